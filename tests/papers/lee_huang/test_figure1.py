"""What goes into, and over, the object of figure 1: built of solid and hollow features, read from its model file."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from fmopt.geometry.csg import Box, Cylinder, Moved
from fmopt.papers.lee_huang.freedom import half_widths
from fmopt.papers.lee_huang.mapping import Mapping, answered, plane_diagrams
from fmopt.papers.lee_huang.nominal_trajectory import insertion
from fmopt.papers.lee_huang.plane_freedom import freedom_on_planes
from fmopt.spatial.se3 import Pose
from fmopt.task.object_model.command import Answer, Task, answer
from fmopt.task.object_model.goal import FREE, Goal
from fmopt.task.object_model.tree import ObjectTree
from fmopt.task.object_model.workcell import Ref, Workcell
from fmopt.task.problem import load
from fmopt.task.task_command import problem_answer
from tests import ROOT
from tests.shared.files.models import tree_of
from tests.shared.parts.workcells import SPECIFICATION, at, cell, feature, thing

WIDE, RHO = np.array([1e-4, 1e-4, 1e-4, 0.05, 0.05, 0.05]), 0.014
FREE_S, ROUND = (0,) * 6, (2, 2, 0, 2, 2, 0)


def steps(made: Mapping) -> list[tuple[int, ...]]:
    return [one.s for one in made.freedoms]


def mapped(workcell: Workcell, wanted: Task) -> tuple[Answer, Mapping]:
    found = answer(workcell, wanted)
    return found, answered(found, WIDE, RHO)


@cache
def object_of_figure_1() -> ObjectTree:
    """The shipped model, its polygons with half as many sides."""
    text = (ROOT / "models" / "lee_huang_figure1.toml").read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "figure1.toml"
        path.write_text(text.replace("sides = 32", "sides = 16"), encoding="utf-8")
        return tree_of(path)


BALL, CONE = WIDE[0], WIDE[3]


def leaning(hole: float, half_width: float, ball: float = BALL, cone: float = CONE) -> float:
    """Depth at which the rim stops a flank that leans by the cone, its lower end off by the ball."""
    return float((hole - ball - half_width / np.cos(cone)) / np.tan(cone) - ball)


def landing(half_width: float, ball: float = BALL, cone: float = CONE) -> float:
    """Height above a floor, or the mouth, at which the lower corner of a tilted end is down on it."""
    return float(ball + half_width * np.sin(cone))


C, B = 0.0035, (0.0058, 0.015)  # of the round peg for hole c, half the sides of the key
FIGURE_1 = {
    "hole_c": (  # countersunk by 3 mm: the rim is there
        (Cylinder(C, 0.05, 16), (0.045, 0.0, 0.06), "cylindrical", FREE),
        [(FREE_S, 0.03), (ROUND, -leaning(0.004, C) - 0.003)],
    ),
    "slot_b": (
        (Box((2 * B[0], 2 * B[1], 0.05)), (0.012, 0.0, 0.06), "prismatic", 0.0),
        [
            (FREE_S, 0.03),
            ((2, 0, 0, 0, 0, 2), landing(B[1])),
            ((2, 0, 0, 0, 2, 2), -leaning(0.006, B[0])),
            ((2, 0, -1, 2, 2, 2), landing(B[1]) - 0.015),
        ],
    ),
}


@pytest.mark.parametrize("hole", sorted(FIGURE_1))
def test_what_goes_into_the_object_of_figure_1(hole: str) -> None:
    """A blind slot stops its key at the floor too and leaves the way along it free; heights by hand."""
    (body, start, pair, turn), expected = FIGURE_1[hole]
    parts = cell(object_of_figure_1(), thing("tool", at(*start), feature("end", "+", at(0), body, 0.05)))
    goal: Goal = (0.0, 0.0, FREE, 0.0, 0.0, turn)
    wanted = Task(Ref("tool", "end"), Ref("lee_huang_figure1", hole), goal, pair, SPECIFICATION)
    found, made = mapped(parts, wanted)
    assert hole in [ref.feature for ref in found.fixed.members]
    assert steps(made) == [s for s, _ in expected]
    heights = [made.path.at(one.start)[2] for one in made.freedoms]
    np.testing.assert_allclose(heights, [height for _, height in expected], rtol=0.0, atol=1e-9 * 0.04)


def test_a_cap_goes_over_the_boss_of_figure_1() -> None:
    """The hollow part is grasped and the solid one stands: answered the other way round, and mapped like any other."""
    cap = thing(
        "cap",
        Pose.from_vector([-0.025, 0.02, 0.08, 0, 0, 0]),
        feature("body", "+", at(0), Box((0.04, 0.04, 0.03)), None),
        feature(
            "inside", "-", Pose.from_vector([0, 0, 0, np.pi, 0, 0]), Moved(Cylinder(0.0158, 0.025, 16), at(0)), 0.025
        ),
    )
    goal: Goal = (0.0, 0.0, 0.018, 0.0, 0.0, FREE)
    wanted = Task(Ref("cap", "inside"), Ref("lee_huang_figure1", "boss"), goal, "cylindrical", SPECIFICATION)
    found, made = mapped(cell(object_of_figure_1(), cap), wanted)
    assert found.exchanged
    np.testing.assert_allclose(found.P0[:3], [0.0, 0.02, 0.03], atol=1e-12)
    np.testing.assert_allclose(made.path.nodes[-1][:3], [0, 0, -0.018], atol=1e-12)
    assert steps(made)[-1] == ROUND


def test_the_shipped_problem_of_figure_1() -> None:
    """The blind hole stops the peg at its floor; polygons are as the file says, sections are round."""
    problem = load(ROOT / "problems" / "lee_huang_figure1.toml")
    found = problem_answer(problem)
    assert [ref.feature for ref in found.fixed.members] == ["hole_a", "base", "boss"]
    assert problem.trapezoid is not None
    ball, cone = problem.trapezoid
    planes = plane_diagrams(found.moving.solid, found.fixed.solid, found.P0, found.PT, half_widths(ball, cone))
    path = insertion([0, 0, 0.012, 0, 0, 0], found.PT, problem.specification.speed, RHO)
    seen = freedom_on_planes([view for plane in planes for view in plane.views], path)
    assert [one.s for one in seen] == [FREE_S, ROUND, (2, 2, -1, 2, 2, 0)]
    expected = [-leaning(0.008, 0.0077373, ball, cone), landing(0.0077373, ball, cone) - 0.035]
    heights = [path.at(one.start)[2] for one in seen[1:]]
    np.testing.assert_allclose(heights, expected, rtol=0.0, atol=1e-9 * 0.05)
