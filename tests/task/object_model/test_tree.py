"""The four-level tree: chains mean what their CSG trees mean, every shipped model has one, bad trees are refused."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.errors import GeometryError, InputError, TaskError
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box, Difference, Hull, Moved, Solid, Union
from fmopt.geometry.inverse_csg import MESH_NOISE, apart
from fmopt.geometry.mating_features import Feature as MatingFeature
from fmopt.spatial.se3 import Pose
from fmopt.task.object_model.classify import FeatureClaim, object_tree
from fmopt.task.object_model.tree import (
    FeatureClass,
    ObjectTree,
    Term,
    TreeFeature,
    chain_of,
    chain_solid,
    instances,
    joined,
    moved,
    without,
)
from fmopt.task.solid_tree import build_part, build_tree
from tests import ROOT
from tests.shared.files import model_text
from tests.shared.files.models import model_of, tree_of
from tests.shared.parts.workcells import at
from tests.shared.same_solid import assert_same_volume
from tests.shared.solids import contains, frustum

MODELS = sorted((ROOT / "models").glob("*.toml"))
HERE = Pose.identity()


def coordinate() -> st.SearchStrategy[float]:
    return st.integers(-4, 4).map(lambda n: 0.01 * n)


def solids() -> st.SearchStrategy[Solid]:
    """Random CSG trees on a coarse grid, where faces coincide more often than not."""
    size = st.tuples(*[st.integers(1, 4).map(lambda n: 0.02 * n)] * 3)
    box = st.builds(lambda s, x, y, z: Moved(Box(s), at(x, y, z)), size, coordinate(), coordinate(), coordinate())
    return st.recursive(
        box,
        lambda inner: st.one_of(
            st.lists(inner, min_size=1, max_size=3).map(lambda parts: Union(tuple(parts))),
            st.builds(lambda base, tools: Difference(base, tuple(tools)), inner, st.lists(inner, max_size=3)),
            st.builds(lambda solid, x: Moved(solid, at(x, -x, 2 * x)), inner, coordinate()),
        ),
        max_leaves=7,
    )


POINTS = np.random.default_rng(3).uniform(-0.16, 0.2, (4000, 3))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(solids())
def test_a_chain_means_what_its_tree_means(solid: Solid) -> None:
    chain = chain_of(solid, "x")
    assert chain[0].sign == "+"
    try:
        again = chain_solid(chain)
    except GeometryError:
        pytest.fail("a chain of a tree begins with a solid term")
    np.testing.assert_array_equal(contains(again, POINTS), contains(solid, POINTS))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(solids())
def test_leaves_of_positive_trees_cover_them(solid: Solid) -> None:
    added = [leaf for leaf in instances(solid) if leaf.sign == "+"]
    covered = np.any([contains(Moved(leaf.primitive, leaf.pose), POINTS) for leaf in added], axis=0)
    assert np.all(covered[contains(solid, POINTS)])


def test_a_difference_in_a_union_becomes_a_chain_where_it_can() -> None:
    a, b, c = Box((0.04, 0.04, 0.04)), Moved(Box((0.04, 0.04, 0.04)), at(0.06)), Moved(Box((0.01, 0.01, 1)), at(0.06))
    apart = chain_of(Union((a, Difference(b, (c,)))), "x")
    assert [term.sign for term in apart] == ["+", "+", "-"]
    through = Difference(b, (Moved(Box((0.2, 0.01, 0.01)), at(0.06)),))
    turned_round = chain_of(Union((a, through)), "x")
    assert [term.sign for term in turned_round] == ["+", "-", "+"]
    both = Union((Difference(a, (Moved(Box((0.2, 0.01, 0.01)), at(0.0, 0.0, 0.02)),)), through))
    kept = chain_of(both, "x")
    assert [term.sign for term in kept] == ["+", "-", "+"]
    assert isinstance(kept[-1].body, Difference)


def test_taking_away_a_difference_gives_back() -> None:
    base, tool = (Term("+", "a", Box((1, 1, 1))),), (Term("+", "b", Box((2, 2, 1))), Term("-", "c", Box((0.5, 0.5, 1))))
    left = chain_solid(without(base, tool))
    assert contains(left, [[0, 0, 0.5], [0.4, 0, 0.5]]).tolist() == [True, False]
    assert len(joined(base, base)) == 2


def test_moving_composes_placements() -> None:
    solid = moved(moved(Box((1, 1, 1)), at(1)), at(0, 2))
    assert isinstance(solid, Moved)
    assert isinstance(solid.solid, Box)
    np.testing.assert_array_equal(solid.pose.p, [1, 2, 0])
    assert moved(solid, HERE) is solid


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_shipped_model_has_its_tree(path: Path) -> None:
    model = model_of(path)
    tree, part = build_tree(model.source, model.file), build_part(model.source, model.file)
    derived = polyhedron(tree.solid)
    body, round_ = part.polyhedron, part.polyhedron.radii[:, None]
    assert_same_volume(derived, body, 1e-12)
    off = 1e-15 + 0.02 * float(body.radii.max())  # a polyhedron of 16 meridians is in its ball by 1.92 % of its radius
    np.testing.assert_allclose(derived.vertices.min(axis=0), (body.vertices - round_).min(axis=0), atol=off)
    np.testing.assert_allclose(derived.vertices.max(axis=0), (body.vertices + round_).max(axis=0), atol=off)
    mating = {feature.name: feature for feature in tree.features if feature.length is not None}
    assert set(mating) == {feature.name for feature in part.features}
    for feature in part.features:
        assert mating[feature.name].hollow == (feature.kind == "hollow")
        np.testing.assert_array_equal(mating[feature.name].frame.vector(), feature.frame.vector())


def test_the_object_of_figure_1() -> None:
    tree = tree_of(ROOT / "models" / "lee_huang_figure1.toml")
    levels = {group.name: [(f.sign, f.name) for f in group.features] for group in tree.classes}
    assert levels == {
        "boxes": [("+", "base")],
        "cylinders": [("+", "boss")],
        "holes": [("-", "hole_a"), ("-", "hole_c")],
        "slots": [("-", "slot_b")],
    }
    assert [leaf.key for leaf in tree.feature("hole_c").instances] == ["cylinder", "cone"]
    assert tree.feature("slot_b").instances[0].primitive == Box((0.012, 0.062, 0.016))
    inside = contains(tree.solid, [[-0.025, 0, 0.045], [-0.025, 0, 0.014], [-0.037, 0, 0.045], [0.012, 0.02, 0.02]])
    assert inside.tolist() == [False, True, True, False]


HOLE = MatingFeature("hole", "hollow", at(0, 0, 0.04), 0.02)
BLOCK = Difference(Box((0.06, 0.06, 0.04)), (Moved(Box((0.02, 0.02, 0.04)), at(0, 0, 0.02)),))


def test_a_mesh_is_its_hull_less_what_that_has_too_much() -> None:
    body = polyhedron(BLOCK)
    tree = object_tree("mesh", chain_of(apart(body, MESH_NOISE * body.diameter)[0], "mesh"), [HOLE], {})
    assert [(f.sign, f.name) for f in tree.features] == [("+", "mesh"), ("-", "hole")]
    assert polyhedron(tree.solid).volume == pytest.approx(body.volume, rel=1e-9)


def test_a_chamfered_hole_is_one_feature_of_two_instances() -> None:
    sink = Moved(frustum((0.02, 0.02), (0.03, 0.03), 0.005), at(0, 0, 0.035))
    chain = chain_of(Difference(BLOCK, (sink,)), "block")
    tree = object_tree("block", chain, [HOLE], {})
    assert [leaf.key for leaf in tree.feature("hole").instances] == ["box", "hull"]
    assert len(tree.features) == 2


def test_two_features_may_share_a_body() -> None:
    bar = chain_of(Box((0.02, 0.02, 0.1)), "bar")
    down = Pose(np.array([0, 0, 0.1]), np.diag([1.0, -1.0, -1.0]))
    ends = [MatingFeature("near", "solid", HERE, 0.03), MatingFeature("far", "solid", down, 0.03)]
    tree = object_tree("bar", bar, ends, {"far": FeatureClaim("tips")})
    assert {group.name: len(group.features) for group in tree.classes} == {"tips": 1, "pegs": 1}
    assert polyhedron(tree.solid).volume == pytest.approx(4e-5, rel=1e-12)


def test_features_that_nothing_makes_up() -> None:
    chain = chain_of(BLOCK, "block")
    with pytest.raises(TaskError, match=r"'hole' runs through nothing that is prefixed -") as caught:
        object_tree("block", chain, [MatingFeature("hole", "hollow", at(0.2, 0, 0.04), 0.02)], {})
    assert caught.value.feature == "hole"
    with pytest.raises(TaskError, match=r"'hole' names 'block', which is no term prefixed -.*such terms: block-cut-1"):
        object_tree("block", chain, [HOLE], {"hole": FeatureClaim("", ("block",))})


def test_terms_with_others_between_them_are_not_taken_together() -> None:
    cut = Moved(Box((0.01, 0.01, 0.1)), at(0, 0, 0.01))
    chain = (*chain_of(BLOCK, "block"), Term("+", "plug", Box((0.02, 0.02, 0.01))), Term("-", "cut", cut))
    claim = {"hole": FeatureClaim("", ("block-cut-1", "cut"))}
    with pytest.raises(TaskError, match="terms with 'plug', of the other sign, between them"):
        object_tree("block", chain, [HOLE], claim)


def test_bulk_never_takes_the_name_of_a_mating_feature() -> None:
    chain = (
        Term("+", "hole", Box((0.06, 0.06, 0.04))),
        Term("-", "cut", Moved(Box((0.02, 0.02, 0.04)), at(0, 0, 0.02))),
    )
    tree = object_tree("block", chain, [HOLE], {})
    assert [(f.sign, f.name) for f in tree.features] == [("+", "hole-2"), ("-", "hole")]


def feature(name: str, sign: str = "+") -> TreeFeature:
    return TreeFeature(name, "+" if sign == "+" else "-", HERE, Box((1, 1, 1)))


@pytest.mark.parametrize(
    ("classes", "order", "words"),
    [
        ((FeatureClass("a", (feature("x"), feature("x"))),), (), "has 'x' twice"),
        ((FeatureClass("a", (feature("x"),)), FeatureClass("a", ())), (), "has 'a' twice"),
        ((FeatureClass("a", (feature("x"),)),), ("x", "y"), "differ in y"),
        ((FeatureClass("a", (feature("x"),)),), ("x", "x"), "differ in x"),
        ((FeatureClass("a", (feature("x", "-"), feature("y"))),), (), "does not begin with a solid feature"),
        ((), (), "does not begin with a solid feature"),
    ],
)
def test_trees_that_are_none(classes: tuple[FeatureClass, ...], order: tuple[str, ...], words: str) -> None:
    with pytest.raises(TaskError, match=words):
        ObjectTree("object", HERE, classes, order)


def test_features_that_are_none() -> None:
    with pytest.raises(GeometryError, match=r"'x' has length -1\.0 m"):
        TreeFeature("x", "+", HERE, Box((1, 1, 1)), -1.0)
    with pytest.raises(GeometryError, match="'x' is solid and cannot be through"):
        TreeFeature("x", "+", HERE, Box((1, 1, 1)), 1.0, through=True)
    with pytest.raises(GeometryError, match="a chain without solid terms is empty"):
        chain_solid([Term("-", "x", Box((1, 1, 1)))])
    with pytest.raises(TaskError, match=r"no feature 'y' .*its features: x"):
        ObjectTree("object", HERE, (FeatureClass("a", (feature("x"),)),)).feature("y")


def test_trees_pickle() -> None:
    tree = tree_of(ROOT / "models" / "lee_huang_bush.toml")
    again = pickle.loads(pickle.dumps(tree))
    assert [f.name for f in again.features] == ["shank", "bore"]
    with pytest.raises(ValueError, match="read-only"):
        again.frame.p[0] = 1.0


def edited(tmp_path: Path, old: str, new: str, name: str = "lee_huang_block.toml") -> ObjectTree:
    text = (ROOT / "models" / name).read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / name
    path.write_text(text.replace(old, new), encoding="utf-8")
    return tree_of(path)


def test_model_files_may_name_classes_and_solids(tmp_path: Path) -> None:
    tree = edited(tmp_path, "through = true", 'through = true\nclassification = "bores"\nsolids = ["hole"]')
    assert [group.name for group in tree.classes] == ["boxes", "bores"]


def test_a_hole_that_solids_leave_between_them(tmp_path: Path) -> None:
    path = tmp_path / "ring.toml"
    sides = "".join(
        model_text.cuboid(name, f"{x}, {y}, 20", f"{a}, {b}, 0")
        for name, x, y, a, b in (
            ("west", 10, 40, -15, 0),
            ("east", 10, 40, 15, 0),
            ("south", 40, 10, 0, -15),
            ("north", 40, 10, 0, 15),
        )
    )
    path.write_text(
        'name = "ring"\n'
        + model_text.part("ring", model_text.UNITS, sides, model_text.union("ring", "west", "east", "south", "north"))
        + model_text.feature("hole", "hollow", "0, 0, 20", "20")
        + "through = true\n",
        encoding="utf-8",
    )
    tree = tree_of(path)
    assert [(f.sign, f.name) for f in tree.features] == [("+", "ring"), ("-", "hole")]
    assert polyhedron(tree.solid).volume == pytest.approx(0.02 * (0.04**2 - 0.02**2), rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("through = true", 'solids = ["hol"]', r"\d+:\d+: unknown-solid: features.hole.solids\[0\]: .*'hol'; .*'hole'"),
        ("through = true", 'solids = ["block"]', r"toml:34:11: frame-rule: features.hole: .*instances of its own sign"),
    ],
)
def test_faults_of_trees_have_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        edited(tmp_path, old, new)


def test_a_hull_is_a_leaf_too() -> None:
    points = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    assert instances(Moved(Hull(points), at(1)))[0].primitive == Hull(points)
