"""The motion of a problem: searched, its way to begin varied, its goal poses placed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import chain, islice, repeat, tee

from fmopt.certificate.contact_implications import Assembly
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.propagation import Tolerance
from fmopt.errors import FmoptError, InfeasibleError, OverdueError, SearchError
from fmopt.geometry.clearance import Clearance
from fmopt.papers.dakin_popplestone import as_in_the_paper
from fmopt.planning.control.controlled_motion import least_firm, least_steady, runs_against
from fmopt.planning.moves.moves import Move, Reached, claims_of_moves
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.placement.error_growth import COARSE, grown
from fmopt.planning.placement.goal_refinement import Method, Turns, refine_goals
from fmopt.planning.placement.sequence_program import Aim, Placed, Refinement, certified, refine
from fmopt.planning.robustness.error_tolerance import CertifiedMotion, Motion
from fmopt.planning.search.best_first import MoveSequence, Searched, best_sequences
from fmopt.planning.search.entry import (
    Entry,
    Shape,
    hovering_entries,
    planar_entries,
    start_spread,
    straight_entry,
    tilted_entry,
)
from fmopt.planning.search.entry_candidates import likely_shapes, room
from fmopt.planning.search.entry_tuning import Limits, deepened, tuned
from fmopt.planning.search.successors import Costs, Task
from fmopt.planning.search.symmetry import Image, images
from fmopt.runtime.compiled import clock, until
from fmopt.runtime.compiled import deadline as set_deadline
from fmopt.spatial.se3 import Pose, length, log
from fmopt.spatial.values import Array
from fmopt.task.problem import Problem
from fmopt.task.sizes import characteristic_length, drift, measured_clearance

Progress = Callable[[str], None]
FINE = math.radians(1.0)
TRIES = 40  # of entries, when one is varied
STEADY = 0.05  # share of the contact force that presses what a part turns along, whatever friction turns it off
FIRM = 0.05  # share of the contact force that presses all that a part slides along to its next contact
GRACE = 2.0  # s beyond the time limit for what is needed to make something of what there is by then
_LATE = "raise settings.time_limit"
_AMPLE = 0.1  # of the clearance, a margin for which no other sequence is looked at
_MORE = 2  # sequences that are looked at beside one with less
_LIKELY = 32  # ways to begin that are tried in each attitude before the rest are


@dataclass(eq=False)
class Stages:
    """What is being done, and how long it took.

    Args:
        progress: told what is being done.
        seconds: that stages took, by name; time spent on compiling does not count.
    """

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
    """A problem as a motion is looked for.

    Args:
        problem: the task.
        assembly: its parts.
        clearance: as measured on them.
        errors: at the start.
        tolerance: velocity error and metric.
    """

    problem: Problem
    assembly: Assembly
    clearance: Clearance
    errors: ErrorSet
    tolerance: Tolerance

    @classmethod
    def of(cls, problem: Problem) -> Posed:
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
        """What a sequence is placed for under a share of all errors, in coarse pieces, free to turn."""
        errors = ErrorSet.of(share * self.problem.start_box, self.problem.framing)
        tolerance = _tolerance(self.problem, self.tolerance.rho, share)
        return Aim(self.assembly, Reached(errors, (), ()), tolerance, COARSE, turning=True)

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
        return CertifiedMotion(self.assembly, self.clearance, self.errors, self.tolerance, found, placed)

    def imaged(self, image: Image) -> Posed:
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


def under_errors(found: CertifiedMotion, problem: Problem) -> Motion:
    """The moves of a motion under the errors of a problem, which need not be those that it was found for."""
    tolerance = _tolerance(problem, found.tolerance.rho)
    return Motion(found.assembly, found.placed.moves, problem.start_box, tolerance, FINE, problem.framing)


@dataclass(frozen=True, eq=False)
class Attempt:
    """How far a motion came that was not found.

    Args:
        stage: in which it ended, "search" or "placement".
        moves: its moves, not all of which may be certified.
        names: the freedom of each.
        onward: the moves that were tried from their end, each with the name of its freedom.
        seated: whether they come to the goal.
    """

    stage: str
    moves: tuple[Move, ...]
    names: tuple[str, ...]
    onward: tuple[tuple[str, Move], ...] = ()
    seated: bool = False


@dataclass(frozen=True, eq=False)
class _Tried:
    """A failure in one attitude, with what came closest to a motion in it."""

    image: Image
    error: FmoptError
    moves: MoveSequence | None = None

    @property
    def order(self) -> tuple[bool, int, float]:
        """What makes one come farther than another."""
        if self.moves is not None:
            return True, 6, self.moves.reached.margin
        closest = getattr(self.error, "attempt", None)
        return (False, -1, -math.inf) if closest is None else closest.order

    @property
    def attempt(self) -> Attempt | None:
        """How far it came, in the parts' own axes."""
        if self.moves is not None:
            searched = self.image.own_search(self.moves.searched)
            return Attempt("placement", self.image.own_moves(self.moves.moves), searched.names, seated=True)
        closest = getattr(self.error, "attempt", None)
        if closest is None:
            return None
        image, onward = self.image, closest.ways_on
        named = image.own_names(name for name, _ in onward)
        ways = tuple(zip(named, image.own_moves(move for _, move in onward), strict=True))
        names = image.own_names(closest.node.names)
        return Attempt("search", image.own_moves(closest.node.moves), names, ways, closest.order[0])


