"""Why there is no plan for a problem: how far a motion came, what it lacks, and the nearest problem that does work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from fmopt.errors import InfeasibleError, OverdueError, SearchError
from fmopt.plan import StatedContact, StatedPart, line
from fmopt.report.attempt import AttemptStep, Failure, Lack, Nearest, failure_page
from fmopt.report.bodies import stated_part
from fmopt.report.naming import quantity
from fmopt.runtime import output
from fmopt.runtime.clock import clock, until
from fmopt.task.problem import Problem
from fmopt.task.sizes import short_of_height

if TYPE_CHECKING:
    from fmopt.geometry.part import Part as Solid
    from fmopt.planning.motion import Failed
    from fmopt.planning.moves.moves import Move
    from fmopt.planning.posed import Posed

Progress = Callable[[str], None]
NoMotion: TypeAlias = SearchError | InfeasibleError
_SHORTEST = 1e-12  # m, below which nothing is called short


def explained(problem: Problem, error: NoMotion, begun: float, progress: Progress = lambda _: None) -> Failure:
    """What there is to say of a problem for which no motion was found, which the error has from then on."""
    from fmopt.planning.pipeline import RESERVED

    limit = problem.settings.time_limit
    # What is left of the time limit, or half of what is reserved where the search took more than its share.
    seconds = max(begun + limit - clock(), 0.5 * RESERVED * limit)
    with until(clock() + seconds):
        failure = _failure(problem, error, seconds, progress)
    error.failure, error.advice = failure, "; or ".join(failure.advice)
    return failure


def _failure(problem: Problem, error: NoMotion, seconds: float, progress: Progress) -> Failure:
    from fmopt.planning.pipeline import nearest
    from fmopt.planning.posed import Posed

    begun, posed = clock(), Posed.of(problem)
    attempt: Failed | None = error.attempt
    steps, lack = ((), None) if attempt is None else _followed(posed, attempt)
    late = isinstance(error, SearchError) and error.late
    found, cut = None, False
    # Else the search itself has tried shares, or guarded moves are none to take.
    if not problem.settings.reduce_errors and not problem.cell.solids:
        progress("the nearest problem that works")
        tried = nearest(problem, seconds - (clock() - begun), progress)
        cut = tried.late
        if tried.share:
            velocity = (tried.velocity.translation, tried.velocity.rotation)
            own = None if tried.velocity == problem.velocity_error else velocity
            found = Nearest(tried.share, tuple(map(float, tried.share * problem.stated_box)), tried.margin, own)
    # Contacts of moves that lead on, too: what is missing may be named after them.
    moves = () if attempt is None else (*attempt.moves, *(move for _, move in attempt.onward))
    contacts = {one.id: one for move in moves for one in (*move.held, *move.making, *move.left)}
    return Failure(
        title=problem.title,
        stage="begin" if attempt is None else attempt.stage,
        message=line(error.message),
        late=late,
        lack=lack,
        steps=steps,
        box=tuple(map(float, problem.start_box)),
        rho=posed.tolerance.rho,
        nearest=found,
        advice=tuple(_advice(problem, error, found, cut)),
        moving=_part(problem.moving, problem, posed),
        fixed=_part(problem.fixed, problem, posed),
        contacts=tuple(StatedContact(c.id, str(c.kind), c.moving, c.fixed) for c in contacts.values()),
    )


def write(failure: Failure, folder: Path) -> list[Path]:
    """Writes `attempt.html`, and its figure as SVG and PNG, to a folder."""
    figures = failure.figures
    svgs = {name: figure.svg() for name, figure in figures.items()}
    files = {folder / "attempt.html": failure_page(failure, svgs).encode()}
    for name, figure in figures.items():
        files[folder / "figures" / f"{name}.svg"] = svgs[name].encode()
        files[folder / "figures" / f"{name}.png"] = figure.png()
    for path, content in files.items():
        output.save(content, path)
    return list(files)


def _advice(problem: Problem, error: NoMotion, found: Nearest | None, cut: bool) -> Iterator[str]:
    """What to change, each true of what was tried; `cut` says whether time ended a try with smaller errors."""
    if problem.cell.solids and error.advice:
        yield error.advice
        return
    if (short := short_of_height(problem)) is not None:
        yield (
            f"raise start.height to {quantity(short[1])}: it is {quantity(problem.approach)}, "
            f"and the start error could bring the part down by {quantity(short[0])}"
        )
    late, now = isinstance(error, SearchError) and error.late, f"{problem.settings.time_limit:g} s now"
    if found is not None:
        share = f"{100.0 * found.share:.3g} % ({found.words})"
        errors = "start errors" if found.velocity is None else "start errors and errors of velocity"
        yield f"lower all {errors} to {share}, which is certified with {quantity(found.margin)}"
    if late:
        yield f"raise settings.time_limit, {now}, which ended the search before its end"
    elif found is None and cut:
        yield f"raise settings.time_limit, {now}, which left too little for tries with smaller start errors"
    elif found is None:
        yield "widen the clearance, or try another settings.max_tilt or start.height; smaller start errors did not help"
    if not isinstance(error, SearchError) and error.advice:
        yield error.advice


def _followed(posed: Posed, attempt: Failed) -> tuple[tuple[AttemptStep, ...], Lack | None]:
    """The moves of an attempt with what is certified of them, and what is missing first."""
    from fmopt.planning.moves.moves import Reached, unroll
    from fmopt.planning.posed import FINE

    def after(move: Move, reached: Reached) -> tuple[Reached, float, str]:
        there = unroll(posed.assembly, move, reached, posed.tolerance, FINE)
        # Of this move alone: the claims of those before it come first.
        worst = min(there.claims[len(reached.claims) :], key=lambda claim: claim.margin)
        return there, worst.margin, worst.binding

    reached, steps, lack = posed.start, list[AttemptStep](), None
    for number, (name, move) in enumerate(zip(attempt.names, attempt.moves, strict=False), start=1):
        margin: float | None = None
        # A move short of margin ends somewhere all the same; after one that is impossible no errors are known.
        if lack is None or lack.binding:
            try:
                reached, margin, binding = after(move, reached)
                if margin <= 0.0 and (lack is None or -margin > (lack.short or 0.0)):
                    lack = Lack(number, name, "", binding, _contact(move, binding), -margin)
            except InfeasibleError as error:
                lack = lack or _impossible(number, name, move, error)
            except OverdueError:
                lack = lack or Lack(number, name, "the time limit is used up", "", "", None)
        start, goal = (tuple(map(float, pose.vector())) for pose in (move.start, move.goal))
        steps.append(AttemptStep(name, start, goal, tuple(contact.id for contact in move.making), margin))
    if lack is None and attempt.seated:  # all of it can be followed: what was missing is time to place it
        lack = Lack(max(1, len(steps)), attempt.names[-1], "the time limit is used up", "", "", None)
    if lack is not None:
        return tuple(steps), lack
    ways = list[Lack]()
    for name, move in attempt.onward:
        try:
            _, margin, binding = after(move, reached)
        except InfeasibleError as error:
            ways.append(_impossible(len(steps) + 1, name, move, error))
        except OverdueError:
            break
        else:
            if margin <= 0.0:
                ways.append(Lack(len(steps) + 1, name, "", binding, _contact(move, binding), -margin))
    # Only lengths compare: the way that is short by least comes nearest to leading on.
    told = [way for way in ways if way.short is not None]
    if told:
        return tuple(steps), min(told, key=lambda way: way.short or 0.0)
    words = "no move from there makes another contact that errors leave sure"
    return tuple(steps), ways[0] if ways else Lack(len(steps) + 1, "", words, "", "", None)


def _impossible(number: int, name: str, move: Move, error: InfeasibleError) -> Lack:
    short = error.shortfall if error.shortfall > _SHORTEST else None
    return Lack(number, name, error.message, "", _contact(move, ""), short)


def _contact(move: Move, binding: str) -> str:
    """The contact that binds, else the one that a move makes."""
    # "v0-f5 too early" is about v0-f5.
    own = next((c.id for c in (*move.held, *move.making, *move.left) if binding.split(" ")[0] == c.id), "")
    return own or next((c.id for c in move.making), "")


def _part(solid: Solid, problem: Problem, posed: Posed) -> StatedPart:
    declared, measured = problem.declared_clearance, posed.clearance.per_side
    part, name = stated_part(solid), line(solid.name)
    return replace(part, name=name, declared_clearance=declared, measured_clearance=measured)
