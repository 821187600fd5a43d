"""Distance of a segment to an obstacle facet, by a separating hyperplane that its multipliers prove.

The obstacle is the convex set {E X = e, B X ≤ b} of local coordinates ([DakinPopplestone1993] eq. 1 and section 3,
figure 5). For y free and λ ≥ 0 the row a = Eᵀy + Bᵀλ has a·X ≤ β = y·e + λ·b on all of it, so that
min over the segment's ends of (a·X − β)/|a*| is a lower bound on the distance, equal to it for the best (y, λ).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.errors import InfeasibleError
from fmopt.placement.clearance import Flat, Metric, Placement, max_min_clearance
from fmopt.placement.program import ConeProgram, Norm, Solution, Solver, certify, checked
from fmopt.placement.socp import ClarabelSolver
from fmopt.values import Array, Value, frozen

_TOUCHING = 1e-6
_FAR = 1e4


@dataclass(frozen=True, eq=False)
class Facet(Value):
    """The convex obstacle {E X = e, B X ≤ b}, B (m, 6), b (m,): one contact and what it forbids.

    B holds the contact's own plane first (N·X ≤ D is the forbidden side), then its bounds, so that overlap counts as
    negative. `flat` holds the contacts of the traversed state, where the segment stays: an obstacle matters, and
    distances are measured, within it.
    """

    flat: Flat
    B: Array
    b: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "B", frozen(self.B, None, 6, name="B"))
        object.__setattr__(self, "b", frozen(self.b, len(self.B), name="b"))


@dataclass(frozen=True, eq=False)
class Separator(Value):
    """A hyperplane a·X = β (m), |a*| = 1, with the facet on or below it, and its multipliers y (p,) and λ (m,) ≥ 0."""

    equalities: Array
    rows: Array
    a: Array
    beta: float

    def room(self, poses: Array) -> float:
        """Least signed distance of poses (ends, 6) above the hyperplane, in m."""
        return float((poses @ self.a - self.beta).min())


def separator(facet: Facet, equalities: Array, rows: Array, metric: Metric) -> Separator | None:
    """The hyperplane of given multipliers, None when they cancel out."""
    lam = np.maximum(rows, 0.0)
    a = facet.flat.E.T @ equalities + facet.B.T @ lam
    largest = np.abs(equalities) @ metric.dual_norm(facet.flat.E) + lam @ metric.dual_norm(facet.B)
    length = float(metric.dual_norm(a))
    if length <= _TOUCHING * largest:
        return None
    beta = float(equalities @ facet.flat.e + lam @ facet.b)
    return Separator(frozen(equalities / length), frozen(lam / length), frozen(a / length), beta / length)


def distance(poses: Array, facet: Facet, metric: Metric, solver: Solver | None = None) -> Separator:
    """The hyperplane between a segment and a facet that leaves the segment most room.

    The distance itself is `room(poses)`: exact when apart; when the segment touches or overlaps the facet, the
    best room over its single rows (zero or negative).

    Args:
        poses: the ends of the segment (1 or 2, 6).
        facet: the obstacle.
        metric: lengths of local coordinates.
        solver: else Clarabel.

    Raises:
        InfeasibleError: the facet is empty.
        SolverError: no certified optimum.
    """
    found = _single_rows(facet, metric)
    E, e = _orthonormal(facet.flat, metric)
    best = checked(_separation(poses, Facet(Flat(E, e), facet.B, facet.b), metric), solver or ClarabelSolver())
    if best.value >= 0.5 * _FAR * metric.clearance:
        raise InfeasibleError("the facet is empty", advice="leave it out: it is no obstacle in this state")
    if best.value > _TOUCHING * metric.clearance:
        p = len(e)
        y = np.asarray(np.linalg.lstsq(facet.flat.E.T, E.T @ best.x[:p], rcond=1e-10)[0])
        mixed = separator(facet, y, best.x[p:-1], metric)
        found += [] if mixed is None else [mixed]
    return max(found, key=lambda s: s.room(poses))


def _single_rows(facet: Facet, metric: Metric) -> list[Separator]:
    """Each row of B that is not constant on the state, as measured within the state."""
    y = np.linalg.lstsq((facet.flat.E / metric.sigma).T, -(facet.B / metric.sigma).T, rcond=1e-10)[0].T
    found = [separator(facet, one, lam, metric) for one, lam in zip(y, np.eye(len(facet.b)), strict=True)]
    if not (rows := [s for s in found if s is not None]):
        raise ValueError("every row of the facet is constant on the contact state")
    return rows


def _orthonormal(flat: Flat, metric: Metric) -> tuple[Array, Array]:
    """The same affine space by rows that are orthonormal in the metric."""
    U, s, Vt = np.linalg.svd(flat.E / metric.sigma, full_matrices=False)
    kept = s > 1e-10 * s.max(initial=0.0)
    return Vt[kept] * metric.sigma, (U[:, kept].T @ flat.e) / s[kept]


def _separation(poses: Array, facet: Facet, metric: Metric) -> ConeProgram:
    """Maximise τ, a·X − β ≥ τ at the ends, |a*| ≤ 1, over (y, λ ≥ 0, τ): the dual of the nearest points."""
    E, e, B, b = facet.flat.E, facet.flat.e, facet.B, facet.b
    p, m, ends = len(e), len(b), len(poses)
    rows = np.vstack([E, B])
    n = p + m + 1
    G = np.zeros((ends + 1, n))
    G[:ends, :-1] = poses @ rows.T - np.concatenate([e, b])
    G[:ends, -1] = -1.0
    W = np.zeros((ends + 1, 1))
    W[ends] = 1.0
    lengths = metric.dual_norm(rows)
    return ConeProgram.of(
        np.append(np.zeros(n - 1), 1.0),
        G=G,
        h=np.append(np.zeros(ends), 1.0),
        W=W,
        norms=(Norm(np.hstack([(rows / metric.sigma).T, np.zeros((6, 1))]), np.zeros(6)),),
        lower=np.concatenate([np.full(p, -np.inf), np.zeros(m), [-np.inf]]),
        upper=np.append(np.full(n - 1, np.inf), _FAR * metric.clearance),
        units=np.append(1.0 / np.where(lengths > 0.0, lengths, 1.0), metric.clearance),
    )


def place_among(
    problem: Placement,
    facets: Sequence[Facet],
    solver: Solver | None = None,
    guess: Array | None = None,
    rounds: int = 20,
) -> tuple[Solution, tuple[Separator, ...]]:
    """Largest least clearance from hyperplanes and facets: separators and poses in turn, clearance never falling.

    The facets' separators join the rows of `problem`, and so hold at every end that is free; make a fixed start a
    `Flat.point` to have the whole segment kept apart. A local optimum: it depends on the side where it starts.

    Args:
        problem: affine spaces, bounds and further hyperplanes.
        facets: the obstacles.
        solver: else Clarabel.
        guess: poses (ends, 6) to start from, within the affine spaces and bounds; else the best poses above the
            first row of each facet.
        rounds: largest number of alternations.

    Returns:
        The solution for the last separators (x as for `max_min_clearance`), and those.

    Raises:
        InfeasibleError, SolverError: as `max_min_clearance`.
    """
    metric = problem.metric
    if guess is None:
        solution = max_min_clearance(_joined(problem, [_single_rows(f, metric)[0] for f in facets]), solver)
    else:
        solution = problem.at(guess)
    kept: tuple[Separator, ...] = ()
    for _ in range(rounds):
        poses = solution.x[:-1].reshape(-1, 6)
        fresh = [distance(poses, facet, metric, solver) for facet in facets]
        kept = tuple(max(old, new, key=lambda s: s.room(poses)) for old, new in zip(kept or fresh, fresh, strict=True))
        joined = _joined(problem, kept)
        before = joined.at(poses)
        after = max_min_clearance(joined, solver)
        better = after.x if after.value > before.value else before.x
        solution = certify(joined.program(), better, after.duals)
        if after.value <= before.value + _TOUCHING * metric.clearance:
            break
    return solution, kept


def _joined(problem: Placement, separators: Sequence[Separator]) -> Placement:
    if not separators:
        return problem
    k = len(separators)
    return replace(
        problem,
        N=np.vstack([problem.N, [s.a for s in separators]]),
        D=np.append(problem.D, [s.beta for s in separators]),
        weights=np.append(problem.weights, np.ones(k)),
        growth=np.append(problem.growth, np.zeros(k)),
    )
