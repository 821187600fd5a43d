"""Evidence: bounds that three ways to compute them agree on, vertices of a balanced design, draws of their numbers."""

from dataclasses import fields
from fractions import Fraction
from math import comb, sqrt

import numpy as np
import pytest

from fmopt.execution.confidence import lower_bound, success_interval
from fmopt.execution.press_controller import Errors
from fmopt.execution.press_trials import drawn_errors, vertex_errors
from fmopt.plan.evidence import CONFIDENCE
from fmopt.plan.press import Conditions
from fmopt.spatial.values import Array
from fmopt.verify.evidence import lower_bound as checked_bound

COUNTS = [(k, n) for n in (1, 2, 7, 10, 33) for k in {0, 1, n // 2, n - 1, n}]
CONDITIONS = Conditions((1e-3, 2e-3, 3e-3, 0.01, 0.02, 0.03))


def tail(k: int, n: int, rate: Fraction) -> Fraction:
    """Probability of k successes of n or more, exactly."""
    return sum((comb(n, j) * rate**j * (1 - rate) ** (n - j) for j in range(k, n + 1)), Fraction(0))


@pytest.mark.parametrize(("k", "n"), COUNTS)
def test_the_exact_binomial_sum_crosses_the_doubt_at_the_bound(k: int, n: int) -> None:
    bound, doubt = lower_bound(k, n), 1 - Fraction(CONFIDENCE)
    if k == 0:
        assert bound == 0.0
        return
    assert tail(k, n, Fraction(bound * (1 - 1e-9))) < doubt < tail(k, n, Fraction(bound * (1 + 1e-9)))


@pytest.mark.parametrize(("k", "n"), [*COUNTS, (96, 96), (90, 96), (1, 1000), (995, 1000), (9990, 10_000)])
def test_planner_and_check_have_the_same_bound(k: int, n: int) -> None:
    assert checked_bound(k, n, CONFIDENCE) == pytest.approx(lower_bound(k, n), rel=1e-10, abs=1e-12)


@pytest.mark.parametrize(("k", "n"), COUNTS)
def test_the_two_sided_interval_holds_the_share_and_begins_at_the_one_sided_bound(k: int, n: int) -> None:
    low, high = success_interval(k, n)
    assert 0.0 <= low <= k / n <= high <= 1.0
    assert low == pytest.approx(lower_bound(k, n, 0.975), abs=1e-12)  # half of the doubt at either end
    assert high == pytest.approx(1.0 - lower_bound(n - k, n, 0.975), abs=1e-12)


def test_nothing_is_known_without_trials() -> None:
    assert success_interval(0, 0) == (0.0, 1.0)
    assert lower_bound(0, 0) == checked_bound(0, 0, CONFIDENCE) == 0.0


def test_vertices_are_all_signs_once_and_the_other_intervals_a_balanced_design() -> None:
    errors = vertex_errors(CONDITIONS, 3)
    signs = np.sign(errors.start)
    assert np.array_equal(np.abs(errors.start), np.tile(CONDITIONS.start, (64, 1)))
    assert len(np.unique(signs, axis=0)) == 64
    columns = [signs]
    for name in ("friction", "stiffness", "admittance"):
        low, high = getattr(CONDITIONS, name)
        values = getattr(errors, name)
        assert (np.sum(values == low), np.sum(values == high)) == (32, 32)
        columns.append(np.sign(values - sqrt(low * high))[:, None])
    assert np.array_equal(np.abs(errors.offset), np.tile(np.repeat(CONDITIONS.offset, 3), (64, 1)))
    assert np.allclose(np.linalg.norm(errors.drift.reshape(64, 2, 3, 3), axis=2), CONDITIONS.drift, rtol=1e-12)
    assert np.array_equal(errors.drift, np.repeat(errors.drift[:, :, :1], 3, axis=2))
    design = np.hstack([*columns, np.sign(errors.offset), np.sign(errors.drift[:, :, 0])])
    # Each column is balanced, and no two of them, the start errors among them, go together.
    assert not design.sum(axis=0).any()
    assert np.array_equal(design.T @ design, 64.0 * np.eye(design.shape[1]))


def rows(errors: Errors, which: list[int]) -> list[Array]:
    return [getattr(errors, field.name)[which] for field in fields(errors)]


def test_a_draw_is_of_its_number_alone_and_within_its_intervals() -> None:
    errors = drawn_errors(CONDITIONS, 4, 7, [*range(2000)])
    for found, alone in zip(rows(errors, [5, 3]), rows(drawn_errors(CONDITIONS, 4, 7, [5, 3]), [0, 1]), strict=True):
        assert np.array_equal(found, alone)
    assert not np.array_equal(drawn_errors(CONDITIONS, 4, 8, [5]).start, errors.start[5:6])
    share = errors.start / np.array(CONDITIONS.start)
    assert np.abs(share).max() <= 1.0
    assert (np.abs(share).max(axis=0) > 0.99).all()
    for name in ("friction", "stiffness", "admittance"):
        low, high = getattr(CONDITIONS, name)
        values = getattr(errors, name)
        assert low <= values.min() < 1.1 * low < 0.95 * high < values.max() <= high
        middle = 0.5 * (low + high) if name == "friction" else sqrt(low * high)
        assert np.median(values) == pytest.approx(middle, rel=0.08)
    assert (np.abs(errors.offset) <= np.repeat(CONDITIONS.offset, 3)).all()
    sizes = np.linalg.norm(errors.drift.reshape(2000, 2, 3, 4), axis=2)
    assert 0.99 * CONDITIONS.drift < sizes.max() <= CONDITIONS.drift
    assert np.mean(sizes < 0.5 * CONDITIONS.drift) == pytest.approx(0.125, abs=0.02)  # uniform in balls


def test_draws_to_choose_by_have_a_share_at_vertices() -> None:
    share = np.abs(drawn_errors(CONDITIONS, 1, 7, range(400), corners=0.5).start) / np.array(CONDITIONS.start)
    assert np.mean((share == 1.0).all(axis=1)) == pytest.approx(0.5, abs=0.1)
