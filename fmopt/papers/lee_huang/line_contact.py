"""When corners of an uncertain section can lie on edges of a cut-diagram: exactly, for many pairs on a leg at once.

The pair's feature on the expanded diagram GE(ψ) is the line from P₀(ψ) to P₁(ψ), Pᵢ(ψ) = cᵢ − R(ψ) mᵢ. The set of Φ₀
whose ball meets the line for some ψ is bounded by finitely many lines and circles: the corners of ball ⊕ line run on
circles, its sides touch circles or stop where the cone ends. Between neighbouring crossings of these one test decides,
and that is exact as well: over ψ, too, an answer changes only where a side of the ball reaches an end of the line, or a
corner of the ball the line.

A straight leg of the nominal centre on a plane, and where it crosses lines and circles, in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.values import Array, Value

_ROUNDING = 1e-12  # of the size
_AT_END = 1e3 * _ROUNDING  # of the size: what comes so near at the end of a leg touches there
_SIGNS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
_MOST_CUTS = 64  # of a leg by one pair
_MOST_TURNS = 26  # at which the answer for one position may change, and the ends


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
        """Shares at which n·Φ₀ has the values (k,).

        Args:
            n: (2,), of any length.
            levels: (k,), m times that length.
        """
        rate = float(n @ self.travel)
        # A leg along the level crosses it nowhere, or lies on it all along: no share is a crossing.
        return (levels - n @ self.start) / rate if abs(rate) > 1e-300 else np.zeros(0)

    def on_circle(self, centre: Array, radius: float) -> Array:
        """Shares (k,) at which Φ₀ is on a circle; they may lie outside 0 to 1.

        Args:
            centre: (2,), m.
            radius: m.
        """
        offset = self.start - centre
        a, b, c = float(self.travel @ self.travel), float(offset @ self.travel), float(offset @ offset) - radius**2
        inside = b * b - a * c
        if a == 0.0 or inside < 0.0:
            return np.zeros(0)
        # The root of larger size first, the other from their product: no difference of nearly equal numbers.
        q = -(b + math.copysign(math.sqrt(inside), b))
        return np.array([q / a, c / q] if q != 0.0 else [0.0])


class Line(NamedTuple):
    """One of the pairs of `Lines`: c and m (2, 2), m, the force (2,) at ψ = 0, and the turns (2,), rad."""

    c: Array
    m: Array
    force: Array
    turns: Array


@dataclass(frozen=True, eq=False)
class Lines(Value):
    """n pairs of a corner and an edge that can meet from outside.

    Args:
        c: (n, 2, 2), m; one of c and m holds one point twice.
        m: (n, 2, 2), m.
        force: directions (n, 2) of the force on the moving section at ψ = 0.
        turns: (n, 2), the turns ψ between which the features can meet, rad.
        shift: (n,), m, how far the contact point lies from P along the force's opposite, for circles.
    """

    c: Array
    m: Array
    force: Array
    turns: Array
    shift: Array

    def spans(self, leg: Leg) -> tuple[NDArray[np.intp], Array]:
        """When contact is possible on a leg.

        Returns:
            Which pair (k,), and the first, the last and the middle one (k, 3) of the shares of the leg on which it can
            touch.
        """
        if not len(self.c):
            return np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        return possible(self.c, self.m, self.force, self.turns, leg)

    def arms(self, rows: NDArray[np.intp], points: Array) -> Array:
        """From the nominal centre to where pairs touch, (k, 2), m.

        Args:
            rows: (k,), numbers of pairs.
            points: (k, 2), the nominal centre for each, m.
        """
        turning = np.any(self.m[rows, 0] != self.m[rows, 1], axis=1)
        fixed = self.m[rows, 0] - self.shift[rows, None] * self.force[rows]
        # A corner that turns with the section touches where it is; an edge that turns touches the fixed corner.
        return np.asarray(np.where(turning[:, None], self.c[rows, 0] - points, fixed))


@compiled
def possible(c: Array, m: Array, force: Array, turns: Array, leg: Leg) -> tuple[NDArray[np.intp], Array]:
    """`Lines.spans` on a leg.

    Args:
        c, m: (n, 2, 2), of each pair.
        force: (n, 2), unit vectors.
        turns: (n, 2), of each pair.
    """
    start, travel = leg.start, leg.travel
    rows, shares = np.empty(len(c) * _MOST_CUTS, dtype=np.intp), np.empty((len(c) * _MOST_CUTS, 3))
    cuts, point, count = np.empty(_MOST_CUTS), np.empty(2), 0
    for k in range(len(c)):
        line = Line(c[k], m[k], force[k], turns[k])
        if not _near(line, leg):
            continue
        found = _crossings(line, leg, cuts)
        met = False
        for j in range(found - 1):
            if cuts[j] == cuts[j + 1]:
                continue
            # Between two neighbouring cuts the answer does not change: one position in the middle speaks for all.
            middle = 0.5 * (cuts[j + 1] + cuts[j])
            point[0], point[1] = start[0] + middle * travel[0], start[1] + middle * travel[1]
            met = _met(line, point, leg, 0.0)
            if met:
                rows[count] = k
                shares[count, 0], shares[count, 1], shares[count, 2] = cuts[j], cuts[j + 1], middle
                count += 1
        point[0], point[1] = start[0] + travel[0], start[1] + travel[1]
        # Contact at the very end of the leg has no stretch, and would be missed by all middles.
        if not met and _met(line, point, leg, _AT_END * leg.size):
            rows[count] = k
            shares[count] = 1.0
            count += 1
    return rows[:count].copy(), shares[:count].copy()


@part
def _near(line: Line, leg: Leg) -> bool:
    """Whether a leg comes within reach of a pair in both coordinates."""
    c, m, start, travel = line.c, line.m, leg.start, leg.travel
    longest = max(math.sqrt(m[0, 0] ** 2 + m[0, 1] ** 2), math.sqrt(m[1, 0] ** 2 + m[1, 1] ** 2))
    # A little farther than any point of the pair can be: pairs that are left out surely do not meet.
    reach = leg.radius + longest * (1.0 + 1e-9) + 1e-6 * leg.size
    for axis in range(2):
        one, other = start[axis], start[axis] + travel[axis]
        low, high = min(c[0, axis], c[1, axis]) - reach, max(c[0, axis], c[1, axis]) + reach
        if min(one, other) > high or low > max(one, other):
            return False
    return True


@part
def _crossings(line: Line, leg: Leg, cuts: Array) -> int:
    """Fills `cuts` with 0, 1, and the shares between at which Φ₀ crosses what can bound the set of contact, sorted.

    For an edge on a corner also where its torque changes sign. Returns how many there are.
    """
    (c, m, force, turns), r = line, leg.radius
    cuts[0], cuts[1], found = 0.0, 1.0, 2
    for i in range(2):
        length = math.sqrt(m[i, 0] ** 2 + m[i, 1] ** 2)
        # The corners of the ball's square about the corner of a section: circles of its own arm, and their extremes.
        for x, y in _SIGNS:
            found = _circle(c[i, 0] + r * x, c[i, 1] + r * y, length, leg, cuts, found)
            found = _level(1.0, 0.0, c[i, 0] + r * x + length * y, leg, cuts, found)
            found = _level(0.0, 1.0, c[i, 1] + r * x + length * y, leg, cuts, found)
    # The line at either end of the cone: its two ends, and the line itself, moved by the ball.
    for turn in turns:
        ax, ay, bx, by = _ends(c, m, turn)
        nx, ny = _across(bx - ax, by - ay)
        for sign in (-1.0, 1.0):
            for x, y in ((ax, ay), (bx, by)):
                found = _level(1.0, 0.0, x + sign * r, leg, cuts, found)
                found = _level(0.0, 1.0, y + sign * r, leg, cuts, found)
            found = _level(nx, ny, nx * ax + ny * ay + sign * (r * (abs(nx) + abs(ny))), leg, cuts, found)
    # The turning edge: perpendicular distance from the corner decides, a circle about it.
    if m[0, 0] != m[1, 0] or m[0, 1] != m[1, 1]:
        found = _level(-force[1], force[0], c[0, 1] * force[0] - c[0, 0] * force[1], leg, cuts, found)
        nx, ny = _across(m[1, 0] - m[0, 0], m[1, 1] - m[0, 1])
        distance = abs(nx * m[0, 0] + ny * m[0, 1])
        for x, y in _SIGNS:
            found = _circle(c[0, 0] + r * x, c[0, 1] + r * y, distance, leg, cuts, found)
    # A fixed edge: the turning corner is on it at the extremes of its circle.
    else:
        nx, ny = _across(c[1, 0] - c[0, 0], c[1, 1] - c[0, 1])
        length = math.sqrt(m[0, 0] ** 2 + m[0, 1] ** 2)
        for x, y in _SIGNS:
            level = nx * c[0, 0] + ny * c[0, 1] + (r * (abs(nx) + abs(ny)) * x + length * y)
            found = _level(nx, ny, level, leg, cuts, found)
    return found


@part
def _level(nx: float, ny: float, level: float, leg: Leg, cuts: Array, found: int) -> int:
    """Adds the share at which n·Φ₀ has a value."""
    start, travel = leg.start, leg.travel
    rate = nx * travel[0] + ny * travel[1]
    # A leg at rest, or along the level, does not cross it.
    if abs(rate) <= 1e-300:
        return found
    return _added((level - (nx * start[0] + ny * start[1])) / rate, cuts, found)


@part
def _circle(x: float, y: float, radius: float, leg: Leg, cuts: Array, found: int) -> int:
    """Adds the shares at which Φ₀ is on a circle about (x, y)."""
    start, travel = leg.start, leg.travel
    dx, dy = start[0] - x, start[1] - y
    a, b = travel[0] * travel[0] + travel[1] * travel[1], dx * travel[0] + dy * travel[1]
    c = dx * dx + dy * dy - radius**2
    inside = b * b - a * c
    if a == 0.0 or inside < 0.0:
        return found
    q = -(b + math.copysign(math.sqrt(inside), b))
    if q == 0.0:
        return found
    return _added(c / q, cuts, _added(q / a, cuts, found))


@part
def _added(share: float, cuts: Array, found: int) -> int:
    """Adds a share of the leg."""
    return _sorted_in(share, cuts, found) if 0.0 < share < 1.0 else found


@part
def _sorted_in(value: float, values: Array, found: int) -> int:
    """Puts a number where it belongs among so many ascending ones."""
    k = found
    while k > 0 and values[k - 1] > value:
        values[k] = values[k - 1]
        k -= 1
    values[k] = value
    return found + 1


@part
def _across(x: float, y: float) -> tuple[float, float]:
    """The unit vector a quarter turn on from a direction."""
    length = math.sqrt(x * x + y * y)
    return -y / length, x / length


@part
def _ends(c: Array, m: Array, turn: float) -> tuple[float, float, float, float]:
    """P₀ and P₁ at a turn."""
    cosine, sine = math.cos(turn), math.sin(turn)
    return (
        c[0, 0] - (cosine * m[0, 0] - sine * m[0, 1]),
        c[0, 1] - (sine * m[0, 0] + cosine * m[0, 1]),
        c[1, 0] - (cosine * m[1, 0] - sine * m[1, 1]),
        c[1, 1] - (sine * m[1, 0] + cosine * m[1, 1]),
    )


@part
def _met(line: Line, point: Array, leg: Leg, slack: float) -> bool:
    """Whether the ball about a point (2,) meets the line for an allowed turn: between breaks, or with slack at them."""
    turns = line.turns
    if turns[0] == turns[1]:
        return _meets(line, turns[0], point, leg, slack)
    breaks = _breaks(line, point, leg.radius)
    last = math.nan
    for k in range(len(breaks) - 1 if slack == 0.0 else len(breaks)):
        # Breaks bound intervals of turns on which the answer is one: their middles tell it, or themselves with slack.
        turn = 0.5 * (breaks[k + 1] + breaks[k]) if slack == 0.0 else breaks[k]
        if turn != last and _meets(line, turn, point, leg, slack):
            return True
        last = turn
    return False


@part
def _meets(line: Line, turn: float, point: Array, leg: Leg, slack: float) -> bool:
    """Whether the ball about a point (2,) meets the line at a turn."""
    radius, size = leg.radius, leg.size
    ax, ay, bx, by = _ends(line.c, line.m, turn)
    ax, ay, bx, by = ax - point[0], ay - point[1], bx - point[0], by - point[1]
    reach = radius + _ROUNDING * size + slack
    # The box of the segment misses the square of the ball: a quick no.
    if min(ax, bx) > reach or min(ay, by) > reach or max(ax, bx) < -reach or max(ay, by) < -reach:
        return False
    nx, ny = ay - by, bx - ax
    # The square's support across the line: r (|n_x| + |n_y|), as the ball is in the maximum norm.
    level = abs(ax * nx + ay * ny) - radius * (abs(nx) + abs(ny))
    return bool(level <= (_ROUNDING * size + slack) * math.sqrt(nx * nx + ny * ny))


@part
def _breaks(line: Line, point: Array, r: float) -> Array:
    """First and last turn allowed, and those between at which the answer for a point (2,) may change, ascending."""
    c, m, _, turns = line
    breaks = np.empty(_MOST_TURNS)
    breaks[0], breaks[1], found = turns[0], turns[1], 2
    for i in range(2):
        for sign in (-1.0, 1.0):
            found = _turns_of(m[i, 0], -m[i, 1], c[i, 0] - point[0] + sign * r, turns, breaks, found)
            found = _turns_of(m[i, 1], m[i, 0], c[i, 1] - point[1] + sign * r, turns, breaks, found)
    turning = m[0, 0] != m[1, 0] or m[0, 1] != m[1, 1]
    end = m if turning else c
    nx, ny = _across(end[1, 0] - end[0, 0], end[1, 1] - end[0, 1])
    for sx, sy in _SIGNS:
        x, y = c[0, 0] - point[0] + r * sx, c[0, 1] - point[1] + r * sy
        if turning:
            found = _turns_of(x * nx + y * ny, y * nx - x * ny, nx * m[0, 0] + ny * m[0, 1], turns, breaks, found)
        else:
            along, across = nx * m[0, 0] + ny * m[0, 1], ny * m[0, 0] - nx * m[0, 1]
            found = _turns_of(along, across, x * nx + y * ny, turns, breaks, found)
        # A ball of no radius has one corner.
        if r == 0.0:
            break
    return breaks[:found]


@part
def _turns_of(A: float, B: float, C: float, turns: Array, breaks: Array, found: int) -> int:
    """Adds the two solutions of A cos ψ + B sin ψ = C, no less and no more than the turns allowed."""
    size = math.hypot(A, B)
    for sign in (-1.0, 1.0):
        turn = turns[0]
        if size > 0.0 and abs(C / size) <= 1.0:
            # Both solutions of a cos + b sin = c, reduced to ±π.
            turn = math.atan2(B, A) + sign * math.acos(C / size)
            turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        # Held to the range allowed, where it repeats an end and is passed over.
        found = _sorted_in(min(max(turn, turns[0]), turns[1]), breaks, found)
    return found
