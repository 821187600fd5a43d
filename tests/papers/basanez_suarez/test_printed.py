"""Formulas that [BasanezSuarez] prints wrongly, as positive controls: sampled deviations must refute each of them."""

import math

import numpy as np
import pytest

from fmopt.papers.basanez_suarez.contact import CU, FULL, ContactType, Range, basic_contacts
from fmopt.papers.basanez_suarez.edge import Case
from fmopt.papers.basanez_suarez.profile import Profile
from fmopt.papers.basanez_suarez.reach import Reach
from fmopt.papers.basanez_suarez.sources import Deviations, edge_turn
from fmopt.papers.basanez_suarez.vertex import ArcSum
from tests.shared.planar_sampling import Instance, deviations, instances

ORIGIN = np.zeros(2)
EVERY = Range(-math.pi, math.pi)


def printed_gamma(p_g: float, v: float, angle: float) -> float:
    """Eq. (9)."""
    return math.asin(v / Reach.from_grasp(p_g, v, angle).h * math.sin(angle))


def printed_lines(cu: CU, phi: float, epsilon: float, sign: float = 1.0) -> tuple[float, float]:
    """d_e and d_i of eqs. (25)-(30), the cosine's sign as printed or turned about."""
    e = cu.edge[1] - cu.edge[0]
    polar = Reach.of(cu.vertex)
    turn = math.remainder(math.atan2(-e[0], e[1]) - phi - polar.gamma, FULL)
    eta = math.copysign(1.0, turn)
    d_e = sign * polar.h * math.cos(turn + eta * cu.spread) + epsilon
    d_i = sign * polar.h * math.cos(turn - eta * cu.spread) - epsilon
    if math.pi - abs(turn) < cu.spread:
        d_e = polar.h + epsilon
    if abs(turn) < cu.spread:
        d_i = -(polar.h + epsilon)
    return d_e, d_i


def lines(cu: CU, phi: float) -> tuple[float, float]:
    """d_e and d_i from the support function of CUl."""
    e = cu.edge[1] - cu.edge[0]
    n = np.array([e[1], -e[0]]) / math.hypot(*e)
    shape, at = cu.at(phi), float(n @ cu.edge[0])
    return float(shape.support(n)) - at, -float(shape.support(-n)) - at


def sampled_lines(instance: Instance, rng: np.random.Generator) -> tuple[float, float]:
    e = instance.cu.edge[1] - instance.cu.edge[0]
    heights = instance.configurations(deviations(rng, 20_000)) - instance.cu.edge[0]
    heights = heights @ (np.array([e[1], -e[0]]) / math.hypot(*e))
    return float(heights.max()), float(heights.min())


def test_gamma_of_every_quadrant() -> None:
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(200):
        p_g, v, angle = rng.uniform([0.1, 0.1, -math.pi], [1.0, 1.0, math.pi]).tolist()
        point = np.array([p_g + v * math.cos(angle), v * math.sin(angle)])
        polar = Reach.from_grasp(p_g, v, angle)
        np.testing.assert_allclose(polar.point(0.0), point, atol=1e-14)
        assert polar.h == pytest.approx(math.sqrt(p_g**2 + v**2 + 2.0 * p_g * v * math.cos(angle)), rel=1e-12)
        wrong += np.hypot(*(Reach(polar.h, printed_gamma(p_g, v, angle)).point(0.0) - point)) > 1e-3
        assert (point[0] < 0.0) == (abs(polar.gamma) > 0.5 * math.pi)
    assert wrong > 20


def test_tangent_lines_of_the_example() -> None:
    # h = 5, ε = 0.1, ε_φ = 0.05, angle of the vertex less that of the normal −1.2 − π/2.
    edge = np.array([[0.0, 0.0], [-1.0, 0.0]])
    angle = -1.2 - 0.5 * math.pi
    cu = CU(ContactType.TYPE_1, 0, 0, edge, Reach(5.0, 0.5 * math.pi).point(0.0), EVERY, EVERY, 0.05, 0.1)
    instance = Instance(cu, angle, 0.1, 0.0)
    sampled = sampled_lines(instance, np.random.default_rng(2))
    np.testing.assert_allclose(sampled, (4.845, 4.464), atol=6e-4)
    np.testing.assert_allclose(lines(cu, angle), (4.845, 4.464), atol=6e-4)
    np.testing.assert_allclose(printed_lines(cu, angle, 0.1), (-4.645, -4.664), atol=6e-4)


