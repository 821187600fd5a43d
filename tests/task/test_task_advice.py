"""Advice on model files, on their meshes and on the frames of their features, is followed to the letter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmopt.errors import InputError
from fmopt.geometry.csg import Box
from fmopt.task.model import load_model
from fmopt.task.solid_tree import build_part, build_tree
from fmopt.task.toml.source import Place
from tests.shared.files.advice.case import UNITS, Case, advice_of
from tests.shared.files.mesh_files import glb, stl_text, triangles_of
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box

ROD = triangles_of(Box((0.012, 0.008, 0.03)))
BLOCK = """part = "block"
[solids.block]
shape = "difference"
of = "whole"
minus = ["pocket"]
[solids.whole]
shape = "box"
size = [60, 60, 40]
[solids.pocket]
shape = "box"
size = [20.2, 20.2, 40]
at = [0, 0, 10]
"""
OPEN = BLOCK.replace("at = [0, 0, 10]", "at = [0, 0, -1]").replace("20.2, 20.2, 40]", "20.2, 20.2, 42]")
PEG = 'part = "peg"\n[solids.peg]\nshape = "box"\nsize = [20, 20, 50]\n'
BLOCK_SIZE, OPEN_SIZE = (60 * 60 * 40 - 20.2**2 * depth for depth in (30, 40))
PEG_SIZE, ROD_SIZE = 20 * 20 * 50, 12 * 8 * 30
INTO = "put the frame's origin into the mouth, z pointing out of it, and check the depth"
END = "put the frame's origin into the leading end, z pointing back into the part, and check the length"
CENTRAL = (
    "move the frame's origin there, or to the centre of the largest circle inside, which an even gap around leaves "
)
CENTRAL += "where it is; or turn an axis along the line; or leave `at` out, to have it found"


def size(folder: Path, text: str) -> float:
    """The volume of a model's part in mm³, once the frames of its features are found to obey the rules."""
    path = folder / "part.toml"
    path.write_text(f'name = "part"\n{text}\n{UNITS}', encoding="utf-8")
    model, faults = load_model(path, Place(str(path)), {})
    if model is None or faults:
        raise InputError(*faults)
    assert build_tree(model.source, model.file).classes
    return 1e9 * build_part(model.source, model.file).polyhedron.volume


def hole(at: str, more: str = "length = 30", model: str = BLOCK) -> str:
    """A block with the feature of its pocket stated."""
    return f'{model}[features.hole]\nkind = "hollow"\n{at}\n{more}'


def peg(at: str) -> str:
    """A bar with the feature of its end stated."""
    return f'{PEG}[features.peg]\nkind = "solid"\nat = {at}\nlength = 50'


def mesh(folder: Path, lines: str, file: str = "rod.stl", scale: float = 1.0) -> float:
    """As `size`, of a model that names a file of the rod, its numbers scaled."""
    path = folder / file
    if path.suffix == ".stl":
        path.write_text(stl_text(scale * ROD[0], ROD[1]))
    elif path.suffix == ".glb":
        path.write_bytes(glb(1e-3 * scale * ROD[0], ROD[1], {}))
    else:
        write_step(path, box(12.0, 8.0, 30.0))
    return size(folder, f'[mesh]\nfile = "{file}"\n{lines}')


