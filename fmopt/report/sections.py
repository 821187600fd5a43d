"""The chapters of a report as fragments of HTML: what was asked, found and proved, everything escaped."""

import numpy as np

from fmopt.plan import FORMAT, FRAMES, UNITS, Numbers, Plan, StatedPart
from fmopt.plan.position_force import AXES
from fmopt.report.control_tables import jamming_words
from fmopt.report.moves import margin_claim, move_words, moves, states, summary_rows, verdict
from fmopt.report.naming import binding_words, box_words, contact_words, millimetres, pose_words, quantity, signed
from fmopt.report.presses import carried_words, conditions_words, evidence_words, shown_words
from fmopt.report.recovery_tables import rates, recovery_words, tolerated_words
from fmopt.report.shell import bullets, facts, paragraph, table
from fmopt.report.views.tube_view import ends_words


def asked(plan: Plan) -> str:
    """Parts, clearances, start errors, goal."""
    head = ("part", "name", "extent, mm", "faces", "convex pieces")
    text = table("Parts", head, [_part_row(side, part) for side, part in plan.parts.items()], "...nn")
    text += bullets(plan.diagnostics.imported, "Of the parts that came as meshes:")
    text += facts("The task", _task_rows(plan))
    notes = "What the plan leaves out, on which its certificate does not rest:"
    return text + bullets(plan.diagnostics.notes, notes)


def statements(plan: Plan) -> list[tuple[str, str]]:
    """What there is to say of a plan beside its moves or presses, each statement behind what it is about."""
    rows = [("clearance a side", "; ".join(_sides(plan, "measured", "declared")))]
    if plan.press_plan is not None:
        first, *others = plan.press_plan.attempts
        more = f"; {len(others)} further attempts where it fails: {', '.join(one.source for one in others)}"
        rows += [("starts at", pose_words(first.start) + more * bool(others)), (plan.verdict, evidence_words(plan))]
        rows += [("shown", shown_words(plan))]
        if plan.trials is not None:
            force = f"up to {plan.trials.peak_force:.1f} N"
            rows += [("drawn from", conditions_words(plan.trials)), ("force", force)]
    else:
        least = min(plan.segments, key=lambda segment: segment.margin)
        margin = f"margin {1e6 * least.margin:.2f} µm ({binding_words(plan, least.binding)})"
        proved = f"least {margin}, checked independently; {carried_words(plan)}"
        rows += [
            (plan.verdict, proved if plan.verdict == "CERTIFIED" else f"least computed {margin}, not proved"),
            ("way", ends_words(plan)),
            ("friction", jamming_words(plan)),
            ("errors", tolerated_words(plan)),
            ("tolerances", "; ".join(f"{name}: {change}" for name, _, change in rates(plan)[:4])),
            ("failures", " ".join(recovery_words(plan))),
            *(("parts", note) for note in plan.diagnostics.imported),
        ]
    return [(name, words) for name, words in [*rows, ("not covered", "; ".join(plan.not_covered))] if words]


def _sides(plan: Plan, *kinds: str) -> list[str]:
    return [f"{kind} {words}" for kind in kinds if (words := clearance_words(plan, kind))]


def asked_words(plan: Plan) -> str:
    """Parts, clearances and start errors in two sentences."""
    sides = _sides(plan, "declared", "measured")
    words = f"Asked for: {plan.moving.name} into {plan.fixed.name}"
    words += f"; clearance on each side {', '.join(sides)}." if sides else "."
    return f"{words} Start error {box_words(plan.start_box)}."


def clearance_words(plan: Plan, kind: str) -> str:
    """The declared or measured clearance on each side along x and y; where a plan has only the least, that one."""
    value: tuple[float | None, ...] = plan.fixed.declared_clearance or ()
    if kind == "measured":
        if plan.description.diagnostics is None:
            return f"{millimetres(plan.fixed.measured_clearance)} mm where it is least"
        value = plan.description.diagnostics.measured_clearance
    stated = [(v, axis) for v, axis in zip(value, AXES, strict=False) if v]
    return ", ".join(f"{millimetres(v)} mm along {axis}" for v, axis in stated)


