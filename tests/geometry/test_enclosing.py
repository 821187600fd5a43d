"""Convex bodies that enclose solids with curved faces: nowhere smaller, and as far out as they say."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, Manifold, Mesh64, OpType

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import union_manifold
from fmopt.geometry.enclosing import enclosing
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.part import mesh_part
from fmopt.spatial.se3 import exp

ROUND = 64


def block(x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Manifold:
    return Manifold.cube((x, y, z)).translate((at[0] - x / 2, at[1] - y / 2, at[2]))


def flared() -> Manifold:
    """A plate with a square pocket whose rim is rounded all the way round, saddles at its corners."""
    levels = np.linspace(0.0, 1.0, 7)
    outlines = [
        CrossSection.square((10.2, 10.2), center=True).offset(2.0 - np.sqrt(1.0 - z**2), circular_segments=32)
        for z in levels
    ]
    cuts = [
        Manifold.extrude(outline, 1.0 / 6.0 + 1e-3).translate((0.0, 0.0, 14.0 + z))
        for z, outline in zip(levels[:-1], outlines[1:], strict=True)
    ]
    pocket = Manifold.extrude(outlines[0], 12.0).translate((0.0, 0.0, 4.0))
    return block(40, 30, 15) - Manifold.batch_boolean([pocket, *cuts], OpType.Add)


SOLIDS = {
    "ball on a post": block(10, 10, 20) + Manifold.sphere(4.9, ROUND).translate((0, 0, 20)),
    "knob": Manifold.cylinder(30, 8, 8, ROUND) + Manifold.sphere(15, ROUND).scale((1, 1, 0.4)).translate((0, 0, 33)),
    "flared pocket": flared(),
    "ring": Manifold.cylinder(6, 12, 12, 48) - Manifold.cylinder(6, 8, 8, 48),
}


def arrays(solid: Manifold) -> tuple[np.ndarray, np.ndarray]:
    mesh = solid.to_mesh64()
    return 1e-3 * np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("turned", [False, True])
def test_bodies_enclose_the_solid_and_are_no_farther_out_than_they_say(name: str, turned: bool) -> None:
    points, triangles = arrays(SOLIDS[name])
    points = points @ exp([0.3, -0.7, 1.1]).T if turned else points
    found = enclosing(points, triangles)
    whole = Manifold(Mesh64(vert_properties=np.ascontiguousarray(points), tri_verts=triangles.astype(np.uint64)))
    union = union_manifold(found.bodies)
    assert (whole - union).volume() < 1e-6 * whole.volume()
    assert found.boundary.volume == pytest.approx(union.volume(), rel=1e-6)
    assert union.volume() - whole.volume() < found.off * whole.surface_area() + 1e-6 * whole.volume()
    assert found.off < 5e-3 * np.linalg.norm(np.ptp(points, axis=0))


def grid(tool: Manifold, x: float, y: float) -> Manifold:
    return Manifold.batch_boolean([tool.translate((i * x, j * y, 0)) for i in (-1, 1) for j in (-1, 1)], OpType.Add)


PLANE = {
    "four pins": block(50, 25, 12) + grid(block(4, 3, 20, (0, 0, 12)), 18, 8),
    "screw holes": block(50, 50, 6)
    + block(12, 8, 26)
    - grid(Manifold.cylinder(8, 2, 2, 24).translate((0, 0, -1)), 19, 19),
}


@pytest.mark.parametrize("name", PLANE)
@pytest.mark.parametrize("seed", range(5))
def test_plane_faces_in_single_precision_are_cut_as_exact_ones(name: str, seed: int) -> None:
    points, triangles = arrays(PLANE[name])
    turned = (points @ exp(np.random.default_rng(seed).normal(size=3)).T).astype(np.float32).astype(np.float64)
    noise = 0.5 * float(np.spacing(np.float32(np.abs(turned).max())))
    found = enclosing(turned, triangles, noise).boundary.volume
    assert found == pytest.approx(1e-9 * PLANE[name].volume(), rel=1e-4)


def test_walls_of_a_pocket_stay_where_they_are() -> None:
    found = enclosing(*arrays(SOLIDS["flared pocket"]))
    walls = [face for face in found.boundary.faces if abs(abs(face.normal[0]) - 1.0) < 1e-9]
    assert min(abs(face.offset) for face in walls) == pytest.approx(6.1e-3, abs=1e-9)


def test_a_ring_comes_apart_exactly() -> None:
    found = enclosing(*arrays(SOLIDS["ring"]))
    assert found.off < 1e-9
    assert len(found.bodies) <= 48


@pytest.mark.parametrize("name", ["ball on a post", "knob"])
def test_a_file_with_surfaces_curved_both_ways_is_a_part(name: str, tmp_path: Path) -> None:
    points, triangles = arrays(SOLIDS[name])
    path = tmp_path / "part.stl"
    path.write_bytes(trimesh.Trimesh(1e3 * points, triangles).export(file_type="stl"))
    part = mesh_part("part", load_mesh(path, "mm"))
    assert any("nowhere smaller" in note for note in part.notes)
    assert part.polyhedron.volume == pytest.approx(1e-9 * SOLIDS[name].volume(), rel=0.03)


def test_a_surface_that_is_open_is_refused() -> None:
    points, triangles = arrays(SOLIDS["ring"])
    with pytest.raises(GeometryError, match="bounds no solid"):
        enclosing(points, triangles[1:])
