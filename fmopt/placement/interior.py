"""Interior points of small second-order cone programs, as compiled kernels.

    minimise  q·v   subject to   M v + s = h,   s = (s₀, s₁, …),  s₀ ≥ 0,  s_k0 ≥ |(s_k1, s_k2, …)|

A primal-dual method from an infeasible start, with the scaling W of Nesterov and Todd, W z = W⁻¹ s, and Mehrotra's
predictor and corrector. Each step factors the normal equations MᵀW⁻²M once, summed from the sparse rows of M.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fmopt.compiled import compiled, part
from fmopt.values import Array

_BACK = 0.99  # of the way to the border of the cone
_BEGIN = 0.3  # least distance from the border of the cone at the start, and the multipliers there
_DEAD = 1e-30  # pivots as small as this, beside the largest, hold their unknown where it is
_AGAIN = 3  # refinements of a step, at most

Indices = NDArray[np.intp]
Counts = NDArray[np.uint32]  # never negative, which Numba need not ask then
Rows = tuple[Counts, Counts, Array]  # where each row's numbers start (m + 1,), their columns and the numbers (nnz,)
Cones = tuple[int, Indices, Indices]  # how many rows the orthant has, where the cones' rows begin and end (K,)
Scaling = tuple[Array, Array]  # W⁻² of the orthant's rows with w of the cones' (m,), and their η (K,)
Step = tuple[Array, Array, Array]  # of v (n,), s (m,) and z (m,)


@compiled
def optimum(
    M: Array, h: Array, q: Array, flat: int, widths: Indices, tolerance: float, iterations: int
) -> tuple[Array, Array, bool]:
    """An optimum and its multipliers.

    Args:
        M: coefficients (m, n), rows of the orthant first.
        h: right-hand sides (m,).
        q: what is minimised (n,).
        flat: how many rows stand in the orthant.
        widths: how many rows each second-order cone has (K,).
        tolerance: of residuals, and of the gap beside one and the value.
        iterations: at most.

    Returns:
        v (n,), multipliers z (m,) in the cone, and whether they are within the tolerance.
    """
    m, n = M.shape
    rows = _rows(M)
    cones = _cones(flat, widths)
    scaling = (np.empty(m), np.empty(len(widths)))
    U, rd = np.empty((n, n)), q.copy()
    v, s, z = np.zeros(n), h.copy(), np.zeros(m)
    step = (np.empty(n), np.empty(m), np.empty(m))
    _begin(s, z, cones)
    rp = s.copy()
    _add(rp, -1.0, h)
    _add_transposed(rows, z, rd)
    for _ in range(iterations):
        gap = _dot(s, z)
        if max(_most(rp), _most(rd)) <= tolerance and gap <= tolerance * (1.0 + abs(_dot(q, v))):
            return v, z, True
        if not _scale(s, z, cones, scaling):
            break
        _factor(rows, cones, scaling, U)
        sigma, slope = _newton(rows, cones, scaling, U, s, z, rp, rd, 0.1 * tolerance, step)
        primal = min(1.0, _BACK * _reach(s, step[1], cones))
        dual = min(1.0, _BACK * _reach(z, step[2], cones))
        _add(v, primal, step[0])
        _add(s, primal, step[1])
        _add(z, dual, step[2])
        _add(rp, -primal * (1.0 - sigma), rp)
        _add(rd, dual, slope)
    return v, z, False


@part
def _newton(
    rows: Rows,
    cones: Cones,
    scaling: Scaling,
    U: Array,
    s: Array,
    z: Array,
    rp: Array,
    rd: Array,
    exact: float,
    step: Step,
) -> tuple[float, Array]:
    """Mehrotra's step: what share of the gap it aims at, and Mᵀ dz."""
    dv, ds, dz = step
    target, slope = np.zeros(len(s)), np.zeros(len(rd))
    _add(target, -1.0, s)  # the predictor goes straight for the optimum
    _direction(rows, cones, scaling, U, rp, rd, 1.0, target, step)
    primal, dual = min(1.0, _reach(s, ds, cones)), min(1.0, _reach(z, dz, cones))
    gap = ahead = 0.0
    for i in range(len(s)):
        gap += s[i] * z[i]
        ahead += (s[i] + primal * ds[i]) * (z[i] + dual * dz[i])
    sigma = min(1.0, max(0.0, ahead / gap)) ** 2
    degree = cones[0] + len(cones[1])
    _bent(s, z, ds, dz, sigma * gap / degree, cones, scaling, target)
    share = 1.0 - sigma
    _direction(rows, cones, scaling, U, rp, rd, share, target, step)
    left = np.empty(len(rd))
    for again in range(_AGAIN + 1):
        slope[:] = 0.0
        _add_transposed(rows, dz, slope)
        for j in range(len(rd)):
            left[j] = -share * rd[j] - slope[j]
        if again == _AGAIN or _most(left) <= exact:
            break
        _solve(U, left)
        _times(rows, left, target)
        _add(dv, 1.0, left)
        _add(ds, -1.0, target)
        _weight(target, cones, scaling)
        _add(dz, 1.0, target)
    return sigma, slope


