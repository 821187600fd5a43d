"""When a corner can lie on an edge: the kernel against the same formulas in plain NumPy, and against a fine grid."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from fmopt.papers.lee_huang.line_contact import Leg, Lines, possible
from fmopt.spatial.values import Array

SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
ROUNDING = 1e-12


def random_lines(seed: int, count: int = 12) -> Lines:
    """Corners on edges, edges on corners, and circles, by turns, all near the leg of `random_leg`."""
    rng = np.random.default_rng(seed)
    c, m = rng.uniform(-2.0, 2.0, (2, count, 2, 2))
    kind = np.arange(count) % 3
    c[kind == 1, 1] = c[kind == 1, 0]
    m[kind == 0, 1] = m[kind == 0, 0]
    m[kind == 2] = 0.0
    turns = np.sort(rng.uniform(-0.3, 0.3, (count, 2)), axis=1)
    turns[kind == 2] = 0.0
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return Lines(c, m, np.column_stack([np.cos(angle), np.sin(angle)]), turns, np.where(kind == 2, 0.3, 0.0))


def random_leg(seed: int) -> Leg:
    rng = np.random.default_rng(1000 + seed)
    radius = rng.uniform(0.0, 0.4) * (seed % 4 > 0)
    travel = rng.uniform(-4.0, 4.0, 2) * (rng.random(2) > 0.2)
    return Leg(rng.uniform(-2.0, 2.0, 2), travel, radius, 0.3, 2.0)


def across(along: Array) -> Array:
    return np.array([-along[1], along[0]]) / np.linalg.norm(along)


def turns_of(A: float, B: float, C: float) -> list[float]:
    """The solutions of A cos ψ + B sin ψ = C between −π and π."""
    size = np.hypot(A, B)
    if size == 0.0 or abs(C) > size:
        return []
    both = np.arctan2(B, A) + np.array([-1.0, 1.0]) * np.arccos(C / size)
    return list(both - 2.0 * np.pi * np.round(both / (2.0 * np.pi)))


def ends(c: Array, m: Array, turn: float) -> Array:
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return c - m @ R.T


def meets(c: Array, m: Array, turn: float, point: Array, leg: Leg, slack: float) -> bool:
    """Whether the ball about a point meets the line at a turn."""
    P = ends(c, m, turn) - point
    reach = leg.radius + ROUNDING * leg.size + slack
    n = np.array([P[0, 1] - P[1, 1], P[1, 0] - P[0, 0]])
    level = abs(P[0] @ n) - leg.radius * np.abs(n).sum()
    near = np.all(P.min(axis=0) <= reach) and np.all(P.max(axis=0) >= -reach)
    return bool(near and level <= (ROUNDING * leg.size + slack) * np.linalg.norm(n))


def met(c: Array, m: Array, turns: Array, point: Array, leg: Leg, slack: float = 0.0) -> bool:
    """Whether it does at any turn allowed."""
    r, found = leg.radius, []
    for i, sign in product((0, 1), (-1.0, 1.0)):
        found += turns_of(m[i, 0], -m[i, 1], c[i, 0] - point[0] + sign * r)
        found += turns_of(m[i, 1], m[i, 0], c[i, 1] - point[1] + sign * r)
    turning = np.any(m[0] != m[1])
    n = across(m[1] - m[0] if turning else c[1] - c[0])
    for corner in c[0] - point + r * SIGNS[: 4 if r > 0.0 else 1]:
        if turning:
            found += turns_of(corner @ n, corner @ [-n[1], n[0]], n @ m[0])
        else:
            found += turns_of(n @ m[0], n @ [-m[0, 1], m[0, 0]], corner @ n)
    breaks = np.sort(np.clip([*turns, turns[0], *found], *turns))
    probes = 0.5 * (breaks[1:] + breaks[:-1]) if slack == 0.0 else breaks
    return any(meets(c, m, turn, point, leg, slack) for turn in probes)


def cuts(c: Array, m: Array, force: Array, turns: Array, leg: Leg) -> Array:
    """Shares at which Φ₀ crosses a line or a circle that can bound the set of contact, or the torque changes sign."""
    r, found = leg.radius, []
    x, y = np.eye(2)
    both = np.array([-1.0, 1.0])
    for corner, length in zip(c, np.linalg.norm(m, axis=1), strict=True):
        found += [leg.on_circle(corner + r * sign, float(length)) for sign in SIGNS]
        found += [leg.on_level(n, (corner @ n + r * both[:, None] + length * both).ravel()) for n in (x, y)]
    for P in (ends(c, m, turn) for turn in turns):
        n = across(P[1] - P[0])
        found += [leg.on_level(axis, (P @ axis + r * both[:, None]).ravel()) for axis in (x, y)]
        found.append(leg.on_level(n, n @ P[0] + r * np.abs(n).sum() * both))
    if np.any(m[0] != m[1]):
        distance = abs(across(m[1] - m[0]) @ m[0])
        found += [leg.on_circle(c[0] + r * sign, float(distance)) for sign in SIGNS]
        n = np.array([-force[1], force[0]])
        found.append(leg.on_level(n, np.array([c[0] @ n])))
    else:
        n = across(c[1] - c[0])
        reach = r * np.abs(n).sum() * both[:, None] + np.linalg.norm(m[0]) * both
        found.append(leg.on_level(n, (n @ c[0] + reach).ravel()))
    inside = np.concatenate(found)
    return np.unique(np.concatenate([[0.0, 1.0], inside[(inside > 0.0) & (inside < 1.0)]]))


def plain(lines: Lines, leg: Leg) -> tuple[list[int], list[tuple[float, float, float]]]:
    rows, shares = [], []
    for k, (c, m, force, turns) in enumerate(zip(lines.c, lines.m, lines.force, lines.turns, strict=True)):
        stops, touches = cuts(c, m, force, turns, leg), False
        for a, b in pairwise(stops):
            touches = met(c, m, turns, leg.start + 0.5 * (a + b) * leg.travel, leg)
            if touches and b - a > 1e-12:
                rows.append(k)
                shares.append((a, b, 0.5 * (a + b)))
        if not touches and met(c, m, turns, leg.start + leg.travel, leg, 1e3 * ROUNDING * leg.size):
            rows.append(k)
            shares.append((1.0, 1.0, 1.0))
    return rows, shares


@pytest.mark.parametrize("seed", range(24))
def test_the_kernel_agrees_with_the_plain_formulas(seed: int) -> None:
    lines, leg = random_lines(seed), random_leg(seed)
    rows, shares = lines.spans(leg)
    wide = (shares[:, 1] - shares[:, 0] > 1e-12) | (shares[:, 0] == 1.0)  # rounding may tear one crossing in two
    expected_rows, expected = plain(lines, leg)
    assert rows[wide].tolist() == expected_rows
    np.testing.assert_allclose(shares[wide], np.array(expected).reshape(-1, 3), rtol=0.0, atol=1e-12)


def test_the_kernel_is_what_is_written() -> None:
    lines, leg = random_lines(3), random_leg(3)
    arguments = (lines.c, lines.m, lines.force, lines.turns, leg)
    rows, shares = possible(*arguments)
    written = possible.py_func(*arguments)  # type: ignore[attr-defined]
    assert len(rows) > 0
    assert np.array_equal(rows, written[0])
    assert np.array_equal(shares, written[1])


@pytest.mark.parametrize("seed", range(8))
def test_a_grid_of_shares_and_turns_touches_in_the_spans_alone(seed: int) -> None:
    lines, leg = random_lines(seed), random_leg(seed)
    rows, shares = lines.spans(leg)
    for k, (c, m, turns) in enumerate(zip(lines.c, lines.m, lines.turns, strict=True)):
        spans = [(a, b) for a, b, _ in shares[rows == k]]
        for share in np.linspace(0.0, 1.0, 41):
            point = leg.start + share * leg.travel
            hit = any(meets(c, m, turn, point, leg, 0.0) for turn in np.linspace(*turns, 25))
            assert not hit or any(a - 1e-9 <= share <= b + 1e-9 for a, b in spans)


def test_no_pairs_make_no_contact() -> None:
    none = np.zeros((0, 2, 2))
    rows, shares = Lines(none, none, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)).spans(random_leg(1))
    assert rows.shape == (0,)
    assert shares.shape == (0, 3)
