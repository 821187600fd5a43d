"""Basic planar contacts, the orientations at which they are possible, and their C-surface values."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from fmopt.papers.basanez_suarez.edge import TurnedEdge
from fmopt.papers.basanez_suarez.gap import segment_arc_gap
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.reach import Reach
from fmopt.papers.basanez_suarez.sources import Deviations
from fmopt.papers.basanez_suarez.vertex import ArcSum, arc_support
from fmopt.spatial.values import Array, Bits, Value

FULL = 2.0 * math.pi


class ContactType(StrEnum):
    """Type 1: a vertex of the grasped object on a static edge. Type 2: an edge of it on a static vertex."""

    TYPE_1 = "type-1"
    TYPE_2 = "type-2"


@dataclass(frozen=True)
class Range:
    """Orientations φ from `low` on, counter-clockwise to `high`, rad; all of them when that is a full turn."""

    low: float
    high: float

    def contains(self, phi: ArrayLike) -> Bits:
        """Whether φ (…), at any number of turns, lies in the range, to 1e-12 rad."""
        ahead = np.mod(np.asarray(phi, dtype=np.float64) - self.low + 1e-12, FULL)
        return np.asarray(ahead <= self.high - self.low + 2e-12)


@dataclass(frozen=True, eq=False)
class CU(Value, edge=(2, 2), vertex=(2,)):
    """CU of a basic contact: all configurations (p_x, p_y, φ) at which deviations may bring it about.

    At each orientation of `range`, eq. (34) or (45), it is the set CUl.

    Args:
        moving: index of the grasped object's vertex (type 1) or edge (type 2).
        static: index of the static object's edge (type 1) or vertex (type 2).
        edge: ends (2, 2) of the edge, m, a static one in the world, one of the grasped object in its frame.
        vertex: (2,), m, likewise.
        nominal: orientations at which it is possible without uncertainty; None when only deviations make it possible.
        spread: ε_φrφg, rad.
        radius: ε_prpgv + ε_a, m.
    """

    kind: ContactType
    moving: int
    static: int
    edge: Array
    vertex: Array
    range: Range
    nominal: Range | None
    spread: float
    radius: float

    @property
    def name(self) -> str:
        """The contact in a few letters, the grasped object's feature first."""
        one, other = ("v", "e") if self.kind is ContactType.TYPE_1 else ("e", "v")
        return f"{one}{self.moving}-{other}{self.static}"

    @property
    def reach(self) -> float:
        """Greatest distance of the grasped object's feature from the reference point, m."""
        points = self.vertex[None] if self.kind is ContactType.TYPE_1 else self.edge
        # The farthest point of the grasped object's feature: a turn moves no other point of it more.
        return float(np.hypot(*points.T).max())

    def at(self, phi: float) -> ArcSum | TurnedEdge:
        """CUl at φ (rad), eqs. (20)-(30) or (38)-(41): reference points (m) that may make the contact."""
        if self.kind is ContactType.TYPE_1:
            polar = Reach.of(self.vertex)
            return ArcSum(self.edge[0], self.edge[1], polar.h, phi + polar.gamma + math.pi, self.spread, self.radius)
        # The edge is the grasped object's, seen from the vertex it touches: hence turned, and with its sign changed.
        c, s = math.cos(phi), math.sin(phi)
        start, end = -self.edge @ np.array([[c, -s], [s, c]]).T
        return TurnedEdge(self.vertex, start, end, self.spread, self.radius)

    def point_contact(self, phi: float, k: float) -> ArcSum:
        """CUv of a type-1 contact at φ (rad) with the point of the static edge at k ∈ [0, 1], eqs. (20)-(24)."""
        if self.kind is not ContactType.TYPE_1:
            raise ValueError("CUv belongs to a vertex of the grasped object, hence to a type-1 contact")
        # One point of the edge in place of all.
        a, polar = self.edge[0] + k * (self.edge[1] - self.edge[0]), Reach.of(self.vertex)
        return ArcSum(a, a, polar.h, phi + polar.gamma + math.pi, self.spread, self.radius)

    def gap(self, poses: ArrayLike) -> Array:
        """Distance (…) in m, within the plane of its φ, of poses (…, 3) from CU; negative inside by what is left of
        the radius; ∞ at orientations outside the range."""
        x = np.asarray(poses, dtype=np.float64)
        core = core_gap(self.kind, self.edge, self.vertex, self.spread, x)
        return np.where(self.range.contains(x[..., 2]), core - self.radius, np.inf)

    def contains(self, poses: ArrayLike) -> Bits:
        """Whether the contact is possible at poses (…, 3) in m and rad, to 1e-9 of the size of the features."""
        size = self.reach + float(np.ptp(self.edge, axis=0).max()) + self.radius
        return np.asarray(self.gap(poses) <= 1e-9 * size)

    def value_interval(self, poses: ArrayLike) -> tuple[Array, Array]:
        """Least and greatest value (…) in m of the C-surface function at poses (…, 3) over all deviations.

        The function is the signed distance of vertex and edge line, positive when apart: n·(p + R b − a) in type 1,
        R n·(a − p − R b) in type 2. Its zero set is the nominal C-surface. For type 1 the interval is that of d_e and
        d_i, eqs. (25)-(30), whose cosine has the wrong sign in print. The contact is possible only where 0 is inside.
        """
        x = np.asarray(poses, dtype=np.float64)
        e = self.edge[1] - self.edge[0]
        n = np.array([e[1], -e[0]]) / math.hypot(*e)
        if self.kind is ContactType.TYPE_1:
            polar = Reach.of(self.vertex)
            base, h, angle = (x[..., :2] - self.edge[0]) @ n, polar.h, x[..., 2] + polar.gamma
            low, high = -arc_support(-n, h, angle, self.spread), arc_support(n, h, angle, self.spread)
        else:
            u = self.vertex - x[..., :2]
            angle = x[..., 2] + math.atan2(n[1], n[0])
            base = np.broadcast_to(-float(self.edge[0] @ n), angle.shape)
            low, high = -arc_support(-u, 1.0, angle, self.spread), arc_support(u, 1.0, angle, self.spread)
        return np.asarray(base + low - self.radius), np.asarray(base + high + self.radius)

    def without_uncertainty(self) -> "CU | None":
        """The nominal C-surface with its ends, as the CU of no deviation; None when the contact needs deviations."""
        return None if self.nominal is None else replace(self, range=self.nominal, spread=0.0, radius=0.0)