@part
def _direction(
    rows: Rows,
    cones: Cones,
    scaling: Scaling,
    U: Array,
    rp: Array,
    rd: Array,
    share: float,
    target: Array,
    step: Step,
) -> None:
    """Newton's direction: M dv + ds = −share rp, Mᵀ dz = −share rd, ds + W² dz = target."""
    dv, ds, dz = step
    for i in range(len(rp)):
        dz[i] = -share * rp[i] - target[i]
    _weight(dz, cones, scaling)
    for j in range(len(rd)):
        dv[j] = -share * rd[j]
    _add_transposed(rows, dz, dv)
    _solve(U, dv)
    _times(rows, dv, ds)
    for i in range(len(rp)):
        ds[i] = -ds[i] - share * rp[i]
        dz[i] = target[i] - ds[i]
    _weight(dz, cones, scaling)


@part
def _cones(flat: int, widths: Indices) -> Cones:
    """Where cones of these widths lie, after the orthant."""
    begins, ends = np.empty_like(widths), np.empty_like(widths)
    end = flat
    for k in range(len(widths)):
        begins[k] = end
        end += widths[k]
        ends[k] = end
    return flat, begins, ends


@part
def _rows(M: Array) -> Rows:
    """The numbers of M that are not zero, row by row."""
    m, n = M.shape
    starts, columns = np.empty(m + 1, dtype=np.uint32), np.empty(m * n, dtype=np.uint32)
    numbers = np.empty(m * n)
    k = 0
    for i in range(m):
        starts[i] = k
        for j in range(n):
            if M[i, j] != 0.0:
                columns[k], numbers[k] = j, M[i, j]
                k += 1
    starts[m] = k
    return starts, columns[:k], numbers[:k]


@part
def _times(rows: Rows, v: Array, out: Array) -> None:
    """out ← M v."""
    starts, columns, numbers = rows
    for i in range(len(out)):
        total = 0.0
        for k in range(starts[i], starts[i + 1]):
            total += numbers[k] * v[columns[k]]
        out[i] = total


@part
def _add_transposed(rows: Rows, z: Array, out: Array) -> None:
    """out ← out + Mᵀ z."""
    starts, columns, numbers = rows
    for i in range(len(z)):
        for k in range(starts[i], starts[i + 1]):
            out[columns[k]] += numbers[k] * z[i]


@part
def _add(x: Array, factor: float, y: Array) -> None:
    """x ← x + factor y."""
    for i in range(len(x)):
        x[i] += factor * y[i]


@part
def _dot(x: Array, y: Array) -> float:
    total = 0.0
    for i in range(len(x)):
        total += x[i] * y[i]
    return total


@part
def _most(x: Array) -> float:
    most = 0.0
    for i in range(len(x)):
        most = max(most, abs(x[i]))
    return most


