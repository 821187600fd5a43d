"""What a STEP file holds, inside the process that reads it: its bodies, each with its name and its place.

Written for whichever CAD kernel is installed: names that its versions spell differently are asked for in one place.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.gp import gp_Pnt, gp_Trsf
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Message import Message
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_ChildIterator, TDF_Label
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from fmopt.errors import GeometryError
from fmopt.geometry.body_names import told_apart
from fmopt.geometry.step import AGAIN
from fmopt.spatial.values import Array

_NAMELESS = ("", "solid", "compound", "shell", "none", "body", "part", "unnamed")  # what programs call what has no name
_WRITER = "Open CASCADE STEP translator"  # how the kernel calls products that have no name
_SAME = 1e-9  # between a placement and a rigid one


@dataclass(frozen=True, eq=False)
class PlacedSolid:
    """A solid of the file in its product's own frame, and the place (3, 4) of that frame in the file, mm."""

    name: str
    solid: TopoDS_Shape
    place: Array


@dataclass(frozen=True, eq=False)
class Same:
    """A shape as a key: equal to itself seen from either side."""

    shape: Any

    def __hash__(self) -> int:
        return hash(self.shape)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and bool(self.shape.IsSame(other.shape))


def solids(path: str) -> list[PlacedSolid]:
    """The bodies of a STEP file, in its order, lengths in mm; names are different, "" of a body that has none.

    Raises:
        GeometryError: unreadable, without a unit, or without a solid.
    """
    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
    document = TDocStd_Document(TCollection_ExtendedString("fmopt"))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    if reader.ReadFile(path) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.Transfer(document):
        raise GeometryError("it is no readable STEP file", "export it again, as AP203, AP214 or AP242")
    whole = [
        label
        for label in _children(XCAFDoc_DocumentTool.ShapesLabel_s(document.Main()))
        if XCAFDoc_ShapeTool.IsFree_s(label)
    ]
    found = [body for label in whole for body in _bodies(label, "", np.eye(4))]
    if not found:
        raise GeometryError(*_without_solids([XCAFDoc_ShapeTool.GetShape_s(label) for label in whole]))
    # Without one the kernel reads on in a unit of its own choice.
    if b"LENGTH_UNIT" not in Path(path).read_bytes():
        raise GeometryError("it does not say the unit of its lengths", AGAIN)
    names = told_apart([body.name for body in found])
    return [replace(body, name=name) for body, name in zip(found, names, strict=True)]


def inside(shape: TopoDS_Shape, kind: str) -> Iterator[Any]:
    """The parts of a shape of one kind, "SOLID", "SHELL", "FACE", "WIRE", "EDGE" or "VERTEX", as what they are."""
    explorer = TopExp_Explorer(shape, getattr(TopAbs_ShapeEnum, f"TopAbs_{kind}"))
    while explorer.More():
        yield cast(explorer.Current(), kind)
        explorer.Next()


def cast(shape: TopoDS_Shape, kind: str) -> Any:
    """The shape as what it is; versions of the kernel call that Face_s or Face."""
    name = kind.capitalize()
    return getattr(TopoDS, f"{name}_s" if hasattr(TopoDS, f"{name}_s") else name)(shape)


def whole(solid: TopoDS_Shape) -> TopoDS_Shape:
    """The solid with faces and edges united that are one surface or one curve, such as the halves of a cylinder."""
    # Edges and faces are united; the last flag, for free forms that join smoothly, is off.
    united = ShapeUpgrade_UnifySameDomain(solid, True, True, False)
    united.Build()
    found = list(inside(united.Shape(), "SOLID"))
    return found[0] if len(found) == 1 else solid


def _bodies(label: TDF_Label, instance: str, place: Array) -> Iterator[PlacedSolid]:
    """The solids under a label of the document: a product, an assembly of products, or a product in its place."""
    if XCAFDoc_ShapeTool.IsReference_s(label):
        product = TDF_Label()
        XCAFDoc_ShapeTool.GetReferredShape_s(label, product)
        move, own = XCAFDoc_ShapeTool.GetLocation_s(label).Transformation(), np.eye(4)
        own[:3] = [[move.Value(i, j) for j in range(1, 5)] for i in range(1, 4)]
        yield from _bodies(product, _name(label) or instance, place @ own)
    elif XCAFDoc_ShapeTool.IsAssembly_s(label):
        for child in _children(label):
            if XCAFDoc_ShapeTool.IsReference_s(child):
                yield from _bodies(child, _name(label) or instance, place)
    else:
        if abs(np.linalg.det(place[:3, :3]) - 1.0) > _SAME:
            raise GeometryError("it places a body mirrored or scaled", "export the bodies as they are, each by itself")
        for solid in inside(XCAFDoc_ShapeTool.GetShape_s(label), "SOLID"):
            yield PlacedSolid(_name(label) or instance, solid, place[:3])


def _children(label: TDF_Label) -> Iterator[TDF_Label]:
    children = TDF_ChildIterator(label)
    while children.More():
        yield children.Value()
        children.Next()


def _name(label: TDF_Label) -> str:
    """The name at a label, "" where it is one that a program gives by itself."""
    found = TDataStd_Name()
    if not label.FindAttribute(TDataStd_Name.GetID_s(), found):
        return ""
    name: str = " ".join(found.Get().ToExtString().split())
    return "" if name.lower() in _NAMELESS or name.isdigit() or name.startswith(_WRITER) else name


def openings(shapes: list[TopoDS_Shape]) -> str:
    """Where shapes are open: how many edges have a face on one side only, and where the first runs; "" if none is."""
    count: Counter[Same] = Counter()
    for shape in shapes:
        for face in inside(shape, "FACE"):
            # The edge at the pole of a sphere has one face, and is no opening.
            count.update(Same(edge) for edge in inside(face, "EDGE") if not BRep_Tool.Degenerated_s(edge))
    loose = [edge for edge, times in count.items() if times == 1]
    if not loose:
        return ""
    curve = BRepAdaptor_Curve(loose[0].shape)
    ends = [curve.Value(at) for at in (curve.FirstParameter(), curve.LastParameter())]
    run = " to ".join(f"({end.X():.4g}, {end.Y():.4g}, {end.Z():.4g}) mm" for end in ends)
    return f"{len(loose)} edges have a face on one side only, the first from {run}"


def _without_solids(shapes: list[TopoDS_Shape]) -> tuple[str, str]:
    """What a file without solids holds, and what to do."""
    faces = sum(1 for shape in shapes for _ in inside(shape, "FACE"))
    if not faces:
        return "it holds no solids", "export the solid, not its surfaces"
    where = openings(shapes)
    what = f"it holds {faces} faces that bound no solid"
    if where:
        return f"{what}: {where}", "close the surface where it was made, and export the solid"
    return what, "they close: export them as a solid, not as surfaces"


def write(path: Path, shapes: list[TopoDS_Shape], scale: float = 1.0) -> None:
    """Writes shapes (mm, after scaling) to a STEP file, the kernel silent meanwhile.

    The scale is 1000 for shapes in m.

    Raises:
        GeometryError: the kernel cannot write them.
    """
    move = gp_Trsf()
    move.SetScale(gp_Pnt(0.0, 0.0, 0.0), scale)
    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        writer = STEPControl_Writer()
        for shape in shapes:
            # A copy, as the shape is the user's.
            scaled = shape if scale == 1.0 else BRepBuilderAPI_Transform(shape, move, True).Shape()
            writer.Transfer(scaled, STEPControl_StepModelType.STEPControl_AsIs)
        done = writer.Write(str(path))
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)
    if done != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise GeometryError("the CAD kernel cannot write the shape", "give one solid")
