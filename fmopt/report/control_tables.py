"""Tables of control: freedoms and forces over time, hybrid strategies, wrenches that friction cannot balance."""

import math
import re
from itertools import groupby

import numpy as np

from fmopt.plan import Hybrid, JamFree, Plan, Segment
from fmopt.plan.position_force import AXES, stretches
from fmopt.report.moves import moves, turn_of, way_of
from fmopt.report.naming import combination, direction, quantity, signed
from fmopt.report.shell import paragraph, table
from fmopt.report.views.trajectory_view import stops_words
from fmopt.spatial.values import Array

_TURNS = 1e-3  # rad/s, a rate worth a word

# Names of planes are any label of a plan file: more digits, or those of other scripts, are no index.
_AXIS = re.compile(r"(position|force)_axes\[(\d{1,3})\]", re.ASCII)
_WIDE = math.radians(90.0)  # a range beyond that on both sides is not worth a word


def force_table(plan: Plan) -> str:
    """S(t) and Fa(t) by interval."""
    rows = []
    for item in plan.description.position_force:
        either = f"; {', '.join(AXES[axis] for axis in item.either_sign)} of either sign" if item.either_sign else ""
        force = combination(item.fa, "N", "N·m") + either
        rows.append((f"{item.start:.3g} to {item.end:.3g} s", stops_words(item.s), force))
    return table("Freedoms and reaction forces by time", ("time", "S(t)", "Fa(t)"), rows)


def motion_table(plan: Plan) -> str:
    """S, Fa and Pa of the certified motion, move by move, beside S(t) of the nominal trajectory."""
    rows = []
    for stretch in stretches(plan):
        name = "seated" if stretch.move is None else f"move {stretch.move + 1}"  # stretches count from 0, people from 1
        time = f"{stretch.start:.3g} to {stretch.end:.3g} s" if stretch.move is not None else f"{stretch.end:.3g} s"
        force = combination(stretch.fa.tolist(), "N", "N·m")
        rows.append((name, time, stops_words(stretch.s), force, "; ".join(stretch.differences) or "nothing"))
    if not rows:
        return ""
    words = paragraph(
        "An axis is stopped where a contact that the move holds has a part along it, at the goal of the move. The "
        "nominal trajectory goes straight in, and its S(t) says what an uncertain part could touch there; the motion "
        "touches on purpose, tilted."
    )
    head = ("move", "commanded", "S", "Fa", "differs from S(t) of the nominal trajectory")
    return words + table("The motion along the axes", head, rows)


def hybrid_table(plan: Plan) -> str:
    """The control strategy of every piece; pieces of a move that share theirs share a row."""
    rows = []
    for move in moves(plan):
        cells = [hybrid_cells(piece, piece is move.segments[-1], plan.rho) for piece in move.segments]
        for alike, run in groupby(enumerate(cells, start=1), key=lambda item: item[1]):
            first, *more = (number for number, _ in run)
            pieces = f", pieces {first}–{more[-1]}" if more else f", piece {first}"
            rows.append((f"{move.number}{pieces if 1 + len(more) < len(cells) else ''}", *alike))
    head = ("move", "position-controlled", "force-controlled", "velocity", "bias wrench", "end")
    words = (
        "<p>Position axes are twists, force axes wrenches, both in the compliance frame; velocity and wrenches in axes "
        "of B about the moving part's reference point. Turns and torques are counted with ρ. The bias is applied to "
        "the moving part; what ends a move is a reaction on it. Ways in the last column count turns with ρ, too: they "
        "are those of the motion without errors, and beyond what is called a fault something is not as planned.</p>\n"
    )
    return words + _impact_words(plan) + table("Hybrid position/force strategy of every piece", head, rows)


def _impact_words(plan: Plan) -> str:
    """Which moves are slowed so that their contacts are met softly, where the impact is limited."""
    if plan.specification.impact is None:
        return ""
    force, mass, stiffness = plan.specification.impact
    slow = [
        f"move {move.number} to {1e3 * min(speeds):.3g} mm/s"
        for move in moves(plan)
        if (speeds := [piece.hybrid.speed for piece in move.segments if piece.hybrid.impact is not None])
        and min(speeds) < plan.specification.speed * (1.0 - 1e-9)
    ]
    met = max((met[1] for piece in plan.segments if (met := piece.hybrid.impact) is not None), default=0.0)
    done = f"slowed for that: {', '.join(slow)}" if slow else "no move had to be slowed for that"
    return paragraph(
        f"Contacts are to be met with at most {force:.3g} N, by {mass:.3g} kg on {1e-3 * stiffness:.3g} "
        f"N/mm, on top of the push; {done}. With every error they are met with at most {met:.3g} N."
    )


def hybrid_cells(piece: Segment, last: bool, rho: float) -> tuple[str, ...]:
    """The strategy of a piece in words: position axes, force axes, velocity, bias wrench, end."""
    hybrid = piece.hybrid
    # Turns times ρ are lengths, torques by ρ forces: all six numbers compare, and power stays what it is.
    twists, wrenches = (np.repeat([1.0, lever], 3) for lever in (rho, 1 / rho))
    velocity = direction(hybrid.velocity, twists) + f" at {1e3 * hybrid.speed:.3g} mm/s"
    rate = hybrid.speed * float(np.linalg.norm(hybrid.velocity[3:]))  # rad/s: velocity is per metre of way
    velocity += f", turning at {rate:.3g} rad/s" if rate >= _TURNS else ""
    if hybrid.impact is not None:
        velocity += f", a contact met with at most {hybrid.impact[1]:.3g} N"
    return (
        "; ".join(direction(axis, twists) for axis in hybrid.position_axes) or "none",
        "; ".join(direction(axis, wrenches) for axis in hybrid.force_axes) or "none",
        velocity,
        combination(hybrid.bias, "N", "N·m"),
        _end_words(piece, last, twists, wrenches),
    )


