"""The shortest route through convex sets, and what no route can be shorter than.

Each set is the hull of its corners, arcs lead from set to set, and a route takes one point in each set on its way. It
costs the distances between these points and the tolls of its arcs. For any vectors λ of the sets on the way, any a with
|a| ≤ 1 of the arcs and any μ ≥ 0 of the sets, let the length of an arc from u to v be

    toll + μ_v + min over x in u of −(a + λ_u)·x + min over y in v of (a + λ_v)·y.

Along a route these add up to its cost and Σμ at most, since |y − x| ≥ a·(y − x), the λ cancel, and no set is met twice.
So the shortest path for these lengths less Σμ bounds all routes. That is the dual of the convex relaxation of shortest
paths in graphs of convex sets [Marcucci2024], whose bound is the best of these. Here λ, a and μ climb along whichever
path is shortest for them, and come near within dozens of steps; each new path is tried as a route.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmopt.errors import InfeasibleError
from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.shortest_path import Ends, Indices, Path, shortest_path
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.spatial.values import Array, Value, frozen

_FAR = 1.9  # times the step that would close the gap if the bound were linear; from 2 on steps need not lead nearer
_TRIED = 8  # paths of which routes are made
_LEVEL = 0.1  # share of the gap asked for that is in the μ from the beginning, for cycles of sets that share a point
_IDLE, _LEAST = 10, 0.2  # steps without gain after which less is aimed at, and the least share of the gap
_VISITS = 2.0  # what μ weighs among the vectors, in mean squared sizes of sets

_SOLVER = ClarabelSolver(tolerance=1e-7)  # what it proposes is drawn into the sets, and measured there

Bits = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ConvexSets(Value):
    """Convex sets and the arcs between them.

    Attributes:
        corners: (n, m, d), those of each set, one repeated where it has fewer than m; in the unit of the costs.
        arcs: (e, 2), from which set to which.
        tolls: (e,), what an arc costs beside the distance; not negative.
    """

    corners: Array
    arcs: Indices
    tolls: Array

    @staticmethod
    def of(corners: Sequence[ArrayLike], arcs: ArrayLike, tolls: ArrayLike = 0.0) -> ConvexSets:
        """Sets by their corners, with arcs and tolls.

        Args:
            corners: (m_i, d) of each.
            arcs: (e, 2), from set to set.
            tolls: (e,), or one for all; added to the length.

        Raises:
            ValueError: shapes do not fit, an arc leads from or to no set, a number is not finite or a toll negative.
        """
        listed = [np.atleast_2d(np.asarray(points, dtype=np.float64)) for points in corners]
        if not listed or not all(points.size and points.shape[1:] == listed[0].shape[1:] for points in listed):
            raise ValueError("every set needs corners, all of one dimension")
        most = max(len(points) for points in listed)
        filled = [np.concatenate([points, np.repeat(points[:1], most - len(points), axis=0)]) for points in listed]
        pairs = np.array(arcs, dtype=np.intp).reshape(-1, 2)
        if pairs.size and not 0 <= pairs.min() <= pairs.max() < len(listed):
            raise ValueError(f"arcs lead between sets 0 to {len(listed) - 1}")
        costs = frozen(np.broadcast_to(np.asarray(tolls, dtype=np.float64), len(pairs)), len(pairs), name="tolls")
        if (costs < 0.0).any():
            raise ValueError("tolls must not be negative")
        return ConvexSets(frozen(filled, None, None, None, name="corners"), _fixed(pairs), costs)

    def part(self, sets: Indices, arcs: Indices) -> ConvexSets:
        """Some of the sets, and some arcs between these."""
        place = np.zeros(len(self.corners), dtype=np.intp)
        place[sets] = np.arange(len(sets))
        return ConvexSets(_fixed(self.corners[sets]), _fixed(place[self.arcs[arcs]]), _fixed(self.tolls[arcs]))

    @cached_property
    def middles(self) -> Array:
        """The mean corner (n, d) of each set."""
        return np.asarray(self.corners.mean(axis=1))

    @cached_property
    def around(self) -> tuple[Indices, ...]:
        """For each set the arcs that begin or end in it."""
        ends = self.arcs.reshape(-1)
        order = np.argsort(ends, kind="stable")
        return tuple(np.split(order // 2, np.searchsorted(ends[order], np.arange(1, len(self.corners)))))

    @cached_property
    def inward(self) -> Ends:
        """The arcs by the sets that they lead to."""
        return Ends.of(self.arcs[:, 0], self.arcs[:, 1], len(self.corners))

    @cached_property
    def outward(self) -> Ends:
        """The arcs by the sets that they come from."""
        return Ends.of(self.arcs[:, 1], self.arcs[:, 0], len(self.corners))


@dataclass(frozen=True, eq=False)
class Route(Value):
    """A route through convex sets.

    Attributes:
        stops: the sets in order.
        points: (k, d), one in each.
        cost: distances and tolls.
        lower_bound: no route costs less.
    """

    stops: tuple[int, ...]
    points: Array
    cost: float
    lower_bound: float

    @property
    def gap(self) -> float:
        """How much less another route could cost, as a share of the cost."""
        return 1.0 - self.lower_bound / self.cost if self.cost > 0.0 else 0.0


def shortest_route(sets: ConvexSets, start: int, goal: int, gap: float = 0.03, steps: int = 1000) -> Route:
    """The shortest of the routes tried from one set to another, with a bound on all.

    Raises:
        ValueError: the gap is not between 0 and 1.
        InfeasibleError: no arcs lead there.
        SolverError: the solver returned no point.
    """
    if not 0.0 < gap < 1.0:
        raise ValueError(f"the gap is a share between 0 and 1, not {gap}")
    if start == goal:
        return Route((start,), frozen(sets.middles[[start]]), 0.0, 0.0)
    # No route comes back to where it begins, or goes on from where it ends.
    sets = sets.part(
        np.arange(len(sets.corners)), np.flatnonzero((sets.arcs[:, 1] != start) & (sets.arcs[:, 0] != goal))
    )
    if not len(sets.arcs):
        raise _unreachable(start, goal)
    tails, heads = sets.arcs.T
    far = np.linalg.norm(sets.middles[heads] - sets.middles[tails], axis=1) + sets.tolls
    first = shortest_path(sets.inward, far, start, goal)
    if first is None:
        raise _unreachable(start, goal)
    best = _route(sets, first.arcs)
    # Against the whole way, or not at all: whichever bounds more to begin with.
    dual, lengths, there = max(
        (
            _first(sets, start, goal, _unit(against))
            for against in (best.points[0] - best.points[-1], 0.0 * best.points[0])
        ),
        key=lambda found: float(found[2][goal]),
    )
    onward, _ = sets.outward.distances(lengths, goal)
    # A route by an arc that is left out costs `enough` at least: of these no more needs to be known.
    enough = (1.0 - gap) * best.cost
    arcs = np.flatnonzero(there[tails] + lengths + onward[heads] < enough)
    if not len(arcs):
        return replace(best, lower_bound=max(enough, float(there[goal])))
    near = np.unique(np.append(sets.arcs[arcs], best.stops))
    stops = tuple(np.searchsorted(near, best.stops).tolist())
    found = _closer(dual.part(near, arcs), replace(best, stops=stops, lower_bound=0.0), gap, steps)
    bound = max(min(found.lower_bound, enough), float(there[goal]))
    return replace(found, stops=tuple(near[list(found.stops)].tolist()), lower_bound=min(bound, found.cost))


def _unreachable(start: int, goal: int) -> InfeasibleError:
    return InfeasibleError(f"no arcs lead from set {start} to set {goal}", advice="arcs lead one way")


def _first(sets: ConvexSets, start: int, goal: int, against: Array) -> tuple[_Dual, Array, Array]:
    """One λ for all sets on the way, the lengths (e,) of arcs, and how far sets are from the start (n,).

    From one set on the way to another no arc is shorter than its toll then, so that there are no cycles.
    """
    dual = _Dual.begun(sets, start, goal, against)
    inner = (sets.arcs[:, 0] != start) & (sets.arcs[:, 1] != goal)
    lengths = np.where(inner, np.maximum(dual.lengths, sets.tolls), dual.lengths)
    return dual, lengths, sets.inward.distances(lengths, start)[0]


def _closer(dual: _Dual, best: Route, gap: float, steps: int) -> Route:
    """The best of a route and others, with a bound on all between its ends; its own cost where no arcs lead there."""
    sets, (start, *_, goal) = dual.sets, best.stops
    dual.prime(best)
    tried: set[tuple[int, ...]] = set()
    bound, aim, idle = -np.inf, 1.0, 0
    for _ in range(steps):
        level = _LEVEL * gap * best.cost / len(sets.corners)
        path = shortest_path(sets.inward, dual.lengths + dual.visits[sets.arcs[:, 1]] + level, start, goal)
        if path is None:
            return replace(best, lower_bound=best.cost)
        if path.cycle:
            dual.climb(path, -path.length)
            continue
        found = path.length - level * len(sets.corners) - float(dual.visits.sum())
        stops = _stops(sets, path.arcs)
        if len(tried) < _TRIED and stops not in tried:
            tried.add(stops)
            best = min(best, _route(sets, path.arcs), key=lambda route: route.cost)
        # The best bound may be far below the best cost: what is aimed at comes nearer when nothing is gained.
        idle = 0 if found > bound else idle + 1
        bound = max(bound, found)
        if bound >= (1.0 - gap) * best.cost:
            break
        if idle in (0, _IDLE):
            aim, idle = (min(1.0, 1.5 * aim) if idle == 0 else max(_LEAST, 0.5 * aim)), 0
        dual.climb(path, bound + aim * (best.cost - bound) - found)
    return replace(best, lower_bound=bound)


def _stops(sets: ConvexSets, arcs: Indices) -> tuple[int, ...]:
    return (int(sets.arcs[arcs[0], 0]), *sets.arcs[arcs, 1].tolist())


def _route(sets: ConvexSets, arcs: Indices) -> Route:
    """The shortest route along arcs in order; its bound is its own cost."""
    stops = _stops(sets, arcs)
    corners = sets.corners[list(stops)]
    k, m, d = corners.shape
    shares, lengths = k * m, k - 1
    norms = []
    for i in range(lengths):
        F = np.zeros((d, shares + lengths))
        F[:, i * m : (i + 2) * m] = np.concatenate([-corners[i], corners[i + 1]]).T
        norms.append(Norm(F, np.zeros(d)))
    longer = np.eye(lengths, shares + lengths, shares)
    size = float(np.ptp(corners, axis=(0, 1)).max())
    program = ConeProgram(
        -longer.sum(axis=0),
        A=np.hstack([np.repeat(np.eye(k), m, axis=1), np.zeros((k, lengths))]),
        b=np.ones(k),
        G=longer,
        h=np.zeros(lengths),
        W=np.eye(lengths),
        norms=tuple(norms),
        lower=np.append(np.zeros(shares), np.full(lengths, -np.inf)),
        units=np.append(np.ones(shares), np.full(lengths, size or 1.0)),  # all sets may be one point
    )
    weights = np.maximum(_SOLVER.proposed(program)[:shares].reshape(k, m), 0.0)
    points = frozen(np.einsum("km,kmd->kd", weights / weights.sum(axis=1, keepdims=True), corners))
    cost = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() + sets.tolls[arcs].sum())
    return Route(stops, points, cost, cost)


class _Dual:
    """The vectors λ (n, d) and numbers μ (n,) of sets, the vectors a (e, d) of arcs, and the lengths (e,) without μ.

    No λ but zero has a set that is not `inner`: where routes begin and end.
    """

    def __init__(self, sets: ConvexSets, inner: Bits, along: Array, across: Array) -> None:
        self.sets, self.visits = sets, np.zeros(len(along))
        self.lengths = np.empty(len(across))
        self._inner, self._along, self._across = inner, along, across
        self._least = np.empty((len(across), 2), dtype=np.intp)  # corners at which each length is taken
        self._measure(np.arange(len(across)))

    @staticmethod
    def begun(sets: ConvexSets, start: int, goal: int, against: Array) -> _Dual:
        """One λ (d,) for all sets on the way, and of some a for each arc the one with which it is longest."""
        tails, heads = sets.arcs.T
        inner = np.ones(len(sets.corners), dtype=bool)
        inner[[start, goal]] = False
        along = inner[:, None] * against
        straight, back = _unit(sets.middles[heads] - sets.middles[tails]), -0.5 * (along[tails] + along[heads])
        tries = [_Dual(sets, inner, along, across) for across in (straight, back, _unit(straight + back))]
        longest = np.argmax([each.lengths for each in tries], axis=0)
        return _Dual(sets, inner, along, np.choose(longest[:, None], [each._across for each in tries]))

    @cached_property
    def _weight(self) -> float:
        """What μ weighs among the vectors."""
        sets = self.sets
        return _VISITS * float(np.mean((sets.corners - sets.middles[:, None]) ** 2) * sets.corners.shape[2])

    def part(self, sets: Indices, arcs: Indices) -> _Dual:
        """The same for some of the sets, and some arcs between these."""
        return _Dual(self.sets.part(sets, arcs), self._inner[sets], self._along[sets], self._across[arcs])

    def prime(self, route: Route) -> None:
        """Turns the λ of a route's sets against its way through them."""
        stops = list(route.stops[1:-1])
        if stops:
            self._along[stops] = _unit(route.points[:-2] - route.points[2:])
            self._measure(np.arange(len(self.lengths)))

    def climb(self, path: Path, missing: float) -> None:
        """Makes a path or cycle longer, by `missing` in all if lengths were linear."""
        tails, heads = self.sets.arcs[path.arcs].T
        begin, end = (
            self.sets.corners[tails, self._least[path.arcs, 0]],
            self.sets.corners[heads, self._least[path.arcs, 1]],
        )
        visited = np.zeros(len(self.visits))
        visited[heads] = 1.0
        # The bound of a path has −Σμ in it, so that what μ there is off the path counts against it; a cycle has none.
        if not path.cycle:
            visited = np.where(self.visits > 0.0, visited - 1.0, 0.0)
        gaping = np.zeros_like(self._along)
        np.subtract.at(gaping, tails, begin)
        np.add.at(gaping, heads, end)
        gaping[~self._inner] = 0.0
        square = np.sum((end - begin) ** 2) + np.sum(gaping**2) + self._weight * np.sum(visited**2)
        if square == 0.0:
            return
        step = _FAR * missing / float(square)
        longer = self._across[path.arcs] + step * (end - begin)
        self._across[path.arcs] = longer / np.maximum(1.0, np.linalg.norm(longer, axis=1, keepdims=True))  # |a| ≤ 1
        self._along += step * gaping
        self.visits = np.maximum(self.visits + step * self._weight * visited, 0.0)
        # With the λ of a set all arcs that begin or end in it change their lengths.
        changed = [self.sets.around[at] for at in {*tails.tolist(), *heads.tolist()} if self._inner[at]]
        self._measure(np.unique(np.concatenate([path.arcs, *changed])))

    def _measure(self, arcs: Indices) -> None:
        """Takes the lengths of some arcs, each at its least."""
        corners, (tails, heads) = self.sets.corners, self.sets.arcs[arcs].T
        across, each = self._across[arcs], np.arange(len(arcs))
        low = -np.matmul(corners[tails], (across + self._along[tails])[:, :, None])[:, :, 0]
        high = np.matmul(corners[heads], (across + self._along[heads])[:, :, None])[:, :, 0]
        least = np.column_stack([low.argmin(axis=1), high.argmin(axis=1)])
        self._least[arcs] = least
        self.lengths[arcs] = self.sets.tolls[arcs] + low[each, least[:, 0]] + high[each, least[:, 1]]


def _unit(rows: Array) -> Array:
    """Rows (…, d) of unit length; those of length zero stay."""
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.asarray(rows / np.where(length > 0.0, length, 1.0))


def _fixed(array: NDArray[np.generic]) -> NDArray[Any]:
    """An array that can no longer be written to."""
    array.setflags(write=False)
    return array
