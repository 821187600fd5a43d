"""An assembly back in words, task by task, as `fmopt check` prints it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from fmopt.knowledge.operand import Operand
from fmopt.task.assembly import Assembly, Step
from fmopt.values import Array


def assembly_facts(assembly: Assembly, steps: Sequence[Step]) -> dict[str, Any]:
    """The same as data: SI units, poses as (x, y, z, rotation vector)."""
    return {
        "valid": True,
        "title": assembly.title,
        "objects": [tree.name for tree in assembly.workcell.objects],
        "tasks": [_step_facts(step) for step in steps],
    }


def _step_facts(step: Step) -> dict[str, Any]:
    found = step.answer
    return {
        "name": step.name,
        "attachment": found.task.attachment,
        "exchanged": found.exchanged,
        "operands": {side: _operand_facts(operand) for side, operand in (("1", found.moving), ("2", found.fixed))},
        "start": found.P0.tolist(),
        "goal": found.PT.tolist(),
        "settled": [str(one) for one in found.settled],
        "carried": list(found.carried),
        "obstacles": [obstacle.name for obstacle in found.obstacles],
        "frames": {tree.name: tree.frame.vector().tolist() for tree in step.after.objects},
        "links": [{"kind": link.kind, "one": str(link.one), "other": str(link.other)} for link in step.after.links],
    }


def _operand_facts(operand: Operand) -> dict[str, Any]:
    return {
        "feature": str(operand.ref),
        "members": [str(ref) for ref in operand.members],
        "frame": operand.frame.vector().tolist(),
    }


def explain_assembly(assembly: Assembly, steps: Sequence[Step]) -> str:
    """The workcell and what each task comes to, one statement a line, lengths in mm and angles in degrees."""
    lines = [assembly.title, str(assembly.source.path)]
    lines.append(f"{'objects':<10} {', '.join(tree.name for tree in assembly.workcell.objects)}")
    for step in steps:
        lines += [f"{step.name if i == 0 else '':<10} {words}" for i, words in enumerate(_statements(step))]
    return "\n".join(lines)


def _statements(step: Step) -> Iterator[str]:
    found = step.answer
    wanted = found.task
    yield f"{wanted.moving} into a {wanted.attachment} pair with {wanted.fixed}"
    if found.exchanged:
        yield "the hollow part is in the hand: answered as if the peg moved, in the frame of the hole"
    for side, operand in (("1", found.moving), ("2", found.fixed)):
        yield f"operand {side}: {', '.join(str(ref) for ref in operand.members)}"
    yield f"from {_pose(found.P0)} to {_pose(found.PT)}"
    yield from map(str, found.settled)
    others = ", ".join(found.carried[1:])
    if others:
        yield f"carried along: {others}"
    if found.obstacles:
        yield f"obstacles: {', '.join(obstacle.name for obstacle in found.obstacles)}"
    yield f"then linked: {', '.join(f'{link.one} - {link.other} ({link.kind})' for link in step.after.links)}"


def _pose(P: Array) -> str:
    place = ", ".join(f"{1e3 * value:.6g}" for value in P[:3].tolist())
    turn = ", ".join(f"{math.degrees(value):.6g}" for value in P[3:].tolist())
    return f"({place}) mm" + (f" turned by ({turn}) deg" if P[3:].any() else "")
