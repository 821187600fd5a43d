"""The freedom decomposition function S(t): which motions of the uncertain moving part are stopped, in three dimensions.

Signs as in [LeeHuang1985] section 4.1.2, for each degree x, y, z, rx, ry, rz of the B-frame about the moving part's
reference point: 0 free; 1 motion along the degree (+) is stopped; −1 motion against it (−) is stopped; 2 both are. The
paper's ball in the max norm and its cone in three planes are the box |dᵢ| ≤ r, |δᵢ| ≤ s of pose errors.

A motion in + is stopped at t when some error in the box brings the parts into a contact whose row N, taken at the
nominal pose, has a negative component there: going on, f would fall. The linearisation's remainder is on the side of
contact, so that where s = 0 no error in the box makes a contact of that degree.

Whether contact is possible within the box of pose errors: small linear programs, solved together by HiGHS.

Contact is possible when a candidate's bounds can hold with f ≤ 0 and also with f ≥ 0, that is, when

    φ = min over both signs of  max_e min(∓N·e ∓ f₀ + ρ, cₖ + Bₖ·e + ρ)

over |eᵢ| ≤ aᵢ is not negative.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import SolverError
from fmopt.geometry.part import Part
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory, Stops, intervals
from fmopt.papers.lee_huang.touch import Features, Linearised, candidates, linear
from fmopt.plan.diagnostics import Interval
from fmopt.spatial.values import Array, Indices, Value, frozen

_PER_LEG = 8  # samples of a leg besides the passings of vertex levels
_TOUCHING = -1e-9  # slack in scaled units that still counts as touching
_LEVER = 1e-9  # N (–) or N·m per N below which a contact does not stop a degree
_TIME = 1e-12  # of T

# HiGHS ends at a vertex, whose value has no error but rounding; presolve would only cost time.
_EXACT: Any = {"presolve": False, "primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True, eq=False)
class _Scene(Value):
    moving: Features
    fixed: Features
    path: NominalTrajectory
    half_widths: Array
    roundness: float

    @property
    def unit(self) -> float:
        """Farthest that a point of the moving part strays, m."""
        radius = np.linalg.norm(self.moving.vertices, axis=1).max()
        return max(float(np.linalg.norm(self.half_widths[:3]) + radius * np.linalg.norm(self.half_widths[3:])), 1e-6)

    def linear(self, items: Indices, times: Array) -> Linearised:
        """The candidates (n, 3) linearised, each at its own time (n,)."""
        return linear(items, self.moving, self.fixed, *self.path.frames(times), self.half_widths)

    def candidates(self, times: Array) -> tuple[Indices, Indices]:
        """What may touch at times (n,): which time (k,), and the candidate there (k, 3)."""
        p, R = self.path.frames(times)
        starts = np.flatnonzero(np.concatenate([[True], np.any(R[1:] != R[:-1], axis=(1, 2))]))
        spans = pairwise([*starts.tolist(), len(times)])
        found = [(a, *candidates(self.moving, self.fixed, p[a:b], R[a], self.half_widths)) for a, b in spans]
        return np.concatenate([a + at for a, at, _ in found]), np.concatenate([items for *_, items in found])

    def stops(self, made: Linearised) -> Array:
        """Contact wrenches (n, 6) with the components that stop nothing set to 0.

        Polygons that stand for circles about the axis give a contact point R off the axis a lever of up to √(2 R s)
        for each sagitta s, which the true surfaces do not have.
        """
        row = made.wrenches
        least = np.full_like(row, _LEVER)
        least[:, 5] += np.sqrt(2.0 * np.hypot(made.arm[:, 0], made.arm[:, 1])) * self.roundness
        return np.where(np.abs(row) > least, row, 0.0)


@dataclass(frozen=True, eq=False)
class _Runs(Value):
    """Candidates (n, 3) that can touch from `start` to `end` (n,), s."""

    items: Indices
    start: Array
    end: Array


def half_widths(ball: float, cone: float) -> Array:
    """Box (6,) of the paper's uncertainty trapezoid: ball radius r in m (max norm), cone angle s in rad."""
    return frozen([ball] * 3 + [cone] * 3)


