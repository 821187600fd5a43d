"""Advice on objects of Python and on features and fits, followed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import trimesh

from fmopt.geometry import python_objects
from fmopt.geometry.clearance import checked_clearance, mating_clearance
from fmopt.geometry.csg import Box, Cylinder, Difference, Placed, Solid
from fmopt.geometry.fit.find import find
from fmopt.geometry.mating_features import DESCRIBE, Feature
from fmopt.geometry.mesh.mesh_import import Unit
from fmopt.geometry.part import Part, mesh_part, part_of, rebased, with_balls
from fmopt.geometry.python_objects import imported_of
from fmopt.geometry.step.step_import import load_step
from fmopt.spatial.se3 import Pose
from tests.shared.files.advice.case import Case, compared, volume
from tests.shared.files.advice.step import SIZE, block, exported
from tests.shared.files.mesh_files import at
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box, cut, cylinder

OUTLINE = [(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]
PRISM = (OUTLINE, 30.0)
INNER = [(2.0, 2.0), (10.0, 2.0), (10.0, 6.0), (2.0, 6.0)]
UNITS: tuple[Unit, ...] = ("m", "dm", "cm", "mm", "um", "in")
PER_METRE = (1.0, 10.0, 100.0, 1e3, 1e6, 1.0 / 0.0254)


def taken(thing: object, unit: Unit | None = "mm") -> float:
    """The volume of an object, its numbers in mm."""
    return volume(imported_of(thing, unit))


def of_trimesh() -> Any:
    return trimesh.creation.box((12.0, 8.0, 30.0))


def of_manifold() -> Any:
    return manifold3d.Manifold.cube((12.0, 8.0, 30.0))


def workplane(built: bool) -> Any:
    """A workplane of CadQuery, with a block on it once it is built."""
    import cadquery

    return cadquery.Workplane().box(12.0, 8.0, 30.0) if built else cadquery.Workplane()


def nothing() -> Any:
    """A shape of the kernel that nothing was made of."""
    from OCP.TopoDS import TopoDS_Shape

    return TopoDS_Shape()


def two() -> Any:
    """A compound of two blocks."""
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Compound

    made, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(made)
    for shape in (block(), box(12.0, 8.0, 30.0, (40.0, 0.0, 0.0))):
        builder.Add(made, shape)
    return made


def first(compound: Any) -> Any:
    """The first of the solids of a compound."""
    from fmopt.geometry.step.step_file import inside

    return next(inside(compound, "SOLID"))


def in_every_unit(_: Path) -> tuple[float, ...]:
    """The volume of the prism with its numbers in each unit."""
    scales = [1e-3 * per for per in PER_METRE]
    prisms = [([(x * s, y * s) for x, y in OUTLINE], 30.0 * s) for s in scales]
    return tuple(volume(imported_of(prism, unit)) for prism, unit in zip(prisms, UNITS, strict=True))


HOLE = Feature("hole", "hollow", at(z=0.04), 0.03)
SEATED = at(z=-0.03)


def hole(width: float = 0.0202) -> Part:
    """A block with a blind hole, in the hole's frame."""
    tool = Placed(Box((width, width, 0.03)), at(z=0.01))
    solid: Solid = Difference(Box((0.06, 0.06, 0.04)), (tool,))
    return rebased(part_of("block", solid, (HOLE,)), HOLE.frame)


def peg(width: float = 0.02, tip: Pose | None = None) -> Part:
    """A square peg, in the frame of its tip."""
    solid = Box((width, width, 0.05))
    return rebased(part_of("peg", solid, (Feature("tip", "solid", at(), 0.05),)), at() if tip is None else tip)


def room(moving: Part, fixed: Part, seated: Pose = SEATED) -> float:
    """The clearance of parts that can be assembled, m a side."""
    return checked_clearance(moving, fixed, seated, 0.03).per_side


def rod(sides: int) -> Part:
    """A round peg, turned by half a facet."""
    turned = Pose.from_vector([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / sides])
    return part_of("rod", Placed(Cylinder(0.01, 0.05, sides), turned))


def bore(sides: int, aside: float = 0.0) -> Part:
    """A block with a round hole, in the hole's frame; so far aside that it is open there."""
    tool = Placed(Cylinder(0.01005, 0.03, sides), at(z=0.01))
    return rebased(part_of("block", Difference(Placed(Box((0.06, 0.06, 0.04)), at(aside)), (tool,))), HOLE.frame)


def round_step(folder: Path, aside: float = 0.0) -> float:
    """The clearance of the same two from STEP files."""
    shapes = {"rod": cylinder(10.0, 50.0)}
    shapes["block"] = cut(box(60.0, 60.0, 40.0, (1e3 * aside, 0.0, 0.0)), cylinder(10.05, 30.0, (0.0, 0.0, 10.0)))
    for name, shape in shapes.items():
        write_step(folder / f"{name}.step", shape)
    moving, fixed = (mesh_part(name, load_step(folder / f"{name}.step")) for name in shapes)
    return room(moving, rebased(fixed, HOLE.frame))


def tip(length: float = 0.1, through: bool = False) -> float:
    """The length of a peg's feature."""
    return Feature("tip", "solid", at(), length, through=through).length


def ball_radius(ball: tuple[list[float], float]) -> float:
    """The radius of a ball of a peg."""
    return with_balls(peg(), [ball]).balls[0].radii[0]


