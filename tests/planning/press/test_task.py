"""An insertion as presses see it: shelves, what stops the part, symmetry and corners, against the pair's numbers."""

from __future__ import annotations

from itertools import groupby, pairwise
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon

from fmopt.planning.press.task import PressTask
from fmopt.task.problem import load
from tests.shared.parts.families import Outline, Pair, Placing, Section, Stack, pair, write_toml
from tests.shared.plans.press_plan import press_task


def task_of(one: Pair, folder: Path) -> PressTask:
    return press_task(load(write_toml(one, folder)))


def rings(stack: Stack) -> list[Polygon]:
    """The different outlines of a stack from below."""
    return [Polygon(outline) for outline, _ in groupby(section.outline for section in stack)]


@pytest.mark.parametrize("seed", [103, 104, 105])
@pytest.mark.parametrize("family", ["stepped", "counterbored"])
def test_shelves_are_where_the_play_drops(family: str, seed: int, tmp_path: Path) -> None:
    one = pair(family, seed)
    task = task_of(one, tmp_path)
    if family == "stepped":
        expected = 2  # the shoulder at the mouth, then the tip at the ledge
    else:
        plays = [rings(one.peg)[0].exterior.distance(hole.exterior) for hole in rings(one.hole)]
        expected = sum(below < 0.6 * above for below, above in pairwise(plays))
        assert expected
    assert len(task.shelves) == expected
    assert all(0.0 < shelf.lever < shelf.gone < 1e-3 * one.depth for shelf in task.shelves)
    first, corner = task.shelves[0], task.corners[0]
    way = task.way_to_walls(first, np.array([cos(corner.angle), sin(corner.angle), 0.0]))
    play = rings(one.peg)[0].exterior.distance(rings(one.hole)[-1].exterior)
    assert way * cos(0.5 * corner.turn) == pytest.approx(1e-3 * play, abs=1e-6)  # as far as either wall
    assert task.through is one.through
    assert task.depth == pytest.approx(1e-3 * one.depth, abs=1e-9)


@pytest.mark.parametrize(
    ("family", "symmetry", "corners"),
    [("3-gon", 3, 3), ("7-gon", 7, 7), ("13-gon", 13, 13), ("triangle", 1, 3), ("rectangle", 2, 4), ("L", 1, 5)],
)  # fmt: skip
@pytest.mark.parametrize("seed", [103, 104])
def test_symmetry_and_corners_are_the_outlines(
    family: str, symmetry: int, corners: int, seed: int, tmp_path: Path
) -> None:
    one = pair(family, seed)
    task = task_of(one, tmp_path)
    assert not task.shelves
    assert not task.round
    assert task.through is one.through
    assert task.symmetry == symmetry
    assert len(task.corners) == corners
    assert task.mouth.area == pytest.approx(1e-6 * Polygon(one.hole[0].outline).area, rel=1e-4)
    turns = [round(corner.turn, 6) for corner in task.corners]
    assert turns == sorted(turns, reverse=True)
    if family != "L":
        assert sum(corner.turn for corner in task.corners) == pytest.approx(2.0 * pi)
    for corner in task.corners:
        u = np.array([cos(corner.angle), sin(corner.angle)])
        assert np.allclose(np.linalg.norm(corner.walls, axis=1), 1.0)
        # Walls are met by going in their direction, and are equally far round from the corner's.
        assert np.allclose(corner.walls @ u, cos(0.5 * corner.turn), atol=1e-9)
        assert not task.mouth.contains(Polygon([corner.at + 1e-5 * np.array(v) for v in ((0, 0), u, (u[1], -u[0]))]))
        assert task.mouth.exterior.distance(Polygon([corner.at + 1e-9 * np.array(v) for v in np.eye(3)[:, :2]])) < 1e-8


def square(half: float) -> Outline:
    return (-half, -half), (half, -half), (half, half), (-half, half)


@pytest.mark.parametrize(
    ("nub", "top", "ahead", "flat"),
    [
        (2.5, 2.5, 1.5, (False, False)),
        (6.0, 6.0, 1.5, (True, True)),
        (6.8, 6.8, 0.0, (True, True)),
        (2.5, 7.0, 0.0, (False, False)),
    ],
)
def test_what_leads_and_never_mates_is_no_tip_and_lands_all_the_same(
    nub: float, top: float, ahead: float, flat: tuple[bool, bool], tmp_path: Path
) -> None:
    peg = (Section(0.0, square(nub)), Section(1.5, square(top)), *(Section(z, square(7.0)) for z in (1.5, 40.0)))
    hole = tuple(Section(z, square(7.2)) for z in (-30.0000001, 0.0))  # its floor is off by rounding
    still = (Placing((0.0, 0.0, 0.0), 0.0),) * 2
    task = task_of(Pair("cell", "cell", peg, (), hole, (30.0, 30.0, 40.0), 0.2, 30.0, False, 14.0, still), tmp_path)
    assert task.ahead == pytest.approx(1e-3 * ahead)
    assert np.ptp(task.tip[:, 0]) == pytest.approx(1e-3 * (14.0 if ahead else 2.0 * nub))
    assert len(task.shelves) == (nub == top == 6.8)
    assert task.landing.bounds == pytest.approx(1e-3 * nub * np.array([-1.0, -1.0, 1.0, 1.0]), abs=1e-5)
    assert task.keeps_attitude
    assert task.turned_flat == flat
