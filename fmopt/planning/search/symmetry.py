"""The attitude in which parts are planned for, so that a plan depends on their shapes alone and not on their files.

What moves one part into another moves their mirror image in, mirrored; so it is with a quarter turn about the axis of
the insertion. Of the eight images that parts have under reflections and quarter turns, one is planned for, the same
for all of them; what is found is turned back. In that image vertices, faces and pieces come in the order of
coordinates. The images of parts whose coordinates are the same to the bit, as those of parts in their frames are once
rounded, are the same to the bit. Into which pieces a part comes apart may still hang on the order of its tools.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import assert_never

import numpy as np
from scipy.spatial import KDTree

from fmopt.certificate.assembly import Assembly
from fmopt.contact.primitive import Kind, PrimitiveContact, ball_face, crossed, face_vertex, vertex_face
from fmopt.geometry.clearance import Clearance
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron, from_faces
from fmopt.planning.moves.moves import Move
from fmopt.planning.search.entry import turned_axes
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Framing, Indices

_DECIMALS = 14  # of lengths in m and of numbers without a unit
_ORDERED = 12  # decimals of coordinates in m that order them
_SAME = 1e-9  # what tells images apart, relative to the part
_LONG = 0.1  # moment from which a part is longer one way than the other, which is along x then
# What ranks images, the largest first: powers of x, y and z whose moments count, then directions (rad from y) in which
# the part reaches farthest, for shapes so regular that their moments do not differ.
_MOMENTS = (
    *((2, 1, 0), (2, 0, 0), (1, 0, 0), (0, 1, 0), (3, 0, 0), (0, 3, 0), (1, 2, 0), (1, 1, 0), (3, 1, 0)),
    *((2, 1, 1), (2, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1), (3, 1, 1)),
)
_REACHES = (0.0, 0.3, 0.7, 1.0, 1.3)
_MIRRORED = frozenset(("y", "rx", "rz"))  # freedoms that have the other sign in a mirror, once x points as before

Loops = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class SearchNode:
    """A contact state that the search came to from that of a number, or by an entry, with the least margin on it, m."""

    origin: int | None
    names: tuple[str, ...]
    held: tuple[PrimitiveContact, ...]
    rank: int
    cost: float
    margin: float
    expanded: bool


@dataclass(frozen=True)
class Searched:
    """What is said of the search for a sequence.

    The heading is the turn about z of the axes that moves go along and about, rad. States are all that were come to, in
    that order, from the entries of the round that the sequence was found in.
    """

    heading: float
    names: tuple[str, ...]
    cost: float
    lower_bound: float
    expanded: int
    states: tuple[SearchNode, ...] = ()
    way: tuple[int, ...] = ()

    def of(self, moves: Sequence[Move]) -> "Searched":
        """The same with each guarded move named by the axis that it goes along, or turns about, most."""
        return replace(self, names=tuple(map(self._named, self.names, moves)))

    def _named(self, name: str, move: Move) -> str:
        if name[0] not in "+-":
            return name
        turning = name[1] == "r"
        way = turned_axes(self.heading).T @ move.start.local(move.goal).reshape(2, 3)[int(turning)]
        axis = int(np.argmax(np.abs(way).round(_DECIMALS)))
        return f"{'-' if way[axis] < 0.0 else '+'}{'r' if turning else ''}{'xyz'[axis]}"


@dataclass(frozen=True, eq=False)
class Attitude:
    """One of the eight images, with x and y of the image, and z, as rows (3, 3) in the parts' own axes."""

    axes: Array

    @property
    def mirrored(self) -> bool:
        """Whether the image is one in a mirror."""
        return bool(np.linalg.det(self.axes) < 0.0)

    def of_framing(self, framing: Framing) -> Framing:
        """Where errors are fixed, in the image's axes."""
        return replace(framing, hole=self.of_widths(framing.hole), hand=self.of_widths(framing.hand))

    def of_pose(self, pose: Pose) -> Pose:
        """The image of a pose."""
        return Pose(self.axes @ pose.p, self.axes @ pose.R @ self.axes.T)

    def of_widths(self, box: Array) -> Array:
        """The image of half-widths (6,), or of two, one for x and one for y (2,)."""
        swap = np.abs(self.axes).argmax(axis=1)  # widths have no sign
        return np.asarray(box[swap[:2]] if len(box) == 2 else box[np.append(swap, 3 + swap)])


@dataclass(frozen=True, eq=False)
class _Numbers:
    """Of a part's image, which vertex (n,), face (m,) and edge (e,) of the part each of its own is."""

    vertices: Indices
    faces: Indices
    edges: Indices


