"""Carry the presses of `presses.yaml` out with the Cartesian compliance controller of ROS 2: python3 executor.py

`Executor` is without ROS: stepped with time, pose and wrench, it returns a command. Its target follows the part along
axes that give way, so that the controller's springs act on held axes alone. Poses are (7,): position, m, and quaternion
x, y, z, w. The exit code is the outcome: 0 seated, 1 stopped on the way, 2 no attempt seated the part, 3 not begun.
"""

from collections.abc import Generator, Mapping, Sequence
from math import atan2, cos, exp, hypot, inf, pi, sin
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Acts: TypeAlias = Generator["HandCommand", None, Any]

OUTCOMES = "seated", "stopped on the way", "no attempt seated the part", "bring the part near its start first"
AXES = ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")
SAMPLE = 0.01  # s between the poses that a standstill is judged by, and that the part goes back along
SETTLING = 0.25  # s at rest after a way, of zeroing the sensor there, and at rest once more
FADING = 0.1  # s in which the wrench is taken away before the part goes back
EASED = 0.015  # s in which the damping of a press passes to that of the next
ARRIVED = (1e-3, 1e-2)  # m and rad by which the part may miss a start
BACKED = 0.7  # of the limits of force and torque, with which the part is led back
BEHIND = 0.1  # of the speed on a way, where the part is further behind than these limits allow
HELD, FREE, ZERO = np.zeros(6, bool), np.ones(6, bool), np.zeros(6)


class HandCommand(NamedTuple):
    """Target pose (7,) and wrench (6,) on the part about its origin, N and N·m, in the base; gains in the hole's axes.

    Axes (6,) that give way, stiffness (2,) of the others, N/m and N·m/rad, and damping (6,), N·s/m and N·m·s/rad.
    """

    pose: Array
    wrench: Array
    gives: Bools
    stiffness: Array
    damping: Array


