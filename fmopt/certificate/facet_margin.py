"""Whether a contact stays inside its facet: the touching point within the face, or within both edges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from fmopt.certificate.assembly import NEAR, TOUCH, Assembly, Span, span, swallowed
from fmopt.certificate.contact_implications import held_on, other_rim, taken_turns
from fmopt.certificate.rows import Forms, Questions
from fmopt.contact.primitive import Kind, PrimitiveContact
from fmopt.geometry.convex_regions import along_edge, convex_regions
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.se3 import Pose, cross, length, lengths
from fmopt.spatial.values import Array, remembered

UNBOUNDED = 1.0  # m; the margin of a contact that nothing bounds
_BEYOND = 1e-6  # m; how far beyond a blocked rim material must go on
_SURELY = 1e-9  # m; what takes over is farther inside by this at least, that rounding does not decide
_DIFFERENCE = 1e-8  # m
_STEEP = 100.0  # what changes faster jumps
_MEMORY = 512

Lower = Sequence[float]
"""The lower bounds (k,) of all rows, m and rad: plain numbers, of which few are looked at."""

Judge = Callable[[Lower], float]
"""The margin of a contact, m, from the lower bounds of all rows."""


class _Looked(list[float]):
    """Numbers that note which of them were looked at."""

    def __init__(self, numbers: Sequence[float]) -> None:
        super().__init__(numbers)
        self.at: set[int] = set()

    def __getitem__(self, k: Any) -> Any:
        self.at.add(k)
        return super().__getitem__(k)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Rows that bound contacts, and what their lower bounds say of each contact."""

    forms: Forms
    judges: tuple[Judge, ...]

    def margins(self, lower: Array) -> list[float]:
        """Margins of the contacts, m, from the lower bounds (k,) of the rows."""
        numbers = lower.tolist()
        return [judge(numbers) for judge in self.judges]

    def slope(self, contact: int, lower: Array) -> Array:
        """How the margin of a contact changes with the lower bounds (k,) of the rows, by differences; (k,).

        Zero where it jumps, as another wall or contact takes over there.
        """
        judge, numbers, found = self.judges[contact], lower.tolist(), np.zeros(len(lower))
        looked = _Looked(numbers)
        here = judge(looked)
        alone = [k for k in looked.at if numbers[k] == here]
        if len(alone) == 1:  # most margins are one of the rows: where it falls with that, no other counts
            numbers[alone[0]] = here - _DIFFERENCE
            if judge(numbers) == here - _DIFFERENCE:
                found[alone[0]] = 1.0
                return found
            numbers[alone[0]] = here
        for way in (-_DIFFERENCE, _DIFFERENCE):  # a least of several falls with each of them, a greatest only rises
            for k in sorted(looked.at):  # what was not looked at makes no difference
                number = numbers[k]
                numbers[k] = number + way
                found[k] = (judge(numbers) - here) / way
                numbers[k] = number
            found[np.abs(found) > _STEEP] = 0.0
            if found.any():
                break
        return found


@remembered(_MEMORY)
def bounds(
    assembly: Assembly,
    contacts: tuple[PrimitiveContact, ...],
    together: tuple[PrimitiveContact, ...],
    own: frozenset[PrimitiveContact] = frozenset(),
) -> Bounds:
    """How far contacts stay from the boundaries of their facets.

    A vertex on a face keeps away from the face's rims. A rim with another wall behind it is waived as far as material
    goes on there: that wall, as a piece, keeps the vertex out. So is a rim that an edge through the vertex crosses,
    when the edge's other end is held on the same face farther inside, or the edge properly crosses another rim: edge
    and vertex take turns, the edge's line lies in the wall either way. Two edges cross where each has its ends on both
    sides of the other. Where a face has holes, the vertex keeps beyond an edge of each that has the hole on one side.
    """
    rows, corners = Questions(), tuple(c for c in together if c.kind is Kind.VERTEX_FACE)
    judges = tuple(_judge(assembly, contact, corners if contact in own else together, rows) for contact in contacts)
    return Bounds(rows.forms(), judges)


