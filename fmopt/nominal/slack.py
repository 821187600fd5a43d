"""Whether contact is possible within the box of pose errors: small linear programs, exact where two rows decide.

Contact is possible when a candidate's bounds can hold with f ≤ 0 and also with f ≥ 0, that is, when

    φ = min over both signs of  max_e min(∓N·e ∓ f₀ + ρ, cₖ + Bₖ·e + ρ)

over |eᵢ| ≤ aᵢ is not negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fmopt.errors import SolverError
from fmopt.nominal.touch import Linear
from fmopt.values import Array

_TOLERANCE = 1e-10  # of the linear programs, in scaled units


def slack(made: Linear, half_widths: Array, remainder: float, unit: float) -> Array:
    """φ (n,) of linearised candidates with `remainder` (m) for the ρ of f, divided by `unit` (m).

    With u = e / a the interval bound min_k (c_k + |B_k|₁) is φ itself when no other row can fall below it; two rows
    are solved by the dual, which is piecewise linear in one variable; more by one linear program for all.
    """
    n, k = made.heights.shape
    c, B = np.empty((2, n, k + 1)), np.empty((2, n, k + 1, 6))
    for sign, values, rows in zip((-1.0, 1.0), c, B, strict=True):
        values[:, 0], values[:, 1:] = sign * made.distance, made.heights
        rows[:, 0], rows[:, 1:] = sign * made.gradient, made.rows
    c[:, :, 0] += remainder
    c[:, :, 1:] += made.remainder[:, 1:]
    c, B = c / unit, B * half_widths / unit
    c, B = c.reshape(2 * n, k + 1), B.reshape(2 * n, k + 1, 6)
    reach = np.abs(B).sum(axis=2)
    value = (c + reach).min(axis=1)
    matters = c - reach < value[:, None]
    matters[:, 1:] &= (c[:, 1:] != c[:, :-1]) | np.any(B[:, 1:] != B[:, :-1], axis=2)
    rows = np.where(value >= 0.0, matters.sum(axis=1), 0)
    two = np.flatnonzero(rows == 2)
    if two.size:
        first, second = np.nonzero(matters[two])[1].reshape(-1, 2).T
        value[two] = _two_rows(c[two, first], c[two, second], B[two, first], B[two, second])
    many = np.flatnonzero(rows > 2)
    if many.size:
        value[many] = _maximin([(c[i, matters[i]], B[i, matters[i]]) for i in many])
    return np.asarray(value.reshape(2, n).min(axis=0))


def _two_rows(c: Array, d: Array, B: Array, C: Array) -> Array:
    """min over 0 ≤ λ ≤ 1 of λ c + (1 − λ) d + |λ B + (1 − λ) C|₁ for c, d (n,) and B, C (n, 6): least at a kink."""
    fall = C - B
    kinks = np.divide(C, fall, out=np.zeros_like(C), where=fall != 0.0)
    share = np.clip(np.column_stack([kinks, np.zeros(len(c)), np.ones(len(c))]), 0.0, 1.0)[..., None]
    blend = share[..., 0] * c[:, None] + (1.0 - share[..., 0]) * d[:, None]
    return np.asarray((blend + np.abs(share * B[:, None] + (1.0 - share) * C[:, None]).sum(axis=2)).min(axis=1))


def _maximin(blocks: Sequence[tuple[Array, Array]]) -> Array:
    """max over |u| ≤ 1 of min_k (c_k + B_k·u) for each block (c (k,), B (k, 6)), through HiGHS."""
    from scipy.optimize import linprog
    from scipy.sparse import csr_array

    sizes = np.array([len(c) for c, _ in blocks])
    columns = np.repeat(7 * np.arange(len(blocks)), sizes)[:, None] + np.arange(7)
    values = np.hstack([-np.vstack([B for _, B in blocks]), np.ones((sizes.sum(), 1))])
    A: Any = csr_array(
        (values.ravel(), columns.ravel(), 7 * np.arange(sizes.sum() + 1)), shape=(sizes.sum(), 7 * len(blocks))
    )
    cost = np.tile([0.0] * 6 + [-1.0], len(blocks))
    limits: Any = np.tile([[-1.0, 1.0]] * 6 + [[-np.inf, np.inf]], (len(blocks), 1))
    options: Any = {"primal_feasibility_tolerance": _TOLERANCE, "dual_feasibility_tolerance": _TOLERANCE}
    answer = linprog(cost, A_ub=A, b_ub=np.concatenate([c for c, _ in blocks]), bounds=limits, options=options)
    if answer.status != 0:
        raise SolverError(f"the touch programs stopped: {answer.message}", "check the half-widths of the pose error")
    u = np.clip(np.asarray(answer.x).reshape(-1, 7)[:, :6], -1.0, 1.0)
    return np.array([float(np.min(c + B @ x)) for (c, B), x in zip(blocks, u, strict=True)])
