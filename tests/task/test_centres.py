"""Outlines whose centres may be taken to be elsewhere by the gap around a peg: a peg and its hole still agree."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.centre import centre
from fmopt.planning.posed import Posed
from fmopt.task.problem import load
from tests.shared.parts.families import Pair, pair, write_stl, write_toml


def disagreeing(count: int) -> list[Pair]:
    """L-shaped pairs of which the peg and the hole, each on its own, have centres that are clearly not the same."""

    def off(one: Pair) -> float:
        peg, hole = (centre(np.array(stack[-1].outline)) for stack in (one.peg, one.hole))
        return float(np.linalg.norm(peg - hole))

    return list(islice((one for one in (pair("L", seed) for seed in range(300)) if off(one) > one.clearance), count))


@pytest.mark.parametrize("write", [write_toml, write_stl])
def test_a_peg_finds_its_hole_where_their_centres_do_not_agree(write: Callable[..., Path], tmp_path: Path) -> None:
    found = disagreeing(3)
    assert len(found) == 3
    for one in found:
        problem = load(write(one, tmp_path / one.name, (0.01, 0.1)))
        assert 1e3 * Posed.of(problem).clearance.per_side == pytest.approx(one.clearance, abs=1e-3)
