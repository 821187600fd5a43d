"""Tasks of prisms over polygons, written as problem files."""

import math
from pathlib import Path

from tests.shared.files.model_text import UNITS, cuboid, difference, feature, part
from tests.shared.files.own import TASK

Outline = list[list[float]]


def prism(
    folder: Path, polygon: Outline, hole: Outline, error: float = 1.0, limit: float = 20, stated: float = 0.1
) -> Path:
    """The files of a prism and a through hole, with outlines in mm; the problem's."""
    wide = 2.0 * max(abs(x) for corner in hole for x in corner) + 20.0
    peg = _prism("prism", polygon, 40) + feature("peg", "solid", "0, 0, 0", "40")
    block = cuboid("block", f"{wide}, {wide}, 25") + _prism("hole", hole, 27) + "at = [0, 0, -1]\n"
    block += difference("drilled", "block", "hole") + feature("hole", "hollow", "0, 0, 25", "25") + "through = true\n"
    (folder / "peg.toml").write_text('name = "peg"\n' + part("prism", UNITS, peg))
    (folder / "hole.toml").write_text('name = "hole"\n' + part("drilled", UNITS, block))
    values = {"moving": "peg", "fixed": "hole", "x": stated, "y": stated, "position": error, "angle": error}
    values |= {"translation": 0.0005, "rotation": 0.0001, "height": 1, "tilt": 25, "limit": limit}
    (folder / "task.toml").write_text(TASK.format(**values))
    return folder / "task.toml"


def _prism(name: str, polygon: Outline, height: float) -> str:
    return f'[solids.{name}]\nshape = "prism"\npolygon = {polygon}\nheight = {height}\n'


def regular(n: int, inside: float) -> Outline:
    """A regular polygon around a circle, mm."""
    size = inside / math.cos(math.pi / n)
    angles = [2.0 * math.pi * (k + 0.5) / n for k in range(n)]
    return [[size * math.cos(a), size * math.sin(a)] for a in angles]


def rectangle(x: float, y: float) -> Outline:
    """A rectangle of half-widths, mm."""
    return [[x, -y], [x, y], [-x, y], [-x, -y]]
