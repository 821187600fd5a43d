"""The ROS 2 executor of presses: on draws of the evidence, without an engine, and as a node among stand-ins of ROS."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from fmopt.cli.entry import app
from fmopt.execution.engines.engine import Bodies
from fmopt.plan import Plan, write
from fmopt.plan.export import press_ros2, ros2
from fmopt.plan.press import Attempt, End, Force, Level, Press, Rocking, Standstill, Time, Travel
from fmopt.spatial.se3 import Pose, exp
from tests.shared.plans.press_executor import ExecutorRobot, loaded
from tests.shared.plans.press_plan import BASE, drawn, press_plan, press_plan_document

PERIOD = 0.002  # s
DOWN = (0.0, 0.0, -5.0, 0.0, 0.0, 0.0)


def test_the_executor_seats_the_part_as_the_plan_does(plan: Plan, tmp_path: Path) -> None:
    write(press_plan_document(), tmp_path / "plan.json")
    words = ["export", "plan.json", "--to", "ros2", "--out", "made", "--base", *map(str, BASE.vector())]
    done = CliRunner().invoke(app, words)
    assert (done.exit_code, len(done.stdout.splitlines())) == (0, 3), done.output
    assert all(Path(line).exists() for line in done.stdout.splitlines())
    presses, (errors, outcomes) = press_plan(), drawn(2)
    for k, one in enumerate(outcomes):
        robot = ExecutorRobot(Bodies.of(plan), presses, BASE, errors.of([k]), k)
        assert robot.execute(Path("made")).seated == one.seated == (robot.outcome == 0)
    beside = replace(presses, attempts=presses.attempts[:1])
    press_ros2.export(plan, beside, BASE, tmp_path / "beside", "")
    errors.start[0, :2] = 0.015, 0.001
    robot = ExecutorRobot(Bodies.of(plan), beside, BASE, errors.of([0]), 0)
    assert (robot.execute(tmp_path / "beside").seated, robot.outcome) == (False, 2)
    assert robot.believed.vector() == pytest.approx(np.array(beside.attempts[0].start), abs=3e-4)


def test_the_files_have_the_keys_of_controller_and_request(plan: Plan, tmp_path: Path) -> None:
    press_ros2.export(plan, press_plan(), BASE, tmp_path, "")
    text = (tmp_path / "presses.yaml").read_text()
    assert text.startswith("# WARNING: nothing is proved of presses\n")
    whole = yaml.safe_load(text)
    for one, stated in zip(whole["attempts"], press_plan().attempts, strict=True):
        for entry, press in zip(one["presses"], stated.presses, strict=True):
            request = entry["set_force_mode"]
            assert [request.pop(f"selection_vector_{axis}") for axis in ("x", "y", "z", "rx", "ry", "rz")] == [
                *press.gives
            ]
            assert set(request) == {
                *("task_frame", "wrench", "type", "speed_limits", "deviation_limits", "damping_factor", "gain_scaling")
            }
            assert [*request["wrench"]["force"].values(), *request["wrench"]["torque"].values()] == [*press.wrench]
            assert {end["kind"] for end in entry["ends"]} == {end.kind for end in press.ends}
    parameters = yaml.safe_load((tmp_path / "controllers.yaml").read_text())[ros2.CONTROLLER]["ros__parameters"]
    assert parameters["stiffness"]["rot_z"] == press_plan().robot.stiffness[1]
    velocity = at = 0.0  # of the controller's model under 1 N, cycle by cycle
    for _ in range(2000):
        before, at = at, at + 0.02 * velocity
        velocity = 0.9 * (velocity + 0.02 * ros2.ERROR_SCALE * parameters["pd_gains"]["trans_x"]["p"])
    assert ros2.UPDATE_RATE * (at - before) * whole["robot"]["held_damping"][0] == pytest.approx(1.0)


def told(plan: Plan, folder: Path, *presses: Press, others: tuple[Attempt, ...] = ()) -> Any:
    """An executor for some presses from 10 mm above the mouth, the hole in the base, and for other attempts."""
    attempts = (Attempt((0.0, 0.0, 0.01, 0.0, 0.0, 0.0), presses), *others)
    press_ros2.export(plan, replace(press_plan(), attempts=attempts), Pose.identity(), folder, "")
    return loaded(folder).Executor(yaml.safe_load((folder / "presses.yaml").read_text()))


def press(*ends: End, gives: tuple[int, ...] = (0, 0, 1, 0, 0, 0), **others: Any) -> Press:
    """A press along z."""
    x, y, z, a, b, c = map(bool, gives)
    stated = {"twist": (0.0,) * 6, "wrench": DOWN, "speed": (0.01,) * 3 + (1.0,) * 3, "reach": (0.005, 1.0), **others}
    return Press("press", (x, y, z, a, b, c), ends=ends, **stated)


def carried(executor: Any, floor: float) -> list[tuple[tuple[int, int], Any]]:
    """Commands to a robot that is at once where it is held, and yields down to a floor; its sensor is off by 6 N."""
    pose, commands, push = np.array([0.001, 0.0, 0.011, 0.0, 0.0, 0.0, 1.0]), list[Any](), 0.0
    while executor.outcome is None and len(commands) < 5000:
        command = executor.step(10.0 + PERIOD * len(commands), pose, np.array([6.0, 0.0, push, 0.0, 0.0, 0.0]))
        commands.append((executor.at, command))
        free = pose[:3] + PERIOD * command.wrench[:3] / command.damping[:3]
        pose = np.array([*np.where(command.gives[:3], free, command.pose[:3]), *command.pose[3:]])
        push = 2e4 * max(floor - pose[2], 0.0)
        pose[2] = max(pose[2], floor)
    return commands


LATE = Time(3.0, "fail")
STILL = Standstill(1e-4, 0.1, 0.1, "seated", below=0.0065)
ENDS: list[tuple[Press, int, float]] = [
    (press(Level(0.007, "seated"), LATE), 0, 0.35),
    (press(Travel(distance=0.002, then="seated"), LATE), 0, 0.25),
    (press(STILL, LATE), 0, 0.54),
    (press(replace(STILL, below=0.0055), LATE), 2, 0.54),
    (press(Time(0.4, "seated"), Time(0.4, "fail")), 0, 0.4),
    (press(LATE, reach=(0.003, 1.0)), 2, 0.35),
    (press(Force(4.9, "fail"), LATE, gives=(0, 0, 0, 0, 0, 0), twist=(0.0, 0.0, -0.01, 0.0, 0.0, 0.0)), 1, 0.43),
    (press(Travel(angle=0.1, then="seated"), LATE, twist=(0.0, 0.0, 0.0, 0.3, 0.0, 0.4)), 0, 0.2),
    (press(Time(0.1, "next")), 0, 0.1),
]


@pytest.mark.parametrize(("one", "outcome", "seconds"), ENDS)
def test_a_press_ends_by_each_of_its_ends(plan: Plan, tmp_path: Path, one: Press, outcome: int, seconds: float) -> None:
    executor = told(plan, tmp_path, one)
    commands = carried(executor, 0.006)
    assert executor.outcome == outcome
    assert PERIOD * sum(at == (0, 0) for at, _ in commands) == pytest.approx(seconds, abs=0.02)
    assert executor.seen[2] == pytest.approx(0.01, abs=1e-4) or outcome == 0  # back at the start


def test_the_next_attempt_begins_where_it_starts_after_a_way_over_the_mouth(plan: Plan, tmp_path: Path) -> None:
    other = Attempt((0.003, 0.0, 0.007, 0.0, 0.0, 0.3), (press(Time(0.1, "seated")),))
    executor = told(plan, tmp_path, press(Time(0.4, "retry")), others=(other,))
    commands = carried(executor, 0.0)
    assert (executor.outcome, executor.at) == (0, (1, 0))
    way = np.array([one.pose for at, one in commands if at == (0, -1) and not one.gives.any()][-700:])
    assert way[(way[:, 0] > 2e-4) & (way[:, 0] < 2.8e-3), 2] == pytest.approx(0.01, abs=1e-4)
    assert way[-1] == pytest.approx([0.003, 0.0, 0.007, 0.0, 0.0, np.sin(0.15), np.cos(0.15)], abs=1e-4)


def test_the_attitude_rocks_and_the_wrench_comes_up_from_that_before(plan: Plan, tmp_path: Path) -> None:
    rocks = press(Time(1.0, "seated"), rocking=Rocking(0.08, 2.0, 1.0), wrench=(0.0, 0.0, -1.0, 0.0, 0.0, 0.0))
    executor = told(plan, tmp_path, press(Time(0.3, "next")), rocks)
    made = [command for at, command in carried(executor, 0.0) if at == (0, 1)]
    assert max(2.0 * np.linalg.norm(one.pose[3:6]) for one in made) == pytest.approx(0.06, rel=0.02)
    assert [made[k].wrench[2] for k in (0, 25, 60)] == pytest.approx([-5.0, -3.0, -1.0])
    damping = [made[k].damping[2] for k in (0, 10)]  # that of the robot, as the limit of speed asks for less
    assert damping == pytest.approx([500.0, press_plan().robot.damping[0]])


def test_a_part_far_from_its_start_is_not_begun_with_and_one_that_does_not_come_there_is_left(
    plan: Plan, tmp_path: Path
) -> None:
    for z, outcome, count in ((0.04, 3, 1), (0.015, 1, 900)):
        executor, pose = told(plan, tmp_path, press(LATE)), np.array([0.0, 0.0, z, 0.0, 0.0, 0.0, 1.0])
        commands = [executor.step(PERIOD * k, pose, np.zeros(6)) for k in range(count)]
        assert (executor.outcome, commands[-1].wrench.any()) == (outcome, False)
        assert commands[-1].pose == pytest.approx(pose)


def stamped() -> Any:
    """A message with a header, a pose and a wrench."""
    pose = SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace())
    wrench = SimpleNamespace(force=SimpleNamespace(), torque=SimpleNamespace())
    return SimpleNamespace(header=SimpleNamespace(), pose=pose, wrench=wrench)


def vector(message: Any) -> np.ndarray:
    return np.array([message.x, message.y, message.z])


class Ros:
    """Stand-ins of ROS, and a controller whose part moves at p / gain times the net force, over a floor in the hole."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, hole: Pose, start: Pose, floor: float, refuses: str) -> None:
        self.hole, self.part, self.floor, self.refuses, self.seconds = hole, start, floor, refuses, 0.0
        self.topics, self.sent, self.parameters = dict[str, Any](), dict[str, Any](), dict[str, float]()
        self.node, names = MagicMock(), ("rclpy", "rclpy.parameter", "geometry_msgs.msg", "rcl_interfaces.srv")
        ros, parameter, messages, services, *_ = modules = [MagicMock() for _ in range(7)]
        for name, module in zip((*names, "rclpy.signals", "geometry_msgs", "rcl_interfaces"), modules, strict=True):
            monkeypatch.setitem(sys.modules, name, module)
        messages.PoseStamped = messages.WrenchStamped = stamped
        parameter.Parameter = lambda name, value: SimpleNamespace(to_parameter_msg=lambda: (name, value))
        services.SetParameters.Request = lambda parameters: parameters
        ros.create_node.return_value, ros.spin_once.side_effect = self.node, self.cycle
        self.node.declare_parameter.side_effect = lambda _, value: SimpleNamespace(value=value)
        self.node.create_publisher.side_effect = lambda _, topic, depth: SimpleNamespace(
            publish=lambda message: self.sent.__setitem__(topic, message)
        )
        self.node.create_subscription.side_effect = lambda _, topic, react, depth: self.topics.update({topic: react})
        self.node.create_client.return_value.call_async.side_effect = self.set_parameters

    def set_parameters(self, parameters: list[tuple[str, float]]) -> Any:
        self.parameters |= dict(parameters)
        results = [SimpleNamespace(successful=name != self.refuses, reason=f"no {name}") for name, _ in parameters]
        answer = SimpleNamespace(result=lambda: SimpleNamespace(results=results))
        return SimpleNamespace(add_done_callback=lambda check: check(answer))

    def cycle(self, *_: Any, **__: Any) -> None:
        """A period: the controller moves the part, then both topics are heard; the sensor is off by 8 N."""
        assert self.seconds < 10.0
        at = self.hole.inverse().compose(self.part).p[2]
        felt = np.array([0.0, 8.0, 0.0]) + self.hole.R @ [0.0, 0.0, 1e5 * max(self.floor - at, 0.0)]
        if self.sent:
            frame, wrench = (self.sent[f"/{ros2.CONTROLLER}/target_{name}"] for name in ("frame", "wrench"))
            gains, stiffness = (
                np.array([self.parameters[f"{name}.trans_{axis}{last}"] for axis in "xyz"])
                for name, last in (("pd_gains", ".p"), ("stiffness", ""))
            )
            net = stiffness * (vector(frame.pose.position) - self.part.p) + vector(wrench.wrench.force) + felt
            self.part = Pose(self.part.p + PERIOD * gains / press_ros2.GAIN * net, self.part.R)
        self.seconds += PERIOD
        message, stated = stamped(), ros2.pose_message(self.part)
        message.pose.position, message.pose.orientation = (SimpleNamespace(**half) for half in stated.values())
        message.header.stamp = SimpleNamespace(sec=7, nanosec=round(1e9 * self.seconds))
        message.wrench.force = SimpleNamespace(**dict(zip("xyz", self.part.R.T @ felt, strict=True)))
        message.wrench.torque = SimpleNamespace(x=0.0, y=0.0, z=0.0)
        self.topics[f"/{ros2.CONTROLLER}/ft_sensor_wrench"](message)
        self.topics[f"/{ros2.CONTROLLER}/current_pose"](message)


