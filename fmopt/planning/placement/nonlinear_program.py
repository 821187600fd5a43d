"""Placement on the true C-surfaces: sequential quadratic programs, and IPOPT for what these do not settle.

    maximise t   s.t.   f_i(X) = 0,   f_j(X) − allowance_j − growth_j |X − S|_σ ≥ weights_j t,   lower ≤ X ≤ upper

What CasADi builds, once per contact formation, is shared within a process and locked: one `nlpsol` object in two
threads crashes it.

The largest least clearance by sequential quadratic programs in a trust region, each solved by daqp.

    maximise t   s.t.   g_i(x) = 0,   g_j(x) ≥ w_j t,   lower ≤ (x, t) ≤ upper

A step is taken when the merit falls, −t + μ (what rows are short of), with t the best that the rows allow at x. Curved
equalities are followed by solving once more with what the rows came to at the end of the step.
"""

import threading
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import SolverError
from fmopt.planning.optimise.cone_program import Solution, left_out, stated
from fmopt.planning.placement.formation import (
    Counts,
    Derivatives,
    Row,
    RowKind,
    Table,
    counts,
    evaluate,
    formation_derivatives,
    formation_solver,
)
from fmopt.planning.placement.largest_clearance import Room, per_weight
from fmopt.spatial.se3 import Pose, left_jacobian
from fmopt.spatial.values import Array, frozen

ON_SURFACE = 1e-7  # clearances by which a pose may miss contacts and bounds
_lock = threading.Lock()

_ORDER = {kind: i for i, kind in enumerate(RowKind)}

_EQUALITY = 5  # how daqp marks equalities
_NONE = 1e30  # daqp's infinity
_ROUNDS = 60
_RADIUS = 2.0  # scaled units of the first step, at most
_LEAST = 1e-9  # radius at which steps are given up
_FLAT = 1e-5  # least curvature that a quadratic program gets
_SETTLED = 1e-10  # of the merit, scaled units
_EXACT = 1e-10  # of equalities
_GAIN = 1e-4  # of what a step promises, the least that it has to bring
_SETTINGS = {"primal_tol": 1e-11, "dual_tol": 1e-11, "iter_limit": 300}


@dataclass(frozen=True, eq=False)
class SurfacePlacement(Room, allowance=("obstacles",)):
    """A goal pose to be placed on true C-surfaces, in local coordinates X around `reference`.

    `contacts` must touch (f = 0), `obstacles` keep clear, less an allowance (k,), else none: weights and growth as in
    the linear `Placement`, |N*| at the reference pose; a weight of 0 must hold but does not count as clearance.

    Raises:
        ValueError: shapes do not fit, growth without a start, or a negative weight or growth.
    """

    reference: Pose
    contacts: tuple[Row, ...]
    obstacles: tuple[Row, ...]
    allowance: Array = field(default_factory=left_out, kw_only=True)
    start: Array | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "contacts", tuple(self.contacts))
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        stated(self, allowance=np.zeros(len(self.obstacles)))
        super().__post_init__()
        if self.start is not None:
            object.__setattr__(self, "start", frozen(self.start, 6, name="start"))
        weights = self.weights
        if not np.size(weights):
            weights = self.metric.dual_norm(evaluate(self.obstacles, self.reference, np.zeros(6))[1])
        self.complete(weights, moving=self.start is not None)

    @cached_property
    def tables(self) -> tuple[Table, Table]:
        """Contacts and obstacles, sorted by kind."""
        return Table.of(self.contacts), Table.of(self.obstacles)

    def slacks(self, X: Array) -> Array:
        """f_j − allowance_j − growth_j |X − S|_σ of the obstacles (k,), in m."""
        f = self.tables[1].at(self.reference, X)[0] - self.allowance
        if self.start is not None:
            f = f - self.growth * np.linalg.norm(self.metric.sigma * (X - self.start))
        return np.asarray(f)

    def clearances(self, X: Array) -> Array:
        """Clearance of each counted obstacle (k,) in m; those of weight 0 have inf."""
        return per_weight(self.slacks(X), self.weights)


