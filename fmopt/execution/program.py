"""What a robot runs: steps, each a hybrid servo with a twist until it stops, and which step comes next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fmopt.execution.robot import Robot
from fmopt.plan import Plan
from fmopt.plan.guarded_moves import PlanMove, moves, to_frame
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Value

DONE, FAILED = -1, -2
COLUMNS = (
    *("travel", "timeout", "due", "force", "deep", "push", "soft"),
    *("on_stop", "on_end", "on_late", "move", "touch", "sure", "gentle"),
)
_GIVE = 2.0  # of what the servo's spring gives way under a contact's force, by which the part may go on as it is felt
_EARLY = 2.0  # bounds of its travel by which a move may end early: where it begins, the part may have settled further
_LATE = 2.0  # durations that a piece of a move may take, as the plan gives its last


@dataclass(frozen=True, eq=False)
class Step(Value, position=(6, 6), twist=(6,), hold=(2, 6), rubbing=(6,), gain=(6,)):
    """One hybrid motion."""

    name: str
    move: int  # number of the move that it belongs to; the reference pose starts anew where the part is at each move
    frame: Pose  # compliance frame, turned as in B, its origin from the moving frame's, axes of B; goes with the part
    position: Array  # projector (6, 6) of twists in the frame's coordinates onto the position-controlled ones
    twist: Array  # (6,) of the moving frame's origin in axes of B, m/s and rad/s
    hold: Array  # wrenches (2, 6) to apply at the start and at the end of its travel, in the frame's coordinates
    travel: float  # way along the twist, m in the metric of ρ, for which it is run
    timeout: float  # s since the move began after which the step ends, wherever it is
    push: float  # limit of the servo along the twist, N in the metric of ρ
    on_stop: int  # index of the next step when it stops; DONE or FAILED
    on_end: int  # the same when its travel is used up
    on_late: int = FAILED  # the same when its time is
    due: float = 0.0
    # Wrench (6,) of friction of coefficient 1 on the held contacts, in the frame's coordinates; 0 for none
    rubbing: Array = field(default_factory=lambda: np.zeros(6))
    # It stops when gain · reaction ≥ force and the part has been braked, or when it is ≥ sure
    gain: Array = field(default_factory=lambda: np.zeros(6))
    force: float = np.inf  # N; infinite for no such stop
    sure: float = np.inf  # N; it allows for all that friction may do; infinite for no such stop
    touch: float = 0.0  # what makes the contact felt, above what resists on the way, as `push`; 0 where none is due
    gentle: bool = False  # whether no more may push where the contact may be met, as that would pry held contacts open
    deep: float = -np.inf  # stop when the part's reference point is below this z in B, m; −infinite for no such stop
    soft: float = 1.0  # stiffness of position axes, as a share of the robot's


@dataclass(frozen=True, eq=False)
class Program(Value):
    """Steps, from the first on.

    To the speed (m/s) the shares of the velocity error refer; limits are the servo's in force (N) and torque (N·m).
    """

    name: str
    start: Pose
    rho: float
    speed: float
    steps: tuple[Step, ...]
    friction: float
    limits: tuple[float, float]


def planned(plan: Plan, robot: Robot) -> Program:
    """The program of a plan: its segments, moves ended by their contacts.

    Where a contact is not felt, the program fails; what a plan says to do then, `attempt` does.

    Raises:
        PlanFormatError: the plan cannot be run.
    """
    rows, asked = moves(plan), plan.specification
    limits = asked.contact_force, asked.torque_limit
    pushes = [
        # Where no contact ends it a move has no push of its own: the servo may push as hard as it takes.
        robot.surplus * segment.hybrid.push if move.stop else limits[0]
        for segment, move in zip(plan.segments, rows, strict=True)
    ]
    steps: list[Step] = []
    for i, row in enumerate(rows):
        spent = steps[-1].timeout if i and rows[i - 1].number == row.number else 0.0
        steps.append(_step(rows, i, plan.rho, pushes[i], spent, robot))
    return Program("plan", rows[0].start, plan.rho, asked.speed, tuple(steps), asked.friction, limits)


def _step(rows: Sequence[PlanMove], index: int, rho: float, push: float, spent: float, robot: Robot) -> Step:
    """A segment's step; `spent` is the time that the pieces of its move before it have, s."""
    move, following = rows[index], index + 1 if index + 1 < len(rows) else DONE
    beyond = next((k for k in range(index, len(rows)) if rows[k].number != move.number), DONE)
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    A = move.position_axes
    pace = min(1.0, robot.turning / max(float(np.linalg.norm(move.twist[3:])), 1e-9))
    common = (
        f"segment {move.segment}",
        move.number,
        Pose(move.frame.p - move.goal.p, move.frame.R),
        # Axes times scale are orthonormal, so that this is the projector; wrenches take its transpose.
        A.T @ A * scale**2,
        pace * move.twist,
        to_frame(move.frame, np.stack([move.hold_start, move.hold]), move.goal.p),
    )
    stop, timeout = move.stop, spent + _LATE * move.duration / pace
    rubbing = to_frame(move.frame, move.rubbing, move.goal.p)
    if stop is None:
        return Step(*common, move.length, timeout, push, following, following, rubbing=rubbing)
    ahead = [row.length for row in rows[index:] if row.number == move.number]
    last = rows[index + len(ahead) - 1]
    assert last.stop is not None
    # The travel of the last piece has the bound of all. A piece that ends before the contact is due feels nothing.
    due = sum(ahead) - _EARLY * (last.stop.max_travel - last.length)
    force = stop.threshold + robot.alert * (stop.force - stop.threshold)
    speed = float(np.linalg.norm(move.twist * scale))
    # The push whose power is that of a reaction of `force` at the new contact, and the surplus.
    touch = robot.surplus * force * abs(float(stop.wrench @ move.twist)) / speed
    felt = (due, rubbing, stop.gain, force, stop.force, touch)
    if not move.last:
        # A piece that has gone its way goes on into the next one; the last one has failed then.
        return Step(*common, move.length, timeout, push, beyond, following, FAILED, *felt, gentle=stop.gentle)
    timeout = spent + stop.timeout / pace
    travel = stop.max_travel + _GIVE * stop.force / robot.stiffness
    return Step(*common, travel, timeout, push, beyond, FAILED, FAILED, *felt, gentle=stop.gentle)


@dataclass(frozen=True, eq=False)
class StepTable(Value):
    """The steps of a program as arrays, one row a step, to be gathered for many bodies at once."""

    rotation: Array
    origin: Array
    position: Array
    twist: Array
    speed: Array
    hold: Array
    rubbing: Array
    gain: Array
    numbers: Array

    @staticmethod
    def of(program: Program) -> StepTable:
        """Speeds are in the metric of ρ, columns of `numbers` as `COLUMNS` has them."""
        steps, rho = program.steps, program.rho
        scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
        names = ("position", "twist", "hold", "rubbing", "gain")
        return StepTable(
            rotation=np.stack([s.frame.R for s in steps]),
            origin=np.stack([s.frame.p for s in steps]),
            speed=np.array([float(np.linalg.norm(s.twist * scale)) for s in steps]),
            # Indices of steps, too: as floats they are exact.
            numbers=np.array([[float(getattr(s, name)) for name in COLUMNS] for s in steps]),
            **{name: np.stack([getattr(s, name) for s in steps]) for name in names},
        )
