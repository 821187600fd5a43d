"""The largest factor: what trying every factor of the grid finds, whatever is likely, in few trials."""

import numpy as np
import pytest

from fmopt.planning.optimise.bisection import factor, largest

GRID = [factor(step) for step in range(-448, 385)]


class Counted:
    """A motion whose moves have no margin from these factors on, and are impossible from another on."""

    def __init__(self, gone: list[float], impossible: float = np.inf) -> None:
        self.limit, self.asked = min([*gone, impossible]), list[float]()

    def __call__(self, share: float) -> bool:
        self.asked.append(share)
        return share < self.limit

    def plainly(self) -> tuple[float, float | None]:
        """The last factor of the grid that holds before the first that does not."""
        below = [share for share in GRID if share < self.limit]
        above = [share for share in GRID if share >= self.limit]
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
    motion = Counted(gone, impossible)
    low, high = motion.plainly()
    for likely_limit in (low, impossible, 0.9 * low, 1.2 * low, 0.0, np.inf):
        motion.asked.clear()
        assert largest(motion, lambda share, limit=likely_limit: share <= limit) == (low, high)
        assert len(motion.asked) == len(set(motion.asked))


def test_a_good_guess_takes_three_trials_and_others_few() -> None:
    motion = Counted([3.0, 2.33], impossible=2.32)
    assert largest(motion, lambda share: share < 2.32) == (2.3125, 2.34375)
    assert motion.asked == [1.0, 2.3125, 2.34375]
    other = Counted([5.0, 2.33])
    assert largest(other, lambda share: True) == (2.3125, 2.34375)
    assert len(other.asked) <= 11


def test_there_may_be_nothing_beyond_and_nothing_at_all() -> None:
    assert largest(Counted([100.0]), lambda share: True) == (64.0, None)
    assert largest(Counted([1e-9]), lambda share: True) == (0.0, 1.0 / 4096.0)
