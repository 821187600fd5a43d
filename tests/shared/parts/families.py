"""Pairs of parts to be planned for, family by family from a seed: as values, in TOML, as binary STL, as STEP.

A part is a stack of outlines. Lengths are in mm and angles in degrees, as they are written. Outlines are
counter-clockwise about the axis, the peg's leading end is at z = 0 and the peg goes up from there; the hole's mouth is
at z = 0 and the hole goes down. Between a peg and its hole there is the same clearance all around, at every height
where both are meant to mate. Each part has a model frame of its own, turned and shifted against that.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.shared.files.mesh_files import binary_stl
from tests.shared.files.model_text import UNITS, of_file
from tests.shared.files.own import TASK
from tests.shared.files.shipped import swapped

if TYPE_CHECKING:
    from manifold3d import Manifold

Outline = tuple[tuple[float, float], ...]
Shape = tuple[Outline, float]  # an outline, and its size: about how wide it is, mm

NGONS = tuple(f"{n}-gon" for n in range(3, 14))
PLAIN = (*NGONS, "rectangle", "triangle", "L", "T", "U", "plus", "star", "keyed")
FAMILIES = (*PLAIN, "stepped", "counterbored", "tapered", "chamfered", "hollow", "capped")
_SLENDER = 1.5  # times as long as it is wide is a peg


@dataclass(frozen=True)
class Section:
    """An outline at a height."""

    at: float
    outline: Outline


Stack = tuple[Section, ...]  # from below upwards, walls run straight from each to the next; two at a height are a step


@dataclass(frozen=True)
class Placing:
    """Where the frame of a stack lies in the model frame: shifted (x, y, z), turned about z."""

    shift: tuple[float, float, float]
    turn: float


@dataclass(frozen=True)
class Pair:
    """Two parts that go together."""

    name: str
    family: str
    peg: Stack  # the solid feature
    bore: Stack  # what is taken out of the part with the peg; empty for most
    hole: Stack  # the hollow feature
    # Size (x, y, z) of the block that the hole is in, centred about it, its top in the mouth
    block: tuple[float, float, float]
    clearance: float  # on each side
    depth: float  # how far the peg goes in
    through: bool  # whether the hole is open below
    size: float  # about how wide the section is
    placings: tuple[Placing, Placing]  # of the part with the peg, and of that with the hole
    exchanged: bool = False  # whether the part with the hole is the one that moves

    @property
    def error(self) -> tuple[float, float]:
        """A start error that is small beside the part: half-widths in mm and degrees."""
        return min(0.3, 0.015 * self.size), 0.3


def pairs(seed: int, families: Sequence[str] = FAMILIES) -> Iterator[Pair]:
    """One pair of each family, its sizes and turns drawn from the seed and the family's name alone."""
    for family in families:
        yield pair(family, seed)


def pair(family: str, seed: int) -> Pair:
    """The pair of a family that a seed draws."""
    rng = np.random.default_rng([seed, *family.encode()])
    outline, size = shape(family if family in PLAIN else "", rng)
    clearance = float(np.exp(rng.uniform(math.log(max(0.01, size / 1000.0)), math.log(min(0.5, size / 60.0)))))
    clearance = round(clearance, 4)
    depth = round(size * float(rng.uniform(1.0, 1.6)), 3)
    through = bool(rng.random() < 0.4)
    length = round(max(depth, _SLENDER * size) * float(rng.uniform(1.25, 1.6)), 3)
    wide = widened(outline, clearance)
    peg: Stack = (Section(0.0, outline), Section(length, outline))
    hole: Stack = (Section(-depth, wide), Section(0.0, wide))
    bore: Stack = ()
    narrow = 0.12 * _inner(outline)
    if family == "stepped":
        low, short = widened(outline, -narrow), round(0.45 * depth, 3)
        above = round(short + 0.04 * depth, 3)
        peg = (Section(0.0, low), Section(above, low), Section(above, outline), Section(length, outline))
        tight = widened(low, clearance)
        hole = (Section(-depth, tight), Section(short - depth, tight), Section(short - depth, wide), Section(0.0, wide))
    elif family == "counterbored":
        deep, deeper = -round(0.2 * depth, 3), -round(0.45 * depth, 3)
        rims = [widened(outline, clearance + k * narrow) for k in (1.0, 2.0)]
        hole = (
            *(Section(-depth, wide), Section(deeper, wide), Section(deeper, rims[0]), Section(deep, rims[0])),
            *(Section(deep, rims[1]), Section(0.0, rims[1])),
        )
    elif family == "tapered":
        tip = widened(outline, -narrow)
        peg = (Section(0.0, tip), Section(depth, outline), Section(length, outline))
        hole = (Section(-depth, widened(tip, clearance)), Section(0.0, wide))
    elif family == "chamfered":
        peg = (Section(0.0, widened(outline, -narrow)), Section(narrow, outline), Section(length, outline))
    elif family == "hollow":
        inner = widened(outline, -2.5 * narrow)
        bore = (Section(0.0, inner), Section(round(0.8 * depth, 3), inner))
    reach = 1.0 + 2.0 * max(math.hypot(*corner) for section in hole for corner in section.outline)
    below = 0.0 if through else round(0.3 * size, 3)
    block = (round(reach + 0.8 * size, 3), round(reach + 1.1 * size, 3), round(depth + below, 3))
    placings = tuple(
        Placing(
            (round(float(rng.uniform(-1.0, 1.0)) * size, 3), round(float(rng.uniform(-1.0, 1.0)) * size, 3), 0.0),
            round(float(rng.uniform(0.0, 360.0)), 3),
        )
        for _ in range(2)
    )
    return Pair(
        name=f"{family}-{seed}",
        family=family,
        peg=peg,
        bore=bore,
        hole=hole,
        block=block,
        clearance=clearance,
        depth=depth,
        through=through,
        size=size,
        placings=(placings[0], placings[1]),
        exchanged=family == "capped",
    )


