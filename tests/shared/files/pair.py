"""Files of a peg and a block that it fits, some of them changed, read as a model, a problem or an assembly."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fmopt
from fmopt.task.assembly import carried_out, load_assembly
from fmopt.task.solid_tree import build_part, build_tree
from tests.shared.files.model_text import UNITS, cuboid, difference, feature, part
from tests.shared.files.models import model_of

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


def written(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Files of these contents."""
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def raw_model(folder: Path, text: str | bytes) -> Any:
    """A model file as it stands, whose part and tree are built; an `InputError` has every fault."""
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


def assembly(folder: Path, text: str) -> int:
    """The number of tasks of an assembly of the peg and the block, all carried out."""
    written(folder, {**PAIR, "assembly.toml": text})
    return len(list(carried_out(load_assembly(folder / "assembly.toml"))))
