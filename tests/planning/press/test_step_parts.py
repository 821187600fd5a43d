"""Parts that people assemble, from two STEP files of a CAD kernel and an error alone: each plan is tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmopt
from fmopt.task.problem import Problem
from tests.shared.files.step_parts import box, cut, cylinder, fuse, prism, write
from tests.shared.plans.press_plan import press_task

Shapes = tuple[Any, Any]


def pocket(block: tuple[float, float, float], depth: float, *tools: Any) -> Any:
    """A block whose top is at z = 0, without tools that stand on the floor of its pocket."""
    assert depth < block[2]
    return cut(box(*block, (0.0, 0.0, -block[2])), *tools)


def lying_key() -> Shapes:
    return box(30, 6, 6), pocket((50, 30, 12), 3.5, box(30.06, 6.06, 5, (0, 0, -3.5)))


def lid() -> Shapes:
    rim = cut(box(59.7, 39.7, 5, (0, 0, -5)), box(53.7, 33.7, 5, (0, 0, -5)))
    return fuse(box(64, 44, 3), rim), pocket((64, 44, 25), 22, box(60, 40, 30, (0, 0, -22)))


def d_sub_shell() -> Shapes:
    def outline(gap: float) -> np.ndarray:
        top, bottom, half = 8.2 + gap, 7.0 + gap, 4.0 + gap
        return np.array([(-bottom, -half), (bottom, -half), (top, half), (-top, half)])

    return prism(outline(0.0), 10), pocket((30, 20, 10), 6, prism(outline(0.1), 8, -6))


def two_prongs() -> Shapes:
    prongs = [box(1.5, 6.3, 16, (x, 0, 12)) for x in (-6.35, 6.35)]
    slots = [box(1.9, 6.7, 20, (x, 0, -18)) for x in (-6.35, 6.35)]
    return fuse(box(26, 20, 12), *prongs), pocket((40, 30, 20), 18, *slots)


def sc_plug() -> Shapes:
    port = pocket((20, 20, 14), 10, box(9.2, 7.6, 12, (0, 0, -10)), box(3.2, 1.2, 12, (0, 4.2, -10)))
    return fuse(box(9, 7.4, 25), box(3, 1, 20, (0, 4.2, 0))), port


def battery_cell() -> Shapes:
    return fuse(cylinder(7.25, 49), cylinder(2.75, 1.5, (0, 0, 49))), cut(
        cylinder(10, 55, (0, 0, -55)), cylinder(7.55, 60, (0, 0, -52))
    )


def cross() -> Shapes:
    return fuse(box(20, 6, 30), box(6, 20, 30)), pocket(
        (40, 40, 15), 12, box(20.2, 6.2, 15, (0, 0, -12)), box(6.2, 20.2, 15, (0, 0, -12))
    )


def gear_on_its_pin() -> Shapes:
    teeth = [(r, (k + a) * pi / 8) for k in range(16) for a, r in ((-0.36, 9), (-0.18, 11), (0.18, 11), (0.36, 9))]
    wheel = prism(np.array([(r * cos(a), r * sin(a)) for r, a in teeth]), 8)
    return cut(wheel, cylinder(3.05, 10, (0, 0, -1))), fuse(box(40, 40, 6, (0, 0, -6)), cylinder(3, 15))


def bearing() -> Shapes:
    ring = cut(cylinder(11, 7), cylinder(4, 9, (0, 0, -1)))
    return ring, pocket((40, 40, 15), 7, cylinder(11.02, 8, (0, 0, -7)), cylinder(5, 17, (0, 0, -16)))


def problem_of(made: Callable[[], Shapes], folder: Path) -> Problem:
    folder.mkdir(exist_ok=True)
    paths = [folder / "moving.step", folder / "fixed.step"]
    for path, shape in zip(paths, made(), strict=True):
        write(path, shape)
    return fmopt.problem(*paths, "0.3 mm, 0.3 deg", folder=folder / "task")


SLOW: Sequence[Callable[[], Shapes]] = (lying_key, lid, two_prongs, sc_plug, battery_cell, cross, gear_on_its_pin)


@pytest.mark.parametrize("made", [d_sub_shell, *(pytest.param(made, marks=pytest.mark.wide) for made in SLOW)])
def test_a_pair_is_tested_from_two_step_files(made: Callable[[], Shapes], tmp_path: Path) -> None:
    plan = fmopt.solve(problem_of(made, tmp_path))
    assert plan.verdict in ("TESTED", "CERTIFIED")
    if (evidence := plan.stated.trials) is not None:
        assert evidence.bound >= 0.9
        assert evidence.vertices_seated >= 58


@pytest.mark.wide
def test_what_has_no_time_for_its_trials_says_how_much_they_take(tmp_path: Path) -> None:
    plan = fmopt.solve(problem_of(bearing, tmp_path))
    assert plan.verdict == "NOT_PROVED"
    assert "set settings.time_limit to about " in plan.stated.description.untried


def test_a_ring_turns_freely_and_is_tried_without_its_bore_unless_something_comes_into_it(tmp_path: Path) -> None:
    ring, seat = bearing()
    post = fuse(pocket((40, 40, 15), 7, cylinder(11.02, 8, (0, 0, -7))), cylinder(3, 7, (0, 0, -8)))
    assert press_task(problem_of(battery_cell, tmp_path / "cell")).round
    for fixed, filled in ((seat, True), (post, False)):
        task = press_task(problem_of(lambda fixed=fixed: (ring, fixed), tmp_path / str(filled)))
        assert task.round
        assert (len(task.bodies.moving) == 1) is filled
