"""What the sets of possible contact say of a plan in the plane: gross and fine parts, and whether S(t) agrees.

In the plane of x and z, φ runs counter-clockwise as drawn, x to the right and z up: a turn by ry about y is φ = −ry.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import InfeasibleError
from fmopt.geometry.plane.curve import Arc
from fmopt.papers.basanez_suarez import motion
from fmopt.papers.basanez_suarez.boundary import BoundaryPiece
from fmopt.papers.basanez_suarez.c_obstacle import PossibleContacts
from fmopt.papers.basanez_suarez.contact import CU, ContactType
from fmopt.papers.basanez_suarez.edge import TurnedEdge, edge_position
from fmopt.papers.basanez_suarez.motion import MotionKind, classify, clearance_for_gross, possible_spans
from fmopt.papers.basanez_suarez.planar_set import PlanarSet
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.reach import Reach
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.papers.basanez_suarez.vertex import vertex_position
from fmopt.plan.diagnostics import Agreement, Boundary, Curve, Phase, Planar, PlanarSegment, Slice, Surface
from fmopt.plan.field_types import numbers, polyline
from fmopt.spatial.values import Array, Value

_TOLERANCE = 1e-5  # m, to which motions are followed
_SIDEWAYS = 1.5  # times the deviation: how far a part is carried to either side above the mouth


@dataclass(frozen=True, eq=False)
class PlanarWay(Value, path=(2, 3)):
    """A straight part of a motion with the errors on it.

    Args:
        path: its two ends (2, 3), x and z in m and φ in rad.
        position: greatest deviation of the reference point, m.
        angle: greatest deviation of the orientation, rad.
    """

    path: Array
    position: float
    angle: float


@dataclass(frozen=True, eq=False)
class PlanarPath(Value, path=(None, 3), times=("path",)):
    """The nominal trajectory in the plane, and which of x, z and ry S(t) says are stopped when.

    Args:
        path: waypoints (k, 3), x and z in m and φ in rad.
        times: of the waypoints (k,), s.
        stops: start and end of each interval of S, s, and whether it stops anything in the plane.
    """

    path: Array
    times: Array
    stops: tuple[tuple[float, float, bool], ...]

    def time(self, parameter: float) -> float:
        """When a parameter of the path, waypoint i at i, is passed, s."""
        return float(np.interp(parameter, np.arange(len(self.times)), self.times))


def in_plane(poses: ArrayLike) -> Array:
    """Configurations (…, 3), x and z in m and φ in rad, of poses (…, 6) without a motion out of the plane."""
    x = np.asarray(poses, dtype=np.float64)
    # The plane is x-z, seen so that z goes up: a turn about y from z to x is clockwise there.
    return np.stack([x[..., 0], x[..., 2], -x[..., 4]], axis=-1)


def account(moving: ArrayLike, fixed: Sequence[ArrayLike], nominal: PlanarPath, run: Sequence[PlanarWay]) -> Planar:
    """The planar part of a plan's diagnostics, of the motion in order.

    Corners (n, 2) of the moving profile are about its reference point, loops (k, 2) those of the fixed one, m.
    """
    grasped, static = Profile.of(moving), Profile.of(*fixed)
    first = run[0]
    start = _deviations(static, first)
    phases = classify(nominal.path, static, grasped, start, _TOLERANCE)
    shown = _shown(PossibleContacts.between(grasped, static, start), run)
    aside = _SIDEWAYS * first.position
    return Planar(
        position=first.position,
        angle=first.angle,
        nominal=tuple(_phase(phase, nominal.time(phase.start), nominal.time(phase.end)) for phase in phases),
        agreement=_agreement(phases, nominal),
        segments=tuple(_stretch(stretch, grasped, static) for stretch in run),
        sets=tuple(one for cu, pose in shown for one in contact_sets(cu, float(pose[2]), pose)),
        surfaces=tuple(surface(cu) for cu, _ in shown),
        aside=aside,
        height=_height(first, aside, grasped, static, start),
    )


def _deviations(static: Profile, stretch: PlanarWay) -> Deviations:
    return Deviations(np.zeros(len(static.vertices)), stretch.position, stretch.angle)


def _phase(phase: motion.ContactPhase, start: float, end: float) -> Phase:
    return Phase(str(phase.kind), start, end, tuple(cu.name for cu in phase.contacts))


def _stretch(stretch: PlanarWay, grasped: Profile, static: Profile) -> PlanarSegment:
    """Gross and fine parts of a stretch, from 0 to 1; a part becomes fine where a contact becomes possible."""
    phases = classify(stretch.path, static, grasped, _deviations(static, stretch), _TOLERANCE)
    kinds = {phase.kind for phase in phases}
    # A stretch is named by the worst of its phases; free and in touch by turns is fine motion.
    whole = MotionKind.BLOCKED if MotionKind.BLOCKED in kinds else MotionKind.FINE if len(kinds) > 1 else kinds.pop()
    return PlanarSegment(str(whole), tuple(_phase(phase, phase.start, phase.end) for phase in phases))


def _agreement(phases: Sequence[motion.ContactPhase], nominal: PlanarPath) -> Agreement:
    """Where on the nominal trajectory the sets allow a contact and S(t) stops a motion, in seconds.

    S takes the errors as a box and contact surfaces as planes at the nominal pose, the sets take a disc around that box
    and turns as they are. Hence the sets may allow more; that S stops a motion where no contact is possible would be a
    fault of one of them.
    """
    spans = [(nominal.time(p.start), nominal.time(p.end), p.kind is not MotionKind.GROSS) for p in phases]
    times = sorted({t for spans_ in (spans, nominal.stops) for start, end, _ in spans_ for t in (start, end)})
    found = {"both": 0.0, "neither": 0.0, "only_possible": 0.0, "only_stopped": 0.0}
    for start, end in pairwise(times):
        # Between all ends neither answer changes: the middle speaks for the interval.
        middle = 0.5 * (start + end)
        possible, stopped = (any(a <= middle <= b and on for a, b, on in s) for s in (spans, nominal.stops))
        name = {(1, 1): "both", (0, 0): "neither", (1, 0): "only_possible", (0, 1): "only_stopped"}[possible, stopped]
        found[name] += end - start
    # Both methods end their spans within their own tolerance: what is shorter than that is no disagreement.
    blur = 1e-9 * float(nominal.times[-1]) + _TOLERANCE * _pace(nominal)
    agrees = found["only_stopped"] <= blur
    words = "S(t) stops motions only where the sets allow a contact"
    if not agrees:
        words = "S(t) stops a motion where the sets allow no contact: one of the two is wrong"
    elif found["only_possible"] > blur:
        words += "; the sets allow some earlier, as they take the errors as a disc around the box and turns as they are"
    return Agreement(**found, agrees=agrees, words=words)


def _pace(nominal: PlanarPath) -> float:
    """The slowest pace along the path, s/m: what a length of tolerance takes at most."""
    lengths = np.hypot(*np.diff(nominal.path[:, :2], axis=0).T)
    moving = lengths > 0.0
    return float((np.diff(nominal.times)[moving] / lengths[moving]).max(initial=0.0))


def _height(first: PlanarWay, aside: float, grasped: Profile, static: Profile, start: Deviations) -> float | None:
    """How far above its start the part is to be carried sideways so that it meets nothing, m; None beyond its size."""
    # To both sides by more than the part may be off: the motion that a robot makes above the mouth.
    path = first.path[[0, 0]] + np.array([[-aside, 0.0, 0.0], [aside, 0.0, 0.0]])
    limit = float(np.ptp(grasped.vertices, axis=0).max())
    try:
        return clearance_for_gross(path, static, grasped, start, (0.0, limit), _TOLERANCE)
    except InfeasibleError:
        return None


def _shown(possible: PossibleContacts, run: Sequence[PlanarWay]) -> list[tuple[CU, Array]]:
    """Of each type the contact that becomes possible first, type 2 in both cases, and the pose where it does."""
    # One contact of each sort is shown, the first that may occur.
    found: dict[object, tuple[CU, Array]] = {}
    for stretch in run:
        spans = possible_spans(possible, stretch.path, 100.0 * _TOLERANCE)
        for index in sorted(spans, key=lambda i: (spans[i][0][0], i)):
            cu, t = possible.sets[index], spans[index][0][0]
            found.setdefault(_sort(cu), (cu, stretch.path[0] + t * (stretch.path[1] - stretch.path[0])))
    return [found[key] for key in sorted(found, key=str)]


def _sort(cu: CU) -> str:
    if cu.kind is ContactType.TYPE_1:
        return cu.kind
    e = cu.edge[1] - cu.edge[0]
    along = -float(cu.edge[0] @ e) / float(e @ e)
    # Two shapes of CU: with the foot of the reference point on the edge, or beside it.
    return f"{cu.kind} {'A' if 0.0 < along < 1.0 else 'B'}"


def reach_of(half_widths: ArrayLike) -> tuple[float, float]:
    """The disc (m) and the turn (rad) in the plane that hold errors with these half-widths (6,)."""
    a = np.asarray(half_widths, dtype=np.float64)
    # The circle about the box: the paper's deviations are discs.
    return math.hypot(a[0], a[2]), float(a[4])


def boundary(found: PlanarSet, name: str, nominal: ArrayLike = ()) -> Boundary:
    """A set with its name, its boundary, and the polyline (k, 2), m, that it shrinks to without deviations, if any."""
    return Boundary(name, tuple(tuple(map(_curve, loop)) for loop in found.boundary()), polyline(nominal))


def _curve(piece: BoundaryPiece) -> Curve:
    curve = piece.curve
    if isinstance(curve, Arc):
        x, y = numbers(curve.centre)
        return Curve(str(piece.on), arc=(x, y, curve.radius, curve.start, curve.sweep))
    (x, y), (u, v) = polyline([curve.start, curve.end])
    return Curve(str(piece.on), line=(x, y, u, v))


def contact_sets(cu: CU, phi: float, pose: Sequence[float] | Array) -> list[Boundary]:
    """The sets of one contact at an orientation φ (rad): where the feature may be, and what reference points touch.

    Type 1: Uv, CUv of the middle of the edge, CUl. Type 2: Ul with its case, CUl. Uv and Ul are drawn at the reference
    point (2,) of `pose`, m.
    """
    reference = np.asarray(pose, dtype=np.float64)[:2]
    core = _core(cu, phi)
    touching = boundary(cu.at(phi), f"CUl of {cu.name}", core)
    if cu.kind is ContactType.TYPE_1:
        reach = Reach.of(cu.vertex)
        held = vertex_position(reference, phi, reach, cu.spread, cu.radius)
        there = reference + reach.point(phi)
        point = boundary(cu.point_contact(phi, 0.5), f"CUv of {cu.name}", core.mean(axis=0))
        return [boundary(held, f"Uv of vertex {cu.moving}", there), point, touching]
    edge = edge_position(reference, phi, cu.edge[0], cu.edge[1], cu.spread, cu.radius)
    ends = edge_position(reference, phi, cu.edge[0], cu.edge[1], 0.0, 0.0)
    name = f"Ul of edge {cu.moving}, case {edge.case.value}"
    return [boundary(edge, name, reference + np.array([ends.start, ends.end])), touching]


def _core(cu: CU, phi: float) -> Array:
    """The segment (2, 2) of reference points that make the contact without deviations: what its set shrinks to."""
    at = replace(cu, spread=0.0, radius=0.0).at(phi)
    if isinstance(at, TurnedEdge):
        return np.asarray(at.pivot + np.array([at.start, at.end]))
    arm = at.h * np.array([math.cos(at.angle), math.sin(at.angle)])
    return np.asarray(np.array([at.start, at.end]) + arm)


def surface(cu: CU, count: int = 25) -> Surface:
    """CU over its range of φ, in slices, with the nominal C-surface (a segment a slice) where there is one."""
    # Whole turns are taken off, so that φ is shown near zero.
    turns = 2.0 * math.pi * round((cu.range.low + cu.range.high) / (4.0 * math.pi))
    low, high = cu.range.low - turns, min(cu.range.high, cu.range.low + 2.0 * math.pi) - turns
    slices = []
    for phi in np.linspace(low, high, count).tolist():
        nominal = _core(cu, phi) if cu.nominal is not None and cu.nominal.contains(phi) else ()
        slices.append(Slice(phi, boundary(cu.at(phi), "CUl", nominal)))
    return Surface(cu.name, str(cu.kind), tuple(slices))
