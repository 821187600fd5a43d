"""What the knowledge base refuses, each by feature and rule."""

import math
import pickle

import pytest

from fmopt.errors import InterferenceError, TaskError
from fmopt.geometry.csg import Box
from fmopt.task.object_model.command import APART, CLEAR, KINDS, STALE, START, CommandLimits, Task, answer, completed
from fmopt.task.object_model.goal import FREE, INSERTED, ON_AXIS, SETTLED, Goal
from fmopt.task.object_model.workcell import EXIST, Link, LinkKind, LowerPair, Ref, Workcell
from tests.shared.parts.workcells import IN_BUSH, SIDES, above, at, bush, cell, feature, peg, plate, task, thing


def refused(base: Workcell, wanted: Task) -> TaskError:
    with pytest.raises(TaskError) as caught:
        answer(base, wanted)
    return caught.value


def test_missing_operands() -> None:
    for wanted, words in (
        (task("pin.shaft", "bush.bore"), "no object 'pin'; its objects: bush, peg"),
        (task("peg.shaft", "bush.hole"), "no feature 'hole' (rule: operands exist); its features: shank, bore"),
        (task("peg", "bush.bore"), "names the object 'peg' without a feature"),
        (task("bush.shank", "bush.bore"), "both operands belong to 'bush'"),
    ):
        error = refused(above(), wanted)
        assert error.rule == EXIST
        assert words.replace(" (rule: operands exist)", "") in str(error).replace(" (rule: operands exist)", "")


def test_features_that_do_not_mate() -> None:
    for wanted in (task("peg.shaft", "bush.shank"), task("peg.socket", "bush.bore")):
        error = refused(above(), wanted)
        assert (error.rule, error.feature) == (KINDS, str(wanted.moving))
    error = refused(above(), task("peg.flange", "bush.bore"))
    assert "'flange' of 'peg' has no length" in str(error)


def test_a_start_inside_the_solid() -> None:
    error = refused(above(0.03), IN_BUSH)
    assert (error.rule, error.feature) == (START, "peg.shaft")
    assert "inside the solid of 'bush' by" in str(error)


def test_a_start_inside_an_obstacle_and_a_goal_in_one() -> None:
    wall = thing("wall", at(0.005, 0, 0.1), feature("brick", "+", at(0), Box((0.01, 0.01, 0.1)), None))
    assert "inside the solid of 'wall'" in str(refused(cell(*above().objects, wall), IN_BUSH))
    lid = thing("lid", at(0, 0, 0.02), feature("brick", "+", at(0), Box((0.01, 0.01, 0.01)), None))
    error = refused(cell(*above().objects, lid), IN_BUSH)
    assert (error.rule, error.feature) == (CLEAR, "peg.shaft")
    assert "'lid', which takes no part in the task" in str(error)


@pytest.mark.parametrize(
    ("goal", "pair", "rule", "words"),
    [
        ((0.001, 0, -0.02, 0, 0, 0), "cylindrical", ON_AXIS, "p_x = 1 mm, which the cylindrical pair holds at 0"),
        ((0, 0, -0.02, 0, 0.01, 0), "prismatic", ON_AXIS, "q_y = 0.572958 deg, which the prismatic pair holds"),
        ((0, 0, 0.01, 0, 0, 0), "cylindrical", INSERTED, "10 mm outside the mouth"),
        ((0, 0, -0.031, 0, 0, 0), "cylindrical", INSERTED, "31 mm inside, where at most 30 mm can be"),
        ((0, 0, 0.02, 0, 0, 0), "planar", ON_AXIS, "p_z = 20 mm"),
        ((0, 0, FREE, 0, 0, FREE), "screw", SETTLED, "leaves q_z free, which the lead of the screw settles"),
        ((0, 0, math.nan, 0, 0, 0), "cylindrical", SETTLED, "not finite"),
    ],
)
def test_goals_that_break_a_rule(goal: Goal, pair: LowerPair, rule: str, words: str) -> None:
    error = refused(above(), task("peg.shaft", "bush.bore", goal, pair))
    assert (error.rule, error.feature) == (rule, "peg.shaft")
    assert words in str(error)


def test_a_through_hole_may_be_passed() -> None:
    base = cell(plate(at(0), 0.0102), peg(at(0, 0, 0.1)))
    assert answer(base, task("peg.shaft", "plate.hole", (0, 0, -0.05, 0, 0, 0))).PT[2] == -0.05
    assert refused(base, task("peg.shaft", "plate.hole", (0, 0, -0.051, 0, 0, 0))).rule == INSERTED


def test_a_peg_too_thick_interferes() -> None:
    base = cell(bush(at(0)), peg(at(0, 0, 0.06), 0.0112))
    with pytest.raises(InterferenceError, match=r"at the goal peg\.shaft overlaps 'bush' by 0\.9\d* mm") as caught:
        answer(base, IN_BUSH)
    assert caught.value.interference == pytest.approx(1e-3 * math.cos(math.pi / SIDES), rel=1e-6)


def test_operands_joined_by_other_links() -> None:
    links = (Link("attached", Ref("peg"), Ref("plate")), Link("attached", Ref("plate"), Ref("bush")))
    error = refused(cell(bush(at(0)), peg(at(0, 0, 0.06)), plate(at(1)), links=links), IN_BUSH)
    assert (error.rule, error.feature) == (APART, "peg.shaft")


def test_an_answer_is_completed_where_it_was_given() -> None:
    found = answer(above(), IN_BUSH)
    for name in ("peg", "bush"):
        with pytest.raises(TaskError, match="stands elsewhere than the answer has it") as caught:
            completed(above().moved([name], at(0, 0, 1e-6)), found)
        assert caught.value.rule == STALE
        assert caught.value.feature.startswith(name)


@pytest.mark.parametrize(
    ("links", "words"),
    [
        ((("attached", "peg", "pin"),), "no object 'pin'"),
        ((("attached", "peg", "bush.hole"),), "no feature 'hole'"),
        ((("attached", "peg", "peg.shaft"),), "joins an object to itself"),
        ((("attached", "peg", "bush"), ("screw", "bush", "peg")), "is there twice"),
    ],
)
def test_links_that_are_none(links: tuple[tuple[LinkKind, str, str], ...], words: str) -> None:
    with pytest.raises(TaskError, match=words):
        cell(*above().objects, links=tuple(Link(k, Ref(*a.split(".")), Ref(*b.split("."))) for k, a, b in links))


def test_the_graph_is_edited() -> None:
    base = above().connect(Link("screw", Ref("peg"), Ref("bush")))
    again = base.connect(Link("attached", Ref("bush"), Ref("peg")))
    assert [link.kind for link in again.links] == ["attached"]
    with pytest.raises(TaskError, match="two objects 'peg'"):
        cell(*above().objects, peg(at(1)))


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_specifications_are_positive(value: float) -> None:
    with pytest.raises(TaskError, match="the contact force is"):
        CommandLimits(0.02, value, 1.0)


def test_answers_and_errors_pickle() -> None:
    found = pickle.loads(pickle.dumps(answer(above(), IN_BUSH)))
    with pytest.raises(ValueError, match="read-only"):
        found.PT[0] = 1.0
    error = pickle.loads(pickle.dumps(refused(above(0.03), IN_BUSH)))
    assert (error.rule, error.feature, error.exit_code) == (START, "peg.shaft", 2)
