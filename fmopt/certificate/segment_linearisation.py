"""The linear picture of a piece of motion: the twist inside the held contacts, and how it projects the errors.

Pieces of a move, the compliance with which contacts are held along them, and the tolerances of the problem.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_forms, hinge, level, made_form
from fmopt.certificate.contact_implications import coming_off
from fmopt.certificate.error_set import Linkage
from fmopt.certificate.remainder import Curvature, Extent
from fmopt.certificate.rows import Forms, Rows, points_above
from fmopt.certificate.tube import ThicknessLayers
from fmopt.contact.primitive import PrimitiveContact
from fmopt.errors import InfeasibleError
from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import Pose, length, lengths
from fmopt.spatial.values import Array, remembered

LARGEST_TURN = 0.5  # rad; the bounds of the certificate hold for pieces that turn no farther
_STANDSTILL = 1e-12  # m
_RECEDING = 1e-9  # m
_MEMORY = 512


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The linear picture of a piece; letters are those of `segment`."""

    twist: Array  # V (6,) from S to G
    turn: float
    length: float
    directions: Array  # compliant twists C_h of the held basis (h, 6)
    held: tuple[Rows, Rows]
    made: tuple[Rows, Rows] | None  # row of the contact being made, by the contacts held, at both ends; None without
    start_dual: Array  # T^S (6, h), dual to the held rows at the start
    goal_dual: Array  # T^h (6, h), dual to the held rows at the goal
    hold: Array  # Π_h = I − T^h N_h (6, 6)
    motion: Array  # v = Π_h V (6,), the motion inside the held contacts
    rate: float  # −N_m·v, how much nearer the contact being made comes, m
    seen: Array  # N′ = Π_hᵀ N_m (6,)
    projector: Array  # Π = Π_h + φ v N′ᵀ/rate (6, 6)
    rho: float  # characteristic length ρ, m

    @property
    def travel(self) -> Array:
        """Translation (3,) from S to G, m."""
        return self.twist[:3]

    @cached_property
    def direction(self) -> Array:
        """v per unit of its length in the metric of ρ (6,), so that directions of slides and of turns are alike."""
        return np.asarray(self.motion / length(self.motion * ellipsoid.metric(self.rho)))

    @cached_property
    def held_curvature(self) -> Curvature:
        """Of the held rows."""
        return Curvature.of(*self.held, self.twist)

    @cached_property
    def joined_curvature(self) -> Curvature:
        """Of the held rows, and of the one of the contact being made."""
        assert self.made is not None
        return Curvature.joined(self.held_curvature, Curvature.of(*self.made, self.twist))

    @cached_property
    def on_the_way(self) -> ThicknessLayers:
        """The thickness of contact surfaces on pieces that do not end the move."""
        first, second = self.held
        none = np.zeros(len(first.f))
        return self._layers(self.held_curvature, np.abs(second.f), np.zeros(2), self.goal_dual, none)

    @cached_property
    def closing(self) -> ThicknessLayers:
        """The same where the contact being made is."""
        assert self.made is not None
        (_, second), end = self.held, self.made[1]
        # The contact being made is held at the end, too: the motion itself is the direction that gives way to it.
        C = np.vstack([self.directions, self.direction]).T
        inverse = ellipsoid.coupling_inverse(np.vstack([second.N, end.N]), C)
        # What a velocity error moves the row by beyond what the held contacts take up.
        left = end.N[0] @ self.projector
        residue = np.array([length(left[:3]), length(left[3:])])
        off, shares = np.abs(np.append(second.f, end.f)), np.append(-end.N[0] @ self.goal_dual, 1.0)
        return self._layers(self.joined_curvature, off, residue, C @ inverse, shares)

    def _layers(
        self, curvature: Curvature, off: Array, residue: Array, goal_dual: Array, shares: Array
    ) -> ThicknessLayers:
        start, form = self.held[0], np.zeros(len(off))
        return ThicknessLayers(
            curvature.bending, start.f, start.N, off, residue, self.start_dual, goal_dual, shares, form
        )


