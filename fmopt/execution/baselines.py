"""What people do without a plan, in the same rig: straight compliant push, spiral, random search, a tilt by hand.

Each method knows the fit as its user would: the hole's place, the depth, the clearance, the part's corner, and how far
the part may be off at the start. What it uses besides was set while looking at the square peg with 0.1 mm of
clearance a side and errors of up to 1 mm and 1°, and is given with its constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmopt.execution.program import DONE, FAILED, Program, Step
from fmopt.execution.robot import Robot
from fmopt.execution.summary import Fit
from fmopt.plan import Plan
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

HEIGHT = 0.001  # m above the mouth, at the start
SPEED = 0.02  # m/s, before and after contact
PRESS = 8.0  # N, while searching
TOUCH = 4.0  # N, that a guarded move stops at
PUSH = 20.0  # N, of the last push
SEATED = 0.2  # of the clearance: so near the bottom the last push ends
ENTERED = 0.0005  # m below the mouth: the search has found the hole
PITCH = 1.0  # clearances between the turns of the spiral
DITHERS = 300
SOFT = 0.1  # share of the robot's stiffness in the straight push
TILT = np.radians(8.0)
UPRIGHT = 0.7  # share of the tilt that is turned back before the last push
CORNER = 6.0  # N, towards each wall
_INFINITE = 60.0  # s and m
_UPRIGHT = Pose(np.array([0.0, 0.0, HEIGHT]), np.eye(3))


@dataclass(frozen=True)
class BaselineTask:
    """What a method may know: the fit, half the leading face (2,), m, and how far the part may be off, m."""

    fit: Fit
    half: tuple[float, float]
    reach: float
    limits: tuple[float, float]

    @staticmethod
    def of(plan: Plan) -> BaselineTask:
        """Of a plan; its moves are not looked at."""
        body, vertices = plan.moving.body, np.array(plan.moving.body.vertices)
        leading = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-6]
        limits = (max(PUSH, plan.specification.contact_force), plan.specification.torque_limit)
        half = np.abs(leading[:, :2]).max(axis=0)
        for vertex, radius in body.balls:  # whose vertices are no corners, but centres
            half = np.maximum(half, np.abs(vertices[vertex, :2]) + radius)
        reach = float(np.hypot(plan.start_box[0], plan.start_box[1]))
        return BaselineTask(Fit.of(plan), (float(half[0]), float(half[1])), reach, limits)

    def program(self, name: str, start: Pose, steps: tuple[Step, ...]) -> Program:
        """A program without friction to make up for."""
        return Program(name, start, self.fit.rho, SPEED, steps, 0.0, self.limits)

    @property
    def bottom(self) -> float:
        """z at which the part counts as seated, m."""
        return float(self.fit.goal.p[2]) + SEATED * self.fit.clearance


def _step(name: str, move: int, servoed: str, twist: Array, follow: tuple[int, int, int], **more: Any) -> Step:
    """A step whose position axes are named by letters: x, y, z and a, b, c for the turns about them.

    The index of the next step follows when it stops, when its travel and when its time is used up; more are fields.
    """
    P = np.diag([float(axis in servoed) for axis in "xyzabc"])
    given: dict[str, Any] = {"frame": Pose.identity(), "hold": np.zeros((2, 6)), "push": PUSH, "timeout": _INFINITE}
    given |= dict(zip(("on_stop", "on_end", "on_late"), follow, strict=True))
    return Step(name, move, position=P, twist=twist, **(given | more))


def _held(x: float, y: float, z: float) -> Array:
    """A force to apply all along a step (2, 6)."""
    return np.tile(np.array([x, y, z, 0.0, 0.0, 0.0]), (2, 1))


def _down(move: int, task: BaselineTask, servoed: str, soft: float, hold: Array) -> Step:
    """The last push."""
    twist, follow = np.array([0.0, 0.0, -SPEED, 0.0, 0.0, 0.0]), (DONE, FAILED, FAILED)
    limits = {"travel": _INFINITE, "timeout": 2.0 * task.fit.depth / SPEED}
    return _step("push", move, servoed, twist, follow, hold=hold, deep=task.bottom, soft=soft, **limits)


def push(plan: Plan, robot: Robot) -> Program:
    """Straight down on soft springs."""
    task = BaselineTask.of(plan)
    return task.program("push", _UPRIGHT, (_down(0, task, "xyzabc", SOFT, _held(0.0, 0.0, 0.0)),))


def spiral(plan: Plan, robot: Robot) -> Program:
    """Pressed on the mouth, the part follows a spiral until it drops, and is pushed down.

    Pressing lays its face flat on the mouth, so that the tilt is gone; yaw is held.
    """
    task = BaselineTask.of(plan)
    pitch, turns = PITCH * task.fit.clearance, 1.2 * task.reach / (PITCH * task.fit.clearance)
    # With the root of the share the steps are about equally long, as the spiral's length grows with angle².
    angle = 2.0 * np.pi * np.sqrt(np.linspace(0.0, 1.0, max(int(24 * turns), 8))) * turns
    points = pitch * angle[:, None] / (2.0 * np.pi) * np.column_stack([np.cos(angle), np.sin(angle)])
    return _search("spiral", task, points)


def dither(plan: Plan, robot: Robot) -> Program:
    """As the spiral, but to random places in the disc that the start error spans."""
    # A seed of its own: every chunk of trials, in whichever process, has the same places.
    task, random = BaselineTask.of(plan), np.random.default_rng(0)
    # With the root they are uniform in the area of the disc, not along its radius.
    angle, radius = random.uniform(0.0, 2.0 * np.pi, DITHERS), 1.2 * task.reach * np.sqrt(random.uniform(size=DITHERS))
    return _search("dither", task, radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _search(name: str, task: BaselineTask, points: Array) -> Program:
    ways = np.diff(np.vstack([np.zeros((1, 2)), points]), axis=0)
    ways = ways[np.linalg.norm(ways, axis=1) > 1e-7]  # a spiral begins where the part is: no direction leads there
    last = len(ways) + 1
    down = np.array([0.0, 0.0, -SPEED, 0.0, 0.0, 0.0])
    # What is not stopped half a millimetre below the mouth is in the hole already, and is pushed on.
    touch = _step("touch", 0, "xyzabc", down, (1, last, FAILED), travel=HEIGHT + ENTERED, push=TOUCH, **_felt(2))
    steps, hold = [touch], _held(0.0, 0.0, -PRESS)
    for k, way in enumerate(ways):
        length = float(np.linalg.norm(way))
        twist = np.array([*way / length * SPEED, 0.0, 0.0, 0.0, 0.0])
        follow = (last, k + 2 if k + 1 < len(ways) else FAILED, FAILED)
        steps.append(_step("search", 1, "xyc", twist, follow, travel=length, hold=hold, deep=-ENTERED))
    return task.program(name, _UPRIGHT, (*steps, _down(2, task, "z", 1.0, _held(0.0, 0.0, 0.0))))


def _felt(axis: int) -> dict[str, Any]:
    """A stop by force along an axis."""
    return {"gain": np.eye(6)[axis], "force": TOUCH}


def tilt(plan: Plan, robot: Robot) -> Program:
    """Four phases: down with one corner in the hole, to both walls, upright against them, down.

    Yaw is left free from the walls on, and the last of the tilt too.
    """
    task = BaselineTask.of(plan)
    turn = TILT * np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    corner = exp(turn) @ np.array([-task.half[0], -task.half[1], 0.0])
    inside = 2.0 * task.reach + task.fit.clearance  # m of the corner from either wall: more than the part may be off
    wall = np.array([-task.half[0], -task.half[1]]) - task.fit.clearance + inside
    start = Pose(np.array([*(wall - corner[:2]), HEIGHT - corner[2]]), exp(turn))
    ways = [np.zeros(6) for _ in range(4)]
    ways[0][2], ways[1][0], ways[2][1] = -SPEED, -0.5 * SPEED, -0.5 * SPEED
    ways[3][3:] = -turn / TILT * robot.turning
    angle = UPRIGHT * TILT * task.fit.rho  # m in the metric of ρ
    on_top, at_x, at_both = (_held(x, y, -CORNER) for x, y in ((0.0, 0.0), (-CORNER, 0.0), (-CORNER, -CORNER)))
    steps = (
        _step("down", 0, "xyzabc", ways[0], (1, FAILED, FAILED), travel=0.01, push=TOUCH, **_felt(2)),
        _step("to x", 1, "xyab", ways[1], (2, FAILED, FAILED), travel=0.01, hold=on_top, push=CORNER, **_felt(0)),
        _step("to y", 2, "yab", ways[2], (3, FAILED, FAILED), travel=0.01, hold=at_x, push=CORNER, **_felt(1)),
        _step("upright", 3, "abc", ways[3], (4, 4, 4), travel=angle, hold=at_both, frame=Pose(corner, np.eye(3))),
        _down(4, task, "z", 1.0, _held(-1.0, -1.0, 0.0)),
    )
    return task.program("tilt", start, steps)


BASELINES: dict[str, Callable[[Plan, Robot], Program]] = {m.__name__: m for m in (push, spiral, dither, tilt)}