CASES = (
    Case(
        "a hole from half-way",
        INTO,
        lambda f: size(f, hole("at = [0, 0, 25]")),
        lambda f: size(f, hole("at = [0, 0, 40]")),
        BLOCK_SIZE,
    ),
    Case(
        "a peg from its middle",
        END,
        lambda f: size(f, peg("[0, 0, 10]")),
        lambda f: size(f, peg("[0, 0, 0]")),
        PEG_SIZE,
    ),
    Case(
        "no mouth",
        "turn z out of the mouth, or open the feature",
        lambda f: size(f, hole("at = [0, 0, 10]\nturn = [180, 0, 0]")),
        lambda f: (
            size(f, hole("at = [0, 0, 40]")),
            size(f, hole("at = [0, 0, 0]\nturn = [180, 0, 0]", "length = 40\nthrough = true", OPEN)),
        ),
        (BLOCK_SIZE, OPEN_SIZE),
    ),
    Case(
        "beside the line",
        CENTRAL,
        lambda f: size(f, hole("at = [1, 0, 40]")),
        lambda f: (size(f, hole("at = [0, 0, 40]")), size(f, hole("", ""))),
        (BLOCK_SIZE, BLOCK_SIZE),
    ),
    Case(
        "in the material",
        "check the feature's frame, or model its shape as a solid of its own",
        lambda f: size(f, hole("at = [25, 0, 40]")),
        lambda f: size(f, hole("at = [0, 0, 40]")),
        BLOCK_SIZE,
    ),
    Case(
        "no unit",
        "add 'unit' to [mesh]: m, cm, mm, um or in",
        lambda f: mesh(f, ""),
        lambda f: tuple(
            mesh(f, f'unit = "{unit}"', scale=s)
            for unit, s in zip(("m", "cm", "mm", "um", "in"), (1e-3, 0.1, 1.0, 1e3, 1.0 / 25.4), strict=True)
        ),
        (ROD_SIZE,) * 5,
    ),
    Case(
        "another unit",
        'set unit = "mm" if that is meant',
        lambda f: mesh(f, 'unit = "m"'),
        lambda f: mesh(f, 'unit = "mm"'),
        ROD_SIZE,
    ),
    Case(
        "another unit in the file",
        "its file says its unit itself: export it again in the right one",
        lambda f: mesh(f, "", "rod.glb", 1e3),
        lambda f: mesh(f, "", "rod.glb"),
        ROD_SIZE,
    ),
    Case(
        "a body of a mesh",
        "remove 'body'",
        lambda f: mesh(f, 'unit = "mm"\nbody = 1'),
        lambda f: mesh(f, 'unit = "mm"'),
        ROD_SIZE,
    ),
    Case(
        "a unit of a STEP file",
        "remove 'unit'",
        lambda f: mesh(f, 'unit = "mm"', "rod.step"),
        lambda f: mesh(f, "", "rod.step"),
        ROD_SIZE,
    ),
    Case(
        "no deviation",
        "give a deviation such as 0.01 mm",
        lambda f: mesh(f, "deviation = 0", "rod.step"),
        lambda f: mesh(f, "deviation = 0.01", "rod.step"),
        ROD_SIZE,
    ),
    Case(
        "too many sides",
        "it should be less than or equal to 1998",
        lambda f: size(f, rod(3000)),
        lambda f: size(f, rod(96)),
        48 * np.sin(np.pi / 48) * 100 * 30,
    ),
    Case(
        "too many meridians",
        "it should be less than or equal to 62",
        lambda f: size(f, ball(100)),
        lambda f: size(f, ball(16)),
        3926.6,
    ),
)


def rod(sides: int) -> str:
    """A cylinder of so many sides."""
    return f'part = "rod"\n[solids.rod]\nshape = "cylinder"\nradius = 10\nheight = 30\nsides = {sides}\n{PIN}'


def ball(sides: int) -> str:
    """A ball of so many meridians."""
    return f'part = "ball"\n[solids.ball]\nshape = "sphere"\nradius = 10\nsides = {sides}\n{KNOB}'


PIN = '[features.pin]\nkind = "solid"\nat = [0, 0, 0]\nlength = 30'
KNOB = '[features.knob]\nkind = "solid"\nat = [0, 0, -10]\nlength = 20'


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_advice_on_a_model_that_is_followed_helps(case: Case, tmp_path: Path) -> None:
    with pytest.raises(InputError) as told:
        case.wrong(tmp_path)
    assert advice_of(told.value) == case.advice
    assert case.followed(tmp_path) == pytest.approx(case.gives, rel=1e-3)