@pytest.mark.parametrize(("refuses", "outcome"), [("", 0), ("stiffness.trans_x", 1)])
def test_the_node_leads_the_controller(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refuses: str, outcome: int
) -> None:
    hole = Pose(np.array([0.4, -0.1, 0.2]), exp([0.0, 0.5 * np.pi, 0.0]))
    attempt = Attempt((0.0, 0.0, 0.01, 0.1, 0.0, 0.0), (press(STILL, LATE, gives=(1, 0, 1, 0, 0, 0)),))
    press_ros2.export(plan, replace(press_plan(), attempts=(attempt,)), hole, tmp_path, "")
    ros = Ros(
        monkeypatch, hole, hole.compose(Pose(np.array([0.001, 0.0, 0.011]), exp([0.1, 0.0, 0.0]))), 0.006, refuses
    )
    assert loaded(tmp_path).main() == outcome
    said = ros.node.get_logger.return_value.info.call_args.args[0]
    assert said == ("fmopt: no stiffness.trans_x" if refuses else "fmopt: seated")
    if not refuses:
        assert hole.inverse().compose(ros.part).p == pytest.approx([0.0, 0.0, 0.006], abs=1e-4)
        assert vector(ros.sent[f"/{ros2.CONTROLLER}/target_wrench"].wrench.force) == pytest.approx([0.0, -8.0, 0.0])
    assert {name.partition(".")[0] for name in ros.parameters} == {"stiffness", "pd_gains"}
    assert len(ros.parameters) == 12
