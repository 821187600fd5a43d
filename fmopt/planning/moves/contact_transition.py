"""What is held along a piece of motion: what lies in a wall stays in it while the contacts at its corners change.

Kernels: which vertices and edges that lie in the plane of a fixed face touch it or its rims on a piece of motion.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, compress
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from fmopt.certificate.assembly import Assembly, in_plane
from fmopt.certificate.contact_implications import facts
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.rows import Forms, points_above
from fmopt.contact.primitive import Kind, PrimitiveContact, edge_edge, vertex_face
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.se3 import Pose, cross, lengths
from fmopt.spatial.values import Array, Indices, remembered, there

_MEMORY = 1024
DOUBTED = 1.2  # times what errors reach: what they leave in doubt

DOUBT = 3e-5  # m; a vertex nearer to a rim than its error and this is listed with its edge
_LEVEL = 1e-3  # sine of the angle at which an edge runs level with a rim

Rims = tuple[Array, Array]
"""Of each rim of a face a point, and the unit direction (r, 3) into the face across it."""

Edges = tuple[Indices, Array, Array, Array, Array]
"""Places (e, 2) of the ends of edges of the moving part, their directions (e, 3) and the sums (e, 3) of the normals of
their faces, and both (c, 3) for the convex rims."""


def described(
    assembly: Assembly, held: tuple[PrimitiveContact, ...], start: Pose, goal: Pose, errors: ErrorSet
) -> tuple[PrimitiveContact, ...]:
    """The contacts that make up what is held, along a piece: faces and edges stay in their walls, corners change.

    A vertex of a face or edge that lies in a wall touches where it is within the wall's face; an edge touches the
    wall's rim where one of its ends does. A vertex that may or may not have passed the rim is listed with its edge,
    if that has an end which has; else it only counts once it has passed. Where several walls lie in one plane, each
    holds what is before it.
    """
    known = _known(assembly, held)
    if not known.walls:
        return known.held
    p, R = np.array([start.p, goal.p]), np.array([start.R, goal.R])
    return _redescribed(known, tuple(_pattern(wall, p, R, errors) for wall in known.walls))


@dataclass(frozen=True, eq=False)
class _Wall:
    """A fixed face that a face or an edge of the moving part lies in."""

    number: int
    flush: bool  # whether it is a face that lies in it
    own: frozenset[int]
    vertices: Array  # where they are in the body (n, 3)
    numbers: tuple[int, ...]
    edges: Edges
    convex: tuple[int, ...]  # convex edges of the face, the first of its rims; at the others another face begins
    rims: Rims


@dataclass(frozen=True, eq=False)
class _HeldContacts:
    """Held contacts, each once, and the fixed faces that they press a face or an edge of the moving part on."""

    owner: ref[Assembly]  # which has this with it
    held: tuple[PrimitiveContact, ...]
    walls: tuple[_Wall, ...]


@remembered(_MEMORY)
def _known(assembly: Assembly, held: tuple[PrimitiveContact, ...]) -> _HeldContacts:
    """What held contacts say of walls but those with holes, whose corners have to stay where they are."""
    body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
    known, found = facts(assembly, held), []
    for number, face in enumerate(fixed.faces):
        wall = known.on(face.normal, face.offset)
        if wall.flush:
            normal, offset = wall.flush[0]
            own = tuple(np.flatnonzero(np.abs(body @ normal - offset) <= 1e-9).tolist())
        else:
            own = tuple(sorted(i for i in wall.points if i < len(body)))
        if len(own) > 1 and _is_convex(fixed, number):
            found.append(_wall(assembly, number, bool(wall.flush), own))
    return _HeldContacts(ref(assembly), tuple(dict.fromkeys(held)), tuple(found))


@remembered(_MEMORY)
def _is_convex(part: Polyhedron, number: int) -> bool:
    """Whether a face is what lies within all of its rims: of others no rim says by itself what is beside the face."""
    face = part.faces[number]
    if len(face.loops) > 1:
        return False
    corners = part.vertices[list(face.loops[0])]
    inward = cross(face.normal, np.roll(corners, -1, axis=0) - corners)
    inward /= lengths(inward)[:, None]
    return bool((np.vecdot(inward, corners[:, None] - corners) >= -1e-9).all())


@remembered(_MEMORY)
def _wall(assembly: Assembly, number: int, flush: bool, own: tuple[int, ...]) -> _Wall:
    """A fixed face with the vertices that lie in its plane."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
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
    pairs = [(i, edge.vertices) for i, edge in enumerate(body.edges) if edge.convex and set(edge.vertices) <= set(own)]
    numbers, rims = tuple(i for i, _ in pairs), tuple(every[convex].tolist())
    places = np.array([[own.index(vertex) for vertex in vertices] for _, vertices in pairs], dtype=np.intp)
    edges = places.reshape(-1, 2), *_run(body, numbers), *_run(fixed, rims)
    across = np.ascontiguousarray(ends[order, 0]), np.ascontiguousarray(inward[order])
    return _Wall(number, flush, frozenset(own), body.vertices[list(own)], numbers, edges, rims, across)


