"""What the sets of possible contact say of a plan in the plane: gross and fine parts, and whether S(t) agrees.

In the plane of x and z the orientation φ runs counter-clockwise as drawn, x to the right and z up: a turn by ry about y
is φ = −ry.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import InfeasibleError
from fmopt.uncertainty.planar.c_obstacle import PossibleContacts
from fmopt.uncertainty.planar.contact import CU, Kind
from fmopt.uncertainty.planar.motion import MotionKind, Phase, classify, clearance_for_gross, possible_spans
from fmopt.uncertainty.planar.profile import Profile
from fmopt.uncertainty.planar.record import contact_records, surface_record
from fmopt.uncertainty.sources import Deviations
from fmopt.values import Array, Value, frozen

_TOLERANCE = 1e-5  # m, to which motions are followed
_SIDEWAYS = 1.5  # times the deviation: how far a part is carried to either side above the mouth


@dataclass(frozen=True, eq=False)
class Stretch(Value):
    """A straight part of a motion with the errors on it.

    Args:
        path: its two ends (2, 3), x and z in m and φ in rad.
        position: greatest deviation of the reference point, m.
        angle: greatest deviation of the orientation, rad.
    """

    path: Array
    position: float
    angle: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", frozen(self.path, 2, 3, name="path"))


@dataclass(frozen=True, eq=False)
class Nominal(Value):
    """The nominal trajectory in the plane, and which of x, z and ry S(t) says are stopped when.

    Args:
        path: waypoints (k, 3), x and z in m and φ in rad.
        times: of the waypoints (k,), s.
        stops: start and end of each interval of S, s, and whether it stops anything in the plane.
    """

    path: Array
    times: Array
    stops: tuple[tuple[float, float, bool], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", frozen(self.path, None, 3, name="path"))
        object.__setattr__(self, "times", frozen(self.times, len(self.path), name="times"))

    def time(self, parameter: float) -> float:
        """When a parameter of the path, waypoint i at i, is passed, s."""
        return float(np.interp(parameter, np.arange(len(self.times)), self.times))


def in_plane(poses: ArrayLike) -> Array:
    """Configurations (…, 3), x and z in m and φ in rad, of poses (…, 6) without a motion out of the plane."""
    x = np.asarray(poses, dtype=np.float64)
    return np.stack([x[..., 0], x[..., 2], -x[..., 4]], axis=-1)


def account(moving: ArrayLike, fixed: Sequence[ArrayLike], nominal: Nominal, run: Sequence[Stretch]) -> dict[str, Any]:
    """The planar part of a plan's diagnostics.

    Args:
        moving: corners (n, 2) of the moving profile about its reference point, m.
        fixed: loops (k, 2) of the fixed one, m.
        nominal: the nominal trajectory, on which the errors are those of the first stretch.
        run: the motion, in order.
    """
    grasped, static = Profile.of(moving), Profile.of(*fixed)
    first = run[0]
    start = _deviations(static, first)
    phases = classify(nominal.path, static, grasped, start, _TOLERANCE)
    possible = PossibleContacts.between(grasped, static, start)
    shown = _shown(possible, run)
    return {
        "deviations": {"position": first.position, "angle": first.angle},
        "nominal": [_phase(phase, nominal.time(phase.start), nominal.time(phase.end)) for phase in phases],
        "agreement": _agreement(phases, nominal),
        "segments": [_stretch(stretch, grasped, static) for stretch in run],
        "carry": _carry(first, grasped, static, start),
        "sets": [record for cu, pose in shown for record in contact_records(cu, float(pose[2]), pose)],
        "surfaces": [surface_record(cu) for cu, _ in shown],
    }


def _deviations(static: Profile, stretch: Stretch) -> Deviations:
    return Deviations(np.zeros(len(static.vertices)), stretch.position, stretch.angle)


def _phase(phase: Phase, start: float, end: float) -> dict[str, Any]:
    contacts = [cu.name for cu in phase.contacts]
    return {"kind": str(phase.kind), "start": start, "end": end, "contacts": contacts}


def _stretch(stretch: Stretch, grasped: Profile, static: Profile) -> dict[str, Any]:
    """Gross and fine parts of a stretch, from 0 to 1; a part becomes fine where a contact becomes possible."""
    phases = classify(stretch.path, static, grasped, _deviations(static, stretch), _TOLERANCE)
    kinds = {phase.kind for phase in phases}
    whole = MotionKind.BLOCKED if MotionKind.BLOCKED in kinds else MotionKind.FINE if len(kinds) > 1 else kinds.pop()
    return {"kind": str(whole), "phases": [_phase(phase, phase.start, phase.end) for phase in phases]}


def _agreement(phases: Sequence[Phase], nominal: Nominal) -> dict[str, Any]:
    """Where on the nominal trajectory the sets allow a contact and S(t) stops a motion, in seconds.

    S takes the errors as a box and contact surfaces as planes at the nominal pose, the sets take a disc around that box
    and turns as they are. Hence the sets may allow more; that S stops a motion where no contact is possible would be a
    fault of one of them.
    """
    spans = [(nominal.time(p.start), nominal.time(p.end), p.kind is not MotionKind.GROSS) for p in phases]
    times = sorted({t for spans_ in (spans, nominal.stops) for start, end, _ in spans_ for t in (start, end)})
    found = {"both": 0.0, "neither": 0.0, "only_possible": 0.0, "only_stopped": 0.0}
    for start, end in pairwise(times):
        middle = 0.5 * (start + end)
        possible, stopped = (any(a <= middle <= b and on for a, b, on in s) for s in (spans, nominal.stops))
        name = {(1, 1): "both", (0, 0): "neither", (1, 0): "only_possible", (0, 1): "only_stopped"}[possible, stopped]
        found[name] += end - start
    blur = 1e-9 * float(nominal.times[-1]) + _TOLERANCE * _pace(nominal)
    agrees = found["only_stopped"] <= blur
    words = "S(t) stops motions only where the sets allow a contact"
    if not agrees:
        words = "S(t) stops a motion where the sets allow no contact: one of the two is wrong"
    elif found["only_possible"] > blur:
        words += "; the sets allow some earlier, as they take the errors as a disc around the box and turns as they are"
    return {**found, "agrees": agrees, "words": words}


def _pace(nominal: Nominal) -> float:
    """The slowest pace along the path, s/m: what a length of tolerance takes at most."""
    lengths = np.hypot(*np.diff(nominal.path[:, :2], axis=0).T)
    moving = lengths > 0.0
    return float((np.diff(nominal.times)[moving] / lengths[moving]).max(initial=0.0))


def _carry(first: Stretch, grasped: Profile, static: Profile, start: Deviations) -> dict[str, Any]:
    """How far above its start the part is to be carried sideways so that it meets nothing, m; None beyond its size."""
    aside = _SIDEWAYS * first.position
    path = first.path[[0, 0]] + np.array([[-aside, 0.0, 0.0], [aside, 0.0, 0.0]])
    limit = float(np.ptp(grasped.vertices, axis=0).max())
    try:
        height = clearance_for_gross(path, static, grasped, start, (0.0, 1.0), limit, _TOLERANCE)
    except InfeasibleError:
        return {"aside": aside, "height": None}
    return {"aside": aside, "height": height}


def _shown(possible: PossibleContacts, run: Sequence[Stretch]) -> list[tuple[CU, Array]]:
    """Of each type the contact that becomes possible first, type 2 in both cases, and the pose where it does."""
    found: dict[object, tuple[CU, Array]] = {}
    for stretch in run:
        spans = possible_spans(possible, stretch.path, 100.0 * _TOLERANCE)
        for index in sorted(spans, key=lambda i: (spans[i][0][0], i)):
            cu, t = possible.sets[index], spans[index][0][0]
            pose = stretch.path[0] + t * (stretch.path[1] - stretch.path[0])
            found.setdefault(_sort(cu), (cu, pose))
    return [found[key] for key in sorted(found, key=str)]


def _sort(cu: CU) -> str:
    if cu.kind is Kind.TYPE_1:
        return cu.kind
    e = cu.edge[1] - cu.edge[0]
    along = -float(cu.edge[0] @ e) / float(e @ e)
    return f"{cu.kind} {'A' if 0.0 < along < 1.0 else 'B'}"


def reach_of(half_widths: ArrayLike) -> tuple[float, float]:
    """The disc (m) and the turn (rad) in the plane that hold errors with these half-widths (6,)."""
    a = np.asarray(half_widths, dtype=np.float64)
    return math.hypot(a[0], a[2]), float(a[4])
