"""The tube of errors along a piece of motion, compiled: how rows bend, the box of all errors, the set at the goal.

What is computed is said in `curvature` and `segment`, whose letters these are. Of a row that has been bent over a piece
one line of a table (_BENT,) is kept: whether it is bilinear, then of a row without b

    |u||k|, sizes of u, of R k at both ends, each with its length, |τ × w|, and what the nominal turn does,

of a bilinear row

    |u||k| + |y|, |AΔ|, how far the path is off its chord, sizes of A, of G and of [β]×A at both ends, of J, the power.
"""

from __future__ import annotations

import math

import numpy as np

from fmopt.certificate.rows import Places
from fmopt.compiled import compiled, part
from fmopt.values import Array

_BENT = 61
POWER = slice(55, 61)
"""Where a bilinear row's line has how N·V, V the twist, changes with the error at the start (6,)."""

_ROUNDS = 80
_FAR = 0.5  # m or rad; errors as wide as this certify nothing
_ALLOWANCE = 4e-15  # m or rad; what the independent check adds to the bounds of errors before it uses them
_SETTLED = 2e-13  # relative rounding of the computed bounds of errors
_TIGHT = 5e-11  # relative: bounds as near to the computed ones as the check asks
_ABOVE = 1e-11  # stated bounds of errors exceed the computed ones by about this share

SETTLED, PAST, LARGE, THICK = range(4)
"""What comes of a piece: its errors settle; they could carry the part past its contact; they are too large for it; the
contact surfaces are too thick."""


@part
def _length(x: float, y: float, z: float) -> float:
    return math.sqrt(x * x + y * y + z * z)


@part
def _turned(v: Array, at: int, angles: Array) -> float:
    """Bound of |ε × v| for all ε in a box of half-widths (3,), v by the sizes of its components and its length."""
    x, y, z = v[at], v[at + 1], v[at + 2]
    a, b, c = angles[0], angles[1], angles[2]
    bound: float = min(_length(y * c + z * b, z * a + x * c, x * b + y * a), _length(a, b, c) * v[at + 3])
    return bound


@part
def _sizes(x: float, y: float, z: float, out: Array, at: int) -> None:
    out[at], out[at + 1], out[at + 2], out[at + 3] = abs(x), abs(y), abs(z), _length(x, y, z)


@part
def _bend_plain(row: Array, first: Array, second: Array, twist: Array, out: Array) -> None:
    """The line of a row without b, from R k at both ends."""
    u, v, w = row[3], row[4], row[5]
    a, b, c = twist[3], twist[4], twist[5]
    out[1] = row[20]
    _sizes(u, v, w, out, 2)
    _sizes(first[0], first[1], first[2], out, 6)
    _sizes(second[0], second[1], second[2], out, 10)
    out[14] = _length(b * first[2] - c * first[1], c * first[0] - a * first[2], a * first[1] - b * first[0])
    out[15] = 0.125 * out[14] * _length(b * w - c * v, c * u - a * w, a * v - b * u)