class Executor:
    """The presses of a plan, one after the other, until there is an `outcome`; `at` counts attempts and presses."""

    def __init__(self, plan: Mapping[str, Any]) -> None:
        self.plan, self.robot, self.hole = plan, plan["robot"], _pose_of(plan["hole"])
        self.outcome: int | None = None
        self.at, self.time, self.zero = (0, -1), -inf, ZERO
        self._least, self._held = (np.repeat(self.robot[key], 3) for key in ("damping", "held_damping"))
        self._wrench, self._resist, self._trail, self._acts = ZERO, ZERO, list[Array](), self._insert()

    def step(self, time: float, pose: Array, wrench: Array) -> HandCommand:
        """Take the time, s, the pose in the base and the wrench of contacts (as in a command), and command a period."""
        self.seen = self._in_hole(pose)
        if self.time == -inf:
            self.time, self._felt, self._lead = time, wrench, self.seen
        self._period, self.time = time - self.time, time
        self._felt = self._felt + (1.0 - exp(-2.0 * pi * self.robot["cut_off"] * self._period)) * (wrench - self._felt)
        if self.outcome is None:
            try:
                return next(self._acts)
            except StopIteration as end:
                self.outcome = end.value
        return self.hold()

    def hold(self) -> HandCommand:
        """Hold the part where it is."""
        self._lead = self.seen
        return self._command()

    def _command(self, gives: Bools = HELD, wrench: Array = ZERO, share: float = 1.0) -> HandCommand:
        """Let the lead follow the part along axes that give way, and limit that of the others by force and torque."""
        lead, stiffness = np.where(gives, 0.0, _difference(self._lead, self.seen)), np.array(self.robot["stiffness"])
        self._lead, self._behind = _moved(self.seen, lead), False
        for half, most in zip(np.split(lead, 2), share * np.array(self.robot["limits"]) / stiffness, strict=True):
            self._behind |= hypot(*half) > most
            half *= min(1.0, most / max(hypot(*half), 1e-12))
        target, q = _moved(self.seen, lead), self.hole[3:]
        pose = np.array([*(_turned(q, target[:3]) + self.hole[:3]), *_product(q, target[3:])])
        applied = np.concatenate([_turned(q, half) for half in np.split(np.where(gives, wrench, 0.0), 2)])
        stiffness[gives.reshape(2, 3).all(axis=1)] = 0.0
        damping = np.where(gives, np.maximum(self._resist, self._least), self._held)
        return HandCommand(pose, applied, gives, stiffness, damping)

    def _insert(self) -> Acts:
        for number, attempt in enumerate(self.plan["attempts"]):
            way = [self._in_hole(_pose_of(one)) for one in attempt["way"]]
            if number == 0 and hypot(*(way[-1] - self.seen)[:3]) > self.plan["near"]:
                return 3
            yield from self._along(way)
            self.zero = yield from self._rest()
            yield from self._rest()
            missed = _difference(way[-1], self.seen)
            if hypot(*missed[:3]) > ARRIVED[0] or hypot(*missed[3:]) > ARRIVED[1]:
                return 1
            self._trail, then = [], ""
            for count, press in enumerate(attempt["presses"]):
                self.at = number, count
                then = yield from self._press(press)
                if then != "next":
                    break
            if then in ("next", "seated"):
                return 0
            yield from self._back()
            if then == "fail":
                return 1
        return 2

    def _press(self, press: Mapping[str, Any]) -> Acts:
        """Press until one of the ends is reached, and return what follows."""
        request, rocking, shifts = press["set_force_mode"], press["rocking"], list[Array]()
        gives = np.array([request[f"selection_vector_{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")])
        wrench, speed = (np.where(gives, _six_of(request[key]), 0.0) for key in ("wrench", "speed_limits"))
        wanted = np.where(gives, np.maximum(self._least, np.abs(wrench) / np.maximum(speed, 1e-9)), 0.0)
        twist, reference = np.where(gives, 0.0, press["twist"]), np.array(press["reference"])
        begun, start, before, resisted = self.seen, self.time, self._wrench, self._resist
        ratio = np.divide(wanted, resisted, out=np.ones(6), where=(passes := np.minimum(wanted, resisted) > 0.0))
        self._lead = np.array([*begun[:3], *(self._lead if press["keeps"] else begun)[3:]])
        while True:
            elapsed, shift = self.time - start, np.where(gives, _difference(self.seen, begun), 0.0)
            if elapsed >= SAMPLE * len(shifts):
                shifts.append(shift * np.repeat([1.0, self.robot["arm"]], 3))
                self._trail.append(self.seen)
            if then := self._end(press, elapsed, shift, gives, shifts):
                return then
            share = min(elapsed / max(press["ramp"], 1e-3), 1.0)
            self._wrench = (1.0 - share) * before + share * wrench
            self._resist = np.where(passes, resisted * ratio ** min(elapsed / EASED, 1.0), wanted)
            self._lead = _moved(self._lead, self._period * twist)
            if rocking is not None:
                gone, phase = min(elapsed / rocking["seconds"], 1.0), 2.0 * pi * rocking["rate"] * elapsed
                angle = rocking["angle"] * min(1.0, 4.0 * gone) * (1.0 - gone)
                cone = _turn(np.array([angle * cos(phase), angle * sin(phase), 0.0]))
                self._lead = np.array([*self._lead[:3], *_product(cone, begun[3:])])
            given, arm = np.where(gives, self._wrench, 0.0), _turned(self.seen[3:], reference)
            yield self._command(gives, given + np.array([0.0, 0.0, 0.0, *np.cross(arm, given[:3])]))

    def _end(self, press: Any, elapsed: float, shift: Array, gives: Bools, shifts: list[Array]) -> str:
        """Name what follows where an end is reached: of several the first in the list."""
        z, way, led = self.seen[2], hypot(*shift[:3]), elapsed * hypot(*press["twist"][3:])
        force = _turned(_conjugate(self.hole[3:]), (self._felt - self.zero)[:3])
        for end in press["ends"]:
            kind, then = end["kind"], str(end["then"])
            if kind == "level":
                reached = z <= end["z"]
            elif kind == "standstill":
                spread = np.ptp(shifts[-round(end["window"] / SAMPLE) - 1 :], axis=0)
                reached = elapsed >= end["window"] + end["armed"] and hypot(*spread) < end["displacement"]
                then = then if z <= end.get("below", inf) else end["else_then"]
            elif kind == "travel":
                reached = way >= end.get("distance", inf) or led >= end.get("angle", inf)
            elif kind == "force":
                reached = hypot(*np.where(gives[:3], 0.0, force)) >= end["force"]
            else:
                reached = elapsed >= end["seconds"]
            if reached:
                return then
        return "retry" if way > press["reach"][0] or hypot(*shift[3:]) > press["reach"][1] else ""

    def _back(self) -> Acts:
        """Take the wrench away and go back along the way in."""
        begun, before, self.at = self.time, self._wrench, (self.at[0], -1)
        while (gone := (self.time - begun) / FADING) < 1.0:
            yield self._command(FREE, (1.0 - gone) * before)
        self._wrench = self._resist = ZERO
        yield from self._along(self._trail[::-1])

    def _along(self, poses: Sequence[Array]) -> Acts:
        """Lead the part through poses, slower where it stays behind, and rest at the last."""
        gone = 0.0
        for pose in poses:
            start, way = self._lead, _difference(pose, self._lead)
            seconds = max(hypot(*way[:3]) / self.robot["back"][0], hypot(*way[3:]) / self.robot["back"][1])
            while gone < seconds:
                self._lead = _moved(start, gone / seconds * way)
                yield self._command(share=BACKED)
                gone += self._period * (BEHIND if self._behind else 1.0)
            gone, self._lead = gone - seconds, pose
        yield from self._rest()

    def _rest(self) -> Acts:
        """Hold the part for a while, and return the mean of what is felt."""
        begun, readings = self.time, list[Array]()
        while self.time - begun < SETTLING:
            yield self._command()
            readings.append(self._felt)
        return np.mean(readings, axis=0)

    def _in_hole(self, pose: Array) -> Array:
        back = _conjugate(self.hole[3:])
        return np.array([*_turned(back, pose[:3] - self.hole[:3]), *_product(back, pose[3:])])


