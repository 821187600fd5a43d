"""Words for the things a plan names by ids: contacts, pieces, directions, quantities."""

import math
import re
from collections.abc import Sequence

import numpy as np

from fmopt.plan import Body, Plan, StatedContact, StatedPart
from fmopt.plan.contact_geometry import Parts
from fmopt.plan.diagnostics import UnplannedContact
from fmopt.plan.position_force import AXES
from fmopt.spatial.se3 import cross
from fmopt.spatial.values import Array

# How poses and errors (6,) are read: factors from m and rad, and names with their units.
SCALES = np.repeat([1e3, math.degrees(1.0)], 3)
AXES_READ = tuple(f"{axis}, {'mm' if k < 3 else '°'}" for k, axis in enumerate(AXES))
_SAME = 1e-9  # m
_SLIGHT = 0.005  # of the greatest component of a direction
_PIECES, _EARLY = re.compile(r"(?:pieces )?(\d+)[/-](\d+)"), re.compile(r"(\S+) too early")
_ALONG = 0.94  # cosine within which a direction is called by one axis


def quantity(length: float) -> str:
    """A length with the unit that suits it: µm below a millimetre."""
    size = abs(length)
    # What rounding leaves of nothing is not worth digits.
    if 0.0 < size < 1e-9:
        return "below 0.001 µm"
    if size >= 1e-3:
        return f"{signed(1e3 * length, '.3g')} mm"
    # Whole ones from 100 µm on, where .3g would write 999.6 as 1e+03.
    return f"{signed(1e6 * length, '.3g' if size < 1e-4 else '.0f')} µm"


def signed(value: float, form: str) -> str:
    """A number in a format such as ".3f" with a true minus sign, and no minus before a zero."""
    text = format(value, form)
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def millimetres(length: float) -> str:
    """A length in mm, to 0.1 µm below 1 m, without the unit."""
    return signed(round(1e3 * length, 4) + 0.0, ".7g")


def degrees(angle: float) -> str:
    """An angle in degrees, to 1e-4 below 100°, without the unit."""
    return signed(round(math.degrees(angle), 4) + 0.0, ".6g")


def spoken_axis(vector: Array, always_signed: bool = False) -> str:
    """A direction (3,) of any length by the axes it runs along, the longest component first: "−x", "−z and +y"."""
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        return "none"
    unit = vector / size
    order = sorted(range(3), key=lambda axis: -abs(unit[axis]))
    chosen = order[:1] if abs(unit[order[0]]) >= _ALONG else [axis for axis in order if abs(unit[axis]) > 0.3]
    show = always_signed or len(chosen) > 1
    words = [(("+" if unit[axis] > 0 else "−") if show else "") + AXES[axis] for axis in chosen]
    return ", ".join(words[:-1]) + " and " + words[-1] if len(words) > 1 else words[0]


def contact_words(plan: Parts, contact: str) -> str:
    """A contact by id in words, the moving part's first: "side edge e0 touches rim edge e8 (x = −10.1 mm)"."""
    if (record := _record(plan, contact)) is None:
        return f"contact {contact} is made"
    own, other = (*contact.split("-", 1), "")[:2] if "-" in contact else (contact, contact)
    return meeting_words(plan, record, f" {own}", f" {other}")


def meeting_words(plan: Parts, record: StatedContact | UnplannedContact, own: str = "", other: str = "") -> str:
    """What touches what, by the vertices of both sides, with names for the two: "corner touches wall (y = 10 mm)"."""
    tip, wall = _points(plan.moving, record.moving), _points(plan.fixed, record.fixed)
    moved = "ball" if record.kind == "ball-face" else _moving_words(plan.moving, tip)
    return f"{moved}{own} touches {_fixed_words(wall)}{other}{_place(wall)}"


def touched_words(plan: Plan, contact: str) -> str:
    """The fixed part's feature of a contact in words: "wall f2"."""
    if (record := _record(plan, contact)) is None:
        return f"contact {contact}"
    return f"{_fixed_words(_points(plan.fixed, record.fixed))} {contact.partition('-')[2]}"


def _points(part: StatedPart, vertices: Sequence[int]) -> Array:
    return np.array([part.body.vertices[i] for i in vertices], dtype=np.float64)


def _record(plan: Parts, contact: str) -> StatedContact | None:
    return next((c for c in plan.contacts if c.id == contact), None)


def _bounds(body: Body) -> Array:
    """The least and greatest coordinates (2, 3) of a body, m."""
    return np.array([np.min(body.vertices, axis=0), np.max(body.vertices, axis=0)])


def _moving_words(part: StatedPart, points: Array) -> str:
    leading = bool(np.all(points[:, 2] <= min(vertex[2] for vertex in part.body.vertices) + _SAME))
    kind = {1: "corner", 2: "edge"}.get(len(points), "face")
    if kind == "edge" and np.all(np.abs(points[0, :2] - points[1, :2]) <= _SAME):
        return "side edge"
    return f"leading {kind}" if leading else kind


