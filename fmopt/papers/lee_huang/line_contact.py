"""When corners of an uncertain section can lie on edges of a cut-diagram: exactly, for many pairs on a leg at once.

The pair's feature on the expanded diagram GE(ψ) is the line from P₀(ψ) to P₁(ψ), Pᵢ(ψ) = cᵢ − R(ψ) mᵢ. The set of Φ₀
whose ball meets the line for some ψ is bounded by finitely many lines and circles: the corners of ball ⊕ line run on
circles, its sides touch circles or stop where the cone ends. Between neighbouring crossings of these one test decides,
and that is exact as well: over ψ, too, an answer changes only where a side of the ball reaches an end of the line, or a
corner of the ball the line.

A straight leg of the nominal centre on a plane, and where it crosses lines and circles, in closed form.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fmopt.spatial.values import Array, Bits, Indices, Value

_ROUNDING = 1e-12  # of the size
_AT_END = 1e3 * _ROUNDING  # of the size: what comes so near at the end of a leg touches there
_BOTH = np.array([-1.0, 1.0])
_SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


class Leg(NamedTuple):
    """Φ₀ on a straight leg from `start` (2,) by `travel` (2,) in m, r in m, s in rad, size of the section in m."""

    start: Array
    travel: Array
    radius: float
    half_angle: float
    size: float

    def at(self, share: Array) -> Array:
        """Φ₀ (n, 2) at shares (n,) of the leg."""
        return np.asarray(self.start + share[:, None] * self.travel)

    def on_level(self, n: Array, levels: Array) -> Array:
        """Shares (…) at which n·Φ₀, n (…, 2), has levels (…), m times |n|; nan or infinite where the leg runs along."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((levels - n @ self.start) / (n @ self.travel))

    def on_circle(self, centre: Array, radius: Array | float) -> Array:
        """Shares (…, 2) at which Φ₀ is on circles, by centres (…, 2) and radii (…), m.

        They may lie outside 0 to 1, and are no numbers without a meeting.
        """
        offset = self.start - centre
        a, b, c = float(self.travel @ self.travel), offset @ self.travel, np.vecdot(offset, offset) - radius**2
        with np.errstate(divide="ignore", invalid="ignore"):
            # The root of larger size first, the other from their product: no difference of nearly equal numbers.
            q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
            return np.stack([q / a, c / q], axis=-1)


