"""Tasks of prisms over polygons, written as problem files."""

from __future__ import annotations

import math
from pathlib import Path

_UNITS = '[units]\nlength = "mm"\nangle = "deg"\n'
_TASK = """title = "{title}"
[units]
length = "mm"
angle = "deg"
speed = "mm/s"
[moving]
model = "peg.toml"
feature = "peg"
[fixed]
model = "hole.toml"
feature = "hole"
[goal]
depth = "full"
[clearance]
x = {stated}
y = {stated}
[start]
height = 1
[uncertainty.start]
x = {error}
y = {error}
z = 0
rx = {error}
ry = {error}
rz = {error}
[uncertainty.velocity]
translation = 0.0005
rotation = 0.0001
[specification]
speed = 20
contact_force = 20
torque_limit = 1
friction = 0.3
termination_force = 2
[settings]
evidence = "certified"
max_tilt = 25
time_limit = {limit}
"""


def prism(folder: Path, polygon: list[list[float]], hole: list[list[float]], **said: float) -> Path:
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
    values = {"error": 1.0, "limit": 20, "stated": 0.1, "title": "prism"} | said
    (folder / "task.toml").write_text(_TASK.format(**values))
    return folder / "task.toml"


def regular(n: int, inside: float) -> list[list[float]]:
    """A regular polygon around a circle, mm."""
    size = inside / math.cos(math.pi / n)
    angles = [2.0 * math.pi * (k + 0.5) / n for k in range(n)]
    return [[size * math.cos(a), size * math.sin(a)] for a in angles]


def rectangle(x: float, y: float) -> list[list[float]]:
    """A rectangle of half-widths, mm."""
    return [[x, -y], [x, y], [-x, y], [-x, -y]]
