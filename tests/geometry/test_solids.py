"""Solids: membership laws, boundary oracles, exact coordinates, convex pieces, and what is refused."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import clip, pieces, polyhedron
from fmopt.geometry.csg import (
    Box,
    Cone,
    Cylinder,
    Difference,
    Moved,
    Prism,
    Solid,
    Union,
    Wedge,
    chamfered_box,
    corners,
    ring,
    sagitta,
)
from fmopt.geometry.polyhedron import Polyhedron, convex_hull_polyhedron, from_triangles, placed
from fmopt.spatial.se3 import Pose
from tests.shared.solids import contains, depth, frustum, raised

BLOCK = Difference(Box((0.06, 0.06, 0.04)), (raised(Box((0.0202, 0.0202, 0.03)), 0.01),))
CHAMFERED = Difference(BLOCK, (raised(frustum((0.0202, 0.0202), (0.0242, 0.0242), 0.002), 0.038),))
ROUND = Difference(Box((0.06, 0.06, 0.04)), (Cylinder(0.0101, 0.04, 12), raised(Cone(0.0101, 0.0121, 2e-3, 12), 0.038)))
TILTED = Moved(Box((0.03, 0.02, 0.05)), Pose.from_vector([0.004, -0.003, 0.002, 0.3, -0.5, 0.7]))
RIBBED = Difference(Box((0.06, 0.06, 0.04)), (Difference(raised(Box((0.04, 0.04, 0.03)), 0.01), (TILTED,)),))
SOLIDS = {
    "block": BLOCK,
    "chamfered": CHAMFERED,
    "round": ROUND,
    "ribbed": RIBBED,
    "wedge on plate": Union((Box((0.06, 0.06, 0.01)), raised(Wedge((0.04, 0.02, 0.02), 0.01), 0.01), TILTED)),
    "pegs": Difference(Union((chamfered_box((0.03, 0.02, 0.05), 0.002), TILTED)), (Cylinder(0.004, 0.06, 9),)),
}


def cloud(seed: int, n: int = 4000) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-0.04, -0.04, -0.02), (0.04, 0.04, 0.07), (n, 3))


def inside(bodies: tuple[Polyhedron, ...], points: np.ndarray) -> np.ndarray:
    return np.any([np.all(points @ body.normals.T <= body.offsets, axis=1) for body in bodies], axis=0)


@pytest.mark.parametrize("name", SOLIDS)
def test_de_morgan(name: str) -> None:
    points = cloud(1)
    a, b, c = SOLIDS[name], TILTED, raised(Cylinder(0.02, 0.03, 16), 0.005)
    away = contains(Difference(a, (b, c)), points)
    assert np.array_equal(away, contains(Difference(a, (Union((b, c)),)), points))
    assert np.array_equal(away, contains(Difference(Difference(a, (b,)), (c,)), points))
    assert np.array_equal(away, contains(a, points) & ~contains(Union((b, c)), points))
    both = contains(Difference(a, (Difference(a, (b,)),)), points)
    assert np.array_equal(both, contains(a, points) & contains(b, points))


@pytest.mark.parametrize("name", SOLIDS)
def test_pieces_are_convex_and_cover_exactly_the_solid(name: str) -> None:
    solid, points = SOLIDS[name], cloud(2)
    made = pieces(solid)
    assert all(edge.convex for piece in made for edge in piece.edges)
    clear = np.abs(depth(solid, points)) > 1e-9
    assert np.array_equal(inside(made, points)[clear], contains(solid, points)[clear])


@pytest.mark.parametrize("name", SOLIDS)
def test_boundary_volume_agrees_with_sampled_pieces(name: str) -> None:
    body = polyhedron(SOLIDS[name])
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    steps = np.linspace(0.0, 1.0, 49)[:-1] + 0.5 / 48
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    share = inside(pieces(SOLIDS[name]), low + grid * (high - low)).mean()
    assert body.volume == pytest.approx(share * np.prod(high - low), rel=0.02)


def test_box_peg() -> None:
    body = polyhedron(Box((0.02, 0.02, 0.05)))
    assert (len(body.vertices), len(body.faces), len(body.edges)) == (8, 6, 12)
    assert all(edge.convex for edge in body.edges)
    assert body.volume == pytest.approx(2e-5, rel=1e-12)
    assert body.diameter == pytest.approx(np.sqrt(0.02**2 + 0.02**2 + 0.05**2), rel=1e-12)
    assert all(len(faces) == 3 for faces in body.vertex_faces)


def test_block_with_blind_hole() -> None:
    body = polyhedron(BLOCK)
    assert (len(body.vertices), len(body.faces), len(body.edges)) == (16, 11, 24)
    assert body.volume == pytest.approx(0.06 * 0.06 * 0.04 - 0.0202**2 * 0.03, rel=1e-12)
    (top,) = [face for face in body.faces if len(face.loops) == 2]
    assert (top.normal.tolist(), top.offset) == ([0.0, 0.0, 1.0], 0.04)
    assert abs(body.vertices[list(top.loops[0]), :2]).min() == 0.03
    for edge in body.edges:
        ends = body.vertices[list(edge.vertices)]
        reflex = bool(np.all(np.abs(ends[:, :2]) < 0.02) and not np.all(ends[:, 2] == 0.04))
        assert edge.convex is not reflex
    for loops, sense in ((top.loops[0], 1.0), (top.loops[1], -1.0)):
        x, y = body.vertices[list(loops), :2].T
        assert sense * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0


@pytest.mark.parametrize("solid", [BLOCK, CHAMFERED])
def test_axis_parallel_coordinates_are_kept_to_the_bit(solid: Solid) -> None:
    known = {0.0, 0.01, 0.04, 0.0101, -0.0101, 0.03, -0.03, 0.0121, -0.0121, 0.038}
    assert set(polyhedron(solid).vertices.ravel().tolist()) <= known
    assert {abs(offset) for piece in pieces(BLOCK) for offset in piece.offsets} <= known
    assert {x for piece in pieces(BLOCK) for x in piece.vertices.ravel().tolist()} <= known


def test_a_cavity_is_a_second_shell() -> None:
    body = polyhedron(Difference(Box((0.06, 0.06, 0.04)), (raised(Box((0.02, 0.02, 0.02)), 0.01),)))
    assert body.volume == pytest.approx(0.06 * 0.06 * 0.04 - 0.02**3, rel=1e-12)
    assert (len(body.faces), sum(edge.convex for edge in body.edges)) == (12, 12)


def test_blind_hole_leaves_five_full_slabs() -> None:
    made = pieces(BLOCK)
    volumes = sorted(piece.volume for piece in made)
    assert volumes == pytest.approx([0.06 * 0.06 * 0.01, *[0.06 * 0.04 * (0.03 - 0.0101)] * 4], rel=1e-12)
    assert len(pieces(CHAMFERED)) == 5
    assert len(pieces(ROUND)) == 12


def test_quarter_turns_are_exact() -> None:
    turned = polyhedron(Moved(Box((0.02, 0.04, 0.06)), Pose.from_vector([0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0])))
    assert set(turned.vertices.ravel().tolist()) == {0.0, 0.06, 0.02, -0.02, 0.01, -0.01}
    assert set(np.abs(turned.normals).ravel().tolist()) == {0.0, 1.0}


@given(st.integers(3, 200))
@settings(max_examples=30, deadline=None)
def test_rings_are_mirror_symmetric_to_the_bit(sides: int) -> None:
    points = {(float(x), float(y)) for x, y in ring(1.0, sides)}
    assert {(x, -y) for x, y in points} == points
    if sides % 2 == 0:
        assert {(-x, -y) for x, y in points} == points
    assert np.allclose(np.hypot(*np.array(sorted(points)).T), 1.0, atol=1e-15)


def test_sagitta_is_the_gap_between_circle_and_polygon() -> None:
    middle = ring(0.01, 32)[[0, -1]].mean(axis=0)
    assert sagitta(Union((Box((1.0, 1.0, 1.0)), raised(Cylinder(0.01, 1.0, 32), 0.0)))) == pytest.approx(
        0.01 - np.hypot(*middle), rel=1e-9
    )
    assert sagitta(Difference(BLOCK, (Cone(0.02, 0.0, 0.01, 8),))) == pytest.approx(0.02 * (1 - np.cos(np.pi / 8)))
    assert sagitta(CHAMFERED) == 0.0


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_clip_splits_volume(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = convex_hull_polyhedron(rng.normal(size=(12, 3)))
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    offset = float(normal @ body.vertices.mean(axis=0))
    below, above = clip(body, normal, offset), clip(body, -normal, -offset)
    assert all(edge.convex for edge in below.edges)
    assert below.volume + above.volume == pytest.approx(body.volume, rel=1e-9)


def test_clip_keeps_vertices_on_the_plane() -> None:
    body = polyhedron(Box((0.02, 0.02, 0.05)))
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    half = clip(body, diagonal, 0.0)
    assert {tuple(v) for v in half.vertices.tolist()} < {tuple(v) for v in body.vertices.tolist()}
    assert len(half.faces) == 5
    assert clip(body, diagonal, 1.0) is body
    assert clip(body, diagonal, -1.0) is None


def test_triangles_of_a_subdivided_box_merge() -> None:
    box = convex_hull_polyhedron(corners(Box((2.0, 2.0, 1.0))))
    points, triangles = [*box.vertices], []
    for face in box.faces:
        (loop,) = face.loops
        centre = len(points)
        points.append(box.vertices[list(loop)].mean(axis=0))
        triangles += [(a, b, centre) for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
    merged = from_triangles(np.array(points), np.array(triangles))
    assert (len(merged.vertices), len(merged.faces), len(merged.edges)) == (8, 6, 12)
    with pytest.raises(GeometryError, match=r"open: edge .* has triangle"):
        from_triangles(np.array(points), np.array(triangles[1:]))
    with pytest.raises(GeometryError, match="inside out: triangle 0"):
        from_triangles(np.array(points), np.array(triangles)[:, ::-1])
    with pytest.raises(GeometryError, match=r"same way in triangles 20 and 23"):
        from_triangles(np.array(points), np.array([*triangles[:-1], triangles[-1][::-1]]))


def test_placing_moves_planes_with_points() -> None:
    pose = Pose.from_vector([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    body = polyhedron(CHAMFERED)
    moved = placed(body, pose)
    assert np.allclose(moved.normals, body.normals @ pose.R.T, atol=1e-12)
    assert np.allclose(moved.offsets, body.offsets + moved.normals @ pose.p, atol=1e-15)
    assert moved.volume == pytest.approx(body.volume, rel=1e-12)


def test_values_stay_read_only_through_pickling() -> None:
    body = pickle.loads(pickle.dumps(polyhedron(BLOCK)))
    for array in (body.vertices, body.faces[0].normal):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_large_tool_of_many_sides_nicks_a_small_body() -> None:
    """What a tool takes away counts beside the body, however much larger the tool itself is."""
    angles = [math.pi * (2 * k + 1) / 8 for k in range(8)]
    octagon = Prism(tuple((0.2 * math.cos(a), 0.2 * math.sin(a)) for a in angles), 0.4)
    nick = Pose(np.array([0.48e-3 + 0.2 * math.cos(math.pi / 8), 0.0, -0.2]), np.eye(3))
    left = pieces(Difference(Box((1e-3, 1e-3, 1e-3)), (Moved(octagon, nick),)))
    assert sum(piece.volume for piece in left) == pytest.approx(0.98e-9, rel=1e-9)