def motion(posed: Posed, stages: Stages) -> tuple[Searched, Placed]:
    """A sequence of contact states with its goal poses placed, found in the attitude that its parts are planned for.

    Where the likeliest ways to begin leave no margin there, those of the other attitudes are tried, then the rest.

    Args:
        posed: the problem.
        stages: told what is being done.

    Raises:
        SearchError: no sequence was found.
        InfeasibleError: some were found in each attempt, none of which fine pieces can follow.
    """
    deadline = clock() + posed.problem.settings.time_limit
    try:
        with until(deadline):
            return _motion(posed, stages, deadline)
    except OverdueError as error:
        raise SearchError("the time limit is used up before a motion could begin", _LATE, late=True) from error


def _motion(posed: Posed, stages: Stages, deadline: float) -> tuple[Searched, Placed]:
    best: tuple[Searched, Placed] | None = None
    failures: list[_Tried] = []
    stood = (_Stood.of(posed, image) for image in images(posed.assembly, posed.problem.start_box))
    first, again = tee(stood)
    for here, most in chain(zip(first, repeat(_LIKELY)), zip(again, repeat(None))):
        try:
            found, placed = here.motion(islice(here.rounds, most), deadline, stages)
            with until(deadline + GRACE):
                own = certified(posed.assembly, here.image.own_moves(placed.moves), posed.start, posed.tolerance, FINE)
                own = _by_method(posed, own)
        except (SearchError, InfeasibleError) as error:
            failures.append(_Tried(here.image, error.with_traceback(None), here.found))
        except OverdueError:
            late = SearchError("the time limit is used up before a motion was certified", _LATE, late=True)
            failures.append(_Tried(here.image, late, here.found))
        else:
            best = (here.image.own_search(found), own) if best is None or own.margin > best[1].margin else best
        if (best is not None and best[1].margin > 0.0) or clock() >= deadline:
            break
    if best is None:
        raise _told(failures, deadline)
    return best


def _told(failures: Sequence[_Tried], deadline: float) -> FmoptError:
    """The failure that is told of some attempts, with how far the one came that came farthest."""
    farthest = max(failures, key=lambda tried: tried.order)
    told = min(failures, key=lambda tried: (_telling(tried.error), tried is not farthest)).error
    assert isinstance(told, SearchError | InfeasibleError)
    try:
        with until(deadline + GRACE):
            told.attempt = farthest.attempt
    except OverdueError:
        told.attempt = None
    return told


def _telling(error: FmoptError) -> int:
    """Which of the failures of some attempts is told: that time was up, that nothing was found, that it did not do."""
    return 2 if not isinstance(error, SearchError) else 0 if error.late else 1