def _run(part: Polyhedron, edges: Sequence[int]) -> tuple[Array, Array]:
    """Directions (e, 3) of edges, and sums (e, 3) of the normals of their faces."""
    of_edges = [part.edges[i] for i in edges]
    ends = part.vertices[[edge.vertices for edge in of_edges]].reshape(-1, 2, 3)  # also of no edges at all
    ahead, beside = ends[:, 1] - ends[:, 0], part.normals[[edge.faces for edge in of_edges]].reshape(-1, 2, 3)
    return ahead / lengths(ahead)[:, None], beside.sum(axis=1)


def within_rims(assembly: Assembly, held: tuple[PrimitiveContact, ...]) -> list[Forms]:
    """How far vertices that lie in a wall are within its convex rims: of each wall, the rims of each vertex in turn."""
    found = []
    for wall in _known(assembly, held).walls:
        places, inward = (numbers[: len(wall.convex)] for numbers in wall.rims)
        if len(places):
            vertices, count = np.repeat(wall.vertices, len(places), axis=0), len(wall.vertices)
            found.append(points_above(vertices, np.tile(inward, (count, 1)), np.tile(np.vecdot(inward, places), count)))
    return found


def on_wall(assembly: Assembly, contact: PrimitiveContact, number: int) -> bool:
    """Whether a contact is on a fixed face: a vertex against it, or an edge across an edge in its plane."""
    fixed = assembly.fixed.polyhedron
    face = fixed.faces[number]
    if contact.kind is Kind.VERTEX_FACE:
        return contact.fixed_feature == number
    return contact.kind is Kind.EDGE_EDGE and in_plane(fixed.vertices[list(contact.fixed)], face.normal, face.offset)


def _pattern(wall: _Wall, p: Array, R: Array, errors: ErrorSet) -> bytes:
    """What touches a wall along a piece of motion between two poses, p (2, 3) and R (2, 3, 3), as a kernel finds it."""
    shape = 2, len(wall.vertices), len(wall.rims[0])
    depth, rows = np.empty(shape), np.empty((*shape, 6))
    depths(wall.vertices, wall.rims, p, R, depth, rows)
    doubt = DOUBTED * errors.support(rows) + DOUBT
    found = np.empty(len(wall.vertices) + len(wall.numbers) * len(wall.convex), dtype=np.uint8)
    pattern(wall.vertices, wall.rims, wall.edges, (p[0], R[0]), (depth, doubt), found)
    return found.tobytes()  # bytes can be a key of what is remembered, arrays cannot


@remembered(_MEMORY)
def _redescribed(known: _HeldContacts, patterns: tuple[bytes, ...]) -> tuple[PrimitiveContact, ...]:
    """What is held where this touches the walls: the same contacts, not just equal ones, whenever the same does."""
    assembly, kept = there(known.owner), list(known.held)
    touching = [_touching(assembly, wall, found) for wall, found in zip(known.walls, patterns, strict=True)]
    for wall in known.walls:
        # The rims of all walls in one plane are in it: what touches another of them is held none the less.
        beside = (_in_one_plane(assembly, wall, other) for other in known.walls)
        now = list(dict.fromkeys(chain.from_iterable(compress(touching, beside))))
        of_wall = (c for c in kept if wall.flush or wall.own >= set(c.moving))
        before = [c for c in of_wall if c in now or on_wall(assembly, c, wall.number)]
        if set(now) != set(before):
            kept = [c for c in kept if c not in before] + now
    return tuple(dict.fromkeys(kept))


def _in_one_plane(assembly: Assembly, wall: _Wall, other: _Wall) -> bool:
    fixed = assembly.fixed.polyhedron
    one, two = fixed.faces[wall.number], fixed.faces[other.number]
    return bool(one.normal @ two.normal > 0.0 and in_plane(fixed.vertices[list(two.vertices)], one.normal, one.offset))


