"""A problem as a motion is looked for: its parts measured, its errors, and how a sequence's poses are placed for it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.errors import InfeasibleError
from fmopt.geometry.clearance import Clearance
from fmopt.planning.control.controlled_motion import least_firm, least_steady, runs_against
from fmopt.planning.control.holding import holds
from fmopt.planning.moves.moves import Move, Reached, claims_of_moves
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.placement.goal_refinement import Method, refine_goals
from fmopt.planning.placement.sequence_program import COARSE, Aim, Placed, Refinement, certified, refine, surer
from fmopt.planning.placement.sequence_rows import HoldMargin
from fmopt.planning.robustness.error_tolerance import CertifiedMotion, WholeMotion
from fmopt.planning.search.entry import start_spread
from fmopt.planning.search.symmetry import Image, Searched
from fmopt.runtime.clock import clock, deadline, until
from fmopt.spatial.se3 import length, log
from fmopt.task.problem import Problem
from fmopt.task.sizes import characteristic_length, measured_clearance

Progress = Callable[[str], None]
FINE = math.radians(1.0)  # greatest turn of a piece of a plan; searches make do with 0.03 rad
STEADY = 0.05  # share of the contact force that presses what a part turns along, whatever friction turns it off
FIRM = 0.05  # share of the contact force that presses all that a part slides along to its next contact
GRACE = 2.0  # s beyond the time limit for what is needed to make something of what there is by then


@dataclass(eq=False)
class Stages:
    """What is being done, and how many seconds each stage took, but for compiling."""

    progress: Progress = lambda _: None
    seconds: dict[str, float] = field(default_factory=dict)
    _last: float = field(default_factory=clock)

    def ended(self, name: str) -> None:
        """Notes that a stage has ended."""
        now = clock()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._last
        self._last = now


@dataclass(frozen=True, eq=False)
class Posed:
    """A problem as a motion is looked for."""

    problem: Problem
    assembly: Assembly
    clearance: Clearance
    errors: ErrorSet
    tolerance: Tolerance

    @classmethod
    def of(cls, problem: Problem) -> "Posed":
        """A problem with its parts measured.

        Raises:
            InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        """
        clearance = measured_clearance(problem)
        assembly = Assembly(problem.moving, problem.fixed, planar=problem.plane is not None)
        errors = ErrorSet.of(problem.start_box, problem.framing)
        tolerance = _tolerance(problem, characteristic_length(problem, clearance))
        return cls(problem, assembly, clearance, errors, tolerance)

    @property
    def start(self) -> Reached:
        """Where its motion starts."""
        return Reached(self.errors, (), ())

    def under(self, share: float) -> Aim:
        """What a sequence is placed for under a share of all errors, coarsely, free to turn and to start elsewhere."""
        errors = ErrorSet.of(share * self.problem.start_box, self.problem.framing)
        tolerance = _tolerance(self.problem, self.tolerance.rho, share)
        start, lift = Reached(errors, (), ()), self.problem.approach
        return Aim(self.assembly, start, tolerance, COARSE, self.felt, turning=True, lift=lift, holds=self.holds)

    def felt(self, placed: Placed) -> bool:
        """Whether every piece of a sequence runs against the contact that ends its move."""
        return runs_against(self.problem, self.assembly, placed.reached.claims, self.tolerance)

    def holds(self, claims: Sequence[Claim]) -> list[HoldMargin]:
        """How surely the pieces of a motion hold their contacts, of those that hold them by little."""
        enough = FIRM, 0.0 if self.assembly.planar else STEADY
        return holds(self.problem, self.assembly, claims, self.tolerance, enough)

    @property
    def spread(self) -> float:
        """How far the start error displaces the tip, m."""
        return start_spread(self.problem.moving, self.problem.start_box)

    @property
    def refinement(self) -> Refinement:
        """How far its placement goes."""
        return Refinement.of(self.spread, self.clearance.per_side)

    def certified(self, found: Searched, placed: Placed) -> CertifiedMotion:
        """Its motion, from what is said of the search and the sequence that is placed."""
        said = found.of(placed.moves)
        return CertifiedMotion(self.assembly, self.clearance, self.errors, self.tolerance, said, placed)

    def imaged(self, image: Image) -> "Posed":
        """The same as an image of the parts poses it."""
        parts, clearance = image.assembly, image.clearance(self.clearance)
        goal, box = image.goal(self.problem.goal), image.attitude.of_widths(self.problem.start_box)
        framing = image.attitude.of_framing(self.problem.framing)
        problem = replace(
            self.problem, moving=parts.moving, fixed=parts.fixed, goal=goal, start_box=box, framing=framing
        )
        tolerance = _tolerance(problem, characteristic_length(problem, clearance))
        return Posed(problem, parts, clearance, ErrorSet.of(box, framing), tolerance)


def _tolerance(problem: Problem, rho: float, share: float = 1.0) -> Tolerance:
    """A share of the velocity error, in the metric of ρ (m)."""
    error = problem.velocity_error
    return Tolerance((share * error.translation, share * error.rotation), rho)


def under_errors(found: CertifiedMotion, problem: Problem) -> WholeMotion:
    """The moves of a motion under the errors of a problem, which need not be those that it was found for."""
    tolerance = _tolerance(problem, found.tolerance.rho)
    return WholeMotion(
        found.assembly, found.placed.moves, problem.start_box, tolerance, found.placed.step, problem.framing
    )


def placement(posed: Posed, moves: Sequence[Move], progress: Progress, step: float = FINE) -> Placed:
    """All goal poses placed for the largest certified margin, by the method that the problem asks for.

    Raises:
        InfeasibleError: fine pieces cannot follow the motion, or no contact would be felt that ends one.
        OverdueError: there is no time to certify it.
    """
    problem, clearance = posed.problem, posed.clearance.per_side
    radius = 0.5 * (posed.spread + clearance)
    with until(deadline() + GRACE):
        begun = certified(posed.assembly, moves, posed.start, posed.tolerance, step)
    solver, aim, first = ClarabelSolver(), _aim(posed, begun), begun
    if problem.settings.placement != "descent":
        first = surer(aim, begun, solver, posed.refinement)
        aim = _aim(posed, first)

    def told(margin: float) -> None:
        progress(f"placement: margin {1e6 * margin:.1f} um")

    def polished(placed: Placed, method: Method) -> Placed:
        return refine_goals(aim, placed, clearance, method, radius, told)

    if problem.settings.placement == "descent":
        stages = [begun, polished(begun, "descent")]
    else:
        refined = refine(aim, first, solver, posed.refinement, told)
        # Single poses are placed by the margin alone: whether control is served as before is asked of the outcome.
        stages = [begun, first, refined, *filter(aim.fit, [polished(refined, "nlp")])]
    return by_method(posed, _felt(posed, stages))


def placed_anew(posed: Posed, moves: Sequence[Move], progress: Progress) -> Placed:
    """Goal poses placed from wherever they are, as `placement` does it where the errors can be followed from there.

    Where they cannot, errors are grown first as the poses come to bear them.

    Raises:
        InfeasibleError: all of the errors cannot be followed.
    """
    try:
        return placement(posed, moves, progress)
    except InfeasibleError:
        return placed_by_growing(posed, moves, progress)


def placed_by_growing(posed: Posed, moves: Sequence[Move], progress: Progress) -> Placed:
    """Goal poses placed from where they bear a share of the errors, until they bear all.

    Raises:
        InfeasibleError: all of the errors cannot be followed.
        OverdueError: there is no time left.
    """
    from fmopt.planning.placement.error_growth import grown

    progress("placement: errors are grown")
    found = grown(posed.under, moves, ClarabelSolver(), posed.refinement, FINE)
    return placement(posed, found.moves, progress, found.step)


def _aim(posed: Posed, begun: Placed) -> Aim:
    """The aim of placing a sequence: contacts hold no less surely than where that began, or than is enough.

    Nor may its moves have to be cut more finely: at each piece a robot stops, and what it is off by adds up.
    """

    @cache
    def least() -> tuple[float, float, bool]:
        return _sureness(posed, begun)

    def fit(placed: Placed) -> bool:
        if any(new > old for new, old in zip(_fineness(placed), _fineness(begun), strict=True)):
            return False
        try:
            return all(new >= old for new, old in zip(_sureness(posed, placed), least(), strict=True))
        except InfeasibleError:  # no bias force holds the contacts
            return False

    return Aim(posed.assembly, posed.start, posed.tolerance, begun.step, fit, holds=posed.holds)


def _sureness(posed: Posed, placed: Placed) -> tuple[float, float, bool]:
    """How surely a sequence holds its contacts, as far as that counts, and whether all pieces run to their ends."""
    given = posed.problem, posed.assembly, placed.reached.claims, posed.tolerance
    steady = STEADY if posed.assembly.planar else least_steady(*given)
    return min(FIRM, least_firm(*given)), min(STEADY, steady), runs_against(*given)


def _fineness(placed: Placed) -> list[float]:
    """Of each move, how many times as many pieces it has as its turn alone asks for."""
    turns = (length(log(move.goal.R @ move.start.R.T)) for move in placed.moves)
    pieces = map(len, claims_of_moves(placed.reached.claims))
    # A turn that is a whole number of steps, but for rounding, asks for no piece more.
    return [count / max(1, math.ceil(turn / FINE - 1e-9)) for count, turn in zip(pieces, turns, strict=True)]


def by_method(posed: Posed, placed: Placed) -> Placed:
    """A sequence with the claims of the method that the problem asks for."""
    if posed.problem.settings.method != "dakin1993":
        return placed
    from fmopt.papers.dakin_popplestone import as_in_the_paper

    claims = as_in_the_paper(posed.assembly, placed.reached.claims, posed.errors, posed.tolerance)
    return replace(placed, reached=replace(placed.reached, claims=claims))


def _felt(posed: Posed, found: Sequence[Placed]) -> Placed:
    """The last of some sequences of which every piece runs against the contact that ends its move."""
    for placed in reversed(found):
        if posed.felt(placed):
            return placed
    raise InfeasibleError("a piece of a turn leads away from the contact that is to end it at first")
