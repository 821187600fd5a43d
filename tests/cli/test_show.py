"""`fmopt show` and `fmopt examples`, standard input and output, colours, start-up: what a terminal is used to."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmopt import plan
from tests import ROOT
from tests.shared.commands import Outcome
from tests.shared.plans.report_plans import cube_plan

Command = Callable[..., Outcome]


DRAWN = {
    "models/square_hole_block.toml": {"part", "scene"},
    "problems/square_peg.toml": {"parts", "scene", "diagrams"},
    "problems/assemblies/lee_huang_bush.toml": {"seat_bush", "insert_peg"},
}


@pytest.mark.parametrize("file", DRAWN)
def test_files_are_drawn_by_what_they_are(command: Command, file: str) -> None:
    code, out, _ = command("show", ROOT / file, "--list", "--json")
    assert code == 0
    assert set(json.loads(out)) == DRAWN[file]
    first = next(iter(json.loads(out)))
    code, out, _ = command("show", ROOT / file)
    written = Path(out.removeprefix("wrote ").strip())
    assert (code, written.name) == (0, f"{Path(file).stem}-{first}.svg")
    assert "<svg" in written.read_text(encoding="utf-8")


def test_a_plan_is_drawn_in_every_format(command: Command) -> None:
    plan.write(cube_plan(), Path("plan.json"))
    names = [line.split()[0] for line in command("show", "plan.json", "--list")[1].splitlines()]
    assert names[:4] == ["scene", "cut", "states", "margin"]
    assert command("show", "plan.json", "--json")[1] == '{"written": ["plan-scene.html"]}\n'
    assert command("show", "plan.json", "--what", "margin", "--out", "m.png", "--quiet")[:2] == (0, "")
    said, named = (command("show", "plan.json", "--what", what, "--out", "-")[1] for what in ("moves", "cut"))
    assert said == named
    assert Path("m.png").read_bytes().startswith(b"\x89PNG")
    assert "<canvas" in Path("plan-scene.html").read_text(encoding="utf-8")


def test_plans_and_drawings_go_through_pipes(command: Command) -> None:
    text = json.dumps(cube_plan()).encode()
    code, out, _ = command("show", "-", "--what", "margin", "--out", "-", given=text)
    assert (code, out.startswith("<?xml")) == (0, True)
    code, out, _ = command("show", "-", "--out", "-", given=text)
    assert (code, out.startswith("<!DOCTYPE html>")) == (0, True)
    assert command("show", "-", given=b"{}")[0] == 2


def test_problems_come_from_standard_input_too(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "problems")
    text = Path("square_peg.toml").read_bytes()
    code, out, _ = command("check", "-", "--json", given=text)
    assert code == 0
    assert json.loads(out)["title"] == json.loads(command("check", "square_peg.toml", "--json")[1])["title"]
    code, _, err = command("check", "-", given=text.replace(b'depth = "full"', b"depth = -1"))
    assert (code, err.startswith("-:")) == (2, True)
    assert "more than 1000000 bytes" in command("check", "-", given=b"#" * 1_000_001)[2]


def test_verify_reads_standard_input(command: Command, square_peg_plan_file: Path) -> None:
    code, out, _ = command("verify", "-", given=square_peg_plan_file.read_bytes())
    assert (code, "CERTIFIED" in out) == (0, True)


REFUSED = {
    "no such drawing": (
        ["show", str(ROOT / "models/square_peg.toml"), "--what", "tube"],
        2,
        "choose from part, scene; fmopt show",
    ),
    "no such format": (["show", str(ROOT / "models/square_peg.toml"), "--out", "x.pdf"], 2, "choose from .svg, .png"),
    "a scene as SVG": (
        ["show", str(ROOT / "models/square_peg.toml"), "--what", "scene", "--out", "x.svg"],
        2,
        "ends with .html",
    ),
    "no file": (["show", "none.toml"], 2, "does not exist"),
    "no plan": (["show", "none.json"], 4, "No such file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_drawn_is_refused_with_advice(command: Command, name: str) -> None:
    words, code, advice = REFUSED[name]
    found = command(*words)
    assert found[0] == code
    assert advice in found[2]


def test_a_model_at_fault_is_refused_at_its_place(command: Command) -> None:
    text = (ROOT / "models/square_peg.toml").read_text(encoding="utf-8").replace("width = 20", "width = -20")
    Path("bad.toml").write_text(text, encoding="utf-8")
    code, _, err = command("show", "bad.toml")
    assert (code, err.startswith("bad.toml:")) == (2, True)


def test_examples_are_listed_and_copied(command: Command) -> None:
    assert "square_peg" in command("examples")[1].split()
    code, out, _ = command("examples", "--out", "trial")
    assert (code, out.endswith("files to trial\n")) == (0, True)
    assert command("check", "trial/problems/square_peg.toml", "--quiet")[:2] == (0, "")
    code, _, err = command("examples", "--out", "trial")
    assert (code, "is there already" in err) == (4, True)


def process(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "TERM": "xterm-256color", **environment}
    words = (sys.executable, "-m", "fmopt", *words)
    return subprocess.run(words, capture_output=True, text=True, timeout=120, env=env, check=False)


def test_output_that_is_no_terminal_has_no_colours_and_no_progress() -> None:
    done = process("check", str(ROOT / "problems/square_peg.toml"))
    assert done.returncode == 0
    assert "\x1b" not in done.stdout + done.stderr
    assert done.stderr == ""


@pytest.mark.parametrize(("forced", "coloured"), [({"FORCE_COLOR": "1"}, True), ({"NO_COLOR": "1"}, False)])
def test_no_color_is_heeded(square_peg_plan: dict[str, Any], forced: dict[str, str], coloured: bool) -> None:
    code = (
        "import json, sys; from pathlib import Path; from fmopt.plan import parsed\n"
        "from fmopt.cli.console import print_solved\n"
        "print_solved(parsed(json.load(sys.stdin)), [], Path('x'), False)"
    )
    env = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")} | forced
    done = subprocess.run(
        [sys.executable, "-c", code], input=json.dumps(square_peg_plan), env=env, capture_output=True, text=True,
        timeout=120, check=True,
    )  # fmt: skip
    assert ("\x1b[" in done.stdout) == coloured


def test_every_command_has_help_with_an_example(command: Command) -> None:
    shown = command("--help")[1]
    for name in ("solve", "verify", "check", "show", "examples", "export", "schema"):
        assert f" {name} " in shown
        assert f"fmopt {name} " in command(name, "--help")[1].split("Example")[1]
    assert "--install-completion" in shown


def test_a_shell_can_complete() -> None:
    done = process("--show-completion", "bash", _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert "_fmopt_completion" in done.stdout or "complete" in done.stdout
