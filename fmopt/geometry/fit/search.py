"""Candidates for what goes where: an end of one solid in an opening of another one, placed for the greatest clearance.

A candidate is a direction of each solid, what of the one sweeps by up to some height, and an opening of the other's
material. Which of them is the fit is told by the walls: a fit is where walls run along walls. The least clearance tells
nothing, as sections across odd directions touch by chance.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise, product

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from fmopt.geometry.fit.layers import Layers, Outline, common, united
from fmopt.geometry.fit.placing import moved
from fmopt.geometry.fit.seat import Led, most_room
from fmopt.geometry.polyhedron import Polyhedron, plane_basis
from fmopt.spatial.values import Array

_AXES, _DRAFTED, _LARGEST = 3, 2, 2  # directions that the surface runs along, or nearly so; normals of large faces
_FACES = 16  # normals whose cross products are tried as axes
_APART = math.cos(math.radians(1.0))  # of directions that differ
_ALONG, _DRAFT, _ACROSS = 0.01, 0.1, 0.9999  # cosines of normals across a direction, of drafts, and along it
_MOST_ROOM, _MOST_ROOM_OPEN = 4.0, 6.0  # area of an opening: of the section's hull
_TIGHTEST, _LOOSEST = -0.08, 0.25  # of the width: clearances of candidates
_NARROWEST = 1.0 + 4.0 * _TIGHTEST  # of the width of a section: closed openings are wider
_LIKE = 1e-3  # of their areas: openings that differ by less are one
_LONGEST = 3  # sides of an outline that are turned to those of an opening
_TURN_GRID = 12
_ONE_TURN = 0.02  # rad: turns that differ by less are one
_PLACED, _MOST_PLACED = 3, 8  # turns of least overlap that are placed, and of none at all
_OVERLAP, _MORE = 0.15, 1.5  # of the section's area, and of the least, by which it may overlap before it is placed
_IN_HULL = 0.5  # of the section's area, which is to lie inside the hull of the material
_ROUGHLY = 1e-5  # of the width: accuracy of a clearance in the search
_GIVEN = 1e-8  # m: what a section gives up so that what touches does not overlap
_AROUND = 1.25  # of the size of a solid: how far around an opening it may come near anything
_SAMPLES = 200  # points of an outline
_MOUTH = 4.0  # times the hull of what goes in: a wider opening is no mouth of it
_SLENDER = 1.2  # times its other widths: a solid that is so long has a longest axis
_LOOSE = 2.0  # times that: walls with so much room between them do not count
SHARES = (0.02, 0.05, 0.1, 0.25)  # of the width: walls so near count


@dataclass(frozen=True, eq=False)
class Candidate:
    """A solid, swept up to a slab, in an opening of other material at `at` (3,) of its pivot (2,)."""

    led: Led
    slab: int
    material: Layers
    height: float  # of the section whose opening it is, m
    opening: shapely.Polygon
    closed: bool  # whether the opening is closed all round
    pivot: Array
    at: Array
    clearance: float
    width: float
    depth: float  # of the tip below the top of the material, m, by the slabs of the search
    walls: tuple[float, ...]  # area of walls that run along walls, m², for each of `SHARES`
    # The candidate that this one is, shifted to another opening; what is around both is the same
    twin: "Candidate | None" = None

    @cached_property
    def feet(self) -> tuple[Array, Array]:
        """Where the line through all that lies in openings passes the origins of the material's and the solid's model.

        It has the same feet (3,), m, whatever end leads, and however what lies beside the openings is turned.
        """
        own, layers, tip = self.led.swept, self.led.layers, self.material.high - self.depth
        slabs = np.searchsorted(layers.edges - layers.low, np.array(self.material.middles) - tip) - 1
        inside = [
            part
            for slab, section in zip(slabs.tolist(), self.material.sections, strict=True)
            for part in shapely.get_parts(moved(own[min(slab, len(own) - 1)].shape, self.pivot, self.at))
            if slab >= 0 and opening_around(section, part)
        ]
        middle = (united(inside) if inside else moved(own[-1].shape, self.pivot, self.at)).centroid
        back = moved(middle, self.at[:2], np.append(self.pivot, -self.at[2]))
        sides = ((self.material, middle), (layers, back))
        material, solid = (one.turn[:2].T @ np.array(point.coords[0]) for one, point in sides)
        return material, solid


def directions(body: Polyhedron) -> list[Array]:
    """Unit vectors (3,), both signs: axes that most of the surface runs along, then normals of the largest faces."""
    area = np.array([_area(body, number) for number in range(len(body.faces))])
    # Facets of one face of a mesh differ by little: the largest of those that are alike stands for all.
    order = np.argsort(-area, kind="stable")
    _, first, group = np.unique(np.round(200.0 * body.normals[order]), axis=0, return_index=True, return_inverse=True)
    heaviest = np.argsort(-np.bincount(group.ravel(), area[order]), kind="stable")[:_FACES]
    widest = body.normals[order[first[heaviest]]]
    crossed = [np.cross(a, b) for a, b in combinations(widest, 2)]
    axes = np.array([*(v / np.linalg.norm(v) for v in crossed if np.linalg.norm(v) > 0.05), *widest])
    cosine = np.abs(axes @ body.normals.T)
    across = 1e-3 * ((cosine > _ACROSS) @ area)
    straight, drafted = (
        axes[np.argsort(-np.round(((cosine < most) @ area + across) / area.sum(), 9), kind="stable")]
        for most in (_ALONG, _DRAFT)
    )
    kept = list[Array]()
    for more, some in ((_AXES, straight), (_DRAFTED, drafted), (_LARGEST, widest)):
        most = len(kept) + more
        for axis in some[:more] if some is drafted else some:
            if len(kept) < most and all(abs(axis @ other) < _APART for other in kept):
                kept.append(axis)
    return [sign * axis for axis in kept for sign in (1.0, -1.0)]


def _area(body: Polyhedron, number: int) -> float:
    face = body.faces[number]
    outer, *holes = (body.vertices[list(loop)] @ plane_basis(face.normal) for loop in face.loops)
    return float(shapely.Polygon(outer, holes).area)


def upright(direction: Array) -> Array:
    """A rotation (3, 3) that takes a direction (3,) to +z, quarter turns where it lies along an axis."""
    x = np.eye(3)[int(np.argmin(np.abs(np.round(direction, 6))))]
    x = x - (x @ direction) * direction
    x /= np.linalg.norm(x)
    return np.vstack([x, np.cross(direction, x), direction])


def candidates(
    solids: Sequence[Led], materials: Sequence[Layers], closed: bool, every: bool = True
) -> Iterator[Candidate]:
    """All candidates of some directions, in openings that are closed all round or in those that are not.

    In openings that are shifted copies of others they are looked for only if `every`.
    """
    for led, material in product(solids, materials):
        for slab in led.heights:
            swept, seen = led.swept[slab], list[shapely.Polygon]()
            part, most = largest(swept.shape), (_MOST_ROOM if closed else _MOST_ROOM_OPEN) * swept.hull.area
            least, narrowest = part.area - _spare(part), closed * _NARROWEST * width_of(part)
            for height in reversed(material.middles):
                kinds = list[tuple[list[BaseGeometry], list[Candidate]]]()
                openings = material.section(height).openings
                areas = np.array([opening.area for opening, _ in openings])
                for opening, is_closed in openings:
                    fits = least < opening.area < most and narrowest < width_of(opening)
                    if is_closed is closed and fits and not _known(opening, seen):
                        seen.append(opening)
                        alone = every or np.sum(np.abs(areas - opening.area) < _LIKE * opening.area) < 2
                        around = [] if alone else _around(led, slab, material, opening)
                        copies = next((own for other, own in kinds if around and other and _equal(around, other)), None)
                        if copies is None:
                            copies = [*_placed(led, slab, material, height, opening, closed)]
                            kinds.append((around, copies))
                            yield from copies
                        else:
                            yield from (_shifted(one, opening) for one in copies)
                    elif not (closed or is_closed or _known(opening, seen)):
                        seen.append(opening)
                        for tongue in swept.tongues:
                            if tongue.area - _spare(tongue) < opening.area < _MOST_ROOM_OPEN * tongue.convex_hull.area:
                                yield from _placed(led, slab, material, height, opening, closed, tongue)


def _around(led: Led, slab: int, material: Layers, opening: shapely.Polygon) -> list[BaseGeometry]:
    """What a solid may come near in an opening: the sections of the material there, seen from the opening's middle."""
    middle, pivot = opening.centroid, largest(led.swept[slab].shape).centroid
    solid = led.swept[-1].shape.convex_hull.exterior.hausdorff_distance(pivot)
    far = _AROUND * solid + opening.exterior.hausdorff_distance(middle)
    near = shapely.box(middle.x - far, middle.y - far, middle.x + far, middle.y + far)
    return [translate(one.shape.intersection(near), -middle.x, -middle.y) for one in material.sections]


