"""Readers held against solids whose volume, centre and inertia are known before they are written, by other writers."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from fmopt.errors import GeometryError
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.polyhedron import triangulated
from fmopt.task.toml.units import UNITS, evaluate
from tests.shared.files.mesh_files import ply_text, polygons_obj

A, B, C = 0.012, 0.008, 0.03  # m, edges of a box
TURN = trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
TURN[:3, 3] = 0.01, -0.02, 0.03
# An L of two boxes in mm: corners counter-clockwise, its area and centre by hand.
L = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 8.0), (8.0, 8.0), (8.0, 20.0), (0.0, 20.0)])
L_AREA, L_CENTRE, HEIGHT = 256.0, (160.0 * 10.0 + 96.0 * 4.0) / 256.0, 15.0
Writer = Callable[[np.ndarray, list[list[int]]], str]


def properties(vertices: np.ndarray, faces: Any) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume, centre and inertia about it of a polyhedron with convex faces, density 1."""
    fans = [(loop[0], loop[k], loop[k + 1]) for (loop,) in faces for k in range(1, len(loop) - 1)]
    mesh = trimesh.Trimesh(vertices, fans, process=False)
    return float(mesh.volume), np.array(mesh.center_mass), np.array(mesh.moment_inertia)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply", "glb"])
def test_a_box_of_another_writer_has_its_volume_centre_and_inertia(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"box.{kind.removesuffix('_ascii')}"
    mesh = trimesh.creation.box((A, B, C), TURN).apply_scale(1e3)
    if kind == "glb":
        mesh.apply_scale(1e-3)  # its unit is the metre
    path.write_bytes(written if isinstance(written := mesh.export(file_type=kind), bytes) else written.encode())
    body = load_mesh(path, "m" if kind == "glb" else "mm").body
    volume, centre, inertia = properties(body.vertices, [face.loops for face in body.faces])
    assert volume == pytest.approx(A * B * C, rel=1e-6)
    assert centre == pytest.approx(TURN[:3, 3], abs=1e-8)
    about = A * B * C / 12.0 * np.diag([B * B + C * C, A * A + C * C, A * A + B * B])
    assert inertia == pytest.approx(TURN[:3, :3] @ about @ TURN[:3, :3].T, rel=1e-5, abs=1e-6 * about.max())


@pytest.mark.parametrize(("kind", "write"), [("obj", polygons_obj), ("ply", ply_text)])
@pytest.mark.parametrize("sides", [3, 5, 8])
def test_a_prism_of_polygons_has_its_volume_and_centre(sides: int, kind: str, write: Writer, tmp_path: Path) -> None:
    """Polygons of many corners, written by hand."""
    turns = 2.0 * np.pi * np.arange(sides) / sides
    ring = 10.0 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    points = np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (0.0, HEIGHT)])
    walls = [[k, (k + 1) % sides, sides + (k + 1) % sides, sides + k] for k in range(sides)]
    (tmp_path / f"prism.{kind}").write_text(write(points, [[*range(sides)][::-1], [*range(sides, 2 * sides)], *walls]))
    body = load_mesh(tmp_path / f"prism.{kind}", "mm").body
    volume, centre, _ = properties(body.vertices, [face.loops for face in body.faces])
    assert volume == pytest.approx(1e-9 * HEIGHT * 50.0 * sides * math.sin(2.0 * np.pi / sides), rel=1e-9)
    assert centre == pytest.approx((0.0, 0.0, 5e-4 * HEIGHT), abs=1e-10)


