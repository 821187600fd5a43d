"""Mesh files of known solids, as a foreign program would write them, whole or with faults."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from fmopt.geometry.csg import Box, Difference, Placed, Prism, Solid
from fmopt.geometry.pieces import polyhedron
from fmopt.geometry.polyhedron import triangulated
from fmopt.se3 import Pose


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose(np.array([x, y, z]), np.eye(3))


def triangles_of(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in mm and outward triangles (m, 3) of a solid."""
    body = polyhedron(solid)
    return 1e3 * body.vertices, triangulated(body)


def stl_text(points: np.ndarray, triangles: Iterable[Iterable[int]]) -> str:
    """An ASCII STL file with nine digits."""
    lines = ["solid part"]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:.9g} {:.9g} {:.9g}".format(*points[i]) for i in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid part"])


def ply_text(points: np.ndarray, triangles: np.ndarray) -> str:
    """An ASCII PLY file with nine digits."""
    axes = [f"property double {axis}" for axis in "xyz"]
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *axes, f"element face {len(triangles)}"]
    rows = ["{:.9g} {:.9g} {:.9g}".format(*point) for point in points]
    faces = ["3 {} {} {}".format(*triangle) for triangle in triangles]
    return "\n".join([*head, "property list uchar int vertex_indices", "end_header", *rows, *faces, ""])


def write_stl(path: Path, solid: Solid) -> None:
    path.write_text(stl_text(*triangles_of(solid)))


def plate(across: tuple[float, float], corner: float = 0.0, size: float = 0.04, thick: float = 0.01) -> Solid:
    """A plate on z = 0 with a through hole of this width, its upright edges cut."""
    return Difference(Box((size, size, thick)), (Placed(rounded(across, 2.0 * thick, corner), at(z=-0.5 * thick)),))


def rounded(across: tuple[float, float], length: float, corner: float = 0.0) -> Solid:
    """A rectangular bar on z = 0 with its upright edges cut at 45°."""
    x, y = 0.5 * across[0], 0.5 * across[1]
    if corner == 0.0:
        return Box((*across, length))
    outline = [(x, y - corner), (x - corner, y), (corner - x, y), (-x, y - corner)]
    return Prism(tuple(outline + [(-a, -b) for a, b in outline]), length)