def _equal(some: Sequence[BaseGeometry], others: Sequence[BaseGeometry]) -> bool:
    least = _GIVEN * max(float(one.length) for one in some)
    pairs = zip(some, others, strict=True)
    return all(abs(a.area - b.area) <= least and a.symmetric_difference(b).area <= least for a, b in pairs)


def _shifted(one: Candidate, opening: shapely.Polygon) -> Candidate:
    """A candidate in another opening with the same around it."""
    here, there = one.opening.centroid, opening.centroid
    return replace(one, opening=opening, at=one.at + np.array([there.x - here.x, there.y - here.y, 0.0]), twin=one)


def opening_around(material: Outline, swept: BaseGeometry) -> tuple[shapely.Polygon, bool] | None:
    """The opening of a section that holds the largest part of what sweeps by, if no wider, and whether it is closed."""
    if swept.is_empty:
        return None
    most, part = _MOUTH * swept.convex_hull.area, largest(swept)
    for opening, closed in material.openings:
        if opening.area < most and common(opening, part) > 0.5 * part.area:
            return opening, closed
    return None


def largest(shape: BaseGeometry) -> shapely.Polygon:
    """The largest region of a plane shape."""
    return max(shapely.get_parts(shape), key=lambda part: part.area)


def _known(opening: shapely.Polygon, seen: Sequence[shapely.Polygon]) -> bool:
    most = _LIKE * opening.area
    near = [o for o in seen if abs(o.area - opening.area) < most and o.intersects(opening)]
    return any(o.symmetric_difference(opening).area < 2.0 * most for o in near)


