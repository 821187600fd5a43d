"""Placement on the true C-surfaces: CasADi and IPOPT, one solver per contact formation, numbers as parameters.

    maximise t   s.t.   f_i(X) = 0,   f_j(X) − allowance_j − growth_j |X − S|_σ ≥ weights_j t,   lower ≤ X ≤ upper

Solvers are shared within a process and locked: one `nlpsol` object in two threads crashes it.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, assert_never

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import SolverError
from fmopt.placement.clearance import Metric
from fmopt.placement.program import Solution
from fmopt.placement.rows import Row, RowKind, evaluate
from fmopt.se3 import Pose, left_jacobian
from fmopt.values import Array, Value, frozen

ON_SURFACE = 1e-7
_SERIES = 13
_SMOOTH = 1e-12
_lock = threading.Lock()

Counts = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class SurfacePlacement(Value):
    """A goal pose to be placed on true C-surfaces, in local coordinates X around `reference`.

    `contacts` must touch (f = 0), `obstacles` keep clear: weights, allowance and growth (k,) as in the linear
    `Placement`; a weight of 0 must hold but does not count as clearance. Built by `surface_placement`.
    """

    reference: Pose
    contacts: tuple[Row, ...]
    obstacles: tuple[Row, ...]
    weights: Array
    allowance: Array
    growth: Array
    start: Array | None
    lower: Array
    upper: Array
    metric: Metric
    cap: float

    def slacks(self, X: Array) -> Array:
        """f_j − allowance_j − growth_j |X − S|_σ of the obstacles (k,), in m."""
        f = evaluate(self.obstacles, self.reference, X)[0] - self.allowance
        if self.start is not None:
            f = f - self.growth * np.linalg.norm(self.metric.sigma * (X - self.start))
        return np.asarray(f)

    def clearances(self, X: Array) -> Array:
        """Clearance of each counted obstacle (k,) in m; those of weight 0 have inf."""
        counted = self.weights > 0.0
        return np.asarray(np.where(counted, self.slacks(X) / np.where(counted, self.weights, 1.0), np.inf))


def surface_placement(
    reference: Pose,
    contacts: Sequence[Row],
    obstacles: Sequence[Row],
    *,
    metric: Metric,
    lower: ArrayLike,
    upper: ArrayLike,
    weights: ArrayLike | None = None,
    allowance: ArrayLike | None = None,
    growth: ArrayLike | None = None,
    start: ArrayLike | None = None,
    cap: float | None = None,
) -> SurfacePlacement:
    """A placement on true surfaces; arguments as in `placement`, rows in place of hyperplanes.

    Weights default to |N*| of the gradients at the reference pose, as in the linear problem there.

    Raises:
        ValueError: shapes do not fit, growth without a start, or a negative weight or growth.
    """
    k, low, high = len(obstacles), frozen(lower, 6, name="lower"), frozen(upper, 6, name="upper")
    if weights is None:
        weights = metric.dual_norm(evaluate(obstacles, reference, np.zeros(6))[1])
    weigh = frozen(weights, k, name="weights")
    grow = frozen(np.zeros(k) if growth is None else growth, k, name="growth")
    if (weigh < 0.0).any() or (grow < 0.0).any() or (grow.any() and start is None):
        raise ValueError("weights and growth must not be negative, and growth needs a start")
    return SurfacePlacement(
        reference,
        tuple(contacts),
        tuple(obstacles),
        weigh,
        frozen(np.zeros(k) if allowance is None else allowance, k, name="allowance"),
        grow,
        None if start is None else frozen(start, 6, name="start"),
        low,
        high,
        metric,
        float(np.linalg.norm(metric.sigma * (high - low))) if cap is None else cap,
    )


def certify_on_surfaces(problem: SurfacePlacement, X: ArrayLike) -> Solution:
    """Checks a pose (6,) in plain NumPy and takes the clearance t that it really has; x of the result is (X, t).

    Raises:
        SolverError: a contact is off its surface, or an obstacle of weight 0 or a bound is overstepped.
    """
    X = np.asarray(X, dtype=np.float64)
    if X.shape != (6,) or not np.isfinite(X).all():
        raise SolverError("the optimiser returned no finite pose")
    unit = problem.metric.clearance
    f, N = evaluate(problem.contacts, problem.reference, X)
    off = np.abs(f) / (unit * problem.metric.dual_norm(N))
    hard = np.where(problem.weights > 0.0, np.inf, problem.slacks(X) / unit)
    box = np.minimum(X - problem.lower, problem.upper - X) / problem.metric.units
    for what, worst in (("contact", -off), ("obstacle", hard), ("bound", box)):
        if worst.min(initial=np.inf) < -ON_SURFACE:
            i = int(worst.argmin())
            raise SolverError(f"the proposed pose misses {what} {i} by {-worst[i]:.3g} clearances")
    t = min(problem.cap, float(problem.clearances(X).min(initial=np.inf)))
    worst_row = min(float(hard.min(initial=np.inf)), float(box.min()))
    return Solution(frozen([*X, t]), t, float(off.max(initial=0.0)), worst_row, float("inf"), float("inf"), None)


def project(problem: SurfacePlacement, X: ArrayLike) -> Array:
    """The pose (6,) on all contacts' surfaces next to X: Gauss–Newton steps of least metric length.

    Coordinates held by equal bounds stay; the other bounds are left to `certify_on_surfaces`.
    """
    X = np.asarray(X, dtype=np.float64)
    units = problem.metric.units * (problem.upper > problem.lower)
    for _ in range(20):
        J, f = _scaled_contacts(problem, X)
        if np.abs(f).max(initial=0.0) < 1e-12:
            break
        X = X - units * np.linalg.lstsq(J, f, rcond=1e-9)[0]
    return X


def _scaled_contacts(problem: SurfacePlacement, X: Array) -> tuple[Array, Array]:
    """Jacobian (p, 6) and values (p,) of the contacts with respect to X / units, rows of unit length."""
    f, N = evaluate(problem.contacts, problem.reference, X)
    turned = N.copy()
    flat = np.array([row.kind is RowKind.PLANE for row in problem.contacts], dtype=bool)
    turned[~flat, 3:] = N[~flat, 3:] @ left_jacobian(X[3:])
    size = problem.metric.clearance * problem.metric.dual_norm(turned)
    free = problem.upper > problem.lower
    return turned * problem.metric.units * free / size[:, None], f / size


def place_on_surfaces(problem: SurfacePlacement, guess: ArrayLike | None = None) -> Solution:
    """The goal pose of largest clearance on the true surfaces near `guess`, a local optimum.

    The guess (else X = 0) is projected onto the surfaces first; the answer is never worse than that projection.
    Contacts that depend on others at the guess are left out of the optimisation and checked afterwards.

    Raises:
        SolverError: IPOPT did not succeed, or its pose fails `certify_on_surfaces`.
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
    return _better(problem, best, X)