@part
def _bend_bilinear(row: Array, turned: Array, bent: Array, twist: Array, out: Array) -> None:
    """The line of a bilinear row, from R k (2, 3) and R b and y (2, 2, 3) at both ends."""
    a, b, c, sign = row[12], row[13], row[14], row[19]
    x, y, z = twist[3], twist[4], twist[5]
    A = np.array([[sign, -c, b], [c, sign, -a], [-b, a, sign]])
    slid = np.empty(3)
    for i in range(3):
        slid[i] = A[i, 0] * twist[0] + A[i, 1] * twist[1] + A[i, 2] * twist[2]
    turn, seen, tallest, chord = _length(x, y, z), _length(slid[0], slid[1], slid[2]), 0.0, 0.0
    G, J = np.empty((3, 3)), np.empty(6)
    for e in range(2):
        w, beta, high = turned[e], bent[0, e], bent[1, e]
        tallest = max(tallest, _length(high[0], high[1], high[2]))
        trace = 0.0
        for i in range(3):
            for j in range(3):
                G[i, j] = -w[i] * row[3 + j] - beta[i] * high[j]
            trace -= G[i, i]
        for i in range(3):
            G[i, i] += trace
        swung = np.array([y * beta[2] - z * beta[1], z * beta[0] - x * beta[2], x * beta[1] - y * beta[0]])
        carried = np.array(
            [
                beta[1] * slid[2] - beta[2] * slid[1],
                beta[2] * slid[0] - beta[0] * slid[2],
                beta[0] * slid[1] - beta[1] * slid[0],
            ]
        )
        along = 0.0
        for i in range(3):
            J[i] = swung[0] * A[0, i] + swung[1] * A[1, i] + swung[2] * A[2, i]
            J[3 + i] = carried[i] - (G[i, 0] * x + G[i, 1] * y + G[i, 2] * z)
            along += J[i] * twist[i] + J[3 + i] * twist[3 + i]
            for j in range(3):
                out[13 + 9 * e + 3 * i + j] = 0.5 * abs(G[i, j] + G[j, i])
            if e == 0:
                out[55 + i], out[58 + i] = J[i], carried[i] - (G[0, i] * x + G[1, i] * y + G[2, i] * z)
        chord = max(chord, abs(along))
        for i in range(3):
            out[31 + 9 * e + i] = abs(beta[1] * A[2, i] - beta[2] * A[1, i])
            out[34 + 9 * e + i] = abs(beta[2] * A[0, i] - beta[0] * A[2, i])
            out[37 + 9 * e + i] = abs(beta[0] * A[1, i] - beta[1] * A[0, i])
        for i in range(6):
            out[49 + i] += abs(J[i])
    size = row[20] + tallest
    out[1], out[2], out[3] = size, seen, 0.125 * chord + turn**2 * (turn * size + 3.0 * seen) / 16.0
    for i in range(3):
        for j in range(3):
            out[4 + 3 * i + j] = abs(A[i, j])


@compiled
def bend(table: Array, places: Places, turned: Array, bent: Array, twist: Array) -> Array:
    """How rows bend over a piece of motion: their lines (k, _BENT).

    Args:
        table: (k, 21), of the forms.
        places: of the bilinear rows among them (m,).
        turned: R k (2, k, 3) at both ends, m.
        bent: R b and y (2, 2, m, 3), each at both ends.
        twist: of the piece (6,).
    """
    found = np.zeros((len(table), _BENT))
    for j in range(len(places)):
        i = places[j]
        found[i, 0] = 1.0
        _bend_bilinear(table[i], turned[:, i], bent[:, :, j], twist, found[i])
    for i in range(len(table)):
        if found[i, 0] == 0.0:
            _bend_plain(table[i], turned[0, i], turned[1, i], twist, found[i])
    return found


@part
def _left_plain(line: Array, angles: Array) -> float:
    theta = _length(angles[0], angles[1], angles[2])
    most = max(_turned(line, 6, angles), _turned(line, 10, angles)) + 0.5 * theta * line[14]
    found: float = _turned(line, 2, angles) * 0.5 * (min(most, theta * line[9]) + line[14]) + line[15]
    return found


@part
def _left_bilinear(line: Array, turn: float, half: Array) -> float:
    angles, size, seen = half[3:], line[1], line[2]
    theta, felt, second, turning = _length(half[3], half[4], half[5]), 0.0, 0.0, 0.0
    for i in range(3):
        across = line[4 + 3 * i] * half[0] + line[5 + 3 * i] * half[1] + line[6 + 3 * i] * half[2]
        felt += across * across
    felt = math.sqrt(felt)
    for e in range(2):
        drawn = 0.0
        for i in range(3):
            for j in range(3):
                at = 9 * e + 3 * i + j
                drawn += (0.5 * line[13 + at] * angles[j] + line[31 + at] * half[j]) * angles[i]
        second = max(second, drawn)
    for i in range(6):
        turning += line[49 + i] * half[i]
    third = theta**2 * ((theta / 6.0 + 0.25 * turn) * size + 0.5 * felt + 0.25 * seen) + 0.5 * theta * turn * felt
    third += 0.125 * turn * (theta * turn * size + turn * felt + 2.0 * theta * seen)
    fine = second + line[3] + 0.25 * turning + third
    coarse = (0.5 * theta**2 + turn**2 / 8.0 + 0.5 * turn * theta) * size
    coarse += (theta + 0.5 * turn) * felt + (0.25 * turn + 0.5 * theta) * seen
    found: float = min(fine, coarse)
    return found


