"""The check of evidence: counts against outcomes, the bound against the counts, the digest of what was carried out.

Outcomes are not rerun: that takes the physics engine.
"""

import math

from fmopt.verify.findings import NOT_PROVED, TESTED, Notes, Verdict
from fmopt.verify.reading.document import StatedEvidence, StatedPlan

MIN_VERTICES = 58  # of the 64 that have to seat
CONFIDENCE = 0.975  # of the bound
_STEPS = 200  # of the bisection
_BOUND_TOLERANCE = 1e-9


def lower_bound(successes: int, trials: int, confidence: float) -> float:
    """One-sided Clopper–Pearson lower bound: the rate at which so many successes or more have 1 − confidence.

    [ClopperPearson1934]
    """
    if successes == 0:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _tail(successes, trials, middle) < 1.0 - confidence else (low, middle)
    return low


def _tail(successes: int, trials: int, rate: float) -> float:
    """Probability of so many successes or more."""
    if not 0.0 < rate < 1.0:
        return float(rate >= 1.0)
    yes, no = math.log(rate), math.log1p(-rate)
    return math.fsum(
        math.exp(
            math.lgamma(trials + 1) - math.lgamma(k + 1) - math.lgamma(trials - k + 1) + k * yes + (trials - k) * no
        )
        for k in range(successes, trials + 1)
    )


def judge_presses(plan: StatedPlan, notes: Notes) -> Verdict:
    """Judge a plan of presses, of which nothing is proved: TESTED where its evidence holds, else NOT_PROVED."""
    told = plan.evidence
    if told is None:
        notes.add("evidence", "the presses were not carried out: nothing is known of them")
    else:
        _check_evidence(told, notes)
        if told.subject != plan.subject:
            notes.add("evidence", "it is of other parts, presses or goals than the plan holds")
        if told.start != plan.start_box:
            notes.add("evidence", "it is drawn from other start errors than the plan states")
    verdict = NOT_PROVED if notes.found else TESTED
    return Verdict(verdict, tuple(notes.found), None, plan.presses, None, plan.not_covered, plan.verdict, evidence=told)


def _check_evidence(evidence: StatedEvidence, notes: Notes) -> None:
    seated, vertices = (sum(one >= 0 for one in of) for of in (evidence.outcomes, evidence.vertex_outcomes))
    if evidence.first_tries != (first := evidence.outcomes.count(0)):
        notes.add("evidence", f"{first} outcomes seat at the first attempt, {evidence.first_tries} are stated")
    if (evidence.seated, evidence.draws) != (seated, len(evidence.outcomes)):
        notes.add("evidence", f"{seated} of {len(evidence.outcomes)} outcomes seat, other counts are stated")
    if (evidence.vertices_seated, evidence.vertices) != (vertices, len(evidence.vertex_outcomes)):
        notes.add("evidence", f"{vertices} of {len(evidence.vertex_outcomes)} vertices seat, other counts are stated")
    if evidence.vertices != 64:
        notes.add("evidence", f"{evidence.vertices} of the 64 vertices of the start box were tried")
    elif vertices < MIN_VERTICES:
        notes.add("evidence", f"{vertices} of 64 vertices seat, where {MIN_VERTICES} have to")
    if evidence.confidence != CONFIDENCE:
        notes.add("evidence", f"the bound holds at {evidence.confidence}, where {CONFIDENCE} is asked for")
    bound = lower_bound(seated, len(evidence.outcomes), CONFIDENCE)
    if abs(bound - evidence.bound) > _BOUND_TOLERANCE:
        notes.add("evidence", f"a bound of {evidence.bound:.6f} is stated, {bound:.6f} follows", evidence.bound - bound)
    if bound < evidence.min_rate:
        notes.add("evidence", f"the rate is at least {bound:.4f}, where {evidence.min_rate} is asked for")
    ranked = sorted(time for time, one in zip(evidence.seconds, evidence.outcomes, strict=True) if one >= 0)
    late = ranked[min(int(0.95 * len(ranked)), len(ranked) - 1)] if ranked else 0.0
    if evidence.max_time is not None and late > evidence.max_time:
        most = f"{evidence.max_time:.3g} s are asked for: raise settings.max_time, or the limits of force and speed"
        notes.add("evidence", f"95 % of the cycle times are within {late:.3g} s, where {most}")
    if not (evidence.tested or notes.found):
        notes.add("evidence", "its level is below, where its outcomes are TESTED")
