"""A problem as a task command: the workcell of its two parts and the five attributes, [LeeHuang1985] section 3."""

from dataclasses import replace

import numpy as np

from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import remembered
from fmopt.task.object_model.command import Answer, CommandLimits, Task, answer
from fmopt.task.object_model.goal import FREE, Entry, settle
from fmopt.task.object_model.tree import ObjectTree, TreeFeature
from fmopt.task.object_model.workcell import LowerPair, Ref, Workcell
from fmopt.task.problem import Attributes, Problem
from fmopt.task.toml.problem_file import Goal

_TURNED = {"cylinder", "cone"}
_FREE_TURN: frozenset[LowerPair] = frozenset({"cylindrical", "revolute"})


@remembered(1)
def problem_answer(problem: Problem) -> Answer:
    """The answer of the knowledge base to the task of a problem; errors as of `answer`."""
    parts = problem.moving, problem.fixed
    known = () if any(part.balls for part in parts) else [part.pieces for part in parts]
    return answer(*task_command(problem), known)


def task_command(problem: Problem) -> tuple[Workcell, Task]:
    """The workcell of a problem at the start, its global reference frame in the feature that stays, and its task.

    The peg's feature has its mating frame, turned so that the goal's orientation is that of the hole.
    """
    moving, fixed = problem.trees
    if moving.name == fixed.name:  # both may be of one model
        moving, fixed = replace(moving, name=f"{moving.name}-moving"), replace(fixed, name=f"{fixed.name}-fixed")
    moving = _turned(moving, problem.moving_feature, problem.task.turn)
    peg, hole = moving.feature(problem.moving_feature), fixed.feature(problem.fixed_feature)
    start, exchanged = Pose.from_vector(problem.start), problem.task.exchanged
    base = start.inverse() if exchanged else Pose.identity()
    at_peg, at_hole = base.compose(start).compose(peg.frame.inverse()), base.compose(hole.frame.inverse())
    refs = Ref(moving.name, peg.name), Ref(fixed.name, hole.name)
    # Where the peg stands it is the hole that moves, by the inverse pose.
    depth = -float(problem.goal[2]) if exchanged else float(problem.goal[2])
    z: Entry = FREE if problem.task.free_depth else depth
    turn: Entry = FREE if problem.task.free_turn else 0.0
    wanted = problem.specification
    specification = CommandLimits(wanted.speed, wanted.contact_force, wanted.torque_limit)
    one, other = reversed(refs) if exchanged else refs
    task = Task(one, other, (0.0, 0.0, z, 0.0, 0.0, turn), problem.task.attachment, specification, problem.task.grasp)
    return Workcell((moving.at(at_peg), fixed.at(at_hole))), task


def attributes(goal: Goal, round_peg: bool, start: Pose, exchanged: bool, grasp: Pose) -> Attributes:
    """The attributes of a task, its pair chosen and its angle about the axis settled where the file leaves them open.

    A round peg makes a cylindrical pair and any other a prismatic one, unless the file says what it makes. A pair that
    turns about its axis leaves the angle of a round peg free, which is then as the start has it.

    With the hole in the hand the file's angle is that of the hole against the peg. The start is that of the peg's
    feature in the frame of the hole.

    Raises:
        TaskError: a free angle that the start does not settle.
    """
    pair: LowerPair = goal.attachment or ("cylindrical" if round_peg else "prismatic")
    free = goal.turn is None if "turn" in goal.model_fields_set else round_peg and pair in _FREE_TURN
    angle = goal.turn or 0.0
    turn = -angle if exchanged else angle
    if free:
        values, _ = settle((0.0, 0.0, 0.0, 0.0, 0.0, FREE), start, pair, 0.0, "the goal")
        turn = float(values[5])
    return Attributes(pair, exchanged, grasp, turn, goal.depth is None, free)


def is_round(feature: TreeFeature) -> bool:
    """Whether every instance of a feature is a solid of revolution about the feature's z axis."""
    into = feature.frame.inverse()
    for leaf in feature.instances:
        own = into.compose(leaf.pose)
        beside, leaning = np.hypot(*own.p[:2]) > 1e-9, np.hypot(*own.R[:2, 2]) > 1e-9  # m, and the sine of an angle
        if beside or not (leaf.key == "sphere" or (leaf.key in _TURNED and not leaning)):
            return False
    return True


def _turned(tree: ObjectTree, name: str, turn: float) -> ObjectTree:
    """The tree with the frame of a feature turned about its z axis by −`turn`, rad."""
    if turn == 0.0:
        return tree
    own = Pose(np.zeros(3), exp([0.0, 0.0, -turn]))

    def put(feature: TreeFeature) -> TreeFeature:
        return replace(feature, frame=feature.frame.compose(own)) if feature.name == name else feature

    classes = (replace(group, features=tuple(map(put, group.features))) for group in tree.classes)
    return replace(tree, classes=tuple(classes))
