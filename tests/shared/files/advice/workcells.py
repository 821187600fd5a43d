"""Advice on workcells and their tasks, followed, in assembly files and where they are made in Python."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.geometry.csg import Box, Solid
from fmopt.spatial.se3 import Pose
from fmopt.task.assembly import load_assembly
from fmopt.task.object_model.command import Specification, answer, completed
from fmopt.task.object_model.goal import settle
from fmopt.task.object_model.tree import Feature, FeatureClass, ObjectTree, Term, chain_solid
from fmopt.task.object_model.workcell import Ref, Workcell
from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import BLOCK, PAIR, PEG, SHORT, START, assembled, assembly, edited, files, written
from tests.shared.files.advice.models import TWINS
from tests.shared.files.advice.texts import LINK
from tests.shared.files.advice.texts import NAMED_TASK as GIVEN
from tests.shared.files.model_text import UNITS, cuboid, union

FREE = '["free", "free", "free", "free", "free", "free"]'
BIT = Box((0.01, 0.01, 0.02))
REST = '[objects.rest]\nmodel = "peg.toml"\nat = [0, 0, 500]\n'
AGAIN = '[links.grip]\nkind = "attached"\none = "rest"\nother = "block"\n'
NAMED = "name the peg of one object and the hole of the other"


def to(goal: str, pair: str = "prismatic") -> str:
    """The assembly with a goal, in mm and deg, and the pair that is made there."""
    return GIVEN.replace(FREE, goal).replace('"prismatic"', f'"{pair}"')


def down(z: int | str) -> str:
    """The assembly with this height for a goal, in mm."""
    return to(f"[0, 0, {z}, 0, 0, 0]")


def screwed(folder: Path, turn: str) -> Any:
    """A peg that is screwed in, by an angle or a free one."""
    return assembly(folder, to(f"[0, 0, -30, 0, 0, {turn}]", "screw"))


def overturned(folder: Path, tilt: str) -> Any:
    """A round goal of a peg that starts upside down."""
    turned = GIVEN.replace("at = [0, 0, 100]", "at = [0, 0, 100]\nturn = [180, 0, 0]")
    return assembly(folder, turned.replace(FREE, f"[0, 0, -10, 0, 0, {tilt}]").replace('"prismatic"', '"cylindrical"'))


def feature(name: str, sign: Any = "+", body: Solid = BIT, **given: Any) -> Feature:
    return Feature(name, sign, Pose.identity(), body, **given)


def tree(folder: Path, names: Sequence[str]) -> ObjectTree:
    """An object of features, those called after "-" hollow; its order what follows a comma."""
    made = [feature(name.removeprefix("-"), "-" if name[0] == "-" else "+") for name in names if name[0] != ","]
    order = tuple(name[1:] for name in names if name[0] == ",")
    return ObjectTree("object", Pose.identity(), (FeatureClass("some", tuple(made)),), order)


def cell(folder: Path, names: Sequence[str]) -> Workcell:
    """A workcell of objects by their names."""
    return Workcell(tuple(replace(tree(folder, ["bit"]), name=name) for name in names))


def solid(folder: Path, signs: str) -> Solid:
    """The solid of a chain of these signs."""
    return chain_solid(Term(sign, "bit", BIT) for sign in signs)  # type: ignore[arg-type]


def long(folder: Path, length: float) -> Feature:
    return feature("bit", length=length)


def through(folder: Path, given: bool) -> Feature:
    return feature("bit", length=0.02, through=given)


def pushed(folder: Path, force: float) -> Specification:
    return Specification(0.02, force, 1.0)


def finite(folder: Path, z: float) -> Any:
    return settle((0.0, 0.0, z, 0.0, 0.0, 0.0), Pose.identity(), "prismatic", 0.0, "peg")


def asked_again(folder: Path, again: bool) -> Workcell:
    """A task completed after its object was moved, the question asked anew or not."""
    written(folder, {**PAIR, "assembly.toml": GIVEN})
    found = load_assembly(folder / "assembly.toml")
    task, moved = found.tasks["first"], found.workcell.moved(["peg"], Pose(np.array([0.0, 0.0, 0.01]), np.eye(3)))
    return completed(moved, answer(moved if again else found.workcell, task))


def thick(folder: Path, given: tuple[float, float, float]) -> Any:
    """A peg and the lower half of a hole of these widths, and how deep the one goes, mm."""
    wide, hole, depth = given
    block = BLOCK.replace("[20.2, 20.2, 40]", f"[{hole}, {hole}, 40]").replace('["pocket"]', '["pocket", "mouth"]')
    mouth = cuboid("mouth", "24, 24, 40", "0, 0, 25")
    peg = PEG.replace("20, 20, 50", f"{wide}, {wide}, 50")
    goal = to(f"[0, 0, {-depth}, 0, 0, 0]")
    return assembled(folder, {"peg.toml": peg + UNITS, "block.toml": block + mouth + UNITS, "assembly.toml": goal})


def hung(folder: Path, more: str) -> Any:
    """A peg with a head, and what is told of a bit beside its shaft."""
    head = union("all", "peg", "head") + cuboid("head", "60, 60, 20", "0, 0, 50")
    peg = PEG.replace('part = "peg"', 'part = "all"') + head
    bit = PEG.replace("20, 20, 50", "8, 8, 15").replace("length = 50", "length = 15")
    said = {"peg.toml": peg + UNITS, "bit.toml": bit + UNITS}
    return assembled(folder, {**said, "assembly.toml": GIVEN.replace("[0, 0, 100]", "[0, 0, 41]") + more})


def twin(folder: Path, more: str) -> Any:
    """A peg that goes into the second of two holes, and what the model says of that."""
    first = '[features.hole]\nkind = "hollow"\nat = [-15, 0, 40]\nlength = 30\n'
    peg = PEG.replace("20, 20, 50", "9.8, 9.8, 50")
    said = {"peg.toml": peg + UNITS, "block.toml": TWINS + first + more + UNITS}
    return assembled(folder, {**said, "assembly.toml": GIVEN.replace("block.hole", "block.other")})


def named(folder: Path, feature: str) -> Any:
    """A task of the peg's feature, or of the peg as a whole."""
    written(folder, {**PAIR, "assembly.toml": GIVEN})
    found = load_assembly(folder / "assembly.toml")
    return answer(found.workcell, replace(found.tasks["first"], moving=Ref("peg", feature)))


