"""Presses as a plan states them: position axes follow a twist, force axes give way under a wrench, until standstill.

The task frame has the axes of the B-frame and stays there; twists, wrenches and travels are about the reference point
of the moving part. Each trial runs the attempts in order: where one fails, the part backs out along its way and the
next one begins.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass

from fmopt.plan.field_types import Six, validated
from fmopt.verify.reading.reader import PlanError

_FORM = ConfigDict(extra="forbid", allow_inf_nan=False, strict=False)
MAX_PRESSES = 40  # of an attempt
MAX_ATTEMPTS = 3  # of a plan; candidates are compared as many attempts

Gives: TypeAlias = tuple[bool, bool, bool, bool, bool, bool]
Point: TypeAlias = tuple[float, float, float]
Positive: TypeAlias = Annotated[float, Field(gt=0.0)]
Next: TypeAlias = Literal["next", "seated", "retry", "fail"]


@dataclass(frozen=True, config=_FORM)
class Standstill:
    """The part has moved by less than `displacement` (m, turns times the arm of the robot) within `window` (s).

    It is measured from `armed` (s after the begin of the press) on. Where `below` (m, z of the reference point in B) is
    stated and the part stands higher, `else_then` follows in place of `then`.
    """

    displacement: Positive
    window: Positive
    armed: float
    then: Next = "next"
    below: float | None = None
    else_then: Next = "retry"
    kind: Literal["standstill"] = "standstill"


@dataclass(frozen=True, config=_FORM)
class Level:
    """The reference point is at or below `z` (m in B); a press that begins there takes no time."""

    z: float
    then: Next = "next"
    kind: Literal["level"] = "level"


@dataclass(frozen=True, config=_FORM)
class Travel:
    """The part has moved by `distance` (m) along force axes, or the twist has led it by `angle` (rad)."""

    distance: float | None = None
    angle: float | None = None
    then: Next = "next"
    kind: Literal["travel"] = "travel"


@dataclass(frozen=True, config=_FORM)
class Force:
    """The filtered contact force on position axes exceeds `force` (N)."""

    force: Positive
    then: Next = "next"
    kind: Literal["force"] = "force"


@dataclass(frozen=True, config=_FORM)
class Time:
    """`seconds` are used up; no standstill is ever taken for reached by that."""

    seconds: Positive
    then: Next = "retry"
    kind: Literal["time"] = "time"


End: TypeAlias = Annotated[Standstill | Level | Travel | Force | Time, Field(discriminator="kind")]


@dataclass(frozen=True, config=_FORM)
class Rocking:
    """The attitude follows a cone of half-angle `angle` (rad), `rate` times a second, that opens and closes again.

    It is fully open after a quarter of `seconds` and closed at their end.
    """

    angle: Positive
    rate: Positive
    seconds: Positive


@dataclass(frozen=True, config=_FORM)
class Press:
    """One press.

    Attributes:
        name: for people.
        gives: which of x, y, z and of the turns about them give way under the wrench; the others follow the twist.
        twist: (6,) of position axes, m/s and rad/s.
        wrench: (6,) of force axes, N and N·m, about the reference point.
        reference: point (3,) of the moving part, m.
        ramp: s over which the wrench comes up from that in force at the end of the press before.
        speed: (6,) limits of force axes, m/s and rad/s: damping is raised until the wrench alone moves no faster.
        reach: limits of travel of force axes, m and rad, beyond which the press fails.
        ends: whichever comes first, in this order.
        rocking: of the attitude, instead of a twist about position axes.
        keeps: whether position axes of the attitude go on from where the press before commands them, and not from
            where they are measured.
    """

    name: str
    gives: Gives
    twist: Six
    wrench: Six
    speed: Six
    reach: tuple[float, float]
    ends: Annotated[tuple[End, ...], Field(min_length=1, max_length=8)]
    reference: Point = (0.0, 0.0, 0.0)
    ramp: float = 0.1
    rocking: Rocking | None = None
    keeps: bool = False


@dataclass(frozen=True, config=_FORM)
class Attempt:
    """A commanded start pose (6,), m and rad, and the presses from there; `source` names the generator."""

    start: Six
    presses: Annotated[tuple[Press, ...], Field(min_length=1, max_length=MAX_PRESSES)]
    source: str = ""


@dataclass(frozen=True, config=_FORM)
class PressRobot:
    """The robot that carries presses out, about the reference point of the moving part.

    Attributes:
        stiffness: of held axes, N/m and N·m/rad.
        damping: of axes that give way, N·s/m and N·m·s/rad.
        mass, inertia: apparent, kg and kg·m².
        limits: greatest force and torque of the servo, N and N·m.
        arm: m, by which turns count as displacements.
        back: m/s and rad/s with which the part backs out.
        period, delay: of the controller and of its measurements, s.
        cut_off: of the low-pass filter on the wrench, Hz.
        noise: standard deviations of a raw sample: N, N·m, m, rad.
    """

    stiffness: tuple[Positive, Positive]
    damping: tuple[Positive, Positive]
    mass: Positive
    inertia: Positive
    limits: tuple[Positive, Positive]
    arm: Positive
    back: tuple[Positive, Positive] = (0.05, 0.5)
    period: Positive = 0.002
    delay: float = 0.02
    cut_off: Positive = 60.0
    noise: tuple[float, float, float, float] = (0.1, 0.002, 2e-6, 3e-5)


@dataclass(frozen=True, config=_FORM)
class Seat:
    """What counts as seated.

    Attributes:
        goal: pose (6,) of the moving part, m and rad.
        clearance: a side, m.
        depth: of the leading face below the mouth, m.
        rho: characteristic length, m.
        loose: what the height may be off by where nothing stops the part, m.
        free_turn: whether the turn about the axis does not count.
        symmetry: number of turns about the axis that take the part to itself.
    """

    goal: Six
    clearance: Positive
    depth: Positive
    rho: Positive
    loose: float = 0.0
    free_turn: bool = False
    symmetry: Annotated[int, Field(ge=1)] = 1


@dataclass(frozen=True, config=_FORM)
class ConvexSolid:
    """A solid by the corners of its convex pieces, m."""

    name: Annotated[str, Field(max_length=64)]
    pieces: Annotated[tuple[tuple[Point, ...], ...], Field(min_length=1)]


@dataclass(frozen=True, config=_FORM)
class Surroundings:
    """What stands around the parts: of `moving` and `fixed` solids none comes near the other ones, nor the other part.

    Attributes:
        moving: solids that move with the moving part, in its frame.
        fixed: solids that stand with the fixed part, in B.
    """

    moving: tuple[ConvexSolid, ...] = ()
    fixed: tuple[ConvexSolid, ...] = ()

    @property
    def solids(self) -> tuple[ConvexSolid, ...]:
        """All of them."""
        return self.moving + self.fixed


ALONE = Surroundings()  # nothing stands around the parts


@dataclass(frozen=True, config=_FORM)
class PressPlan:
    """Attempts in order, what carries them out, and what the part is that they are tried with.

    Between two attempts the part is lifted to a height in B, m. It is tried with its hollows filled where nothing comes
    into them, and kept clear of the cell.
    """

    robot: PressRobot
    attempts: Annotated[tuple[Attempt, ...], Field(min_length=1)]
    clear: float
    seat: Seat
    filled: bool = False
    cell: Surroundings = ALONE

    def strengthened(self, factor: float) -> "PressPlan":
        """All wrenches times a factor, damping likewise: ways and speeds stay."""
        robot = replace(self.robot, damping=(factor * self.robot.damping[0], factor * self.robot.damping[1]))
        attempts = (replace(one, presses=tuple(_stronger(p, factor) for p in one.presses)) for one in self.attempts)
        return replace(self, robot=robot, attempts=tuple(attempts))


def _stronger(press: Press, factor: float) -> Press:
    wrench = tuple(factor * value for value in press.wrench)
    ends = tuple(replace(end, force=factor * end.force) if isinstance(end, Force) else end for end in press.ends)
    return replace(press, wrench=wrench, ends=ends)


def first_presses(attempts: Sequence[Attempt]) -> list[int]:
    """Number of the first press of each attempt, among all presses of a plan."""
    return [sum(len(one.presses) for one in attempts[:k]) for k in range(len(attempts))]


def press_records(plan: PressPlan) -> dict[str, Any]:
    """The keys `segments` and `presses` of a plan file."""
    whole = _ADAPTER.dump_python(plan)
    attempts = [{"start": one["start"], "source": one["source"]} for one in whole["attempts"]]
    listed = [
        {"kind": "press", "attempt": number, **press}
        for number, one in enumerate(whole["attempts"])
        for press in one["presses"]
    ]
    return {"segments": listed, "presses": {**whole, "attempts": attempts}}


def press_plan_of(document: Mapping[str, Any]) -> PressPlan:
    """The presses of a plan file whose segments are presses.

    Raises:
        PlanError: they are none; says where, and what is wrong.
    """
    stated = document["presses"]
    starts = stated.get("attempts") if isinstance(stated, Mapping) else None
    if not isinstance(starts, Sequence) or not all(isinstance(one, Mapping) for one in starts):
        raise PlanError("presses", "must be a table with its attempts")
    attempts: list[dict[str, Any]] = [{**one, "presses": []} for one in starts]
    for number, segment in enumerate(document["segments"]):
        attempt = segment.get("attempt")
        if not isinstance(attempt, int) or not 0 <= attempt < len(attempts):
            raise PlanError(f"segments[{number}].attempt", "must be the number of an attempt")
        attempts[attempt]["presses"].append({k: v for k, v in segment.items() if k not in ("kind", "attempt")})
    found = validated(_ADAPTER, {**stated, "attempts": attempts}, "presses")
    if len(found.attempts) > MAX_ATTEMPTS:
        raise PlanError("presses.attempts", f"must be {MAX_ATTEMPTS} at most")
    return found


_ADAPTER = TypeAdapter(PressPlan)


@dataclass(frozen=True, config=_FORM)
class Conditions:
    """What evidence is drawn from: half-widths of the start errors, and intervals of what else is not known.

    Attributes:
        start: (6,), m and rad.
        friction: coefficient.
        stiffness, admittance: factors of the robot's, log-uniform.
        offset: of the wrench, either way, N and N·m.
        drift: of the twist, as a share of it.
    """

    start: Six
    friction: tuple[float, float] = (0.1, 0.5)
    stiffness: tuple[Positive, Positive] = (0.5, 3.0)
    admittance: tuple[Positive, Positive] = (1.0 / 3.0, 3.0)
    offset: tuple[float, float] = (1.0, 0.05)
    drift: float = 0.01
