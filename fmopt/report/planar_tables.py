"""What the planar sets of possible contact say of a plan, as tables: gross and fine parts, and whether S(t) agrees."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from fmopt.plan import Phase, Plan, Planar, PlanarSegment
from fmopt.report.moves import moves
from fmopt.report.naming import degrees, quantity
from fmopt.report.tables import table


def possible_contacts(plan: Plan) -> str:
    """The chapter of a planar plan; nothing for a plan in space."""
    found = None if plan.diagnostics is None else plan.diagnostics.planar
    if found is None:
        return ""
    words = (
        "The problem is planar, in x and z. Its solids stand for the profiles: the moving one is a ridge that touches "
        "with its profile, at y = 0, alone. A part of a motion is fine where errors allow a contact, else "
        "gross. Contacts are named by the corners (v) "
        "and edges (e) of the two profiles, the moving one first. At the start errors displace the moving part's "
        f"reference point by up to {quantity(found.position)} and turn it by up to {degrees(found.angle)}°."
    )
    return f"<p>{escape(words)}</p>\n" + _motion(plan, found) + _nominal(found) + _carry(found)


def _motion(plan: Plan, found: Planar) -> str:
    """One row per move: how much of it is gross, where it first becomes fine, and which contacts are possible."""
    parts, rows, first = found.segments, [], 0
    for move in moves(plan):
        mine = parts[first : first + len(move.segments)]
        first += len(move.segments)
        contacts = dict.fromkeys(name for part in mine for phase in part.phases for name in phase.contacts)
        gross = sum(_share(part.phases, "gross") for part in mine) / max(len(mine), 1)
        rows.append((str(move.number), f"{100.0 * gross:.3g} %", _becomes(mine), ", ".join(contacts) or "none"))
    head = ("move", "gross", "contacts become possible after", "possible contacts")
    return table("Gross and fine parts of the motion", head, rows, "nn..")


def _share(phases: Sequence[Phase], kind: str) -> float:
    return float(sum(phase.end - phase.start for phase in phases if phase.kind == kind))


def _becomes(parts: Sequence[PlanarSegment]) -> str:
    """The shares of a move, counted in its pieces, at which a gross part ends."""
    at, before = [], ""
    for number, part in enumerate(parts):
        for phase in part.phases:
            if phase.kind != "gross" and before in ("", "gross"):
                at.append(f"{100.0 * (number + phase.start) / len(parts):.3g} %")
            before = phase.kind
    return ", ".join(at) or "–"


def _nominal(found: Planar) -> str:
    rows = [
        (f"{phase.start:.3f} to {phase.end:.3f} s", phase.kind, ", ".join(phase.contacts) or "none")
        for phase in found.nominal
    ]
    said = found.agreement
    text = (
        f"Both for {said.both:.3f} s, neither for {said.neither:.3f} s, only a contact possible for "
        f"{said.only_possible:.3f} s, only S(t) stopped for {said.only_stopped:.3f} s. {said.words}."
    )
    head = ("time", "kind", "possible contacts")
    return table("The nominal insertion along the axis", head, rows) + f"<p>{escape(text)}</p>\n"


def _carry(found: Planar) -> str:
    height, aside = found.height, quantity(found.aside)
    if height is None:
        words = f"Carried {aside} to either side the part may meet the fixed one, however high it is lifted."
    elif height == 0.0:
        words = f"Carried {aside} to either side at the height of its start the part meets nothing."
    else:
        words = f"To be carried {aside} to either side without a contact it has to be lifted by {quantity(height)}."
    return f"<p>{escape(words)}</p>\n"
