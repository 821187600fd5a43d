"""A plate, a bush and a peg, and workcells and tasks of them, for the tests of the knowledge base."""

import numpy as np

from fmopt.geometry.csg import Box, Cylinder, Moved, Solid
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.object_model.command import CommandLimits, Task
from fmopt.task.object_model.goal import FREE, Goal
from fmopt.task.object_model.tree import FeatureClass, ObjectTree, TreeFeature
from fmopt.task.object_model.workcell import Link, LowerPair, Ref, Workcell

SIDES = 12
SPECIFICATION = CommandLimits(0.02, 10.0, 1.0)
DOWN: Goal = (0.0, 0.0, FREE, 0.0, 0.0, FREE)


def at(x: float, y: float = 0.0, z: float = 0.0, r: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pose:
    return Pose(np.array([x, y, z]), exp(r))


def thing(name: str, frame: Pose, *features: TreeFeature) -> ObjectTree:
    return ObjectTree(name, frame, (FeatureClass("features", features),))


def feature(name: str, sign: str, frame: Pose, body: Solid, length: float | None, through: bool = False) -> TreeFeature:
    return TreeFeature(name, "+" if sign == "+" else "-", frame, body, length, through)


def round_hole(radius: float, z: float, depth: float) -> Solid:
    return Moved(Cylinder(radius, depth + 0.01, SIDES), at(0, 0, z - depth))


def plate(frame: Pose, radius: float = 0.0302) -> ObjectTree:
    """A plate 40 mm high, 100 mm wide, with a through hole, and with a pin hole aside that touches no other hole."""
    return thing(
        "plate",
        frame,
        feature("block", "+", at(0), Box((0.1, 0.1, 0.04)), None),
        feature("hole", "-", at(0, 0, 0.04), Moved(Cylinder(radius, 0.06, SIDES), at(0, 0, -0.01)), 0.04, True),
        feature("aside", "-", at(0.042, 0.042, 0.04), Moved(round_hole(0.003, 0.04, 0.03), at(0.042, 0.042)), 0.03),
    )


def bush(frame: Pose) -> ObjectTree:
    """A bush 40 mm long, 60 mm wide outside, with a blind bore of 20.4 mm, 30 mm deep."""
    bore = feature("bore", "-", at(0, 0, 0.04), round_hole(0.0102, 0.04, 0.03), 0.03)
    return thing("bush", frame, feature("shank", "+", at(0), Cylinder(0.03, 0.04, SIDES), 0.04), bore)


def peg(frame: Pose, radius: float = 0.01) -> ObjectTree:
    """A peg 50 mm long with a flange on top, and a ring groove's worth of a hollow beside its flange."""
    return thing(
        "peg",
        frame,
        feature("shaft", "+", at(0), Cylinder(radius, 0.05, SIDES), 0.05),
        feature("flange", "+", at(0, 0, 0.05), Moved(Box((0.03, 0.03, 0.01)), at(0, 0, 0.05)), None),
        feature("socket", "-", at(0, 0, 0.06), Moved(Box((0.008, 0.008, 0.02)), at(0, 0, 0.052)), 0.008),
    )


def cell(*objects: ObjectTree, links: tuple[Link, ...] = ()) -> Workcell:
    return Workcell(objects, links)


def task(
    moving: str, fixed: str, goal: Goal = DOWN, pair: LowerPair = "cylindrical", grasp: Pose | None = None
) -> Task:
    return Task(Ref(*moving.split(".")), Ref(*fixed.split(".")), goal, pair, SPECIFICATION, grasp or Pose.identity())


def above(z: float = 0.06, turn: float = 0.0) -> Workcell:
    return cell(bush(at(0)), peg(at(0.005, 0.0, z, (0.0, 0.0, turn))))


IN_BUSH = task("peg.shaft", "bush.bore")


def close(one: Pose, other: Pose, tolerance: float = 1e-12) -> bool:
    return bool(np.max(np.abs(one.local(other))) <= tolerance)
