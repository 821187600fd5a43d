"""How a peg fits a hole whose frames do not agree about the axis: the turn with the most room, other centres and ends.

A peg turned so that one of its sides is parallel to a wall of the hole may fit; those turns are tried, and none at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fmopt.errors import GeometryError
from fmopt.geometry.clearance import Slice, facing, gap, overlap_shrunk
from fmopt.geometry.mating_features import Feature, other_ends, section_ring
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import Polyhedron, diameter, plane_basis
from fmopt.runtime.compiled import heed
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from shapely import MultiPolygon

_LARGEST = 3  # sides of the peg that are held against the walls
_WALLS = 64  # of the hole, the largest ones
_SAME = 1e-7  # rad: turns closer than this are one
_ONE = 1e-9  # of its length: centres of a feature that are closer are one
_AS_GOOD = 0.02  # of the clearance: turns that leave so little less are as good
_NEAR = 1e-9  # m: likewise, however small the clearance
_STEEP = 0.9  # upward part of a normal above which a face is no wall


@dataclass(frozen=True)
class Fit:
    """How a peg fits: turned by `turn` (rad) about the axis against the hole's frame it has `gap` (m) on each side.

    Negative gaps are by how much its section would have to shrink. Half the diagonal of that is `half_diagonal` (m).
    """

    turn: float
    gap: float
    half_diagonal: float


def best_fit(peg: Part, hole: Part, depth: float, turning: bool = True) -> Fit:
    """The turn of a peg about the axis that leaves the most room; of turns that are as good, the least.

    Args:
        peg: in the frame of its feature.
        depth: of the insertion, m.
        turning: whether to try any turn but none.

    Raises:
        GeometryError: peg or hole has no material at those depths.
    """
    from shapely import get_coordinates

    pairs = facing(peg, hole, depth)
    turns = [*_turns(peg, hole, depth)] if turning else [0.0]
    apart = [_distances(turn, pairs) for turn in turns]
    gaps = [min(distances) for distances in apart]
    if max(gaps) <= 0.0:  # how much too thick it is takes long to find
        best, gaps = -math.inf, []
        for turn in turns:
            gaps.append(_overlap(turn, pairs, _as_good(best)))
            best = max(best, gaps[-1])
    alike = [k for k, gap in enumerate(gaps) if gap >= _as_good(max(gaps))]
    chosen = min(alike, key=lambda k: (abs(turns[k]), -turns[k]))
    tightest, _ = pairs[int(np.argmin(apart[chosen]))]
    return Fit(turns[chosen], gaps[chosen], 0.5 * diameter(get_coordinates(tightest.shape)))


def goes_in(peg: Part, hole: Part, depth: float, turning: bool = True) -> bool:
    """Whether a peg has room in a hole at any turn about the axis.

    Raises:
        GeometryError: peg or hole has no material at those depths.
    """
    pairs = facing(peg, hole, depth)
    return any(min(_distances(turn, pairs)) > 0.0 for turn in (_turns(peg, hole, depth) if turning else (0.0,)))


def _as_good(gap: float) -> float:
    """The least gap that is as good, m."""
    return gap - max(_NEAR, _AS_GOOD * abs(gap))


def _distances(turn: float, pairs: Sequence[tuple[Slice, Slice]]) -> list[float]:
    """How far the sections of a peg that is turned are from those of the hole that they pass, m; 0 where they touch."""
    heed()
    return [float(_turned(peg, turn).distance(hole.shape)) for peg, hole in pairs]


def _overlap(turn: float, pairs: Sequence[tuple[Slice, Slice]], least: float) -> float:
    """The gap, m, of a peg that does not go in as it is turned; −∞ if it is less than `least`."""
    heed()
    found = 0.0
    for peg, hole in pairs:
        shape = _turned(peg, turn)
        # One look shows that it is worse than the best so far; how much too thick it is takes some thirty.
        if math.isfinite(least) and overlap_shrunk(shape, hole.shape, -least):
            return -math.inf
        if overlap_shrunk(shape, hole.shape, -found):
            found = gap(shape, hole.shape)
    return found


def _turned(section: Slice, turn: float) -> MultiPolygon:
    from shapely.affinity import rotate

    return rotate(section.shape, turn, (0.0, 0.0), use_radians=True)


def _turns(peg: Part, hole: Part, depth: float) -> Iterator[float]:
    """Turns of the peg to try, rad, 0 first."""
    sides = _headings(peg.polyhedron, (0.0, depth), outward=True)[:_LARGEST]
    walls = _headings(hole.polyhedron, (-depth, 0.0), outward=False)[:_WALLS]
    known = [0.0]
    yield 0.0
    for side in sides:
        for wall in walls:
            # A side looks against the wall that it is to face; the difference is taken to [−π, π).
            turn = turned_to((wall + math.pi - side + math.pi) % (2.0 * math.pi) - math.pi)
            if all(abs(turn - other) > _SAME for other in known):
                known.append(turn)
                yield turn


def turned_to(turn: float) -> float:
    """A turn as one says it: in (−π, π] rad, a whole number of degrees where it differs from that by rounding only."""
    degrees = round(math.degrees(turn))
    turn = math.radians(degrees) if abs(turn - math.radians(degrees)) <= _SAME else float(turn)
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
            # Rounded, so that sides of one size come in the order of their headings.
            found.append((-round(_area(corners), 12), math.atan2(across[1], across[0])))
    return np.array([heading for _, heading in sorted(found)])


def _area(corners: Array) -> float:
    arms = corners - corners[0]
    return 0.5 * float(np.linalg.norm(np.cross(arms[1:-1], arms[2:]).sum(axis=0)))


def other_frames(pieces: Sequence[Polyhedron], feature: Feature) -> Iterator[Pose]:
    """The frames of a found feature about the other points that may be taken for the centre of its section.

    Args:
        pieces: of its part, in the frame of the model.
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
    """
    for frame in other_ends(part.polyhedron, part.pieces, feature):
        yield frame
        yield from other_frames(part.pieces, replace(feature, frame=frame))


def require_near(fit: Fit, peg: str, hole: str) -> None:
    """Refuses a peg that is lost in its hole: no fit, but a wrong unit.

    Raises:
        GeometryError: there is more room on each side than the peg is wide.
    """
    if fit.gap > 2.0 * fit.half_diagonal:
        raise GeometryError(
            f"{hole!r} leaves {1e3 * fit.gap:.4g} mm on each side of {peg!r}, which is "
            f"{2e3 * fit.half_diagonal:.4g} mm across: no fit",
            "check the units of both files, and which features are to mate; or state [clearance] if that is meant",
        )
