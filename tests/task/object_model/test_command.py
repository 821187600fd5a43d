"""Task commands: answers in every frame, operands, exchanged operands, assemblies in two steps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fmopt.geometry.csg import Box, Moved
from fmopt.papers.lee_huang.hand_position_force import grasped_twist, grasped_wrench, hand_pose, world_pose
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.object_model.command import Answer, answer, completed, grasped_pose
from fmopt.task.object_model.goal import FREE
from fmopt.task.object_model.tree import ObjectTree
from fmopt.task.object_model.workcell import Link, Ref
from tests.shared.parts.workcells import IN_BUSH, above, at, bush, cell, close, feature, peg, plate, task, thing
from tests.shared.solids import contains

SOMEWHERE = [Pose.identity(), at(0.3, -0.7, 1.1, (0.5, -1.0, 0.8)), at(-2.0, 0.1, 0.0, (math.pi, 0.0, 0.0))]


@pytest.mark.parametrize("world", SOMEWHERE)
def test_an_answer_does_not_depend_on_where_the_workcell_is(world: Pose) -> None:
    base = above(turn=0.3)
    found = answer(base.moved(["bush", "peg"], world), IN_BUSH)
    np.testing.assert_allclose(found.P0, [0.005, 0, 0.02, 0, 0, 0.3], atol=1e-12)
    np.testing.assert_allclose(found.PT, [0, 0, -0.03, 0, 0, 0.3], atol=1e-12)
    assert close(found.fixed.frame, world.compose(at(0, 0, 0.04)))
    assert close(found.moving.frame, world.compose(at(0.005, 0, 0.06, (0, 0, 0.3))))
    assert not found.exchanged


@pytest.mark.parametrize("seed", range(4))
def test_an_answer_does_not_depend_on_where_the_frames_of_the_objects_are(seed: int) -> None:
    """The same solids and features, described in other object frames."""
    random = np.random.default_rng(seed)

    def redescribed(tree: ObjectTree) -> ObjectTree:
        move = Pose(random.uniform(-1, 1, 3), exp(random.normal(size=3)))
        features = tuple(replace(f, frame=move.compose(f.frame), body=Moved(f.body, move)) for f in tree.features)
        return thing(tree.name, tree.frame.compose(move.inverse()), *features)

    usual = answer(above(turn=0.3), IN_BUSH)
    found = answer(cell(*(redescribed(tree) for tree in above(turn=0.3).objects)), IN_BUSH)
    np.testing.assert_allclose(found.P0, usual.P0, atol=1e-12)
    np.testing.assert_allclose(found.PT, usual.PT, atol=1e-12)
    points = random.uniform(-0.05, 0.05, (300, 3))
    for one, other in ((found.moving, usual.moving), (found.fixed, usual.fixed)):
        np.testing.assert_array_equal(contains(one.solid, points), contains(other.solid, points))
        np.testing.assert_array_equal(contains(one.whole, points), contains(other.whole, points))


def test_operands_are_the_feature_and_its_direct_neighbours() -> None:
    found = answer(cell(plate(at(0)), bush(at(0, 0, 0.1))), task("bush.shank", "plate.hole"))
    assert found.fixed.members == (Ref("plate", "hole"), Ref("plate", "block"))
    assert found.moving.members == (Ref("bush", "shank"),)
    aside = np.array([[0.042, 0.042, -0.01]])
    assert contains(found.fixed.solid, aside).tolist() == [True]
    assert contains(found.fixed.whole, aside).tolist() == [False]
    in_bore = np.array([[0.0, 0.0, 0.035]])
    assert contains(found.moving.solid, in_bore).tolist() == [True]
    assert contains(found.moving.whole, in_bore).tolist() == [False]


def test_operands_reach_across_links() -> None:
    link = Link("cylindrical", Ref("bush", "shank"), Ref("plate", "hole"))
    glued = cell(plate(at(0)), bush(at(0)), links=(link,)).connect(Link("attached", Ref("plate"), Ref("bush")))
    assert set(glued.operand(Ref("plate", "aside"))) >= {Ref("bush", "shank"), Ref("bush", "bore")}


def test_a_two_step_assembly() -> None:
    """The bush goes into the plate, the peg into the bush, then plate and all are put elsewhere."""
    base = cell(plate(at(0)), bush(at(0.2, 0, 0.1)), peg(at(0, 0.3, 0.1)))
    first = answer(base, task("bush.shank", "plate.hole"))
    assert [other.name for other in first.obstacles] == ["peg"]
    after = completed(base, first)
    assert after.links == (Link("cylindrical", Ref("bush", "shank"), Ref("plate", "hole")),)
    assert close(after.object("bush").frame, at(0))
    assert close(after.object("peg").frame, base.object("peg").frame)

    second = answer(after, task("peg.shaft", "bush.bore"))
    assert [str(ref) for ref in second.fixed.members] == ["bush.bore", "bush.shank", "plate.hole", "plate.block"]
    assert not second.obstacles
    beside = np.array([[0.04, 0.0, -0.02]])
    assert contains(second.fixed.solid, beside).tolist() == [True]
    done = completed(after, second)
    assert close(done.frame(Ref("peg", "shaft")), at(0, 0, 0.01))
    assert (done.group("plate"), len(done.links)) == (("plate", "bush", "peg"), 2)

    floor = thing("floor", at(0, 0, -1), feature("top", "+", at(0, 0, 0.1), Box((4, 4, 0.1)), None))
    lifted = cell(*done.moved(done.group("peg"), at(0, 0, 0.5)).objects, floor)
    assert close(lifted.frame(Ref("bush", "bore")), at(0, 0, 0.54))
    assert close(lifted.object("floor").frame, at(0, 0, -1))


def test_what_is_attached_is_carried() -> None:
    """A peg in a bush goes along when the bush is put into the plate."""
    link = Link("cylindrical", Ref("peg", "shaft"), Ref("bush", "bore"))
    base = cell(plate(at(0)), bush(at(0.2, 0, 0.1)), peg(at(0.2, 0, 0.11)), links=(link,))
    found = answer(base, task("bush.shank", "plate.hole"))
    assert found.carried == ("bush", "peg")
    assert contains(found.moving.whole, [[0.0, 0.0, 0.055]]).tolist() == [True]
    after = completed(base, found)
    assert close(after.frame(Ref("peg", "shaft")), at(0, 0, 0.01))
    assert set(after.links) == {link, Link("cylindrical", Ref("bush", "shank"), Ref("plate", "hole"))}


def test_a_pair_is_moved_along_again() -> None:
    """A peg that is half in goes deeper: its own link to the bush does not carry the bush along."""
    half = completed(above(), answer(above(), task("peg.shaft", "bush.bore", (0, 0, -0.01, 0, 0, 0))))
    found = answer(half, task("peg.shaft", "bush.bore", (0, 0, -0.02, 0, 0, 0)))
    np.testing.assert_allclose(found.P0, [0, 0, -0.01, 0, 0, 0], atol=1e-15)
    assert found.carried == ("peg",)
    assert len(completed(half, found).links) == 1


@pytest.mark.parametrize("seed", range(3))
def test_a_grasped_hole_is_exchanged_for_a_grasped_peg(seed: int) -> None:
    """Moving the bush over the fixed peg is the inverse of moving the peg into the fixed bush."""
    random = np.random.default_rng(seed)
    world = Pose(random.normal(size=3), exp(random.normal(size=3)))
    base = cell(bush(at(0, 0, 0.2, (0.1, 0.2, 0.3))), peg(at(0, 0, 0, (0, 0, 0.5))), plate(at(1)))
    base = base.moved([tree.name for tree in base.objects], world)
    grasp = Pose(random.normal(size=3), exp(random.normal(size=3)))
    over = task("bush.bore", "peg.shaft", (0.0, 0.0, FREE, 0.0, 0.0, 0.25), grasp=grasp)
    found, usual = answer(base, over), answer(base, task("peg.shaft", "bush.bore", (0, 0, FREE, 0, 0, -0.25)))
    assert found.exchanged
    assert not usual.exchanged
    assert [str(one) for one in found.settled] == ["p_z is free: 30 mm, at full depth"]
    assert (found.moving.ref, found.fixed.ref) == (Ref("peg", "shaft"), Ref("bush", "bore"))
    np.testing.assert_allclose(found.P0, usual.P0, atol=1e-12)
    np.testing.assert_allclose(found.PT, usual.PT, atol=1e-12)

    assert close(world_pose(found, found.P0), base.frame(Ref("bush", "bore")))
    assert close(world_pose(usual, usual.P0), base.frame(Ref("peg", "shaft")))
    assert close(hand_pose(found, found.P0).compose(grasp), base.frame(Ref("bush", "bore")))
    after, as_usual = completed(base, found), completed(base, usual)
    assert close(after.object("peg").frame, base.object("peg").frame)
    assert close(after.frame(Ref("bush", "bore")), world_pose(found, found.PT))
    assert close(as_usual.object("bush").frame, base.object("bush").frame)
    for cellar in (after, as_usual):
        seated = cellar.frame(Ref("bush", "bore")).inverse().compose(cellar.frame(Ref("peg", "shaft")))
        np.testing.assert_allclose(seated.vector(), [0, 0, -0.03, 0, 0, -0.25], atol=1e-12)


def test_obstacles_of_an_exchanged_task_stand_in_the_frame_of_the_fixed_peg() -> None:
    base = cell(bush(at(0, 0, 0.2)), peg(at(0)), plate(at(1)))
    found = answer(base, task("bush.bore", "peg.shaft", (0, 0, FREE, 0, 0, 0)))
    (other,) = found.obstacles
    assert contains(other.solid, [[1.04, 0.0, 0.02]]).tolist() == [True]


def exchanged_answer() -> Answer:
    base = cell(bush(at(0.01, 0.02, 0.2, (0.1, 0.2, 0.3))), peg(at(0, 0, 0, (0, 0, 0.5))))
    return answer(base, task("bush.bore", "peg.shaft"))


@pytest.mark.parametrize("seed", range(5))
def test_motion_and_wrench_are_mapped_back_together(seed: int) -> None:
    """Virtual work: the counterpart's power is the task's. The twist is the derivative of the pose."""
    found, random = exchanged_answer(), np.random.default_rng(seed)
    X, V, F = random.normal(size=6), random.normal(size=6), random.normal(size=6)
    twist, wrench = grasped_twist(found, X, V), grasped_wrench(found, X, F)
    assert twist @ wrench == pytest.approx(V @ F, rel=1e-12)
    step = 1e-6
    there, back = (grasped_pose(found, Pose.from_vector(X).moved(s * step * V).vector()) for s in (1.0, -1.0))
    np.testing.assert_allclose(twist, back.local(there) / (2.0 * step), atol=1e-8)
    same = answer(above(), IN_BUSH)
    np.testing.assert_array_equal(grasped_twist(same, X, V), V)
    np.testing.assert_array_equal(grasped_wrench(same, X, F), F)


def test_a_face_may_be_put_on_a_face() -> None:
    """A planar pair needs no hole: z of the base frame points out of the face, and where the part slides is free."""
    top = feature("top", "+", at(0, 0, 0.02, (math.pi, 0, 0)), Box((1, 1, 0.02)), 0.02)
    base = cell(thing("table", at(0), top), peg(at(0.1, 0.2, 0.1, (0.0, 0.0, 0.7))))
    found = answer(base, task("peg.shaft", "table.top", (FREE, FREE, FREE, FREE, FREE, FREE), "planar"))
    assert not found.exchanged
    after = completed(base, found)
    assert close(after.object("peg").frame, at(0.1, 0.2, 0.02, (0.0, 0.0, 0.7)))
