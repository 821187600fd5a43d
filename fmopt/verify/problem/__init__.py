"""A second reading of problem files, by the standard library alone: what a plan's claims rest on besides the plan."""

from fmopt.verify.problem.compare import Held, differences, held
from fmopt.verify.problem.parts import Given
from fmopt.verify.problem.tables import ProblemError

__all__ = ["Given", "Held", "ProblemError", "differences", "held"]
