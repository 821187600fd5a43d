"""The knowledge base of files: problems as task commands, the shipped assembly in steps, faults with their place."""

import math
from pathlib import Path

import numpy as np
import pytest

from fmopt.errors import InputError, InterferenceError
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box, Cylinder
from fmopt.papers.lee_huang.hand_position_force import hand_pose
from fmopt.spatial.se3 import Pose
from fmopt.task.assembly import AssemblyStep, carried_out, load_assembly
from fmopt.task.object_model.tree import TreeFeature, moved
from fmopt.task.object_model.workcell import Link, Ref
from fmopt.task.problem import load
from fmopt.task.task_command import is_round, problem_answer, task_command
from tests import ROOT
from tests.shared.same_solid import assert_same_volume
from tests.shared.solids import contains

ASSEMBLY = ROOT / "problems" / "assemblies" / "lee_huang_bush.toml"


TOO_WIDE = "bilba_plain_63"  # a peg that is to be refused
TASKS = [path for path in sorted((ROOT / "problems").glob("*.toml")) if path.stem != TOO_WIDE]


@pytest.mark.wide
@pytest.mark.parametrize("path", TASKS, ids=lambda path: path.stem)
def test_every_shipped_problem_is_a_task(path: Path) -> None:
    problem = load(path)
    found = problem_answer(problem)
    np.testing.assert_allclose(found.P0, problem.start, atol=1e-15)
    np.testing.assert_allclose(found.PT, problem.goal, atol=1e-15)
    np.testing.assert_allclose(found.fixed.frame.vector(), np.zeros(6), atol=1e-15)
    assert not found.exchanged
    for operand, part in ((found.moving, problem.moving), (found.fixed, problem.fixed)):
        whole, body = polyhedron(operand.whole), part.polyhedron
        assert_same_volume(whole, body, 1e-9)
        least = (body.vertices - body.radii[:, None]).min(axis=0)
        np.testing.assert_allclose(whole.vertices.min(axis=0), least, atol=1e-12 + 0.02 * float(body.radii.max()))


def test_a_peg_that_is_too_wide_is_refused_with_its_interference() -> None:
    with pytest.raises(InterferenceError, match=r"overlaps 'square_hole_block' by 1 mm; seat it less deep"):
        problem_answer(load(ROOT / "problems" / f"{TOO_WIDE}.toml"))


def test_the_peg_of_figure_2_turns_freely_and_the_square_one_does_not() -> None:
    _, wanted = task_command(load(ROOT / "problems" / "lee_huang_peg.toml"))
    assert (wanted.attachment, wanted.goal[5]) == ("cylindrical", "free")
    _, wanted = task_command(load(ROOT / "problems" / "square_peg.toml"))
    assert (wanted.attachment, wanted.goal[5]) == ("prismatic", 0.0)


def test_round_is_what_turns_about_z() -> None:
    body = Cylinder(0.01, 0.02)
    for x, y, tilt, expected in ((0.0, 0.0, 0.0, True), (1e-6, 0.0, 0.0, False), (0.0, 0.0, 1e-3, False)):
        frame = Pose.from_vector([x, y, 0, tilt, 0, 0])
        assert is_round(TreeFeature("peg", "+", frame, body, 0.02)) is expected
    assert not is_round(TreeFeature("peg", "+", Pose.identity(), Box((1, 1, 1)), 0.02))


@pytest.fixture(scope="module")
def steps() -> list[AssemblyStep]:
    return list(carried_out(load_assembly(ASSEMBLY)))


def test_the_shipped_assembly(steps: list[AssemblyStep]) -> None:
    first, second = steps
    assert (first.name, second.name) == ("seat_bush", "insert_peg")
    np.testing.assert_allclose(first.answer.P0, [0.1, 0, -0.03, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(first.answer.PT, [0, 0, -0.03, 0, 0, 0], atol=1e-15)
    assert [str(one) for one in first.answer.settled] == [
        "p_z is free: -30 mm, at full depth",
        "q_z is free: 0 deg, nearest to the orientation at the start",
    ]
    assert second.answer.task.specification.contact_force == 10.0
    np.testing.assert_allclose(second.answer.PT, [0, 0, -0.025, 0, 0, math.radians(30)], atol=1e-12)
    link = Link("cylindrical", Ref("bush", "shank"), Ref("block", "hole"))
    assert link in second.after.links
    assert second.after.group("peg") == ("peg", "bush", "block")


def test_the_second_step_finds_the_bush_in_the_block(steps: list[AssemblyStep]) -> None:
    fixed = steps[1].answer.fixed
    assert [str(ref) for ref in fixed.members] == ["bush.bore", "bush.shank", "block.hole", "block.block"]
    points = np.array([[0.0, 0.0, -0.01], [0.0125, 0.0, -0.01], [0.025, 0.0, -0.01]])
    assert contains(fixed.solid, points).tolist() == [False, True, True]
    gap = contains(fixed.whole, [[0.0151 * math.cos(math.pi / 32), 0.0, -0.01]])
    assert gap.tolist() == [False]
    after = steps[1].after
    body = moved(after.object("peg").solid, after.object("peg").frame)
    assert contains(body, [[0.0, 0.0, 0.006], [0.0, 0.0, 0.004]]).tolist() == [True, False]


def test_the_hand_holds_as_the_file_says(steps: list[AssemblyStep]) -> None:
    found = steps[1].answer
    hand = hand_pose(found, found.PT)
    np.testing.assert_allclose(hand.p, [0, 0, 0.03 - 0.025 + 0.06], atol=1e-12)


LINK = '[links.seat]\nkind = "attached"\none = "peg"\nother = "pin"\n\n[tasks.seat_bush]'


def refused(tmp_path: Path, old: str, new: str) -> str:
    text = ASSEMBLY.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "assembly.toml"
    path.write_text(text.replace(old, new, 1).replace("../../models", str(ROOT / "models")), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        list(carried_out(load_assembly(path)))
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ('"bush.shank"', '"bush.shan"', "24:8: task-rule: tasks.seat_bush", "no feature 'shan'"),
        ('"bush.shank"', '"bush"', "25:10: ", "tasks.seat_bush.moving"),
        ('goal = [0, 0, "free", 0, 0, "free"]', 'goal = [1, 0, "free", 0, 0, 0]', "24:8: task-rule", "p_x = 1 mm"),
        ('goal = [0, 0, "free", 0, 0, "free"]', 'goal = [0, 0, "fre", 0, 0, 0]', "28:15: ", "tasks.seat_bush.goal[2]"),
        ("at = [100, 0, 0]", "at = [20, 0, 10]", "24:8: task-rule", "inside the solid of 'block'"),
        ("{ radius = 15.2 }", "{ radus = 15.2 }", "13:24: unknown-parameter", "'radus'"),
        ("lee_huang_bush.toml", "no_such.toml", "16:9: ", "no_such.toml"),
        ("[tasks.seat_bush]", LINK, "24:2: task-rule: links", "'pin'"),
    ],
)
def test_faults_have_their_place(tmp_path: Path, old: str, new: str, place: str, words: str) -> None:
    message = refused(tmp_path, old, new)
    assert place in message
    assert words in message