def certify_on_surfaces(problem: SurfacePlacement, X: ArrayLike) -> Solution:
    """Checks X (6,), m and rad, in plain NumPy and takes the clearance t that it really has; x of the result is (X, t).

    Raises:
        SolverError: a contact is off its surface, or an obstacle of weight 0 or a bound is overstepped.
    """
    X = np.asarray(X, dtype=np.float64)
    if X.shape != (6,) or not np.isfinite(X).all():
        raise SolverError("the optimiser returned no finite pose")
    unit = problem.metric.clearance
    f, N = problem.tables[0].at(problem.reference, X)
    off = np.abs(f) / (unit * problem.metric.dual_norm(N))
    slacks = problem.slacks(X)
    hard = np.where(problem.weights > 0.0, np.inf, slacks / unit)
    box = np.minimum(X - problem.lower, problem.upper - X) / problem.metric.units
    for what, worst in (("contact", -off), ("obstacle", hard), ("bound", box)):
        if worst.min(initial=np.inf) < -ON_SURFACE:
            i = int(worst.argmin())
            raise SolverError(f"the proposed pose misses {what} {i} by {-worst[i]:.3g} clearances")
    t = min(problem.cap, float(per_weight(slacks, problem.weights).min(initial=np.inf)))
    return Solution(frozen([*X, t]), t, float("inf"), float("inf"), None)


def project(problem: SurfacePlacement, X: ArrayLike) -> Array:
    """The pose (6,) on all contacts' surfaces next to X: Gauss–Newton steps of least metric length.

    Coordinates held by equal bounds stay; the other bounds are left to `certify_on_surfaces`.
    """
    X = np.asarray(X, dtype=np.float64)
    if not problem.contacts:
        return X
    units = problem.metric.units * (problem.upper > problem.lower)
    for _ in range(20):
        J, f = _scaled_contacts(problem, X)
        if np.abs(f).max(initial=0.0) < 1e-12:
            break
        X = X - units * np.linalg.lstsq(J, f, rcond=1e-9)[0]
    return X


def _scaled_contacts(problem: SurfacePlacement, X: Array) -> tuple[Array, Array]:
    """Jacobian (p, 6) and values (p,) of the contacts with respect to X / units, rows of unit length."""
    f, N = problem.tables[0].at(problem.reference, X)
    turned = N.copy()
    places = problem.tables[0].contacts
    turned[places, 3:] = N[places, 3:] @ left_jacobian(X[3:])  # from turns of the pose to changes of X
    size = problem.metric.clearance * problem.metric.dual_norm(turned)
    free = problem.upper > problem.lower
    return turned * problem.metric.units * free / size[:, None], f / size


def place_on_surfaces(problem: SurfacePlacement, guess: ArrayLike | None = None) -> Solution:
    """The goal pose of largest clearance on the true surfaces near `guess` (6,), m and rad, a local optimum.

    The guess (else X = 0) is projected onto the surfaces first; the answer is never worse than that projection.
    Contacts that depend on others at the guess are left out of the optimisation and checked afterwards.

    Raises:
        SolverError: no method succeeded, or its pose fails `certify_on_surfaces`.
    """
    from scipy.linalg import qr

    X = project(problem, np.zeros(6) if guess is None else guess)
    kept = list(range(len(problem.contacts)))
    if kept:
        R, pivots = qr(_scaled_contacts(problem, X)[0].T, mode="r", pivoting=True)
        diagonal = np.abs(np.diag(R))
        kept = sorted(pivots[: int((diagonal > 1e-7 * diagonal[0]).sum())].tolist())
    try:
        best = certify_on_surfaces(problem, project(problem, _optimum(problem, kept, X)))
    except SolverError:
        if len(kept) == len(problem.contacts):
            raise
        best = certify_on_surfaces(problem, project(problem, _optimum(problem, list(range(len(problem.contacts))), X)))
    try:
        projected = certify_on_surfaces(problem, X)
    except SolverError:
        return best
    return projected if projected.value > best.value else best


