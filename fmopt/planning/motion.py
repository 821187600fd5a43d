"""The motion of a problem: searched, its way to begin varied, its goal poses placed."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import islice, tee

from fmopt.errors import FmoptError, InfeasibleError, OverdueError, SearchError
from fmopt.planning.control.controlled_motion import least_steady
from fmopt.planning.moves.moves import Care, Move
from fmopt.planning.placement.sequence_program import Placed, certified
from fmopt.planning.posed import GRACE, STEADY, Posed, Stages, by_method, placed_by_growing, placement
from fmopt.planning.search.best_first import MoveSequence, best_sequences, farther, search
from fmopt.planning.search.entry import (
    Approach,
    Entry,
    hovering_entries,
    planar_entries,
    start_spread,
    straight_entry,
    tilted_entry,
)
from fmopt.planning.search.entry_room import room
from fmopt.planning.search.entry_sampling import EntryDraws, beginnings
from fmopt.planning.search.entry_tuning import TuningLimits, tuned
from fmopt.planning.search.successors import ASKEW, Costs, SearchTask
from fmopt.planning.search.symmetry import Image, Searched, images
from fmopt.runtime.clock import clock, until
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.sizes import drift

TRIES = 40  # of entries, when one is varied
_LATE = "raise settings.time_limit"
_AMPLE = 0.1  # of the clearance, a margin for which no other sequence is looked at
_MORE = 2  # sequences that are looked at beside one with less
_LIKELY = 32  # ways to begin that are tried in each attitude before the rest are
_SHARE = 0.25  # of the errors, for which sequences are looked for that then take all of them
_BEGINNING = (1.0, 0.7, 0.5)  # of the errors, for which ways to begin are drawn for these
_DRAWN, _ENOUGH = 100, 8  # ways that are drawn for each, and found of different kinds so that no less will do
_DRAWINGS = 24  # how often
_STATES = 30  # that a search from one of them looks at: what was found with a margin in families took 26 at most
_SMALLER = "allow a larger tilt, lower the start errors"


@dataclass(frozen=True, eq=False)
class Failed:
    """How far a motion came that was not found."""

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
    def attempt(self) -> Failed | None:
        """How far it came, in the parts' own axes."""
        if self.moves is not None:
            searched = self.image.own_search(self.moves.searched)
            return Failed("placement", self.image.own_moves(self.moves.moves), searched.names, seated=True)
        closest = getattr(self.error, "attempt", None)
        if closest is None:
            return None
        image, onward = self.image, closest.ways_on
        named = image.own_names(name.rstrip(ASKEW) for name, _ in onward)
        ways = tuple(zip(named, image.own_moves(move for _, move in onward), strict=True))
        names = image.own_names(name.rstrip(ASKEW) for name in closest.node.names)
        return Failed("search", image.own_moves(closest.node.moves), names, ways, closest.order[0])


