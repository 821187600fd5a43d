"""The tables of a model file: a tree of named solids, a mesh or a profile, with parameters and features.

part = "part"                       the named solid that the model is
[parameters]  width = 20            plain numbers are lengths; angles are written "5 deg"
[solids.part] shape = "box"         size, at, turn: numbers, or arithmetic on parameters
[balls.tip]   radius = 5            exact balls that the part has besides
[profile] polygons = [[[0, 0], …]]  a part in the plane of x and z
[features.peg] kind = "solid"       a frame on the centre line and a length, after [LeeHuang1985] section 3
"""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from fmopt.task.toml.tables import (
    Coordinate,
    Distance,
    File,
    Length,
    Name,
    Rotation,
    Table,
    Title,
    Values,
    Vector,
    fault,
)

STEP = (".step", ".stp")


class ModelUnits(Table):
    """The units of the plain numbers of this file; what has its unit beside it needs none here."""

    length: Literal["m", "cm", "mm", "um", "in"] | None = None
    angle: Literal["rad", "mrad", "deg"] | None = None


class PlacedTable(Table):
    """Where a solid is put."""

    at: Vector = (0.0, 0.0, 0.0)
    """Where the solid's origin is put."""
    turn: Rotation = (0.0, 0.0, 0.0)
    """How it is turned about its origin first: a rotation vector (axis times angle)."""


class BoxTable(PlacedTable):
    """A cuboid centred in x and y, standing on z = 0."""

    shape: Literal["box"]
    size: tuple[Length, Length, Length]
    """Extents along x, y, z."""
    chamfer: Distance = 0.0
    """Leg of the 45° cut on the four upright edges."""


class TurnedTable(PlacedTable):
    """A solid of revolution, for which a polyhedron stands: by `sides` the inscribed one, or one by `sagitta`."""

    sides: Annotated[int, Field(ge=3, le=1998)] = 64  # and two ends: 2,000 faces are the most of a part
    """Corners around, on the true circles."""
    sagitta: Length | None = None
    """In place of `sides`: how far the polyhedron may lie from the round surface, on the safe side of it: around what
    is solid, inside what is taken away. A twentieth of the clearance a side, say, or less."""

    @model_validator(mode="after")
    def _one_of_both(self) -> "TurnedTable":
        if {"sides", "sagitta"} <= self.model_fields_set:
            raise fault("conflict", "both sides and sagitta are given", "give one of them")
        return self


class CylinderTable(TurnedTable):
    """A cylinder about z, standing on z = 0."""

    shape: Literal["cylinder"]
    radius: Length
    height: Length


class ConeTable(TurnedTable):
    """A truncated cone about z, standing on z = 0; one radius may be zero."""

    shape: Literal["cone"]
    radius_bottom: Distance
    radius_top: Distance
    height: Length


class SphereTable(PlacedTable):
    """A ball about its origin; the planner sees the inscribed polyhedron with `sides` meridians."""

    shape: Literal["sphere"]
    radius: Length
    sides: Annotated[int, Field(ge=3, le=62)] = 16
    """Meridians, and half as many bands; the polyhedron has up to about half the square of this many faces."""


Polygon: TypeAlias = Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=4096)]


class PrismTable(PlacedTable):
    """An upright prism over a simple polygon, convex or not, standing on z = 0."""

    shape: Literal["prism"]
    polygon: Polygon
    """Corners, counter-clockwise seen from above."""
    holes: Annotated[tuple[Polygon, ...], Field(max_length=64)] = ()
    """Polygons that go through it, counter-clockwise too."""
    height: Length


class Section(Table):
    """An outline of a stack."""

    at: Coordinate
    """Its height."""
    polygon: Polygon
    """Corners of a simple polygon, counter-clockwise seen from above."""


class StackTable(PlacedTable):
    """A stepped, tapered or chamfered part: outlines one above the other, walls straight from each to the next."""

    shape: Literal["stack"]
    sections: Annotated[tuple[Section, ...], Field(min_length=2, max_length=64)]
    """From below upwards. Neighbours at different heights have as many corners, in the same order, and parallel sides;
    two at one height are a step, where the outline may change."""


class WedgeTable(PlacedTable):
    """A box whose top is only `top_x` long: the face at negative x is upright, the opposite one leans."""

    shape: Literal["wedge"]
    size: tuple[Length, Length, Length]
    top_x: Distance


class HullTable(PlacedTable):
    """The convex hull of points."""

    shape: Literal["hull"]
    points: Annotated[tuple[Vector, ...], Field(min_length=4, max_length=4096)]


