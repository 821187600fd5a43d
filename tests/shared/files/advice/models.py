"""Advice on model files, followed: their solids, their profile, their mesh, and their parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fmopt.geometry.csg import Box
from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import BLOCK, PEG, START, edited, files, model, raw_model, written
from tests.shared.files.mesh_files import glb, stl_text, triangles_of
from tests.shared.files.model_text import UNITS, cuboid, difference, part
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box

ROD = triangles_of(Box((0.012, 0.008, 0.03)))
WHOLE = BLOCK[: BLOCK.index("[features")]
BAR = PEG[: PEG.index("[features")]
ADD_FEATURES = "add [features.NAME] with kind, at and length: where the part mates"
IN_PLANE = "write at = [x, 0, z] without turn, z out of the mouth"
OTHER_UNIT = "give it the unit of the model's parameter"
PLAIN = 'write it as text, such as "2"'
IN_MM = 'set length = "mm" if that is meant'
ADD_UNIT = "add 'unit' to [mesh]: m, cm, mm, um or in"
EXPORT_AGAIN = "its file says its unit itself: export it again, in the size that is meant"
SHAPES = "give [solids] and part, or [mesh], or [profile]"
PROFILE = "[profile]\npolygons = [[[-10, 0], [10, 0], [10, 50], [-10, 50]]]\n"
TWO = "[profile]\npolygons = [[[-10, 0], [0, 0], [0, 50], [-10, 50]], [[0, 0], [10, 0], [10, 50], [0, 50]]]\n"
ON_IT = '[features.peg]\nkind = "solid"\nat = [0, 0, 0]\nlength = 50\n'
OUTLINED = f"{PROFILE}{ON_IT}"
IN_IT = ON_IT.replace("peg", "hole").replace("solid", "hollow")
BALL = "[balls.tip]\nat = [0, 0, 0]\nradius = 8\n"
IN_UM = '[units]\nlength = "um"\nangle = "deg"\n'
LARGE = PEG.replace("[20, 20, 50]", "[20e3, 20e3, 50e3]").replace("length = 50", "length = 50e3") + IN_UM
MORE = f'{BLOCK}[solids.more]\nshape = "box"\nsize = [9, 9, 9]\nat = [20, 20, 35]\n'
BLOB = f'{BLOCK}[solids.tip]\nshape = "sphere"\nradius = 8\n[solids.all]\nshape = "union"\nof = ["block", "tip"]\n'
TWINS = part(
    "block",
    difference("block", "whole", "one", "other"),
    cuboid("whole", "60, 60, 40"),
    cuboid("one", "10, 10, 40", "-15, 0, 10"),
    cuboid("other", "10, 10, 40", "15, 0, 10"),
)


def mesh(folder: Path, lines: str, file: str = "rod.stl", scale: float = 1.0) -> Any:
    """A model of a file of a rod, its numbers scaled."""
    path = folder / file
    if path.suffix == ".stl":
        path.write_text(stl_text(scale * ROD[0], ROD[1]))
    elif path.suffix == ".glb":
        path.write_bytes(glb(1e-3 * scale * ROD[0], ROD[1], {}))
    elif path.suffix == ".step":
        write_step(path, box(12.0, 8.0, 30.0))
    return model(folder, f'[mesh]\nfile = "{path.name}"\n{lines}')


def of_stl(folder: Path, lines: str) -> Any:
    return mesh(folder, lines)


def of_step(folder: Path, lines: str) -> Any:
    return mesh(folder, lines, "rod.step")


def of_glb(folder: Path, scale: float) -> Any:
    return mesh(folder, "", "rod.glb", scale)


def in_unit(folder: Path, given: tuple[str, float]) -> Any:
    """The rod, its numbers in a unit that is stated, or not."""
    unit, scale = given
    return mesh(folder, f'unit = "{unit}"' if unit else "", scale=scale)


def broken(folder: Path, given: tuple[str, bool]) -> Any:
    """The rod, whose file is damaged or mended."""
    lines, whole = given
    (folder / "rod.stl").write_text(stl_text(*ROD) if whole else "solid")
    return model(folder, f'[mesh]\nfile = "rod.stl"\n{lines}')


def asked(folder: Path, moving: str) -> Any:
    """A problem with a table for its moving part, among files of rods that fit the pocket of the block."""
    text = stl_text(*triangles_of(Box((0.02, 0.02, 0.05))))
    written(folder, {"rod.stl": text, "rod.toml": f'[mesh]\nfile = "rod.stl"\n{UNITS}', "wide.toml": WIDE + UNITS})
    if "step" in moving:
        write_step(folder / "rod.step", box(20.0, 20.0, 50.0))
        written(folder, {"stepped.toml": f'[mesh]\nfile = "rod.step"\n{UNITS}'})
    table, _, rest = moving.partition("\n\n")
    said = {"rod.toml": f'[mesh]\nfile = "rod.stl"\n{rest}\n{UNITS}'} if rest else {}
    return files(folder, {"problem.toml": f'[moving]\n{table}\n[fixed]\nmodel = "block.toml"\n{START}', **said})


WIDE = f'[parameters]\nwidth = 19\ncount = "3"\n{PEG}'.replace("[20, 20, 50]", '["width", "width", 50]')
WIDE = WIDE.replace('part = "peg"\n', "").replace("[parameters]", 'part = "peg"\n[parameters]')


def doubled(times: int) -> str:
    """A peg of two of what is of two, and so on."""
    said = PEG.replace('part = "peg"', 'part = "twice_1"')
    for n in range(1, times + 1):
        inner = "peg" if n == times else f"twice_{n + 1}"
        said += f'[solids.twice_{n}]\nshape = "union"\nof = ["{inner}", "{inner}"]\n'
    return said


def wide(parameter: str) -> str:
    """The table of a moving part whose model has parameters, one of them given."""
    return f'model = "wide.toml"\nparameters.{parameter}'


BARE_PEG, BARE_STEP = 'model = "peg.toml"', 'model = "rod.step"'
FITTING = wide('width = "19 mm"')
ABOUT_SOLIDS = (
    edited("no part", "name the solid that the part is", model, PEG.replace('part = "peg"\n', ""), PEG),
    edited("a solid misspelt", "did you mean 'peg'?", model, PEG.replace('part = "peg"', 'part = "pegg"'), PEG),
    edited("no such solid", "solids: peg", model, PEG.replace('part = "peg"', 'part = "rod"'), PEG),
    edited(
        "a circle",
        "break the circle of names",
        model,
        f'{BLOCK}[solids.more]\nshape = "union"\nof = ["block"]\n'.replace('"whole"', '"more"'),
        BLOCK,
    ),
    edited(
        "a solid too many",
        "name it in a union or difference, or remove it",
        model,
        MORE,
        MORE.replace('cket"]', 'cket", "more"]'),
        BLOCK,
    ),
    edited("too many instances", "use at most 1000", model, doubled(10), doubled(5)),
    edited("no shape at all", SHAPES, model, ON_IT, PEG, OUTLINED),
    edited("two shapes", SHAPES, model, f"{PEG}{PROFILE}", PEG, OUTLINED),
    edited("a part of a profile", "remove 'part'", model, f'part = "peg"\n{PROFILE}{ON_IT}', OUTLINED),
    edited("an endless part", "check its numbers", raw_model, LARGE.replace("50e3", "50e6"), LARGE),
    edited("another unit of solids", IN_MM, raw_model, f"{PEG}{UNITS.replace('mm', 'm')}", f"{PEG}{UNITS}"),
    edited("balls alone", "give [solids] and part as the only shape", model, f"{PROFILE}{ON_IT}{BALL}", f"{PEG}{BALL}"),
    edited(
        "a ball in a wall",
        'give them to the part that goes in, or a solid of shape = "sphere" to this one',
        model,
        f"{BLOCK}{BALL}",
        f"{PEG}{BALL}",
        BLOB.replace('part = "block"', 'part = "all"'),
    ),
)
ABOUT_PROFILES = (
    edited("a profile without features", ADD_FEATURES, model, PROFILE, OUTLINED),
    edited("no length", "add 'length' to the feature", model, OUTLINED.replace("length = 50\n", ""), OUTLINED),
    edited("no place", "add 'at' to the feature", model, OUTLINED.replace("at = [0, 0, 0]\n", ""), OUTLINED),
    edited("two kinds", "keep one kind", model, f"{OUTLINED}{IN_IT}", OUTLINED),
    edited("two polygons", "what moves in a plane is to be one convex polygon", model, f"{TWO}{ON_IT}", OUTLINED),
    edited("out of the plane", IN_PLANE, model, OUTLINED.replace("at = [0, 0, 0]", "at = [0, 1, 0]"), OUTLINED),
)
ABOUT_MESHES = (
    edited(
        "no unit", ADD_UNIT, in_unit, ("", 1.0), ("m", 1e-3), ("cm", 0.1), ("mm", 1.0), ("um", 1e3), ("in", 1.0 / 25.4)
    ),
    edited("no unit of a broken file", f"{ADD_UNIT}; and mend the file", broken, ("", False), ('unit = "mm"', True)),
    edited("another unit", 'set unit = "mm" if that is meant', of_stl, 'unit = "m"', 'unit = "mm"'),
    edited("another size", EXPORT_AGAIN, of_glb, 1e3, 1.0),
    edited("a unit of a STEP file", "remove 'unit'", of_step, 'unit = "mm"', ""),
    edited(
        "no deviation", "give a deviation such as 0.01 mm", of_step, "deviation = 0", 'deviation = "0.01 mm"', slow=True
    ),
    edited("a unit of a model", "leave 'unit' out", asked, f'{BARE_PEG}\nunit = "mm"', BARE_PEG),
    edited(
        "a unit above the model",
        "leave 'unit' out, or put it under [mesh] of the model file",
        asked,
        'model = "rod.toml"\nunit = "mm"\n\nunit = "mm"',
        'model = "rod.toml"\n\nunit = "mm"',
    ),
    edited(
        "a body above the model",
        "leave 'body' out, or put it under [mesh] of the model file",
        asked,
        'model = "stepped.toml"\nbody = 1',
        'model = "stepped.toml"',
        slow=True,
    ),
    edited(
        "a unit of a STEP file itself", "leave 'unit' out", asked, f'{BARE_STEP}\nunit = "mm"', BARE_STEP, slow=True
    ),
    edited(
        "parameters of a mesh",
        "name a model file, or leave it out",
        asked,
        'model = "rod.stl"\nparameters.width = "19 mm"',
        FITTING,
        'model = "rod.stl"',
    ),
    edited("another kind of parameter", OTHER_UNIT, asked, wide('width = "19 deg"'), FITTING),
    edited("a parameter misspelt", "did you mean 'width'?", asked, wide('widht = "19 mm"'), FITTING),
    edited("a length for a plain number", PLAIN, asked, wide('count = "2 mm"'), wide('count = "2"')),
    edited("no such parameter", "its parameters: width, count", asked, wide('xyz = "19 mm"'), FITTING),
    edited("no parameters", "its parameters: none", asked, f'{BARE_PEG}\nparameters.xyz = "19 mm"', BARE_PEG),
    edited(
        "a problem for a model",
        "name a model file, which describes one part by [solids], [mesh] or [profile] and its [features]",
        asked,
        'model = "problem.toml"',
        'model = "peg.toml"',
    ),
)
CASES: tuple[Case, ...] = (*ABOUT_SOLIDS, *ABOUT_PROFILES, *ABOUT_MESHES)
