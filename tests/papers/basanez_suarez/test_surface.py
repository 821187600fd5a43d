"""Families of C-surfaces: they agree with the sets; envelopes are where the boundary is."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy

from fmopt.papers.basanez_suarez.contact import ContactType
from fmopt.papers.basanez_suarez.surface import boundary_rank, family, geometry_values
from tests.shared.planar_sampling import Instance, instances

KINDS = pytest.mark.parametrize("kind", list(ContactType))


def drawn(instance: Instance, q: np.ndarray) -> np.ndarray:
    """δ_φ, δ_p, θ_p, δ_a, θ_a of a point q (6,) of the unit cube."""
    turn = instance.cu.spread * (2.0 * q[1] - 1.0)
    return np.array([turn, instance.epsilon_p * q[3], FULL * q[2], instance.epsilon_a * q[5], FULL * q[4]])


FULL = 2.0 * math.pi


def envelope_function(kind: ContactType) -> Callable[..., Any]:
    """(configuration, geometry, deviations) ↦ [F, k, ∂F/∂δ_φ, ∂F/∂θ_p, ∂F/∂θ_a]."""
    found = family(kind)
    arguments = (found.configuration, found.geometry, found.deviations)
    made: Callable[..., Any] = sympy.lambdify(arguments, [found.function, found.k, *found.envelope()])
    return made


@KINDS
def test_the_family_vanishes_at_every_contact(kind: ContactType) -> None:
    rng = np.random.default_rng(1)
    function = envelope_function(kind)
    for instance in instances(kind, None, 100, seed=51):
        q = rng.uniform(size=6)
        configuration = [*instance.configurations(q), instance.phi]
        f, k, *_ = function(configuration, geometry_values(instance.cu), drawn(instance, q))
        assert f == pytest.approx(0.0, abs=1e-12 * instance.cu.at(0.0).size)
        # The place on the edge that was eliminated comes back.
        assert k == pytest.approx(q[0], abs=1e-9)


@KINDS
def test_without_deviations_it_is_the_nominal_surface(kind: ContactType) -> None:
    rng = np.random.default_rng(2)
    function = envelope_function(kind)
    for instance in instances(kind, None, 30, seed=52):
        nominal = instance.cu.without_uncertainty()
        pose = np.array([*rng.normal(size=2) * nominal.reach, instance.phi])
        low, high = nominal.value_interval(pose)
        assert low == pytest.approx(high, abs=1e-12 * nominal.reach)
        f = function(pose, geometry_values(instance.cu), np.zeros(5))[0]
        assert f == pytest.approx(low, abs=1e-9 * nominal.reach)


@KINDS
def test_the_envelope_is_where_the_value_is_extreme(kind: ContactType) -> None:
    """At the least and greatest value over the deviations the conditions hold, and only there."""
    rng = np.random.default_rng(4)
    function = envelope_function(kind)
    stationary = 0
    for instance in instances(kind, None, 60, seed=53):
        pose = np.array([*instance.configurations(rng.uniform(size=6)), instance.phi])
        numbers = geometry_values(instance.cu)
        for sign, bound in zip((-1.0, 1.0), instance.cu.value_interval(pose), strict=True):
            turns = np.linspace(-1.0, 1.0, 4001) * instance.cu.spread
            values = function(pose, numbers, (turns, 0.0, 0.0, 0.0, 0.0))[0]
            turn = turns[np.argmax(sign * values)]
            normal = normal_angle(instance, turn)
            # Both points shifted along the edge's normal, towards the extreme.
            toward = normal if (sign > 0.0) is (kind is ContactType.TYPE_1) else normal + math.pi
            at = np.array([turn, instance.epsilon_p, toward, instance.epsilon_a, toward + math.pi])
            f, _, by_turn, by_p, by_a = function(pose, numbers, at)
            assert f == pytest.approx(float(bound), abs=1e-6 * (instance.uncertainty + abs(float(bound))))
            np.testing.assert_allclose([by_p, by_a], 0.0, atol=1e-9 * instance.uncertainty)
            if abs(turn) < 0.999 * instance.cu.spread:
                stationary += 1
                scale = instance.cu.reach + np.hypot(*(pose[:2] - instance.cu.vertex))
                assert abs(by_turn) < 2e-3 * instance.cu.spread * scale + 1e-9
            else:
                assert sign * by_turn * turn >= -1e-9 * instance.uncertainty
    assert stationary > 3


def normal_angle(instance: Instance, turn: float) -> float:
    e = instance.cu.edge[1] - instance.cu.edge[0]
    psi = math.atan2(-e[0], e[1])
    return psi if instance.cu.kind is ContactType.TYPE_1 else psi + instance.phi + turn


@KINDS
def test_the_additional_condition_holds_on_tangent_arcs(kind: ContactType) -> None:
    """Where neither the place on the edge nor the turn is at a limit, the points' derivatives are parallel."""
    rank = boundary_rank(kind)
    found = family(kind)
    k = sympy.Symbol("k", real=True)
    turn = found.deviations[0]
    for instance in instances(kind, None, 5, seed=54):
        cu = instance.cu
        values = dict(zip(found.geometry, geometry_values(cu), strict=True)) | {found.configuration[2]: instance.phi}
        at = rank.subs(values)
        if kind is ContactType.TYPE_1:
            # The arm is along the normal of the edge.
            e, (x, y) = cu.edge[1] - cu.edge[0], cu.vertex
            zero = math.atan2(-e[0], e[1]) - math.atan2(y, x) - instance.phi
            assert float(at.subs({turn: zero})) == pytest.approx(0.0, abs=1e-12 * cu.reach)
            assert abs(float(at.subs({turn: zero + 0.1}))) > 1e-3 * math.hypot(*e) * math.hypot(x, y)
        else:
            # The foot of the perpendicular, whatever the turn: the additional arc.
            e = cu.edge[1] - cu.edge[0]
            foot = -float(cu.edge[0] @ e) / float(e @ e)
            for angle in (-0.3, 0.2):
                assert float(at.subs({turn: angle, k: foot})) == pytest.approx(0.0, abs=1e-12 * cu.reach**2)
                assert abs(float(at.subs({turn: angle, k: foot + 0.1}))) > 1e-3 * float(e @ e)


def test_expressions_read_like_the_paper() -> None:
    found = family(ContactType.TYPE_1)
    p_x, p_y, phi = found.configuration
    assert {p_x, p_y, phi} < found.function.free_symbols
    assert "delta_phi" in sympy.latex(found.function) or "\\delta_{\\phi}" in sympy.latex(found.function)
