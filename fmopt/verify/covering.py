"""That convex pieces make up a part: the two agree as sets, which is decided exactly.

Each piece stands for two bodies of half-spaces, one a little larger than its hull and one a little smaller (see
`halfspaces`). Of the larger ones, the boundary of their union is in what is left of the faces of each without the
inside of all others. Where none of that meets the part's surface or is inside the part, and every shell of the surface
has a vertex inside one of them, they cover the part: else their boundary would divide the inside of the part between
them and what is not covered, and had an area there. The part then is nowhere farther from the hulls than what
`halfspaces` tells.

Nothing of a piece sticks out where the part's surface does not meet the smaller body, and one point of that is inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fmopt.verify.halfspaces import Cell, Hull
from fmopt.verify.lattice import (
    FINENESS,
    HalfSpace,
    Place,
    TooMuchWork,
    Work,
    apart,
    bounds,
    common,
    elevation,
    elevations,
    place,
)
from fmopt.verify.solids import Shape
from fmopt.verify.surface import Surface

# Steps that may be taken: what parts take is about the square of their number of vertices.
_LEAST_STEPS = 20_000
_MOST_STEPS = 20_000_000
_SHARE = 4


def uncovered(part: Shape, pieces: Sequence[Shape]) -> Iterator[str]:
    """What keeps the faces of a part from being the surface of a solid, and its pieces from being that solid."""
    size = sum(len(shape.vertices) + len(shape.faces) for shape in (part, *pieces))
    work = Work(min(_MOST_STEPS, _LEAST_STEPS + _SHARE * size * size))
    try:
        surface = Surface(part, work)
        if surface.flaws:
            yield from surface.flaws
            return
        hulls = [Hull(piece, work) for piece in pieces]
        flaws = [f"piece {n}: {flaw}" for n, hull in enumerate(hulls) for flaw in hull.flaws()]
        yield from flaws
        if not flaws:
            yield from (f"piece {n} sticks out of the part" for n in _sticking_out(surface, hulls, work))
            at = _open(surface, hulls, work)
            if at is not None:
                yield f"the pieces leave the part uncovered at {_told(at)}"
    except TooMuchWork:
        yield "the part and its pieces take too many steps to compare"


def _sticking_out(surface: Surface, hulls: Sequence[Hull], work: Work) -> Iterator[int]:
    """The pieces that the surface meets, or that are outside of it."""
    corners = [tuple(place(p) for p in surface.corners(t)) for t in range(len(surface.triangles))]
    for n, hull in enumerate(hulls):
        work.spend(len(corners))
        near = (t for t, box in enumerate(surface.boxes) if not apart(box, hull.box))
        if any(common(corners[t], hull.inner) for t in near) or not surface.holds(hull.middle):
            yield n


def _open(surface: Surface, hulls: Sequence[Hull], work: Work) -> Place | None:
    """A place inside the part, or on its surface, that the pieces leave uncovered; None where there is none."""
    for shell in surface.shells:
        start = place(surface.points[surface.triangles[shell[0]][0]])
        if not any(all(elevation(space, start) < 0 for space in hull.outer) for hull in hulls):
            return start
    corners = [tuple(place(p) for p in surface.corners(t)) for t in range(len(surface.triangles))]
    for n, hull in enumerate(hulls):
        others = [other for m, other in enumerate(hulls) if m != n and not apart(other.box, hull.box)]
        for face in hull.cells:
            for cell in _left_of(face, others, work):
                work.spend(len(corners))
                if _meets(surface, corners, cell) or surface.holds(cell.corners[0]):
                    return cell.corners[0]
    return None


def _left_of(face: Cell, others: Sequence[Hull], work: Work) -> list[Cell]:
    """What of a face is in none of the other bodies."""
    cells = [face]
    box = bounds(face.corners)
    for other in others:
        if apart(box, other.box):
            continue
        work.spend(len(cells) * len(other.outer))
        cells = [left for cell in cells for left in cell.without(other.outer)]
        if not cells:
            break
    return cells


def _meets(surface: Surface, corners: Sequence[Sequence[Place]], cell: Cell) -> bool:
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
