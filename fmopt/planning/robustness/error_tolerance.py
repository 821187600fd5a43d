"""How much error a placed motion tolerates, and what each tolerance costs: the motion certified anew, not re-planned.

Every figure is a margin of the same moves under other errors, or with a slimmer part, each with all of its rows, sets
and remainders derived again; nothing is linearised.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from fmopt.certificate.assembly import Assembly
from fmopt.certificate.claim import Claim
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Tolerance
from fmopt.errors import InfeasibleError
from fmopt.geometry.clearance import Clearance
from fmopt.geometry.part import stretched
from fmopt.plan import line
from fmopt.plan.diagnostics import ErrorTolerance, Sensitivity, ToleranceEnd
from fmopt.plan.field_types import numbers
from fmopt.plan.position_force import AXES
from fmopt.planning.moves.moves import Care, Move, Reached, carried, claims_of_moves, in_a_row, onto_surfaces, unroll
from fmopt.planning.optimise.bisection import largest
from fmopt.planning.placement.sequence_program import Placed, certified
from fmopt.planning.search.symmetry import Searched
from fmopt.spatial.values import IN_THE_WORLD, Array, Framing

_SHARE = 0.02  # of a tolerance, by which it is widened


@dataclass(frozen=True, eq=False)
class Proved:
    """What is certified of a motion, or of the moves before one that is impossible for a reason."""

    reached: Reached
    least: tuple[Claim, ...] = ()
    reason: str = ""

    @property
    def margins(self) -> tuple[float, ...]:
        """Margins of the moves, m."""
        return tuple(claim.margin for claim in self.least)


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """A motion that can be certified under other start errors.

    `box` (6,) has the half-widths of its own, m and rad; `turn` is the greatest turn of one piece, rad.
    """

    assembly: Assembly
    moves: tuple[Move, ...]
    box: Array
    tolerance: Tolerance
    turn: float
    framing: Framing = IN_THE_WORLD
    known: Reached | None = None

    def under(self, errors: Array) -> "WholeMotion":
        """The motion under start errors with other half-widths (6,)."""
        return replace(self, box=errors, known=None)

    @cached_property
    def start(self) -> Reached:
        """Where it starts."""
        return Reached(ErrorSet.of(self.box, self.framing), (), ())

    def placed(self) -> Placed:
        """The motion, certified for its errors.

        Raises:
            InfeasibleError: a move is impossible.
        """
        return certified(self.assembly, self.moves, self.start, self.tolerance, self.turn)

    @cached_property
    def begun(self) -> Proved:
        """What is certified of it, as far as the first move without a margin."""
        if self.known is not None:
            claims = claims_of_moves(self.known.claims)
            return Proved(self.known, tuple(min(of_move, key=lambda claim: claim.margin) for of_move in claims))
        return self._followed(Proved(self.start), beyond=False)

    @cached_property
    def outcome(self) -> Proved:
        """What is certified of it, as far as it is possible."""
        return self._followed(self.begun, beyond=True)

    def _followed(self, begun: Proved, beyond: bool) -> Proved:
        """What is certified of it after the moves that it begins with; `beyond` the first without a margin, too."""
        reached, least = begun.reached, begun.least
        for move in () if begun.reason else self.moves[len(least) :]:
            try:
                after = unroll(self.assembly, move, reached, self.tolerance, self.turn)
            except InfeasibleError as error:
                return Proved(reached, least, error.message)
            least = (*least, min(after.claims[len(reached.claims) :], key=lambda claim: claim.margin))
            reached = after
            if least[-1].margin <= 0.0 and not beyond:
                break
        return Proved(reached, least, begun.reason)

    @property
    def margin(self) -> float | None:
        """Least certified margin, m; None when a move is impossible."""
        return None if self.outcome.reason else min(self.outcome.margins)

    def bears(self, pieces: Sequence[int]) -> bool:
        """Whether errors can be carried through its moves, in so many pieces each or in one; nothing is claimed."""
        reached = self.start
        for move, count in zip(self.moves, pieces, strict=True):
            for number in dict.fromkeys((count, 1)):
                try:
                    reached = carried(self.assembly, move, reached, self.tolerance, number, Care.ALL)[1]
                    break
                except InfeasibleError:
                    continue
            else:
                return False
        return True


@dataclass(frozen=True, eq=False)
class CertifiedMotion:
    """The motion found for a problem, and what it rests on; the problem's specification plays no part in it."""

    assembly: Assembly
    clearance: Clearance
    errors: ErrorSet
    tolerance: Tolerance
    found: Searched
    placed: Placed

    @property
    def claims(self) -> tuple[Claim, ...]:
        """What is certified of its pieces, in order."""
        return self.placed.reached.claims


