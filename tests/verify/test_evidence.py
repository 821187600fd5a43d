"""The check of evidence: only the honest one is TESTED, and TESTED is not CERTIFIED."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmopt.verify import verify
from tests.shared.commands import Outcome
from tests.shared.plans.press_plan import press_plan_document, restated

Document = dict[str, Any]


def _unseated(document: Document, key: str, counted: str | None, number: int = 0) -> None:
    """Flips an outcome; its count with it where that is named."""
    evidence = document["evidence"]
    evidence[key][number]["seated"] = not evidence[key][number]["seated"]
    if counted is not None:
        evidence[counted] = sum(one["seated"] for one in evidence[key])


CORNERS = [[0, 0, 1], [1, 0, 1], [0, 1, 1], [0, 0, 2]]
CROWD = {"moving": [], "fixed": [{"name": "wall", "pieces": [CORNERS]}]}


def _crowd(document: Document) -> None:
    """Solids around the parts, which one of the draws comes too near to."""
    document["presses"]["cell"] = CROWD
    for one in (*document["evidence"]["outcomes"], *document["evidence"]["vertex_outcomes"]):
        one["distance"] = 0.01
    document["evidence"]["outcomes"][3]["distance"] = 1e-4


OTHERS = "other parts, presses or goals"
LIES: list[tuple[Callable[[Document], Any], bool, str]] = [
    (lambda d: d["evidence"].update(seated=11), True, "other counts are stated"),
    (lambda d: d["evidence"].update(draws=11), True, "other counts are stated"),
    (lambda d: _unseated(d, "outcomes", None), True, "9 of 10 outcomes seat"),
    (lambda d: _unseated(d, "outcomes", "seated"), True, "a bound of 0.691503 is stated, 0.554984 follows"),
    (lambda d: _unseated(d, "vertex_outcomes", None), True, "62 of 64 vertices seat"),
    (lambda d: [_unseated(d, "vertex_outcomes", "vertices_seated", n) for n in range(6)], True, "57 of 64 vertices"),
    (lambda d: d["evidence"].update(bound=d["evidence"]["bound"] + 1e-6), True, "a bound of"),
    (lambda d: d["evidence"].update(confidence=0.9), True, "the bound holds at 0.9"),
    (lambda d: d["evidence"].update(min_rate=0.7), True, "the rate is at least 0.6915, where 0.7 is asked for"),
    (lambda d: d["evidence"].update(max_time=7.0), True, "95 % of the cycle times are within 8 s, where 7 s are asked"),
    (lambda d: d["evidence"].update(first_tries=9), True, "10 outcomes seat at the first attempt, 9 are stated"),
    (lambda d: d["evidence"].update(level="below"), True, "its level is below"),
    (_crowd, True, "9 of 10 outcomes seat"),
    (lambda d: d["presses"].update(cell=CROWD), False, OTHERS),
    (lambda d: d["presses"].update(cell=CROWD), True, "0 of 10 outcomes seat"),
    (lambda d: d["segments"][1]["wrench"].__setitem__(0, 1.0), False, OTHERS),
    (lambda d: d["presses"]["robot"].update(mass=1.0), False, OTHERS),
    (lambda d: d["parts"]["moving"]["pieces"][0]["vertices"][0].__setitem__(2, -1e-4), False, OTHERS),
    (lambda d: d.update(goal=[1e-6, *d["goal"][1:]]), False, OTHERS),
    (lambda d: d.update(verdict="CERTIFIED"), True, "does not claim to be tested"),
    (lambda d: d.update(not_covered=d["not_covered"][:1]), True, "plans of this kind"),
]


def test_the_honest_one_is_tested_and_nothing_more() -> None:
    verdict = verify(press_plan_document())
    assert (str(verdict.verdict), verdict.findings, verdict.margin) == ("TESTED", (), None)
    words = "\n".join(verdict.lines())
    assert words.startswith("verdict: TESTED (23 presses)\nevidence: 10 of 10 draws seat")
    assert "63 of 64 vertices" in words
    assert "nothing is proved of presses" in words
    assert "margin" not in words


@pytest.mark.parametrize(("lie", "subject", "words"), LIES)
def test_a_lie_is_not_tested(lie: Callable[[Document], Any], subject: bool, words: str) -> None:
    document = press_plan_document()
    lie(document)
    verdict = verify(restated(document, subject))
    assert str(verdict.verdict) == "NOT_PROVED"
    assert any(words in str(finding) for finding in verdict.findings)


def test_without_a_seal_or_without_evidence_nothing_is_tested() -> None:
    document = press_plan_document()
    document["evidence"]["min_rate"] = 0.4
    assert [finding.what for finding in verify(document).findings] == ["sha256"]
    del document["evidence"]
    (finding,) = verify(restated(document, subject=False)).findings
    assert "were not carried out" in str(finding)


@pytest.mark.parametrize(("more", "code"), [((), 3), (("--evidence", "tested"), 0)])
def test_the_command_takes_tested_for_enough_only_where_that_is_asked_for(
    more: tuple[str, ...], code: int, tmp_path: Path, command: Callable[..., Outcome]
) -> None:
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(press_plan_document()))
    done = command("verify", file, *more)
    words = done.out + done.err
    assert done.code == code, words
    assert "TESTED" in words
    assert "margin" not in words
    lie = press_plan_document()
    _unseated(lie, "outcomes", "seated")
    file.write_text(json.dumps(restated(lie)))
    assert command("verify", file, *more).code == 3
