"""Basic contacts, their union Cc, and two contacts at once; degenerate objects are refused by name."""

import math

import numpy as np
import pytest
import shapely

from fmopt.errors import GeometryError
from fmopt.geometry.plane.curve import LineSegment
from fmopt.papers.basanez_suarez.c_obstacle import PossibleContacts
from fmopt.papers.basanez_suarez.contact import CU, ContactType, Range, basic_contacts
from fmopt.papers.basanez_suarez.edge import Case
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.sources import Deviations
from tests.shared.parts.profiles import gon, notched, slot, spread
from tests.shared.planar_sampling import deviations as sampled_deviations
from tests.shared.planar_sampling import disc, instances

NONE = Deviations(np.zeros(1), 0.0, 0.0)
EVERY = Range(-math.pi, math.pi)


def test_contacts_of_two_squares() -> None:
    square = gon(4, 1.0, 0.25 * math.pi)
    found = basic_contacts(square, square, NONE)
    assert len(found) == 32
    for cu in found:
        assert cu.nominal == cu.range
        assert cu.range.high - cu.range.low == pytest.approx(0.5 * math.pi)
    # At φ = 0 edges lie on edges: every vertex on both edges of one side, and the other way round.
    flat = [cu for cu in found if cu.range.contains(0.0)]
    turned = [cu for cu in found if cu.range.contains(0.1)]
    assert (len(flat), len(turned)) == (16, 8)


def test_every_touch_of_nominal_objects_is_a_nominal_contact() -> None:
    rng = np.random.default_rng(1)
    moving, static = gon(3, 0.01, 0.3), notched()
    possible = PossibleContacts.between(moving, static, NONE)
    fixed = static.region((0.0, 0.0, 0.0))
    for _ in range(100):
        x, y, phi = rng.uniform([-0.05, -0.05, -7.0], [0.1, 0.1, 7.0])
        # Shift it along x until it touches: bisect between free and overlapping.
        low, high = -0.2, 0.03 - x
        if not moving.region((x + high, y, phi)).intersects(fixed) or not -0.005 < y < 0.045:
            continue
        for _ in range(60):
            middle = 0.5 * (low + high)
            if moving.region((x + middle, y, phi)).intersection(fixed).area > 0.0:
                high = middle
            else:
                low = middle
        assert abs(possible.gap([(x + high, y, phi)])[0]) < 1e-9


def test_every_touch_of_deviating_objects_lies_in_cc() -> None:
    rng = np.random.default_rng(2)
    moving, static = gon(5, 0.01, 0.3), notched()
    total = spread(static, 2e-3, 0.05, shape=5e-4)
    possible = PossibleContacts.between(moving, static, total)
    touches = 0
    for _ in range(150):
        shaken = Profile.of(*(static.vertices[rows] + shift(rng, len(rows), 1e-3) for rows in (range(7), range(7, 11))))
        body = Profile.of(moving.vertices + shift(rng, 5, 5e-4))
        off = shift(rng, 1, 5e-4)[0]
        y, phi, turn = rng.uniform(0.0, 0.04), rng.uniform(-4.0, 4.0), total.angle * rng.choice([-1.0, 1.0])
        fixed, low, high = shaken.region((0.0, 0.0, 0.0)), -0.05, 0.005
        for _ in range(50):
            middle = 0.5 * (low + high)
            overlap = body.region((middle + off[0], y + off[1], phi + turn)).intersects(fixed)
            low, high = (low, middle) if overlap else (middle, high)
        if high < 0.0049:
            touches += 1
            assert possible.gap([(high, y, phi)])[0] < 1e-9
    assert touches > 100


def shift(rng: np.random.Generator, count: int, epsilon: float) -> np.ndarray:
    return epsilon * disc(rng.uniform(size=count), np.ones(count))


