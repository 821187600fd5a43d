"""Kernels of rows: value, gradient, and what the linear picture leaves over a piece of motion.

A row is a function of the pose p, R of the moving part,

    f = n·p + u·(R k) + (R b)·(σ p + a × p + s) − c,

which is what definitions of contacts come to (`rows`). What the formulas of remainders mean is told in `curvature`.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from fmopt.runtime.compiled import part
from fmopt.spatial.kernels import Vector, cross, dot, halves, plus, size, swung, turned, vector
from fmopt.spatial.values import Array

ROW = np.dtype(
    [*((name, "f8", 3) for name in "nukbas"), *((name, "f8") for name in ("c", "sign", "lever")), ("bilinear", "i8")]
)
"""A row: n, u, k, b, a, s, c, σ, |u||k| in m, and whether b is there at all."""

Table: TypeAlias = Any  # rows (k,)
Row: TypeAlias = Any
End: TypeAlias = tuple[Vector, Vector, Vector]


class Turned(NamedTuple):
    """The vectors of rows that turn: w = R k, b = R b and y = σ p + a × p + s, each (…, k, 3)."""

    w: Array
    b: Array
    y: Array


class Bending(NamedTuple):
    """Rows (k) along a piece of motion V = (Δ, τ) (6,), m and rad, and what turns at both ends (2, k, 3)."""

    table: Table
    turned: Turned
    twist: Array


@part
def value(row: Row, p: Vector, R: Array) -> tuple[float, Vector, Vector, End]:
    """f at a pose, p in m and R (3, 3), its gradient in translation and in rotation, and what turns: w, b, y."""
    n, u, w = vector(row["n"]), vector(row["u"]), turned(R, vector(row["k"]))
    # ∇ of n·p is n; a turn by δ adds δ × w to w, and u·(δ × w) = (w × u)·δ.
    f, moving, turning = dot(n, p) + dot(u, w) - row["c"], n, cross(w, u)
    b = y = (0.0, 0.0, 0.0)
    if row["bilinear"]:
        a, sign = vector(row["a"]), row["sign"]
        b, y = turned(R, vector(row["b"])), plus(plus(vector(row["s"]), 1.0, cross(a, p)), sign, p)
        f += dot(b, y)
        # Product rule: A = σ + [a]× maps a translation onto y, and a turn moves b by δ × b.
        moving, turning = plus(plus(n, 1.0, cross(b, a)), sign, b), plus(turning, 1.0, cross(b, y))
    return f, moving, turning, (w, b, y)


@part
def reach(row: Row, start: End, goal: End) -> float:
    """|u||k| + |b||y|, y at the end where it is larger: what a small turn moves by at most, m."""
    found: float = row["lever"]
    if row["bilinear"]:
        # The end farther away: lengths between two positions of a straight way are at most that of one of its ends.
        found += max(size(start[2]), size(goal[2]))
    return found


@part
def end_of(turned: Turned, e: int, i: int) -> End:
    """What turns of row i at an end."""
    return vector(turned.w[e, i]), vector(turned.b[e, i]), vector(turned.y[e, i])


@part
def slid(row: Row, move: Vector) -> Vector:
    """A Δ, A = σ + [a]×."""
    return plus(cross(vector(row["a"]), move), row["sign"], move)


@part
def _columns(row: Row) -> tuple[Vector, Vector, Vector]:
    """Those of A = σ + [a]×, to which translations of a box are put."""
    a, sign = vector(row["a"]), row["sign"]
    return (sign, a[2], -a[1]), (-a[2], sign, a[0]), (a[1], -a[0], sign)


@part
def remainder(row: Row, ends: tuple[End, End], twist: tuple[Vector, Vector], half: tuple[Vector, Vector]) -> float:
    """What the linear picture of a row leaves over a twist (Δ, τ) with errors in a box of half-widths, m and rad."""
    # Bilinear rows have products of translation and turn as well, and terms of third order.
    return _bent(row, ends, twist, half) if row["bilinear"] else _straight(row, ends, twist, half)


@part
def _straight(row: Row, ends: tuple[End, End], twist: tuple[Vector, Vector], half: tuple[Vector, Vector]) -> float:
    """The remainder of a row without b."""
    turn, angles, u, w = twist[1], half[1], vector(row["u"]), ends[0][0]
    theta, swept = size(angles), size(cross(turn, w))
    # ε × w at its largest end, and half the sweep of the nominal arc between, where w points elsewhere.
    most = max(swung(w, angles, theta), swung(ends[1][0], angles, theta)) + 0.5 * theta * swept
    left = 0.5 * (min(most, theta * size(w)) + swept)
    # 1/2 |ε × u||ε × w|, 1/2 |ε × u||τ × w| and 1/8 |τ × u||τ × w|, with the better of two bounds for each length.
    return swung(u, angles, theta) * left + size(cross(turn, u)) * (0.125 * swept)


@part
def _bent(row: Row, ends: tuple[End, End], twist: tuple[Vector, Vector], half: tuple[Vector, Vector]) -> float:
    """The remainder of a bilinear row."""
    (move, turn), (offset, angles), a = twist, half, vector(row["a"])
    theta, tau, arm = size(angles), size(turn), reach(row, ends[0], ends[1])
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    sides = (z * offset[1] + y * offset[2], z * offset[0] + x * offset[2], y * offset[0] + x * offset[1])
    # |M d| over the box of d, component by component.
    felt, seen = size(plus(sides, abs(row["sign"]), offset)), size(slid(row, move))
    # Second order at either end: half the Hessian over the box, the chord of the arc, and the turn of the gradient.
    second, chord, turning = 0.0, 0.0, 0.0
    for end in ends:
        second = max(second, _drawn(row, end, offset, angles))
        moving, spinning = _changed(row, end, move, turn)
        chord = max(chord, abs(dot(moving, move) + dot(spinning, turn)))
        for i in range(3):
            turning += abs(moving[i]) * offset[i] + abs(spinning[i]) * angles[i]
    # Between the ends the second derivative differs from that at the nearer one by the third order.
    chord = 0.125 * chord + tau**2 * (tau * arm + 3.0 * seen) / 16.0
    # What is of third order in errors and turn together, by the lengths of all vectors.
    third = theta**2 * ((theta / 6.0 + 0.25 * tau) * arm + 0.5 * felt + 0.25 * seen) + 0.5 * theta * tau * felt
    third += 0.125 * tau * (theta * tau * arm + tau * felt + 2.0 * theta * seen)
    coarse = (0.5 * theta**2 + tau**2 / 8.0 + 0.5 * tau * theta) * arm
    coarse += (theta + 0.5 * tau) * felt + (0.25 * tau + 0.5 * theta) * seen
    # Second order may be the worse bound for large errors: the quick one holds as well.
    return min(second + chord + 0.25 * turning + third, coarse)


@part
def _drawn(row: Row, end: End, offset: Vector, angles: Vector) -> float:
    """The most of a bilinear row's Hessian at an end: ½ ε·G ε and ε·[b]× A d over the box of the errors."""
    u, (w, b, y), columns = vector(row["u"]), end, _columns(row)
    # The Hessian of the rotation, symmetric: trace on the diagonal, less products of what turns.
    trace, found = dot(u, w) + dot(b, y), 0.0
    for i in range(3):
        found += 0.5 * abs(trace - w[i] * u[i] - b[i] * y[i]) * angles[i] * angles[i]
        for j in range(i):
            found += 0.5 * abs(w[i] * u[j] + b[i] * y[j] + w[j] * u[i] + b[j] * y[i]) * angles[i] * angles[j]
    for j in range(3):
        mixed = cross(b, columns[j])
        found += offset[j] * (abs(mixed[0]) * angles[0] + abs(mixed[1]) * angles[1] + abs(mixed[2]) * angles[2])
    return found