@part
def _length(s: Array, i: int, j: int) -> float:
    total = 0.0
    for r in range(i, j):
        total += s[r] * s[r]
    return math.sqrt(total)


@part
def _lorentz(s: Array, i: int, j: int) -> float:
    """s₀² − |s₁|² of the cone in rows i to j, as a product, which stays exact near the border."""
    tip, length = float(s[i]), _length(s, i + 1, j)
    return (tip - length) * (tip + length)


@part
def _begin(s: Array, z: Array, cones: Cones) -> None:
    """Raises s into the cone, and sets z on its axis."""
    flat, begins, ends = cones
    for i in range(flat):
        s[i], z[i] = max(s[i], _BEGIN), _BEGIN
    for k in range(len(begins)):
        i = begins[k]
        s[i], z[i] = max(s[i], _BEGIN + _length(s, i + 1, ends[k])), _BEGIN


@part
def _scale(s: Array, z: Array, cones: Cones, scaling: Scaling) -> bool:
    """Sets the scaling of s and z; False where one of them left the cone."""
    flat, begins, ends = cones
    w, eta = scaling
    for i in range(flat):
        if not (s[i] > 0.0 and z[i] > 0.0):
            return False
        w[i] = z[i] / s[i]
    for k in range(len(begins)):
        i, j = begins[k], ends[k]
        a, b = _lorentz(s, i, j), _lorentz(z, i, j)
        if not (a > 0.0 and b > 0.0 and s[i] > 0.0 and z[i] > 0.0):
            return False
        a, b = np.sqrt(a), np.sqrt(b)
        product = 0.0
        for r in range(i, j):
            product += s[r] * z[r]
        half = 2.0 * np.sqrt(0.5 * (1.0 + product / (a * b)))
        w[i] = (s[i] / a + z[i] / b) / half
        for r in range(i + 1, j):
            w[r] = (s[r] / a - z[r] / b) / half
        eta[k] = np.sqrt(a / b)
    return True


@part
def _turn(x: Array, i: int, j: int, w: Array, sign: float, scale: float, out: Array) -> None:
    """W x of the cone in rows i to j, with η as scale; W⁻¹ x with the sign −1 and 1/η."""
    along = 0.0
    for r in range(i + 1, j):
        along += w[r] * x[r]
    along *= sign
    tip = x[i]
    factor = sign * (tip + along / (1.0 + w[i]))
    out[i] = scale * (w[i] * tip + along)
    for r in range(i + 1, j):
        out[r] = scale * (x[r] + factor * w[r])


@part
def _weight(x: Array, cones: Cones, scaling: Scaling) -> None:
    """x ← W⁻² x."""
    flat, begins, ends = cones
    w, eta = scaling
    for i in range(flat):
        x[i] *= w[i]
    for k in range(len(begins)):
        for _ in range(2):
            _turn(x, begins[k], ends[k], w, -1.0, 1.0 / eta[k], x)


@part
def _bent(s: Array, z: Array, ds: Array, dz: Array, mu: float, cones: Cones, scaling: Scaling, target: Array) -> None:
    """target ← W u − s, with W z ∘ u = mu e − W⁻¹ds ∘ W dz; ds and dz are used up."""
    flat, begins, ends = cones
    w, eta = scaling
    for i in range(flat):
        target[i] = (mu - ds[i] * dz[i]) / z[i] - s[i]
    for k in range(len(begins)):
        i, j = begins[k], ends[k]
        _turn(ds, i, j, w, -1.0, 1.0 / eta[k], ds)
        _turn(dz, i, j, w, 1.0, eta[k], dz)
        _turn(z, i, j, w, 1.0, eta[k], target)
        product, along = mu - ds[i] * dz[i], 0.0
        for r in range(i + 1, j):
            product -= ds[r] * dz[r]
            dz[r] = -(ds[i] * dz[r] + dz[i] * ds[r])
            along += target[r] * dz[r]
        tip = (target[i] * product - along) / _lorentz(target, i, j)
        for r in range(i + 1, j):
            target[r] = (dz[r] - tip * target[r]) / target[i]
        target[i] = tip
        _turn(target, i, j, w, 1.0, eta[k], target)
        for r in range(i, j):
            target[r] -= s[r]


