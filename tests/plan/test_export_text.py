"""Text of a plan in exports: whatever it is, it stays text, though no reader has looked at it."""

import csv
import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from lark import Token, Tree

from fmopt.errors import FmoptError
from fmopt.notebook.checking import admitted
from fmopt.plan import Plan
from fmopt.plan import parsed as read
from fmopt.plan.export.write import Form, exported
from tests.shared.plans.report_plans import altered
from tests.shared.urscript.language import parsed

MOVEJ = "movej([0,0,0,0,0,0])"
BREAKS = ("\n", "\r", "\r\n", "\v", "\f", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029", "\0", "\x1b[2J", "\x9b2J")
QUOTES = (
    *('"', "'", '")', '\\"', "\\", "`", '"""', "'''", "#", ": ", " #", "---", "...", "%"),
    *("{", "}", "[", "]", ",", ";", "&a", "*a", "!t"),
)
EVERYTHING = "1" + "".join(f"{hazard}{MOVEJ}" for hazard in BREAKS + QUOTES)
TEXTS = {
    "a line of URScript": f"1\n{MOVEJ} #",
    "everything": EVERYTHING,
    "a string that ends": f'"){BREAKS[0]}{MOVEJ}\ntextmsg("' + EVERYTHING,
    "a formula": '=HYPERLINK("http://x";1),+1,-1,@a\t=1;=1\r=1\n=1',
    "a document of YAML": f"x\n---\nmove: !!python/object/apply:os.system ['{MOVEJ}']\n...\n",
    "a key of JSON": '","samples":[],"x":"\ud800\U0001f600\u202e',
}
OF_THE_FORM = {"kind", "role", "stays", "axis"}  # words of the format: another one may stop the export
BASE = (0.4, -0.1, 0.2, 0.3, 3.0, -0.2)
FILES = {"urscript": ("",), "csv": ("",), "json": ("",), "ros2": ("segments.yaml", "controllers.yaml")}


def strings(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Every text in a plan, with the name of what holds it."""
    if isinstance(value, str):
        yield key, value
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from strings(getattr(value, field.name), field.name)
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from strings(item, f"{key}.{name}")
    elif isinstance(value, tuple):
        for item in value:
            yield from strings(item, key)


def spoilt(value: Any, change: Callable[[str, str], str], key: str = "") -> Any:
    """The plan with every text changed, given the name of what holds it."""
    if isinstance(value, str):
        return change(key, value)
    if dataclasses.is_dataclass(value):
        changed = {f.name: spoilt(getattr(value, f.name), change, f.name) for f in dataclasses.fields(value)}
        return altered(value, **changed)
    if isinstance(value, Mapping):
        return {name: spoilt(item, change, f"{key}.{name}") for name, item in value.items()}
    return tuple(spoilt(item, change, key) for item in value) if isinstance(value, tuple) else value


@pytest.fixture(scope="module")
def plan(square_peg_plan: dict[str, Any]) -> Plan:
    """A short plan: the first moves of the square peg."""
    whole = read(square_peg_plan)
    short = altered(whole.description, position_force=whole.description.position_force[:3])
    return replace(whole, segments=whole.segments[:6], description=short)


def written(plan: Plan, to: str, folder: Path) -> dict[str, str]:
    """The texts that an export writes, by file."""
    exported(plan, Form(to, BASE, 1.0, admitted(plan, unverified=True)), folder / to)
    return {name: (folder / to / name if name else folder / to).read_bytes().decode() for name in FILES[to]}


def shape(node: Any) -> Any:
    """A syntax tree without the content of its strings."""
    if isinstance(node, Tree):
        return (node.data, [shape(child) for child in node.children])
    return "STRING" if isinstance(node, Token) and node.type == "STRING" else str(node)


def of_data(value: Any) -> Any:
    """Data without the content of its texts."""
    if isinstance(value, dict):
        return {key: of_data(item) for key, item in value.items()}
    if isinstance(value, list):
        return [of_data(item) for item in value]
    return "text" if isinstance(value, str) else value


def structure(to: str, text: str) -> Any:
    """What a reader of the format makes of a text, but for the content of texts; one line for every line feed."""
    assert text.splitlines() == text.removesuffix("\n").split("\n")
    assert not [letter for letter in text if letter != "\n" and not letter.isprintable()]
    if to == "urscript":
        code = [line.partition("#")[0] if '"' not in line else "" for line in text.split("\n")]
        assert not [line for line in code if "movej" in line]
        return shape(parsed(text))
    if to == "ros2":
        return of_data(yaml.safe_load(text))
    if to == "json":
        return of_data(json.loads(text))
    told = [line for line in text.split("\n") if line.startswith(("# plan", "# WARNING"))]
    assert {len(next(csv.reader([line], delimiter=delimiter))) for line in told for delimiter in ",;\t|"} == {1}
    rows = list(csv.reader(text.splitlines()))
    return [["#"] if row[0].startswith(("# plan", "# WARNING")) else row for row in rows]


@pytest.mark.parametrize(
    ("to", "text"),
    [
        *((to, "everything") for to in FILES),
        *(("urscript", "a line of URScript"), ("urscript", "a string that ends"), ("csv", "a formula")),
        *(("ros2", "a document of YAML"), ("json", "a key of JSON")),
    ],
)
def test_no_text_of_a_plan_becomes_code(plan: Plan, tmp_path: Path, to: str, text: str) -> None:
    before = {name: structure(to, content) for name, content in written(plan, to, tmp_path / "before").items()}
    names = {contact.id for contact in plan.contacts}
    keys = sorted({key for key, value in strings(plan) if value not in names})
    assert {"title", "problem", "version", "sha256", "verdict", "name", "not_covered"} <= set(keys)
    changes = {key: lambda k, value, key=key: TEXTS[text] if k == key and value not in names else value for key in keys}
    changes["names of contacts"] = lambda _, value: TEXTS[text] + value if value in names else value
    for key, change in changes.items():
        try:
            after = written(spoilt(plan, change), to, tmp_path / key)
        except FmoptError:
            assert key in OF_THE_FORM
            continue
        assert {name: structure(to, content) for name, content in after.items()} == before, key


def test_the_comparison_notices_code(plan: Plan, tmp_path: Path) -> None:
    [good] = written(plan, "urscript", tmp_path / "a").values()
    bad = good.replace("\n\n", f"\n{MOVEJ}\n", 1)
    with pytest.raises(AssertionError):
        structure("urscript", bad)
    assert shape(parsed(bad)) != shape(parsed(good))
    good = written(plan, "ros2", tmp_path / "b")["segments.yaml"]
    assert structure("ros2", f"{good}\nmore: 1\n") != structure("ros2", good)


@pytest.mark.parametrize("to", ["urscript", "ros2"])
@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_numbers_that_are_none_are_not_written(plan: Plan, tmp_path: Path, to: str, number: float) -> None:
    spoilt = replace(plan, specification=replace(plan.specification, friction=number))
    with pytest.raises(FmoptError):
        written(spoilt, to, tmp_path)
