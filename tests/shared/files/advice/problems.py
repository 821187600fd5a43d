"""Advice on problem files, followed: which features mate, the goal, the errors of the start and what limits forces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import fmopt
from fmopt.geometry.csg import Box
from fmopt.geometry.mating_features import DESCRIBE
from tests.shared.files.advice.case import UNITS, Case
from tests.shared.files.advice.edits import (
    BLOCK,
    LONG,
    PAIR,
    PEG,
    SHORT,
    START,
    assembled,
    edited,
    files,
    fitted,
    problem,
    written,
)
from tests.shared.files.advice.models import TWINS
from tests.shared.files.advice.texts import TASK
from tests.shared.files.asked import generated, write, write_assembly
from tests.shared.files.mesh_damage import subdivided
from tests.shared.files.mesh_files import plate, rounded, stl_text, triangles_of
from tests.shared.files.packed import packed_stl

WHOLE = f"{SHORT}{START}"
MATED = '[moving]\nmodel = "peg.toml"\nfeature = "peg"\n[fixed]\nmodel = "block.toml"\nfeature = "hole"\n'
EITHER = 'give either [uncertainty.start], or [uncertainty] start = "1 mm, 1 deg", or [uncertainty.sources]'
BOX = '[uncertainty.start]\nposition = "1 mm"\nangle = "1 deg"\n'
ROBOT = '[uncertainty.sources]\nrobot = { position = "0.1 mm" }\ngrasp = { height = "20 mm" }\n'
BALL_PEG = f"{PEG}[balls.tip]\nat = [0, 0, 0]\nradius = 8\n{UNITS}"
PLACED = 'placed = [{ robot = { position = "0.1 mm" } }]'
SIDEWAYS = PEG.replace("[features.peg]", "[features.pin]")
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


def twins(folder: Path, text: str) -> Any:
    """A problem of a peg and a block with two holes for it."""
    return files(folder, {"peg.toml": SMALL, "block.toml": f"{TWINS}{UNITS}", "problem.toml": text})


def answered(folder: Path, pair: str) -> Any:
    """A task whose pair is made by what a problem file asks for, or is answered in an assembly."""
    if pair == "planar":
        said = {"block.toml": TABLE + UNITS, "assembly.toml": f'title = "put on"\n{PUT_ON}'}
        return assembled(folder, said)
    return problem(folder, f'{WHOLE}[goal]\nattachment = "{pair.removeprefix("not ")}"\n')


def any_file(folder: Path, name: str) -> Any:
    """A file of its kind, loaded as a problem; or checked as an assembly."""
    written(folder, {**PAIR, "problem.toml": WHOLE, "assembly.toml": f'title = "a peg"\n{TASK}'})
    return fmopt.load(folder / name)


def as_asked(folder: Path, ways: str) -> Any:
    """The two models without a problem file, or with one."""
    written(folder, {**PAIR, "problem.toml": WHOLE})
    if ways == "both parts":
        return fmopt.problem(folder / "peg.toml", folder / "block.toml", "1 mm, 1 deg", folder=folder / "asked")
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


def declared(folder: Path, given: tuple[str, str, str]) -> Any:
    """A problem that declares a clearance on each side, its parts in some unit, its hole a wide one or not."""
    across, unit, name = given
    wide = f'{TWO}[features.wide]\nkind = "hollow"\nat = [60, 0, 40]\nlength = 30\n'
    parts = {"peg.toml": PEG + UNITS, "block.toml": wide + UNITS}
    parts = {file: text.replace('length = "mm"', f'length = "{unit}"') for file, text in parts.items()}
    text = f'moving = "peg.toml"\n{START}[fixed]\nmodel = "block.toml"\nfeature = "{name}"\n'
    return fitted(folder, {**parts, "problem.toml": text + (f'[clearance]\nx = "{across}"\n' if across else "")})


def meshes(folder: Path, noise: float) -> Any:
    """A rod and a plate as meshes, the plate's facets this far off its planes, mm."""
    rng = np.random.default_rng(1)
    points, corners = subdivided(*triangles_of(plate((0.01202, 0.00802))), rng)
    noisy = points + noise * rng.uniform(-1.0, 1.0, points.shape)
    rod = stl_text(*triangles_of(rounded((0.012, 0.008), 0.03)))
    both = {"rod.stl": rod, "plate.stl": packed_stl(noisy, corners)}
    said = {"problem.toml": 'moving = "rod.stl"\nfixed = "plate.stl"\n' + START}
    return fitted(folder, {**both, **said})


def both(folder: Path, depth: float | None) -> Any:
    """A STEP file of two bodies, the one so deep in the other; or each by itself."""
    pair = generated(seed=1)[0]
    write_assembly(folder / "both.step", pair, 7.0 if depth is None else depth)
    if depth is None:
        one, other = write(pair, folder, "step")
        return fmopt.problem(one, other, "0.02 mm, 0.02 deg", folder=folder / "asked")
    text = (
        f'moving = {{ model = "both.step", body = "peg" }}\nfixed = {{ model = "both.step", body = "plate" }}\n{START}'
    )
    return files(folder, {"problem.toml": text})


def far_off(folder: Path, x: float) -> Any:
    """A bar with a feature far from where it is, in mm."""
    far = PEG.replace("at = [0, 0, 0]", f"at = [{x}, 0, 0]")
    return files(folder, {"peg.toml": far + UNITS, "problem.toml": f"{MATED}{START}"})


