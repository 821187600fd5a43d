"""The chain of segments: poses, states, bases and error sets handed from one to the next.

That the pieces of a move fit executions that are longer or shorter than the move.

The execution. The controller follows the commanded pieces of a move one after the other and stops as it touches: the
piece in which it touches is cut short, or the last piece goes on. That of `propagation` measures each execution on its
own way instead, and stretches every piece alike. Let V′ₖ be the twist of piece k per unit of the move's progress, λ_k
by how much more than planned an execution has progressed when, on its own way, piece k ends. What it has done then is
the commanded motion up to s_k + λ_k, where the model has Σ_{j≤k} (s_j − s_{j−1} + λ_j − λ_{j−1}) V′ⱼ. The difference is

    D_k = ∫ V′ ds over [s_k, s_k + λ_k] − Σ_{j≤k} (λ_j − λ_{j−1}) V′ⱼ = Σ_b c_{bk} (V′_{b+1} − V′_b),

    c_{bk} = λ_b + (s_b − s_k − λ_k)⁺ for boundaries b < k,   c_{bk} = (λ_k − (s_b − s_k))⁺ for b ≥ k.

Executions never turn back, s_b + λ_b ≤ s_k + λ_k for b < k, so the bracket of the first is at most (−λ_b)⁺ and
|c_{bk}| ≤ Λ_b = Σ_{j≤b} o_j (s_j − s_{j−1}) for all k, o_j the overtravel bound of piece j. What lies along the
compliant directions C, the same for all pieces, the contacts take up; with Π_k the projector along C at piece k,

    |Π_k D_k| ≤ Σ_b Λ_b |Π_k (V′_{b+1} − V′_b)|

holds for translations, exactly, and for rotations, which compose, to first order. A move whose pieces share one twist
up to the compliance has nothing here. Up to `LEFT_ASIDE` of it is allowed to a move, and not added to the errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from fmopt.verify.arithmetic.rational import (
    ONE,
    SLACK,
    Matrix,
    Row,
    Square,
    Vector,
    add,
    fixed,
    length,
    number,
    over,
    times,
    vector,
)
from fmopt.verify.certificate.contact_implications import CheckedFacts
from fmopt.verify.certificate.error_set import ErrorShape, image, row_of, start_errors
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.findings import ALLOWANCE, LEFT_ASIDE, Notes, micrometres
from fmopt.verify.parts.assembly import PartPair, Passage, Touch
from fmopt.verify.parts.incidence import LARGEST_ERROR
from fmopt.verify.parts.rows import pose
from fmopt.verify.parts.solids import Plane
from fmopt.verify.reading.document import Segment, StatedPlan

Basis = tuple[tuple[Touch, Row], ...]
_DIRECTION_FLOOR = 1e-11  # stated directions differ from derived ones by the rounding of doubles


class Broken(ValueError):
    """The chain cannot be followed beyond a segment."""


@dataclass(frozen=True)
class SegmentLink:
    """What a segment hands on."""

    errors: ErrorShape
    thick_along: tuple[Row, ...]  # directions in whose span its thickness generators lie
    basis: Basis
    facts: CheckedFacts | None


@dataclass(frozen=True)
class Stage:
    """A segment with everything that its claims are derived from.

    `coming_off` has the planes and body points that the contacts given up had put there, and those held do not; `late`
    is how much longer or shorter the way of its move may be up to its end, in the metric of ρ.
    """

    segment: Segment
    motion: Motion
    facts: CheckedFacts
    state: tuple[Touch, ...]
    goal_state: tuple[Touch, ...]
    made: Touch | None
    leaving: tuple[Touch, ...]
    coming_off: tuple[tuple[Plane, Vector], ...]
    late: int


class Chain:
    """Follows a plan segment by segment."""

    def __init__(self, plan: StatedPlan, assembly: PartPair) -> None:
        self.plan = plan
        self.assembly = assembly
        self.link = SegmentLink(start_errors(plan), (), (), None)
        self.previous: Segment | None = None
        self._legs: list[CheckedLeg] = []
        self._late = 0
        self._facts: dict[tuple[int, tuple[str, ...]], CheckedFacts] = {}

    def follow(self, segment: Segment, notes: Notes) -> Stage:
        """Derives a segment from the one before it.

        Raises:
            Broken: the segment does not fit to the one before it.
            ArithmeticRefusal: see `Motion`.
        """
        self._connect(segment)
        before = self.previous
        state, goal_state = self._touches(segment.state), self._touches(segment.goal_state)
        leaving = self._leaving(segment, state)
        held, made = self._basis(segment, notes)
        start, goal = pose(segment.start), pose(segment.goal)
        basis_facts = self._known(segment.move, [t for t, _ in held], start.R)
        # The basis is what errors are projected along; whatever else a state claims to hold has to follow from it.
        for touch in state:
            if not basis_facts.implies(touch):
                raise Broken(f"holds {touch.id}, which its basis does not imply")
        facts = self._known(segment.move, state, start.R)
        if before is not None:
            # Within a move its goal state is still ahead; the next one begins with all of that.
            earlier = set(before.goal_state if before.move != segment.move else before.state)
            self._nothing_lost(earlier - set(segment.leaving), state, start.R)
        if set(segment.state) - set(segment.goal_state):
            raise Broken("its goal state must hold all that its state holds")
        # Old thickness lies along directions of its own: it is measured anew where all of them still give way.
        errors = self._without_thickness(held)
        s0, s1 = (fixed(s) for s in segment.progress)
        task = Passage(
            start,
            goal,
            held,
            made,
            state,
            goal_state,
            # The share of what is left of the move: pieces of a move stretch alike, by how much is decided at its end.
            ONE if s1 == ONE else over(s1 - s0, ONE - s0),
            fixed(segment.tube.theta) + ALLOWANCE,
            add(vector(segment.tube.angles), (ALLOWANCE, ALLOWANCE, ALLOWANCE)),
            add(vector(segment.tube.box), (ALLOWANCE, ALLOWANCE, ALLOWANCE)),
            (fixed(self.plan.velocity_error[0]), fixed(self.plan.velocity_error[1])),
            fixed(self.plan.rho),
        )
        # The wall leaves an edge two directions, the nominal one being right only while errors cannot reach the other.
        if task.theta >= LARGEST_ERROR and any(turn.level for turn in (*basis_facts.turns, *facts.turns)):
            raise Broken("may turn so far that an edge in a wall is not known by its nominal direction")
        motion = Motion(self.assembly, task, errors)
        if made is not None and motion.made_direction is not None:
            notes.equal(f"direction of {made.id}", segment.basis[-1][1], motion.made_direction, _DIRECTION_FLOOR)
        self._fit(motion, s1 - s0, notes)
        self._late = times(motion.overtravel, motion.length) + (self._late if s0 > 0 else 0)
        self._hand_on(segment, task, motion, goal_state)
        flat = self._coming_off(segment.move, state, leaving, start.R)
        return Stage(segment, motion, facts, state, goal_state, made, leaving, flat, self._late)

    def finish(self, notes: Notes) -> None:
        """Checks the end of the plan."""
        last = self.previous
        if last is None or last.progress[1] != 1.0:
            notes.add("last segment", "does not end its move")
        # Poses of a plan are rounded when they are written, no more than this.
        if last is not None and any(abs(a - b) > 1e-12 for a, b in zip(last.goal, self.plan.goal, strict=True)):
            notes.add("goal", "the last segment does not end at the stated goal")

    def _touches(self, ids: Sequence[str]) -> tuple[Touch, ...]:
        missing = [i for i in ids if i not in self.assembly.touches]
        if missing:
            raise Broken(f"uses contact {missing[0]}, which is not sound")
        return tuple(self.assembly.touches[i] for i in ids)

    def _connect(self, segment: Segment) -> None:
        before = self.previous
        if before is None:
            if segment.state or segment.move != 0 or segment.progress[0] != 0.0:
                raise Broken("the plan must start with move 0 at progress 0, without contacts")
            return
        # To the last bit: it is one pose, written twice.
        if before.goal != segment.start:
            raise Broken("does not start where the segment before it ends")
        if segment.move == before.move:
            if _aim(segment) != _aim(before):
                raise Broken("what the move is to make or give up changes within it")
            if segment.progress[0] != before.progress[1]:
                raise Broken("progress does not continue")
        elif segment.move != before.move + 1 or before.progress[1] != 1.0 or segment.progress[0] != 0.0:
            raise Broken("moves must follow each other, each from progress 0 to 1")

    def _basis(self, segment: Segment, notes: Notes) -> tuple[Basis, Touch | None]:
        made = None
        entries = list(segment.basis)
        if any(flag for _, _, flag in entries[:-1]):
            raise Broken("only the last entry of the basis can be the contact being made")
        if entries and entries[-1][2]:
            made = self._touches([entries.pop()[0]])[0]
            if made.id in segment.state or made.id not in segment.goal_state:
                raise Broken(f"makes {made.id}, which must be in its goal state and not in its state")
        elif set(segment.goal_state) - set(segment.state):
            raise Broken("its goal state has contacts that nothing makes")
        available = list(self.link.basis)
        held = []
        for name, direction, _ in entries:
            touch = self._touches([name])[0]
            found = self._matching(touch, direction, available)
            if found is None:
                raise Broken(f"its basis holds {name} along a direction that no earlier move left")
            # Entries keep their order: what is passed over was given up.
            del available[: found + 1]
            held.append((touch, self.link.basis[len(self.link.basis) - len(available) - 1][1]))
        if len({t.id for t, _ in held}) != len(held) or any(t.id not in segment.state for t, _ in held):
            raise Broken("its basis repeats a contact, or holds one that is not in its state")
        for (name, direction, _), (_, derived) in zip(entries, held, strict=True):
            notes.equal(f"direction of {name}", direction, derived, _DIRECTION_FLOOR)
        return tuple(held), made

    def _matching(self, touch: Touch, direction: Sequence[float], available: Sequence[tuple[Touch, Row]]) -> int | None:
        """The earlier basis entry with this direction that the contact continues or may replace."""
        for k, (known, derived) in enumerate(available):
            # So near it is the entry meant; whether it is near enough is judged when all are found.
            close = all(abs(fixed(x) - y) <= fixed(1e-8) for x, y in zip(direction, derived, strict=True))
            # Another contact may take the place of one that it follows from: the direction stays, the name changes.
            if close and (known.id == touch.id or (self.link.facts is not None and self.link.facts.implies(touch))):
                return k
        return None

    def _leaving(self, segment: Segment, state: Sequence[Touch]) -> tuple[Touch, ...]:
        """The contacts that the move gives up: held up to its start, and known by a distance of their own."""
        before = self.previous
        found = self._touches(segment.leaving)
        for touch in found:
            if before is None or touch.id in segment.state or touch.id in segment.goal_state:
                raise Broken(f"gives up {touch.id}, which must have been held before and not be held on its way")
            earlier = before.leaving if before.move == segment.move else before.goal_state
            if touch.id not in earlier:
                raise Broken(f"gives up {touch.id}, which was not held when the move started")
            # A hinged contact has no distance of its own that could be shown to grow.
            if self.assembly.hinge(touch, state) is not None or self.assembly.level(touch, state) is not None:
                raise Broken(f"gives up {touch.id} without the contacts that it turns about")
        return found

    def _coming_off(
        self, move: int, state: Sequence[Touch], leaving: Sequence[Touch], R: Matrix
    ) -> tuple[tuple[Plane, Vector], ...]:
        """Fixed planes with the body points that contacts given up put there, and that those held do not keep there."""
        if not leaving:
            return ()
        kept = self._known(move, state, R)
        return tuple(
            (wall.plane, v)
            for wall in self._known(move, leaving, R).walls
            for v in wall.points
            if v not in kept.on(wall.plane).points
        )

    def _nothing_lost(self, before: set[str], after: Sequence[Touch], R: Matrix) -> None:
        """Contacts may only be left out of a state when the others imply them, or the move gives them up."""
        lost = before - {t.id for t in after}
        if lost:
            facts = CheckedFacts(self.assembly, after, R)
            for name in sorted(lost):
                if not facts.implies(self.assembly.touches[name]):
                    raise Broken(f"loses {name}, which the other contacts do not imply")

    def _known(self, move: int, held: Sequence[Touch], R: Matrix) -> CheckedFacts:
        key = move, tuple(t.id for t in held)
        return self._facts.get(key) or self._facts.setdefault(key, CheckedFacts(self.assembly, held, R))

    def _without_thickness(self, held: Basis) -> ErrorShape:
        """The start set; its old thickness is dropped when every direction that it lies along still gives way."""
        errors = self.link.errors
        directions = [c for _, c in held]
        # Nothing to give up where no direction has thickness.
        if all(c in directions for c in self.link.thick_along):
            return errors
        return ErrorShape(errors.core + errors.thick, (), errors.slide, errors.swing, errors.shape, errors.linkage)

    def _fit(self, motion: Motion, progress: int, notes: Notes) -> None:
        """Collects the pieces of a move that makes a contact; at its end they must fit together."""
        # Without a contact to make executions go as far as commanded.
        if motion.task.made is None:
            return
        self._legs.append(CheckedLeg(motion.twist, progress, motion.overtravel, motion.directions, motion.hold))
        if motion.task.last:
            check_fit(self._legs, notes)
            self._legs = []

    def _hand_on(self, segment: Segment, task: Passage, motion: Motion, goal_state: Sequence[Touch]) -> None:
        along = motion.directions
        basis: Basis = task.held
        after = task.state
        if task.last:
            if task.made is not None and motion.made_direction is not None:
                along = (*along, motion.made_direction)
                basis = (*basis, (task.made, motion.made_direction))
            reached = self._known(segment.move, [t for t, _ in basis], task.goal.R)
            for touch in goal_state:
                if not reached.implies(touch):
                    raise Broken(f"its goal state has {touch.id}, which its basis does not imply")
            after = tuple(goal_state)
        held = [t for t, _ in basis]
        held += [t for t in after if all(t.id != s.id for s in held)]
        self.link = SegmentLink(motion.goal_errors, along, basis, self._known(segment.move, held, task.goal.R))
        self.previous = segment


def _aim(segment: Segment) -> tuple[list[str], list[str], tuple[str, ...]]:
    """What a segment's move is to make, the contact of the basis and all that come with it, and to give up."""
    made, new = [b[0] for b in segment.basis if b[2]], [i for i in segment.goal_state if i not in segment.state]
    return made, new, segment.leaving