def _pose_of(message: Mapping[str, Mapping[str, float]]) -> Array:
    place, attitude = message["position"], message["orientation"]
    return np.array([*(place[axis] for axis in "xyz"), *(attitude[axis] for axis in "xyzw")])


def _six_of(message: Mapping[str, Mapping[str, float]]) -> Array:
    return np.array([half[axis] for half in message.values() for axis in "xyz"])


def _product(a: Array, b: Array) -> Array:
    """The turn b, then a."""
    (x, y, z, w), (i, j, k, r) = a.tolist(), b.tolist()
    vector = [w * i + x * r + y * k - z * j, w * j - x * k + y * r + z * i, w * k + x * j - y * i + z * r]
    return np.array([*vector, w * r - x * i - y * j - z * k])


def _conjugate(q: Array) -> Array:
    return np.array([-q[0], -q[1], -q[2], q[3]])


def _turned(q: Array, v: Array) -> Array:
    return _product(_product(q, np.array([*v, 0.0])), _conjugate(q))[:3]


def _turn(r: Array) -> Array:
    """The quaternion of a rotation vector (3,), rad."""
    angle = hypot(*r)
    return np.array([*(0.5 * np.sinc(0.5 * angle / pi) * r), cos(0.5 * angle)])


def _moved(pose: Array, by: Array) -> Array:
    """A pose shifted and turned by (6,), m and rad, in the axes that it is stated in."""
    return np.array([*(pose[:3] + by[:3]), *_product(_turn(by[3:]), pose[3:])])


def _difference(pose: Array, other: Array) -> Array:
    """Shift and turn (6,), m and rad, from another pose to a pose."""
    q = _product(pose[3:], _conjugate(other[3:]))
    q, size = q if q[3] > 0.0 else -q, hypot(*q[:3])
    return np.array([*(pose[:3] - other[:3]), *(2.0 * atan2(size, q[3]) / max(size, 1e-12) * q[:3])])


