"""How much a contact nears along a piece while others are held: no execution comes nearer by less than is claimed."""

import numpy as np
import pytest

from fmopt.certificate.assembly import contact_forms, made_form
from fmopt.certificate.kernels_rows import power
from fmopt.certificate.remainder import Curvature
from fmopt.certificate.rows import points_above
from fmopt.certificate.segment_linearisation import Growth, linearisation_of
from fmopt.spatial.kernels import halves, vector
from fmopt.spatial.se3 import Pose, exp, log
from fmopt.spatial.values import Array
from tests.shared.executions.tube_segments import RHO, SEGMENTS, Segment, segment, unit_rows

POSES = 300
ROUNDING = 1e-15  # m


def moving(made: Segment, rng: np.random.Generator) -> Array:
    """How much nearer the contact of a segment comes, at poses of the piece, per the whole of it (POSES,)."""
    ends, way = made.outcome.ends, linearisation_of(made.assembly, made.piece, made.tolerance)
    held = contact_forms(made.assembly, tuple(c.contact for c in made.piece.basis), made.piece.held)
    nearing = made_form(made.assembly, made.piece.making[0], made.piece.held)
    turn, travel = log(ends.goal.R @ ends.start.R.T), ends.goal.p - ends.start.p
    translation, rotation = made.tolerance.velocity_error
    found = []
    for _ in range(POSES):
        s, e = rng.uniform(), ends.extent.half * rng.choice([-1.0, 1.0, rng.uniform()], 6)
        at = Pose(ends.start.p + s * travel + e[:3], exp(e[3:]) @ exp(s * turn) @ ends.start.R)
        drift = [translation * way.length, rotation / RHO * way.length]
        w = np.concatenate([d * unit_rows(rng, 1, 3)[0] for d in drift])
        V, N = way.twist + w, held.at(at).N
        # What gives way keeps the held contacts where they are at this pose.
        C = made.directions
        given = np.linalg.solve(N @ C, -N @ V) if len(N) else np.zeros(0)
        found.append(-float(nearing.at(at).N[0] @ (V + C @ given)))
    return np.array(found)


def claimed(made: Segment) -> Growth:
    assert made.outcome.approach is not None
    return made.outcome.approach


def test_no_execution_comes_nearer_by_less_than_is_claimed() -> None:
    rng, turning = np.random.default_rng(5), 0
    for made in map(segment, range(SEGMENTS)):
        least = float(moving(made, rng).min())
        assert least >= claimed(made).least - ROUNDING
        turning += least < claimed(made).nominal - 1e-9
    assert turning > SEGMENTS // 2


def test_a_claim_without_what_errors_take_is_caught() -> None:
    rng = np.random.default_rng(6)
    caught = [made for made in map(segment, range(SEGMENTS)) if moving(made, rng).min() < claimed(made).nominal - 1e-9]
    assert len(caught) > SEGMENTS // 2


def test_the_claim_is_not_far_below_what_happens() -> None:
    rng, shares = np.random.default_rng(7), []
    for made in map(segment, range(SEGMENTS)):
        growth = claimed(made)
        if growth.lost > 1e-7:
            shares.append((growth.nominal - float(moving(made, rng).min())) / growth.lost)
    # Of what errors may take so many samples come to a good part.
    assert np.median(shares) > 0.4


def test_what_rows_turn_alike_cancels() -> None:
    """Two corners beside each other, far from the origin, on one floor: as one is held, the other hardly turns."""
    corners, half = np.array([[0.1, 0.02, 0.0], [0.1, 0.021, 0.0]]), np.repeat([1e-4, 1e-3], 3)
    start, goal = (Pose(np.zeros(3), exp(np.array([turn, 0.0, 0.0]))) for turn in (0.02, 0.0))
    rows = points_above(corners, np.array([0.0, 0.0, 1.0]), 0.0).over(start, goal)
    down, twist = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), start.local(goal)
    inside = twist - down * float(rows[1].N[0] @ twist)
    curvature, N = Curvature.of(*rows, twist), np.array([end.N for end in rows])
    grows, _, lost, _ = curvature.inside(N, np.array([inside, down]), half, np.zeros(2))
    assert grows == pytest.approx(-0.02 * 1e-3 * np.array([np.cos(0.02), 1.0]), rel=1e-9)  # their distance, as it turns
    each = curvature.variation(half, inside)
    assert 0.0 < lost < 0.05 * each.sum()


@pytest.mark.parametrize("index", range(0, SEGMENTS, 40))
def test_power_is_the_derivative_of_what_a_motion_does(index: int) -> None:
    made = segment(index)
    motion = np.random.default_rng(index).normal(size=6)
    forms = made_form(made.assembly, made.piece.making[0], made.piece.held)
    rows, slide, spin = forms.at(made.piece.goal), *halves(motion)
    end = vector(rows.turned.w[0]), vector(rows.turned.b[0]), vector(rows.turned.y[0])
    found = np.concatenate(power.py_func(forms.table[0], end, slide, spin))
    step = 1e-6
    for axis, unit in enumerate(np.eye(6)):
        goal = made.piece.goal
        there, back = (Pose(goal.p + d[:3], exp(d[3:]) @ goal.R) for d in (step * unit, -step * unit))
        slope = float((forms.at(there).N[0] - forms.at(back).N[0]) @ motion) / (2.0 * step)
        assert found[axis] == pytest.approx(slope, rel=1e-6, abs=1e-8)
