"""Advice on problem files is followed to the letter, and the fault is gone; keys that messages name exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import fmopt
from fmopt.errors import Fault, FmoptError, InputError
from fmopt.planning.pipeline import tried
from fmopt.task.toml import model_file, problem_file
from tests.shared.files.asked import generated, solid, write
from tests.shared.files.step_files import write_step

PACKAGE = Path(fmopt.__file__).parent
BASE = 'moving = "peg.toml"\nfixed = "plate.toml"\n[uncertainty]\nstart = "0.02 mm, 0.02 deg"\n'
Rule = Callable[[str, re.Match[str], Fault], str]


def replaced(text: str, fault: Fault, value: str) -> str:
    """The text with another value at the place of a fault."""
    lines = text.split("\n")
    line = lines[fault.line - 1]
    key, _, _ = line.partition("=")
    lines[fault.line - 1] = f"{key.rstrip()} = {value}"
    return "\n".join(lines)


def removed(text: str, fault: Fault) -> str:
    lines = text.split("\n")
    del lines[fault.line - 1]
    return "\n".join(lines)


def added(text: str, table: str, line: str) -> str:
    """The text with a line at the end of a table, which is made where it is not there."""
    head = f"[{table}]\n"
    return text.replace(head, f"{head}{line}\n") if head in text else f"{text}{head}{line}\n"


# What advice says, and what a reader does who takes it at its word. The first that is found in it is followed.
RULES: tuple[tuple[str, Rule], ...] = (
    (r"did you mean '([^']+)'\?", lambda t, m, f: _renamed(t, m[1], f)),
    (r"add '(\w+)' to \[specification\], or drop '(\w+)'", lambda t, m, f: re.sub(rf"(?m)^{m[2]} = .*\n", "", t)),
    (r"add '(\w+)' to \[([\w.]+)\]", lambda t, m, f: added(t, m[2], f'{m[1]} = "0.01 {_unit(m[1])}"')),
    (r"such as (\"[^\"]+\")", lambda t, m, f: replaced(t, f, m[1])),
    (r'give either .* start = ("[^"]+")', lambda t, m, f: added(t, "uncertainty", f"start = {m[1]}")),
    (r"keep it at (?:most|least) ([\d.e+-]+ ?[\w/*]*)", lambda t, m, f: replaced(t, f, f'"{m[1]}"')),
    (r"lower it, or write (\"full\")", lambda t, m, f: replaced(t, f, m[1])),
    (r"leave (?:it|'\w+') out|remove '\w+'|drop it", lambda t, m, f: removed(t, f)),
    (r"^write '([\w+]+)'", lambda t, m, f: replaced(t, f, f'"{m[1]}"')),
    (r"make it (?:positive|zero or positive)", lambda t, m, f: replaced(t, f, '"0.5 mm"')),
    (r"lower it to well below ([\d.]+ N)", lambda t, m, f: replaced(t, f, '"1 N"')),
    (r"or correct \[clearance\]", lambda t, m, f: t[: t.index("[clearance]")]),
)


def _renamed(text: str, name: str, fault: Fault) -> str:
    lines = text.split("\n")
    line = lines[fault.line - 1]
    if fault.code == "unknown-key":
        key = fault.key.rpartition(".")[2]
        lines[fault.line - 1] = line.replace(key, name, 1)
    else:
        lines[fault.line - 1] = re.sub(r'"[^"]*"\s*(#.*)?$', f'"{name}"', line)
    return "\n".join(lines)


def _unit(name: str) -> str:
    return "deg" if name.startswith("r") or name == "angle" else "mm"


def followed(text: str, fault: Fault) -> str:
    for pattern, rule in RULES:
        found = re.search(pattern, fault.advice)
        if found:
            return rule(text, found, fault)
    raise AssertionError(f"nobody knows how to follow {fault.advice!r}")


LONG = '[moving]\nmodel = "peg.toml"\n[fixed]\nmodel = "plate.toml"\n'
BROKEN = {
    "no error": 'moving = "peg.toml"\nfixed = "plate.toml"\n',
    "error without angle": BASE.replace(", 0.02 deg", ""),
    "error without units": BASE.replace("0.02 mm, 0.02 deg", "0.02, 0.02"),
    "number without unit": f"{BASE}[start]\nheight = 1\n",
    "angle without unit": f"{BASE}[goal]\nturn = 1\n",
    "speed without unit": f"{BASE}[specification]\nspeed = 20\n",
    "no angle": f'{LONG}[uncertainty.start]\nposition = "0.02 mm"\nrx = "0.1 deg"\nry = "0.1 deg"\n',
    "no position": f'{LONG}[uncertainty.start]\nangle = "0.02 deg"\nx = "0.1 mm"\ny = "0.1 mm"\n',
    "misspelt table": BASE.replace("[uncertainty]", "[setings]\n[uncertainty]").replace("[setings]\n", "")
    + '[setings]\nmax_tilt = "9 deg"\n',
    "misspelt key": f'{BASE}[settings]\nmax_tlt = "9 deg"\n',
    "misspelt unit key": f'{LONG}featur = "hole"\n{BASE[BASE.index("[unc") :]}',
    "misspelt feature": f'{LONG}feature = "hle"\n{BASE[BASE.index("[unc") :]}',
    "misspelt choice": f'{BASE}[settings]\nmethod = "sund"\n',
    "too steep": f'{BASE}[settings]\nmax_tilt = "50 deg"\n',
    "too low": f'{BASE}[start]\nheight = "1e-12 mm"\n',
    "below zero": f'{BASE}[start]\nheight = "-1 mm"\n',
    "too deep": f'{BASE}[goal]\ndepth = "50 mm"\n',
    "unit of a model file": f'{LONG}unit = "mm"\n{BASE[BASE.index("[unc") :]}',
    "ends with too much": f'{BASE}[specification]\ntermination_force = "30 N"\n',
    "half an impact": f'{BASE}[specification]\nimpact_force = "30 N"\n',
    "clearance of another part": f'{BASE}[clearance]\nx = "9 mm"\n',
    "unit of a STEP file": f'{LONG.replace("plate.toml", "plate.step")}unit = "mm"\n{BASE[BASE.index("[unc") :]}',
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    here = tmp_path_factory.mktemp("advice")
    pair = generated(seed=1)[0]
    write(pair, here, "toml")
    write(pair, here, "stl")
    write_step(here / "plate.step", solid(pair.loops()[1], 12.0))
    return here


def faults(file: Path) -> tuple[Fault, ...]:
    """What is wrong with a file, as loading or trying it says."""
    try:
        tried(fmopt.load(file))
    except InputError as error:
        return error.faults
    except FmoptError as error:
        return (Fault(str(file), 1, 1, "", "", error.message, error.advice),)
    return ()


@pytest.mark.parametrize("name", BROKEN)
def test_advice_that_is_followed_leads_to_a_problem(name: str, folder: Path) -> None:
    file = folder / "problem.toml"
    text = BROKEN[name]
    for _ in range(4):
        file.write_text(text, encoding="utf-8")
        found = faults(file)
        if not found:
            break
        assert found[0].advice, found[0]
        text = followed(text, found[0])
    else:
        raise AssertionError(f"advice goes round in circles: {found}")
    assert text != BROKEN[name]


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
    for path in (path for path in sorted(PACKAGE.rglob("*.py")) if not set(others) & set(path.parts)):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and "\n" not in node.value:
                for table, key in re.findall(rf"(?<![\w.\[])({tables})\.([a-z_]+)\b", node.value):
                    named.append((path.name, table, key))
    assert len(named) > 3
    assert [found for found in named if found[2] not in known] == []
