"""The faces and edges of a solid as the surfaces and curves that the CAD kernel has for them, in mm.

Planes, cylinders, cones, spheres and tori, and free forms that are plane; a solid with any other surface is told
apart.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.GeomLib import GeomLib_IsPlanarSurface
from OCP.gp import gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS_Shape

from fmopt.geometry.step.step_file import Same, inside
from fmopt.spatial.values import Array

Kind = Literal["Plane", "Cylinder", "Cone", "Sphere", "Torus"]
REACH = 1e-6  # mm: between points of a file that are one
_TURNED = 1e-7  # rad: between directions that are one
_KINDS: tuple[Kind, ...] = ("Plane", "Cylinder", "Cone", "Sphere", "Torus")


class OtherSurfaceError(Exception):
    """The solid has surfaces, or edges between them, that have to be left to the kernel."""


@dataclass(frozen=True, eq=False)
class EdgeCurve:
    """An edge: the kernel's curve, from `first` to `last`; a circle's centre (3,), axes (3, 3), radius, mm."""

    curve: Any
    first: float
    last: float
    circle: tuple[Array, Array, float] | None
    closed: bool
    point_like: bool

    def at(self, parameter: float, across: float = 1.0) -> Array:
        """The point (3,) at a parameter of the kernel, rad on a circle, whose radius is multiplied by `across`."""
        if self.circle is None:
            return _xyz(self.curve.Value(parameter))
        centre, axes, radius = self.circle
        return np.asarray(centre + across * radius * (axes[:, :2] @ np.array([np.cos(parameter), np.sin(parameter)])))

    @property
    def ends(self) -> tuple[Array, Array]:
        """Its first and its last point (3,)."""
        return self.at(self.first), self.at(self.last)


@dataclass(frozen=True, eq=False)
class FaceSurface:
    """A face: its surface, with origin (3,), mm, and axes (3, 3) of its frame in columns; its parameters' ranges.

    `sign` is 1 where the surface's own normal points out of the solid, -1 where it points in.
    """

    kind: Kind
    origin: Array
    axes: Array
    radius: float
    tube: float
    slope: float
    sign: float
    u: tuple[float, float]
    v: tuple[float, float]
    rings: tuple[tuple[tuple[Same, bool], ...], ...] = ()
    edges: frozenset[Same] = field(default_factory=frozenset)

    def at(self, u: float, v: float, across: float = 1.0, along: float = 1.0) -> Array:
        """The point (3,), mm, at its parameters, the distance from its axis and from its profile's centre stretched.

        The kernel's u is about the axis, rad, its v along a straight profile, mm, or around a round one, rad.
        """
        if self.kind == "Cylinder":
            r, z = self.radius, v
        elif self.kind == "Cone":
            r, z = self.radius + v * np.sin(self.slope), v * np.cos(self.slope)
        else:
            middle = self.radius if self.kind == "Torus" else 0.0
            r, z = middle + along * self.tube * np.cos(v), along * self.tube * np.sin(v)
        return np.asarray(self.origin + self.axes @ np.array([across * r * np.cos(u), across * r * np.sin(u), z]))

    def normal(self, point: Array) -> Array:
        """The outward unit normal (3,) at a point of the surface."""
        x, y, z = (point - self.origin) @ self.axes
        rim = float(np.hypot(x, y))
        if self.kind == "Plane":
            local = np.array([0.0, 0.0, 1.0])
        elif self.kind == "Sphere":
            local = np.array([x, y, z])
        elif rim == 0.0:
            raise OtherSurfaceError("the tip of a cone")
        elif self.kind == "Cylinder":
            local = np.array([x, y, 0.0])
        elif self.kind == "Cone":
            local = np.array([x / rim * np.cos(self.slope), y / rim * np.cos(self.slope), -np.sin(self.slope)])
        else:
            local = np.array([x * (1.0 - self.radius / rim), y * (1.0 - self.radius / rim), z])
        local = local / np.linalg.norm(local)
        handed = float(np.sign(np.linalg.det(self.axes)))  # d/du × d/dv points the other way in left-handed frames
        return np.asarray(self.sign * handed * (self.axes @ local))

    def around(self, point: Array) -> float:
        """The angle u of a point (3,) about the axis, rad."""
        x, y, _ = (point - self.origin) @ self.axes
        return float(np.arctan2(y, x))

    def is_parallel(self, curve: EdgeCurve) -> bool:
        """Whether a curve runs around the axis at one height, a point of it on the axis included."""
        if curve.point_like:
            return True
        if curve.circle is None:
            return False
        centre, axes, _ = curve.circle
        axis, along = axes[:, 2], self.axes[:, 2]
        aside = np.cross(centre - self.origin, along)
        return bool(np.linalg.norm(np.cross(axis, along)) <= _TURNED and np.linalg.norm(aside) <= REACH)

    def is_meridian(self, curve: EdgeCurve) -> bool:
        """Whether a curve lies in a half-plane that the axis bounds."""
        points = np.array([curve.at(s) for s in np.linspace(curve.first, curve.last, 5)]) - self.origin
        flat = points @ self.axes[:, :2]
        far = flat[int(np.argmax(np.linalg.norm(flat, axis=1)))]
        size = float(np.linalg.norm(far))
        aside = np.abs(flat @ np.array([-far[1], far[0]])) / size if size > 0.0 else np.zeros(1)
        return bool(aside.max() <= REACH and (flat @ far).min() >= -REACH * size)


def read(solid: TopoDS_Shape) -> tuple[list[FaceSurface], dict[Same, EdgeCurve]]:
    """The faces of a solid, and its edges.

    Raises:
        OtherSurfaceError: one of them is no plane, cylinder, cone, sphere or torus.
    """
    curves: dict[Same, EdgeCurve] = {}
    surfaces = []
    for face in inside(solid, "FACE"):
        rings = tuple(tuple(_ring(wire, face)) for wire in inside(face, "WIRE"))
        own = frozenset(edge for ring in rings for edge, _ in ring)
        for edge in own - curves.keys():
            curves[edge] = _curve(edge.shape, face)
        surfaces.append(_surface(face, rings, own))
    return surfaces, curves


def _ring(wire: Any, face: Any) -> Iterator[tuple[Same, bool]]:
    """The edges of a wire in their order, and whether each runs forward."""
    explorer = BRepTools_WireExplorer(wire, face)
    found = 0
    while explorer.More():
        edge = explorer.Current()
        yield Same(edge), edge.Orientation() == TopAbs_Orientation.TopAbs_FORWARD
        found += 1
        explorer.Next()
    # The explorer leaves out what it cannot reach from where it is, without a word.
    if found != sum(1 for _ in inside(wire, "EDGE")):
        raise OtherSurfaceError("a wire that is not one loop")


def _surface(face: Any, rings: Any, own: frozenset[Same]) -> FaceSurface:
    adaptor = BRepAdaptor_Surface(face)
    kind = next((kind for kind in _KINDS if adaptor.GetType().name == f"GeomAbs_{kind}"), None)
    shape = plane_of(face) if kind is None else getattr(adaptor, kind)()
    if shape is None:
        raise OtherSurfaceError(adaptor.GetType().name)
    frame = shape.Position()
    sign = -1.0 if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0
    if kind is None:
        # The plane that the kernel finds looks to a side of its own choice.
        kind, sign = "Plane", sign * _agreement(adaptor, _columns(frame))
    radius = {"Cylinder": "Radius", "Cone": "RefRadius", "Torus": "MajorRadius"}.get(kind)
    tube = {"Sphere": "Radius", "Torus": "MinorRadius"}.get(kind)
    return FaceSurface(
        kind,
        _xyz(frame.Location()),
        _columns(frame),
        getattr(shape, radius)() if radius else 0.0,
        getattr(shape, tube)() if tube else 0.0,
        shape.SemiAngle() if kind == "Cone" else 0.0,
        sign,
        (adaptor.FirstUParameter(), adaptor.LastUParameter()),
        (adaptor.FirstVParameter(), adaptor.LastVParameter()),
        rings,
        own,
    )


def plane_of(face: Any) -> Any:
    """The kernel's plane that a face lies in, whatever its surface is called; None where it is curved.

    Lofts of straight sides are free forms in a file.
    """
    found = GeomLib_IsPlanarSurface(BRep_Tool.Surface_s(face), REACH)
    return found.Plan() if found.IsPlanar() else None


def _agreement(adaptor: Any, axes: Array) -> float:
    """1 where d/du × d/dv of a surface looks to the side that the cross product of the first two axes does, else -1."""
    u = 0.5 * (adaptor.FirstUParameter() + adaptor.LastUParameter())
    v = 0.5 * (adaptor.FirstVParameter() + adaptor.LastVParameter())
    along_u, along_v = gp_Vec(), gp_Vec()
    adaptor.D1(u, v, gp_Pnt(), along_u, along_v)
    return 1.0 if np.cross(_xyz(along_u), _xyz(along_v)) @ np.cross(axes[:, 0], axes[:, 1]) > 0.0 else -1.0


def _curve(edge: Any, face: Any) -> EdgeCurve:
    if BRep_Tool.Degenerated_s(edge):
        # It has no curve in space, only one in the parameters of its face.
        curve = BRepAdaptor_Curve(edge, face)
        return EdgeCurve(curve, curve.FirstParameter(), curve.LastParameter(), None, False, True)
    curve = BRepAdaptor_Curve(edge)
    circle = None
    if curve.GetType().name == "GeomAbs_Circle":
        shape = curve.Circle()
        circle = (_xyz(shape.Location()), _columns(shape.Position()), float(shape.Radius()))
    first, last = curve.FirstParameter(), curve.LastParameter()
    closed = bool(np.linalg.norm(_xyz(curve.Value(first)) - _xyz(curve.Value(last))) <= REACH)
    return EdgeCurve(curve, first, last, circle, closed, False)


def _columns(frame: Any) -> Array:
    return np.column_stack([_xyz(frame.XDirection()), _xyz(frame.YDirection()), _xyz(frame.Direction())])


def _xyz(made: Any) -> Array:
    return np.array([made.X(), made.Y(), made.Z()])
