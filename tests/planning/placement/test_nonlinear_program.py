"""Placement on true C-surfaces: gradients, agreement with the linear problem, refusals, threads."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from fmopt.errors import SolverError
from fmopt.planning.placement import nonlinear_program as nlp
from fmopt.planning.placement.nonlinear_program import certify_on_surfaces, place_on_surfaces, project
from tests.shared.placement_instances import METRIC, linearised, max_min_clearance, peg_placement

STATES = [
    (),
    ("tipx++",),
    ("mouthy-+",),
    ("tipx++", "tipx+-"),
    ("tipx++", "mouthx-+"),
    ("tipx++", "tipx+-", "mouthx-+", "mouthx--"),
    ("tipx++", "tipx+-", "mouthx++", "mouthx+-"),
    ("tipx++", "tipx+-", "tipy++"),
]


@pytest.mark.parametrize("seed", range(10))
def test_gradients_agree_with_finite_differences(seed: int) -> None:
    problem = peg_placement(("tipx++", "mouthx-+"))
    X, step = 0.5 * np.random.default_rng(seed).normal(size=6) * problem.upper, 1e-6
    ends = [(problem.rows(X + e)[0], problem.rows(X - e)[0]) for e in np.eye(6) * step]
    slopes = np.transpose([(one - other) / (2.0 * step) for one, other in ends])
    assert problem.rows(X)[1] == pytest.approx(slopes, abs=1e-8)


@pytest.mark.parametrize("state", STATES)
def test_true_clearance_is_at_least_that_of_the_socp_point(state: tuple[str, ...]) -> None:
    problem = peg_placement(state)
    guess = max_min_clearance(linearised(problem, np.zeros(6))).x[:6]
    solution = place_on_surfaces(problem, guess)
    at_guess = certify_on_surfaces(problem, project(problem, guess))
    assert solution.value >= at_guess.value
    assert problem.clearances(solution.x[:6]).min() == pytest.approx(solution.value, abs=1e-12)


def test_a_tilted_peg_on_two_lines_has_its_tilt_by_hand() -> None:
    problem = peg_placement(("tipx++", "tipx+-", "mouthx-+", "mouthx--"))
    theta = -place_on_surfaces(problem).x[4]
    # The tip at +x touches 10.1 mm; the mouth edge at −10.1 mm, 15 mm above the tip, lies on the peg's other face.
    x = 0.0101 - 0.01 * np.cos(theta)
    face = (-0.0101 - x) * np.cos(theta) + 0.015 * np.sin(theta)
    assert face == pytest.approx(-0.01, abs=1e-10)


@pytest.mark.parametrize("seed", range(6))
def test_linearised_again_at_the_answer_nothing_is_left_to_gain(seed: int) -> None:
    state = [s for s in STATES if 1 <= len(s) <= 2][seed % 4]
    problem = peg_placement(state)
    solution = place_on_surfaces(problem, max_min_clearance(linearised(problem, np.zeros(6))).x[:6])
    tangent = linearised(problem, solution.x[:6])
    assert max_min_clearance(tangent).value <= solution.value + 3e-3 * METRIC.clearance


def test_same_numbers_same_bits_whatever_was_solved_before() -> None:
    problems = [peg_placement((name,)) for name in ("tipx++", "tipx+-", "tipy-+")]
    first = [place_on_surfaces(problem).x for problem in problems]
    again = [place_on_surfaces(problem).x for problem in reversed(problems)]
    assert all(np.array_equal(a, b) for a, b in zip(first, reversed(again), strict=True))


def test_threads_are_served_one_at_a_time() -> None:
    problems = [peg_placement((name,)) for name in ("tipx++", "tipx-+", "tipy+-", "tipy--")] * 2
    serial = [place_on_surfaces(problem).x for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        parallel = list(pool.map(lambda problem: place_on_surfaces(problem).x, problems))
    assert all(np.array_equal(a, b) for a, b in zip(serial, parallel, strict=True))


def test_an_allowance_lowers_the_clearance_as_stated() -> None:
    plain = place_on_surfaces(peg_placement(("tipx++",))).value
    less = place_on_surfaces(peg_placement(("tipx++",), allowance=0.3e-4)).value
    assert less == pytest.approx(plain - 0.3e-4, abs=1e-10)


def test_contacts_that_cannot_meet_raise_with_the_shortfall() -> None:
    with pytest.raises(SolverError, match="clearances"):
        place_on_surfaces(peg_placement(("tipx++", "tipx+-", "tipx-+", "tipx--")))


def test_a_pose_off_the_surfaces_is_refused() -> None:
    problem = peg_placement(("tipx++",))
    good = place_on_surfaces(problem).x[:6]
    certify_on_surfaces(problem, good)
    with pytest.raises(SolverError, match="contact 0"):
        certify_on_surfaces(problem, good + 1e-9 * np.eye(6)[0])
    with pytest.raises(SolverError, match="bound 2"):
        certify_on_surfaces(problem, good + 1e-9 * np.eye(6)[2])
    with pytest.raises(SolverError, match="finite"):
        certify_on_surfaces(problem, np.full(6, np.inf))


def test_an_optimiser_that_lies_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = peg_placement(("tipx++",))
    monkeypatch.setattr(nlp, "_optimum", lambda *_: np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0]))
    assert place_on_surfaces(problem).value == certify_on_surfaces(problem, project(problem, np.zeros(6))).value
