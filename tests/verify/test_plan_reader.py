"""The one reader of plans: typed values, or PlanError with the place, whatever a document holds; keys with classes."""

import copy
import json
import random
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fmopt import plan
from fmopt.errors import PlanFormatError, ResourceError
from fmopt.verify import PlanError, Verdict, verify
from fmopt.verify.reading.parse import FIELDS, parse
from fmopt.verify.reading.reader import COMMENTARY, COMPARED, LARGEST_FILE, PROVED, Fields, Reader, decoded
from tests import ROOT
from tests.shared.plans.table_plan import sealed
from tests.shared.plans.whole_plan import WRONG, Place, places, put, whole_plan

PAGE = ROOT / "fmopt" / "manual" / "certificate.md"
UNSEEN = ("\n", "\r", "\x00", "\x1b[2K", "\x7f", "\x85", "\u2028", "\u2029", "\u202e", "\u2066", "\u200f", "\ud83d")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return whole_plan()


def pattern(place: Place) -> str:
    """A place as `Fields` names it, but for the sides of parts and contacts."""
    return ".".join("[]" if isinstance(key, int) else key for key in place).replace(".[]", "[]")


def judged(document: dict[str, Any]) -> Iterator[tuple[Place, Any]]:
    """Every place of what the check reads."""
    return ((place, value) for place, value in places(document) if place[:1] != ("description",))


def without(document: dict[str, Any], place: Place) -> dict[str, Any]:
    """A copy without the key at a place."""
    held: Any = document
    for key in place[:-1]:
        held = held[key]
    return put(document, place[:-1], {k: v for k, v in held.items() if k != place[-1]}) if place[:-1] else {
        k: v for k, v in held.items() if k != place[-1]
    }  # fmt: skip


def of(where: str) -> Fields:
    """The fields of objects at such a place."""
    starred = re.sub(r"(^parts|^contacts\[\]|first\[\])\.(moving|fixed)", r"\1.*", where)
    return next(row for row in FIELDS if row.where == starred)


def test_every_key_of_a_plan_is_in_the_table(document: dict[str, Any]) -> None:
    seen: dict[str, set[str]] = {}
    for place, value in judged(document):
        if isinstance(value, dict):
            seen.setdefault(of(pattern(place)).where, set()).update(value)
    rows = {row.where: row.known for row in FIELDS if not row.where.startswith("evidence")}
    assert seen == {**rows, "": rows[""] - {"evidence", "presses"}}


def test_the_table_in_the_manual_is_that_of_the_reader() -> None:
    lines = ["| where | counts as | keys |", "|---|---|---|"]
    for row in FIELDS:
        for kind in (PROVED, COMPARED, COMMENTARY):
            if keys := [f"`{key}`" for key, said in row.classes if said == kind]:
                lines.append(f"| {f'`{row.where}`' if row.where else 'the plan'} | {kind} | {', '.join(keys)} |")
    assert "\n".join(lines) in PAGE.read_text(encoding="utf-8"), "\n" + "\n".join(lines)


def test_the_whole_plan_is_read_and_judged(document: dict[str, Any]) -> None:
    found = parse(document)
    assert found.digest_holds
    assert found.recovery is not None
    assert (found.segments[0].hybrid.impact, found.parts["fixed"].name) == ((0.5, 1.0), "table")
    assert isinstance(verify(document), Verdict)


def test_every_key_that_is_missing_or_unknown_is_refused_with_its_place(document: dict[str, Any]) -> None:
    tried = 0
    for place, value in judged(document):
        if not isinstance(value, dict):
            continue
        where = re.escape(pattern(place)).replace(r"\[\]", r"\[\d+\]")
        with pytest.raises(PlanError, match=f"^{where or 'plan'}: unknown key 'trust_me'"):
            parse(put(document, (*place, "trust_me"), 1))
        for key in of(pattern(place)).required:
            with pytest.raises(PlanError, match=f"^{where or 'plan'}: lacks the key '{key}'"):
                parse(without(document, (*place, key)))
            tried += 1
    assert tried > 80


