"""A plan as a URScript program: one `force_mode` call for each segment, and a guarded move while it holds.

`force_mode(task_frame, selection_vector, wrench, type, limits)` takes the task frame as a pose in the base, 1 in the
selection vector for a compliant axis, the wrench that the robot applies to its environment in the task frame, type 2
for a frame that stays as it is, and limits: the greatest speed on compliant axes, the greatest deviation from the
programmed motion on stiff ones. `get_tcp_force` returns the reaction on the tool in axes of the base.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmopt.errors import PlanFormatError
from fmopt.plan import FRAMES, Plan
from fmopt.plan.export.cautions import failing_words, insertion_words, turning_words
from fmopt.plan.export.frame import TaskFrame, task_frame
from fmopt.plan.guarded_moves import PlanMove, moves
from fmopt.runtime.escape import one_line, urscript_string
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array


@dataclass(frozen=True)
class ProgramSettings:
    """What the program states explicitly and the plan does not know.

    Args:
        damping: of force mode, 0 to 1.
        gain: scaling of force mode's gain, 0 to 2.
        acceleration, acceleration_angular: of the moves, m/s² and rad/s².
        stop, stop_angular: decelerations at a stop, m/s² and rad/s².
        settling: s in which the held contacts settle before a move starts.
        starting: s at the start of a move in which the sensor's reading is noted and nothing is felt.
        memory: s over which slow changes of the reading are taken for the level that a touch rises above.
        averaging: s over which the force of the new contacts is averaged.
        alert: share of what a plan's stop allows for friction and noise that is left after the averaging.
        early: bounds of its travel by which a move may end early.
        approach, turning: greatest speeds of guarded moves, m/s and rad/s.
        most: greatest reaction in moves that nothing ends but their travel, in contact forces of the plan.
        reach: greatest distance from the start pose at which the program may begin, m.
        compliant_speed: limit on compliant axes, in speeds of the plan.
        deviation: limit on stiff axes at least, m in the metric of ρ: short moves begin pressed by those before them.
    """

    damping: float = 0.1
    gain: float = 0.5
    acceleration: float = 1.2
    acceleration_angular: float = 60.0
    stop: float = 5.0
    stop_angular: float = 250.0
    debounce: int = 3
    settling: float = 0.15
    starting: float = 0.05
    memory: float = 0.1
    averaging: float = 0.02
    slow: float = 0.6
    alert: float = 0.25
    early: float = 2.0
    approach: float = 0.005
    turning: float = 0.1
    most: float = 2.0
    reach: float = 0.02
    compliant_speed: float = 5.0
    deviation: float = 0.002


def program(plan: Plan, base: Pose, caution: str = "") -> str:
    """The program as text, with the hole's frame B in the robot's base and what is to be said of the plan, if anything.

    Raises:
        PlanFormatError: a segment cannot be run, or its force axes are not orthogonal in any one frame.
    """
    settings, rows = ProgramSettings(), moves(plan)
    lines = [_head(plan, rows, base, caution), of_tcp(plan), _functions(settings), "def fmopt_insert():"]
    begin = base.compose(rows[0].start).compose(tcp_of(plan))
    lines += _indented(_beginning(begin, plan.specification.speed, settings))
    for index in range(len(rows)):
        lines += _indented(_segment(plan, rows, index, base, settings))
    arrived = "seated" if rows[-1].stop else "as far in as planned; no contact tells that the part is seated"
    lines += _indented(["end_force_mode()", f'textmsg("fmopt: ", "{arrived}")'])
    return "\n".join([*lines, "end", "", "fmopt_insert()", ""])


def commanded(rows: Sequence[PlanMove]) -> list[Array]:
    """The twist (6,), m/s and rad/s, that the program commands in each move: in guarded ones at the robot's pace."""
    settings = ProgramSettings()
    return [move.twist if move.stop is None else _pace(move, settings) * move.twist for move in rows]


def _head(plan: Plan, rows: Sequence[PlanMove], base: Pose, caution: str) -> str:
    words = failing_words(plan, base)
    turning = turning_words(commanded(rows), [move.number for move in rows])
    failing = f"# {one_line(words[0].upper() + words[1:])}.\n" if words else ""
    said = heading(plan, base, f"WARNING: {caution}." if caution else "It has passed the independent check.")
    return templates("guarded.script")[0].format(failing=failing, turning=one_line(turning), **said)


