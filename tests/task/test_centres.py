"""Outlines without symmetry: a peg and its hole find each other however they lie."""

from pathlib import Path

import numpy as np
import pytest

from fmopt.errors import InputError
from fmopt.planning.posed import Posed
from fmopt.spatial.se3 import exp
from fmopt.task.problem import load
from tests.shared.files.mesh_files import binary_stl
from tests.shared.parts.families import meshes, pair, write_stl


def test_a_hole_alike_from_both_sides_is_entered_where_a_stated_peg_fits(tmp_path: Path) -> None:
    one = next(one for one in (pair("triangle", seed) for seed in range(100)) if one.through)
    file = write_stl(one, tmp_path, (0.01, 0.1))
    found = load(file).mated[0]
    at, turn = (
        ", ".join(map(repr, part))
        for part in (np.multiply(found.frame[:3], 1e3).tolist(), np.degrees(found.frame[3:]).tolist())
    )
    stated = f'\n[features.peg]\nkind = "solid"\nat = [{at}]\nturn = [{turn}]\nlength = {one.peg[-1].at}\n'
    (tmp_path / "peg.toml").write_text((tmp_path / "peg.toml").read_text() + stated)
    _, (points, triangles) = meshes(one)
    for way in ([0.0, 0.0, 0.0], [np.pi, 0.0, 0.0], [0.0, np.pi, 0.0]):
        (tmp_path / "block.stl").write_bytes(binary_stl(points @ exp(np.array(way)).T, triangles))
        assert 1e3 * Posed.of(load(file)).clearance.per_side == pytest.approx(one.clearance, abs=1e-3), way


def test_a_peg_that_is_turned_over_says_so_and_has_to_be_whole_at_the_end_that_leads(tmp_path: Path) -> None:
    one = pair("L", 0)
    file = write_stl(one, tmp_path, (0.01, 0.1))
    (points, triangles), _ = meshes(one)
    points = points @ exp(np.array([np.pi, 0.0, 0.0])).T
    (tmp_path / "peg.stl").write_bytes(binary_stl(points, triangles))
    moving = load(file).mated[0]
    at = ", ".join(f"{1e3 * value + 0.0:.9g}" for value in moving.frame[:3])
    (said,) = (note for note in load(file).moving.notes if "features.peg" in note)
    assert f"at = [{at}] mm" in said
    leads = (points[triangles][..., 2] > points[:, 2].max() - 1e-6).all(axis=1)
    (tmp_path / "peg.stl").write_bytes(binary_stl(points, triangles[~leads]))
    with pytest.raises(InputError, match="its mating faces are not all there"):
        load(file)
