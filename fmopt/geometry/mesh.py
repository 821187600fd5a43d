"""Meshes from files: vertices merged, faults named by triangle, coplanar facets merged, a rim left open closed.

Meshes whose numbers are rounded: facets that were meant to be plane, and are so only to the last digit written.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Solid
from fmopt.geometry.excess import MESH_NOISE, solid_of
from fmopt.geometry.facets import Indices, merged_vertices, place
from fmopt.geometry.mating import chord_error
from fmopt.geometry.mesh_file import read_triangles
from fmopt.geometry.mesh_repair import Crossing, Patch, first_crossing, patches
from fmopt.geometry.pieces import polyhedron
from fmopt.geometry.polyhedron import Polyhedron, from_triangles, triangulated
from fmopt.geometry.section import require_plausible
from fmopt.values import Array, Value, remembered

Unit = Literal["m", "dm", "cm", "mm", "um", "in"]

_PER_METRE: dict[Unit, float] = {"m": 1.0, "dm": 10.0, "cm": 100.0, "mm": 1e3, "um": 1e6, "in": 1.0 / 0.0254}
_MERGE = 1e-7  # of the diameter: vertices this close are one
_FLAT = 1e-6  # of the diameter: triangles this close to a plane are coplanar
_COARSE = 1e-4  # of the diameter: coordinates that are multiples of more than this are meant, not rounded
_MOST_LOOSE = 5_000  # open edges: more are no rims of gaps
_MOST_SPLITS = 10  # times that triangles are split at the rims of gaps
_MENDED = -1  # what triangles that no file holds are called

_REACH = 2.0  # steps of rounding: corners that are half a step off each way leave their plane by less
_UNEVEN = 1e-4  # of the diameter: facets this close to one plane are said to be uneven


@dataclass(frozen=True, eq=False)
class Imported(Value):
    """A mesh as it came in.

    Args:
        body: the polyhedron, m.
        chord_error: how far the curved surfaces that it stands for may lie from it, m.
        mended: what closes gaps of the mesh.
        notes: what was done to the mesh that a user should know of.
        rounding: step of the grid that all coordinates lie on, as where a file gives few decimals, m; 0 where that is
            too fine or too coarse to be rounding.
    """

    body: Polyhedron
    chord_error: float
    mended: tuple[Patch, ...] = ()
    notes: tuple[str, ...] = ()
    rounding: float = 0.0


def load_mesh(path: Path | str, unit: Unit) -> Imported:
    """The polyhedron of an STL, OBJ or PLY file.

    Vertices within 1e-7 of the diameter are merged, facets within 1e-6 of it of a plane are coplanar. Gaps are closed
    where the missing surface is flat or a band between two rims, see `mended.patches`: whoever uses the part is to
    look at them.

    Args:
        path: the file.
        unit: length unit of its numbers; mesh files do not say.

    Raises:
        ResourceError: there is no such file.
        SizeError: too large or too small for a part, as where the unit is another one.
        GeometryError: unreadable, open, inside out or crossing itself; names the triangle, the edge, the place.
    """
    points, triangles = read_triangles(Path(path))
    require_plausible(points / _PER_METRE[unit])
    try:
        mesh = mesh_polyhedron(points / _PER_METRE[unit], triangles)
    except GeometryError as error:
        raise GeometryError(f"{path}: {error.message}", error.advice) from error
    return replace(mesh, rounding=decimal_step(points) / _PER_METRE[unit])


def decimal_step(points: Array) -> float:
    """The largest power of ten that all coordinates (n, 3) are multiples of, to a single's precision.

    0 where that is less than 1e-6 of the diameter, too fine to matter, or more than 1e-4, too coarse to be rounding.
    """
    span = float(np.linalg.norm(np.ptp(points, axis=0)))
    slack = float(np.finfo(np.float32).eps) * float(np.abs(points).max())
    for power in range(math.floor(math.log10(span)), math.ceil(math.log10(_FLAT * span)) - 1, -1):
        step = 10.0**power
        if np.abs(points - step * np.round(points / step)).max() <= min(slack, 0.01 * step):
            return step if step <= _COARSE * span else 0.0
    return 0.0


def mesh_polyhedron(points: Array, triangles: Indices) -> Imported:
    """The polyhedron of loose triangles (m, 3) over points (n, 3) in m, merged, mended and checked as by `load_mesh`.

    Raises:
        GeometryError: open, inside out or crossing itself.
    """
    span = float(np.linalg.norm(np.ptp(points, axis=0)))
    merged, corners, numbers = merged_vertices(points, triangles, _MERGE * span)
    notes = _left_out(points, triangles, numbers)
    corners, numbers = _sewn(merged, corners, numbers, _FLAT * span)
    mended = tuple(
        replace(patch, beside=int(numbers[patch.beside])) for patch in patches(merged, corners, _FLAT * span)
    )
    closed = np.vstack([corners, *(patch.triangles for patch in mended)])
    called = np.append(numbers, np.full(len(closed) - len(numbers), _MENDED))
    crossing = first_crossing(merged, closed, _FLAT * span)
    if crossing is not None and _MENDED in called[list(crossing[:2])]:
        closed, called, mended = corners, numbers, ()
    body = from_triangles(merged, closed, _FLAT * span, called)
    _require_simple(merged, closed, crossing, called)
    return Imported(body, chord_error(body), mended, (*notes, *(_gap(patch) for patch in mended)))


def extents(path: Path) -> tuple[float, float, float]:
    """Width of a mesh file along x, y and z in the numbers of the file, whose unit it does not say.

    Raises:
        ResourceError: there is no such file.
        GeometryError: unreadable.
    """
    x, y, z = np.ptp(read_triangles(path)[0], axis=0)
    return float(x), float(y), float(z)


def _left_out(points: Array, triangles: Indices, kept: Indices) -> list[str]:
    lost = np.setdiff1d(np.arange(len(triangles)), kept)
    if not len(lost):
        return []
    where = f"triangle {lost[0]} at {place(points[triangles[lost[0], 0]])}"
    return [
        f"{where} has no area and was left out"
        if len(lost) == 1
        else f"{len(lost)} triangles have no area and were left out, {where} first"
    ]


def _gap(patch: Patch) -> str:
    a, b = patch.corners.min(axis=0), patch.corners.max(axis=0)
    return f"the mesh is open beside triangle {patch.beside}, from {place(a)} to {place(b)}; it was closed there"


def _sewn(points: Array, triangles: Indices, numbers: Indices, reach: float) -> tuple[Indices, Indices]:
    """Triangles with an open edge are split at the vertices that lie on it, as where a rim was subdivided on one side.

    Only vertices of open edges within `reach` of the edge count, so that the surface stays where it is. The parts of
    a triangle keep its number. Where there are too many to be a rim, the surface is left as open as it is.
    """
    for _ in range(_MOST_SPLITS):
        sides = {(int(t[k]), int(t[(k + 1) % 3])): (i, k) for i, t in enumerate(triangles) for k in range(3)}
        loose = [side for side in sides if side[::-1] not in sides]
        if len(loose) > _MOST_LOOSE:
            break
        rim = np.unique(np.array(loose, dtype=np.int64))
        splits: dict[int, tuple[int, list[int]]] = {}
        for a, b in loose:
            if between := _between(points, a, b, rim, reach):
                splits.setdefault(sides[a, b][0], (sides[a, b][1], between))
        if not 0 < sum(len(between) for _, between in splits.values()) <= _MOST_LOOSE:
            break
        kept = [triangle for i, triangle in enumerate(triangles.tolist()) if i not in splits]
        called = [number for i, number in enumerate(numbers.tolist()) if i not in splits]
        for i, (k, between) in splits.items():
            a, b, c = np.roll(triangles[i], -k).tolist()
            parts = [[one, two, c] for one, two in pairwise([a, *between, b])]
            kept.extend(parts)
            called.extend([int(numbers[i])] * len(parts))
        triangles, numbers = np.array(kept, dtype=np.int64), np.array(called, dtype=np.int64)
    return triangles, numbers


def _between(points: Array, a: int, b: int, candidates: Indices, reach: float) -> list[int]:
    """The candidates strictly inside the segment from a to b, in order along it."""
    along = points[b] - points[a]
    length = float(np.linalg.norm(along))
    arms = points[candidates] - points[a]
    run = arms @ along / length
    off = np.linalg.norm(arms - np.outer(run / length, along), axis=1)
    on = (off <= reach) & (run > reach) & (run < length - reach)
    return [int(index) for index in candidates[on][np.argsort(run[on])]]


def _require_simple(points: Array, triangles: Indices, crossing: Crossing | None, numbers: Indices) -> None:
    """Refuse a surface that passes through itself, and shells inside each other: together they would count twice."""
    if crossing is not None:
        one, other, where = crossing
        message = f"the surface passes through itself: triangles {numbers[one]} and {numbers[other]} cross"
        advice = "unite the bodies in the program that made the mesh, and export it again"
        raise GeometryError(f"{message} at {place(where)}", advice)
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


@remembered(1)
def come_apart(mesh: Imported) -> tuple[Solid, float]:
    """The solid of a mesh by way of `excess.solid_of`, and how far its faces were moved to make them plane, m.

    Noise of 1e-6 of the diameter is cleaned away. Where the mesh has neighbouring faces that are one plane but for the
    rounding of its numbers, corners within two steps of the rounding of a plane are in it.

    Raises:
        GeometryError: it does not come apart into convex bodies, and where its facets are uneven.
    """
    body, reach = mesh.body, _REACH * mesh.rounding
    uneven, where = _flattest_edge(body)
    try:
        if uneven > reach:
            return solid_of(body, MESH_NOISE * body.diameter), 0.0
        triangles = triangulated(body)
        solid = solid_of(from_triangles(body.vertices, triangles, reach), reach)
    except GeometryError as error:
        if uneven > _UNEVEN * body.diameter:
            raise
        raise GeometryError(
            f"the facets around {place(where)} are {1e6 * uneven:.3g} µm off one plane, and the mesh does not come "
            "apart into convex bodies",
            "make them plane in the program that made the mesh, or write the file with more digits",
        ) from error
    return solid, _shift(body.vertices, triangles, polyhedron(solid))


def _flattest_edge(body: Polyhedron) -> tuple[float, Array]:
    """The least distance by which the faces at an edge, looking the same way, are off one plane, m, and where."""
    least, where = np.inf, np.zeros(3)
    for edge in body.edges:
        one, other = (body.faces[number] for number in edge.faces)
        beyond = float(np.abs(body.vertices[list(other.vertices)] @ one.normal - one.offset).max())
        if one.normal @ other.normal > 0.0 and beyond < least:
            least, where = beyond, body.vertices[list(edge.vertices)].mean(axis=0)
    return least, where


def _shift(points: Array, triangles: Indices, flat: Polyhedron) -> float:
    """How far a triangle is off the face that it became, the nearest that looks its way, m, at most."""
    corners = points[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    off = np.abs(corners @ flat.normals.T - flat.offsets).max(axis=1)
    return float(np.where(area @ flat.normals.T > 0.0, off, np.inf).min(axis=1).max())