def heading(plan: Plan, base: Pose, standing: str) -> dict[str, str]:
    """A program's words on its plan and frames, by name."""
    said = {
        "title": plan.title,
        "digest": plan.sha256,
        "verdict": plan.verdict,
        "version": plan.version,
        "standing": standing,
        "moving": FRAMES["moving"],
        "tcp": pose_of(tcp_of(plan)),
        "hole": FRAMES["B"],
        "base": pose_of(base),
        "insertion": insertion_words(base),
    }
    return {name: one_line(text) for name, text in said.items()}


def tcp_of(plan: Plan) -> Pose:
    """Pose of the tool's centre point in the frame of the moving part."""
    return Pose.from_vector(plan.description.tcp)


def of_tcp(plan: Plan) -> str:
    """Functions from the tool's centre point to the origin of the part's frame, which twists and wrenches are of."""
    return templates("tcp.script")[0].format(part_in_tcp=pose_of(tcp_of(plan).inverse()))


def _functions(settings: ProgramSettings) -> str:
    names = ("acceleration", "acceleration_angular", "stop", "stop_angular", "starting", "memory", "averaging", "slow")
    values = {name: number(getattr(settings, name)) for name in names}
    return templates("guarded.script")[1].format(debounce=settings.debounce, **values)


def templates(name: str) -> list[str]:
    """The sections of a file of program text."""
    return Path(__file__).with_name(name).read_text("utf-8").split("# ---\n")


def _beginning(start: Pose, speed: float, settings: ProgramSettings) -> list[str]:
    pose = pose_of(start)
    return [
        f"if point_dist(get_actual_tcp_pose(), {pose}) > {number(settings.reach)}:",
        f'  textmsg("fmopt: ", "bring the part to within {number(settings.reach)} m of {pose} first")',
        "  halt",
        "end",
        f"movel({pose}, {number(settings.acceleration)}, {number(speed)}, 0, 0)",
        "sleep(0.5)",  # s in which the arm comes to rest, before the sensor is zeroed
        "zero_ftsensor()",
        f"force_mode_set_damping({number(settings.damping)})",
        f"force_mode_set_gain_scaling({number(settings.gain)})",
        "global touched = False",
        *(f"global {name} = 0.0" for name in ("moving", "level", "mean", "ahead")),
    ]


def _segment(plan: Plan, rows: Sequence[PlanMove], index: int, base: Pose, settings: ProgramSettings) -> list[str]:
    """A move's pieces follow each other without a stop; once the contact that ends it is felt, the rest is left out.

    What a piece takes longer by than it is to, as steps are whole, the next one takes less.
    """
    move, rho = rows[index], plan.rho
    task = task_frame(move, rho)
    begins = index == 0 or rows[index - 1].last
    held = one_line(", ".join(move.state) or "nothing")
    lines = [f"# move {move.number + 1}, segments[{move.segment}], held: {held}"]
    lines += ["ahead = 0.0"] if begins else []
    if begins and index and move.stop is None and (rows[index - 1].stop or rows[index - 1].state):
        lines += [_released(move, base, rho, settings), f"sleep({number(settings.settling)})"]
    if move.stop is None:
        most = settings.most * plan.specification.contact_force
        way = f"{list_of(in_axes_of(base, move.twist))}, {number(move.duration)}, {number(most)}"
        lines += [_force_mode(move, task, base, rho, settings), f"touched = fmopt_move({way})"]
        return [*lines, "if touched:", f'  fmopt_leave("move {move.number + 1}: pushed against something")', "end"]
    pace = _pace(move, settings)
    guarded = [_force_mode(move, task, base, rho, settings)]
    if begins:
        guarded += [f"sleep({number(settings.settling)})", "moving = 0.0", "mean = 0.0"]
    guarded.append(f"touched = fmopt_guarded({', '.join(_guard(rows, index, base, rho, settings, pace))})")
    lines += ["if not touched:", *("  " + line for line in guarded), "end"]
    if move.last:
        missed = urscript_string(f"move {move.number + 1}: {', '.join(move.stop.contacts)} not felt")
        lines += ["if not touched:", f"  fmopt_leave({missed})", "end", "touched = False"]
    return lines


