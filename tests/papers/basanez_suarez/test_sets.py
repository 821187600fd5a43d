"""Planar uncertainty sets against sampled deviations: nothing outside, nothing padded, a shrunk set is caught."""

from dataclasses import replace

import numpy as np
import pytest

from fmopt.papers.basanez_suarez.contact import ContactType
from fmopt.papers.basanez_suarez.edge import Case
from fmopt.papers.basanez_suarez.planar_set import PlanarSet
from tests.shared.planar_sampling import Instance, deviations, instances, nearest

GROUPS = [(ContactType.TYPE_1, None), (ContactType.TYPE_2, Case.A), (ContactType.TYPE_2, Case.B)]
NAMES = ["type 1", "type 2 case A", "type 2 case B"]
CASES, SAMPLES = 200, 4000

pytestmark = pytest.mark.parametrize(("kind", "case"), GROUPS, ids=NAMES)


def support_misses(instance: Instance, shape: PlanarSet, x: np.ndarray) -> float:
    """By how much the points (k, 2) stay behind the support function in 16 directions, as a part of the uncertainty."""
    theta = np.arange(16) * np.pi / 8.0
    n = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    return float(np.max(shape.support(n) - np.max(x @ n.T, axis=0))) / instance.uncertainty


def test_every_sample_lies_inside(kind: ContactType, case: Case | None) -> None:
    rng = np.random.default_rng(1)
    for instance in instances(kind, case, CASES, seed=1):
        shape = instance.cu.at(instance.phi)
        x = instance.configurations(deviations(rng, SAMPLES))
        assert np.all(shape.core_distance(x) <= shape.radius + 1e-9 * shape.size)
        away = x - x.mean(axis=0)
        assert np.all(shape.support(away) >= np.sum(x * away, axis=1) - 1e-9 * shape.size**2)
        poses = np.column_stack([x, np.full(len(x), instance.phi)])
        assert np.all(instance.cu.contains(poses))


def test_a_set_shrunk_by_a_thousandth_is_caught(kind: ContactType, case: Case | None) -> None:
    rng = np.random.default_rng(2)
    for instance in instances(kind, case, CASES, seed=2):
        shape = instance.cu.at(instance.phi)
        x = instance.configurations(deviations(rng, SAMPLES))
        for shrunk in (shape.widened(-1e-3 * shape.radius), replace(shape, spread=0.999 * shape.spread)):
            assert np.any(shrunk.core_distance(x) > shrunk.radius + 1e-9 * shape.size)


def test_the_boundary_is_reached(kind: ContactType, case: Case | None) -> None:
    for instance in instances(kind, case, CASES, seed=3):
        loops = instance.cu.at(instance.phi).boundary()
        points = np.array([piece.curve.point(t) for loop in loops for piece in loop for t in (0.1, 0.6)])
        assert nearest(instance, points).max() <= 1e-4 * instance.uncertainty


def test_the_support_is_reached(kind: ContactType, case: Case | None) -> None:
    rng = np.random.default_rng(4)
    for instance in instances(kind, case, CASES, seed=4):
        shape = instance.cu.at(instance.phi)
        x = instance.configurations(deviations(rng, SAMPLES))
        assert support_misses(instance, shape, x) * instance.uncertainty / shape.size >= -1e-9
        assert support_misses(instance, shape, x) <= 0.05
