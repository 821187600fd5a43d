"""A problem as a task command: the workcell of its two parts and the five attributes, [LeeHuang1985] section 3."""

from __future__ import annotations

from dataclasses import replace
from os.path import normpath
from pathlib import Path

import numpy as np

from fmopt.errors import InputError
from fmopt.knowledge.command import Specification, Task
from fmopt.knowledge.goal import FREE, Goal
from fmopt.knowledge.tree import Feature, ObjectTree
from fmopt.knowledge.workcell import LowerPair, Ref, Workcell
from fmopt.se3 import Pose
from fmopt.task.model import load_model, overrides_of
from fmopt.task.problem import Problem
from fmopt.task.tables import Reading, factors
from fmopt.task.toml_source import Source, read
from fmopt.task.tree import build_tree

_TURNED = {"cylinder", "cone"}


def task_command(problem: Problem) -> tuple[Workcell, Task]:
    """The workcell of a problem at the start, its global reference frame in the mouth of the hole, and its task.

    A round peg makes a cylindrical pair and leaves its turn about the axis free; any other makes a prismatic one. The
    problem's files are read again for the trees of their solids.

    Raises:
        InputError: a file that has changed since and is no longer valid, or a feature that breaks a frame rule.
    """
    source = read(problem.path)
    moving, fixed = (_tree(source, side) for side in ("moving", "fixed"))
    if moving.name == fixed.name:
        moving, fixed = replace(moving, name=f"{moving.name}-moving"), replace(fixed, name=f"{fixed.name}-fixed")
    peg, hole = moving.feature(problem.moving_feature), fixed.feature(problem.fixed_feature)
    start = Pose.from_vector(problem.start)
    cell = Workcell((moving.at(start.compose(peg.frame.inverse())), fixed.at(hole.frame.inverse())))
    x, y, z, rx, ry, rz = (float(value) for value in problem.goal)
    pair: LowerPair = "cylindrical" if is_round(peg) else "prismatic"
    goal: Goal = (x, y, z, rx, ry, FREE if pair == "cylindrical" else rz)
    wanted = problem.specification
    specification = Specification(wanted.speed, wanted.contact_force, wanted.torque_limit)
    return cell, Task(Ref(moving.name, peg.name), Ref(fixed.name, hole.name), goal, pair, specification)


def is_round(feature: Feature) -> bool:
    """Whether every instance of a feature is a solid of revolution about the feature's z axis."""
    into = feature.frame.inverse()
    for leaf in feature.instances:
        own = into.compose(leaf.pose)
        beside, leaning = np.hypot(*own.p[:2]) > 1e-9, np.hypot(*own.R[:2, 2]) > 1e-9
        if beside or not (leaf.key == "sphere" or (leaf.key in _TURNED and not leaning)):
            return False
    return True


def _tree(source: Source, side: str) -> ObjectTree:
    reading = Reading(factors(source.data.get("units")))
    overrides, faults = overrides_of(source, reading, (side, "parameters"))
    path = Path(normpath(source.path.parent / source.data[side]["model"]))
    model, more = load_model(path, source.place((side, "model")), overrides)
    if model is None or faults:
        raise InputError(*faults, *more)
    return build_tree(model.source, model.file)
