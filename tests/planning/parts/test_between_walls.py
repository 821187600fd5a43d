"""Ways to begin between two walls that stand at an angle, whether or not they meet in a corner."""

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.contact.primitive import Kind, near_contacts
from fmopt.geometry.section import walls_around
from fmopt.planning import motion
from fmopt.planning.moves.moves import Reached
from fmopt.planning.posed import Posed
from fmopt.planning.search.entry import Approach, Entry
from fmopt.planning.search.guarded_move import ContactPose, lasts
from fmopt.planning.search.successors import Node, _freedoms
from fmopt.planning.search.symmetry import images
from fmopt.spatial.values import Array
from tests.shared.parts.families import Pair, write_toml
from tests.shared.parts.families import pair as family_pair

NAMES = ("triangle", "8-gon", "12-gon", "rectangle", "L", "T", "chamfered")
SHAPES, ALONG = 30, np.linspace(0.0, 1.0, 400)


@pytest.fixture(scope="module", params=NAMES)
def given(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Pair, motion._Stood]:
    pair = family_pair(request.param, 102)
    return pair, stood(fmopt.load(write_toml(pair, tmp_path_factory.mktemp("walls"), (0.2, 0.5))))


def stood(problem: fmopt.Problem) -> motion._Stood:
    posed = Posed.of(problem)
    return motion._Stood.of(posed, next(iter(images(posed.assembly, problem.start_box))))


def drawn(stand: motion._Stood) -> list[tuple[Approach, Entry]]:
    between = (shape for shape in motion.drawing(stand.posed).shapes(0) if shape.between is not None)
    return [(shape, stand.entry_of(shape)) for shape in islice(between, SHAPES)]


def gaps(stand: motion._Stood, points: Array) -> Array:
    """How far points (n, 3) are inside the sides (m) of the moving part, were it seated: (n, m), m."""
    around = walls_around(stand.posed.problem.moving)
    return points[:, :2] @ around.inward.T - around.offsets


def test_walls_are_those_that_the_part_has(given: tuple[Pair, motion._Stood]) -> None:
    pair, stand = given
    body, around = stand.posed.problem.moving.polyhedron, walls_around(stand.posed.problem.moving)
    upright = [face for face in body.faces if abs(face.normal[2]) < 1e-9]
    for inward, offset in zip(around.inward, around.offsets, strict=True):
        assert any(np.abs(f.normal[:2] + inward).max() < 1e-9 and abs(f.offset + offset) < 1e-12 for f in upright)
    assert gaps(stand, body.vertices).min() >= -1e-12
    sides = {"triangle": 3, "8-gon": 8, "12-gon": 12, "rectangle": 4, "L": 4, "T": 4}  # none over the notches
    assert len(around.offsets) == sides.get(pair.family, len(around.offsets))


def test_two_walls_stand_at_an_angle(given: tuple[Pair, motion._Stood]) -> None:
    _, stand = given
    around = walls_around(stand.posed.problem.moving)
    assert around.pairs
    for one, two in around.pairs:
        (x, y), (u, v) = around.inward[[one, two]]
        assert x * v - y * u >= 0.7


def test_what_is_below_the_mouth_has_the_room_that_its_shape_says(given: tuple[Pair, motion._Stood]) -> None:
    pair, stand = given
    body = stand.posed.problem.moving.polyhedron
    ends = np.array([edge.vertices for edge in body.edges])
    for shape, entry in drawn(stand):
        assert shape.between is not None
        points = entry.inside.apply(body.vertices)
        assert points[:, 2].min() == pytest.approx(-shape.depth, abs=1e-4 * pair.size)  # but for a chamfered tip
        a, b = points[ends[:, 0], None], points[ends[:, 1], None]
        low = (a + ALONG[None, :, None] * (b - a)).reshape(-1, 3)
        low = low[low[:, 2] <= 0.0]
        room = gaps(stand, low)[:, list(shape.between)].min(axis=0)
        assert room == pytest.approx(shape.room, abs=2e-3 * pair.clearance + 0.01 * 1e-3 * pair.size)


def test_what_touches_the_top_first_is_outside_the_mouth_there(given: tuple[Pair, motion._Stood]) -> None:
    pair, stand = given
    for shape, entry in drawn(stand):
        if shape.touch is not None:
            inside = gaps(stand, entry.start.apply(entry.corner)[None]).min()
            assert inside <= -shape.touch[0] + 2e-3 * pair.clearance


def test_moves_go_along_and_about_the_axes_of_both_walls(given: tuple[Pair, motion._Stood]) -> None:
    _, stand = given
    around = walls_around(stand.posed.problem.moving)
    shape, entry = drawn(stand)[0]
    assert shape.between is not None
    place = ContactPose(entry.inside, (), (), entry.corner)
    node = Node(entry, place, Reached(stand.task.start, (), ()), (), (), 0.0, 0)
    for inward in around.inward[list(shape.between)]:
        slides = [f.twist[:2] for f in _freedoms(replace(stand.task, askew=True), node) if not f.twist[3:].any()]
        assert min(float(np.abs(slide + inward).max()) for slide in slides) < 1e-9


def test_a_part_of_many_sides_begins_between_walls_as_well(tmp_path: Path) -> None:
    pair = family_pair("10-gon", 102)
    assert stood(fmopt.load(write_toml(pair, tmp_path, (0.5, 0.5))))._beginnings(1.0, 0)


def test_a_star_begins_with_its_corners(tmp_path: Path) -> None:
    stand = stood(fmopt.load(write_toml(family_pair("star", 102), tmp_path, (0.2, 0.5))))
    assert walls_around(stand.posed.problem.moving).pairs == ()
    assert all(shape.between is None for shape in islice(motion.drawing(stand.posed).shapes(0), SHAPES))


def test_contacts_last_where_faces_meet_that_mate_in_the_seat(tmp_path: Path) -> None:
    stand = stood(fmopt.load(write_toml(family_pair("8-gon", 102), tmp_path, (0.2, 0.5))))
    assembly, goal = stand.task.assembly, stand.task.goal
    body, hole = assembly.moving.polyhedron, assembly.fixed.polyhedron
    assert len(stand.task.mates) == 8 + 1  # the walls, and the tip on the floor
    seen = set[bool]()
    for one in near_contacts(body, hole, goal, 0.02, 3.0):
        if one.kind is not Kind.VERTEX_FACE:
            continue
        normal = hole.faces[one.fixed_feature].normal
        own = [goal.R @ body.faces[k].normal for k in body.vertex_faces[one.moving_feature]]
        depth = float(normal @ goal.apply(body.vertices[one.moving_feature])) - hole.faces[one.fixed_feature].offset
        beside = min(float(np.abs(n + normal).max()) for n in own) < 1e-9 and abs(depth) < 1e-3
        assert lasts(assembly, one, stand.task.mates) == beside
        seen.add(beside)
    assert seen == {True, False}