def _judge(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact], rows: Questions
) -> Judge:
    if contact.kind in (Kind.VERTEX_FACE, Kind.BALL_FACE):  # a ball touches where its centre is over the face
        return _in_face(assembly, contact, together, rows)
    if contact.kind is Kind.EDGE_EDGE:
        return _in_edges(assembly, contact, together, rows)
    return _on_moving_face(assembly, contact, rows)


@dataclass(frozen=True, eq=False)
class _Rim:
    """An edge around a convex part of a face."""

    span: tuple[int, int]
    inward: Array  # normal of the plane that has the part in front of it (3,)
    offset: float  # of that plane, m
    # Whether the part goes along the edge's line no farther than the edge does; beyond it is more of the face
    whole: bool
    swallowed: tuple[Span, ...]


_Region = tuple[_Rim, ...]
"""The edges whose inward planes bound a convex part of a face."""


@remembered(_MEMORY)
def _regions(assembly: Assembly, part: Polyhedron, face: int) -> tuple[_Region, ...]:
    """Convex parts of a face without its holes, all of it where its outline is convex."""
    loop, normal = part.faces[face].loops[0], part.faces[face].normal
    points = part.vertices[list(loop)]
    ends = np.array([points, np.roll(points, -1, axis=0)])
    inward = cross(normal, ends[1] - ends[0])
    inward /= lengths(inward)[:, None]
    offsets = np.vecdot(inward, points)
    convex = {frozenset(edge.vertices): edge.convex for edge in part.edges}
    spans = list(zip(loop, (*loop[1:], loop[0]), strict=True))

    def rim(i: int, whole: bool) -> _Rim:
        walled = whole and not convex[frozenset(spans[i])]
        behind = swallowed(assembly, ends[:, i], inward[i]) if walled else ()
        return _Rim(spans[i], inward[i], float(offsets[i]), whole, behind)

    if (points @ inward.T - offsets >= -NEAR).all():
        return (tuple(rim(i, True) for i in range(len(spans))),)
    regions = convex_regions(ends, inward, offsets)
    return tuple(tuple(rim(i, along_edge(i, chosen, ends, inward, offsets)) for i in chosen) for chosen in regions)


def cornered(assembly: Assembly, contact: PrimitiveContact, pose: Pose) -> bool:
    """Whether a vertex on a face is at a corner that the face goes around, where no convex part of it has it inside.

    Such a contact may hold, but what bounds it is not known.
    """
    if contact.kind is not Kind.VERTEX_FACE:
        return False
    at = pose.apply(assembly.moving.polyhedron.vertices[contact.moving[0]])
    regions = _regions(assembly, assembly.fixed.polyhedron, contact.fixed_feature)
    return not any(
        all(rim.inward @ at - rim.offset > TOUCH or (rim.whole and rim.swallowed) for rim in region)
        for region in regions
    )


@remembered(_MEMORY)
def _holes(assembly: Assembly, part: Polyhedron, face: int) -> tuple[tuple[tuple[Array, float], ...], ...]:
    """For each hole of a face, the planes across those of its edges that have all of it behind them."""
    normal, found = part.faces[face].normal, []
    for loop in part.faces[face].loops[1:]:
        points = part.vertices[list(loop)]
        ways = cross(normal, np.roll(points, -1, axis=0) - points)
        ways = ways / lengths(ways)[:, None]
        planes = [(way, float(way @ p)) for way, p in zip(ways, points, strict=True)]
        found.append(tuple((way, at) for way, at in planes if (points @ way <= at + NEAR).all()))
    return tuple(found)


