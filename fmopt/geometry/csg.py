"""Constructive solid geometry as frozen data: convex primitives, placements, regularised unions and differences.

Lengths in m. Primitives stand on the plane z = 0 and are centred in x and y, as the instances of [LeeHuang1985]
section 3; every primitive is convex, and is the convex hull of its corners.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple, TypeAlias, assert_never

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.polyhedron import Polyhedron, convex_hull_polyhedron
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value, remembered

_MAX_SIDES, _MAX_MERIDIANS = 1998, 62  # with more a part has more than `facets.MAX_FACES` faces


@dataclass(frozen=True)
class Box:
    """A cuboid of `size` (x, y, z) in m, centred in x and y, from z = 0 up."""

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _floats("Box.size", self.size, 3))
        _require_positive(self, *self.size)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, in the polyhedral stages the prism over the inscribed regular `sides`-gon.

    Corners lie on the true circle, one flat looks along +x; the true surface is never further than `sagitta` outside.
    """

    radius: float
    height: float
    sides: int = 64

    def __post_init__(self) -> None:
        _require_positive(self, self.radius, self.height)
        _require_sides(self, self.sides)


@dataclass(frozen=True)
class Cone:
    """A truncated cone about z with radii `radius_bottom` at z = 0 and `radius_top` at z = height, one may be 0."""

    radius_bottom: float
    radius_top: float
    height: float
    sides: int = 64

    def __post_init__(self) -> None:
        radii = (self.radius_bottom, self.radius_top)
        _require_positive(self, max(radii), self.height, *(radius for radius in radii if radius != 0.0))
        _require_sides(self, self.sides)


@dataclass(frozen=True)
class Sphere:
    """A ball about the origin, in the polyhedral stages inscribed: `sides` meridians, half as many bands."""

    radius: float
    sides: int = 16

    def __post_init__(self) -> None:
        _require_positive(self, self.radius)
        _require_sides(self, self.sides)


@dataclass(frozen=True)
class Prism:
    """An upright prism over a convex polygon ((x, y), …), counter-clockwise seen from above."""

    polygon: tuple[tuple[float, float], ...]
    height: float

    def __post_init__(self) -> None:
        polygon = tuple((float(x), float(y)) for x, y in self.polygon)
        object.__setattr__(self, "polygon", polygon)
        _require_positive(self, self.height)
        _require_convex(polygon)


@dataclass(frozen=True)
class Wedge:
    """A box of `size` whose top is only `top_x` long: the face at x = −size_x/2 is upright, the opposite one leans."""

    size: tuple[float, float, float]
    top_x: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _floats("Wedge.size", self.size, 3))
        _require_positive(self, *self.size)
        if not 0.0 <= self.top_x <= self.size[0]:
            raise GeometryError(f"{self} has a top longer than its base or below 0", "set top_x between 0 and size x")


@dataclass(frozen=True)
class Hull:
    """The convex hull of at least four points ((x, y, z), …)."""

    points: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", tuple(_floats("Hull.points", point, 3) for point in self.points))
        if len(self.points) < 4:
            raise GeometryError(f"Hull has {len(self.points)} points", "give four or more that are not flat")


@dataclass(frozen=True, eq=False)
class Moved(Value):
    """A solid moved by a pose: points p of `solid` appear at pose.apply(p)."""

    solid: Solid
    pose: Pose


