"""Placement of one goal pose at a time: a nonlinear program on the true surfaces, or the paper's steepest descent.

Both keep all other poses. What an obstacle row loses to errors, remainders and contact thickness is taken from the last
certificate as an allowance; a new pose is kept only when the certificate, computed anew, has a larger margin.

The papers' placement, for comparison: reciprocal cost and steepest descent on the goal state's affine space.

    cost = Σ 1/(dist_j − C),  C < 0                                      [DakinPopplestone1993] eq. 2, section 3

with dist_j the clearance of obstacle j in the scaled metric and C the overlap at which the cost becomes infinite.
(The paper prints C − dist.) Bounds enter with C = 0 and a small factor.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from fmopt.certificate.assembly import Assembly, contact_forms
from fmopt.certificate.remainder import EndsBatch
from fmopt.certificate.rows import Forms, Rows, points_above, stacked
from fmopt.certificate.separating_plane import counted_rows
from fmopt.errors import InfeasibleError, OverdueError, SolverError
from fmopt.planning.moves.moves import Move, onto_surfaces
from fmopt.planning.optimise.cone_program import ConeProgram, Solution
from fmopt.planning.placement.largest_clearance import Flat, Metric, Placement
from fmopt.planning.placement.nonlinear_program import SurfacePlacement, place_on_surfaces
from fmopt.planning.placement.sequence_program import Aim, Placed, better, state_rows
from fmopt.planning.placement.sequence_rows import pairs_of
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array

_WALL = 1e-3  # factor of bounds in the cost
_INTERIOR = 1e-6  # scaled units: a pose on a bound, or so little beyond, has a finite cost still

_ROUNDS = 3  # in which each pose gets its turn
_GAIN = 1e-3  # of the clearance, the least gain that counts
_NEAR = 1.5  # of the radius, how far from binding rows count
_SHORTER = 0.3  # of the radius, for a second try where the first gains nothing
_IDLE = 0.1  # of the clearance; a pose with that much more margin than the sequence has no say in it

Method = Literal["nlp", "descent"]


@dataclass(frozen=True)
class Descent:
    """Settings: overlap C in clearances (negative), largest number of steps, and the step that ends it."""

    asymptote: float = -0.1
    max_steps: int = 2000
    smallest_step: float = 1e-9


def descend(problem: Placement, guess: ArrayLike = (0.0,) * 6, settings: Descent = Descent()) -> Solution:
    """Perturbs the poses along the state's surface until the reciprocal cost has a minimum; proves no optimum.

    It starts from the point of the affine space nearest to a guess (6,).

    Raises:
        InfeasibleError: the equations of the affine space contradict each other.
        SolverError: the first pose oversteps a bound.
    """
    scaled, units = problem.program().scaled(), problem.metric.units
    y, Z = _state(scaled, np.asarray(guess) / units, problem.metric.clearance)
    cost = _Cost.of(scaled, y, settings.asymptote)
    if not np.isfinite(cost(y)):
        raise SolverError("the descent starts outside its bounds", "start from a pose strictly inside them")
    step = 1.0
    for _ in range(settings.max_steps):
        downhill = -Z @ (Z.T @ cost.gradient(y))
        length = float(np.linalg.norm(downhill))
        if length == 0.0:
            break
        step, y = _line_search(cost, y, downhill / length, 2.0 * step, length)
        if step < settings.smallest_step:
            break
    return problem.at(y * units)


def _state(scaled: ConeProgram, y: Array, unit: float) -> tuple[Array, Array]:
    """The point of the affine space nearest to y (6,), and an orthonormal basis (6, r) of its directions."""
    if not len(scaled.b):
        return y, np.eye(6)
    A = scaled.A[:, :6]
    U, s, Vt = np.linalg.svd(A)
    rank = int((s > 1e-10 * s[0]).sum())
    y = y + Vt[:rank].T @ ((U[:, :rank].T @ (scaled.b - A @ y)) / s[:rank])
    short = float(np.abs(A @ y - scaled.b).max())
    if short > 1e-9:
        raise InfeasibleError(f"the contacts of the state contradict by {short:.3g} clearances", short * unit)
    return y, Vt[rank:].T


def _line_search(cost: "_Cost", y: Array, direction: Array, step: float, slope: float) -> tuple[float, Array]:
    """Backtracking to Armijo's rule; returns the step taken and the point."""
    here = cost(y)
    while step > 1e-14:
        there = y + step * direction
        if cost(there) <= here - 1e-4 * step * slope:
            return step, there
        step *= 0.5
    return 0.0, y


