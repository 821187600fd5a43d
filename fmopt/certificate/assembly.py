"""The two parts of an assembly, and which of their features, planes, lines and points are the same.

The function of a contact as an equality: zero exactly while the contact is held, positive before it is made.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmopt.certificate import rows
from fmopt.certificate.rows import Forms, Rows, directions_along, points_above
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose, cross, length, lengths
from fmopt.spatial.values import Array, Bits, remembered

TOUCH = 1e-9  # m: features of a part and of its pieces closer than this are the same
NEAR = 1e-12  # m: what is incident but for this is so in exact coordinates, on which the proof rests, see `plan_record`

_SHORT = 1e-6  # m: what is nearer to a line than this spans no plane with it
_MEMORY = 4096  # forms of contacts are asked for again with every piece and every neighbour of a pose

Span = tuple[float, float]
"""An open interval of depths, m."""


@dataclass(frozen=True, eq=False)
class Assembly:
    """The two parts: the moving one in its body frame, kept to x and z if `planar`, the fixed one in the B-frame."""

    moving: Part
    fixed: Part
    planar: bool = False

    @cached_property
    def body_points(self) -> Array:
        """All vertices (n, 3) of the moving part, then those that only its pieces have."""
        found = self.moving.polyhedron.vertices
        for piece in self.moving.pieces:
            # Pieces are cut along planes within the part, so that some of their corners are no corners of it.
            new = [v for v in piece.vertices if not (np.abs(found - v).max(axis=1) <= NEAR).any()]
            found = np.array([*found, *new])
        return found

    @cached_property
    def several(self) -> bool:
        """Whether what touches need not be the piece that is looked at: the moving part has several.

        Of faces of one part that are off their form nothing is said by contacts of others.
        """
        return len(self.moving.bodies) > 1 and not self.form

    @cached_property
    def radius(self) -> float:
        """How far from the origin a plane may matter, m."""
        parts = (self.moving.polyhedron, self.fixed.polyhedron)
        # Neither part reaches farther, and contacts are where both are.
        return sum(float((lengths(part.vertices) + part.radii).max()) for part in parts)

    @property
    def form(self) -> float:
        """How far the surfaces of both parts may lie from those planned with, together, m."""
        return self.moving.form + self.fixed.form

    @cached_property
    def units(self) -> Array:
        """Units of a displacement (6,): metres, and turns that move a point half a diameter of the part away by one."""
        return np.array([1.0, 1.0, 1.0, *[2.0 / self.moving.polyhedron.diameter] * 3])

    @cached_property
    def freedoms(self) -> Array:
        """Which components (6,) of a displacement there may be, 1, and which not, 0."""
        # Planar: x, z and the turn about y.
        return np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]) if self.planar else np.ones(6)

    @cached_property
    def fixed_planes(self) -> tuple[tuple[Array, Array], ...]:
        """Unit normals (m, 3) and offsets (m,) of the faces of each fixed piece."""
        return tuple((piece.normals, piece.offsets) for piece in self.fixed.pieces)

    @cached_property
    def _carried(self) -> dict[Polyhedron, frozenset[tuple[str, int]]]:
        parts = (self.moving, self.fixed)
        return {piece: _carried(part.polyhedron, piece) for part in parts for piece in part.bodies}

    def carried(self, piece: Polyhedron) -> frozenset[tuple[str, int]]:
        """Which vertices, edges, faces and balls of its part a piece carries, as (kind, index)."""
        return self._carried[piece]

    def agree(self, normal: Array, offset: float, other: Array, other_offset: float) -> bool:
        """Whether two planes are one, seen from the same side, wherever the parts can be.

        Planes are outward unit normals (3,), in axes of one frame, and offsets in m.
        """
        # Two planes that are not quite parallel part with the distance from the origin: the angle counts on the whole
        # reach.
        return length(normal - other) * self.radius + abs(offset - other_offset) <= NEAR


def _carried(part: Polyhedron, piece: Polyhedron) -> frozenset[tuple[str, int]]:
    """See `Assembly.carried`; only what lies in a box around the piece is held against it."""
    # Twice the tolerance on every side: nothing within it is lost to the box.
    low, high = piece.vertices.min(axis=0) - 2.0 * TOUCH, piece.vertices.max(axis=0) + 2.0 * TOUCH
    near = np.flatnonzero(np.all((part.vertices >= low) & (part.vertices <= high), axis=1)).tolist()
    vertices = [n for n in near if (lengths(piece.vertices - part.vertices[n]) <= TOUCH).any()]
    if piece.balls:
        # A ball is a piece of its own, a point without edges or faces.
        return frozenset(("ball", n) for n, _ in part.balls if n in vertices)
    starts, ways, _, _ = _outlines(part)
    edges = []
    for a, b in piece.vertices[[edge.vertices for edge in piece.edges]]:
        # An edge of the part is carried by one of the piece that lies on its line.
        off = np.maximum(lengths(cross(a - starts, ways)), lengths(cross(b - starts, ways)))
        edges += np.flatnonzero(off <= TOUCH).tolist()
    faces = frozenset[int]().union(*(_faces_in(part, face.normal.tobytes(), face.offset) for face in piece.faces))
    kinds = (("vertex", vertices), ("edge", edges), ("face", faces))
    return frozenset((kind, n) for kind, found in kinds for n in found)


@remembered(1)
def _outlines(part: Polyhedron) -> tuple[Array, Array, Array, list[Array]]:
    """Where edges begin (e, 3), m, unit vectors along them; the first corner (f, 3) of each face, and all (k, 3), m."""
    ends = part.vertices[[edge.vertices for edge in part.edges]]
    ways = ends[:, 1] - ends[:, 0]
    own = [part.vertices[list(face.loops[0])] for face in part.faces]
    return ends[:, 0], ways / lengths(ways)[:, None], np.array([points[0] for points in own]), own


@remembered(_MEMORY)
def _faces_in(part: Polyhedron, normal: bytes, offset: float) -> frozenset[int]:
    """Which faces of a part lie in a plane, as pieces share them: its unit normal (3,) as bytes, and its offset, m."""
    (_, _, first, own), n = _outlines(part), np.frombuffer(normal)
    # Its first corner drops most faces of the part before all their corners are looked at.
    level = np.flatnonzero(np.abs(first @ n - offset) <= TOUCH)
    return frozenset(k for k in level.tolist() if in_plane(own[k], n, offset))


def in_plane(points: Array, normal: Array, offset: float) -> bool:
    """Whether all points (k, 3), m, lie in the plane of a unit normal (3,) and an offset, m, to `TOUCH`."""
    return bool(np.all(np.abs(points @ normal - offset) <= TOUCH))


def on_line(points: Array, a: Array, direction: Array) -> Bits:
    """Which points (k, 3), m, lie on the line through a (3,), m, along a unit direction (3,), to `NEAR`."""
    return np.asarray(lengths(cross(points - a, direction)) <= NEAR)


def hinge(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact]
) -> tuple[int, int, int] | None:
    """The hinge of an edge–edge contact: (fixed face φ, body vertex a on it, other end b), None without.

    When a vertex–face contact of `together` holds one end exactly on a wall through the fixed edge, the lines of both
    edges meet exactly when the other end is on that wall too.
    """
    if contact.kind is not Kind.EDGE_EDGE:
        return None
    fixed = assembly.fixed.polyhedron
    # Only a wall through the fixed edge itself: in any other the line of the moving edge would not meet that edge.
    sides = [fixed.faces[n] for n in fixed.edges[contact.fixed_feature].faces]
    for other in together:
        if other.kind is Kind.VERTEX_FACE and other.moving[0] in contact.moving:
            face = fixed.faces[other.fixed_feature]
            if any(assembly.agree(face.normal, face.offset, side.normal, side.offset) for side in sides):
                a, b = contact.moving
                return (other.fixed_feature, a, b) if other.moving[0] == a else (other.fixed_feature, b, a)
    return None


def level(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact]
) -> tuple[Array, Array] | None:
    """What tells that an edge meets a rim on which another edge of the same body face is held before it, or None.

    The face's plane has one point of the rim already; its other lines meet the rim exactly when the face is level with
    it. The contacts of `together` that are listed before this one count.

    Returns:
        (u, k): direction (3,) along the rim towards the edge, and the face's normal (3,) times the greatest distance
        between the two edges, m: u·(R k) vanishes as the edge meets the rim and is positive before.
    """
    if contact.kind is not Kind.EDGE_EDGE:
        return None
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    for other in together:
        if other == contact:
            # Later contacts do not count: of two edges one has to be measured, the other follows from it.
            return None
        if other.kind is not Kind.EDGE_EDGE or other.fixed_feature != contact.fixed_feature:
            continue
        shared = set(body.edges[other.moving_feature].faces) & set(body.edges[contact.moving_feature].faces)
        # Two shared faces, or none, tell nothing: the edge is the same one, or lies elsewhere.
        if len(shared) == 1 and other.moving_feature != contact.moving_feature:
            normal = body.faces[shared.pop()].normal
            a, b = body.vertices[list(other.moving)]
            c, d = fixed.vertices[list(other.fixed)]
            away = cross((b - a) / length(b - a), normal)
            reach = (body.vertices[list(contact.moving)] - a) @ away
            # The end farther off weighs most, with its sign: the row is positive on the side that is open.
            far = float(reach[int(np.argmax(np.abs(reach)))])
            return (d - c) / length(d - c), far * normal
    return None


def contact_rows(
    assembly: Assembly, contacts: Sequence[PrimitiveContact], together: Sequence[PrimitiveContact], pose: Pose
) -> Rows:
    """Rows (k) of contacts at a pose; an edge that one of all, `together`, hinges in the wall gets its hinge form."""
    return contact_forms(assembly, tuple(contacts), tuple(together)).at(pose)


@remembered(_MEMORY)
def contact_forms(
    assembly: Assembly, contacts: tuple[PrimitiveContact, ...], together: tuple[PrimitiveContact, ...]
) -> Forms:
    """The functions of contacts; arguments as for `contact_rows`."""
    if not contacts:
        # No contact: an empty table, for which all else goes on as it is.
        return points_above(np.zeros((0, 3)), np.zeros(3), 0.0)
    return rows.stacked(*(_form(assembly, contact, together) for contact in contacts))


@remembered(_MEMORY)
def made_form(assembly: Assembly, made: PrimitiveContact, held: tuple[PrimitiveContact, ...]) -> Forms:
    """The function (1) that tells how far a contact is from being made, positive before.

    A vertex that reaches a wall while its edge is held on a rim of that wall is (0, 1) times the edge's rise over the
    wall high: the edge's direction alone tells when it touches, whatever the part's position is.
    """
    if made.kind is Kind.VERTEX_FACE:
        body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
        for contact in held:
            found = hinge(assembly, contact, (made,))
            # Only while the edge is still measured by its crossing: where it is hinged already its direction has been
            # used up.
            if found is not None and hinge(assembly, contact, held) is None:
                wall, a, b = found
                return directions_along(fixed.faces[wall].normal, body[[a]] - body[[b]])
    return contact_forms(assembly, (made,), held)


@remembered(_MEMORY)
def made_scale(assembly: Assembly, made: PrimitiveContact, held: tuple[PrimitiveContact, ...], rho: float) -> float:
    """What makes a margin of `made_form`, m: 1 for a distance; a direction's angle counts on an arm of ρ."""
    found = made_form(assembly, made, held).at(Pose(np.zeros(3), np.eye(3)))
    # Rows that no translation moves are of an angle; all others are distances.
    return rho / float(found.forms.lever[0]) if not found.forms.bilinear.any() and not found.N[0, :3].any() else 1.0


