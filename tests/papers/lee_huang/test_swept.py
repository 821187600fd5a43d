"""The whole nominal motion against the solids: proofs agree with sampling, meetings are named and placed."""

import numpy as np
import pytest

from fmopt.errors import InterferenceError
from fmopt.geometry.clearance import deepest
from fmopt.geometry.convex_pieces import pieces
from fmopt.geometry.csg import Box, Cone, Cylinder, Difference, Sphere, Union
from fmopt.geometry.polyhedron import placed
from fmopt.papers.lee_huang.nominal_trajectory import NominalTrajectory, insertion, through
from fmopt.papers.lee_huang.shrink_expand import enclosing
from fmopt.papers.lee_huang.swept import checked, free_until, meetings
from tests.shared.parts.figure2 import at
from tests.shared.solids import contains

SPEED, RHO = 0.02, 0.014
PEG = Box((0.02, 0.02, 0.04))


def hole(depth):
    return at(Difference(Box((0.06, 0.06, 0.04)), (at(Box((0.0202, 0.0202, 0.05)), 0, 0, 0.04 - depth),)), 0, 0, -0.04)


BLOCK = hole(0.03)
DOWN = insertion([0, 0, 0.005, 0, 0, 0], [0, 0, -0.03, 0, 0, 0], SPEED, RHO)


def test_a_free_insertion_that_ends_on_the_floor_meets_nothing():
    assert meetings([("peg", PEG)], [("block", BLOCK)], DOWN) == ()


def test_too_shallow_a_hole_is_met_when_the_tip_reaches_its_floor():
    (found,) = meetings([("peg", PEG)], [("block", hole(0.02))], DOWN)
    assert found.time == pytest.approx((0.005 + 0.02) / SPEED, abs=1e-6)
    assert found.pose[2] == pytest.approx(-0.02, abs=2e-8)
    assert (found.depth, found.planes) == (pytest.approx(0.01, abs=1e-12), ("xz", "yz"))


def test_an_obstacle_off_the_three_planes_is_named_placed_and_said_to_be_off_them():
    post = at(Box((0.002, 0.002, 0.003)), 0.006, 0.007, 0.001)
    (found,) = meetings([("peg", PEG)], [("block", BLOCK), ("post", post)], DOWN)
    assert (found.moving, found.fixed, found.planes) == ("peg", "post", ())
    assert found.time == pytest.approx(0.001 / SPEED, abs=1e-6)
    assert np.all(np.abs(found.point - [0.006, 0.007, 0.0025]) <= [1e-3, 1e-3, 1.5e-3])
    with pytest.raises(InterferenceError, match=r"'peg' meets 'post' at 0\.05\d* s .* off the planes xz, y") as told:
        checked([("peg", PEG)], [("block", BLOCK), ("post", post)], DOWN)
    assert told.value.place == "post"
    assert told.value.interference == found.depth > 0.0
    checked([("peg", PEG)], [("block", BLOCK)], DOWN)


def test_an_obstacle_between_two_samples_is_not_passed_by():
    # A blade of 2 µm across a sideways leg, which steps of 10 ms pass in 200 µm strides.
    blade = at(Box((2e-6, 0.001, 0.001)), 0.0201, 0.0, 0.004)
    path = through([[-0.02, 0, 0.003], [0.02, 0, 0.003], [0.06, 0, 0.003]], np.zeros(3), np.zeros(3), SPEED, RHO)
    (found,) = meetings([("sheet", Box((1e-6, 0.02, 0.04)))], [("blade", blade)], path)
    assert path.at(found.time)[0] == pytest.approx(0.0201 - 1.5e-6, abs=3e-9)


def deepest_of_samples(moving, fixed, path, count):
    bodies, others = pieces(enclosing(moving)), pieces(enclosing(fixed))
    times = np.linspace(0.0, path.duration, count)
    return np.array([deepest([placed(b, path.pose(t)) for b in bodies], others) for t in times]), times


def turning_case(seed):
    rng = np.random.default_rng(seed)
    shifts, turns = rng.uniform(-0.03, 0.03, (2, 3)), rng.uniform(-1.0, 1.0, (2, 3))
    path = NominalTrajectory(np.hstack([shifts, turns]), np.array([0.0, 1.0]))
    post = at(Box((0.01, 0.006, 0.02)), *rng.uniform(-0.03, 0.03, 3), r=rng.uniform(-2, 2, 3))
    return Union((Box((0.004, 0.004, 0.03)), at(Box((0.015, 0.003, 0.003)), 0, 0, 0.02))), post, path


def test_a_turning_motion_is_free_exactly_where_samples_are():
    """Random poses and a random post: a free proof has no overlapping sample; a meeting begins before the first one."""
    answers = []
    for seed in range(10):
        moving, post, path = turning_case(seed)
        found = meetings([("key", moving)], [("post", post)], path)
        depths, times = deepest_of_samples(moving, post, path, 100)
        deep = times[depths > 1e-6]
        assert bool(found) == bool(deep.size)
        if found:
            assert deep[0] - times[1] <= found[0].time <= deep[0] + 1e-6
        answers.append(bool(found))
    assert 2 <= sum(answers) <= 8  # both answers were tried