def _in_face(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact], rows: Questions
) -> Judge:
    fixed, vertex = assembly.fixed.polyhedron, assembly.moving.polyhedron.vertices[contact.moving[0]]
    regions = [
        [
            (
                rows.above(vertex, rim.inward, rim.offset),
                rim.swallowed,
                _slips(assembly, contact, together, rim, rows) if rim.whole else lambda lower, room: False,
            )
            for rim in region
        ]
        for region in _regions(assembly, fixed, contact.fixed_feature)
    ]
    outlines = _holes(assembly, fixed, contact.fixed_feature)
    holes = [[rows.above(vertex, way, at) for way, at in planes] for planes in outlines]

    def judge(lower: Lower) -> float:
        beyond = min((max([-UNBOUNDED, *(lower[k] for k in planes)]) for planes in holes), default=UNBOUNDED)
        most = -UNBOUNDED
        for asked in regions:
            found = beyond
            for room, behind, slips in asked:
                value = lower[room]
                if value < found and not (_within(behind, value) or slips(lower, value)):
                    found = value
            most = max(most, found)
        return most

    return judge


def _slips(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact], rim: _Rim, rows: Questions
) -> Callable[[Lower, float], bool]:
    """Whether an edge held across a rim takes over when the vertex, this far from it, slips over it.

    That edge has its other end on the same wall, farther inside the rim, or properly crosses another rim of the wall;
    its line is then in the wall either way, so that edge contact and vertex contact have the same zeros.
    """
    body, wall, vertex = assembly.moving.polyhedron.vertices, contact.fixed_feature, contact.moving[0]
    on_wall = held_on(assembly, wall, together)
    far: list[int] = []
    crossings: list[tuple[Judge, Judge]] = []
    for other in together:
        if other.kind is Kind.EDGE_EDGE and set(other.fixed) == set(rim.span) and vertex in other.moving:
            end = other.moving[1] if other.moving[0] == vertex else other.moving[0]
            if end in on_wall:
                far.append(rows.above(body[end], rim.inward, rim.offset))
            for kept in together:
                if other_rim(assembly, other, kept, wall):
                    crossings.append((_sides(assembly, kept, wall, rows), _sides(assembly, other, wall, rows)))

    def slips(lower: Lower, room: float) -> bool:
        inside = any(lower[k] > max(room, 0.0) + _SURELY for k in far)
        return inside or any(kept(lower) > max(waived(lower), 0.0) + _SURELY for kept, waived in crossings)

    return slips


def _sides(assembly: Assembly, contact: PrimitiveContact, along: int, rows: Questions) -> Judge:
    """How far the ends of a moving edge stay on different sides of the face across its fixed edge from a wall."""
    body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
    wall = fixed.faces[along]
    asked = []
    for n in fixed.edges[contact.fixed_feature].faces:
        face = fixed.faces[n]
        if not assembly.agree(face.normal, face.offset, wall.normal, wall.offset):
            for a, b in (contact.moving, contact.moving[::-1]):
                below = rows.above(body[a], -face.normal, -face.offset)
                asked.append((below, rows.above(body[b], face.normal, face.offset)))
    return lambda lower: max(min(lower[below], lower[above]) for below, above in asked)


def _within(spans: Sequence[Span], room: float) -> bool:
    depth = max(0.0, -room) + _BEYOND
    return any(low < depth < high for low, high in spans)


def _in_edges(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact], rows: Questions
) -> Judge:
    fixed = assembly.fixed.polyhedron
    lies_in = _lying_in(assembly, contact, together, rows)
    ways = product(fixed.edges[contact.fixed_feature].faces, (contact.moving, contact.moving[::-1]))
    crossings = [(number, _across(assembly, contact, number, ends, rows)) for number, ends in ways]

    def judge(lower: Lower) -> float:
        shared = lies_in(lower)
        return max(across(lower, shared is not None) for number, across in crossings if number != shared)

    return judge


