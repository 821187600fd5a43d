"""Jam-free ranges: agreement with the planar jamming diagram and cone programs, soundness by sampling, refusals."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from fmopt.plan import parsed
from fmopt.planning.control.bias_wrench import GuardedMove
from fmopt.planning.control.compliance_frame import twist_scale
from fmopt.planning.control.friction_cones import FrictionCones, cone_angle, least_push, plane_angle
from fmopt.planning.control.hybrid_strategy import HybridStrategy, JamMargin, hybrid_strategy, jam_free
from fmopt.report.control_tables import jamming_table, jamming_words
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import Specification
from fmopt.verify import CERTIFIED, NOT_PROVED, verify
from tests.shared.lies.mutations import claims

RHO = 0.014
SCALE = twist_scale(RHO)
SPECIFICATION = Specification(0.02, 20.0, 1.0, 0.3, 2.0)
GOAL = Pose(np.array([-1e-4, -1e-4, -0.03]), np.eye(3))


def contacts(pairs: Any, pose: Pose = GOAL) -> tuple[Array, Array]:
    """Unit wrenches (m, 6) and points (m, 3) of contacts (point, normal)."""
    points = np.array([p for p, _ in pairs], dtype=float).reshape(-1, 3)
    normals = np.array([n for _, n in pairs], dtype=float).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.hstack([normals, np.cross(points - pose.p, normals)]), points


def cones(pairs: Any, friction: float = 0.3) -> FrictionCones:
    wrenches, points = contacts(pairs)
    return FrictionCones.of(wrenches, points - GOAL.p, RHO, friction)


def generators(pairs: Any, friction: float, count: int, grown: float = 1.0) -> Array:
    """Scaled rays (6, m · count) on the friction cones, written down apart from `FrictionCones`."""
    rays = []
    for point, normal in pairs:
        n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
        t = np.linalg.svd(n[None, :])[2][1:]
        for a in np.linspace(0.0, 2.0 * math.pi, count, endpoint=False):
            f = n + friction * grown * (math.cos(a) * t[0] + math.sin(a) * t[1])
            rays.append(np.concatenate([f, np.cross(np.asarray(point) - GOAL.p, f)]) / SCALE)
    return np.array(rays).T


def balance(wrench: Array, rays: Array) -> float:
    """How short forces along rays fall of balancing a scaled wrench, as a share of it."""
    return float(nnls(rays, -wrench)[1]) / float(np.linalg.norm(wrench))


def random_pairs(rng: np.random.Generator, count: int) -> list[tuple[Array, Array]]:
    """Contacts with normals in a half-space, so that not all of them wedge."""
    normals = rng.normal(size=(count, 3)) + np.array([1.5, 1.5, 0.5])
    return [(GOAL.p + 0.015 * rng.normal(size=3), n) for n in normals]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_no_sampled_forces_balance_what_is_said_to_be_free(count: int) -> None:
    rng = np.random.default_rng(count)
    free = 0
    for _ in range(12):
        pairs = random_pairs(rng, count)
        held = cones(pairs)
        rays = generators(pairs, 0.3, 48)
        wrench = rng.normal(size=6)
        twist = held.rest(wrench)
        if not np.any(twist):
            assert balance(wrench, generators(pairs, 0.3, 48, 1.0 / math.cos(math.pi / 48))) < 2e-3
            continue
        free += 1
        assert np.min(held.opening(twist)) >= -1e-8
        angle = cone_angle(twist, wrench)
        for _ in range(10):
            aside = rng.normal(size=6)
            aside -= (aside @ wrench) / (wrench @ wrench) * wrench
            turned = wrench * math.cos(0.999 * angle) / np.linalg.norm(wrench)
            turned += aside * math.sin(0.999 * angle) / np.linalg.norm(aside)
            assert balance(turned, rays) > 0.0
    assert free


@pytest.mark.parametrize("count", [1, 2, 4, 6])
def test_ranges_end_where_friction_begins_to_balance(count: int) -> None:
    """Just below the angle of a plane no forces of polygons around the cones balance, just above it they do."""
    rng = np.random.default_rng(10 + count)
    outer = 1.0 / math.cos(math.pi / 96)
    ended = 0
    for _ in range(15):
        pairs = random_pairs(rng, count)
        held, a, d = cones(pairs), rng.normal(size=6), rng.normal(size=6)
        a /= np.linalg.norm(a)
        d -= (d @ a) * a
        d /= np.linalg.norm(d)
        twist = held.turn(a, d)
        if twist is None:
            continue
        angle = plane_angle(twist, a, d)
        for share in (0.1, 0.5, 0.9, 0.99):
            assert balance(a * math.cos(share * angle) + d * math.sin(share * angle), generators(pairs, 0.3, 48)) > 0.0
        if angle < math.pi - 0.05:
            ended += 1
            beyond = angle + 0.02
            wrench = a * math.cos(beyond) + d * math.sin(beyond)
            assert balance(wrench, generators(pairs, 0.3, 96, outer)) < 2e-3
    assert ended or count < 4


def test_rests_agree_with_cone_programs_of_another_solver() -> None:
    import cvxpy as cp

    rng = np.random.default_rng(3)
    for count in (1, 3, 6):
        held, wrench = cones(random_pairs(rng, count)), rng.normal(size=6)
        v = cp.Variable(6)
        rows = [held.normal[i] @ v >= cp.norm(held.tangent[i] @ v) for i in range(count)]
        cp.Problem(cp.Minimize(cp.sum_squares(v - wrench)), rows).solve(solver="CLARABEL")
        assert np.allclose(held.rest(wrench), v.value if np.linalg.norm(v.value) > 1e-3 else 0.0, atol=2e-4)


def two_points(depth: float, radius: float) -> list[tuple[Array, Array]]:
    """A peg tilted in the plane of x and z: its tip on the right wall, the mouth's left rim on its side."""
    tip, (x, _, z) = GOAL.p, np.eye(3)
    return [(tip - radius * x + depth * z, x), (tip + radius * x, -x)]