def _form(assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact]) -> Forms:
    body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
    if contact.kind is Kind.VERTEX_FACE:
        face = fixed.faces[contact.fixed_feature]
        return points_above(body[[contact.moving[0]]], face.normal, face.offset)
    if contact.kind is Kind.BALL_FACE:
        face, centre = fixed.faces[contact.fixed_feature], [contact.moving[0]]
        return rows.balls_above(body[centre], face.normal, face.offset, assembly.moving.polyhedron.radii[centre])
    if contact.kind is Kind.FACE_VERTEX:
        own = assembly.moving.polyhedron.faces[contact.moving_feature]
        return rows.faces_above(own.normal, own.offset, fixed.vertices[[contact.fixed[0]]])
    # The crossing of two lines cannot be asked for where one of them lies in a plane through the other: its turn can.
    found = hinge(assembly, contact, together)
    if found is not None:
        wall, a, b = found
        return directions_along(fixed.faces[wall].normal, body[[b]] - body[[a]])
    flush = level(assembly, contact, together)
    if flush is not None:
        return directions_along(*flush)
    a, b = body[list(contact.moving)]
    c, d = fixed.vertices[list(contact.fixed)]
    return rows.edges_apart((b - a) / length(b - a), (d - c) / length(d - c), c, a[None])