class UnionTable(PlacedTable):
    """The union of named solids."""

    shape: Literal["union"]
    of: Annotated[tuple[Name, ...], Field(min_length=1, max_length=256)]


class DifferenceTable(PlacedTable):
    """A named solid without others."""

    shape: Literal["difference"]
    of: Name
    minus: Annotated[tuple[Name, ...], Field(min_length=1, max_length=256)]


Primitive: TypeAlias = (
    BoxTable | CylinderTable | ConeTable | SphereTable | PrismTable | StackTable | WedgeTable | HullTable
)
Shape: TypeAlias = Primitive | UnionTable | DifferenceTable
Solids: TypeAlias = Annotated[dict[Name, Annotated[Shape, Field(discriminator="shape")]], Field(max_length=100)]


class BallTable(Table):
    """An exact ball that the part has besides its solids, which it may reach into: no facets stand for it."""

    at: Vector
    """Its centre."""
    radius: Length


class Mesh(Table):
    """A closed triangle mesh, or a STEP file, in place of solids."""

    file: File
    """STL, OBJ, PLY, 3MF or GLB file, or STEP with the extra of that name, relative to this model file."""
    unit: Literal["m", "cm", "mm", "um", "in"] | None = None
    """Unit of the numbers in a mesh file, which does not say it itself. STEP, 3MF and GLB do: leave it out there."""
    body: Annotated[str, Field(min_length=1, max_length=200)] | Annotated[int, Field(ge=1, le=10_000)] | None = None
    """Which body of a STEP file, or object of an OBJ file, that holds several: its name, or its number, counted from 1.
    That of a STEP file is then in its product's own frame, as if its part had been exported alone."""
    deviation: Distance | None = None
    """How far curved surfaces lie from the facets that stand for them, which adds to the errors of the start.
    Estimated from the facets if not given; curved faces of a STEP file are faceted as finely as this, 0.01 mm if not
    given, and plane ones are exact."""

    @property
    def is_step(self) -> bool:
        """Whether it is a STEP file, which says its unit itself."""
        return self.file.lower().endswith(STEP)


class ProfileTable(Table):
    """A part that moves in a plane only, in place of solids: convex polygons in x and z whose union it is."""

    polygons: Annotated[
        tuple[Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=1000)], ...],
        Field(min_length=1, max_length=256),
    ]
    """Each counter-clockwise, x to the right and z up; one for a moving part."""


class MatingFeature(Table):
    """A peg (solid) or hole (hollow) that can mate, with its frame on the centre line; found where it is not given."""

    kind: Literal["solid", "hollow"]
    at: Vector | None = None
    """Solid: centre of the leading end face. Hollow: centre of the mouth. Found with `turn` if not given."""
    turn: Rotation = (0.0, 0.0, 0.0)
    """Rotation vector; z then points out of the mouth (hollow), or from the leading end back into the part (solid)."""
    length: Length | None = None
    """Depth of the hole, or length of the peg; found, with `through`, if not given."""
    through: bool = False
    """Whether a hole is open at both ends."""
    classification: Name | None = None
    """Class of features to list it in, such as holes or slots; holes or pegs, by its kind, if not given."""
    solids: Annotated[tuple[Name, ...], Field(min_length=1, max_length=256)] | None = None
    """Named solids that it is made of: what a hole takes away, or a peg adds; found on its axis if not given."""

    @property
    def is_whole(self) -> bool:
        """Whether its place and its length are known."""
        return self.at is not None and self.length is not None


class ModelFile(Table):
    """A part for fmopt: a tree of solids (or a mesh, or a profile), parameters, and mating features."""

    name: Name = ""
    """What the part is called; as its file if not given."""
    description: Title = "a part"
    units: ModelUnits = Field(default_factory=ModelUnits)
    parameters: Values = Field(default_factory=dict)
    """Named quantities for use in expressions; plain numbers are lengths. Later ones may use earlier ones."""
    part: Name | None = None
    """The solid that the part is."""
    solids: Solids = Field(default_factory=dict)
    """Named solids; an instance may be used several times."""
    balls: Annotated[dict[Name, BallTable], Field(max_length=16)] = Field(default_factory=dict)
    """Exact balls of the part besides its solids, by name: of what moves, such as the tip of a ball-ended pin."""
    mesh: Mesh | None = None
    """A mesh file in place of solids."""
    profile: ProfileTable | None = None
    """The profile of a part in the plane, in place of solids."""
    features: Annotated[dict[Name, MatingFeature], Field(max_length=64)] = Field(default_factory=dict)
    """Mating features by name; found if there are none: peg and hole, or hole_1, hole_2 and so on. A profile states
    them."""
