"""The compiled searches against the formulas: surfaces, shortages with their gradients, steps and projections."""

import numpy as np
import pytest

from fmopt.contact import descent
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.facet_bounds import cell
from fmopt.contact.primitive import PrimitiveContact, face_vertex, near_contacts
from fmopt.contact.realisation import Neighbourhood, Poses, meet, project
from fmopt.contact.state_graph import ContactCell, Scale, local_space
from fmopt.geometry.polyhedron import Polyhedron, from_faces
from fmopt.spatial.se3 import Pose, turns
from fmopt.spatial.values import Array, Bits
from tests.shared.parts.square import MID_DEPTH, block, peg, spike
from tests.shared.parts.square_poses import POSES

CLEARANCE, RHO = 1e-4, 0.5 * float(np.hypot(0.02, 0.02))
SPIKE = from_faces(*spike())


def neighbourhood(contacts: tuple[PrimitiveContact, ...], fixed: Polyhedron, pose: Pose) -> Neighbourhood:
    """The contacts that count at a pose, 3 mm and 0.03 rad around it."""
    kept, limits = cell(contacts, peg(), fixed, pose, 1e-3)
    space = local_space(kept, peg(), fixed, pose, Scale(CLEARANCE, RHO), ContactCell(limits, 3e-3, 0.03))
    return Neighbourhood.of(space, peg(), fixed)


def cases() -> dict[str, Neighbourhood]:
    pose, reach, angle, _ = POSES["corner in the mouth"]
    above = Pose.from_vector((0.001, -0.002, 0.0003, 0.1, 0.2, -0.3))
    return {
        "mid-depth": neighbourhood(near_contacts(peg(), block(), MID_DEPTH, 1e-3, 0.02), block(), MID_DEPTH),
        "mouth": neighbourhood(near_contacts(peg(), block(), pose, reach, angle), block(), pose),
        "spike": neighbourhood(tuple(face_vertex(peg(), face, 4) for face in (0, 2, 3)), SPIKE, above),
    }


CASES = cases()


@pytest.fixture(params=CASES)
def near(request: pytest.FixtureRequest) -> Neighbourhood:
    return CASES[request.param]


def scattered(near: Neighbourhood, count: int) -> Poses:
    """Poses around that of a space, most of them within its limits."""
    rng = np.random.default_rng(7)
    return Poses.around(near.space.pose, rng.normal(size=(count, 6)) * np.repeat([5e-4, 0.01], 3))


def some(near: Neighbourhood, count: int) -> Bits:
    return np.random.default_rng(8).random((count, len(near.space.contacts))) < 0.3


def every_surface(near: Neighbourhood) -> tuple[PrimitiveContact, ...]:
    """The contacts of a space and of its bounds, each once."""
    return tuple(dict.fromkeys((*near.space.contacts, *(bound.contact for bound in near.table.listed))))


def plain(near: Neighbourhood, on: Bits, pose: Pose, room: float) -> tuple[float, Array, Array]:
    """|r|, Jᵀr and JᵀJ of what one state is short of at a pose."""
    contacts, unit, scale = near.space.contacts, near.space.scale[0], near.space.scale
    every = every_surface(near)
    value, gradient = Surfaces.of(every, *near.parts).values_and_rows(pose)
    f, N = dict(zip(every, value, strict=True)), dict(zip(every, gradient, strict=True))
    demands: list[tuple[float, Array]] = []
    touching = {contact.id for contact, bit in zip(contacts, on, strict=True) if bit}
    for contact, bit, clauses in zip(contacts, on, near.table.clauses, strict=True):
        depths = []
        for clause in clauses:
            groups = [min(((-b.sign * f[b.contact], b) for b in group), key=lambda d: d[0]) for group in clause]
            depths.append(max(groups, key=lambda d: d[0]))
        ended = any(bound.sign > 0 and bound.contact.id in touching for _, bound in depths)
        inside, bound = min(depths, key=lambda d: d[0]) if depths else (np.inf, None)
        if bit:
            demands.append((f[contact] / unit, N[contact]))
            if bound is not None and inside / unit < room:
                demands.append((inside / unit - room, -bound.sign * N[bound.contact]))
        elif bound is not None and -inside > f[contact]:
            if not ended and -inside / unit < room:
                demands.append((-inside / unit - room, bound.sign * N[bound.contact]))
        elif not ended and f[contact] / unit < room:
            demands.append((f[contact] / unit - room, N[contact]))
    demands = [(r, row * scale / unit) for r, row in demands]
    x = Poses(pose.p[None], pose.R[None]).local(near.space.pose)[0] / scale
    demands += [(wall[:6] @ x - wall[6], wall[:6]) for wall in near.space.limits if wall[:6] @ x < wall[6]]
    r, J = np.array([r for r, _ in demands]), np.reshape([row for _, row in demands], (-1, 6))
    return float(np.linalg.norm(r)), r @ J, J.T @ J


