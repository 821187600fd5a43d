"""Meshes from files: vertices merged, triangles turned the same way, gaps closed, facets made plane, faults named."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from manifold3d import Manifold, OpType

from fmopt.errors import GeometryError
from fmopt.geometry.body_names import chosen
from fmopt.geometry.enclosing import enclosing, solid_of
from fmopt.geometry.facets import Indices, compact, heights_of, merged_vertices, normals_of, place, shells_of, together
from fmopt.geometry.mesh.mesh_file import read_surface, read_triangles
from fmopt.geometry.mesh.mesh_repair import Crossing, first_crossing, turned_alike, turned_outward
from fmopt.geometry.mesh.open_edges import MOST_OFF, MOST_OPEN, Patch, closes, joined, open_sides, patches, sewn
from fmopt.geometry.mesh.plane_facets import flattened
from fmopt.geometry.mesh.round_planes import chord_error, sagitta
from fmopt.geometry.mesh.shells import United, united
from fmopt.geometry.mesh.surface import MeshSurface
from fmopt.geometry.polyhedron import Polyhedron, from_triangles, manifold_of, placed
from fmopt.geometry.section import require_plausible
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value, remembered

Unit = Literal["m", "dm", "cm", "mm", "um", "in"]

_PER_METRE: dict[Unit, float] = {"m": 1.0, "dm": 10.0, "cm": 100.0, "mm": 1e3, "um": 1e6, "in": 1.0 / 0.0254}
_MERGE = 1e-7  # of the diameter: vertices this close are one
_WIDER = (10.0, 100.0, 1000.0, 10000.0)  # times that: so close where the surface does not close otherwise
_CURVED = 4.0 * MOST_OFF  # m: facets that are off plane faces by more stand for surfaces that are curved both ways
_TRIES = 2  # distances that are tried
_FLAT = 1e-6  # of the diameter: triangles this close to a plane are coplanar
_MENDED = -1  # what triangles that no file holds are called
_COUNTS = 1e-9  # m: what facets are off their faces by less is rounding
TOLD = 1e-7  # m: what facets are off their faces by more is said


@dataclass(frozen=True, eq=False)
class Imported(Value, where=(3,), labels={"where": "place"}):
    """A mesh as it came in, with the place (3,), m, where facets of its file lie farthest from its faces."""

    body: Polyhedron  # the polyhedron, m
    chord_error: float  # how far the curved surfaces that it stands for may lie from it, m
    mended: tuple[Patch, ...] = ()
    notes: tuple[str, ...] = ()
    off: float = 0.0  # how far the facets of the file lie from the faces of the polyhedron at most, m
    where: Array = field(default_factory=lambda: np.zeros(3))
    kind: Literal["mesh", "solid"] = "mesh"
    # How far points of facets may be off, m, that stand for curved surfaces and are no faces; None of others
    noise: float | None = None

    def moved(self, pose: Pose) -> "Imported":
        """The mesh moved by a pose."""
        return replace(self, body=placed(self.body, pose))


@dataclass(frozen=True)
class _Closed:
    """A surface that closes, as far as it can be closed."""

    points: Array  # (n, 3), m
    triangles: Indices  # (m, 3)
    numbers: Indices  # what each triangle is called (m,)
    mended: tuple[Patch, ...]  # what closes its gaps
    moved: float  # how far points were moved to become one, m
    notes: tuple[str, ...]  # what was done

    @property
    def is_closed(self) -> bool:
        """Whether every side of a triangle has one other across it."""
        return len(self.triangles) > 3 and closes(self.triangles)


@dataclass(frozen=True, eq=False)
class NamedBody(Value):
    """A body of a file that holds several."""

    name: str  # told apart from others by a number at its end; "" where it has none
    number: int  # its place in the file, from 1
    mesh: Imported  # the body in its own frame, m
    pose: Pose  # of that frame in the file's


def mesh_bodies(path: Path, unit: Unit) -> tuple[NamedBody, ...]:
    """All named objects of a mesh file, in the frame of the file; errors as of `load_mesh`."""
    return tuple(
        NamedBody(name, number, _imported(path, unit, points, triangles), Pose.identity())
        for number, (name, points, triangles) in enumerate(_objects(path), 1)
    )


def lie_apart(path: Path) -> bool:
    """Whether a mesh file has several named objects that are not one part, as they do not all touch."""
    found = _objects(path)
    return len(found) > 1 and united(*_together(found)).count > 1


def _objects(path: Path) -> tuple[tuple[str, Array, Indices], ...]:
    return read_surface(path, _objects_of)


@remembered(1)
def _objects_of(surface: MeshSurface) -> tuple[tuple[str, Array, Indices], ...]:
    """Name, points (n, 3) and triangles (m, 3) of each object of a file; of one object each body that lies apart."""
    found = surface.bodies()
    if len(found) > 1:
        return found
    points, triangles, reach = _together(found)
    merged, corners, _ = merged_vertices(points, triangles, reach)
    label = shells_of(corners, len(merged))
    shells = dict.fromkeys(label.tolist())
    # Where some touch and were united the file is one part, as its writer meant it.
    if len(shells) < 2 or (whole := united(points, triangles, reach)).count < 2 or whole.notes:
        return found
    return tuple((found[0][0], *compact(merged, corners[label == shell])) for shell in shells)


def _together(found: Sequence[tuple[str, Array, Indices]]) -> tuple[Array, Indices, float]:
    """Points and triangles of all objects, and the distance within which vertices are one."""
    points, triangles = together([(points, corners) for _, points, corners in found])
    return points, triangles, _MERGE * _span(points)


def load_mesh(path: Path | str, unit: Unit, body: str = "") -> Imported:
    """The polyhedron of a mesh file, or of one of its named objects.

    Vertices within 1e-7 of the diameter are merged, of a surface that does not close then those farther apart.
    Triangles that face the other way than those around them are turned. Gaps are closed where the missing surface is
    flat or a band between two rims, see `mended.patches`: whoever uses the part is to look at them. Facets that are
    plane but for noise become plane faces, see `plane_facets.flattened`; how far they lie from the file's is `off`.

    Args:
        unit: length unit of its numbers; mesh files do not say.
        body: name or number, from 1, of an object; "" where there is but one.

    Raises:
        ResourceError: there is no such file.
        SizeError: too large or too small for a part, as where the unit is another one.
        GeometryError: unreadable, open or crossing itself; names the triangle, the edge, the place.
    """
    found = _objects(Path(path))
    points, triangles, reach = _together(found)
    # Objects that touch are one part, as simulators have it, where none of them is named.
    if body or (len(found) > 1 and united(points, triangles, reach).count > 1):
        _, points, triangles = found[chosen([name for name, *_ in found], body, path)]
    return _imported(path, unit, points, triangles)


def _imported(path: Path | str, unit: Unit, points: Array, triangles: Indices) -> Imported:
    require_plausible(points / _PER_METRE[unit])
    try:
        return mesh_polyhedron(points / _PER_METRE[unit], triangles, _rounding(points) / _PER_METRE[unit])
    except GeometryError as error:
        raise GeometryError(f"{path}: {error.message}", error.advice) from error


def _span(points: Array) -> float:
    """Length of the diagonal of the box around points (n, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _rounding(points: Array) -> float:
    """By how much numbers (n, 3) may be rounded: half a step of single precision where they are of it, else nothing."""
    single = points.astype(np.float32)
    return 0.5 * float(np.spacing(np.abs(single).max())) if np.array_equal(single, points) else 0.0


def mesh_polyhedron(points: Array, triangles: Indices, rounding: float = 0.0) -> Imported:
    """The polyhedron of loose triangles (m, 3) over points (n, 3) in m, merged, mended and checked as by `load_mesh`.

    Numbers of the file may be rounded by as much as `rounding`, m.

    Raises:
        GeometryError: open or crossing itself.
    """
    shells = united(points, triangles, _MERGE * _span(points))
    try:
        return _of_shells(shells, rounding)
    except GeometryError:
        if not shells.moved:
            raise
    return _of_shells(United(points, triangles), rounding)  # shells that meet but for rounding stay beside each other


def _of_shells(shells: United, rounding: float) -> Imported:
    """See `mesh_polyhedron`."""
    span = _span(shells.points)
    closed = _best(shells.points, shells.triangles, span)
    noise = closed.moved + shells.moved + rounding
    try:
        flat = flattened(closed.points, closed.triangles, closed.numbers, noise)
        if flat.off > _CURVED:
            raise GeometryError("the facets are those of curved surfaces")
    except GeometryError as error:
        if not closed.is_closed or closed.mended:
            raise
        crossing = first_crossing(closed.points, closed.triangles, _FLAT * span)
        _require_simple(closed.points, closed.triangles, crossing, closed.numbers)
        try:
            return _as_facets(closed.points, closed.triangles, (*shells.notes, *closed.notes), noise)
        except GeometryError:
            raise error from None
    off = flat.off + closed.moved + shells.moved
    # It is looked for before facets are made plane, where each of two may be `off` from its face.
    crossing = first_crossing(closed.points, closed.triangles, max(_FLAT * span, 2.0 * off))
    # A patch that crosses closes nothing: flattened without patches, the mesh is refused as open, with the place.
    if crossing is not None and _MENDED in closed.numbers[list(crossing[:2])]:
        whole = closed.numbers != _MENDED
        flattened(closed.points, closed.triangles[whole], closed.numbers[whole])
    _require_simple(closed.points, closed.triangles, crossing, closed.numbers)
    off = off if off > _COUNTS else 0.0
    notes = (*shells.notes, *closed.notes, *(_gap(patch) for patch in closed.mended), *_evened(off, flat.where))
    return Imported(flat.body, chord_error(flat.body), closed.mended, notes, off, flat.where)


def _as_facets(points: Array, triangles: Indices, notes: tuple[str, ...], noise: float) -> Imported:
    """A closed surface of triangles (m, 3) over points (n, 3), m, that stand for no faces; see `enclosing`."""
    solid_of(points, triangles)  # for its faults
    try:
        body, off, where = from_triangles(points, triangles), 0.0, points[0]
    except GeometryError:  # of facets that are slivers
        found = enclosing(points, triangles, noise)
        body, off, where = found.boundary, found.off, found.where
    return Imported(body, sagitta(points, triangles), notes=notes, off=off, where=where, noise=noise)


def _best(points: Array, triangles: Indices, span: float) -> _Closed:
    """The surface closed with as little as it takes: without closing gaps if it can be; as the file has it if not."""
    first, with_gaps = None, None
    for reaches in dict.fromkeys(_reaches(points, triangles, span)):
        attempt = _closed(points, triangles, *reaches)
        first = first or attempt
        if attempt.is_closed:
            if not attempt.mended:
                return attempt
            with_gaps = with_gaps or attempt
        elif len(open_sides(attempt.triangles)) > MOST_OPEN:
            break
    found = with_gaps or first
    return found if found is not None else _closed(points, triangles, _MERGE * span, _FLAT * span, 0.0)


def _reaches(points: Array, triangles: Indices, span: float) -> Iterator[tuple[float, float, float]]:
    """How close vertices are to be one, how close to a side to be on it, and how thin triangles are left out, m.

    What leaves little open comes first.
    """
    least = _MERGE * span
    open_ = {least: _open_sides(points, triangles, least)}
    for times in _WIDER if open_[least] else ():
        reach = min(times * least, 2.0 * MOST_OFF)
        try:
            open_[reach] = _open_sides(points, triangles, reach)
        except GeometryError:  # in heaps, which the least distance may leave apart
            break
    if 0 < open_[least] <= MOST_OPEN:  # vertices on sides of others may be all that it is open by
        yield least, _FLAT * span, 0.0
    fewest = min(open_.values())
    good = sorted(reach for reach, count in open_.items() if count <= 1.1 * fewest + 3)
    yield good[0], max(_FLAT * span, 0.5 * good[0]), 0.0
    for off in (_FLAT * span, 0.1 * MOST_OFF, MOST_OFF):
        for reach in good[:_TRIES]:
            yield reach, max(off, 0.5 * reach), max(0.1 * off, reach)


def _open_sides(points: Array, triangles: Indices, reach: float) -> int:
    """How many sides of triangles have no other across once vertices are merged.

    Raises:
        GeometryError: the vertices lie in heaps, or most triangles are smaller than that.
    """
    corners = merged_vertices(points, triangles, reach)[1]
    if 2 * len(corners) < len(triangles):
        raise GeometryError(
            "most triangles are no larger than noise", "export the mesh again, in mm or with more digits"
        )
    sides = np.sort(np.vstack([corners[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    return int(np.count_nonzero(np.unique(sides, axis=0, return_counts=True)[1] == 1))


def _closed(points: Array, triangles: Indices, reach: float, beside: float, thin: float) -> _Closed:
    """Triangles over vertices merged within `reach`, turned alike, sewn within `beside`, their gaps closed.

    Those that are not as high as `thin` are left out, as where they fill what a side lacks of vertices on it.
    """
    span = _span(points)
    merged, corners, numbers = merged_vertices(points, triangles, reach)
    notes = _left_out(points, triangles, numbers)
    moved = _moved(points, merged) if reach > _MERGE * span else 0.0
    corners, numbers, doubled = _once(corners, numbers)
    if thin > 0.0:
        high = heights_of(merged[corners]) > thin
        corners, numbers = corners[high], numbers[high]
    corners, numbers, closer = joined(merged, corners, numbers, beside)
    notes += [f"{doubled} triangles stand twice in the file and count once"] if doubled else []
    # Turned before, as the two sides of an edge are known by their opposite directions; and once more after, as
    # splits join what had no common edge.
    corners, numbers = sewn(merged, turned_alike(merged, corners), numbers, beside)
    corners = turned_alike(merged, corners)
    mended = tuple(
        replace(patch, beside=int(numbers[patch.beside])) for patch in patches(merged, corners, _FLAT * span)
    )
    closed = np.vstack([corners, *(patch.triangles for patch in mended)])
    called = np.append(numbers, np.full(len(closed) - len(numbers), _MENDED))
    closed = turned_outward(merged, closed)
    notes += _turned(points, triangles, merged[closed], called)
    return _Closed(merged, closed, called, mended, moved + closer, tuple(notes))


def _moved(points: Array, merged: Array) -> float:
    """How far points (n, 3) are from those (k, 3) that they became, m, at most."""
    from scipy.spatial import cKDTree

    return float(np.max(cKDTree(merged).query(points)[0]))


def _once(triangles: Indices, numbers: Indices) -> tuple[Indices, Indices, int]:
    """Each triangle once, whichever corner comes first, and how many were left out."""
    first = np.argmin(triangles, axis=1)[:, None]
    alike = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    kept = np.sort(np.unique(alike, axis=0, return_index=True)[1])
    return triangles[kept], numbers[kept], len(triangles) - len(kept)


def _turned(points: Array, triangles: Indices, corners: Array, called: Indices) -> list[str]:
    """Which triangles of the file (m, 3) face the other way than those (k, 3, 3) that were made of them."""
    own = np.flatnonzero(called != _MENDED)
    before, after = normals_of(points[triangles[called[own]]]), normals_of(corners[own])
    turned = np.unique(called[own[np.einsum("ij,ij->i", before, after) < 0.0]])
    if not len(turned):
        return []
    if len(turned) >= len(np.unique(called[own])):
        return ["all triangles faced inward and were turned"]
    where = f"triangle {turned[0]} at {place(points[triangles[turned[0], 0]])}"
    many = f"{len(turned)} triangles faced the other way and were turned, {where} first"
    return [f"{where} faced the other way and was turned" if len(turned) == 1 else many]


def _evened(off: float, where: Array) -> list[str]:
    if off <= TOLD:
        return []
    return [
        f"facets are up to {1e6 * off:.3g} µm off plane faces, most at {place(where)}; they were made plane, which is "
        "a tolerance of form"
    ]


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
    many = f"{len(lost)} triangles have no area and were left out, {where} first"
    return [f"{where} has no area and was left out" if len(lost) == 1 else many]


def _gap(patch: Patch) -> str:
    a, b = patch.corners.min(axis=0), patch.corners.max(axis=0)
    return f"the mesh is open beside triangle {patch.beside}, from {place(a)} to {place(b)}; it was closed there"


def _require_simple(points: Array, triangles: Indices, crossing: Crossing | None, numbers: Indices) -> None:
    """Refuse a surface that passes through itself, and shells inside each other: together they would count twice."""
    if crossing is not None:
        one, other, where = crossing
        message = f"the surface passes through itself: triangles {numbers[one]} and {numbers[other]} cross"
        advice = "unite the bodies in the program that made the mesh, and export it again"
        raise GeometryError(f"{message} at {place(where)}", advice)
    # Shells of cavities have negative volumes.
    shells = [shell for shell in manifold_of(points, triangles).decompose() if shell.volume() > 0.0]
    apart = sum(shell.volume() for shell in shells)
    together = Manifold.batch_boolean(shells, OpType.Add).volume()
    if together < (1.0 - 1e-6) * apart:
        raise GeometryError(
            f"{len(shells)} shells overlap by {apart - together:.3g} m³", "unite them in the program that made the mesh"
        )
