"""What touches a wall and its rims along a piece of motion, against the plain formula; compiled and as written."""

from typing import Any

import numpy as np
import pytest

from fmopt.contact.primitive import edge_edge
from fmopt.geometry.csg import Box, Difference, Moved, Union
from fmopt.geometry.part import Part, part_of
from fmopt.planning.moves import contact_transition as flush
from fmopt.planning.moves.contact_transition import DOUBT, Edges, Rims
from fmopt.spatial.se3 import Pose, cross, exp
from fmopt.spatial.values import Array


def both(kernel: Any) -> tuple[Any, Any]:
    """A kernel, compiled and as it is written."""
    return kernel, kernel.py_func


def parts() -> tuple[Part, Part]:
    lowered = Pose(np.array([0.0, 0.0, -0.02]), np.eye(3))
    pocket = Moved(Box((0.02, 0.02, 0.04)), Pose(np.array([0.0, 0.0, 0.0]), np.eye(3)))
    block = Difference(Moved(Box((0.06, 0.06, 0.04)), lowered), (pocket,))
    return part_of("peg", Box((0.012, 0.016, 0.03))), part_of("block", block)


def wall(moving: Part, fixed: Part) -> tuple[Array, Rims, Edges, list[int], list[int]]:
    """The lower face of the peg in a wall of the pocket: its vertices, rims and edges, and the numbers of both."""
    body, block = moving.polyhedron, fixed.polyhedron
    number = next(n for n, f in enumerate(block.faces) if f.normal[0] < -0.99 and f.offset > -0.015)
    own = [i for i, v in enumerate(body.vertices) if v[2] == body.vertices[:, 2].min()]
    edges = [i for i, e in enumerate(body.edges) if set(e.vertices) <= set(own)]
    sides = [i for i, e in enumerate(block.edges) if number in e.faces]
    sides.sort(key=lambda i: not block.edges[i].convex)
    convex = [i for i in sides if block.edges[i].convex]
    ends = np.array([block.vertices[list(block.edges[i].vertices)] for i in sides])
    middle = block.vertices[list(block.faces[number].loops[0])].mean(axis=0)
    inward = cross(block.faces[number].normal, ends[:, 1] - ends[:, 0])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    inward *= np.sign(np.vecdot(inward, middle - ends[:, 0]))[:, None]
    runs = []
    for part, numbers in ((body, edges), (block, convex)):
        along = np.array([np.subtract(*part.vertices[list(part.edges[i].vertices)[::-1]]) for i in numbers])
        runs += [along / np.linalg.norm(along, axis=1)[:, None]]
        runs += [np.array([part.normals[list(part.edges[i].faces)].sum(axis=0) for i in numbers])]
    places = np.array([[own.index(v) for v in body.edges[i].vertices] for i in edges], dtype=np.intp)
    ahead, normals, other, others = runs
    return body.vertices[own], (ends[:, 0].copy(), inward), (places, ahead, normals, other, others), edges, convex


def plainly(vertices: Array, across: Rims, edges: Edges, pose: Pose, depth: Array, doubt: Array) -> tuple[Any, Any]:
    """Which vertices are listed, and which edges cross which convex rims, in plain NumPy."""
    points, inward = across
    convex = len(edges[3])
    side = np.where((depth > doubt).all(axis=0), 1, np.where((depth < -doubt).all(axis=0), -1, 0))
    sure = side == 1
    sure[:, convex:] = side[:, convex:] >= 0
    joined = sure.copy()
    for a, b in edges[0]:
        joined[a] |= sure[b] & (side[a] == 0)
        joined[b] |= sure[a] & (side[b] == 0)
    listed = joined.all(axis=1)
    beyond = (side == -1) | ((side == 0) & listed[:, None])
    over = np.array([(sure[a] & beyond[b]) | (sure[b] & beyond[a]) for a, b in edges[0]])[:, :convex]
    for e, r in zip(*np.nonzero(over), strict=True):
        a, b = pose.apply(vertices[edges[0][e]])
        rise = float((b - a) @ inward[r])
        x = a + np.clip((points[r] - a) @ inward[r] / rise, 0.0, 1.0) * (b - a)
        inside = np.vecdot(inward, x - points) > -DOUBT
        inside[r] = True
        over[e, r] = abs(rise) > 1e-3 * np.linalg.norm(b - a) and inside.all()
    return listed, over


