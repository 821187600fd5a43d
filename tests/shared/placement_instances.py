"""Placement instances for tests and benchmarks: random linearised ones, hand-made ones, a square peg, and oracles."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from fmopt.certificate.rows import Forms, edges_apart, points_above, stacked
from fmopt.planning.optimise.cone_program import ConeProgram, Norm, Solution, Solver, checked
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.placement.largest_clearance import Flat, Metric, Placement
from fmopt.planning.placement.nonlinear_program import SurfacePlacement
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

CLEARANCE = 1e-4
METRIC = Metric(0.014, CLEARANCE)
BOX = np.array([1e-3, 1e-3, 1e-3, 0.05, 0.05, 0.05])
LEVERS = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])


def random_placement(seed: int, rows: int = 10, contacts: int = 3, spare: int = 0) -> Placement:
    """Random hyperplanes round a random affine space, `spare` of its equalities dependent on the others."""
    rng = np.random.default_rng(seed)
    N = rng.normal(size=(rows, 6)) * LEVERS
    D = -rng.uniform(-0.2, 2.0, rows) * CLEARANCE * np.linalg.norm(N, axis=1)
    N, D = N / METRIC.dual_norm(N)[:, None], D / METRIC.dual_norm(N)
    E = rng.normal(size=(contacts, 6)) * LEVERS
    E = np.vstack([E, rng.normal(size=(spare, contacts)) @ E])
    goal = Flat(E, E @ (0.3 * METRIC.units * rng.normal(size=6)))
    return Placement(N, D, goal, metric=METRIC, lower=-BOX, upper=BOX)


def max_min_clearance(problem: Placement, solver: Solver | None = None) -> Solution:
    """The pose of largest least clearance, its optimality checked."""
    return checked(problem.program(), ClarabelSolver() if solver is None else solver)


def random_program(seed: int, growth: float = 0.0, rows: int = 10, contacts: int = 3, spare: int = 0) -> ConeProgram:
    """The program of a random placement of which each row loses `growth` times the way from a random start."""
    program = random_placement(seed, rows, contacts, spare).program()
    if not growth:
        return program
    start, F = METRIC.units * np.random.default_rng(seed).normal(size=6), np.diag(METRIC.sigma)
    norms = (Norm(np.column_stack([F, np.zeros(6)]), -F @ start),)
    return replace(program, W=np.full((rows, 1), growth), norms=norms)


def translations(N: list[list[float]], D: list[float], goal: Flat | None = None) -> Placement:
    """Hyperplanes in x, y, z alone; rotations are held at zero and lengths are in clearances."""
    rows = np.hstack([np.array(N, dtype=np.float64).reshape(-1, 3), np.zeros((len(D), 3))])
    hold = np.array([9.0, 9.0, 9.0, 0.0, 0.0, 0.0])
    goal = Flat(np.zeros((0, 6)), np.zeros(0)) if goal is None else goal
    return Placement(rows, D, goal, metric=Metric(1.0, 1.0), lower=-hold, upper=hold)


def vertex_enumeration(problem: Placement) -> float:
    """The exact optimum of a placement: the best feasible vertex of its polyhedron, all tried."""
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


def peg_rows(half: float = 0.01, clearance: float = CLEARANCE) -> dict[str, Forms]:
    """The 16 primitive contacts of a square peg engaged in a square hole (mouth at z = 0, tip frame at the tip)."""
    wall, up, rows = half + clearance, np.array([0.0, 0.0, 1.0]), {}
    for axis in (0, 1):
        for side in (1.0, -1.0):
            n = np.zeros(3)
            n[axis] = -side
            for other in (1.0, -1.0):
                tip, across = np.zeros(3), np.zeros(3)
                tip[axis], tip[1 - axis], across[1 - axis] = side * half, other * half, 1.0
                name = "xy"[axis] + ("+" if side > 0 else "-") + ("+" if other > 0 else "-")
                rows["tip" + name] = points_above(tip[None], n, -wall)
                sign = np.sign(np.cross(up, across) @ n)
                rows["mouth" + name] = edges_apart(sign * up, across, -wall * n, tip[None])
    return rows


def peg_placement(contacts: tuple[str, ...], depth: float = 0.015, allowance: float = 0.0) -> SurfacePlacement:
    """The peg at `depth` with these contacts made, all others as obstacles; sliding and height are held."""
    rows = peg_rows()
    hold = np.array([1e-3, 1e-3, 0.0, 0.05, 0.05, 0.05])
    obstacles = stacked(*(row for name, row in rows.items() if name not in contacts))
    return SurfacePlacement(
        Pose(np.array([0.0, 0.0, -depth]), np.eye(3)),
        stacked(points_above(np.zeros((0, 3)), np.zeros(3), 0.0), *(rows[name] for name in contacts)),
        obstacles,
        np.full(len(obstacles), allowance),
        metric=METRIC,
        lower=-hold,
        upper=hold,
    )


def linearised(problem: SurfacePlacement, X: Array) -> Placement:
    """The tangent placement of a surface placement at X."""
    (f, N), p = problem.rows(X), len(problem.contacts)
    goal = Flat(N[:p], N[:p] @ X - f[:p])
    bounds = {"lower": problem.lower, "upper": problem.upper}
    return Placement(N[p:], N[p:] @ X - f[p:], metric=problem.metric, goal=goal, **bounds)
