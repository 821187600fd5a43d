"""Error sets along a plan, derived from its start box by the chain of the check."""

from dataclasses import dataclass

import numpy as np

from fmopt.spatial.values import Array, Value
from fmopt.verify.arithmetic.rational import ArithmeticRefusal, Row, fixed, number
from fmopt.verify.certificate import error_set
from fmopt.verify.certificate.chain import Broken, Chain
from fmopt.verify.findings import Notes
from fmopt.verify.parts.assembly import PartPair
from fmopt.verify.reading.document import StatedPlan


@dataclass(frozen=True, eq=False)
class PlanErrorSet(Value, generators=(None, 6), shape=(6, 6), slide=(6, 6), swing=(6, 6), growth=(6, 6)):
    """A set of errors: inside zonotope ⊕ slide ⊕ swing, and inside an outer ellipsoid.

    Args:
        generators: (k, 6), m and rad.
        shape: shape matrix (6, 6) of the outer ellipsoid.
        slide, swing: shape matrices of the drift in translation and in rotation.
        growth: shape matrix of an ellipsoid around slide ⊕ swing.
    """

    generators: Array
    shape: Array
    slide: Array
    swing: Array
    growth: Array

    def half_widths(self) -> Array:
        """Half-widths (6,) along the axes: the smaller of the two bounds on each, m and rad."""
        sum_ = np.sum(np.abs(self.generators), axis=0) + np.sqrt(np.maximum(np.diag(self.growth), 0.0))
        return np.asarray(np.minimum(sum_, np.sqrt(np.maximum(np.diag(self.shape), 0.0))))


def error_sets(plan: StatedPlan) -> tuple[PlanErrorSet, ...]:
    """The set at the start and at the end of each segment; none after a segment at which the chain breaks."""
    weights = error_set.metric(fixed(plan.rho))
    found = [_in_floats(error_set.start_errors(plan), weights)]
    try:
        chain = Chain(plan, PartPair(plan))
        for segment in plan.segments:
            chain.follow(segment, Notes(None))
            found.append(_in_floats(chain.link.errors, weights))
    except (Broken, ArithmeticRefusal):
        return tuple(found)
    return tuple(found)


def _in_floats(errors: error_set.ErrorShape, weights: Row) -> PlanErrorSet:
    growth = error_set.outer_sum(errors.slide, errors.swing, weights)
    matrices = (errors.generators, errors.shape, errors.slide, errors.swing, growth)
    return PlanErrorSet(*(np.reshape([[number(x) for x in row] for row in rows], (-1, 6)) for rows in matrices))