def motion(posed: Posed, stages: Stages) -> tuple[Searched, Placed]:
    """A sequence of contact states with its goal poses placed, found in the attitude that its parts are planned for.

    Where the likeliest ways to begin leave no margin there, those of the other attitudes are tried, then the rest.

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
    for here, found_by in _ways(posed):
        try:
            found, placed = found_by(deadline, stages)
            with until(deadline + GRACE):
                # A plan is of the parts themselves: what holds of their image is certified once more on them.
                moves = here.image.own_moves(placed.moves)
                own = by_method(posed, certified(posed.assembly, moves, posed.start, posed.tolerance, placed.step))
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


_Finding = Callable[[float, Stages], tuple[Searched, Placed]]
"""Finds a motion by a deadline, and says what is being done; raises what `_Stood.motion` does."""


def _ways(posed: Posed) -> "Iterator[tuple[_Stood, _Finding]]":
    """Ways to find a motion: by the likeliest ways to begin, by growing errors, in other attitudes, by all others."""
    attitudes = images(posed.assembly, posed.problem.start_box)
    # Each attitude is made once: in its second turn the rounds go on after the likeliest ones.
    first, again = tee(_Stood.of(posed, image) for image in attitudes)
    here = next(first)
    yield here, partial(here.motion, islice(here.rounds, _LIKELY))
    yield here, here.grown
    for here in first:
        yield here, partial(here.motion, islice(here.rounds, _LIKELY))
    for here in again:
        yield here, partial(here.motion, here.rounds)


def _told(failures: Sequence[_Tried], deadline: float) -> FmoptError:
    """The failure that is told of some attempts, with how far the one came that came farthest."""
    farthest = max(failures, key=lambda tried: tried.order)
    told = min(failures, key=lambda tried: (_telling(tried.error), tried is not farthest)).error
    assert isinstance(told, SearchError | InfeasibleError)
    share = max(_share(tried.error) for tried in failures)
    if share > 0.0:
        words = f"no motion takes all of the errors, the best that was found about {share:.0%} of them"
        told = SearchError(words, _SMALLER, isinstance(told, SearchError) and told.late)
    if isinstance(told, SearchError):
        told.late = told.late or clock() >= deadline  # there were ways left to try
    # To say how far it came, moves are looked for from there: that may take longer than is left.
    try:
        with until(deadline + GRACE):
            told.attempt = farthest.attempt
    except OverdueError:
        told.attempt = None
    return told


def _share(error: FmoptError) -> float:
    """What a sequence that failed takes of all errors; 0 where that is not known."""
    return error.share if isinstance(error, InfeasibleError) else 0.0


def _telling(error: FmoptError) -> int:
    """Which of the failures of some attempts is told: that time was up, that nothing was found, that it did not do."""
    return 2 if not isinstance(error, SearchError) else 0 if error.late else 1


@dataclass(eq=False)
class _Stood:
    """A problem in one attitude, with what its search is about, and the ways to begin that are left.

    `found` is the last sequence that was found, whether or not it could be placed.
    """

    image: Image
    posed: Posed
    task: SearchTask
    entry_of: Callable[[Approach], Entry]
    rounds: Iterator[Sequence[Entry]]
    found: MoveSequence | None = None

    @staticmethod
    def of(own: Posed, image: Image) -> "_Stood":
        """The problem as an image of its parts poses it."""
        posed = own.imaged(image)
        problem, parts, clearance = posed.problem, posed.assembly, posed.clearance
        roomy = room(parts, clearance.per_side, problem.start_box, drift(problem, clearance))
        # Moves have to reach as far as ways to begin leave room, also where errors are next to nothing.
        costs = Costs.of(start_spread(parts.moving, roomy), clearance.per_side)
        turn = 1.3 * problem.settings.max_tilt
        task = SearchTask(parts, Pose.from_vector(problem.goal), posed.errors, posed.tolerance, costs, turn)
        entry_of = partial(tilted_entry, parts.moving, clearance.play, problem.approach)
        return _Stood(image, posed, task, entry_of, _rounds(posed, task, roomy, entry_of))

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

        @cache  # the search asks it of a sequence, and its tuning asks again
        def steady(found: MoveSequence) -> bool:
            return assembly.planar or least_steady(problem, assembly, found.reached.claims, tolerance) >= STEADY

        limits = TuningLimits(deadline, TRIES, per_side)
        while best is None or (best[1].margin < _AMPLE * per_side and more > 0 and clock() < deadline):
            # Beside sequences without a margin any number of others is looked at, as long as there are some.
            more -= best is not None and best[1].margin > 0.0
            try:
                spare = spare if clock() < deadline else ()
                candidates = spare or best_sequences(task, rounds, deadline, told, steady, self.rounds)
                # One with a margin is varied alone; the others stay for where it cannot be placed, or keeps little.
                if candidates[0].reached.margin > 0.0:
                    candidates, spare = candidates[:1], candidates[1:]
                stages.ended("search")
                found = tuned(task, candidates, self.entry_of, limits, tuning, steady)
                stages.ended("entry")
                self.found = found
                placed = placement(posed, found.moves, stages.progress)
                stages.ended("placement")
            except SearchError as error:
                failures = failures or [error.with_traceback(None)]  # what could not be placed says more
                break
            except InfeasibleError as error:  # what the search's coarse pieces allow, the fine ones may not
                failures = [error.with_traceback(None)]
                continue
            if best is None or placed.margin > best[1].margin:
                best = found, placed
        if best is None:
            raise failures.pop()
        return best[0].searched, best[1]

    def grown(self, deadline: float, stages: Stages) -> tuple[Searched, Placed]:
        """A sequence that takes a share of the errors, its poses placed anew until they take all of them.

        Raises:
            SearchError: there is none.
            InfeasibleError: those that there are cannot be placed so.
        """
        failure: FmoptError | None = None
        failed = list[SearchError]()
        for found in self._under(deadline, stages, failed):
            self.found = found
            try:
                placed = placed_by_growing(self.posed, found.moves, stages.progress)
            except (InfeasibleError, OverdueError) as error:
                error = error.with_traceback(None)
                failure = max(failure or error, error, key=_share)
                continue
            finally:
                stages.ended("placement")
            if placed.margin > 0.0:
                return found.searched, placed
        attempt = failed[-1].attempt if failed else None
        words = "no sequence of contacts was found for a share of the errors"
        raise failure or SearchError(words, _SMALLER, attempt=attempt)

    def _under(self, deadline: float, stages: Stages, failed: list[SearchError]) -> Iterator[MoveSequence]:
        """Sequences for a share of all errors from ways to begin under as much of them as there are any for.

        The last of those that failed is the one that came farthest.
        """
        aim = self.posed.under(_SHARE)
        task = replace(
            self.task,
            start=aim.start.errors,
            tolerance=aim.tolerance,
            costs=replace(self.task.costs, states=_STATES),
            askew=True,
            care=Care.FACETS,  # growing asks for facets, too: most sequences that are short of them grew to nothing
        )
        for entry in self._drawn(deadline):
            if clock() >= deadline:
                break
            try:
                found = search(task, (entry,), deadline, lambda names: stages.progress(f"search: {names}"))
            except SearchError as error:
                failed[:] = [farther(error.with_traceback(None), *failed)]
                continue
            if found.reached.margin > 0.0:
                stages.ended("search")
                yield found

    def _drawn(self, deadline: float) -> Iterator[Entry]:
        """Ways to begin, as many times as there is time: for all errors first, for less where there are few."""
        problem, moving = self.posed.problem, self.posed.assembly.moving
        # What is drawn tilts about two axes and goes in with a corner, which these do not.
        if problem.plane is not None or moving.polyhedron.balls or problem.settings.max_tilt <= 0.0:
            return
        for seed in range(_DRAWINGS):
            few = 0
            for share in _BEGINNING:
                if clock() >= deadline or few >= _ENOUGH:
                    break
                for entry in self._beginnings(share, seed):
                    few += 1
                    yield entry

    def _beginnings(self, share: float, seed: int) -> tuple[Entry, ...]:
        """Ways to begin that can be certified for a share of all errors."""
        aim = self.posed.under(share)
        task = replace(self.task, start=aim.start.errors, tolerance=aim.tolerance)
        return beginnings(task, drawing(self.posed, share).shapes(seed), self.entry_of, _DRAWN)


def drawing(posed: Posed, share: float = 1.0) -> EntryDraws:
    """What ways to begin are drawn for under a share of all errors, widened where these are next to nothing."""
    problem, clearance, tilt = posed.problem, posed.clearance, posed.problem.settings.max_tilt
    rate = share * (problem.velocity_error.translation + problem.velocity_error.rotation)
    box = room(posed.assembly, clearance.per_side, share * problem.start_box, share * drift(problem, clearance))
    return EntryDraws(problem.moving, problem.fixed, clearance.play, box, rate, tilt)


def _rounds(
    posed: Posed, task: SearchTask, roomy: Array, entry_of: Callable[[Approach], Entry]
) -> Iterator[Sequence[Entry]]:
    """Ways to begin, the likeliest first, several to be weighed against each other in each round."""
    problem, clearance = posed.problem, posed.clearance
    moving, box, tilt = problem.moving, problem.start_box, problem.settings.max_tilt
    if straight := straight_entry(moving, clearance.play, box, problem.approach):
        yield straight
    if moving.polyhedron.balls:
        yield from hovering_entries(moving, box, problem.approach)
    elif problem.plane is not None:
        yield from planar_entries(moving, problem.fixed, roomy, problem.approach, tilt)
    elif tilt > 0.0:
        found = drawing(posed)
        for seed in range(_DRAWINGS):
            for entry in beginnings(task, found.shapes(seed), entry_of, _DRAWN):
                yield (entry,)
