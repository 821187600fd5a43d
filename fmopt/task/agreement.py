"""Whether a plan is of a problem as it stands: not by its hash alone, but number by number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fmopt.geometry.part import Part
from fmopt.plan import clean
from fmopt.task.problem import Problem

_SAME = 1e-12  # m, rad: between numbers that went the same way
_SEATED = 1e-6  # m, rad: walls of rounded numbers seat a part a little off the pose of its goal


def disagreements(problem: Problem, document: Mapping[str, Any]) -> list[str]:
    """What a plan states otherwise than the problem does, in words; empty when they agree.

    Args:
        problem: as its file gives it now.
        document: the plan, of a form that the check accepts.
    """
    return list(_differences(problem, document))


def _differences(problem: Problem, document: Mapping[str, Any]) -> Iterator[str]:
    if document["problem"]["sha256"] != problem.sha256:
        yield "the plan belongs to another problem, or the problem's files have changed since"
    uncertainty, velocity = document["uncertainty"], problem.velocity_error
    if not _same(uncertainty["start_box"], problem.start_box.tolist()):
        yield "the plan is for other start errors"
    if not _same(uncertainty["velocity_error"], [velocity.translation, velocity.rotation]):
        yield "the plan is for another velocity error"
    if not _same(document["goal"][2:], problem.goal.tolist()[2:], _SEATED):
        yield "the plan ends at another depth or orientation"
    if document["specification"] != clean(problem.specification.record()):
        yield "the plan is for another specification"
    for side, part in (("moving", problem.moving), ("fixed", problem.fixed)):
        stated = document["parts"][side]
        if not _alike(stated, part):
            yield f"the plan is for another {side} part: its vertices or faces differ"
        if not _same(stated.get("declared_clearance", problem.declared_clearance), problem.declared_clearance):
            yield f"the plan states another declared clearance of the {side} part"


def _alike(stated: Mapping[str, Any], part: Part) -> bool:
    shape = part.polyhedron
    faces = [[list(loop) for loop in face.loops] for face in shape.faces]
    vertices = shape.vertices.tolist()
    return bool(
        stated["faces"] == faces
        and len(stated["vertices"]) == len(vertices)
        and all(_same(a, b) for a, b in zip(stated["vertices"], vertices, strict=True))
    )


def _same(a: Any, b: Any, off: float = _SAME) -> bool:
    return len(a) == len(b) and all(abs(x - y) <= off for x, y in zip(a, b, strict=True))