def upside_down(folder: Path, goal: str) -> Any:
    """A problem of a round peg that starts upside down."""
    rod = PEG.replace('"box"\nsize = [20, 20, 50]', '"cylinder"\nradius = 10\nheight = 50')
    start = f'{SHORT}{START}[start]\nheight = "1 mm"\nturn = ["180 deg", 0, 0]\n'
    return files(folder, {"peg.toml": rod + UNITS, "problem.toml": f"{start}{goal}"})


BIT_AT = '[objects.bit]\nmodel = "bit.toml"\n'
ON = f"{BIT_AT}at = [20, 0, 76]\n"
HELD = '[links.held]\nkind = "attached"\none = "bit"\nother = "peg"\n'
JOINED = f'{LINK}one = "rest"\n[links.grip]\nkind = "attached"\none = "rest"\nother = "peg"\n'
OTHER = '[objects.other]\nmodel = "block.toml"\nat = [500, 0, 0]\n'
SECOND = '[features.other]\nkind = "hollow"\nat = [15, 0, 40]\nlength = 30\n'
DEEP = "give p_z between 0 and -30 mm, or leave it free"
OUTSIDE = "start outside, and check the frames of both objects"
THIN = "seat it less deep, or make the peg thinner or the hole wider"
AWAY = "move that object away, or connect it to the one that it is on"
SHAFT = ["bit", "cap", ",bit"]
CASES: tuple[Case, ...] = (
    edited("no such object", "its objects: peg, block", assembly, GIVEN.replace('"peg.peg"', '"pin.peg"'), GIVEN),
    edited("no such feature", "its features: whole, hole", assembly, GIVEN.replace("block.hole", "block.slot"), GIVEN),
    edited("an object for a feature", "features that can be operands: peg", named, "", "peg"),
    edited("a feature without frame", "give it a length, and a frame in its mouth or leading end", twin, "", SECOND),
    edited("one object", "name features of two objects", assembly, GIVEN.replace("block.hole", "peg.peg"), GIVEN),
    edited("two pegs", NAMED, assembly, GIVEN.replace("block.hole", "rest.peg") + REST, GIVEN + REST),
    edited(
        "joined already",
        "disconnect them, or name another feature",
        assembly,
        GIVEN + JOINED,
        f'{GIVEN}{LINK}one = "rest"',
        GIVEN.replace("block.hole", "other.hole") + JOINED + OTHER,
    ),
    edited("a link to itself", "remove it", assembly, f'{GIVEN}{LINK}one = "block"', f"{GIVEN}"),
    edited("linked twice", "remove it", assembly, f'{GIVEN}{LINK}one = "rest"\n{AGAIN}', f'{GIVEN}{LINK}one = "rest"'),
    edited("inside at the start", OUTSIDE, assembly, GIVEN.replace("[0, 0, 100]", "[15, 0, 20]"), GIVEN),
    edited("too thick", THIN, thick, (21, 20.2, 30), (20, 20.2, 30), (21, 22, 30)),
    edited("another object there", AWAY, hung, ON, f"{BIT_AT}at = [500, 0, 76]", ON + HELD),
    edited(
        "beside the axis",
        "set it to 0, or leave it free",
        assembly,
        *(to(f'[{x}, 0, "free", 0, 0, 0]') for x in (1, 0, '"free"')),
    ),
    edited("too deep", DEEP, assembly, *map(down, (-31, -30, -15, '"free"'))),
    edited("outside", DEEP, assembly, *map(down, (1, -30, '"free"'))),
    edited("a free screw", "give the angle that goes with the depth", screwed, '"free"', "0"),
    edited("turned over", "give a number instead of free", overturned, '"free"', "0"),
    edited("a round peg turned over", "give a number instead of free", upside_down, "", "[goal]\nturn = 0"),
    edited("no number", "give finite numbers", finite, math.inf, -0.01),
    edited("no force", "make it positive", pushed, 0.0, 20.0),
    edited("no length", "make it positive", long, 0.0, 0.02),
    edited("a peg through", "drop `through`", through, True, False),
    edited("two of a name", "rename one", tree, ["bit", "bit"], ["bit", "bit_2"]),
    edited("objects of a name", "rename one", cell, ["bit", "bit"], ["bit", "bit_2"]),
    edited("an order of others", "list the features of the object, each once", tree, SHAFT, [*SHAFT, ",cap"]),
    edited("a hole first", "put a feature prefixed + first", tree, ["-hole", "bit"], ["bit", "-hole"]),
    edited("holes alone", "prefix at least one feature with +", solid, "--", "+-"),
    edited("an old answer", "ask again", asked_again, False, True),
)