@dataclass(frozen=True)
class CheckedLeg:
    """A piece of a move, as far as the fit of the pieces is concerned."""

    twist: Row  # V = (Δ, ω)
    progress: int
    overtravel: int  # bound of how much longer or shorter than V an execution's piece can be, as a share of V
    directions: tuple[Row, ...]  # C, along which contacts give way
    hold: Square  # projector along C


def misfit(legs: Sequence[CheckedLeg]) -> tuple[int, int]:
    """Bounds of translation (m) and rotation (rad) by which executions can differ from a move's stretched pieces."""
    rates = [row_of(over(x, leg.progress) for x in leg.twist) for leg in legs]
    # Where pieces join, an execution that is late still moves at the old rate while the claim has it at the new one.
    jumps = [row_of(y - x for x, y in zip(a, b, strict=True)) for a, b in pairwise(rates)]
    lags: list[int] = []
    for leg in legs[:-1]:
        lags.append((lags[-1] if lags else 0) + times(leg.overtravel, leg.progress) + 1)
    translation = rotation = 0
    for leg in legs:
        felt = [image(leg.hold, jump) for jump in jumps]
        translation = max(translation, sum(times(lag, length(f[:3])) for lag, f in zip(lags, felt, strict=True)))
        rotation = max(rotation, sum(times(lag, length(f[3:])) for lag, f in zip(lags, felt, strict=True)))
    return translation + SLACK, rotation + SLACK


def check_fit(legs: Sequence[CheckedLeg], notes: Notes) -> None:
    """Notes when a move that makes a contact relies on its pieces, which come in order, being stretched alike."""
    if any(leg.directions != legs[0].directions for leg in legs):
        notes.add("pieces of the move", "do not give way along the same directions")
        return
    translation, rotation = misfit(legs)
    if translation > fixed(LEFT_ASIDE[0]) or rotation > fixed(LEFT_ASIDE[1]):
        notes.add(
            "pieces of the move",
            "do not share one twist: an execution that touches late would leave its error set by "
            f"{micrometres(number(translation))} / {number(rotation) * 1e6:.9g} µrad",
            number(translation),
        )