def _lying_in(
    assembly: Assembly, contact: PrimitiveContact, together: Sequence[PrimitiveContact], rows: Questions
) -> Callable[[Lower], int | None]:
    """The wall in which a moving edge lies whether or not it crosses here, when another contact warrants that."""
    shared = taken_turns(assembly, contact, together)
    if shared is None:
        return lambda lower: None
    if set(contact.moving) <= held_on(assembly, shared, together):
        return lambda lower: shared
    own = _sides(assembly, contact, shared, rows)
    others = [_sides(assembly, c, shared, rows) for c in together if other_rim(assembly, contact, c, shared)]
    return lambda lower: shared if any(kept(lower) > max(own(lower), 0.0) + _SURELY for kept in others) else None


def _across(
    assembly: Assembly, contact: PrimitiveContact, number: int, ends: tuple[int, ...], rows: Questions
) -> Callable[[Lower, bool], float]:
    """How far an edge that runs from below a wall to above it crosses within both edges.

    The result takes the lower bounds, and whether the edge lies in the other wall and need not cross at all.
    """
    a, b = assembly.moving.polyhedron.vertices[list(ends)]
    wall = assembly.fixed.polyhedron.faces[number]
    below, above = rows.above(a, -wall.normal, -wall.offset), rows.above(b, wall.normal, wall.offset)
    rise, depth = rows.along(wall.normal, b - a), rows.above(a, wall.normal, wall.offset)
    both = _blocked(assembly, contact.fixed_feature, number)
    rooms = [(rows.above(a, way, float(way @ end)), rows.along(way, b - a), blocked) for end, way, blocked in both]

    def margin(lower: Lower, lies: bool) -> float:
        found, share = UNBOUNDED, 1.0
        if not lies:
            found = min(lower[below], lower[above])
            if lower[rise] > 0.0:
                share = min(1.0, -lower[depth] / lower[rise])
        for room, turned, blocked in rooms:
            value = lower[room] + min(0.0, share * lower[turned])
            if value < found and not _within(blocked, value):
                found = value
        return found

    return margin


@remembered(_MEMORY)
def _blocked(assembly: Assembly, edge: int, wall: int) -> tuple[tuple[Array, Array, tuple[Span, ...]], ...]:
    """Both ends of a fixed edge: end, direction inward, and the depths to which the edge's line goes on beyond it
    within a piece, or within a piece's face in a wall's plane.

    An edge that crosses the wall there would enter that piece, which the separations rule out.
    """
    fixed = assembly.fixed.polyhedron
    face = fixed.faces[wall]
    c, d = fixed.vertices[list(fixed.edges[edge].vertices)]
    u = (d - c) / length(d - c)
    found = []
    for end, inward in ((c, u), (d, -u)):
        spans = []
        for normals, offsets in assembly.fixed_planes:
            heights, rise = normals @ end - offsets, -(normals @ inward)
            flush = [n for n in range(len(normals)) if assembly.agree(normals[n], offsets[n], face.normal, face.offset)]
            for others in (np.ones(len(normals), dtype=bool), *(np.arange(len(normals)) != n for n in flush)):
                if (heights[others] <= NEAR).all():
                    spans.append(span(list(zip(-NEAR - heights[others], rise[others], strict=True))))
        found.append((end, inward, tuple(span for span in spans if span[0] < span[1])))
    return tuple(found)


def _on_moving_face(assembly: Assembly, contact: PrimitiveContact, rows: Questions) -> Judge:
    if len(assembly.moving.polyhedron.faces[contact.moving_feature].loops) > 1:
        return lambda lower: -UNBOUNDED
    w = assembly.fixed.polyhedron.vertices[contact.fixed[0]]
    regions = _regions(assembly, assembly.moving.polyhedron, contact.moving_feature)
    asked = [[rows.beneath(rim.inward, rim.offset, w) for rim in region] for region in regions]
    return lambda lower: max((min(lower[k] for k in region) for region in asked), default=-UNBOUNDED)
