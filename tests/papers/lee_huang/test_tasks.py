"""Tasks of the knowledge base through the whole mapping: who is in the hand, steps, obstacles, refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmopt.certificate.error_set import ErrorSet
from fmopt.errors import InterferenceError, TaskError
from fmopt.geometry.csg import Box, Cylinder, Moved, Prism, Solid, ring
from fmopt.papers.lee_huang.mapping import Mapping, answered
from fmopt.planning.pipeline import nominal_motion, synthesise
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.assembly import carried_out, load_assembly
from fmopt.task.object_model.command import Answer, Task, answer
from fmopt.task.object_model.goal import FREE, Goal
from fmopt.task.object_model.tree import ObjectTree
from fmopt.task.object_model.workcell import LowerPair, Workcell
from tests import ROOT
from tests.shared.files.model_text import cuboid, union
from tests.shared.files.shipped import loaded, shipped, swapped
from tests.shared.parts.workcells import at, cell, feature, task, thing

BOX, RHO = np.array([1e-4, 1e-4, 1e-4, 0.01, 0.01, 0.03]), 0.014
FREE_S, ROUND, SQUARE = (0,) * 6, (2, 2, 0, 2, 2, 0), (2, 2, 0, 2, 2, 2)


def steps(made: Mapping) -> list[tuple[int, ...]]:
    return [one.s for one in made.freedoms]


def mapped(workcell: Workcell, wanted: Task, box: Array = BOX) -> tuple[Answer, Mapping]:
    found = answer(workcell, wanted)
    return found, answered(found, box, RHO)


# Two steps, each with the workcell that the one before left.


def test_a_two_step_assembly_is_mapped_step_by_step() -> None:
    first, second = carried_out(load_assembly(ROOT / "problems" / "assemblies" / "lee_huang_bush.toml"))
    made = [answered(step.answer, BOX, RHO) for step in (first, second)]
    for step, one in zip((first, second), made, strict=True):
        np.testing.assert_allclose(one.path.nodes[0], step.answer.P0)
        np.testing.assert_allclose(one.path.nodes[-1], step.answer.PT)
        np.testing.assert_array_equal(one.path.nodes[-2][:2], [0, 0])
        assert one.path.nodes[-2][2] > 0.0  # on the axis above the mouth, from where it goes straight in
        assert steps(one)[-1] == ROUND
    np.testing.assert_allclose(second.answer.P0[:3], [0.0, 0.1, -0.01], atol=1e-12)  # the bush stands in the block now
    assert [str(ref) for ref in second.answer.fixed.members][:2] == ["bush.bore", "bush.shank"]


# Round and polygonal, blind and through, the pair by its name.


def shape(kind: str, size: float, height: float) -> Solid:
    return Cylinder(size, height, 24) if kind == "round" else Prism(tuple(map(tuple, ring(size, 6))), height)


@pytest.mark.parametrize("through", [True, False])
@pytest.mark.parametrize(("kind", "pair"), [("round", "cylindrical"), ("hexagonal", "prismatic")])
def test_pegs_of_both_pairs_in_blind_and_through_holes(kind: str, pair: LowerPair, through: bool) -> None:
    pin = thing("pin", at(0.03, 0.01, 0.06), feature("pin", "+", at(0), shape(kind, 0.01, 0.05), 0.05))
    depth = 0.04 if through else 0.03
    tool = Moved(shape(kind, 0.0102, 0.06), at(0, 0, 0.04 - depth - (0.01 if through else 0.0)))
    body = feature("body", "+", at(0), Box((0.06, 0.06, 0.04)), None)
    block = thing("block", at(0), body, feature("hole", "-", at(0, 0, 0.04), tool, depth, through))
    goal: Goal = (0.0, 0.0, FREE, 0.0, 0.0, FREE if kind == "round" else 0.0)
    _, made = mapped(cell(block, pin), task("pin.pin", "block.hole", goal, pair))
    inside = ROUND if kind == "round" else SQUARE
    ends = [inside] if through else [inside, (*inside[:2], -1, *inside[3:])]
    assert steps(made)[0] == FREE_S
    assert steps(made)[-len(ends) :] == ends


# Obstacles off the planes.

PIN = thing("pin", at(0.0, 0.0, 0.06), feature("pin", "+", at(0), Box((0.02, 0.02, 0.05)), 0.05))
SLEEVE = thing(
    "sleeve",
    at(0),
    feature("body", "+", at(0), Box((0.06, 0.06, 0.04)), None),
    feature("bore", "-", at(0, 0, 0.04), Moved(Box((0.0204, 0.0204, 0.04)), at(0, 0, 0.01)), 0.03),
)
DOWN: Goal = (0.0, 0.0, FREE, 0.0, 0.0, 0.0)


def post(where: Pose) -> ObjectTree:
    return thing("post", where, feature("post", "+", at(0), Box((0.004, 0.004, 0.02)), None))


def test_an_obstacle_beside_the_planes_is_reported_by_name() -> None:
    wanted = task("pin.pin", "sleeve.bore", DOWN, "prismatic")
    aside = PIN.at(at(0.06, 0.06, 0.06))
    in_the_way = post(at(0.03, 0.03, 0.046))
    with pytest.raises(InterferenceError, match=r"'pin' meets 'post' .* off the planes xz, yz and xy") as told:
        mapped(cell(SLEEVE, aside, in_the_way), wanted)
    assert told.value.place == "post"
    assert steps(mapped(cell(SLEEVE, aside), wanted)[1])[-1] == (2, 2, -1, 2, 2, 2)


def test_an_obstacle_of_an_exchanged_task_moves_with_operand_1() -> None:
    """The sleeve is in the hand and goes over the standing pin; what stands beside the pin is in the sleeve's way."""
    standing = PIN.at(Pose.from_vector([0, 0, 0, np.pi, 0, 0]))  # on its head, its leading end up
    grasped = SLEEVE.at(Pose.from_vector([0, 0, 0.06, np.pi, 0, 0]))  # its mouth down
    wanted = task("sleeve.bore", "pin.pin", DOWN, "prismatic")
    found, made = mapped(cell(standing, grasped), wanted)
    assert found.exchanged
    assert steps(made)[-1] == (2, 2, -1, 2, 2, 2)
    with pytest.raises(TaskError, match=r"at the goal sleeve\.bore overlaps 'post'"):
        mapped(cell(standing, grasped, post(at(0.02, 0.02, -0.03))), wanted)
    between = post(at(0.04, 0.04, -0.005)), grasped.at(Pose.from_vector([0.05, 0.05, 0.06, np.pi, 0, 0]))
    with pytest.raises(InterferenceError, match=r"'post' meets 'sleeve' "):
        mapped(cell(standing, *between), replace(wanted, goal=(0.0, 0.0, 0.001, 0.0, 0.0, 0.0)))