def linearisation_of(assembly: Assembly, piece: Piece, tolerance: Tolerance) -> Linearisation:
    """The linear picture of a piece.

    Raises:
        InfeasibleError: the piece turns too far or goes nowhere, contacts do not determine their compliant
            directions, or the motion does not lead to the contact that it is to make.
    """
    # As bytes, which can be a key of what is remembered: arrays cannot.
    twists = np.array([c.direction for c in piece.basis]).tobytes()
    basis = tuple(c.contact for c in piece.basis), twists
    made = None if piece.made is None else (piece.made, piece.share)
    return _way(assembly, (piece.start, piece.goal), piece.held, basis, made, tolerance.rho)


@remembered(_MEMORY)
def _way(
    assembly: Assembly,
    ends: tuple[Pose, Pose],
    held_all: tuple[PrimitiveContact, ...],
    basis: tuple[tuple[PrimitiveContact, ...], bytes],
    making: tuple[PrimitiveContact, float] | None,
    rho: float,
) -> Linearisation:
    """See `linearisation_of`: no error enters it, so that a motion certified under other errors has the same.

    The contact being made comes with the share φ of what is left of its move.
    """
    (start, goal), (contacts, twists) = ends, basis
    V = start.local(goal)
    turn, far = length(V[3:]), length(V * ellipsoid.metric(rho))
    if turn > LARGEST_TURN or far <= _STANDSTILL:
        raise InfeasibleError(f"a piece of motion turns by {turn:.3g} rad, goes {far:.3g} m", advice="split the move")
    C = np.frombuffer(twists).reshape(-1, 6)
    held = contact_forms(assembly, contacts, held_all).over(start, goal)
    duals = [C.T @ ellipsoid.coupling_inverse(rows.N, C.T) if len(C) else np.zeros((6, 0)) for rows in held]
    # Held at the goal, where the piece ends: errors are projected along the compliant twists onto what is held there.
    hold = np.eye(6) - duals[1] @ held[1].N
    v = hold @ V
    if making is None:
        return Linearisation(V, turn, far, C, held, None, duals[0], duals[1], hold, v, 0.0, np.zeros(6), hold, rho)
    contact, share = making
    made = made_form(assembly, contact, held_all).over(start, goal)
    N = made[1].N[0]
    rate, seen = -float(N @ v), N @ hold
    # The row has to fall along the motion, by more than rounding, or no error says how far to go on.
    if rate <= _RECEDING:
        raise InfeasibleError(f"the move does not lead to contact {contact.id}")
    # Who is too far from the contact by an error goes on for longer, along the motion: that is what the projector adds.
    projector = hold + np.outer(share / rate * v, seen)
    return Linearisation(V, turn, far, C, held, made, duals[0], duals[1], hold, v, rate, seen, projector, rho)


def cone(tolerance: Tolerance, way: Linearisation, N: Array) -> float:
    """How far the velocity error can move a row along the piece, m, by its gradient N (6,), m and m/rad."""
    t, r = tolerance.velocity_error[0], tolerance.velocity_error[1] / tolerance.rho
    # Translation and angle of the error add up at worst.
    return (t * length(N[:3]) + r * length(N[3:])) * way.length


@dataclass(frozen=True, eq=False)
class Growth:
    """How much a row grows along a piece, whatever the error."""

    row: Array  # its gradient inside the held contacts (6,)
    nominal: float  # how much it grows where there are no errors, m
    lost: float  # what errors may take of that, m
    turned: Array = field(default_factory=lambda: np.zeros(6))  # how that changes with the pose (6,), as rows turn

    @property
    def least(self) -> float:
        """How much the row grows at least, m."""
        return self.nominal - self.lost


def approach(tolerance: Tolerance, way: Linearisation, extent: Extent, linkage: Linkage | None) -> Growth | None:
    """How much nearer the contact being made comes along a piece, at every error in the bounds; None without one.

    An execution stops when it first touches: that needs the distance to fall all along.
    """
    if way.made is None:
        return None
    grows, turned, lost = _growing(tolerance, way, extent, linkage, way.made, way.joined_curvature)
    return Growth(-way.seen, -float(grows.max()), lost, -turned)


