"""Meshes that other people made, where their folder lies beside the repository: what is found on them and measured."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import mating_clearance
from fmopt.geometry.mesh.mesh_import import Unit, load_mesh
from fmopt.geometry.part import Part, mesh_part, rebased
from tests.shared.files.others import PAIRS, PARTS

PRESENT = [name for name in PAIRS if (PARTS / name).is_dir()]


def seated(path: Path, unit: Unit, name: str) -> Part:
    part = mesh_part(name, load_mesh(path, unit))
    return rebased(part, part.feature(name).frame)


@pytest.mark.parametrize("name", PRESENT)
def test_a_pair_is_found_and_measured(name: str) -> None:
    peg, hole, unit, declared = PAIRS[name]
    moving, fixed = seated(PARTS / name / peg, unit, "peg"), seated(PARTS / name / hole, unit, "hole")
    depth = fixed.feature("hole").length
    assert fixed.feature("hole").through
    assert moving.feature("peg").length > depth
    measured = mating_clearance(moving, fixed, depth)
    curved = moving.chord_error + fixed.chord_error
    assert 1e-3 * declared - curved - 1e-6 <= measured.per_side <= 1e-3 * declared + 1e-6


@pytest.mark.parametrize("name", [name for name in PRESENT if name == "agh_6gon"])
def test_a_wrong_unit_is_seen_in_the_clearance(name: str) -> None:
    peg, hole, unit, _ = PAIRS[name]
    moving, fixed = seated(PARTS / name / peg, "cm", "peg"), seated(PARTS / name / hole, unit, "hole")
    assert mating_clearance(moving, fixed, fixed.feature("hole").length).per_side < 0.0


@pytest.mark.parametrize("name", [name for name in ("mit_planar_slot",) if (PARTS / name).is_dir()])
def test_a_slot_that_is_open_sideways_has_to_be_described(name: str) -> None:
    mesh = load_mesh(PARTS / name / "hole_chamfered.obj", "mm")
    with pytest.raises(GeometryError, match="no peg or hole was found on it") as told:
        mesh_part("slot", mesh)
    assert told.value.advice.startswith("describe where it mates under [features] of a model file: a hole, or a slot")
    described = mesh_part("slot", mesh, [])
    assert described.polyhedron.volume == pytest.approx(mesh.body.volume, rel=1e-9)