def test_what_touches_a_wall_is_what_the_plain_formula_finds() -> None:
    moving, fixed = parts()
    vertices, across, edges, numbers, rim_numbers = wall(moving, fixed)
    rng = np.random.default_rng(0)
    listed_sometimes, crossings, ways = set(), 0, set()
    for _ in range(200):
        at = rng.uniform(-0.006, 0.006, 3) + np.array([0.0, 0.0, 0.02])
        start = Pose(at, exp(rng.normal(size=3) * [0.6, 0.6, 2.0]))
        goal = start.moved(rng.normal(size=6) * [1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02])
        p, R = np.array([start.p, goal.p]), np.array([start.R, goal.R])
        shape = 2, len(vertices), len(across[0])
        doubt = rng.uniform(0.0, 1e-3, shape)
        for depths, pattern in zip(both(flush.depths), both(flush.pattern), strict=True):
            depth, rows = np.empty(shape), np.empty((*shape, 6))
            depths(vertices, across, p, R, depth, rows)
            arms = np.array([vertices @ pose.R.T for pose in (start, goal)])[:, :, None]
            expected = np.vecdot(across[1], arms + p[:, None, None] - across[0])
            assert depth == pytest.approx(expected, abs=1e-16)
            assert rows[..., :3] == pytest.approx(np.broadcast_to(across[1], rows[..., :3].shape))
            assert rows[..., 3:] == pytest.approx(cross(arms, across[1]), abs=1e-16)
            found = np.empty(len(vertices) + len(numbers) * len(rim_numbers), dtype=np.uint8)
            pattern(vertices, across, edges, (p[0], R[0]), (depth, doubt), found)
            listed, over = plainly(vertices, across, edges, start, depth, doubt)
            assert found[: len(vertices)].tolist() == listed.tolist()
            across_rims = found[len(vertices) :].reshape(len(numbers), len(rim_numbers))
            assert (across_rims > 0).tolist() == over.tolist()
        for e, r in zip(*np.nonzero(over), strict=True):
            contact = edge_edge(moving.polyhedron, fixed.polyhedron, start.R, numbers[e], rim_numbers[r])
            forward = contact.moving == moving.polyhedron.edges[numbers[e]].vertices
            assert across_rims[e, r] == (2 if forward else 1)
            crossings += 1
            ways.add(forward)
        listed_sometimes |= set(np.flatnonzero(listed).tolist())
    assert listed_sometimes
    assert crossings > 20
    assert ways == {True, False}


def test_faces_that_are_not_convex_or_have_holes_are_no_walls() -> None:
    """Of a U no rim of the notch says by itself what is beside the face; a side of it is a wall."""
    sunk = Pose(np.array([0.0, 0.0, -0.02]), np.eye(3))
    boxes = [
        Moved(Box((0.01 * x, 0.01 * y, 0.02)), sunk.moved(0.01 * np.array([u, v, 0.0, 0.0, 0.0, 0.0])))
        for (x, y), (u, v) in (((6, 1), (0, -2.5)), ((1, 5), (-2.5, 0.5)), ((1, 5), (2.5, 0.5)))
    ]
    for fixed in (part_of("block", Union(tuple(boxes))), parts()[1]):
        body = fixed.polyhedron
        convex = [flush._is_convex(body, number) for number in range(len(body.faces))]
        top = max(range(len(body.faces)), key=lambda n: (body.faces[n].normal[2] > 0.99, body.faces[n].offset))
        assert not convex[top]
        assert all(convex[n] for n, face in enumerate(body.faces) if abs(face.normal[2]) < 0.01)
