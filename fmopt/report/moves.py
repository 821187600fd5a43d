"""A plan read as moves: the pieces of a motion that belong together, their numbers, and what they do in words."""

import math
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from fmopt.errors import ChoiceError
from fmopt.plan import Numbers, Plan, Segment
from fmopt.report.naming import binding_words, contact_words, quantity, spoken_axis, touched_words
from fmopt.report.presses import carried_words, evidence_words
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array


@dataclass(frozen=True)
class VerdictWords:
    """What may be said of a plan: whether it is proved, the one word for it, and a sentence.

    A plan whose digest does not fit its content, or with a margin that is not positive, is not proved, whatever it says
    of itself.
    """

    proved: bool
    word: str
    sentence: str


@dataclass(frozen=True)
class MoveWords:
    """A move of a plan, numbered from 1, with travel, m, turn, rad, and the smallest clearance and margin, m.

    `made` is the id of the contact that ends it, None for a move that makes none.
    """

    number: int
    segments: tuple[Segment, ...]
    state: tuple[str, ...]
    goal_state: tuple[str, ...]
    left: tuple[str, ...]
    made: str | None
    travel: float
    turn: float
    clearance: float
    margin: float
    binding: str

    @property
    def new(self) -> tuple[str, ...]:
        """Contacts held after the move and not before, the one that ends it first."""
        new = [contact for contact in self.goal_state if contact not in self.state]
        return tuple(sorted(new, key=lambda contact: contact != self.made))


def moves(plan: Plan) -> tuple[MoveWords, ...]:
    """The moves of a plan, in order."""
    runs = [tuple(run) for _, run in groupby(plan.segments, key=lambda piece: piece.move)]
    return tuple(_move(number, run) for number, run in enumerate(runs, start=1))


def _move(number: int, run: tuple[Segment, ...]) -> MoveWords:
    worst = min(run, key=lambda piece: piece.margin)
    made = [contact for contact, _, is_made in run[-1].basis if is_made]
    state, goal = run[0].state, run[-1].goal_state
    new = [contact for contact in goal if contact not in state]
    return MoveWords(
        number=number,
        segments=run,
        state=state,
        goal_state=goal,
        left=run[0].leaving,
        made=next(iter(made or new), None),
        travel=sum(float(np.linalg.norm(way_of(piece))) for piece in run),
        turn=sum(float(np.linalg.norm(turn_of(piece))) for piece in run),
        clearance=min(piece.clearance for piece in run),
        margin=worst.margin,
        binding=worst.binding,
    )


def way_of(piece: Segment) -> Array:
    """Way (3,) of the reference point along a piece, m."""
    return np.asarray(piece.goal[:3], dtype=np.float64) - np.asarray(piece.start[:3], dtype=np.float64)


def turn_of(piece: Segment) -> Array:
    """Rotation vector (3,) in rad, axes of B, that turns a piece's start into its goal."""
    return turn_between(piece.start, piece.goal)


def turn_between(start: Numbers, goal: Numbers) -> Array:
    """Rotation vector (3,) in rad, axes of B, that turns one pose (6,) into another."""
    return Pose.from_vector(start).local(Pose.from_vector(goal))[3:]


def smallest_margin(plan: Plan) -> float:
    """The smallest margin of all pieces, m.

    Raises:
        ChoiceError: the plan has presses, of which nothing is proved.
    """
    if plan.press_plan is not None:
        raise ChoiceError("a plan of presses has no margin: nothing is proved of it", "read its evidence instead")
    return min(piece.margin for piece in plan.segments)


