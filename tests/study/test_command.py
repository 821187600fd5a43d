"""`fmopt study` as people use it: runs, goes on, foretells, tabulates, refuses."""

import csv
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

import fmopt.study
from fmopt.errors import InputError
from fmopt.study.running.store import owned
from tests import ROOT
from tests.shared.commands import Outcome

STUDY = f"""\
title = "clearance alone"
problem = "{ROOT}/problems/square_peg.toml"
compute = ["clearance"]

[units]
length = "mm"
angle = "deg"

[[axes]]
name = "gap"
values = [-0.05, 0.05, 0.1, 0.2]
sets = {{ "model.fixed.width" = "20 mm + 2 * gap" }}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "gaps.toml"
    path.write_text(STUDY)
    return path


Study = Callable[..., tuple[str, str]]


@pytest.fixture
def fmopt_study(command: Callable[..., Outcome]) -> Study:
    """Runs the command in this process: output and errors."""

    def run(*arguments: object, code: int = 0) -> tuple[str, str]:
        done = command("study", *arguments)
        assert done.code == code, done.err
        return done.out, done.err

    return run


def test_a_study_is_run_in_two_goes_and_tabulated(study: Path, tmp_path: Path, fmopt_study: Study) -> None:
    folder = tmp_path / "out"
    out, _ = fmopt_study(study, "--out", folder, "--limit", 1, "--jobs", 1)
    assert out.startswith("1 of 4 runs done; 1 now")
    assert "; 3 left\n" in out
    out, err = fmopt_study(study, "--out", folder, "--jobs", 1)
    assert out.startswith("4 of 4 runs done; 3 now")
    assert err == ""
    out, _ = fmopt_study(study, "--out", folder, "--json")
    assert json.loads(out)["fresh"] == 0
    first, *lines = csv.reader((folder / "table.csv").read_text().splitlines())
    assert ",".join(first) == "number,gap,outcome,reason,clearance,clearance_x,clearance_y,verdict,shortfall"
    assert lines[0][:3] + lines[0][4:8] == ["0", "-5e-05", "done", "", "", "", "INFEASIBLE"]
    assert "'square_peg' does not go into 'square_hole_block'" in lines[0][3]
    assert [line[3] for line in lines[1:]] == ["", "", ""]
    assert [float(line[4]) for line in lines[1:]] == pytest.approx([5e-5, 1e-4, 2e-4], rel=1e-9)
    table = fmopt.study.frame(folder)
    assert table["gap"].to_list() == [-5e-5, 5e-5, 1e-4, 2e-4]
    assert table["verdict"].to_list() == ["INFEASIBLE", None, None, None]
    with pytest.raises(InputError, match="no study in this folder"):
        fmopt.study.frame(tmp_path)


def test_a_dry_run_shows_runs_and_time_and_writes_nothing(study: Path, tmp_path: Path, fmopt_study: Study) -> None:
    folder = tmp_path / "out"
    out, _ = fmopt_study(study, "--out", folder, "--dry-run")
    assert "4 runs, 0 of them done" in out
    assert "0: gap = -0.05 mm\n" in out
    assert "by a trial of the middle run" in out
    assert out.endswith("for the rest\n")
    assert not folder.exists()


def test_a_dry_run_foretells_what_the_same_options_would_do(study: Path, tmp_path: Path, fmopt_study: Study) -> None:
    folder = tmp_path / "out"
    fmopt_study(study, "--out", folder, "--limit", 2, "--jobs", 1)
    with closing(sqlite3.connect(folder / "study.sqlite")) as store:
        store.execute("UPDATE effort SET seconds = 3.0")
        store.execute("UPDATE results SET outcome = 'crash' WHERE key = (SELECT key FROM runs WHERE number = 1)")
        store.commit()

    def foretold(*options: object) -> tuple[int, int, float]:
        found = json.loads(fmopt_study(study, "--out", folder, "--dry-run", "--json", *options)[0])
        return found["done"], found["asked"], found["rest"]

    assert foretold("--jobs", 1) == (2, 2, 6.0)
    assert foretold("--jobs", 2, "--retry-failed") == (2, 3, 6.0)
    assert foretold("--jobs", 1, "--limit", 1) == (2, 1, 3.0)


def test_a_study_at_fault_ends_with_two(study: Path, fmopt_study: Study) -> None:
    study.write_text(STUDY.replace("model.fixed.width", "model.fixed.widht"))
    _, err = fmopt_study(study, code=2)
    assert err.startswith(f"{study}:12:")
    assert "unknown-path" in err
    assert "did you mean 'model.fixed.width'?" in err
    _, err = fmopt_study("report", study.parent, code=2)
    assert "no-study" in err


def test_the_second_at_a_folder_is_told_who_the_first_is(study: Path, tmp_path: Path, fmopt_study: Study) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    with owned(folder):
        _, err = fmopt_study(study, "--out", folder, code=4)
    assert f"process {os.getpid()} runs a study in this folder" in err


@pytest.mark.wide
def test_ctrl_c_leaves_what_was_done(study: Path, tmp_path: Path) -> None:
    study.write_text(STUDY.replace("[-0.05, 0.05, 0.1, 0.2]", str([0.05 + 0.0005 * n for n in range(300)])))
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "fmopt", "study", str(study), "--out", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        limit = time.monotonic() + 100.0
        while not done(folder) and time.monotonic() < limit:
            time.sleep(0.1)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 130, err
    assert out.startswith("interrupted: ")
    assert err == ""
    assert 0 < done(folder) < 300


def done(folder: Path) -> int:
    """Runs that are durable so far, read while the study runs."""
    if not (folder / "study.sqlite").exists():
        return 0
    with closing(sqlite3.connect((folder / "study.sqlite").as_uri() + "?mode=ro", uri=True)) as file:
        known = file.execute("SELECT count(*) FROM sqlite_master WHERE name = 'results'").fetchone()[0]
        return int(file.execute("SELECT count(*) FROM results").fetchone()[0]) if known else 0
