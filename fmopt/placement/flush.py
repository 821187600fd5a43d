"""What is held along a piece of motion: what lies in a wall stays in it while the contacts at its corners change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmopt.certificate.assembly import Assembly, in_plane
from fmopt.certificate.knowledge import facts
from fmopt.contact.primitive import Kind, PrimitiveContact, edge_edge, vertex_face
from fmopt.memory import remembered
from fmopt.se3 import Pose, cross, length, lengths
from fmopt.uncertainty.error_set import ErrorSet
from fmopt.values import Array

_LEVEL = 1e-3  # sine of the angle at which an edge runs level with a rim
_DOUBT = 3e-5  # m; a vertex nearer to a rim than its error and this is listed with its edge
_MEMORY = 1024


def described(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], start: Pose, goal: Pose, errors: ErrorSet
) -> tuple[PrimitiveContact, ...]:
    """The contacts that make up what is held, along a piece: faces and edges stay in their walls, corners change.

    A vertex of a face or edge that lies in a wall touches where it is within the wall's face; an edge touches the
    wall's rim where one of its ends does. A vertex that may or may not have passed the rim is listed with its edge,
    if that has an end which has; else it only counts once it has passed. Where several walls lie in one plane, each
    holds what is before it.
    """
    kept = list(held)
    for wall in _walls(assembly, held):
        own = set(wall.vertices.tolist())
        before = [c for c in kept if on_wall(assembly, c, wall.number) and (wall.flush or own >= set(c.moving))]
        now = _touching(assembly, wall, (start, goal), errors)
        if set(now) != set(before):
            kept = [c for c in kept if c not in before] + now
    return tuple(dict.fromkeys(kept))


@dataclass(frozen=True, eq=False)
class _Wall:
    """A fixed face that a face or an edge of the moving part lies in.

    Args:
        number: of the face.
        flush: whether it is a face that lies in it.
        vertices: of the moving part that lie in the plane.
        rims: edges of the face, the convex ones first.
        convex: how many of these are convex; at the others another face begins.
        points: a point (r, 3) of each rim.
        inward: unit directions (r, 3) into the face across them.
    """

    number: int
    flush: bool
    vertices: NDArray[np.intp]
    rims: tuple[int, ...]
    convex: int
    points: Array
    inward: Array


@remembered(_MEMORY)
def _walls(assembly: Assembly, held: tuple[PrimitiveContact, ...]) -> tuple[_Wall, ...]:
    """The fixed faces that held contacts press a face or an edge of the moving part on.

    Not those with holes: their corners have to stay where they are.
    """
    body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
    known, found = facts(assembly, held), []
    for number, face in enumerate(fixed.faces):
        there = known.on(face.normal, face.offset)
        if there.flush:
            normal, offset = there.flush[0]
            own = np.flatnonzero(np.abs(body @ normal - offset) <= 1e-9)
        else:
            own = np.array(sorted(i for i in there.points if i < len(body)), dtype=np.intp)
        if len(own) > 1 and len(face.loops) == 1:
            found.append(_wall(assembly, number, bool(there.flush), own))
    return tuple(found)


def _wall(assembly: Assembly, number: int, flush: bool, own: NDArray[np.intp]) -> _Wall:
    """A fixed face with the vertices that lie in its plane."""
    fixed = assembly.fixed.polyhedron
    face = fixed.faces[number]
    corners = fixed.vertices[list(face.loops[0])]
    every = np.array([i for i, edge in enumerate(fixed.edges) if number in edge.faces])
    ends = fixed.vertices[[fixed.edges[i].vertices for i in every]]
    inward = cross(face.normal[None], ends[:, 1] - ends[:, 0])
    inward *= (np.sign(np.vecdot(inward, corners.mean(axis=0) - ends[:, 0])) / lengths(inward))[:, None]
    convex = np.array([fixed.edges[i].convex for i in every])
    # At a concave edge the face ends, but where it goes on beside that.
    ending = (np.vecdot(inward, corners[:, None] - ends[:, 0]) >= -1e-9).all(axis=0)
    order = np.concatenate([np.flatnonzero(convex), np.flatnonzero(ending & ~convex)])
    return _Wall(number, flush, own, tuple(every[order].tolist()), int(convex.sum()), ends[order, 0], inward[order])


def on_wall(assembly: Assembly, contact: PrimitiveContact, number: int) -> bool:
    """Whether a contact is on a fixed face: a vertex against it, or an edge across an edge in its plane."""
    fixed = assembly.fixed.polyhedron
    face = fixed.faces[number]
    if contact.kind is Kind.VERTEX_FACE:
        return contact.fixed_feature == number
    return contact.kind is Kind.EDGE_EDGE and in_plane(fixed.vertices[list(contact.fixed)], face.normal, face.offset)


def _touching(assembly: Assembly, wall: _Wall, poses: tuple[Pose, Pose], errors: ErrorSet) -> list[PrimitiveContact]:
    """Contacts between what lies in a wall and the wall, as the piece of motion has them."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    side = _sides(body.vertices[wall.vertices], wall, poses, errors)
    place = {vertex: n for n, vertex in enumerate(wall.vertices.tolist())}
    edges = [
        (i, [place[vertex] for vertex in edge.vertices])
        for i, edge in enumerate(body.edges)
        if edge.convex and all(vertex in place for vertex in edge.vertices)
    ]
    sure = side == 1
    sure[:, wall.convex :] = side[:, wall.convex :] >= 0
    joined = sure.copy()
    for _, (a, b) in edges:
        joined[a] |= sure[b] & (side[a] == 0)
        joined[b] |= sure[a] & (side[b] == 0)
    listed = joined.all(axis=1)
    found = [vertex_face(fixed, vertex, wall.number) for vertex in wall.vertices[listed].tolist()]
    # An edge crosses a rim all along where one end is beyond it, or as long as that end, which is listed, is.
    crossing = (side == -1) | ((side == 0) & listed[:, None])
    for i, (a, b) in edges:
        edge, over = body.edges[i], (sure[a] & crossing[b]) | (sure[b] & crossing[a])
        for r in np.flatnonzero(over[: wall.convex]).tolist():
            if _meets(body.vertices[list(edge.vertices)], wall, r, poses[0]):
                found.append(edge_edge(body, fixed, poses[0].R, i, wall.rims[r]))
    return found


