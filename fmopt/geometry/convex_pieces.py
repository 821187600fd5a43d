"""From a CSG tree to polyhedra: its exact convex half-space pieces, and its boundary.

A difference base ∖ tool with tool = {x : h_i(x) ≤ 0, all i} is the union of the slabs base ∩ {h_i ≥ 0}. The slabs
overlap on purpose: each is as large as it can be, so that one plane keeps another body off it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, assert_never

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.csg import (
    Box,
    Cone,
    Cylinder,
    Difference,
    Hull,
    Moved,
    Prism,
    Ring,
    Solid,
    Sphere,
    Stack,
    Union,
    Wedge,
    convex_polyhedron,
    corners,
    exact_pose,
    operands,
)
from fmopt.geometry.facets import place, require_few, together
from fmopt.geometry.polyhedron import (
    Polyhedron,
    convex_hull_polyhedron,
    from_faces,
    from_triangles,
    manifold_of,
    mesh_of,
    placed,
)
from fmopt.geometry.upright_prisms import upright_axes
from fmopt.runtime.clock import heed
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, remembered

if TYPE_CHECKING:
    from manifold3d import Manifold
    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

ROUNDING = 1e-12  # m: vertices this close to a plane lie on it, coordinates this close to an operand's are that one
_SLIVER = 1e-9  # of the volume of the piece that was cut
_NOISE = 1e-13  # relative, of volumes
_MANY = 16  # bodies, from which prisms are united by their sections
_DECIMALS = 12  # of levels in m
_MERIDIANS = 32  # of the polyhedra that stand for balls where those are only shown


@remembered(1)
def material(solid: Solid) -> tuple[Polyhedron, ...]:
    """Convex polyhedra whose union is the solid; they overlap. There are none where its tools take all of it away.

    Slivers below 1e-9 of the volume of the piece they were cut from, and pieces inside others, are dropped.
    """
    return _pieces(solid, Pose.identity())


def pieces(solid: Solid) -> tuple[Polyhedron, ...]:
    """The `material` of a solid that is not empty.

    Raises:
        GeometryError: it is.
    """
    if not (made := material(solid)):
        raise GeometryError("the solid is empty: its tools take all of its base away", "make the tools smaller")
    return made


def clip(body: Polyhedron, normal: Array, offset: float) -> Polyhedron | None:
    """The part of a convex polyhedron in the half-space normal·x ≤ offset (m), None when there is none.

    Vertices on the plane stay as they are; cuts across an axis get that coordinate exactly. The normal is (3,).
    """
    height = body.vertices @ normal - offset
    side = np.where(np.abs(height) <= ROUNDING, 0, np.sign(height)).astype(int)
    if not np.any(side > 0):
        return body
    if not np.any(side < 0):
        return None
    points = [*body.vertices]
    cuts: dict[tuple[int, int], int] = {}
    for edge in body.edges:
        a, b = edge.vertices
        if side[a] * side[b] < 0:
            cuts[a, b] = cuts[b, a] = len(points)
            points.append(_crossing(body.vertices[a], body.vertices[b], height[a], height[b], normal, offset))
    loops, planes, following = [], [], {}
    for face in body.faces:
        loop = _clipped_loop(face.loops[0], side, cuts)
        if len(loop) < 3:
            continue
        loops.append([loop])
        planes.append((face.normal, face.offset))
        # The rim runs against the faces beside it; index i + 1 − n is the next corner, behind the last one the first.
        flat = [vertex >= len(body.vertices) or side[vertex] == 0 for vertex in loop]
        following.update(
            {loop[(i + 1) % len(loop)]: loop[i] for i in range(len(loop)) if flat[i] and flat[i + 1 - len(loop)]}
        )
    rim = _chain(following)
    if rim is None:
        with suppress(GeometryError):  # of what lies in a plane
            return convex_hull_polyhedron(np.array([*body.vertices[side <= 0], *points[len(body.vertices) :]]))
        return None
    loops.append([rim])
    planes.append((normal, offset))
    return from_faces(np.array(points), loops, planes)


def polyhedron(solid: Solid) -> Polyhedron:
    """The boundary of the solid, coordinates of its operands kept to the bit.

    Raises:
        GeometryError: the solid is empty, has too many faces, or touches itself along an edge or at a corner.
    """
    stock: list[Array] = []
    shells = [mesh_of(s) for s in _manifold(solid, Pose.identity(), stock).decompose() if _is_thick(s)]
    if not shells:
        raise GeometryError("the solid is empty: its tools take all of its base away", "make the tools smaller")
    points, triangles = together(shells)
    body = from_triangles(snapped(points, np.vstack(stock)), triangles)
    require_few(len(body.faces))
    order = np.lexsort(body.vertices.T)
    if len(double := np.flatnonzero(np.all(np.diff(body.vertices[order], axis=0) == 0.0, axis=1))):
        if isinstance(solid, Moved):  # in its own frame many coordinates are one, and rounding makes none meet
            return bounded(solid, placed(polyhedron(solid.solid), exact_pose(solid.pose)))
        raise GeometryError(
            f"the solid touches itself at {place(body.vertices[order[double[0]]])}",
            "let the operands overlap there or leave a gap",
        )
    return body


def bounded(solid: Solid, body: Polyhedron) -> Polyhedron:
    """The boundary of a solid that is known but for rounding, coordinates of its operands kept to the bit."""
    found = operands(solid, Pose.identity())
    known = np.vstack([convex_polyhedron(operand.primitive, operand.pose).vertices for operand in found])
    return from_faces(snapped(body.vertices, known), [face.loops for face in body.faces])


def volume(solid: Solid) -> float:
    """The volume of a CSG tree, m³."""
    match solid:
        case Moved(inner, _):
            return volume(inner)
        case Difference(Hull() as base, tools) if all(isinstance(tool, Hull) for tool in tools):
            return _volume_less(pieces(base), [body for tool in tools for body in pieces(tool)])
        case _:
            return float(manifold(solid).volume())


def _volume_less(stock: Sequence[Polyhedron], tools: Sequence[Polyhedron]) -> float:
    """The volume of the union of convex polyhedra less that of others, m³."""
    if prisms := _prisms([*stock, *tools]):
        lost = prisms.with_all(range(len(stock), len(stock) + len(tools)))
        return prisms.with_all(range(len(stock))) - lost
    return float((union_manifold(stock) - union_manifold(tools)).volume())


def manifold(solid: Solid) -> Manifold:
    """The manifold3d solid of a CSG tree."""
    return _manifold(solid, Pose.identity(), [])


def convex_manifold(body: Polyhedron) -> Manifold:
    """The manifold3d solid of a convex polyhedron.

    Raises:
        GeometryError: its faces do not close.
    """
    fans = [
        (loop[0], loop[i], loop[i + 1]) for (loop,) in (f.loops for f in body.faces) for i in range(1, len(loop) - 1)
    ]
    made = manifold_of(body.vertices, np.array(fans))
    if made.is_empty():
        raise GeometryError(f"a convex body is no solid: {made.status()}", "report the model: its faces do not close")
    return made


def union_manifold(bodies: Sequence[Polyhedron]) -> Manifold:
    """The manifold3d union of convex polyhedra."""
    from manifold3d import Manifold, OpType

    return Manifold.batch_boolean([convex_manifold(body) for body in bodies], OpType.Add)


def _pieces(solid: Solid, pose: Pose) -> tuple[Polyhedron, ...]:
    match solid:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            return (convex_polyhedron(solid, pose),)
        case Moved(inner, move):
            return _pieces(inner, exact_pose(pose).compose(exact_pose(move)))
        # A Stack is a Union, but its parts are few as they are made: none is measured to be dropped.
        case Stack(parts):
            return tuple(piece for part in parts for piece in _pieces(part, pose))
        case Union(parts):
            bodies = [piece for part in parts for piece in _pieces(part, pose)]
            return _irredundant(bodies, union_manifold(bodies).volume())
        case Difference(base, tools):
            left = _pieces(base, pose)
            for tool in tools:
                left = _minus(left, tool, pose)
            return left
        case _:
            assert_never(solid)


def _minus(stock: tuple[Polyhedron, ...], tool: Solid, pose: Pose) -> tuple[Polyhedron, ...]:
    """Pieces of (union of stock) ∖ tool; a tool that is itself a difference gives back what its own tools spare."""
    match tool:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            body = convex_polyhedron(tool, pose)
            if len(stock) == 1:
                return tuple(_slabs(stock[0], body))  # each alone has what is right outside its own face of the tool
            whole = _volume_less(stock, [body])
            slabs = [slab for some in [_slabs(piece, body) for piece in stock] for slab in some]
            # What the tool leaves whole is needed still: of the others there is less than before.
            intact = {id(piece) for piece in stock}
            return _irredundant(slabs, whole, [i for i, slab in enumerate(slabs) if id(slab) in intact])
        case Moved(inner, move):
            return _minus(stock, inner, exact_pose(pose).compose(exact_pose(move)))
        case Union(parts):
            for part in parts:
                stock = _minus(stock, part, pose)
            return stock
        case Difference(base, tools):
            # S ∖ (B ∖ T) = (S ∖ B) ∪ (S ∩ T).
            spared = [_common(piece, body) for inner in tools for body in _pieces(inner, pose) for piece in stock]
            bodies = [*_minus(stock, base, pose), *(piece for piece in spared if piece is not None)]
            return _irredundant(bodies, union_manifold(bodies).volume())
        case _:
            assert_never(tool)


def _slabs(piece: Polyhedron, tool: Polyhedron) -> list[Polyhedron]:
    """Pieces of piece ∖ tool, one for each plane of the tool that bounds piece ∩ tool; the other planes are idle."""
    # The one with more faces is cut by those of the other: which of its planes are left is the same either way.
    common = _within(tool, piece) if len(tool.faces) > len(piece.faces) else _within(piece, tool)
    if common is None or common.volume <= _SLIVER * piece.volume:
        return [piece]
    # `clip` hands planes on to the bit, so that they can be looked up.
    bounding = {(face.offset, *face.normal) for face in common.faces}
    planes = [face for face in tool.faces if (face.offset, *face.normal) in bounding]
    cut = [clip(piece, -face.normal, -face.offset) for face in planes]
    return [slab for slab in cut if slab is not None and slab.volume > _SLIVER * piece.volume]


def _common(piece: Polyhedron, other: Polyhedron) -> Polyhedron | None:
    """The intersection of two convex polyhedra, None when it is empty or a sliver of the piece."""
    common = _within(piece, other)
    return common if common is not None and common.volume > _SLIVER * piece.volume else None


def _within(body: Polyhedron, other: Polyhedron) -> Polyhedron | None:
    """What a convex polyhedron has inside of another one, None when there is nothing."""
    heed()
    above = _heights(body, other)
    if any(np.any(heights.min(axis=0) >= -ROUNDING) for heights in (above, _heights(other, body))):
        return None
    for k in np.flatnonzero(above.max(axis=0) > ROUNDING).tolist():
        face = other.faces[k]
        left = clip(body, face.normal, face.offset)
        if left is None:
            return None
        body = left
    return body


def _heights(body: Polyhedron, other: Polyhedron) -> Array:
    """Heights (n, m) of the vertices of a polyhedron above the faces of another one, m."""
    return body.vertices @ other.normals.T - other.offsets


def _irredundant(bodies: Sequence[Polyhedron], whole: float, needed: Sequence[int] = ()) -> tuple[Polyhedron, ...]:
    """Few of the bodies whose union has the volume `whole` (m³), chosen by the volume they add; input order.

    Gains only fall while the union grows, so a body whose gain is old is measured again before it is chosen. Those that
    are known to be `needed`, by number, are not measured.
    """
    if len(bodies) < 2:
        return tuple(bodies)
    union, kept = (_prisms(bodies) if len(bodies) > _MANY else None) or _Union(bodies), [*needed]
    covered, enough = union.with_all(needed), (1.0 - _NOISE) * whole
    queue = [(-bodies[i].volume, i, 0) for i in sorted({*range(len(bodies))} - {*needed})]
    heapify(queue)
    while queue and covered < enough:
        heed()
        gain, i, age = heappop(queue)
        if age == len(kept):
            union.add(i)
            kept.append(i)
            covered -= gain
        elif (gain := union.gain(i)) > _SLIVER * bodies[i].volume:
            heappush(queue, (-gain, i, len(kept)))
    return tuple(bodies[i] for i in sorted(kept))


class _Union:
    """The union of some bodies, each by its number."""

    def __init__(self, bodies: Sequence[Polyhedron]) -> None:
        from manifold3d import Manifold

        self._solids, self._whole = [convex_manifold(body) for body in bodies], Manifold()

    def with_all(self, which: Sequence[int]) -> float:
        """Its volume with some bodies, m³."""
        from manifold3d import Manifold, OpType

        self._whole = Manifold.batch_boolean([self._whole, *(self._solids[i] for i in which)], OpType.Add)
        return float(self._whole.volume())

    def add(self, i: int) -> None:
        # Where bodies meet in a plane their union keeps edges that are none, each of which takes time.
        self._whole = (self._whole + self._solids[i]).as_original().simplify(ROUNDING)

    def gain(self, i: int) -> float:
        """The volume that another body would add, m³."""
        return float((self._solids[i] - self._whole).volume())


class _Sections(_Union):
    """The same of prisms along one axis, by sections between the levels of their ends: that takes a tenth of the time.

    Args:
        ends: levels (n, 2) of the floor and the roof of each, m.
    """

    def __init__(self, sections: Sequence[Polygon], ends: Array) -> None:
        from shapely import Polygon

        levels = np.unique(ends)
        self._sections, self._heights = sections, np.diff(levels)
        self._slabs = [range(*np.searchsorted(levels, one)) for one in ends]
        self._filled: list[BaseGeometry] = [Polygon()] * len(self._heights)

    def with_all(self, which: Sequence[int]) -> float:
        """Its volume with some bodies, m³."""
        from shapely import union_all

        for k in range(len(self._filled)):
            self._filled[k] = union_all([self._filled[k], *(self._sections[i] for i in which if k in self._slabs[i])])
        return float(sum(h * one.area for h, one in zip(self._heights, self._filled, strict=True)))

    def add(self, i: int) -> None:
        for k in self._slabs[i]:
            self._filled[k] = self._filled[k].union(self._sections[i])

    def gain(self, i: int) -> float:
        """The volume that another body would add, m³."""
        return float(sum(self._heights[k] * self._sections[i].difference(self._filled[k]).area for k in self._slabs[i]))


def _prisms(bodies: Sequence[Polyhedron]) -> _Sections | None:
    """Bodies by their sections, if all of them are prisms along one axis of coordinates."""
    from shapely import Polygon

    for axis in upright_axes(np.vstack([body.normals for body in bodies])):
        across = [k for k in range(3) if k != axis]
        floors = [next(face.loops[0] for face in body.faces if face.normal[axis] < -0.5) for body in bodies]
        sections = [Polygon(body.vertices[list(f)][:, across]) for body, f in zip(bodies, floors, strict=True)]
        heights = [body.vertices[:, axis].round(_DECIMALS) for body in bodies]
        return _Sections(sections, np.array([(one.min(), one.max()) for one in heights]))
    return None


def _clipped_loop(loop: tuple[int, ...], side: np.ndarray, cuts: dict[tuple[int, int], int]) -> list[int]:
    kept = []
    for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
        if side[a] <= 0:
            kept.append(a)
        if (a, b) in cuts:
            kept.append(cuts[a, b])
    return kept


def _chain(following: dict[int, int]) -> list[int] | None:
    """The vertices around a cut; None where rounding leaves no loop, as beside faces that the plane next to touches."""
    start = min(following, default=-1)
    loop = [start]
    for _ in following:
        ahead = following.get(loop[-1])
        if ahead is None:
            return None
        if ahead == start:
            return loop
        loop.append(ahead)
    return None


def _crossing(a: Array, b: Array, at_a: float, at_b: float, normal: Array, offset: float) -> Array:
    """Where the segment from a to b meets the plane, interpolated from its nearer end."""
    if abs(at_a) > abs(at_b):
        a, b, at_a, at_b = b, a, at_b, at_a
    point = a + at_a / (at_a - at_b) * (b - a)
    for axis in np.flatnonzero(np.abs(normal) == 1.0):
        point[axis] = normal[axis] * offset
    return np.asarray(point)


def _is_thick(shell: Manifold) -> bool:
    """Whether a shell is more than the skin that rounding leaves between two tools."""
    # A skin has two sides: its volume is half of its surface times its thickness.
    return bool(2.0 * abs(shell.volume()) > ROUNDING * shell.surface_area())


def snapped(points: Array, known: Array) -> Array:
    """Points (n, 3), m, with coordinates that are off a coordinate of known points (m, 3) by rounding made that one."""
    return np.column_stack([_snapped(points[:, axis], known[:, axis]) for axis in range(3)])


def _snapped(values: Array, known: Array) -> Array:
    grid = np.unique(known)
    above = np.clip(np.searchsorted(grid, values), 1, len(grid) - 1)
    nearest = np.where(values - grid[above - 1] < grid[above] - values, grid[above - 1], grid[above])
    return np.where(np.abs(nearest - values) <= ROUNDING, nearest, values)


def _manifold(solid: Solid, pose: Pose, stock: list[Array]) -> Manifold:
    """The manifold3d solid, the vertices of its operands noted in `stock`."""
    from manifold3d import Manifold, OpType

    match solid:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            body = convex_polyhedron(solid, pose)
            stock.append(body.vertices)
            return convex_manifold(body)
        case Moved(inner, move):
            return _manifold(inner, exact_pose(pose).compose(exact_pose(move)), stock)
        case Stack(_, lofts):
            return Manifold.batch_boolean([_loft(below, above, pose, stock) for below, above in lofts], OpType.Add)
        case Union(parts):
            return Manifold.batch_boolean([_manifold(part, pose, stock) for part in parts], OpType.Add)
        case Difference(base, tools):
            return Manifold.batch_boolean([_manifold(part, pose, stock) for part in (base, *tools)], OpType.Subtract)
        case _:
            assert_never(solid)


def _loft(below: Ring, above: Ring, pose: Pose, stock: list[Array]) -> Manifold:
    """What is between two rings of corners, the walls straight, one above the other."""
    from manifold3d import triangulate

    points, count = exact_pose(pose).apply(np.array([*below, *above])) + 0.0, len(below)
    cap = np.asarray(triangulate([np.array(below)[:, :2]]), dtype=np.int64)
    lid = np.asarray(triangulate([np.array(above)[:, :2]]), dtype=np.int64) + count
    one = np.arange(count)
    two = np.roll(one, -1)
    walls = [np.column_stack([one, two, two + count]), np.column_stack([one, two + count, one + count])]
    triangles = np.vstack([cap[:, ::-1], *walls, lid])
    stock.append(points)
    made = manifold_of(points, triangles)
    if made.is_empty():
        raise GeometryError(f"the walls between two sections do not close: {made.status()}", "check both outlines")
    return made


def faceted(body: Polyhedron) -> Polyhedron:
    """The same bounded by faces alone: in place of each ball a polyhedron inside it, its corners on the ball."""
    if not body.balls:
        return body
    points, loops = list(body.vertices), [face.loops for face in body.faces]
    for vertex, radius in body.balls:
        globe = convex_hull_polyhedron(corners(Sphere(radius, _MERIDIANS)))
        loops += [(tuple(len(points) + i for i in face.loops[0]),) for face in globe.faces]
        points += list(globe.vertices + body.vertices[vertex])
    return from_faces(points, loops)
