"""Whatever files and options are asked with, there is an answer or an error with an exit code of its own, never 70."""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path

import pytest

from fmopt.cli import main
from fmopt.errors import FmoptError
from fmopt.planning.pipeline import tried
from fmopt.task.problem import load
from tests.shared.files.asked import generated, write

FOUR = 'moving = "peg.{form}"\nfixed = "plate.{form}"\n[uncertainty]\nstart = "0.02 mm, 0.02 deg"\n'


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Some bytes dropped, doubled or replaced."""
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(content))
        end = min(at + rng.randint(0, 12), len(content))
        put = rng.choice([b"", content[at:end] * 2, bytes(rng.randrange(32, 127) for _ in range(rng.randint(1, 4)))])
        content = content[:at] + put + content[end:]
    return content


@pytest.mark.parametrize("form", ["toml", "stl"])
def test_damaged_files_are_read_or_refused(form: str, tmp_path: Path) -> None:
    rng, codes = random.Random(7), set()
    write(generated(seed=4)[1], tmp_path, form)
    files = {name: (tmp_path / name).read_bytes() for name in (f"peg.{form}", f"plate.{form}")}
    files["problem.toml"] = FOUR.format(form=form).encode()
    for number in range(60):
        for name, content in files.items():
            (tmp_path / name).write_bytes(content)
        name = sorted(files)[number % 3]
        (tmp_path / name).write_bytes(damaged(files[name], rng))
        codes.add(code(tmp_path / "problem.toml"))
    assert {0, 2} <= codes <= {0, 1, 2}


def code(file: Path) -> int:
    """The exit code with which a problem would be checked."""
    try:
        tried(load(file))
    except FmoptError as error:
        return error.exit_code
    return 0


def test_wrong_words_on_the_command_line_end_with_a_code_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(11)
    peg, plate = write(generated(seed=4)[0], tmp_path, "stl")
    (tmp_path / "problem.toml").write_text(FOUR.format(form="stl"))
    words = [str(peg), str(plate), str(tmp_path / "problem.toml"), str(tmp_path / "none.step"), str(tmp_path), "-x", ""]
    options = ["--error", "1 mm", "1 mm, 1 deg", "nan mm, 1 deg", "--unit", "mm", "parsec", "--moving", "1", "--json"]
    monkeypatch.setattr("fmopt.planning.pipeline.synthesise", lambda *_: (_ for _ in ()).throw(FmoptErrorOfTests()))
    for _ in range(60):
        command = [rng.choice(["solve", "check", "init"]), *rng.choices(words, k=rng.randint(0, 3))]
        command += [*rng.choices(options, k=rng.randint(0, 4)), "--out", str(tmp_path / "made" / str(rng.random()))]
        monkeypatch.setattr(sys, "argv", ["fmopt", *command])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capfd.readouterr()
        assert stop.value.code in (0, 1, 2, 3, 4), (command, err)
        assert "Traceback" not in out + err
        if "--json" in command and out and stop.value.code:
            assert json.loads(out)["exit_code"] == stop.value.code


class FmoptErrorOfTests(FmoptError):
    """Stands for a solve, which is not what is tried here."""

    exit_code = 3

    def __init__(self) -> None:
        super().__init__("not solved here")
