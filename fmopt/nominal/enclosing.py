"""Polyhedral stand-ins that contain a solid, so that what is free of them is free of its true round surfaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

import numpy as np

from fmopt.geometry.csg import (
    Box,
    Cone,
    Cylinder,
    Difference,
    Hull,
    Placed,
    Prism,
    Solid,
    Sphere,
    Union,
    Wedge,
    convex_polyhedron,
)
from fmopt.se3 import Pose


def enclosing(solid: Solid, outward: bool = True) -> Solid:
    """The solid with polygons that contain its round instances; those that are taken away lie inside theirs.

    Where nothing is round, that is the solid itself, whose pieces may be known.

    Args:
        solid: CSG tree.
        outward: False for the opposite, polygons inside the solid.
    """
    match solid:
        case Cylinder(radius, _, sides):
            return replace(solid, radius=radius / math.cos(math.pi / sides)) if outward else solid
        case Cone(bottom, top, _, sides):
            grown = 1.0 / math.cos(math.pi / sides)
            return replace(solid, radius_bottom=bottom * grown, radius_top=top * grown) if outward else solid
        case Sphere(radius, _):
            inner = float(np.min(convex_polyhedron(solid, Pose.identity()).offsets))
            return replace(solid, radius=radius * radius / inner) if outward else solid
        case Box() | Prism() | Wedge() | Hull():
            return solid
        case Placed(inner, pose):
            body = enclosing(inner, outward)
            return solid if body is inner else Placed(body, pose)
        case Union(parts):
            bodies = tuple(enclosing(part, outward) for part in parts)
            return solid if _same(bodies, parts) else Union(bodies)
        case Difference(base, tools):
            body, cuts = enclosing(base, outward), tuple(enclosing(tool, not outward) for tool in tools)
            return solid if _same((body, *cuts), (base, *tools)) else Difference(body, cuts)
        case _:
            assert_never(solid)


def _same(made: Sequence[Solid], parts: Sequence[Solid]) -> bool:
    return all(one is other for one, other in zip(made, parts, strict=True))


def grown(solid: Solid) -> float:
    """By how much, at most, `enclosing` moves a round surface, m."""
    match solid:
        case Cylinder(radius, _, sides):
            return radius * (1.0 / math.cos(math.pi / sides) - 1.0)
        case Cone(bottom, top, _, sides):
            return max(bottom, top) * (1.0 / math.cos(math.pi / sides) - 1.0)
        case Sphere(radius, _):
            inner = float(np.min(convex_polyhedron(solid, Pose.identity()).offsets))
            return radius * radius / inner - radius
        case Box() | Prism() | Wedge() | Hull():
            return 0.0
        case Placed(inner_solid, _):
            return grown(inner_solid)
        case Union(parts):
            return max(map(grown, parts))
        case Difference(base, tools):
            return max(map(grown, (base, *tools)))
        case _:
            assert_never(solid)


def finer(solid: Solid, sides: int) -> Solid:
    """The solid with at least so many sides for each cylinder and cone; spheres, whose faces are many, as they are."""
    match solid:
        case Cylinder() | Cone():
            return replace(solid, sides=max(solid.sides, sides))
        case Box() | Prism() | Wedge() | Hull() | Sphere():
            return solid
        case Placed(inner, pose):
            return Placed(finer(inner, sides), pose)
        case Union(parts):
            return Union(tuple(finer(part, sides) for part in parts))
        case Difference(base, tools):
            return Difference(finer(base, sides), tuple(finer(tool, sides) for tool in tools))
        case _:
            assert_never(solid)
