"""S(t) from the cut-diagrams: known by hand, against sampled poses on each plane, and against S(t) in space."""

from itertools import pairwise

import numpy as np
import pytest
from shapely import Polygon, affinity

from fmopt.errors import GeometryError
from fmopt.geometry.csg import Box, Difference
from fmopt.geometry.part import part_of
from fmopt.geometry.plane.curve import Arc
from fmopt.geometry.plane.region import Region, polygon_region
from fmopt.papers.lee_huang.diagram import of_region
from fmopt.papers.lee_huang.freedom import freedom, half_widths
from fmopt.papers.lee_huang.line_contact import Leg
from fmopt.papers.lee_huang.nominal_trajectory import insertion
from fmopt.papers.lee_huang.plane_freedom import OperandSlice, PlaneView, freedom_on_planes, spans
from fmopt.papers.lee_huang.uncertainty_zone import PLANES, zones
from tests.shared.parts.figure2 import agree, at, steps
from tests.shared.parts.random_sections import loop, polygon, random_case

FREE = (0,) * 6
PEG, HOLE, LONG = 0.01, 0.0101, 0.04
DOWN = insertion([0, 0, 0.005, 0, 0, 0], [0, 0, -0.03, 0, 0, 0], 0.02, 0.014)


def square(a):
    return [(-a, -a), (a, -a), (a, a), (-a, a)]


def upright(a, h):
    return [(-a, 0.0), (a, 0.0), (a, h), (-a, h)]


BLIND = [(-0.03, -0.04), (0.03, -0.04), (0.03, 0), (HOLE, 0), (HOLE, -0.03), (-HOLE, -0.03), (-HOLE, 0), (-0.03, 0)]
SIDES = [[(s * 0.03, -0.04), (s * HOLE, -0.04), (s * HOLE, 0.0), (s * 0.03, 0.0)] for s in (-1, 1)]
THROUGH = [SIDES[0], SIDES[1][::-1]]


def round_region(radius, sense=1.0):
    """A disc, or with a sense of −1 its hole."""
    return Region(((Arc(np.zeros(2), radius, 0.0, sense * 2.0 * np.pi),),))


def views(box, walls=(BLIND,), round_peg=False):
    bored = Region((*polygon_region(square(0.03)).loops, *round_region(HOLE, -1.0).loops))
    around = of_region(bored) if round_peg else MOUTH
    own = of_region(round_region(PEG)) if round_peg else polygon(square(PEG))
    zx, zy, zz = zones(box)
    side = polygon(*walls), (OperandSlice(polygon(upright(PEG, LONG))),)
    return PlaneView(zx, *side), PlaneView(zy, *side), PlaneView(zz, around, (OperandSlice(own, (0.0, LONG)),))


MOUTH = polygon(square(0.03), square(HOLE)[::-1])


def test_without_error_only_the_goal_touches():
    last = freedom_on_planes(views(np.zeros(6)), DOWN)[-1]
    assert last.s == (0, 0, -1, 2, 2, 0)
    assert last.start == last.end == DOWN.duration


def test_intervals_cover_the_trajectory_and_differ():
    found = freedom_on_planes(views(half_widths(3e-4, 0.005)), DOWN)
    assert (found[0].start, found[-1].end) == (0.0, DOWN.duration)
    for one, other in pairwise(found):
        assert one.end == other.start
        assert one.s != other.s


@pytest.mark.parametrize(("side", "s"), [(1, (1, 0, 0, 0, 1, 0)), (-1, (-1, 0, 0, 0, -1, 0))])
def test_signs_name_the_motion_that_is_stopped(side, s):
    wall = [(side * 0.0101, -0.04), (side * 0.03, -0.04), (side * 0.03, 0.0), (side * 0.0101, 0.0)]
    wall = wall if side > 0 else wall[::-1]
    (xz, *_) = views(half_widths(2e-4, 0.0), (wall,))
    assert freedom_on_planes([xz], DOWN)[-1].s == s
    yz = PlaneView(zones(half_widths(2e-4, 0.0))[1], xz.fixed, xz.moving)
    assert freedom_on_planes([yz], DOWN)[-1].s == (0, s[0], 0, -s[4], 0, 0)