@dataclass(frozen=True)
class Union:
    """The regularised union of `parts`."""

    parts: tuple[Solid, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise GeometryError("a union of no parts is empty", "name at least one part")


Ring: TypeAlias = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Stack(Union):
    """The union of convex parts that together fill a stack of outlines, see `fmopt.geometry.outline_solids.stack`.

    Args:
        lofts: the same solid as what is between two rings of corners (x, y, z) each, one below the other: its surface
            is made of these, so that no corner of a piece that is none of the solid's is seen.
    """

    lofts: tuple[tuple[Ring, Ring], ...]


@dataclass(frozen=True)
class Difference:
    """The regularised difference of `base` and all `tools`."""

    base: Solid
    tools: tuple[Solid, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "tools", tuple(self.tools))


Primitive: TypeAlias = Box | Cylinder | Cone | Sphere | Prism | Wedge | Hull
Solid: TypeAlias = Box | Cylinder | Cone | Sphere | Prism | Wedge | Hull | Moved | Union | Difference


def chamfered_box(size: tuple[float, float, float], chamfer: float) -> Prism:
    """A box whose four upright edges are cut at 45°.

    The size is full widths, the chamfer what it takes from each of the two sides that it cuts, m.

    Raises:
        GeometryError: the chamfer is not positive, or takes half a side and more.
    """
    x, y, c = 0.5 * size[0], 0.5 * size[1], chamfer
    if not 0.0 < c < min(x, y):
        raise GeometryError(f"a chamfer of {c:g} m does not fit a section of {size[0]:g} x {size[1]:g} m", "shorten it")
    quarter = ((x, y - c), (x - c, y))
    upper = quarter + tuple((-a, b) for a, b in reversed(quarter))
    return Prism(upper + tuple((-a, -b) for a, b in upper), size[2])


def corners(primitive: Primitive) -> Array:
    """The points (n, 3) in m whose convex hull the primitive is."""
    match primitive:
        case Box(size):
            return _loft(_rectangle(size[0], size[1]), _rectangle(size[0], size[1]), size[2])
        case Cylinder(radius, height, sides):
            return _loft(ring(radius, sides), ring(radius, sides), height)
        case Cone(bottom, top, height, sides):
            return _loft(ring(bottom, sides), ring(top, sides), height)
        case Sphere(radius, sides):
            return _globe(radius, sides)
        case Prism(polygon, height):
            return _loft(np.array(polygon), np.array(polygon), height)
        case Wedge(size, top_x):
            lower = _rectangle(size[0], size[1])
            upper = lower.copy()
            upper[upper[:, 0] > 0.0, 0] = top_x - 0.5 * size[0]
            return _loft(lower, upper, size[2])
        case Hull(points):
            return np.array(points)
        case _:
            assert_never(primitive)


def convex_polyhedron(primitive: Primitive, pose: Pose) -> Polyhedron:
    """The primitive at a pose as a convex polyhedron with its corners as vertices, exact to the bit when not turned."""
    place = exact_pose(pose)
    # As numbers, which can be keys of what is remembered; arrays cannot.
    return _standing(primitive, tuple(place.p.tolist()), tuple(place.R.ravel().tolist()))


@remembered(4)
def _standing(primitive: Primitive, p: tuple[float, ...], R: tuple[float, ...]) -> Polyhedron:
    """The primitive at p (3,) in m, turned by R (9,)."""
    points = Pose(np.array(p), np.array(R).reshape(3, 3)).apply(corners(primitive))
    return convex_hull_polyhedron(points + 0.0)


def exact_pose(pose: Pose) -> Pose:
    """The pose with entries of R within 1e-15 of −1, 0, 1 made so, so that quarter turns keep coordinates exact."""
    whole = np.round(pose.R)
    return Pose(pose.p, np.where(np.abs(pose.R - whole) < 1e-15, whole, pose.R) + 0.0)


def ring(radius: float, sides: int) -> Array:
    """Corners (n, 2), m, of the regular polygon in a circle, mirror-symmetric to the last bit, a flat at +x."""
    return radius * np.array([(_cosine(j, sides), _sine(j, sides)) for j in range(1, 2 * sides, 2)])


class Operand(NamedTuple):
    """A primitive of a solid, the pose of its frame, and of how many tools, one of the other, it is a part."""

    primitive: Primitive
    pose: Pose
    taken: int


def operands(solid: Solid, pose: Pose, taken: int = 0) -> Iterator[Operand]:
    """The primitives of a solid at a pose, from left to right."""
    match solid:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            yield Operand(solid, exact_pose(pose), taken)
        case Moved(inner, move):
            yield from operands(inner, exact_pose(pose).compose(exact_pose(move)), taken)
        case Union(parts):
            for part in parts:
                yield from operands(part, pose, taken)
        case Difference(base, tools):
            yield from operands(base, pose, taken)
            for tool in tools:
                yield from operands(tool, pose, taken + 1)
        case _:
            assert_never(solid)


def changed(solid: Solid, change: Callable[[Primitive, int], Primitive], taken: int = 0) -> Solid:
    """A solid with `change` made of each primitive, given as in `Operand`; what does not change stays itself."""
    match solid:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            return change(solid, taken)
        case Moved(inner, pose):
            body = changed(inner, change, taken)
            return solid if body is inner else Moved(body, pose)
        case Union(parts):
            bodies = [changed(part, change, taken) for part in parts]
            return solid if all(map(operator.is_, bodies, parts)) else Union(tuple(bodies))
        case Difference(base, tools):
            body, cuts = changed(base, change, taken), [changed(tool, change, taken + 1) for tool in tools]
            same = all(map(operator.is_, (body, *cuts), (base, *tools)))
            return solid if same else Difference(body, tuple(cuts))
        case _:
            assert_never(solid)


def sagitta(solid: Solid) -> float:
    """Largest distance in m between a curved surface of the solid and the polyhedron that stands for it."""
    return max(_sagitta(operand.primitive) for operand in operands(solid, Pose.identity()))


def _sagitta(primitive: Primitive) -> float:
    match primitive:
        case Box() | Prism() | Wedge() | Hull():
            return 0.0
        case Cylinder(radius, _, sides):
            return 2.0 * radius * math.sin(0.5 * math.pi / sides) ** 2
        case Cone(bottom, top, _, sides):
            return 2.0 * max(bottom, top) * math.sin(0.5 * math.pi / sides) ** 2
        case Sphere(radius, sides):
            return radius * (1.0 - math.cos(math.pi / sides) * math.cos(0.5 * math.pi / max(sides // 2, 2)))
        case _:
            assert_never(primitive)


def _loft(lower: Array, upper: Array, height: float) -> Array:
    levels = ((lower, 0.0), (upper, height))
    points = np.vstack([np.column_stack([outline, np.full(len(outline), z)]) for outline, z in levels])
    # Corners of the tip of a cone, or of a wedge without a top, are one.
    kept = np.sort(np.unique(points + 0.0, axis=0, return_index=True)[1])
    return np.asarray(points[kept] + 0.0)


def _globe(radius: float, sides: int) -> Array:
    bands = max(sides // 2, 2)
    poles = np.array([(0.0, 0.0, -radius), (0.0, 0.0, radius)])
    rings = []
    for k in range(1, bands):
        outline = ring(radius * _sine(k, bands), sides)
        rings.append(np.column_stack([outline, np.full(sides, -radius * _cosine(k, bands))]))
    return np.asarray(np.vstack([*rings, poles]) + 0.0)


def _rectangle(x: float, y: float) -> Array:
    return 0.5 * np.array([(-x, -y), (x, -y), (x, y), (-x, y)])


def _cosine(j: int, n: int) -> float:
    """cos(π j / n) for 0 ≤ j ≤ 2n, equal up to sign for mirrored j."""
    j = min(j, 2 * n - j)
    if 2 * j == n:
        return 0.0
    return math.cos(math.pi * j / n) if 2 * j <= n else -math.cos(math.pi * (n - j) / n)


def _sine(j: int, n: int) -> float:
    """sin(π j / n) for 0 ≤ j ≤ 2n, equal up to sign for mirrored j."""
    return -_sine(2 * n - j, n) if j > n else math.sin(math.pi * min(j, n - j) / n)


def _floats(name: str, values: tuple[float, ...], count: int) -> tuple[float, ...]:
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise GeometryError(f"{name} is {values}, expected {count} finite numbers", "give lengths in metres")
    return tuple(float(value) for value in values)


def _require_positive(solid: Primitive, *lengths: float) -> None:
    if not all(math.isfinite(length) and length > 0.0 for length in lengths):
        shown = ", ".join(f"{field.name}={getattr(solid, field.name)}" for field in fields(solid))
        raise GeometryError(f"{type(solid).__name__}({shown}) has no volume", "make every length positive")


def _require_sides(solid: Cylinder | Cone | Sphere, sides: int) -> None:
    most = _MAX_MERIDIANS if isinstance(solid, Sphere) else _MAX_SIDES
    if not 3 <= sides <= most:
        raise GeometryError(f"{type(solid).__name__} has {sides} sides", f"use 3 to {most}")


def _require_convex(polygon: tuple[tuple[float, float], ...]) -> None:
    points = np.array(polygon)
    if len(polygon) < 3 or not np.isfinite(points).all():
        raise GeometryError(f"Prism has {len(polygon)} usable corners", "give at least three finite ones")
    turns = outline_turns(points)
    # A star turns left everywhere, too, but goes round more than once.
    if not np.all(turns > 0.0) or abs(turns.sum() - 2.0 * math.pi) > 1e-6:
        worst = int(np.argmin(turns))
        raise GeometryError(
            f"Prism is not convex and counter-clockwise at corner {worst}, {polygon[worst]}",
            "list the corners of a convex polygon counter-clockwise; build others as Union or Difference",
        )


def outline_turns(corners: Array) -> Array:
    """How far an outline (n, 2) turns to the left at each of its corners (n,), rad."""
    ahead = np.roll(corners, -1, axis=0) - corners
    before = np.roll(ahead, 1, axis=0)
    sines = before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0]
    return np.asarray(np.arctan2(sines, np.sum(before * ahead, axis=1)))