def departures(
    assembly: Assembly, piece: Piece, tolerance: Tolerance, way: Linearisation, extent: Extent, linkage: Linkage | None
) -> list[Growth]:
    """How much farther away each contact given up gets along a piece, at every error in the bounds.

    They are touched when the move starts: where their distances rise all along, none of them is touched again. So are
    the other points of an edge or face that lies flat with them, and are no contacts as there is nothing below them.

    Raises:
        InfeasibleError: a contact given up meets another one of its edge or face that stays held.
    """
    forms = list[Forms]()
    for contact in piece.left:
        # What it turns about stays held, so that its row is another one than that of a contact alone.
        if hinge(assembly, contact, piece.held) is not None or level(assembly, contact, piece.held) is not None:
            raise InfeasibleError(f"contact {contact.id} cannot be given up without those that it turns about")
        forms.append(contact_forms(assembly, (contact,), ()))
    for wall in coming_off(assembly, piece.held, piece.left):
        forms += [points_above(assembly.body_points[[i]], wall.normal, wall.offset) for i in sorted(wall.points)]
    found = list[Growth]()
    for form in forms:
        rows = form.over(piece.start, piece.goal)
        bends = Curvature.joined(way.held_curvature, Curvature.of(*rows, way.twist))
        grows, turned, lost = _growing(tolerance, way, extent, linkage, rows, bends)
        found.append(Growth(rows[1].N[0] @ way.hold, float(grows.min()), lost, turned))
    return found


def _growing(
    tolerance: Tolerance,
    way: Linearisation,
    extent: Extent,
    linkage: Linkage | None,
    rows: tuple[Rows, Rows],
    bends: Curvature,
) -> tuple[Array, Array, float]:
    """How much a row (1) grows along a piece nominally, by either end (2,), how that turns (6,), what errors change, m.

    The rows turn along the piece and with the errors, that of the row and those held, see `Curvature.inside`; the
    velocity error adds to the motion. In a hole that is askew by h all motion is seen turned by it, and a part that is
    off by g in the hand swings by its turn across g.
    """
    seen, drift = rows[1].N[0] @ way.hold, np.multiply(tolerance.velocity_error, way.length)
    drift[1] /= tolerance.rho
    slid, spun = length(way.motion[:3]), length(way.motion[3:])
    _, askew, off, _ = (0.0,) * 4 if linkage is None else linkage.sizes.tolist()
    wide = drift + np.array([askew * slid + off * spun, askew * spun])
    N = np.array([[*held.N, row.N[0]] for held, row in zip(way.held, rows, strict=True)])
    grows, turned, lost, given = bends.inside(N, np.array([way.motion, *way.goal_dual.T]), extent.half, wide)
    lost += cone(tolerance, way, seen)
    if linkage is not None:
        # Errors of the frames tilt the way itself: by as much as the part slides and spins on it.
        slid += float(given @ lengths(way.goal_dual[:3].T)) + float(drift[0])
        spun += float(given @ lengths(way.goal_dual[3:].T)) + float(drift[1])
        lost += length(seen[:3]) * (askew * slid + off * spun) + length(seen[3:]) * askew * spun
    return grows, turned, float(lost)


@dataclass(frozen=True, eq=False)
class Compliance:
    """A held contact of the basis and the twist (6,) along which the part gives way to keep it."""

    contact: PrimitiveContact
    direction: Array


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a move: nominal poses, contacts held and to be held, the basis, and which fraction of the move it is.

    Where contacts are made together, `made` is one for all.
    """

    start: Pose
    goal: Pose
    held: tuple[PrimitiveContact, ...]
    goal_contacts: tuple[PrimitiveContact, ...]
    basis: tuple[Compliance, ...]
    made: PrimitiveContact | None
    progress: tuple[float, float]
    left: tuple[PrimitiveContact, ...] = ()

    @property
    def last(self) -> bool:
        """Whether the move ends with this piece."""
        return self.progress[1] >= 1.0

    @property
    def making(self) -> tuple[PrimitiveContact, ...]:
        """The contacts that the move adds."""
        return tuple(c for c in self.goal_contacts if c not in self.held) if self.made is not None else ()

    @property
    def opening(self) -> tuple[PrimitiveContact, ...]:
        """The contacts that never pass but may be open: the one being made that counts, and those given up."""
        return self.left if self.made is None else (self.made, *self.left)

    @property
    def share(self) -> float:
        """The part φ of what is left of the move that this piece covers."""
        return 1.0 if self.last else (self.progress[1] - self.progress[0]) / (1.0 - self.progress[0])


@dataclass(frozen=True, eq=False)
class Tolerance:
    """What steps need of the problem: velocity errors (translation, rotation) and the characteristic length ρ, m."""

    velocity_error: tuple[float, float]
    rho: float