def test_a_round_peg_touches_a_round_hole_where_the_corner_of_the_ball_does():
    """The ball is a square: on the plane of the mouth it reaches r √2, so that r = 0.8 c is enough."""
    clear = HOLE - PEG
    for share, stopped in ((0.69, 0), (0.72, 2)):
        (*_, xy) = views(half_widths(share * clear, 0.0), THROUGH, round_peg=True)
        found = freedom_on_planes([xy], DOWN)
        assert found[-1].s == (stopped, stopped, 0, 0, 0, 0)


def test_a_part_that_still_turns_near_the_mouth_is_refused_and_one_that_is_clear_is_not():
    turning = insertion([0, 0, 0.02, 0.1, 0, 0], [0, 0, -0.03, 0, 0, 0], 0.02, 0.014, turned=0.5)
    box = half_widths(2e-4, 0.0)
    with pytest.raises(GeometryError, match=r"turns until .* clear of operand 2 until 0 s"):
        freedom_on_planes(views(box), turning)
    found = freedom_on_planes(views(box), turning, free_until=float(turning.times[1]))
    assert steps(found, turning)[1][1] == pytest.approx(2e-4, abs=1e-12)


# Against samples: random sections, random diagrams, random legs.


def touches(own, other, leg, share, rng, count):
    """Whether a sampled pose overlaps: corners of ball and cone first, then random ones."""
    centre = leg.start + share * leg.travel
    errors = np.array(np.meshgrid([-1, 1], [-1, 1], np.linspace(-1, 1, 9))).reshape(3, -1).T
    errors = np.vstack([errors, rng.uniform(-1.0, 1.0, (count, 3))])
    for u, v, w in errors:
        turned = affinity.rotate(own, w * leg.half_angle, origin=(0, 0), use_radians=True)
        moved = affinity.translate(turned, centre[0] + u * leg.radius, centre[1] + v * leg.radius)
        if moved.intersection(other).area > 1e-12:
            return True
    return False


@pytest.mark.parametrize("group", range(2))
def test_on_random_diagrams_the_switch_to_contact_is_where_samples_have_it(group):
    """Before the first switch no sampled pose touches; just after it nearly always some does, in its middle always."""
    seen, soon = 0, 0
    for seed in range(30 * group, 30 * group + 30):
        case = random_case(seed)
        rng = np.random.default_rng(seed)
        if case is None or touches(case[0], case[1], case[2], 0.0, rng, 30):
            continue
        own, other, leg = case
        found = spans(polygon(loop(own)), polygon(loop(other)), leg)
        first = min(found.start, default=None)
        for share in np.linspace(0.0, 1.0, 9) if first is None else first * np.linspace(0.0, 1.0 - 1e-9, 5):
            assert not touches(own, other, leg, share, rng, 40)
        start, end = max(zip(found.start, found.end, strict=True), key=np.ptp, default=(0.0, 0.0))
        if end - start > 0.05:
            assert touches(own, other, leg, 0.5 * (start + end), rng, 600)
            seen += 1
            soon += touches(own, other, leg, first + 0.02, rng, 400)
    assert seen >= 3
    assert soon >= 0.75 * seen


def test_a_smaller_cone_is_refuted_by_the_same_samples():
    """Control: the samples above can tell a wrong answer."""
    refuted = 0
    for seed in range(40):
        case = random_case(seed)
        rng = np.random.default_rng(seed)
        if case is None or case[2].half_angle < 0.1 or touches(case[0], case[1], case[2], 0.0, rng, 30):
            continue
        own, other, leg = case
        small = Leg(leg.start, leg.travel, leg.radius, 0.3 * leg.half_angle, leg.size)
        first = min(spans(polygon(loop(own)), polygon(loop(other)), small).start, default=0.0)
        if first > 0.0:
            refuted += touches(own, other, leg, first, rng, 200)
    assert refuted >= 2