def _better(problem: SurfacePlacement, found: Solution, X: Array) -> Solution:
    try:
        guess = certify_on_surfaces(problem, X)
    except SolverError:
        return found
    return guess if guess.value > found.value else found


def _optimum(problem: SurfacePlacement, kept: list[int], X: Array) -> Array:
    """IPOPT's pose (6,) with the contacts `kept`."""
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
    fixed = [units, problem.reference.p, problem.reference.R.ravel(order="F"), start, [unit]]
    numbers = np.reshape([row.numbers for row in rows], (p + k, 12))
    parameters = np.concatenate([*fixed, numbers.ravel(), scale.ravel(order="F")])
    t = min(problem.cap, float(problem.clearances(X).min(initial=np.inf))) / unit
    bounds = (np.append(problem.lower / units, -np.inf), np.append(problem.upper / units, problem.cap / unit))
    with _lock:
        solver = formation_solver(_counts(contacts), _counts(obstacles))
        answer = solver(
            x0=np.append(X / units, t),
            p=parameters,
            lbx=bounds[0],
            ubx=bounds[1],
            lbg=np.zeros(p + k),
            ubg=np.append(np.zeros(p), np.full(k, np.inf)),
        )
        status = str(solver.stats()["return_status"])
        z, g = np.array(answer["x"])[:, 0], np.array(answer["g"])[:, 0]
    if status != "Solve_Succeeded":
        short = float(np.abs(np.append(g[:p], np.minimum(g[p:], 0.0))).max(initial=0.0))
        raise SolverError(
            f"IPOPT stopped with {status}, {short:.3g} clearances short", "start from a better pose, or drop the state"
        )
    return np.asarray(np.clip(z[:6] * units, problem.lower, problem.upper))


