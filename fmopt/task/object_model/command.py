"""Task commands and their answers, [LeeHuang1985] sections 3 and 4.1.

A task is its five attributes. The T-C mapping assumes that the operand with the solid feature is grasped and the one
with the hollow feature fixed. A task the other way round is exchanged for its counterpart: the fixed peg moves in the
frame of the grasped hole, by the inverse motion; `papers.lee_huang.hand_position_force` maps results back.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from fmopt.errors import InterferenceError, TaskError
from fmopt.geometry.clearance import deepest
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Solid, sagitta
from fmopt.geometry.polyhedron import Polyhedron, placed
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value
from fmopt.task.object_model.goal import Goal, Settled, check_goal, settle
from fmopt.task.object_model.tree import TreeFeature, moved
from fmopt.task.object_model.workcell import EXIST, AnswerSide, Link, LowerPair, Ref, Workcell, operand_of

KINDS = "an insertion has one solid and one hollow feature"
APART = "the operands are joined by nothing but the pair between them"
START = "the start is free of overlap"
CLEAR = "the goal is free of other objects"
STALE = "a task is completed in the workcell that answered it"
_TOUCH = 1e-9  # m
_FACING = Pose(np.zeros(3), np.diag([1.0, -1.0, -1.0]))


@dataclass(frozen=True)
class CommandLimits:
    """The miscellaneous attribute: greatest speed (m/s), contact force (N), greatest torque (N·m).

    Raises:
        TaskError: one that is not positive.
    """

    speed: float
    contact_force: float
    torque_limit: float

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            name = key.replace("_", " ")
            if not (math.isfinite(value) and value > 0.0):
                raise TaskError(f"the {name} is {value}", name, "specifications are positive", "make it positive")


@dataclass(frozen=True, eq=False)
class Task(Value):
    """A task command by its five attributes.

    Args:
        goal: pose of the moving feature's frame in the `base_frame`, m and rad, entries may be "free".
        grasp: pose of the moving feature's frame in the hand's frame, H_ho.
    """

    moving: Ref
    fixed: Ref
    goal: Goal
    attachment: LowerPair
    specification: CommandLimits
    grasp: Pose = field(default_factory=Pose.identity)


@dataclass(frozen=True, eq=False)
class Obstacle(Value):
    """An object that takes no part in the task, in the frame of the feature that stays.

    This is the B-frame unless the operands were exchanged. If they were, the obstacle moves with operand 1.
    """

    name: str
    solid: Solid


@dataclass(frozen=True, eq=False)
class Answer(Value, P0=(6,), PT=(6,)):
    """What the knowledge base says of a task, its operands `exchanged` where that fits the assumptions.

    Args:
        moving: operand 1, with the solid feature.
        fixed: operand 2, with the hollow feature; its feature's frame is the B-frame.
        P0, PT: poses (6,) of operand 1's feature frame in the B-frame at the start and at the goal, m and rad.
    """

    task: Task
    exchanged: bool
    moving: AnswerSide
    fixed: AnswerSide
    P0: Array
    PT: Array
    settled: tuple[Settled, ...]
    obstacles: tuple[Obstacle, ...]
    carried: tuple[str, ...]


def answer(workcell: Workcell, task: Task, known: Sequence[Sequence[Polyhedron]] = ()) -> Answer:
    """The data of a task for the T-PF mapping.

    Where the convex pieces of operands 1 and 2 are `known`, in their features' frames, they are not cut again.

    Raises:
        TaskError: a missing operand, a frame that breaks a rule, kinds of features that do not mate, a goal off the
            axis or outside the hole, a start inside a solid. With the feature and the rule.
        InterferenceError: the parts overlap at the goal.
    """
    one, other = _feature(workcell, task.moving), _feature(workcell, task.fixed)
    exchanged = _is_exchanged(task, one, other)
    # Links between the operands do not count: a pair that is there already may be moved along.
    carried = workcell.group(task.moving.object, task.fixed.object)
    standing = workcell.group(task.fixed.object, task.moving.object)
    if task.fixed.object in carried:
        message = f"{task.moving} is to move against {task.fixed}, and other links join the two"
        raise TaskError(message, str(task.moving), APART, "disconnect them, or name another feature")
    frame, base = workcell.frame(task.moving), base_frame(workcell, task)
    start = base.inverse().compose(frame)
    goal, settled = _goal(task, one, other, start, exchanged)
    moving = operand_of(workcell, task.moving, carried, frame)
    fixed = operand_of(workcell, task.fixed, standing, base)
    if exchanged:
        moving, fixed, start, goal = fixed, moving, start.inverse(), goal.inverse()
    inward = base.inverse()
    others = (tree for tree in workcell.objects if tree.name not in (*carried, *standing))
    obstacles = tuple(Obstacle(tree.name, moved(tree.solid, inward.compose(tree.frame))) for tree in others)
    found = Answer(task, exchanged, moving, fixed, start.vector(), goal.vector(), settled, obstacles, carried)
    _check_ends(workcell, found, (*carried, *standing), known or [pieces(side.whole) for side in (moving, fixed)])
    return found


def base_frame(workcell: Workcell, task: Task) -> Pose:
    """The frame, in the global reference frame, that the goal of a task is given in: that of the feature that stays.

    Where a solid feature is put on a solid one, z of that frame would point into the material. It is turned about x by
    180°, so that z points out of it as out of a mouth.
    """
    (_, one), (_, other) = workcell.resolve(task.moving), workcell.resolve(task.fixed)
    facing = one is not None and other is not None and not one.hollow and not other.hollow
    return workcell.frame(task.fixed).compose(_FACING) if facing else workcell.frame(task.fixed)


def completed(workcell: Workcell, found: Answer) -> Workcell:
    """The workcell after the task: the grasped object and what it carries moved, the attachment recorded.

    Raises:
        TaskError: the operands are not where the answer has them.
    """
    task = found.task
    before = workcell.frame(task.moving)
    base = base_frame(workcell, task)
    stood = base.compose(grasped_pose(found, found.P0))
    for ref, frame, known in ((task.fixed, base, _given(found).frame), (task.moving, before, stood)):
        if np.max(np.abs(known.local(frame))) > _TOUCH:
            message = f"{ref} stands elsewhere than the answer has it, {known.vector()} in the global frame"
            raise TaskError(message, str(ref), STALE, "ask again")
    move = base.compose(grasped_pose(found, found.PT)).compose(before.inverse())
    return workcell.moved(found.carried, move).connect(Link(task.attachment, task.moving, task.fixed))


def grasped_pose(found: Answer, P: ArrayLike) -> Pose:
    """Pose of the grasped feature in the frame of the one that stays, of P (6,) in m and rad, as the task was given."""
    pose = Pose.from_vector(P)
    return pose.inverse() if found.exchanged else pose


def _given(found: Answer) -> AnswerSide:
    """The operand that stays, as the task was given."""
    return found.moving if found.exchanged else found.fixed


def _feature(workcell: Workcell, ref: Ref) -> TreeFeature:
    tree, feature = workcell.resolve(ref)
    if feature is None:
        named = ", ".join(feature.name for feature in tree.features if feature.length is not None) or "none"
        message = f"the task names the object {ref.object!r} without a feature"
        raise TaskError(message, ref.object, EXIST, f"features that can be operands: {named}")
    if feature.length is None:
        message = f"the feature {feature.name!r} of {tree.name!r} has no length and no mating frame"
        raise TaskError(message, feature.name, EXIST, "give it a length, and a frame in its mouth or leading end")
    return feature


def _is_exchanged(task: Task, one: TreeFeature, other: TreeFeature) -> bool:
    """Whether the hollow part is grasped and the solid one fixed."""
    if task.moving.object == task.fixed.object:
        message = f"both operands belong to {task.moving.object!r}"
        raise TaskError(message, str(task.moving), EXIST, "name features of two objects")
    # Of two alike only solid ones join, a face put on a face.
    if one.hollow == other.hollow and (one.hollow or task.attachment != "planar"):
        message = f"{task.moving} and {task.fixed} are both {'hollow' if one.hollow else 'solid'}"
        raise TaskError(message, str(task.moving), KINDS, "name the peg of one object and the hole of the other")
    return one.hollow


def _goal(
    task: Task, one: TreeFeature, other: TreeFeature, start: Pose, exchanged: bool
) -> tuple[Pose, tuple[Settled, ...]]:
    peg, hole = (other, one) if exchanged else (one, other)
    reach = peg.length or 0.0
    full = min(reach, hole.length or 0.0)
    sign = 1.0 if exchanged else -1.0
    values, settled = settle(task.goal, start, task.attachment, sign * full, str(task.moving))
    # Out of an open hole the peg may come at its far end, as far as it is long.
    check_goal(values, task.attachment, reach if hole.through else full, sign, str(task.moving))
    return Pose.from_vector(values), settled


def _check_ends(workcell: Workcell, found: Answer, sides: Sequence[str], both: Sequence[Sequence[Polyhedron]]) -> None:
    """At the start and at the goal what is grasped and carried overlaps nothing of what stands."""
    body, standing = reversed(both) if found.exchanged else both
    obstacles = [(other.name, pieces(other.solid)) for other in found.obstacles]
    for P, at_goal in ((found.P0, False), (found.PT, True)):
        pose = grasped_pose(found, P)
        bodies = [placed(piece, pose) for piece in body]
        for name, still in [(_given(found).ref.object, standing), *obstacles]:
            depth = deepest(bodies, still)
            # Round holes are narrower as polygons than they are: by so much a peg may overlap.
            holes = (f for one in (*sides, name) for f in workcell.object(one).features if f.hollow)
            if depth > _TOUCH + max((sagitta(hole.body) for hole in holes), default=0.0):
                _refuse(found.task, name, depth, at_goal)


def _refuse(task: Task, name: str, depth: float, at_goal: bool) -> None:
    amount = f"{1e3 * depth:.4g} mm"
    if not at_goal:
        message = f"at the start {task.moving} is inside the solid of {name!r} by {amount}"
        raise TaskError(message, str(task.moving), START, "start outside, and check the frames of both objects")
    if name == task.fixed.object:
        message = f"at the goal {task.moving} overlaps {name!r} by {amount}"
        advice = "seat it less deep, or make the peg thinner or the hole wider"
        raise InterferenceError(message, depth, f"{task.fixed} of {name!r}", advice)
    message = f"at the goal {task.moving} overlaps {name!r}, which takes no part in the task, by {amount}"
    raise TaskError(message, str(task.moving), CLEAR, "move that object away, or connect it to the one that it is on")
