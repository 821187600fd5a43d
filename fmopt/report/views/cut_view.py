"""The cut view: both parts cut through the mating axis, the moving part at every move's end, the gaps magnified."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from fmopt.plan import Numbers, Plan
from fmopt.plan.contact_geometry import Parts
from fmopt.report.bodies import CUTS, contact_place, extent, loops_of, pieces_of, section_of, upright_plane
from fmopt.report.drawing import BLUE, INK, PALE, RUST, WIDTH, Axes, Drawing, Figure, fill
from fmopt.report.moves import moves
from fmopt.report.naming import quantity
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array

if TYPE_CHECKING:
    from shapely import MultiPolygon

TITLE = (
    "Cut view: both parts cut through the mating axis, at every move's end in the plane in which the part leans; dots: "
    "contacts just made, seen across the plane"
)
_TOUCH = 1e-9  # m
_UPRIGHT = math.sin(math.radians(0.5))  # a lean below which the part counts as upright
_COLUMNS = 4
_HEADS, _ROW, _GAPS = 0.8, 2.12, 2.05  # inches: for the words above a panel, for a row of panels, for the gaps below
_PANEL = (1.43, 2.05)  # inches
_GROUND: dict[str, Any] = {"facecolor": PALE, "edgecolor": "#999999", "hatch": "////", "linewidth": 0}
_TINT: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.15, "linewidth": 0}
_LETTERS = 25  # in a line above a panel


@dataclass(frozen=True, eq=False)
class End:
    """The moving part at the end of a move: what it is called, where it is, and the contacts that were made there."""

    name: str
    pose: Pose
    made: tuple[str, ...]

    @property
    def lean(self) -> float:
        """The angle between the part's axis and that of the hole, rad."""
        return math.acos(min(1.0, float(self.pose.R[2, 2])))  # rounding may leave a little more than 1

    @property
    def azimuth(self) -> float:
        """The angle from x, rad, in [0, π), of the plane through the axis in which the part leans; 0 when upright."""
        x, y = (float(v) for v in self.pose.R[:2, 2])
        return math.atan2(y, x) % math.pi if math.hypot(x, y) > _UPRIGHT else 0.0

    @property
    def plane(self) -> str:
        """The plane in words."""
        angle = round(math.degrees(self.azimuth)) % 180  # 179.6° rounds to 180°, which is 0° again
        return "plane x–z" if angle == 0 else "plane y–z" if angle == 90 else f"{angle}° from x"


@dataclass(frozen=True, eq=False)
class _Gap:
    """A gap between the seated moving part and the fixed part: its side −1 or 1, wall, flank, and engaged heights."""

    side: int
    wall: float
    flank: float
    low: float
    high: float

    @property
    def width(self) -> float:
        return self.side * (self.wall - self.flank)

    @property
    def words(self) -> str:
        return "touching" if abs(self.width) <= _TOUCH else quantity(self.width)


def drawing(plan: Plan) -> Drawing:
    """A section for each move's end; below them the gaps in the seated pose, magnified across."""
    seated = Pose.from_vector(plan.segments[-1].goal)
    gaps = [(plane, gap) for plane in CUTS for gap in _gaps(plan, seated, CUTS[plane])]
    said = [f"{'left' if gap.side < 0 else 'right'} in {plane} {gap.words}" for plane, gap in gaps]
    attempt = attempt_drawing("cut", TITLE, plan, move_ends(plan))
    alt = attempt.alt + (f" Gaps in the goal pose: {', '.join(said)}." if said else "")
    size = WIDTH, attempt.size[1] + (_GAPS if gaps else 0.0)
    return replace(attempt, alt=alt, size=size, paint=partial(_paint, plan, gaps, size[1]))


