"""The independent check of plans: exact arithmetic, the standard library alone, nothing from the rest of the package.

It trusts poses, bases and witnesses of a plan as choices, and derives again what is claimed of them. Contact functions,
remainders, error sets and knowledge of held contacts are written here a second time, from the same definitions.
"""

from fmopt.verify.check import judge, verify
from fmopt.verify.findings import CERTIFIED, NOT_PROVED, REFUTED, TESTED, Finding, Verdict, Witness
from fmopt.verify.reading.reader import PlanError, load

__all__ = [
    "CERTIFIED", "NOT_PROVED", "REFUTED", "TESTED", "Finding", "PlanError", "Verdict", "Witness", "judge", "load",
    "verify",
]  # fmt: skip
