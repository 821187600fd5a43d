"""The problems and models that come with the program.

The parts of a problem for the check of plans, which does not read every file itself.

Who hands a plan on, to a robot or into an engine, asks the check first, or is told not to.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import fmopt
from fmopt import output
from fmopt.errors import ChoiceError, PlanFormatError, ResourceError, UnprovedError
from fmopt.geometry.part import Part
from fmopt.plan import Body, Plan
from fmopt.task.problem import Problem
from fmopt.verify import CERTIFIED, PlanError, judge
from fmopt.verify.problem import Given

_FOLDERS = ("models", "problems")


def _root() -> Path:
    """The folder that holds `models` and `problems`: inside an installed package, beside a checkout's."""
    package = Path(fmopt.__file__).parent
    return package / "shipped" if (package / "shipped").is_dir() else package.parent


def examples() -> tuple[str, ...]:
    """Names of the shipped problems.

    >>> "square_peg" in fmopt.examples()
    True
    """
    return tuple(sorted(file.stem for file in (_root() / "problems").glob("*.toml")))


def example(name: str) -> Path:
    """The file of a shipped problem.

    >>> fmopt.example("square_peg").name
    'square_peg.toml'

    Args:
        name: one of `fmopt.examples()`.

    Raises:
        ChoiceError: there is none of this name.
    """
    if name not in examples():
        raise ChoiceError(f"no shipped problem is called {name!r}", f"choose from {', '.join(examples())}")
    return _root() / "problems" / f"{name}.toml"


def copy_examples(folder: str | PathLike[str]) -> tuple[Path, ...]:
    """Copies the shipped problems and models, to be changed at will.

    Args:
        folder: gets the folders `problems` and `models`; what is in them already is left as it is.

    Returns:
        The files that were written, in order.

    Raises:
        ResourceError: a file is there already, or cannot be written; nothing is overwritten.
    """
    target = Path(folder)
    pairs = [
        (file, target / file.relative_to(_root()))
        for name in _FOLDERS
        for file in sorted((_root() / name).rglob("*"))
        if file.is_file()
    ]
    there = [str(copy) for _, copy in pairs if copy.exists()]
    if there:
        raise ResourceError(f"{there[0]} is there already", "choose an empty folder with --out")
    for file, copy in pairs:
        output.save(file.read_bytes(), copy)
    return tuple(copy for _, copy in pairs)


def given(problem: Problem) -> dict[str, Given]:
    """The two parts by side, in their mating frames."""
    return {"moving": _part(problem.moving), "fixed": _part(problem.fixed)}


def _part(part: Part) -> Given:
    shape = part.polyhedron
    faces = tuple(tuple(tuple(loop) for loop in face.loops) for face in shape.faces)
    return Given(Body(tuple(tuple(row) for row in shape.vertices.tolist()), faces), part.chord_error)


def admitted(plan: Plan, unverified: bool, name: str = "the plan") -> str:
    """What is to be said wherever the plan goes: nothing of one that the check certifies and that says so itself.

    Args:
        plan: the plan.
        unverified: whether to take it without asking the check.
        name: of the plan, in messages.

    Raises:
        UnprovedError: the check does not certify it, its seal is broken, or it does not say CERTIFIED itself.
        PlanFormatError: its parts are none that can be checked.
    """
    if unverified:
        said = f"the check was not asked, and the plan says {plan.verdict}"
        return f"unverified: {said}; nothing is guaranteed of what it does"
    try:
        found = judge(plan)
    except PlanError as error:
        raise PlanFormatError(f"{name}: {error}", "give a plan.json that fmopt solve wrote") from error
    if not plan.verdict == found.verdict == CERTIFIED:
        reasons = tuple(str(finding) for finding in found.findings)
        advice = "solve its problem again; or take it as it is with --unverified, when nothing is guaranteed"
        raise UnprovedError(f"{name}: not certified, the check says {found.verdict}", reasons, advice)
    return ""