def _paint(plan: Plan, gaps: Sequence[tuple[str, _Gap]], height: float, figure: Figure) -> None:
    _panels(plan, move_ends(plan), height, figure)
    if gaps:
        figure.text(0.01, 1.85 / height, "The gaps in the goal pose, magnified across", fontweight="bold", fontsize=9.5)
        room = {"left": 0.085, "right": 0.985, "top": 1.55 / height, "bottom": 0.45 / height, "wspace": 0.55}
        below = figure.add_gridspec(1, max(len(gaps), 4), **room)
        for number, (plane, gap) in enumerate(gaps):
            _gap_panel(figure.add_subplot(below[number]), plane, gap)


def attempt_drawing(name: str, title: str, plan: Parts, ends: Sequence[End]) -> Drawing:
    """A section for each of some poses."""
    said = "; ".join(f"{end.name}, {end.plane}, lean {_degrees(end.lean)}" for end in ends)
    alt = f"Sections of {plan.moving.name} and {plan.fixed.name} through the mating axis: {said}."
    height = -(-len(ends) // _COLUMNS) * (_HEADS + _ROW) + 0.05
    return Drawing(name, title, alt, (WIDTH, height), partial(_panels, plan, ends, height))


def _panels(plan: Parts, ends: Sequence[End], height: float, figure: Figure) -> None:
    """A section for each of some poses, from the top of a figure of a height in inches."""
    figure.set_layout_engine("none")  # by hand: half the time
    drawn = [sections(plan, end) for end in ends]
    middle, scale = _window(drawn)
    for number, (end, (peg, block)) in enumerate(zip(ends, drawn, strict=True)):
        row, column = divmod(number, _COLUMNS)
        top = height - row * (_HEADS + _ROW) - _HEADS
        left = 0.085 + column * 0.232
        axes = figure.add_axes((left, (top - _PANEL[1]) / height, _PANEL[0] / WIDTH, _PANEL[1] / height))
        _section_panel(axes, plan, end, peg, block)
        axes.set_xlim(*(1e3 * (middle[0] + sign * 0.5 * scale * _PANEL[0]) for sign in (-1, 1)))
        axes.set_ylim(*(1e3 * (middle[1] + sign * 0.5 * scale * _PANEL[1]) for sign in (-1, 1)))
        axes.set_ylabel("" if column else "z, mm")
        axes.tick_params(labelleft=column == 0, labelbottom=False, bottom=False)
        for line, (words, style) in enumerate(_head(end)):
            figure.text(left, (top + _HEADS - 0.08 - 0.14 * line) / height, words, fontsize=8.0, va="top", **style)


def _window(drawn: Sequence[tuple[MultiPolygon, MultiPolygon]]) -> tuple[Array, float]:
    """The middle (2,), m, and the scale, m an inch, of panels with all of the moving part and the fixed one's depth."""
    # An empty section has bounds that are no numbers.
    pegs, blocks = (np.array([p[k].bounds for p in drawn if not p[k].is_empty]).reshape(-1, 4) for k in (0, 1))
    both = np.vstack([pegs, blocks])
    # Across the moving part alone counts: blocks may be many times as wide.
    low, high = np.array([pegs[:, 0].min(), both[:, 1].min()]), np.array([pegs[:, 2].max(), both[:, 3].max()])
    return 0.5 * (low + high), float(np.max((high - low) * 1.06 / _PANEL))


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.1f}°"


def _head(end: End) -> list[tuple[str, dict[str, Any]]]:
    """The lines above a panel, each with its style: where, in which plane, what was made."""
    where = end.plane + (f", lean {_degrees(end.lean)}" if end.lean > _UPRIGHT else "")
    # Ids of contacts have hyphens, at which they are not to be torn apart.
    made = wrap(", ".join(end.made), _LETTERS, break_on_hyphens=False, max_lines=3, placeholder=" …")
    return [(end.name, {"fontweight": "bold"}), (where, {}), *((line, {"color": RUST}) for line in made)]