def shape(family: str, rng: np.random.Generator) -> Shape:
    """An outline of a family about the origin, to nine digits; of any plain family where none is named."""
    if not family:
        family = str(rng.choice(["4-gon", "6-gon", "8-gon", "rectangle", "L", "T", "plus"]))
    size = float(np.exp(rng.uniform(math.log(3.0), math.log(60.0))))
    if family in NGONS:
        n = int(family.split("-")[0])
        corners = [(math.cos(math.tau * k / n), math.sin(math.tau * k / n)) for k in range(n)]
    elif family == "rectangle":
        ratio = float(np.exp(rng.uniform(0.0, math.log(20.0))))
        corners = [(-1.0, -1.0 / ratio), (1.0, -1.0 / ratio), (1.0, 1.0 / ratio), (-1.0, 1.0 / ratio)]
    elif family == "triangle":
        corners = _triangle(rng)
    elif family == "star":
        n, inner = int(rng.integers(4, 7)), float(rng.uniform(0.5, 0.65))
        corners = [
            (radius * math.cos(math.pi * k / n), radius * math.sin(math.pi * k / n))
            for k in range(2 * n)
            for radius in ((1.0, inner)[k % 2],)
        ]
    elif family == "keyed":
        w = float(rng.uniform(0.2, 0.3))
        ring = [(math.cos(math.pi * (k + 0.5) / 8), math.sin(math.pi * (k + 0.5) / 8)) for k in range(16)]
        flat = math.cos(math.pi / 16)
        key = [(w, flat * math.cos(math.pi / 8)), (w, 1.25), (-w, 1.25), (-w, flat * math.cos(math.pi / 8))]
        ring = [(x, y) for x, y in ring if not (abs(x) < 0.45 and y > 0.0)]
        at = next(k for k, (x, y) in enumerate(ring) if x < 0.0 and y > 0.0)
        left, right = ring[at], ring[at - 1]
        foot = min(left[1], right[1])
        corners = [*ring[:at], (w, foot), *key[1:3], (-w, foot), *ring[at:]]
    else:
        corners = _armed(family, rng)
    middle = 0.5 * (np.min(corners, axis=0) + np.max(corners, axis=0))
    scale = size / float(np.ptp(corners, axis=0).max())
    made = tuple(
        (round(float(scale * (x - middle[0])), 9), round(float(scale * (y - middle[1])), 9)) for x, y in corners
    )
    return made, size


def _triangle(rng: np.random.Generator) -> list[tuple[float, float]]:
    """A triangle with three different sides and no angle below 35°."""
    while True:
        a, b = rng.uniform(math.radians(35.0), math.radians(100.0), size=2)
        c = math.pi - a - b
        if c > math.radians(35.0) and min(abs(a - b), abs(b - c), abs(a - c)) > math.radians(8.0):
            break
    x = math.sin(c) * math.cos(a) / math.sin(a + b)
    return [(0.0, 0.0), (1.0, 0.0), (x * math.sin(b) / math.sin(c), math.sin(a) * math.sin(b) / math.sin(c))]


