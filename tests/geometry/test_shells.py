"""Closed shells that touch or overlap are one solid; objects of one file that lie apart are offered by name."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from fmopt.cli.asked import asked_problem
from fmopt.errors import GeometryError, InputError
from fmopt.geometry.mesh.mesh_import import load_mesh, mesh_bodies

SIZES = {  # of boxes, and their middles, mm; with the volume of what they are together
    "on top": ([((10, 10, 10), (0, 0, 0)), ((4, 4, 6), (0, 0, 8))], 1096.0),
    "sunk in": ([((10, 10, 10), (0, 0, 0)), ((4, 4, 6), (0, 0, 7))], 1080.0),
    "face to face": ([((10, 10, 10), (0, 0, 0)), ((10, 10, 10), (10, 0, 0))], 2000.0),
    "a frame": (
        [((10, 2, 5), (0, 4, 0)), ((10, 2, 5), (0, -4, 0)), ((2, 6, 5), (4, 0, 0)), ((2, 6, 5), (-4, 0, 0))],
        320.0,
    ),
}
TURN = trimesh.transformations.rotation_matrix(1.1, (1.0, -2.0, 0.5), (3.0, 40.0, -7.0))


def boxes(sizes: list[tuple[tuple[int, ...], tuple[int, ...]]], turned: bool) -> list[trimesh.Trimesh]:
    found = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in sizes]
    for box in found:
        if turned:
            box.apply_transform(TURN)
    return found


def obj_of(meshes: list[trimesh.Trimesh], names: list[str]) -> str:
    lines, count = list[str](), 0
    for mesh, name in zip(meshes, names, strict=True):
        lines += [f"o {name}"] if name else []
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += ["f " + " ".join(str(count + 1 + k) for k in face) for face in mesh.faces.tolist()]
        count += len(mesh.vertices)
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("kind", ["obj", "named objects", "stl"])
@pytest.mark.parametrize("case", SIZES)
def test_shells_that_touch_or_overlap_are_one_solid(case: str, kind: str, turned: bool, tmp_path: Path) -> None:
    sizes, volume = SIZES[case]
    meshes = boxes(sizes, turned)
    path = tmp_path / ("part.stl" if kind == "stl" else "part.obj")
    if kind == "stl":
        path.write_bytes(trimesh.util.concatenate(meshes).export(file_type="stl"))
    else:
        path.write_text(obj_of(meshes, [f"hull_{k}" if kind != "obj" else "" for k in range(len(meshes))]))
    found = load_mesh(path, "mm")
    assert found.body.volume == pytest.approx(1e-9 * volume, rel=1e-5)
    assert len(found.body.faces) == {"on top": 11, "sunk in": 11, "face to face": 6, "a frame": 10}[case]
    assert f"{len(sizes)} closed shells of " in found.notes[0]
    assert f"{np.prod(sizes[0][0])}" in found.notes[0]
    assert found.off < 1e-7


def test_slanted_faces_that_meet_but_for_rounding_are_moved_which_is_a_tolerance_of_form(tmp_path: Path) -> None:
    large = trimesh.creation.box((60.0, 60.0, 2.0), trimesh.transformations.translation_matrix((0.0, 0.0, -50.0)))
    at = trimesh.transformations.translation_matrix
    tip = trimesh.creation.box((4.0, 4.0, 6.0), TURN @ at((0.0, 0.0, 8.0)))
    top = trimesh.creation.box((10.0, 10.0, 10.0), TURN)
    for mesh in (top, tip):
        mesh.vertices = mesh.vertices.round(7)
    path = tmp_path / "part.obj"
    path.write_text(obj_of([large, top, tip], [""] * 3))
    found = load_mesh(path, "mm")
    assert "3 closed shells" in found.notes[0]
    assert "are 2 solids" in found.notes[0]
    assert found.body.volume == pytest.approx(1e-9 * (7200.0 + 1000.0 + 96.0), rel=1e-4)
    assert 1e-9 < found.off < 1e-7


def test_shells_that_share_an_edge_alone_are_not_joined(tmp_path: Path) -> None:
    meshes = boxes([((10, 10, 10), (0, 0, 0)), ((10, 10, 10), (10, 10, 0))], turned=False)
    (tmp_path / "part.obj").write_text(obj_of(meshes, ["", ""]))
    with pytest.raises(GeometryError, match="runs the same way"):
        load_mesh(tmp_path / "part.obj", "mm")


def test_points_without_a_surface_are_refused(tmp_path: Path) -> None:
    (tmp_path / "line.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nf 1 2 3\nf 2 3 4\n")
    with pytest.raises(GeometryError):
        load_mesh(tmp_path / "line.obj", "mm")


def test_shells_that_lie_apart_are_bodies_by_number(tmp_path: Path) -> None:
    meshes = boxes([((10, 10, 10), (0, 0, 0)), ((4, 4, 6), (0, 0, 9))], turned=True)
    (tmp_path / "part.stl").write_bytes(trimesh.util.concatenate(meshes).export(file_type="stl"))
    with pytest.raises(GeometryError, match="holds 2 bodies: 1, 2"):
        load_mesh(tmp_path / "part.stl", "mm")
    found = load_mesh(tmp_path / "part.stl", "mm", "2")
    assert (found.notes, len(found.body.faces)) == ((), 6)


def test_objects_that_lie_apart_are_offered_by_name(tmp_path: Path) -> None:
    meshes = boxes([((10, 10, 10), (0, 0, 0)), ((4, 4, 6), (0, 0, 9)), ((4, 4, 6), (0, 20, 9))], turned=False)
    path = tmp_path / "part.obj"
    path.write_text(obj_of(meshes, ["base", "pin", "pin"]))
    with pytest.raises(GeometryError, match=r"holds 3 bodies: 1 'base', 2 'pin_1', 3 'pin_2'"):
        load_mesh(path, "mm")
    assert load_mesh(path, "mm", "pin_2").body.vertices[:, 1].min() == pytest.approx(0.018)
    path.write_text(obj_of(meshes, ["2", "1", "7"]))  # digits are numbers, whatever bodies are called
    assert [(one.name, one.number) for one in mesh_bodies(path, "mm")] == [("2", 1), ("1", 2), ("7", 3)]
    volumes = [one.mesh.body.volume for one in mesh_bodies(path, "mm")]
    assert volumes == pytest.approx([1e-6, 96e-9, 96e-9])
    assert load_mesh(path, "mm", "1").body.volume == pytest.approx(1e-6)


def test_of_several_bodies_two_are_named_or_the_others_are_listed(tmp_path: Path) -> None:
    meshes = boxes([((10, 10, 10), (20 * k, 0, 0)) for k in range(4)], turned=False)
    (tmp_path / "four.obj").write_text(obj_of(meshes, ["a", "b", "c", "d"]))
    asked = asked_problem([tmp_path / "four.obj"], ("1 mm, 1 deg", None, "b", "d"))
    assert asked.bodies == ("b", "d")
    with pytest.raises(InputError, match=r"holds 3 other bodies: 1 'a', 3 'c', 4 'd'; say which"):
        asked_problem([tmp_path / "four.obj"], ("1 mm, 1 deg", None, "b", None))