def test_cc_is_the_union_of_its_sets() -> None:
    rng = np.random.default_rng(3)
    static = notched()
    possible = PossibleContacts.between(gon(5, 0.01), static, spread(static, 1e-3, 0.02))
    poses = rng.uniform([-0.02, -0.02, -9.0], [0.08, 0.06, 9.0], size=(80, 3))
    by_hand = np.array([[cu.gap(pose) for cu in possible.sets] for pose in poses])
    np.testing.assert_allclose(possible.gaps(poses), by_hand, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(possible.gap(poses), by_hand.min(axis=1), rtol=0.0, atol=1e-14)
    inside = possible.contains(poses)
    assert 5 < inside.sum() < 75
    for pose, row in zip(poses[inside], by_hand[inside], strict=True):
        names = {cu.name for cu, gap in zip(possible.sets, row, strict=True) if gap <= 0.0}
        assert {cu.name for cu in possible.possible(pose)} == names
        for cu in possible.possible(pose):
            assert cu.at(pose[2]).contains(pose[:2])


@pytest.mark.parametrize(("position", "angle"), [(1e-3, 0.02), (1e-4, 0.2), (0.0, 0.0), (4e-3, 0.0), (0.0, 0.05)])
def test_polygons_of_cc_contain_it_closely(position: float, angle: float) -> None:
    rng = np.random.default_rng(4)
    static, tolerance = notched(), 5e-5
    possible = PossibleContacts.between(gon(5, 0.01), static, spread(static, position, angle))
    phi = rng.uniform(-7.0, 7.0, 6)
    for at, polygon in zip(phi, possible.polygons(phi, tolerance), strict=True):
        points = rng.uniform([-0.02, -0.02], [0.08, 0.06], size=(2000, 2))
        x = np.vstack([points, shapely.get_coordinates(shapely.segmentize(polygon, 1e-3))])
        gap = possible.gap(np.column_stack([x, np.full(len(x), at)]))
        assert np.all(shapely.distance(polygon, shapely.points(x[gap <= 0.0])) < 1e-12)
        assert np.all(gap[2000:] <= tolerance)
        assert np.all(gap[:2000][shapely.contains_xy(polygon, points)] <= tolerance)


def test_nominal_surface_lies_inside_and_is_the_limit() -> None:
    for kind, case in ((ContactType.TYPE_1, None), (ContactType.TYPE_2, Case.A), (ContactType.TYPE_2, Case.B)):
        for instance in instances(kind, case, 30, seed=41):
            nominal = instance.cu.without_uncertainty()
            (loop,) = nominal.at(instance.phi).boundary()
            assert len(loop) == 2
            assert all(isinstance(piece.curve, LineSegment) for piece in loop)
            assert nominal.at(instance.phi).area() == 0.0
            on = loop[0].curve.point(np.linspace(0.0, 1.0, 9))
            assert np.all(instance.cu.at(instance.phi).contains(on))
            for value in nominal.value_interval(np.column_stack([on, np.full(9, instance.phi)])):
                np.testing.assert_allclose(value, 0.0, atol=1e-12 * nominal.at(0.0).size)


def test_value_intervals_hold_what_deviations_make() -> None:
    rng = np.random.default_rng(5)
    for kind, case in ((ContactType.TYPE_1, None), (ContactType.TYPE_2, Case.A), (ContactType.TYPE_2, Case.B)):
        for instance in instances(kind, case, 60, seed=42):
            cu = instance.cu
            pose = np.array([*instance.configurations(rng.uniform(size=6)), instance.phi])
            low, high = cu.value_interval(pose)
            assert low <= 1e-9 * cu.reach
            assert high >= -1e-9 * cu.reach
            values = sampled_values(cu, pose, sampled_deviations(rng, 4000), instance.epsilon_p, instance.epsilon_a)
            assert low <= values.min() + 1e-12
            assert values.max() <= high + 1e-12
            assert max(values.min() - low, high - values.max()) <= 0.02 * (high - low)


def sampled_values(cu: CU, pose: np.ndarray, q: np.ndarray, epsilon_p: float, epsilon_a: float) -> np.ndarray:
    turn = pose[2] + cu.spread * (2.0 * q[:, 1] - 1.0)
    c, s = np.cos(turn), np.sin(turn)
    off = epsilon_p * disc(q[:, 2], q[:, 3]) - epsilon_a * disc(q[:, 4], q[:, 5])
    e = cu.edge[1] - cu.edge[0]
    n = np.array([e[1], -e[0]]) / math.hypot(*e)
    if cu.kind is ContactType.TYPE_1:
        x, y = cu.vertex
        return (pose[:2] + np.stack([c * x - s * y, s * x + c * y], axis=-1) + off - cu.edge[0]) @ n
    normal = np.stack([c * n[0] - s * n[1], s * n[0] + c * n[1]], axis=-1)
    return np.sum(normal * (cu.vertex - pose[:2] - off), axis=1) - cu.edge[0] @ n


@pytest.mark.parametrize("tilt", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("depth", [0.03, 0.05])
def test_two_point_contact_of_a_peg_in_a_slot(tilt: float, depth: float) -> None:
    width = 0.062
    wide = width * math.cos(tilt) + depth * math.sin(tilt)
    peg = Profile.of([(-0.5 * width, 0.0), (0.5 * width, 0.0), (0.5 * width, 0.1), (-0.5 * width, 0.1)])
    block = slot(wide, 0.09, 0.05)
    nominal = {cu.name: cu for cu in basic_contacts(peg, block, NONE)}
    corner, mouth = vertex_at(block, (-0.5 * wide, -0.09)), vertex_at(block, (0.5 * wide, 0.0))
    # Tilted to the right, the tip's left corner is on the left wall, the peg's right side on the mouth's right corner.
    wall = corner if block.vertices[block.after[corner]][1] == 0.0 else int(block.before[corner])
    sets = nominal[f"v0-e{wall}"].at(-tilt), nominal[f"e1-v{mouth}"].at(-tilt)
    lines = [shape.boundary()[0][0].curve for shape in sets]
    A = np.column_stack([lines[0].end - lines[0].start, lines[1].start - lines[1].end])
    t = np.linalg.solve(A, lines[1].start - lines[0].start)
    assert np.all((t >= 0.0) & (t <= 1.0))
    p = lines[0].point(t[0])
    for shape in sets:
        assert shape.core_distance(p) < 1e-15
    # How far the mouth's corner is up the peg's side is the engaged length.
    c, s = math.cos(tilt), math.sin(tilt)
    engaged = float((block.vertices[mouth] - p) @ np.array([s, c]))
    assert engaged == pytest.approx(depth, abs=1e-9)
    assert wide == pytest.approx(width * c + engaged * s, abs=1e-9)


def vertex_at(profile: Profile, point: tuple[float, float]) -> int:
    (found,) = np.flatnonzero(np.hypot(*(profile.vertices - point).T) < 1e-12)
    return int(found)


def test_two_point_contact_is_possible_just_within_the_deviations() -> None:
    width, tilt, depth, epsilon = 0.062, 0.1, 0.03, 2e-4
    wide = width * math.cos(tilt) + depth * math.sin(tilt)
    up, aside = np.array([math.sin(tilt), math.cos(tilt)]), np.array([math.cos(tilt), -math.sin(tilt)])
    for extra, possible in ((0.999, True), (1.001, False)):
        # The corner may be off by ε across the wall, the side by ε across itself.
        block = slot(wide + extra * epsilon * (1.0 + math.cos(tilt)), 0.09, 0.05)
        peg = Profile.of([(-0.5 * width, 0.0), (0.5 * width, 0.0), (0.5 * width, 0.1), (-0.5 * width, 0.1)])
        cus = {cu.name: cu for cu in basic_contacts(peg, block, Deviations(np.zeros(1), epsilon, 0.0))}
        inner = float(block.vertices[3][0])
        mouth, corner = vertex_at(block, (inner, 0.0)), vertex_at(block, (-inner, -0.09))
        wall = corner if block.vertices[block.after[corner]][1] == 0.0 else int(block.before[corner])
        one, other = cus[f"v0-e{wall}"].at(-tilt), cus[f"e1-v{mouth}"].at(-tilt)
        left, right = one.polygon(1e-8, "outside"), other.polygon(1e-8, "outside")
        # At the engaged depth: a line across the sets.
        centre = np.array([inner, 0.0]) - depth * up - 0.5 * width * aside
        line = shapely.LineString([centre - 0.01 * aside, centre + 0.01 * aside])
        assert left.intersection(right).intersects(line) is possible


def test_orientations_at_any_number_of_turns() -> None:
    allowed = Range(3.0, 3.5)
    for turn in (-4.0 * math.pi, 0.0, 2.0 * math.pi):
        assert allowed.contains(3.2 + turn)
        assert allowed.contains(3.0 + turn)
        assert not allowed.contains(2.99 + turn)
        assert not allowed.contains(3.51 + turn)
    assert np.all(EVERY.contains(np.linspace(-20.0, 20.0, 99)))


def test_deviations_larger_than_edges_allow_every_orientation() -> None:
    square = gon(4, 0.01)
    total = Deviations(np.full(4, 0.01), 0.001, 0.0)
    assert all(cu.range == EVERY for cu in basic_contacts(square, square, total))


def test_a_corner_that_deviations_make_convex_counts() -> None:
    bent = Profile.of([(0.0, 0.0), (0.02, 0.0), (0.02, 0.02), (0.01, 0.0195), (0.0, 0.02)])
    static = gon(4, 0.05)
    (reflex,) = np.flatnonzero(bent.turns < 0.0)
    for epsilon, counted in ((1e-5, False), (1e-3, True)):
        found = basic_contacts(bent, static, Deviations(np.zeros(1), epsilon, 0.0, epsilon))
        mine = [cu for cu in found if cu.kind is ContactType.TYPE_1 and cu.moving == reflex]
        assert bool(mine) is counted
        assert all(cu.nominal is None and cu.without_uncertainty() is None for cu in mine)


def test_collinear_vertices_and_axis_parallel_edges() -> None:
    plain = Profile.of([(0.0, 0.0), (0.02, 0.0), (0.02, 0.01), (0.0, 0.01)])
    split = Profile.of([(0.0, 0.0), (0.01, 0.0), (0.02, 0.0), (0.02, 0.01), (0.0, 0.01)])
    static, rng = gon(6, 0.03), np.random.default_rng(6)
    total = spread(static, 5e-4, 0.01)
    one, other = (PossibleContacts.between(body, static, total) for body in (plain, split))
    poses = rng.uniform([-0.06, -0.06, -4.0], [0.06, 0.06, 4.0], size=(500, 3))
    # A vertex in the middle of an edge adds nothing where its neighbours' edges already are.
    np.testing.assert_allclose(one.gap(poses), other.gap(poses), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        ([(0.0, 0.0), (1.0, 0.0)], "fewer than three"),
        ([(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)], "edge 1 .* has no length"),
        ([(0.0, 0.0), (1.0, 0.0), (0.5, 0.0), (0.5, 1.0)], "vertex 1 fold back"),
        ([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)], "enclose -0.5"),
        ([(1.0, 1.0), (1.0, 1.0), (1.0, 1.0)], "has no length"),
    ],
)
def test_degenerate_objects_are_refused(loop: list[tuple[float, float]], message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        Profile.of(loop)


def test_refusals() -> None:
    possible = PossibleContacts.between(gon(3, 1.0), gon(4, 1.0), NONE)
    with pytest.raises(GeometryError, match="tolerance of -1"):
        possible.polygons(0.0, -1.0)
    with pytest.raises(ValueError, match="position is -1"):
        Deviations(np.zeros(4), -1.0, 0.0)
    with pytest.raises(ValueError, match="type-1"):
        possible.sets[-1].point_contact(0.0, 0.5)


def test_cuv_is_cul_of_one_point() -> None:
    for instance in instances(ContactType.TYPE_1, None, 20, seed=43):
        cul = instance.cu.at(instance.phi)
        for k in (0.0, 0.3, 1.0):
            cuv = instance.cu.point_contact(instance.phi, k)
            on = np.vstack([piece.curve.point(np.linspace(0.0, 1.0, 5)) for loop in cuv.boundary() for piece in loop])
            assert np.all(cul.contains(on))
