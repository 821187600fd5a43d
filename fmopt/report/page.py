"""The report of a plan: one page of HTML that holds everything, opens offline and prints in black and white."""

from collections.abc import Mapping, Sequence
from html import escape

from fmopt.plan import Plan
from fmopt.plan.diagnostics import Planar, PlanarSegment
from fmopt.report import control_tables, sections
from fmopt.report.control_tables import jamming_table
from fmopt.report.figures import catalogue
from fmopt.report.moves import VerdictWords, moves, verdict
from fmopt.report.naming import degrees, quantity
from fmopt.report.presses import press_chapters
from fmopt.report.recovery_tables import recovery_chapter, tolerance_chapter
from fmopt.report.scene import resource, scene
from fmopt.report.shell import chaptered, figure, page, paragraph, table
from fmopt.report.views.budget_view import budget_table
from fmopt.report.views.tube_view import error_table


def report_page(plan: Plan, figures: Mapping[str, str]) -> str:
    """The report: verdict first, then the motion, why it holds, what it tolerates, with its figures (SVG by name).

    The page has no reference to something outside it; everything from the plan is escaped.
    """
    found = verdict(plan)
    # In the order of the catalogue, whatever that of `figures`; nothing is painted for it.
    drawn = {name: drawing for name, drawing in catalogue(plan).items() if name in figures}
    shown = {name: figure(figures[name], d.alt, d.title, d.size) for name, d in drawn.items()}
    title = plan.title or "insertion"
    # A chapter that the plan has nothing for is empty here, and `chaptered` leaves it out.
    own = _press_chapters(plan, shown) if plan.press_plan is not None else _guarded_chapters(plan, shown)
    chapters = [
        ("motion", "The motion", scene(plan) + shown.get("cut", "")),
        *own,
        ("limits", "What was not checked", sections.not_covered(plan)),
        ("asked", "What was asked", sections.asked(plan)),
        ("provenance", "Where this comes from", sections.provenance(plan)),
    ]
    body = chaptered("Insertion plan", title, chapters, f"{_verdict_box(plan, found)}\n")
    return page(f"{title}: {found.word.lower()}", resource("page.css"), body, scripts=True)


