"""Pairs of parts as files that say nothing of how they mate: a prism and a plate with a hole for it, mm."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.geometry.polyhedron import triangulated
from fmopt.geometry.python_objects import imported_of
from fmopt.spatial.se3 import Pose
from tests.shared.files import step_parts
from tests.shared.files.mesh_files import stl_text
from tests.shared.files.step_files import write_step

Outline = tuple[tuple[float, float], ...]
FORMS = ("toml", "stl", "step")


@dataclass(frozen=True)
class Asked:
    """A peg over an outline about its own axis, and a plate with a hole that is wider by a clearance all around.

    The frames of the files are turned about z (rad) and shifted against the axis, each in its own way.
    """

    name: str
    peg: Outline
    hole: Outline
    clearance: float
    turns: tuple[float, float] = (0.0, 0.0)
    shift: tuple[float, float] = (0.0, 0.0)
    heights: tuple[float, float] = (30.0, 12.0)

    def loops(self) -> tuple[list[Outline], list[Outline]]:
        """The loops of the peg and of the plate, outer ones first, in the frames of their files."""
        plate = ((-20.0, -18.0), (20.0, -18.0), (20.0, 18.0), (-20.0, 18.0))
        peg = placed(self.peg, self.turns[0], (0.0, 0.0))
        return [peg], [placed(loop, self.turns[1], self.shift) for loop in (plate, self.hole)]


def placed(outline: Outline, turn: float, shift: tuple[float, float]) -> Outline:
    """An outline turned about the origin and shifted."""
    c, s = math.cos(turn), math.sin(turn)
    return tuple((c * x - s * y + shift[0], s * x + c * y + shift[1]) for x, y in outline)


def rectangle(x: float, y: float) -> Outline:
    """A rectangle about the origin."""
    return ((-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2))


def regular(sides: int, across: float) -> Outline:
    """A regular polygon about the origin, this far across its flats."""
    r = 0.5 * across / math.cos(math.pi / sides)
    at = [(2 * k + 1) * math.pi / sides for k in range(sides)]
    return tuple((r * math.cos(a), r * math.sin(a)) for a in at)


def keyed(width: float, gap: float) -> Outline:
    """A square with a key on one side, wider by a gap all around."""
    w, k, out = width / 2 + gap, width / 8 + gap, width / 2 + width / 6 + gap
    return ((-w, -w), (w, -w), (w, -k), (out, -k), (out, k), (w, k), (w, w), (-w, w))


def generated(seed: int) -> list[Asked]:
    """A square, a rectangle, a hexagon and a keyed square, of sizes and in frames drawn from a seed."""
    rng = np.random.default_rng(seed)

    def drawn(name: str, size: float, gap: float) -> tuple[Outline, Outline]:
        match name:
            case "square":
                return rectangle(size, size), rectangle(size + 2 * gap, size + 2 * gap)
            case "rectangle":
                return rectangle(size, 0.6 * size), rectangle(size + 2 * gap, 0.6 * size + 2 * gap)
            case "hexagon":
                return regular(6, size), regular(6, size + 2 * gap)
        return keyed(size, 0.0), keyed(size, gap)

    found = []
    for name in ("square", "rectangle", "hexagon", "keyed"):
        size, gap = round(float(rng.uniform(8.0, 14.0)), 2), round(float(rng.uniform(0.05, 0.2)), 3)
        turns = (math.radians(float(rng.integers(0, 4)) * 90.0), math.radians(float(rng.integers(0, 4)) * 90.0))
        shift = (round(float(rng.uniform(-50.0, 50.0)), 1), round(float(rng.uniform(-50.0, 50.0)), 1))
        found.append(Asked(name, *drawn(name, size, gap), gap, turns, shift))
    return found


def write(pair: Asked, folder: Path, form: str) -> tuple[Path, Path]:
    """The files of peg and plate in one form; a mesh is in mm, and does not say so."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / f"peg.{form}", folder / f"plate.{form}"
    for number, (path, loops, height) in enumerate(zip(paths, pair.loops(), pair.heights, strict=True)):
        if form == "toml":
            path.write_text(model(pair, number), encoding="utf-8")
        elif form == "step":
            write_step(path, solid(loops, height))
        else:
            body = imported_of((loops, height), "mm").body
            path.write_text(stl_text(1e3 * body.vertices, triangulated(body)), encoding="utf-8")
    return paths


def model(pair: Asked, number: int) -> str:
    """A model file of the peg (0) or the plate (1): without a name, units beside its numbers, and without features."""
    loops, height = pair.loops()[number], pair.heights[number]
    shapes = [loops[0], *(piece for loop in loops[1:] for piece in convex(loop))] if number else convex(loops[0])
    names = [f"body_{k}" for k in range(len(shapes))]
    low, high = (-1.0, height + 1.0) if number else (0.0, height)

    def prism(name: str, loop: Outline, z: float, top: float) -> str:
        polygon = ", ".join(f'["{x!r} mm", "{y!r} mm"]' for x, y in loop)
        where = f'at = [0, 0, "{z!r} mm"]\n' if z else ""
        return f'[solids.{name}]\nshape = "prism"\npolygon = [{polygon}]\nheight = "{top - z!r} mm"\n{where}'

    if not number:
        made = [prism(name, shape, 0.0, height) for name, shape in zip(names, shapes, strict=True)]
        return f'part = "part"\n[solids.part]\nshape = "union"\nof = {names}\n{"".join(made)}'.replace("'", '"')
    made = [prism(names[0], shapes[0], 0.0, height)]
    made += [prism(name, shape, low, high) for name, shape in zip(names[1:], shapes[1:], strict=True)]
    text = f'part = "part"\n[solids.part]\nshape = "difference"\nof = "body_0"\nminus = {names[1:]}\n{"".join(made)}'
    return text.replace("'", '"')


def convex(loop: Outline) -> list[Outline]:
    """The convex outlines that make an outline: the keyed square is the square and its key."""
    if len(loop) != 8:
        return [loop]
    a, b, c, d = (np.array(corner) for corner in loop[2:6])
    key = tuple((float(x), float(y)) for x, y in (2.0 * a - b, b, c, 2.0 * d - c))
    return [(loop[0], loop[1], loop[6], loop[7]), key]


def solid(loops: Sequence[Outline], height: float) -> Any:
    """A prism over loops as a solid of the CAD kernel."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec

    face = BRepBuilderAPI_MakeFace(step_parts.wire(loops[0], 0.0), True)
    for loop in loops[1:]:
        face.Add(step_parts.wire(loop[::-1], 0.0))
    return BRepPrimAPI_MakePrism(face.Face(), gp_Vec(0.0, 0.0, height)).Shape()


def write_assembly(path: Path, pair: Asked, depth: float) -> None:
    """A STEP file of the peg in the plate's hole, its leading end this far below the mouth, bodies called by name."""
    peg = [placed(loop, pair.turns[1] - pair.turns[0], (0.0, 0.0)) for loop in pair.loops()[0]]
    seat = Pose(np.array([*pair.shift, pair.heights[1] - depth]), np.eye(3))
    parts = [("peg", solid(peg, pair.heights[0]), seat)]
    step_parts.write_assembly(path, [*parts, ("plate", solid(pair.loops()[1], pair.heights[1]), Pose.identity())])