def _armed(family: str, rng: np.random.Generator) -> list[tuple[float, float]]:
    """L, T, U and plus: bars of one width, or of two."""
    w, v, h = (float(rng.uniform(*span)) for span in ((0.28, 0.38), (0.28, 0.38), (0.8, 1.2)))
    if family == "L":
        return [(0.0, 0.0), (1.0, 0.0), (1.0, w), (v, w), (v, h), (0.0, h)]
    if family == "T":
        a, b = 0.5 - 0.5 * v, 0.5 + 0.5 * v
        return [(a, 0.0), (b, 0.0), (b, h - w), (1.0, h - w), (1.0, h), (0.0, h), (0.0, h - w), (a, h - w)]
    if family == "U":
        return [(0.0, 0.0), (1.0, 0.0), (1.0, h), (1.0 - v, h), (1.0 - v, w), (v, w), (v, h), (0.0, h)]
    a, b, c, d = 0.5 - 0.5 * v, 0.5 + 0.5 * v, 0.5 * h - 0.5 * w, 0.5 * h + 0.5 * w
    upper = [(1.0, c), (1.0, d), (b, d), (b, h), (a, h), (a, d)]
    return [(a, 0.0), (b, 0.0), (b, c), *upper, (0.0, d), (0.0, c), (a, c)]


def widened(outline: Outline, gap: float) -> Outline:
    """The outline whose sides lie farther out by a gap, its corners where they meet."""
    corners = np.array(outline)
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    offsets = np.sum(normals * corners, axis=1) + gap
    pairs = zip(np.roll(normals, 1, axis=0), normals, np.roll(offsets, 1), offsets, strict=True)
    found = [np.linalg.solve(np.array([a, b]), [d, e]).tolist() for a, b, d, e in pairs]
    return tuple((x, y) for x, y in found)


def _inner(outline: Outline) -> float:
    """The radius of a largest circle inside an outline, about."""
    from shapely import Polygon, maximum_inscribed_circle

    whole = Polygon(outline)
    return float(maximum_inscribed_circle(whole, tolerance=1e-3 * math.sqrt(whole.area)).length)


def write_toml(pair: Pair, folder: Path, error: tuple[float, float] | None = None, time_limit: float = 60.0) -> Path:
    """The problem of a pair, with both of its models; the path of the problem file.

    Features are left for fmopt to find. `error`: half-widths in mm and degrees, the pair's own if not given.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "peg.toml").write_text(_peg_model(pair))
    (folder / "block.toml").write_text(_block_model(pair))
    return _write_problem(pair, folder, error or pair.error, time_limit)


def write_stl(pair: Pair, folder: Path, error: tuple[float, float] | None = None, time_limit: float = 60.0) -> Path:
    """The same with each part as a binary STL file and a model file that names it, its facets plane as drawn."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (points, triangles) in zip(("peg", "block"), meshes(pair), strict=True):
        (folder / f"{name}.stl").write_bytes(binary_stl(points, triangles))
        (folder / f"{name}.toml").write_text(of_file(f"{name}.stl", 'unit = "mm"\ndeviation = 0\n'))
    return _write_problem(pair, folder, error or pair.error, time_limit)


def write_step(pair: Pair, folder: Path, error: tuple[float, float] | None = None, time_limit: float = 60.0) -> Path:
    """The same with each part as a STEP file of plane faces and a model file that names it."""
    from fmopt.spatial.se3 import Pose, exp
    from tests.shared.files.step_parts import box, cut, write

    x, y, z = pair.block
    peg, block = _brep(pair.peg), box(x, y, z, (0.0, 0.0, -z))
    if pair.bore:
        peg = cut(peg, _brep(_proud(pair.bore, low=True)))
    block = cut(block, _brep(_proud(pair.hole, low=pair.through, high=True)))
    folder.mkdir(parents=True, exist_ok=True)
    for name, shape, placing in zip(("peg", "block"), (peg, block), pair.placings, strict=True):
        turn = exp(np.array([0.0, 0.0, math.radians(placing.turn)]))
        write(folder / f"{name}.step", shape, pose=Pose(np.array(placing.shift), turn))
        (folder / f"{name}.toml").write_text(of_file(f"{name}.step", ""))
    return _write_problem(pair, folder, error or pair.error, time_limit)