def sections(plan: Parts, end: End) -> tuple[MultiPolygon, MultiPolygon]:
    """The sections of the moving and the fixed part in the plane in which the part leans, m."""
    plane = upright_plane(end.azimuth)
    moving, fixed = (pieces_of(part) for part in (plan.moving, plan.fixed))
    return section_of(moving, end.pose, plane), section_of(fixed, Pose.identity(), plane)


def _section_panel(axes: Axes, plan: Parts, end: End, peg: MultiPolygon, block: MultiPolygon) -> None:
    for shape, inside, colour, width in ((block, _GROUND, INK, 0.8), (peg, _TINT, BLUE, 1.2)):
        loops = [1e3 * loop for loop in loops_of(shape)]
        fill(axes, loops, **inside)
        for loop in loops:
            axes.plot(*loop.T, color=colour, linewidth=width)
    to_plane = upright_plane(end.azimuth).inverse()
    places = [to_plane.apply(contact_place(plan, name, end.pose))[:2] for name in end.made]
    if places:
        axes.plot(*(1e3 * np.array(places)).T, "o", markersize=4.0, color=RUST, markeredgecolor="white", clip_on=False)


def move_ends(plan: Plan) -> list[End]:
    """The start and the end of every move."""
    return ends_of(plan.segments[0].start, [(move.segments[-1].goal, move.new) for move in moves(plan)])


def ends_of(start: Numbers, goals: Iterable[tuple[Numbers, tuple[str, ...]]]) -> list[End]:
    """The start and the end of every move, by poses (6,), m and rad, and the contacts that are made there."""
    ends = [End(f"end of move {k}", Pose.from_vector(goal), made) for k, (goal, made) in enumerate(goals, start=1)]
    return [End("start", Pose.from_vector(start), ()), *ends]


def _gaps(plan: Plan, pose: Pose, plane: Pose) -> list[_Gap]:
    """The gaps on both sides at the middle of the engaged heights; none where the parts are not side by side."""
    moving, fixed = (pieces_of(part) for part in (plan.moving, plan.fixed))
    peg, block = section_of(moving, pose, plane), section_of(fixed, Pose.identity(), plane)
    if peg.is_empty or block.is_empty:
        return []
    low, high = max(peg.bounds[1], block.bounds[1]), min(peg.bounds[3], block.bounds[3])
    if high - low <= _TOUCH:
        return []
    flanks, walls = (extent(shape, 0.5 * (low + high)) for shape in (peg, block))
    found = []
    for side, flank in ((-1, flanks[0, 0]), (1, flanks[-1, 1])) if len(flanks) else ():
        # Of material on the left the right end is the wall, and the other way round.
        beyond = [wall for wall in walls[:, 1 if side < 0 else 0] if side * (wall - flank) >= -_TOUCH]
        if beyond:
            found.append(_Gap(side, min(beyond, key=lambda wall: side * wall), flank, low, high))
    return found


def _gap_panel(axes: Axes, plane: str, gap: _Gap) -> None:
    """One gap: wall hatched, moving part tinted; the horizontal axis from the wall, in µm."""
    reach = 1.5e6 * max(gap.width, 5e-5)
    low, high = 1e3 * gap.low, 1e3 * gap.high
    flank = -gap.side * 1e6 * gap.width
    axes.axvspan(0.0, gap.side * reach, **_GROUND)
    axes.axvspan(flank, -gap.side * 2.0 * reach, **_TINT)
    axes.axvline(0.0, color=INK, linewidth=1.0)
    axes.axvline(flank, color=BLUE, linewidth=1.4)
    axes.set_xlim(*sorted((gap.side * 0.5 * reach, -gap.side * 1.5 * reach)))
    axes.set_ylim(low, high)
    axes.set_title(f"{plane}, {'left' if gap.side < 0 else 'right'}: {gap.words}", fontweight="normal")
    axes.set_xlabel(f"{plane[0]} from the wall, µm")
    axes.set_ylabel("z, mm")
