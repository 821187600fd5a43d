"""Which tilted ways to begin are tried, and in which order: shapes of entries for the errors of a problem.

Everywhere `start_box` has half-widths (6,) of the start error, m and rad; `per_side` is the clearance a side, m; `play`
the free travel (x, y) of the upright part between the walls, m; `max_tilt` the greatest tilt about each axis, rad. A
`funnel` is how deep below the mouth the walls begin, and how far outside them the top does, m.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice, product, tee
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from fmopt.certificate.assembly import Assembly
from fmopt.geometry.clearance import Clearance
from fmopt.geometry.part import Part
from fmopt.geometry.section import corner_walls, leading_corners, outline
from fmopt.planning.search.entry import Shape, lowest, start_spread, swung_by, turned_axes
from fmopt.spatial.values import Array

_TILTS = ((0.8, 1.0), (1.0, 0.8))
# Shares of the turn, from the one that levels the leading corner's face towards −y with the mouth to that of the other.
_TURNS = ((0.4, 0.6), (-0.3, 1.3))
# What the errors are multiplied with: how deep the corner goes in, how far from the walls it goes in.
_ROUNDS = ((4.0, 3.0), (3.0, 3.0), (5.5, 3.0), (2.2, 3.0), (7.5, 4.0), (4.0, 4.0))
_SLOPED = 1e-3  # upward part of the normal of a face that is neither a wall nor level
_MEETS = 1e-9  # m, heights that differ by less are one
_SHARED = (0.4, 0.6)  # of the room between opposite walls that the corner stays within
# What a corner that has touched the top goes in by, in errors of velocity; how far it rises, as a share of its way.
_TOUCHED, _RISE = (8.0, 6.0, 4.5, 10.0), 0.06
# What the errors are multiplied with where the part lies flat first: how far from the walls its leading corner is, how
# far the part leans as it comes down.
_AWAY, _LEAN = 1.3, 2.0
_PLAY = 0.25  # of the play between the walls, which what the height is uncertain by is taken to be at least
_BEYOND = 1.1  # of the errors that displace the corner, how far outside the mouth it touches the top
_ROOMY = 4.0  # clearances a side that ways to enter tilted leave room for at least, as if the errors were that large
_AMPLE = 7.0  # the same for the larger errors that are tried in turn with them
_DRIFTED = 0.7  # of how far the part may drift at most, in position and in angle, which hardly happens at once
_TURNED = 0.06  # of the lateral ones of these, what errors of angle displace the tip by at least
_INSIDE = 0.115  # of the part's width that is inside the mouth at least where it is tilted the most
_EACH = 0.25  # of errors widened to so many clearances, what is along either axis and what is by turning at least
_FAR = 40.0  # clearances a side that the start errors displace the tip by, from where parts are laid flat first
_AT_ONCE = 2  # entries that go in at once are tried for each that touches the top first
_OBTUSE = math.radians(55.0)  # corners that turn by less are held by two walls next to parallel
# What such a corner goes in with: tilts about the wall that it is to be flush with and about the normal of that, as
# shares of the largest; how deep, in plays between the walls; how far turned from where the part's edge is parallel to
# the wall, in errors of angle; how far from that wall and the other, in lateral errors.
_UNEVEN, _SHALLOW = ((0.4, 0.17), (0.4, 0.24), (0.9, 0.2)), (0.7, 1.25, 2.5)
_ASKEW, _APART = (1.2, 2.0), ((1.5, 2.5), (1.7, 2.9))
_RUN = 6  # shapes of one heading are tried before those of the next, and before any for ample errors
_BEST = math.radians(100.0)  # of the angles of corners, which of them goes in first
_SAME = 1e-6  # of the part's width, by which a part that looks the same once turned may differ

Pair = tuple[float, float]


def room(assembly: Assembly, per_side: float, start_box: Array, drift: Array) -> Array:
    """Half-widths (6,) of the errors that ways to begin leave room for, wide enough for contacts some clearances apart.

    They are those with which the part comes to the mouth: what it drifts by until then counts, too.
    """
    met = start_box + _DRIFTED * (drift * assembly.freedoms)
    return roomy_in_plane(per_side, met) if assembly.planar else roomy_errors(assembly.moving, per_side, met)


def roomy_errors(moving: Part, per_side: float, start_box: Array) -> Array:
    """Half-widths (6,) of errors to leave room for: the start errors, widened where they are next to nothing.

    A part that enters tilted goes through contacts a few clearances apart, however small its errors are.
    """
    tip, least = leading_corners(moving), _ROOMY * per_side
    part, spread = _EACH * least, start_spread(moving, start_box)
    wider = start_box * max(1.0, least / max(spread, 1e-3 * least))
    wider = np.maximum(wider, part * np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    if swung_by(tip, wider) >= part:
        return np.asarray(wider)
    about = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0])
    return np.asarray(np.maximum(wider, about * part / swung_by(tip, about)))


def roomy_in_plane(per_side: float, start_box: Array) -> Array:
    """The same (6,) for a part that moves in the plane of x and z: a few clearances (m) along x at least."""
    return np.asarray(np.maximum(start_box, _ROOMY * per_side * np.eye(6)[0]))


def ample(moving: Part, per_side: float, start_box: Array) -> Array:
    """Half-widths (6,) of larger errors: as large along x as along y, turned by some of that, many clearances in all.

    A motion that takes them takes the smaller ones. Ways to begin that leave room for these alone may lead nowhere:
    sides that are askew turn one lateral error into the other, contacts and drift turn lateral errors into angles.
    """
    wider = start_box * max(1.0, _AMPLE * per_side / start_spread(moving, start_box))
    lateral, tip = float(wider[:2].max()), leading_corners(moving)
    least = np.full(6, _TURNED * lateral / swung_by(tip, np.ones(6)))
    least[:2], least[2] = lateral, 0.0
    return np.asarray(np.maximum(wider, least))


def likely_shapes(
    moving: Part, fixed: Part, clearance: Clearance, start_box: Array, rate: float, max_tilt: float
) -> Iterator[Shape]:
    """Tilted ways to begin, the likeliest first: the corner goes in at once, touches the top first, or lies flat on it.

    The further errors are beyond the clearance, the more it is worth to lay the part flat: that is tried first or last.
    Of corners that differ each has its turn, with its walls as axes; `obtuse_shapes` are for those that turn by little.
    Where errors are uneven or small, the first few are for them; then shapes for `ample` ones take turns with the
    others. Errors to leave room for are such as `roomy_errors`.
    """
    if max_tilt <= 0.0:
        return iter(())
    own = _shapes(moving, fixed, clearance, start_box, rate, max_tilt)
    wider = ample(moving, clearance.per_side, start_box)
    if np.array_equal(wider, start_box):
        return own
    return chain(islice(own, _RUN), _in_turn((own, 1), (_shapes(moving, fixed, clearance, wider, rate, max_tilt), 1)))


def _shapes(
    moving: Part, fixed: Part, clearance: Clearance, start_box: Array, rate: float, max_tilt: float
) -> Iterator[Shape]:
    """Shapes that leave room for errors; the rest as of `likely_shapes`."""
    spread, play = start_spread(moving, start_box), clearance.play
    funnel = funnel_depth(fixed), funnel_width(fixed)
    first = spread >= _FAR * clearance.per_side

    def towards(way: Way) -> Iterator[Shape]:
        if way.wall is not None:
            return obtuse_shapes(moving, play, start_box, max_tilt, funnel, way)
        tilted = tilted_shapes(moving, play, start_box, max_tilt, funnel[0], way.heading)
        at_once, for_touching, for_flat = tee(tilted, 3)  # made once for all three
        touching = touching_shapes(for_touching, moving, start_box, rate, funnel[1])
        flat = flat_shapes(for_flat, moving, play, start_box, rate, funnel)
        others = _in_turn((at_once, _AT_ONCE), (touching, 1))
        return chain(flat, others) if first else chain(others, flat)

    return _in_turn(*((towards(way), _RUN) for way in likely_headings(moving)))


class Way(NamedTuple):
    """With which heading a corner of the tip goes in.

    The heading is the turn about z of the axes that its tilts are about, rad. An obtuse corner is to be flush first
    with the wall towards −x (0) or −y (1) of them; the wall of others is None.
    """

    heading: float
    wall: int | None = None


def likely_headings(moving: Part) -> tuple[Way, ...]:
    """Headings with which corners of the tip go in.

    After none come those that put a corner between its walls. An obtuse corner has two, with one of its walls towards
    −x (0) or −y (1), that from which the part reaches farther first. Of those with which the part looks the same there
    is one only; with an obtuse corner, in a mirror, too.
    """
    loop = outline(leading_corners(moving))
    hull, found = loop[:, :2], list[tuple[float, float, Way]]()
    for corner in loop:
        (one, _), (two, _) = corner_walls(moving, corner)
        turn = math.acos(float(np.clip(one @ two, -1.0, 1.0)))
        unlike = round(abs(math.pi - turn - _BEST), 6)
        if turn < _OBTUSE:
            for wall, inward in enumerate((one, two)):
                reach = round(float(np.ptp(hull @ inward)), 9)
                found.append((unlike, -reach, Way(_direction(inward) - 0.5 * math.pi * wall, wall)))
        else:
            found.append((unlike, 0.0, Way(_direction(one + two) - 0.25 * math.pi)))
    found.sort(key=lambda one: (*one[:2], one[2].wall or 0, abs(one[2].heading)))
    if all(way.wall is None for *_, way in found):
        found.insert(0, (0.0, 0.0, Way(0.0)))
    ways, seen = list[Way](), list[tuple[bool, KDTree]]()
    for *_, way in found:
        shown = hull @ turned_axes(way.heading)[:2, :2]
        kind, sight = way.wall is None, shown[:, ::-1] if way.wall else shown
        if not any(kind == other and _looks_the_same(sight, before) for other, before in seen):
            ways.append(way)
            seen.append((kind, KDTree(sight)))
    return tuple(ways)


def _direction(n: Array) -> float:
    return math.atan2(n[1], n[0])


def _looks_the_same(one: Array, other: KDTree) -> bool:
    """Whether the corners (n, 2) of two outlines are the same."""
    apart, _ = other.query(one)
    return bool(np.max(apart) <= _SAME * float(np.ptp(one)))


def _in_turn(*runs: tuple[Iterator[Shape], int]) -> Iterator[Shape]:
    """So many of the first run, so many of the next, and so on, over and over; what is left when others end."""
    while some := [shape for run, times in runs for shape in islice(run, times)]:
        yield from some


def tilted_shapes(
    moving: Part, play: Pair, start_box: Array, max_tilt: float, funnel: float = 0.0, heading: float = 0.0
) -> Iterator[Shape]:
    """Shapes that leave room for the start error, the likeliest first: a tilted part shows the mouth only a corner.

    The corner goes in by several times what its height is uncertain by, at several times its lateral error from the
    two walls next to it; unequally far from the two, so that it cannot meet both at once. Tilts about the two axes
    differ, so that no two edges come down level; turned between the two ways that level a face next to the corner with
    the mouth, the corner is nearest to both walls, turned beyond them another edge is. The less deep the corner goes
    in, the less the part is tilted, so that as much of its edges is inside. It goes in below the `funnel`, of which the
    depth alone counts here, m; all this is about axes turned about z by a heading, rad.
    """
    tip = leading_corners(moving)
    slack = 0.5 * min(play)
    widths = np.ptp((tip @ turned_axes(heading))[:, :2], axis=0)
    # Depth and room in errors, share of the turn, shares of the tilt about y and x.
    for (deep, wide), share, tilts in (way for shares in _TURNS for way in product(_ROUNDS, shares, _TILTS)):
        swing = swung_by(lowest(tip, Shape(*tilts, 0.0, 0.0, (0.0, 0.0), heading=heading))[None], start_box)
        uncertain = float(start_box[2]) + swing
        steepest = np.arctan((_ROUNDS[0][0] * uncertain + 0.5 * slack) / (_INSIDE * widths))
        about = np.array(tilts) * np.minimum(max_tilt, steepest)
        depth = deep * uncertain + 0.5 * slack
        wanted = np.array([wide, wide + 1.0]) * start_box[:2] + 2.0 * swing
        # No further than leaves the far walls as much room: beside the corner, the part is wider up there.
        least = start_box[:2] + swing
        most = widths + np.asarray(play) - least - depth / np.tan(about)
        x, y = np.minimum(wanted, least + np.array(_SHARED) * np.maximum(most - least, 0.0)).tolist()
        turn = share * float(np.prod(about))
        yield Shape(float(about[0]), float(about[1]), turn, funnel + depth, (x, y), heading=heading)


def touching_shapes(
    shapes: Iterable[Shape], moving: Part, start_box: Array, rate: float, width: float
) -> Iterator[Shape]:
    """The same shapes with the top touched first, `width` (m) outside the walls, so that corners go in less deep."""
    tip = leading_corners(moving)
    for n, shape in enumerate(shapes):
        swing = swung_by(lowest(tip, shape)[None], start_box)
        beyond = width + _BEYOND * (float(start_box[:2].max()) + swing)
        way = min(shape.room) + beyond
        depth = _TOUCHED[n // 2 % len(_TOUCHED)] * rate * way
        if depth < shape.depth:
            yield replace(shape, depth=depth, touch=(beyond, _RISE * way))


def obtuse_shapes(
    moving: Part, play: Pair, start_box: Array, max_tilt: float, funnel: Pair, way: Way
) -> Iterator[Shape]:
    """Shapes for a corner that turns by so little that a part flush with one wall has little play towards the other.

    The part is to be flush with the first wall before it meets the second, and to meet both well apart: so it is tilted
    less along the wall, turned from it by little more than errors, and nearer to it. The corner touches the top first
    and goes in less deep than the next one along the wall is above it.
    """
    spread = start_spread(moving, start_box)
    beyond = funnel[1] + _BEYOND * spread
    for tilts, deep, askew, apart in product(_UNEVEN, _SHALLOW, _ASKEW, _APART):
        first, second = (share * max_tilt for share in tilts)
        near, far = (share * spread for share in apart)
        touch = beyond, _RISE * (near + beyond)
        turn = askew * float(start_box[3:].max())
        depth = funnel[0] + deep * min(play)
        # In a mirror x and y change places, and a share s of the turn between both levels becomes 1 − s.
        if way.wall:
            yield Shape(second, first, first * second + turn, depth, (far, near), touch, heading=way.heading)
        else:
            yield Shape(first, second, -turn, depth, (near, far), touch, heading=way.heading)


def flat_shapes(
    shapes: Iterable[Shape], moving: Part, play: Pair, start_box: Array, rate: float, funnel: Pair
) -> Iterator[Shape]:
    """The same shapes with the part laid flat on the top first, which takes away errors of its height and tilts."""
    tip = leading_corners(moving)
    lean = _LEAN * float(np.linalg.norm(start_box[3:]))
    for n, shape in enumerate(shapes):
        corner = lowest(tip, shape)
        away = funnel[1] + _AWAY * (float(start_box[:2].max()) + swung_by(corner[None], start_box))
        way = float(np.linalg.norm(corner)) * math.hypot(shape.about_y, shape.about_x)
        off = max(rate * way, _PLAY * min(play))
        depth = funnel[0] + max(_TOUCHED[n // 2 % len(_TOUCHED)] * off, min(play))
        if depth < shape.depth and lean > 0.0:
            yield replace(shape, depth=depth, flat=(away, _RISE * way, lean))


def funnel_depth(fixed: Part) -> float:
    """How deep the sloped faces go down that begin at the mouth, m; 0 where there are none."""
    return max((depth for depth, _ in _slopes(fixed)), default=0.0)


def funnel_width(fixed: Part) -> float:
    """How far outside the walls the sloped faces that begin at the mouth end, m; 0 where there are none."""
    return max((depth * rise for depth, rise in _slopes(fixed)), default=0.0)


def _slopes(fixed: Part) -> Iterator[tuple[float, float]]:
    """The sloped faces that begin at the mouth: how deep they go down, and how far outside they are for each depth.

    They lead to walls that go on steeper below them: those of a tapered hole, which end with it, are its walls.
    """
    body = fixed.polyhedron
    lowest = [float(body.vertices[list(face.vertices), 2].min()) for face in body.faces]
    for face, low in zip(body.faces, lowest, strict=True):
        heights, rise = body.vertices[list(face.vertices), 2], float(face.normal[2])
        if not _SLOPED < rise < 1.0 - _SLOPED or abs(float(heights.max())) > _MEETS:
            continue
        end = {v for v, z in zip(face.vertices, heights.tolist(), strict=True) if z <= low + _MEETS}
        if any(
            abs(other.normal[2]) < rise - _SLOPED and deep < low - _MEETS and not end.isdisjoint(other.vertices)
            for other, deep in zip(body.faces, lowest, strict=True)
        ):
            yield -low, rise / math.hypot(*face.normal[:2])
