"""Tasks of prisms over polygons, written as problem files."""

from __future__ import annotations

import math
from pathlib import Path

from tests.shared.files.own import TASK

Outline = list[list[float]]
_UNITS = '[units]\nlength = "mm"\nangle = "deg"\n'


def prism(
    folder: Path, polygon: Outline, hole: Outline, error: float = 1.0, limit: float = 20, stated: float = 0.1
) -> Path:
    """The files of a prism and a through hole, with outlines in mm; the problem's."""
    wide = 2.0 * max(abs(x) for corner in hole for x in corner) + 20.0
    peg = f'[solids.prism]\nshape = "prism"\npolygon = {polygon}\nheight = 40\n'
    block = f'[solids.block]\nshape = "box"\nsize = [{wide}, {wide}, 25]\n'
    block += f'[solids.hole]\nshape = "prism"\npolygon = {hole}\nheight = 27\nat = [0, 0, -1]\n'
    block += '[solids.drilled]\nshape = "difference"\nof = "block"\nminus = ["hole"]\n'
    (folder / "peg.toml").write_text(
        f'name = "peg"\npart = "prism"\n{_UNITS}{peg}[features.peg]\nkind = "solid"\nat = [0, 0, 0]\nlength = 40\n'
    )
    (folder / "hole.toml").write_text(
        f'name = "hole"\npart = "drilled"\n{_UNITS}{block}[features.hole]\nkind = "hollow"\nat = [0, 0, 25]\n'
        "length = 25\nthrough = true\n"
    )
    values = {"moving": "peg", "fixed": "hole", "x": stated, "y": stated, "position": error, "angle": error}
    values |= {"translation": 0.0005, "rotation": 0.0001, "tilt": 25, "limit": limit}
    (folder / "task.toml").write_text(TASK.format(**values))
    return folder / "task.toml"


def regular(n: int, inside: float) -> Outline:
    """A regular polygon around a circle, mm."""
    size = inside / math.cos(math.pi / n)
    angles = [2.0 * math.pi * (k + 0.5) / n for k in range(n)]
    return [[size * math.cos(a), size * math.sin(a)] for a in angles]


def rectangle(x: float, y: float) -> Outline:
    """A rectangle of half-widths, mm."""
    return [[x, -y], [x, y], [-x, y], [-x, -y]]