# Through the problem file.


def test_figure_two_through_the_problem_file(tmp_path: Path) -> None:
    problem = loaded(tmp_path, shipped("lee_huang_peg"))
    made = nominal_motion(problem, ErrorSet.from_box(problem.start_box), RHO)
    assert [one.s for one in made.freedoms] == [FREE_S, ROUND]
    assert len(made.path.nodes) == 3
    np.testing.assert_array_equal(made.path.nodes[0], [0.015, 0.004, 0.012, 0, 0, 0])
    plain = loaded(tmp_path, shipped("lee_huang_peg").replace("ball = 0.1\ncone = 0.5", "ball = 0.03\ncone = 0.05"))
    assert [one.s for one in nominal_motion(plain, ErrorSet.from_box(plain.start_box), RHO).freedoms] == [FREE_S]


def test_the_hollow_part_in_the_hand_is_solved(tmp_path: Path) -> None:
    """A block goes over a standing peg: the certificate is that of the relative motion, the hand makes its inverse."""
    grasp = "[grasp]\nat = [0, 0, 50]\n\n[uncertainty.start]"
    text = swapped(shipped("square_peg")).replace("[uncertainty.start]", grasp)
    for name, value in (("x", 0.02), ("y", 0.02), ("rx", 0.01), ("ry", 0.01), ("rz", 0.01)):
        text = text.replace(f"\n{name} = 0.3\n", f"\n{name} = {value}\n")
    text = text.replace('depth = "full"', "depth = 20")
    text = text.replace("translation = 0.01", "translation = 0.0002").replace("rotation = 0.01", "rotation = 0.0002")
    result = synthesise(loaded(tmp_path, text))
    assert result.document["verdict"] == "CERTIFIED"
    hand = result.document["description"]["diagnostics"]["hand"]
    assert (hand["grasped"], hand["standing"], hand["exchanged"]) == ("square_hole_block.hole", "square_peg.peg", True)
    for segment, move in zip(result.document["segments"], hand["segments"], strict=True):
        held = Pose.from_vector(move["goal"]).compose(Pose.from_vector([0, 0, 0.05, 0, 0, 0]))
        np.testing.assert_allclose(held.compose(Pose.from_vector(segment["goal"])).vector(), np.zeros(6), atol=1e-12)
        assert move["velocity"][2] > 0.0 > segment["hybrid"]["velocity"][2]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("height = 1", "height = 1\nat = [20, 0, -5]", "at the start square_peg.peg is inside the solid"),
        ("height = 1", "height = 1\nat = [0, 0, 30]\nturn = [10, 0, 0]", None),
    ],
)
def test_starts_of_problem_files(tmp_path: Path, old: str, new: str, words: str | None) -> None:
    problem = loaded(tmp_path, shipped("square_peg").replace(old, new))
    errors = ErrorSet.from_box(problem.start_box)
    if words is None:
        path = nominal_motion(problem, errors, RHO).path
        mouth = next(k for k, node in enumerate(path.nodes) if not node[3:].any())
        assert path.nodes[0][3] > 0.1
        assert path.nodes[mouth][2] > 0.0  # the orientation is reached above the mouth
        return
    with pytest.raises(TaskError, match=words) as told:
        nominal_motion(problem, errors, RHO)
    assert told.value.rule


def test_an_obstacle_of_the_fixed_model_off_the_planes_is_reported(tmp_path: Path) -> None:
    """A post on the block, in a corner between the planes: on the way from beside it, clear of it from above."""
    model = (ROOT / "models" / "square_hole_block.toml").read_text(encoding="utf-8")
    post = cuboid("post", "4, 4, 20", '18, 18, "block_z - proud"') + union("posted", "drilled", "post")
    model = model.replace('part = "drilled"', 'part = "posted"').replace("[features.hole]", f"{post}[features.hole]")
    (tmp_path / "block.toml").write_text(model, encoding="utf-8")
    text = shipped("square_peg").replace(str(ROOT / "models" / "square_hole_block.toml"), "block.toml")
    beside = loaded(tmp_path, text.replace("height = 1", "height = 1\nat = [35, 35, 5]"))
    with pytest.raises(InterferenceError, match=r"meets 'square_hole_block' .* off the planes xz, yz and xy"):
        nominal_motion(beside, ErrorSet.from_box(beside.start_box), RHO)
    above = loaded(tmp_path, text)
    assert len(nominal_motion(above, ErrorSet.from_box(above.start_box), RHO).path.nodes) >= 2
