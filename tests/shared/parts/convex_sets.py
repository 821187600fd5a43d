"""Convex sets with arcs to be searched for routes, the routes counted out, and the relaxation as one program."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import cvxpy as cp
import numpy as np
from scipy.sparse import block_diag, csr_array

from fmopt.planning.optimise.convex_route import ConvexSets
from fmopt.spatial.values import Array


def in_space(count: int, seed: int, corners: int = 12) -> ConvexSets:
    """Hulls of random corners in six dimensions, each joined both ways with the four nearest; from one end to another.

    Routes lead from the first to the last.
    """
    rng = np.random.default_rng(seed)
    middles = rng.uniform(0.0, 10.0, size=(count, 6))
    middles[0], middles[-1] = 0.0, 10.0
    sets = [middle + rng.normal(size=(corners, 6)) * 0.9 for middle in middles]
    near = np.argsort(np.linalg.norm(middles[:, None] - middles[None], axis=2), axis=1)[:, 1:5]
    arcs = {pair for u in range(count) for v in near[u] for pair in ((u, int(v)), (int(v), u))}
    return ConvexSets.of(sets, sorted(arcs))


def overlapping(seed: int) -> ConvexSets:
    """A few sets that overlap in few dimensions, with arcs and tolls at random; maybe none lead from first to last."""
    rng = np.random.default_rng(seed)
    count, d = int(rng.integers(3, 8)), int(rng.integers(1, 5))
    middles = rng.uniform(0.0, 4.0, size=(count, d))
    sets = [middle + rng.normal(size=(rng.integers(1, 6), d)) for middle in middles]
    arcs = [(u, v) for u in range(count) for v in range(count) if u != v and rng.random() < 0.5]
    return ConvexSets.of(sets, arcs, rng.uniform(0.0, 1.0, len(arcs)) if seed % 2 else 0.0)


def shortest_of_all(sets: ConvexSets) -> float:
    """The cost of the shortest route from first to last, each path solved by itself; inf when there is none."""
    return min((_along(sets, path) for path in _paths(sets, [0])), default=np.inf)


def _paths(sets: ConvexSets, begun: list[int]) -> Iterator[list[int]]:
    if begun[-1] == len(sets.corners) - 1:
        yield begun
        return
    for u, v in sets.arcs.tolist():
        if u == begun[-1] and v not in begun:
            yield from _paths(sets, [*begun, v])


def _along(sets: ConvexSets, path: list[int]) -> float:
    shares = [cp.Variable(sets.corners.shape[1], nonneg=True) for _ in path]
    points = [share @ sets.corners[at] for share, at in zip(shares, path, strict=True)]
    tolls = {(u, v): toll for (u, v), toll in zip(sets.arcs.tolist(), sets.tolls.tolist(), strict=True)}
    cost = sum(cp.norm(b - a) for a, b in pairwise(points))
    problem = cp.Problem(cp.Minimize(cost), [cp.sum(share) == 1 for share in shares])
    problem.solve(solver="CLARABEL")
    return float(problem.value) + sum(tolls[pair] for pair in pairwise(path))


def relaxation(sets: ConvexSets) -> float:
    """The convex relaxation of the shortest route from first to last, all arcs in one cone program."""
    corners, (tails, heads) = sets.corners, sets.arcs.T
    n, m, _ = corners.shape
    e = len(tails)
    leaving, coming = cp.Variable((e, m), nonneg=True), cp.Variable((e, m), nonneg=True)
    lengths, flow = cp.Variable(e), cp.sum(leaving, axis=1)
    begin, end = (_points(corners[at], shares) for at, shares in ((tails, leaving), (heads, coming)))
    out, into = (csr_array((np.ones(e), (at, np.arange(e))), shape=(n, e)) for at in (tails, heads))
    inner = slice(1, n - 1)
    rules = [
        flow == cp.sum(coming, axis=1),
        cp.norm(end - begin, axis=1) <= lengths,
        (out @ flow)[inner] == (into @ flow)[inner],
        (out @ flow)[inner] <= 1,
        (out @ begin)[inner] == (into @ end)[inner],
        (out @ flow)[0] == 1,
        (into @ flow)[n - 1] == 1,
        (into @ flow)[0] == 0,
        (out @ flow)[n - 1] == 0,
    ]
    problem = cp.Problem(cp.Minimize(cp.sum(lengths) + sets.tolls @ flow), rules)
    problem.solve(solver="CLARABEL")
    return float(problem.value)


def _points(corners: Array, shares: cp.Variable) -> cp.Expression:
    e, m, d = corners.shape
    stacked = block_diag([each.T for each in corners], format="csr")
    return cp.reshape(stacked @ cp.reshape(shares, (e * m,), order="C"), (e, d), order="C")
