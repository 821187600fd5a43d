"""STEP files by their own surfaces: exact planes, rounds and fillets as stated, assemblies, parts from objects."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import pytest
import trimesh

from fmopt.errors import GeometryError, ResourceError
from fmopt.geometry.csg import Box as Block
from fmopt.geometry.csg import Difference, Moved
from fmopt.geometry.fit.find import find
from fmopt.geometry.part import mesh_part
from fmopt.geometry.part import part_of as part_of_solid
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.geometry.python_objects import imported_of
from fmopt.geometry.step.facets import facets_of
from fmopt.geometry.step.step_import import bodies, load_step
from fmopt.spatial.se3 import Pose, exp
from tests.shared.files import step_parts
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box, cut, cylinder

EXACT = 1e-9  # m


def turned(seed: int) -> Pose:
    r = np.random.default_rng(seed)
    return Pose(r.uniform(-80.0, 80.0, 3), exp(r.uniform(-1.5, 1.5, 3)))


def off_planes(body: Polyhedron, planes: np.ndarray, pose: Pose) -> float:
    """How far the plane faces (mm, before the pose) are from those of a polyhedron (m) at most, m."""
    worst = 0.0
    for *normal, offset in planes:
        n = pose.R @ normal
        own = [face for face in body.faces if face.normal @ n > 1.0 - 1e-6]
        assert own, normal
        corners = [body.vertices[list(face.vertices)] @ n - 1e-3 * (offset + n @ pose.p) for face in own]
        worst = max(worst, min(float(np.abs(each).max()) for each in corners))
    return worst


@pytest.mark.parametrize("name", step_parts.FAMILIES)
def test_plane_faces_are_those_of_the_file_in_any_unit_and_place(name: str, tmp_path: Path) -> None:
    seed = list(step_parts.FAMILIES).index(name)
    shape = step_parts.FAMILIES[name](np.random.default_rng(seed))
    pose, unit = turned(seed), ("mm", "m", "inch")[seed % 3]
    step_parts.write(tmp_path / "part.step", shape, unit, pose)
    mesh = load_step(tmp_path / "part.step")
    assert off_planes(mesh.body, step_parts.planes(shape), pose) <= EXACT
    assert mesh.mended == ()
    assert mesh.chord_error <= 1e-5
    fillets = name in ("filleted", "pocket", "pin")
    assert any("fillets are enclosed" in note for note in mesh.notes) == fillets
    if name in ("filleted", "pocket"):
        assert mesh.chord_error == 0.0
        true, area = step_parts.volume(shape), step_parts.area(shape)
        assert 0.0 <= mesh.body.volume * 1e9 - true <= 0.02 * area


@pytest.mark.parametrize("seed", range(4))
def test_free_forms_that_are_plane_are_read_as_planes(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2.0 * np.pi) + np.radians([0.0, 120.0, 240.0]) + rng.uniform(-0.4, 0.4, 3)
    corners = rng.uniform(6.0, 12.0) * np.column_stack([np.cos(angles), np.sin(angles)])
    peg = step_parts.loft(corners, step_parts.offset(corners, 1.5), 20.0, reverse=bool(seed % 2))
    if seed > 1:
        peg = cut(box(80.0, 80.0, 20.0), peg)
    pose = turned(seed)
    step_parts.write(tmp_path / "part.step", peg, "mm", pose)
    mesh = load_step(tmp_path / "part.step")
    assert mesh.chord_error == 0.0
    assert mesh.body.volume * 1e9 == pytest.approx(step_parts.volume(peg), rel=1e-9)
    if seed < 2:
        assert len(mesh.body.faces) == 5
        ends = {0.0: corners, 20.0: step_parts.offset(corners, 1.5)}
        points = np.array([(*at, z) for z, outline in ends.items() for at in outline])
        there = 1e-3 * (points @ pose.R.T + pose.p)
        assert np.abs(there[:, None] - mesh.body.vertices).max(axis=2).min(axis=1).max() <= EXACT


def test_fillets_are_inside_of_their_facets(tmp_path: Path) -> None:
    shape = step_parts.filleted(np.random.default_rng(5))
    step_parts.write(tmp_path / "part.step", shape)
    body = load_step(tmp_path / "part.step").body
    points = 1e-3 * step_parts.samples(shape)
    depth = (points @ body.normals.T - body.offsets).max(axis=1)
    assert depth.max() <= 1e-12
    assert -2e-5 < depth.min() < -1e-6


def test_facets_of_fillets_are_no_ends_of_a_peg(tmp_path: Path) -> None:
    shape = step_parts.filleted(np.random.default_rng(7))
    step_parts.write(tmp_path / "part.step", shape)
    body = load_step(tmp_path / "part.step").body
    x, y, z = np.ptp(body.vertices, axis=0)
    middle = Pose(np.append(0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))[:2], -0.005), np.eye(3))
    hole = Difference(Block((0.1, 0.1, 0.01)), (Moved(Block((x + 2e-4, y + 2e-4, 0.02)), middle),))
    fit = find(body, part_of_solid("plate", hole).polyhedron)
    np.testing.assert_allclose(np.abs(fit.solid.R[:, 2]), [0.0, 0.0, 1.0], atol=1e-12)
    assert fit.peg == pytest.approx(z, abs=EXACT)


def test_coarser_rounds_are_said_to_be_coarser(tmp_path: Path) -> None:
    write_step(tmp_path / "rod.step", cylinder(6.0, 30.0))
    for deviation in (1e-4, 1e-5, 1e-6):
        mesh = load_step(tmp_path / "rod.step", deviation)
        sides = len(mesh.body.faces) - 2
        assert mesh.chord_error == pytest.approx(0.006 * (1.0 - np.cos(np.pi / sides)), rel=1e-9)
        assert mesh.chord_error <= deviation
        assert sides & (sides - 1) == 0


@pytest.mark.wide
def test_bodies_of_an_assembly_are_named_and_placed(tmp_path: Path) -> None:
    peg, plate = box(10.0, 8.0, 30.0), cut(box(40.0, 40.0, 10.0), box(10.4, 8.4, 20.0, (0.0, 0.0, 3.0)))
    goal, away = Pose(np.array([0.0, 0.0, 3.0]), np.eye(3)), turned(3)
    path = tmp_path / "fit.step"
    step_parts.write_assembly(path, [("plate", plate, away), ("peg", peg, away.compose(goal)), ("peg", peg, goal)])
    one, two, three = bodies(path)
    assert [(body.name, body.number) for body in (one, two, three)] == [("plate", 1), ("peg_1", 2), ("peg_2", 3)]
    np.testing.assert_allclose(one.pose.inverse().compose(two.pose).vector(), [0, 0, 0.003, 0, 0, 0], atol=1e-12)
    assert two.mesh.body.vertices.max(axis=0) == pytest.approx([0.005, 0.004, 0.03], abs=EXACT)
    assert load_step(path, body="peg_2").body.volume == pytest.approx(2.4e-6)
    assert load_step(path, body="1").body.volume == pytest.approx(one.mesh.body.volume)
    with pytest.raises(GeometryError, match=r"holds 3 bodies: 1 'plate', 2 'peg_1', 3 'peg_2'; say which by body ="):
        load_step(path)
    with pytest.raises(GeometryError, match=r"has no body 'pin'; name one that it has, or give its number: 1 'plate'"):
        load_step(path, body="pin")


def test_files_that_hold_no_part_say_what_they_hold(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    block = box(10.0, 8.0, 30.0)
    write_step(path, step_parts.shell(block))
    with pytest.raises(GeometryError, match=r"holds 6 faces that bound no solid; they close: export them as a solid"):
        load_step(path)
    write_step(path, step_parts.shell(block, 1))
    with pytest.raises(GeometryError, match=r"no solid: 4 edges have a face on one side only, the first from \(.*\)"):
        load_step(path)
    with pytest.raises(GeometryError, match="its shell is not closed: 4 edges have a face on one side only"):
        facets_of(step_parts.shell(block, 1), 0.01)
    write_step(path, block)
    path.write_text(path.read_text().replace("LENGTH_UNIT()", "MASS_UNIT()"))
    with pytest.raises(GeometryError, match="does not say the unit of its lengths"):
        load_step(path)


def test_a_kernel_that_cannot_be_imported_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_step(tmp_path / "part.step", box(10.0, 8.0, 30.0))
    broken = tmp_path / "elsewhere" / "OCP"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("raise ImportError('libTK.so: cannot open shared object file')")
    monkeypatch.setattr(sys, "path", [str(broken.parent), *sys.path])
    monkeypatch.delitem(sys.modules, "OCP")
    listed = rf"install it anew: pip install --force-reinstall --no-deps cadquery-ocp=={version('cadquery-ocp')}"
    with pytest.raises(ResourceError, match=rf"does not work: libTK\.so: cannot open .*{listed}$"):
        load_step(tmp_path / "part.step")


def test_objects_of_python_become_the_same_part() -> None:
    x, y, z = np.random.default_rng(2).uniform(8.0, 30.0, 3)
    corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y)]) / 2.0
    mesh = trimesh.creation.box((x, y, z))
    mesh.apply_translation((0.0, 0.0, 0.5 * z))
    solid = manifold3d.Manifold.cube((x, y, z), True).translate((0.0, 0.0, 0.5 * z))
    mesh.units = "mm"
    read = [
        imported_of(box(x, y, z)),
        imported_of(box(0.1 * x, 0.1 * y, 0.1 * z), "cm"),
        imported_of(mesh),
        imported_of(solid, "mm"),
        imported_of((corners, z), "mm"),
        imported_of((1e-3 * corners[::-1], 1e-3 * z), "m"),
    ]
    made = [mesh_part("part", one) for one in read]
    expected = 5e-4 * np.array([x, y, 2.0 * z])
    for one in made:
        np.testing.assert_allclose(one.polyhedron.vertices.max(axis=0), expected, atol=EXACT)
        assert one.features == ()
    ring = imported_of(([corners, 0.5 * corners], 4.0), "mm").body
    assert ring.volume == pytest.approx(0.75 * x * y * 4.0e-9)


@pytest.mark.parametrize(
    ("thing", "unit", "words"),
    [
        (5, "mm", r"builtins\.int is no part; give a solid"),
        (([(0, 0), (1, 1), (0, 1), (1, 0)], 5.0), "mm", "bounds no area: Self-intersection"),
        (([(0, 0), (9, 0), (0, 9)], -1.0), "mm", "the height of an outline is -1.0"),
        (([(0, 0), (9, 0), (0, 9)], 5.0), None, "does not say its unit; give unit = one of m"),
        (([1, 2, 3], 5.0), "mm", r"has to be corners \(n, 2\)"),
        (trimesh.creation.box((9, 9, 30)), None, "the trimesh does not say its unit"),
        (manifold3d.Manifold(), "mm", "the mesh holds no triangles"),
    ],
)
def test_objects_that_are_no_part_say_why(thing: object, unit: Any, words: str) -> None:
    with pytest.raises(GeometryError, match=words):
        imported_of(thing, unit)


OWN_FILES = """
import cadquery as cq, build123d as bd, mujoco, trimesh
from fmopt.geometry.python_objects import imported_of
from fmopt.geometry.step.step_import import bodies, load_step
from pathlib import Path
dowel = cq.Workplane().circle(5).extrude(30).faces("<Z").chamfer(1)
bar = bd.Box(10, 8, 30)
cq.exporters.export(dowel, "cq.step")
bd.export_step(bar, "bd.step")
both = cq.Assembly().add(dowel, name="dowel").add(cq.Workplane().box(1, 2, 3), name="block", loc=cq.Location((9, 0, 0)))
both.export("both.step")
trimesh.creation.box((1, 2, 3)).export("tm.stl")
def near(a, b): assert abs(a - b) <= 2e-3 * b, (a, b)
true = dowel.val().Volume()
near(cq.importers.importStep("cq.step").val().Volume(), true)
near(bd.import_step("bd.step").volume, 2400)
near(trimesh.load_mesh("tm.stl").volume, 6)
assert mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>").ngeom == 1
for thing, volume in ((dowel, true), (dowel.val(), true), (bar, 2400)):
    near(1e9 * imported_of(thing).body.volume, volume)
near(1e9 * load_step(Path("cq.step")).body.volume, true)
near(1e9 * load_step(Path("bd.step")).body.volume, 2400)
named = bodies(Path("both.step"))
assert [body.name for body in named] == ["dowel", "block"], named
assert (1e3 * named[1].pose.p).round(9).tolist() == [9, 0, 0]
print("all of them read")
"""


def test_cad_libraries_and_fmopt_read_their_files_in_one_environment(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", OWN_FILES], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.endswith("all of them read\n"), done.stderr[-2000:]