def _optimum(problem: SurfacePlacement, kept: list[int], X: Array) -> Array:
    """The optimum (6,) with the contacts `kept`."""
    contacts = sorted((problem.contacts[i] for i in kept), key=lambda row: _ORDER[row.kind])
    order = sorted(range(len(problem.obstacles)), key=lambda j: _ORDER[problem.obstacles[j].kind])
    obstacles = [problem.obstacles[j] for j in order]
    unit, units = problem.metric.clearance, problem.metric.units
    rows = [*contacts, *obstacles]
    sizes = problem.metric.dual_norm(evaluate(rows, problem.reference, X)[1])
    sizes[sizes == 0.0] = 1.0
    p, k = len(contacts), len(obstacles)
    scale = np.zeros((4, p + k))
    scale[0] = 1.0 / (unit * sizes)
    scale[1:, p:] = problem.weights[order] / sizes[p:], problem.allowance[order], problem.growth[order]
    start = np.zeros(6) if problem.start is None else problem.start
    fixed = [units, problem.reference.p, problem.reference.R.ravel(order="F"), start, [unit]]  # by columns, as CasADi's
    parameters = np.concatenate([*fixed, *(row.numbers for row in rows), scale.ravel(order="F")])
    t = min(problem.cap, float(problem.clearances(X).min(initial=np.inf))) / unit
    begin = np.append(X / units, t)
    bounds = np.append(problem.lower / units, -np.inf), np.append(problem.upper / units, problem.cap / unit)
    formation = counts(contacts), counts(obstacles)
    with _lock:
        found = largest(formation_derivatives(*formation), p, scale[1], begin, parameters, bounds)
        if found is None:
            found = _interior_point(formation, begin, parameters, bounds)
    return np.asarray(np.clip(found[:6] * units, problem.lower, problem.upper))


def _interior_point(
    formation: tuple[Counts, Counts], begin: Array, parameters: Array, bounds: tuple[Array, Array]
) -> Array:
    """IPOPT's answer (7,), for what the sequential programs do not settle."""
    p, k = (sum(part) for part in formation)
    solver = formation_solver(*formation)
    low, high = np.zeros(p + k), np.append(np.zeros(p), np.full(k, np.inf))
    answer = solver(x0=begin, p=parameters, lbx=bounds[0], ubx=bounds[1], lbg=low, ubg=high)
    status = str(solver.stats()["return_status"])
    if status != "Solve_Succeeded":
        g = np.array(answer["g"])[:, 0]
        short = float(np.abs(np.append(g[:p], np.minimum(g[p:], 0.0))).max(initial=0.0))
        raise SolverError(
            f"IPOPT stopped with {status}, {short:.3g} clearances short", "start from a better pose, or drop the state"
        )
    return np.array(answer["x"])[:, 0]


@dataclass(frozen=True, eq=False)
class _Program:
    """The program in numbers: its functions, equalities first, how many of them, weights (k,) and bounds (7,)."""

    functions: Derivatives
    equalities: int
    weights: Array
    parameters: Array
    lower: Array
    upper: Array

    def best(self, g: Array) -> float:
        """The largest t that rows with values g (k,) allow."""
        counted = self.weights > 0.0
        return min(float(self.upper[6]), float((g[counted] / self.weights[counted]).min(initial=np.inf)))

    def short(self, g: Array) -> float:
        """What equalities are off, and rows without weight short of, in all."""
        p = self.equalities
        hard = g[p:][self.weights[p:] == 0.0]
        return float(np.abs(g[:p]).sum() - np.minimum(hard, 0.0).sum())


@dataclass(frozen=True, eq=False)
class _Point:
    """A pose x (6,) with the rows' values (k,), gradients (k, 6), and the Hessian (6, 6) of their weighted sum."""

    x: Array
    g: Array
    J: Array
    H: Array


class _Step(NamedTuple):
    """A step (6,) and the rows' multipliers (k,) at its end."""

    d: Array
    multipliers: Array


class _Merit(NamedTuple):
    """−t + μ (what rows are short of): what it is now, and the price μ."""

    now: float
    price: float

    def gained(self, program: _Program, g: Array) -> float:
        """By how much it falls where rows have values g (k,)."""
        return self.now - self.price * program.short(g) + program.best(g)