def verdict(plan: Plan) -> VerdictWords:
    """The verdict in words; proved only where the plan says CERTIFIED, is intact and its margins are positive."""
    # First of all: what a changed plan says of itself counts for nothing.
    if not plan.digest_holds:
        return VerdictWords(False, "Not proved", "The plan was changed after it was sealed: its digest does not fit.")
    if plan.press_plan is not None:
        word = "Tested" if plan.verdict == "TESTED" else "Not tested enough"
        return VerdictWords(False, word, f"{evidence_words(plan)} Nothing is proved of presses.")
    margin = smallest_margin(plan)
    if plan.verdict == "CERTIFIED" and margin > 0.0:
        words = (
            "Every motion whose errors lie in the stated set makes the planned contacts in the planned order and ends "
            f"in the goal pose. Smallest certified margin: {quantity(margin)}. Trials: {carried_words(plan)}."
        )
        return VerdictWords(True, "Certified", words)
    short = f"Smallest computed margin, not proved: {quantity(margin)}."
    short = short if margin > 0.0 else f"Largest shortfall: {quantity(-margin)}."
    if plan.verdict == "REFUTED":
        words = "The independent check found a pose within the stated errors at which the plan fails."
        return VerdictWords(False, "Refuted", f"{words} {short}")
    words = "The proof could not be closed: the motion may work, but nothing below is a guarantee."
    return VerdictWords(False, "Not proved", f"{words} {short}")


def margin_name(plan: Plan) -> str:
    """What the margins of a plan may be called."""
    return "certified margin" if verdict(plan).proved else "computed margin, not proved"


def margin_words(margin: float) -> str:
    """A margin with its unit; a negative one is called a shortfall."""
    return quantity(margin) if margin > 0.0 else f"shortfall {quantity(-margin)}"


def margin_claim(plan: Plan, margin: float) -> str:
    """A margin and what it may be called, in one phrase."""
    if margin <= 0.0:
        return margin_words(margin)
    between = " " if verdict(plan).proved else ": "
    return f"{margin_name(plan)}{between}{quantity(margin)}"


def move_words(plan: Plan, move: MoveWords) -> str:
    """What a move does: "slide 1.15 mm in −x until …", "move freely 2 mm in +x away from …"."""
    words = _motion_words(plan, move)
    if move.left:
        left = dict.fromkeys(touched_words(plan, contact) for contact in move.left)
        words += f" away from {', '.join(left)}"
    if move.made is not None:
        words += f" until {contact_words(plan, move.made)}"
    others = [contact for contact in move.new if contact != move.made]
    if others:
        words += f" (with it {', '.join(others)})"
    return words


def _motion_words(plan: Plan, move: MoveWords) -> str:
    start, goal = (Pose.from_vector(pose) for pose in (move.segments[0].start, move.segments[-1].goal))
    step = start.local(goal)
    way, angle = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
    verb = "slide" if move.state else "move freely"
    # What two digits would show as nothing is no part of the motion.
    turned = f"{math.degrees(angle):.2f}° about {spoken_axis(step[3:])}" if math.degrees(angle) >= 0.01 else ""
    gone = f"{1e3 * way:.2f} mm in {spoken_axis(step[:3], always_signed=True)}" if way >= 1e-5 else ""
    if plan.rho * angle > way and turned:
        return f"turn {turned}" + (f", going {gone}" if gone else "")
    return f"{verb} {gone}" + (f", turning {turned}" if turned else "") if gone else "stay"


def summary_rows(plan: Plan) -> list[tuple[str, ...]]:
    """Rows for the terminal, the first with the heads: number, what it does, held, travel, turn, margin, what binds."""
    head: tuple[str, ...] = ("move", "what it does", "held", "travel", "turn", margin_name(plan), "what binds")
    rows = [head]
    for move in moves(plan):
        held, (way, turn) = ", ".join(move.state) or "none", (1e3 * move.travel, math.degrees(move.turn))
        said = margin_words(move.margin), binding_words(plan, move.binding)
        rows.append((str(move.number), move_words(plan, move), held, f"{way:.2f} mm", f"{turn:.2f}°", *said))
    return rows


def states(plan: Plan) -> list[tuple[tuple[str, ...], int]]:
    """The contact states along the motion, first to last, each with its dimension 6 − rank."""
    chain: list[tuple[tuple[str, ...], int]] = []
    for move in moves(plan):
        begin = (move.state, 6 - _rank(move.segments[0], held_only=True))
        if not chain:
            chain.append(begin)
        # Giving contacts up changes the state before anything moves: a link of the chain of its own.
        if move.left:
            chain.append(begin)
        if move.goal_state != move.state:
            chain.append((move.goal_state, 6 - _rank(move.segments[-1], held_only=False)))
    return chain


def _rank(piece: Segment, held_only: bool) -> int:
    # Contacts of a basis are independent, so that their number is the rank.
    return sum(not (held_only and made) for _, _, made in piece.basis)
