"""Two parts are read alike from TOML, from meshes and from STEP."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import fmopt
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Moved
from fmopt.geometry.mesh.mesh_import import mesh_polyhedron
from fmopt.geometry.mesh.mesh_solid import decomposed
from fmopt.geometry.outline_solids import stack
from fmopt.geometry.section import sealed
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import Problem
from fmopt.task.sizes import measured_clearance
from tests.shared.files.mesh_files import binary_stl
from tests.shared.parts import families
from tests.shared.parts.forms import differences, read

SEEDS = range(3)


@pytest.mark.parametrize("family", families.FAMILIES)
def test_meshes_are_read_as_the_models_they_are_of(family: str, tmp_path: Path) -> None:
    for seed in SEEDS:
        pair = families.pair(family, seed)
        problems = {form: read(pair, form, tmp_path / pair.name) for form in ("toml", "stl")}
        assert differences(pair, problems) == [], pair.name


@pytest.mark.wide
@pytest.mark.parametrize("family", families.FAMILIES)
def test_a_step_file_is_read_as_the_model_it_is_of(family: str, tmp_path: Path) -> None:
    pair = families.pair(family, families.FAMILIES.index(family) % len(SEEDS))
    assert differences(pair, {form: read(pair, form, tmp_path) for form in ("toml", "step")}) == []


def check_motion(family: str, seed: int, motion: int, folder: Path) -> Problem:
    """The fit of two STL files is the pair's, each moved at random, its numbers in single precision."""
    pair, rng = families.pair(family, seed), np.random.default_rng([motion, seed, families.FAMILIES.index(family)])
    paths = [folder / f"{motion}-{name}.stl" for name in ("peg", "block")]
    for path, (points, triangles) in zip(paths, families.meshes(pair), strict=True):
        pose = Pose(rng.uniform(-50.0, 50.0, 3), exp(rng.normal(size=3)))
        path.write_bytes(binary_stl(points @ pose.R.T + pose.p, triangles))
    shift, turn = pair.error
    error = f"{shift} mm, {turn} deg"
    problem = fmopt.problem(*paths[:: -1 if pair.exchanged else 1], error, unit="mm", folder=folder / "task")
    case = family, seed, motion
    assert measured_clearance(problem).per_side == pytest.approx(1e-3 * pair.clearance, abs=1e-6), case
    assert -problem.goal[2] == pytest.approx(1e-3 * pair.depth, abs=1e-6), case
    return problem


@pytest.mark.parametrize(
    ("family", "seed", "motion"),
    [("tapered", 102, 1), ("tapered", 102, 7), ("tapered", 101, 20), ("chamfered", 101, 0)],
)
def test_a_fit_does_not_depend_on_how_the_files_lie(family: str, seed: int, motion: int, tmp_path: Path) -> None:
    problem = check_motion(family, seed, motion, tmp_path)
    if (seed, motion) == (101, 20):  # a corner of it has no exact coordinates
        assert problem.moving.enclosed
        assert "warning: nothing is certified of these parts" in "; ".join(problem.fixed.notes)


@pytest.mark.wide
@pytest.mark.parametrize("family", families.FAMILIES)
def test_no_fit_of_any_family_depends_on_how_the_files_lie(family: str, tmp_path: Path) -> None:
    for seed, motion in product((101, 102), range(10)):
        check_motion(family, seed, motion, tmp_path)


def test_a_tapered_solid_is_one_however_it_lies() -> None:
    """Rounding of turned coordinates makes corners of its parts meet, or miss each other."""
    made = families.pair("tapered", 101).peg
    solid = stack([(1e-3 * one.at, 1e-3 * np.array(one.outline)) for one in made])
    upright, rng = polyhedron(solid), np.random.default_rng(3)
    for _ in range(40):
        moved = polyhedron(Moved(solid, Pose(rng.uniform(-0.05, 0.05, 3), exp(rng.normal(size=3)))))
        assert moved.volume == pytest.approx(upright.volume, rel=1e-9)
        assert len(moved.faces) == len(upright.faces)


def test_another_pair_is_told_apart(tmp_path: Path) -> None:
    pair, other = families.pair("keyed", 0), families.pair("keyed", 1)
    found = differences(pair, {"toml": read(pair, "toml", tmp_path), "stl": read(other, "stl", tmp_path)})
    assert [text.split(":")[0] for text in found] == ["stl"] * 5


@pytest.mark.parametrize("family", ["chamfered", "tapered"])
def test_slanted_faces_of_a_mesh_that_are_nearly_parallel_are_so(family: str) -> None:
    """Single precision turns each by itself, and cuts along faces that are nearly parallel come to no good end."""
    for seed in range(4):
        points, triangles = families.meshes(families.pair(family, seed))[0]
        single = 1e-3 * points.astype(np.float32).astype(np.float64)
        mesh = mesh_polyhedron(single, triangles, 2e-9)
        between = np.linalg.norm(np.cross(mesh.body.normals[:, None], mesh.body.normals), axis=2)
        assert not np.any((between > 1e-12) & (between < 1e-5))
        found = decomposed(mesh)
        assert sum(piece.volume for piece in found.pieces) > found.boundary.volume * (1.0 - 1e-6)


def test_cracks_and_skins_of_rounding_are_no_part_of_a_section() -> None:
    from shapely import Polygon, box, union_all

    left = box(0.0, 0.0, 0.01, 0.02)
    right = Polygon([(0.01 + 1e-15, 0.005), (0.02, 0.005), (0.02, 0.01), (0.01 + 3e-12, 0.01)])
    apart = union_all([left, right])
    assert len(getattr(apart, "geoms", [apart])) == 2
    whole = sealed(apart)
    assert whole.geom_type == "Polygon"
    assert whole.area == pytest.approx(left.area + right.area, rel=1e-9)
    skin = union_all([left, box(0.01, 0.005, 0.02, 0.005 + 1e-12)])
    assert sealed(skin).bounds == pytest.approx(left.bounds, abs=1e-11)
    assert sealed(left) is left


def ring(radius: float, angles: np.ndarray) -> families.Outline:
    return tuple((radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("seed", [0, 1])
def test_noise_on_many_narrow_facets_stays_as_small_as_it_is(even: bool, seed: int) -> None:
    """Planes fitted to facets that meet at 2.5° cross up to 20 times as far aside as they are off, each for itself."""
    rng = np.random.default_rng(seed)
    angles = 2.0 * np.pi * (np.arange(144) + (0.0 if even else 0.1) * rng.uniform(-1.0, 1.0, 144)) / 144
    peg = tuple(families.Section(z, ring(r, angles)) for z, r in ((0.0, 7.5), (0.5, 8.0), (30.0, 8.0)))
    hole = (families.Section(-20.0, ring(8.25, angles)), families.Section(0.0, ring(8.25, angles)))
    pair = replace(families.pair("4-gon", seed), peg=peg, hole=hole, block=(40.0, 40.0, 20.0), through=True)
    for number, (points, triangles) in enumerate(families.meshes(pair)):
        if number == 0 and not even:
            continue  # slanted facets of uneven rings lie in no planes that meet in corners near them
        noisy = 1e-3 * points + rng.uniform(-1e-6, 1e-6, points.shape)
        whole, found = mesh_polyhedron(1e-3 * points, triangles), mesh_polyhedron(noisy, triangles)
        assert len(found.body.faces) == len(whole.body.faces)
        assert 0.5e-6 < found.off < 6e-6
        apart = np.linalg.norm(found.body.vertices[:, None] - whole.body.vertices, axis=2)
        assert apart.min(axis=1).max() < 6e-6
