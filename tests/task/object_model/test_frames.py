"""The frame rules of the knowledge base: what is on a central line, what has a mouth, wherever the object is turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapely import points as shapely_points

from fmopt.errors import TaskError
from fmopt.geometry.csg import Box, Cone, Cylinder, Difference, Placed, Prism, Solid, Union, Wedge
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.object_model.frames import CENTRAL, INSIDE, MOUTH, across, check_frame, clipped, length, on_axis
from fmopt.task.object_model.tree import Feature, FeatureClass, ObjectTree, chain_of, moved
from tests.shared.solids import contains

FLIP = np.diag([1.0, -1.0, -1.0])


def at(x: float, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose(np.array([x, y, z]), np.eye(3))


def drilled(tool: Solid, frame: Pose, depth: float, *, block: Solid | None = None) -> tuple[ObjectTree, Feature]:
    hole = Feature("hole", "-", frame, tool, depth)
    return with_feature(block or Box((0.06, 0.06, 0.04)), hole), hole


def with_feature(block: Solid, *features: Feature) -> ObjectTree:
    base = [Feature(term.name, term.sign, at(0), term.body) for term in chain_of(block, "block")]
    return ObjectTree("object", at(0), (FeatureClass("bodies", tuple(base)), FeatureClass("mating", features)))


def shaft(body: Solid, x: float = 0.0, y: float = 0.0) -> tuple[ObjectTree, Feature]:
    peg = Feature("peg", "+", at(x, y), body, 0.03)
    return ObjectTree("object", at(0), (FeatureClass("pegs", (peg,)),)), peg


def turned(tree: ObjectTree, feature: Feature, pose: Pose) -> tuple[ObjectTree, Feature]:
    """The same object described in another frame of its own."""

    def move(one: Feature) -> Feature:
        return replace(one, frame=pose.compose(one.frame), body=moved(one.body, pose))

    classes = tuple(replace(group, features=tuple(map(move, group.features))) for group in tree.classes)
    return replace(tree, classes=classes), move(feature)


ARM = Placed(Box((0.08, 0.06, 0.01)), at(0, 0, 0.19))
SLOT = Placed(Box((0.012, 0.08, 0.02)), at(0, 0, 0.03))
WELL = Placed(Cylinder(0.01, 0.04, 24), at(0, 0, 0.02))
FLAT = Difference(Cylinder(0.01, 0.03, 32), (Placed(Box((0.01, 0.04, 0.05)), at(0.012, 0, -0.01)),))
KEYED = Union((Cylinder(0.01, 0.03, 32), Placed(Box((0.006, 0.004, 0.03)), at(0.01))))
BORE = Feature("bore", "-", at(0, 0, 0.03), Placed(Cylinder(0.006, 0.05, 32), at(0, 0, -0.01)), 0.03, through=True)
OUTSIDE = Feature("peg", "+", at(0), Cylinder(0.01, 0.03, 32), 0.03)
TRIANGLE = Prism(((0.01, 0.0), (-0.005, 0.0075), (-0.005, -0.0075)), 0.03)

RIGHT = {
    "blind": drilled(WELL, at(0, 0, 0.04), 0.02),
    "tool flush with the mouth": drilled(Placed(Cylinder(0.01, 0.02, 24), at(0, 0, 0.02)), at(0, 0, 0.04), 0.02),
    "frame below the mouth": drilled(WELL, at(0, 0, 0.035), 0.015),
    "slot": drilled(SLOT, at(0, 0, 0.04), 0.01),
    "under an arm": drilled(
        WELL,
        at(0, 0, 0.04),
        0.02,
        block=Union(
            (
                Box((0.06, 0.06, 0.04)),
                Placed(Box((0.01, 0.06, 0.2)), at(0.035)),
                ARM,
            )
        ),
    ),
    "shaft": shaft(Cylinder(0.01, 0.03, 24)),
    "shaft with a flat": shaft(FLAT),
    "shaft with a key": shaft(KEYED),
    "tube": (ObjectTree("tube", at(0), (FeatureClass("all", (OUTSIDE, BORE)),)), OUTSIDE),
    "cone": shaft(Cone(0.01, 0.004, 0.03, 24)),
    "odd prism": shaft(TRIANGLE),
    "rectangle": shaft(Box((0.02, 0.01, 0.03))),
}
PLUG = Feature("plug", "+", at(0), Placed(Box((0.03, 0.03, 0.01)), at(0, 0, 0.035)))
PLUGGED = Feature("hole", "-", at(0, 0, 0.03), WELL, 0.01)
CAVITY = drilled(Placed(Box((0.02, 0.02, 0.02)), at(0, 0, 0.01)), at(0, 0, 0.03), 0.02)
TUNNEL = drilled(Placed(Box((0.1, 0.01, 0.01)), at(0, 0, 0.01)), at(0, 0, 0.02), 0.01)
WRONG = {
    "off": (drilled(WELL, at(0.0001, 0, 0.04), 0.02), CENTRAL, r"centroid at \(-0.1, "),
    "off the slot": (drilled(SLOT, at(0.001, 0, 0.04), 0.01), CENTRAL, r"centroid at \(-1, \S+\) mm"),
    "off the shaft": (shaft(Cylinder(0.01, 0.03, 24), 0.001, 0.002), CENTRAL, r"centroid at \(-1, -2\) mm"),
    "off along the wide side": (shaft(Box((0.02, 0.01, 0.03)), 0.0003), CENTRAL, r"centroid at \(-0.3, 0\) mm"),
    "leaning": (shaft(Wedge((0.02, 0.02, 0.03), 0.01)), CENTRAL, "not on a central line"),
    "cavity": (CAVITY, MOUTH, "no mouth along its z axis, which meets material 0 mm above"),
    "tunnel": (TUNNEL, MOUTH, "no mouth along its z axis"),
    "mouth plugged": (
        (with_feature(Box((0.06, 0.06, 0.04)), PLUGGED, PLUG), PLUGGED),
        MOUTH,
        "meets material 5 mm above the origin",
    ),
    "too deep": (drilled(WELL, at(0, 0, 0.04), 0.025), INSIDE, "from z = -25 to -20 mm"),
    "upside down": (drilled(WELL, Pose(np.array([0, 0, 0.04]), FLIP), 0.02), MOUTH, "meets material 20 mm above"),
    "too long": (shaft(Cylinder(0.01, 0.02, 24)), INSIDE, "from z = 20 to 30 mm"),
}
SOMEWHERE = Pose(np.array([0.3, -0.2, 0.1]), exp([0.4, -1.1, 0.7]))


@pytest.mark.parametrize("name", RIGHT)
@pytest.mark.parametrize("pose", [at(0), SOMEWHERE], ids=["upright", "turned"])
def test_right_frames_pass_wherever_the_object_is_turned(name: str, pose: Pose) -> None:
    check_frame(*turned(*RIGHT[name], pose))


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("pose", [at(0), SOMEWHERE], ids=["upright", "turned"])
def test_wrong_frames_are_refused_by_rule_and_name(name: str, pose: Pose) -> None:
    (tree, feature), rule, words = WRONG[name]
    with pytest.raises(TaskError, match=words if pose.p[0] == 0.0 else None) as caught:
        check_frame(*turned(tree, feature, pose))
    assert (caught.value.rule, caught.value.feature) == (rule, feature.name)
    assert rule in str(caught.value)


def test_an_axis_of_the_frame_other_than_z_may_be_along_the_central_line() -> None:
    """A slot's central line runs along the slot: a frame anywhere on it will do."""
    slot = Placed(Box((0.012, 0.08, 0.02)), at(0, 0, 0.025))
    check_frame(*drilled(slot, at(0, 0.013, 0.035), 0.01))


