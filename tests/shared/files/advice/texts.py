"""Advice on the text of TOML files, followed: files that are none, keys and tables, and numbers with their units."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from unittest import mock

import fmopt
from fmopt.geometry.csg import Box
from fmopt.task.toml import source
from tests import ROOT
from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import (
    LONG,
    PEG,
    SHORT,
    START,
    assembly,
    edited,
    files,
    model,
    problem,
    raw_model,
    written,
)
from tests.shared.files.mesh_files import stl_text, triangles_of
from tests.shared.files.model_text import UNITS

ROD = triangles_of(Box((0.02, 0.02, 0.05)))
WHOLE = f"{SHORT}{START}"
HEIGHT = f"{WHOLE}[start]\nheight = "
LEVER = f"{WHOLE}[settings]\ncharacteristic_length = "
ALONE, FIXED = f'moving = "peg.toml"\n{START}', '[fixed]\nmodel = "block.toml"\n'
BODY, SIZE = 'part = "peg"\n[solids.peg]\n', "size = [20, 20, 50]"
CUBOID = f'shape = "box"\n{SIZE}'
SQUARE = "polygon = [[0, 0], [20, 0], [20, 20], [0, 20]]"
HULL = f'{BODY}shape = "hull"\npoints = '
CORNERS = "[[0, 0, 0], [20, 0, 0], [20, 20, 0], [0, 20, 0], [0, 0, 50], [20, 0, 50], [20, 20, 50], [0, 20, 50]]"
LINK = '[objects.rest]\nmodel = "peg.toml"\nat = [0, 0, 500]\n[links.seat]\nkind = "attached"\nother = "block"\n'
TASK = f"""{UNITS}[objects.peg]
model = "peg.toml"
at = [0, 0, 100]
[objects.block]
model = "block.toml"
[tasks.first]
moving = "peg.peg"
fixed = "block.hole"
attachment = "prismatic"
goal = ["free", "free", "free", "free", "free", "free"]
specification = {{ speed = "20 mm/s", contact_force = 20, torque_limit = 1 }}
"""
NO_UNIT = 'write text with its unit, such as "2 mm", or add length = "mm" under [units]'
TURN, BACK, UNIT = "keep it at most ", "keep it at least ", ", and check the unit"
DEFINE = "define it under [parameters], above its first use"
START_ERROR = 'write a distance and an angle with their units, such as "1 mm, 1 deg": how far off the part may start'
SHAPES = "write one of 'box', 'cylinder', 'cone', 'sphere', 'prism', 'stack', 'wedge', 'hull', 'union', 'difference'"
NAME_PROBLEM = "name a problem file, which names two models under [moving] and [fixed]; or both parts, with --error"
TITLE = "use 1 to 200 characters in one line, none of them hidden"
SYNTAX = "see https://toml.io for the syntax; numbers take a decimal point, words quotation marks"
QUANTITY = 'write a number, or text such as "2 mm"'
LONE = 'write a number, or one with its unit: "2 mm", "0.3 deg"'
GRAMMAR = "write numbers with units, names of parameters, + - * / and parentheses"
NO_PLAN = "name a problem or model file; a plan goes to fmopt verify"
A_UNIT = "write a unit such as mm, um, deg or N"
WIDTH, W, TWICE = "width = 50\n", "w = 25\n", 'h = "2 * w"\n'
NAMED_TASK = f'title = "a peg"\n{TASK}'
OPERAND = 'write "object.feature"'
DEEP = "x = " + 25 * "[" + 25 * "]"


def box(size: str, more: str = "") -> str:
    """A model of a box."""
    return f'{more}part = "peg"\n[solids.peg]\nshape = "box"\nsize = [{size}]\n'


def sized(z: str, parameters: str = "w = 50\n") -> str:
    """A model of a box with parameters, its height as text."""
    return f"{box(f'20, 20, {z}')}[parameters]\n{parameters}"


def stacked(height: str) -> str:
    """A model of a stack, the height of its upper section as told."""
    return f'{BODY}shape = "stack"\nsections = [{{ at = 0, {SQUARE} }}, {{ {height}{SQUARE} }}]'


def rod(sides: int, more: str = "") -> str:
    """A cylinder of so many sides."""
    return f'part = "rod"\n[solids.rod]\nshape = "cylinder"\nradius = 10\nheight = 30\nsides = {sides}\n{more}{PIN}'


def sagged(most: str) -> str:
    """A cylinder of as many sides as its sagitta asks for."""
    return rod(20).replace("sides = 20", f"sagitta = {most}")


def ball(sides: int) -> str:
    """A ball of so many meridians."""
    return f'part = "ball"\n[solids.ball]\nshape = "sphere"\nradius = 10\nsides = {sides}\n{KNOB}'


PIN = '[features.pin]\nkind = "solid"\nat = [0, 0, 0]\nlength = 30'
KNOB = '[features.knob]\nkind = "solid"\nat = [0, 0, -10]\nlength = 20'


def error(position: str, angle: str = "1 deg") -> str:
    """A problem with a start error."""
    return f'{SHORT}[uncertainty.start]\nposition = "{position}"\nangle = "{angle}"'


def turned(angle: str) -> str:
    """A problem whose goal is turned."""
    return f'{WHOLE}[goal]\nturn = "{angle}"'


def speed(value: str) -> str:
    """A problem with a greatest speed."""
    return f'{WHOLE}[specification]\nspeed = "{value}"'


def deep(count: int) -> str:
    """An expression in parentheses."""
    return f'"{"(" * count}w{")" * count}"'


def named(folder: Path, name: str) -> object:
    """A problem whose moving part is of this name, among files and folders."""
    written(folder, {"inner/peg.toml": f"{PEG}{UNITS}", "peg.urdf": "<robot/>", "peg.stl": stl_text(*ROD)})
    return files(folder, {"problem.toml": f'moving = "{name}"\nfixed = "block.toml"\n{START}'})


def loaded(folder: Path, changed: Mapping[str, str | bytes]) -> object:
    """The first of these files as a problem, beside the peg and the block."""
    files(folder, changed)
    return fmopt.load(folder / next(iter(changed)))


def unreadable(folder: Path, closed: bool) -> object:
    """A problem that its owner may not read, or may."""
    written(folder, {"problem.toml": WHOLE})
    refused = mock.patch.object(Path, "read_bytes", side_effect=PermissionError(13, "Permission denied"))
    with refused if closed else mock.MagicMock():
        return problem(folder, WHOLE)


def come_in(folder: Path, content: bytes | None) -> object:
    """A model from standard input; None for one that cannot be read."""
    stream = mock.Mock(buffer=io.BytesIO(content or b""))
    if content is None:
        stream.buffer = mock.Mock(read=mock.Mock(side_effect=OSError(21, "Is a directory")))
    with mock.patch.object(sys, "stdin", stream):
        return source.read(source.STDIO)


def three(folder: Path, text: str) -> object:
    """A model, whose schema says how many entries the size of a box has."""
    schema = json.loads((ROOT / "models" / "model.schema.json").read_text(encoding="utf-8"))
    assert schema["$defs"]["Box"]["properties"]["size"]["minItems"] == 3
    return model(folder, text)


def spelled(folder: Path, text: str) -> object:
    """A problem with a start error as text."""
    return problem(folder, f'{SHORT}[uncertainty]\nstart = "{text}"')


ABOUT_FILES = (
    edited("no file", "correct the path; it is relative to the file that names it", named, "inner.toml", "peg.toml"),
    edited("a folder", "name a file", named, "inner", "inner/peg.toml"),
    edited("a file for a folder", "correct the path", named, "peg.toml/peg.toml", "inner/peg.toml"),
    edited("no name", "correct the path", named, r"peg\u0000.toml", "peg.toml"),
    edited("much too large", "name a smaller file", problem, WHOLE + "#" * 1_000_000, WHOLE),
    edited("much coming in", "name a smaller file", come_in, b"#" * 1_000_001, WHOLE.encode()),
    edited("nothing coming in", "give something to read, or a file", come_in, None, WHOLE.encode()),
    edited("a file of others", "check its permissions", unreadable, True, False),
    edited("a deep file", "flatten the file", problem, f"{DEEP}\n{WHOLE}", WHOLE),
    edited("a deeper file", "flatten the file", problem, f"x = {'[' * 9999}{']' * 9999}\n{WHOLE}", WHOLE),
    edited("a mark", "save it as UTF-8 without one", raw_model, b"\xef\xbb\xbf" + PEG.encode(), f"{PEG}{UNITS}"),
    edited("Latin", "save it as UTF-8", raw_model, f"# für\n{PEG}{UNITS}".encode("latin-1"), f"# für\n{PEG}{UNITS}"),
    edited("no decimal point", SYNTAX, model, box("20, 20, 50."), box("20, 20, 50.0")),
    edited("no quotation marks", SYNTAX, problem, WHOLE.replace('"peg.toml"', "peg.toml"), WHOLE),
    edited("a long number", "shorten the number", problem, f"{HEIGHT}{'1' * 5000}", f'{HEIGHT}"1 mm"'),
    edited("a mesh for a problem", NAME_PROBLEM, loaded, {"peg.stl": "solid"}, {"problem.toml": WHOLE}),
    edited("a robot", "export the part as STEP or STL, and name that file", named, "peg.urdf", "peg.stl"),
    edited("a plan", NO_PLAN, loaded, {"plan.json": "{}"}, {"problem.toml": WHOLE}),
    edited(
        "an empty file",
        "copy a shipped problem or model and change it",
        raw_model,
        "",
        (ROOT / "models" / "square_peg.toml").read_text(encoding="utf-8"),
    ),
)
ABOUT_KEYS = (
    edited("a key misspelt", "did you mean 'turn'?", model, f"{PEG}trn = [0, 0, 0]", f"{PEG}turn = [0, 0, 0]"),
    edited(
        "no such key",
        "known keys here: at, turn, shape, size, chamfer",
        model,
        *(f"{box('20, 20, 50')}{key}" for key in ("width = 20", "at = [0, 0, 0]", "turn = [0, 0, 0]", "chamfer = 1")),
    ),
    edited("no size", "add 'size' to [solids.peg]", model, f'{BODY}shape = "box"', f"{BODY}{CUBOID}"),
    edited("no height of a section", "add 'at' to solids.peg.sections[1]", model, stacked(""), stacked("at = 50, ")),
    edited("one part", "add 'fixed' above the first table, or as a table", problem, ALONE, WHOLE, f"{ALONE}{FIXED}"),
    edited("no title", "add 'title' above the first table", assembly, TASK, NAMED_TASK),
    edited("two numbers", "see the schema for how many it takes", three, box("20, 20"), box("20, 20, 50")),
    edited("no corners", "see the schema for how many it takes", three, f"{HULL}[]", f"{HULL}{CORNERS}"),
    edited(
        "a choice misspelt",
        "write 'sound' or 'dakin1993'",
        problem,
        *(f"{WHOLE}[settings]\nmethod = '{one}'" for one in ("round", "sound", "dakin1993")),
    ),
    edited("a shape misspelt", SHAPES, model, f'{BODY}shape = "bock"\n{SIZE}', f"{BODY}{CUBOID}"),
    edited("no shape", 'write shape = "box", for example', model, f"{BODY}{SIZE}", f"{BODY}{CUBOID}"),
    edited("no text", "write text", model, f"description = 1\n{PEG}", f'description = "1"\n{PEG}'),
    edited("no table", "write a table", problem, f"moving = 1\n{ALONE[20:]}{FIXED}", f"{LONG}{START}"),
    edited("no solid", "write a table", model, 'part = "peg"\n[solids]\npeg = 1', f"{BODY}{CUBOID}"),
    edited("no title at all", TITLE, problem, f'title = ""\n{WHOLE}', f'title = "a"\n{WHOLE}'),
    edited("no array", "write an array", model, box("20, 20, 50").replace("[20, 20, 50]", "20"), box("20, 20, 50")),
    edited(
        "a long name",
        "use up to 64 letters, digits, _ and -, starting with a letter",
        model,
        *(f"name = '{name}'\n{PEG}" for name in ("x" * 70, "x" * 64, "a-peg_2")),
    ),
    edited(
        "a parameter with a dash",
        "use up to 64 letters, digits and _, starting with a letter",
        model,
        f'{PEG}[parameters]\n"a-b" = 1',
        f"{PEG}[parameters]\na_b2 = 1",
    ),
    edited("a title of two lines", TITLE, problem, f'title = "a\\nb"\n{WHOLE}', f"title = '{'a b, ' * 40}'\n{WHOLE}"),
    edited("an object for a feature", OPERAND, assembly, NAMED_TASK.replace("peg.peg", "peg"), NAMED_TASK),
    edited(
        "no object",
        f"{OPERAND}, or the name of an object",
        assembly,
        *(f'{NAMED_TASK}{LINK}one = "{one}"' for one in ("the peg", "rest.peg", "rest")),
    ),
    edited("few sides", "it should be greater than or equal to 3", model, rod(2), rod(3)),
    edited("many sides", "it should be less than or equal to 1998", model, rod(3000), rod(1998), slow=True),
    edited("sides twice", "give one of them", model, rod(20, "sagitta = 0.1\n"), rod(20)),
    edited("sides without end", "give one for which 1998 sides do", model, *map(sagged, ("1e-6", "0.01"))),
    edited("many meridians", "it should be less than or equal to 62", model, ball(100), ball(62), slow=True),
    edited("no file", "it should have at least 1 character", problem, f'moving = ""\n{ALONE[20:]}{FIXED}', WHOLE),
)
ABOUT_NUMBERS = (
    edited("below zero", "make it positive", problem, f'{HEIGHT}"-1 mm"', f'{HEIGHT}"1 mm"'),
    edited("nothing", "make it positive", problem, f"{HEIGHT}0", f'{HEIGHT}"1 mm"'),
    edited("an error below zero", "make it zero or positive", problem, error("-1 mm"), error("0 mm"), error("1 mm")),
    edited("too high", f"{TURN}4000 mm{UNIT}", problem, f'{HEIGHT}"9 m"', f'{HEIGHT}"4000 mm"'),
    edited("too low", f"{BACK}1e-06 mm{UNIT}", problem, f'{HEIGHT}"1 pm"', f'{HEIGHT}"1e-06 mm"'),
    edited("too far off", f"{TURN}500 mm{UNIT}", problem, error("1 m"), error("50 mm")),
    edited(
        "too askew", f"{TURN}28.6478897 deg{UNIT}", problem, error("1 mm", "40 deg"), error("1 mm", "28.6478897 deg")
    ),
    edited("turned twice", f"{TURN}360 deg{UNIT}", problem, turned("400 deg"), turned("360 deg")),
    edited("turned back", f"{BACK}-360 deg{UNIT}", problem, turned("-361 deg"), turned("-360 deg")),
    edited("a length without unit", NO_UNIT, problem, f"{HEIGHT}1", f'{HEIGHT}"2 mm"', f"{HEIGHT}1\n{UNITS}"),
    edited(
        "a speed without unit",
        'write text with its unit, such as "20 mm/s", or add speed = "m/s" under [units]',
        problem,
        f"{WHOLE}[specification]\nspeed = 1",
        f'{WHOLE}[specification]\nspeed = "20 mm/s"',
        f'{WHOLE}[specification]\nspeed = 1\n[units]\nspeed = "m/s"',
    ),
    edited("no number", QUANTITY, problem, f"{HEIGHT}true", f'{HEIGHT}"2 mm"'),
    edited("an angle for a length", QUANTITY, problem, f'{HEIGHT}"1 deg"', f'{HEIGHT}"2 mm"'),
    edited("a lever without size", QUANTITY, problem, f"{LEVER}true", f'{LEVER}"2 mm"'),
    edited("a mass for a parameter", QUANTITY, model, *(sized("50", f"w = {w}") for w in ('"1 kg"', '"2 mm"', 2))),
    edited("no end", "write a finite number", problem, f"{HEIGHT}inf", f'{HEIGHT}"1 mm"'),
    edited("half a unit", 'write a unit such as "N*m" or "mm/s"', problem, speed("20 mm/"), speed("20 mm/s")),
    edited("no unit of anything", A_UNIT, problem, f'{HEIGHT}"1 mmm"', f'{HEIGHT}"1 mm"', f'{HEIGHT}"1 um"'),
    edited("a unit with an offset", A_UNIT, problem, f'{HEIGHT}"1 degC"', f'{HEIGHT}"1 mm"'),
    edited("a comma", "write a decimal point, 0.2", problem, f'{HEIGHT}"0,2 mm"', f'{HEIGHT}"0.2 mm"'),
    edited("a sum in a problem", LONE, problem, f'{HEIGHT}"2 mm + 1 mm"', f'{HEIGHT}"2 mm"'),
    edited("a sign in a problem", LONE, problem, f'{HEIGHT}"2 mm!"', f'{HEIGHT}"2 mm"'),
    edited("a word for a number", LONE, problem, f'{HEIGHT}"two"', f'{HEIGHT}"2 mm"'),
    edited("a word for an angle", LONE, problem, turned("two"), turned("0.3 deg")),
    edited("a power", GRAMMAR, model, sized('"w^2"'), sized('"(w + 1 mm) * 2 - 3 mm / 1"')),
    edited("an open parenthesis", GRAMMAR, model, sized('"2 * (w"'), sized('"2 * (w)"')),
    edited("two numbers in a row", GRAMMAR, model, sized('"2 w"'.replace("w", "3")), sized('"2 * w"')),
    edited("many parentheses", "use at most 16", model, sized(deep(17)), sized(deep(16))),
    edited("a long text", "use at most 200", model, sized(f'"w{" " * 200}"'), sized(f'"w{" " * 199}"')),
    edited("a division by zero", "divide by something else", model, sized('"w / (w - w)"'), sized('"w / 2"')),
    edited("a sum of kinds", "give every number in a sum its unit", model, sized('"w + 1"'), sized('"w + 1 mm"')),
    edited("a parameter misspelt", "did you mean 'width'?", model, sized('"widht"', WIDTH), sized('"width"', WIDTH)),
    edited("no parameter", DEFINE, model, sized('"height"'), sized('"height"', "height = 50\n")),
    edited("used too early", DEFINE, model, sized('"h"', f"{TWICE}{W}"), sized('"h"', f"{W}{TWICE}")),
    edited("half an error", START_ERROR, spelled, "1 mm", "1 mm, 1 deg"),
    edited("two lengths", START_ERROR, spelled, "1 mm, 1 mm", "1 mm, 1 deg"),
    edited("a mass of an error", START_ERROR, spelled, "1 mm, 1 kg", "1 mm, 1 deg"),
    edited("an error of words", START_ERROR, spelled, "a little", "1 mm, 1 deg"),
)
CASES: tuple[Case, ...] = (*ABOUT_FILES, *ABOUT_KEYS, *ABOUT_NUMBERS)