def test_every_value_of_another_kind_is_refused_or_judged(document: dict[str, Any]) -> None:
    """No value anywhere ends in another exception than the reader's own, nor in the check of those that pass it."""
    refused, kept, pick = [], [], random.Random(5)
    for place, _ in judged(document):
        for value in pick.sample(WRONG, 8) if place else ():
            changed = put(document, place, value)
            try:
                parse(changed)
                kept.append(changed)
            except PlanError as error:
                refused.append(str(error))
    assert len(refused) > 2000
    assert all(words.isprintable() for words in refused)
    for changed in pick.sample(kept, 12):
        try:
            assert isinstance(verify(sealed(changed)), Verdict)
        except PlanError as error:
            refused.append(str(error))


def test_no_text_of_a_plan_holds_what_is_not_seen(document: dict[str, Any]) -> None:
    texts = [(place, value) for place, value in places(document) if isinstance(value, str)]
    assert len(texts) > 40
    for place, value in texts:
        for sign in UNSEEN:
            where = re.escape(".".join(map(str, place[-1:])))
            with pytest.raises(PlanFormatError, match=rf"{where}|\[\d+\]|is not JSON"):
                plan.parsed(put(document, place, value + sign))
        with pytest.raises(PlanFormatError):
            plan.parsed(put(document, place, value + 1001 * "x"))


def test_words_from_elsewhere_become_what_a_plan_may_hold() -> None:
    for words in ("a\nb", "a\x1b[31m", "a\u202eb", "x" * 5000, "\udcff.stl", "a part, 3 µm"):
        assert Reader(plan.line(words)).text() == plan.line(words)
    assert plan.line("a part,\n3 µm") == "a part, 3 µm"


def test_what_is_read_from_files(tmp_path: Path, document: dict[str, Any]) -> None:
    file = tmp_path / "plan.json"
    plan.write(document, file)
    assert plan.read(file) == plan.parsed(document)
    file.write_text('{"format": "fmopt.plan/2"}')
    with pytest.raises(PlanFormatError, match=r"plan\.json: plan: lacks the key 'verdict'"):
        plan.read(file)
    with pytest.raises(ResourceError):
        plan.read(tmp_path / "nowhere.json")
    file.write_bytes(b"\xff")
    with pytest.raises(PlanFormatError, match="cannot be read"):
        plan.read(file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b" " * (LARGEST_FILE + 1), "larger than 64 MiB"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a": NaN}', "NaN, which is no number"),
        (b'{"a": ' + b"9" * 5000 + b"}", "no JSON"),
        ('{"a": \u00b2}'.encode(), "no JSON"),
        (json.dumps({str(k): k for k in range(200_000)}).encode()[:-1] + b', "7": 7}', "repeats the key '7'"),
    ],
    ids=["large", "deep", "nan", "digits", "superscript", "repeated"],
)
def test_what_is_no_json_is_refused_in_time(text: bytes, message: str) -> None:
    begun = time.process_time()
    with pytest.raises(PlanError, match=message):
        decoded(text)
    assert time.process_time() - begun < 10.0


def test_reading_takes_no_longer_than_its_size_asks_for(document: dict[str, Any]) -> None:
    """Lists are bounded, and what is looked up in them is not searched for from end to end."""
    loose = copy.deepcopy(document)
    loose["parts"]["fixed"]["vertices"] += [[0.01, 0.01, 0.01]] * 4000
    many = copy.deepcopy(document)
    many["contacts"] = [{**many["contacts"][0], "id": f"c{k}"} for k in range(4000)] + many["contacts"]
    many["segments"][0]["state"] = [f"c{k}" for k in range(4000)]
    wide = copy.deepcopy(document)
    wide["segments"] = wide["segments"] * 2000
    begun = time.process_time()
    with pytest.raises(PlanError, match="vertex 8 belongs to no face"):
        parse(loose)
    with pytest.raises(PlanError, match="contacts: has a contact under two ids"):
        parse(many)
    with pytest.raises(PlanError, match="segments: must have at most 4096 entries"):
        parse(wide)
    assert time.process_time() - begun < 10.0