def main() -> int:
    """Run the node until the presses have ended; returns the outcome."""
    import rclpy
    from geometry_msgs.msg import PoseStamped, WrenchStamped
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # an interruption has the part held, below
    node = rclpy.create_node("fmopt_executor")
    file = node.declare_parameter("file", str(Path(__file__).with_name("presses.yaml"))).value
    name = node.declare_parameter("controller", "cartesian_compliance_controller").value
    plan = yaml.safe_load(Path(file).read_text("utf-8"))
    node.get_logger().info(f"{name}: waiting for current_pose and ft_sensor_wrench")
    executor, sensor, felt = Executor(plan), _pose_of(plan["sensor"]), np.full(6, np.nan)
    # Shares of the hole's axes in a mobility along each axis of the base.
    shares = np.array([_turned(executor.hole[3:], axis) for axis in np.eye(3)]).T ** 2
    stated, refused = dict[str, float](), list[str]()
    frames = node.create_publisher(PoseStamped, f"/{name}/target_frame", 3)
    wrenches = node.create_publisher(WrenchStamped, f"/{name}/target_wrench", 10)
    parameters = node.create_client(SetParameters, f"/{name}/set_parameters")

    def send(command: HandCommand) -> None:
        frame, wrench, given = PoseStamped(), WrenchStamped(), command.wrench - executor.zero
        for field, axes, values in (
            (frame.pose.position, "xyz", command.pose[:3]),
            (frame.pose.orientation, "xyzw", command.pose[3:]),
            (wrench.wrench.force, "xyz", given[:3]),
            (wrench.wrench.torque, "xyz", given[3:]),
        ):
            for axis, value in zip(axes, values.tolist(), strict=True):
                setattr(field, axis, value)
        for message, publisher in ((frame, frames), (wrench, wrenches)):
            message.header.stamp, message.header.frame_id = node.get_clock().now().to_msg(), plan["frame_id"]
            publisher.publish(message)
        gains = plan["gain"] * np.concatenate([shares @ (1.0 / half) for half in np.split(command.damping, 2)])
        wanted = {f"stiffness.{axis}": float(command.stiffness[k // 3]) for k, axis in enumerate(AXES)}
        wanted |= {f"pd_gains.{axis}.p": float(gains[k]) for k, axis in enumerate(AXES)}
        if changed := {key: new for key, new in wanted.items() if abs(new - stated.get(key, inf)) > 0.01 * new}:
            stated.update(changed)
            listed = [Parameter(key, value=new).to_parameter_msg() for key, new in changed.items()]
            parameters.call_async(SetParameters.Request(parameters=listed)).add_done_callback(check)

    def check(future: Any) -> None:
        refused.extend(result.reason for result in future.result().results if not result.successful)

    def feel(message: Any) -> None:
        felt[:] = [getattr(half, axis) for half in (message.wrench.force, message.wrench.torque) for axis in "xyz"]

    def see(message: Any) -> None:
        at, q, stamp = message.pose.position, message.pose.orientation, message.header.stamp
        pose = np.array([at.x, at.y, at.z, q.x, q.y, q.z, q.w])
        if np.isfinite(felt).all() and executor.outcome is None:
            force, torque = (_turned(_product(pose[3:], sensor[3:]), half) for half in np.split(felt, 2))
            arm = np.cross(_turned(pose[3:], sensor[:3]), force)
            send(executor.step(stamp.sec + 1e-9 * stamp.nanosec, pose, np.array([*force, *(torque + arm)])))

    node.create_subscription(WrenchStamped, f"/{name}/ft_sensor_wrench", feel, 10)
    node.create_subscription(PoseStamped, f"/{name}/current_pose", see, 3)
    if not parameters.wait_for_service(10.0):
        raise SystemExit(f"/{name} is not there: load and activate the controller of controllers.yaml first")
    try:
        while executor.outcome is None and not refused:
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        outcome = executor.outcome = 1 if executor.outcome is None else executor.outcome
        if executor.time > -inf:
            send(executor.hold())
            rclpy.spin_once(node, timeout_sec=0.1)
    node.get_logger().info(f"fmopt: {'; '.join(refused) or OUTCOMES[outcome]}")
    return outcome


if __name__ == "__main__":
    raise SystemExit(main())
