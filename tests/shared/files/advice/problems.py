"""Advice on problem files, followed: the goal, the errors of the start, what limits forces, and other files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from typer.testing import CliRunner

import fmopt
from fmopt.cli import app
from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import LONG, PAIR, PEG, SHORT, START, assembled, edited, files, problem, written
from tests.shared.files.advice.texts import TASK
from tests.shared.files.model_text import UNITS, cuboid, feature, part

WHOLE = f"{SHORT}{START}"
MATED = '[moving]\nmodel = "peg.toml"\nfeature = "peg"\n[fixed]\nmodel = "block.toml"\nfeature = "hole"\n'
EITHER = 'give either [uncertainty.start], or [uncertainty] start = "1 mm, 1 deg", or [uncertainty.sources]'
BOX = '[uncertainty.start]\nposition = "1 mm"\nangle = "1 deg"\n'
ROBOT = '[uncertainty.sources]\nrobot = { position = "0.1 mm" }\ngrasp = { height = "20 mm" }\n'
BALL_PEG = f"{PEG}[balls.tip]\nat = [0, 0, 0]\nradius = 8\n{UNITS}"
DESCRIBE_IT = "the knowledge base answers such tasks; describe it in an assembly file"
PAIRS = "write 'cylindrical', 'prismatic' or 'revolute'"
APPARENT = "add 'apparent_mass' to [specification], or drop 'impact_force' and 'contact_stiffness'"
ADD_Z = "add 'z' to [uncertainty.start], or 'position' for all three axes"
WIDE = "give three points at the corners of a wide triangle"
POSITION, ANGLE, KNOWN = 'position = "0.1 mm"', 'angle = "0.1 deg"', 'known = "0.1 mm"'
NO_HAND = "give [uncertainty.start]: errors of the peg's leading face against the hole"
NO_BALL = "give [uncertainty.start]: errors of the ball's lowest point against the hole"
SWAPPED = 'moving = "block.toml"\nfixed = "peg.toml"\n'
NOTHING_AROUND = "leave [tool] solids and [obstacles] out"
WALL = '[obstacles.wall]\nshape = "box"\nsize = ["10 mm", "50 mm", "20 mm"]\nat = ["60 mm", 0, "40 mm"]\n'
TCP = '[tool]\ntcp = { at = [0, 0, "10 mm"] }\n'
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


def gripped(folder: Path, model: str) -> Any:
    """A problem whose gripper is of this model."""
    return files(folder, {"held.toml": model, "problem.toml": f'{WHOLE}[tool.solids]\ngripper = "held.toml"\n'})


def level(*names: str) -> str:
    """A problem whose start error is stated for these components, and about y."""
    return box(*names).replace("angle", "ry")


def flat(folder: Path, names: tuple[str, ...]) -> Any:
    """A problem, some of whose parts are profiles."""
    said = level("x", "z") if names else WHOLE
    return files(folder, {**{name: PLANE[name] for name in names}, "problem.toml": said})


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


def to(depth: str) -> str:
    """A problem with a depth to go to."""
    return f"{MATED}{START}[goal]\ndepth = {depth}"


def robot(angle: float) -> str:
    """A problem with a robot that turns its part by so many degrees, twice."""
    return SHORT + ROBOT.replace('"0.1 mm" }', f'"0.1 mm", angle = "{angle} deg" }}')


def forces(end: float, push: float = 20.0) -> str:
    """A problem with forces in N that end a move and hold a contact."""
    return f'{WHOLE}[specification]\ntermination_force = "{end} N"\ncontact_force = "{push} N"\n'


def lower(newtons: int) -> str:
    """The advice where a move would end by more than it may push with."""
    return f"lower it to well below {newtons} N, or raise contact_force"


def impact(*lines: str) -> str:
    """A problem that limits impacts."""
    return "\n".join([f"{WHOLE}[specification]", *lines])


def large(folder: Path, mm: float) -> Any:
    """A problem of parts of half a metre, with a robot that is so far off, twice."""
    tall = {name: text.replace('length = "mm"', 'length = "cm"') for name, text in PAIR.items()}
    return files(folder, {**tall, "problem.toml": SHORT + ROBOT.replace('"0.1 mm"', f'"{mm} mm"')})


def weak(newtons: int) -> str:
    """A problem with a robot of little force."""
    return f'{WHOLE}[robot]\nmax_force = "{newtons} N"\n'


PUSH, END = 'contact_force = "1 N"', 'termination_force = "0.2 N"'
IMPACT = ('impact_force = "30 N"', 'contact_stiffness = "20 N/mm"')
TURN = 28.6478897  # deg
LAIN = (f"{POSITION}\n{ANGLE}", KNOWN, POINTS.format(20, 20), PLACED)
TABLE = part("table", cuboid("table", "60, 60, 40"), feature("top", "solid", "0, 0, 40", "40", "180, 0, 0"))
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
    edited("too deep", 'lower it, or write "full"', problem, to('"31 mm"'), to('"30 mm"'), to('"full"')),
    edited("no error", EITHER, problem, SHORT, f"{SHORT}{BOX}", f"{SHORT}{START}", f"{SHORT}{ROBOT}"),
    edited("two errors", EITHER, problem, f"{SHORT}{BOX}{ROBOT}", f"{SHORT}{BOX}", f"{SHORT}{ROBOT}"),
    edited("sources of a ball", NO_BALL, balled, f"{SHORT}{ROBOT}", f"{SHORT}{BOX}"),
    edited("sources of a hole in the hand", NO_HAND, problem, f"{SWAPPED}{ROBOT}", f"{SWAPPED}{BOX}"),
    edited(
        "one profile", "give both models a [profile], or none", flat, ("block.toml",), ("peg.toml", "block.toml"), ()
    ),
    edited("out of the plane", "leave it out", flat_problem, level("x", "y", "z"), level("x", "z")),
    edited("no error along z", ADD_Z, problem, box("x", "y"), box("x", "y", "z"), box("position")),
    edited("stated twice", ONE_OF, problem, lain(f"{POSITION}\n{KNOWN}"), *map(lain, LAIN)),
    edited(
        "an angle alone",
        "add 'position', or drop it",
        problem,
        *map(lain, (f"{ANGLE}\n{PLACED}", f"{POSITION}\n{ANGLE}\n{PLACED}", PLACED)),
    ),
    edited("an angle beside what is known", "drop it", problem, lain(f"{KNOWN}\n{ANGLE}"), lain(KNOWN)),
    edited("points on a line", WIDE, problem, lain(POINTS.format(1, 0)), lain(POINTS.format(20, 20))),
    edited(
        "an error beyond the parts",
        'check [units], or write the unit beside the number, as in "0.4 mm"',
        problem,
        f'[units]\nlength = "cm"\nangle = "deg"\n{LONG}[uncertainty.start]\nposition = 12\nangle = 1',
        f'[units]\nlength = "mm"\nangle = "deg"\n{LONG}[uncertainty.start]\nposition = 12\nangle = 1',
        f'[units]\nlength = "cm"\nangle = "deg"\n{LONG}[uncertainty.start]\nposition = "0.4 mm"\nangle = 1',
    ),
    edited("wild sources", f"keep all together at most {TURN} deg", problem, robot(15), robot(0.5 * TURN)),
    edited("an end beyond the push", lower(20), problem, forces(30), forces(2), forces(30, 300)),
    edited(
        "a push below the end", lower(1), problem, impact(PUSH), impact(PUSH, END), impact('contact_force = "20 N"')
    ),
    edited(
        "a weak robot",
        "lower it to 5 N, or state max_force in [robot]",
        problem,
        weak(5),
        f'{weak(5)}[specification]\ncontact_force = "5 N"\n',
        weak(20),
    ),
    edited("half an impact", APPARENT, problem, impact(*IMPACT), impact(*IMPACT, 'apparent_mass = "5 kg"'), impact()),
    edited("far off with large parts", "keep them at most 500 mm", large, 300, 249),
    edited("no insertion", DESCRIBE_IT, answered, "not planar", "planar"),
    edited("a pair misspelt", PAIRS, answered, "prism", "cylindrical", "prismatic", "revolute"),
    edited("obstacles in a plane", NOTHING_AROUND, flat_problem, level("x", "z") + WALL, level("x", "z")),
    edited(
        "obstacles for a proof",
        f'write settings.evidence = "tested", or {NOTHING_AROUND}',
        problem,
        f'{WHOLE}{WALL}[settings]\nevidence = "certified"',
        f'{WHOLE}{WALL}[settings]\nevidence = "tested"',
        f'{WHOLE}[settings]\nevidence = "certified"',
    ),
    edited("a gripper with balls", "give [solids] or [mesh] alone", gripped, BALL_PEG, f"{PEG}{UNITS}"),
    edited("a TCP at what stays", "leave it out", problem, f"{SWAPPED}{START}{TCP}", f"{SWAPPED}{START}"),
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