@dataclass(frozen=True, eq=False)
class _Stood:
    """A problem in one attitude, with what its search is about, and the ways to begin that are left."""

    image: Image
    posed: Posed
    task: Task
    entry_of: Callable[[Shape], Entry]
    rounds: Iterator[Sequence[Entry]]
    found_last: list[MoveSequence]

    @property
    def found(self) -> MoveSequence | None:
        """The last sequence that was found, whether or not it could be placed."""
        return self.found_last[-1] if self.found_last else None

    @staticmethod
    def of(own: Posed, image: Image) -> _Stood:
        """The problem as an image of its parts poses it."""
        posed = own.imaged(image)
        problem, parts, clearance = posed.problem, posed.assembly, posed.clearance
        roomy = room(parts, clearance.per_side, problem.start_box, drift(problem, clearance))
        costs = Costs.of(start_spread(parts.moving, roomy), clearance.per_side)
        turn = 1.3 * problem.settings.max_tilt
        task = Task(parts, Pose.from_vector(problem.goal), posed.errors, posed.tolerance, costs, turn)
        entry_of = partial(tilted_entry, parts.moving, clearance.play, problem.approach)
        return _Stood(image, posed, task, entry_of, _rounds(problem, clearance, roomy, entry_of), [])

    def motion(self, rounds: Iterator[Sequence[Entry]], deadline: float, stages: Stages) -> tuple[Searched, Placed]:
        """What `motion` finds for some ways to begin: the first sequence whose margin is positive, else the best."""
        posed, task = self.posed, self.task
        problem, assembly, tolerance, per_side = posed.problem, task.assembly, task.tolerance, posed.clearance.per_side
        best: tuple[MoveSequence, Placed] | None = None
        failures: list[FmoptError] = []
        spare: tuple[MoveSequence, ...] = ()
        more = _MORE

        def told(names: str) -> None:
            stages.progress(f"search: {names}")

        def tuning(margin: float) -> None:
            stages.progress(f"entry: margin {1e6 * margin:.1f} um")

        def firm(found: MoveSequence) -> bool:
            return least_firm(problem, assembly, found.reached.claims, tolerance) >= FIRM

        @cache
        def steady(found: MoveSequence) -> bool:
            return assembly.planar or least_steady(problem, assembly, found.reached.claims, tolerance) >= STEADY

        limits = Limits(deadline, TRIES, per_side)
        while best is None or (best[1].margin < _AMPLE * per_side and more > 0 and clock() < deadline):
            more -= best is not None and best[1].margin > 0.0
            try:
                spare = spare if clock() < deadline else ()
                candidates = spare or best_sequences(task, rounds, deadline, told, steady, self.rounds)
                if candidates[0].reached.margin > 0.0:
                    candidates, spare = candidates[:1], candidates[1:]
                stages.ended("search")
                found = tuned(task, candidates, self.entry_of, limits, tuning, steady)
                found = deepened(task, found, self.entry_of, firm, limits)
                stages.ended("entry")
                self.found_last[:] = [found]
                placed = placement(posed, found.moves, stages.progress)
                stages.ended("placement")
            except SearchError as error:
                failures = failures or [error.with_traceback(None)]
                break
            except InfeasibleError as error:  # what the search's coarse pieces allow, the fine ones may not
                failures = [error.with_traceback(None)]
                continue
            if best is None or placed.margin > best[1].margin:
                best = found, placed
        if best is None:
            raise failures.pop()
        return best[0].searched, best[1]


def _rounds(
    problem: Problem, clearance: Clearance, roomy: Array, entry_of: Callable[[Shape], Entry]
) -> Iterator[Sequence[Entry]]:
    """Ways to begin, the likeliest first, several to be weighed against each other in each round."""
    moving, box, tilt = problem.moving, problem.start_box, problem.settings.max_tilt
    straight = straight_entry(moving, clearance.play, box, problem.approach)
    if straight:
        yield straight
    if moving.polyhedron.balls:
        yield from hovering_entries(moving, box, problem.approach)
    elif problem.plane is not None:
        yield from planar_entries(moving, problem.fixed, roomy, problem.approach, tilt)
    else:
        rate = problem.velocity_error.translation + problem.velocity_error.rotation
        for shape in likely_shapes(moving, problem.fixed, clearance, roomy, rate, tilt):
            yield (entry_of(shape),)