@pytest.mark.parametrize("ratio", [1.2, 2.0, 4.0])
@pytest.mark.parametrize("friction", [0.1, 0.3, 0.6])
def test_two_points_jam_where_the_planar_diagram_says(ratio: float, friction: float) -> None:
    """[Whitney1982]: M / r Fz = λ − μ (1 + λ) Fx / Fz bounds the region without jamming, for λ = l / 2 r μ > 1."""
    radius = 0.01
    held = cones(two_points(2.0 * radius * friction * ratio, radius), friction)
    inner = held.inner()
    assert inner is not None
    for x in np.linspace(-0.9, 0.9, 7) / friction:
        edge = ratio - friction * (1.0 + ratio) * x
        for off, jams in ((-0.01, False), (0.01, True)):
            wrench = np.array([x, 0.0, -1.0, 0.0, 0.0, 0.0])
            # A moment that turns x to z is negative about y.
            wrench[4] = -radius * (edge + off * (1.0 + ratio))
            assert (not np.any(held.rest(wrench / SCALE))) == jams


def test_two_points_wedge_when_they_see_each_other() -> None:
    """[Whitney1982]: they can where λ < 1, that is l < 2 r μ."""
    assert cones(two_points(0.9 * 2.0 * 0.01 * 0.3, 0.01)).inner() is None
    inner = cones(two_points(1.1 * 2.0 * 0.01 * 0.3, 0.01)).inner()
    assert inner is not None
    assert cones([((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ((0.002, 0.0, 0.0), (-1.0, 0.0, 0.0))]).inner() is None


def test_a_block_on_a_wall_slides_above_the_cone_of_friction() -> None:
    held = cones([(GOAL.p, (0.0, 0.0, 1.0))])
    pressing, along = np.array([0, 0, -10.0, 0, 0, 0]), np.array([1.0, 0, 0, 0, 0, 0])
    twist = held.freeing(pressing, along)
    assert twist is not None
    # A point contact rolls as well: a push with an arm turns it, one through the point has to overcome friction.
    assert least_push(twist, pressing, along) == pytest.approx(3.0, rel=1e-6)
    assert not np.any(held.rest(pressing + 2.9 * along))
    assert np.any(held.rest(pressing + 3.1 * along))


def test_symmetric_contacts_are_settled_by_the_cone_program_too() -> None:
    rng = np.random.default_rng(5)
    held, wrench = cones(random_pairs(rng, 4)), np.array([1.0, 0.3, -0.2, 0.1, 0.0, 0.4])
    found = held._opened(wrench / np.linalg.norm(wrench), 1.0, 0.0)[:6]
    rest = held.rest(wrench)
    assert np.allclose(found * float(found @ wrench), rest, atol=1e-6)
    inner = held.inner()
    assert inner is not None
    least = held._opened(np.zeros(6), 1.0, 1.0)
    assert float(np.min(held.opening(inner))) == pytest.approx(float(least[6]), rel=1e-6)


def strategy(pairs: Any, displacement: Any, made: Any = ()) -> tuple[GuardedMove, HybridStrategy, JamMargin | None]:
    wrenches, points = contacts(pairs)
    move = GuardedMove(GOAL, np.asarray(displacement, dtype=float), wrenches, points, contacts(made)[0], 1e-3)
    found = hybrid_strategy(move, RHO, SPECIFICATION)
    return move, found, jam_free(move, found, RHO, SPECIFICATION)


WALLS = [
    *[((-0.0101, y, z), (1, 0, 0)) for y in (-0.0101, 0.0099) for z in (-0.03, 0.0)],
    *[((x, -0.0101, z), (0, 1, 0)) for x in (-0.0101, 0.0099) for z in (-0.03, 0.0)],
]
FLOOR = [((x, y, -0.03), (0, 0, 1)) for x in (-0.0101, 0.0099) for y in (-0.0101, 0.0099)]
DOWN = (0, 0, -0.01, 0, 0, 0)


def test_stated_numbers_follow_from_stated_twists_and_hold_for_sampled_forces() -> None:
    _, found, free = strategy(WALLS, DOWN, FLOOR)
    assert free.push == found.push
    assert free.least_push is not None
    assert 0.0 < free.least_push < free.push
    assert 0.0 < free.angle < math.radians(30.0)
    names = {name for name, _ in free.planes}
    assert {"push", "force_axes[0]"} <= names
    held, _ = contacts(WALLS)
    for twist in free.twists:
        assert np.all(held @ twist > 0.0)
    rays, applied = generators(WALLS, 0.3, 32), found.bias_wrench / SCALE
    assert balance(applied, rays) > 0.0
    along = np.array([0, 0, -1.0, 0, 0, 0])
    short = applied - (found.push - 0.99 * free.least_push) * along
    assert balance(short, generators(WALLS, 0.3, 96, 1.0 / math.cos(math.pi / 96))) < 1e-6
    assert balance(applied - (found.push - 1.01 * free.least_push) * along, rays) > 0.0


def test_a_move_without_contact_at_its_end_is_pushed_as_hard_as_allowed() -> None:
    _, found, free = strategy(WALLS, DOWN)
    assert found.push == 0.0
    assert free.push == SPECIFICATION.contact_force
    assert free.angle > 0.0


def test_free_motion_states_nothing() -> None:
    assert strategy((), DOWN)[2] is None
    assert strategy((), DOWN, FLOOR)[2] is None


def test_angles_do_not_depend_on_the_unit_of_length() -> None:
    _, _, one = strategy(WALLS, DOWN, FLOOR)
    wrenches, points = contacts(WALLS)
    grown = Pose(10.0 * GOAL.p, GOAL.R)
    bigger = wrenches * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])
    floor = contacts(FLOOR)[0] * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])
    move = GuardedMove(grown, 10.0 * np.array(DOWN), bigger, 10.0 * points, floor, 1e-2)
    asked = Specification(0.02, 20.0, 10.0, 0.3, 2.0)
    other = jam_free(move, hybrid_strategy(move, 10.0 * RHO, asked), 10.0 * RHO, asked)
    assert other.angle == pytest.approx(one.angle, rel=1e-6)
    assert other.least_push == pytest.approx(one.least_push, rel=1e-6)