def test_a_turn_that_swings_through_a_post_and_back_out_is_met():
    """Both ends are free and look alike; only the arc between them meets the post."""
    bar = at(Box((0.04, 0.004, 0.004)), 0.02, 0, 0)
    path = NominalTrajectory(np.array([[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1.2]]), np.array([0.0, 1.0]))
    (found,) = meetings([("bar", bar)], [("post", at(Box((0.002, 0.002, 0.01)), 0.03, 0.025, 0))], path)
    assert 0.2 < found.time < 0.8
    assert meetings([("bar", bar)], [("post", at(Box((0.002, 0.002, 0.01)), 0.037, 0.025, 0))], path) == ()


def test_round_solids_are_enclosed_and_round_holes_are_not_widened():
    rng = np.random.default_rng(3)
    for solid, radius in ((Cylinder(0.01, 0.02, 16), 0.01), (Cone(0.01, 0.004, 0.02, 12), 0.01)):
        angle, z = rng.uniform(0, 2 * np.pi, 400), rng.uniform(1e-6, 0.02 - 1e-6, 400)
        true = 0.999999 * (radius if isinstance(solid, Cylinder) else 0.01 - 0.3 * z)
        rim = np.column_stack([true * np.cos(angle), true * np.sin(angle), z])
        assert contains(enclosing(solid), rim).all()
        assert not contains(solid, rim).all()  # control: the inscribed polygon does not hold it
        ring = Difference(Box((0.04, 0.04, 0.02)), (solid,))
        outside = rim * np.array([1.000002, 1.000002, 1.0])
        assert contains(enclosing(ring), outside).all()


def test_balls_are_enclosed():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(400, 3))
    points *= 0.01 * 0.999999 / np.linalg.norm(points, axis=1)[:, None]
    assert contains(enclosing(Sphere(0.01, 12)), points).all()
    assert not contains(Sphere(0.01, 12), points).all()


def test_a_solid_with_nothing_round_encloses_itself_and_its_pieces_are_found_once():
    block = Difference(Box((0.03, 0.03, 0.02)), (at(Box((0.01, 0.01, 0.03)), 0.0, 0.0, 0.01),))
    assert enclosing(block) is block
    assert pieces(enclosing(block)) is pieces(block)
    assert enclosing(Difference(block, (Cylinder(0.002, 0.05, 12),))).tools[0] == Cylinder(0.002, 0.05, 12)
    whole = enclosing(Union((block, Cylinder(0.002, 0.05, 12))))
    assert whole.parts[0] is block
    assert whole.parts[1].radius > 0.002


def test_two_round_bodies_that_polygons_would_let_pass_meet():
    """Gap of the 16-gons 130 µm at their flats, of the circles 10 µm less than nothing."""
    one, other = Cylinder(0.01, 0.01, 16), at(Cylinder(0.01, 0.01, 16), 0.01999, 0, -0.02)
    path = NominalTrajectory(np.array([[0, 0, 0, 0, 0, 0], [0, 0, -0.02, 0, 0, 0]]), np.array([0.0, 1.0]))
    bodies = [placed(body, path.pose(1.0)) for body in pieces(one)]
    assert deepest(bodies, pieces(other)) < 0.0
    assert len(meetings([("one", one)], [("other", other)], path)) == 1


def test_free_until_is_the_last_node_with_room():
    path = insertion([0.001, 0, 0.02, 0.1, 0, 0.2], [0, 0, -0.03, 0, 0, 0], SPEED, RHO, turned=0.5)
    bodies = [("peg", PEG)], [("block", BLOCK)]
    assert free_until(*bodies, path, 5e-4) == path.times[1]
    assert free_until(*bodies, path, 0.02) == 0.0
    assert free_until([("peg", PEG)], [("far", at(Box((0.01, 0.01, 0.01)), 0.2, 0, 0))], path, 1e-3) == path.duration


def test_a_tight_round_peg_passes_although_the_polygons_around_it_and_in_its_hole_meet():
    peg, block = Cylinder(0.01, 0.04, 32), at(Box((0.06, 0.06, 0.04)), 0, 0, -0.04)
    bored = Difference(block, (at(Cylinder(0.01003, 0.05, 32), 0, 0, -0.03),))
    (met,) = meetings([("peg", peg)], [("block", bored)], DOWN)
    assert 0.0 < met.depth < 1e-4
    checked([("peg", peg)], [("block", bored)], DOWN)
    shallow = Difference(block, (at(Cylinder(0.01003, 0.05, 32), 0, 0, -0.02),))
    with pytest.raises(InterferenceError, match="'peg' meets 'block'"):
        checked([("peg", peg)], [("block", shallow)], DOWN)