def placement(posed: Posed, moves: Sequence[Move], progress: Progress) -> Placed:
    """All goal poses placed for the largest certified margin, by the method that the problem asks for.

    Args:
        posed: the problem.
        moves: the sequence, with goals in the contact states that it goes through.
        progress: told the margin after each gain.

    Raises:
        InfeasibleError: fine pieces cannot follow the motion, or no contact would be felt that ends one.
        OverdueError: there is no time to certify it.
    """
    problem, clearance = posed.problem, posed.clearance.per_side
    turns = Turns(3, 0.5 * (posed.spread + clearance))
    with until(set_deadline() + GRACE):
        begun = certified(posed.assembly, moves, posed.start, posed.tolerance, FINE)
    aim = Aim(posed.assembly, posed.start, posed.tolerance, FINE, _as_good_as(posed, begun))

    def told(margin: float) -> None:
        progress(f"placement: margin {1e6 * margin:.1f} um")

    def polished(placed: Placed, method: Method) -> Placed:
        return refine_goals(aim, placed, clearance, method, turns, told)

    if problem.settings.placement == "descent":
        stages = [begun, polished(begun, "descent")]
    else:
        refined = refine(aim, begun, ClarabelSolver(), posed.refinement, told)
        stages = [begun, refined, *filter(aim.fit, [polished(refined, "nlp")])]
    return _by_method(posed, _felt(posed, stages))


def placed_anew(posed: Posed, moves: Sequence[Move], progress: Progress) -> Placed:
    """Goal poses placed from wherever they are, as `placement` does it where the errors can be followed from there.

    Where they cannot, errors are grown first as the poses come to bear them.

    Args:
        posed: the problem.
        moves: the sequence, with goals in the contact states that it goes through.
        progress: told the margin after each gain.

    Raises:
        InfeasibleError: all of the errors cannot be followed.
    """
    try:
        return placement(posed, moves, progress)
    except InfeasibleError:
        progress("placement: errors are grown")
        return placement(posed, grown(posed.under, moves, ClarabelSolver(), posed.refinement, FINE).moves, progress)


def _as_good_as(posed: Posed, begun: Placed) -> Callable[[Placed], bool]:
    """Whether contacts of a sequence hold as surely as those of another one, or as surely as they need to.

    Nor may its moves have to be cut more finely: at each piece a robot stops, and what it is off by adds up.
    """

    @cache
    def least() -> tuple[float, float, bool]:
        return measured(begun)

    def measured(placed: Placed) -> tuple[float, float, bool]:
        given = posed.problem, posed.assembly, placed.reached.claims, posed.tolerance
        steady = STEADY if posed.assembly.planar else least_steady(*given)
        return min(FIRM, least_firm(*given)), min(STEADY, steady), runs_against(*given)

    def fit(placed: Placed) -> bool:
        if any(new > old for new, old in zip(_fineness(placed), _fineness(begun), strict=True)):
            return False
        try:
            return all(new >= old for new, old in zip(measured(placed), least(), strict=True))
        except InfeasibleError:  # no bias force holds the contacts
            return False

    return fit


def _fineness(placed: Placed) -> list[float]:
    """Of each move, how many times as many pieces it has as its turn alone asks for."""
    turns = (length(log(move.goal.R @ move.start.R.T)) for move in placed.moves)
    pieces = map(len, claims_of_moves(placed.reached.claims))
    return [count / max(1, math.ceil(turn / FINE - 1e-9)) for count, turn in zip(pieces, turns, strict=True)]


def _by_method(posed: Posed, placed: Placed) -> Placed:
    """A sequence with the claims of the method that the problem asks for."""
    if posed.problem.settings.method != "dakin1993":
        return placed
    claims = as_in_the_paper(posed.assembly, placed.reached.claims, posed.errors, posed.tolerance)
    return replace(placed, reached=replace(placed.reached, claims=claims))


def _felt(posed: Posed, found: Sequence[Placed]) -> Placed:
    """The last of some sequences of which every piece runs against the contact that ends its move."""
    for placed in reversed(found):
        if runs_against(posed.problem, posed.assembly, placed.reached.claims, posed.tolerance):
            return placed
    raise InfeasibleError("a piece of a turn leads away from the contact that is to end it at first")
