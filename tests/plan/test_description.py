"""The description in a plan: values that read themselves again, or are refused with their place."""

import copy
import json
import random
from collections.abc import Callable
from typing import Any

import pytest

from fmopt.errors import PlanFormatError
from fmopt.plan import clean, parsed
from fmopt.plan.description import Description
from fmopt.verify import CERTIFIED, verify
from tests.shared.lies.mutations import changed
from tests.shared.plans.whole_plan import WRONG, places, put

Plan = dict[str, Any]


def test_a_description_reads_what_it_writes(square_peg_plan: Plan) -> None:
    found = parsed(square_peg_plan).description
    assert json.loads(json.dumps(clean(found.record()))) == square_peg_plan["description"]
    assert Description.parsed(clean(found.record())) == found


def test_the_check_reads_no_description(square_peg_plan: Plan) -> None:
    for other in ({}, {"search": None}, [1], "words"):
        assert verify(changed(square_peg_plan, lambda p, other=other: p.update(description=other))).findings == ()
    assert verify(changed(square_peg_plan, lambda p: p.pop("description"))).verdict == CERTIFIED
    unsealed = {**square_peg_plan, "description": {}}
    assert [finding.what for finding in verify(unsealed).findings] == ["sha256"]


def test_every_wrong_value_is_refused_with_its_place(square_peg_plan: Plan) -> None:
    pick, refused = random.Random(3), list[str]()
    for place, _ in places(square_peg_plan["description"], ("description",)):
        for value in pick.sample(WRONG, 3):
            try:
                parsed(put(square_peg_plan, place, value))
            except PlanFormatError as error:
                refused.append(error.message)
    assert len(refused) > 500
    assert all(words.isprintable() for words in refused)
    assert all(words.startswith(("description", "plan: holds what is not JSON")) for words in refused)


def _last(values: list[Any], value: Any) -> None:
    values[-1] = value


def _rows(p: Plan) -> Any:
    return p["description"]["position_force"]


CHANGES: dict[str, tuple[Callable[[Plan], Any], str]] = {
    "unknown key": (lambda p: p["description"]["search"].update(trust_me=1), r"search\.trust_me"),
    "missing key": (lambda p: p["description"]["search"].pop("cost"), r"search\.cost"),
    "later state": (lambda p: p["description"]["search"]["states"][1].update(origin=5), "search: a state must be"),
    "no number": (lambda p: p["description"]["search"]["states"][3].update(cost="1"), r"search\.states\[3\]\.cost"),
    "bound": (lambda p: p["description"]["search"].update(lower_bound=99.0), "search: the lower bound exceeds"),
    "way": (lambda p: _last(p["description"]["search"]["way"], 4000), "search: way must hold"),
    "times": (lambda p: p["description"]["nominal"]["times"].reverse(), "nominal: nodes need increasing times"),
    "nodes": (lambda p: p["description"]["nominal"]["nodes"].pop(), "nominal: nodes need"),
    "interval": (lambda p: p["description"]["nominal"]["intervals"].pop(0), "nominal: intervals do not cover"),
    "row": (lambda p: _rows(p).pop(), "intervals do not cover"),
    "s": (lambda p: p["description"]["nominal"]["intervals"][0].update(s=[1, 0, 0, 0, 0, 0]), "has another s"),
    "reaction": (lambda p: _rows(p)[-1].update(fa=[-x for x in _rows(p)[-1]["fa"]]), r"position_force\[\d\]: entry"),
    "free force": (lambda p: _rows(p)[0]["fa"].__setitem__(2, 5.0), r"position_force\[0\]: entry 2 of fa"),
    "position": (lambda p: _rows(p)[-1]["pa_end"].__setitem__(0, 1e-3), r"position_force\[\d\]: entry 0 of pa"),
    "critical point": (lambda p: _last(p["description"]["places"], 99), "a critical point is named beyond the"),
    "vertex": (lambda p: p["description"]["diagnostics"]["unplanned"][0].update(fixed=[999]), "names a vertex"),
    "sons": (lambda p: p["description"]["diagnostics"]["graphs"][0]["sons"].pop(), r"graphs\[0\]: each state"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_contradicts_itself_is_refused(name: str, square_peg_plan: Plan) -> None:
    change, words = CHANGES[name]
    document = copy.deepcopy(square_peg_plan)
    change(document)
    with pytest.raises(PlanFormatError, match=f"^description.*{words}"):
        parsed(document)