def work(near: Neighbourhood) -> descent._Shortfall:
    k, surfaces, limits = len(near.space.contacts), len(every_surface(near)), len(near.space.limits)
    return descent._Shortfall(np.zeros(surfaces), np.zeros((2 * k, 3)), np.zeros(6), np.zeros(limits))


def test_surfaces_are_those_of_the_table(near: Neighbourhood) -> None:
    surfaces, tables = Surfaces.of(every_surface(near), *near.parts), near.functions.tables
    found, row = np.zeros(len(surfaces.order)), np.zeros(6)
    for T in scattered(near, 20).matrices:
        f, N = surfaces.over(T[:, 3], T[:, :3])
        descent._heights(tables, T, found)
        np.testing.assert_allclose(found[surfaces.order], f, rtol=0.0, atol=1e-16)
        for i, number in enumerate(surfaces.order):
            assert descent._surface(tables, number, T, row) == pytest.approx(f[i], abs=1e-16)
            np.testing.assert_allclose(row, N[i], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("room", [0.0, 0.1])
def test_shortages_are_what_the_formula_says(near: Neighbourhood, room: float) -> None:
    at, slope, square, held = near.functions, np.zeros(6), np.zeros((6, 6)), work(near)
    for on, T in zip(some(near, 60), scattered(near, 60).matrices, strict=True):
        size, count = descent._short(at, on, T, room, held)
        descent._pull(at, T, count, held, slope, square)
        expected, pull, product = plain(near, on, Pose(T[:, 3], T[:, :3]), room)
        assert size == pytest.approx(expected, rel=1e-11, abs=1e-12)
        np.testing.assert_allclose(slope, pull, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(square, np.tril(product), rtol=1e-10, atol=1e-10)


def plain_descent(near: Neighbourhood, on: Bits, pose: Pose, room: float) -> tuple[float, bool]:
    """How much is short where Levenberg–Marquardt ends, and whether that is final."""
    damping, then, scale = 1e-3, np.inf, near.space.scale
    now, slope, square = plain(near, on, pose, room)
    for tried in range(90):
        final = bool(now <= 1e-11 or np.linalg.norm(slope) <= 1e-7 * now)
        if tried % 10 == 9:
            final = final or (np.isfinite(then) and now * (now / then) ** ((90 - tried) / 10) > 1e-11)
            then = now
        if final:
            break
        step = -np.linalg.solve(square + damping * np.eye(6), slope)
        trial = pose.moved(scale * step * min(1.0, 8.0 / float(np.linalg.norm(step))))
        new, pull, product = plain(near, on, trial, room)
        damping = min(max((0.1 if new < now else 10.0) * damping, 1e-14), 1e8)
        if new < now:
            now, slope, square, pose = new, pull, product, trial
    return now, final


def test_searches_end_where_plain_ones_do(near: Neighbourhood) -> None:
    on, start = some(near, 20), scattered(near, 20)
    found, size, final = descent.descended(near.functions, on, start.matrices, 0.1)
    for i, held in enumerate(on):
        short, settled = plain_descent(near, held, start.pose(i), 0.1)
        assert final[i] == settled
        # Where demands take turns to the end, rounding decides how far down they go.
        assert size[i] == pytest.approx(short, rel=1e-2, abs=1e-11)
        there, _, _ = plain(near, held, Poses.of(found).pose(i), 0.1)
        assert size[i] == pytest.approx(there, rel=1e-9, abs=1e-11)


def test_damped_steps_solve_the_normal_equations() -> None:
    rng = np.random.default_rng(1)
    step, L = np.zeros(6), np.zeros((6, 6))
    for rows in (3, 6, 9):
        J, r = rng.normal(size=(rows, 6)), rng.normal(size=rows)
        square = J.T @ J
        descent._solve(np.tril(square), 0.1, J.T @ r, L, step)
        np.testing.assert_allclose(step, -np.linalg.solve(square + 0.1 * np.eye(6), J.T @ r), rtol=1e-10)
    descent._solve(np.tril(square), 0.1, 1e6 * (J.T @ r), L, step)
    assert np.linalg.norm(step) == pytest.approx(descent._FARTHEST)


@pytest.mark.parametrize("sizes", [(4, 4, 6), (4, 2, 6), (9, 6, 6), (9, 4, 6), (9, 6, 3), (3, 2, 1)])
def test_shortest_steps_are_those_of_the_singular_values(sizes: tuple[int, int, int]) -> None:
    rows, true, allowed = sizes
    rng = np.random.default_rng(2)
    triangle, step = np.zeros((6, 7)), np.zeros(6)
    for _ in range(20):
        A, f = rng.normal(size=(rows, true)) @ rng.normal(size=(true, 6)), rng.normal(size=rows)
        triangle[:] = 0.0
        for row in np.column_stack([A, f]):
            descent._rotate_in(triangle, row)
        np.testing.assert_allclose(np.tril(triangle[:, :6], -1), 0.0, atol=1e-12)
        descent._shortest(triangle, allowed, step)
        U, s, Vt = np.linalg.svd(A)
        kept = slice(min(true, allowed))
        np.testing.assert_allclose(step, -Vt[kept].T @ ((U.T @ f)[kept] / s[kept]), rtol=1e-8, atol=1e-9)


def test_moves_are_local_coordinates() -> None:
    rng, moved = np.random.default_rng(3), np.zeros((3, 4))
    scale = np.repeat([1e-4, 1e-2], 3)
    for size in (0.0, 1e-3, 1.0, 100.0):
        T = np.column_stack([turns(rng.normal(size=(1, 3)))[0], rng.normal(size=3)])
        step = size * rng.normal(size=6)
        descent._move(scale, step, T, moved)
        expected = Poses.around(Pose(T[:, 3], T[:, :3]), (scale * step)[None]).matrices[0]
        np.testing.assert_allclose(moved, expected, rtol=0.0, atol=1e-15)


def test_projections_touch_and_go_no_farther_than_they_must(near: Neighbourhood) -> None:
    start = scattered(near, 40)
    on = np.zeros((40, len(near.space.contacts)), dtype=np.bool_)
    on[np.arange(40), np.arange(40) % on.shape[1]] = True
    found = project(near, on, start, 6)
    assert (near.measured(on, found).residual <= 1e-11).all()
    f, N = Surfaces.of(near.space.contacts, *near.parts).over(start.p, start.R)
    first = np.abs(f[on]) / np.linalg.norm(N[on] * near.space.scale, axis=1)
    went = [np.linalg.norm(start.pose(i).local(found.pose(i)) / near.space.scale) for i in range(40)]
    np.testing.assert_allclose(went, first, rtol=0.2, atol=1e-6)


def test_edges_that_are_level_count_as_far_and_pull_nowhere() -> None:
    near = CASES["mouth"]
    level = Poses(near.space.pose.p[None], np.eye(3)[None])
    on = np.zeros((1, len(near.space.contacts)), dtype=np.bool_)
    surfaces = Surfaces.of(every_surface(near), *near.parts)
    nowhere = np.isnan(surfaces.heights(level.p, level.R)[0])
    assert nowhere.any()
    found, row = np.zeros(len(surfaces.order)), np.zeros(6)
    descent._heights(near.functions.tables, level.matrices[0], found)
    assert (found[surfaces.order[nowhere]] == 1.0).all()
    for number in surfaces.order[nowhere]:
        assert descent._surface(near.functions.tables, number, level.matrices[0], row) == 1.0
        assert not row.any()
    with np.errstate(all="raise"):
        measures, met, polished = near.measured(on, level), meet(near, on, level, 0.01), project(near, ~on, level, 6)
    for values in (measures.others, met.poses.p, met.poses.R, met.short, polished.p, polished.R):
        assert not np.isnan(values).any()
