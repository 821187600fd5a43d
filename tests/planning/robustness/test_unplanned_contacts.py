"""What errors make first: friction cones and angles against brute force, factors against the true surfaces."""

import math
from typing import Any

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.contact.c_surface import Surfaces, angle_between, friction_cone
from fmopt.contact.facet_bounds import BoundTable
from fmopt.contact.primitive import near_contacts
from fmopt.geometry.csg import Box, Difference, Moved
from fmopt.geometry.part import part_of
from fmopt.planning.control.recovery import offsets, order, told_apart
from fmopt.planning.moves.moves import Move, Reached, unroll
from fmopt.planning.robustness.unplanned_contacts import LARGEST, UnplannedCandidate, images_of, unplanned_contacts
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import Specification

Array = np.ndarray[Any, np.dtype[np.float64]]
BOX = np.array([3e-4, 2e-4, 1e-4, 4e-3, 5e-3, 6e-3])
RHO = 0.014


@pytest.mark.parametrize("seed", range(4))
def test_a_friction_cone_lies_inside_coulombs_and_reaches_its_sides(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, arm, mu = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.1, 0.8)
    n /= np.linalg.norm(n)
    cone = friction_cone(n, arm, mu)
    forces = rng.exponential(size=(200, len(cone))) @ cone
    normal = forces[:, :3] @ n
    sliding = np.linalg.norm(forces[:, :3] - normal[:, None] * n, axis=1)
    assert (sliding <= mu * normal * (1.0 + 1e-12)).all()
    assert np.allclose(np.linalg.norm(cone[:, :3] - n, axis=1), mu)
    assert np.allclose(forces[:, 3:], np.cross(arm, forces[:, :3]))


@pytest.mark.parametrize("seed", range(12))
def test_the_angle_between_cones_is_the_least_that_sampling_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = (rng.normal(size=6) + 0.5 * rng.normal(size=(5, 6)) for _ in range(2))
    angle = angle_between(one, other)
    assert angle is not None
    assert angle == pytest.approx(angle_between(other, one), abs=1e-4)
    weights = rng.exponential(size=(2, 4000, 5)) * (rng.uniform(size=(2, 4000, 5)) < 0.5)
    u, v = (w @ cone for w, cone in zip(weights, (one, other), strict=True))
    u, v = (x[np.linalg.norm(x, axis=1) > 0.0] for x in (u, v))
    u, v = (x / np.linalg.norm(x, axis=1)[:, None] for x in (u, v))
    sampled = math.acos(min(float((u @ v.T).max()), 1.0))
    assert angle <= sampled + 1e-6
    assert sampled <= angle + 0.2


def test_cones_that_meet_have_no_angle_between_them_and_a_point_has_none() -> None:
    cone = friction_cone(np.array([0.0, 0.0, 1.0]), np.array([0.01, 0.0, 0.0]), 0.3)
    inside = cone.sum(axis=0)[None]
    assert angle_between(cone, inside) == pytest.approx(0.0, abs=1e-7)
    assert angle_between(cone, -inside) == pytest.approx(math.pi - math.atan(0.3), abs=0.1)
    assert angle_between(cone, np.zeros((3, 6))) is None


@pytest.fixture(scope="module")
def entered() -> tuple[Assembly, list[Claim]]:
    """A square peg that goes a little way into a roomy hole, nothing being touched."""
    at = Moved(Box((0.0226, 0.0226, 0.03)), Pose(np.array([0.0, 0.0, -0.02]), np.eye(3)))
    block = Difference(Moved(Box((0.06, 0.06, 0.03)), Pose(np.array([0.0, 0.0, -0.03]), np.eye(3))), (at,))
    assembly = Assembly(part_of("peg", Box((0.02, 0.02, 0.04))), part_of("block", block))
    turned = exp([0.05, -0.04, 0.02])
    start, goal = (Pose(np.array([1e-4, -2e-4, z]), turned) for z in (0.002, -0.004))
    begun = Reached(ErrorSet.from_box(BOX), (), ())
    found = unroll(assembly, Move(start, goal, (), ()), begun, Tolerance((0.0, 0.0), RHO), 0.02, True)
    return assembly, list(found.claims)


