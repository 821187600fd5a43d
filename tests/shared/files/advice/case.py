"""A case of advice: what was done wrong, and what a reader does then who takes the advice at its word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from fmopt.errors import FmoptError, InputError
from fmopt.geometry.part import Part
from fmopt.task.solid_tree import build_part
from tests.shared.files.model_text import UNITS
from tests.shared.files.models import model_of

T = TypeVar("T")


@dataclass(frozen=True)
class Case:
    """Advice in all its words; `wrong` meets it, and `followed` does what it says, each in an empty folder.

    `followed` says a number, such as a volume in m³, or one for each thing that the advice leaves to choose from; they
    are as `gives` says, but for a thousandth.
    """

    name: str
    advice: str
    wrong: Callable[[Path], object]
    followed: Callable[[Path], float | tuple[float, ...]]
    gives: float | tuple[float, ...]
    slow: bool = False


def filed(
    name: str, advice: str, read: Callable[[Path, T], float], wrong: T, *right: T, gives: Any, slow: bool = False
) -> Case:
    """A case of what is read in a folder: as it was wrong, and in each way that the advice leaves to choose from."""

    def followed(folder: Path) -> float | tuple[float, ...]:
        found = tuple(read(folder, one) for one in right)
        return found if len(found) > 1 else found[0]

    return Case(name, advice, lambda folder: read(folder, wrong), followed, gives, slow)


def compared(name: str, advice: str, read: Callable[[T], float], wrong: T, *right: T, gives: Any) -> Case:
    """The same, of what needs no folder."""
    return filed(name, advice, lambda _, one: read(one), wrong, *right, gives=gives)


def advice_of(error: FmoptError) -> str:
    """What an error advises; of a file at fault what the first of its faults does."""
    return error.faults[0].advice if isinstance(error, InputError) else error.advice


def modelled(folder: Path, text: str) -> Part:
    """The part of a model file, mm and deg.

    Raises:
        InputError: with every fault.
    """
    path = folder / "part.toml"
    path.write_text(f'name = "part"\n{text}\n{UNITS}', encoding="utf-8")
    model = model_of(path)
    return build_part(model.source, model.file)


def volume(part: Any) -> float:
    """Of a part, what came of a mesh, or a polyhedron, m³."""
    body = getattr(part, "polyhedron", getattr(part, "body", part))
    return float(body.volume)
