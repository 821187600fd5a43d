"""When a corner can lie on an edge: against a fine grid of shares and turns."""

import numpy as np
import pytest

from fmopt.papers.lee_huang.line_contact import Leg, Lines
from fmopt.spatial.values import Array

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
    return Lines(c, m, np.column_stack([np.cos(angle), np.sin(angle)]), turns, np.zeros((count, 2)))


def random_leg(seed: int) -> Leg:
    rng = np.random.default_rng(1000 + seed)
    radius = rng.uniform(0.0, 0.4) * (seed % 4 > 0)
    travel = rng.uniform(-4.0, 4.0, 2) * (rng.random(2) > 0.2)
    return Leg(rng.uniform(-2.0, 2.0, 2), travel, radius, 0.3, 2.0)


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


@pytest.mark.parametrize("seed", range(12))
def test_a_grid_of_shares_and_turns_touches_in_the_spans_and_there_alone(seed: int) -> None:
    lines, leg = random_lines(seed), random_leg(seed)
    rows, shares = lines.spans(leg)
    for k, (c, m, turns) in enumerate(zip(lines.c, lines.m, lines.turns, strict=True)):
        spans = [(a, b) for a, b, _ in shares[rows == k]]
        for share in np.linspace(0.0, 1.0, 41):
            point = leg.start + share * leg.travel
            hit = any(meets(c, m, turn, point, leg, 0.0) for turn in np.linspace(*turns, 25))
            assert not hit or any(a - 1e-9 <= share <= b + 1e-9 for a, b in spans)
        for a, b in spans:
            # A turn beside that of the contact leaves a gap of at most the arm times the difference.
            point, grid = leg.start + 0.5 * (a + b) * leg.travel, np.linspace(*turns, 401)
            slack = 4.0 * (turns[1] - turns[0]) / 400
            assert any(meets(c, m, turn, point, leg, slack) for turn in grid)


def test_no_pairs_make_no_contact() -> None:
    none = np.zeros((0, 2, 2))
    rows, shares = Lines(none, none, *np.zeros((3, 0, 2))).spans(random_leg(1))
    assert rows.shape == (0,)
    assert shares.shape == (0, 3)
