"""Placement instances for tests and benchmarks: random linearised ones, hand-made ones, a square peg, and oracles."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from fmopt.planning.placement.formation import Row, edge_edge, plane, vertex_face
from fmopt.planning.placement.largest_clearance import Flat, Metric, Placement
from fmopt.planning.placement.nonlinear_program import SurfacePlacement
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

CLEARANCE = 1e-4
METRIC = Metric(0.014, CLEARANCE)
BOX = np.array([1e-3, 1e-3, 1e-3, 0.05, 0.05, 0.05])
LEVERS = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])


def random_placement(seed: int, rows: int = 10, contacts: int = 3, growth: float = 0.0, spare: int = 0) -> Placement:
    """Random hyperplanes round a random affine space, `spare` of its equalities dependent on the others."""
    rng = np.random.default_rng(seed)
    N = rng.normal(size=(rows, 6)) * LEVERS
    D = -rng.uniform(-0.2, 2.0, rows) * CLEARANCE * np.linalg.norm(N, axis=1)
    E = rng.normal(size=(contacts, 6)) * LEVERS
    E = np.vstack([E, rng.normal(size=(spare, contacts)) @ E])
    e = E @ (0.3 * METRIC.units * rng.normal(size=6))
    start = METRIC.units * rng.normal(size=6)
    return Placement(
        N,
        D,
        metric=METRIC,
        lower=-BOX,
        upper=BOX,
        goal=Flat(E, e),
        start=start if growth else None,
        growth=np.full(rows, growth),
    )


def translations(N: list[list[float]], D: list[float], **settings: object) -> Placement:
    """Hyperplanes in x, y, z alone; rotations are held at zero and lengths are in clearances."""
    rows = np.hstack([np.array(N, dtype=np.float64).reshape(-1, 3), np.zeros((len(D), 3))])
    hold = np.array([9.0, 9.0, 9.0, 0.0, 0.0, 0.0])
    return Placement(rows, D, metric=Metric(1.0, 1.0), lower=-hold, upper=hold, **settings)


def linear_surfaces(problem: Placement) -> SurfacePlacement:
    """The same placement for the nonlinear optimiser, every function a plane."""
    assert not isinstance(problem.start, Flat)
    return SurfacePlacement(
        Pose.identity(),
        [plane(N, D) for N, D in zip(problem.goal.E, problem.goal.e, strict=True)],
        [plane(N, D) for N, D in zip(problem.N, problem.D, strict=True)],
        metric=problem.metric,
        lower=problem.lower,
        upper=problem.upper,
        weights=problem.weights,
        growth=problem.growth,
        start=problem.start,
    )


def vertex_enumeration(problem: Placement) -> float:
    """The exact optimum of a placement without growth: the best feasible vertex of its polyhedron, all tried."""
    program = problem.program().scaled()
    A, b = program.A, program.b
    _, s, Vt = np.linalg.svd(A)
    rank = int((s > 1e-10 * s[0]).sum()) if len(b) else 0
    Z, origin = Vt[rank:].T, np.linalg.lstsq(A, b, rcond=1e-10)[0]
    low, high = np.isfinite(program.lower), np.isfinite(program.upper)
    eye = np.eye(len(program.c))
    G = np.vstack([program.G, eye[low], -eye[high]])
    h = np.concatenate([program.h, -program.lower[low], program.upper[high]])
    G, h = G @ Z, h + G @ origin
    chosen = np.array(list(combinations(range(len(h)), G.shape[1])))
    M = G[chosen]
    regular = np.abs(np.linalg.det(M)) > 1e-9
    u = np.linalg.solve(M[regular], -h[chosen[regular]][..., None])[..., 0]
    feasible = (u @ G.T + h > -1e-8).all(axis=1)
    return float(program.size.objective * (origin + u[feasible] @ Z.T)[:, -1].max() * problem.program().size.objective)


def line_search(problem: Placement) -> float:
    """The exact optimum of a placement on a line (five independent contacts), growth included: a concave function."""
    units = problem.metric.units
    E = problem.goal.E * units
    X, V = np.linalg.lstsq(E, problem.goal.e, rcond=1e-12)[0], np.linalg.svd(E)[2][-1]
    with np.errstate(divide="ignore"):
        ends = np.sort([(problem.lower / units - X) / V, (problem.upper / units - X) / V], axis=0)
    low, high = float(ends[0].max()), float(ends[1].min())

    def t(u: float) -> float:
        return float(problem.clearances(np.append(units * (X + u * V), 0.0)).min())

    for _ in range(200):
        one, other = low + (high - low) / 3.0, high - (high - low) / 3.0
        low, high = (low, other) if t(one) > t(other) else (one, high)
    return min(t(low), problem.cap)


def peg_rows(half: float = 0.01, clearance: float = CLEARANCE) -> dict[str, Row]:
    """The 16 primitive contacts of a square peg engaged in a square hole (mouth at z = 0, tip frame at the tip)."""
    wall, length, rows = half + clearance, 0.04, {}
    for axis in (0, 1):
        for side in (1.0, -1.0):
            n = np.zeros(3)
            n[axis] = -side
            for other in (1.0, -1.0):
                tip = np.zeros(3)
                tip[axis], tip[1 - axis] = side * half, other * half
                name = "xy"[axis] + ("+" if side > 0 else "-") + ("+" if other > 0 else "-")
                rows["tip" + name] = vertex_face(tip, n, -wall * n)
                across = np.zeros(3)
                across[1 - axis] = 1.0
                up, mouth = tip + length * np.array([0.0, 0.0, 1.0]), -wall * n
                sign = int(np.sign(np.cross([0.0, 0.0, 1.0], across) @ n))
                rows["mouth" + name] = edge_edge([tip, up], [mouth - 0.01 * across, mouth + 0.01 * across], sign)
    return rows


def peg_placement(contacts: tuple[str, ...], depth: float = 0.015) -> SurfacePlacement:
    """The peg at `depth` with these contacts made, all others as obstacles; sliding and height are held."""
    rows = peg_rows()
    hold = np.array([1e-3, 1e-3, 0.0, 0.05, 0.05, 0.05])
    return SurfacePlacement(
        Pose(np.array([0.0, 0.0, -depth]), np.eye(3)),
        [rows[name] for name in contacts],
        [row for name, row in rows.items() if name not in contacts],
        metric=METRIC,
        lower=-hold,
        upper=hold,
    )


def linearised(problem: SurfacePlacement, X: Array) -> Placement:
    """The tangent placement of a surface placement at X (rotation of X small)."""
    from fmopt.planning.placement.formation import evaluate

    f, E = evaluate(problem.contacts, problem.reference, X)
    g, N = evaluate(problem.obstacles, problem.reference, X)
    return Placement(
        N,
        N @ X - g + problem.allowance,
        metric=problem.metric,
        lower=problem.lower,
        upper=problem.upper,
        goal=Flat(E, E @ X - f),
        weights=problem.weights,
    )