@dataclass(frozen=True, eq=False)
class Image:
    """Two parts in an attitude."""

    attitude: Attitude
    own: Assembly
    assembly: Assembly
    moving: _Numbers
    fixed: _Numbers

    def clearance(self, found: Clearance) -> Clearance:
        """What was measured on the parts, as it is of their images, but for the place and the faces."""
        x, y = self.attitude.of_widths(np.asarray(found.play)).round(_DECIMALS).tolist()
        per_side, half = round(found.per_side, _DECIMALS), round(found.half_diagonal, _DECIMALS)
        return replace(found, per_side=per_side, play=(x, y), half_diagonal=half)

    def goal(self, pose: Array) -> Array:
        """The image of the seated pose (6,)."""
        return np.asarray(self.attitude.of_pose(Pose.from_vector(pose)).vector().round(_DECIMALS) + 0.0)

    def own_moves(self, moves: Iterable[Move]) -> tuple[Move, ...]:
        """The moves of the images as moves of the parts themselves."""
        back, own = Attitude(self.attitude.axes.T).of_pose, self.own_contacts
        return tuple(
            Move(back(move.start), back(move.goal), own(move.held), own(move.making), own(move.left)) for move in moves
        )

    def own_search(self, found: Searched) -> Searched:
        """What is said of the search, in the parts' own axes."""
        c, s = math.cos(found.heading), math.sin(found.heading)
        x, y, _ = self.attitude.axes.T @ np.array([c, s, 0.0])
        states = tuple(
            replace(state, names=self.own_names(state.names), held=self.own_contacts(state.held))
            for state in found.states
        )
        return replace(found, heading=math.atan2(y, x), names=self.own_names(found.names), states=states)

    def own_names(self, names: Iterable[str]) -> tuple[str, ...]:
        """The names of freedoms in the parts' own axes."""
        return tuple(map(_in_mirror, names)) if self.attitude.mirrored else tuple(names)

    def own_contacts(self, contacts: Iterable[PrimitiveContact]) -> tuple[PrimitiveContact, ...]:
        """Contacts of the images as those of the parts themselves."""
        return tuple(self._own_contact(contact) for contact in contacts)

    def _own_contact(self, contact: PrimitiveContact) -> PrimitiveContact:
        body, fixed = self.own.moving.polyhedron, self.own.fixed.polyhedron
        one, other = contact.moving_feature, contact.fixed_feature
        match contact.kind:
            case Kind.VERTEX_FACE:
                return vertex_face(fixed, int(self.moving.vertices[one]), int(self.fixed.faces[other]))
            case Kind.BALL_FACE:
                return ball_face(fixed, int(self.moving.vertices[one]), int(self.fixed.faces[other]))
            case Kind.FACE_VERTEX:
                return face_vertex(body, int(self.moving.faces[one]), int(self.fixed.vertices[other]))
            case Kind.EDGE_EDGE:
                one, other = int(self.moving.edges[one]), int(self.fixed.edges[other])
                along = tuple(self.moving.vertices[list(contact.moving)].tolist()) == body.edges[one].vertices
                with_fixed = tuple(self.fixed.vertices[list(contact.fixed)].tolist()) == fixed.edges[other].vertices
                # Each of these turns R a × b round: either edge run the other way, and a mirror.
                return crossed(body, fixed, one, other, along ^ (not with_fixed) ^ self.attitude.mirrored)
            case _:
                assert_never(contact.kind)


def _in_mirror(name: str) -> str:
    sign, axis = name[:1], name[1:]
    return ("-" if sign == "+" else "+") + axis if axis in _MIRRORED and sign in "+-" else name


def images(own: Assembly, box: Array) -> Iterator[Image]:
    """The images of two parts that differ, the one to plan for first, shaped as well by the start error's box (6,)."""
    left: list[Attitude] = []
    # Equal ones go first: all eight of a symmetric part would tie, and be put in order to be told apart.
    for attitude in all_attitudes(own.planar):
        if not any(_alike(own, box, attitude, other) for other in left):
            left.append(attitude)
    ranks = {attitude: _rank(own, box, attitude) for attitude in left}
    while left:
        first = left
        for n in range(len(ranks[first[0]])):
            most = max(ranks[attitude][n] for attitude in first)
            # What is as large but for rounding stays: the next number tells these apart.
            first = [attitude for attitude in first if ranks[attitude][n] >= most - _SAME]
        found = max(first, key=partial(_whole, own)) if len(first) > 1 else first[0]
        left.remove(found)
        yield image_in(own, found)


