"""The solids of a model as sets in the mating frame, and whether convex pieces are together the same set.

A cell is cut by planes of the solids until each of them holds all of it or nothing. What is thinner than the deviation
is left aside: where two sets are told to agree, a point of one outside the other lies within it of one of their planes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from fmopt.verify.arithmetic.rational import (
    ONE,
    Matrix,
    Vector,
    add,
    dot,
    exponential,
    number,
    product,
    sub,
    turned,
    vector,
)
from fmopt.verify.problem.cells import Cell, Plane, box_cell, cell_of, cut, heights, is_before, is_behind, plane_of
from fmopt.verify.problem.model import Solid
from fmopt.verify.problem.shapes import MOST_POINTS, Convex
from fmopt.verify.reading.document import Body as Piece

MOST_CUTS = 10_000
_ROOM = ONE >> 10  # 1 mm beyond boxes, so that planes do the cutting
_TOUCHES = ONE >> 33  # 1.2e-10 m
_SNAP = ONE >> 48  # 3.6e-15: entries of a rotation so close to −1, 0 or 1 are these


class Unbounded(ValueError):
    """A comparison that takes more work than one may."""


@dataclass(frozen=True)
class Frame:
    """Where a point x goes: R x + p."""

    R: Matrix
    p: Vector

    def __call__(self, x: Vector) -> Vector:
        return add(turned(self.R, x), self.p)

    def after(self, other: Frame) -> Frame:
        """First the other, then this."""
        return Frame(product(self.R, other.R), self(other.p))

    @property
    def inverse(self) -> Frame:
        """What undoes this."""
        (a, b, c), (d, e, f), (g, h, i) = self.R
        back: Matrix = ((a, d, g), (b, e, h), (c, f, i))
        x, y, z = turned(back, self.p)
        return Frame(back, (-x, -y, -z))


def frame(at: Sequence[float], turn: Sequence[float]) -> Frame:
    """The frame at a place, with the rotation vector; quarter turns are exact.

    Args:
        at: of its origin, m.
        turn: rotation vector, rad.
    """
    rows = [tuple(_snapped(x) for x in row) for row in exponential(vector(turn))]
    (a, b, c), (d, e, f), (g, h, i) = rows
    return Frame(((a, b, c), (d, e, f), (g, h, i)), vector(at))


def _snapped(x: int) -> int:
    return next((whole for whole in (-ONE, 0, ONE) if abs(x - whole) < _SNAP), x)


@dataclass(frozen=True)
class Body:
    """A convex set: planes that it lies behind, and the box around it."""

    planes: tuple[Plane, ...]
    low: Vector
    high: Vector
    known: Cell | None = None

    @cached_property
    def cell(self) -> Cell:
        """The set as a cell."""
        if self.known is not None:
            return self.known
        low = (self.low[0] - _ROOM, self.low[1] - _ROOM, self.low[2] - _ROOM)
        high = (self.high[0] + _ROOM, self.high[1] + _ROOM, self.high[2] + _ROOM)
        found = box_cell(low, high)
        for plane in self.planes:
            kept, _ = cut(found, plane)
            if kept is None:
                raise Unbounded("a convex solid is thinner than the deviation")
            found = kept
        return found


@dataclass(frozen=True)
class Tree:
    """A convex body, or the union of `first` without any of `minus`."""

    body: Body | None
    first: tuple[Tree, ...] = ()
    minus: tuple[Tree, ...] = ()


def tree_of(solid: Solid, at: Frame) -> Tree:
    """The set of a solid whose surroundings have this frame.

    Args:
        at: frame of its surroundings.

    Raises:
        Unbounded: a hull of too many points.
    """
    own = at.after(frame(solid.at, solid.turn))
    if solid.convex is not None:
        return Tree(_body(solid.convex, own))
    first, minus = (tuple(tree_of(part, own) for part in parts) for parts in (solid.first, solid.minus))
    return Tree(None, first, minus)


def _body(convex: Convex, at: Frame) -> Body:
    points = [at(vector(point)) for point in convex.points]
    if not convex.rings:
        x, y, z = _middle(points)
        columns = list(zip(*points, strict=True))
        (a, b, c), (d, e, f) = ([pick(column) for column in columns] for pick in (min, max))
        return Body(tuple(_hulled(points, (x, y, z))), (a, b, c), (d, e, f))
    n, count = len(convex.rings[0]), len(convex.rings)
    loops = [[*range(n)], [*range(n * (count - 1), n * count)]]
    for low in range(0, n * (count - 1), n):
        loops += [[low + k, low + (k + 1) % n, low + n + (k + 1) % n, low + n + k] for k in range(n)]
    return _faced(points, loops)


def _faced(points: Sequence[Vector], loops: Sequence[Sequence[int]]) -> Body:
    """The convex body of corners and faces; faces that enclose nothing are none."""
    middle = _middle(points)
    planes, kept = [], []
    for loop in loops:
        plane = plane_of([points[k] for k in loop], middle)
        if plane is not None:
            planes.append(plane)
            kept.append(loop)
    if len(kept) < 4:
        raise Unbounded("a convex solid has no volume")
    cell = cell_of(points, kept)
    return Body(tuple(planes), cell.low, cell.high, cell)


def _middle(points: Sequence[Vector]) -> Vector:
    x, y, z = (sum(column) // len(points) for column in zip(*points, strict=True))
    return x, y, z


def _hulled(points: Sequence[Vector], centre: Vector) -> Iterator[Plane]:
    """The planes through three points that have all others behind them, each once."""
    if len(points) > MOST_POINTS:
        raise Unbounded(f"a hull of more than {MOST_POINTS} points is not compared")
    found: list[Plane] = []
    for trio in combinations(points, 3):
        plane = plane_of(trio, centre)
        if plane is None or any(dot(plane.n, p) - plane.o > _TOUCHES for p in points):
            continue
        if not any(is_same(plane, other) for other in found):
            found.append(plane)
            yield plane


def is_same(one: Plane, other: Plane) -> bool:
    """Whether two planes hardly differ."""
    d = sub(one.n, other.n)
    return dot(d, d) < ONE >> 70 and abs(one.o - other.o) < ONE >> 40


def of_piece(piece: Piece) -> Body:
    """A convex piece of a plan.

    Raises:
        Unbounded: a face of it encloses nothing.
    """
    return _faced([vector(corner) for corner in piece.vertices], [loop for (loop,) in piece.faces])


def _side(cell: Cell, body: Body) -> tuple[bool | None, Plane | None]:
    """Whether a body holds all of a cell (True) or nothing of it (False); else a plane that cuts both."""
    for k in range(3):
        if cell.low[k] >= body.high[k] or cell.high[k] <= body.low[k]:
            return False, None
    # Cuts are limited: first by the plane that the cell reaches farthest beyond.
    cutting, most = None, 0
    for plane in body.planes:
        found = heights(cell, plane)
        if is_behind(found):
            continue
        if is_before(found):
            return False, None
        if max(found) > most:
            cutting, most = plane, max(found)
    return (True, None) if cutting is None else (None, cutting)


def _state(cell: Cell, tree: Tree) -> tuple[bool | None, Plane | None]:
    """The same of a set."""
    if tree.body is not None:
        return _side(cell, tree.body)
    inside: bool | None = False
    cutting = None
    for part in tree.first:
        held, plane = _state(cell, part)
        if held:
            inside, cutting = True, None
            break
        if held is None:
            inside, cutting = None, cutting or plane
    if inside is False:
        return False, None
    for tool in tree.minus:
        held, plane = _state(cell, tool)
        if held:
            return False, None
        if held is None:
            inside, cutting = None, plane if inside else cutting or plane
    return inside, cutting


class Comparison:
    """Two sets held against each other, in a bounded number of cuts."""

    def __init__(self, tree: Tree, pieces: Sequence[Body]) -> None:
        self._tree = tree
        self._pieces = tuple(pieces)
        self._cuts = 0

    def outside(self) -> tuple[int, str] | None:
        """A piece that reaches out of the set, and where; None when none does.

        Raises:
            Unbounded: it takes too many cuts.
        """
        for number_, piece in enumerate(self._pieces):
            waiting = [piece.cell]
            while waiting:
                cell = waiting.pop()
                held, plane = _state(cell, self._tree)
                if held is False:
                    return number_, where(cell)
                if plane is not None and held is None:
                    waiting += self._halves(cell, plane)
        return None

    def uncovered(self) -> str | None:
        """Where the set reaches out of the pieces; None when it does not.

        Raises:
            Unbounded: it takes too many cuts.
        """
        waiting = [body.cell for body in _bodies(self._tree)]
        pieces = [*self._pieces]
        while waiting:
            cell = waiting.pop()
            holder = next((k for k, piece in enumerate(pieces) if _within(cell, piece)), None)
            if holder is not None:
                pieces.insert(0, pieces.pop(holder))  # neighbouring cells often lie in the same piece
                continue
            held, plane = _state(cell, self._tree)
            if held is False:
                continue
            # In the set and in no piece alone: pieces that cut it may hold it together.
            if held:
                plane = next((p for p in (_side(cell, piece)[1] for piece in self._pieces) if p is not None), None)
            if plane is None:
                return where(cell)
            waiting += self._halves(cell, plane)
        return None

    def _halves(self, cell: Cell, plane: Plane) -> list[Cell]:
        self._cuts += 1
        if self._cuts > MOST_CUTS:
            raise Unbounded(f"it takes more than {MOST_CUTS} cuts to compare them")
        return [half for half in cut(cell, plane) if half is not None]


def _bodies(tree: Tree) -> Iterator[Body]:
    """The bodies whose union holds the set."""
    if tree.body is not None:
        yield tree.body
    for part in tree.first:
        yield from _bodies(part)


def _within(cell: Cell, body: Body) -> bool:
    if any(cell.high[k] > body.high[k] + _ROOM or cell.low[k] < body.low[k] - _ROOM for k in range(3)):
        return False
    return all(is_behind(heights(cell, plane)) for plane in body.planes)


def where(cell: Cell) -> str:
    """The middle of a cell in words, mm of the part's frame."""
    n = len(cell.corners)
    # + 0.0 makes −0 a plain 0.
    place = ", ".join(f"{1e3 * number(sum(p[k] for p in cell.corners) // n) + 0.0:.6g}" for k in range(3))
    return f"({place}) mm"