def test_tangent_lines() -> None:
    rng = np.random.default_rng(3)
    flagged = 0
    for instance in instances(ContactType.TYPE_1, None, 200, seed=31):
        cu = instance.cu
        right, sampled = lines(cu, instance.phi), sampled_lines(instance, rng)
        slack = 1e-9 * cu.at(instance.phi).size
        assert right[0] >= sampled[0] - slack
        assert right[1] <= sampled[1] + slack
        assert max(right[0] - sampled[0], sampled[1] - right[1]) <= 0.05 * instance.uncertainty
        printed = printed_lines(cu, instance.phi, cu.radius)
        flagged += printed[0] < sampled[0] - 1e-3 * cu.radius or printed[1] > sampled[1] + 1e-3 * cu.radius
        # With the cosine's sign right the rule of η and the special cases are right too.
        turned = printed_lines(cu, instance.phi, cu.radius, sign=-1.0)
        np.testing.assert_allclose(right, turned, rtol=0.0, atol=1e-12 * cu.at(instance.phi).size)
    assert flagged > 100


def shaken(profile: Profile, epsilon: float, rng: np.random.Generator) -> Profile:
    """The object with each vertex moved by ε, in a random direction or across one of its edges."""
    n = len(profile.vertices)
    theta = rng.uniform(-math.pi, math.pi, n)
    across = np.where(rng.uniform(size=n) < 0.5, profile.normals, profile.normals[profile.before])
    theta = np.where(rng.uniform(size=n) < 0.7, across + math.pi * rng.integers(0, 2, n), theta)
    return Profile.of(profile.vertices + epsilon * np.stack([np.cos(theta), np.sin(theta)], axis=-1))


def triangle(rng: np.random.Generator) -> Profile:
    theta = np.sort(rng.uniform(0.0, 0.6, 3) + 2.0 * math.pi / 3.0 * np.arange(3))
    return Profile.of(rng.uniform(0.8, 1.2) * np.stack([np.cos(theta), np.sin(theta)], axis=-1) + rng.normal(size=2))


def tilted(cu: CU, moving: Profile, static: Profile, total: Deviations, end: float) -> tuple[Profile, Profile]:
    """Both objects with the edges that limit the contact's orientations, the lower end for 1, turned all the way."""
    if cu.kind is ContactType.TYPE_1:
        one, other = cu.moving if end > 0.0 else moving.before[cu.moving], cu.static
    else:
        one, other = cu.moving, static.before[cu.static] if end > 0.0 else cu.static
    epsilon_a = float(total.static[0])
    return turned_edge(moving, int(one), total.shape, end), turned_edge(static, int(other), epsilon_a, -end)


def turned_edge(profile: Profile, edge: int, epsilon: float, sign: float) -> Profile:
    """The object with the ends of an edge moved by ε each, against each other, across the edge as it is then."""
    turn = sign * math.asin(2.0 * epsilon / profile.lengths[edge])
    theta = profile.normals[edge] + turn
    shift = math.copysign(epsilon, sign) * np.array([math.cos(theta), math.sin(theta)])
    vertices = profile.vertices.copy()
    vertices[edge] += shift
    vertices[profile.after[edge]] -= shift
    return Profile.of(vertices)


def sampled_range(cu: CU, moving: Profile, static: Profile, angle: float) -> tuple[float, float]:
    """Orientations of the contact between two deviating objects at a deviating angle, near the nominal ones."""
    if cu.kind is ContactType.TYPE_1:
        high = static.normals[cu.static] + math.pi - moving.normals[moving.before[cu.moving]]
        low = static.normals[cu.static] + math.pi - moving.normals[cu.moving]
    else:
        high = static.normals[cu.static] - math.pi - moving.normals[cu.moving]
        low = static.normals[static.before[cu.static]] - math.pi - moving.normals[cu.moving]
    return (
        cu.nominal.low + math.remainder(float(low) - angle - cu.nominal.low, FULL),
        cu.nominal.high + math.remainder(float(high) - angle - cu.nominal.high, FULL),
    )


def printed_range(cu: CU, moving: Profile, static: Profile, epsilon_a: float, both: tuple[float, float]) -> list[Range]:
    """Eqs. (31)-(34) or (42)-(45), as printed, and with the minimum at the lower end."""
    if cu.kind is ContactType.TYPE_1:
        lengths = static.lengths[cu.static], moving.lengths[moving.before[cu.moving]], moving.lengths[cu.moving]
        below = above = 2.0 * epsilon_a / lengths[0] + sum(both)
        below, above = below + 2.0 * epsilon_a / lengths[1], above + 2.0 * epsilon_a / lengths[2]
    else:
        lengths = static.lengths[static.before[cu.static]], static.lengths[cu.static], moving.lengths[cu.moving]
        below = above = sum(2.0 * epsilon_a / length for length in lengths) + both[1]
    low, high = cu.nominal.low, cu.nominal.high
    return [Range(high - below, high + above), Range(low - below, high + above)]