FRAMES = "check the feature's frame: z points out of a hole, and back into the part from a peg's leading end"
ASIDE = 0.035
SECTION = manifold3d.CrossSection.square((12.0, 8.0))
CORNER, BESIDE = ([0.01, 0.01, 0.0], 0.004), ([0.01, 0.01, -1e-6], 0.004)
BALL = ([0.0, 0.0, -0.01], 0.004)

CASES = (
    Case(
        "no part at all",
        python_objects._ADVICE,
        lambda f: taken(5),
        lambda f: (exported(), taken(of_trimesh()), taken(of_manifold()), taken(PRISM)),
        (SIZE,) * 4,
    ),
    compared("an outline of numbers", python_objects._ADVICE, taken, ([1, 2, 3], 5.0), PRISM, gives=SIZE),
    Case(
        "no unit", "give unit = one of m, dm, cm, mm, um, in", lambda f: taken(PRISM, None), in_every_unit, (SIZE,) * 6
    ),
    compared(
        "nothing built", "give it once it is built", lambda built: taken(workplane(built)), False, True, gives=SIZE
    ),
    Case("two solids", "give one of its solids", lambda f: taken(two()), lambda f: taken(first(two())), SIZE),
    Case("a shape of nothing", "give one solid", lambda f: taken(nothing()), lambda f: exported(), SIZE),
    Case(
        "a scene",
        "give one Trimesh, such as one of scene.geometry, or scene.to_mesh()",
        lambda f: taken(trimesh.Scene([of_trimesh(), of_trimesh()])),
        lambda f: (
            taken(next(iter(trimesh.Scene([of_trimesh()]).geometry.values()))),
            taken(trimesh.Scene([of_trimesh()]).to_mesh()),
            taken(trimesh.Scene([of_trimesh()])),
        ),
        (SIZE, SIZE, SIZE),
    ),
    compared("a cross-section", "give a Manifold", taken, SECTION, of_manifold(), gives=SIZE),
    compared("a manifold of nothing", "give a solid", taken, manifold3d.Manifold(), of_manifold(), gives=SIZE),
    compared("no height", "make it positive", taken, (OUTLINE, 0.0), PRISM, gives=SIZE),
    Case(
        "loops that cross",
        "list the corners of loops that do not cross, the outer one first, then its holes",
        lambda f: taken(([INNER, OUTLINE], 30.0)),
        lambda f: taken(([OUTLINE, INNER], 30.0)),
        (12 * 8 - 8 * 4) * 30e-9,
    ),
    compared("no length", "make it positive", tip, 0.0, 0.1, gives=0.1),
    compared("a peg that is through", "drop `through`", lambda given: tip(through=given), True, False, gives=0.1),
    compared(
        "another name", "its features: hole", lambda name: hole().feature(name).length, "slot", "hole", gives=0.03
    ),
    Case(
        "too thick",
        "make the peg thinner or the hole wider, and check the units of both",
        lambda f: room(peg(0.0204), hole()),
        lambda f: (room(peg(0.02), hole()), room(peg(0.0204), hole(0.0206))),
        (1e-4, 1e-4),
    ),
    Case(
        "nothing goes in",
        f"check the units of both, and that one has an opening for the other; or {DESCRIBE}",
        lambda f: find(peg().polyhedron, peg().polyhedron).clearance,
        lambda f: find(peg().polyhedron, hole().polyhedron).clearance,
        1e-4,
    ),
    Case(
        "too coarse to tell",
        "give about 63 facets around, or a STEP file",
        lambda f: room(rod(24), bore(24)),
        lambda f: (room(rod(63), bore(63)), round_step(f)),
        (0.01005 * np.cos(np.pi / 63) - 0.01, 5e-5),
    ),
    Case(
        "too large an enclosure to tell",
        "describe 'rod' by shapes: an enclosure is larger than the part",
        lambda f: room(replace(rod(63), larger=1e-4), bore(24)),
        lambda f: room(rod(63), bore(63)),
        0.01005 * np.cos(np.pi / 63) - 0.01,
    ),
    Case(
        "too coarse to tell, open to the side",
        "give finer facets, or a STEP file",
        lambda f: room(rod(24), bore(24, ASIDE)),
        lambda f: (room(rod(48), bore(48, ASIDE)), 4.5e-5 < round_step(f, ASIDE) < 5e-5),
        (0.01005 * np.cos(np.pi / 48) - 0.01, True),
    ),
    Case(
        "too deep",
        "seat it less deep, or move the features' frames",
        lambda f: room(peg(), hole(), at(z=-0.0301)),
        lambda f: (room(peg(), hole(), SEATED), room(peg(tip=at(z=-0.0001)), hole(), at(z=-0.0301))),
        (1e-4, 1e-4),
    ),
    Case(
        "a frame the wrong way",
        FRAMES,
        lambda f: mating_clearance(peg(tip=Pose.from_vector([0.0, 0.0, 0.0, np.pi, 0.0, 0.0])), hole(), 0.03),
        lambda f: room(peg(), hole()),
        1e-4,
    ),
    compared("a ball of no size", "give it a positive one", ball_radius, (BALL[0], 0.0), BALL, gives=0.004),
    compared("a ball at a corner", "move it a little", ball_radius, CORNER, BESIDE, gives=0.004),
)
