"""The claim of one piece of motion: every pair of convex pieces apart, every contact inside its facet, with margins."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from fmopt.certificate.assembly import Assembly, contact_forms, made_form, made_scale
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.facet_margin import Bounds, bounds
from fmopt.certificate.form import made_lever
from fmopt.certificate.piece_pairs import FacingPairs, facing
from fmopt.certificate.propagation import Advance, advance
from fmopt.certificate.remainder import AtEnd, Ends, EndsBatch
from fmopt.certificate.segment_linearisation import Piece, Tolerance
from fmopt.certificate.separating_plane import Separation
from fmopt.contact.primitive import PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.runtime.clock import heed
from fmopt.spatial.values import Array

Chooser = Callable[[Assembly, FacingPairs, EndsBatch], Sequence[Sequence[Separation | None]]]
"""Finds separating planes for all pairs over pieces of motion, None where there is none."""

Stepped = tuple[Piece, Advance]
"""A piece of motion and the errors along it, from `stepped`."""


@dataclass(frozen=True, eq=False)
class ContactClaim:
    """A contact of the piece: row N·e − offset at the goal, remainder, and how far it stays inside its facet (m)."""

    contact: PrimitiveContact
    role: str
    normal: Array
    offset: float
    remainder: float
    margin: float


@dataclass(frozen=True, eq=False)
class Claim:
    """A piece of motion with everything that is claimed of it.

    `margin` is the least of all margins, `clearance` the least nominal clearance, `binding` names what is tightest;
    `early` is how far from touching the contact to be made still is when the move starts, None elsewhere.
    """

    piece: Piece
    advance: Advance
    separations: tuple[tuple[int, int, Separation], ...]
    contacts: tuple[ContactClaim, ...]
    margin: float
    clearance: float
    binding: str
    early: float | None = None


def stepped(assembly: Assembly, piece: Piece, errors: ErrorSet, tolerance: Tolerance) -> Advance:
    """Carries the errors through a piece of motion that every execution follows.

    Raises:
        InfeasibleError: the step is impossible, or some executions would not make or give up a contact as it says.
    """
    step = advance(assembly, piece, errors, tolerance)
    # The distance has to fall at every error, all along: else some execution stops short, or never does.
    if piece.made is not None and step.approach is not None and step.approach.least <= 0.0:
        raise InfeasibleError(
            f"some executions could move away from contact {piece.made.id} before they touch: errors may change how "
            f"much nearer it comes by {-step.approach.least * 1e6:.1f} um more than it does",
            -step.approach.least,
        )
    # Growth has to be positive for the same reason, with the sign the other way: what stays in touch is not given up.
    if step.departure <= 0.0:
        raise InfeasibleError(
            f"some executions could stay in touch with {', '.join(c.id for c in piece.left)}, which the move gives up: "
            f"errors may change how much farther away it gets by {-step.departure * 1e6:.1f} um more than it does",
            -step.departure,
        )
    return step


def claimed(
    assembly: Assembly, steps: Sequence[Stepped], tolerance: Tolerance, choose: Chooser, thorough: bool = True
) -> list[Claim]:
    """Certifies what it can of pieces that carried the errors; if `thorough` also how far contacts stay inside facets.

    Raises:
        InfeasibleError: a pair of pieces overlaps nominally.
        OverdueError: there is no time left.
    """
    found: list[Claim] = []
    # Of pieces of motion one after the other under the same contacts the same is asked: at once.
    for _, group in groupby(steps, lambda step: _contacts_of(step[0])):
        heed()
        alike = list(group)
        listed = facing(assembly, alike[0][0])
        course = EndsBatch.of([step.ends for _, step in alike])
        # Contacts say how the margin of a plan comes about; a search that only compares margins of planes leaves them
        # out.
        contacts = _contacts(assembly, alike, course) if thorough else [()] * len(alike)
        chosen = choose(assembly, listed, course)
        for n, ((piece, step), planes, own) in enumerate(zip(alike, chosen, contacts, strict=True)):
            separations, early = _separated(listed, planes), None
            named = [(s.margin, f"pieces {i}/{j}") for i, j, s in separations]
            named += [(c.margin, c.contact.id) for c in own]
            # Only where the move begins: later pieces go on from where the contact was proved to be open.
            if piece.made is not None and piece.progress[0] == 0.0:
                early = _before(assembly, piece, step.ends, course.piece(n), tolerance.rho)
                named.append((early, f"{piece.made.id} too early"))
            # By margin, then by name: of equal ones always the same is said to bind.
            margin, binding = min(named)
            clearance = min(s.clearance for _, _, s in separations)
            found.append(Claim(piece, step, separations, own, margin, clearance, binding, early))
    return found


def _contacts_of(piece: Piece) -> tuple[object, ...]:
    """The contacts that decide what is asked of a piece of motion: those held, made and given up."""
    return piece.held, piece.goal_contacts, piece.made, piece.left, tuple(c.contact for c in piece.basis)


def _separated(listed: FacingPairs, planes: Sequence[Separation | None]) -> tuple[tuple[int, int, Separation], ...]:
    """The planes chosen for all pairs, by the numbers of both pieces."""
    found = []
    for (i, j, _), plane in zip(listed.listed, planes, strict=True):
        if plane is None:
            raise InfeasibleError(f"moving piece {i} and fixed piece {j} are not apart on the nominal path")
        found.append((i, j, plane))
    return tuple(found)


def _contacts(assembly: Assembly, alike: Sequence[Stepped], course: EndsBatch) -> list[tuple[ContactClaim, ...]]:
    """What is claimed of the contacts of pieces of motion that hold the same ones."""
    held, making = alike[0][0].held, alike[0][0].making
    table = bounds(assembly, held, held, _own(assembly, alike[0][0]))
    inside, own = course.over(table.forms).lower, course.over(contact_forms(assembly, held, held))
    found = []
    for n, (piece, _) in enumerate(alike):
        contacts, margins, rows, at = held, table.margins(inside[n]), own, n
        # At the end of the move new contacts hold as well, and facets are those of the goal state.
        if piece.last and making:
            only = course.piece(n)
            contacts, at = (*held, *making), 0
            rows = only.over(contact_forms(assembly, contacts, piece.goal_contacts))
            made = _made(assembly, piece, only)
            margins += made.table.margins(made.lower)
        roles = ("held" if k < len(held) else "made" for k in range(len(contacts)))
        # The row is stated as N·e ≥ offset about the goal, hence the value with its sign turned.
        listed = (contacts, roles, rows.N[1, at], (-rows.f[1, at]).tolist(), rows.rest[at].tolist(), margins)
        found.append(tuple(ContactClaim(*each) for each in zip(*listed, strict=True)))
    return found


@dataclass(frozen=True, eq=False)
class FacetRows:
    """Rows that bound contacts at one end of a piece of motion, and their certified lower bounds (k,) there, m."""

    contacts: tuple[PrimitiveContact, ...]
    end: int
    table: Bounds
    rows: AtEnd
    lower: Array


def facet_rows(assembly: Assembly, claim: Claim) -> Iterator[FacetRows]:
    """What bounds the contacts of a piece of motion at both ends, for placements that want to move them."""
    piece, course = claim.piece, EndsBatch.of((claim.advance.ends,))
    table = bounds(assembly, piece.held, piece.held, _own(assembly, piece))
    rows = course.over(table.forms)
    # Both ends: the bound is the lesser of the two, and a displacement of either pose moves its own.
    for end in (0, 1):
        yield FacetRows(piece.held, end, table, rows.end(end), rows.bounds[end, 0])
    if piece.last and piece.making:
        yield _made(assembly, piece, course)


def _made(assembly: Assembly, piece: Piece, course: EndsBatch) -> FacetRows:
    """What bounds the contacts made at the end of a piece."""
    # Only the goal counts: before it these contacts are not there, and nothing has to bound them.
    table = bounds(assembly, piece.making, piece.goal_contacts, _own(assembly, piece))
    rows = course.ended().over(table.forms)
    return FacetRows(piece.making, 1, table, rows.end(1), rows.bounds[1, 0])


def _own(assembly: Assembly, piece: Piece) -> frozenset[PrimitiveContact]:
    """Where parts are off their form the contacts of the basis, which have to touch themselves."""
    made = () if piece.made is None else (piece.made,)
    return frozenset((*(c.contact for c in piece.basis), *made)) if assembly.form else frozenset()


def _before(assembly: Assembly, piece: Piece, ends: Ends, course: EndsBatch, rho: float) -> float:
    """How far from touching the contact to be made still is when the move starts.

    Where its row measures an angle (see `made_form`), this is the way on an arm of ρ. Parts that are off their form
    touch where that is not yet zero.
    """
    assert piece.made is not None
    forms = made_form(assembly, piece.made, piece.held)
    found = float(course.over(forms).bounds[0, 0, 0])
    if ends.form:
        found += ends.form * ((2.0 if forms.directed[0] else 1.0) - made_lever(assembly, piece, ends))
    return found * made_scale(assembly, piece.made, piece.held, rho)