def _fixed_words(points: Array) -> str:
    # Heights are those of the hole's frame: z = 0 is the mouth, z points out of it.
    if len(points) == 1:
        return "corner"
    if len(points) == 2:
        return "rim edge" if np.all(np.abs(points[:, 2]) <= _SAME) else "edge"
    normal = cross(points, np.roll(points, -1, axis=0)).sum(axis=0)  # Newell's sum
    normal = normal / np.linalg.norm(normal)
    if abs(normal[2]) <= 1e-6:
        return "wall"
    if normal[2] >= 1.0 - 1e-6:
        return "floor" if points[0, 2] < -_SAME else "top face"
    return "sloped face" if abs(normal[2]) < 1.0 - 1e-6 else "face"


def _place(points: Array) -> str:
    """The coordinates that all points share, in mm; for an edge of the mouth z = 0 goes without saying."""
    shared = [axis for axis in range(3) if np.ptp(points[:, axis]) <= _SAME]
    if len(points) == 2 and 2 in shared and abs(points[0, 2]) <= _SAME:
        shared.remove(2)
    values = ", ".join(f"{AXES[axis]} = {millimetres(points[0, axis])} mm" for axis in shared)
    return f" ({values})" if values else ""


def binding_words(plan: Parts, binding: str) -> str:
    """What a margin is of, in words: a contact, a pair of pieces "0/3", or a contact with " too early"."""
    if pair := _PIECES.fullmatch(binding):
        sides = zip((plan.moving, plan.fixed), pair.groups(), strict=True)
        return " against ".join(_piece_words(part, int(number)) for part, number in sides)
    if early := _EARLY.fullmatch(binding):
        return f"contact {early[1]} must not be made too early"
    if any(contact.id == binding for contact in plan.contacts):
        return f"bounds of contact {binding}"
    return binding or "–"


def binding_label(plan: Plan, binding: str) -> str:
    """The same in two or three words, for figures."""
    if pair := _PIECES.fullmatch(binding):
        return f"against {_side_words(plan.fixed, int(pair[2]))}"
    early = _EARLY.fullmatch(binding)
    return f"{early[1]} made too early" if early else f"bounds of {binding}" if binding else "nothing"


def _side_words(part: StatedPart, number: int) -> str:
    """Where a convex piece of the fixed part lies, seen from the hole: "the −x side", "the floor"."""
    pieces = part.pieces
    if len(pieces) < 2 or number >= len(pieces):
        return part.name
    low, high = _bounds(pieces[number])
    # Positive where all of the piece lies beyond the axis on that side.
    gaps = {"−x": -high[0], "+x": low[0], "−y": -high[1], "+y": low[1]}
    side = max(gaps, key=lambda name: float(gaps[name]))
    return f"the {side} side" if gaps[side] > 0.0 else "the floor" if high[2] < -_SAME else f"piece {number}"


def _piece_words(part: StatedPart, number: int) -> str:
    """A convex piece by the part's name and, where there are several, the axis on which it is a slice of the part."""
    pieces = part.pieces
    if number >= len(pieces) and part.body.balls:
        return f"{part.name} ball" if len(part.body.balls) == 1 else f"{part.name} ball {number - len(pieces)}"
    if len(pieces) < 2 or number >= len(pieces):
        return part.name
    low, high = _bounds(pieces[number])
    axis = int(np.argmin((high - low) / np.subtract(*_bounds(part.body)[::-1])))
    span = f"{AXES[axis]} {millimetres(low[axis])} to {millimetres(high[axis])} mm"
    return f"{part.name} piece {number} ({span})"


def box_words(box: Sequence[float]) -> str:
    """Half-widths (6,) of errors: "x ±0.45 mm, rx ±0.45°"; those that are zero are left out."""
    said = [f"{AXES[k]} ±{millimetres(v) + ' mm' if k < 3 else degrees(v) + '°'}" for k, v in enumerate(box) if v]
    return ", ".join(said) or "none"


def pose_words(pose: Sequence[float]) -> str:
    """A pose: position in mm, rotation vector in degrees."""
    way, angle = (", ".join(form(v) for v in half) for form, half in ((millimetres, pose[:3]), (degrees, pose[3:])))
    return f"({way}) mm, turned by ({angle})°"


def combination(vector: Sequence[float], force: str = "", torque: str = "") -> str:
    """A vector (6,) as a combination of the axes: "x", "0.98 y − 0.17 rz", "−5 N z"; small ones are left out."""
    values = np.asarray(vector, dtype=np.float64)
    if values.size != 6 or not np.any(values):
        return "none"
    words = ""
    for axis, value in enumerate(values):
        if abs(value) <= 1e-4 * float(np.max(np.abs(values))):
            continue
        unit = force if axis < 3 else torque
        size = "" if abs(abs(value) - 1.0) < 1e-9 and not unit else f"{abs(value):.3g}{' ' + unit if unit else ''} "
        sign = ("−" if value < 0 else "") if not words else (" − " if value < 0 else " + ")
        words += f"{sign}{size}{AXES[axis]}"
    return words


def direction(vector: Sequence[float], scale: Array) -> str:
    """A twist or wrench (6,) by axes, its greatest part scaled by (6,) made 1, those below 0.5 % left out."""
    values = np.asarray(vector, dtype=np.float64)
    if values.size != 6 or not np.any(values):
        return "none"
    values = values * scale
    values = values / np.max(np.abs(values))
    return combination(np.where(np.abs(values) < _SLIGHT, 0.0, values).tolist())