def bare(folder: Path, given: tuple[float, str]) -> Any:
    """A rod as a mesh that a problem names itself, its numbers scaled, in a unit or not."""
    scale, unit = given
    points, corners = triangles_of(Box((0.02, 0.02, 0.05)))
    text = f'[moving]\nmodel = "rod.stl"\n{unit}\n[fixed]\nmodel = "block.toml"\n{START}'
    return files(folder, {"rod.stl": stl_text(scale * points, corners), "problem.toml": text})


def many(folder: Path, text: str) -> Any:
    """A problem of a peg and a block, each with many features at one place."""
    pegs = "".join(f'[features.p{n}]\nkind = "solid"\nat = [0, 0, 0]\nlength = 50\n' for n in range(17))
    holes = "".join(f'[features.h{n}]\nkind = "hollow"\nat = [0, 0, 40]\nlength = 30\n' for n in range(16))
    parts = {"peg.toml": BAR + pegs + UNITS, "block.toml": SOLID + holes + UNITS}
    return files(folder, {**parts, "problem.toml": text})


LAIN = ('position = "0.1 mm"\nangle = "0.1 deg"', 'known = "0.1 mm"', POINTS.format(20, 20), PLACED)
WIDE = '[solids.wide]\nshape = "box"\nsize = [24, 24, 40]\nat = [60, 0, 10]\n'
TWO = BLOCK.replace("60, 60, 40", "200, 60, 40").replace('["pocket"]', '["pocket", "wide"]') + WIDE
BAR, SOLID = PEG[: PEG.index("[features")], BLOCK[: BLOCK.index("[features")]
BARE = 'set unit = "m" under [moving] or [fixed], where the file is named, or --unit m, if that is meant'
CHECK = "check the units of the model files, [mesh] unit among them, and which features are to mate; "
SMALL = PEG.replace("20, 20, 50", "9.8, 9.8, 50") + UNITS
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
        "a feature misspelt",
        "did you mean 'hole'?",
        problem,
        MATED.replace('"hole"', '"hle"') + START,
        f"{MATED}{START}",
    ),
    edited("no such feature", "features: hole", problem, MATED.replace('"hole"', '"slot"') + START, f"{MATED}{START}"),
    edited(
        "two pegs",
        NAMED,
        files,
        {"problem.toml": MATED.replace("block", "peg").replace("hole", "peg") + START},
        {"problem.toml": f"{MATED}{START}"},
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
        "half an impact",
        "add 'apparent_mass' to [specification], or drop 'impact_force' and 'contact_stiffness'",
        problem,
        impact('impact_force = "30 N"', 'contact_stiffness = "20 N/mm"'),
        impact('impact_force = "30 N"', 'contact_stiffness = "20 N/mm"', 'apparent_mass = "5 kg"'),
        impact(),
    ),
    edited("far off with large parts", "keep them at most 500 mm", large, 300, 249),
    edited(
        "another clearance",
        f"{CHECK}or correct [clearance]",
        declared,
        ("0.1 mm", "mm", "wide"),
        ("0.1 mm", "mm", "hole"),
        ("2 mm", "mm", "wide"),
    ),
    edited(
        "another unit of the parts",
        f"{CHECK}or correct [clearance]",
        declared,
        ("0.1 mm", "cm", "wide"),
        ("2 mm", "mm", "wide"),
    ),
    edited("facets off their planes", "export the mesh with more digits, its plane faces plane", meshes, 0.01, 0.0),
    edited(
        "bodies apart",
        "export the assembly with the parts seated; or export each part on its own and name both files",
        both,
        -5.0,
        7.0,
        None,
        slow=True,
    ),
    edited("a feature elsewhere", "check where the feature is", far_off, 5000, 0),
    edited("metres for millimetres", BARE, bare, (1e-3, ""), (1e-3, 'unit = "m"')),
    edited(
        "two holes alike",
        'say which: feature = "hole_1" under [fixed]',
        twins,
        f"{LONG}{START}",
        f'{LONG}feature = "hole_1"\n{START}',
    ),
    edited(
        "two holes alike, in short",
        'say which: fixed = { model = "block.toml", feature = "hole_1" }',
        twins,
        WHOLE,
        f'moving = "peg.toml"\nfixed = {{ model = "block.toml", feature = "hole_1" }}\n{START}',
    ),
    edited(
        "many alike",
        'say which, such as feature = "p0" under [moving] and feature = "h0" under [fixed]',
        many,
        f"{LONG}{START}",
        LONG.replace("[fixed]", 'feature = "p0"\n[fixed]\nfeature = "h0"') + START,
    ),
    edited(
        "a peg for a hole",
        "check that the files are those of a peg and of a part with a hole for it; fmopt check FILE draws a part",
        problem,
        WHOLE.replace("block", "peg"),
        WHOLE,
    ),
    edited(
        "a found feature misspelt",
        f"did you mean 'hole_1'?; they were found, and for another one {DESCRIBE}",
        twins,
        f'{LONG}feature = "hole1"\n{START}',
        f'{LONG}feature = "hole_1"\n{START}',
    ),
    edited(
        "no such feature was found",
        f"features: hole_1, hole_2; they were found, and for another one {DESCRIBE}",
        twins,
        f'{LONG}feature = "slot"\n{START}',
        f'{LONG}feature = "hole_1"\n{START}',
        f'{LONG}feature = "hole_2"\n{START}',
    ),
    edited(
        "no insertion",
        "the knowledge base answers such tasks; describe it in an assembly file",
        answered,
        "not planar",
        "planar",
    ),
    edited(
        "an assembly",
        "check it with fmopt check; a plan is of one task, which a problem file describes",
        any_file,
        "assembly.toml",
        "problem.toml",
    ),
)
