"""The plan file of presses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fmopt import __version__, plan
from fmopt.plan.description import Description, TracePose
from fmopt.plan.evidence import Evidence, evidence_record
from fmopt.plan.press import PressPlan, press_records
from fmopt.planning.plan_record import part_record
from fmopt.planning.posed import Posed
from fmopt.task.problem import Problem
from fmopt.verify.reading.parse import SUBJECT


def press_document(
    posed: Posed, presses: PressPlan, evidence: Evidence | None, trace: Sequence[TracePose] = ()
) -> dict[str, Any]:
    """The plan file of presses, its verdict still open.

    Args:
        posed: the problem with its parts measured.
        presses: as they are carried out.
        evidence: of their trials; None where there were none.
        trace: the way of a trial without errors.
    """
    problem = posed.problem
    document: dict[str, Any] = {
        "format": plan.FORMAT,
        "fmopt_version": __version__,
        "problem": {"title": problem.title, "sha256": problem.sha256},
        "units": plan.UNITS,
        "frames": plan.FRAMES,
        "verdict": "NOT_PROVED",
        "uncertainty": {
            "start_box": problem.start_box,
            "velocity_error": posed.tolerance.velocity_error,
            "rho": posed.tolerance.rho,
        },
        "specification": problem.specification.record(),
        "goal": problem.goal,
        "touch_tolerance": 1e-9,
        "not_covered": plan.NOT_COVERED_PRESSES,
        "parts": {"moving": _part(problem, 0, posed), "fixed": _part(problem, 1, posed)},
        "contacts": [],
        **press_records(presses),
        **({} if evidence is None else {"evidence": evidence_record(evidence)}),
        "description": Description(trace=tuple(trace)).record(),
    }
    return dict(plan.clean(document))


def _part(problem: Problem, number: int, posed: Posed) -> dict[str, Any]:
    part, mated = (problem.moving, problem.fixed)[number], problem.mated[number]
    record = part_record(part, problem.declared_clearance, posed.clearance.per_side)
    return record if mated is None else {**record, "found": mated.record()}


def subject(document: Mapping[str, Any]) -> str:
    """Digest of what evidence is of: parts, presses and goal of a plan file."""
    return plan.digest({key: document[key] for key in SUBJECT})
