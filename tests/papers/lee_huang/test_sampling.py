"""S(t) of whole tasks against sampled poses, and switching times against a search over the turns of the cone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull
from shapely import Polygon, affinity

from fmopt.geometry.csg import Box, Solid, ring
from fmopt.papers.lee_huang.line_contact import Leg
from fmopt.papers.lee_huang.mapping import Mapping, MappingTask, task_mapping
from fmopt.papers.lee_huang.plane_freedom import spans
from fmopt.papers.lee_huang.uncertainty_zone import PLANES
from fmopt.spatial.values import Array
from tests.shared.parts.figure2 import BORE, GOAL, PEG, RHO, SPEED, START, block, hexagon
from tests.shared.parts.random_sections import loop, polygon, random_case

BALL, CONE = 1e-4, 0.012
LENGTH, HIGH = 0.05, 0.04
_AREA = 1e-13  # m², overlap up to this is rounding
_SLIDE = 0.05 * BALL  # m, more than a step along a flank that leans by the cone goes into it


@dataclass(frozen=True)
class Insertion:
    """A peg and its hole: solids, half their widths on the upright planes, outlines across; no outline when round."""

    peg: Solid
    bore: Solid
    half: tuple[tuple[float, float], tuple[float, float]]  # of peg and hole, on x-z and on y-z
    outlines: tuple[Array, Array] | None
    depth: float

    def upright(self, number: int) -> tuple[Polygon, Polygon]:
        a, b = self.half[number]
        hole = [(b, 0.0), (b, -self.depth), (-b, -self.depth), (-b, 0.0)]
        walls = Polygon([(-0.03, 0.0), (-0.03, -HIGH), (0.03, -HIGH), (0.03, 0.0), *hole])
        if self.depth >= HIGH:
            walls = Polygon([(-0.03, 0), (-0.03, -HIGH), (-b, -HIGH), (-b, 0)]).union(shapely.box(b, -HIGH, 0.03, 0))
        return shapely.box(-a, 0.0, a, LENGTH), walls


def square(depth: float) -> Insertion:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    peg, bore = Box((0.02, 0.02, LENGTH)), Box((0.0204, 0.0204, 0.06))
    return Insertion(peg, bore, ((0.01, 0.0102), (0.01, 0.0102)), (0.01 * corners, 0.0102 * corners), depth)


def round_(depth: float) -> Insertion:
    return Insertion(PEG, BORE, ((0.01, 0.0102), (0.01, 0.0102)), None, depth)


def six_sided(depth: float) -> Insertion:
    """A hexagon has flats on the plane x-z and corners on y-z."""
    flat = np.cos(np.pi / 6)
    sizes = 0.01 / flat, 0.0102 / flat
    bodies, rings = (hexagon(sizes[0], LENGTH), hexagon(sizes[1], 0.06)), [np.array(ring(size, 6)) for size in sizes]
    return Insertion(*bodies, ((0.01, 0.0102), sizes), tuple(rings), depth)


TASKS = {
    "round, through": round_(HIGH),
    "round, blind": round_(0.03),
    "square, through": square(HIGH),
    "square, blind": square(0.03),
    "hexagonal, through": six_sided(HIGH),
    "hexagonal, blind": six_sided(0.03),
}


def made_of(one: Insertion, share: float = 1.0) -> Mapping:
    box = share * np.array([BALL] * 3 + [CONE, CONE, 0.05])
    return task_mapping(MappingTask(one.peg, block(one.bore, one.depth), START, GOAL, box, SPEED, RHO))


Touches = Callable[[Array, float], bool]


def sampled_planes(one: Insertion, centre: Array) -> list[Touches]:
    """Whether a pose in ball × cone (u, v, turn in units of r, r, s) overlaps by more than so much, for each plane."""

    def upright(number: int) -> Touches:
        peg, walls = one.upright(number)

        def touches(e: Array, depth: float) -> bool:
            turned = affinity.rotate(peg, e[2] * CONE, origin=(0, 0), use_radians=True)
            moved = affinity.translate(turned, centre[number] + e[0] * BALL, centre[2] + e[1] * BALL)
            return bool(moved.intersection(walls.buffer(-depth, join_style="mitre") if depth else walls).area > _AREA)

        return touches

    reach = BALL + max(a for a, _ in one.half) * np.sin(CONE)

    def mouth(e: Array, depth: float) -> bool:
        if centre[2] > reach:
            return False
        offset = centre[:2] + e[:2] * BALL
        if one.outlines is None:
            return bool(np.hypot(*offset) + one.half[0][0] > one.half[0][1] + depth)
        peg = affinity.rotate(Polygon(one.outlines[0]), e[2] * 0.05, origin=(0, 0), use_radians=True)
        hole = Polygon(one.outlines[1]).buffer(depth, join_style="mitre")
        return bool(affinity.translate(peg, *offset).difference(hole).area > _AREA)

    return [upright(0), upright(1), mouth]


def errors_of(rng: np.random.Generator, count: int) -> Array:
    """Corners of ball × cone, then points in it."""
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 0, 1])).reshape(3, -1).T
    return np.vstack([corners, rng.uniform(-1.0, 1.0, (count, 3))])


def stopped(planes: list[Touches], rng: np.random.Generator) -> tuple[int, ...]:
    """S: which steps along a degree, from a free pose to the bound of ball × cone, run into the wall.

    S is that of the nominal flanks: a step along one that leans goes into it by less than 5 % of the ball's radius.
    """
    hit = np.zeros((6, 2), dtype=bool)
    for plane, touches in zip(PLANES, planes, strict=True):
        for e in errors_of(rng, 240):
            if touches(e, 0.0):
                continue
            for place, degree in enumerate(plane.degrees):
                for side, sign in enumerate((1.0, -1.0)):
                    column = side if place < 2 or plane.sense > 0 else 1 - side
                    if not hit[degree, column]:
                        step = np.where(np.arange(3) == place, sign, e)
                        hit[degree, column] = touches(step, 0.0 if place == 2 else _SLIDE)
    return tuple(2 if plus and minus else int(plus) - int(minus) for plus, minus in hit)


@pytest.mark.parametrize("name", TASKS)
def test_where_s_is_zero_no_sample_touches_and_where_it_is_not_some_do_in_that_direction(name: str) -> None:
    one = TASKS[name]
    made, rng = made_of(one), np.random.default_rng(0)
    first, *others = made.freedoms
    assert first.s == (0,) * 6
    for share in (0.0, 0.5, 0.9, 1.0 - 1e-9):
        planes = sampled_planes(one, made.path.at(share * first.end)[:3])
        assert not any(touches(e, 0.0) for touches in planes for e in errors_of(rng, 60))
    soon = sampled_planes(one, made.path.at(first.end + 1e-3 * made.path.duration)[:3])
    assert any(touches(e, 0.0) for touches in soon for e in errors_of(rng, 60))
    assert len(others) >= 1
    for interval in others:
        centre = made.path.at(0.5 * (interval.start + interval.end))[:3]
        assert stopped(sampled_planes(one, centre), rng) == interval.s


def test_a_smaller_trapezoid_is_refuted_by_the_same_samples() -> None:
    """Control: the samples can tell a switch that comes too late."""
    one, rng = TASKS["round, through"], np.random.default_rng(0)
    late = made_of(one, 0.9)
    planes = sampled_planes(one, late.path.at(late.freedoms[0].end)[:3])
    assert any(touches(e, 0.0) for touches in planes for e in errors_of(rng, 60))


# Switching times by a search over the turns: for one turn, the nominal centre enters GE where it enters half-planes.


def entry(own: Array, triangles: list[Array], leg: Leg, turn: float) -> float:
    """The share of a leg at which a convex section, turned and anywhere in its ball, first touches; inf for never."""
    c, s = np.cos(turn), np.sin(turn)
    square = leg.radius * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    swept = ((own @ np.array([[c, s], [-s, c]]))[:, None] + square).reshape(-1, 2)
    first = np.inf
    for corners in triangles:
        sides = ConvexHull((corners[:, None] - swept).reshape(-1, 2)).equations
        height, rate = sides[:, :2] @ leg.start + sides[:, 2], sides[:, :2] @ leg.travel
        crossing = -height / np.where(rate == 0.0, 1.0, rate)
        low = max(0.0, np.max(crossing[rate < 0.0], initial=0.0))
        high = min(1.0, np.min(crossing[rate > 0.0], initial=1.0))
        if low <= high and not np.any(height[rate == 0.0] > 0.0):
            first = min(first, low)
    return first


def first_entry(own: Array, triangles: list[Array], leg: Leg) -> float:
    """The earliest over all turns of the cone: a grid, and a search around its best places."""
    turns = np.linspace(-leg.half_angle, leg.half_angle, 81)
    values = np.array([entry(own, triangles, leg, turn) for turn in turns])
    best = float(values.min())
    for k in np.argsort(values)[:3] if best < np.inf else ():
        around = turns[max(k - 1, 0)], turns[min(k + 1, len(turns) - 1)]
        options = {"xatol": 1e-12, "maxiter": 200}
        found = minimize_scalar(
            lambda turn: min(entry(own, triangles, leg, turn), 2.0), bounds=around, method="bounded", options=options
        )
        best = min(best, float(found.fun))
    return best


def test_switching_times_on_random_diagrams_are_those_of_a_search() -> None:
    """Closed forms against a search, to 1e-9 of the leg: entering where half-planes are entered, or never."""
    met, missed = 0, 0
    for seed in range(45):
        case = random_case(seed)
        if case is None:
            continue
        own, other, leg = case
        triangles = [np.array(one.exterior.coords)[:3] for one in shapely.constrained_delaunay_triangles(other).geoms]
        expected = first_entry(loop(own), triangles, leg)
        found = min(spans(polygon(loop(own)), polygon(loop(other)), leg).start, default=np.inf)
        if expected == np.inf:
            assert found == np.inf
            missed += 1
        else:
            assert abs(found - expected) <= 1e-9
            met += 1
    assert met >= 15
    assert missed >= 15
