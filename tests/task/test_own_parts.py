"""Parts of a problem that come as meshes: from files without features to a certified plan, and what is asked before."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmopt
from fmopt.geometry.csg import Box, Cylinder, Difference, Moved
from fmopt.report.sections import asked
from fmopt.task.explain import explain, facts
from fmopt.task.problem import load
from fmopt.task.sizes import measured_clearance
from tests.shared.files.mesh_files import at, plate, rounded, stl_text, triangles_of, write_stl
from tests.shared.files.model_text import of_file
from tests.shared.files.own import PROBLEM
from tests.shared.files.shipped import edit
from tests.shared.files.step_files import write_step


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A rod and a plate as a foreign program wrote them, with models that do not say where they mate."""
    write_stl(tmp_path / "rod.stl", rounded((0.012, 0.008), 0.03, 0.0005))
    write_stl(tmp_path / "plate.stl", plate((0.0123, 0.0083)))
    for name in ("rod", "plate"):
        (tmp_path / f"{name}.toml").write_text(of_file(f"{name}.stl"))
    (tmp_path / "problem.toml").write_text(PROBLEM)
    return tmp_path


def step_block(tool: Any = None) -> Any:
    """A solid of Open CASCADE in mm: a block on z = 0, 40 x 40 x 10, less a tool."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    block = BRepPrimAPI_MakeBox(gp_Pnt(-20.0, -20.0, 0.0), gp_Pnt(20.0, 20.0, 10.0)).Shape()
    return block if tool is None else BRepAlgoAPI_Cut(block, tool).Shape()


def as_step(folder: Path, shape: Any, deviation: str = "") -> None:
    """The plate of the problem as a STEP file."""
    write_step(folder / "plate.step", shape)
    edit(folder / "plate.toml", 'file = "plate.stl"\nunit = "mm"\n', f'file = "plate.step"\n{deviation}')


def test_a_foreign_mesh_and_a_step_file_become_a_certified_plan(folder: Path) -> None:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    as_step(folder, step_block(BRepPrimAPI_MakeBox(gp_Pnt(-6.15, -4.15, -5.0), gp_Pnt(6.15, 4.15, 15.0)).Shape()))
    problem = fmopt.load(folder / "problem.toml")
    said = problem.explain()
    assert "found: [features.peg] of the mesh, solid, at = [0, 0, 0] mm, turn = [0, 0, 0] deg, length = 30 mm" in said
    assert "found: [features.hole] of the STEP file, hollow, at = [0, 0, 10] mm" in said
    assert "along x, 0.2 mm a side are declared, 0.15 mm measured; the plan rests on the measured one" in said
    assert "error as stated: +-0.03, 0.03, 0 mm" in said
    plan = fmopt.solve(problem)
    assert (plan.verdict, plan.verify(problem).verdict) == ("CERTIFIED", "CERTIFIED")
    notes = plan.stated.description.diagnostics.imported
    assert len(notes) == 2
    assert all(note.startswith("found: [features.") and f"<li>{note}</li>" in asked(plan.stated) for note in notes)


def test_plane_faces_of_a_step_file_are_exact_and_curved_ones_as_stated(folder: Path) -> None:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder

    write_stl(folder / "rod.stl", rounded((0.012, 0.008), 0.03))
    radius = 0.5e-3 * np.hypot(12.3, 8.3)
    as_step(folder, step_block(BRepPrimAPI_MakeCylinder(1e3 * radius, 30.0).Shape()), "deviation = 0.05\n")
    problem = load(folder / "problem.toml")
    corners = problem.fixed.polyhedron.vertices
    square = corners[np.abs(corners[:, :2]).max(axis=1) > 0.015]
    np.testing.assert_array_equal(np.unique(square[:, :2]), [-0.02, 0.02])
    np.testing.assert_array_equal(np.unique(square[:, 2]), [-0.01, 0.0])
    bore = corners[np.abs(corners[:, :2]).max(axis=1) < 0.015]
    np.testing.assert_allclose(np.linalg.norm(bore[:, :2], axis=1), radius, rtol=1e-6)
    sagitta = radius * (1.0 - np.cos(2.0 * np.pi / len(bore)))
    assert 0.0 < sagitta <= 5e-5
    assert problem.start_box[:3] == pytest.approx([3e-5 + sagitta, 3e-5 + sagitta, sagitta], rel=1e-6)


def test_step_files_that_cannot_be_used_say_why(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    as_step(folder, step_block(), 'unit = "mm"\ndeviation = 0\n')
    with pytest.raises(fmopt.InputError) as caught:
        load(folder / "problem.toml")
    assert [fault.code for fault in caught.value.faults] == ["conflict", "zero"]
    edit(folder / "plate.toml", 'unit = "mm"\ndeviation = 0\n', "")
    whole = (folder / "plate.step").read_text()
    (folder / "plate.step").write_text("ISO-10303-21;")
    with pytest.raises(fmopt.InputError, match=r"plate\.toml:8:8: geometry: .*no readable STEP file"):
        load(folder / "problem.toml")
    (folder / "plate.step").write_text(whole)
    monkeypatch.setitem(sys.modules, "OCP", None)
    with pytest.raises(fmopt.ResourceError, match=r"there is none; install it anew: pip install --force-reinst"):
        load(folder / "problem.toml")


def test_a_step_file_of_two_solids_or_none_is_refused(folder: Path) -> None:
    from OCP.BRep import BRep_Builder
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.TopoDS import TopoDS_Compound

    pair, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(pair)
    builder.Add(pair, step_block())
    builder.Add(pair, BRepPrimAPI_MakeBox(1.0, 2.0, 3.0).Shape())
    as_step(folder, pair)
    with pytest.raises(fmopt.InputError, match=r"holds 2 bodies: 1, 2; say which by body = 1, under \[mesh\], "):
        load(folder / "problem.toml")


def test_found_features_are_those_that_could_be_written_there(folder: Path) -> None:
    found = load(folder / "problem.toml")
    for name, words in (
        ("rod", 'peg]\nkind = "solid"\nat = [0, 0, 0]\nlength = 30\n'),
        ("plate", 'hole]\nkind = "hollow"\nat = [0, 0, 10]\nlength = 10\nthrough = true\n'),
    ):
        with (folder / f"{name}.toml").open("a") as file:
            file.write(f"\n[features.{words}")
    written = load(folder / "problem.toml")
    assert written.moving.notes == ()
    for one, other in ((found.moving, written.moving), (found.fixed, written.fixed)):
        np.testing.assert_allclose(one.polyhedron.vertices, other.polyhedron.vertices, atol=1e-12)
    np.testing.assert_array_equal(found.goal, written.goal)


def test_a_unit_is_asked_for_with_the_size_to_choose_it_by(folder: Path) -> None:
    edit(folder / "plate.toml", 'unit = "mm"\n', "")
    with pytest.raises(fmopt.InputError) as caught:
        load(folder / "problem.toml")
    (fault,) = caught.value.faults
    assert (fault.code, fault.key, fault.line) == ("missing-key", "mesh", 7)
    assert "its size in the file's own numbers is 40 x 40 x 10" in fault.message
    assert "add 'unit' to [mesh]" in fault.advice


def test_a_part_that_states_no_features_has_none_by_another_name(folder: Path) -> None:
    edit(folder / "problem.toml", 'feature = "hole"', 'feature = "slot"')
    with pytest.raises(fmopt.InputError, match=r"no feature 'slot'; leave 'feature' out, to have it found with the"):
        load(folder / "problem.toml")


def test_a_plate_open_on_its_far_rim_serves_with_a_warning(folder: Path) -> None:
    points, triangles = triangles_of(plate((0.0123, 0.0083)))
    bottom = np.all(points[triangles][:, :, 2] == 0.0, axis=1)
    (folder / "plate.stl").write_text(stl_text(points, triangles[~bottom]))
    problem = load(folder / "problem.toml")
    clearance = measured_clearance(problem)
    assert clearance.per_side == pytest.approx(1.5e-4, abs=1e-9)
    (open_rim,) = [line for line in facts(problem, clearance)["warnings"] if "open" in line]
    assert open_rim.startswith("warning: plate: the mesh is open beside triangle")
    assert open_rim in explain(problem, clearance)
    mouth = np.all(points[triangles][:, :, 2] == 10.0, axis=1)
    (folder / "plate.stl").write_text(stl_text(points, triangles[~mouth]))
    with pytest.raises(fmopt.InputError, match=r"is open beside triangle \d+, .* mating faces are not all there"):
        load(folder / "problem.toml")


def test_facets_of_curves_add_to_the_errors_of_position(folder: Path) -> None:
    radius, sides = 0.005, 24
    sagitta = radius * (1.0 - np.cos(np.pi / sides))
    write_stl(folder / "rod.stl", Cylinder(radius, 0.03, sides))
    bore = Moved(Cylinder(radius + 1.5e-4, 0.02, sides), at(z=-0.005))
    write_stl(folder / "plate.stl", Difference(Box((0.04, 0.04, 0.01)), (bore,)))
    estimated = load(folder / "problem.toml")
    both = sagitta + (radius + 1.5e-4) * (1.0 - np.cos(np.pi / sides))
    assert [share.symbol for share in estimated.budget] == ["", "ε_v", "ε_v"]
    assert estimated.start_box[:3] == pytest.approx(np.array([3e-5, 3e-5, 0.0]) + both, rel=1e-4)
    assert estimated.start_box[3:] == pytest.approx(np.deg2rad([0.05] * 3))
    assert "moving part, facets of its mesh (ε_v): 0.042" in explain(estimated, measured_clearance(estimated))
    for name, deviation in (("rod", 0.2), ("plate", 0.0)):
        edit(folder / f"{name}.toml", 'unit = "mm"\n', f'unit = "mm"\ndeviation = {deviation}\n')
    stated = load(folder / "problem.toml")
    assert stated.start_box[0] == pytest.approx(2.3e-4)
    warnings = facts(stated, measured_clearance(stated))["warnings"]
    assert any("which is the clearance and more; give finer facets" in line for line in warnings)