@part
def _changed(row: Row, end: End, move: Vector, turn: Vector) -> tuple[Vector, Vector]:
    """J: how a row's gradient changes along the path, Aᵀ(τ × b) and b × A Δ − G τ."""
    u, (w, b, y) = vector(row["u"]), end
    return _sloped(row, end, (move, turn), (u, y), (w, b))


@part
def power(row: Row, end: End, move: Vector, turn: Vector) -> tuple[Vector, Vector]:
    """How N·V, V = (Δ, τ), m and rad, changes with a small error: Aᵀ(τ × b) and b × A Δ − Gᵀ τ."""
    u, (w, b, y) = vector(row["u"]), end
    return _sloped(row, end, (move, turn), (w, b), (u, y))


@part
def _sloped(
    row: Row, end: End, V: tuple[Vector, Vector], seen: tuple[Vector, Vector], along: tuple[Vector, Vector]
) -> tuple[Vector, Vector]:
    """Aᵀ(τ × b), and b × A Δ − (u·w + b·y) τ + Σ (seen·τ) along."""
    u, (w, b, y), (move, turn) = vector(row["u"]), end, V
    pulled = cross(turn, b)
    spun = plus(plus(cross(b, slid(row, move)), dot(seen[0], turn), along[0]), dot(seen[1], turn), along[1])
    return plus(cross(pulled, vector(row["a"])), row["sign"], pulled), plus(spun, -dot(u, w) - dot(b, y), turn)


@part
def unsteady(row: Row, arm: float, motion: tuple[float, float], reach: tuple[float, float]) -> float:
    """How much N·μ differs at most between poses, by lengths alone: of motions in any direction.

    `arm` is the row's `reach`, m, `motion` the lengths of μ, and `reach` how far the poses are apart at most, m and
    rad.
    """
    found = reach[1] * motion[1] * arm
    if row["bilinear"]:
        found += reach[1] * motion[0] + reach[0] * motion[1]
    return found


