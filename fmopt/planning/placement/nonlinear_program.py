"""Placement of a goal pose on the true C-surfaces by a nonlinear program (CasADi, IPOPT).

maximise t   s.t.   f_i(X) = 0,   f_j(X) − allowance_j ≥ t,   lower ≤ X ≤ upper
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fmopt.certificate.rows import Forms, stacked
from fmopt.errors import SolverError
from fmopt.planning.optimise.cone_program import Solution
from fmopt.planning.placement.largest_clearance import Room
from fmopt.spatial.se3 import Pose, left_jacobian
from fmopt.spatial.values import Array, frozen

ON_SURFACE = 1e-7  # clearances by which a pose may miss contacts and bounds
_SERIES = 13  # terms of the series of a rotation
_WIDTH = 23  # numbers of a row
_LOCK = threading.Lock()  # IPOPT's linear solver is not safe for threads
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 100,
        "tol": 1e-9,
        "constr_viol_tol": 1e-9,
        "acceptable_iter": 0,  # none: what is only acceptable is not solved
        "bound_relax_factor": 0.0,  # bounds are checked as they are stated
        "mu_strategy": "adaptive",
    },
}


@dataclass(frozen=True, eq=False)
class SurfacePlacement(Room, allowance=("obstacles",)):
    """A goal pose to be placed on true C-surfaces, in local coordinates X around `reference`.

    `contacts` must touch (f = 0), `obstacles` keep clear, less an allowance (k,), m.
    """

    reference: Pose
    contacts: Forms
    obstacles: Forms
    allowance: Array

    @cached_property
    def _forms(self) -> Forms:
        return stacked(self.contacts, self.obstacles)

    def rows(self, X: Array) -> tuple[Array, Array]:
        """Distances (p + k,) of contacts, then of obstacles less their allowances, m, and gradients (p + k, 6) by X."""
        rows = self._forms.at(self.reference.moved(X))
        N = np.hstack([rows.N[:, :3], rows.N[:, 3:] @ left_jacobian(X[3:])])  # from turns of the pose to changes of X
        return rows.f - np.append(np.zeros(len(self.contacts)), self.allowance), N

    def clearances(self, X: Array) -> Array:
        """Clearance of each obstacle (k,) in m."""
        return self.rows(X)[0][len(self.contacts) :]


def certify_on_surfaces(problem: SurfacePlacement, X: ArrayLike) -> Solution:
    """Checks X (6,), m and rad, and takes the clearance t that it really has; x of the result is (X, t).

    Raises:
        SolverError: a contact is off its surface, or a bound is overstepped.
    """
    X = np.asarray(X, dtype=np.float64)
    if X.shape != (6,) or not np.isfinite(X).all():
        raise SolverError("the optimiser returned no finite pose")
    unit, p = problem.metric.clearance, len(problem.contacts)
    f, N = problem.rows(X)
    off = np.abs(f[:p]) / (unit * problem.metric.dual_norm(N[:p]))
    box = np.minimum(X - problem.lower, problem.upper - X) / problem.metric.units
    for what, worst in (("contact", -off), ("bound", box)):
        if worst.min(initial=np.inf) < -ON_SURFACE:
            i = int(worst.argmin())
            raise SolverError(f"the proposed pose misses {what} {i} by {-worst[i]:.3g} clearances")
    t = min(problem.cap, float(f[p:].min(initial=np.inf)))
    return Solution(frozen([*X, t]), t, float("inf"), float("inf"), None)


def project(problem: SurfacePlacement, X: ArrayLike) -> Array:
    """The pose (6,) on all contacts' surfaces next to X: Gauss–Newton steps of least metric length.

    Coordinates held by equal bounds stay; the other bounds are left to `certify_on_surfaces`.
    """
    X = np.asarray(X, dtype=np.float64)
    if not len(problem.contacts):
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
    f, N = (part[: len(problem.contacts)] for part in problem.rows(X))
    size = problem.metric.clearance * problem.metric.dual_norm(N)
    free = problem.upper > problem.lower
    return N * problem.metric.units * free / size[:, None], f / size


def place_on_surfaces(problem: SurfacePlacement, guess: ArrayLike | None = None) -> Solution:
    """The goal pose of largest clearance on the true surfaces near `guess` (6,), m and rad, a local optimum.

    The guess (else X = 0) is projected onto the surfaces first; the answer is never worse than that projection.
    Contacts that depend on others at the guess are left out of the optimisation and checked afterwards.

    Raises:
        SolverError: neither the optimum nor the projection passes `certify_on_surfaces`.
    """
    from scipy.linalg import qr

    X, p = project(problem, np.zeros(6) if guess is None else guess), len(problem.contacts)
    kept = list(range(p))
    if kept:
        R, pivots = qr(_scaled_contacts(problem, X)[0].T, mode="r", pivoting=True)
        diagonal = np.abs(np.diag(R))
        kept = sorted(pivots[: int((diagonal > 1e-7 * diagonal[0]).sum())].tolist())
    found, failure = list[Solution](), None
    for pose in (_optimum(problem, kept, X), X):
        try:
            found.append(certify_on_surfaces(problem, project(problem, pose)))
        except SolverError as error:
            failure = failure or error
    if not found:
        assert failure is not None
        raise failure
    return max(found, key=lambda solution: solution.value)


def _optimum(problem: SurfacePlacement, kept: Sequence[int], X: Array) -> Array:
    """The pose (6,) at which IPOPT stops, with the contacts `kept`; variables are in their natural sizes."""
    metric, p, (f, N) = problem.metric, len(problem.contacts), problem.rows(X)
    rows = np.array([*kept, *range(p, len(f))])
    sizes = metric.clearance * metric.dual_norm(N[rows])
    sizes[sizes == 0.0] = 1.0
    counted = rows >= p
    table, weights = stacked(problem.contacts, problem.obstacles).table[rows], counted * metric.clearance / sizes
    columns = np.column_stack([*(table[name] for name in "nukbas"), table["c"], table["sign"]])
    less = np.append(np.zeros(p), problem.allowance)[rows]
    given = [metric.units, problem.reference.p, problem.reference.R.T.ravel()]
    numbers = np.concatenate([*given, np.column_stack([columns, less, sizes, weights]).ravel()])
    t = min(problem.cap, float(problem.clearances(X).min(initial=np.inf)))
    units = np.append(metric.units, metric.clearance)
    with _LOCK:
        answer = _solver(len(rows))(
            x0=np.append(X, t) / units, p=numbers, lbg=0.0, ubg=np.where(counted, np.inf, 0.0),
            lbx=np.append(problem.lower, -np.inf) / units, ubx=np.append(problem.upper, problem.cap) / units,
        )  # fmt: skip
    return np.clip(np.array(answer["x"])[:6, 0] * metric.units, problem.lower, problem.upper)


@lru_cache(maxsize=64)
def _solver(count: int) -> Any:
    """IPOPT over a scaled pose and the clearance (7,), for so many rows, whose numbers are parameters."""
    import casadi as ca

    x = ca.SX.sym("x", 7)
    units, p0, R0 = (ca.SX.sym(name, n, m) for name, n, m in (("units", 6, 1), ("p", 3, 1), ("R", 3, 3)))
    rows = ca.SX.sym("rows", _WIDTH, count)
    n, u, k, b, a, s = (rows[3 * i : 3 * i + 3, :] for i in range(6))
    c, sign, less, sizes, weights = (rows[18 + i, :] for i in range(5))
    X = units * x[:6]
    p, R = p0 + X[:3], _rotation(ca, X[3:]) @ R0
    f = p.T @ n + ca.sum1(u * (R @ k)) + ca.sum1((R @ b) * (p @ sign - ca.skew(p) @ a + s)) - c
    program = {
        "x": x,
        "f": -x[6],
        "g": ((f - less) / sizes - weights * x[6]).T,
        "p": ca.vertcat(units, p0, ca.vec(R0), ca.vec(rows)),
    }
    return ca.nlpsol(f"placement_{count}", "ipopt", program, _OPTIONS)


def _rotation(ca: Any, r: Any) -> Any:
    """exp([r]×) by its power series in |r|², smooth at 0; 1e-15 accurate up to half a turn."""
    square, a, b = ca.sumsqr(r), 0.0, 0.0
    for k in reversed(range(_SERIES)):
        a = 1.0 - a * square / ((2 * k + 2) * (2 * k + 3))
        b = 1.0 - b * square / ((2 * k + 3) * (2 * k + 4))
    K = ca.skew(r)
    return ca.SX.eye(3) + a * K + 0.5 * b * (K @ K)
