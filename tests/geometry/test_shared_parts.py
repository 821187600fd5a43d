"""Meshes that other people made, where their folder lies beside the repository: how they mate, and their clearance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import mating_clearance
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box
from fmopt.geometry.fit.find import Fit, find
from fmopt.geometry.mesh.mesh_import import Unit, load_mesh
from fmopt.geometry.part import mesh_part, rebased
from tests.shared.files.others import PAIRS, PARTS

PRESENT = [name for name in PAIRS if (PARTS / name).is_dir()]


def measured(peg: Path, hole: Path, *units: Unit) -> tuple[Fit, float, float]:
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


@pytest.mark.parametrize("name", [name for name in PRESENT if name == "agh_6gon"])
def test_a_wrong_unit_is_seen_as_nothing_goes_in(name: str) -> None:
    peg, hole, unit, _ = PAIRS[name]
    with pytest.raises(GeometryError, match="nothing of the one goes into an opening of the other"):
        measured(PARTS / name / peg, PARTS / name / hole, "cm", unit)


@pytest.mark.parametrize("name", [name for name in ("mit_planar_slot",) if (PARTS / name).is_dir()])
def test_a_slot_that_is_open_sideways_is_found(name: str) -> None:
    fit = find(polyhedron(Box((0.0208, 0.03, 0.1))), load_mesh(PARTS / name / "hole_chamfered.obj", "mm").body)
    assert (fit.exchanged, fit.through) == (False, True)
    assert fit.clearance == pytest.approx(0.5 * (0.021006 - 0.0208), abs=1e-9)
    np.testing.assert_allclose(np.abs(fit.hollow.R[:, 2]), [0.0, 0.0, 1.0], atol=1e-9)