def largest(
    functions: Derivatives,
    equalities: int,
    weights: Array,
    begin: Array,
    parameters: Array,
    bounds: tuple[Array, Array],
) -> Array | None:
    """A local optimum (x, t) (7,) from a start (7,), within bounds (7,); None where the steps do not come to an end.

    Weights w (k,) are zero for equalities and for rows that only have to hold.
    """
    program = _Program(functions, equalities, weights, parameters, *bounds)
    at = _Point(begin[:6], *functions(begin[:6], parameters, np.zeros(len(weights))))
    radius, price = _RADIUS, 1.0
    for _ in range(_ROUNDS):
        step = _step(program, at, at.g, radius)
        if step is None:
            radius *= 0.1
            if radius < _LEAST:
                return None
            continue
        d, multipliers = step
        price = max(price, 2.0 * float(np.abs(multipliers).max(initial=0.0)))  # above all multipliers: exact
        merit = _Merit(price * program.short(at.g) - program.best(at.g), price)
        gain = merit.gained(program, at.g + at.J @ d)
        if gain <= _SETTLED * (1.0 + abs(merit.now)) and program.short(at.g) <= _EXACT:
            return np.append(at.x, program.best(at.g))
        there = _there(program, at.x + d, multipliers)
        rise = merit.gained(program, there.g)
        if rise < _GAIN * gain:
            there, rise = _corrected(program, at, there, step, radius, merit)
        if rise >= _GAIN * gain:
            farther = rise >= 0.75 * gain and float(np.abs(d).max()) >= 0.9 * radius
            at, radius = there, 2.0 * radius if farther else radius
        else:
            at = replace(at, H=program.functions(at.x, parameters, multipliers)[2])
            radius = 0.25 * min(radius, float(np.abs(d).max()))
        if radius < _LEAST:
            return None
    return None


def _there(program: _Program, x: Array, multipliers: Array) -> _Point:
    return _Point(x, *program.functions(x, program.parameters, multipliers))


def _corrected(
    program: _Program, at: _Point, there: _Point, step: _Step, radius: float, merit: _Merit
) -> tuple[_Point, float]:
    """The end of a step that takes into account how rows bend along the first one, where that is better."""
    again = _step(program, at, there.g - at.J @ step.d, radius)
    rise = merit.gained(program, there.g)
    if again is None:
        return there, rise
    other = _there(program, at.x + again.d, step.multipliers)
    more = merit.gained(program, other.g)
    return (other, more) if more > rise else (there, rise)


def _step(program: _Program, at: _Point, g: Array, radius: float) -> _Step | None:
    """The step (6,) of the quadratic program of rows g + J d, and its multipliers (k,); None where daqp finds none.

    With u = t at the end of the step: −u + ½ dᵀB d, B the Hessian of the Lagrangian with flat and falling directions
    bent up, so that the program is convex.
    """
    import daqp

    p, k = program.equalities, len(g)
    w, V = np.linalg.eigh(-0.5 * (at.H + at.H.T))
    quadratic = np.zeros((7, 7))
    quadratic[6, 6] = 1e-7  # t is linear, and daqp wants curvature
    rows = np.empty((k, 7))
    rows[:, :6], rows[:, 6] = at.J, -program.weights
    lower, upper = np.empty(7 + k), np.full(7 + k, _NONE)
    lower[:6], upper[:6] = np.maximum(program.lower[:6] - at.x, -radius), np.minimum(program.upper[:6] - at.x, radius)
    lower[6], upper[6] = -_NONE, min(float(program.upper[6]), _NONE)
    lower[7:] = -g
    upper[7 : 7 + p] = -g[:p]
    sense = np.zeros(7 + k, dtype=np.int32)
    sense[7 : 7 + p] = _EQUALITY
    quadratic[:6, :6] = (V * np.maximum(w, _FLAT)) @ V.T
    # Where many rows meet in one point, as in symmetric placements, daqp cycles unless it goes there in short steps.
    for settings in (_SETTINGS, {**_SETTINGS, "eps_prox": 1e-3}, {**_SETTINGS, "eps_prox": 1e-1}):
        z, _, flag, info = daqp.solve(quadratic, np.append(np.zeros(6), -1.0), rows, upper, lower, sense, **settings)
        if flag == 1:
            return _Step(np.asarray(z[:6]), -np.asarray(info["lam"])[7:])
    return None
