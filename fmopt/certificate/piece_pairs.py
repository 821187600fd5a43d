"""Pairs of convex pieces, the contacts between them, and the planes that may keep them apart."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from fmopt.certificate.assembly import NEAR, Assembly
from fmopt.certificate.contact_implications import coming_off, facts
from fmopt.certificate.level_rims import edges_beside, level_rims
from fmopt.certificate.segment_linearisation import Piece
from fmopt.contact.primitive import PrimitiveContact
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.spatial.values import remembered

BEHIND = 1e-15  # m; how far in front of the fixed piece a free plane is put, against rounding
_MEMORY = 2048


@dataclass(frozen=True)
class PlaneWitness:
    """A plane between two pieces: along a face or edges, as vertex indices of pieces, or any plane of the B-frame."""

    kind: Literal["fixed-face", "moving-face", "edges", "plane"]
    moving: tuple[int, ...]
    fixed: tuple[int, ...]
    # For kind "plane" the unit normal (3) and the offset; the fixed piece lies behind it
    plane: tuple[float, float, float, float] | None = None


class Pair(NamedTuple):
    """A moving piece against a fixed one, with the contacts that bear on the two."""

    moving: Polyhedron
    fixed: Polyhedron
    held: tuple[PrimitiveContact, ...]
    opening: tuple[PrimitiveContact, ...]
    state: tuple[PrimitiveContact, ...]  # all contacts held, for a pair of which contacts say something; else none
    left: tuple[PrimitiveContact, ...]  # all contacts given up, for such a pair; else none
    # The contact being made that counts and those given up, wherever, for such a pair; else none
    beside: tuple[PrimitiveContact, ...]

    @property
    def touched(self) -> bool:
        """Whether a contact bears on the two."""
        return bool(self.held or self.opening)

    @property
    def told(self) -> bool:
        """Whether contacts say something of the two, which may be about features in the planes of those that touch."""
        return bool(self.state or self.left or self.beside)


@dataclass(frozen=True, eq=False)
class FacingPairs:
    """All pairs of a moving piece and a fixed one under the same contacts, by the numbers of both pieces.

    One for each contact state and what opens or closes: what is worked out of it once can be kept by its identity.
    """

    listed: tuple[tuple[int, int, Pair], ...]

    @cached_property
    def apart(self) -> tuple[tuple[Polyhedron, tuple[int, ...]], ...]:
        """For each moving piece the places in the list of its pairs that no contact touches."""
        found: dict[Polyhedron, list[int]] = {}
        for n, (_, _, pair) in enumerate(self.listed):
            if not pair.touched:
                found.setdefault(pair.moving, []).append(n)
        return tuple((piece, tuple(places)) for piece, places in found.items())


def facing(assembly: Assembly, piece: Piece) -> FacingPairs:
    """All pairs of convex pieces, moving and fixed, in order, with the contacts of a piece of motion."""
    return _facing(assembly, piece.held, (*piece.making, *piece.left), piece.left, piece.opening)


@remembered(_MEMORY)
def _facing(
    assembly: Assembly,
    held: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
    left: tuple[PrimitiveContact, ...],
    shown: tuple[PrimitiveContact, ...],
) -> FacingPairs:
    found = []
    for i, M in enumerate(assembly.moving.bodies):
        for j, F in enumerate(assembly.fixed.pieces):
            own, new = (touching(assembly, M, F, contacts) for contacts in (held, opening))
            told = bool(own or new) or (assembly.several and _in_walls(assembly, M, F, held, left, shown))
            known = (held, left, shown) if told else ((), (), ())
            found.append((i, j, Pair(M, F, own, new, *known)))
    return FacingPairs(tuple(found))


def _in_walls(
    assembly: Assembly,
    moving: Polyhedron,
    fixed: Polyhedron,
    held: tuple[PrimitiveContact, ...],
    left: tuple[PrimitiveContact, ...],
    opening: tuple[PrimitiveContact, ...],
) -> bool:
    """Whether contacts say something of two pieces that they do not touch themselves.

    A part that is not convex may touch a wall with one of its pieces and have others flush with it, or on its rim.
    """
    known, off = facts(assembly, held), coming_off(assembly, held, left)
    for normal, offset in zip(fixed.normals, fixed.offsets, strict=True):
        points = set(known.level_with(normal, offset).points)
        walls = [wall for wall in off if assembly.agree(wall.normal, wall.offset, normal, offset)]
        points.update(*(wall.points for wall in walls))
        near = assembly.body_points[sorted(points)]
        if points and (np.abs(moving.vertices[:, None] - near).max(axis=2) <= NEAR).any():
            return True
    if edges_beside(assembly, moving, fixed, held, opening):
        return True
    rims = level_rims(assembly, held, opening)
    planes = list(zip(moving.normals, moving.offsets, strict=True)) if rims else []
    return any(rim.before(fixed.vertices, *plane).any() for rim in rims for plane in planes)


def touching(
    assembly: Assembly, moving: Polyhedron, fixed: Polyhedron, contacts: Iterable[PrimitiveContact]
) -> tuple[PrimitiveContact, ...]:
    """The contacts that two pieces can have with each other: on a face plane or along an edge of each."""
    own, other = assembly.carried(moving), assembly.carried(fixed)
    kinds = ((c, c.kind.split("-")) for c in contacts)
    return tuple(c for c, (one, two) in kinds if (one, c.moving_feature) in own and (two, c.fixed_feature) in other)


def free_plane(normal: Sequence[float], offset: float) -> PlaneWitness:
    """The plane of a unit normal (3), out of a fixed piece, just in front of its farthest point, at an offset in m."""
    return PlaneWitness("plane", (), (), (normal[0], normal[1], normal[2], offset + BEHIND))
