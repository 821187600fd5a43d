"""The nominal trajectory P(t) of an insertion along the mating axis, [LeeHuang1985] section 4.1.1, step 3.

S(t) as intervals: what is stopped when, joined to a piecewise constant function, [LeeHuang1985] section 4.1.2.

Critical poses: where along the nominal path the set of faces that constrain the moving part sideways changes.

A lateral pair is a face of the moving part and a face of the fixed part, neither perpendicular to the mating axis, that
look at each other across a narrow gap while their heights overlap. The pair begins, ends or changes its kind where an
end of the one face's heights passes an end of the other's: there a vertex or edge enters or leaves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import GeometryError
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Face, Polyhedron, placed
from fmopt.plan.diagnostics import Interval
from fmopt.spatial.se3 import Pose, turns
from fmopt.spatial.values import Array, Bits, Value

_AT_GOAL = 1e-11  # of T: what begins this late only the goal touches
_FLAT = 1e-9  # |n × z| of a face that is perpendicular to the axis
_SAME = 1e-12  # m, heights this close are one


@dataclass(frozen=True, eq=False)
class NominalTrajectory(Value, nodes=(None, 6), times=("nodes",)):
    """P(t), piecewise linear in the six numbers (x, y, z, r) of the moving part's pose in the B-frame.

    Nodes (n, 6) are in m and rad, of neighbouring rotation vectors on one branch, |r| may exceed π; times (n,), s, rise
    from 0.
    """

    nodes: Array
    times: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.times) < 2 or self.times[0] != 0.0 or np.any(np.diff(self.times) <= 0.0):
            raise ValueError(f"the times of a trajectory start at 0 and grow, not {self.times}")

    @property
    def duration(self) -> float:
        """T, s."""
        return float(self.times[-1])

    def at(self, t: float) -> Array:
        """P(t) as six numbers (x, y, z, r) in m and rad; before 0 and after T the part rests."""
        return np.array([np.interp(t, self.times, self.nodes[:, axis]) for axis in range(6)])

    def pose(self, t: float) -> Pose:
        """P(t) as a pose."""
        return Pose.from_vector(self.at(t))

    def frames(self, times: Array) -> tuple[Array, Array]:
        """Positions (n, 3) in m and rotation matrices (n, 3, 3) at times (n,)."""
        P = np.stack([np.interp(times, self.times, self.nodes[:, axis]) for axis in range(6)], axis=-1)
        return P[:, :3], turns(P[:, 3:])


def insertion(start: ArrayLike, goal: ArrayLike, speed: float, rho: float, turned: float = 1.0) -> NominalTrajectory:
    """The paper's three nodes: N₁ above the mouth, N₂ on the axis in the mouth's plane, N_T seated.

    The orientation of the goal is reached at N₂, or before it. Each leg is as long as ‖ΔP‖ = √(|Δp|² + ρ²|Δr|²) and
    takes that over the speed, so that no point within ρ of the axis of turning outruns the specification.

    Poses are (6,) in the B-frame, m and rad, the start not below the mouth's plane z = 0, the goal below it; the speed
    is in m/s. `turned` is the share of the way from N₁ to N₂ after which the goal's orientation is reached, above 0, at
    most 1; below 1 it is one more node, where the part turns.

    Raises:
        GeometryError: the goal is not inside the hollow feature, or the start not outside.
    """
    first, last = np.asarray(start, dtype=np.float64).copy(), np.asarray(goal, dtype=np.float64)
    if last[2] >= 0.0:
        message = f"the goal lies {last[2]:.6g} m above the mouth of the hollow feature, where nothing is inserted"
        raise GeometryError(message, "give a goal with z below 0 in the B-frame, whose z points out of the mouth")
    if first[2] < 0.0:
        message = f"the start lies {-first[2]:.6g} m below the mouth of the hollow feature"
        raise GeometryError(message, "give a start with z of 0 or more in the B-frame")
    return through([first[:3], np.zeros(3), last[:3]], first[3:], last[3:], speed, rho, (0, turned))


def through(
    positions: Sequence[ArrayLike],
    start_turn: ArrayLike,
    goal_turn: ArrayLike,
    speed: float,
    rho: float,
    turned: tuple[int, float] = (0, 1.0),
) -> NominalTrajectory:
    """P(t) through position nodes N₁ … N_T, its orientation nodes M, and its times.

    The part turns evenly on one leg, from its start up to a share of it, from the start's orientation to the goal's.

    Nodes are (3,) in m, M are rotation vectors (3,), rad, the speed is in m/s, and ρ, m, as for `insertion`. `turned`
    is the leg on which the part turns, from 0, and the share of it, above 0, at most 1.

    Raises:
        ValueError: there is no such leg, or no such share.
    """
    points = [np.asarray(position, dtype=np.float64) for position in positions]
    leg, share = turned
    if not (0 <= leg < len(points) - 1 and 0.0 < share <= 1.0):
        raise ValueError(f"a part cannot turn on the share {share} of leg {leg} of {len(points) - 1}")
    last = np.asarray(goal_turn, dtype=np.float64)
    # Of all rotation vectors of one rotation the nearest, or the part would turn the long way round.
    first = nearest_branch(np.asarray(start_turn, dtype=np.float64), last)
    nodes = [np.concatenate([point, first if k <= leg else last]) for k, point in enumerate(points)]
    if share < 1.0 and np.any(first != last):
        nodes.insert(leg + 1, np.concatenate([points[leg] + share * (points[leg + 1] - points[leg]), last]))
    steps = np.diff(nodes, axis=0)
    # Turning takes time by how far a point ρ away moves.
    lengths = [float(np.hypot(np.linalg.norm(d[:3]), rho * np.linalg.norm(d[3:]))) for d in steps]
    # Nodes of no length are left out: times have to grow.
    kept = [nodes[0], *(node for node, length in zip(nodes[1:], lengths, strict=True) if length > 0.0)]
    times = np.cumsum([length for length in lengths if length > 0.0]) / speed
    return NominalTrajectory(np.array(kept), np.concatenate([[0.0], times]))


def nearest_branch(r: Array, target: Array) -> Array:
    """The rotation vector r + 2πk r/|r|, (3,) in rad, nearest to `target`; 0 stays, having no axis to turn on about."""
    angle = float(np.linalg.norm(r))
    if angle == 0.0:
        return r
    choices = [r * (1.0 + 2.0 * np.pi * k / angle) for k in (0, -1, 1)]
    return min(choices, key=lambda choice: float(np.linalg.norm(choice - target)))


@dataclass(frozen=True, eq=False)
class Stops(Value):
    """Motions along each degree and against it, bits (n, 6, 2), that are stopped from `start` to `end` (n,), s."""

    start: Array
    end: Array
    bits: Bits


def together(parts: Sequence[Stops]) -> Stops:
    """All that several parts stop."""
    every = (Stops(np.zeros(0), np.zeros(0), np.zeros((0, 6, 2), dtype=bool)), *parts)
    return Stops(*(np.concatenate([getattr(part, name) for part in every]) for name in ("start", "end", "bits")))


def intervals(stops: Stops, duration: float, blur: float) -> tuple[Interval, ...]:
    """S on the cells between all ends, equal neighbours joined; at T also what touches there only.

    The duration is T, s. Ends nearer than `blur`, s, cannot be told apart: starts move to the first, ends to the last.
    """
    # Cells are between all ends; ends that rounding alone tells apart are one.
    ends = np.unique(np.concatenate([[0.0, duration], stops.start, stops.end]))
    opens = np.concatenate([[True], np.diff(ends) > blur])
    group = np.cumsum(opens) - 1
    first, last = ends[opens], ends[np.append(opens[1:], True)]
    # What only the goal touches has no cell of its own, and gets one of no length at T.
    late = stops.start >= duration * (1.0 - _AT_GOAL)
    start = np.where(late, duration, first[group[np.searchsorted(ends, stops.start)]])
    end = last[group[np.searchsorted(ends, stops.end)]]
    cuts = np.unique(np.concatenate([[0.0, duration], start, end]))
    cuts = np.append(cuts, duration)
    t = 0.5 * (cuts[:-1] + cuts[1:])
    on = (start[:, None] <= t) & (t <= end[:, None])
    plus, minus = np.moveaxis((on.T.astype(int) @ stops.bits.reshape(-1, 12)).reshape(-1, 6, 2) > 0, 2, 0)
    # Stopped both ways is 2, one way its sign, not at all 0.
    values = np.where(plus & minus, 2, plus.astype(int) - minus)
    begins = np.flatnonzero(np.concatenate([[True], np.any(values[1:] != values[:-1], axis=1)]))
    edges = np.append(cuts[begins], duration).tolist()
    return tuple(Interval(a, b, tuple(values[k].tolist())) for k, (a, b) in zip(begins, pairwise(edges), strict=True))


@dataclass(frozen=True, eq=False)
class CriticalPose(Value, pose=(6,), labels={"pose": "critical pose"}):
    """A pose (6,) on the nominal trajectory, its time in s, and its name: mouth, step k, exit k, mid-depth, bottom."""

    name: str
    pose: Array
    time: float


@dataclass(frozen=True)
class _Event:
    time: float
    enters: bool


def critical_poses(moving: Part, fixed: Part, path: NominalTrajectory, reach: float) -> tuple[CriticalPose, ...]:
    """The critical poses of an insertion, in the order of time.

    The first is the mouth, where a lateral pair first closes; later ones are a step where faces enter, an exit where
    they only leave; the middle of the last stretch, where the section is fully engaged, is the mid-depth; the last is
    the bottom, the goal. Legs that turn lie above the mouth and have no events. The moving part is in its body frame,
    the fixed one in the B-frame, z along the mating axis. `reach` is the widest gap in m that still constrains, such as
    how far the uncertain part may reach sideways; only the bottom is left where no lateral pair comes within it.
    """
    events: list[_Event] = []
    for (one, t0), (other, t1) in pairwise(zip(path.nodes, path.times, strict=True)):
        # Critical poses are of straight legs along the axis: a turn has no passing of levels.
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
        stops = sorted([*(z for z, _ in passes if min(p[2], q[2]) < z < max(p[2], q[2])), p[2], q[2]])
        probes = (p + (z - p[2]) / travel * (q - p) for z in [*stops, *(0.5 * (u + v) for u, v in pairwise(stops))])
        # Walls that stay farther apart than `reach` all the way touch at no error either.
        if all(abs(_gap(turned, own, fixed, wall, probe)) > reach for probe in probes):
            continue
        for z, at_entry in passes:
            share = (z - p[2]) / travel
            # With a little room for levels at the very ends of the leg.
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
            inside = (z for z in (low, high) if min(a[2], b[2]) + _SAME < z < max(a[2], b[2]) - _SAME)
            found += [(a + (z - a[2]) / (b[2] - a[2]) * (b - a))[:2] for z in inside]
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
