"""The solid of an imported mesh as convex pieces: exact ones, or bodies that enclose what is curved."""

from contextlib import suppress
from dataclasses import dataclass

from fmopt.errors import GeometryError
from fmopt.geometry.convex_pieces import pieces, volume
from fmopt.geometry.csg import Difference, Hull, Moved, Solid, Union, exact_pose
from fmopt.geometry.enclosing import Enclosure, enclosing
from fmopt.geometry.facets import MOST_REFLEX, place, require_few
from fmopt.geometry.inverse_csg import MESH_NOISE, apart
from fmopt.geometry.mesh.mesh_import import TOLD, Imported
from fmopt.geometry.polyhedron import Polyhedron, convex_hull_polyhedron, placed, triangulated
from fmopt.runtime.store import kept
from fmopt.spatial.values import Value, remembered

_VOLUME = 1e-4  # of the volume, by which pieces may be off


@dataclass(frozen=True, eq=False)
class Decomposed(Value):
    """A mesh as convex pieces."""

    solid: Solid  # that they are, the convex hull less others
    boundary: Polyhedron  # of the solid, m
    pieces: tuple[Polyhedron, ...]  # whose union it is
    notes: tuple[str, ...] = ()  # what was done
    larger: float | None = None  # by how much they go beyond it, m, where they are bodies of an enclosure


@remembered(1)
def decomposed(mesh: Imported) -> Decomposed:
    """The convex pieces of a mesh by way of `inverse_csg.apart`; bodies that enclose it where it does not come apart.

    Raises:
        GeometryError: it is too thin for that.
    """
    body, noise = mesh.body, mesh.noise
    depends = body.vertices.tobytes(), [face.loops for face in body.faces], noise
    return kept(depends, lambda: _decomposed(body, noise))


def _decomposed(body: Polyhedron, noise: float | None) -> Decomposed:
    with suppress(GeometryError):  # of too many faces or reflex edges, or pieces that do not make it up
        if noise is None:
            return _exact(body)
    enclosure = enclosing(body.vertices, triangulated(body), noise or 0.0)
    solid, notes = _less_others(enclosure), _enclosure_notes(enclosure)
    return Decomposed(solid, enclosure.boundary, enclosure.bodies, notes, enclosure.off)


def _exact(body: Polyhedron) -> Decomposed:
    require_few(len(body.faces))
    if body.reflex > MOST_REFLEX:
        raise GeometryError(f"{body.reflex} reflex edges are too many")
    solid, boundary = apart(body, MESH_NOISE * body.diameter)
    if abs((found := volume(solid)) - boundary.volume) > _VOLUME * boundary.volume:
        raise GeometryError(f"it has {boundary.volume:.6g} m³, its convex pieces {found:.6g} m³")
    return Decomposed(solid, boundary, _upright_pieces(solid))


def _upright_pieces(solid: Solid) -> tuple[Polyhedron, ...]:
    """The pieces of a solid, cut in its own frame, where many coordinates are one: that takes a tenth of the time."""
    if isinstance(solid, Moved):
        return tuple(placed(piece, exact_pose(solid.pose)) for piece in pieces(solid.solid))
    return pieces(solid)


def _less_others(enclosure: Enclosure) -> Solid:
    """The convex hull of an enclosure less what it does not fill."""
    outer = Hull(convex_hull_polyhedron(enclosure.boundary.vertices).vertices.tolist())
    whole = tuple(Hull(body.vertices.tolist()) for body in enclosure.bodies)
    return outer if len(whole) == 1 else Difference(outer, (Difference(outer, (Union(whole),)),))


def _enclosure_notes(enclosure: Enclosure) -> tuple[str, ...]:
    if enclosure.off <= TOLD:
        return ()
    count = len(enclosure.bodies)
    by = "a convex body" if count == 1 else f"{count} convex bodies"
    return (
        f"it is enclosed by {by}, which makes it up to {1e6 * enclosure.off:.3g} µm larger, most at "
        f"{place(enclosure.where)}, and nowhere smaller",
    )