def _guard(
    rows: Sequence[PlanMove], index: int, base: Pose, rho: float, settings: ProgramSettings, pace: float
) -> list[str]:
    """The arguments of a guarded move: twist, what tells its share of a speed, gain, forces, and times, s."""
    move = rows[index]
    stop = move.stop
    assert stop is not None
    speed, twist = pace * _speed(move, rho), pace * move.twist
    # ⟨V, v⟩/|V|² in the metric of ρ: the share of the commanded speed in the measured one.
    along = twist * np.array([1.0, 1.0, 1.0, rho, rho, rho]) ** 2 / speed**2
    travel, timeout = (stop.max_travel, stop.timeout / pace) if move.last else (move.length, move.length / speed)
    ahead = [row for row in rows[index:] if row.number == move.number]
    bound = 0.0 if ahead[-1].stop is None else ahead[-1].stop.max_travel - ahead[-1].length
    due = sum(row.length for row in ahead) - settings.early * bound
    force = stop.threshold + settings.alert * (stop.force - stop.threshold)
    lists = (in_axes_of(base, six) for six in (twist, along, stop.gain))
    # What the gain reads of the holding wrench, the part of e that is known beforehand, at both ends of the way.
    held = stop.gain @ np.column_stack([move.hold_start, move.hold])
    # The program counts time: the way is as commanded until something is touched.
    times = (travel / speed, timeout, max(due, 0.0) / speed)
    return [*map(list_of, lists), number(force), list_of(held), *map(number, times)]


def _pace(move: PlanMove, settings: ProgramSettings) -> float:
    """The share of the plan's speed at which a guarded move is run."""
    speeds = float(np.linalg.norm(move.twist[:3])), float(np.linalg.norm(move.twist[3:]))
    return min(1.0, settings.approach / max(speeds[0], 1e-9), settings.turning / max(speeds[1], 1e-9))


def in_axes_of(base: Pose, six: Array) -> Array:
    """A twist or wrench (6,) that is given in axes of B, in those of the base."""
    # About the moving frame's origin before and after: no arm comes in.
    return np.concatenate([base.R @ six[:3], base.R @ six[3:]])


def _speed(move: PlanMove, rho: float) -> float:
    """m/s in the metric of ρ."""
    return float(np.linalg.norm(move.twist * np.array([1.0, 1.0, 1.0, rho, rho, rho])))


def _force_mode(move: PlanMove, task: TaskFrame, base: Pose, rho: float, settings: ProgramSettings) -> str:
    scale = np.array([1.0, 1.0, 1.0, rho, rho, rho])
    speed = _speed(move, rho)
    deviation = max(speed * (move.stop.timeout if move.stop else 2.0 * move.duration), settings.deviation)
    sizes = np.where(np.array(task.selection) == 1, settings.compliant_speed * speed, deviation) / scale
    selection = ", ".join(str(value) for value in task.selection)
    return f"force_mode({pose_of(base.compose(task.pose))}, [{selection}], {list_of(task.wrench)}, 2, {list_of(sizes)})"


def _released(move: PlanMove, base: Pose, rho: float, settings: ProgramSettings) -> str:
    """What lets the springs of the robot go after a touch: a part that leaves it would begin beside where it is."""
    limit = settings.compliant_speed * _speed(move, rho)
    limits = np.array([limit] * 3 + [limit / rho] * 3)
    return f"force_mode({pose_of(base.compose(move.frame))}, {[1] * 6}, {list_of(np.zeros(6))}, 2, {list_of(limits)})"


def _indented(lines: Sequence[str]) -> Iterable[str]:
    return ["  " + line for line in lines]


def number(value: float) -> str:
    """Fixed point, a picometre fine: the language has no exponents.

    Raises:
        PlanFormatError: it is not finite, and would read as a name.
    """
    if not math.isfinite(value):
        raise PlanFormatError(f"a number of the motion is {value!r}", "give a plan.json that fmopt solve wrote")
    text = f"{value:.12f}".rstrip("0")
    return "0.0" if text in ("-0.", "0.") else text + "0" * text.endswith(".")


def list_of(values: Array | Sequence[float]) -> str:
    """Numbers (n,) as a list."""
    return "[" + ", ".join(number(float(value)) for value in values) + "]"


def pose_of(pose: Pose) -> str:
    """A pose as p[x, y, z, rx, ry, rz]."""
    return "p" + list_of(pose.vector())