def test_a_feature_without_a_length_has_no_mating_frame() -> None:
    tree, peg = shaft(Cylinder(0.01, 0.03, 24))
    with pytest.raises(TaskError, match="'peg' of 'object' has no length"):
        check_frame(tree, replace(peg, length=None))


def trees(random: np.random.Generator) -> Solid:
    def body() -> Solid:
        primitive = (Box((0.05, 0.04, 0.06)), Cylinder(0.03, 0.05, 9), Cone(0.03, 0.01, 0.07, 8))[random.integers(3)]
        return Placed(primitive, Pose(random.uniform(-0.03, 0.03, 3), exp(random.normal(size=3))))

    return Difference(Union((body(), body(), body())), (body(), Placed(Union((body(), body())), at(0.01))))


@pytest.mark.parametrize("seed", range(8))
def test_axis_and_sections_agree_with_membership(seed: int) -> None:
    random = np.random.default_rng(seed)
    solid = trees(random)
    heights = random.uniform(-0.1, 0.1, 400)
    points = np.column_stack([np.zeros((400, 2)), heights])
    stretches = on_axis(solid)
    found = [any(a < z < b for a, b in stretches) for z in heights]
    np.testing.assert_array_equal(found, contains(solid, points))
    fine = np.column_stack([np.zeros((20001, 2)), np.linspace(-0.1, 0.1, 20001)])
    assert length(stretches) == pytest.approx(0.2 * np.mean(contains(solid, fine)), abs=1e-4)
    assert length(clipped(stretches, 0.0, 0.02)) <= 0.02
    cut = across(solid)
    for height in heights[:6]:
        flat = random.uniform(-0.08, 0.08, (500, 2))
        inside = contains(solid, np.column_stack([flat, np.full(500, height)]))
        np.testing.assert_array_equal(cut(height).contains(shapely_points(flat)), inside)
