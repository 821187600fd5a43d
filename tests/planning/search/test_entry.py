"""Ways to begin: one corner goes in below the funnel, away from the walls next to it, whatever the outline is."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.clearance import checked_clearance
from fmopt.geometry.section import corner_walls, leading_corners
from fmopt.planning.search.entry import Entry, Shape, straight_entry, tilted_entry
from fmopt.planning.search.entry_candidates import funnel_depth, tilted_shapes
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem, load
from tests import PROBLEMS
from tests.shared.parts.families import pair as family_pair
from tests.shared.parts.families import write_toml
from tests.shared.parts.outlines import prism

SQUARE, CHAMFERED = "square_peg_100um", "factory_rect_8mm_tight"
HEXAGON, TWO, FUNNEL, SMALL = "hexagon_prism", "two_pegs", "bilba_chamfered_60", "factory_rect_4mm_tight"
KEYED, LEGS = "keyed_shaft", "bilba_puzzle"


def entries(name: str, count: int = 12) -> tuple[Problem, list[tuple[Shape, Entry]]]:
    problem = load(PROBLEMS / f"{name}.toml")
    goal = Pose.from_vector(problem.goal)
    clearance = checked_clearance(problem.moving, problem.fixed, goal, -float(problem.goal[2]))
    tilt, funnel = problem.settings.max_tilt, funnel_depth(problem.fixed)
    shapes = islice(tilted_shapes(problem.moving, clearance.play, problem.start_box, tilt, funnel), count)
    return problem, [(s, tilted_entry(problem.moving, clearance.play, problem.approach, s)) for s in shapes]


@pytest.mark.parametrize("name", [SQUARE, CHAMFERED, HEXAGON, TWO, FUNNEL, SMALL, KEYED, LEGS])
def test_the_lowest_corner_alone_is_in(name: str) -> None:
    problem, found = entries(name)
    funnel = funnel_depth(problem.fixed)
    for shape, entry in found:
        heights = entry.inside.apply(problem.moving.polyhedron.vertices)[:, 2]
        assert entry.inside.apply(entry.corner)[2] == pytest.approx(-shape.depth, abs=1e-12)
        assert heights.min() >= -shape.depth - 2e-3 * shape.depth - 1e-3
        assert shape.depth > funnel
        assert entry.start.apply(problem.moving.polyhedron.vertices)[:, 2].min() == pytest.approx(problem.approach)
        assert np.abs(entry.start.R - entry.inside.R).max() < 1e-12


@pytest.mark.parametrize("name", [SQUARE, CHAMFERED, HEXAGON, TWO, SMALL])
def test_the_corner_is_as_far_from_the_walls_next_to_it_as_its_shape_says(name: str) -> None:
    """The walls are those of the hole: faces that look inward, read off the fixed part itself."""
    problem, found = entries(name)
    mouth = [f for f in problem.fixed.polyhedron.faces if abs(f.normal[2]) < 1e-9 and f.offset > -0.5]
    for shape, entry in found:
        at = entry.inside.apply(entry.corner)
        gaps = []
        for face in mouth:
            points = problem.fixed.polyhedron.vertices[list(face.vertices)]
            along = np.array([-face.normal[1], face.normal[0], 0.0])
            span = points @ along
            beside = span.min() - 1e-9 <= at @ along <= span.max() + 1e-9
            gap = float(face.normal @ at - face.offset)
            if gap > 0.0 and beside and points[:, 2].min() < -1e-3 < points[:, 2].max() + 2e-3:
                gaps.append(gap)
        nearest = sorted(gaps)[:2]
        wanted = sorted(shape.room)
        # Free travel is known along x and y alone: at a slanted wall the room is right to a part of it.
        assert nearest == pytest.approx(wanted, abs=5e-4 if name == HEXAGON else 2e-5), shape


def test_a_small_mouth_shares_its_room_between_opposite_walls() -> None:
    problem, found = entries(SMALL)
    width = 4.11e-3
    for shape, _ in found:
        swing = 3e-3 * np.linalg.norm(problem.start_box[3:])
        for side in shape.room:
            assert problem.start_box[0] < side < width - problem.start_box[0] - swing


SLENDER = {
    "rectangle": [[30.0, 3.0], [-30.0, 3.0], [-30.0, -3.0], [30.0, -3.0]],
    "bevelled": [
        [20.0, 3.0],
        [19.0, 4.0],
        [-19.0, 4.0],
        [-20.0, 3.0],
        [-20.0, -3.0],
        [-19.0, -4.0],
        [19.0, -4.0],
        [20.0, -3.0],
    ],
    "pencil": [[20.0, 0.0], [16.0, 4.0], [-20.0, 4.0], [-20.0, -4.0], [16.0, -4.0]],
    "slanted": [[29.0, -4.0], [20.0, 4.0], [-20.0, 4.0], [-20.0, -4.0]],
    "obround": [
        [side * (6.0 + 6.0 * np.cos(turn)), side * 6.0 * np.sin(turn)]
        for side in (1.0, -1.0)
        for turn in np.radians(np.linspace(-90.0, 90.0, 9))
    ],
}


@pytest.mark.parametrize("name", SLENDER)
def test_every_corner_of_a_slender_outline_has_two_walls_at_an_angle(name: str, tmp_path: Path) -> None:
    """The ends are short beside the sides; of the obround they are many sides that are shorter still."""
    problem = prism(tmp_path, SLENDER[name], (0.1, 0.1))
    for corner in leading_corners(problem.moving):
        (one, on_one), (two, on_two) = corner_walls(problem.moving, corner)
        assert abs(np.linalg.det(np.array([one, two]))) > 0.3
        for normal, point in ((one, on_one), (two, on_two)):
            assert (leading_corners(problem.moving)[:, :2] @ normal).min() == pytest.approx(normal @ point, abs=1e-12)
            if name in ("rectangle", "bevelled"):
                assert float(normal @ (corner[:2] - point)) < 2e-3


def test_a_funnel_is_as_deep_as_its_sloped_faces() -> None:
    assert funnel_depth(load(PROBLEMS / f"{FUNNEL}.toml").fixed) == pytest.approx(14e-3, abs=1e-12)
    assert funnel_depth(load(PROBLEMS / f"{SQUARE}.toml").fixed) == 0.0


def test_errors_of_the_heading_make_the_corner_go_deeper() -> None:
    problem, _ = entries(SQUARE)
    play = (2e-4, 2e-4)
    depths = []
    for factor in (1.0, 2.0, 4.0):
        wider = replace(problem, start_box=factor * problem.start_box)
        depths.append(next(tilted_shapes(problem.moving, play, wider.start_box, 0.4)).depth)
    assert depths[2] - depths[1] == pytest.approx(2.0 * (depths[1] - depths[0]))
    assert depths[0] < depths[1]


def test_a_part_on_legs_begins_with_them() -> None:
    """What stands out below the leading face of the mating feature goes in first, upright or tilted."""
    problem = load(PROBLEMS / f"{LEGS}.toml")
    vertices = problem.moving.polyhedron.vertices
    assert vertices[:, 2].min() == pytest.approx(-0.02)
    (upright,) = straight_entry(problem.moving, (5e-4, 1e-3), 0.05 * problem.start_box, problem.approach)
    assert upright.start.apply(vertices)[:, 2].min() == pytest.approx(problem.approach)
    assert upright.inside.apply(vertices)[:, 2].min() == pytest.approx(-2.5e-4)
    _, found = entries(LEGS)
    for _, entry in found:
        assert entry.corner[2] == pytest.approx(-0.02)


@pytest.mark.parametrize("seed", range(4))
def test_walls_begin_above_chamfers_of_the_tip(seed: int, tmp_path: Path) -> None:
    """The corners that go in are those of the whole outline, at the height where the walls begin."""
    pair = family_pair("chamfered", seed)
    moving = load(write_toml(pair, tmp_path)).moving
    corners, outline = leading_corners(moving), np.array(pair.peg[-1].outline)
    assert len(corners) == len(outline)
    assert np.ptp(corners[:, 2]) < 1e-9
    assert corners[0, 2] - moving.polyhedron.vertices[:, 2].min() == pytest.approx(1e-3 * pair.peg[1].at, abs=1e-9)
    sides = np.sort(np.linalg.norm(np.roll(corners, 1, axis=0) - corners, axis=1))
    assert sides == pytest.approx(
        1e-3 * np.sort(np.linalg.norm(np.roll(outline, 1, axis=0) - outline, axis=1)), abs=1e-9
    )


def test_a_taper_is_no_chamfer(tmp_path: Path) -> None:
    moving = load(write_toml(family_pair("tapered", 0), tmp_path)).moving
    assert leading_corners(moving)[:, 2] == pytest.approx(moving.polyhedron.vertices[:, 2].min(), abs=1e-12)