def test_the_plan_states_ranges_that_the_check_derives_again(square_peg_plan: dict[str, Any]) -> None:
    stated = [s["hybrid"].get("jam_free") for s in square_peg_plan["segments"]]
    assert [free is None for free in stated] == [not s["hybrid"]["normal_forces"] for s in square_peg_plan["segments"]]
    assert verify(square_peg_plan).verdict == CERTIFIED


def test_ranges_that_say_too_much_are_rejected(square_peg_plan: dict[str, Any]) -> None:
    changed = [(name, plan) for name, plan in claims(square_peg_plan) if "jam-free" in name or "least push" in name]
    assert len(changed) == 8
    for name, plan in changed:
        verdict = verify(plan)
        assert verdict.verdict == NOT_PROVED, name
        assert any(finding.what.startswith("jam_free") for finding in verdict.findings), name


def test_the_report_tells_the_worst_piece_of_every_move(square_peg_plan: dict[str, Any]) -> None:
    plan = parsed(square_peg_plan)
    page = jamming_table(plan)
    held = {s["move"] for s in square_peg_plan["segments"] if s["hybrid"].get("jam_free")}
    assert page.count("<tr>") == 1 + len(held)
    assert "friction can take" in page
    stated = [s["hybrid"]["jam_free"] for s in square_peg_plan["segments"] if s["hybrid"].get("jam_free")]
    free = [item["angle"] for item in stated if item["angle"] > 0.0]
    words = jamming_words(plan)
    assert f"of {len(free)} of {len(stated)} pieces that hold contacts" in words
    assert f"turned by up to {math.degrees(min(free)):.2g}°" in words
    assert "e-0" not in words + page
    assert ("may jam" in words) == (len(free) < len(stated))
    assert jamming_table(replace(plan, segments=plan.segments[:1])) == ""
