"""Facets of a solid of the CAD kernel: plane faces exactly, curved ones no further off than stated."""

from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepGProp import BRepGProp
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Shape

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices, together
from fmopt.geometry.mesh.mesh_repair import first_crossing
from fmopt.geometry.mesh.surface import MAX_TRIANGLES
from fmopt.geometry.polyhedron import from_triangles
from fmopt.geometry.step import SIMPLER
from fmopt.geometry.step.exact_facets import Facets, exact_facets
from fmopt.geometry.step.step_file import inside, openings
from fmopt.geometry.step.surfaces import OtherSurfaceError, plane_of
from fmopt.spatial.values import Array

_COARSEST = 0.5  # rad between neighbouring facets
_INSIDE = np.array([[1, 1, 1], [1.5, 1.5, 0], [0, 1.5, 1.5], [1.5, 0, 1.5]]) / 3.0  # where facets are held to surfaces
_METRES = 1e-3  # a mm
_FLAT = 1e-6  # of the diameter: facets that cross by less touch
_ROUNDING = 1e-6  # of the volume
_HEAL = "heal the solid where it was made"


def facets_of(solid: TopoDS_Shape, deviation: float) -> dict[str, Any]:
    """The boundary of a solid: {"points": (n, 3) in mm, "triangles": (m, 3) outward, "off", …}.

    "off" is how far curved faces are from the facets, mm, None where there are none; "around" how much larger the
    facets are than fillets of the solid; "own" whether they are of its own surfaces and close by themselves. A solid of
    other surfaces than `exact_facets` follows is cut by the kernel.

    The deviation is how far the facets may be from curved faces, mm.

    Raises:
        GeometryError: the solid is open, or a face of it cannot be cut into facets.
    """
    if not any(inside(solid, "FACE")):
        raise GeometryError("its solid has no faces", _HEAL)
    if where := openings([solid]):
        raise GeometryError(f"its shell is not closed: {where}", _HEAL)
    found = _from_surfaces(solid, deviation)
    own = found is not None
    if found is None:
        points, triangles, off = _facets(solid, deviation)
        found = Facets(points, triangles, None if off is None else max(deviation, off), 0.0)
    told = {"off": found.off, "around": found.around, "own": own}
    return {"points": found.points.tolist(), "triangles": found.triangles.tolist(), **told}


def _from_surfaces(solid: TopoDS_Shape, deviation: float) -> Facets | None:
    """Facets of the solid's own surfaces, if they close and hold as much as the solid, but for what they are off."""
    try:
        found = exact_facets(solid, deviation)
    except OtherSurfaceError:
        return None
    volume, surface = GProp_GProps(), GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, volume)
    BRepGProp.SurfaceProperties_s(solid, surface)
    # About their middle, where the volumes that add up cancel least.
    held = float(np.linalg.det(found.points[found.triangles] - found.points.mean(axis=0)).sum()) / 6.0
    # What a layer of that thickness all over the surface would hold.
    spare = surface.Mass() * ((found.off or 0.0) + found.around) + _ROUNDING * abs(volume.Mass())
    return found if abs(held - volume.Mass()) <= spare and _closes(found) else None


def _closes(found: Facets) -> bool:
    """Whether each edge has two facets, and none passes through another."""
    try:
        from_triangles(_METRES * found.points, found.triangles)
    except GeometryError:
        return False
    span = float(np.linalg.norm(np.ptp(found.points, axis=0)))
    return first_crossing(found.points, found.triangles, _FLAT * span) is None


def _facets(shape: TopoDS_Shape, deviation: float) -> tuple[Array, Indices, float | None]:
    """Points (n, 3), outward triangles (m, 3), and how far they are from curved faces, mm; None if none is."""
    # Without the flags: the deviation is in mm, not relative to edges, and no threads are started.
    BRepMesh_IncrementalMesh(shape, deviation, False, _COARSEST, False)
    meshes = [(face, *_mesh_of(face)) for face in inside(shape, "FACE")]
    off = (
        _distance(BRepAdaptor_Surface(face), corners[sides], places[sides])
        for face, corners, sides, places in meshes
        if plane_of(face) is None
    )
    points, triangles = together([(corners, sides) for _, corners, sides, _ in meshes])
    return points, triangles, max(off, default=None)


def _mesh_of(face: Any) -> tuple[Array, Indices, Array]:
    """Corners (n, 3) in mm of a face's facets, the facets (m, 3) seen from outside, and the corners' parameters."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None or not mesh.NbTriangles() or not mesh.HasUVNodes():
        raise GeometryError("a face of the STEP file has no facets", _HEAL)
    if mesh.NbTriangles() > MAX_TRIANGLES:
        raise GeometryError(f"a face becomes {mesh.NbTriangles()} facets", SIMPLER)
    move = location.Transformation()
    nodes = [mesh.Node(i).Transformed(move) for i in range(1, mesh.NbNodes() + 1)]
    corners = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
    sides = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)], dtype=np.int64) - 1
    places = np.array([(uv.X(), uv.Y()) for uv in (mesh.UVNode(i) for i in range(1, mesh.NbNodes() + 1))])
    return corners, sides[:, ::-1] if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else sides, places


def _distance(surface: Any, facets: Array, places: Array) -> float:
    """Largest distance in mm of a surface from facets (m, 3, 3), at the middles of facets and of their edges."""
    normal = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    size = np.linalg.norm(normal, axis=1)
    sound = size > 0.0
    facets, places, normal = facets[sound], places[sound], normal[sound] / size[sound, None]
    largest = 0.0
    for weights in _INSIDE:
        found = [surface.Value(u, v) for u, v in (weights @ places).tolist()]
        points = np.array([(point.X(), point.Y(), point.Z()) for point in found]).reshape(-1, 3)
        largest = max(largest, float(np.abs(np.vecdot(normal, points - facets[:, 0])).max(initial=0.0)))
    return largest