def value(assembly: Assembly, found: UnplannedCandidate, pose: Pose) -> tuple[float, float]:
    """The contact's distance at a pose, and how far inside its bounds it is."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    f = float(Surfaces.of([found.contact], body, fixed).values(pose)[0])
    return f, float(BoundTable.of([found.contact], body, fixed, pose).insides(pose)[0])


def off(pose: Pose, e: Array) -> Pose:
    return Pose(pose.p + e[:3], exp(e[3:]) @ pose.R)


def test_errors_below_the_least_factor_make_no_contact(entered: tuple[Assembly, list[Claim]]) -> None:
    assembly, claims = entered
    found = unplanned_contacts(assembly, claims, BOX, 0.3, RHO)
    assert 1 < len(found) <= 4
    least = found[0].factor
    assert [one.factor for one in found] == sorted(one.factor for one in found)
    assert 1.0 < least < LARGEST
    rng, body, fixed = np.random.default_rng(4), assembly.moving.polyhedron, assembly.fixed.polyhedron
    for pose in (claims[0].piece.start, claims[-1].piece.goal):
        near = near_contacts(body, fixed, pose, 0.004, 0.1)
        for _ in range(150):
            e = rng.choice([-1.0, 1.0], 6) * BOX * 0.97 * least
            there = off(pose, e)
            f = Surfaces.of(near, body, fixed).values(there)
            inside = BoundTable.of(near, body, fixed, there).insides(there)
            assert not ((f < 0.0) & (f > -1e-3) & (inside > 1e-9)).any()


def test_the_first_contact_is_made_at_its_factor(entered: tuple[Assembly, list[Claim]]) -> None:
    """Both by all errors together, at the worst corner, and by the one that does it alone."""
    assembly, claims = entered
    first = unplanned_contacts(assembly, claims, BOX, 0.3, RHO)[0]
    corner = -np.sign(first.row) * BOX
    ends = [claims[0].piece.start, *(claim.piece.goal for claim in claims)]
    for e, factor in ((corner, first.factor), *_alone(first)):
        reached = [value(assembly, first, off(pose, factor * e)) for pose in ends]
        gaps = [abs(f) for f, inside in reached if inside > -1e-4]
        assert min(gaps) < 0.03 * first.gap


def _alone(first: UnplannedCandidate) -> list[tuple[Array, float]]:
    if not first.axis:
        return []
    k = ("x", "y", "z", "rx", "ry", "rz").index(first.axis)
    assert first.axis_factor >= first.factor
    e = np.zeros(6)
    e[k] = -np.sign(first.row[k]) * BOX[k]
    return [(e, first.axis_factor)]


def test_larger_errors_come_to_contacts_sooner_in_proportion(entered: tuple[Assembly, list[Claim]]) -> None:
    assembly, _ = entered
    start, goal = entered[1][0].piece.start, entered[1][-1].piece.goal
    begun = Reached(ErrorSet.from_box(1.2 * BOX), (), ())
    larger = unroll(assembly, Move(start, goal, (), ()), begun, Tolerance((0.0, 0.0), RHO), 0.02, True).claims
    before = unplanned_contacts(assembly, entered[1], BOX, 0.3, RHO)
    after = unplanned_contacts(assembly, larger, 1.2 * BOX, 0.3, RHO)
    sooner = {one.contact.id: 1.2 * one.factor for one in after}
    assert after[0].contact.id == before[0].contact.id
    assert all(sooner[c.contact.id] == pytest.approx(c.factor, rel=1e-9) for c in before if c.contact.id in sooner)
    assert len(sooner.keys() & {one.contact.id for one in before}) > 2


def test_shifts_that_bring_the_first_contact_away_are_tried_first(entered: tuple[Assembly, list[Claim]]) -> None:
    """A part that met something too early is likely off towards it: the shift away from it comes first."""
    assembly, claims = entered
    shifts = offsets(BOX)
    found = unplanned_contacts(assembly, claims, BOX, 0.3, RHO)[:1]
    tried = order(assembly, claims, found, BOX, shifts)
    assert sorted(tried["early"]) == sorted(tried["late"]) == list(range(9))
    gains = [float(found[0].row @ (np.array(shifts[k]) / BOX)) for k in tried["early"][:-1]]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > gains[-1]
    assert tried["early"][-1] == tried["late"][-1] == 8
    assert not any(shifts[8])


def test_noise_hides_small_angles(entered: tuple[Assembly, list[Claim]]) -> None:
    assembly, claims = entered
    one = unplanned_contacts(assembly, claims, BOX, 0.3, RHO)[0]
    assert one.angle is None
    asked = Specification(0.02, 20.0, 1.0, 0.3, 2.0)
    assert told_apart(one, asked, RHO)
    for angle, told in ((0.01, False), (0.5, True), (math.pi, True)):
        made = UnplannedCandidate(one.contact, 1.0, "", math.inf, 1e-4, one.row, one.wrench, angle)
        assert told_apart(made, asked, RHO) is told


def test_images_of_start_errors_are_those_of_a_box_and_none_of_an_ellipsoid() -> None:
    box = np.where(np.arange(6) == 2, 0.0, BOX)
    axes = np.flatnonzero(box)
    assert np.array_equal(images_of(ErrorSet.from_box(box), axes), np.diag(box))
    assert not images_of(ErrorSet.from_ellipsoid(np.diag(BOX**2)), axes).any()
