"""What has to hold of a plan before it is used: that it is of its problem, and that the check certifies it."""

from __future__ import annotations

import math

from fmopt.errors import Fault, InputError, PlanFormatError, UnprovedError
from fmopt.geometry.part import Part
from fmopt.notebook.problem import Problem
from fmopt.plan import Body, Plan
from fmopt.task import problem as task
from fmopt.verify import CERTIFIED, TESTED, PlanError, judge
from fmopt.verify.problem import Given, Held, ProblemError, held


def held_against(plan: Plan, problem: task.Problem) -> Held:
    """A plan held against the document of a problem, and against what was put in its place since.

    Raises:
        InputError: the document or one of its models cannot be read.
    """
    data = problem.source.data if isinstance(problem, Problem) else None
    try:
        found = held(plan, problem.path, data, lambda: given(problem))
    except ProblemError as error:
        raise InputError(Fault(error.file, 1, 1, error.key, "problem", error.message)) from error
    if found.differences:
        return found
    velocity = problem.velocity_error
    declared = problem.declared_clearance or (math.nan, math.nan)  # differences from nan are above no bound
    pairs = (
        ("start errors", plan.start_box, problem.start_box.tolist(), 1e-12),
        ("velocity error", plan.velocity_error, (velocity.translation, velocity.rotation), 1e-12),
        ("declared clearance", plan.moving.declared_clearance, declared, 1e-12),
        ("depth", plan.goal[2:3], problem.goal[2:3].tolist(), 1e-6),
    )
    words = [
        f"the plan is for another {what} than the problem in memory, which is not that of its file"
        for what, stated, wanted, off in pairs
        if stated is not None and max(abs(a - b) for a, b in zip(stated, wanted, strict=True)) > off
    ]
    return Held(tuple(words), found.remarks)


def given(problem: task.Problem) -> dict[str, Given]:
    """The two parts by side, in their mating frames."""
    return {"moving": _part(problem.moving), "fixed": _part(problem.fixed)}


def _part(part: Part) -> Given:
    shape = part.polyhedron
    faces = tuple(tuple(tuple(loop) for loop in face.loops) for face in shape.faces)
    return Given(Body(tuple(tuple(row) for row in shape.vertices.tolist()), faces), part.chord_error, part.form)


def admitted(plan: Plan, unverified: bool, name: str = "the plan") -> str:
    """What is to be said wherever the plan goes: nothing of one that the check certifies and that says so itself.

    Args:
        unverified: whether to take it without asking the check.

    Raises:
        UnprovedError: the check does not certify it, its seal is broken, or it does not say CERTIFIED itself.
        PlanFormatError: its parts are none that can be checked.
    """
    if unverified:
        said = f"the check was not asked, and the plan says {plan.verdict}"
        return f"unverified: {said}; nothing is guaranteed of what it does"
    try:
        found = judge(plan)
    except PlanError as error:
        raise PlanFormatError(f"{name}: {error}", "give a plan.json that fmopt solve wrote") from error
    if plan.verdict == found.verdict == TESTED:
        return "tested, not certified: nothing is proved of presses"
    # A plan that says less of itself than the check finds is taken at its word.
    if not plan.verdict == found.verdict == CERTIFIED:
        reasons = tuple(str(finding) for finding in found.findings)
        advice = "solve its problem again; or take it as it is with --unverified, when nothing is guaranteed"
        raise UnprovedError(f"{name}: not certified, the check says {found.verdict}", reasons, advice)
    return ""
