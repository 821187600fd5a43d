"""The plan file of presses: read and written alike, and refused with the place of what is wrong."""

import json
import math
from collections.abc import Callable
from typing import Any

import pytest

from fmopt.errors import PlanFormatError
from fmopt.plan import canonical, clean, parsed, sealed
from fmopt.plan.evidence import evidence_record
from fmopt.plan.press import press_records
from tests.shared.plans.press_plan import press_plan, press_plan_document

Document = dict[str, Any]


def test_document_and_plan_are_taken_to_each_other() -> None:
    document = json.loads(canonical(press_plan_document()))
    found = parsed(document)
    assert found.press_plan == press_plan()
    assert found.presses == len(document["segments"]) == 23
    assert found.segments == ()
    assert found.trials is not None
    assert len(found.trials.outcomes) == found.trials.draws
    again = {**document, **press_records(found.press_plan), "evidence": evidence_record(found.trials)}
    assert canonical(sealed(clean(again))) == canonical(document)


def _press(document: Document) -> Document:
    found: Document = document["segments"][1]
    return found


def _attempts(document: Document) -> None:
    document["presses"]["attempts"] *= 2
    document["segments"] += [{**one, "attempt": one["attempt"] + 2} for one in document["segments"]]


SECOND = r"presses\.attempts\[0\]\.presses\[1\]"
REFUSED: list[tuple[Callable[[Document], Any], str, str]] = [
    (lambda d: _press(d).update(colour="red"), rf"{SECOND}\.colour", "Unexpected keyword"),
    (lambda d: d["presses"].update(colour="red"), r"presses\.colour", "Unexpected keyword"),
    (lambda d: d["presses"]["robot"].update(mass=0.0), r"presses\.robot\.mass", "greater than 0"),
    (lambda d: _press(d).update(attempt=2), r"segments\[1\]\.attempt", "number of an attempt"),
    (lambda d: _press(d).update(attempt=-1), r"segments\[1\]\.attempt", "number of an attempt"),
    (lambda d: _press(d).pop("attempt"), r"segments\[1\]\.attempt", "number of an attempt"),
    (lambda d: _press(d).update(ends=[]), rf"{SECOND}\.ends", "at least 1 item"),
    (lambda d: _press(d)["ends"][0].update(then="later"), rf"{SECOND}\.ends\[0\]\.standstill\.then", "'seated'"),
    (lambda d: _press(d)["ends"][0].update(kind="force"), rf"{SECOND}\.ends\[0\]\.force\.force", "required"),
    (lambda d: d["presses"].update(attempts=7), "presses", "table with its attempts"),
    (lambda d: d.pop("presses"), "plan", "lacks the key 'presses'"),
    (lambda d: d["segments"][2].update(kind="guarded_move"), "presses", "a plan whose segments all are presses"),
    (_attempts, r"presses\.attempts", "3 at most"),
    (lambda d: d["evidence"].update(bound=1.5), r"evidence\.bound", ""),
    (lambda d: d["evidence"]["conditions"].update(drift="much"), r"evidence\.conditions\.drift", "number"),
    (lambda d: d["evidence"]["outcomes"][0].update(seated=1), r"evidence\.outcomes\[0\]\.seated", ""),
    (lambda d: d["evidence"]["outcomes"][3]["rests"][0].extend([[0.0] * 3] * 5), "evidence, draw 3", "not have"),
    (lambda d: d["evidence"]["outcomes"][3]["rests"].extend([[[0.0] * 3]] * 2), "evidence, draw 3", "not have"),
    (lambda d: d["evidence"]["vertex_outcomes"][63]["way"][-1].update(press=23), "evidence, vertex 63", "not have"),
    (lambda d: d["description"].update(trace=[{"time": 0.0, "press": 11, "pose": [0.0] * 6}]), "description.trace", ""),
]  # fmt: skip


@pytest.mark.parametrize(("change", "place", "words"), REFUSED)
def test_a_flaw_is_refused_with_its_place(change: Callable[[Document], Any], place: str, words: str) -> None:
    document = press_plan_document()
    change(document)
    with pytest.raises(PlanFormatError, match=f"^{place}.*({words})"):
        parsed(sealed(document))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_is_refused(value: float) -> None:
    document = press_plan_document()
    document["presses"]["clear"] = value
    with pytest.raises(PlanFormatError, match="holds a number that JSON cannot"):
        sealed(document)
    with pytest.raises(PlanFormatError, match="holds what is not JSON"):
        parsed(document)