def _part_row(side: str, part: StatedPart) -> tuple[str, ...]:
    points, radii = np.array(part.body.vertices, dtype=np.float64), np.zeros((len(part.body.vertices), 1))
    for vertex, radius in part.body.balls:
        radii[vertex] = radius
    extent = " × ".join(millimetres(width) for width in (points + radii).max(axis=0) - (points - radii).min(axis=0))
    return side, part.name, extent, str(len(part.body.faces)), str(len(part.pieces) + len(part.balls))


def _task_rows(plan: Plan) -> list[tuple[str, str]]:
    part, box = plan.fixed, plan.start_box
    rows = [("goal pose", pose_words(plan.goal)), ("nominal start pose", pose_words(start_of(plan)))]
    for kind in ("declared", "measured"):
        if words := clearance_words(plan, kind):
            rows.append((f"{kind} clearance on each side", words))
    rows.append(("start error, half-widths", box_words(box)))
    if max(box[:2]) > (part.measured_clearance or min(part.declared_clearance or (0.0,))):
        rows.append(("what follows", "the start error is larger than the clearance: contacts have to shrink it"))
    if (reduced := plan.diagnostics.reduced) is not None:
        stated = box_words(reduced.stated_start_box)
        rows.append(("start error that the problem states", f"{stated}: the plan is for {reduced.share:.0%} of it"))
        rows.append(("for all of it", reduced.short))
    across, turning = (f"{100.0 * share:.3g} %" for share in plan.velocity_error)
    rows.append(("velocity error", f"{across} in translation, {turning} in rotation"))
    rows.append(("characteristic length ρ", f"{millimetres(plan.rho)} mm"))
    return rows


def start_of(plan: Plan) -> Numbers:
    """The commanded pose (6,) with which the motion begins, m and rad."""
    return plan.segments[0].start if plan.press_plan is None else plan.press_plan.attempts[0].start


def worst_move(plan: Plan) -> str:
    """Where the smallest margin lies, in a sentence."""
    worst = min(moves(plan), key=lambda move: move.margin)
    where = f"It lies in move {worst.number}" if verdict(plan).proved else f"Move {worst.number} is the tightest"
    return f"{where}: {move_words(plan, worst)}. What binds: {binding_words(plan, worst.binding)}."


def move_table(plan: Plan) -> str:
    """One row per move."""
    run = moves(plan)
    (*first, travel, turn, margin, binds), *listed = summary_rows(plan)
    head = (*first, f"{travel}, {turn}", "smallest clearance", "taken of it", margin, binds)
    rows = [
        (*first, f"{travel}, {turn}", quantity(m.clearance), quantity(m.clearance - m.margin), margin, binds)
        for m, (*first, travel, turn, margin, binds) in zip(run, listed, strict=True)
    ]
    worst = min(range(len(run)), key=lambda k: run[k].margin)
    pieces = sum(len(move.segments) for move in run)
    words = f"{len(run)} moves in {pieces} pieces; a move that turns far is checked piece by piece."
    words += " What is taken of a clearance goes to errors and curvature."
    return paragraph(words) + table("Moves, in order", head, rows, "n...nnn", worst) + paragraph(unguarded_words(plan))


def unguarded_words(plan: Plan) -> str:
    """What ends the moves that make no contact, and what is known of the place where they end."""
    run = moves(plan)
    quiet = [str(move.number) for move in run if not move.new]
    if not quiet:
        return ""
    *others, last = quiet
    name = f"Moves {', '.join(others)} and {last} make" if others else f"Move {last} makes"
    words = f"{name} no contact: {'each ends' if others else 'it ends'} after its travel, with nothing to feel. "
    proved = "With every error in the stated set nothing but what is held is touched up to there. "
    unproved = "That nothing but what is held is touched up to there is not proved. "
    words += proved if verdict(plan).proved else unproved
    if not run[-1].new:
        words += f"The last move is one of them: no contact says that the part has arrived. {ends_words(plan)} "
    return words + "A contact felt on such a move means that something is not as planned."