@dataclass(frozen=True, eq=False)
class Lines(Value):
    """n pairs of a corner and an edge that can meet from outside.

    Args:
        c, m: (n, 2, 2), m; of both or one of them the two points are one.
        force: directions (n, 2) of the force on the moving section at ψ = 0.
        turns: (n, 2), the turns ψ between which the features can meet, rad.
        arm: (n, 2), m, from the nominal centre to where those touch whose edge does not turn.
    """

    c: Array
    m: Array
    force: Array
    turns: Array
    arm: Array

    @property
    def turning(self) -> Bits:
        """Whether the edge of each pair (n,) turns with the section."""
        return np.asarray(np.any(self.m[:, 0] != self.m[:, 1], axis=1))

    @property
    def normals(self) -> Array:
        """Unit vectors (n, 2) across the edges at ψ = 0."""
        m, c = self.m[:, 1] - self.m[:, 0], self.c[:, 1] - self.c[:, 0]
        along = np.where(self.turning[:, None], m, c)
        length = np.maximum(np.linalg.norm(along, axis=1), np.finfo(np.float64).tiny)  # none of a point on an arc
        return np.asarray(along[:, ::-1] * (-1.0, 1.0) / length[:, None])

    def spans(self, leg: Leg) -> tuple[Indices, Array]:
        """When contact is possible on a leg.

        The answer is which pair (k,), and the first, last and middle (k, 3) of the shares on which it can touch.
        """
        near = np.flatnonzero(self._near(leg))
        cuts = self._rows(near)._crossings(leg)
        row, k = np.nonzero(cuts[:, 1:] > cuts[:, :-1])
        first, last = cuts[row, k], cuts[row, k + 1]
        # Between two neighbouring cuts the answer does not change: one position in the middle speaks for all.
        middle = 0.5 * (first + last)
        met = self._rows(near[row])._met(leg.at(middle), leg, 0.0)
        # Contact at the very end of the leg has no stretch, and would be missed by all middles.
        others = np.setdiff1d(near, near[row[met & (last == 1.0)]])
        others = others[self._rows(others)._met(leg.at(np.ones(len(others))), leg, _AT_END * leg.size)]
        shares = np.column_stack([first, last, middle])[met]
        return np.concatenate([near[row[met]], others]), np.vstack([shares, np.ones((len(others), 3))])

    def arms(self, rows: Indices, points: Array) -> Array:
        """From nominal centres (k, 2), m, to where pairs, given by number (k,), touch: (k, 2), m."""
        # A corner that turns with the section touches where it is; an edge that turns touches the fixed corner.
        return np.asarray(np.where(self.turning[rows, None], self.c[rows, 0] - points, self.arm[rows]))

    def _rows(self, rows: Indices) -> "Lines":
        return Lines(self.c[rows], self.m[rows], self.force[rows], self.turns[rows], self.arm[rows])

    def _near(self, leg: Leg) -> Bits:
        """Whether a leg comes within reach of each pair in both coordinates."""
        # A little farther than any point of the pair can be: pairs that are left out surely do not meet.
        longest = np.linalg.norm(self.m, axis=2).max(axis=1, initial=0.0)
        reach = (leg.radius + longest * (1.0 + 1e-9) + 1e-6 * leg.size)[:, None]
        ends = np.stack([leg.start, leg.start + leg.travel])
        low, high = self.c.min(axis=1) - reach, self.c.max(axis=1) + reach
        return np.asarray(np.all((ends.min(axis=0) <= high) & (low <= ends.max(axis=0)), axis=1))

    def _crossings(self, leg: Leg) -> Array:
        """0, 1, and the shares between (n, k) at which Φ₀ crosses what can bound the set of contact, sorted.

        For an edge on a corner also where its torque changes sign.
        """
        c, m, r, n, axes = self.c, self.m, leg.radius, self.normals, np.eye(2)
        length, height = np.linalg.norm(m, axis=2), np.vecdot(n, m[:, 0])
        wide, turning = r * np.abs(n).sum(axis=1)[:, None], self.turning
        across = self.force[:, ::-1] * (-1.0, 1.0)
        P = self._ends(self.turns)
        normals = (P[:, :, 1] - P[:, :, 0])[..., ::-1] * (-1.0, 1.0)
        supports = r * np.abs(normals).sum(axis=2)[..., None] * _BOTH
        shares = [
            # The corners of the ball's square about the corner of a section: circles of its own arm, their extremes.
            leg.on_circle(c[:, :, None] + r * _SIGNS, length[..., None]),
            leg.on_level(axes, c[:, :, None] + (r * _SIGNS[:, :1] + length[..., None, None] * _SIGNS[:, 1:])),
            # The line at either end of the cone: its two ends, and the line itself, moved by the ball.
            leg.on_level(axes, P[..., None, :] + r * _BOTH[:, None]),
            leg.on_level(normals[:, :, None], np.vecdot(normals, P[:, :, 0])[..., None] + supports),
        ]
        # The turning edge: perpendicular distance from the corner decides, a circle about it.
        circles = leg.on_circle(c[:, :1] + r * _SIGNS, np.abs(height)[:, None])
        torques = leg.on_level(across, np.vecdot(across, c[:, 0]))
        # A fixed edge: the turning corner is on it at the extremes of its circle.
        levels = np.vecdot(n, c[:, 0])[:, None] + wide * _SIGNS[:, 0] + length[:, :1] * _SIGNS[:, 1]
        shares += [np.where(turning[:, None, None], circles, np.nan), np.where(turning, torques, np.nan)]
        shares += [np.where(turning[:, None], np.nan, leg.on_level(n[:, None], levels))]
        ends = np.tile([0.0, 1.0], (len(c), 1))
        return np.sort(np.clip(np.nan_to_num(np.hstack([ends, *map(_columns, shares)])), 0.0, 1.0), axis=1)

    def _ends(self, turns: Array) -> Array:
        """P₀ and P₁ (n, k, 2, 2) at turns (n, k)."""
        cosine, sine = np.cos(turns)[..., None], np.sin(turns)[..., None]
        x, y = self.m[:, None, :, 0], self.m[:, None, :, 1]
        return np.asarray(self.c[:, None] - np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1))

    def _met(self, points: Array, leg: Leg, slack: float) -> Bits:
        """Whether the ball about each pair's point (n, 2) meets its line for an allowed turn.

        Without slack the turns between those at which the answer may change are tried, else these turns themselves.
        """
        turns = self._breaks(points, leg.radius)
        turns = turns if slack else 0.5 * (turns[:, 1:] + turns[:, :-1])
        ends = self._ends(turns) - points[:, None, None]
        reach = leg.radius + _ROUNDING * leg.size + slack
        # The box of the segment misses the square of the ball: a quick no.
        near = np.all((ends.min(axis=2) <= reach) & (ends.max(axis=2) >= -reach), axis=2)
        n = (ends[:, :, 1] - ends[:, :, 0])[..., ::-1] * (-1.0, 1.0)
        # The square's support across the line: r (|n_x| + |n_y|), as the ball is in the maximum norm.
        level = np.abs(np.vecdot(ends[:, :, 0], n)) - leg.radius * np.abs(n).sum(axis=2)
        return np.asarray(np.any(near & (level <= (_ROUNDING * leg.size + slack) * np.linalg.norm(n, axis=2)), axis=1))

    def _breaks(self, points: Array, r: float) -> Array:
        """First and last turn allowed, and those between at which the answer for each point may change, (n, k) sorted.

        All solve A cos ψ + B sin ψ = C.
        """
        to, n, m = self.c - points[:, None], self.normals, self.m
        quarter = n[:, ::-1] * (1.0, -1.0)
        corners = to[:, :1] + r * _SIGNS
        height, beside = np.vecdot(n, m[:, 0])[:, None], np.vecdot(quarter, m[:, 0])[:, None]
        over = np.vecdot(corners, n[:, None])
        turning, ones = self.turning[:, None], np.ones((1, 4))
        # A side of the ball reaches an end of the line, in x and in y.
        sides = [(m[:, :, 0], -m[:, :, 1], to[:, :, 0]), (m[:, :, 1], m[:, :, 0], to[:, :, 1])]
        rows = [(a, b, level + sign * r) for a, b, level in sides for sign in _BOTH]
        # A corner of the ball reaches the line.
        A = np.where(turning, over, height * ones)
        B = np.where(turning, -np.vecdot(corners, quarter[:, None]), beside * ones)
        rows.append((A, B, np.where(turning, height * ones, over)))
        A, B, C = (np.hstack(column) for column in zip(*rows, strict=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.arccos(C / np.hypot(A, B))[..., None] * _BOTH + np.arctan2(B, A)[..., None]
        turn -= 2.0 * math.pi * np.floor(turn / (2.0 * math.pi) + 0.5)
        first, last = self.turns[:, :1], self.turns[:, 1:]
        found = np.hstack([first, last, _columns(np.where(np.isnan(turn), first[..., None], turn))])
        return np.sort(np.clip(found, first, last), axis=1)


def _columns(values: Array) -> Array:
    """Arrays (n, …) as one row (n, k) each."""
    return values.reshape(len(values), math.prod(values.shape[1:]))