def width_of(shape: BaseGeometry) -> float:
    """How wide a plane shape is across its longest extent, m."""
    return float(_box(shape).min())


def _spare(shape: BaseGeometry) -> float:
    """Area of a strip along all sides of a plane shape by which it may be too thick for an opening, m²."""
    return -_TIGHTEST * width_of(shape) * float(shape.length)


def _box(shape: BaseGeometry) -> Array:
    """Lengths (2,) of the sides of the least rectangle around a plane shape, m."""
    return np.asarray(np.hypot(*np.diff(np.asarray(shape.minimum_rotated_rectangle.exterior.coords)[:3], axis=0).T))


def lies(body: Polyhedron, along: Array) -> bool:
    """Whether a solid is longer across a direction (3,) than along it and the other way across."""
    sides = _box(shapely.MultiPoint(body.vertices @ plane_basis(along)))
    others = max(float(sides.min()), float(np.ptp(body.vertices @ along)))
    return bool(sides.max() > _SLENDER * others)


def turns(outline: Outline, material: Outline, opening: shapely.Polygon) -> list[float]:
    """Turns to try, rad: those that bring the longest sides together, or several prongs to holes, and a grid."""
    own, other = (_headings(one) for one in (outline, Outline.of(opening)))
    prongs = _towards(shapely.get_parts(outline.shape), largest(outline.shape))[:1]
    holes = _towards([one for one, _ in material.openings], opening) if prongs else []
    kept = list[float]()
    sides = [b - a + half for a in own for b in other for half in (0.0, math.pi)]
    # Around a round surface of many facets the best turn is none that brings sides together.
    between = [sides[0] + share * math.tau / len(outline.start) for share in (0.3, -0.3)]
    for turn in (*(b - a for a in prongs for b in holes), *sides, *between, *_GRID):
        turn = (turn + math.pi) % math.tau - math.pi
        if all(abs((turn - known + math.pi) % math.tau - math.pi) > _ONE_TURN for known in kept):
            kept.append(turn)
    return kept


def _towards(others: Sequence[shapely.Polygon], one: shapely.Polygon) -> list[float]:
    """Where the others of some regions lie, seen from one, rad, the farthest first."""
    here = np.array(one.centroid.coords[0])
    ways = [np.array(other.centroid.coords[0]) - here for other in others]
    far = sorted((way for way in ways if np.hypot(*way) > _GIVEN), key=lambda way: -round(float(np.hypot(*way)), 9))
    return [math.atan2(way[1], way[0]) for way in far[:_MOST_PLACED]]


_GRID = tuple(k * math.tau / _TURN_GRID for k in range(_TURN_GRID))


def _headings(outline: Outline) -> list[float]:
    steps = outline.end - outline.start
    longest = np.argsort(-np.round(np.hypot(*steps.T), 9), kind="stable")[:_LONGEST]
    return [float(angle) for angle in np.arctan2(steps[longest, 1], steps[longest, 0])]