def _touching(assembly: Assembly, wall: _Wall, found: bytes) -> list[PrimitiveContact]:
    """Contacts between what lies in a wall and the wall."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    own = sorted(wall.own)  # the order in which the kernel has them
    contacts = [vertex_face(fixed, i, wall.number) for i, listed in zip(own, found, strict=False) if listed]
    crossings = ((i, rim) for i in wall.numbers for rim in wall.convex)
    for (i, rim), way in zip(crossings, found[len(own) :], strict=True):
        if way:
            across, ends = edge_edge(body, fixed, np.eye(3), i, rim), body.edges[i].vertices
            contacts.append(replace(across, moving=ends if way == 2 else ends[::-1]))
    return contacts


@compiled
def depths(vertices: Array, rims: Rims, p: Array, R: Array, depth: Array, rows: Array) -> None:
    """Fills in how far inside rims (r) vertices are, m, and how errors change that.

    Args:
        vertices: in the body (n, 3).
        p: positions (2, 3).
        R: rotations (2, 3, 3).
        depth: (2, n, r).
        rows: (2, n, r, 6).
    """
    points, inward = rims
    arm = np.empty(3)
    for end in range(len(p)):
        for i in range(len(vertices)):
            v = vertices[i]
            for j in range(3):
                arm[j] = R[end, j, 0] * v[0] + R[end, j, 1] * v[1] + R[end, j, 2] * v[2]
            for r in range(len(points)):
                total = 0.0
                for j in range(3):
                    k, m = (j + 1) % 3, (j + 2) % 3
                    total += inward[r, j] * (arm[j] + p[end, j] - points[r, j])
                    rows[end, i, r, j] = inward[r, j]
                    rows[end, i, r, 3 + j] = arm[k] * inward[r, m] - arm[m] * inward[r, k]
                depth[end, i, r] = total


@part
def _meets(a: Array, b: Array, rims: Rims, rim: int) -> bool:
    """Whether an edge from a to b (3,) in a wall's plane crosses a rim, rather than passing the face beside it."""
    points, inward = rims
    rise, to, square = 0.0, 0.0, 0.0
    for j in range(3):
        rise += (b[j] - a[j]) * inward[rim, j]
        to += (points[rim, j] - a[j]) * inward[rim, j]
        square += (b[j] - a[j]) ** 2
    if abs(rise) <= _LEVEL * math.sqrt(square):
        return False
    share = min(max(to / rise, 0.0), 1.0)
    for r in range(len(points)):
        room = 0.0
        for j in range(3):
            room += inward[r, j] * (a[j] + share * (b[j] - a[j]) - points[r, j])
        if r != rim and not room > -DOUBT:
            return False
    return True


@part
def _forward(edges: Edges, e: int, r: int, R: Array) -> bool:
    """Whether (R e_moving) × e_fixed points out of the fixed part as edge and rim run."""
    _, own, own_normals, other, other_normals = edges
    turned, normals = np.empty(3), np.empty(3)
    for j in range(3):
        turned[j] = R[j, 0] * own[e, 0] + R[j, 1] * own[e, 1] + R[j, 2] * own[e, 2]
        normals[j] = R[j, 0] * own_normals[e, 0] + R[j, 1] * own_normals[e, 1] + R[j, 2] * own_normals[e, 2]
    total = 0.0
    for j in range(3):
        k, m = (j + 1) % 3, (j + 2) % 3
        out = turned[k] * other[r, m] - turned[m] * other[r, k]
        total += out * (other_normals[r, j] - normals[j])
    return bool(total > 0.0)


@compiled
def pattern(
    vertices: Array,
    rims: Rims,
    edges: Edges,
    pose: tuple[Array, Array],
    inside: tuple[Array, Array],
    found: NDArray[np.uint8],
) -> None:
    """Fills in which vertices touch a face, and which edges cross its convex rims along a piece of motion.

    Args:
        vertices: in the body (n, 3), in the face's plane.
        rims: of the face, c convex ones first; at the others another face begins.
        pose: position (3,) and rotation (3, 3) at the start.
        inside: how far inside rims vertices are at both ends (2, n, r), m, and how far errors displace that.
        found: (n + e c), of each vertex whether it is listed, of each edge and rim 1 where they cross, 2 where they do
            so with the edge run from its first end to its second.
    """
    n, c, (p, R), (depth, doubt) = len(vertices), len(edges[3]), pose, inside
    side, sure = np.empty((n, len(rims[0])), dtype=np.int8), np.empty((n, len(rims[0])), dtype=np.bool_)
    for i in range(n):
        for r in range(len(rims[0])):
            within = min(depth[0, i, r] - doubt[0, i, r], depth[1, i, r] - doubt[1, i, r])
            beyond = max(depth[0, i, r] + doubt[0, i, r], depth[1, i, r] + doubt[1, i, r])
            side[i, r] = 1 if within > 0.0 else (-1 if beyond < 0.0 else 0)
            sure[i, r] = side[i, r] >= (1 if r < c else 0)
    joined = sure.copy()
    ends = edges[0]
    for e in range(len(ends)):
        a, b = ends[e]
        for r in range(len(rims[0])):
            joined[a, r] |= sure[b, r] and side[a, r] == 0
            joined[b, r] |= sure[a, r] and side[b, r] == 0
    for i in range(n):
        found[i] = 1
        for r in range(len(rims[0])):
            if not joined[i, r]:
                found[i] = 0
    # An edge crosses a rim all along where one end is beyond it, or as long as that end, which is listed, is.
    at = np.empty((2, 3))
    for e in range(len(ends)):
        for k in range(2):
            v = vertices[ends[e, k]]
            for j in range(3):
                at[k, j] = p[j] + R[j, 0] * v[0] + R[j, 1] * v[1] + R[j, 2] * v[2]
        for r in range(c):
            over = False
            for k in range(2):
                a, b = ends[e, k], ends[e, 1 - k]
                over |= sure[a, r] and (side[b, r] == -1 or (side[b, r] == 0 and found[b] == 1))
            crossing = over and _meets(at[0], at[1], rims, r)
            found[n + e * c + r] = (2 if _forward(edges, e, r, R) else 1) if crossing else 0
