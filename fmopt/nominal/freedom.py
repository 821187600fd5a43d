"""The freedom decomposition function S(t): which motions of the uncertain moving part are stopped, in three dimensions.

Signs as in [LeeHuang1985] section 4.1.2, for each degree x, y, z, rx, ry, rz of the B-frame about the moving part's
reference point: 0 free; 1 motion along the degree (+) is stopped; −1 motion against it (−) is stopped; 2 both are. The
paper's ball in the max norm and its cone in three planes are the box |dᵢ| ≤ r, |δᵢ| ≤ s of pose errors.

A motion in + is stopped at t when some error in the box brings the parts into a contact whose row N, taken at the
nominal pose, has a negative component there: going on, f would fall. The linearisation's remainder is on the side of
contact, so that where s = 0 no error in the box makes a contact of that degree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fmopt.geometry.part import Part
from fmopt.nominal.intervals import Bits, FreedomInterval, Stop, intervals
from fmopt.nominal.slack import slack
from fmopt.nominal.touch import Body, Candidate, Indices, Linear, candidates, linear
from fmopt.nominal.trajectory import NominalTrajectory
from fmopt.values import Array, Value, frozen

_PER_LEG = 8  # samples of a leg besides the passings of vertex levels
_TOUCHING = -1e-9  # slack in scaled units that still counts as touching
_LEVER = 1e-9  # N (–) or N·m per N below which a contact does not stop a degree
_TIME = 1e-12  # of T


@dataclass(frozen=True, eq=False)
class _Scene(Value):
    moving: Body
    fixed: Body
    path: NominalTrajectory
    half_widths: Array
    roundness: float

    @property
    def unit(self) -> float:
        """Farthest that a point of the moving part strays, m."""
        radius = np.linalg.norm(self.moving.vertices, axis=1).max()
        return max(float(np.linalg.norm(self.half_widths[:3]) + radius * np.linalg.norm(self.half_widths[3:])), 1e-6)

    def linear(self, items: Sequence[Candidate], times: ArrayLike) -> Linear:
        """The candidates linearised, each at its own time."""
        poses = {t: self.path.pose(t) for t in np.unique(times).tolist()}
        each = [poses[t] for t in np.broadcast_to(times, len(items)).tolist()]
        return linear(items, self.moving, self.fixed, each, self.half_widths)

    def stops(self, made: Linear) -> Array:
        """Contact wrenches (n, 6) with the components that stop nothing set to 0.

        Polygons that stand for circles about the axis give a contact point R off the axis a lever of up to √(2 R s)
        for each sagitta s, which the true surfaces do not have.
        """
        row = made.wrenches
        least = np.full_like(row, _LEVER)
        least[:, 5] += np.sqrt(2.0 * np.hypot(made.arm[:, 0], made.arm[:, 1])) * self.roundness
        return np.where(np.abs(row) > least, row, 0.0)


class _Run(NamedTuple):
    item: Candidate
    start: float
    end: float


def half_widths(ball: float, cone: float) -> Array:
    """Box (6,) of the paper's uncertainty trapezoid: ball radius r in m (max norm), cone angle s in rad."""
    return frozen([ball] * 3 + [cone] * 3)


def freedom(moving: Part, fixed: Part, path: NominalTrajectory, box: ArrayLike) -> tuple[FreedomInterval, ...]:
    """S(t) along the nominal trajectory, piecewise constant, switching times of the linearised contacts to 1e-11 of T.

    When the box turns, switches nearer than the remainder takes to travel are joined, to the side of contact. A contact
    that is possible during less than an eighth of a leg, and not while a vertex of one part passes the height of a
    vertex of the other, can be missed.

    Args:
        moving: in its body frame.
        fixed: in the B-frame.
        path: P(t).
        box: half-widths a (6,) of the pose error (d, δ), m and rad; of an error set, its support along each axis.

    Returns:
        Intervals that cover [0, T], neighbours different.
    """
    roundness = float(np.sqrt(moving.chord_error) + np.sqrt(fixed.chord_error))
    bodies = Body.of(moving.polyhedron), Body.of(fixed.polyhedron)
    scene = _Scene(*bodies, path, frozen(box, 6, name="half-widths"), roundness)
    grid = _grid(scene)
    runs, remainder = _runs(scene, grid)
    legs = np.linalg.norm(np.diff(path.nodes[:, :3], axis=0), axis=1) / np.diff(path.times)
    blur = max(_TIME * path.duration, 2.0 * remainder / (float(legs.max()) or np.inf))
    return intervals(_stops(scene, grid, runs), path.duration, blur)


def _grid(scene: _Scene) -> Array:
    """Times to look at: nodes, fractions of each leg, and when vertices pass one another's height on straight legs."""
    nodes, times = scene.path.nodes, scene.path.times
    levels = np.unique(np.round(scene.fixed.vertices[:, 2], 12))
    found = [times]
    for k in range(len(times) - 1):
        shares = np.linspace(0.0, 1.0, _PER_LEG, endpoint=False)
        travel = nodes[k + 1, 2] - nodes[k, 2]
        if np.array_equal(nodes[k, 3:], nodes[k + 1, 3:]) and travel != 0.0:
            heights = scene.moving.vertices @ scene.path.pose(float(times[k])).R[2]
            passes = (levels[:, None] - np.unique(np.round(heights, 12)) - nodes[k, 2]) / travel
            shares = np.concatenate([shares, passes[(passes > 0.0) & (passes < 1.0)]])
        found.append(times[k] + shares * (times[k + 1] - times[k]))
    return _distinct(np.concatenate(found), _TIME * scene.path.duration)