def why(plan: Plan) -> str:
    """What the search says of the sequence."""
    search, chain = plan.description.search, states(plan)
    ends = f"from {chain[0][1]} freedoms to {chain[-1][1]}"
    text = paragraph(f"The motion goes through {len(chain)} contact states, {ends}.")
    if search is None or not search.states_expanded:
        none = "The plan states no search: nothing is said of how this sequence compares with others."
        return text + paragraph(none)
    rows = [
        ("objective", search.objective),
        ("cost of this sequence", signed(search.cost, ".6g")),
        ("lower bound over all sequences", signed(search.lower_bound, ".6g")),
        ("gap", signed(search.gap, ".6g")),
        ("states expanded", str(search.states_expanded)),
    ]
    if search.moves:
        rows.append(("moves, by name", ", ".join(search.moves)))
    by = "" if search.gap <= 1e-9 * abs(search.cost) else f" by more than {signed(search.gap, '.6g')}"
    text += paragraph(f"By the objective of the search, no sequence is cheaper{by}.")
    return text + facts("The search", rows)


def contact_table(plan: Plan) -> str:
    """What the ids of the contacts mean."""
    rows = [(c.id, c.kind, contact_words(plan, c.id)) for c in plan.contacts]
    caption = "Contacts by id (v vertex, e edge, f face, b ball), the moving part's feature first"
    return table(caption, ("id", "kind", "what"), rows)


# All but those confirmed, whose number has a place of its own.
_VERDICTS = {
    "split": "parted by curvature",
    "blocked": "blocked by another contact",
    "out_of_bounds": "beyond a rim",
    "undecided": "undecided",
}


def critical_table(plan: Plan) -> str:
    """The critical points and what was found there."""
    rows = []
    for point in plan.description.critical_points:
        counts, verdicts = sorted(point.states_by_dimension.items(), reverse=True), point.states_by_verdict
        by_dimension = ", ".join(f"{n} of dimension {d}" for d, n in counts if n)
        others = [f"; {n} {_VERDICTS[name]}" for name, n in verdicts.items() if n and name in _VERDICTS]
        sure = f"{verdicts.get('confirmed', 0)}{''.join(others)}"
        rows.append((point.name, pose_words(point.pose), str(len(point.contacts)), by_dimension or "–", sure))
    head = ("critical point", "pose", "primitive contacts", "contact states", "confirmed on the true surfaces")
    caption = "Contact spaces, at the critical points of the nominal trajectory and where contacts are made"
    return table(caption, head, rows, "..n.n")


def margin_words_of(plan: Plan) -> str:
    """What the figure of the margins shows, with the smallest one."""
    worst = min(moves(plan), key=lambda move: move.margin)
    return paragraph(
        "The clearance is that of the nominal motion; the margin is what is left of it when every error in the set, "
        "the curvature of the contact surfaces and the drift of the velocity have taken their part. Smallest: "
        f"{margin_claim(plan, worst.margin)}, in move {worst.number}."
    )


def not_covered(plan: Plan) -> str:
    """What the plan says was not checked."""
    return bullets(plan.not_covered) or paragraph("The plan does not say what was not checked.")


def provenance(plan: Plan) -> str:
    """Versions, digests, units and frames, and how to check again."""
    fits = "fits this plan" if plan.digest_holds else "does not fit this plan"
    rows = [
        ("made by", f"fmopt {plan.version}, plan format {FORMAT}"),
        ("problem", f"{plan.title}, SHA-256 {plan.problem}"),
        ("plan", f"SHA-256 {plan.sha256} ({fits})"),
        ("units", ", ".join(f"{name} in {unit}" for name, unit in sorted(UNITS.items()))),
        *((f"frame: {name}", words) for name, words in sorted(FRAMES.items())),
    ]
    tested = " --evidence tested" if plan.press_plan is not None else ""
    text = f"<p>Anyone can check the plan again without the planner: <code>fmopt verify plan.json{tested}</code>.</p>\n"
    return text + facts("Provenance", rows)