_ORDER = {kind: i for i, kind in enumerate(RowKind)}


def _counts(rows: Sequence[Row]) -> Counts:
    kinds = [row.kind for row in rows]
    one, two, three, four = (kinds.count(kind) for kind in RowKind)
    return one, two, three, four


@lru_cache(maxsize=64)
def formation_solver(contacts: Counts, obstacles: Counts) -> Any:
    """IPOPT for this many rows of each kind, contacts then obstacles; call it under the module's lock only."""
    import casadi as ca

    repeats = [*zip(RowKind, contacts, strict=True), *zip(RowKind, obstacles, strict=True)]
    kinds = [kind for kind, n in repeats for _ in range(n)]
    p, total = sum(contacts), len(kinds)
    z = ca.SX.sym("z", 7)
    units, p0, R0, start, unit = (ca.SX.sym(name, n) for name, n in _FIXED)
    numbers, scale = ca.SX.sym("numbers", 12, total), ca.SX.sym("scale", 4, total)
    X = units * z[:6]
    R = _rotation(ca, X[3:]) @ ca.reshape(R0, 3, 3)
    f = [_expression(ca, kind, numbers[:, i], X, p0 + X[:3], R) for i, kind in enumerate(kinds)]
    travel = unit * ca.sqrt(ca.sumsqr((X - start) / units) + _SMOOTH)
    g = [scale[0, i] * (f[i] - scale[2, i] - scale[3, i] * travel) - scale[1, i] * z[6] for i in range(total)]
    parameters = ca.vertcat(units, p0, R0, start, unit, ca.vec(numbers), ca.vec(scale))
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": 100,
            "tol": 1e-9,
            "constr_viol_tol": 1e-9,
            "acceptable_iter": 0,
            "bound_relax_factor": 0.0,
            "mu_strategy": "adaptive",
        },
    }
    name = "placement_" + "_".join(str(n) for n in (*contacts, p, *obstacles))
    return ca.nlpsol(name, "ipopt", {"x": z, "f": -z[6], "g": ca.vertcat(*g), "p": parameters}, options)


_FIXED = (("units", 6), ("p0", 3), ("R0", 9), ("start", 6), ("unit", 1))


def _rotation(ca: Any, r: Any) -> Any:
    """exp([r]×) by its power series in |r|², smooth at 0; 1e-15 accurate up to half a turn."""
    square = ca.sumsqr(r)
    a = b = 0.0
    for k in reversed(range(_SERIES)):
        a = 1.0 - a * square / ((2 * k + 2) * (2 * k + 3))
        b = 1.0 - b * square / ((2 * k + 3) * (2 * k + 4))
    K = ca.skew(r)
    return ca.SX.eye(3) + a * K + 0.5 * b * (K @ K)


def _expression(ca: Any, kind: RowKind, c: Any, X: Any, p: Any, R: Any) -> Any:
    match kind:
        case RowKind.VERTEX_FACE:
            return ca.dot(c[3:6], R @ c[:3] + p) - c[6]
        case RowKind.FACE_VERTEX:
            return ca.dot(R @ c[:3], c[3:6] - p) - c[6]
        case RowKind.EDGE_EDGE:
            m = ca.cross(R @ c[:3], c[6:9])
            return ca.dot(m, R @ c[3:6] + p - c[9:12]) / ca.norm_2(m)
        case RowKind.PLANE:
            return ca.dot(c[:6], X) - c[6]
        case _:
            assert_never(kind)
