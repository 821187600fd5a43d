"""The papers' reciprocal cost with steepest descent, beside the certified optimum."""

import numpy as np
import pytest

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.placement.goal_refinement import Descent, _Cost, descend
from fmopt.planning.placement.largest_clearance import Flat
from tests.shared.placement_instances import CLEARANCE, max_min_clearance, random_placement, translations


def test_it_centres_between_walls() -> None:
    walls = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], [0, -3, -2, -2]
    solution = descend(translations(*walls), guess=[0.5, 0.5, 0, 0, 0, 0])
    assert solution.x[:2] == pytest.approx([1.5, 0.0], abs=1e-4)
    assert solution.value == pytest.approx(1.5, abs=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_it_gains_on_its_start_and_never_reports_more_than_the_optimum(seed: int) -> None:
    problem = random_placement(seed)
    best = max_min_clearance(problem)
    begun = descend(problem, settings=Descent(max_steps=0))
    for asymptote in (-1.0, -0.1, -0.01):
        found = descend(problem, settings=Descent(asymptote))
        assert found.value <= best.bound + 1e-9 * CLEARANCE
        assert found.duals is None
        assert problem.clearances(found.x[:6]).min() == pytest.approx(found.value, abs=1e-15)
    assert found.value > begun.value


def test_it_approaches_the_optimum_from_below_as_the_asymptote_nears() -> None:
    # Walls at 0 and 3, a second wall at 3.5 pulls the balance over; the nearer the asymptote, the less it counts.
    problem = translations([[1, 0, 0], [-1, 0, 0], [-1, 0, 0]], [0, -3, -3.5], goal=Flat(np.eye(6)[1:], np.zeros(5)))
    values = [descend(problem, np.eye(6)[0], Descent(asymptote=C)).value for C in (-10.0, -1.0, -1e-3)]
    assert values[0] < values[1] < values[2] < max_min_clearance(problem).value == pytest.approx(1.5, abs=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_gradient_of_the_cost_agrees_with_finite_differences(seed: int) -> None:
    problem = random_placement(seed, rows=8, contacts=0)
    scaled = problem.program().scaled()
    y = 0.1 * np.random.default_rng(seed).normal(size=6)
    cost = _Cost.of(scaled, y, -1.0)
    difference = [(cost(y + e) - cost(y - e)) / 2e-6 for e in np.eye(6) * 1e-6]
    assert difference == pytest.approx(cost.gradient(y), rel=1e-5, abs=1e-7)


def test_the_printed_sign_would_reward_contact() -> None:
    # 1/(C − dist) as printed grows towards zero from below as the distance falls: the erratum's reason.
    C, near, far = -1.0, 0.1, 2.0
    assert 1.0 / (C - near) < 1.0 / (C - far)
    assert 1.0 / (near - C) > 1.0 / (far - C)


def test_refusals() -> None:
    with pytest.raises(SolverError, match="strictly inside"):
        descend(translations([[1, 0, 0]], [0]), guess=[20.0, 0, 0, 0, 0, 0])
    with pytest.raises(InfeasibleError, match="contradict"):
        descend(translations([[1, 0, 0]], [0], goal=Flat(np.eye(6)[[0, 0]], [0.0, 1.0])))
