"""The cheapest tolerances that keep margins: a convex program, solved by cutting planes from the margins themselves.

With u_i the tolerance i as a multiple of its present value and w_i its weight, the cost is Σ w_i/u_i, the reciprocal
cost of tolerancing. For a fixed motion each margin is a distance less the support of the error set, Σ|N·g_i| u_i with
the generators g_i of the start errors, less what grows and curves: affine in u but for terms of second order, which
bend it downwards. So margins are concave where those bounds are, and their tangents are cuts that no allowed point
violates: minimising the cost under all cuts so far bounds the cost from below, and the cheapest point whose margins
were computed to suffice bounds it from above, after Kelley (1960). A tangent that a margin is seen above is dropped,
and no bound is claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fmopt.errors import InfeasibleError, SolverError
from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.spatial.values import Array, Value, frozen

Margins = Callable[[Array], Mapping[str, float] | str]
"""Named margins (m) at multiples u (p,) of the present tolerances; words where the motion cannot be followed."""

_ROUNDS = 24
_STALLED = 4  # rounds without a better point after which no more are tried
_STEP = 0.02  # relative step of the differences that slopes are taken from
_BISECTIONS = 5  # which leave a thirty-second of the way open
_NEAR = 0.1  # share of the margin asked for that the least margin may have left to be what binds
_MICRO = 1e6  # µm in a metre: margins are in m, cuts in µm
_BENT = 0.05  # µm that a margin must exceed its tangent by to count as bent upwards
_NOISE = 1e-4  # µm that margins and their differences are not exact to


@dataclass(frozen=True, eq=False)
class Cheapest(Value, u=(None,)):
    """The cheapest tolerances found, as multiples u (p,) of the present ones.

    No point that keeps the margins costs less than `bound`, None where margins were seen not to be concave. `binding`
    names the least margin, m; where all are wide it says why the motion could not be followed beyond.
    """

    u: Array
    cost: float
    bound: float | None
    margin: float
    binding: str
    rounds: int
    evaluations: int


@dataclass(frozen=True, eq=False)
class _MarginCut:
    """value + slope·(u − at) ≥ required, in µm, from the margin of a name."""

    name: str
    at: Array
    value: float
    slope: Array

    def promises(self, u: Array) -> float:
        """What the tangent promises at u, µm."""
        return self.value + float(self.slope @ (u - self.at))

    def belies(self, other: _MarginCut) -> bool:
        """Whether there is more at the other's point than this one says there can be."""
        return other.value > self.promises(other.at) + _BENT

    def least(self, low: Array, high: Array) -> float:
        """Its least value in a box."""
        return self.value + float(np.minimum(self.slope * (low - self.at), self.slope * (high - self.at)).sum())

    def says_more(self, than: list[_MarginCut]) -> bool:
        """Whether those of its name promise more at its point than there is."""
        others = [cut.promises(self.at) for cut in than if cut.name == self.name]
        return self.value < min(others, default=np.inf) - _NOISE


def cheapest(margins: Margins, weights: Array, low: Array, high: Array, required: float, gap: float) -> Cheapest:
    """Minimises Σ w_i/u_i over low ≤ u ≤ high, all (p,), with all margins at least `required`, m.

    Raises:
        InfeasibleError: not even `low` keeps the margins; with the shortfall.
    """
    search = _Search(margins, required)
    best = frozen(low, None)
    reached = search.at(best)
    if isinstance(reached, str):
        raise InfeasibleError(f"not even for the tightest tolerances: {reached}", advice="allow tighter tolerances")
    if (least := min(reached.values())) < required:
        message = f"the tightest tolerances leave {1e6 * least:.4g} um, not {1e6 * required:.4g} um"
        raise InfeasibleError(message, required - least, "lower the margin asked for, or allow tighter tolerances")
    cuts = search.cuts(best, reached)
    bound, rounds, since, near, concave = 0.0, 0, 0, False, True
    while not near and rounds < _ROUNDS and since < _STALLED:
        rounds += 1
        try:
            proposed, bound = _program(cuts, weights, low, high, required)
        except (SolverError, InfeasibleError):
            break  # too many tangents that all but contradict; the bound of the round before still holds
        proposed = _evaluable(search, best, proposed)
        fresh = search.cuts(proposed, search.margins(proposed))
        kept = [cut for cut in cuts if not any(cut.name == new.name and cut.belies(new) for new in fresh)]
        bent = len(kept) < len(cuts)
        concave = concave and not bent
        cuts = kept + [cut for cut in fresh if cut.says_more(kept)]
        better = _allowed(search, best, proposed)
        # Less than a tenth of the gap counts as no gain, so that rounds do not go into creeping.
        since = 0 if _cost(weights, better) < (1.0 - 0.1 * gap) * _cost(weights, best) else since + 1
        if _cost(weights, better) < _cost(weights, best):
            best = better
        # Where tangents were belied, this round's bound came from wrong ones.
        near = not bent and _cost(weights, best) - bound <= gap * _cost(weights, best)
    if not near:
        best = _one_by_one(search, best, weights, high)
    cost = _cost(weights, best)
    margin, binding = search.binding(best)
    return Cheapest(best, cost, min(bound, cost) if concave else None, margin, binding, rounds, len(search.known))


