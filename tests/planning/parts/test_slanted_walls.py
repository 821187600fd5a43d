"""Slanted walls: what contacts on two of them say, to the planner and to the check, and how deep a mouth is."""

import math
from itertools import permutations, product

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.contact_implications import aligned, facts
from fmopt.contact.primitive import Kind, PrimitiveContact, near_contacts
from fmopt.planning.search.entry_room import funnel
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem, load
from fmopt.verify.arithmetic.exact import inner, outer, unit_of
from fmopt.verify.arithmetic.rational import ONE, Matrix, Vector
from fmopt.verify.parts.incidence import Turn, crossing
from tests import ROOT
from tests.shared.parts.families import pair, write_toml

HEXAGON = 103  # a seed that draws a tapered hexagon
EXACT = ((13, -4, 5), (-7, 3, 11), (2, 9, -6))


@pytest.fixture(scope="module")
def tapered(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    return load(write_toml(pair("tapered", HEXAGON), tmp_path_factory.mktemp("tapered")))


@pytest.fixture(scope="module")
def cornered(tapered: Problem) -> tuple[Assembly, list[int], list[PrimitiveContact]]:
    """The part upright and 5 mm deep in a corner between two walls: the walls, and the contacts there."""
    assembly = Assembly(tapered.moving, tapered.fixed)
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    slanted = [n for n, face in enumerate(fixed.faces) if 1e-3 < face.normal[2] < 0.5]
    one = slanted[0]
    beside = [n for n in slanted if 0.4 < fixed.faces[n].normal @ fixed.faces[one].normal < 0.6]
    walls = [one, beside[0]]
    rows, gaps = [], []
    for n in walls:
        wall = fixed.faces[n]
        own = next(f for f in body.faces if np.allclose(f.normal, -wall.normal, atol=1e-9))
        rows.append(wall.normal)
        gaps.append(wall.offset + own.offset)
    at = np.linalg.solve(np.array([*rows, [0.0, 0.0, 1.0]]), np.array([*gaps, -5e-3]))
    return assembly, walls, list(near_contacts(body, fixed, Pose(at, np.eye(3)), 1e-9, 1e-3))


def crossings(near: list[PrimitiveContact], assembly: Assembly, wall: int) -> list[PrimitiveContact]:
    """Edges that run down a wall, across its rim in the mouth."""
    fixed, body = assembly.fixed.polyhedron, assembly.moving.polyhedron
    level = np.abs(fixed.vertices[:, 2]) < 1e-9
    rims = [n for n, edge in enumerate(fixed.edges) if wall in edge.faces and level[list(edge.vertices)].all()]
    found = [c for c in near if c.kind is Kind.EDGE_EDGE and c.fixed_feature in rims]
    return [c for c in found if abs(np.diff(body.vertices[list(c.moving), 2])[0]) > 1e-3]


def corner_of(near: list[PrimitiveContact], wall: int, edge: PrimitiveContact) -> PrimitiveContact:
    """The end of an edge that is on a wall."""
    tips = [c for c in near if c.kind is Kind.VERTEX_FACE and c.fixed_feature == wall]
    return next(c for c in tips if c.moving[0] in edge.moving)


def test_two_edges_in_and_across_a_wall_are_flush(cornered: tuple[Assembly, list[int], list[PrimitiveContact]]) -> None:
    """The second edge touches anywhere on its length: that is enough, as all of it is on one side of the first."""
    assembly, walls, near = cornered
    for wall in walls:
        plane = assembly.fixed.polyhedron.faces[wall]
        one, other = crossings(near, assembly, wall)[:2]
        hinged = corner_of(near, wall, one), one
        assert facts(assembly, hinged).on(plane.normal, plane.offset).flush == ()
        known = facts(assembly, (*hinged, other)).on(plane.normal, plane.offset)
        assert len(known.flush) == 1
        np.testing.assert_allclose(known.flush[0][0], -plane.normal, atol=1e-12)
        assert len(known.points) == 4


def test_a_face_flush_with_one_wall_and_an_edge_in_the_next_fix_the_rotation(
    cornered: tuple[Assembly, list[int], list[PrimitiveContact]],
) -> None:
    assembly, (wall, beside), near = cornered
    one, other = crossings(near, assembly, wall)[:2]
    line = next(c for c in crossings(near, assembly, beside) if set(c.moving).isdisjoint({*one.moving, *other.moving}))
    held = corner_of(near, wall, one), one, other, corner_of(near, beside, line), line
    known, plane = facts(assembly, held), assembly.fixed.polyhedron.faces[beside]
    np.testing.assert_allclose(aligned(known.turns, np.array([0.2, 0.3, 0.7])), [0.2, 0.3, 0.7], atol=1e-12)
    assert len(known.on(plane.normal, plane.offset).points) == 4


def seats() -> list[tuple[tuple[int, ...], ...]]:
    """The rotations that turn axes onto axes."""
    found = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        R = np.zeros((3, 3))
        R[range(3), order] = signs
        if np.linalg.det(R) > 0.0:
            found.append(tuple(tuple(int(x) for x in row) for row in R))
    return found


def turned(R: tuple[tuple[int, ...], ...], v: tuple[int, ...]) -> tuple[int, int, int]:
    x, y, z = (inner(row, v) for row in R)
    return (x, y, z)


@pytest.mark.parametrize("R", seats())
def test_the_check_knows_a_slanted_edge_where_both_parts_have_the_same_angles(R: tuple[tuple[int, ...], ...]) -> None:
    """An edge of a face in the second wall, at an odd angle to the flush one: known exactly if angles agree exactly."""
    flush, second, across = EXACT
    edge = outer(second, across)
    assert np.dot(edge, flush) != 0
    onto, wall, there = turned(R, flush), turned(R, second), turned(R, edge)
    turn = Turn(unit_of(flush), unit_of(onto), flush, onto, None)
    nominal = tuple(tuple(x * ONE + 3 for x in row) for row in R)
    rows: Matrix = (vector3(nominal[0]), vector3(nominal[1]), vector3(nominal[2]))
    assert crossing(wall, turn, edge, unit_of(there), rows) == there
    # As far as they go along the normals does not count; a wall that is askew by next to nothing does.
    longer = Turn(turn.body, turn.world, vector3([3 * x for x in flush]), vector3([7 * x for x in onto]), None)
    assert crossing(vector3([5 * x for x in wall]), longer, edge, unit_of(there), rows) == there
    for k in range(3):
        askew = [10**12 * x + (i == k) for i, x in enumerate(wall)]
        assert (crossing(vector3(askew), turn, edge, unit_of(there), rows) is None) == (there[k] != 0)
        other = Turn(turn.body, turn.world, flush, vector3([10**12 * x + (i == k) for i, x in enumerate(onto)]), None)
        assert crossing(wall, other, edge, unit_of(there), rows) is None
    mirrored = unit_of([-x for x in there])
    assert crossing(wall, turn, edge, mirrored, rows) is None
    tilted = (rows[0], rows[1], vector3([x + (ONE >> 20) for x in rows[2]]))
    assert crossing(wall, turn, edge, unit_of(there), tilted) is None


def vector3(numbers: list[int] | tuple[int, ...]) -> Vector:
    x, y, z = numbers
    return (x, y, z)


def test_slopes_that_lead_to_walls_are_a_mouth_those_of_a_tapered_hole_are_none(tapered: Problem) -> None:
    funnelled, plain = (load(ROOT / "problems" / f"{name}.toml").fixed for name in ("bilba_chamfered_60", "square_peg"))
    depth, width = funnel(funnelled)
    assert depth == pytest.approx(14e-3, abs=1e-12)
    assert 1e-3 < width < math.inf
    for part in (plain, tapered.fixed):
        assert funnel(part) == (0.0, 0.0)