@compiled
def left(lines: Array, turn: float, half: Array, coupling: Array) -> Array:
    """What the linear picture of rows leaves over a piece (k,), m.

    Args:
        lines: of the rows (k, _BENT).
        turn: |τ| of the piece, rad.
        half: half-widths (6,) of a box around the errors, m and rad.
        coupling: what the linear picture leaves of errors in different frames (2,), m and rad.
    """
    found = np.empty(len(lines))
    for i in range(len(lines)):
        line = lines[i]
        found[i] = _left_plain(line, half[3:]) if line[0] == 0.0 else _left_bilinear(line, turn, half)
        found[i] += coupling[0] + coupling[1] * line[1]
    return found


@compiled
def varied(lines: Array, twist: Array, half: Array, motion: Array) -> Array:
    """Bounds (k,) of how much N·v may differ between poses of a piece, errors included, m.

    Args:
        lines: of the rows (k, _BENT).
        twist: of the piece (6,).
        half: half-widths (6,) of a box around the errors.
        motion: v (6,).
    """
    slide, spin = _length(motion[0], motion[1], motion[2]), _length(motion[3], motion[4], motion[5])
    wander = _length(half[3], half[4], half[5]) + _length(twist[3], twist[4], twist[5])
    moved = _length(half[0], half[1], half[2]) + _length(twist[0], twist[1], twist[2])
    found = np.empty(len(lines))
    for i in range(len(lines)):
        if lines[i, 0] == 0.0:
            found[i] = wander * spin * lines[i, 1]
        else:
            found[i] = wander * (spin * lines[i, 1] + slide) + moved * spin
    return found


@part
def _coupled(links: Array, offset: float, angle: float, turn: float) -> tuple[float, float]:
    """What the linear picture leaves of errors in different frames, m and rad; see `uncertainty.linkage`.

    Args:
        links: sizes of h_p, h, g_p and g_r, and P (5,), m and rad.
        offset: bound of the translation, m.
        angle: bound of the angle, rad.
        turn: of the piece, rad.
    """
    shift, askew, off, slant, travel = links[0], links[1], links[2], links[3], links[4]
    moved, a, arc = offset + shift + askew * travel + off, angle + askew + slant, turn * turn / 8.0
    c = a + slant
    straight = 0.5 * askew * askew * travel + askew * (moved + off) + (a + arc) * off
    return straight, 0.5 * a * slant * (1.0 + c) + 0.5 * askew * c * (1.0 + askew + c) + arc * slant


@compiled
def coupled(links: Array, half: Array, turn: float) -> Array:
    """What the linear picture leaves of errors in different frames (2,), m and rad.

    Args:
        links: sizes of h_p, h, g_p and g_r, and P (5,), m and rad; all zero where errors are fixed in one frame.
        half: half-widths (6,) of a box around the errors, m and rad.
        turn: of the piece, rad.
    """
    found = np.zeros(2)
    if links[0] + links[1] + links[2] + links[3] > 0.0:
        offset, angle = _length(half[0], half[1], half[2]), _length(half[3], half[4], half[5])
        found[0], found[1] = _coupled(links, offset, angle, turn)
    return found


@part
def _reach(N: Array, generators: Array, slide: Array, swing: Array) -> float:
    """How far generators (k, 6) and ellipsoids with roots (6, …), added up, reach along a row (6,)."""
    total = 0.0
    for k in range(len(generators)):
        along = 0.0
        for i in range(6):
            along += generators[k, i] * N[i]
        total += abs(along)
    return total + _radius(N, slide) + _radius(N, swing)


@part
def _radius(N: Array, F: Array) -> float:
    """How far an ellipsoid with a root (6, g) reaches along a row (6,)."""
    square = 0.0
    for k in range(F.shape[1]):
        along = 0.0
        for i in range(6):
            along += F[i, k] * N[i]
        square += along * along
    return math.sqrt(square)


@part
def _spread(slide: Array, swing: Array, projector: Array, rho: float) -> Array:
    """Diagonals (6,) and, last, traces, (2, 2, 7): in translation and in angle of the carried drift and of a unit's."""
    found = np.zeros((2, 2, 7))
    for i in range(6):
        for k in range(slide.shape[1]):
            found[0, 0, i] += slide[i, k] * slide[i, k]
        for k in range(swing.shape[1]):
            found[1, 0, i] += swing[i, k] * swing[i, k]
        for n in range(2):
            for k in range(3):
                found[n, 1, i] += projector[i, 3 * n + k] * projector[i, 3 * n + k]
            for m in range(2):
                found[n, m, 6] += (1.0 if i < 3 else rho * rho) * found[n, m, i]
    return found


