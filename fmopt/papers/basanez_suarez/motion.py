"""Gross and fine motion: where along a path which contacts are possible, and how far off a motion stays gross.

A motion is gross while it touches no CU, fine while it is in one ([BasanezSuarez], Conclusions). The answers are
bounds: a contact that is not listed is impossible, a clearance is never overstated.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError, InfeasibleError
from fmopt.papers.basanez_suarez.c_obstacle import PossibleContacts
from fmopt.papers.basanez_suarez.contact import CU, FULL, Range
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.spatial.values import Array, Bits, Indices, frozen


class MotionKind(StrEnum):
    """What a part of a motion is; blocked when the nominal objects overlap beyond any possible contact."""

    GROSS = "gross"
    FINE = "fine"
    BLOCKED = "blocked"


@dataclass(frozen=True)
class ContactPhase:
    """A part of a path with one set of possible contacts."""

    kind: MotionKind
    start: float
    end: float
    contacts: tuple[CU, ...]


@dataclass(frozen=True, eq=False)
class _Spans:
    """Intervals [low, high] ⊆ [0, 1] of straight parts of a path, each for one contact."""

    contact: Indices
    part: Indices
    low: Array
    high: Array

    def kept(self, mask: Bits) -> "_Spans":
        return _Spans(self.contact[mask], self.part[mask], self.low[mask], self.high[mask])

    def halves(self) -> "_Spans":
        middle = 0.5 * (self.low + self.high)
        low, high = np.concatenate([self.low, middle]), np.concatenate([middle, self.high])
        return _Spans(np.tile(self.contact, 2), np.tile(self.part, 2), low, high)


def classify(
    path: ArrayLike, static: Profile, moving: Profile, deviations: Deviations, tolerance: float
) -> tuple[ContactPhase, ...]:
    """The phases of a motion, in order, with the basic contacts that are possible in each.

    The path is waypoints (k, 3), x and y in m and φ in rad, not taken modulo 2π, straight in between, of the grasped
    object in the frame of the gripper's reference point. A contact is listed where it is possible and at most where a
    CU is nearer than the tolerance, m.

    Raises:
        GeometryError: fewer than two waypoints, or a tolerance that is not positive.
    """
    points = _waypoints(path, tolerance)
    possible = PossibleContacts.between(moving, static, deviations)
    touching = possible_spans(possible, points, tolerance)
    ends = {0.0, float(len(points) - 1)}
    moments = sorted(ends | {t for spans in touching.values() for span in spans for t in span})
    phases: list[ContactPhase] = []
    for start, end in pairwise(moments):
        middle = 0.5 * (start + end)
        active = [i for i, spans in touching.items() if any(low <= middle <= high for low, high in spans)]
        # Which contacts may occur changes only at ends of spans: the middle speaks for the phase.
        contacts = tuple(possible.sets[i] for i in sorted(active))
        part = min(int(middle), len(points) - 2)
        pose = points[part] + (middle - part) * (points[part + 1] - points[part])
        kind = MotionKind.FINE if contacts else _free_or_blocked(pose, static, moving)
        phases.append(ContactPhase(kind, start, end, contacts))
    return tuple(phases)


def possible_spans(
    possible: PossibleContacts, path: ArrayLike, tolerance: float
) -> dict[int, tuple[tuple[float, float], ...]]:
    """For each contact that may occur (index in `possible.sets`) where on a path (n, 3) it may: spans of its parameter.

    The distance from a CU changes by at most |Δp| + reach |Δφ| along a part of the path. A span that this proves free
    is dropped, one that it proves inside is kept, any other is halved until the change over it is below the tolerance.
    The path is straight from row to row, x and y in m, φ in rad; nearer to a CU than the tolerance, m, counts as on it.
    """
    points = _waypoints(path, tolerance)
    spans, found = _starting_spans(possible, points), []
    while len(spans.contact):
        gap, slope = _gaps(possible, points, spans)
        # By how much the distance may change over a span, at most: to either side of its middle by half.
        change = slope * (spans.high - spans.low)
        inside = (gap <= -0.5 * change) | ((gap <= 0.5 * change) & (change <= tolerance))
        found.append(spans.kept(inside))
        spans = spans.kept(~inside & (gap <= 0.5 * change)).halves()
    return _joined(found)


def clearance(possible: PossibleContacts, path: ArrayLike, tolerance: float) -> float:
    """A lower bound (m), within `tolerance`, of the distance between a path and all CU in the plane of each φ.

    Positive for a gross motion, and for one that overlaps throughout; ∞ when no contact is possible at its
    orientations. Inside a CU it is the distance from the core less the radius, no measure of depth. The work grows with
    the length of path at about the least distance, over the tolerance. The path (n, 3) is straight from row to row, x
    and y in m, φ in rad. The tolerance is in m.
    """
    points = _waypoints(path, tolerance)
    spans, least = _starting_spans(possible, points), math.inf
    while len(spans.contact):
        gap, slope = _gaps(possible, points, spans)
        least = min(least, float(gap.min()))
        # Only spans that may still come below the least by more than the tolerance are halved on.
        spans = spans.kept(gap - 0.5 * slope * (spans.high - spans.low) < least - tolerance).halves()
    return least - tolerance


def clearance_for_gross(
    path: ArrayLike, static: Profile, moving: Profile, deviations: Deviations, farthest: ArrayLike, tolerance: float
) -> float:
    """A displacement c (m) such that the path moved by any of c to the farthest is gross.

    Moving a path by c changes its clearance by at most c, so that a path with clearance m may be moved back by m. At
    the answer either c = 0, or the clearance is below twice the tolerance, or c is the farthest.

    Path, objects and tolerance are those of `classify`; the farthest displacement (2,), m, is away from the static one.

    Raises:
        InfeasibleError: the motion is not gross at the farthest.
        GeometryError: the farthest displacement has no length.
    """
    points = _waypoints(path, tolerance)
    away = frozen(farthest, 2, name="farthest")
    limit = math.hypot(*away)
    if not limit > 0.0:
        raise GeometryError("the direction of a clearance has no length", "give a vector away from the static object")
    step = np.append(away / limit, 0.0)
    possible = PossibleContacts.between(moving, static, deviations)
    at, margin = limit, clearance(possible, points + limit * step, 0.5 * tolerance)
    if margin <= 0.0:
        short = f"moved by {limit:.6g} m the motion is {-margin:.3g} m short of gross"
        raise InfeasibleError(short, -margin, "raise the limit, or turn less")
    if _free_or_blocked(points[0] + limit * step, static, moving) is MotionKind.BLOCKED:
        overlap = f"moved by {limit:.6g} m the objects overlap"
        raise InfeasibleError(overlap, 0.0, "raise the limit, or turn the direction")
    while margin > 0.5 * tolerance and at > 0.0:
        # By the margin at least it can come nearer: the distance changes by no more than the way.
        at -= margin
        margin = clearance(possible, points + at * step, 0.5 * tolerance)
    # Too far by half the tolerance is still gross, too near is not.
    return min(at + 0.5 * tolerance, limit) if at > 0.0 else 0.0


def _waypoints(path: ArrayLike, tolerance: float) -> Array:
    points = frozen(path, None, 3, name="path")
    if len(points) < 2:
        raise GeometryError(f"a path with {len(points)} waypoints", "give at least two")
    if not tolerance > 0.0:
        raise GeometryError(f"a motion followed to a tolerance of {tolerance} m", "give a positive one")
    return points


def _starting_spans(possible: PossibleContacts, points: Array) -> _Spans:
    """Where along the path the orientation allows each contact."""
    rows = []
    for part, (one, other) in enumerate(pairwise(points[:, 2])):
        for contact, cu in enumerate(possible.sets):
            rows += [(contact, part, *span) for span in _turn_spans(float(one), float(other), cu.range)]
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return _Spans(table[:, 0].astype(np.intp), table[:, 1].astype(np.intp), table[:, 2], table[:, 3])


def _turn_spans(start: float, end: float, allowed: Range) -> list[tuple[float, float]]:
    """Parameters t ∈ [0, 1] at which start + t (end − start) lies in the range, at any number of turns."""
    low, high = allowed.low, allowed.high
    if high - low >= FULL:
        return [(0.0, 1.0)]
    # Angles of the path and ranges differ by whole turns: all that overlap are taken.
    least, most = min(start, end) - 1e-12, max(start, end) + 1e-12
    spans = []
    for turn in range(math.ceil((least - high) / FULL), math.floor((most - low) / FULL) + 1):
        a, b = low + turn * FULL, high + turn * FULL
        if start == end:
            return [(0.0, 1.0)]
        t = sorted(((a - start) / (end - start), (b - start) / (end - start)))
        spans.append((min(max(t[0], 0.0), 1.0), min(max(t[1], 0.0), 1.0)))
    return spans


def _gaps(possible: PossibleContacts, points: Array, spans: _Spans) -> tuple[Array, Array]:
    """Distance (k,) from the CU in the middle of each span, m, and how fast it may change with t, m."""
    step = np.diff(points, axis=0)[spans.part]
    poses = points[spans.part] + (0.5 * (spans.low + spans.high))[:, None] * step
    reach = np.array([cu.reach for cu in possible.sets])[spans.contact]
    # Lipschitz: translation moves points by as much, a turn by the reach times its angle.
    slope = np.hypot(step[:, 0], step[:, 1]) + reach * np.abs(step[:, 2])
    return possible.pair_gaps(poses, spans.contact), slope


def _joined(found: list[_Spans]) -> dict[int, tuple[tuple[float, float], ...]]:
    """Spans of each contact as path parameters, those that touch made one."""
    columns = (np.stack([spans.contact, spans.part + spans.low, spans.part + spans.high], axis=1) for spans in found)
    rows = sorted((int(contact), low, high) for each in columns for contact, low, high in each.tolist())
    joined: dict[int, list[tuple[float, float]]] = {}
    for contact, low, high in rows:
        mine = joined.setdefault(contact, [])
        if mine and low <= mine[-1][1] + 1e-12:
            mine[-1] = (mine[-1][0], max(mine[-1][1], high))
        else:
            mine.append((low, high))
    return {contact: tuple(spans) for contact, spans in joined.items()}


def _free_or_blocked(pose: Array, static: Profile, moving: Profile) -> MotionKind:
    overlap = moving.region(pose).intersection(static.region((0.0, 0.0, 0.0)))
    # Touching alone is free: overlap has an area.
    return MotionKind.BLOCKED if overlap.area > 0.0 else MotionKind.GROSS
