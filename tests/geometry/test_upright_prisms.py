"""Upright bodies as prisms less prisms: filleted outlines in mesh files, whose pieces make up the part exactly."""

import math
from pathlib import Path

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold

from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box, Difference, Hull, Moved, Prism, Union
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.part import mesh_part
from fmopt.geometry.upright_prisms import upright_prisms
from fmopt.spatial.se3 import Pose
from fmopt.verify.parts.covering import uncovered
from fmopt.verify.parts.solids import Shape
from tests.shared.files.mesh_files import binary_stl
from tests.shared.parts.families import Outline, widened
from tests.shared.parts.stated import as_stated

OUTLINES: dict[str, Outline] = {
    "L": ((0, 0), (20, 0), (20, 6), (8, 6), (8, 18), (0, 18)),
    "U": ((0, 0), (20, 0), (20, 18), (14, 18), (14, 6), (6, 6), (6, 18), (0, 18)),
    "T": ((0, 0), (20, 0), (20, 6), (13, 6), (13, 20), (7, 20), (7, 6), (0, 6)),
    "plus": (
        (6, 0),
        (12, 0),
        (12, 6),
        (18, 6),
        (18, 12),
        (12, 12),
        (12, 18),
        (6, 18),
        (6, 12),
        (0, 12),
        (0, 6),
        (6, 6),
    ),
}


def filleted(outline: Outline, radius: float, count: int) -> Outline:
    """An outline with `count` chords in place of each corner."""
    corners, found = np.array(outline, dtype=np.float64), list[np.ndarray]()
    for k, b in enumerate(corners):
        u, v = (other - b for other in (corners[k - 1], corners[(k + 1) % len(corners)]))
        u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
        half = 0.5 * math.acos(float(u @ v))
        middle = b + (u + v) / np.linalg.norm(u + v) * radius / math.sin(half)
        ends = [b + radius / math.tan(half) * way - middle for way in (u, v)]
        start, end = (math.atan2(y, x) for x, y in ends)
        sweep = (end - start + math.pi) % (2.0 * math.pi) - math.pi
        angles = start + sweep * np.linspace(0.0, 1.0, count + 1)
        found += [middle + radius * np.array([math.cos(angle), math.sin(angle)]) for angle in angles]
    return tuple((float(x), float(y)) for x, y in found)


def extruded(outline: Outline, low: float, high: float) -> Manifold:
    return Manifold.extrude(CrossSection([np.array(outline)]), high - low).translate((0.0, 0.0, low))


def made(kind: str, outline: Outline) -> Manifold:
    """A part of the kind, mm."""
    if kind == "collar":
        return extruded(outline, 0.0, 30.0) + extruded(widened(outline, 0.3), 20.0, 30.0)
    block = Manifold.cube((50.0, 50.0, 12.0)).translate((-15.0, -15.0, 0.0))
    hole = block - extruded(widened(outline, 0.1), 4.0 if kind == "blind" else -5.0, 20.0)
    return hole - extruded(widened(outline, 2.1), 7.0, 20.0) if kind == "counterbored" else hole


@pytest.mark.parametrize("family", sorted(OUTLINES))
@pytest.mark.parametrize("kind", ["blind", "through", "counterbored", "collar"])
def test_pieces_make_up_filleted_parts_exactly_however_they_are_turned(family: str, kind: str, tmp_path: Path) -> None:
    rng = np.random.default_rng([*family.encode(), *kind.encode()])
    outline = filleted(OUTLINES[family], float(rng.uniform(0.8, 2.0)), int(rng.integers(1, 4)))
    solid = made(kind, outline).rotate((0.0, 0.0, float(rng.uniform(0.0, 360.0)))).to_mesh64()
    path = tmp_path / "part.stl"
    path.write_bytes(binary_stl(np.asarray(solid.vert_properties)[:, :3], np.asarray(solid.tri_verts, dtype=np.int64)))
    stated = as_stated(mesh_part("part", load_mesh(path, "mm")))
    assert list(uncovered(Shape(stated.body), [Shape(piece) for piece in stated.pieces])) == []


def test_a_body_on_any_axis_comes_apart_and_one_that_leans_does_not() -> None:
    box, tool = Box((0.03, 0.02, 0.01)), Moved(Box((0.01, 0.03, 0.02)), Pose(np.array([0.0, 0.0, 0.004]), np.eye(3)))
    body = polyhedron(Difference(box, (tool,)))
    found = upright_prisms(body)
    assert found.base.volume - sum(one.volume for one in found.tools) == pytest.approx(body.volume)
    leaning = Hull(((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01)))
    assert upright_prisms(polyhedron(leaning)) is None


def test_a_body_with_one_section_within_another_does_not_come_apart() -> None:
    inside = Moved(Box((0.02, 0.02, 0.01)), Pose(np.array([0.0, 0.0, 0.003]), np.eye(3)))
    rim = Difference(Box((0.03, 0.03, 0.01)), (inside,))
    post = Prism(tuple((0.005 * math.cos(k), 0.005 * math.sin(k)) for k in range(6)), 0.01)
    assert upright_prisms(polyhedron(rim)) is not None
    assert upright_prisms(polyhedron(Union((rim, post)))) is None
