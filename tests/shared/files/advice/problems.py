"""Advice on problem files, followed: the goal, the errors of the start, what limits forces, and other files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from typer.testing import CliRunner

import fmopt
from fmopt.cli import app
from tests.shared.files.advice.case import UNITS, Case
from tests.shared.files.advice.edits import (
    LONG,
    PAIR,
    PEG,
    SHORT,
    START,
    assembled,
    edited,
    files,
    problem,
    written,
)
from tests.shared.files.advice.texts import TASK

WHOLE = f"{SHORT}{START}"
MATED = '[moving]\nmodel = "peg.toml"\nfeature = "peg"\n[fixed]\nmodel = "block.toml"\nfeature = "hole"\n'
EITHER = 'give either [uncertainty.start], or [uncertainty] start = "1 mm, 1 deg", or [uncertainty.sources]'
BOX = '[uncertainty.start]\nposition = "1 mm"\nangle = "1 deg"\n'
ROBOT = '[uncertainty.sources]\nrobot = { position = "0.1 mm" }\ngrasp = { height = "20 mm" }\n'
BALL_PEG = f"{PEG}[balls.tip]\nat = [0, 0, 0]\nradius = 8\n{UNITS}"
PLACED = 'placed = [{ robot = { position = "0.1 mm" } }]'
NAMED = "name the peg of one part and the hole of the other"
ONE_OF = "give one of position (with angle), known, observed; or placed alone, from an exact place"
POINTS = 'observed = {{ points = [["0 mm", 0, 0], ["{} mm", 0, 0], [0, "{} mm", 0]], deviation = "0.1 mm" }}'
FLAT, FLAT_SLOT = (
    f"[profile]\npolygons = {polygons}\n[features.{name}]\nkind = '{kind}'\nat = {at}\nlength = 30\n{UNITS}"
    for name, kind, at, polygons in (
        ("peg", "solid", [0, 0, 0], [[[-10, 0], [10, 0], [10, 50], [-10, 50]]]),
        (
            "hole",
            "hollow",
            [0, 0, 40],
            [
                [[-30, 0], [-10.1, 0], [-10.1, 40], [-30, 40]],
                [[10.1, 0], [30, 0], [30, 40], [10.1, 40]],
                [[-30, 0], [30, 0], [30, 10], [-30, 10]],
            ],
        ),
    )
)
PLANE = {"peg.toml": FLAT, "block.toml": FLAT_SLOT}


def flat_problem(folder: Path, text: str) -> Any:
    """A problem in the plane."""
    return files(folder, {**PLANE, "problem.toml": text})


def flat(folder: Path, names: tuple[str, ...]) -> Any:
    """A problem, some of whose parts are profiles."""
    said = f'{SHORT}[uncertainty.start]\nx = "0.1 mm"\nz = "0.1 mm"\nry = "0.1 deg"\n'
    return files(folder, {**{name: PLANE[name] for name in names}, "problem.toml": said if names else WHOLE})


def lain(keys: str) -> str:
    """A problem whose fixed part lies as it is said."""
    return f"{SHORT}{ROBOT}[uncertainty.sources.configuration]\n{keys}\n"


def balled(folder: Path, text: str) -> Any:
    """A problem of a peg with a ball at its end."""
    return files(folder, {"peg.toml": BALL_PEG, "problem.toml": text})


def answered(folder: Path, pair: str) -> Any:
    """A task whose pair is made by what a problem file asks for, or is answered in an assembly."""
    if pair == "planar":
        said = {"block.toml": TABLE + UNITS, "assembly.toml": f'title = "put on"\n{PUT_ON}'}
        return assembled(folder, said)
    return problem(folder, f'{WHOLE}[goal]\nattachment = "{pair.removeprefix("not ")}"\n')


def any_file(folder: Path, name: str) -> Any:
    """A file of its kind, loaded as a problem; or checked."""
    written(folder, {**PAIR, "problem.toml": WHOLE, "assembly.toml": f'title = "a peg"\n{TASK}'})
    if name.startswith("check "):
        done = CliRunner().invoke(app, ["check", str(folder / name.removeprefix("check "))])
        assert done.exit_code == 0
        return done
    return fmopt.load(folder / name)


def as_asked(folder: Path, ways: str) -> Any:
    """The two models without a problem file, or with one."""
    written(folder, {**PAIR, "problem.toml": WHOLE})
    if ways == "both parts":
        parts = [str(folder / name) for name in ("peg.toml", "block.toml")]
        done = CliRunner().invoke(app, ["init", *parts, "--error", "1 mm, 1 deg", "--out", str(folder / "asked.toml")])
        assert done.exit_code == 0
        return fmopt.load(folder / "asked.toml")
    return fmopt.load(folder / ways)


def box(*names: str) -> str:
    """A problem whose start error is stated for these components, and in angle."""
    lines = "".join(f'{name} = "0.1 mm"\n' for name in names)
    return f'{SHORT}[uncertainty.start]\nangle = "0.1 deg"\n{lines}'


def robot(angle: float) -> str:
    """A problem with a robot that turns its part by so many degrees, twice."""
    return ROBOT.replace('"0.1 mm" }', f'"0.1 mm", angle = "{angle} deg" }}')


def forces(end: float, push: float = 20.0) -> str:
    """A problem with forces in N that end a move and hold a contact."""
    return f'{WHOLE}[specification]\ntermination_force = "{end} N"\ncontact_force = "{push} N"\n'


def impact(*lines: str) -> str:
    """A problem that limits impacts."""
    return "\n".join([f"{WHOLE}[specification]", *lines])


def large(folder: Path, mm: float) -> Any:
    """A problem of parts of half a metre, with a robot that is so far off, twice."""
    tall = {name: text.replace('length = "mm"', 'length = "cm"') for name, text in PAIR.items()}
    return files(folder, {**tall, "problem.toml": SHORT + ROBOT.replace('"0.1 mm"', f'"{mm} mm"')})


LAIN = ('position = "0.1 mm"\nangle = "0.1 deg"', 'known = "0.1 mm"', POINTS.format(20, 20), PLACED)
TABLE = """part = "table"
[solids.table]
shape = "box"
size = [60, 60, 40]
[features.top]
kind = "solid"
at = [0, 0, 40]
turn = [180, 0, 0]
length = 40
"""
PUT_ON = TASK.replace('"prismatic"', '"planar"').replace("block.hole", "block.top")
CASES: tuple[Case, ...] = (
    edited(
        "a model",
        "name a problem file, which names two models under [moving] and [fixed]; or both parts, with --error",
        as_asked,
        "peg.toml",
        "problem.toml",
        "both parts",
    ),
    edited(
        "too deep",
        'lower it, or write "full"',
        problem,
        f'{MATED}{START}[goal]\ndepth = "31 mm"',
        f'{MATED}{START}[goal]\ndepth = "30 mm"',
        f'{MATED}{START}[goal]\ndepth = "full"',
    ),
    edited(
        "no error",
        EITHER,
        problem,
        SHORT,
        f"{SHORT}{BOX}",
        f'{SHORT}[uncertainty]\nstart = "1 mm, 1 deg"',
        f"{SHORT}{ROBOT}",
    ),
    edited("two errors", EITHER, problem, f"{SHORT}{BOX}{ROBOT}", f"{SHORT}{BOX}", f"{SHORT}{ROBOT}"),
    edited(
        "sources of a ball",
        "give [uncertainty.start]: errors of the ball's lowest point against the hole",
        balled,
        f"{SHORT}{ROBOT}",
        f"{SHORT}{BOX}",
    ),
    edited(
        "sources of a hole in the hand",
        "give [uncertainty.start]: errors of the peg's leading face against the hole",
        problem,
        f'moving = "block.toml"\nfixed = "peg.toml"\n{ROBOT}',
        f'moving = "block.toml"\nfixed = "peg.toml"\n{BOX}',
    ),
    edited(
        "one profile", "give both models a [profile], or none", flat, ("block.toml",), ("peg.toml", "block.toml"), ()
    ),
    edited(
        "out of the plane",
        "leave it out",
        flat_problem,
        f'{SHORT}[uncertainty.start]\nx = "0.1 mm"\ny = "0.1 mm"\nz = "0.1 mm"\nry = "0.1 deg"',
        f'{SHORT}[uncertainty.start]\nx = "0.1 mm"\nz = "0.1 mm"\nry = "0.1 deg"',
    ),
    edited(
        "no error along z",
        "add 'z' to [uncertainty.start], or 'position' for all three axes",
        problem,
        box("x", "y"),
        box("x", "y", "z"),
        box("position"),
    ),
    edited("stated twice", ONE_OF, problem, lain('position = "0.1 mm"\nknown = "0.1 mm"'), *map(lain, LAIN)),
    edited(
        "an angle alone",
        "add 'position', or drop it",
        problem,
        lain(f'angle = "0.1 deg"\n{PLACED}'),
        lain(f'position = "0.1 mm"\nangle = "0.1 deg"\n{PLACED}'),
        lain(PLACED),
    ),
    edited(
        "an angle beside what is known",
        "drop it",
        problem,
        lain('known = "0.1 mm"\nangle = "0.1 deg"'),
        lain('known = "0.1 mm"'),
    ),
    edited(
        "points on a line",
        "give three points at the corners of a wide triangle",
        problem,
        lain(POINTS.format(1, 0)),
        lain(POINTS.format(20, 20)),
    ),
    edited(
        "an error beyond the parts",
        'check [units], or write the unit beside the number, as in "0.4 mm"',
        problem,
        f'[units]\nlength = "cm"\nangle = "deg"\n{LONG}[uncertainty.start]\nposition = 12\nangle = 1',
        f'[units]\nlength = "mm"\nangle = "deg"\n{LONG}[uncertainty.start]\nposition = 12\nangle = 1',
        f'[units]\nlength = "cm"\nangle = "deg"\n{LONG}[uncertainty.start]\nposition = "0.4 mm"\nangle = 1',
    ),
    edited(
        "wild sources",
        "keep all together at most 28.6478897 deg",
        problem,
        SHORT + robot(15),
        SHORT + robot(14.32394485),
    ),
    edited(
        "an end beyond the push",
        "lower it to well below 20 N, or raise contact_force",
        problem,
        forces(30),
        forces(2),
        forces(30, 300),
    ),
    edited(
        "a push below the end",
        "lower it to well below 1 N, or raise contact_force",
        problem,
        impact('contact_force = "1 N"'),
        impact('contact_force = "1 N"', 'termination_force = "0.2 N"'),
        impact('contact_force = "20 N"'),
    ),
    edited(
        "half an impact",
        "add 'apparent_mass' to [specification], or drop 'impact_force' and 'contact_stiffness'",
        problem,
        impact('impact_force = "30 N"', 'contact_stiffness = "20 N/mm"'),
        impact('impact_force = "30 N"', 'contact_stiffness = "20 N/mm"', 'apparent_mass = "5 kg"'),
        impact(),
    ),
    edited("far off with large parts", "keep them at most 500 mm", large, 300, 249),
    edited(
        "no insertion",
        "the knowledge base answers such tasks; describe it in an assembly file",
        answered,
        "not planar",
        "planar",
    ),
    edited(
        "a pair misspelt",
        "write 'cylindrical', 'prismatic' or 'revolute'",
        answered,
        "prism",
        "cylindrical",
        "prismatic",
        "revolute",
    ),
    edited("no such file", "correct the path", any_file, "prolbem.toml", "problem.toml"),
    edited(
        "an assembly",
        "check it with fmopt check; a plan is of one task, which a problem file describes",
        any_file,
        "assembly.toml",
        "check assembly.toml",
        "problem.toml",
    ),
)