def _end_words(piece: Segment, last: bool, twists: Array, wrenches: Array) -> str:
    """When a piece ends without errors, and apart from that beyond what it is a fault."""
    stop = piece.hybrid
    way = quantity(float(np.linalg.norm(np.concatenate([way_of(piece), turn_of(piece)]) * twists)))
    felt = any(stop.wrench)
    if not last:
        return f"goes on after {way}" + ("; a contact felt before ends the move" if felt else "")
    reached = f"{direction(stop.wrench, wrenches)} reaches {signed(stop.threshold, '.3g')} N"
    ends = f"ends when reaction along {reached}, nominally after {way}" if felt else f"ends after {way}"
    return f"{ends}; a fault beyond {quantity(stop.max_travel)} or {stop.timeout:.3g} s"


def jamming_table(plan: Plan) -> str:
    """The worst piece of every move, how many may jam, and what the numbers mean; nothing where none is stated."""
    rows = []
    for move in moves(plan):
        pieces = enumerate((piece.hybrid for piece in move.segments), start=1)
        stated = [(k, hybrid, hybrid.jam_free) for k, hybrid in pieces if hybrid.jam_free is not None]
        if not stated:
            continue
        k, worst, free = min(stated, key=lambda item: _room(item[2]))
        jamming, several = sum(not free.angle > 0.0 for _, _, free in stated), len(stated) > 1
        name = f"{move.number}, piece {k}" if several else str(move.number)
        count = f"{jamming} of {len(stated)} pieces" if jamming and several else "may jam" if jamming else "none"
        rows.append((name, *jamming_cells(worst, free, plan.rho), count))
    head = ("move", "push", "angle in any direction", "narrow ranges", "may jam")
    words = (
        "Friction on the held contacts, of the stated coefficient, cannot balance the wrench that is applied to the "
        "part: it has to move. The angles say how far that wrench may turn from the bias before it could, with torques "
        "counted by ρ; each is proved by a twist in the plan. Where no angle is given, contact forces exist that leave "
        "the part where it is: it may jam there, and a servo has to push harder than the bias does. Shown is the worst "
        "piece of each move."
    )
    said = paragraph(words, f"Of this plan, {jamming_words(plan)}.")
    return said + table("Directions in which the applied wrench cannot jam", head, rows) if rows else ""


def jamming_words(plan: Plan) -> str:
    """Which pieces may jam and what push that takes, and how far the wrenches of the others turn; "" if unstated."""
    ranges = [(move.number, piece.hybrid.jam_free) for move in moves(plan) for piece in move.segments]
    stated = [(number, free) for number, free in ranges if free is not None]
    if not stated:
        return ""
    angles = [item.angle for _, item in stated if item.angle > 0.0]
    words = f"friction cannot balance the bias of {len(angles)} of {len(stated)} pieces that hold contacts"
    words += f", turned by up to {_degrees(min(angles))}" if angles else ""
    jamming = [(number, item) for number, item in stated if not item.angle > 0.0]
    if not jamming:
        return words
    names = [str(number) for number in dict.fromkeys(number for number, _ in jamming)]
    words += f"; the others, of move{'s' if len(names) > 1 else ''} {', '.join(names)}, may jam"
    pairs = [(item.push, item.least_push) for _, item in jamming if item.least_push is not None]
    if pairs:
        push, least = max(pairs, key=lambda pair: pair[1] - pair[0])
        words += f": where most is missing, the push is {push:.2f} N and friction can take {least:.2f} N"
    return words


def jamming_cells(hybrid: Hybrid, free: JamFree, rho: float) -> tuple[str, str, str]:
    """Of a strategy: the push and what it takes, the angle in any direction, and the narrow ranges."""
    least = free.least_push
    takes = "no push is shown to be enough" if least is None else f"friction can take {least:.2f} N"
    push = f"{free.push:.2f} N, {takes}"
    if not free.twists:  # nothing opens all held contacts, so that no push is sure to move the part
        return push, "may wedge", "–"
    if not free.angle > 0.0:
        return push, "may jam", "–"
    near = ((name, away, to) for name, (away, to) in free.planes if min(away, to) < _WIDE)
    narrow = [f"{_degrees(away)} from, {_degrees(to)} to {_towards(hybrid, name, rho)}" for name, away, to in near]
    return push, _degrees(free.angle), "; ".join(narrow) or "none below 90°"


def _towards(hybrid: Hybrid, name: str, rho: float) -> str:
    """What a plane is named after, in words."""
    named = _AXIS.fullmatch(name)
    positions = named is not None and named[1] == "position"
    axes = hybrid.position_axes if positions else hybrid.force_axes
    if named is None or int(named[2]) >= len(axes):
        return name
    return f"{named[1]} axis {direction(axes[int(named[2])], np.repeat([1.0, rho if positions else 1.0 / rho], 3))}"


def _degrees(angle: float) -> str:
    """An angle (rad) in degrees, two digits of it below 10°."""
    degrees = math.degrees(angle)
    return f"{degrees:.2g}°" if degrees < 10.0 else f"{degrees:.0f}°"


def _room(free: JamFree) -> tuple[float, float]:
    """What orders ranges from the worst: those that may jam by how much push is missing."""
    return free.angle, free.push - (math.inf if free.least_push is None else free.least_push)
