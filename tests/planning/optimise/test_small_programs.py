"""Small linear programs: daqp against HiGHS, programs without any answer, and answers that are none."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from fmopt.errors import SolverError
from fmopt.planning.optimise.solvers import least_vertex
from fmopt.spatial.values import Array

NOWHERE = np.zeros((0, 2)), np.zeros(0)
POSITIVE = np.zeros(2), np.full(2, np.inf)
# The least x + 2 y with x + y at least 1.
CORNER = np.array([1.0, 2.0]), (np.array([[-1.0, -1.0]]), np.array([-1.0])), NOWHERE, POSITIVE


class Lie:
    """What a solver says that takes (0.1, 0.1) for every answer."""

    status, message, x = 0, "optimal", np.full(2, 0.1)


def lying(_: Array, cost: Array, rows: Array, *__: Any, **___: Any) -> tuple[Array, float, int, dict[str, Array]]:
    return np.full(len(cost), 0.1), 0.0, 1, {"lam": np.zeros(sum(rows.shape))}


@pytest.mark.parametrize("seed", range(40))
def test_the_answer_is_that_of_highs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, k, p = rng.integers(3, 20), rng.integers(2, 25), rng.integers(0, 4)
    A, C, at = rng.normal(size=(k, n)), rng.normal(size=(p, n)), rng.uniform(0.0, 2.0, size=n)
    rows = A, A @ at + rng.choice([0.0, 0.5, -0.3], p=[0.4, 0.5, 0.1], size=k)
    equations, limits = (C, C @ at), (np.zeros(n), np.where(rng.random(n) < 0.5, 2.0, 5.0))
    cost = rng.normal(size=n)
    answer = linprog(cost, A_ub=rows[0], b_ub=rows[1], A_eq=C, b_eq=equations[1], bounds=np.column_stack(limits))
    found = least_vertex(cost, rows, equations, limits)
    assert answer.status in (0, 2)
    assert (found is None) == (answer.status == 2)
    if found is not None:
        assert found == pytest.approx(answer.x, abs=1e-8)


def test_a_corner_is_found_exactly() -> None:
    found = least_vertex(*CORNER)
    assert found is not None
    assert found == pytest.approx([1.0, 0.0], abs=1e-15)


def test_rows_that_contradict_each_other_have_no_answer_without_highs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scipy.optimize.linprog", None)
    rows = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, -1.001])
    assert least_vertex(np.ones(2), rows, NOWHERE, POSITIVE) is None
    assert least_vertex(np.ones(2), CORNER[1], (np.eye(2), np.array([0.2, 0.3])), POSITIVE) is None


def test_a_cost_without_end_is_refused() -> None:
    with pytest.raises(SolverError, match="a linear program stopped"):
        least_vertex(-np.ones(2), *CORNER[1:])


def test_highs_answers_where_daqp_lies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daqp.solve", lying)
    found = least_vertex(*CORNER)
    assert found is not None
    assert found == pytest.approx([1.0, 0.0], abs=1e-9)


def test_an_answer_that_breaks_its_rows_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daqp.solve", lying)
    monkeypatch.setattr("scipy.optimize.linprog", lambda *_, **__: Lie)
    with pytest.raises(SolverError, match=r"breaks its rows by 0\.8"):
        least_vertex(*CORNER)


def test_an_answer_that_is_not_the_least_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its rows hold, but its multipliers do not prove it."""

    def slack(_: Array, cost: Array, rows: Array, *__: Any, **___: Any) -> tuple[Array, float, int, dict[str, Array]]:
        return np.append(np.ones(2), np.zeros(len(cost) - 2)), 0.0, 1, {"lam": np.zeros(sum(rows.shape))}

    monkeypatch.setattr("daqp.solve", slack)
    found = least_vertex(*CORNER)
    assert found is not None
    assert found == pytest.approx([1.0, 0.0], abs=1e-9)