def test_the_stopped_motions_are_those_that_run_into_the_wall():
    """From a free pose, a step along a degree inside ball and cone overlaps, in the directions of s and no others."""
    box = half_widths(2e-4, 0.004)
    interval = next(one for one in freedom_on_planes(views(box), DOWN) if one.s == (2, 2, 0, 2, 2, 2))
    height = DOWN.at(0.5 * (interval.start + interval.end))[2]
    peg, block = Polygon(upright(PEG, LONG)), Polygon(BLIND)
    hit, rng = np.zeros((3, 2), dtype=bool), np.random.default_rng(0)

    def free(u, v, w):
        turned = affinity.rotate(peg, w, origin=(0, 0), use_radians=True)
        return affinity.translate(turned, u, height + v).intersection(block).area < 1e-13

    for _ in range(300):
        e = rng.uniform(-1.0, 1.0, 3) * [2e-4, 2e-4, 0.004]
        e[2] *= rng.integers(0, 2)
        if free(*e):
            for degree in range(3):
                for side, sign in enumerate((1.0, -1.0)):
                    if degree == 2 or e[2] == 0.0:
                        moved = e.copy()
                        moved[degree] = sign * (0.004 if degree == 2 else 2e-4)
                        hit[degree, side] |= not free(*moved)
    assert np.array_equal(hit, [[True, True], [False, False], [True, True]])


# Against S(t) in space.


PEG_3D = part_of("peg", Box((2 * PEG, 2 * PEG, LONG)))
BLOCK_3D = part_of(
    "block", at(Difference(Box((0.06, 0.06, 0.04)), (at(Box((0.0202, 0.0202, 0.05)), 0, 0, 0.01),)), 0, 0, -0.04)
)


@pytest.mark.parametrize("r", [2e-4, 5e-5, 0.0])
def test_agrees_with_space_when_only_the_position_is_uncertain(r):
    flat = freedom_on_planes(views(half_widths(r, 0.0)), DOWN)
    agree(steps(flat, DOWN), steps(freedom(PEG_3D, BLOCK_3D, DOWN, half_widths(r, 0.0)), DOWN))


def test_with_tilts_space_sees_contact_no_later_than_the_planes_do():
    """In space the peg tilts about two axes at once and lifts its corners by both; a plane shows one tilt at a time."""
    box = half_widths(2e-4, 0.004)
    flat, space = freedom_on_planes(views(box), DOWN)[0], freedom(PEG_3D, BLOCK_3D, DOWN, box)[0]
    assert flat.s == space.s == FREE
    assert space.end < flat.end


def test_a_post_off_the_planes_is_seen_in_space_only():
    """Why the plan has S(t) from space: on the planes this post does not exist."""
    post = part_of("post", at(Box((0.001, 0.001, 0.01)), 0.0104, 0.0104, -0.01))
    box = half_widths(5e-4, 0.0)
    assert any(one.s != FREE for one in freedom(PEG_3D, post, DOWN, box))
    empty = of_region(Region(()))
    zx, zy, zz = zones(box)
    corner = polygon([(0.0099, 0.0099), (0.0109, 0.0099), (0.0109, 0.0109), (0.0099, 0.0109)])
    own = OperandSlice(polygon(upright(PEG, LONG)))
    flat = freedom_on_planes([PlaneView(zx, empty, (own,)), PlaneView(zy, empty, (own,))], DOWN)
    assert [one.s for one in flat] == [FREE]
    below = [PlaneView(zz, corner, (OperandSlice(polygon(square(PEG)), (0.0, LONG)),))]
    assert freedom_on_planes(below, DOWN)[-1].s[0] == 1  # the plane of the mouth would, were the post as high as it


def test_planes_are_right_handed_as_their_senses_say():
    for plane in PLANES:
        turned = np.cross(np.eye(3)[plane.u], np.eye(3)[plane.v])
        assert turned[plane.turn - 3] == plane.sense


def test_a_box_that_is_no_cube_touches_sooner_on_the_planes_than_in_space():
    """The paper's ball has one radius a plane: an error of x alone is taken for one of z as well."""
    box = np.array([3e-4, 3e-4, 0.0, 0.0, 0.0, 0.0])
    flat, space = freedom_on_planes(views(box), DOWN)[0], freedom(PEG_3D, BLOCK_3D, DOWN, box)[0]
    assert DOWN.at(flat.end)[2] == pytest.approx(3e-4, abs=1e-11)
    assert DOWN.at(space.end)[2] == pytest.approx(0.0, abs=1e-11)
