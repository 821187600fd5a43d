"""The command line as people and machines meet it: exit codes, messages with place and advice, no traceback ever."""

import copy
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fmopt import __version__, plan
from fmopt.cli import EXIT
from tests import ROOT
from tests.shared.commands import Outcome
from tests.shared.files.shipped import copied, edit

PROBLEM, PEG, BLOCK = "problems/square_peg.toml", "models/square_peg.toml", "models/square_hole_block.toml"


Command = Callable[..., Outcome]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with the shipped problems and models."""
    copied(tmp_path)
    return tmp_path


def widths(files: Path, peg: float, hole: float) -> Path:
    edit(files / PEG, "\nwidth = ", f"\nwidth = {peg} # ")
    edit(files / BLOCK, "\nwidth = ", f"\nwidth = {hole} # ")
    for side in ("block_x = ", "block_y = "):
        edit(files / BLOCK, side, f"{side}100 # ")
    return files / PROBLEM


# Bad input: exit 2, file:line:column: CODE: message; advice


def test_all_faults_at_once(command: Command, files: Path) -> None:
    edit(files / PROBLEM, "height = ", "heigth = ")
    edit(files / PROBLEM, "contact_force = ", "contact_force = nan # ")
    edit(files / PEG, "length = 40\n", "length = 0\n")
    done = command("check", files / PROBLEM)
    codes = {line.split(": ")[1] for line in done.err.splitlines()}
    assert done.code == 2
    assert {"unknown-key", "not-finite", "zero"} <= codes


OTHERS = [
    ("solve", "model", "this is a model file, not a problem; name a problem file"),
    ("solve", "mesh", "this is one part, and an insertion takes two; name the other one, too"),
    ("check", "mesh", "the file holds no triangles"),
    ("check", "plan", "is JSON, not TOML"),
    ("check", "empty", "is empty; copy a shipped problem"),
    ("check", "folder", "is a directory"),
    ("solve", "plan", "a plan goes to fmopt verify"),
    ("verify", "problem", "give a plan.json that fmopt solve wrote"),
]


@pytest.mark.parametrize(("verb", "kind", "words"), OTHERS, ids=[f"{row[0]} {row[1]}" for row in OTHERS])
def test_a_file_of_another_kind(command: Command, files: Path, verb: str, kind: str, words: str) -> None:
    made = {"model": files / PEG, "problem": files / PROBLEM, "folder": files}
    made |= {"mesh": files / "part.stl", "plan": files / "plan.json", "empty": files / "empty.toml"}
    made["mesh"].write_bytes(b"solid part\nendsolid part\n")
    made["plan"].write_bytes(b'{"format": "fmopt.plan/2"}')
    made["empty"].write_bytes(b"\n")
    done = command(verb, made[kind])
    assert (done.code, done.out) == (2, "")
    assert words in done.err
    assert done.err.count("\n") <= 2


def test_a_problem_in_place_of_a_model(command: Command, files: Path) -> None:
    edit(files / PROBLEM, 'model = "../models/square_peg.toml"', 'model = "square_peg.toml"')
    done = command("check", files / PROBLEM)
    assert done.code == 2
    assert "this is a problem file, not a model; name a model file" in done.err


def test_errors_as_json(command: Command, files: Path) -> None:
    line, _ = edit(files / PROBLEM, "[goal]", "[gaol]")
    done = command("check", files / PROBLEM, "--json")
    told = json.loads(done.out)
    assert told["exit_code"] == done.code == 2
    assert any(f["line"] == line and f["code"] == "unknown-key" and f["advice"] for f in told["error"]["faults"])
    assert "unknown-key" in done.err


# Infeasible: exit 1 with the interference in millimetres and where


def test_a_peg_wider_than_its_hole(command: Command, files: Path) -> None:
    done = command("solve", widths(files, 63, 61))
    assert (done.code, done.out) == (1, "")
    assert "interference 1.000000 mm at (-31, 0, -30) mm" in done.err
    assert "make the peg thinner or the hole wider" in done.err


@pytest.mark.parametrize(("peg", "words"), [(20.5, "interference 0.150000 mm"), (20.2, "interference 0.000000 mm")])
def test_check_refuses_what_cannot_be_assembled(command: Command, files: Path, peg: float, words: str) -> None:
    done = command("check", widths(files, peg, 20.2))
    assert (done.code, done.out) == (1, "")
    assert words in done.err


# check, schema, version


def test_check_says_the_problem_back(command: Command) -> None:
    done = command("check", ROOT / PROBLEM)
    assert (done.code, done.err) == (0, "")
    for words in ("20 x 20 x 40 mm", "blind, depth 30 mm", "0.1 mm along x", "+-0.3, 0.3, 0 mm", "1 % in translation"):
        assert words in done.out


def test_check_as_json_and_in_silence(command: Command) -> None:
    found = json.loads(command("check", ROOT / PROBLEM, "--json").out)
    assert found["valid"] is True
    assert len(found["sha256"]) == 64
    assert command("check", ROOT / PROBLEM, "--quiet") == Outcome(0, "", "")


ASSEMBLY = "problems/assemblies/lee_huang_bush.toml"


def test_check_says_an_assembly_back(command: Command) -> None:
    done = command("check", ROOT / ASSEMBLY)
    assert (done.code, done.err) == (0, "")
    for words in ("seat_bush  bush.shank", "operand 2: bush.bore, bush.shank, block.hole", "p_z is free: -30 mm"):
        assert words in done.out
    found = json.loads(command("check", ROOT / ASSEMBLY, "--json").out)
    assert [step["name"] for step in found["tasks"]] == ["seat_bush", "insert_peg"]
    assert found["tasks"][1]["links"][-1] == {"kind": "cylindrical", "one": "peg.peg", "other": "bush.bore"}


def test_check_finds_the_task_that_breaks_a_rule_and_solve_refuses_assemblies(command: Command, tmp_path: Path) -> None:
    text = (ROOT / ASSEMBLY).read_text(encoding="utf-8").replace("../../models", str(ROOT / "models"))
    path = tmp_path / "assembly.toml"
    path.write_text(text.replace("goal = [0, 0, -25,", "goal = [0, 0.5, -25,"), encoding="utf-8")
    done = command("check", path)
    assert (done.code, done.out) == (2, "")
    assert "assembly.toml:32:8: task-rule: tasks.insert_peg: the goal of 'peg.peg' has p_y = 0.5 mm" in done.err
    assert command("solve", ROOT / ASSEMBLY).code == 2


FOLDERS = {"problem": "problems", "model": "models", "assembly": "problems/assemblies"}
FOLDERS |= dict.fromkeys(("study", "allocation"), "problems/studies")


@pytest.mark.parametrize(("kind", "folder"), FOLDERS.items())
def test_the_published_schemas_are_the_printed_ones(command: Command, kind: str, folder: str) -> None:
    done = command("schema", kind)
    assert done.code == 0
    assert done.out == (ROOT / folder / f"{kind}.schema.json").read_text(encoding="utf-8")


def test_wrong_words_on_the_command_line(command: Command) -> None:
    for words in (["schema", "plan"], ["no-such-command"], ["solve"], ["check", "--no-such-option", "x"]):
        assert command(*words).code == 2


def test_version_and_help(command: Command) -> None:
    assert command("--version").out.strip() == __version__
    assert "Exit codes: 0 certified" in command("--help").out


def test_an_internal_fault_is_one_line(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(path: Path) -> None:
        raise ZeroDivisionError("broken on purpose")

    monkeypatch.setattr("fmopt.task.problem.load", broken)
    done = command("check", ROOT / PROBLEM)
    assert (done.code, done.err.count("\n")) == (70, 1)
    assert "internal fault: ZeroDivisionError: broken on purpose" in done.err


# verify


def test_verify_agrees(command: Command, square_peg_plan_file: Path, square_peg_plan: dict[str, Any]) -> None:
    done = command("verify", square_peg_plan_file, "--problem", ROOT / PROBLEM)
    assert done.code == EXIT[square_peg_plan["verdict"]]
    assert done.out.startswith(f"verdict: {square_peg_plan['verdict']}")
    assert "not covered: friction" in done.out
    as_json = command("verify", square_peg_plan_file, "--json")
    assert json.loads(as_json.out)["verdict"] == square_peg_plan["verdict"]
    assert as_json.out.count("\n") == 1
    told = json.loads(as_json.out)
    assert [s["margin"] for s in told["segment_margins"]] == [s["margin"] for s in square_peg_plan["segments"]]
    assert told["collision"] is None
    assert told["details"] == []
    assert command("verify", square_peg_plan_file, "--quiet") == Outcome(done.code, "", "")


def test_verify_tells_that_a_plan_does_not_claim_to_be_certified(
    command: Command, square_peg_plan: dict[str, Any], tmp_path: Path
) -> None:
    """Every number of it follows, as where it is certified for a share of the stated errors, and it says so itself."""
    plan.write(plan.sealed({**square_peg_plan, "verdict": "NOT_PROVED"}), tmp_path / "plan.json")
    done = command("verify", tmp_path / "plan.json")
    assert done.code == 3
    assert "plan: verdict: the plan itself does not claim to be certified, but says NOT_PROVED" in done.out
    told = json.loads(command("verify", tmp_path / "plan.json", "--json").out)
    assert (told["verdict"], told["stated_verdict"]) == ("NOT_PROVED", "NOT_PROVED")
    altered = copy.deepcopy(square_peg_plan)
    altered["segments"][0]["margin"] *= 2.0
    plan.write(plan.sealed(altered), tmp_path / "plan.json")
    done = command("verify", tmp_path / "plan.json")
    assert done.out.startswith("verdict: NOT_PROVED (")
    assert "; the plan's own verdict is CERTIFIED" in done.out


@pytest.mark.parametrize(
    "line",
    [
        ["verify", "FILE"],
        ["show", "FILE", "--list"],
        ["export", "FILE", "--to", "csv", "--out", "-"],
        ["export", "FILE", "--to", "urscript", "--base", "0", "0", "0", "0", "0", "0", "--out", "-"],
        ["execute", "FILE", "--trials", "1"],
        ["compare", "FILE", "--trials", "1"],
    ],
    ids=["verify", "show", "csv", "urscript", "execute", "compare"],
)
def test_what_lacks_a_key_is_no_plan_for_any_command(command: Command, tmp_path: Path, line: list[str]) -> None:
    file = tmp_path / "plan.json"
    file.write_text('{"format": "fmopt.plan/2"}')
    done = command(*(str(file) if word == "FILE" else word for word in line))
    assert (done.code, done.out) == (2, "")
    assert f"{file}: plan: lacks the key 'verdict'" in done.err


def test_verify_with_another_problem_is_not_proved(command: Command, square_peg_plan_file: Path) -> None:
    done = command("verify", square_peg_plan_file, "--problem", ROOT / "problems" / "factory_rect_8mm_tight.toml")
    assert done.code == 3
    assert "the plan belongs to another problem" in done.out
    assert "the plan is for another moving part" in done.out


def test_verify_refutes_an_end_in_the_wall(command: Command, square_peg_plan: dict[str, Any], tmp_path: Path) -> None:
    changed = copy.deepcopy(square_peg_plan)
    changed["segments"][-1]["goal"][0] += 1e-3
    plan.write(plan.sealed(changed), tmp_path / "plan.json")
    done = command("verify", tmp_path / "plan.json")
    assert done.code == 1
    assert done.out.startswith("verdict: REFUTED")
    assert "overlap" in done.out


def test_verify_of_a_missing_plan(command: Command, tmp_path: Path) -> None:
    done = command("verify", tmp_path / "nowhere.json")
    assert (done.code, done.out) == (4, "")
    assert str(tmp_path / "nowhere.json") in done.err


# solve


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch, square_peg_plan: dict[str, Any]) -> None:
    """Lets `solve` answer with the session's plan at once."""
    from fmopt import verify
    from fmopt.planning import pipeline

    answer = pipeline.Synthesis(square_peg_plan, verify.verify(square_peg_plan), {"search": 1.0})
    monkeypatch.setattr(pipeline, "synthesise", lambda problem, progress, reserved: answer)


