"""A plan of presses in words: each press with what is held, pushed and awaited, and what its trials came to."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from fmopt.plan import Plan
from fmopt.plan.evidence import TOUCH, Evidence, TrialOutcome
from fmopt.plan.position_force import AXES
from fmopt.plan.press import Attempt, Force, Level, Press, PressPlan, Standstill, Time, Travel, first_presses
from fmopt.plan.press_rows import FREE_OF_JAMS, PlacedAttempt, PressRows
from fmopt.report.naming import box_words, degrees, millimetres, pose_words
from fmopt.report.shell import Markup, paragraph, table

_NAMED = 3  # contacts of a set
_MAX_LISTED = 40  # trials that do not seat
OUTCOMES = "Outcomes by press and kind: draws, and vertices in brackets"
ENDINGS = ("attempt", "press", "go on", "retry", "seat", "fail")
PLACED = "Rows of the presses, to first order along the way without errors; nothing of them is proved"
ROWS = ("press", "room for errors, mm", "held by", "holds at friction", "no jam up to friction", "errors left")
HEAD = ("press", "S", "Pa: twist of held axes", "Fa: wrench on the others", "ends")


def presses_of(plan: Plan) -> PressPlan:
    """The presses of a plan that has them."""
    assert plan.press_plan is not None
    return plan.press_plan


def press_rows(attempt: Attempt) -> list[tuple[str, ...]]:
    """One row per press: name, S as the letters of force axes, twist, wrench, ends."""
    return [(p.name, _s_words(p), _twist_words(p), _wrench_words(p), "; ".join(_ends(p))) for p in attempt.presses]


def placed_rows(attempt: Attempt, placed: PlacedAttempt) -> list[tuple[str, ...]]:
    """One row per press that the trial without errors came to: room, contacts, friction, errors that are left."""
    return [
        (
            press.name,
            "" if row.margin is None else millimetres(row.margin),
            f"{len(row.contacts)} contacts, rank {row.rank} of {sum(press.gives)}" if row.contacts else "",
            "" if row.holds is None else _friction_words(row.holds),
            _jam_words(row),
            box_words(row.error),
        )
        for press, row in zip(attempt.presses, placed.presses, strict=False)
    ]


def _friction_words(friction: float) -> str:
    return f"{friction:.2f}" if friction < FREE_OF_JAMS - 0.01 else f"{FREE_OF_JAMS:g} and more"


def _jam_words(row: PressRows) -> str:
    if row.largest_friction is None:
        return ""
    more = f", {row.left_out} sets left out" if row.left_out else ""
    count = len(row.jams_on)
    names = ", ".join(row.jams_on[:_NAMED]) + (f" and {count - _NAMED} more" if count > _NAMED else "")
    if row.largest_friction < 0.0:
        return f"rests without friction on {names}{more}"
    on = f", then on {names}" if names else ""
    return f"{_friction_words(row.largest_friction)}{on}{more}"


def shown_words(plan: Plan) -> str:
    """From which press of the first attempt on, and up to which friction, rows show that the part comes to its goal."""
    first = next(iter(plan.description.placed), None)
    if first is None or first.datum is None or first.shown_friction is None:
        return ""
    name = presses_of(plan).attempts[0].presses[first.datum].name
    return (
        f"from press {first.datum + 1} ({name}) on, a datum that fixes all six coordinates, for friction up to "
        f"{_friction_words(first.shown_friction)}: to first order, and not proved"
    )


def _s_words(press: Press) -> str:
    giving = [axis for axis, gives in zip(AXES, press.gives, strict=True) if gives]
    words = f"{', '.join(giving)} give{'s' if len(giving) == 1 else ''} way" if giving else "all held"
    return f"{words}, the attitude held as commanded" if press.keeps and not all(press.gives[3:]) else words


def _twist_words(press: Press) -> str:
    if press.rocking is not None:
        return f"cone of {degrees(press.rocking.angle)}°, {press.rocking.rate:g} times a second"
    way, turn = (1e3 * v for v in press.twist[:3]), map(math.degrees, press.twist[3:])
    return _along([*way, *turn], " mm/s", "°/s")


def _wrench_words(press: Press) -> str:
    at = f" at {millimetres(press.reference[2])} mm over the leading face" if any(press.reference) else ""
    return _along(press.wrench, " N", " N m") + (at if any(press.wrench) else "")


def _along(vector: Sequence[float], along: str, about: str) -> str:
    """A twist or wrench (6,) with its units, the greatest first: "towards −z 14 N, +x 1 N; about +z 0.3 N m"."""
    words = []
    for way, unit, half in (("towards", along, vector[:3]), ("about", about, vector[3:])):
        parts = sorted(zip(map(abs, half), half, AXES[:3], strict=True), key=lambda part: -part[0])
        named = [f"{'−' if v < 0 else '+'}{at} {size:.3g}{unit}" for size, v, at in parts if size > 1e-4 * parts[0][0]]
        words += [f"{way} {', '.join(named)}"] if named else []
    return "; ".join(words) or "none"


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
    rate += timing_words(found.times)
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
    vertices = "Vertices of the start errors were not tried, so that the plan is not TESTED."
    if evidence.vertices:
        vertices = f"{evidence.vertices_seated} of {evidence.vertices} vertices of the start errors seat."
    most = "" if evidence.max_time is None else f", asked for {evidence.max_time:.3g} s"
    return (
        f"{evidence.seated} of {evidence.draws} draws seat in the physics engine, {evidence.first_tries} at the first "
        f"attempt{timing_words(evidence.cycle_times)}{most}: a rate of at least {100.0 * evidence.bound:.1f} % at "
        f"{evidence.confidence:.1%} confidence, asked for {100.0 * evidence.min_rate:g} %. {vertices}"
        + _clear_words(evidence)
        + ("" if share is None else f" Guarded moves are certified for {share:.0%} of the start errors.")
        + own
    )


def timing_words(times: tuple[float, float] | None) -> str:
    """Median and 95 % of cycle times, s, as they go on a rate; nothing where there are none."""
    return "" if times is None else f", in {times[0]:.1f} s, 95 % within {times[1]:.1f} s"


def _clear_words(evidence: Evidence) -> str:
    """How near tool and obstacles come, where there are any."""
    if evidence.distance is None:
        return ""
    touching = sum((one.distance or 0.0) <= TOUCH for one in (*evidence.outcomes, *evidence.vertex_outcomes))
    if touching:
        return f" In {touching} trials tool or obstacles are touched."
    return f" Tool and obstacles are kept clear by {1e3 * evidence.distance:.3g} mm or more."


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


def outcome_rows(plan: Plan, evidence: Evidence) -> list[tuple[str, ...]]:
    """How many draws, and in brackets vertices, go on from a press or end there, a row for each press."""
    attempts = presses_of(plan).attempts
    firsts, counts = first_presses(attempts), Counter[tuple[int, str, bool]]()
    for at_vertex, outcomes in enumerate((evidence.outcomes, evidence.vertex_outcomes)):
        for one in outcomes:
            for attempt, (first, rests) in enumerate(zip(firsts, one.rests, strict=False)):
                ends = "retries" if attempt < one.attempt else "seats" if one.seated else one.kind
                for row in range(len(rests)):
                    counts[first + row, ends if row + 1 == len(rests) else "goes on", bool(at_vertex)] += 1
    usual = ("goes on", "retries", "seats")
    kinds = sorted({ending for _, ending, _ in counts} - {*usual})
    presses = [(str(k), press.name) for k, attempt in enumerate(attempts, start=1) for press in attempt.presses]
    rows = []
    for row, named in enumerate(presses):
        pairs = ((ending, counts[row, ending, False], counts[row, ending, True]) for ending in (*usual, *kinds))
        told = {ending: f"{draws} ({vertices})" for ending, draws, vertices in pairs if draws or vertices}
        fails = "; ".join(f"{told[kind]} {kind}" for kind in kinds if kind in told)
        rows += [(*named, *(told.get(ending, "") for ending in usual), fails)] if told else []
    return rows


def outcome_words(one: TrialOutcome) -> str:
    """How a trial ended, in words."""
    where = f"attempt {one.attempt + 1}, {one.press}"
    return f"seats at attempt {one.attempt + 1}" if one.seated else f"{', '.join(one.reasons)}; {where}"


def failure_rows(evidence: Evidence) -> list[tuple[str, ...]]:
    """Trials that do not seat: name, a button where the scene can show it, attempt, last press, reasons, s and N."""
    failed = [(name, one) for name, one in evidence.by_name.items() if not one.seated]
    failed.sort(key=lambda pair: not pair[1].way)  # those that can be shown before others
    return [
        (
            Markup(f'<button type="button" data-trial="{name}">▶ {name}</button>') if one.way else name,
            *(str(one.attempt + 1), one.press, ", ".join(one.reasons), f"{one.seconds:.1f}", f"{one.peak_force:.1f}"),
        )
        for name, one in failed[:_MAX_LISTED]
    ]


def press_chapters(plan: Plan) -> list[tuple[str, str, str]]:
    """Chapters of the page: evidence, presses, failed draws."""
    presses, evidence = presses_of(plan), plan.trials
    text = ""
    for number, attempt in enumerate(presses.attempts):
        title = f"Attempt {number + 1} ({attempt.source}), from {pose_words(attempt.start)}"
        text += table(title, HEAD, press_rows(attempt))
        if number < len(plan.description.placed):
            text += table(PLACED, ROWS, placed_rows(attempt, plan.description.placed[number]), ".n.n..")
    if words := shown_words(plan):
        text += paragraph(f"The way to the goal is shown {words}.")
    robot = presses.robot
    text += paragraph(
        f"Axes of the frame of the hole, torques about the leading face's centre. Held axes: "
        f"{1e-3 * robot.stiffness[0]:g} N/mm, {robot.stiffness[1]:g} N m/rad; axes that give way: "
        f"{robot.damping[0]:.4g} N s/m, {robot.damping[1]:.3g} N m s/rad; {robot.mass:g} kg. After a failure the part "
        "backs out along its way, is lifted, and the next attempt begins."
    )
    found = paragraph(evidence_words(plan))
    if evidence is not None:
        found += paragraph(f"Drawn from: {conditions_words(evidence)}. Force up to {evidence.peak_force:.1f} N.")
        found += table(OUTCOMES, ENDINGS, outcome_rows(plan, evidence), "n.nnn.")
        failed = len(evidence.by_name) - evidence.seated - evidence.vertices_seated
        head = ("trial", "attempt", "last press", "what speaks against it", "s", "greatest N")
        rows = failure_rows(evidence)
        title = f"Trials that do not seat, {len(rows)} of {failed}; a button shows one in the picture of the motion"
        found += table(title, head, rows, ".n..nn")
    return [("evidence", "Evidence", found), ("presses", "The presses", text)]