@part
def _ball(projector: Array, first: int, radius: float) -> Array:
    """A root (6, 3) of what a projector makes of a ball in the three coordinates from `first` on."""
    found = np.empty((6, 3))
    for i in range(6):
        for k in range(3):
            found[i, k] = radius * projector[i, first + k]
    return found


@part
def _mapped(P: Array, F: Array) -> Array:
    """P F (6, k)."""
    found = np.zeros((6, F.shape[1]))
    for i in range(6):
        for j in range(6):
            for k in range(F.shape[1]):
                found[i, k] += P[i, j] * F[j, k]
    return found


@part
def _trace(F: Array, rho: float) -> float:
    """The trace of the shape matrix of a root (6, k) in the metric of ρ."""
    found = 0.0
    for i in range(6):
        weight = 1.0 if i < 3 else rho * rho
        for k in range(F.shape[1]):
            found += weight * F[i, k] * F[i, k]
    return found


@part
def _sum(F1: Array, F2: Array, rho: float) -> Array:
    """Root of the ellipsoid of least trace around the sum of two; see `ellipsoid.outer_sum`."""
    s1, s2 = math.sqrt(_trace(F1, rho)), math.sqrt(_trace(F2, rho))
    if s1 == 0.0:
        return F2
    if s2 == 0.0:
        return F1
    k, one, two = F1.shape[1], math.sqrt(1.0 + s2 / s1), math.sqrt(1.0 + s1 / s2)
    found = np.empty((6, k + F2.shape[1]))
    for i in range(6):
        for j in range(k):
            found[i, j] = one * F1[i, j]
        for j in range(F2.shape[1]):
            found[i, k + j] = two * F2[i, j]
    return found


@part
def _narrow(F: Array) -> Array:
    """A root (6, k) of the same ellipsoid as F (6, m) with k ≤ 6, by Householder reflections of Fᵀ."""
    m = F.shape[1]
    if m <= 6:
        return F
    M = np.empty((m, 6))
    for i in range(6):
        for k in range(m):
            M[k, i] = F[i, k]
    for j in range(6):
        below = 0.0
        for k in range(j + 1, m):
            below += M[k, j] * M[k, j]
        if below == 0.0:
            continue
        head = M[j, j]
        size = math.sqrt(head * head + below)
        end = -size if head >= 0.0 else size
        M[j, j] = head - end
        for i in range(j + 1, 6):
            along = 0.0
            for k in range(j, m):
                along += M[k, j] * M[k, i]
            along /= size * (size + abs(head))
            for k in range(j, m):
                M[k, i] -= along * M[k, j]
        M[j, j] = end
    found = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            found[i, j] = M[j, i] if j <= i else 0.0
    return found


@part
def _grown(
    half: Array,
    lines: Array,
    rest: Array,
    held: int,
    residue: Array,
    delay: Array,
    way: Array,
    late: tuple[float, float],
    rates: tuple[float, float],
    links: Array,
) -> tuple[int, Array, float, tuple[float, float], Array]:
    """What follows from half-widths (6,) of all errors.

    Returns:
        how it ends, thickness of the contacts at the goal (r,), overtravel, radii of the drift, of the translation and
        of the angle with the turn's second order (m, rad), and what the linear picture leaves of different frames (2,).
    """
    far, turn, rate, leaning, share = way[0], way[1], way[2], way[3], way[4]
    box = np.empty(6)
    for i in range(6):
        box[i] = half[i] + _ALLOWANCE
    theta = _length(box[3], box[4], box[5])
    # Bounds of translation and angle with their drift, before contacts take it up.
    wide, wider = _length(box[0], box[1], box[2]) + 2.0 * rates[0] * far, theta + 2.0 * rates[1] * far
    coupling = coupled(links, box, turn)
    final = left(lines, turn, box, coupling)
    for i in range(len(final)):
        final[i] += rest[i] if i < held else rest[i] + residue[0] * wide + residue[1] * wider
    beyond, nothing = 0.0, (0.0, 0.0)
    if rate > 0.0:
        room = 1.0 - share * (late[1] + 0.75 * wider * turn * leaning / rate)
        if room < 0.5:
            return PAST, final, beyond, nothing, coupling
        delayed = 0.0
        for i in range(len(final)):
            delayed += delay[i] * final[i]
        beyond = (share * (late[0] + late[1]) + delayed) / room
    gone = far * (1.0 + beyond)
    a, b, swung = rates[0] * gone, rates[1] * gone, beyond * turn
    if beyond > 1.0 or theta + b + swung > _FAR:
        return LARGE, final, beyond, nothing, coupling
    return SETTLED, final, beyond, (a, b + 0.5 * (theta + b) * swung * (1.0 + theta + b + swung)), coupling


