"""Solids of the CAD kernel as designers draw them, in mm: from stated seeds, in any unit and place."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.geometry.csg import Hull
from fmopt.geometry.step.step_file import inside
from fmopt.spatial.se3 import Pose
from tests.shared.files.step_files import write_step

UNITS = {"mm": (".MILLI.,.METRE.", 1.0), "m": ("$,.METRE.", 1e-3), "inch": ("", 1.0 / 25.4)}


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    """A block of x by y by z, centred over `at`."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    return BRepPrimAPI_MakeBox(gp_Pnt(at[0] - 0.5 * x, at[1] - 0.5 * y, at[2]), x, y, z).Shape()


def cylinder(radius: float, height: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    """A cylinder along z, standing on `at`."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    return BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(*at), gp_Dir(0.0, 0.0, 1.0)), radius, height).Shape()


def cut(base: Any, *tools: Any) -> Any:
    """The base without the tools."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut

    for tool in tools:
        base = BRepAlgoAPI_Cut(base, tool).Shape()
    return base


def fuse(base: Any, *others: Any) -> Any:
    """All of them in one."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Fuse

    for other in others:
        base = BRepAlgoAPI_Fuse(base, other).Shape()
    return base


def eased(shape: Any, size: float, which: Callable[[np.ndarray, np.ndarray], bool], rounded: bool = False) -> Any:
    """The shape with a chamfer or fillet on the edges of which `which(first, last)` is true."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.BRepFilletAPI import BRepFilletAPI_MakeChamfer, BRepFilletAPI_MakeFillet

    made = (BRepFilletAPI_MakeFillet if rounded else BRepFilletAPI_MakeChamfer)(shape)
    for edge in {hash(edge): edge for edge in inside(shape, "EDGE")}.values():
        curve = BRepAdaptor_Curve(edge)
        ends = [curve.Value(at) for at in (curve.FirstParameter(), curve.LastParameter())]
        if which(*(np.array([end.X(), end.Y(), end.Z()]) for end in ends)):
            made.Add(size, edge)
    return made.Shape()


def at_height(z: float) -> Callable[[np.ndarray, np.ndarray], bool]:
    """Edges in the plane at a height."""
    return lambda a, b: abs(a[2] - z) < 1e-9 and abs(b[2] - z) < 1e-9


def upright(a: np.ndarray, b: np.ndarray) -> bool:
    """Edges along z."""
    return bool(np.linalg.norm((a - b)[:2]) < 1e-9 and np.linalg.norm(a - b) > 1e-9)


def prism(corners: np.ndarray, height: float, z: float = 0.0) -> Any:
    """The prism over a polygon (n, 2), from z up."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec

    return BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire(corners, z)).Face(), gp_Vec(0.0, 0.0, height)).Shape()


def loft(low: np.ndarray, high: np.ndarray, height: float, reverse: bool = False) -> Any:
    """The solid between two polygons (n, 2) with parallel sides, its walls free forms; made downwards if `reverse`."""
    from OCP.BRepOffsetAPI import BRepOffsetAPI_ThruSections

    made = BRepOffsetAPI_ThruSections(True, False)
    for corners, z in ((high, height), (low, 0.0)) if reverse else ((low, 0.0), (high, height)):
        made.AddWire(wire(corners, z))
    return made.Shape()


def wire(corners: Iterable[Iterable[float]], *z: float) -> Any:
    """A closed polygon (n, 3), or (n, 2) at a height."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakePolygon
    from OCP.gp import gp_Pnt

    outline = BRepBuilderAPI_MakePolygon()
    for corner in corners:
        outline.Add(gp_Pnt(*map(float, corner), *z))
    outline.Close()
    return outline.Wire()


def offset(corners: np.ndarray, gap: float) -> np.ndarray:
    """A convex polygon (n, 2), counter-clockwise, each side moved outward by a gap."""
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.hypot(*sides.T)[:, None]
    offsets = np.sum(normals * corners, axis=1) + gap
    count = len(corners)
    return np.array([np.linalg.solve(normals[[k - 1, k]], offsets[[k - 1, k]]) for k in range(count)])


def hull(sizes: np.ndarray) -> Hull:
    """The hull of rectangles (x, y) of given sizes at heights z, centred."""
    signs = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    return Hull(tuple((float(i * x), float(j * y), float(z)) for x, y, z in sizes for i, j in signs))


def key(r: np.random.Generator) -> Any:
    x, y, z = r.uniform((4.0, 4.0, 24.0), (12.0, 12.0, 32.0))
    return eased(box(x, y, z), 0.8, at_height(0.0))


def dowel(r: np.random.Generator) -> Any:
    radius, height = r.uniform(2.5, 7.5), r.uniform(20.0, 40.0)
    return eased(cylinder(radius, height), 0.8, at_height(0.0))


def d_shaft(r: np.random.Generator) -> Any:
    radius, height = r.uniform(3.0, 7.5), r.uniform(20.0, 40.0)
    return cut(cylinder(radius, height), box(radius, 30.0, r.choice([100.0, 0.4 * height]), (1.3 * radius, 0.0, 0.0)))


def plug(r: np.random.Generator) -> Any:
    x, y, z = r.uniform(10.0, 16.0, 3)
    return cut(box(x, y, z), box(x - 4.0, y - 4.0, z - 3.0, (0.0, 0.0, 3.0)))


def bracket(r: np.random.Generator) -> Any:
    x, y, z = r.uniform(15.0, 25.0, 3)
    return cut(box(x, y, z), box(x, y, z + 2.0, (6.0, 5.0, -1.0)))


def stepped(r: np.random.Generator) -> Any:
    one, other = np.sort(r.uniform(2.5, 7.5, 2))
    return fuse(cylinder(other + 0.5, 15.0), cylinder(one, 12.0, (0.0, 0.0, 15.0)))


def plate(r: np.random.Generator) -> Any:
    radius = r.uniform(3.0, 7.0)
    blind = cylinder(r.uniform(2.0, 4.0), 20.0, (12.0, 5.0, 4.0))
    return cut(box(44.0, 40.0, 10.0), cylinder(radius, 20.0, (-8.0, 0.0, -5.0)), blind)


def filleted(r: np.random.Generator) -> Any:
    x, y, z = r.uniform((10.0, 10.0, 25.0), (20.0, 20.0, 35.0))
    round_ = eased(box(x, y, z), r.uniform(1.0, 3.0), upright, rounded=True)
    return eased(round_, 0.5, at_height(z), rounded=True)


def pocket(r: np.random.Generator) -> Any:
    x, y = r.uniform(10.0, 18.0, 2)
    tool = eased(box(x, y, 20.0, (0.0, 0.0, 3.0)), r.uniform(0.8, 2.0), upright, rounded=True)
    return cut(box(44.0, 40.0, 10.0), tool)


def pin(r: np.random.Generator) -> Any:
    height = r.uniform(20.0, 30.0)
    return eased(cylinder(r.uniform(3.0, 7.0), height), 1.0, at_height(height), rounded=True)


FAMILIES = {each.__name__: each for each in (key, dowel, d_shaft, plug, bracket, stepped, plate, filleted, pocket, pin)}


def write(path: Path, shape: Any, unit: str = "mm", pose: Pose | None = None) -> None:
    """A STEP file of a shape, moved by a pose (mm), with its numbers in a unit."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Pnt, gp_Trsf

    words, scale = UNITS[unit]
    move, grow = gp_Trsf(), gp_Trsf()
    if pose is not None:
        move.SetValues(*(float(value) for row, p in zip(pose.R, pose.p, strict=True) for value in (*row, p)))
    grow.SetScale(gp_Pnt(0.0, 0.0, 0.0), scale)
    for each in (move, grow):
        shape = BRepBuilderAPI_Transform(shape, each, True).Shape()
    write_step(path, shape)
    text = path.read_text()
    if unit == "inch":
        metre = "#9001 = ( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.) );"
        inch = "#9002 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.0254),#9001);"
        size = "#9003 = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);"
        unit_of = "( CONVERSION_BASED_UNIT('INCH',#9002) LENGTH_UNIT() NAMED_UNIT(#9003) )"
        assert "#9001" not in text
        text = text.replace("( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )", unit_of)
        text = text.replace("ENDSEC;\nEND-ISO", f"{metre}\n{inch}\n{size}\nENDSEC;\nEND-ISO")
    else:
        text = text.replace(".MILLI.,.METRE.", words)
    path.write_text(text)


def planes(shape: Any) -> np.ndarray:
    """Outward unit normals and offsets (n, 4) in mm of the plane faces of a shape, as the kernel has them."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.TopAbs import TopAbs_Orientation

    found = []
    for face in inside(shape, "FACE"):
        surface = BRepAdaptor_Surface(face)
        if surface.GetType().name == "GeomAbs_Plane":
            frame = surface.Plane().Position()
            sign = -1.0 if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0
            sign *= 1.0 if frame.Direct() else -1.0
            n, p = frame.Direction(), frame.Location()
            normal = sign * np.array([n.X(), n.Y(), n.Z()])
            found.append([*normal, normal @ np.array([p.X(), p.Y(), p.Z()])])
    return np.array(found)


def volume(shape: Any) -> float:
    """mm³."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, found)
    return float(found.Mass())


def area(shape: Any) -> float:
    """mm²."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, found)
    return float(found.Mass())


def samples(shape: Any) -> np.ndarray:
    """Points (n, 3) on the curved faces of a shape that are rectangles of their parameters, mm."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    found = []
    for face in inside(shape, "FACE"):
        surface = BRepAdaptor_Surface(face)
        if surface.GetType().name != "GeomAbs_Plane":
            for u in np.linspace(surface.FirstUParameter(), surface.LastUParameter(), 23):
                for v in np.linspace(surface.FirstVParameter(), surface.LastVParameter(), 23):
                    point = surface.Value(float(u), float(v))
                    found.append([point.X(), point.Y(), point.Z()])
    return np.array(found)


def shell(shape: Any, left_out: int = 0) -> Any:
    """The faces of a shape, but for some, as a shell that bounds no solid."""
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Shell

    made, builder = TopoDS_Shell(), BRep_Builder()
    builder.MakeShell(made)
    for face in list(inside(shape, "FACE"))[left_out:]:
        builder.Add(made, face)
    return made


def write_assembly(path: Path, parts: list[tuple[str, Any, Pose]]) -> None:
    """A STEP file of named shapes, each in its place (mm)."""
    from OCP.gp import gp_Trsf
    from OCP.Message import Message
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
    document = TDocStd_Document(TCollection_ExtendedString("test"))
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    whole = tool.NewShape()
    TDataStd_Name.Set_s(whole, TCollection_ExtendedString("fit"))
    products: dict[str, Any] = {}
    for name, shape, pose in parts:
        if name not in products:
            products[name] = tool.AddShape(shape, False)
            TDataStd_Name.Set_s(products[name], TCollection_ExtendedString(name))
        move = gp_Trsf()
        move.SetValues(*(float(value) for row, p in zip(pose.R, pose.p, strict=True) for value in (*row, p)))
        tool.AddComponent(whole, products[name], TopLoc_Location(move))
    tool.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.Transfer(document)
    writer.Write(str(path))