def meshes(pair: Pair) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Points (n, 3) in mm and outward triangles (m, 3) of the part with the peg and of that with the hole."""
    from manifold3d import Manifold

    peg = _solid(pair.peg)
    if pair.bore:
        peg -= _solid(_proud(pair.bore, low=True))
    x, y, z = pair.block
    block = Manifold.cube((x, y, z), True).translate((0.0, 0.0, -0.5 * z))
    block -= _solid(_proud(pair.hole, low=pair.through, high=True))
    made = []
    for body, placing in zip((peg, block), pair.placings, strict=True):
        mesh = body.rotate((0.0, 0.0, placing.turn)).translate(placing.shift).to_mesh64()
        made.append((np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, dtype=np.int64)))
    return made[0], made[1]


def _solid(stack: Stack) -> "Manifold":
    """The manifold3d solid of a stack."""
    from manifold3d import Manifold, OpType

    parts = [_loft(low, high) for low, high in _lofts(stack)]
    return Manifold.batch_boolean(parts, OpType.Add)


def _loft(low: Section, high: Section) -> "Manifold":
    from manifold3d import Manifold, Mesh64, triangulate

    n = len(low.outline)
    points = np.array([(*corner, one.at) for one in (low, high) for corner in one.outline])
    cap = np.asarray(triangulate([np.array(low.outline)]))
    walls = [t for k in range(n) for t in ((k, (k + 1) % n, n + (k + 1) % n), (k, n + (k + 1) % n, n + k))]
    triangles = np.vstack([cap[:, ::-1], np.array(walls), cap + n])
    return Manifold(Mesh64(vert_properties=points, tri_verts=triangles.astype(np.uint64)))


def _brep(stack: Stack) -> Any:
    """The solid of a stack as the CAD kernel has it: plane faces over the corners of its sections."""
    from tests.shared.files.step_parts import fuse

    bodies = [_plane_faced(low, high) for low, high in _lofts(stack)]
    return fuse(*bodies) if len(bodies) > 1 else bodies[0]


def _plane_faced(low: Section, high: Section) -> Any:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    from tests.shared.files.step_parts import wire

    below, above = ([(*corner, one.at) for corner in one.outline] for one in (low, high))
    sides = list(zip(below, below[1:] + below[:1], above[1:] + above[:1], above, strict=True))
    sewing = BRepBuilderAPI_Sewing()
    for corners in (below[::-1], above, *sides):
        sewing.Add(BRepBuilderAPI_MakeFace(wire(corners), True).Face())
    sewing.Perform()
    made = BRepBuilderAPI_MakeSolid(TopoDS.Shell(sewing.SewedShape())).Solid()
    BRepLib.OrientClosedSolid_s(made)
    return made


def _lofts(stack: Stack) -> list[tuple[Section, Section]]:
    return [(low, high) for low, high in pairwise(stack) if high.at > low.at]


def _proud(stack: Stack, low: bool = False, high: bool = False) -> Stack:
    """A stack that is to be cut away, standing out where it is to open."""
    out = 0.25 * (stack[-1].at - stack[0].at)
    below = (replace(stack[0], at=stack[0].at - out),) if low else ()
    above = (replace(stack[-1], at=stack[-1].at + out),) if high else ()
    return (*below, *stack, *above)


def _peg_model(pair: Pair) -> str:
    root = "bored" if pair.bore else "shaft"
    lines = ['name = "peg"', f'part = "{root}"', "", UNITS]
    lines += _stacked("shaft", pair.peg, () if pair.bore else _where(pair.placings[0]))
    if pair.bore:
        lines += _stacked("bore", _proud(pair.bore, low=True))
        lines += _cut("bored", "shaft", "bore", pair.placings[0])
    return "\n".join(lines)


def _block_model(pair: Pair) -> str:
    x, y, z = pair.block
    lines = ['name = "block"', 'part = "drilled"', "", UNITS]
    lines += ["[solids.block]", 'shape = "box"', f"size = [{x}, {y}, {z}]", f"at = [0, 0, {-z}]", ""]
    lines += _stacked("hole", _proud(pair.hole, low=pair.through, high=True))
    return "\n".join(lines + _cut("drilled", "block", "hole", pair.placings[1]))


def _stacked(name: str, stack: Stack, where: Sequence[str] = ()) -> list[str]:
    rows = [f"  {{ at = {one.at!r}, polygon = {[list(corner) for corner in one.outline]} }}," for one in stack]
    return [f"[solids.{name}]", 'shape = "stack"', "sections = [", *rows, "]", *where, ""]


def _cut(name: str, base: str, tool: str, placing: Placing) -> list[str]:
    return [f"[solids.{name}]", 'shape = "difference"', f'of = "{base}"', f'minus = ["{tool}"]', *_where(placing), ""]


def _where(placing: Placing) -> list[str]:
    return [f"at = {list(placing.shift)}", f"turn = [0, 0, {placing.turn}]"]


def _write_problem(pair: Pair, folder: Path, error: tuple[float, float], time_limit: float) -> Path:
    shift, turn = error
    values = {"x": pair.clearance, "y": pair.clearance, "position": shift, "angle": turn, "limit": time_limit}
    height = max(round(0.05 * pair.size, 3), 0.2)
    text = TASK.format(moving="peg", fixed="block", height=height, translation=0.01, rotation=0.01, tilt=25, **values)
    path = folder / "problem.toml"
    path.write_text(swapped(text) if pair.exchanged else text)
    return path
