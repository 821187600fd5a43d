"""The inside of the process that reads a STEP file: the CAD kernel, which may break down or go on for ever.

It answers in JSON on what was its standard output, and ends with its owner.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.mesh_file import MAX_TRIANGLES

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Shape

    from fmopt.geometry.facets import Indices
    from fmopt.values import Array

MEMORY = 4 << 30  # bytes of address space
SECONDS = 60  # of the processor
_COARSEST = 0.5  # rad between neighbouring facets
_INSIDE = np.array([[1, 1, 1], [1.5, 1.5, 0], [0, 1.5, 1.5], [1.5, 0, 1.5]]) / 3.0  # where facets are held to surfaces
_PR_SET_PDEATHSIG = 1
_SIMPLER = "export one part on its own, with simpler surfaces, or give a larger 'deviation'"


def main(arguments: list[str]) -> None:
    """Answers {"points", "triangles", "off"} or {"message", "advice"}.

    Args:
        arguments: the STEP file, how far facets may lie from curved faces in mm, the descriptor of a pipe that is
            closed when the owner ends, and the owner's process.
    """
    path, deviation, life, owner = arguments
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the owner to answer
    _die_with(int(owner), int(life))
    _limit()
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the kernel is talkative
    json.dump(_read(path, float(deviation)), answer)
    answer.close()
    os._exit(0)  # what the kernel holds of a damaged file is not worth taking apart


def _read(path: str, deviation: float) -> dict[str, Any]:
    from OCP.Standard import Standard_Failure

    try:
        points, triangles, off = _facets(_solid(path), deviation)
    except GeometryError as error:
        return {"message": error.message, "advice": error.advice}
    except MemoryError:
        return {"message": f"the CAD kernel needs more than {MEMORY >> 30} GiB for it", "advice": _SIMPLER}
    except (Standard_Failure, RuntimeError) as error:
        told = " ".join(str(error).split())[:200]
        return {"message": f"the CAD kernel gives up on it: {type(error).__name__} {told}", "advice": "export it again"}
    return {"points": points.tolist(), "triangles": triangles.tolist(), "off": off}


def _limit() -> None:
    """Limits memory and processor time where the system can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _die_with(owner: int, life: int) -> None:
    """Makes this process end with its owner."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
    if os.getppid() != owner:
        os._exit(0)

    def watch() -> None:
        os.read(life, 1)
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()


def _solid(path: str) -> TopoDS_Shape:
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Message import Message
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_ShapeEnum

    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
    reader = STEPControl_Reader()
    if reader.ReadFile(path) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.TransferRoots():
        raise GeometryError("it is no readable STEP file", "export it again, as AP203, AP214 or AP242")
    shape = reader.OneShape()
    solids = [] if shape.IsNull() else list(_inside(shape, TopAbs_ShapeEnum.TopAbs_SOLID))
    if len(solids) != 1:
        advice = "export one part on its own" if solids else "export the solid, not its surfaces"
        raise GeometryError(f"it holds {len(solids) or 'no'} solids", advice)
    return solids[0]


def _inside(shape: TopoDS_Shape, kind: Any) -> Iterator[Any]:
    from OCP.TopExp import TopExp_Explorer

    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def _facets(shape: TopoDS_Shape, deviation: float) -> tuple[Array, Indices, float | None]:
    """Points (n, 3), outward triangles (m, 3), and how far they are from curved faces, mm; None if none is."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.GeomAbs import GeomAbs_SurfaceType
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopoDS import TopoDS

    BRepMesh_IncrementalMesh(shape, deviation, False, _COARSEST, False)
    points: list[Array] = []
    triangles: list[Indices] = []
    off: list[float] = []
    count = 0
    for found in _inside(shape, TopAbs_ShapeEnum.TopAbs_FACE):
        face = TopoDS.Face(found)
        corners, sides, places = _mesh_of(face)
        surface = BRepAdaptor_Surface(face)
        if surface.GetType() != GeomAbs_SurfaceType.GeomAbs_Plane:
            off.append(_distance(surface, corners[sides], places[sides]))
        points.append(corners)
        triangles.append(sides + count)
        count += len(corners)
    if not points:
        raise GeometryError("its solid has no faces", "heal the solid where it was made")
    return np.vstack(points), np.vstack(triangles), max(off, default=None)


def _mesh_of(face: Any) -> tuple[Array, Indices, Array]:
    """Corners (n, 3) in mm of a face's facets, the facets (m, 3) seen from outside, and the corners' parameters."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None or not mesh.NbTriangles() or not mesh.HasUVNodes():
        raise GeometryError("a face of the STEP file has no facets", "heal the solid where it was made")
    if mesh.NbTriangles() > MAX_TRIANGLES:
        raise GeometryError(f"a face becomes {mesh.NbTriangles()} facets", _SIMPLER)
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
