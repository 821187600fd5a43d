"""Intervals of C-surface values in space: sampled turns and shifts, and the plane as a special case."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import Kind as SpatialKind
from fmopt.contact.primitive import near_contacts
from fmopt.papers.basanez_suarez.contact import Kind
from fmopt.papers.basanez_suarez.spatial import Interval, Turns, edge_edge, face_vertex, vertex_face
from fmopt.spatial.se3 import Pose, exp, log
from tests.shared.parts.square import MID_DEPTH, block, peg
from tests.shared.planar_sampling import instances

Z = np.array([0.0, 0.0, 1.0])


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose(0.1 * rng.normal(size=3), exp(rng.normal(size=3)))


def unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def turns(rng: np.random.Generator, angle: float, count: int, axis: np.ndarray | None = None) -> np.ndarray:
    """Rotation matrices (count, 3, 3) by up to `angle`, most by just that."""
    sizes = min(angle, math.pi) * np.where(rng.uniform(size=count) < 0.8, 1.0, rng.uniform(size=count))
    axes = rng.normal(size=(count, 3)) if axis is None else axis * rng.choice([-1.0, 1.0], size=(count, 1))
    return np.array([exp(size * a / np.linalg.norm(a)) for size, a in zip(sizes, axes, strict=True)])


def check(interval: Interval, values: np.ndarray, short: float) -> None:
    size = max(abs(interval.low), abs(interval.high))
    assert interval.low <= values.min() + 1e-12 * size
    assert values.max() <= interval.high + 1e-12 * size
    assert max(values.min() - interval.low, interval.high - values.max()) <= short * (interval.high - interval.low)


@pytest.mark.parametrize("angle", [0.003, 0.3, 2.0, 4.0])
def test_vertex_and_face_in_space(angle: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(6):
        pose, n, v, w = random_pose(rng), unit(rng), 0.05 * rng.normal(size=3), 0.1 * rng.normal(size=3)
        offset, radius = 0.02 * rng.normal(), 1e-3 * rng.uniform()
        R = turns(rng, angle, 3000)
        shift = radius * np.sign(rng.normal(size=3000))
        values = (pose.p + R @ (pose.R @ v)) @ n - offset + shift
        check(vertex_face(pose, v, n, offset, Turns(angle), radius), values, 0.05)
        normals = R @ (pose.R @ n)
        values = normals @ (w - pose.p) - offset + shift
        check(face_vertex(pose, n, offset, w, Turns(angle), radius), values, 0.05)


@pytest.mark.parametrize(("angle", "short"), [(0.0, 1e-9), (0.003, 0.06), (0.1, 0.2), (1.0, 1.0)])
@pytest.mark.parametrize("about_axis", [False, True])
def test_edges_in_space(angle: float, short: float, about_axis: bool) -> None:
    rng = np.random.default_rng(2)
    count = 0
    while count < 6:
        pose, moving, e = random_pose(rng), 0.05 * rng.normal(size=(2, 3)), 0.05 * rng.normal(size=3)
        # The edges' lines pass each other within 0.1 mm.
        fixed = pose.apply(moving.mean(axis=0)) + 1e-4 * unit(rng) + np.outer([-0.4, 0.6], e)
        a = pose.R @ (moving[1] - moving[0])
        if np.linalg.norm(np.cross(a, e)) < 0.4 * np.linalg.norm(a) * np.linalg.norm(e):
            continue
        count += 1
        radius, axis = 1e-4 * rng.uniform(), unit(rng)
        R = turns(rng, angle, 3000, axis if about_axis else None)
        m = np.cross(R @ a, e)
        m /= np.linalg.norm(m, axis=1, keepdims=True)
        values = np.sum(m * (pose.p + R @ (pose.R @ moving[0]) - fixed[0]), axis=1)
        values += radius * np.sign(rng.normal(size=3000))
        interval = edge_edge(pose, moving, fixed, Turns(angle, axis if about_axis else None), radius)
        if math.isinf(interval.high - interval.low):
            assert angle > 0.3
        else:
            check(interval, values, short)


def test_the_bound_over_turns_is_exact() -> None:
    rng = np.random.default_rng(3)
    for i in range(60):
        n, u = rng.normal(size=(2, 3))
        angle = 10.0 ** rng.uniform(-8.0, 0.6)
        size = float(np.linalg.norm(n) * np.linalg.norm(u))
        between = math.acos(float(n @ u) / size)
        high = size * math.cos(max(between - min(angle, math.pi), 0.0))
        low = size * math.cos(min(between + min(angle, math.pi), math.pi))
        found = Turns(angle).values(np.outer(n, u))
        assert (found.low, found.high) == pytest.approx((low, high), abs=1e-13 * size)
        M = rng.normal(size=(3, 3))
        M = M + M.T if i % 3 == 0 else M
        found = Turns(angle).values(M)
        sampled = np.einsum("kij,ij->k", turns(rng, angle, 300), M)
        assert found.low - 1e-14 * np.abs(M).sum() <= sampled.min()
        assert sampled.max() <= found.high + 1e-14 * np.abs(M).sum()
        assert climbed(M, angle, turns(rng, angle, 200)) == pytest.approx(found.high, abs=1e-6 * np.abs(M).sum())


def climbed(M: np.ndarray, angle: float, starts: np.ndarray) -> float:
    """Greatest tr(RᵀM) over turns by up to `angle`, climbed to by shrinking random steps from the best start."""
    rng = np.random.default_rng(9)
    angle = min(angle, math.pi)
    best, value = starts[np.argmax(np.einsum("kij,ij->k", starts, M))], -math.inf
    for step in angle * 0.6 ** np.arange(28):
        tries = [exp(step * v) @ best for v in rng.normal(size=(40, 3))] + [best]
        inside = [clamped(R, angle) for R in tries]
        values = [float(np.sum(R * M)) for R in inside]
        best, value = inside[int(np.argmax(values))], max(values)
    return value


def clamped(R: np.ndarray, angle: float) -> np.ndarray:
    r = log(R)
    size = float(np.linalg.norm(r))
    return R if size <= angle else np.asarray(exp(r * (angle / size)))


def test_extruded_planar_contacts_have_the_planar_intervals() -> None:
    rng = np.random.default_rng(4)
    for kind in Kind:
        for instance in instances(kind, None, 100, seed=61):
            cu, phi = instance.cu, instance.phi
            p = np.array([*instance.configurations(rng.uniform(size=6)), rng.normal()])
            pose, about_z = Pose(p, exp(phi * Z)), Turns(cu.spread, Z)
            e = cu.edge[1] - cu.edge[0]
            normal = np.array([e[1], -e[0], 0.0]) / math.hypot(*e)
            offset, height = float(normal[:2] @ cu.edge[0]), rng.normal()
            vertex = np.array([*cu.vertex, height])
            if kind is Kind.TYPE_1:
                spatial = vertex_face(pose, vertex, normal, offset, about_z, cu.radius)
            else:
                spatial = face_vertex(pose, normal, offset, vertex, about_z, cu.radius)
            planar = cu.value_interval(np.array([p[0], p[1], phi]))
            size = cu.at(phi).size + float(np.hypot(*p[:2]))
            np.testing.assert_allclose((spatial.low, spatial.high), planar, rtol=0.0, atol=1e-12 * size)
            # A contact that deviations can make is possible in space too; turns about any axis only add.
            assert spatial.widened(1e-12 * size).possible
            free = vertex_face(pose, vertex, normal, offset, Turns(cu.spread), cu.radius)
            assert kind is Kind.TYPE_2 or (
                free.low <= spatial.low + 1e-12 * size and spatial.high <= free.high + 1e-12 * size
            )


def test_possible_means_the_same_in_the_middle_of_an_edge() -> None:
    rng = np.random.default_rng(5)
    agreed = 0
    for instance in instances(Kind.TYPE_1, None, 200, seed=62):
        cu, phi = instance.cu, instance.phi
        e = cu.edge[1] - cu.edge[0]
        if math.hypot(*e) < 4.0 * instance.uncertainty:
            continue
        normal = np.array([e[1], -e[0]]) / math.hypot(*e)
        middle = instance.configurations(np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.0]))
        for _ in range(5):
            p = middle + 3.0 * rng.normal() * instance.uncertainty * normal
            pose, about_z = Pose(np.array([*p, 0.0]), exp(phi * Z)), Turns(cu.spread, Z)
            face = np.array([*normal, 0.0])
            spatial = vertex_face(
                pose, np.array([*cu.vertex, 0.0]), face, float(normal @ cu.edge[0]), about_z, cu.radius
            )
            assert spatial.possible == bool(cu.contains([*p, phi]))
            agreed += 1
    assert agreed > 50


def test_without_deviations_they_are_the_surfaces() -> None:
    moving, fixed = peg(), block()
    pose = MID_DEPTH.moved([1e-4, -2e-4, 3e-4, 0.01, -0.02, 0.03])
    contacts = near_contacts(moving, fixed, MID_DEPTH, reach=1e-3, angle=0.02)
    still, seen = Turns(0.0), set()
    for contact, value in zip(contacts, Surfaces.of(contacts, moving, fixed).values(pose), strict=True):
        seen.add(contact.kind)
        match contact.kind:
            case SpatialKind.VERTEX_FACE:
                face = fixed.faces[contact.fixed_feature]
                found = vertex_face(pose, moving.vertices[contact.moving[0]], face.normal, face.offset, still, 0.0)
            case SpatialKind.FACE_VERTEX:
                face = moving.faces[contact.moving_feature]
                found = face_vertex(pose, face.normal, face.offset, fixed.vertices[contact.fixed[0]], still, 0.0)
            case SpatialKind.EDGE_EDGE:
                edges = moving.vertices[list(contact.moving)], fixed.vertices[list(contact.fixed)]
                found = edge_edge(pose, *edges, still, 0.0)
        assert (found.low, found.high) == pytest.approx((value, value), abs=1e-15)
    assert {SpatialKind.VERTEX_FACE, SpatialKind.EDGE_EDGE} <= seen


def test_edges_that_may_become_parallel_are_bounded_by_nothing() -> None:
    pose = Pose.identity()
    found = edge_edge(pose, [(0, 0, 0), (1, 0.01, 0)], [(0, 0, 0.1), (1, 0, 0.1)], Turns(0.1), 0.0)
    assert found == Interval(-math.inf, math.inf)
    assert found.possible


def test_refusals() -> None:
    with pytest.raises(ValueError, match=r"angle is -0\.1"):
        Turns(-0.1)
    with pytest.raises(ValueError, match="no length"):
        edge_edge(Pose.identity(), np.zeros((2, 3)), [(0, 0, 0), (1, 0, 0)], Turns(0.0), 0.0)
