"""CUT_DIA: the cut-diagram of a solid, by divide and conquer over its tree of instances.

The cut-diagram of a tree is the same tree of regularised operators over the cut-diagrams of its instances
([LeeHuang1985] Assertion 2). Round sections stay exact: circles, ellipses, parabolas, hyperbolas.
"""

from __future__ import annotations

from collections.abc import Iterator
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
    exact_pose,
)
from fmopt.nominal.instance_section import Limit, instance_sections
from fmopt.plane.boolean import difference, intersection, union
from fmopt.plane.region import Region
from fmopt.se3 import Pose


def cut_diagram(solid: Solid, plane: Pose) -> Region:
    """The regularised section of a solid by the plane z = 0 of `plane`, in the plane's x (u) and y (v), m.

    The boundary is a list of parametric curve pairs: `curve.point(t)` gives (u(t), v(t)), the interior on the left.

    Where the plane runs in a face the answer is what both sides share, the seam of two stacked bodies full, the top of
    a body empty: as [LeeHuang1985] Assertion 2 can only hold for sections that a small shift of the plane does not
    change, each limit is built over the whole tree, and the two are intersected.

    Args:
        solid: a tree of instances.
        plane: pose of the section plane in the solid's frame.
    """
    above, below = zip(*_leaves(solid, exact_pose(exact_pose(plane).inverse())), strict=True)
    if all(map(same, above, below)):
        return _section(solid, iter(above))
    return intersection(_section(solid, iter(above)), _section(solid, iter(below)))


def section_limit(solid: Solid, plane: Pose, limit: Limit) -> Region:
    """The limit of the solid's sections as the plane comes from above (1, from its positive z) or from below (−1)."""
    leaves = _leaves(solid, exact_pose(exact_pose(plane).inverse()))
    return _section(solid, (above if limit > 0 else below for above, below in leaves))


def frame_planes(frame: Pose) -> dict[str, Pose]:
    """The three planes of a frame, "xy", "yz" and "zx": each named by its u and v axis, with the third axis upward."""
    return {
        "xyz"[k] + "xyz"[(k + 1) % 3]: frame.compose(Pose(np.zeros(3), np.roll(np.eye(3), k, axis=0))) for k in range(3)
    }


def _leaves(solid: Solid, pose: Pose) -> Iterator[tuple[Region, Region]]:
    """Both limits of the sections of all instances, from left to right."""
    match solid:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            yield instance_sections(solid, pose)
        case Placed(inner, inner_pose):
            yield from _leaves(inner, exact_pose(pose.compose(exact_pose(inner_pose))))
        case Union(parts):
            for part in parts:
                yield from _leaves(part, pose)
        case Difference(base, tools):
            for part in (base, *tools):
                yield from _leaves(part, pose)
        case _:
            assert_never(solid)


def _section(solid: Solid, leaves: Iterator[Region]) -> Region:
    """The section of a tree, of those of its instances."""
    match solid:
        case Box() | Cylinder() | Cone() | Sphere() | Prism() | Wedge() | Hull():
            return next(leaves)
        case Placed(inner, _):
            return _section(inner, leaves)
        case Union(parts):
            return union([_section(part, leaves) for part in parts])
        case Difference(base, tools):
            body, cuts = _section(base, leaves), [_section(tool, leaves) for tool in tools]
            return difference(body, union(cuts)) if not body.empty else body
        case _:
            assert_never(solid)


def same(first: Region, second: Region) -> bool:
    """Whether two regions have the same curves to the bit."""
    if first is second:
        return True
    mine, other = first.curves, second.curves
    return len(mine) == len(other) and all(
        type(a) is type(b) and np.array_equal(a.point((0.0, 0.5, 1.0)), b.point((0.0, 0.5, 1.0)))
        for a, b in zip(mine, other, strict=True)
    )
