"""What has to hold of a plan before it is used: that the check certifies it, or its evidence."""

from fmopt.errors import PlanFormatError, UnprovedError
from fmopt.plan import Plan
from fmopt.verify import CERTIFIED, TESTED, PlanError, judge


def admitted(plan: Plan, unverified: bool, name: str = "the plan") -> str:
    """What is to be said of a plan wherever it goes: nothing where the check, asked unless `unverified`, certifies it.

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