def freedom(moving: Part, fixed: Part, path: NominalTrajectory, box: ArrayLike) -> tuple[Interval, ...]:
    """S(t) along the nominal trajectory, piecewise constant, switching times of the linearised contacts to 1e-11 of T.

    When the box turns, switches nearer than the remainder takes to travel are joined, to the side of contact. A contact
    that is possible during less than an eighth of a leg, and not while a vertex of one part passes the height of a
    vertex of the other, can be missed. The moving part is in its body frame, the fixed one in the B-frame. The box is
    half-widths a (6,) of the pose error (d, δ), m and rad; of an error set, its support along each axis.

    Returns:
        Intervals that cover [0, T], neighbours different.
    """
    roundness = float(sum(np.sqrt(part.chord_error + part.form) for part in (moving, fixed)))
    bodies = Features.of(moving.polyhedron), Features.of(fixed.polyhedron)
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
    # Sorted, without those within the tolerance of an earlier one; the first and the last stay.
    ordered = np.sort(np.concatenate(found))
    kept = ordered[np.concatenate([[True], np.diff(ordered) > _TIME * scene.path.duration])]
    kept[-1] = ordered[-1]
    return np.asarray(kept)


def _runs(scene: _Scene, grid: Array) -> tuple[_Runs, float]:
    """The stretches of time in which candidates can touch, and the largest remainder, m.

    All candidates get the largest remainder of any, so that what happens at one time keeps happening at one time.
    """
    at, items = scene.candidates(grid)
    made = scene.linear(items, grid[at])
    remainder = float(made.remainder[:, 0].max(initial=0.0))
    touches = slack(made, scene.half_widths, remainder, scene.unit) >= _TOUCHING
    some, which = np.unique(items[touches], axis=0, return_inverse=True)
    on = np.zeros((len(some), len(grid) + 2), dtype=int)
    on[which, at[touches] + 1] = 1
    edges = np.diff(on, axis=1)
    (row, first), (_, beyond) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    last, items = beyond - 1, some[row]
    inside = np.concatenate([grid[first], grid[last]])
    outside = np.concatenate([grid[np.maximum(first - 1, 0)], grid[np.minimum(last + 1, len(grid) - 1)]])
    start, end = np.split(_switches(scene, np.tile(items, (2, 1)), outside, inside, remainder), 2)
    return _Runs(items, start, end), remainder


def _switches(scene: _Scene, items: Indices, off: Array, on: Array, remainder: float) -> Array:
    """Where touching begins between times without and times with it: all at once, false position and halving by turns.

    The answer (n,) is the end with touching of a bracket of 1e-12 T; `on` itself where `off` is no other time.
    """

    def value(which: Indices, times: Array) -> Array:
        return slack(scene.linear(items[which], times), scene.half_widths, remainder, scene.unit) - _TOUCHING

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


def _stops(scene: _Scene, grid: Array, runs: _Runs) -> Stops:
    """What touching candidates stop, each cut where a component of its row changes sign."""
    inside, k = np.nonzero((grid > runs.start[:, None]) & (grid < runs.end[:, None]))
    cell, start, end = _cut(runs.start, runs.end, inside, grid[k])
    items = runs.items[cell]
    before, after = np.split(scene.stops(scene.linear(np.tile(items, (2, 1)), np.concatenate([start, end]))), 2)
    turning, degree = np.nonzero(before * after < 0.0)
    turned = [_turn(scene, items[c], int(d), start[c], end[c]) for c, d in zip(turning, degree, strict=True)]
    cell, start, end = _cut(start, end, turning, np.array(turned))
    rows = scene.stops(scene.linear(items[cell], 0.5 * (start + end)))
    return Stops(start, end, np.stack([rows < 0.0, rows > 0.0], axis=2))


