"""A part as the contact floors see it: polyhedron, convex pieces, mating features, all in one body frame.

Planar parts as solids: a motion in the x, z plane, turning about y, taken to space without changing its contacts.

A fixed part is extruded along y. A moving part is a ridge: its profile at y = 0, drawn in towards both ends, so that in
planar motion it touches with the profile alone. A planar contact of a vertex with an edge is then one contact of a
vertex with a face, or of two crossing edges, not of two vertices at once; and as every point that touches lies at
y = 0, drift out of the plane moves no contact to first order. Two profiles overlap exactly when the solids do.
Lengths are in m.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from shapely import Polygon, get_parts
from shapely.geometry.polygon import orient

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import pieces, polyhedron
from fmopt.geometry.csg import Hull, Solid, Union, exact_pose, outline_turns, sagitta
from fmopt.geometry.exact_coordinates import Exact, exact_vertices, facing_directions
from fmopt.geometry.facets import place
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.polyhedron import Polyhedron, from_faces, levelled, placed, rounded, scaled, with_vertices
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value, frozen

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import Imported

_ELSEWHERE = 1.5  # times: how far facets are off faces in frames that fit a mesh to them by other measures
_SINGLE = 2e-8  # m: as far as that, numbers of single precision put facets off in parts of 200 mm
_FAR_END = 0.05  # of a feature's length: gaps no further from its far end than this are at its far rim

_ASIDE, _IN_PLANE = 1e-10, 1e-15  # m: planes are one up to here; vertices that are so near are in a plane
_MOVED = 1e-9  # m: how far coordinates may go to exact ones before anything rests on them
_DRAWN_IN = 0.25  # of the way to the centroid
_SAME_PLACE = 1e-9  # m
_ASKEW = np.array([0.3717, 0.2153, 0.9031])  # along no edge and across no face that people draw: it puts all in order


@dataclass(frozen=True, eq=False)
class Part(Value):
    """A part: its boundary, the convex pieces whose union it is, its features, and the sagitta of its curves in m.

    Balls beside the boundary are parts of it; `pieces` are what is bounded by faces, `bodies` all that it is made of.
    `notes` say what a user should know of an imported mesh, one statement each. The facets of its file lie up to `off`
    (m) from the boundary, at `where` (3,), m, in the numbers of the file. Of one that is `enclosed` pieces and boundary
    agree but for rounding, and go up to `larger` (m) beyond the file's surface.
    """

    name: str
    polyhedron: Polyhedron
    pieces: tuple[Polyhedron, ...]
    features: tuple[Feature, ...]
    chord_error: float
    notes: tuple[str, ...] = ()
    off: float = 0.0
    where: Array = field(default_factory=lambda: np.zeros(3))
    enclosed: bool = False
    larger: float = 0.0

    @property
    def form(self) -> float:
        """Its tolerance of form, m: how far the surface of the real part may lie from the boundary.

        What single precision leaves of numbers is none.
        """
        return _ELSEWHERE * self.off if self.off > _SINGLE else 0.0

    @cached_property
    def balls(self) -> tuple[Polyhedron, ...]:
        """The balls of the part, each as a body without faces."""
        whole = self.polyhedron
        return tuple(from_faces(whole.vertices[[n]], (), balls=((0, radius),)) for n, radius in whole.balls)

    @property
    def bodies(self) -> tuple[Polyhedron, ...]:
        """The convex bodies whose union the part is: its pieces, then its balls."""
        return (*self.pieces, *self.balls)

    def feature(self, name: str) -> Feature:
        """The feature of that name.

        Raises:
            GeometryError: there is none.
        """
        for feature in self.features:
            if feature.name == name:
                return feature
        known = ", ".join(feature.name for feature in self.features) or "none"
        raise GeometryError(f"part {self.name!r} has no feature {name!r}", f"its features: {known}")


def part_of(name: str, solid: Solid, features: Sequence[Feature] = ()) -> Part:
    """The part of a solid in its model frame, in which the features are as well.

    Raises:
        GeometryError: the solid is empty or has edges of no thickness.
    """
    return Part(name, polyhedron(solid), pieces(solid), tuple(features), sagitta(solid))


def with_balls(part: Part, balls: Sequence[tuple[ArrayLike, float]]) -> Part:
    """A part with exact balls besides (centre (3,) and radius, m), whose centres are the last vertices of its boundary.

    Raises:
        GeometryError: a radius is not positive, or two balls, or a ball and a corner, are in one place.
    """
    body = part.polyhedron
    centres = np.array([centre for centre, _ in balls], dtype=np.float64).reshape(-1, 3)
    points = np.vstack([body.vertices, centres])
    for n, (_, radius) in enumerate(balls, len(body.vertices)):
        if not radius > 0.0:
            raise GeometryError(
                f"a ball at {place(points[n])} has a radius of {radius:.3g} m", "give it a positive one"
            )
        if (np.linalg.norm(points[:n] - points[n], axis=1) <= _SAME_PLACE).any():
            raise GeometryError(
                f"a ball at {place(points[n])} is where a corner or another ball is", "move it a little"
            )
    rounds = tuple((len(body.vertices) + n, float(radius)) for n, (_, radius) in enumerate(balls))
    return replace(part, polyhedron=Polyhedron(points, body.faces, body.edges, rounds))


def mesh_part(
    name: str, mesh: "Imported", features: Sequence[Feature] = (), chord_error: float | None = None, few: float = np.inf
) -> Part:
    """The part of an imported mesh; it gets convex pieces by way of `mesh_solid.decomposed`.

    >>> from fmopt.geometry import csg, convex_pieces as pieces, polyhedron
    >>> from fmopt.geometry.mesh import mesh_import as mesh
    >>> bar = pieces.polyhedron(csg.Box((0.01, 0.01, 0.03)))
    >>> part = mesh_part("bar", mesh.mesh_polyhedron(bar.vertices, polyhedron.triangulated(bar)))
    >>> len(part.pieces), round(1e9 * part.polyhedron.volume)
    (1, 3000)

    Args:
        mesh, features: in the model frame.
        chord_error: how far the true curved surfaces lie from the mesh, m; the mesh's own estimate if not given.
        few: reflex edges; a mesh with more of them gets no convex pieces.

    Raises:
        GeometryError: the mesh has no convex pieces, or it is open at a mating face.
    """
    from fmopt.geometry.mesh.mesh_solid import decomposed

    if mesh.body.reflex > few:
        part = Part(name, mesh.body, (), tuple(features), 0.0, mesh.notes, mesh.off, mesh.where)
    else:
        cut = decomposed(mesh)
        notes = (*mesh.notes, *cut.notes)
        part = Part(name, cut.boundary, cut.pieces, tuple(features), 0.0, notes, mesh.off, mesh.where)
        part = replace(part, enclosed=cut.larger is not None, larger=cut.larger or 0.0)
    for feature in features:
        _require_intact(name, mesh, feature)
    true = mesh.chord_error if chord_error is None else chord_error
    return replace(part, chord_error=true, notes=tuple(f"warning: {name}: {note}" for note in part.notes))


def _require_intact(name: str, mesh: "Imported", feature: Feature) -> None:
    """Gaps of a mesh may lie in a face that is there beside them, or at the far end of a feature, where nothing mates.

    Raises:
        GeometryError: one reaches into the mating faces.
    """
    sign = -1.0 if feature.kind == "hollow" else 1.0
    for gap in mesh.mended:
        if gap.flush:
            continue
        depth = float(np.min(sign * feature.frame.inverse().apply(gap.corners)[:, 2]))
        if depth < (1.0 - _FAR_END) * feature.length:
            raise GeometryError(
                f"{mesh.kind} {name!r} is open beside triangle {gap.beside}, at {place(gap.corners[0])}, which is "
                f"{1e3 * depth + 0.0:.4g} mm along feature {feature.name!r} of {1e3 * feature.length:.4g} mm: its "
                "mating faces are not all there",
                "close the mesh in the program that made it; a gap may be left open at a feature's far end only",
            )


def rebased(part: Part, pose: Pose) -> Part:
    """The part expressed in the frame `pose` (given in the part's present frame), which becomes the origin."""
    inward = exact_pose(pose).inverse()
    bodies = tuple(rounded(placed(body, inward)) for body in (part.polyhedron, *part.pieces))
    if not np.all(np.isin(inward.R, (-1.0, 0.0, 1.0))):  # quarter turns keep equal coordinates equal
        bodies = levelled(bodies)
    features = tuple(replace(one, frame=pose.inverse().compose(one.frame)) for one in part.features)
    return replace(part, polyhedron=bodies[0], pieces=bodies[1:], features=features)


def in_order(part: Part) -> Part:
    """The part with its pieces and their corners and faces in an order that comes from where they are in its frame.

    Files name them in the order of the program that wrote them. A motion that is looked for among them one after
    another is then the same for a part however it came.
    """
    askew = _ASKEW / part.polyhedron.diameter
    pieces = sorted((_in_order(piece, askew) for piece in part.pieces), key=lambda piece: _rank(piece.vertices, askew))
    return replace(part, polyhedron=_in_order(part.polyhedron, askew), pieces=tuple(pieces))


def _in_order(body: Polyhedron, askew: Array) -> Polyhedron:
    """A body with its corners, then the centres of its balls, along a direction (3,), and its faces by their ranks."""
    points = body.vertices
    order = np.lexsort((points @ askew, body.radii > 0.0))  # the last key is the first to count
    number, faces = np.argsort(order), []
    for face in body.faces:
        loops = [np.roll(own, -own.argmin()).tolist() for own in (number[list(loop)] for loop in face.loops)]
        faces.append((_rank(points[list(face.vertices)], askew), [loops[0], *sorted(loops[1:])]))
    faces.sort(key=lambda face: face[0])
    balls = [(int(number[n]), radius) for n, radius in body.balls]
    return from_faces(points[order], [loops for _, loops in faces], balls=balls)


def _rank(corners: Array, askew: Array) -> float:
    """What puts figures (n, 3) in order; those with one middle, as symmetric parts have them, differ in it as well."""
    return float(np.exp(corners @ askew).mean())


def stretched(part: Part, factors: Sequence[float]) -> Part:
    """The part stretched along its axes by positive factors (3,), `rounded`; its features stay where they are."""
    return replace(
        part,
        polyhedron=rounded(scaled(part.polyhedron, factors)),
        pieces=tuple(rounded(scaled(piece, factors)) for piece in part.pieces),
        chord_error=max(factors) * part.chord_error,
        off=max(factors) * part.off,
        larger=max(factors) * part.larger,
    )


def settled(moving: Part, fixed: Part) -> tuple[Part, Part]:
    """Two parts with their vertices at the floats nearest to exact coordinates, facing faces exactly parallel.

    Both are in one frame, but for a shift. Rounded coordinates turn a face of 20 mm by 1e-13 off its own plane and off
    the face that comes to lie in it. What a motion is found for are then not quite the parts that a proof is about,
    which has exact ones.

    Raises:
        GeometryError: there are no exact coordinates within 1 nm of the floats.
    """
    if moving.enclosed or fixed.enclosed:  # nothing is proved of these
        return moving, fixed
    own = exact_vertices(moving.polyhedron, most=_MOVED)
    facing = facing_directions(moving.polyhedron, own, fixed.polyhedron, range(len(fixed.polyhedron.faces)))
    return _settled(moving, own), _settled(fixed, exact_vertices(fixed.polyhedron, facing, _MOVED))


def _settled(part: Part, exact: Mapping[int, Exact]) -> Part:
    """A part with some vertices of its boundary at exact coordinates, and its pieces with their faces in the part's."""
    body = part.polyhedron
    if exact:
        points = body.vertices.copy()
        for n, at in exact.items():
            points[n] = [float(x) for x in at]
        body = with_vertices(body, points + 0.0)
    moved = {before.tobytes(): after for before, after in zip(part.polyhedron.vertices, body.vertices, strict=True)}
    return replace(part, polyhedron=body, pieces=tuple(_in_planes(piece, body, moved) for piece in part.pieces))


def _in_planes(piece: Polyhedron, body: Polyhedron, moved: Mapping[bytes, Array]) -> Polyhedron:
    """A piece whose faces are in the planes of faces of a part's boundary `body` where they were but for rounding.

    A face of 2 mm that rounding turns is 1e-12 off 10 mm farther out, where a piece goes on behind it.
    """
    planes = list[tuple[Array, float]]()
    for face in piece.faces:
        corners = piece.vertices[list(face.vertices)]
        # Planes that look the other way are put a metre off, where none is near.
        off = np.abs(corners @ body.normals.T - body.offsets).max(axis=0) + (body.normals @ face.normal < 0.0)
        nearest = int(off.argmin())
        own = off[nearest] <= _ASIDE
        planes.append((body.normals[nearest], body.offsets[nearest]) if own else (face.normal, face.offset))
    points = piece.vertices.copy()
    for n, faces in enumerate(piece.vertex_faces):
        at = moved.get(piece.vertices[n].tobytes())
        N, c = np.array([planes[k][0] for k in faces]), np.array([planes[k][1] for k in faces])
        if at is not None:
            points[n] = at
        elif np.abs(N @ points[n] - c).max() > _IN_PLANE:
            points[n] += np.linalg.lstsq(N, c - N @ points[n], rcond=1e-6)[0]
    return piece if np.array_equal(points, piece.vertices) else with_vertices(piece, points + 0.0)


@dataclass(frozen=True, eq=False)
class Profiles(Value):
    """The planar parts of a problem in their mating frames, x across and z out of the hole, m.

    Args:
        moving: corners (n, 2) of the convex moving part, counter-clockwise.
        fixed: loops (k, 2) of the fixed part, outlines counter-clockwise, holes clockwise.
    """

    moving: Array
    fixed: tuple[Array, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "moving", frozen(self.moving, None, 2, name="moving profile"))
        object.__setattr__(self, "fixed", tuple(frozen(loop, None, 2, name="loop") for loop in self.fixed))


def slab(polygons: Sequence[ArrayLike]) -> Solid:
    """The union of convex polygons (k, 2) in x and z, extruded along y as far as they are wide, centred."""
    corners = [convex(polygon) for polygon in polygons]
    y = 0.5 * float(np.ptp(np.vstack(corners), axis=0).max())
    hulls = [Hull(tuple((float(x), side, float(z)) for side in (-y, y) for x, z in polygon)) for polygon in corners]
    return hulls[0] if len(hulls) == 1 else Union(tuple(hulls))


def ridge(polygon: ArrayLike) -> Solid:
    """A convex polygon (n, 2) in x and z at y = 0, drawn in by a quarter towards its centroid at both ends.

    It is as thick as the polygon is wide where it is narrowest.
    """
    corners = convex(polygon)
    y = 0.5 * width(corners)
    ends = (1.0 - _DRAWN_IN) * corners + _DRAWN_IN * corners.mean(axis=0)
    points = [(x, 0.0, z) for x, z in corners.tolist()]
    return Hull(tuple(points + [(x, side, z) for side in (-y, y) for x, z in ends.tolist()]))


def outline(polygons: Sequence[ArrayLike]) -> tuple[Array, ...]:
    """The loops (k, 2) of the union of convex polygons, outlines counter-clockwise, holes clockwise."""

    from fmopt.geometry.section import united

    whole = united([Polygon(convex(polygon)) for polygon in polygons])
    loops = []
    for part in get_parts(whole):
        turned = orient(part)
        loops += [frozen(ring.coords[:-1], None, 2) for ring in (turned.exterior, *turned.interiors)]
    return tuple(loops)


def convex(polygon: ArrayLike) -> Array:
    """The corners (n, 2) of a convex polygon.

    Raises:
        GeometryError: fewer than three corners, or not convex and counter-clockwise.
    """
    corners = frozen(polygon, None, 2, name="polygon")
    if len(corners) < 3:
        raise GeometryError(f"a polygon with {len(corners)} corners", "give at least three")
    turns = outline_turns(corners)
    if not np.all(turns > 1e-9) or turns.sum() > 7.0:  # once around is 6.28 rad
        k = int(np.argmin(turns))
        raise GeometryError(
            f"a polygon of a profile does not turn left at corner {k}",
            "list the corners of a convex polygon counter-clockwise, x to the right and z up; cut others into several",
        )
    return corners


def width(corners: Array) -> float:
    """The least width (m) of a convex polygon (n, 2)."""
    e = np.roll(corners, -1, axis=0) - corners
    n = np.column_stack([-e[:, 1], e[:, 0]]) / np.hypot(*e.T)[:, None]
    return float(np.ptp(n @ corners.T, axis=1).min())
