"""Critical poses: where along the nominal path the set of faces that constrain the moving part sideways changes.

A lateral pair is a face of the moving part and a face of the fixed part, neither perpendicular to the mating axis, that
look at each other across a narrow gap while their heights overlap. The pair begins, ends or changes its kind where an
end of the one face's heights passes an end of the other's: there a vertex or edge enters or leaves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Face, Polyhedron, placed
from fmopt.nominal.trajectory import NominalTrajectory
from fmopt.se3 import Pose
from fmopt.values import Array, Value, frozen

_FLAT = 1e-9  # |n × z| of a face that is perpendicular to the axis
_SAME = 1e-12  # m, heights this close are one


@dataclass(frozen=True, eq=False)
class CriticalPose(Value):
    """A pose (6,) on the nominal trajectory, its time in s, and its name: mouth, step k, exit k, mid-depth, bottom."""

    name: str
    pose: Array
    time: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(self.pose, 6, name="critical pose"))


@dataclass(frozen=True)
class _Event:
    time: float
    enters: bool


def critical_poses(moving: Part, fixed: Part, path: NominalTrajectory, reach: float) -> tuple[CriticalPose, ...]:
    """The critical poses of an insertion, in the order of time.

    The first is the mouth, where a lateral pair first closes; later ones are a step where faces enter, an exit where
    they only leave; the middle of the last stretch, where the section is fully engaged, is the mid-depth; the last is
    the bottom, the goal. Legs that turn lie above the mouth and have no events.

    Args:
        moving: in its body frame.
        fixed: in the B-frame, z along the mating axis.
        path: P(t).
        reach: widest gap in m that still constrains, such as how far the uncertain part may reach sideways.

    Returns:
        The poses; only the bottom where no lateral pair comes within `reach`.
    """
    events: list[_Event] = []
    for (one, t0), (other, t1) in pairwise(zip(path.nodes, path.times, strict=True)):
        if np.array_equal(one[3:], other[3:]) and one[2] != other[2]:
            events += _leg_events(moving.polyhedron, fixed.polyhedron, one, other, (float(t0), float(t1)), reach)
    end = path.duration
    merged = _merged([event for event in events if 0.0 < event.time < end * (1.0 - 1e-12)], 1e-12 * end)
    named = list(zip(_names(merged), [event.time for event in merged], strict=True))
    if named:
        named.append(("mid-depth", 0.5 * (named[-1][1] + end)))
    named.append(("bottom", end))
    return tuple(CriticalPose(name, path.at(time), time) for name, time in named)


def _leg_events(
    moving: Polyhedron, fixed: Polyhedron, one: Array, other: Array, times: tuple[float, float], reach: float
) -> Iterator[_Event]:
    turned = placed(moving, Pose.from_vector(np.concatenate([np.zeros(3), one[3:]])))
    p, q = one[:3], other[:3]
    travel = q[2] - p[2]
    for own, wall in _near_pairs(turned, fixed, np.array([p, q]), reach):
        a, b = _heights(turned, own), _heights(fixed, wall)
        entry = 1 if travel < 0.0 else 0
        passes = [(b[j] - a[i], j == entry) for i in (0, 1) for j in (0, 1)]
        inside = [z for z, _ in passes if min(p[2], q[2]) < z < max(p[2], q[2])]
        stops = sorted([*inside, p[2], q[2]])
        probes = (p + (z - p[2]) / travel * (q - p) for z in [*stops, *(0.5 * (u + v) for u, v in pairwise(stops))])
        if all(abs(_gap(turned, own, fixed, wall, probe)) > reach for probe in probes):
            continue
        for z, at_entry in passes:
            share = (z - p[2]) / travel
            if share * abs(travel) >= -_SAME and (share - 1.0) * abs(travel) <= _SAME:
                yield _Event(times[0] + share * (times[1] - times[0]), at_entry)


def _near_pairs(turned: Polyhedron, fixed: Polyhedron, ends: Array, reach: float) -> Iterator[tuple[Face, Face]]:
    """Lateral faces that look at each other and come within `reach` of each other in x and y on the way."""
    walls = [(wall, _outline(fixed, wall)) for wall in fixed.faces if _lateral(wall)]
    for own in filter(_lateral, turned.faces):
        low, high = _outline(turned, own)
        low, high = low + ends[:, :2].min(axis=0) - reach, high + ends[:, :2].max(axis=0) + reach
        for wall, (lower, upper) in walls:
            if own.normal @ wall.normal < 0.0 and np.all(low <= upper) and np.all(lower <= high):
                yield own, wall


def _lateral(face: Face) -> bool:
    return float(np.hypot(face.normal[0], face.normal[1])) > _FLAT


def _outline(body: Polyhedron, face: Face) -> tuple[Array, Array]:
    points = body.vertices[list(face.vertices), :2]
    return points.min(axis=0), points.max(axis=0)


def _heights(body: Polyhedron, face: Face) -> tuple[float, float]:
    z = body.vertices[list(face.vertices), 2]
    return float(z.min()), float(z.max())


def _gap(body: Polyhedron, own: Face, fixed: Polyhedron, wall: Face, p: Array) -> float:
    """Distance along the wall's horizontal normal between the stretches at common heights; infinite without any."""
    a, b = _heights(body, own), _heights(fixed, wall)
    low, high = max(a[0] + p[2], b[0]), min(a[1] + p[2], b[1])
    if high < low - _SAME:
        return np.inf
    n = wall.normal[:2] / np.linalg.norm(wall.normal[:2])
    mine = _stretch(body, own, low - p[2], high - p[2]) @ n
    theirs = _stretch(fixed, wall, low, high) @ n
    return float(mine.min() + p[:2] @ n - theirs.max())


def _stretch(body: Polyhedron, face: Face, low: float, high: float) -> Array:
    """Points (k, 2) in x and y whose hull is the face between two heights."""
    found = []
    for loop in face.loops:
        points = body.vertices[list(loop)]
        found += [point[:2] for point in points if low - _SAME <= point[2] <= high + _SAME]
        for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
            found += [
                (a + (z - a[2]) / (b[2] - a[2]) * (b - a))[:2]
                for z in (low, high)
                if min(a[2], b[2]) + _SAME < z < max(a[2], b[2]) - _SAME
            ]
    return np.array(found)


def _merged(events: list[_Event], tolerance: float) -> list[_Event]:
    merged: list[_Event] = []
    for event in sorted(events, key=lambda event: event.time):
        if merged and event.time - merged[-1].time <= tolerance:
            merged[-1] = _Event(merged[-1].time, merged[-1].enters or event.enters)
        else:
            merged.append(event)
    return merged


def _names(events: list[_Event]) -> list[str]:
    names: list[str] = []
    for event in events:
        kind = "step" if event.enters else "exit"
        names.append(f"{kind} {1 + sum(name.startswith(kind) for name in names)}" if names else "mouth")
    return names
