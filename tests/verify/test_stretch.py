"""The check that a move's pieces share one twist: its bound holds for simulated executions, and bent moves fail."""

import math
import random
from typing import Any

import pytest

from fmopt.verify import CERTIFIED, verify
from fmopt.verify.arithmetic.rational import ONE, fixed, number, row
from fmopt.verify.certificate.chain import CheckedLeg, check_fit, misfit
from fmopt.verify.certificate.error_set import square_of
from fmopt.verify.findings import LEFT_ASIDE, Notes
from tests.shared.lies.mutations import changed

Vector = tuple[float, ...]
WHAT = "pieces of the move"


def leg(twist: Vector, progress: float, overtravel: float, *directions: Vector) -> CheckedLeg:
    """A piece whose contacts give way along some of the axes."""
    axes = [d.index(1.0) for d in directions]
    hold = square_of([[ONE if a == b and a not in axes else 0 for b in range(6)] for a in range(6)])
    return CheckedLeg(row(twist), fixed(progress), fixed(overtravel), tuple(row(d) for d in directions), hold)


def commanded(rates: list[Vector], ends: list[float], s: float) -> list[float]:
    """Where the controller is when it has progressed by s; past the end it goes on along the last piece."""
    at, before = [0.0] * 6, 0.0
    for k, (rate, end) in enumerate(zip(rates, ends, strict=True)):
        until = s if k == len(rates) - 1 else min(s, end)
        at = [x + v * (until - before) for x, v in zip(at, rate, strict=True)]
        if until == s:
            return at
        before = end
    raise AssertionError("a move has pieces")


@pytest.mark.parametrize("seed", range(40))
def test_no_execution_differs_from_stretched_pieces_by_more_than_the_bound(seed: int) -> None:
    dice = random.Random(seed)
    count = dice.randint(2, 7)
    cuts = sorted(dice.uniform(0.05, 0.95) for _ in range(count - 1))
    ends = [*cuts, 1.0]
    shares = [b - a for a, b in zip([0.0, *cuts], ends, strict=True)]
    rates = [tuple(dice.uniform(-1.0, 1.0) for _ in range(6)) for _ in range(count)]
    bounds = [dice.uniform(0.0, 0.95) for _ in range(count)]
    legs = [leg(tuple(x * d for x in rate), d, o) for rate, d, o in zip(rates, shares, bounds, strict=True)]
    translation, rotation = (number(x) for x in misfit(legs))
    for kind in (1.0, -1.0, 0.0):
        for _ in range(20):
            lag, model = 0.0, [0.0] * 6
            for rate, end, d, o in zip(rates, ends, shares, bounds, strict=True):
                stretch = o * (kind or dice.uniform(-1.0, 1.0))
                lag += stretch * d
                model = [x + v * d * (1.0 + stretch) for x, v in zip(model, rate, strict=True)]
                off = [x - y for x, y in zip(commanded(rates, ends, end + lag), model, strict=True)]
                assert math.hypot(*off[:3]) <= translation + 1e-12
                assert math.hypot(*off[3:]) <= rotation + 1e-12


def test_one_late_piece_reaches_the_bound() -> None:
    legs = [leg((1e-3, 0, 0, 0, 0, 0), 0.5, 0.2), leg((0, 1e-3, 0, 0, 0, 0.01), 0.5, 0.0)]
    translation, rotation = (number(x) for x in misfit(legs))
    assert translation == pytest.approx(0.1 * math.hypot(2e-3, 2e-3), rel=1e-12)
    assert rotation == pytest.approx(0.1 * 0.02, rel=1e-12)


def test_one_twist_fits_whatever_the_contacts_take_up() -> None:
    x, settled = (1e-3, 0.0, 0.0, 0.01, 0.0, 0.0), (1e-3, 0.0, 3e-4, 0.01, 0.0, 0.0)
    along = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    notes = Notes(0)
    check_fit([leg(x, 0.5, 0.4, along), leg(settled, 0.5, 0.4, along)], notes)
    assert notes.found == []
    check_fit([leg(x, 0.5, 0.4), leg(settled, 0.5, 0.4)], notes)
    assert [f.what for f in notes.found] == [WHAT]
    assert notes.found[0].shortfall == pytest.approx(0.2 * 6e-4)
    assert "do not share one twist" in notes.found[0].message


def test_pieces_must_give_way_along_the_same_directions() -> None:
    x = (1e-3, 0.0, 0.0, 0.01, 0.0, 0.0)
    notes = Notes(0)
    check_fit([leg(x, 0.5, 0.4, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)), leg(x, 0.5, 0.4)], notes)
    assert ["same directions" in f.message for f in notes.found] == [True]


@pytest.mark.parametrize("axis", [0, 3])
def test_what_is_left_aside_is_the_limit(axis: int) -> None:
    allowed = LEFT_ASIDE[0 if axis < 3 else 1]
    for share, findings in ((0.99, 0), (1.01, 1)):
        jump = [0.0] * 6
        jump[axis] = share * allowed / 0.2 * 0.5
        notes = Notes(0)
        check_fit([leg((0.0,) * 6, 0.5, 0.4), leg(tuple(jump), 0.5, 0.4)], notes)
        assert len(notes.found) == findings


def test_a_bent_move_is_refused(square_peg_plan: dict[str, Any]) -> None:
    segments = square_peg_plan["segments"]
    inner = [k for k, s in enumerate(segments) if s["progress"][1] < 1.0 and s["start"][3:] != s["goal"][3:]]
    inner = [k for k in inner if any(b["made"] for b in segments[k]["basis"])]
    assert inner
    k = inner[len(inner) // 4]  # on a turn that the contacts do not take up

    def bend(plan: dict[str, Any]) -> None:
        first, second = plan["segments"][k], plan["segments"][k + 1]
        way = [b - a for a, b in zip(segments[k]["start"][:3], segments[k]["goal"][:3], strict=True)]
        across = [-way[1], way[0], 0.0] if math.hypot(*way[:2]) > 1e-9 else [1.0, 0.0, 0.0]
        size = math.hypot(*across)
        for axis in range(3):
            first["goal"][axis] += 5e-6 * across[axis] / size
            second["start"][axis] = first["goal"][axis]

    verdict = verify(changed(square_peg_plan, bend))
    assert verdict.verdict != CERTIFIED
    assert any(f.what == WHAT and "do not share one twist" in f.message for f in verdict.findings)