@dataclass(frozen=True, eq=False)
class _Cost:
    """Σ 1/(dist − C) over the rows of a scaled program in (y, t), bounds with C = 0."""

    program: ConeProgram
    asymptote: float

    @staticmethod
    def of(program: ConeProgram, y: Array, asymptote: float) -> "_Cost":
        # A pose deeper in the overlap than C moves the asymptote below itself.
        least = float(_Cost(program, 0.0)._room(y)[0].min(initial=0.0))
        return _Cost(program, min(asymptote, 1.5 * least))

    def __call__(self, y: Array) -> float:
        rows, low, high = self._room(y)
        if not (np.concatenate([rows, low, high]) > 0.0).all():
            return float("inf")
        return float(np.sum(1.0 / rows) + _WALL * (np.sum(1.0 / low) + np.sum(1.0 / high)))

    def gradient(self, y: Array) -> Array:
        rows, low, high = self._room(y)
        inner = (1.0 / rows**2 / self.program.G[:, -1]) @ self.program.G[:, :-1]
        return np.asarray(inner - _WALL / low**2 + _WALL / high**2)

    def _room(self, y: Array) -> tuple[Array, Array, Array]:
        """What is left of distances over C, and of both bounds; the last column of the rows is minus their length."""
        rows = -self.program.slacks(np.append(y, 0.0)) / self.program.G[:, -1] - self.asymptote
        return rows, y - self.program.lower[:-1] + _INTERIOR, self.program.upper[:-1] - y + _INTERIOR


_CENTRING = Descent(smallest_step=1e-3)  # finer steps change no certified margin that counts


def refine_goals(
    aim: Aim,
    placed: Placed,
    clearance: float,
    method: Method,
    radius: float,
    progress: Callable[[float], None] = lambda _: None,
) -> Placed:
    """Moves one goal pose after the other while the certified margin rises, and there is time.

    Whether a sequence is fit is not asked. In one turn a pose goes no farther than the radius, m in the metric of ρ.
    The clearance a side, m, is the unit of length of the programs: a nonlinear one on the true surfaces, or reciprocal
    cost and steepest descent on the linear ones.
    """
    best = placed
    for _ in range(_ROUNDS):
        before = best.margin
        for k in range(len(best.moves) - 1):  # the seated pose stays
            for reach in (radius, _SHORTER * radius):
                metric = Metric(aim.tolerance.rho, clearance)
                try:
                    heed()
                    candidate = _one(aim, best, metric, method, k, reach)
                except OverdueError:
                    return best
                if candidate is not None:
                    best = candidate
                    progress(best.margin)
                    break
        if best.margin <= before + _GAIN * clearance:
            break
    return best


def _one(aim: Aim, placed: Placed, metric: Metric, method: Method, k: int, radius: float) -> Placed | None:
    assembly = aim.assembly
    move = placed.moves[k]
    forms, allowance = _obstacles(assembly, placed, k, _NEAR * radius)
    rows = forms.at(move.goal)
    if not len(forms) or (rows.f - allowance).min() > placed.margin + _IDLE * metric.clearance:
        return None
    try:
        X = _placed_pose(assembly, move, (rows, allowance), metric, method, radius)
        goal = onto_surfaces(assembly, move.goal.moved(X * assembly.freedoms), move)
        moves = list(placed.moves)
        moves[k] = replace(move, goal=goal)
        moves[k + 1] = replace(moves[k + 1], start=goal)
    except (InfeasibleError, SolverError):
        return None
    return better(aim, moves, placed, _GAIN * metric.clearance)


def _placed_pose(
    assembly: Assembly, move: Move, obstacles: tuple[Rows, Array], metric: Metric, method: Method, radius: float
) -> Array:
    """The displacement (6,) of a goal pose that one method proposes, under rows at it and their allowances, m."""
    rows, allowance = obstacles
    contacts, box = (*move.held, *move.making), radius / metric.sigma
    if method == "nlp":
        problem = SurfacePlacement(
            move.goal,
            contact_forms(assembly, contacts, contacts),
            rows.forms,
            allowance,
            metric=metric,
            lower=-box * assembly.freedoms,
            upper=box * assembly.freedoms,
        )
        return place_on_surfaces(problem, np.zeros(6)).x[:6]
    E = state_rows(assembly, contacts, move.goal)
    goal = Flat(E, np.zeros(len(E)))
    linear = Placement(rows.N, allowance - rows.f, metric=metric, lower=-box, upper=box, goal=goal)
    return descend(linear, np.zeros(6), _CENTRING).x[:6]


def _obstacles(assembly: Assembly, placed: Placed, k: int, near: float) -> tuple[Forms, Array]:
    """Rows near binding at the goal of move k, of pieces that meet there, with allowances, m; none of edge planes."""
    number, forms, allowances = -1, [points_above(np.zeros((0, 3)), np.zeros(3), 0.0)], [np.zeros(0)]
    for claim in placed.reached.claims:
        number += claim.piece.progress[0] == 0.0
        ending = number == k and claim.piece.last
        if not ending and not (number == k + 1 and claim.piece.progress[0] == 0.0):
            continue
        for pair, separation in pairs_of(assembly, claim):
            if separation.witness.kind == "edges" or separation.margin > placed.margin + near:
                continue
            own = counted_rows(assembly, pair, separation.witness).forms
            rows = EndsBatch.of((claim.advance.ends,)).over(own)
            loss = rows.f[:, 0].min(axis=0) - rows.lower[0]
            which = rows.f[int(ending), 0] - loss < placed.margin + near
            forms.append(Forms(own.table[which]))
            allowances.append(loss[which])
        if claim.early is not None and not ending and claim.piece.made is not None:
            forms.append(contact_forms(assembly, (claim.piece.made,), ()))
            allowances.append(forms[-1].at(claim.piece.start).f - claim.early)
    return stacked(*forms), np.concatenate(allowances)