@pytest.mark.usefixtures("solved")
def test_solve_tells_people(command: Command, square_peg_plan: dict[str, Any], tmp_path: Path) -> None:
    done = command("solve", ROOT / PROBLEM, "--trials", "0", "--out", tmp_path / "out")
    assert (done.code, done.err) == (EXIT[square_peg_plan["verdict"]], "")
    for words in (square_peg_plan["verdict"], "clearance a side: measured 0.1 mm", "not covered: ", "plan.json"):
        assert words in done.out
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["plan.json", "timings.json"]
    assert json.loads((tmp_path / "out" / "timings.json").read_text()) == {"search": 1.0}


@pytest.mark.usefixtures("solved")
def test_solve_tells_machines(command: Command, square_peg_plan: dict[str, Any], tmp_path: Path) -> None:
    done = command("solve", ROOT / PROBLEM, "--trials", "0", "--out", tmp_path, "--json")
    assert (done.code, done.err) == (EXIT[square_peg_plan["verdict"]], "")
    assert done.out.count("\n") == 1
    found = json.loads(done.out)
    assert found["verdict"] == square_peg_plan["verdict"]
    assert found["segments"] == len(square_peg_plan["segments"])
    assert found["plan"] == str(tmp_path / "plan.json")
    assert command("solve", ROOT / PROBLEM, "--trials", "0", "--out", tmp_path, "--quiet") == Outcome(done.code, "", "")


