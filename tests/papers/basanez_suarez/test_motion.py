"""Gross and fine motion: contacts along a path against dense samples, clearances that are safe and not overstated."""

import math
from itertools import pairwise

import numpy as np
import pytest

from fmopt.errors import GeometryError, InfeasibleError
from fmopt.papers.basanez_suarez.c_obstacle import PossibleContacts
from fmopt.papers.basanez_suarez.motion import MotionKind, classify, clearance, clearance_for_gross, possible_spans
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from tests.shared.parts.profiles import gon, notched, slot, spread
from tests.shared.planar_sampling import disc

BODY, STATIC = gon(5, 0.01, 0.2), notched()
TOTAL = spread(STATIC, 1e-3, 0.02, shape=2e-4)
POSSIBLE = PossibleContacts.between(BODY, STATIC, TOTAL)
UP = np.array([0.0, 1.0, 0.0])
NONE = Deviations(np.zeros(1), 0.0, 0.0)


def random_path(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform([-0.03, -0.03, -4.0], [0.09, 0.08, 4.0], size=(3, 3))


def along(path: np.ndarray, t: np.ndarray) -> np.ndarray:
    i = np.minimum(t.astype(int), len(path) - 2)
    return path[i] + (t - i)[:, None] * (path[i + 1] - path[i])


def test_spans_hold_every_possible_contact_and_little_else() -> None:
    rng = np.random.default_rng(1)
    tolerance = 1e-5
    for _ in range(8):
        path = random_path(rng)
        spans = possible_spans(POSSIBLE, path, tolerance)
        t = np.sort(rng.uniform(0.0, 2.0, 3000))
        gaps = POSSIBLE.gaps(along(path, t))
        listed = np.zeros(gaps.shape, dtype=bool)
        for contact, pieces in spans.items():
            for low, high in pieces:
                listed[(t >= low) & (t <= high), contact] = True
        assert np.all(listed[gaps <= 0.0])
        assert np.all(gaps[listed] <= tolerance + 1e-12)


def test_phases_tell_gross_from_fine() -> None:
    rng = np.random.default_rng(2)
    for _ in range(4):
        path = random_path(rng)
        phases = classify(path, STATIC, BODY, TOTAL, 1e-5)
        assert (phases[0].start, phases[-1].end) == (0.0, 2.0)
        assert all(one.end == other.start for one, other in pairwise(phases))
        fixed = STATIC.region((0.0, 0.0, 0.0))
        for phase in phases:
            t = rng.uniform(phase.start, phase.end, 20)
            poses = along(path, t)
            inside = POSSIBLE.contains(poses)
            assert phase.kind is MotionKind.FINE or not inside.any()
            overlaps = [BODY.region(pose).intersection(fixed).area > 0.0 for pose in poses]
            if phase.kind is not MotionKind.FINE:
                assert phase.contacts == ()
                assert set(overlaps) == {phase.kind is MotionKind.BLOCKED}
            for pose in poses:
                assert {cu.name for cu in POSSIBLE.possible(pose)} <= {cu.name for cu in phase.contacts}


def test_an_insertion_is_gross_then_fine() -> None:
    peg = Profile.of([(-0.031, 0.0), (0.031, 0.0), (0.031, 0.1), (-0.031, 0.1)])
    block = slot(0.063, 0.08, 0.05)
    total = Deviations(np.full(8, 1e-4), 2e-4, 0.002)
    phases = classify([(0.0, 0.02, 0.0), (0.0, -0.05, 0.0)], block, peg, total, 1e-6)
    assert (phases[0].kind, phases[0].contacts) == (MotionKind.GROSS, ())
    assert len(phases) == 1
    # Beside the centre by more than what is left of the clearance, contacts become possible at the mouth.
    phases = classify([(3e-4, 0.02, 0.0), (3e-4, -0.05, 0.0)], block, peg, total, 1e-6)
    assert phases[0].kind is MotionKind.GROSS
    assert {phase.kind for phase in phases[1:]} == {MotionKind.FINE}
    # At y = 0 the tip is in the mouth, eight thirtieths of the way: deviations can bring it there before.
    assert phases[0].end == pytest.approx(0.02 / 0.07, abs=0.006)
    assert phases[0].end < 0.02 / 0.07
    assert {"v1", "e1"} <= {cu.name.split("-")[0] for phase in phases for cu in phase.contacts}
    assert "v0" not in {cu.name.split("-")[0] for phase in phases[2:] for cu in phase.contacts}
    # Without uncertainty the same motion stays gross.
    (whole,) = classify([(3e-4, 0.02, 0.0), (3e-4, -0.05, 0.0)], block, peg, NONE, 1e-6)
    assert whole.kind is MotionKind.GROSS


def test_a_motion_through_the_wall_is_blocked_inside() -> None:
    body, wall = gon(4, 0.002), Profile.of([(0.0, 0.0), (0.05, 0.0), (0.05, 0.05), (0.0, 0.05)])
    phases = classify([(-0.02, 0.02, 0.3), (0.07, 0.02, 0.3)], wall, body, spread(wall, 1e-4, 0.01), 1e-6)
    kinds = [phase.kind for phase in phases if phase.kind is not MotionKind.FINE]
    assert kinds == [MotionKind.GROSS, MotionKind.BLOCKED, MotionKind.GROSS]
    assert phases[1].kind is MotionKind.FINE
    assert len(phases) > 4


def test_clearance_is_the_least_distance() -> None:
    rng = np.random.default_rng(3)
    gross = 0
    for _ in range(10):
        path = random_path(rng) + UP * 0.06
        found = clearance(POSSIBLE, path, 1e-6)
        sampled = float(POSSIBLE.gap(along(path, np.linspace(0.0, 2.0, 4001))).min())
        assert found <= sampled <= found + 1e-6 + 2e-4
        gross += found > 0.0
    assert gross >= 2


def test_clearance_keeps_off_by_what_it_says() -> None:
    wall = Profile.of([(0.0, 0.0), (0.1, 0.0), (0.1, 0.01), (0.0, 0.01)])
    body = Profile.of([(-0.005, 0.0), (0.005, 0.0), (0.005, 0.02), (-0.005, 0.02)])
    total = Deviations(np.full(4, 1e-4), 2e-4, 0.01)
    possible = PossibleContacts.between(body, wall, total)
    path = np.array([(0.03, 0.015, 0.0), (0.07, 0.015, 0.0)])
    # A corner at (±5 mm, 0) sinks by 5 mm sin ε_φ.
    drop = 0.005 * math.sin(0.01)
    assert clearance(possible, path, 1e-6) == pytest.approx(0.005 - 3e-4 - drop, abs=1.1e-6)
    off = clearance_for_gross(path - UP * 0.005, wall, body, total, (0.0, 0.02), 2e-6)
    assert off == pytest.approx(3e-4 + drop, abs=4e-6)
    assert clearance(possible, path + UP * (off - 0.005), 1e-6) > 0.0
    assert clearance_for_gross(path + UP * 0.01, wall, body, total, (0.0, 0.02), 1e-6) == 0.0


def test_a_motion_with_chosen_clearance_touches_nothing() -> None:
    rng = np.random.default_rng(4)
    path = np.array([(-0.02, 0.045, -1.0), (0.03, 0.03, 0.5), (0.08, 0.045, 2.0)])
    off = clearance_for_gross(path, STATIC, BODY, TOTAL, (0.0, 0.1), 1e-5)
    assert off > 0.005
    path = path + UP * off
    for t in rng.uniform(0.0, 2.0, 150):
        (pose,) = along(path, np.array([t]))
        q = rng.uniform(size=(3, 30))
        static = STATIC.vertices + 5e-4 * disc(q[0, :11], np.ones(11))
        shift = 5e-4 * disc(q[1, :1], np.ones(1))[0]
        actual = BODY.region((*(pose[:2] + shift), pose[2] + 0.02 * rng.choice([-1.0, 1.0])))
        assert not actual.intersects(Profile.of(static[:7], static[7:]).region((0.0, 0.0, 0.0)))


def test_refusals() -> None:
    with pytest.raises(GeometryError, match="1 waypoints"):
        clearance(POSSIBLE, [(0.0, 0.0, 0.0)], 1e-6)
    with pytest.raises(GeometryError, match="tolerance of 0"):
        clearance(POSSIBLE, np.zeros((2, 3)), 0.0)
    with pytest.raises(GeometryError, match="direction"):
        clearance_for_gross(np.zeros((2, 3)), STATIC, BODY, TOTAL, (0.0, 0.0), 1e-6)
    touching = [(0.03, 0.049, 0.0), (0.02, 0.049, 0.0)]
    with pytest.raises(InfeasibleError, match="short of gross") as raised:
        clearance_for_gross(touching, STATIC, BODY, TOTAL, (0.0, 1e-4), 1e-6)
    assert raised.value.shortfall > 0.0
    deep = [(0.045, 0.02, 0.0), (0.045, 0.021, 0.0)]
    assert clearance(POSSIBLE, deep, 1e-6) > 0.0
    with pytest.raises(InfeasibleError, match="objects overlap"):
        clearance_for_gross(deep, STATIC, BODY, TOTAL, (0.0, 1e-4), 1e-6)