def _press_chapters(plan: Plan, shown: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Chapters of presses: what their trials came to, what they do, and the first attempt along the axes."""
    words = paragraph(
        "The first attempt as it goes without errors, from press to press. An axis that gives way counts as stopped "
        "in the direction in which it is pressed, in both without a force; the others are led."
    )
    course = shown.get("trajectory", "") + control_tables.force_table(plan)
    evidence, (name, title, text) = press_chapters(plan)
    placed = (name, title, text + shown.get("depths", ""))
    return [evidence, placed, ("trajectory", "Position and force over time", words + course if course else "")]


def _guarded_chapters(plan: Plan, shown: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Chapters of guarded moves: what they do, why it holds, what it tolerates."""
    drawings = "".join(shown[name] for name in shown if name == "states" or name.startswith("states-"))
    states = sections.why(plan) + drawings + sections.contact_table(plan) + sections.critical_table(plan)
    # Where the start errors come from, what becomes of them on the way, and what they take of the clearance.
    budget = budget_table(plan) + shown.get("budget", "") + error_table(plan) + shown.get("tube", "")
    tables = control_tables.force_table(plan) + control_tables.motion_table(plan)
    course = shown.get("diagrams", "") + shown.get("trajectory", "") + tables
    planar = possible_contacts(plan)
    return [
        ("moves", "The moves", sections.move_table(plan)),
        ("states", "Contact states, and why this sequence", states),
        ("margins", "Margins and what binds them", sections.margin_words_of(plan) + shown.get("margin", "")),
        ("budget", "Uncertainty budget", budget),
        ("plane", "Possible contacts in the plane", planar + shown.get("sets", "") + shown.get("surfaces", "")),
        ("trajectory", "Position and force over time", course),
        ("hybrid", "Hybrid strategies", control_tables.hybrid_table(plan) + jamming_table(plan)),
        ("tolerance", "Tolerated errors and sensitivities", tolerance_chapter(plan)),
        ("recovery", "When a move fails", recovery_chapter(plan)),
    ]


def _verdict_box(plan: Plan, found: VerdictWords) -> str:
    kind = "proved" if found.proved or found.word == "Tested" else "unproved"
    limits = ' Under the assumptions listed in <a href="#limits">what was not checked</a>.' if found.proved else ""
    text = f'<div class="verdict {kind}">\n<p class="word">{escape(found.word)}</p>\n'
    text += f"<p>{escape(found.sentence)}{limits}</p>\n"
    text += "" if plan.press_plan is not None else paragraph(sections.worst_move(plan))
    text += f'<p>{escape(sections.asked_words(plan))} More under <a href="#asked">what was asked</a>.</p>\n'
    return text + "</div>"


def possible_contacts(plan: Plan) -> str:
    """The chapter of a planar plan; nothing for a plan in space."""
    if (found := plan.diagnostics.planar) is None:
        return ""
    words = (
        "The problem is planar, in x and z. Its solids stand for the profiles: the moving one is a ridge that touches "
        "with its profile, at y = 0, alone. A part of a motion is fine where errors allow a contact, else "
        "gross. Contacts are named by the corners (v) "
        "and edges (e) of the two profiles, the moving one first. At the start errors displace the moving part's "
        f"reference point by up to {quantity(found.position)} and turn it by up to {degrees(found.angle)}°."
    )
    return paragraph(words) + _motion(plan, found) + _nominal_table(found) + _carry(found)


def _motion(plan: Plan, found: Planar) -> str:
    """One row per move: how much of it is gross, where it first becomes fine, and which contacts are possible."""
    parts, rows, first = found.segments, [], 0
    for move in moves(plan):
        mine = parts[first : first + len(move.segments)]
        first += len(move.segments)
        contacts = dict.fromkeys(name for part in mine for phase in part.phases for name in phase.contacts)
        gross = sum(sum(p.end - p.start for p in part.phases if p.kind == "gross") for part in mine) / max(len(mine), 1)
        rows.append((str(move.number), f"{100.0 * gross:.3g} %", _becomes(mine), ", ".join(contacts) or "none"))
    head = ("move", "gross", "contacts become possible after", "possible contacts")
    return table("Gross and fine parts of the motion", head, rows, "nn..")


def _becomes(parts: Sequence[PlanarSegment]) -> str:
    """The shares of a move, counted in its pieces, at which a gross part ends."""
    at, before = [], ""  # over all pieces: what was fine before does not become so anew
    for number, part in enumerate(parts):
        for phase in part.phases:
            if phase.kind != "gross" and before in ("", "gross"):
                at.append(f"{100.0 * (number + phase.start) / len(parts):.3g} %")
            before = phase.kind
    return ", ".join(at) or "–"


def _nominal_table(found: Planar) -> str:
    rows = [(f"{p.start:.3f} to {p.end:.3f} s", p.kind, ", ".join(p.contacts) or "none") for p in found.nominal]
    said = found.agreement
    text = (
        f"Both for {said.both:.3f} s, neither for {said.neither:.3f} s, only a contact possible for "
        f"{said.only_possible:.3f} s, only S(t) stopped for {said.only_stopped:.3f} s. {said.words}."
    )
    head = ("time", "kind", "possible contacts")
    return table("The nominal insertion along the axis", head, rows) + paragraph(text)


def _carry(found: Planar) -> str:
    aside = quantity(found.aside)
    if found.height is None:
        return paragraph(f"Carried {aside} to either side the part may meet the fixed one, however high it is lifted.")
    if found.height == 0.0:
        return paragraph(f"Carried {aside} to either side at the height of its start the part meets nothing.")
    lifted = f"it has to be lifted by {quantity(found.height)}"
    return paragraph(f"To be carried {aside} to either side without a contact {lifted}.")
