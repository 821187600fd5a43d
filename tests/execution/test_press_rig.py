"""The rig for presses, on a cube of 10 mm before floors, walls and slopes: ends, held axes, damping, retries.

Laws are asked for without noise of sensors, so that they hold to the period. The last tests are controls on the square
peg: what must not seat does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, product

import numpy as np
import pytest
from numpy.typing import ArrayLike

from fmopt.execution import press_controller
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.press_controller import Errors
from fmopt.execution.press_rig import PressRig
from fmopt.execution.press_servo import BACKING, RUNNING
from fmopt.execution.press_trials import carry_out, drawn_errors
from fmopt.execution.rotation import between
from fmopt.plan.evidence import TrialOutcome
from fmopt.plan.field_types import Six
from fmopt.plan.press import Attempt, End, Force, Level, Press, PressPlan, PressRobot, Seat, Standstill, Time, Travel
from fmopt.spatial.values import Array
from tests.shared.plans.press_plan import press_choosing, press_plan

ROBOT = PressRobot((2e4, 100.0), (400.0, 0.16), 2.0, 0.0098, (20.0, 1.0), arm=0.01, noise=(0.0, 0.0, 0.0, 0.0))
LATE = round(ROBOT.delay / ROBOT.period)
STILL = Standstill(3e-5, 0.15, 0.1, "seated")
NOTHING: Six = (0.0,) * 6
NEXT_TO_NO_FRICTION = 1e-3


def box(low: Sequence[float], high: Sequence[float]) -> Array:
    """Vertices of a cuboid, mm in, m out."""
    return 1e-3 * np.array([*product(*zip(low, high, strict=True))], dtype=np.float64)


CUBE = box((-5, -5, 0), (5, 5, 10))
FLOOR = box((-30, -30, -10), (30, 30, 0))
WALL = box((8, -30, 0), (20, 30, 30))
FAR = box((100, 100, 0), (110, 110, 10))
SLOPE = 1e-3 * np.array([(x, y, z) for y in (-20, 20) for x, z in ((-20, -30), (20, 10), (20, -30))])  # 45°


def press(gives: str, wrench: Six, *ends: End, reach: float = 0.05, speed: float = 0.02, twist: Six = NOTHING) -> Press:
    """A press whose axes in `gives` ("x z") give way."""
    x, y, z, rx, ry, rz = (name in gives.split() for name in ("x", "y", "z", "rx", "ry", "rz"))
    speeds = (speed, speed, speed, 0.5, 0.5, 0.5)
    return Press("press", (x, y, z, rx, ry, rz), twist, wrench, speeds, (reach, 1.0), ends)


def at(x: float, z: float, *presses: Press) -> Attempt:
    return Attempt((x, 0.0, z, 0.0, 0.0, 0.0), presses)


def errors_of(n: int, **more: ArrayLike) -> Errors:
    """Nothing off in n trials, on next to no friction, but for what is given."""
    given = {"friction": np.full(n, NEXT_TO_NO_FRICTION), **more}
    return replace(Errors.none(n, 12), **{name: np.array(value) for name, value in given.items()})


def run(
    fixed: Sequence[Array],
    attempts: Sequence[Attempt],
    errors: Errors | None = None,
    goal: tuple[float, float] = (0.003, 0.0),
    courses: Sequence[Sequence[int]] | None = None,
) -> tuple[list[TrialOutcome], dict[str, Array]]:
    """Outcomes, and mode, step, pose and time in the press of each body after every period."""
    errors = errors_of(1) if errors is None else errors
    seat = Seat((goal[0], 0.0, goal[1], 0.0, 0.0, 0.0), 1e-3, 0.01, 0.01)
    ways: dict[str, list[Array]] = {"mode": [], "step": [], "q": [], "time": []}

    def look(rig: PressRig) -> None:
        now = rig.state.mode, rig.state.step, rig.engine.qpos, rig.state.time
        for way, value in zip(ways.values(), now, strict=True):
            way.append(np.array(value))

    bodies, numbers = Bodies((CUBE,), tuple(fixed)), range(len(errors.start))
    outcomes = carry_out(bodies, PressPlan(ROBOT, tuple(attempts), 0.02, seat), errors, 1, numbers, courses, look=look)
    return outcomes, {name: np.array(way) for name, way in ways.items()}


def test_a_press_towards_a_wall_ends_by_standstill_at_the_wall() -> None:
    (one,), way = run([WALL], [at(0.0, 0.005, press("x", (5.0, *NOTHING[1:]), STILL, Time(3.0)))], goal=(0.003, 0.005))
    assert one.seated, one.reasons
    assert abs(one.offset[0]) < 1e-5
    # 3 mm at 12.5 mm/s, then a window.
    assert 0.24 + STILL.window < one.seconds - press_controller._REST < 0.24 + 0.1 + STILL.window + 0.06
    assert np.ptp(way["q"][:, 0, 1:3], axis=0).max() < 1e-5
    assert 5.0 <= one.peak_force < 5.0 + 2.0 * 0.0125 * 2.0 * np.pi * ROBOT.cut_off  # and the filtered impact


def test_a_press_that_meets_nothing_ends_by_its_reach_and_the_next_attempt_seats() -> None:
    away = at(0.0, 0.005, press("x", (-5.0, *NOTHING[1:]), STILL, Time(3.0), reach=0.002))
    there = at(-0.009, 0.004, press("x", (5.0, *NOTHING[1:]), STILL, Time(3.0)))
    (alone,), _ = run([WALL], [away], goal=(0.003, 0.004))
    assert not alone.seated
    assert (alone.attempt, alone.reasons[0]) == (0, "stopped on the way")
    start = [(0.0005, -0.0003, 0.0, 0.0, 0.0, 0.01)]
    (one,), way = run([WALL], [away, there], errors_of(1, start=start), goal=(0.003, 0.004))
    assert one.seated, one.reasons
    assert one.attempt == 1
    mode, step, q = way["mode"][:, 0], way["step"][:, 0], way["q"][:, 0]
    first = np.flatnonzero(mode == BACKING)
    # Places and ways are to 20 ms: the first press moves at 12.5 mm/s when it is over, the last one stands.
    ((gone_to,), (there_at,)) = one.rests
    assert np.abs(np.array(gone_to) - q[first[0], :3]).max() < 0.0125 * 0.022
    assert np.abs(np.array(there_at) - (0.003 + one.offset[0], one.offset[1], 0.004 + one.offset[2])).max() < 1e-6
    assert (alone.rests, one.way) == (((alone.way[-1].pose[:3],),), ())
    assert (alone.way[0].time, alone.way[0].pose) == (0.0, (0.0, 0.0, 0.005, 0.0, 0.0, 0.0))
    (lost,), _ = run([WALL], [away, away], goal=(0.003, 0.004))
    assert [(press, back) for (press, back), _ in groupby(lost.way, lambda one: (one.press, one.back))] == [
        (0, False), (0, True), (1, False),
    ]  # fmt: skip
    assert 50 < len(lost.way) <= 65
    # As late as the measurement is: the place a delay ago is just beyond the reach.
    gone = np.abs(q[:, 0] - start[0][0])
    assert gone[first[0] - LATE - 1] <= 0.002 < gone[first[0] - LATE]
    # Out along the way in, then up; nothing goes across below the height to which the part is lifted.
    lag = 1.5 * 2.0 * ROBOT.back[0] * np.sqrt(ROBOT.mass / ROBOT.stiffness[0])  # of critically damped springs, and some
    back = q[first, :3] - start[0][:3]
    assert abs(back[:, 2].max() - 0.02) < lag
    on_the_way_in = (np.abs(back[:, 2] - 0.005) < lag) & (np.abs(back[:, 0]) < 0.0024)
    over_a_start = np.min([np.abs(back[:, 0]), np.abs(back[:, 0] + 0.009)], axis=0) < lag
    assert (on_the_way_in | over_a_start | (back[:, 2] > 0.02 - lag)).all()
    assert np.abs(back[:, 1]).max() < 1e-5
    # The next attempt begins off its start by the same error.
    begun = q[np.flatnonzero((step == 1) & (mode == RUNNING))[0]]
    assert np.abs(begun[:3] - (start[0][0] - 0.009, start[0][1], 0.004)).max() < 2e-5
    assert np.abs(between(begun[None, 3:], np.array([[1.0, 0.0, 0.0, 0.0]])) - start[0][3:]).max() < 1e-3


@pytest.mark.parametrize("keeps", [False, True])
def test_a_held_attitude_goes_on_from_where_it_is_measured_or_commanded(keeps: bool) -> None:
    """An edge stands on the floor: each press turns the part by the torque over the stiffness, from where it begins."""
    down = replace(press("x y z", (0.0, 0.0, -10.0, 0.0, 0.0, 0.0), Time(0.4)), keeps=keeps)
    _, way = run([FLOOR], [Attempt((0.0, 0.0, 0.0055, 0.0, 0.1, 0.0), (down,) * 5)], goal=(0.0, 0.0))
    ends = np.flatnonzero(np.diff(way["step"][:, 0]))
    turned = 0.1 - np.array([between(way["q"][k, :, 3:], np.array([[1.0, 0.0, 0.0, 0.0]]))[0, 1] for k in ends])
    each = 10.0 * 0.005 / ROBOT.stiffness[1]
    assert turned == pytest.approx(each if keeps else each * np.arange(1, len(ends) + 1), rel=0.15)


def test_a_time_out_is_no_standstill_however_still_the_part_is() -> None:
    touching = at(0.003, 0.005, press("x", (5.0, *NOTHING[1:]), STILL, Time(0.2)))
    (one,), _ = run([WALL], [touching], goal=(0.003, 0.005))
    assert one.reasons == ("stopped on the way",)


def test_a_press_without_an_end_that_comes_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(press_controller, "MAX_SECONDS", 0.5)
    (one,), _ = run([WALL], [at(0.003, 0.005, press("x", (5.0, *NOTHING[1:]), Travel(distance=0.01, then="seated")))])
    assert "took too long" in one.reasons
    assert one.seconds == pytest.approx(0.5, abs=0.01)


def test_level_travel_and_angle_end_a_press_one_delay_late() -> None:
    down: Six = (0.0, 0.0, -5.0, 0.0, 0.0, 0.0)
    attempts = [
        at(0.0, 0.01, press("z", down, Level(0.008, "seated"))),
        at(0.0, 0.01, press("z", down, Travel(distance=0.002, then="seated"))),
        at(0.0, 0.01, press("z", down, Travel(angle=0.05, then="seated"), twist=(0.0, 0.0, 0.0, 0.0, 0.5, 0.0))),
    ]
    start = np.zeros((3, 6))
    start[0, 2] = 0.001  # levels count from where the part is known to begin
    _, way = run([FAR], attempts, errors_of(3, start=start), courses=[(0,), (1,), (2,)])
    running = way["mode"] == RUNNING
    for body, gone in ((0, 0.002), (1, 0.002)):
        ended = int(np.argmin(running[:, body]))
        fallen = 0.01 + start[body, 2] - way["q"][:, body, 2]
        assert fallen[ended - LATE - 1] < gone <= fallen[ended - LATE]
    # An angle is that of the commanded twist, which needs no measurement.
    assert np.argmin(running[:, 2]) == pytest.approx(0.05 / 0.5 / ROBOT.period, abs=2)


def test_a_press_below_its_level_takes_no_time_and_the_wrench_comes_up_from_that_in_force() -> None:
    light, hard = ((0.0, 0.0, -force, 0.0, 0.0, 0.0) for force in (2.0, 16.0))  # 2 N move the part at 5 mm/s
    passed = press("z", light, Level(0.018)), press("z", hard, Level(0.019)), press("z", hard, Level(0.0179))
    _, way = run([FAR], [at(0.0, 0.02, *passed, press("z", hard, Level(0.016, "seated"), speed=0.001))])
    step, z = way["step"][:, 0], way["q"][:, 0, 2]
    assert [int(number) for number, _ in groupby(step)] == [0, 2, 3]
    # Damping is put on in 15 ms, in which 16 N at once would move the part at 20 mm/s.
    assert np.diff(z)[step[1:] == 3].min() > -0.0075 * ROBOT.period


def test_held_axes_keep_their_place_under_a_load_but_for_load_over_stiffness() -> None:
    """A cube that is pressed onto a frictionless slope of 45° is pushed across by as much as down."""
    stiffness = (0.5, 1.0, 3.0)
    attempts = [at(0.0, 0.0, press("z", (0.0, 0.0, -5.0, 0.0, 0.0, 0.0), STILL, Time(3.0)))]
    _, way = run([SLOPE], attempts, errors_of(3, stiffness=stiffness))
    for body, factor in enumerate(stiffness):
        q = way["q"][way["mode"][:, body] == RUNNING, body][-1]
        assert q[0] == pytest.approx(-5.0 / (factor * 2e4), rel=0.03)
        turn = between(q[None, 3:], np.array([[1.0, 0.0, 0.0, 0.0]]))[0]
        assert turn[1] == pytest.approx(-5.0 * 0.005 / (factor * 100.0), rel=0.05)
        assert np.abs([q[1], turn[0], turn[2]]).max() < 1e-5


def test_force_on_held_axes_ends_a_press_at_force_over_stiffness_beyond_the_wall() -> None:
    into = press("z", NOTHING, Force(6.0, "seated"), Time(3.0), twist=(0.002, 0.0, 0.0, 0.0, 0.0, 0.0))
    for factor in (0.5, 2.0):
        (one,), way = run([WALL], [at(0.0029, 0.005, into)], errors_of(1, stiffness=[factor]), goal=(0.003, 0.005))
        assert one.seated, one.reasons
        led = 0.002 * np.sum(way["mode"][:, 0] == RUNNING) * ROBOT.period
        late = 0.002 * (ROBOT.delay + ROBOT.period + 1.0 / (2.0 * np.pi * ROBOT.cut_off))  # and filtered
        damping = 2.0 * np.sqrt(factor * 2e4 * ROBOT.mass)  # critical: it pushes as well while the twist goes on
        assert led - 0.0001 == pytest.approx((6.0 - damping * 0.002) / (factor * 2e4) + late, abs=1e-5)


def test_damping_lets_a_wrench_move_no_faster_than_its_limit() -> None:
    admittance = (1.0 / 3.0, 1.0, 3.0)
    wrenches = ((0.0, 0.0, 8.0, 0.0, 0.0, 0.08), (0.0, 0.0, 1.0, 0.0, 0.0, 0.02))
    attempts = [at(0.0, 0.0, press("z rz", wrench, Time(1.5), speed=0.005)) for wrench in wrenches]
    _, way = run([FAR], attempts, errors_of(6, admittance=admittance * 2), courses=[(0,)] * 3 + [(1,)] * 3)
    last = int(np.argmax(way["mode"][:, 0] != RUNNING)) - 1
    q = way["q"][[last - 10, last]]
    speeds = (q[1, :, 2] - q[0, :, 2]) / (10 * ROBOT.period)
    rates = between(q[1, :, 3:], q[0, :, 3:])[:, 2] / (10 * ROBOT.period)
    for body, (wrench, factor) in enumerate(product(wrenches, admittance)):
        assert speeds[body] == pytest.approx(min(factor * wrench[2] / 400.0, 0.005), rel=1e-3)
        assert rates[body] == pytest.approx(min(factor * wrench[5] / 0.16, 0.5), rel=1e-2)


def test_an_outcome_does_not_depend_on_which_trials_run_beside_it() -> None:
    """To the last bit, with noise, frictions of their own, and trials that fail and try again beside others."""
    start = (1e-3, 1e-3, 0.0, 0.02, 0.02, 0.02)
    away = at(0.0, 0.005, press("x z", (-5.0, 0.0, -4.0, 0.0, 0.0, 0.0), STILL, Time(0.3), reach=0.002))
    corner = at(0.0, 0.002, press("x y z rx ry rz", (5.0, 0.0, -6.0, 0.0, 0.0, 0.0), STILL, Time(3.0)))
    seat = Seat((0.003, 0.0, 0.0, 0.0, 0.0, 0.0), 1e-3, 0.01, 0.01, loose=0.01)
    plan = PressPlan(replace(ROBOT, noise=PressRobot.noise), (away, corner), 0.01, seat)
    numbers, courses = [4, 7, 2, 9], [(1,), (0, 1), (0,), (1, 0)]
    errors = drawn_errors(replace(press_choosing().conditions, start=start, friction=(0.1, 0.5)), 2, 3, numbers)
    bodies = Bodies((CUBE,), (FLOOR, WALL))
    together = carry_out(bodies, plan, errors, 3, numbers, courses, threads=2)
    assert {one.attempt for one in together} == {0, 1}
    for k in (1, 3):
        assert carry_out(bodies, plan, errors.of([k]), 3, [numbers[k]], [courses[k]]) == [together[k]]


def test_interference_and_starts_outside_the_mouth_do_not_seat() -> None:
    """Positive controls: the same draws, that seat with the parts as they are, fail where nothing could seat."""
    choosing, plan, n = press_choosing(), press_plan(), 2
    errors = drawn_errors(choosing.conditions, 40, 5, range(n))
    clearance, once = plan.seat.clearance, [(0,)] * n
    behind = np.array([-0.006, -0.006, 0.0, 0.0, 0.0, 0.0])  # the corner that the part is pressed into
    both = errors.followed_by(replace(errors, start=errors.start + behind))
    seated = [one.seated for one in carry_out(choosing.bodies, plan, both, 5, range(2 * n), once * 2)]
    assert seated == [True] * n + [False] * n
    wider = 1.0 + (clearance + 5e-6) / 0.01  # an interference of 10 µm over the width of 20 mm
    grown = tuple(piece * (wider, wider, 1.0) for piece in choosing.bodies.moving)
    tight = carry_out(replace(choosing.bodies, moving=grown), plan, errors, 5, range(n), once)
    assert not any(one.seated for one in tight)
