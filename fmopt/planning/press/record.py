"""The plan file of presses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fmopt import plan
from fmopt.plan.description import Description, TracePose
from fmopt.plan.evidence import Evidence, evidence_record
from fmopt.plan.press import PressPlan, press_records
from fmopt.planning.plan_record import heading
from fmopt.planning.posed import Posed
from fmopt.verify.reading.parse import SUBJECT


def press_document(
    posed: Posed,
    presses: PressPlan,
    evidence: Evidence | None,
    trace: Sequence[TracePose] = (),
    certified_share: float | None = None,
) -> dict[str, Any]:
    """The plan file of presses, its verdict still open.

    Args:
        posed: the problem with its parts measured.
        presses: as they are carried out.
        evidence: of their trials; None where there were none.
        trace: the way of a trial without errors.
        certified_share: see `Description`.
    """
    document: dict[str, Any] = {
        **heading(posed.problem, posed.tolerance, posed.errors, posed.clearance.per_side),
        "goal": posed.problem.goal,
        "not_covered": plan.NOT_COVERED_PRESSES,
        "contacts": [],
        **press_records(presses),
        **({} if evidence is None else {"evidence": evidence_record(evidence)}),
        "description": Description(trace=tuple(trace), certified_share=certified_share).record(),
    }
    return dict(plan.clean(document))


def subject(document: Mapping[str, Any]) -> str:
    """Digest of what evidence is of: parts, presses and goal of a plan file."""
    return plan.digest({key: document[key] for key in SUBJECT})
