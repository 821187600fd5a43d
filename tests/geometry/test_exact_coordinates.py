"""Exact coordinates of parts: every face plane without rounding, next to the floats; walls as what lies flat there."""

from fractions import Fraction
from math import lcm

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box, Difference, Hull, Moved, Solid
from fmopt.geometry.exact_coordinates import MOST, Exact, direction, exact_vertices, facing_directions
from fmopt.geometry.polyhedron import Polyhedron, convex_hull_polyhedron, placed, rounded
from fmopt.planning.plan_record import part_record
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import load
from fmopt.verify.arithmetic.exact import parallel
from fmopt.verify.parts.solids import Shape
from fmopt.verify.reading.document import Body
from tests import PROBLEMS

ASKEW = ("lee_huang_figure1",)  # problems with a part whose faces are not plane in floats


def seen(body: Polyhedron, exact: dict[int, Exact]) -> Shape:
    """A part as the check has it."""
    points = {}
    for n, at in exact.items():
        w = lcm(*(x.denominator for x in at))
        x, y, z = (int(value * w) for value in at)
        points[n] = (x, y, z, w)
    faces = tuple(face.loops for face in body.faces)
    return Shape(Body(tuple(map(tuple, body.vertices.tolist())), faces, points))


def deviation(body: Polyhedron, exact: dict[int, Exact]) -> float:
    offs = [abs(float(x - Fraction(y))) for n, at in exact.items() for x, y in zip(at, body.vertices[n], strict=True)]
    return max(offs, default=0.0)


def turned(solid: Solid, seed: int) -> Polyhedron:
    """A solid turned and shifted anyhow, its coordinates rounded as those of parts are."""
    rng = np.random.default_rng(seed)
    pose = Pose(rng.uniform(-0.05, 0.05, 3), exp(rng.uniform(-1.5, 1.5, 3)))
    return rounded(placed(polyhedron(solid), pose))


def chamfered(size: float, cut: float) -> Solid:
    """A cube with all twelve edges chamfered: corners where three slopes and three chamfers meet in pairs."""
    a, b = 0.5 * size, 0.5 * size - cut
    signs = (2.0 * np.array(s) - 1.0 for s in np.ndindex(2, 2, 2))
    corners = [sign * np.where(np.arange(3) == k, a, b) for sign in signs for k in range(3)]
    return Hull(tuple(map(tuple, corners)))


def frustum(sides: int, below: float, above: float, height: float) -> Solid:
    angles = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(sides)])
    return Hull(tuple(map(tuple, [*(below * ring), *(above * ring + [0.0, 0.0, height])])))


SOLIDS = {
    "prism": frustum(7, 0.01, 0.01, 0.03),
    "tapered frustum": frustum(5, 0.012, 0.007, 0.02),
    "cone of 18 sides": frustum(18, 0.01, 0.008, 0.004),
    "cone of 64 sides": frustum(64, 0.02, 0.015, 0.01),
    "chamfered block": chamfered(0.02, 0.001),
    "block with a hole": Difference(Box((0.04, 0.04, 0.02)), (Box((0.01, 0.012, 0.05)),)),
}
"""Solids of each kind that reading a part may leave askew."""


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_solid_that_is_turned_anyhow_has_exact_coordinates_next_to_its_floats(name: str, seed: int) -> None:
    body = turned(SOLIDS[name], seed)
    assert list(seen(body, {}).flaws()) != []
    exact = exact_vertices(body)
    assert list(seen(body, exact).flaws()) == []
    assert 0.0 < deviation(body, exact) < 2e-13 <= MOST
    assert max(len(str(x)) for at in exact.values() for x in at) < 800


@settings(deadline=None, max_examples=25)
@given(st.integers(4, 12), st.floats(0.002, 0.02), st.floats(0.4, 1.6), st.integers(0, 10**6))
def test_frusta_of_any_taper_have_exact_coordinates(sides: int, size: float, taper: float, seed: int) -> None:
    body = turned(frustum(sides, size, taper * size, 0.01), seed)
    exact = exact_vertices(body)
    assert list(seen(body, exact).flaws()) == []
    assert deviation(body, exact) < MOST


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6))
def test_hulls_of_points_need_none(seed: int) -> None:
    """Faces of three corners are plane wherever their corners are."""
    body = convex_hull_polyhedron(np.random.default_rng(seed).uniform(-0.01, 0.01, (12, 3)))
    assert all(len(face.vertices) == 3 for face in body.faces)
    assert exact_vertices(body) == {}


def moved(solid: Solid, x: float, y: float, z: float) -> Polyhedron:
    """A solid shifted, its coordinates rounded as those of parts are."""
    return rounded(placed(polyhedron(solid), Pose(np.array([x, y, z]), np.eye(3))))


def test_what_is_plane_in_floats_stays_as_it_is() -> None:
    assert exact_vertices(moved(Box((0.01, 0.02, 0.03)), 1.0 / 3.0, 0.1, 0.7)) == {}
    body = moved(SOLIDS["cone of 18 sides"], 0.01, -0.02, 0.005)
    exact = exact_vertices(body)
    levels = {2: {0.005, 0.009}}
    assert exact
    assert all(float(at[2]) in levels[2] for at in exact.values())


def test_walls_are_made_parallel_to_what_lies_flat_in_them() -> None:
    peg = polyhedron(frustum(6, 0.01, 0.01, 0.03))
    hole = moved(Difference(Box((0.06, 0.06, 0.06)), (frustum(6, 0.0101, 0.0101, 0.06),)), 0.0, 0.0, 0.0)
    walls = range(len(hole.faces))
    asked = facing_directions(peg, exact_vertices(peg), hole, walls)
    assert len(asked) >= 6
    exact = exact_vertices(hole, asked)
    shape = seen(hole, exact)
    assert list(shape.flaws()) == []
    assert deviation(hole, exact) < MOST
    normals = [face.exact for face in seen(peg, exact_vertices(peg)).faces]
    for n in asked:
        plane = shape.faces[n].exact
        assert plane is not None
        assert any(normal is not None and parallel(normal, plane) for normal in normals)
    askew = turned(frustum(6, 0.01, 0.01, 0.03), 5)
    assert facing_directions(askew, exact_vertices(askew), hole, walls) == {}


def test_faces_in_one_plane_stay_in_one() -> None:
    """The two halves of a top that a slot parts."""
    slot = Moved(Box((0.01, 0.1, 0.02)), Pose(np.array([0.0, 0.0, 0.01]), np.eye(3)))
    body = turned(Difference(Box((0.04, 0.04, 0.02)), (slot,)), 3)
    planes = [face.exact for face in seen(body, exact_vertices(body)).faces]
    assert sorted(planes.count(plane) for plane in set(planes)) == [1] * 8 + [2]


@pytest.mark.wide
def test_all_shipped_parts_are_plane_in_floats_but_cones() -> None:
    for path in sorted(PROBLEMS.glob("*.toml")):
        problem = load(path)
        for part in (problem.moving, problem.fixed):
            exact = exact_vertices(part.polyhedron)
            assert bool(exact) == (path.stem in ASKEW and part is problem.fixed)
            assert list(seen(part.polyhedron, exact).flaws()) == []
            assert deviation(part.polyhedron, exact) < 1e-14
            assert ("exact" in part_record(part, (0.0, 0.0), 0.0, exact)) == bool(exact)


def test_directions_have_the_least_integers() -> None:
    assert direction((Fraction(1, 2), Fraction(-1, 3), Fraction(0))) == (3, -2, 0)