def core_gap(kind: ContactType, edge: Array, vertex: Array, spread: float | Array, poses: Array) -> Array:
    """Distance (…) in m of poses (…, 3) from contact without the deviations of position, of any number of contacts.

    The edge is (…, 2, 2), the vertex (…, 2), as in `CU`, m, the spread ε_φrφg (…), rad.
    """
    p, phi = poses[..., :2], poses[..., 2]
    if kind is ContactType.TYPE_1:
        h, gamma = np.hypot(vertex[..., 0], vertex[..., 1]), np.arctan2(vertex[..., 1], vertex[..., 0])
        return segment_arc_gap(p - edge[..., 0, :], p - edge[..., 1, :], h, phi + gamma + math.pi, spread)
    # Type 2 from the static vertex: the reference point is on the turned edge, mirrored.
    c, s = np.cos(phi), np.sin(phi)
    x, y = edge[..., 0], edge[..., 1]
    turned = -np.stack([c[..., None] * x - s[..., None] * y, s[..., None] * x + c[..., None] * y], axis=-1)
    to = p - vertex
    radius, angle = np.hypot(to[..., 0], to[..., 1]), np.arctan2(to[..., 1], to[..., 0])
    return segment_arc_gap(turned[..., 0, :], turned[..., 1, :], radius, angle, spread)


def basic_contacts(moving: Profile, static: Profile, deviations: Deviations) -> tuple[CU, ...]:
    """CU of every basic contact that deviations may bring about between a grasped and a static object.

    A contact needs the normal of the edge, turned about, in the normal cone of the vertex. Deviations widen the range
    of φ by ε_φrφg and by the turns of the edge and of the vertex's edge that comes to lie on it: in type 1 the second
    one at the range's lower end, the first one at the upper; in type 2 the other way round. Eq. (34) has them
    exchanged, and both its ends at the maximum; eq. (45) leaves ε_φr out and counts both at either end. Edges of the
    grasped object turn with its ε_v alone. A reflex vertex counts when deviations may make it convex. The grasped one
    is in the gripper's frame, the other in that of the plane.
    """
    return tuple(cu for kind in ContactType for cu in _contacts(kind, moving, static, deviations))


def _contacts(kind: ContactType, moving: Profile, static: Profile, deviations: Deviations) -> Iterator[CU]:
    """CU of each vertex of the one object with each edge of the other."""
    first, epsilon_a = kind is ContactType.TYPE_1, np.broadcast_to(deviations.static, len(static.vertices))
    own, other = moving.edge_turns(deviations.shape), static.edge_turns(epsilon_a)
    pointed, turned, edged, level = (moving, own, static, other) if first else (static, other, moving, own)
    if first:
        # The larger one of two ends: a point between them moves by no more.
        epsilon_a = np.maximum(epsilon_a, epsilon_a[static.after])
    for vertex in _corners(pointed, turned):
        before, turn = pointed.before[vertex], float(pointed.turns[vertex])
        for edge in range(len(edged.vertices)):
            # What either may be turned by beside its nominal direction.
            spare = level[edge] + deviations.angle
            below, above = turned[vertex] + spare, turned[before] + spare
            # The edge's normal against the opposite of the vertex's cone, as φ turns the one or the other.
            if first:
                high = float(edged.normals[edge]) + math.pi - float(pointed.normals[before])
                ranges = _ranges(high - turn, high, below, above)
            else:
                low = float(pointed.normals[before]) - math.pi - float(edged.normals[edge])
                ranges = _ranges(low, low + turn, above, below)
            i, j = (vertex, edge) if first else (edge, vertex)
            ends, point = edged.vertices[[edge, edged.after[edge]]], pointed.vertices[vertex]
            yield CU(kind, i, j, ends, point, *ranges, deviations.angle, deviations.position + float(epsilon_a[j]))


def _corners(profile: Profile, edge_turns: Array) -> list[int]:
    """Vertices that are convex or may be made so."""
    # Reflex by less than deviations may make up for: then it may be convex in truth.
    return [int(i) for i in np.flatnonzero(profile.turns + edge_turns + edge_turns[profile.before] >= 0.0)]


def _ranges(low: float, high: float, below: float, above: float) -> tuple[Range, Range | None]:
    wide = Range(low - below, high + above)
    # More than a full turn allows every orientation.
    if wide.high - wide.low >= FULL:
        wide = Range(-math.pi, math.pi)
    return wide, Range(low, high) if high >= low else None