def _runs(scene: _Scene, grid: Array) -> tuple[list[_Run], float]:
    """Each candidate with the stretches of time in which it can touch.

    All candidates get the largest remainder of any, so that what happens at one time keeps happening at one time.

    Returns:
        The stretches, and that remainder in m.
    """
    near = [candidates(scene.moving, scene.fixed, scene.path.pose(float(t)), scene.half_widths) for t in grid]
    made = [scene.linear(items, t) for items, t in zip(near, grid, strict=True)]
    remainder = max(float(one.remainder[:, 0].max(initial=0.0)) for one in made)
    on: dict[Candidate, Bits] = {}
    for k, (items, one) in enumerate(zip(near, made, strict=True)):
        touches = slack(one, scene.half_widths, remainder, scene.unit) >= _TOUCHING
        for number in np.flatnonzero(touches):
            on.setdefault(items[number], np.zeros(len(grid), dtype=bool))[k] = True
    runs = []
    for item in sorted(on):
        edges = np.diff(np.concatenate([[0], on[item].astype(int), [0]]))
        for first, last in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True):
            runs.append((item, int(first), int(last)))
    items = [item for item, _, _ in runs for _ in range(2)]
    inside = grid[[k for _, first, last in runs for k in (first, last)]]
    outside = grid[[k for _, first, last in runs for k in (max(first - 1, 0), min(last + 1, len(grid) - 1))]]
    ends = _switches(scene, items, outside, inside, remainder).reshape(-1, 2).tolist()
    return [_Run(item, start, end) for (item, _, _), (start, end) in zip(runs, ends, strict=True)], remainder


def _switches(scene: _Scene, items: Sequence[Candidate], off: Array, on: Array, remainder: float) -> Array:
    """Where touching begins between times without and times with it: all at once, false position and halving by turns.

    Returns:
        (n,), the end with touching of a bracket of 1e-12 T; `on` itself where `off` is no other time.
    """

    def value(which: Indices, times: Array) -> Array:
        made = scene.linear([items[k] for k in which], times)
        return slack(made, scene.half_widths, remainder, scene.unit) - _TOUCHING

    off, on, every = off.copy(), on.copy(), np.arange(len(items))
    below, above = value(every, off), value(every, on)
    halve = False
    while (k := np.flatnonzero(np.abs(on - off) > _TIME * scene.path.duration)).size:
        share = below[k] / np.minimum(below[k] - above[k], -1e-300)
        share = np.full(k.size, 0.5) if halve else np.clip(share, 1e-3, 1.0 - 1e-3)
        t = off[k] + share * (on[k] - off[k])
        new = value(k, t)
        touches = new >= 0.0
        on[k], above[k] = np.where(touches, t, on[k]), np.where(touches, new, above[k])
        off[k], below[k] = np.where(touches, off[k], t), np.where(touches, below[k], new)
        halve = not halve
    return on


def _stops(scene: _Scene, grid: Array, runs: Sequence[_Run]) -> list[Stop]:
    """What touching candidates stop, each cut where a component of its row changes sign."""
    cells = []
    for run in runs:
        cuts = [run.start, *grid[(grid > run.start) & (grid < run.end)].tolist(), run.end]
        cells += [(run.item, a, b) for a, b in pairwise(cuts)]
    items = [item for item, _, _ in cells]
    before, after = (scene.stops(scene.linear(items, np.array([cell[k] for cell in cells]))) for k in (1, 2))
    split = []
    for (item, a, b), turning in zip(cells, before * after < 0.0, strict=True):
        cuts = sorted([a, *(_turn(scene, item, int(k), a, b) for k in np.flatnonzero(turning)), b])
        split += [(item, start, end) for start, end in pairwise(cuts)]
    middle = np.array([0.5 * (a + b) for _, a, b in split])
    rows = scene.stops(scene.linear([item for item, _, _ in split], middle))
    return [Stop(a, b, np.column_stack([row < 0.0, row > 0.0])) for (_, a, b), row in zip(split, rows, strict=True)]


def _turn(scene: _Scene, item: Candidate, degree: int, a: float, b: float) -> float:
    """When a component of the candidate's row changes its sign."""
    from scipy.optimize import brentq

    return float(brentq(lambda t: scene.linear([item], t).wrenches[0, degree], a, b, xtol=1e-14))


def _distinct(times: Array, tolerance: float) -> Array:
    """Sorted times without those within the tolerance of an earlier one; the first and the last stay."""
    ordered = np.sort(times)
    kept = ordered[np.concatenate([[True], np.diff(ordered) > tolerance])]
    kept[-1] = ordered[-1]
    return np.asarray(kept)
