"""Keys of model, problem and assembly files beyond the plain insertion, and how they reach the knowledge base."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from fmopt.errors import InputError
from fmopt.geometry.csg import Cylinder, Placed, Sphere, contains
from fmopt.geometry.pieces import polyhedron
from fmopt.knowledge.tree import Feature, ObjectTree
from fmopt.se3 import Pose
from fmopt.task.command import is_round
from fmopt.task.model import load_model
from fmopt.task.toml_source import Place
from fmopt.task.tree import build_tree

ROOT = Path(__file__).parent.parent
NOSED = """
name = "nosed"
part = "nosed"
units = {length = "mm", angle = "deg"}
[parameters]
radius = 10
[solids.nose]
shape = "sphere"
radius = "radius"
at = [0, 0, "radius"]
sides = 32
[solids.shaft]
shape = "cylinder"
radius = "radius"
height = 40
at = [0, 0, "radius"]
[solids.nosed]
shape = "union"
of = ["nose", "shaft"]
[features.peg]
kind = "solid"
at = [0, 0, 0]
length = 50
"""


def tree_of(folder: Path, text: str) -> ObjectTree:
    path = folder / "model.toml"
    path.write_text(text, encoding="utf-8")
    model, faults = load_model(path, Place(str(path)), {})
    if model is None:
        raise InputError(*faults)
    return build_tree(model.source, model.file)


def test_a_sphere_is_a_solid_of_a_model_file(tmp_path: Path) -> None:
    tree = tree_of(tmp_path, NOSED)
    peg = tree.feature("peg")
    assert next(leaf.primitive for leaf in peg.instances) == Sphere(0.01, 32)
    assert is_round(peg)
    nose = polyhedron(tree.solid).volume - polyhedron(Cylinder(0.01, 0.04)).volume
    assert nose == pytest.approx(2.0 / 3.0 * math.pi * 0.01**3, rel=0.05)
    assert contains(tree.solid, [[0, 0, 1e-4], [0.009, 0, 1e-3], [0.009, 0, 0.011]]).tolist() == [True, False, True]


@pytest.mark.parametrize(("x", "expected"), [(0.0, True), (1e-6, False)])
def test_a_sphere_is_round_however_it_is_turned(x: float, expected: bool) -> None:
    body = Placed(Sphere(0.01), Pose.from_vector([x, 0, 0.01, 0.5, 0, 0]))
    assert is_round(Feature("nose", "+", Pose.identity(), body, 0.02)) is expected


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('shape = "sphere"', 'shape = "spher"', r"7:9: unknown-choice: solids.nose: .*'sphere'"),
        ('radius = "radius"\nat', "radius = 0\nat", r"9:10: zero: solids.nose.radius"),
        ("sides = 32", "sides = 2", r"11:9: .*solids.nose.sides"),
    ],
)
def test_faults_of_spheres_have_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in NOSED
    with pytest.raises(InputError, match=words):
        tree_of(tmp_path, NOSED.replace(old, new, 1))