@pytest.mark.parametrize(
    ("outline", "area", "around", "centre"),  # mm², mm, mm
    [
        (L, L_AREA, 80.0, (L_CENTRE, L_CENTRE)),
        ([(0, 0), (10, 0), (10, 10), (5, 3), (0, 10)], 65.0, 30.0 + 2.0 * math.sqrt(74.0), (5.0, 139.0 / 39.0)),
        ([(-3, 0), (3, 0), (3, 10), (9, 10), (9, 15), (-9, 15), (-9, 10), (-3, 10)], 150.0, 66.0, (0.0, 9.5)),
        ([(-9, 0), (9, 0), (9, 15), (4, 15), (4, 5), (-4, 5), (-4, 15), (-9, 15)], 190.0, 86.0, (0.0, 1225.0 / 190.0)),
    ],
    ids=["L", "notched", "T", "U"],
)
@pytest.mark.parametrize(("kind", "write"), [("obj", polygons_obj), ("ply", ply_text)])
def test_a_polygon_that_is_not_convex_is_one_face_from_whatever_corner_it_is_listed(
    outline: Any, area: float, around: float, centre: tuple[float, float], kind: str, write: Writer, tmp_path: Path
) -> None:
    n, path = len(outline), tmp_path / f"prism.{kind}"
    points = np.vstack([np.column_stack([outline, np.full(n, z)]) for z in (0.0, HEIGHT)]) @ TURN[:3, :3].T
    walls = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    for start in range(n):
        ring = np.roll(np.arange(n), -start)
        path.write_text(write(points, [ring[::-1].tolist(), (n + ring).tolist(), *walls]))
        body = load_mesh(path, "mm").body
        mesh = trimesh.Trimesh(1e3 * body.vertices, triangulated(body), process=False)
        assert (len(body.faces), mesh.volume) == (n + 2, pytest.approx(area * HEIGHT, rel=1e-9))
        assert mesh.area == pytest.approx(2.0 * area + around * HEIGHT, rel=1e-9)
        assert mesh.center_mass == pytest.approx(TURN[:3, :3] @ (*centre, 0.5 * HEIGHT), abs=1e-8)


def test_corners_that_stand_twice_and_polygons_far_away_or_without_area_are_read(tmp_path: Path) -> None:
    points = np.vstack([np.column_stack([L, np.full(6, z)]) for z in (0.0, HEIGHT)]) + 1000.0
    walls = [[k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k] for k in range(6)]
    for start in range(6):
        ring = np.roll([0, 1, 2, 3, 3, 4, 5], -start)  # the inner corner twice
        faces = [ring[::-1].tolist(), (6 + ring).tolist(), *walls, [0, 1, 1, 0], [0, 0, 1, 1]]
        (tmp_path / "L.obj").write_text(polygons_obj(points, faces))
        body = load_mesh(tmp_path / "L.obj", "mm").body
        assert len(body.faces) == 8
        assert body.volume == pytest.approx(1e-9 * L_AREA * HEIGHT, rel=1e-9)


def test_a_polygon_that_crosses_itself_is_named_with_its_line(tmp_path: Path) -> None:
    bow = np.array([(0.0, 0.0, 0.0), (2.0, 1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (1.0, 1.0, 3.0)])
    star = np.array([(np.cos(0.8 * np.pi * k), np.sin(0.8 * np.pi * k), 0.0) for k in range(5)])
    for points, face in ((bow, [0, 1, 2, 3]), (star, [0, 1, 2, 3, 4])):
        for kind, write, head in (("obj", polygons_obj, 0), ("ply", ply_text, 9)):
            (tmp_path / f"bow.{kind}").write_text(write(points, [[0, 1, 2], face]))
            line = head + len(points) + 2
            with pytest.raises(GeometryError, match=rf"bow\.{kind}, line {line}: the polygon crosses itself"):
                load_mesh(tmp_path / f"bow.{kind}", "mm")


@pytest.mark.parametrize("name", [name for lengths in UNITS.values() for name in lengths[1]])
def test_units_are_those_of_pint(name: str) -> None:
    import pint

    known = pint.UnitRegistry().Quantity(1.0, name).to_base_units().magnitude
    assert evaluate(f"1 {name}").value == pytest.approx(known, rel=1e-12)
