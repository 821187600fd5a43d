"""A part as the contact floors see it: polyhedron, convex pieces, mating features, all in one body frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Solid, exact_pose, sagitta
from fmopt.geometry.excess import MESH_NOISE, solid_of
from fmopt.geometry.features import Feature, in_frame
from fmopt.geometry.pieces import pieces, polyhedron
from fmopt.geometry.polyhedron import Polyhedron, placed, scaled
from fmopt.se3 import Pose
from fmopt.values import Value

_MESH_VOLUME = 1e-4  # of the volume


@dataclass(frozen=True, eq=False)
class Part(Value):
    """A part: its boundary, the convex pieces whose union it is, its features, and the sagitta of its curves in m."""

    name: str
    polyhedron: Polyhedron
    pieces: tuple[Polyhedron, ...]
    features: tuple[Feature, ...]
    chord_error: float

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
    """The part of a solid, in the solid's model frame.

    Raises:
        GeometryError: the solid is empty or has edges of no thickness.
    """
    return Part(name, polyhedron(solid), pieces(solid), tuple(features), sagitta(solid))


def mesh_part(name: str, body: Polyhedron, features: Sequence[Feature] = (), chord_error: float = 0.0) -> Part:
    """The part of an imported mesh; it gets exact convex pieces by way of `excess.solid_of`.

    Args:
        name: the part's name.
        body: as `load_mesh` returns it, in the model frame; noise below 1e-6 of its diameter is cleaned away.
        features: mating features in the model frame.
        chord_error: how far the true curved surfaces lie from the mesh, m; the file does not say.

    Raises:
        GeometryError: the mesh does not come apart into convex bodies.
    """
    solid = solid_of(body, MESH_NOISE * body.diameter)
    part = part_of(name, solid, features)
    if abs(part.polyhedron.volume - body.volume) > _MESH_VOLUME * body.volume:
        raise GeometryError(
            f"mesh {name!r} has {body.volume:.6g} m³, its convex pieces {part.polyhedron.volume:.6g} m³",
            "give one connected solid, or model it as a CSG solid",
        )
    return replace(part, chord_error=chord_error)


def rebased(part: Part, pose: Pose) -> Part:
    """The part expressed in the frame `pose` (given in the part's present frame), which becomes the origin."""
    inward = exact_pose(pose).inverse()
    return replace(
        part,
        polyhedron=placed(part.polyhedron, inward),
        pieces=tuple(placed(piece, inward) for piece in part.pieces),
        features=tuple(in_frame(feature, pose) for feature in part.features),
    )


def stretched(part: Part, factors: Sequence[float]) -> Part:
    """The part stretched along its axes by positive factors (3,); its features stay where they are."""
    return replace(
        part,
        polyhedron=scaled(part.polyhedron, factors),
        pieces=tuple(scaled(piece, factors) for piece in part.pieces),
        chord_error=max(factors) * part.chord_error,
    )
