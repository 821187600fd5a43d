"""Who hands a plan on, to a robot or into an engine, asks the check first, or is told not to."""

from __future__ import annotations

from fmopt.errors import PlanFormatError, UnprovedError
from fmopt.plan import Plan
from fmopt.verify import CERTIFIED, PlanError, judge


def admitted(plan: Plan, unverified: bool, name: str = "the plan") -> str:
    """What is to be said wherever the plan goes: nothing of one that the check certifies and that says so itself.

    Args:
        plan: the plan.
        unverified: whether to take it without asking the check.
        name: of the plan, in messages.

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
    if not plan.verdict == found.verdict == CERTIFIED:
        reasons = tuple(str(finding) for finding in found.findings)
        advice = "solve its problem again; or take it as it is with --unverified, when nothing is guaranteed"
        raise UnprovedError(f"{name}: not certified, the check says {found.verdict}", reasons, advice)
    return ""
