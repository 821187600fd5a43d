"""Meshes that other people made, where their folder lies beside the repository: how they mate, and their clearance."""

from pathlib import Path

import pytest

from fmopt.geometry.clearance import mating_clearance
from fmopt.geometry.fit.find import FoundFit, find
from fmopt.geometry.mesh.mesh_import import Unit, load_mesh
from fmopt.geometry.part import mesh_part, rebased
from tests.shared.files.others import PAIRS, PARTS

PRESENT = [name for name in PAIRS if (PARTS / name).is_dir()]


def measured(peg: Path, hole: Path, *units: Unit) -> tuple[FoundFit, float, float]:
    """How two meshes mate, their clearance (m a side), and how far curved surfaces lie from both at most (m)."""
    moving, fixed = (mesh_part(path.stem, load_mesh(path, unit)) for path, unit in zip((peg, hole), units, strict=True))
    fit = find(moving.polyhedron, fixed.polyhedron)
    room = mating_clearance(rebased(moving, fit.solid), rebased(fixed, fit.hollow), fit.hole).per_side
    return fit, room, moving.chord_error + fixed.chord_error


@pytest.mark.parametrize("name", PRESENT)
def test_a_pair_is_found_and_measured(name: str) -> None:
    peg, hole, unit, declared = PAIRS[name]
    fit, room, curved = measured(PARTS / name / peg, PARTS / name / hole, unit, unit)
    assert (fit.exchanged, fit.through) == (False, True)
    assert fit.peg > fit.hole
    assert 1e-3 * declared - curved - 1e-6 <= room <= 1e-3 * declared + 1e-6
