"""Each advice of the task room is followed to the letter, and what was refused is taken; keys in messages exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import fmopt
from fmopt.errors import FmoptError
from fmopt.task.toml import assembly_file, model_file, problem_file, tables
from fmopt.task.toml.tables import Measured
from fmopt.task.toml.units import EXAMPLES, at_most, evaluate
from tests.shared.files.advice import features, fits, models, problems, texts, workcells
from tests.shared.files.advice.case import Case, advice_of
from tests.shared.files.advice.given import given

CASES = (*texts.CASES, *models.CASES, *features.CASES, *problems.CASES, *fits.CASES, *workcells.CASES)


@pytest.mark.parametrize(
    "case", [pytest.param(one, id=one.name, marks=pytest.mark.wide if one.slow else ()) for one in CASES]
)
def test_advice_that_is_followed_helps(case: Case, tmp_path: Path) -> None:
    refused, taken = tmp_path / "refused", tmp_path / "taken"
    refused.mkdir()
    taken.mkdir()
    with pytest.raises(FmoptError) as told:
        case.wrong(refused)
    assert advice_of(told.value) == case.advice
    assert case.followed(taken) == case.gives


@pytest.mark.parametrize(("words", "before", "after"), fits.WARNED)
def test_warnings_that_are_heeded_go(
    words: str, before: Mapping[str, str], after: Mapping[str, str], tmp_path: Path
) -> None:
    with pytest.raises(FmoptError) as told:
        fits.warned(tmp_path, before)
    assert words in told.value.advice
    assert fits.warned(tmp_path, after)


def test_all_advice_is_followed() -> None:
    """Of advice that fits a text the one with the most words of its own is meant, and another one with as many."""
    known = given("task")
    assert len(known) > 130
    told = {case.advice for case in CASES}
    followed = set()
    for text in told:
        meant = [one for one in known if one.says(text)]
        most = max((one.words for one in meant), default=0)
        followed.update(one for one in meant if one.words == most)
    assert [one for one in known if one not in followed] == []
    assert [text for text in told if not any(one.says(text) for one in known)] == []


def keys_of(schema: Any) -> set[str]:
    """All keys of all tables of a schema."""
    if isinstance(schema, dict):
        own = set(schema.get("properties", {})) if isinstance(schema.get("properties"), dict) else set()
        return own.union(*map(keys_of, schema.values()))
    return set().union(*map(keys_of, schema)) if isinstance(schema, list) else set()


def test_keys_that_messages_name_exist() -> None:
    known = keys_of(problem_file.ProblemFile.model_json_schema()) | keys_of(model_file.ModelFile.model_json_schema())
    tables = "settings|specification|goal|start|clearance|uncertainty|mesh|grasp|units"
    named = []
    others = ("verify", "same_problem.py")  # these name keys of plans
    for path in (
        path for path in sorted(Path(fmopt.__file__).parent.rglob("*.py")) if not set(others) & set(path.parts)
    ):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and "\n" not in node.value:
                for table, key in re.findall(rf"(?<![\w.\[])({tables})\.([a-z_]+)\b", node.value):
                    named.append((path.name, table, key))
    assert len(named) > 3
    assert [found for found in named if found[2] not in known] == []


def measured() -> Iterator[Measured]:
    """The limits of all numbers of problem, model and assembly files."""
    for module in (tables, problem_file, model_file, assembly_file):
        for kind in vars(module).values():
            yield from (one for one in getattr(kind, "__metadata__", ()) if isinstance(one, Measured))


def test_limits_are_taken_as_they_are_told() -> None:
    limits: set[Any] = set(measured())
    assert len(limits) > 15
    for one in limits:
        for bound in (one.low, one.high):
            assert bound == 0.0 or one.low <= evaluate(at_most(bound, one.dimension)).value <= one.high
        assert one.low <= evaluate(EXAMPLES[one.dimension].strip('"')).value <= one.high
