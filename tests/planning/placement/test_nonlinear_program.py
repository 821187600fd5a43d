"""Placement on true C-surfaces: gradients, agreement with the linear problem, refusals, threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import near_contacts
from fmopt.errors import SolverError
from fmopt.geometry.csg import Box, convex_polyhedron
from fmopt.planning.placement import nonlinear_program as nlp
from fmopt.planning.placement.formation import (
    Row,
    RowKind,
    counts,
    edge_edge,
    evaluate,
    face_vertex,
    formation_derivatives,
    vertex_face,
)
from fmopt.planning.placement.largest_clearance import max_min_clearance
from fmopt.planning.placement.nonlinear_program import (
    SurfacePlacement,
    certify_on_surfaces,
    largest,
    place_on_surfaces,
    project,
)
from fmopt.spatial.se3 import Pose
from tests.shared.placement_instances import (
    METRIC,
    linear_surfaces,
    linearised,
    peg_placement,
    peg_rows,
    random_placement,
)

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


def random_rows(seed: int) -> list[Row]:
    rng = np.random.default_rng(seed)
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    points = 0.02 * rng.normal(size=(6, 3))
    return [
        vertex_face(points[0], n, points[1]),
        face_vertex(n, 0.01, points[2]),
        edge_edge(points[[0, 1]], points[[2, 3]], 1),
        edge_edge(points[[1, 4]], points[[5, 3]], -1),
    ]


@pytest.mark.parametrize("seed", range(10))
def test_gradients_agree_with_finite_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    reference = Pose.from_vector(rng.normal(size=6) * [0.02, 0.02, 0.02, 1.0, 1.0, 1.0])
    rows = random_rows(seed)
    N = evaluate(rows, reference, np.zeros(6))[1]
    step = 1e-6
    for i, e in enumerate(np.eye(6) * step):
        difference = (evaluate(rows, reference, e)[0] - evaluate(rows, reference, -e)[0]) / (2.0 * step)
        assert difference == pytest.approx(N[:, i], abs=1e-7)


def test_numbers_of_primitive_contacts_are_rows_as_they_stand() -> None:
    moving = convex_polyhedron(Box((0.02, 0.02, 0.04)), Pose.identity())
    fixed = convex_polyhedron(Box((0.06, 0.05, 0.04)), Pose.identity())
    pose = Pose.from_vector([0.025, 0.02, 0.039, 0.2, 0.3, 0.4])
    contacts = near_contacts(moving, fixed, pose, 0.03, 0.3)
    assert len({contact.kind for contact in contacts}) == 3
    rows = [Row.of(contact, moving, fixed) for contact in contacts]
    expected = Surfaces.of(contacts, moving, fixed).values_and_rows(pose)
    for one, other in zip(evaluate(rows, pose, np.zeros(6)), expected, strict=True):
        assert one == pytest.approx(other, abs=1e-14)


def test_signed_distances_by_hand() -> None:
    up = np.array([0.0, 0.0, 1.0])
    at = Pose(np.array([0.0, 0.0, 2.0]), np.eye(3))
    rows = [
        vertex_face([0, 0, -1], up, [5, 5, 0]),
        face_vertex(-up, 1.0, [0.3, 0.2, 0.0]),
        edge_edge([[-1, 0, -1], [1, 0, -1]], [[0, -1, 0], [0, 1, 0]], 1),
        Row(RowKind.PLANE, [0, 0, 1, 0, 0, 0, -1]),
    ]
    assert evaluate(rows, at, np.zeros(6))[0] == pytest.approx([1.0, 1.0, 1.0, 1.0])


@pytest.mark.parametrize("state", STATES)
def test_true_clearance_is_at_least_that_of_the_socp_point(state: tuple[str, ...]) -> None:
    problem = peg_placement(state)
    guess = max_min_clearance(linearised(problem, np.zeros(6))).x[:6]
    solution = place_on_surfaces(problem, guess)
    at_guess = certify_on_surfaces(problem, project(problem, guess))
    assert solution.value >= at_guess.value
    f = evaluate(problem.obstacles, problem.reference, solution.x[:6])[0]
    assert (f / problem.weights).min() == pytest.approx(solution.value, abs=1e-12)


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


def test_one_solver_serves_all_formations_of_equal_counts() -> None:
    formation_derivatives.cache_clear()
    for name in ("tipx++", "tipx-+", "tipy+-", "tipy--"):
        place_on_surfaces(peg_placement((name,)))
    assert formation_derivatives.cache_info().misses == 1


@pytest.mark.parametrize("state", STATES)
def test_quadratic_programs_and_the_interior_point_method_agree(
    state: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(len(state))
    guesses = rng.normal(size=(4, 6)) * [3e-5, 3e-5, 0.0, 1e-3, 1e-3, 1e-3]
    problem = peg_placement(state)
    settled = []

    def counted(*arguments: Any) -> Any:
        settled.append(largest(*arguments))
        return settled[-1]

    monkeypatch.setattr(nlp, "largest", counted)
    quick = [place_on_surfaces(problem, guess).value for guess in guesses]
    assert all(found is not None for found in settled)
    monkeypatch.setattr(nlp, "largest", lambda *_: None)
    slow = [place_on_surfaces(problem, guess).value for guess in guesses]
    assert quick == pytest.approx(slow, abs=1e-6 * METRIC.clearance)


def test_what_quadratic_programs_do_not_settle_the_interior_point_method_does(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = peg_placement(("tipx++",))
    found = place_on_surfaces(problem).value
    monkeypatch.setattr(nlp, "_ROUNDS", 1)
    assert place_on_surfaces(problem).value == pytest.approx(found, abs=1e-6 * METRIC.clearance)


def test_derivatives_of_a_formation_agree_with_finite_differences() -> None:
    rng = np.random.default_rng(3)
    rows = sorted(random_rows(3), key=lambda row: list(RowKind).index(row.kind))
    functions = formation_derivatives(counts(()), counts(rows))
    units = np.array([1e-2] * 3 + [0.5] * 3)
    scale = np.zeros((4, len(rows)))
    scale[0], scale[3] = rng.uniform(1.0, 2.0, (2, len(rows)))
    reference = Pose.from_vector([0.01, -0.02, 0.03, 0.3, -0.2, 0.4])
    fixed = [units, reference.p, reference.R.ravel(order="F"), 0.01 * rng.normal(size=6), [1e-2]]
    parameters = np.concatenate([*fixed, *(row.numbers for row in rows), scale.ravel(order="F")])
    x, weights, step = rng.normal(size=6), rng.normal(size=len(rows)), 1e-5
    _, J, H = functions(x, parameters, weights)
    ends = [[functions(x + side * step * e, parameters, weights) for side in (1.0, -1.0)] for e in np.eye(6)]
    slopes = np.array([(one[0] - other[0]) / (2.0 * step) for one, other in ends]).T
    bends = np.array([weights @ (one[1] - other[1]) / (2.0 * step) for one, other in ends])
    assert pytest.approx(slopes, abs=1e-8) == J
    assert pytest.approx(bends, abs=1e-8) == H


def test_threads_are_served_one_at_a_time() -> None:
    problems = [peg_placement((name,)) for name in ("tipx++", "tipx-+", "tipy+-", "tipy--")] * 2
    serial = [place_on_surfaces(problem).x for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        parallel = list(pool.map(lambda problem: place_on_surfaces(problem).x, problems))
    assert all(np.array_equal(a, b) for a, b in zip(serial, parallel, strict=True))


def test_allowance_and_growth_lower_the_clearance_as_stated() -> None:
    linear = random_placement(7, rows=8, contacts=2)
    plain = place_on_surfaces(linear_surfaces(linear)).value
    problem = linear_surfaces(linear)
    less = SurfacePlacement(
        problem.reference,
        problem.contacts,
        problem.obstacles,
        metric=METRIC,
        lower=problem.lower,
        upper=problem.upper,
        weights=problem.weights,
        allowance=0.3e-4 * problem.weights,
    )
    assert place_on_surfaces(less).value == pytest.approx(plain - 0.3e-4, abs=1e-10)


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
    with pytest.raises(SolverError, match="bound 2"):
        place_on_surfaces(problem)


def test_rows_refuse_wrong_kinds_and_shapes() -> None:
    with pytest.raises(ValueError, match="shape"):
        Row(RowKind.PLANE, np.zeros(12))
    with pytest.raises(ValueError, match="RowKind"):
        Row("face-face", np.zeros(12))
    assert len(peg_rows()) == 16
