"""Parts with obtuse corners: two walls next to parallel hold them, so that they go in along one of these."""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.section import corner_walls, leading_corners, outline
from fmopt.planning.search.best_first import begin
from fmopt.planning.search.entry import Shape, tilted_entry
from fmopt.planning.search.entry_candidates import Way, likely_headings, likely_shapes, obtuse_shapes
from fmopt.planning.search.successors import Node, follow
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from tests import PROBLEMS
from tests.shared.executions.model import execute
from tests.shared.parts.outlines import prism
from tests.shared.searched import certified_plan, task_of, tilted_motion

NAMES = ("octagon_prism", "keyed_shaft")
LOPSIDED = [[-10.0, -10.0], [6.0, -10.0], [10.0, -6.0], [10.0, 3.0], [3.0, 10.0], [-10.0, 10.0]]  # two corners cut off
FOUND = {0: ("-x", "+rz", "+ry", "-y", "-rx", "-z"), 1: ("-y", "-rz", "-rx", "-x", "+ry", "-z")}  # along either wall


@pytest.fixture(scope="module", params=NAMES)
def problem(request: pytest.FixtureRequest) -> Problem:
    return load(PROBLEMS / f"{request.param}.toml")


@pytest.fixture(scope="module")
def octagon() -> Problem:
    return load(PROBLEMS / "octagon_prism.toml")


def first_along(problem: Problem, wall: int = 0, after: int = 0) -> Shape:
    """The first shape, after some, that is to be flush with the wall towards −x or −y, where one is across the key."""
    heading = next(way.heading for way in likely_headings(problem.moving) if way.wall == 0)
    play = measured_clearance(problem).play
    towards = Way(heading, wall)
    shapes = obtuse_shapes(problem.moving, play, problem.start_box, problem.settings.max_tilt, (0.0, 0.0), towards)
    return next(islice(shapes, after, None))


def test_a_corner_is_held_by_the_sides_next_to_it(octagon: Problem) -> None:
    loop = outline(leading_corners(octagon.moving))
    for corner in loop:
        walls = corner_walls(octagon.moving, corner)
        assert walls[0][0] @ walls[1][0] == pytest.approx(math.cos(0.25 * math.pi))
        for inward, point in walls:
            assert inward @ (corner[:2] - point) == pytest.approx(0.0, abs=1e-12)
            assert (loop[:, :2] @ inward).min() == pytest.approx(inward @ point)


def degrees(problem: Problem) -> list[tuple[int, int | None]]:
    return [(round(math.degrees(heading)), wall) for heading, wall in likely_headings(problem.moving)]


def test_one_wall_of_an_obtuse_corner_lies_across_an_axis(octagon: Problem) -> None:
    assert degrees(octagon) == [(0, 0)]  # all corners are the same
    keyed = degrees(load(PROBLEMS / "keyed_shaft.toml"))
    assert keyed[:2] == [(-90, None), (-180, None)]  # the key's own corners are right ones
    assert keyed[2] == (90, 0)  # across from the key
    assert {(round(way[0]) % 360, way[1]) for way in keyed[3:]} == {(d, 0) for d in (0, 45, 135, 180, 315)}


def test_mirror_images_take_turns_where_the_part_is_not_its_own(tmp_path: Path) -> None:
    problem = prism(tmp_path, LOPSIDED, (0.1, 0.1))
    found = degrees(problem)
    obtuse = [way for way in found if way[1] is not None]
    assert {wall for _, wall in obtuse} == {0, 1}
    assert len(obtuse) == len(set(obtuse)) == 2 * 4
    shapes = likely_shapes(
        problem.moving, problem.fixed, measured_clearance(problem), problem.start_box, 1e-3, problem.settings.max_tilt
    )
    seen = [shape for shape in islice(shapes, 6 * len(found)) if shape.touch and shape.depth < 1e-3]
    assert {shape.about_y > shape.about_x for shape in seen} == {True, False}


def test_going_in_along_the_other_wall_is_the_mirror_image(octagon: Problem) -> None:
    play, mirror = measured_clearance(octagon).play, np.eye(3)[[1, 0, 2]]
    one, other = (tilted_entry(octagon.moving, play, octagon.approach, first_along(octagon, k)) for k in (0, 1))
    assert mirror @ one.corner == pytest.approx(other.corner, abs=1e-12)
    for a, b in ((one.start, other.start), (one.inside, other.inside)):
        assert mirror @ a.p == pytest.approx(b.p, abs=5e-6)
        assert np.abs(mirror @ a.R @ mirror - b.R).max() < 2e-3  # the tilts are in the other order


def test_the_corner_goes_in_alone_and_farther_from_the_second_wall(problem: Problem) -> None:
    shape = first_along(problem)
    entry = tilted_entry(problem.moving, measured_clearance(problem).play, problem.approach, shape)
    heights = np.sort(entry.inside.apply(leading_corners(problem.moving))[:, 2])
    assert heights[0] == pytest.approx(-shape.depth, abs=1e-12)
    assert heights[1] > 0.0
    assert shape.room[1] > shape.room[0] > problem.start_box[0]


def flush_before_it_meets(problem: Problem, wall: int) -> Node:
    """The seated state, after contacts that each take a freedom away."""
    task, play = task_of(problem), measured_clearance(problem).play
    node = begin(task, tilted_entry(problem.moving, play, problem.approach, first_along(problem, wall)))
    ranks = []
    for name in FOUND[wall]:
        assert node is not None
        node = follow(task, node, name)
        assert node is not None
        ranks.append(node.rank)
    assert ranks == [1, 2, 3, 4, 5, 5]
    assert task.seated(node.place.pose)
    return node


def test_the_part_is_flush_with_the_first_wall_before_it_meets_the_second(problem: Problem) -> None:
    assert flush_before_it_meets(problem, 0).reached.margin > 2e-5


def test_of_corners_that_come_together_that_one_is_met_which_errors_leave_sure(octagon: Problem) -> None:
    """As the part turns upright both corners of the second wall come onto it; the one that it turns on hardly moves.

    Which of the two is the last in the list depends on which way the part goes in.
    """
    margins = [flush_before_it_meets(octagon, wall).reached.margin for wall in (0, 1)]
    assert margins[0] == pytest.approx(margins[1], abs=1e-6)


@pytest.mark.parametrize(("name", "after"), [("octagon_prism", 4), ("keyed_shaft", 0)])
def test_it_is_certified_at_errors_of_millimetres(name: str, after: int) -> None:
    problem = load(PROBLEMS / f"{name}.toml")
    motion = tilted_motion(problem, first_along(problem, after=after))
    assert motion.placed.margin > 2e-5
    assert execute(certified_plan(problem, motion), 20, seed=3).broken == {}
