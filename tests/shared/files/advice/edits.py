"""Advice on files that are followed by an edit of their text: what is read, and two parts that fit one another."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import fmopt
from fmopt.planning.pipeline import tried
from fmopt.task.assembly import carried_out, load_assembly
from fmopt.task.solid_tree import build_part, build_tree
from tests.shared.files.advice.case import Case
from tests.shared.files.model_text import UNITS, cuboid, difference, feature, part
from tests.shared.files.models import model_of

T = TypeVar("T")
PEG = part("peg", cuboid("peg", "20, 20, 50"), feature("peg", "solid", "0, 0, 0", "50"))
BLOCK = part(
    "block",
    difference("block", "whole", "pocket"),
    cuboid("whole", "60, 60, 40"),
    cuboid("pocket", "20.2, 20.2, 40", "0, 0, 10"),
    feature("hole", "hollow", "0, 0, 40", "30"),
)
PAIR = {"peg.toml": f"{PEG}{UNITS}", "block.toml": f"{BLOCK}{UNITS}"}
SHORT = 'moving = "peg.toml"\nfixed = "block.toml"\n'
LONG = '[moving]\nmodel = "peg.toml"\n[fixed]\nmodel = "block.toml"\n'
START = '[uncertainty]\nstart = "0.02 mm, 0.02 deg"\n'


def edited(name: str, advice: str, read: Callable[[Path, T], object], before: T, *after: T, slow: bool = False) -> Case:
    """A case of what is read: refused as it was before, and taken in each way that the advice leaves to choose from."""

    def followed(folder: Path) -> float:
        for one in after:
            read(folder, one)
        return float(len(after))

    return Case(name, advice, lambda folder: read(folder, before), followed, float(len(after)), slow)


def written(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Files of these contents."""
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def raw_model(folder: Path, text: str | bytes) -> Any:
    """A model file as it stands, whose part and tree are built.

    Raises:
        InputError: with every fault.
    """
    path = folder / "part.toml"
    written(folder, {path.name: text})
    model = model_of(path)
    part = build_part(model.source, model.file)
    if part.features:
        build_tree(model.source, model.file)
    return part


def model(folder: Path, text: str) -> Any:
    """The same, with mm and deg for its numbers."""
    return raw_model(folder, f"{text}\n{UNITS}")


def problem(folder: Path, text: str) -> Any:
    """A problem about the peg and the block, read."""
    return files(folder, {"problem.toml": text})


def files(folder: Path, changed: Mapping[str, str | bytes]) -> Any:
    """A problem read, and the files that it names, where they are not those of the peg and of the block as they are."""
    written(folder, {**PAIR, "problem.toml": f"{SHORT}{START}", **changed})
    return fmopt.load(folder / "problem.toml")


def fitted(folder: Path, changed: Mapping[str, str | bytes]) -> Any:
    """The same, and its clearance measured."""
    return tried(files(folder, changed))


def assembly(folder: Path, text: str) -> int:
    """The number of tasks of an assembly of the peg and the block, all carried out."""
    return assembled(folder, {"assembly.toml": text})


def assembled(folder: Path, changed: Mapping[str, str]) -> int:
    """The same, with files that are not as they are."""
    written(folder, {**PAIR, **changed})
    return len(list(carried_out(load_assembly(folder / "assembly.toml"))))
