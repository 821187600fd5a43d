"""Interior points against the plain formulas of their kernels, Clarabel, hand-made optima and refusals."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from placement_instances import random_placement

from fmopt.errors import InfeasibleError, SolverError
from fmopt.placement import cone_solver, interior
from fmopt.placement.clearance import lexicographic, max_min_clearance
from fmopt.placement.cone_solver import ConeSolver
from fmopt.placement.equalities import eliminated
from fmopt.placement.program import ConeProgram, Norm, certify, checked
from fmopt.placement.socp import ClarabelSolver
from fmopt.values import Array

FLAT, WIDTHS = 5, np.array([3, 4], dtype=np.intp)


def cones() -> interior.Cones:
    return interior._cones(FLAT, WIDTHS)


def inner(rng: np.random.Generator) -> Array:
    """A point inside the product of an orthant and two second-order cones."""
    s = rng.uniform(0.1, 2.0, FLAT)
    for width in WIDTHS:
        tail = rng.normal(size=width - 1)
        s = np.append(s, [np.linalg.norm(tail) + rng.uniform(0.05, 1.0), *tail])
    return s


def scaled(rng: np.random.Generator) -> tuple[Array, Array, interior.Scaling, Array]:
    """Two points inside, their scaling as the kernel has it, and W as a matrix."""
    s, z, scaling = inner(rng), inner(rng), (np.zeros(12), np.zeros(2))
    assert interior._scale(s, z, cones(), scaling)
    w, eta = scaling
    W = np.diag(np.append(1.0 / np.sqrt(w[:FLAT]), np.zeros(7)))
    for k, (i, j) in enumerate(((5, 8), (8, 12))):
        u = w[i + 1 : j]
        W[i, i], W[i, i + 1 : j], W[i + 1 : j, i] = w[i], u, u
        W[i + 1 : j, i + 1 : j] = np.eye(j - i - 1) + np.outer(u, u) / (1.0 + w[i])
        W[i:j, i:j] *= eta[k]
    return s, z, scaling, W


def product(x: Array, y: Array) -> Array:
    """x ∘ y."""
    found = x * y
    for i, j in ((5, 8), (8, 12)):
        found[i:j] = np.append(x[i:j] @ y[i:j], x[i] * y[i + 1 : j] + y[i] * x[i + 1 : j])
    return found


@pytest.mark.parametrize("seed", range(8))
def test_equations_are_solved_for_as_many_unknowns_as_are_independent(seed: int) -> None:
    rng = np.random.default_rng(seed)
    r = int(rng.integers(0, 5))
    A = np.vstack([rng.normal(size=(r, 6)), rng.normal(size=(2, r)) @ rng.normal(size=(r, 6))])
    A[r:] = rng.normal(size=(2, r)) @ A[:r]
    A, x = rng.permutation(A), rng.normal(size=6)
    b = A @ x
    table, rows, columns, left = eliminated(A, b, 1e-10)
    plain = eliminated.py_func(A, b, 1e-10)
    assert table.shape == (r, 7)
    assert left < 1e-12
    assert np.linalg.matrix_rank(A[rows]) == r
    free = rng.normal(size=6)
    free[columns] = 0.0
    free[columns] = table[:, 6] - table[:, :6] @ free
    assert A @ free == pytest.approx(b, abs=1e-11)
    for one, other in zip((table, rows, columns), plain, strict=False):
        assert one == pytest.approx(other, abs=1e-13)
    assert eliminated(np.vstack([A, A[:1]]), np.append(b, b[0] + 0.5), 1e-10)[3] == pytest.approx(0.5) or not r


@pytest.mark.parametrize("seed", range(8))
def test_the_scaling_takes_one_point_to_the_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s, z, scaling, W = scaled(rng)
    assert W @ z == pytest.approx(np.linalg.solve(W, s), rel=1e-10)
    x = rng.normal(size=12)
    found = x.copy()
    interior._weight(found, cones(), scaling)
    assert found == pytest.approx(np.linalg.solve(W, np.linalg.solve(W, x)), rel=1e-9)
    for points in ((s - 10.0, z), (s, -z)):
        assert not interior._scale(*points, cones(), (np.zeros(12), np.zeros(2)))


@pytest.mark.parametrize("seed", range(8))
def test_the_corrector_solves_what_it_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s, z, scaling, W = scaled(rng)
    ds, dz, target = rng.normal(size=12), rng.normal(size=12), np.empty(12)
    unit = np.zeros(12)
    unit[[*range(FLAT), 5, 8]] = 1.0
    right = 0.3 * unit - product(np.linalg.solve(W, ds), W @ dz)
    interior._bent(s, z, ds.copy(), dz.copy(), 0.3, cones(), scaling, target)
    assert product(W @ z, np.linalg.solve(W, target + s)) == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_step_reaches_the_border_and_no_farther(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s, ds = inner(rng), rng.normal(size=12)

    def room(x: Array) -> float:
        return min(x[:FLAT].min(), *(x[i] - np.linalg.norm(x[i + 1 : j]) for i, j in ((5, 8), (8, 12))))

    far = interior._reach(s, ds, cones())
    assert room(s + 0.999999 * far * ds) > 0.0
    assert room(s + 1.000001 * far * ds) < 0.0
    assert interior._reach(s, inner(rng), cones()) == np.inf


@pytest.mark.parametrize("seed", range(8))
def test_normal_equations_and_newtons_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, _, scaling, W = scaled(rng)
    M = rng.normal(size=(12, 4)) * (rng.uniform(size=(12, 4)) < 0.7)
    M[:4] += np.eye(4)
    rows, U = interior._rows(M), np.empty((4, 4))
    interior._factor(rows, cones(), scaling, U)
    upper = np.triu(U)
    upper[np.arange(4), np.arange(4)] = 1.0 / np.diag(U)
    V = np.linalg.solve(W, M)
    assert upper.T @ upper == pytest.approx(V.T @ V, rel=1e-9)
    rp, rd, target = rng.normal(size=12), rng.normal(size=4), rng.normal(size=12)
    dv, ds, dz = step = np.empty(4), np.empty(12), np.empty(12)
    interior._direction(rows, cones(), scaling, U, rp, rd, 0.7, target, step)
    assert M @ dv + ds == pytest.approx(-0.7 * rp, abs=1e-10)
    assert M.T @ dz == pytest.approx(-0.7 * rd, abs=1e-8)
    assert ds + W @ W @ dz == pytest.approx(target, abs=1e-9)


def disc() -> tuple[Array, Array, Array, int, Array]:
    """Least −x − y on the unit disc: −√2."""
    return np.vstack([np.zeros(2), -np.eye(2)]), np.array([1.0, 0, 0]), -np.ones(2), 0, np.array([3], dtype=np.intp)


def test_optimum_by_hand_compiled_and_as_it_is_written() -> None:
    for kernel in (interior.optimum, interior.optimum.py_func):
        v, z, done = kernel(*disc(), 1e-10, 50)
        assert done
        assert v == pytest.approx([np.sqrt(0.5)] * 2, abs=1e-8)
        assert z == pytest.approx([np.sqrt(2.0), -1.0, -1.0], abs=1e-8)
    assert not interior.optimum(*disc(), 1e-10, 3)[2]


@pytest.mark.parametrize("growth", [0.0, 0.05])
@pytest.mark.parametrize("contacts", [0, 3, 5])
@pytest.mark.parametrize("seed", range(6))
def test_interior_points_agree_with_clarabel(seed: int, contacts: int, growth: float) -> None:
    problem = random_placement(seed, rows=30, contacts=contacts, growth=growth, spare=seed % 3 if contacts else 0)
    program = problem.program()
    mine = ConeSolver().by_interior_points(program)
    assert abs(mine.value - ClarabelSolver().solve(program).value) < 1e-8 * program.size.objective
    assert checked(program, ConeSolver()).value == mine.value
    assert abs(mine.gap) < 1e-8 * program.size.objective
    assert mine.worst_row > -1e-9


def test_equal_bounds_hold_a_variable() -> None:
    # x + y on x² + y² ≤ 1 with x held at 3/5, or by an equality besides: 7/5.
    norm = Norm(np.eye(2), np.zeros(2))
    program = ConeProgram.of(
        [1.0, 1.0], G=[[0.0, 0.0]], h=[1.0], W=[[1.0]], norms=(norm,), lower=[0.6, -9], upper=[0.6, 9]
    )
    assert ConeSolver().by_interior_points(program).x == pytest.approx([0.6, 0.8], abs=1e-8)
    twice = replace(program, A=np.array([[2.0, 0.0]]), b=np.array([1.2]))
    assert ConeSolver().by_interior_points(twice).value == pytest.approx(1.4, abs=1e-8)
    for off in (1.3, 1.2 + 1e-6):
        with pytest.raises(InfeasibleError):
            ConeSolver().solve(replace(twice, b=np.array([off])))


@pytest.mark.parametrize("gap", [1e-6, 1e-2, 1.0])
def test_contradictions_raise_with_clarabels_shortfall(gap: float) -> None:
    unit = 1e-4
    program = ConeProgram.of(
        [0.0, unit], G=[[1.0, 0.0], [-1.0, 0.0]], h=[-gap * unit, 0.0], upper=[1.0, 1.0], units=[unit, 1.0]
    )
    with pytest.raises(InfeasibleError) as expected:
        ClarabelSolver().solve(program)
    with pytest.raises(InfeasibleError) as caught:
        ConeSolver().solve(program)
    assert caught.value.shortfall == expected.value.shortfall
    with pytest.raises(SolverError):
        ConeSolver().by_interior_points(program)


def test_an_unbounded_program_is_refused() -> None:
    for program in (ConeProgram.of([1.0], G=[[1.0]], h=[0.0]), ConeProgram.of([1.0])):
        with pytest.raises(SolverError, match="add bounds"):
            ConeSolver().solve(program)


@pytest.mark.parametrize("fault", ["unfinished", "another point", "other multipliers"])
def test_clarabel_takes_over_where_interior_points_fail(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program = random_placement(3, growth=0.02).program()
    true = interior.optimum

    def faulty(*arguments: object) -> tuple[Array, Array, bool]:
        v, z, done = true(*arguments)
        return (
            v + 0.1 * (fault == "another point"),
            z * (1.1 if fault == "other multipliers" else 1.0),
            (done and fault != "unfinished"),
        )

    monkeypatch.setattr(cone_solver, "optimum", faulty)
    with pytest.raises(SolverError):
        ConeSolver().by_interior_points(program)
    assert np.array_equal(ConeSolver().solve(program).x, ClarabelSolver().solve(program).x)


def test_the_same_program_has_the_same_bits_after_others_and_in_threads() -> None:
    programs = [random_placement(seed, rows=20, contacts=2, growth=0.02).program() for seed in range(12)]
    first = [ConeSolver().solve(program).x for program in programs]
    with ThreadPoolExecutor(2) as pool:
        again = list(pool.map(lambda program: ConeSolver().solve(program).x, programs[::-1]))[::-1]
    assert all(np.array_equal(one, other) for one, other in zip(first, again, strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_placements_are_solved_as_with_clarabel(seed: int) -> None:
    problem = random_placement(seed, rows=14, contacts=2, growth=0.02)
    one, other = max_min_clearance(problem, ConeSolver()), max_min_clearance(problem)
    assert one.value == pytest.approx(other.value, abs=1e-12)
    assert certify(problem.program(), one.x, one.duals).value == one.value
    assert lexicographic(problem, ConeSolver()).value == pytest.approx(other.value, abs=1e-10)
