"""That convex pieces make up a part: the two agree as sets, which is decided exactly.

Each piece stands for two bodies of half-spaces, one a little larger than its hull and one a little smaller (see
`ConvexPiece`). Of the larger ones, the boundary of their union is in what is left of the faces of each without the
inside of all others. Where none of that meets the part's surface or is inside the part, and every shell of the surface
has a vertex inside one of them, they cover the part: else their boundary would divide the inside of the part between
them and what is not covered, and had an area there. The part is nowhere farther from them than `DEVIATION`.

Nothing of a piece sticks out where the part's surface does not meet the smaller body, and one point of that is inside.

Convex pieces as half-spaces with integer coefficients that hold a little more than their hulls, or a little less.

The half-space of a face goes out by `SHIFT` beyond the outermost vertex of the piece, so that all of them together hold
the hull of the vertices. Where their planes meet in places that are all next to vertices, they hold nothing that is
farther than `DEVIATION` from the hull.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from math import gcd, isqrt
from typing import NamedTuple

from fmopt.verify.arithmetic.exact import area, turned_over
from fmopt.verify.arithmetic.exact import height as elevation
from fmopt.verify.arithmetic.lattice import (
    FINENESS,
    Bounds,
    HalfSpace,
    Loops,
    Place,
    Point,
    TooMuchWork,
    WorkLeft,
    apart,
    bounds,
    common,
    elevations,
    on_lattice,
    place,
    steepest,
)
from fmopt.verify.arithmetic.rational import ONE
from fmopt.verify.parts.solids import Shape
from fmopt.verify.parts.surface import CutSurface

# Steps that may be taken: what parts take is about the square of their number of vertices.
_LEAST_STEPS = 20_000
_MOST_STEPS = 20_000_000
_SHARE = 4

DEVIATION = ONE // 10**11  # m: how far a part may reach beyond the hulls of its pieces
SHIFT = 1 << (FINENESS - 45)  # 3·10⁻¹⁴ m: more than piece and part differ by where they agree but for rounding
_NEXT = (1 << FINENESS) * 9 // (16 * 10**11)  # along each axis, a little less than DEVIATION/√3
_ROOM = 1 << (FINENESS - 10)  # 1 mm
_PRECISION = 64  # bits of a normal


def uncovered(part: Shape, pieces: Sequence[Shape]) -> Iterator[str]:
    """What keeps the faces of a part from being the surface of a solid, and its convex pieces from being that solid."""
    size = sum(len(shape.vertices) + len(shape.faces) for shape in (part, *pieces))
    # The work is bounded, as a plan may come from anybody: what takes longer is refused, not waited for.
    work = WorkLeft(min(_MOST_STEPS, _LEAST_STEPS + _SHARE * size * size))
    try:
        surface = CutSurface(part, work)
        if surface.flaws:
            yield from surface.flaws
            return
        hulls = [ConvexPiece(piece, work) for piece in pieces]
        flaws = [f"piece {n}: {flaw}" for n, hull in enumerate(hulls) for flaw in hull.flaws()]
        yield from flaws
        if not flaws:
            yield from (f"piece {n} sticks out of the part" for n in _sticking_out(surface, hulls, work))
            at = _open(surface, hulls, work)
            if at is not None:
                yield f"the pieces leave the part uncovered at {_told(at)}"
    # Refused as too much work: nothing is claimed of what was not compared.
    except TooMuchWork:
        yield "the part and its pieces take too many steps to compare"


def _sticking_out(surface: CutSurface, hulls: Sequence[ConvexPiece], work: WorkLeft) -> Iterator[int]:
    """The pieces that the surface meets, or that are outside of it."""
    corners = [tuple(place(p) for p in surface.corners(t)) for t in range(len(surface.triangles))]
    for n, hull in enumerate(hulls):
        # Triangles of the surface against the inside of the piece: a common point is material that ends within it.
        work.spend(len(corners))
        near = (t for t, box in enumerate(surface.boxes) if not apart(box, hull.box))
        # No triangle within: then the piece is all inside or all outside, and one point tells.
        if any(common(corners[t], hull.inner) for t in near) or not surface.holds(hull.middle):
            yield n


def _open(surface: CutSurface, hulls: Sequence[ConvexPiece], work: WorkLeft) -> Place | None:
    """A place inside the part, or on its surface, that the pieces leave uncovered; None where there is none."""
    for shell in surface.shells:
        start = place(surface.points[surface.triangles[shell[0]][0]])
        # One point of each shell: what follows from the boundaries of pieces says nothing of a shell they do not touch.
        if not any(all(elevation(space, start) < 0 for space in hull.outer) for hull in hulls):
            return start
    corners = [tuple(place(p) for p in surface.corners(t)) for t in range(len(surface.triangles))]
    for n, hull in enumerate(hulls):
        others = [other for m, other in enumerate(hulls) if m != n and not apart(other.box, hull.box)]
        for face in hull.cells:
            for cell in _left_of(face, others, work):
                work.spend(len(corners))
                # What is left of a piece's boundary must not be inside the part: the part would go on beyond it.
                if _meets(surface, corners, cell) or surface.holds(cell.corners[0]):
                    return cell.corners[0]
    return None


def _left_of(face: Cell, others: Sequence[ConvexPiece], work: WorkLeft) -> list[Cell]:
    """What of a face is in none of the other bodies."""
    cells = [face]
    box = bounds(face.corners)
    for other in others:
        if apart(box, other.box):
            continue
        work.spend(len(cells) * len(other.outer))
        # Cut one after the other, as cells stay convex: differences of polygons would not.
        cells = [left for cell in cells for left in cell.without(other.outer)]
        if not cells:
            break
    return cells


def _meets(surface: CutSurface, corners: Sequence[Sequence[Place]], cell: Cell) -> bool:
    """Whether the surface has a point of a cell."""
    box = bounds(cell.corners)
    return any(
        _across(cell.corners, surface.planes[t]) and common(corners[t], cell.spaces)
        for t, other in enumerate(surface.boxes)
        if not apart(box, other)
    )


def _across(corners: Sequence[Place], plane: HalfSpace) -> bool:
    """Whether places are not all on one side of a plane."""
    heights = elevations(plane, corners)
    return min(heights) <= 0 <= max(heights)


def _told(p: Place) -> str:
    """A place in words, in mm."""
    unit = p[3] << FINENESS
    return "({:.6g}, {:.6g}, {:.6g}) mm".format(*(1e3 * (x / unit) for x in p[:3]))


class Cell(NamedTuple):
    """A convex polygon in a plane, its corners in order.

    Its sides are half-spaces that hold it, each with the way from the same corner to the next in its plane.
    """

    plane: HalfSpace
    corners: tuple[Place, ...]
    sides: tuple[HalfSpace, ...]

    @property
    def spaces(self) -> tuple[HalfSpace, ...]:
        """Half-spaces that hold nothing else."""
        return (self.plane, turned_over(self.plane), *self.sides)

    def behind(self, space: HalfSpace) -> Cell | None:
        """The part in a half-space; None where that has no area."""
        heights = elevations(space, self.corners)
        if max(heights) <= 0:
            return self
        if min(heights) >= 0:
            return None
        corners: list[Place] = []
        sides: list[HalfSpace] = []
        for k, (p, side, g) in enumerate(zip(self.corners, self.sides, heights, strict=True)):
            before, h, ahead = self.sides[k - 1], heights[k - 1], heights[(k + 1) % len(heights)]
            # Crossings are meetings of three planes, exact in homogeneous integers: nothing comes from rounded corners.
            if h < 0 < g or g < 0 < h:
                corners.append(meeting(self.plane, before, space))
                sides.append(space if g > 0 else before)
            if g <= 0:
                corners.append(p)
                sides.append(space if g == 0 < ahead else side)
        return Cell(self.plane, tuple(corners), tuple(sides))

    def without(self, spaces: Sequence[HalfSpace]) -> list[Cell]:
        """Cells that make up all of it that is not inside a convex body."""
        crossing = []
        # Planes that do not cross the cell cut nothing; one that has it in front leaves it whole.
        for space in spaces:
            heights = elevations(space, self.corners)
            if min(heights) >= 0:
                return [self]
            if max(heights) > 0:
                crossing.append(space)
        cell = self
        left = []
        for space in crossing:
            # In turn, each from what the ones before left inside: the pieces do not overlap.
            outside, inside = cell.behind(turned_over(space)), cell.behind(space)
            # Nothing of it is in the body: it is left whole, whatever was cut off before.
            if inside is None:
                return [self]
            if outside is not None:
                left.append(outside)
            cell = inside
        return left


def meeting(p: HalfSpace, q: HalfSpace, r: HalfSpace) -> Place:
    """The place where three planes meet."""
    a, b, c, d = p
    e, f, g, h = q
    i, j, k, l = r
    qr = (f * k - g * j, g * i - e * k, e * j - f * i)
    rp = (j * c - k * b, k * a - i * c, i * b - j * a)
    pq = (b * g - c * f, c * e - a * g, a * f - b * e)
    # Cramer's rule, homogeneous: no division, and the sign puts w > 0.
    size = a * qr[0] + b * qr[1] + c * qr[2]
    x, y, z = (d * u + h * v + l * w for u, v, w in zip(qr, rp, pq, strict=True))
    return (-x, -y, -z, -size) if size < 0 else (x, y, z, size)


class ConvexPiece:
    """A convex piece.

    Attributes:
        outer, inner: half-spaces of the faces, beyond the outermost vertex and behind the innermost of the face.
    """

    def __init__(self, shape: Shape, work: WorkLeft) -> None:
        self.points: tuple[Point, ...] = tuple(on_lattice(v) for v in shape.vertices)
        self.loops: tuple[Loops, ...] = tuple(face.loops for face in shape.faces)
        self.outer: list[HalfSpace] = []
        self.inner: list[HalfSpace] = []
        self._bent: list[int] = []
        work.spend(len(self.loops) * (len(self.loops) + len(self.points)))
        for n, loops in enumerate(self.loops):
            a, b, c = _short(area(self.points, loops))
            # A normal's length, rounded up: heights are compared in its units, without a root of their own.
            out = isqrt(a * a + b * b + c * c) + 1
            heights = [a * x + b * y + c * z for x, y, z in self.points]
            top, lowest = max(heights), min(heights[i] for loop in loops for i in loop)
            if top - lowest > _NEXT * out:
                self._bent.append(n)
            # Moved out, and in, by more than rounding can move a plane: what both agree on is so exactly.
            self.outer.append((a, b, c, top + SHIFT * out))
            self.inner.append((a, b, c, lowest - SHIFT * out))

    def flaws(self) -> Iterator[str]:
        """What keeps the half-spaces from being the hull of the vertices, but for `DEVIATION`."""
        if len({i for loops in self.loops for loop in loops for i in loop}) < len(self.points):
            yield "a vertex belongs to no face"
            return
        yield from (f"face {n} has material on both sides" for n in self._bent)
        if self._bent:
            return
        # Half-spaces of the faces may hold more than the hull where a face is missing: planes then meet off vertices.
        if not self.cells or not all(self._by_vertex(p) for cell in self.cells for p in cell.corners):
            yield "its faces meet elsewhere than in its vertices"
        elif any(elevation(space, self.middle) >= 0 for space in self.inner):
            yield "it is too thin to have an inside"

    def _by_vertex(self, p: Place) -> bool:
        x, y, z, w = p
        off = _NEXT * w
        return any(abs(x - a * w) <= off and abs(y - b * w) <= off and abs(z - c * w) <= off for a, b, c in self.points)

    @cached_property
    def middle(self) -> Place:
        """The mean of the vertices."""
        xs, ys, zs = zip(*self.points, strict=True)
        return (sum(xs), sum(ys), sum(zs), len(self.points))

    @cached_property
    def cells(self) -> list[Cell]:
        """The boundary of what the outer half-spaces hold; cut off 1 mm from the vertices where it goes on."""
        found = []
        used = [{i for loop in loops for i in loop} for loops in self.loops]
        for n, plane in enumerate(self.outer):
            cell: Cell | None = self._wide(plane)
            # Faces around this one leave few corners for the others to be compared with.
            beside = [k for k in range(len(used)) if k != n and not used[k].isdisjoint(used[n])]
            for k in (*beside, *(k for k in range(len(used)) if k != n and used[k].isdisjoint(used[n]))):
                if cell is not None:
                    cell = cell.behind(self.outer[k])
            if cell is not None:
                found.append(cell)
        return found

    def _wide(self, plane: HalfSpace) -> Cell:
        """A part of a plane that goes beyond all vertices, seen along an axis."""
        around: list[HalfSpace] = []
        k = steepest(plane)
        for sign in (1, -1):
            for axis in ((k + 1) % 3, (k + 2) % 3):
                normal = [0, 0, 0]
                normal[axis] = sign
                most = max(sign * p[axis] for p in self.points) + _ROOM
                # A millimetre beyond all vertices: wide enough to be cut back by the planes around, if there are any.
                around.append((normal[0], normal[1], normal[2], most))
        return Cell(plane, tuple(meeting(plane, around[n - 1], around[n]) for n in range(4)), tuple(around))

    @cached_property
    def box(self) -> Bounds:
        """A box around what the outer half-spaces hold."""
        return bounds([p for cell in self.cells for p in cell.corners])


def _short(n: Point) -> Point:
    """A direction in `_PRECISION` bits."""
    # The direction is shortened, not the plane: offsets are taken anew, so that vertices stay behind.
    spare = max(0, max(abs(x) for x in n).bit_length() - _PRECISION)
    a, b, c = (x >> spare for x in n)
    shared = gcd(a, b, c) or 1
    return (a // shared, b // shared, c // shared)
