"""Where the central line of a section is, and which way its x axis points: found alike on a peg and on its hole.

A hole leaves an even gap around its peg, by which the centroid of a section without symmetry moves. What does not move
is the point x from which the signed distances to the lines of some sides are as even as can be,

    min over x, t of Σᵢ (nᵢ·x + t − cᵢ)²,

as a gap adds the same to every cᵢ, which t takes up. Where the point for all sides lies outside the section, as in a
U, that for the sides of its largest convex piece is taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from fmopt.geometry.plane.convex_polygons import convex_pieces
from fmopt.spatial.values import Array

_ON, _SHORT = 1e-5, 1e-3  # of an outline's size: lines so close are one, sides so short are noise
_STRAIGHT = 1e-6  # rad: corners that turn less are none
_WITHIN = 0.2  # of the radius of a largest circle inside: how far inside a central line is
_LIKE = 0.02  # of its area: pieces that differ by less are of one size
_LONGEST = 1e-5  # of a length: sides that differ by less are equally long
_MANY, _EVEN = 16, 0.02  # so many sides that differ by less than this share make a section round
_LOPSIDED = 1e-3  # of a section's width: a centroid this far from the middle says which way x points
_ALIKE = 1e-3  # rad, and of the longest side: turns and sides that differ by less are alike


def inside(ring: Array) -> Array:
    """A point (2,) well inside an outline (n, 2), m: its centroid where it is, else the middle of a large circle."""
    from shapely import Polygon, maximum_inscribed_circle

    shape = Polygon(ring)
    # shapely gives the circle as a line from its centre to its rim: the length is the radius.
    circle = maximum_inscribed_circle(shape, tolerance=1e-3 * float(np.sqrt(shape.area)))
    if shape.contains(shape.centroid) and shape.exterior.distance(shape.centroid) > _WITHIN * circle.length:
        return np.array(shape.centroid.coords[0])
    return np.array(circle.coords[0])


def centre(ring: Array) -> Array:
    """The point (2,) of an outline (n, 2), m, counter-clockwise, through which its central line goes.

    It turns and shifts with the outline, and an even gap all around leaves it where it is.
    """
    return next(centres(ring))


def centres(ring: Array) -> Iterator[Array]:
    """The points (2,) that may be taken for the centre of an outline (n, 2), m, the best first."""
    whole = _corners(ring)
    middle = _centroid(whole)
    corners = whole - middle
    normals, offsets = _sides(corners)
    best = _evenest(normals, offsets)
    if best is not None and _is_within(corners, best):
        yield middle + best
    pieces = convex_pieces(tuple((float(x), float(y)) for x, y in corners))
    largest = max(float(piece.area) for piece in pieces)
    x, size = axis(corners), float(np.ptp(corners, axis=0).max())
    made = []
    for piece in pieces:
        own, levels = _lines(np.array(piece.outline), size)
        # 1 − cos is half the square of a small angle: alike are lines turned by less than `_ON` (rad).
        turns = np.abs(own @ normals.T - 1.0) <= 0.5 * _ON**2
        held = np.any(turns & (np.abs(levels[:, None] - offsets) <= _ON * size), axis=1)
        even = _evenest(own[held], levels[held])
        if even is None or not _is_within(corners, even):
            even = np.mean(np.array(piece.outline), axis=0)
        like = float(piece.area) >= (1.0 - _LIKE) * largest
        # Rounded, so that of pieces that are alike noise does not choose; along x first.
        along = np.round([x @ even / size, (x[0] * even[1] - x[1] * even[0]) / size], 4).tolist()
        made.append((like, along, even))
    for _, _, even in sorted(made, key=lambda one: one[:2], reverse=True):
        yield middle + even


def axis(ring: Array, known: Array | None = None) -> Array:
    """The direction (2,) of the x axis of an outline: along its longest side, in a way that turns with it.

    A gap makes sides between convex corners longer and others not, so that which one is the longest is asked where the
    outline is narrowed until its sides are as far out as in. Where its symmetry leaves several, that one of them which
    `known` takes to the largest entries.

    Args:
        ring: corners (n, 2) in order, m.
        known: (2, k); of the directions d left the one with the greatest d·known, column by column; unit vectors if
            None.
    """
    corners = _corners(ring)
    steps = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(steps, axis=1)
    size = float(lengths.max())
    turns = np.arctan2(_cross(steps, np.roll(steps, -1, axis=0)), np.sum(steps * np.roll(steps, -1, axis=0), axis=1))
    # Where all sides move in by d, a side is d tan(turn/2) shorter at each of its ends, and longer at reflex corners.
    cut = np.tan(0.5 * turns)
    narrowed = lengths - _even_width(corners) * (cut + np.roll(cut, 1))
    middle = _centroid(corners)
    longest = np.flatnonzero(narrowed >= narrowed.max() - _LONGEST * size)
    longest = longest[lengths[longest] >= lengths[longest].max() - _LONGEST * size]
    choices = [(k, sign * steps[k] / lengths[k]) for k, sign in product(longest.tolist(), (1.0, -1.0))]
    choices = [(k, x) for k, x in choices if not _is_backward(corners - middle, x)]
    # Among sides that are equal, what follows them around the outline tells; only those of its symmetry are left.
    for ahead in range(len(corners)):
        for values in (turns, narrowed / size, lengths / size):
            own = [values[(k + ahead) % len(corners)] for k, _ in choices]
            choices = [choice for choice, value in zip(choices, own, strict=True) if value >= max(own) - _ALIKE]
    turn = np.eye(2) if known is None else known
    return max((x for _, x in choices), key=lambda d: np.round(d @ turn, 6).tolist())


def is_round(ring: Array) -> bool:
    """Whether an outline (n, 2), m, has so many sides of about one length that it stands for a circle."""
    lengths = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    return bool(np.count_nonzero(lengths >= lengths.max() * (1.0 - _EVEN)) > _MANY)


def _corners(ring: Array) -> Array:
    """The corners of an outline in which it turns, once each."""
    apart = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
    corners = ring[apart > 1e-9 * float(np.ptp(ring, axis=0).max())]
    back, ahead = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turn = np.arctan2(_cross(back, ahead), np.sum(back * ahead, axis=1))
    return np.asarray(corners[np.abs(turn) > _STRAIGHT])


def _sides(corners: Array) -> tuple[Array, Array]:
    """Outward normals (n, 2) and offsets (n,) of the sides of an outline that is counter-clockwise."""
    steps = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([steps[:, 1], -steps[:, 0]]) / np.linalg.norm(steps, axis=1)[:, None]
    return normals, np.sum(normals * corners, axis=1)


def _even_width(corners: Array) -> float:
    """How far out the sides of an outline are on the whole, m: t of the point that lies as evenly as can be."""
    normals, offsets = _sides(corners)
    return float(np.linalg.lstsq(np.column_stack([normals, np.ones(len(normals))]), offsets, rcond=1e-9)[0][2])


def _lines(corners: Array, size: float) -> tuple[Array, Array]:
    """Normals and offsets of the sides of an outline that are longer than noise."""
    normals, offsets = _sides(corners)
    long = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) > _SHORT * size
    return normals[long], offsets[long]


def _evenest(normals: Array, offsets: Array) -> Array | None:
    """The point that lies as evenly as can be behind some lines; None where they leave it free."""
    rows = np.column_stack([normals, np.ones(len(normals))])
    found, _, rank, _ = np.linalg.lstsq(rows, offsets, rcond=1e-9)
    return np.asarray(found[:2]) if rank == 3 else None


def _is_within(corners: Array, point: Array) -> bool:
    from shapely import Point, Polygon, maximum_inscribed_circle

    shape, at = Polygon(corners), Point(point)
    radius = float(maximum_inscribed_circle(shape, tolerance=1e-3 * float(np.sqrt(shape.area))).length)
    return bool(shape.contains(at)) and float(shape.exterior.distance(at)) > _WITHIN * radius


def _is_backward(corners: Array, x: Array) -> bool:
    """Whether the middle of an outline about its centroid lies against x, or where it lies on y, against that."""
    spread = corners @ np.column_stack([x, (-x[1], x[0])])
    lean = -0.5 * (spread.min(axis=0) + spread.max(axis=0))
    size = float(np.ptp(spread, axis=0).max())
    return next((bool(out < 0.0) for out in lean if abs(out) > _LOPSIDED * size), False)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _centroid(corners: Array) -> Array:
    ahead = np.roll(corners, -1, axis=0)
    area = _cross(corners, ahead)
    return np.asarray((area @ (corners + ahead)) / (3.0 * np.sum(area)))
