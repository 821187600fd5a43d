"""Which features can come together: compiled distances and angles against least squares, Shapely and dense samples."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls
from shapely.geometry import Point, Polygon

from fmopt.contact import detection
from fmopt.contact.primitive import _features
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from tests.shared.parts.square import block, peg, tilted

REACH, ANGLE = 1e-3, 0.05
POSES = [tilted((0.03, -0.05, 0.02)), tilted((0.0, 0.0, 0.0), 0.015), tilted((0.1, 0.0, 0.7), -0.0005)]


def vector(x: Array) -> detection.Vector:
    a, b, c = x.tolist()
    return a, b, c


def units(rng: np.random.Generator, *shape: int) -> Array:
    x = rng.normal(size=(*shape, 3))
    return np.asarray(x / np.linalg.norm(x, axis=-1, keepdims=True))


def matrix(pose: Pose) -> Array:
    return np.column_stack([pose.R, pose.p])


def test_distances_from_arcs_agree_with_least_squares() -> None:
    rng = np.random.default_rng(0)
    arcs, x = units(rng, 400, 2), units(rng, 400)
    arcs[:50, 1] = arcs[:50, 0]
    x[50:100] = arcs[50:100].sum(axis=1) / np.linalg.norm(arcs[50:100].sum(axis=1), axis=-1, keepdims=True)
    found = [detection.arc_distance(vector(one), vector(a), vector(b)) for one, (a, b) in zip(x, arcs, strict=True)]
    assert found == pytest.approx([nnls(pair.T, one)[1] for pair, one in zip(arcs, x, strict=True)], abs=1e-12)
    assert max(found) == 1.0
    assert max(found[50:100]) < 1e-13


def test_angles_between_arcs_agree_with_samples() -> None:
    rng = np.random.default_rng(1)
    share = np.linspace(0.0, 1.0, 401)[:, None]
    crossing = 0
    for a, b, c, d in units(rng, 300, 4):
        if min(a @ b, c @ d) < -0.5:
            continue  # samples along such arcs lie far apart
        along, across = (1.0 - share) * a + share * b, (1.0 - share) * c + share * d
        along, across = (x / np.linalg.norm(x, axis=1)[:, None] for x in (along, across))
        least = float(np.arccos(np.clip((along @ across.T).max(), -1.0, 1.0)))
        found = detection.arc_angle(vector(a), vector(b), vector(c), vector(d))
        assert found == pytest.approx(min(least, 0.5 * np.pi), abs=0.02)
        crossing += found == 0.0
    assert crossing > 5


def test_distances_between_segments_agree_with_least_squares() -> None:
    rng = np.random.default_rng(2)
    for n in range(200):
        a, b, c, d = rng.normal(size=(4, 3))
        if n % 4 == 0:
            d = c + 0.5 * (b - a)
        best = lsq_linear(np.column_stack([b - a, c - d]), c - a, (0.0, 1.0), tol=1e-14)
        found = detection.segment_distance(vector(a), vector(b), vector(c), vector(d))
        assert found == pytest.approx(np.sqrt(2.0 * best.cost), abs=1e-7)


@pytest.mark.parametrize("face", range(len(block().faces)))
def test_distances_from_faces_agree_with_shapely(face: int) -> None:
    rng, solid = np.random.default_rng(3), block()
    plane, walls = solid.faces[face], _features(solid).walls
    axes = np.linalg.svd(plane.normal[None])[2][1:]
    outer, *holes = [solid.vertices[list(loop)] @ axes.T for loop in plane.loops]
    polygon = Polygon(outer, holes)
    middle = solid.vertices[list(plane.vertices)].mean(axis=0)
    for x in middle + 0.03 * rng.normal(size=(100, 3)):
        expected = np.hypot(plane.normal @ x - plane.offset, polygon.distance(Point(*(axes @ x))))
        assert detection.face_distance(walls, face, vector(x)) == pytest.approx(expected, abs=1e-12)


def vertices_near(pointed: Polyhedron, faced: Polyhedron, T: Pose, lever: bool) -> Array:
    """Of each vertex and each face whether they are near, by their normals and distances."""
    near = []
    for v in _features(pointed).vertices:
        x = T.apply(pointed.vertices[v])
        cone = np.array([T.R @ pointed.faces[f].normal for f in pointed.vertex_faces[v]]).T
        limit = REACH + ANGLE * float(np.linalg.norm(pointed.vertices[v] if lever else x))
        for f, face in enumerate(faced.faces):
            turn = np.arcsin(min(nnls(cone, -face.normal)[1], 1.0))
            near.append(turn <= ANGLE and detection.face_distance(_features(faced).walls, f, vector(x)) <= limit)
    return np.array(near)


@pytest.mark.parametrize("pose", POSES)
def test_vertices_are_near_faces_by_their_normals_and_distance(pose: Pose) -> None:
    body, fixed = peg(), block()
    own, other, back = _features(body), _features(fixed), pose.inverse()
    found = detection.vertices_at_faces(own.corners, other.walls, matrix(pose), REACH, ANGLE, True)
    np.testing.assert_array_equal(found.ravel(), vertices_near(body, fixed, pose, True))
    assert 0 < found.sum() < found.size
    found = detection.vertices_at_faces(other.corners, own.walls, matrix(back), REACH, ANGLE, False)
    np.testing.assert_array_equal(found.ravel(), vertices_near(fixed, body, back, False))


@pytest.mark.parametrize("pose", POSES)
def test_edges_are_near_by_their_normals_and_distance(pose: Pose) -> None:
    body, fixed = peg(), block()
    own, other, sine = _features(body), _features(fixed), np.sin(np.radians(1.0))
    found = detection.edges_at_edges(own.ridges, other.ridges, matrix(pose), REACH, ANGLE, sine)
    for i, one in enumerate(own.edges):
        a, b = pose.apply(body.vertices[list(body.edges[one].vertices)])
        limit = REACH + ANGLE * np.linalg.norm(body.vertices[list(body.edges[one].vertices)], axis=1).max()
        normals = [vector(-pose.R @ body.faces[f].normal) for f in body.edges[one].faces]
        for j, two in enumerate(other.edges):
            c, d = fixed.vertices[list(fixed.edges[two].vertices)]
            cross = np.linalg.norm(np.cross(b - a, d - c)) / np.linalg.norm(b - a) / np.linalg.norm(d - c)
            beside = [vector(fixed.faces[f].normal) for f in fixed.edges[two].faces]
            near = detection.segment_distance(vector(a), vector(b), vector(c), vector(d)) <= limit
            assert found[i, j] == (near and cross >= sine and detection.arc_angle(*normals, *beside) <= ANGLE)
