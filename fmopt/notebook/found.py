"""What was found on parts, as comments of the problem file that asks for nothing of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from fmopt.notebook.asking import UNITLESS, quoted
from fmopt.task.explain import aligned, statements

if TYPE_CHECKING:
    from fmopt.geometry.clearance import Clearance
    from fmopt.notebook.asking import Asked
    from fmopt.task.problem import Problem


def commented(asked: Asked, folder: Path, problem: Problem, clearance: Clearance, stated: bool) -> str:
    """The problem file of a question, findings and usual values as comments; `stated`: the error is the user's own."""
    yours = "how far off the part may start, along and about every axis (half-widths)"
    note = yours if stated else f"AN EXAMPLE, put your own: {yours}"
    goal, exchanged = problem.task, problem.task.exchanged
    # The file names first what it moves, which is the part with the hole where operands were exchanged.
    names = (problem.peg.name, problem.hole.name)[:: -1 if exchanged else 1]
    lines = [f"# {problem.title}. What stands behind # was found or is as usual: take the # away to state it.", ""]
    for file, unit, table, name in zip(asked.files, asked.units, asked.operands(folder), names, strict=True):
        usual = unit is None and file.suffix.lower() in UNITLESS
        lines += [*table, *(['# unit = "mm"'] if usual else []), f"# feature = {quoted(name)}", ""]
    lines += ["[goal]", f'# depth = "{_number(-1e3 * float(problem.goal[2]))} mm" # or "full"']
    # The problem has the turn of the peg, the file that of what it moves.
    if goal.turn and not goal.free_turn:
        lines.append(f'# turn = "{-goal.turn if exchanged else goal.turn!r} rad"')
    lines += ["", "# [clearance] # on each side, as measured"]
    for axis, play in zip("xy", clearance.play, strict=True):
        # Play is infinite along an axis on which nothing stops the part: there the least gap of all is said.
        lines.append(f'# {axis} = "{_number(500.0 * (play if play < 1e3 else 2.0 * clearance.per_side))} mm"')
    lines += ["", "[start]", f'# height = "{_number(1e3 * problem.approach)} mm"', ""]
    lines += ["[uncertainty]", f"start = {quoted(asked.error)} # {note}", "", "[uncertainty.velocity]"]
    lines += [f"# {name} = {getattr(problem.velocity_error, name)!r}" for name in ("translation", "rotation")]
    lines += ["", *_usual(problem), ""]
    said = aligned(*statements(problem, clearance)).split("\n")
    return "\n".join([*lines, "# What fmopt check says of it:", *(f"# {line}".rstrip() for line in said), ""])


def _usual(problem: Problem) -> Iterator[str]:
    """Speed, forces and settings, which are as usual."""
    wanted, settings = problem.specification, problem.settings
    yield "[specification]"
    yield f'# speed = "{_number(1e3 * wanted.speed)} mm/s"'
    yield f'# contact_force = "{_number(wanted.contact_force)} N"'
    yield f'# torque_limit = "{_number(wanted.torque_limit)} N*m"'
    yield f"# friction = {[*problem.friction]} # of what trials are drawn from; proofs take the greater one"
    yield f'# termination_force = "{_number(wanted.termination_force)} N"'
    yield from ("", "[robot] # at the moving part, where presses hold axes in position")
    yield f'# preset = "{problem.robot.preset}" # or "ur5e", "ur10e", "franka": values for what is not given'
    yield f'# force_offset = "{_number(problem.robot.force_offset)} N" # accuracy of its force'
    yield from ("", "[settings]", f'# evidence = "{settings.evidence}" # or "certified": guarded moves with a proof')
    yield f"# min_rate = {settings.min_rate!r} # with which a tested plan has to seat, by the bound that its draws give"
    yield f"# draws = {settings.draws}"
    yield f'# max_tilt = "{_number(math.degrees(settings.max_tilt))} deg"'
    yield f'# time_limit = "{_number(settings.time_limit)} s"'


def _number(value: float) -> str:
    return f"{value:.9g}"
