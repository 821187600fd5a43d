"""How a peg fits a hole whose frames do not agree about the axis: the turn with the most room, other centres and ends.

A peg turned so that one of its sides is parallel to a wall of the hole may fit; those turns are tried, and none at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import turned_room
from fmopt.geometry.mating_features import Feature, other_ends, section_ring
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron, plane_basis
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

_LARGEST = 3  # sides of the peg that are held against the walls
_WALLS = 64  # of the hole, the largest ones
_SAME = 1e-7  # rad: turns closer than this are one
_ONE = 1e-9  # of its length: centres of a feature that are closer are one
_AS_GOOD = 0.02  # of the clearance: turns that leave so little less are as good
_STEEP = 0.9  # upward part of a normal above which a face is no wall


@dataclass(frozen=True)
class Fit:
    """How a peg fits: turned by `turn` (rad) about the axis against the hole's frame it has `gap` (m) on each side.

    Negative gaps are by how much its section would have to shrink.
    """

    turn: float
    gap: float
    half_diagonal: float


def best_fit(peg: Part, hole: Part, depth: float, turning: bool = True) -> Fit:
    """The turn of a peg about the axis that leaves the most room; of turns that are as good, the least.

    Args:
        peg: in the frame of its feature.
        hole: likewise.
        depth: of the insertion, m.
        turning: whether to try any turn but none.

    Raises:
        GeometryError: peg or hole has no material at those depths.
    """
    turns = [*_turns(peg, hole, depth)] if turning else [0.0]
    fits = [Fit(turn, *room) for turn, room in zip(turns, turned_room(peg, hole, depth, turns), strict=True)]
    best = max(fit.gap for fit in fits)
    alike = [fit for fit in fits if fit.gap >= best - max(1e-9, _AS_GOOD * abs(best))]
    return min(alike, key=lambda fit: (abs(fit.turn), -fit.turn))


def _turns(peg: Part, hole: Part, depth: float) -> Iterator[float]:
    """Turns of the peg to try, rad, 0 first."""
    sides = _headings(peg.polyhedron, (0.0, depth), outward=True)[:_LARGEST]
    walls = _headings(hole.polyhedron, (-depth, 0.0), outward=False)[:_WALLS]
    known = [0.0]
    yield 0.0
    for side in sides:
        for wall in walls:
            turn = turned_to((wall + math.pi - side + math.pi) % (2.0 * math.pi) - math.pi)
            if all(abs(turn - other) > _SAME for other in known):
                known.append(turn)
                yield turn


def turned_to(turn: float) -> float:
    """A turn as one says it: in (−π, π] rad, a whole number of degrees where it differs from that by rounding only."""
    degrees = round(math.degrees(turn))
    turn = math.radians(degrees) if abs(turn - math.radians(degrees)) <= _SAME else turn
    return turn + 2.0 * math.pi if turn <= -math.pi else turn


def _headings(body: Polyhedron, window: tuple[float, float], outward: bool) -> Array:
    """Where the walls around the z axis look, rad, between two heights, the largest first.

    `outward`: those that look away from the axis, else those that look towards it.
    """
    found = []
    for face in body.faces:
        across = face.normal[:2]
        corners = body.vertices[list(face.loops[0])]
        low, high = corners[:, 2].min(), corners[:, 2].max()
        if abs(face.normal[2]) > _STEEP or min(high, window[1]) - max(low, window[0]) <= 0.0:
            continue
        away = float(across @ corners[:, :2].mean(axis=0))
        if (away > 0.0) == outward and away != 0.0:
            found.append((-round(_area(corners), 12), math.atan2(across[1], across[0])))
    return np.array([heading for _, heading in sorted(found)])


def _area(corners: Array) -> float:
    arms = corners - corners[0]
    return 0.5 * float(np.linalg.norm(np.cross(arms[1:-1], arms[2:]).sum(axis=0)))


def other_frames(pieces: Sequence[Polyhedron], feature: Feature) -> Iterator[Pose]:
    """The frames of a found feature about the other points that may be taken for the centre of its section.

    Args:
        pieces: of its part, in the frame of the model.
        feature: as it was found.
    """
    from shapely.geometry.polygon import orient

    from fmopt.geometry.centre import centres

    frame, hollow = feature.frame, feature.kind == "hollow"
    z = frame.R[:, 2]
    ring = section_ring(pieces, frame.p, z, (-0.5 if hollow else 0.5) * feature.length, hollow)
    if ring is not None:
        basis = plane_basis(z)
        for point in centres(np.array(orient(ring).exterior.coords)[:-1]):
            if float(np.linalg.norm(point)) > _ONE * feature.length:
                yield Pose(frame.p + basis @ point, frame.R)


def frames_from_beyond(part: Part, feature: Feature) -> Iterator[Pose]:
    """The frames of a found feature that leads by its other end, about all points that may be taken for its centre.

    Args:
        part: in the frame of its model.
        feature: of the part, as it was found.
    """
    for frame in other_ends(part.polyhedron, part.pieces, feature):
        yield frame
        yield from other_frames(part.pieces, replace(feature, frame=frame))


def require_near(fit: Fit, peg: str, hole: str) -> None:
    """Refuses a peg that is lost in its hole: no fit, but a wrong unit.

    Args:
        fit: of the two.
        peg, hole: what they are called, for the message.

    Raises:
        GeometryError: there is more room on each side than the peg is wide.
    """
    if fit.gap > 2.0 * fit.half_diagonal:
        raise GeometryError(
            f"{hole!r} leaves {1e3 * fit.gap:.4g} mm on each side of {peg!r}, which is "
            f"{2e3 * fit.half_diagonal:.4g} mm across: no fit",
            "check the units of both files, and which features are to mate; or state [clearance] if that is meant",
        )