def _alike(own: Assembly, box: Array, one: Attitude, other: Attitude) -> bool:
    """Whether two images are the same."""
    if np.any(np.abs(one.of_widths(box) - other.of_widths(box)) > _SAME * box.max()):
        return False
    for part in (own.moving, own.fixed):
        body = part.polyhedron
        apart, place = KDTree(body.vertices @ other.axes.T).query(body.vertices @ one.axes.T)
        if np.max(apart) > _SAME * np.abs(body.vertices).max():
            return False
        if np.any(np.abs(body.radii[place] - body.radii) > _SAME * np.abs(body.vertices).max()):
            return False
        faces = {frozenset(face.vertices) for face in body.faces}
        if faces != {frozenset(np.asarray(place)[list(face)].tolist()) for face in faces}:
            return False
    return True


def _whole(own: Assembly, attitude: Attitude) -> list[tuple[list[list[float]], list[Loops]]]:
    """What ranks images whose ranks are the same otherwise: all of their vertices and faces, in order."""
    bodies = [_in_order(part.polyhedron, attitude)[0] for part in (own.moving, own.fixed)]
    return [(_in_places(body), [face.loops for face in body.faces]) for body in bodies]


def all_attitudes(planar: bool) -> list[Attitude]:
    """All attitudes, the parts' own first; in the plane of x and z that and its mirror image."""
    x, y, z = np.eye(3)
    if planar:
        return [Attitude(np.array([sign * x, y, z]) + 0.0) for sign in (1.0, -1.0)]
    pairs = product(((x, y), (y, x)), (1.0, -1.0), (1.0, -1.0))
    return [Attitude(np.array([a * one, b * other, z]) + 0.0) for (one, other), a, b in pairs]


def _rank(own: Assembly, box: Array, attitude: Attitude) -> Array:
    """Numbers that tell an image from others; lengths count relative to the part."""
    found = list[float]()
    for part in (own.moving, own.fixed):
        points = part.polyhedron.vertices @ attitude.axes.T
        x, y, z = points.T / np.abs(points).max()
        long = float(np.mean(x * x - y * y))
        found += [long if abs(long) > _LONG else 0.0]
        found += [float(np.mean(x**a * y**b * z**c)) for a, b, c in _MOMENTS]
        found += [float(np.max(math.sin(angle) * x + math.cos(angle) * y)) for angle in _REACHES]
    return np.append(found, attitude.of_widths(box) / max(box.max(), 1e-12))


def image_in(own: Assembly, attitude: Attitude) -> Image:
    """The image of two parts in an attitude."""
    (moving, of_moving), (fixed, of_fixed) = (_turned(part, attitude) for part in (own.moving, own.fixed))
    return Image(attitude, own, Assembly(moving, fixed, own.planar), of_moving, of_fixed)


def _turned(part: Part, attitude: Attitude) -> tuple[Part, _Numbers]:
    body, numbers = _in_order(part.polyhedron, attitude)
    pieces = sorted((_in_order(piece, attitude)[0] for piece in part.pieces), key=_in_places)
    features = tuple(replace(feature, frame=attitude.of_pose(feature.frame)) for feature in part.features)
    return replace(part, polyhedron=body, pieces=tuple(pieces), features=features), numbers


def _in_order(body: Polyhedron, attitude: Attitude) -> tuple[Polyhedron, _Numbers]:
    """The image of a polyhedron, vertices and faces in the order of their coordinates, and where each comes from."""
    points = body.vertices @ attitude.axes.T + 0.0
    order = np.lexsort(points.round(_ORDERED).T[::-1])  # the last key is the first to count: x
    place = np.argsort(order)
    way = -1 if attitude.mirrored else 1  # a mirror turns loops round, which tell outside from inside
    loops = []
    for face in body.faces:
        outer, *holes = (_from_least(place[list(loop)].tolist()[::way]) for loop in face.loops)
        loops.append((outer, *sorted(holes)))
    faces = sorted(range(len(loops)), key=loops.__getitem__)
    balls = [(int(place[vertex]), radius) for vertex, radius in body.balls]
    image = from_faces(points[order], [loops[k] for k in faces], balls=balls)
    known = {frozenset(edge.vertices): k for k, edge in enumerate(body.edges)}
    edges = [known[frozenset(order[list(edge.vertices)].tolist())] for edge in image.edges]
    return image, _Numbers(order, np.array(faces, dtype=np.intp), np.array(edges, dtype=np.intp))


def _in_places(body: Polyhedron) -> list[list[float]]:
    return list(body.vertices.round(_ORDERED).tolist())


def _from_least(loop: list[int]) -> tuple[int, ...]:
    """A loop, begun at its least vertex."""
    k = loop.index(min(loop))
    return (*loop[k:], *loop[:k])