def _sides(vertices: Array, wall: _Wall, poses: tuple[Pose, Pose], errors: ErrorSet) -> NDArray[np.intp]:
    """Whether vertices (n, 3) in a wall are inside each of its rims for sure (1), outside (−1), or perhaps (0)."""
    arms = vertices @ np.array([pose.R.T for pose in poses])
    there = arms + np.array([pose.p for pose in poses])[:, None]
    depth = there @ wall.inward.T - np.vecdot(wall.inward, wall.points)
    turning = cross(arms[:, :, None], wall.inward)
    rows = np.concatenate([np.broadcast_to(wall.inward, turning.shape), turning], axis=-1)
    doubt = 1.2 * errors.support(rows).max(axis=0) + _DOUBT
    return np.where(depth.min(axis=0) > doubt, 1, np.where(depth.max(axis=0) < -doubt, -1, 0))


def _meets(ends: Array, wall: _Wall, rim: int, pose: Pose) -> bool:
    """Whether an edge (2, 3) of the body in the wall's plane crosses a rim, rather than passing the face beside it."""
    c, inward = wall.points[rim], wall.inward[rim]
    a, b = pose.apply(ends)
    rise = float((b - a) @ inward)
    if abs(rise) <= _LEVEL * length(b - a):
        return False
    x = a + min(max(float((c - a) @ inward) / rise, 0.0), 1.0) * (b - a)
    inside = np.vecdot(wall.inward, x - wall.points) > -_DOUBT
    inside[rim] = True
    return bool(inside.all())
