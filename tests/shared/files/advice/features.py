"""Advice on the features of model files, followed: their frames, what they are made of, and how they are found."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from fmopt.errors import InputError
from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import (
    edited,
    model,
)
from tests.shared.files.advice.models import BAR, ON_IT, PROFILE, TWINS, WHOLE, of_stl

MOUTH = "at = [0, 0, 40]"
ROD_END = 'unit = "mm"\n[features.peg]\nkind = "solid"\n'

OPEN = WHOLE.replace("at = [0, 0, 10]", "at = [0, 0, -1]").replace("20.2, 20.2, 40]", "20.2, 20.2, 42]")
INTO = "put the frame's origin into the mouth, z pointing out of it, and check the depth"
END = "put the frame's origin into the leading end, z pointing back into the part, and check the length"
CENTRAL = (
    "move the frame's origin there, or to the centre of the largest circle inside, which an even gap around leaves "
    "where it is; or turn an axis along the line; or leave `at` out, to have it found"
)


def hole(at: str, more: str = "length = 30", solids: str = WHOLE) -> str:
    """A block with the feature of its pocket stated."""
    return f'{solids}[features.hole]\nkind = "hollow"\n{at}\n{more}'


def peg(at: str, more: str = "") -> str:
    """A bar with the feature of its end stated."""
    return f'{BAR}[features.peg]\nkind = "solid"\nat = {at}\nlength = 50\n{more}'


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


def of_solids(name: str) -> str:
    """A block with a feature that is made of a named solid."""
    return hole("at = [0, 0, 40]", f'length = 30\nsolids = ["{name}"]')


def centred(folder: Path, choice: str) -> Any:
    """A block with a hole of three corners, its frame where an error puts it, or beside the line."""
    block = hole("at = [1.23456, 0, 40]", solids=WHOLE.replace(*THREE))
    with pytest.raises(InputError) as told:
        model(folder, block)
    if choice == "beside":
        raise told.value
    found = re.findall(r"\((\S+), (\S+)\) mm", told.value.faults[0].message)
    x, y = (float(number) for number in found[0 if choice == "centroid" else 1])
    return model(folder, block.replace("at = [1.23456, 0, 40]", f"at = [{1.23456 + x!r}, {y!r}, 40]"))


THREE = (
    'shape = "box"\nsize = [20.2, 20.2, 40]',
    'shape = "prism"\npolygon = [[-7, -6], [13, -5], [-8, 11]]\nheight = 40',
)
CASES: tuple[Case, ...] = (
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
    edited("beside a line of odd digits", CENTRAL, centred, "beside", "centroid", "circle"),
    edited(
        "in the material",
        "check the feature's frame, or model its shape as a solid of its own",
        model,
        hole("at = [25, 0, 40]"),
        hole("at = [0, 0, 40]"),
        hole("at = [25, 0, 40]", f"length = 30\n{OWN}", WHOLE.replace('["pocket"]', '["pocket", "slit"]')),
    ),
    edited(
        "askew", CENTRAL, model, hole(f"{MOUTH}\nturn = [0.1, 0, 0]", "length = 29.9"), hole(MOUTH, "length = 29.9")
    ),
    edited(
        "beside the line of a mesh",
        CENTRAL,
        of_stl,
        f"{ROD_END}at = [1, 0, 0]\nlength = 30",
        f"{ROD_END}at = [0, 0, 0]\nlength = 30",
        f"{ROD_END}length = 30",
    ),
    edited(
        "beside a mesh",
        "check the feature's frame",
        of_stl,
        f"{ROD_END}at = [30, 0, 0]\nlength = 30",
        f"{ROD_END}at = [0, 0, 0]\nlength = 30",
    ),
    edited(
        "beside the line of a profile",
        "move the frame's origin there",
        model,
        f"{PROFILE}{ON_IT}".replace("at = [0, 0, 0]", "at = [1, 0, 0]"),
        f"{PROFILE}{ON_IT}",
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
