"""A plan of presses in words: each press with what is held, pushed and awaited, and what its trials came to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape

from fmopt.plan import Plan
from fmopt.plan.evidence import Evidence, TrialOutcome
from fmopt.plan.position_force import AXES
from fmopt.plan.press import Attempt, Force, Level, Press, PressPlan, Standstill, Time, Travel
from fmopt.report.naming import combination, degrees, millimetres, pose_words
from fmopt.report.shell import table

HEAD = ("press", "S", "Pa: twist of held axes", "Fa: wrench on the others", "ends")


def presses_of(plan: Plan) -> PressPlan:
    """The presses of a plan that has them."""
    assert plan.press_plan is not None
    return plan.press_plan


def press_rows(attempt: Attempt) -> list[tuple[str, ...]]:
    """One row per press: name, S as the letters of force axes, twist, wrench, ends."""
    return [(p.name, _s_words(p), _twist_words(p), _wrench_words(p), "; ".join(_ends(p))) for p in attempt.presses]


def _s_words(press: Press) -> str:
    giving = [axis for axis, gives in zip(AXES, press.gives, strict=True) if gives]
    words = f"{', '.join(giving)} give{'s' if len(giving) == 1 else ''} way" if giving else "all held"
    return f"{words}, the attitude held as commanded" if press.keeps and not all(press.gives[3:]) else words


def _twist_words(press: Press) -> str:
    if press.rocking is not None:
        return f"cone of {degrees(press.rocking.angle)}°, {press.rocking.rate:g} times a second"
    rates = enumerate(zip(AXES, press.twist, strict=True))
    moving = [f"{axis} {1e3 * v:+.3g} mm/s" if k < 3 else f"{axis} {degrees(v)}°/s" for k, (axis, v) in rates if v]
    return ", ".join(moving) or "none"


def _wrench_words(press: Press) -> str:
    if not any(press.wrench):
        return "none"
    at = "" if not any(press.reference) else f" at {millimetres(press.reference[2])} mm over the leading face"
    return combination(press.wrench, "N", "N m") + at


def _ends(press: Press) -> Iterator[str]:
    for end in press.ends:
        then = "" if end.then == "next" else f": {end.then}"
        match end:
            case Standstill():
                below = "" if end.below is None else f" below z = {millimetres(end.below)} mm, else {end.else_then}"
                words = f"within {1e6 * end.displacement:.0f} µm for {end.window:g} s{below}"
            case Level():
                words = f"z at {millimetres(end.z)} mm"
            case Travel():
                way = f"{millimetres(end.distance)} mm" if end.distance else f"{degrees(end.angle or 0.0)}°"
                words = f"after {way}"
            case Force():
                words = f"at {end.force:.3g} N on held axes"
            case Time():
                words = f"after {end.seconds:.3g} s"
        yield words + then


def carried_words(plan: Plan) -> str:
    """What trials of a certified plan came to, in a few words for its verdict."""
    found = plan.description.carried_out
    if found is None:
        return "; ".join(["not carried out", *own_words(plan)])
    rate = f"{found.seated} of {found.draws} draws seat in the physics engine, at least {100.0 * found.bound:.1f} %"
    reached = found.bound >= found.min_rate
    return "; ".join([rate if reached else f"BUT {rate}, asked for {100.0 * found.min_rate:g} %", *own_words(plan)])


def own_words(plan: Plan) -> list[str]:
    """What trials on robots came to, one statement a file."""
    return [
        f"{one.seated} of {one.trials} trials on a robot ({one.source}) seat, at least {100.0 * one.bound:.1f} %"
        + (f", in {one.seconds:.3g} s" if one.seconds is not None else "")
        + (", which CONTRADICTS the physics engine" if one.contradicts else "")
        for one in plan.description.own_trials
    ]


def evidence_words(plan: Plan) -> str:
    """What trials came to, with draws and bound; and what is certified where that is less than was asked for."""
    evidence, share = plan.trials, plan.description.certified_share
    own = "".join(f" {words}." for words in own_words(plan))
    if evidence is None:
        return f"There is no evidence: {plan.description.untried or 'trials of the presses were left out'}.{own}"
    return (
        f"{evidence.seated} of {evidence.draws} draws seat in the physics engine, {evidence.first_tries} at the first "
        f"attempt: a rate of at least {100.0 * evidence.bound:.1f} % at {evidence.confidence:.1%} confidence, asked "
        f"for {100.0 * evidence.min_rate:g} %. {evidence.vertices_seated} of {evidence.vertices} vertices of the start "
        "errors seat."
        + ("" if share is None else f" Guarded moves are certified for {share:.0%} of the start errors.")
        + own
    )


def conditions_words(evidence: Evidence) -> str:
    """What draws are taken from."""
    given = evidence.conditions
    return (
        f"friction {_interval(given.friction)}, stiffness × {_interval(given.stiffness)}, admittance × "
        f"{_interval(given.admittance)}, wrench off by ±{given.offset[0]:g} N and ±{given.offset[1]:g} N m, twists by "
        f"{100.0 * given.drift:g} %"
    )


def _interval(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.3g}" if ends[0] == ends[1] else f"{ends[0]:.3g} to {ends[1]:.3g}"


def failure_rows(evidence: Evidence) -> list[tuple[str, ...]]:
    """Failures by the press that they are last at and their first reason: how many draws, how many vertices."""

    def counted(outcomes: Sequence[TrialOutcome]) -> Counter[tuple[str, str]]:
        # Reasons begin with numbers of one trial: what tells failures apart is the words behind them.
        return Counter((one.press, _kind(one.reasons)) for one in outcomes if not one.seated)

    draws, vertices = counted(evidence.outcomes), counted(evidence.vertex_outcomes)
    return [(*key, str(draws[key]), str(vertices[key])) for key in sorted({*draws, *vertices})]


def _kind(reasons: Sequence[str]) -> str:
    words = reasons[-1] if reasons and reasons[0] == "stopped on the way" else next(iter(reasons), "")
    return words.lstrip("-.0123456789 ").removeprefix("mm ")


def timing_words(evidence: Evidence) -> str:
    """Cycle time of the draws that seat, and their greatest force."""
    if (times := evidence.cycle_times) is None:
        return ""
    peak = max(one.peak_force for one in evidence.outcomes)
    return f"Cycle time {times[0]:.1f} s, 95 % within {times[1]:.1f} s; force up to {peak:.1f} N."


def press_chapters(plan: Plan) -> list[tuple[str, str, str]]:
    """Chapters of the page: evidence, presses, failed draws."""
    presses, evidence = presses_of(plan), plan.trials
    text = ""
    for number, attempt in enumerate(presses.attempts):
        title = f"Attempt {number + 1} ({attempt.source}), from {pose_words(attempt.start)}"
        text += table(title, HEAD, press_rows(attempt))
    robot = presses.robot
    text += (
        f"<p>Axes of the frame of the hole, torques about the leading face's centre. Held axes: "
        f"{1e-3 * robot.stiffness[0]:g} N/mm, {robot.stiffness[1]:g} N m/rad; axes that give way: "
        f"{robot.damping[0]:.4g} N s/m, {robot.damping[1]:.3g} N m s/rad; {robot.mass:g} kg. After a failure the part "
        "backs out along its way, is lifted, and the next attempt begins.</p>\n"
    )
    found = f"<p>{escape(evidence_words(plan))}</p>\n"
    if evidence is not None:
        found += f"<p>Drawn from: {escape(conditions_words(evidence))}. {escape(timing_words(evidence))}</p>\n"
        head = ("last press", "what speaks against it", "draws", "vertices")
        found += table("Trials that do not seat", head, failure_rows(evidence), "..nn")
    return [("evidence", "Evidence", found), ("presses", "The presses", text)]