def _cut(start: Array, end: Array, which: Indices, times: Array) -> tuple[Indices, Array, Array]:
    """Stretches from `start` to `end` (n,) cut at times (k,) within those in `which` (k,).

    The answer is the stretch that each part (n + k,) comes from, and where the part starts and ends.
    """
    whole = np.concatenate([np.arange(len(start)), which])
    starts, ends = np.concatenate([start, times]), np.concatenate([end, times])
    return np.sort(whole, kind="stable"), starts[np.lexsort((starts, whole))], ends[np.lexsort((ends, whole))]


def _turn(scene: _Scene, item: Indices, degree: int, a: float, b: float) -> float:
    """When a component of the candidate's row changes its sign."""
    from scipy.optimize import brentq

    def component(t: float) -> float:
        return float(scene.linear(item[None], np.array([t])).wrenches[0, degree])

    return float(brentq(component, a, b, xtol=1e-14))


def slack(made: Linearised, half_widths: Array, remainder: float, unit: float) -> Array:
    """φ (n,) of linearised candidates, divided by `unit`.

    Where that is negative, its bound min_k (c_k + |B_k|₁), with u = e / a, may stand for it.

    f and the heights of the candidates are to first order; `half_widths` is the box (6,) of the pose error, m and rad,
    the remainder ρ of f, m, in the place of the candidates' own.

    Raises:
        SolverError: a program did not end.
    """
    n, k = made.heights.shape
    c, B = np.empty((2, n, k + 1)), np.empty((2, n, k + 1, 6))
    for sign, values, rows in zip((-1.0, 1.0), c, B, strict=True):
        values[:, 0], values[:, 1:] = sign * made.distance, made.heights
        rows[:, 0], rows[:, 1:] = sign * made.gradient, made.rows
    c[:, :, 0] += remainder
    c[:, :, 1:] += made.remainder[:, 1:]
    value = maximin((c / unit).reshape(2 * n, k + 1), (B * half_widths / unit).reshape(2 * n, k + 1, 6))
    if np.any(np.isnan(value)):
        raise SolverError("the touch programs did not end", "check the half-widths of the pose error")
    return np.asarray(value.reshape(2, n).min(axis=0))


def maximin(c: Array, B: Array) -> Array:
    """max over |u| ≤ 1 of min_k (c_k + B_k·u), (n,), of c (n, k) and B (n, k, 6); its bound where that is negative.

    All n programs are blocks of one, with a variable t for each, so that HiGHS is called once. Rows that no other can
    fall below, or that repeat the one before, are left out. nan where the method did not end.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array

    reach = np.abs(B).sum(axis=2)
    found = np.asarray((c + reach).min(axis=1))
    kept = (c - reach < found[:, None]) & (found >= 0.0)[:, None]
    kept[:, 1:] &= (c[:, 1:] != c[:, :-1]) | np.any(B[:, 1:] != B[:, :-1], axis=2)
    asked = np.flatnonzero(kept.sum(axis=1) > 1)
    if not asked.size:
        return found
    block, k = np.nonzero(kept[asked])
    rows = np.column_stack([-B[asked[block], k], np.ones(len(block))])  # t − B_k·u ≤ c_k
    columns = 7 * block[:, None] + np.arange(7)
    shape = len(block), 7 * len(asked)
    program: Any = csr_array((rows.ravel(), columns.ravel(), np.arange(0, rows.size + 1, 7)), shape=shape)
    limits: Any = np.tile([(-1.0, 1.0)] * 6 + [(-np.inf, np.inf)], (len(asked), 1))
    limits[6::7, 1] = found[asked]
    cost = np.tile([0.0] * 6 + [-1.0], len(asked))
    answer = linprog(cost, A_ub=program, b_ub=c[asked[block], k], bounds=limits, options=_EXACT)
    found[asked] = np.nan if answer.x is None else answer.x[6::7]
    return found
