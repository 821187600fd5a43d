"""Parts that are several closed shells: those that touch or overlap are one solid, and are united."""

from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Error, Manifold, OpType

from fmopt.geometry.facets import Indices, compact, merged_vertices, normals_of
from fmopt.geometry.polyhedron import manifold_of, mesh_of
from fmopt.spatial.values import Array

_LOST = 1e-9  # of the volume of shells, by which that of their union is smaller where they overlap
_SLIVER = 1e-5  # of the greatest face at a vertex, root of the area, below which others do not count
_SQUARE = 1e-6  # cosine between faces that are square to each other
_FACING = 1e-4  # of the square of the size, the least area of faces that touch
_DEEP = 4.0  # times the distance within which vertices are one, by which faces are moved to meet others


@dataclass(frozen=True, eq=False)
class United:
    """A surface of triangles (k, 3) between points (n, 3), m, its closed shells one where they touch or overlap."""

    points: Array
    triangles: Indices
    count: int = 0  # of solids; 0 where not every shell closes and faces outward, so that nothing was united
    moved: float = 0.0  # how far faces were moved to meet each other, m
    notes: tuple[str, ...] = ()  # what was done


def united(points: Array, triangles: Indices, reach: float) -> United:
    """Unite the closed shells of a surface where they touch or overlap; those that lie apart stay as they are.

    Triangles (m, 3) over points (n, 3), m, are counter-clockwise from outside; vertices within `reach`, m, are one.
    """
    as_it_is = United(points, triangles)
    if not normals_of(points[triangles]).any():
        return as_it_is
    R = _axes(points, triangles)
    shells = _shells(_levelled(points @ R.T, reach), triangles, reach)
    solids = [manifold_of(*shell) for shell in shells]
    if not solids or any(one.status() != Error.NoError or one.volume() <= 0.0 for one in solids):
        return as_it_is
    if len(solids) == 1:
        return replace(as_it_is, count=1)
    apart, moved, deep = sum(one.volume() for one in solids), 0.0, _DEEP * reach
    union = Manifold.batch_boolean(solids, OpType.Add)
    count = len(union.decompose())
    # Slanted faces that touch but for rounding meet where all are moved outward by as much; edges that touch do not.
    wider = [manifold_of(_offset(*shell, deep), shell[1]) for shell in shells]
    met = Manifold.batch_boolean(wider, OpType.Add)
    common = sum(one.volume() for one in wider) - met.volume() - (apart - union.volume())
    if (closer := len(met.decompose())) < count and common > deep * _FACING * float(np.ptp(points, axis=0).max()) ** 2:
        union, count, moved = met, closer, deep
    elif count == len(solids) and union.volume() >= (1.0 - _LOST) * apart:
        return replace(as_it_is, count=count)
    vertices, corners = mesh_of(union)
    volumes = ", ".join(f"{1e9 * one.volume():.6g}" for one in solids)
    left = "one solid" if count == 1 else f"{count} solids"
    note = f"{len(solids)} closed shells of {volumes} mm³ touch or overlap: they were united, and are {left}"
    return United(vertices @ R, corners, count, moved, (note,))


def _shells(points: Array, triangles: Indices, reach: float) -> list[tuple[Array, Indices]]:
    """Vertices and triangles of each shell, in the order of the file, which ends one before it begins the next.

    Empty where a shell does not close, or is not closed when the next one begins.
    """
    vertices, corners, _ = merged_vertices(points, triangles, reach)
    found, begun = list[tuple[Array, Indices]](), 0
    open_sides = set[tuple[int, int]]()
    for number, (a, b, c) in enumerate(corners.tolist(), 1):
        for one, other in ((a, b), (b, c), (c, a)):
            if (other, one) in open_sides:
                open_sides.remove((other, one))
            elif (one, other) in open_sides:
                return []
            else:
                open_sides.add((one, other))
        if not open_sides:
            found.append(compact(vertices, corners[begun:number]))
            begun = number
    return [] if open_sides else found


def _axes(points: Array, triangles: Indices) -> Array:
    """Axes (3, 3), as rows, along normals of the largest facets."""
    normals = normals_of(points[triangles])
    areas = np.linalg.norm(normals, axis=1)
    z = normals[np.argmax(areas)] / areas.max()
    y = np.cross(z, normals)[np.argmax(np.where(np.abs(normals @ z) < _SQUARE * areas, areas, -1.0))]
    y = y if np.linalg.norm(y) > 0.0 else np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z])


def _levelled(points: Array, reach: float) -> Array:
    """Points (n, 3) whose coordinates are one where they follow each other within a distance, m."""
    found = points.copy()
    for axis in range(3):
        order = np.argsort(points[:, axis])
        values = points[order, axis]
        runs = np.cumsum(np.diff(values, prepend=values[0]) > reach)
        means = np.bincount(runs, values) / np.bincount(runs)
        # Only runs that stay within the distance as a whole: curved walls are not to be flattened.
        narrow = np.bincount(runs, np.abs(values - means[runs]) > reach) == 0
        found[order, axis] = np.where(narrow[runs], means[runs], values)
    return found


def _offset(vertices: Array, triangles: Indices, by: float) -> Array:
    """Vertices (n, 3) with every face moved outward by a distance, m."""
    normals = normals_of(vertices[triangles])
    areas = np.linalg.norm(normals, axis=1)
    # Slivers, whose normals are rounding, weigh next to nothing beside the faces that they lie in.
    weights = np.sqrt(areas / areas.max())
    normals *= (weights / np.maximum(areas, 1e-300))[:, None]
    found = vertices.copy()
    around: list[list[int]] = [[] for _ in vertices]
    for number, row in enumerate(triangles.tolist()):
        for vertex in row:
            around[vertex].append(number)
    for vertex, faces in enumerate(around):
        found[vertex] += by * np.linalg.lstsq(normals[faces], weights[faces], rcond=_SLIVER)[0]
    return found
