"""Advice on model files, followed: their solids, their mesh, their profile, and the features by which they mate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fmopt.geometry.csg import Box
from tests.shared.files.advice.case import UNITS, Case
from tests.shared.files.advice.edits import (
    BLOCK,
    PEG,
    START,
    edited,
    files,
    model,
    raw_model,
    written,
)
from tests.shared.files.mesh_files import glb, stl_text, triangles_of
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box

ROD = triangles_of(Box((0.012, 0.008, 0.03)))
WHOLE = BLOCK[: BLOCK.index("[features")]
OPEN = WHOLE.replace("at = [0, 0, 10]", "at = [0, 0, -1]").replace("20.2, 20.2, 40]", "20.2, 20.2, 42]")
BAR = PEG[: PEG.index("[features")]
INTO = "put the frame's origin into the mouth, z pointing out of it, and check the depth"
END = "put the frame's origin into the leading end, z pointing back into the part, and check the length"
CENTRAL = (
    "move the frame's origin there, or to the centre of the largest circle inside, which an even gap around leaves "
    "where it is; or turn an axis along the line; or leave `at` out, to have it found"
)
SHAPES = "give [solids] and part, or [mesh], or [profile]"
PROFILE = "[profile]\npolygons = [[[-10, 0], [10, 0], [10, 50], [-10, 50]]]\n"
TWO = "[profile]\npolygons = [[[-10, 0], [0, 0], [0, 50], [-10, 50]], [[0, 0], [10, 0], [10, 50], [0, 50]]]\n"
ON_IT = '[features.peg]\nkind = "solid"\nat = [0, 0, 0]\nlength = 50\n'
MESH = '[mesh]\nfile = "rod.stl"\nunit = "mm"\n'
BALL = "[balls.tip]\nat = [0, 0, 0]\nradius = 8\n"
IN_UM = '[units]\nlength = "um"\nangle = "deg"\n'
LARGE = PEG.replace("[20, 20, 50]", "[20e3, 20e3, 50e3]").replace("length = 50", "length = 50e3")
BLOB = f'{BLOCK}[solids.tip]\nshape = "sphere"\nradius = 8\n[solids.all]\nshape = "union"\nof = ["block", "tip"]\n'
TWINS = """part = "block"
[solids.block]
shape = "difference"
of = "whole"
minus = ["one", "other"]
[solids.whole]
shape = "box"
size = [60, 60, 40]
[solids.one]
shape = "box"
size = [10, 10, 40]
at = [-15, 0, 10]
[solids.other]
shape = "box"
size = [10, 10, 40]
at = [15, 0, 10]
"""


def hole(at: str, more: str = "length = 30", solids: str = WHOLE) -> str:
    """A block with the feature of its pocket stated."""
    return f'{solids}[features.hole]\nkind = "hollow"\n{at}\n{more}'


def peg(at: str, more: str = "") -> str:
    """A bar with the feature of its end stated."""
    return f'{BAR}[features.peg]\nkind = "solid"\nat = {at}\nlength = 50\n{more}'


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
    write_step(folder / "rod.step", box(20.0, 20.0, 50.0))
    written(folder, {"stepped.toml": f'[mesh]\nfile = "rod.step"\n{UNITS}'})
    table, _, rest = moving.partition("\n\n")
    said = {"rod.toml": f'[mesh]\nfile = "rod.stl"\n{rest}\n{UNITS}'} if rest else {}
    return files(folder, {"problem.toml": f'[moving]\n{table}\n[fixed]\nmodel = "block.toml"\n{START}', **said})


WIDE = f"[parameters]\nwidth = 19\n{PEG}".replace("[20, 20, 50]", '["width", "width", 50]')
WIDE = WIDE.replace('part = "peg"\n', "").replace("[parameters]", 'part = "peg"\n[parameters]')
OWN = '[solids.slit]\nshape = "box"\nsize = [5, 5, 40]\nat = [25, 0, 10]'
CUTS = """[solids.whole]
shape = "box"
size = [60, 60, 40]
[solids.one]
shape = "box"
size = [20, 20, 20]
at = [0, 0, 25]
[solids.lid]
shape = "box"
size = [60, 60, 5]
at = [0, 0, -5]
[solids.other]
shape = "box"
size = [20, 20, 20]
at = [0, 0, 10]
[features.hole]
kind = "hollow"
at = [0, 0, 40]
"""
ONE, BOTH, OTHER = "length = 15\nsolids = ['one']\n", "length = 30\nsolids = ['one', 'other']\n", "solids = ['other']\n"
MORE = f'{ONE}[features.more]\nkind = "hollow"\nat = [0, 0, 30]\nlength = 20\n{OTHER}'
IN_TURN = f"""part = "block"
[solids.block]
shape = "difference"
of = "filled"
minus = ["other"]
[solids.filled]
shape = "union"
of = ["cut", "lid"]
[solids.cut]
shape = "difference"
of = "whole"
minus = ["one"]
{CUTS}"""
AT_ONCE = f"""part = "block"
[solids.block]
shape = "difference"
of = "filled"
minus = ["one", "other"]
[solids.filled]
shape = "union"
of = ["whole", "lid"]
{CUTS}"""


def doubled(times: int) -> str:
    """A peg of two of what is of two, and so on."""
    said = PEG.replace('part = "peg"', 'part = "twice_1"')
    for n in range(1, times + 1):
        inner = "peg" if n == times else f"twice_{n + 1}"
        said += f'[solids.twice_{n}]\nshape = "union"\nof = ["{inner}", "{inner}"]\n'
    return said


def of_solids(name: str) -> str:
    """A block with a feature that is made of a named solid."""
    return hole("at = [0, 0, 40]", f'length = 30\nsolids = ["{name}"]')


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
        f'{BLOCK}[solids.more]\nshape = "box"\nsize = [9, 9, 9]\nat = [20, 20, 35]\n',
        f'{BLOCK}[solids.more]\nshape = "box"\nsize = [9, 9, 9]\nat = [20, 20, 35]\n'.replace(
            'cket"]', 'cket", "more"]'
        ),
        BLOCK,
    ),
    edited(
        "too many instances",
        "use at most 1000",
        model,
        doubled(10),
        doubled(5),
    ),
    edited("no shape at all", SHAPES, model, ON_IT, PEG, f"{PROFILE}{ON_IT}"),
    edited("two shapes", SHAPES, model, f"{PEG}{PROFILE}", PEG, f"{PROFILE}{ON_IT}"),
    edited("a part of a profile", "remove 'part'", model, f'part = "peg"\n{PROFILE}{ON_IT}', f"{PROFILE}{ON_IT}"),
    edited(
        "an endless part", "check its numbers", raw_model, f"{LARGE}{IN_UM}".replace("50e3", "50e6"), f"{LARGE}{IN_UM}"
    ),
    edited(
        "another unit of solids",
        'set length = "mm" if that is meant',
        raw_model,
        f'{PEG}[units]\nlength = "m"\nangle = "deg"',
        f'{PEG}[units]\nlength = "mm"\nangle = "deg"',
    ),
    edited("balls alone", "give [solids] and part beside them", model, f"{PROFILE}{ON_IT}{BALL}", f"{PEG}{BALL}"),
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
    edited(
        "a profile without features",
        "add [features.NAME] with kind, at and length: where the part mates",
        model,
        PROFILE,
        f"{PROFILE}{ON_IT}",
    ),
    edited(
        "no length",
        "add 'length' to the feature",
        model,
        f"{PROFILE}{ON_IT}".replace("length = 50\n", ""),
        f"{PROFILE}{ON_IT}",
    ),
    edited(
        "no place",
        "add 'at' to the feature",
        model,
        f"{PROFILE}{ON_IT}".replace("at = [0, 0, 0]\n", ""),
        f"{PROFILE}{ON_IT}",
    ),
    edited(
        "two kinds",
        "keep one kind",
        model,
        f"{PROFILE}{ON_IT}{ON_IT.replace('peg', 'hole').replace('solid', 'hollow')}",
        f"{PROFILE}{ON_IT}",
    ),
    edited(
        "two polygons", "what moves in a plane is to be one convex polygon", model, f"{TWO}{ON_IT}", f"{PROFILE}{ON_IT}"
    ),
    edited(
        "out of the plane",
        "write at = [x, 0, z] without turn, z out of the mouth",
        model,
        f"{PROFILE}{ON_IT}".replace("at = [0, 0, 0]", "at = [0, 1, 0]"),
        f"{PROFILE}{ON_IT}",
    ),
)
ABOUT_FEATURES = (
    edited("a hole from half-way", INTO, model, hole("at = [0, 0, 25]"), hole("at = [0, 0, 40]")),
    edited("a hole too deep", INTO, model, hole("at = [0, 0, 40]", "length = 31"), hole("at = [0, 0, 40]")),
    edited("a peg from its middle", END, model, peg("[0, 0, 10]"), peg("[0, 0, 0]")),
    edited(
        "no mouth",
        "turn z out of the mouth, or open the feature",
        model,
        hole("at = [0, 0, 10]\nturn = [180, 0, 0]"),
        hole("at = [0, 0, 40]"),
        hole("at = [0, 0, 0]\nturn = [180, 0, 0]", "length = 40\nthrough = true", OPEN),
    ),
    edited("beside the line", CENTRAL, model, hole("at = [1, 0, 40]"), hole("at = [0, 0, 40]"), hole("", "")),
    edited(
        "in the material",
        "check the feature's frame, or model its shape as a solid of its own",
        model,
        hole("at = [25, 0, 40]"),
        hole("at = [0, 0, 40]"),
        hole("at = [25, 0, 40]", f"length = 30\n{OWN}", WHOLE.replace('["pocket"]', '["pocket", "slit"]')),
    ),
    edited("a peg through", "remove 'through'", model, peg("[0, 0, 0]", "through = true"), peg("[0, 0, 0]")),
    edited("made of nothing", "solids: block, whole, pocket", model, of_solids("slit"), of_solids("pocket")),
    edited("made of a name misspelt", "did you mean 'pocket'?", model, of_solids("pockt"), of_solids("pocket")),
    edited("solids of a mesh", "leave 'solids' out", model, f'{PROFILE}{ON_IT}solids = ["peg"]', f"{PROFILE}{ON_IT}"),
    edited("made of the other sign", "such terms: pocket", model, of_solids("whole"), of_solids("pocket")),
    edited(
        "not one after the other",
        "name them one after the other in the model, or make two features",
        model,
        f"{IN_TURN}{BOTH}",
        f"{AT_ONCE}{BOTH}",
        f"{IN_TURN}{MORE}",
    ),
    edited(
        "another kind",
        "check its kind, or add at, turn and length",
        model,
        f'{BAR}[features.peg]\nkind = "hollow"',
        f'{BAR}[features.peg]\nkind = "solid"',
    ),
    edited(
        "in no mouth",
        "correct it, drop it, or add length",
        model,
        f'{BAR}[features.peg]\nkind = "solid"\nat = [0, 0, 10]\n',
        f'{BAR}[features.peg]\nkind = "solid"\nat = [0, 0, 0]\n',
        f'{BAR}[features.peg]\nkind = "solid"\n',
    ),
    edited(
        "one of two",
        "say which by its 'at', or call it by its name here",
        model,
        f'{TWINS}[features.hole]\nkind = "hollow"',
        f'{TWINS}[features.hole]\nkind = "hollow"\nat = [15, 0, 40]',
        f'{TWINS}[features.hole_2]\nkind = "hollow"',
    ),
)
ABOUT_MESHES = (
    edited(
        "no unit",
        "add 'unit' to [mesh]: m, cm, mm, um or in",
        in_unit,
        ("", 1.0),
        *((unit, scale) for unit, scale in (("m", 1e-3), ("cm", 0.1), ("mm", 1.0), ("um", 1e3), ("in", 1.0 / 25.4))),
    ),
    edited(
        "no unit of a broken file",
        "add 'unit' to [mesh]: m, cm, mm, um or in; and mend the file",
        broken,
        ("", False),
        ('unit = "mm"', True),
    ),
    edited("another unit", 'set unit = "mm" if that is meant', of_stl, 'unit = "m"', 'unit = "mm"'),
    edited(
        "another size", "its file says its unit itself: export it again, in the size that is meant", of_glb, 1e3, 1.0
    ),
    edited("a body of a mesh", "remove 'body'", of_stl, 'unit = "mm"\nbody = 1', 'unit = "mm"'),
    edited("a unit of a STEP file", "remove 'unit'", of_step, 'unit = "mm"', ""),
    edited("no deviation", "give a deviation such as 0.01 mm", of_step, "deviation = 0", 'deviation = "0.01 mm"'),
    edited("a unit of a model", "leave 'unit' out", asked, 'model = "peg.toml"\nunit = "mm"', 'model = "peg.toml"'),
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
    ),
    edited(
        "a unit of a STEP file itself",
        "leave 'unit' out",
        asked,
        'model = "rod.step"\nunit = "mm"',
        'model = "rod.step"',
    ),
    edited(
        "a body of an STL file itself",
        "leave 'body' out",
        asked,
        'model = "rod.stl"\nunit = "mm"\nbody = 1',
        'model = "rod.stl"\nunit = "mm"',
    ),
    edited(
        "parameters of a mesh",
        "name a model file, or leave it out",
        asked,
        'model = "rod.stl"\nparameters.width = "19 mm"',
        'model = "wide.toml"\nparameters.width = "19 mm"',
        'model = "rod.stl"',
    ),
    edited(
        "another kind of parameter",
        "give it the unit of the model's parameter",
        asked,
        'model = "wide.toml"\nparameters.width = "19 deg"',
        'model = "wide.toml"\nparameters.width = "19 mm"',
    ),
    edited(
        "a parameter misspelt",
        "did you mean 'width'?",
        asked,
        'model = "wide.toml"\nparameters.widht = "19 mm"',
        'model = "wide.toml"\nparameters.width = "19 mm"',
    ),
    edited(
        "no such parameter",
        "its parameters: width",
        asked,
        'model = "wide.toml"\nparameters.x = "19 mm"',
        'model = "wide.toml"\nparameters.width = "19 mm"',
    ),
    edited(
        "no parameters",
        "its parameters: none",
        asked,
        'model = "peg.toml"\nparameters.x = "19 mm"',
        'model = "peg.toml"',
    ),
    edited(
        "a problem for a model",
        "name a model file, which describes one part by [solids], [mesh] or [profile] and its [features]",
        asked,
        'model = "problem.toml"',
        'model = "peg.toml"',
    ),
)
CASES: tuple[Case, ...] = (*ABOUT_SOLIDS, *ABOUT_PROFILES, *ABOUT_FEATURES, *ABOUT_MESHES)