@pytest.mark.usefixtures("solved")
def test_an_out_folder_that_cannot_be_written(command: Command, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    done = command("solve", ROOT / PROBLEM, "--out", tmp_path / "file" / "out")
    assert (done.code, done.out) == (4, "")
    assert str(tmp_path / "file" / "out") in done.err
    assert "choose another place with --out" in done.err


def test_a_fresh_process_writes_the_same_bytes(square_peg_plan_file: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "fmopt", "solve", str(ROOT / PROBLEM)]
    command += ["--out", "out", "--trials", "0", "--report", "--json"]
    environment = {**os.environ, "PYTHONHASHSEED": "4711"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=540)
    document = plan.read_document(tmp_path / "out" / "plan.json")
    assert (done.returncode, done.stderr) == (EXIT[document["verdict"]], "")
    assert json.loads(done.stdout)["verdict"] == document["verdict"]
    assert (tmp_path / "out" / "plan.json").read_bytes() == square_peg_plan_file.read_bytes()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.lower().startswith("<!doctype html>")
    assert document["sha256"] in page


@pytest.mark.wide
def test_a_traceback_never_leaves_a_process(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xff\x00\x1b[31m = [[[")
    for words in (["solve", "a.toml"], ["verify", "a.toml"], ["check", "."], ["solve", "missing.toml", "--json"]):
        done = subprocess.run([sys.executable, "-m", "fmopt", *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert (done.stdout == "") is ("--json" not in words)
        assert done.stderr
        assert "Traceback" not in done.stderr
        assert "\x1b" not in done.stderr
