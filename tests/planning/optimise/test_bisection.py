"""The largest factor: what trying every factor of the grid finds, whatever is likely, in few trials."""

from __future__ import annotations

import numpy as np
import pytest

from fmopt.planning.optimise.bisection import Trial, factor, largest

GRID = [factor(step) for step in range(-448, 385)]


class Counted:
    """A motion whose moves have the margins a (1 − (f/l)^n) under a factor f, and are impossible from another on."""

    def __init__(self, room: list[float], gone: list[float], power: float = 1.0, impossible: float = np.inf) -> None:
        self.room, self.gone, self.power, self.impossible = room, gone, power, impossible
        self.asked: list[float] = []

    def __call__(self, share: float) -> Trial:
        self.asked.append(share)
        found: list[float] = []
        for room, gone in zip(self.room, self.gone, strict=True):
            found.append(room * (1.0 - (share / gone) ** self.power))
            if found[-1] <= 0.0:
                return Trial(tuple(found), False)
        return Trial(tuple(found[:-1]), False) if share >= self.impossible else Trial(tuple(found), True)

    def plainly(self) -> tuple[float, float | None]:
        """The last factor of the grid that holds before the first that does not."""
        limit = min(*self.gone, self.impossible)
        below = [share for share in GRID if share < limit]
        above = [share for share in GRID if share >= limit]
        return below[-1], above[0] if above else None


def test_the_grid_is_that_of_halving() -> None:
    assert GRID[0] == 0.0
    assert GRID[-1] == 64.0
    assert {0.5, 1.0, 1.0 + 1.0 / 64.0, 2.0, 2.0 + 1.0 / 32.0, 2.3125, 33.5, 1.0 / 4096.0, 1.0 / 64.0} <= set(GRID)
    steps = np.diff(GRID)
    assert (steps > 0.0).all()
    assert (steps <= np.maximum(np.array(GRID[:-1]), 1.0 / 64.0) / 64.0).all()


@pytest.mark.parametrize("seed", range(40))
def test_it_is_what_trying_every_factor_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gone = np.exp(rng.uniform(np.log(0.01), np.log(90.0), 4)).tolist()
    impossible = float(np.exp(rng.uniform(np.log(0.5), np.log(90.0)))) if seed % 2 else np.inf
    motion = Counted(rng.uniform(1e-5, 1e-3, 4).tolist(), gone, float(rng.choice([0.5, 1.0, 2.0])), impossible)
    low, high = motion.plainly()
    for likely_limit in (low, impossible, 0.9 * low, 1.2 * low, 0.0, np.inf):
        motion.asked.clear()
        assert largest(motion, lambda share, limit=likely_limit: share <= limit) == (low, high)
        assert len(motion.asked) == len(set(motion.asked))


def test_a_good_guess_takes_three_trials_and_even_margins_few() -> None:
    motion = Counted([1e-4, 2e-4], [3.0, 2.33], impossible=2.32)
    assert largest(motion, lambda share: share < 2.32) == (2.3125, 2.34375)
    assert motion.asked == [1.0, 2.3125, 2.34375]
    even = Counted([1e-4, 2e-4], [5.0, 2.33])
    assert largest(even, lambda share: True) == (2.3125, 2.34375)
    assert len(even.asked) <= 6


def test_there_may_be_nothing_beyond_and_nothing_at_all() -> None:
    assert largest(Counted([1e-4], [100.0]), lambda share: True) == (64.0, None)
    assert largest(Counted([1e-4], [1e-9]), lambda share: True) == (0.0, 1.0 / 4096.0)