def _cost(weights: Array, u: Array) -> float:
    return float(np.sum(weights / u))


class _Search:
    """Margins, counted and remembered, and the cuts that they give."""

    def __init__(self, margins: Margins, required: float) -> None:
        self._margins, self._required = margins, required
        self.known: dict[bytes, Mapping[str, float] | str] = {}
        self._words = ""

    def at(self, u: Array) -> Mapping[str, float] | str:
        """Margins at u, or words."""
        if (key := u.tobytes()) not in self.known:
            self.known[key] = self._margins(u)
        found = self.known[key]
        self._words = found if isinstance(found, str) else self._words
        return found

    def margins(self, u: Array) -> Mapping[str, float]:
        """Margins at u; none where the motion cannot be followed."""
        return {} if isinstance(found := self.at(u), str) else found

    def suffices(self, u: Array) -> bool:
        """Whether all margins at u are wide enough."""
        return min(self.margins(u).values(), default=-np.inf) >= self._required

    def binding(self, u: Array) -> tuple[float, str]:
        """The least margin at u, and what keeps u from growing."""
        found = self.margins(u)
        name = min(found, key=lambda key: (found[key], key))
        # The micrometre counts where the margin asked for is zero, of which a share is nothing.
        wide = found[name] > self._required * (1.0 + _NEAR) + 1e-6
        return found[name], self._words if wide and self._words else name

    def cuts(self, u: Array, here: Mapping[str, float]) -> list[_MarginCut]:
        """Tangents of all margins at u, by differences towards tighter tolerances."""
        slopes = {name: np.zeros(len(u)) for name in here}
        for i in range(len(u)):
            step = _STEP * u[i]
            # Tighter errors are inside those at u, where the motion could be followed; looser ones may not be.
            there = self.margins(u - step * np.eye(len(u))[i])
            for name, slope in slopes.items():
                # A move may be cut into other pieces there: a margin without a counterpart counts as level.
                slope[i] = (here[name] - there.get(name, here[name])) / step
        return [
            _MarginCut(name, u, _MICRO * here[name], _MICRO * slope) for name, slope in slopes.items() if slope.any()
        ]


def _evaluable(search: _Search, good: Array, wanted: Array) -> Array:
    """The first point between `wanted` and `good` where margins can be computed."""
    for _ in range(_ROUNDS):
        if search.margins(wanted):
            return wanted
        wanted = 0.5 * (good + wanted)
    return good


def _allowed(search: _Search, good: Array, wanted: Array) -> Array:
    """The farthest point found from `good` towards `wanted` at which all margins suffice."""
    if search.suffices(wanted):
        return wanted
    inside, outside = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if search.suffices(good + middle * (wanted - good)) else (inside, middle)
    return good + inside * (wanted - good)


def _one_by_one(search: _Search, good: Array, weights: Array, high: Array) -> Array:
    """Each in turn as far as it goes, those first that gain most: where no tangent says what is in the way."""
    u = np.array(good)
    for i in np.argsort(-weights / u, kind="stable"):
        wanted = u.copy()
        wanted[i] = high[i]
        while wanted[i] > 2.0 * u[i] and not search.suffices(wanted):
            # Halved in the logarithm, as multiples may span decades, until a factor of two is left to bisect.
            wanted[i] = np.sqrt(wanted[i] * u[i])
        u = _allowed(search, u, wanted)
    return u


def _program(cuts: list[_MarginCut], weights: Array, low: Array, high: Array, required: float) -> tuple[Array, float]:
    """The cheapest u under all cuts, and its cost: least w·s with s_i u_i ≥ 1, or |(2, s_i − u_i)| ≤ s_i + u_i."""
    p = len(weights)
    eye = np.eye(p)
    # What holds in the whole box cannot bind.
    reach = [cut for cut in cuts if cut.least(low, high) < _MICRO * required]
    G = np.vstack([np.hstack([eye, eye]), *(np.append(cut.slope, np.zeros(p))[None] for cut in reach)])
    h = np.append(np.zeros(p), [cut.value - float(cut.slope @ cut.at) - _MICRO * required for cut in reach])
    W = np.vstack([eye, np.zeros((len(reach), p))])
    norms = tuple(Norm(np.vstack([np.zeros(2 * p), np.append(-e, e)]), np.array([2.0, 0.0])) for e in eye)
    lower, upper = np.append(low, np.zeros(p)), np.append(high, 2.0 / low)  # s need be no more than 1/low
    c, units = np.append(np.zeros(p), -weights), np.append(high, 1.0 / low)
    program = ConeProgram(c, G=G, h=h, W=W, norms=norms, lower=lower, upper=upper, units=units)
    solution = ClarabelSolver(tolerance=1e-10).solve(program)
    # The solver keeps to the box but for its tolerance.
    return np.clip(solution.x[:p], low, high), -solution.bound  # the program maximises −cost
