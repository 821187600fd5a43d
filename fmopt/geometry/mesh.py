"""Meshes from files: vertices merged, closedness, orientation and overlaps checked, coplanar facets merged."""

from __future__ import annotations

from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from fmopt.errors import GeometryError, ResourceError
from fmopt.geometry.facets import Indices, merged_vertices
from fmopt.geometry.polyhedron import Polyhedron, from_triangles
from fmopt.values import Array

Unit = Literal["m", "dm", "cm", "mm", "um", "in"]

_PER_METRE: dict[Unit, float] = {"m": 1.0, "dm": 10.0, "cm": 100.0, "mm": 1e3, "um": 1e6, "in": 1.0 / 0.0254}
_MERGE = 1e-7  # of the diameter: vertices this close are one
_FLAT = 1e-6  # of the diameter: triangles this close to a plane are coplanar


def load_mesh(path: Path | str, unit: Unit) -> Polyhedron:
    """The polyhedron of an STL or OBJ file.

    Vertices within 1e-7 of the diameter are merged, facets within 1e-6 of it of a plane are coplanar.

    Args:
        path: the file.
        unit: length unit of its numbers; mesh files do not say.

    Raises:
        ResourceError: there is no such file.
        GeometryError: unreadable, open, inside out or overlapping itself; names the triangle, the edge, the place.
    """
    points, triangles = _read(Path(path))
    points = points / _PER_METRE[unit]
    try:
        return mesh_polyhedron(points, triangles)
    except GeometryError as error:
        raise GeometryError(f"{path}: {error.message}", error.advice) from error


def mesh_polyhedron(points: Array, triangles: Indices) -> Polyhedron:
    """The polyhedron of loose triangles (m, 3) over points (n, 3) in m, merged and checked as `load_mesh` does.

    Raises:
        GeometryError: open, inside out or overlapping itself.
    """
    span = float(np.linalg.norm(np.ptp(points, axis=0)))
    points, triangles = merged_vertices(points, triangles, _MERGE * span)
    triangles = _sewn(points, triangles, _FLAT * span)
    body = from_triangles(points, triangles, _FLAT * span)
    _require_simple(points, triangles)
    return body


def _read(path: Path) -> tuple[Array, Indices]:
    import trimesh

    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("stl", "obj"):
        raise GeometryError(f"{path}: {path.suffix or 'a name without suffix'} is no mesh format", "use .stl or .obj")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ResourceError(f"cannot read mesh {path}: {error.strerror}", "check the path") from error
    try:
        mesh = trimesh.load_mesh(BytesIO(data), file_type=kind, process=False)
        points, triangles = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except (ValueError, LookupError, AttributeError, TypeError) as error:
        raise GeometryError(f"{path} is no readable {kind.upper()} file: {error}", "export it again") from error
    if not len(triangles):
        raise GeometryError(f"{path} holds no triangles", "export the solid, not a drawing or a point cloud")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise GeometryError(f"{path}: vertex {bad} is not finite", "export it again")
    return points, triangles


def _sewn(points: Array, triangles: Indices, reach: float) -> Indices:
    """Triangles with an open edge are split at the vertices that lie on it, as where a rim was subdivided on one side.

    Only vertices of open edges within `reach` of the edge count, so that the surface stays where it is.
    """
    while True:
        sides = {(int(t[k]), int(t[(k + 1) % 3])): (i, k) for i, t in enumerate(triangles) for k in range(3)}
        loose = [side for side in sides if side[::-1] not in sides]
        rim = np.unique(np.array(loose, dtype=np.int64))
        splits: dict[int, tuple[int, list[int]]] = {}
        for a, b in loose:
            if between := _between(points, a, b, rim, reach):
                splits.setdefault(sides[a, b][0], (sides[a, b][1], between))
        if not splits:
            return triangles
        kept = [triangle for i, triangle in enumerate(triangles.tolist()) if i not in splits]
        for i, (k, between) in splits.items():
            a, b, c = np.roll(triangles[i], -k).tolist()
            kept.extend([one, two, c] for one, two in pairwise([a, *between, b]))
        triangles = np.array(kept, dtype=np.int64)


def _between(points: Array, a: int, b: int, candidates: Indices, reach: float) -> list[int]:
    """The candidates strictly inside the segment from a to b, in order along it."""
    along = points[b] - points[a]
    length = float(np.linalg.norm(along))
    arms = points[candidates] - points[a]
    run = arms @ along / length
    off = np.linalg.norm(arms - np.outer(run / length, along), axis=1)
    on = (off <= reach) & (run > reach) & (run < length - reach)
    return [int(index) for index in candidates[on][np.argsort(run[on])]]


def _require_simple(points: Array, triangles: Indices) -> None:
    """Refuse shells that overlap each other: together they would count twice."""
    from manifold3d import Manifold, Mesh64, OpType

    body = Manifold(Mesh64(vert_properties=points, tri_verts=triangles.astype(np.uint64)))
    shells = [shell for shell in body.decompose() if shell.volume() > 0.0]
    apart = sum(shell.volume() for shell in shells)
    together = Manifold.batch_boolean(shells, OpType.Add).volume()
    if together < (1.0 - 1e-6) * apart:
        raise GeometryError(
            f"{len(shells)} shells overlap by {apart - together:.3g} m³",
            "unite them in the program that made the mesh",
        )
