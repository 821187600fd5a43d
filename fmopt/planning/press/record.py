"""The plan file of presses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fmopt import plan
from fmopt.plan.description import Description, Nominal, PositionForce, TracePose
from fmopt.plan.diagnostics import Interval
from fmopt.plan.evidence import Evidence, evidence_record
from fmopt.plan.field_types import numbers
from fmopt.plan.position_force import gamma, natural_constraints
from fmopt.plan.press import Press, PressPlan, press_records
from fmopt.planning.plan_record import heading
from fmopt.planning.posed import Posed
from fmopt.verify.reading.parse import SUBJECT


def press_document(
    posed: Posed, presses: PressPlan, evidence: Evidence | None, trace: Sequence[TracePose] = (), **described: Any
) -> dict[str, Any]:
    """The plan file of presses with the way of a trial without errors, `described` further, its verdict still open."""
    document: dict[str, Any] = {
        **heading(posed.problem, posed.tolerance, posed.errors, posed.clearance.per_side),
        "goal": posed.problem.goal,
        "not_covered": plan.NOT_COVERED_PRESSES,
        "contacts": [],
        **press_records(presses),
        **({} if evidence is None else {"evidence": evidence_record(evidence)}),
        "description": Description(
            trace=tuple(trace),
            tcp=numbers(posed.problem.tcp),
            **described,
            **_position_force(presses.attempts[0].presses, trace),
        ).record(),
    }
    return dict(plan.clean(document))


def _position_force(presses: Sequence[Press], trace: Sequence[TracePose]) -> dict[str, Any]:
    """P(t) from press to press, with S, Pₐ and Fₐ read off them: axes that give way are pressed, the others led.

    A pressed axis is stopped in the direction of its force; without one, both ways.
    """
    if not trace:
        return {}
    begins = [k for k, one in enumerate(trace) if k == 0 or one.press != trace[k - 1].press]
    at = [trace[k] for k in dict.fromkeys((*begins, len(trace) - 1))]
    if len(at) < 2:
        return {}
    times = tuple(one.time - at[0].time for one in at)
    rows = []
    for k, (one, other) in enumerate(pairwise(at)):
        press = presses[one.press]
        gives, wrench = np.array(press.gives), np.array(press.wrench)
        s = tuple(np.where(gives, np.where(wrench == 0.0, 2, np.sign(wrench)), 0).astype(int).tolist())
        (a, b), (c, d) = ([numbers(of(s, P.pose)) for P in (one, other)] for of in (gamma, natural_constraints))
        rows.append(PositionForce(times[k], times[k + 1], s, a, b, c, d, numbers(-wrench * gives + 0.0)))
    nominal = Nominal(tuple(one.pose for one in at), times, tuple(Interval(row.start, row.end, row.s) for row in rows))
    return {"nominal": nominal, "position_force": tuple(rows)}


def subject(posed: Posed, presses: PressPlan) -> str:
    """Digest of what evidence is of: parts, presses and goal of their plan file."""
    document = press_document(posed, presses, None)
    return plan.digest({key: document[key] for key in SUBJECT})