def same_side(vertices: Array, a: Array, direction: Array, p: Array) -> Bits:
    """Which points lie in the half-plane that a line bounds and p spans."""
    off = (p - a) - direction * float(direction @ (p - a))
    size = length(off)
    if size <= _SHORT:
        return np.zeros(len(vertices), dtype=np.bool_)
    u = off / size
    d = vertices - a
    d = d - np.outer(d @ direction, direction)
    t = d @ u
    return np.asarray((t > 0.0) & (lengths(d - np.outer(t, u)) <= NEAR))


def beyond(vertices: Array, z: Array, p: Array) -> Bits:
    """Which points lie on the ray from z through p."""
    if np.abs(z - p).max() <= NEAR:
        return np.zeros(len(vertices), dtype=np.bool_)
    u = (p - z) / length(p - z)
    d = vertices - z
    t = d @ u
    return np.asarray((t > 0.0) & (lengths(d - np.outer(t, u)) <= NEAR))


def swallowed(assembly: Assembly, ends: Array, inward: Array) -> tuple[Span, ...]:
    """Depths to which the strip of a wall beyond a re-entrant edge is inside a fixed piece, its middle strictly.

    A contact cannot leave its face there without the parts overlapping, which the separations rule out.
    """
    spans = []
    for normals, offsets in assembly.fixed_planes:
        heights, rise = ends @ normals.T - offsets, -(normals @ inward)
        if not (heights > NEAR).any():
            limits = [(NEAR - heights.max(axis=0), rise), (-NEAR - heights.mean(axis=0), 0.5 * rise)]
            spans.append(span([pair for room, slope in limits for pair in zip(room, slope, strict=True)]))
    return tuple(span for span in spans if span[0] < span[1])


