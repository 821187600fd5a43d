"""Whether a plan is of a problem as it stands: not by its hash alone, but number by number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fmopt.geometry.part import Part
from fmopt.plan import Part as Stated
from fmopt.plan import Plan, Specification, clean
from fmopt.task.problem import Problem

_SAME = 1e-12  # m, rad: between numbers that went the same way
_SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal


def disagreements(problem: Problem, plan: Plan) -> list[str]:
    """What a plan states otherwise than the problem does, in words; empty when they agree.

    Args:
        problem: as its file gives it now.
        plan: the plan.
    """
    return list(_differences(problem, plan))


def _differences(problem: Problem, plan: Plan) -> Iterator[str]:
    if plan.problem != problem.sha256:
        yield "the plan belongs to another problem, or the problem's files have changed since"
    velocity = problem.velocity_error
    if not _same(plan.start_box, problem.start_box.tolist()):
        yield "the plan is for other start errors"
    if not _same(plan.velocity_error, [velocity.translation, velocity.rotation]):
        yield "the plan is for another velocity error"
    if not _same(plan.goal[2:], problem.goal.tolist()[2:], _SEATED):
        yield "the plan ends at another depth or orientation"
    if _recorded(plan.specification) != clean(problem.specification.record()):
        yield "the plan is for another specification"
    for side, part in (("moving", problem.moving), ("fixed", problem.fixed)):
        stated = plan.parts[side]
        if not _alike(stated, part):
            yield f"the plan is for another {side} part: its vertices or faces differ"
        if not _same(stated.declared_clearance, problem.declared_clearance):
            yield f"the plan states another declared clearance of the {side} part"


def _recorded(specification: Specification) -> dict[str, float]:
    """A plan's specification as a problem's is recorded."""
    names = ("speed", "contact_force", "torque_limit", "friction", "termination_force")
    found = {name: float(getattr(specification, name)) for name in names}
    if specification.impact is not None:
        found |= zip(("impact_force", "apparent_mass", "contact_stiffness"), specification.impact, strict=True)
    return found


def _alike(stated: Stated, part: Part) -> bool:
    shape = part.polyhedron
    faces = tuple(tuple(tuple(loop) for loop in face.loops) for face in shape.faces)
    vertices = shape.vertices.tolist()
    return bool(
        stated.body.faces == faces
        and len(stated.body.vertices) == len(vertices)
        and all(_same(a, b) for a, b in zip(stated.body.vertices, vertices, strict=True))
    )


def _same(a: Any, b: Any, off: float = _SAME) -> bool:
    return len(a) == len(b) and all(abs(x - y) <= off for x, y in zip(a, b, strict=True))
