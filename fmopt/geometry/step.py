"""STEP files: plane faces exactly, curved ones as facets no further from them than stated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.errors import GeometryError, ResourceError
from fmopt.geometry.facets import Indices
from fmopt.geometry.mesh import Imported, mesh_polyhedron
from fmopt.values import Array

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Shape

DEVIATION = 1e-5  # m: how finely curved faces are cut into facets where nothing else is asked for
_MILLIMETRE = 1e-3
_COARSEST = 0.5  # rad between neighbouring facets
_INSIDE = np.array([[1, 1, 1], [1.5, 1.5, 0], [0, 1.5, 1.5], [1.5, 0, 1.5]]) / 3.0  # where facets are held to surfaces


def load_step(path: Path, deviation: float = DEVIATION) -> Imported:
    """The solid of a STEP file, in m; the file says its unit itself.

    Corners of plane faces are those of the file. Curved faces become facets that lie within `deviation` of them; the
    distance is measured again at the middles of facets and their edges, and the larger of the two is the mesh's
    `chord_error`, 0 where all faces are plane.

    Args:
        path: the file.
        deviation: how far facets may lie from curved faces, m, positive.

    Raises:
        ResourceError: there is no such file, or the extra `step` is not installed.
        GeometryError: unreadable, no solid or several, or one whose boundary does not close.
    """
    if not path.is_file():
        raise ResourceError(f"cannot read {path}: there is no such file", "check the path")
    shape = _solid(path)
    points, triangles, off = _facets(shape, deviation)
    try:
        mesh = mesh_polyhedron(_MILLIMETRE * points, triangles)
    except GeometryError as error:
        raise GeometryError(f"{path}: {error.message}", error.advice) from error
    return replace(mesh, chord_error=0.0 if off is None else max(deviation, off))


def _solid(path: Path) -> TopoDS_Shape:
    try:
        from OCP.IFSelect import IFSelect_ReturnStatus
        from OCP.Message import Message
        from OCP.STEPControl import STEPControl_Reader
        from OCP.TopAbs import TopAbs_ShapeEnum
    except ImportError as error:
        advice = "install fmopt[step], or export the part as STL"
        raise ResourceError(f"{path}: STEP files need the extra step", advice) from error
    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.TransferRoots():
        raise GeometryError(f"{path} is no readable STEP file", "export it again, as AP203, AP214 or AP242")
    solids = list(_inside(reader.OneShape(), TopAbs_ShapeEnum.TopAbs_SOLID))
    if len(solids) != 1:
        advice = "export one part on its own" if solids else "export the solid, not its surfaces"
        raise GeometryError(f"{path} holds {len(solids) or 'no'} solids", advice)
    return solids[0]


def _inside(shape: TopoDS_Shape, kind: Any) -> Iterator[Any]:
    from OCP.TopExp import TopExp_Explorer

    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def _facets(shape: TopoDS_Shape, deviation: float) -> tuple[Array, Indices, float | None]:
    """Points (n, 3) in mm, outward triangles (m, 3), and how far they are from curved faces, m; None if none is."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.GeomAbs import GeomAbs_SurfaceType
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopoDS import TopoDS

    BRepMesh_IncrementalMesh(shape, deviation / _MILLIMETRE, False, _COARSEST, False)
    points, triangles, off, count = [], [], [], 0
    for found in _inside(shape, TopAbs_ShapeEnum.TopAbs_FACE):
        face = TopoDS.Face(found)
        corners, sides, places = _mesh_of(face)
        surface = BRepAdaptor_Surface(face)
        if surface.GetType() != GeomAbs_SurfaceType.GeomAbs_Plane:
            off.append(_MILLIMETRE * _distance(surface, corners[sides], places[sides]))
        points.append(corners)
        triangles.append(sides + count)
        count += len(corners)
    return np.vstack(points), np.vstack(triangles), max(off, default=None)


def _mesh_of(face: Any) -> tuple[Array, Indices, Array]:
    """Corners (n, 3) in mm of a face's facets, the facets (m, 3) seen from outside, and the corners' parameters."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None:
        raise GeometryError("a face of the STEP file has no facets", "heal the solid where it was made")
    move = location.Transformation()
    nodes = [mesh.Node(i).Transformed(move) for i in range(1, mesh.NbNodes() + 1)]
    corners = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
    sides = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)], dtype=np.int64) - 1
    places = np.array([(uv.X(), uv.Y()) for uv in (mesh.UVNode(i) for i in range(1, mesh.NbNodes() + 1))])
    reversed_ = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return corners, sides[:, ::-1] if reversed_ else sides, places


def _distance(surface: Any, facets: Array, places: Array) -> float:
    """Largest distance in mm of a surface from facets (m, 3, 3), at the middles of facets and of their edges."""
    normal = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    size = np.linalg.norm(normal, axis=1)
    normal = normal[size > 0.0] / size[size > 0.0, None]
    largest = 0.0
    for weights in _INSIDE:
        for (u, v), corner, across in zip(weights @ places[size > 0.0], facets[size > 0.0, 0], normal, strict=True):
            point = surface.Value(float(u), float(v))
            largest = max(largest, abs(float(across @ (np.array([point.X(), point.Y(), point.Z()]) - corner))))
    return largest