def span(limits: Sequence[tuple[float, float]]) -> Span:
    """Where slope·t < room holds for all (room, slope), t > 0."""
    low, high = 0.0, np.inf
    for room, slope in limits:
        if slope > 0.0:
            high = min(high, room / slope)
        elif slope < 0.0:
            low = max(low, room / slope)
        elif room <= 0.0:
            return 0.0, 0.0
    return float(low), float(high)


@remembered(_MEMORY)
def edge_along(piece: Polyhedron, part: Polyhedron, ends: tuple[int, ...]) -> tuple[int, int] | None:
    """The piece's edge on the line through two vertices of its part, run from the first towards the second, if any."""
    a, b = part.vertices[list(ends)]
    direction = (b - a) / length(b - a)
    off = lengths(cross(piece.vertices - a, direction))
    on_line = (edge.vertices for edge in piece.edges if off[[*edge.vertices]].max() <= TOUCH)
    return next((run_like(piece.vertices, ends, direction) for ends in on_line), None)


def run_like(vertices: Array, ends: tuple[int, int], way: Array) -> tuple[int, int]:
    """The ends of an edge, as indices of vertices (n, 3) in m, in the order in which they come along a way (3,)."""
    i, j = ends
    return (i, j) if float((vertices[j] - vertices[i]) @ way) > 0.0 else (j, i)