def error_tolerance(motion: WholeMotion, clearance: tuple[float, float]) -> ErrorTolerance:
    """How much error a motion, with its clearance (x, y) a side, m, tolerates and what each tolerance costs it."""
    factor, beyond = factors(motion)
    end = None if beyond is None else what_fails(beyond)
    return ErrorTolerance(factor, numbers(factor * motion.box), sensitivities(motion, clearance), end)


def what_fails(motion: WholeMotion) -> ToleranceEnd:
    """The inequality of least margin of a motion and the move that it belongs to, or why a move is impossible."""
    found = motion.outcome
    if found.reason:
        return ToleranceEnd(len(found.least), "", line(found.reason))
    number, claim = min(enumerate(found.least), key=lambda pair: pair[1].margin)
    return ToleranceEnd(number, claim.binding, "")


def largest_factor(motion: WholeMotion) -> float:
    """The largest factor of the whole start box at which the motion still has a margin, to 1/64, at most 64."""
    return factors(motion)[0]


def factors(motion: WholeMotion) -> tuple[float, WholeMotion | None]:
    """The largest factor at which the motion still has a margin, to 1/64, and the motion at the next one, without.

    There is none of the latter where a factor of 64 leaves a margin.
    """
    pieces = [len(claims) for claims in claims_of_moves(motion.begun.reached.claims)]

    @cache  # a motion keeps what is certified of it, and that with which the factor ends is asked for again
    def under(share: float) -> WholeMotion:
        return motion if share == 1.0 else motion.under(share * motion.box)

    def holds(share: float) -> bool:
        found = under(share).begun
        return not found.reason and min(found.margins) > 0.0

    # What errors ask of the pieces is seldom less than what there is room for, and takes half of the time.
    share, beyond = largest(holds, lambda share: under(share).bears(pieces))
    return share, None if beyond is None else under(beyond)


def sensitivities(motion: WholeMotion, clearance: tuple[float, float]) -> tuple[Sensitivity, ...]:
    """What the margin loses as each tolerance grows by a fiftieth, and gains as the clearance does; arguments above."""
    now, rate = motion.margin, motion.tolerance.velocity_error
    if now is None:
        return ()
    found = []

    def compared(name: str, value: float, other: WholeMotion) -> None:
        then = other.margin
        found.append(Sensitivity(name, value, _SHARE * value, None if then is None else then - now))

    for k, name in enumerate(AXES):
        if motion.box[k] > 0.0:
            wider = motion.box * (1.0 + _SHARE * (np.arange(6) == k))
            compared(f"start.{name}", float(motion.box[k]), motion.under(wider))
    for k, name in enumerate(("translation", "rotation")):
        if rate[k] > 0.0:
            more = (rate[0] * (1.0 + _SHARE * (k == 0)), rate[1] * (1.0 + _SHARE * (k == 1)))
            tolerance = replace(motion.tolerance, velocity_error=more)
            compared(f"velocity.{name}", rate[k], replace(motion, tolerance=tolerance, known=None))
    sides = [side for side in clearance if np.isfinite(side)]
    if sides and (slimmer := _slimmer(motion, _SHARE * min(sides))) is not None:
        compared("clearance", min(sides), slimmer)
    return tuple(found)


def _slimmer(motion: WholeMotion, gap: float) -> WholeMotion | None:
    """The motion with the moving part slimmer by `gap` (m) on each side, its poses put back onto the surfaces.

    Sides that run askew between x and y leave the surfaces where the two are not slimmed alike. None where the contacts
    do not fit a slimmer part either way.
    """
    x, y, _ = 0.5 * motion.assembly.moving.polyhedron.widths
    for one, other in ((x, y), (min(x, y), min(x, y))):
        slim = stretched(motion.assembly.moving, (1.0 - gap / one, 1.0 - gap / other, 1.0))
        assembly = replace(motion.assembly, moving=slim)
        try:
            goals = [onto_surfaces(assembly, move.goal, move) for move in motion.moves]
            moves = in_a_row(motion.moves, motion.moves[0].start, goals)
            return replace(motion, assembly=assembly, moves=moves, known=None)
        except InfeasibleError:
            continue
    return None