@part
def _drifted(radius: float, drifts: Array) -> tuple[float, float]:
    """Of what a drift is made up, the carried one and a unit's (2, 7), in squares; see `_sum` and `_spread`."""
    s1, s2 = math.sqrt(drifts[0, 6]), radius * math.sqrt(drifts[1, 6])
    if s1 == 0.0:
        return 0.0, radius * radius
    if s2 == 0.0:
        return 1.0, 0.0
    return 1.0 + s2 / s1, (1.0 + s1 / s2) * radius * radius


@part
def _boxes(core: Array, image: Array, slide: Array, swing: Array) -> Array:
    """Half-widths (3, 6): of the start set without thickness, of its carried core alone, and to begin with.

    What errors are at the start is a good first guess, and too wide where the motion takes much of their drift away.
    """
    found = np.empty((3, 6))
    for i in range(6):
        start, goal, slid, swung = 0.0, 0.0, 0.0, 0.0
        for k in range(len(core)):
            start, goal = start + abs(core[k, i]), goal + abs(image[k, i])
        for k in range(slide.shape[1]):
            slid += slide[i, k] * slide[i, k]
        for k in range(swing.shape[1]):
            swung += swing[i, k] * swing[i, k]
        width = math.sqrt(slid) + math.sqrt(swung)
        found[0, i], found[1, i], found[2, i] = start + width, goal, max(start, goal) + width
    return found


