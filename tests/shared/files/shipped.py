"""Shipped problem and model files as texts, and their operands exchanged."""

import shutil
from pathlib import Path

from fmopt.task.problem import Problem, load
from tests import ROOT


def shipped(name: str) -> str:
    """The text of a shipped problem, its models found from anywhere."""
    return (ROOT / "problems" / f"{name}.toml").read_text(encoding="utf-8").replace("../models", str(ROOT / "models"))


def swapped(text: str) -> str:
    """The same task with the hollow part in the hand."""
    a, b, c = (text.index(table) for table in ("[moving]", "[fixed]", "[goal]"))
    return text[:a] + text[b:c].replace("fixed", "moving") + text[a:b].replace("[moving]", "[fixed]") + text[c:]


def copied(folder: Path) -> Path:
    """All shipped problems and models in a folder; the problem of the square peg there."""
    for name in ("problems", "models"):
        shutil.copytree(ROOT / name, folder / name)
    return folder / "problems" / "square_peg.toml"


def edit(file: Path, old: str, new: str) -> tuple[int, int]:
    """Replaces the one place of a file where `old` stands; line and column of it."""
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {file}"
    before = text[: text.index(old)]
    file.write_text(text.replace(old, new), encoding="utf-8")
    return before.count("\n") + 1, len(before) - before.rfind("\n")


def loaded(folder: Path, text: str) -> Problem:
    """The problem of a text, whose file is written to a folder."""
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)