@pytest.mark.parametrize("kind", list(ContactType))
def test_orientations(kind: ContactType) -> None:
    rng = np.random.default_rng(5)
    flagged = np.zeros(2)
    for _ in range(12):
        moving, static = triangle(rng), triangle(rng)
        epsilon_v, epsilon_a = rng.uniform(0.0, 0.3, 2).tolist()
        angles = (0.3, 0.02)  # ε_φr, ε_φg
        total = Deviations(np.full(3, epsilon_a), epsilon_v, sum(angles), epsilon_v)
        cus = [cu for cu in basic_contacts(moving, static, total) if cu.kind is kind]
        assert len(cus) == 9
        ends = {cu.name: np.array([math.inf, -math.inf]) for cu in cus}
        for _ in range(60):
            one, other = shaken(moving, epsilon_v, rng), shaken(static, epsilon_a, rng)
            angle = sum(angles) * float(rng.choice([-1.0, 1.0]))
            for cu in cus:
                low, high = sampled_range(cu, one, other, angle)
                assert cu.range.low - 1e-9 <= low
                assert high <= cu.range.high + 1e-9
                ends[cu.name] = np.array([min(ends[cu.name][0], low), max(ends[cu.name][1], high)])
        for cu in cus:
            low, high = ends[cu.name]
            far = [sampled_range(cu, *tilted(cu, moving, static, total, end), end * sum(angles)) for end in (1.0, -1.0)]
            assert far[0][0] == pytest.approx(cu.range.low, abs=1e-9)
            assert far[1][1] == pytest.approx(cu.range.high, abs=1e-9)
            low, high = min(low, far[0][0]), max(high, far[1][1])
            for i, printed in enumerate(printed_range(cu, moving, static, epsilon_a, angles)):
                flagged[i] += low < printed.low - 1e-6 or high > printed.high + 1e-6
    assert np.all(flagged > 20)


def test_turn_of_an_edge_whose_ends_move() -> None:
    theta = np.linspace(-math.pi, math.pi, 721)
    shift = 0.2 * np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    edges = np.array([1.0, 0.0]) + shift[:, None] - shift
    turn = np.abs(np.arctan2(edges[..., 1], edges[..., 0])).max()
    assert 0.4 < 0.41 < turn <= edge_turn(0.2, 1.0) + 1e-15
    assert turn == pytest.approx(edge_turn(0.2, 1.0), abs=1e-4)
    assert edge_turn(0.5, 1.0) == math.pi
    assert edge_turn(0.0, 1.0) == 0.0


def test_case_a_as_printed_leaves_contacts_out() -> None:
    for instance in instances(ContactType.TYPE_2, Case.A, 100, seed=32):
        cu = instance.cu
        e = cu.edge[1] - cu.edge[0]
        k = -float(cu.edge[0] @ e) / float(e @ e)
        foot = cu.edge[0] + k * e
        d = math.hypot(*foot)
        if d <= cu.radius:
            continue
        # A contact of the foot without a turn, at the limit of the deviations of position.
        q = np.array([k, 0.5, 0.0, 1.0, 0.0, 1.0])
        outward = math.atan2(foot[1], foot[0]) + instance.phi
        q[2], q[4] = np.mod(np.array([outward + math.pi, outward]) / (2.0 * math.pi), 1.0)
        p = instance.configurations(q) - cu.vertex
        assert np.hypot(*p) == pytest.approx(d - cu.radius, abs=1e-9)
        assert cu.at(instance.phi).contains(p + cu.vertex)
        # Two lines, tangent at both extreme turns, and no additional arc: beyond d − ε along the normal of either.
        normals = outward + math.pi + np.array([-1.0, 1.0]) * cu.spread
        along = p[0] * np.cos(normals) + p[1] * np.sin(normals)
        assert np.all(along < (d - cu.radius) * (1.0 - 0.4 * min(cu.spread, 1.0) ** 2))


def test_centre_of_the_additional_arc() -> None:
    # Eq. (41) keeps the centre and the direction of eq. (36): the arc of CUl lies about the vertex, turned by π.
    edge, vertex = np.array([[1.0, -0.5], [1.0, 0.5]]), np.array([4.0, 3.0])
    cu = CU(ContactType.TYPE_2, 0, 0, edge, vertex, EVERY, EVERY, 0.1, 0.05)
    right, printed = vertex - np.array([0.95, 0.0]), vertex + np.array([0.95, 0.0])
    assert cu.at(0.0).contains(right)
    assert not cu.at(0.0).contains(right + np.array([1e-6, 0.0]))
    assert not cu.at(0.0).contains(printed)
    x = Instance(cu, 0.0, 0.03, 0.02).configurations(deviations(np.random.default_rng(6), 20_000))
    assert np.hypot(*(x - right).T).min() < 0.01
    assert np.hypot(*(x - printed).T).min() > 1.0


def test_uv_is_no_single_circle() -> None:
    # Position and angle deviate together: neither the disc nor the arc alone holds what they sum up to.
    shape = ArcSum(ORIGIN, ORIGIN, 1.0, 0.0, 0.2, 0.05)
    at = 1.05 * np.array([math.cos(0.2), math.sin(0.2)])
    assert shape.contains(at)
    assert not ArcSum(ORIGIN, ORIGIN, 1.0, 0.0, 0.0, 0.05).contains(at)
    assert not ArcSum(ORIGIN, ORIGIN, 1.0, 0.0, 0.2, 0.0).contains(at)