@part
def _widths(
    final: Array,
    held: int,
    radii: tuple[float, float],
    boxes: Array,
    drifts: Array,
    start_dual: Array,
    goal_dual: Array,
    coupling: Array,
) -> Array:
    """Half-widths (6,) of the box around the errors at both ends."""
    (x, y), (z, w) = _drifted(radii[0], drifts[0]), _drifted(radii[1], drifts[1])
    found = np.empty(6)
    for i in range(6):
        own, slid = boxes[0, i], math.sqrt(x * drifts[0, 0, i] + y * drifts[0, 1, i])
        after = boxes[1, i] + slid + math.sqrt(z * drifts[1, 0, i] + w * drifts[1, 1, i])
        for k in range(held):
            own += abs(start_dual[i, k]) * final[k]
        for k in range(len(final)):
            after += abs(goal_dual[i, k]) * final[k]
        found[i] = max(own, after) + coupling[i // 3]
    return found


@part
def _raised(half: Array, wider: Array) -> tuple[bool, bool]:
    """Raises half-widths (6,) to those computed with them; whether any was short, and whether all are tight."""
    short, close, tight = False, True, True
    for i in range(6):
        short = short or wider[i] > half[i] * (1.0 - _SETTLED)
        close = close and wider[i] <= half[i] * (1.0 + 10.0 * _ABOVE)
        tight = tight and half[i] <= wider[i] * (1.0 + _TIGHT)
    for i in range(6):
        if wider[i] > half[i] * (1.0 - _SETTLED):
            # Close to the fixed point a little is added, that rounding does not matter.
            half[i] = max(half[i], wider[i]) * (1.0 + _ABOVE if close else 1.0)
    return short, tight


@compiled
def carried(
    lines: Array,
    f: Array,
    N: Array,
    off: Array,
    residue: Array,
    start_dual: Array,
    goal_dual: Array,
    delay: Array,
    way: Array,
    seen: Array,
    projector: Array,
    core: Array,
    slide: Array,
    swing: Array,
    shape: Array,
    moved: Array,
    moved_shape: Array,
    links: Array,
    rates: tuple[float, float],
    rho: float,
) -> tuple[int, Array, Array, float, Array, Array, Array, Array]:
    """Carries an error set through a piece of motion; see `segment`.

    Args:
        lines: how the rows of the contacts (r) bend; those held, and on the last piece the one being made.
        f: values (h,) of the rows of those held, h, at the start, m.
        N: their gradients (h, 6).
        off: sizes of the values (r,) at the goal, m.
        residue: what rounding leaves of the made one under the projection, per m and per rad (2,).
        start_dual: T^S (6, h).
        goal_dual: T^G (6, r).
        delay: how much farther the execution goes for each thickness (r,), as a share of the piece, 1/m.
        way: length (m), turn (rad), rate (m), |turning part of N′|, and the share of the move (5,).
        seen: N′ (6,).
        projector: Π (6, 6).
        core: generators (k, 6) of the start set without its old thickness.
        slide: root (6, a) of its drift in translation.
        swing: root (6, b) of its drift in rotation.
        shape: root (6, s) of its shape.
        moved: the generators (k, 6) as the motion alone would carry them on, before contacts take errors up.
        moved_shape: root (6, s′) of the shape, likewise.
        links: sizes of the errors in different frames (5,), see `coupled`.
        rates: velocity errors per unit of length, in translation and in angle (1/m).
        rho: ρ, m.

    Returns:
        how it ends; half-widths (6,) of a box around the errors all along; thickness of the contacts at the goal (r,);
        overtravel; and generators (k + r, 6), roots of both drifts (6, …) and of the shape (6, s′) at the goal.
    """
    image = np.zeros(core.shape)
    for k in range(len(core)):
        for i in range(6):
            for j in range(6):
                image[k, i] += projector[i, j] * moved[k, j]
    slide_there, swing_there = _mapped(projector, slide), _mapped(projector, swing)
    shape_there = _mapped(projector, moved_shape)
    held, rest = len(f), off.copy()
    for k in range(held):
        reach = min(_reach(N[k], core, slide, swing), _radius(N[k], shape))
        rest[k] = max(abs(f[k]) + reach, rest[k])
    drifts, boxes = _spread(slide_there, swing_there, projector, rho), _boxes(core, image, slide, swing)
    late = (0.0, 0.0)
    if way[2] > 0.0:
        leaning = _length(seen[0], seen[1], seen[2]) * rates[0], way[3] * rates[1]
        late = (_reach(seen, moved, slide, swing) / way[2], (leaning[0] + leaning[1]) * way[0] / way[2])
    radii, code, final, beyond, half = (0.0, 0.0), THICK, rest, 0.0, np.empty(6)
    for attempt in range(2):
        for i in range(6):  # at first from what is likely; where that is not tight, from below
            half[i] = boxes[2, i] if attempt == 0 else max(boxes[0, i], boxes[1, i])
        code, tight = THICK, False
        for _ in range(_ROUNDS):
            code, final, beyond, radii, coupling = _grown(
                half, lines, rest, held, residue, delay, way, late, rates, links
            )
            if code != SETTLED:
                break
            short, tight = _raised(half, _widths(final, held, radii, boxes, drifts, start_dual, goal_dual, coupling))
            if not short:
                break
            code = THICK
            if max(half[0], half[1], half[2], half[3], half[4], half[5]) > _FAR:
                break
        if code != SETTLED or tight:
            break
    generators = np.empty((len(core) + len(final), 6))
    if code != SETTLED:
        return code, half, final, beyond, generators, slide_there, swing_there, shape_there
    slid, swung = _ball(projector, 0, radii[0]), _ball(projector, 3, radii[1])
    slide_there, swing_there = _sum(slide_there, slid, rho), _sum(swing_there, swung, rho)
    shape_there = _sum(_sum(shape_there, slid, rho), swung, rho)
    thick = np.empty((6, len(final)))
    for i in range(6):
        for k in range(len(core)):
            generators[k, i] = image[k, i]
        for k in range(len(final)):
            generators[len(core) + k, i] = goal_dual[i, k] * final[k]
            thick[i, k] = math.sqrt(len(final)) * generators[len(core) + k, i]
    shape_there = _sum(shape_there, thick, rho)
    return code, half, final, beyond, generators, _narrow(slide_there), _narrow(swing_there), _narrow(shape_there)