@part
def _reach(s: Array, ds: Array, cones: Cones) -> float:
    """How far s can go along ds inside the cone."""
    flat, begins, ends = cones
    most = 0.0
    for i in range(flat):
        most = max(most, -ds[i] / s[i])
    far = 1.0 / most if most > 0.0 else np.inf
    for k in range(len(begins)):
        i, j = begins[k], ends[k]
        b = s[i] * ds[i]
        for r in range(i + 1, j):
            b -= s[r] * ds[r]
        a, c = _lorentz(ds, i, j), _lorentz(s, i, j)  # the border is where a t² + 2 b t + c = 0
        root = np.sqrt(max(b * b - a * c, 0.0))
        if b < 0.0 and (a < 0.0 or b * b >= a * c):
            far = min(far, c / (root - b))
        elif a < 0.0:
            far = min(far, (-b - root) / a)
    return far


@part
def _factor(rows: Rows, cones: Cones, scaling: Scaling, U: Array) -> None:
    """The upper triangle U with UᵀU = MᵀW⁻²M; on its diagonal the inverse of what stands there."""
    starts, columns, numbers = rows
    flat, begins, ends = cones
    w, eta = scaling
    U[:] = 0.0
    for i in range(flat):
        _add_square(rows, i, w[i], U)
    for k in range(len(begins)):  # W⁻² = (2 u uᵀ − J) / η², u = J w
        square = 1.0 / (eta[k] * eta[k])
        u = np.zeros(len(U))
        for i in range(begins[k], ends[k]):
            sign = 1.0 if i == begins[k] else -1.0
            _add_square(rows, i, -sign * square, U)
            for p in range(starts[i], starts[i + 1]):
                u[columns[p]] += sign * w[i] * numbers[p]
        for a in range(len(U)):
            if u[a] != 0.0:
                factor = 2.0 * square * u[a]
                for b in range(a, len(U)):
                    U[a, b] += factor * u[b]
    _cholesky(U)


@part
def _add_square(rows: Rows, i: int, weight: float, U: Array) -> None:
    """Adds weight m mᵀ of row m = M[i] to the upper triangle U."""
    starts, columns, numbers = rows
    for p in range(starts[i], starts[i + 1]):
        a, factor = columns[p], weight * numbers[p]
        for r in range(p, starts[i + 1]):
            U[a, columns[r]] += factor * numbers[r]


@part
def _cholesky(U: Array) -> None:
    n = len(U)
    used = np.empty(n, dtype=np.intp)
    most = 0.0
    for k in range(n):
        most = max(most, U[k, k])
    for k in range(n):
        if not U[k, k] > _DEAD * most:
            for j in range(k, n):
                U[k, j] = 0.0
            continue
        inverse = 1.0 / np.sqrt(U[k, k])
        U[k, k] = inverse
        count = 0
        for j in range(k + 1, n):
            if U[k, j] != 0.0:
                U[k, j] *= inverse
                used[count] = j
                count += 1
        for a in range(count):
            i, factor = used[a], U[k, used[a]]
            for b in range(a, count):
                U[i, used[b]] -= factor * U[k, used[b]]


@part
def _solve(U: Array, x: Array) -> None:
    """x ← (UᵀU)⁻¹ x, U with the inverse of its diagonal."""
    n = len(x)
    for k in range(n):
        x[k] *= U[k, k]
        for j in range(k + 1, n):
            x[j] -= U[k, j] * x[k]
    for k in range(n - 1, -1, -1):
        total = x[k]
        for j in range(k + 1, n):
            total -= U[k, j] * x[j]
        x[k] = total * U[k, k]
