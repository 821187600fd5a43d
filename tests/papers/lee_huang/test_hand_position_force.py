"""C-PF on the axes: Γ, Ω and the subspaces obey the paper's laws; figure 2's task; rows of the plan file."""

from itertools import product

import numpy as np
import pytest

from fmopt.papers.lee_huang.hand_position_force import position_force
from fmopt.papers.lee_huang.nominal_trajectory import insertion
from fmopt.plan.diagnostics import Interval
from fmopt.plan.position_force import Decomposition, contact_forces, gamma, natural_constraints, omega
from fmopt.task.problem import Specification

SPECIFICATION = Specification(0.02, 5.0, 0.5, 0.3, 2.0)
ALL = list(product((-1, 0, 1, 2), repeat=6))[::37]
PATH = insertion([0.001, 0, 0.005, 0, 0, 0.1], [0, 0, -0.03, 0, 0, 0], 0.02, 0.014)
F = contact_forces(SPECIFICATION, 0.014)


def test_subspaces_are_complements_and_constraints_count_six():
    for s in ALL:
        split = Decomposition(s)
        assert sorted(split.natural + split.artificial) == list(range(6))


def test_pa_and_pn_sum_to_p_and_lie_in_their_subspaces():
    rng = np.random.default_rng(0)
    for s in ALL:
        P, split = rng.normal(size=6), Decomposition(s)
        Pa, Pn = gamma(s, P), natural_constraints(s, P)
        assert not Pa[list(split.natural)].any()
        assert not Pn[list(split.artificial)].any()
        assert np.array_equal(Pa + Pn, P)


def test_omega_is_the_reaction_against_the_stopped_motion():
    assert np.array_equal(omega((1, -1, 0, 2, 0, 1), F), [-F[0], F[1], 0, F[3], 0, -F[5]])
    for s in ALL:
        split, Fa = Decomposition(s), omega(s, F)
        assert not Fa[list(split.artificial)].any()
        assert all(np.sign(Fa[k]) == -s[k] for k in range(6) if s[k] in (1, -1))
        assert all(abs(Fa[k]) == F[k] for k in split.natural)


def test_torques_come_from_the_force_at_rho_up_to_the_limit():
    assert np.allclose(F, [5, 5, 5, 0.07, 0.07, 0.07])
    assert np.allclose(contact_forces(SPECIFICATION, 1.0)[3:], 0.5)


def test_figure_two_of_the_paper():
    t1, T = float(PATH.times[1]), PATH.duration
    rows = position_force(PATH, [Interval(0.0, t1, (0,) * 6), Interval(t1, T, (2, 2, 0, 2, 2, 0))], F)
    assert [(row.start, row.end) for row in rows] == [(0.0, t1), (t1, T)]
    assert np.array_equal(rows[0].pa_start, PATH.at(0.0))
    assert not any(rows[0].fa)
    assert Decomposition(rows[1].s).artificial == (2, 5)
    assert Decomposition(rows[1].s).written == {
        "C_np": "(p_x, p_y, 0, q_x, q_y, 0)",
        "C_ap": "(0, 0, p_z, 0, 0, q_z)",
        "C_af": "(f_x, f_y, 0, tau_x, tau_y, 0)",
    }
    assert Decomposition(rows[0].s).written["C_ap"] == "(p_x, p_y, p_z, q_x, q_y, q_z)"
    assert np.array_equal(rows[1].pa_end, [0, 0, -0.03, 0, 0, 0])
    assert np.array_equal(rows[1].fa, [F[0], F[1], 0, F[3], F[4], 0])


def test_rows_split_where_the_trajectory_bends_so_that_each_is_straight():
    rows = position_force(PATH, [Interval(0.0, PATH.duration, (0,) * 6)], F)
    assert [row.end for row in rows] == [float(PATH.times[1]), PATH.duration]
    for row in rows:
        for u in (0.25, 0.5):
            t = (1 - u) * row.start + u * row.end
            pa = (1 - u) * np.array(row.pa_start) + u * np.array(row.pa_end)
            assert np.allclose(pa, gamma(row.s, PATH.at(t)), atol=1e-16)


def test_an_interval_of_no_length_at_the_goal_is_one_row():
    T = PATH.duration
    rows = position_force(PATH, [Interval(T, T, (0, 0, -1, 0, 0, 0))], F)
    assert (len(rows), rows[0].fa[2]) == (1, F[2])


def test_rows_give_what_a_controller_applies():
    (row,) = position_force(PATH, [Interval(1.0, 1.2, (2, 0, -1, 1, 0, 2))], F)
    assert row.either_sign == (0, 5)
    assert np.array_equal(np.add(row.pa_start, row.pn_start), PATH.at(1.0))
    assert row.fa == (5, 0, 5, -F[3], 0, F[5])


@pytest.mark.parametrize("s", [(0,) * 5, (0, 0, 0, 0, 0, 3)])
def test_refuses_what_is_no_value_of_s(s):
    with pytest.raises(ValueError, match="six values"):
        gamma(s, np.zeros(6))