@part
def varying(
    row: Row, arm: float, motion: tuple[float, float], errors: tuple[float, float], way: tuple[float, float]
) -> float:
    """What N·μ at a pose of a piece differs by, at most, from its linear picture: that of both ends, interpolated.

    With μ = (x, ξ) it changes by u·(ξ × (E − 1)w) + (ξ × (E − 1)β)·y + (ξ × Eβ)·A d + (E − 1)β·A x, E the turn by ε.
    Beyond the first order in ε and d that is ½θ²(|ξ| arm + |x|) and θ|ξ||d| at most. On the nominal path all of it, and
    its first order, is off its chord by an eighth of its second derivative. Given are the row's `reach`, m, and the
    lengths of μ and of the piece's twist, m and rad.
    """
    (slide, spin), (offset, theta), (move, turn) = motion, errors, way
    swing, chord = spin * arm, 0.0
    left = 0.0
    if row["bilinear"]:
        swing += slide
        left = theta * offset * spin
        chord = 2.0 * (1.0 + theta) * turn * move * spin + turn * turn * offset * spin
    return left + 0.5 * theta * theta * swing + 0.125 * (chord + (1.0 + theta) * turn * turn * swing)


@part
def together(bending: Bending, shares: Array, off: Array, half: Array, coupling: Array) -> float:
    """What the linear picture of a combination of rows leaves where a piece ends, at most, m.

    At errors (d, ε) in a box a row is off its linear part by ½ε·G ε + ε·[β]× A d, G as in `_drawn`, and by a sixth of
    |ε|³ times its reach and ½|ε|²|A d|. In the sum of all first parts what rows have in common cancels.

    `shares` (k,) are of the rows, `off` (k,), m, what each is off by besides, `half` is the box (6,), m and rad, and
    the coupling (2,) what the linear picture leaves of errors in different frames, m and rad.
    """
    K, X, found = np.zeros((3, 3)), np.zeros((3, 3)), 0.0
    theta, offset = size((half[3], half[4], half[5])), size((half[0], half[1], half[2]))
    for k in range(len(shares)):
        row, share, end = bending.table[k], shares[k], end_of(bending.turned, 1, k)
        u, (w, b, y) = vector(row["u"]), end
        far, trace = reach(row, end, end), dot(u, w)
        found += abs(share) * (off[k] + coupling[0] + coupling[1] * far + theta**3 / 6.0 * far)
        for i in range(3):
            for j in range(3):
                K[i, j] += 0.25 * share * (w[i] * u[j] + w[j] * u[i])
        if row["bilinear"]:
            found += abs(share) * 0.5 * theta * theta * offset
            trace += dot(b, y)
            columns = _columns(row)
            for j in range(3):
                mixed = cross(b, columns[j])
                for i in range(3):
                    K[i, j] += 0.25 * share * (b[i] * y[j] + b[j] * y[i])
                    X[i, j] += share * mixed[i]
        for i in range(3):
            K[i, i] -= 0.5 * share * trace
    for i in range(3):
        for j in range(3):
            found += half[3 + i] * (abs(K[i, j]) * half[3 + j] + abs(X[i, j]) * half[j])
    return found


@part
def products(N: Array, motions: Array) -> Array:
    """Those (2, k, m) of rows (2, k, 6) at both ends with motions (m, 6)."""
    found = np.empty((2, N.shape[1], len(motions)))
    for e in range(2):
        for i in range(N.shape[1]):
            for j in range(len(motions)):
                found[e, i, j] = (N[e, i] * motions[j]).sum()
    return found


@part
def differing(bending: Bending, motions: Array, half: Array, drift: Array, shares: Array) -> tuple[Array, Array, Array]:
    """By how much products of rows with motions differ between poses from those at both ends, interpolated.

    Args:
        motions: (m, 6).
        half: half-widths (6,) of a box around the errors.
        drift: lengths of what is added to the motions in any direction (2,).
        shares: of each row (k,) in their combination.

    Returns:
        bounds (k, m), of the combination in place of the last row; how much the product of each row with the drift
        differs at most (k,); and how that of the combination changes with the error, at both ends (m, 2, 6).
    """
    k, m, (move, turn), (offset, angles) = len(shares), len(motions), halves(bending.twist), halves(half)
    errors, way, beside = (size(offset), size(angles)), (size(move), size(turn)), (drift[0], drift[1])
    own, loose, felt = np.zeros((k, m)), np.empty(k), np.zeros((m, 2, 6))
    beyond = np.zeros(m)
    for i in range(k):
        row, ends = bending.table[i], (end_of(bending.turned, 0, i), end_of(bending.turned, 1, i))
        arm = reach(row, ends[0], ends[1])
        loose[i] = unsteady(row, arm, beside, (errors[0] + way[0], errors[1] + way[1]))
        for j in range(m):
            slide, spin = halves(motions[j])
            for e in range(2):
                moving, spinning = power(row, ends[e], slide, spin)
                total = 0.0
                for x in range(3):
                    felt[j, e, x] += shares[i] * moving[x]
                    felt[j, e, 3 + x] += shares[i] * spinning[x]
                    total += abs(moving[x]) * offset[x] + abs(spinning[x]) * angles[x]
                own[i, j] = max(own[i, j], total)
            left = varying(row, arm, (size(slide), size(spin)), errors, way)
            own[i, j], beyond[j] = own[i, j] + left, beyond[j] + abs(shares[i]) * left
    for j in range(m):
        own[k - 1, j] = max(np.abs(felt[j, 0]) @ half, np.abs(felt[j, 1]) @ half) + beyond[j]
    return own, loose, felt