def placements(
    outline: Outline, material: Outline, opening: shapely.Polygon, pivot: Array, tolerance: float, every: bool = False
) -> Iterator[tuple[float, Array]]:
    """Clearances, m, and places (3,) of an outline in an opening, from the turns with the least overlap or from all.

    The pivot (2,) of the outline, m, is put into the middle of the opening. The tolerance is that of clearances, m.
    """
    middle, found = np.array(opening.centroid.coords[0]), list[tuple[float, float, Array]]()
    far = float(np.hypot(*(outline.start - pivot).T).max())
    near = material.shape.intersection(shapely.box(*(middle - far), *(middle + far)))
    for turn in turns(outline, material, opening):
        at = np.append(middle, turn)
        put = moved(outline.shape, pivot, at)
        overlap = common(put, near)
        found.append((overlap, 0.0 if overlap else -common(put, material.hull), at))
    found.sort(key=lambda one: one[:2])
    none = sum(overlap < _GIVEN**2 for overlap, _, _ in found)
    size, most = math.sqrt(outline.hull.area), max(_OVERLAP * outline.shape.area, _MORE * found[0][0])
    most = min(most, _spare(outline.shape))
    # With much room for some turns, that of sides which would touch is among those that overlap.
    chosen = [*found[: min(none, _MOST_PLACED)], *found[none : max(_PLACED, none + 2)]]
    for overlap, _, at in found if every else chosen:
        if overlap <= most:
            yield most_room([(outline, material)], pivot, at, size, False, tolerance)


def _placed(
    led: Led,
    slab: int,
    material: Layers,
    height: float,
    opening: shapely.Polygon,
    closed: bool,
    tongue: shapely.Polygon | None = None,
) -> Iterator[Candidate]:
    swept, section = led.swept[slab], material.section(height)
    part, width = tongue or largest(swept.shape), width_of(tongue or swept.shape)
    pivot = np.array(part.centroid.coords[0])
    for clearance, at in placements(swept, section, opening, pivot, _ROUGHLY * width):
        if not _TIGHTEST * width < clearance < _LOOSEST * width:
            continue
        if common(moved(part, pivot, at), section.hull) < _IN_HULL * part.area:
            continue
        depth = _reach(led, material, pivot, at, min(clearance, 0.0))
        found = Candidate(led, slab, material, height, opening, closed, pivot, at, clearance, width, depth, ())
        yield replace(found, walls=walls(found))


def _reach(led: Led, material: Layers, pivot: Array, at: Array, spare: float) -> float:
    """How far the tip gets below the top of the material, m, as far as the slabs of the search tell."""
    own = led.layers.edges - led.layers.low
    put = [moved(one.shape.buffer(spare - _GIVEN, join_style="mitre"), pivot, at) for one in led.swept]

    def free(slab: int, section: Outline) -> bool:
        return not section.shape.intersects(put[slab]) or (
            common(section.shape, put[slab]) <= 1e-9 * section.shape.area
        )

    top, done = material.high, 0.0
    known = dict[tuple[int, int], bool]()
    full = top - material.low
    depths = {round(float(top - e + a), 10) for e in material.edges for a in own}
    for ahead in sorted(depth for depth in depths if depth > 1e-10):
        tip = top - 0.5 * (done + ahead)
        for j, section in enumerate(material.sections):
            if (up := material.edges[j + 1] - tip) > 0.0:
                k = min(max(int(np.searchsorted(own, up)) - 1, 0), len(put) - 1)
                if (k, j) not in known:
                    known[k, j] = free(k, section)
                if not known[k, j]:
                    return done
        done = min(ahead, full)
        if done == full:
            break
    return done


def walls(candidate: Candidate) -> tuple[float, ...]:
    """Area of the walls of a seated solid, m², that lie within shares of its width of the material."""
    own, material = candidate.led.layers, candidate.material
    shift = material.high - candidate.depth - own.low
    cuts = np.unique(np.concatenate([own.edges + shift, material.edges]))
    found, known = np.zeros(len(SHARES)), dict[tuple[Outline, Outline], Array]()
    for low, high in pairwise(cuts):
        middle = 0.5 * (low + high)
        if material.low < middle < material.high and own.low < middle - shift < own.high:
            key = (
                own.sections[int(np.searchsorted(own.edges, middle - shift)) - 1],
                material.sections[int(np.searchsorted(material.edges, middle)) - 1],
            )
            if key not in known:
                known[key] = _beside(candidate, *key)
            found += (high - low) * known[key]
    return tuple(found.tolist())


def _beside(candidate: Candidate, own: Outline, material: Outline) -> Array:
    """Length (k,) of an outline that lies within shares of the width of material, m."""
    if own.is_empty or material.is_empty:
        return np.zeros(len(SHARES))
    near = np.array(SHARES) * candidate.width
    rim = moved(own.shape, candidate.pivot, candidate.at).boundary
    points = [
        shapely.line_interpolate_point(ring, np.linspace(0.0, ring.length, count, endpoint=False))
        for ring in shapely.get_parts(rim)
        for count in (max(8, math.ceil(_SAMPLES * ring.length / rim.length)),)
    ]
    far, s = shapely.distance(np.concatenate(points), material.shape), candidate.clearance
    within = (far[:, None] < max(s, 0.0) + near).mean(axis=0)
    return np.asarray(np.where((-near < s) & (s < _LOOSE * near), within * rim.length, 0.0))
