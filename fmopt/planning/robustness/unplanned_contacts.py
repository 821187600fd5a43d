"""What contact an error would make first: for each move, the contacts that it does not plan and errors could make.

A move is certified for its start errors. Let them grow by a factor λ: the error set of each piece grows with them, as
the image of the start box does, and at some λ a contact c that is not planned becomes possible,

    min λ   with   f(X) + N·e = 0,   e = Σ uₖ gₖ,   |uₖ| ≤ λ,   e inside the bounds of c,

gₖ being the images of the start errors at the pose X. Velocity errors, and what contact surfaces bend, are left aside:
these are the planner's own figures, of first order, and no part of what is certified.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim
from fmopt.certificate.error_set import ErrorSet
from fmopt.contact.c_surface import (
    Surfaces,
    angle_between,
    contact_normal,
    contact_point,
    contact_wrench,
    friction_cone,
)
from fmopt.contact.facet_bounds import bounds
from fmopt.contact.primitive import PrimitiveContact, near_contacts
from fmopt.plan import diagnostics
from fmopt.plan.field_types import numbers
from fmopt.plan.position_force import AXES
from fmopt.planning.optimise.solvers import least_vertex
from fmopt.planning.search.guarded_move import implied, modulo
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, Indices, Value

_MOST_ALONE = 1e6  # factor of a start error alone beyond which it makes no contact: its part in it is rounding
LARGEST = 4.0  # factor of the start errors up to which contacts are looked for
_SURELY = 1.001 * LARGEST  # up to which gaps may close at first sight
_MOST = 4  # contacts that are told of each move
_ALTERNATIVES = 16  # of bounds
_OPEN = 1e-9  # m: a contact nearer than this touches


@dataclass(frozen=True, eq=False)
class UnplannedCandidate(Value, row=(6,), wrench=(6,)):
    """A contact that a move does not plan, and what error would make it."""

    contact: PrimitiveContact
    factor: float
    axis: str  # the one start error that makes it alone at the least factor of its own; "" where none does
    axis_factor: float  # that factor, infinite where none does
    gap: float  # nominal distance, m, where it comes nearest
    row: Array  # gradient (6,) of the distance in the start errors, m per half-width; those of axes without error are 0
    wrench: Array  # reaction (6,) for a unit normal force there, about the moving frame's origin, axes of B
    # Least angle (rad) between its friction cone and that of the contact that the move makes, modulo the held contacts;
    # None where the move makes none, or where the held contacts take all of one of the two
    angle: float | None

    def described(self, move: int, told: bool) -> diagnostics.UnplannedContact:
        """As a plan describes it, with whether the robot can tell it from the contact that is wanted."""
        features = str(self.contact.kind), self.contact.moving, self.contact.fixed
        alone = self.axis, self.axis_factor if self.axis else None
        wrench = numbers(self.wrench)
        return diagnostics.UnplannedContact(move, *features, self.factor, wrench, told, *alone, self.angle)


class _Place(NamedTuple):
    """A pose of a move, with the images (6, 6) of the start errors there as columns."""

    pose: Pose
    images: Array


def images_of(errors: ErrorSet, axes: Indices) -> Array:
    """The images (6, 6) of the start errors in a set that a motion has carried on, one column an axis with error.

    An ellipsoid, as the paper's sets are, has forgotten them: all are 0, and nothing is foreseen.
    """
    images = np.zeros((6, 6))
    if len(errors.generators) >= len(axes):
        images[:, axes] = errors.generators[: len(axes)].T
    return images


class _Met(NamedTuple):
    """That errors could make a contact at a place: the least factor, alone by axis, distance and its gradient."""

    factor: float
    alone: tuple[float, str]
    claim: Claim
    place: _Place
    gap: float
    row: Array


def unplanned_contacts(
    assembly: Assembly, claims: Sequence[Claim], box: Array, friction: float, rho: float
) -> tuple[UnplannedCandidate, ...]:
    """The contacts that errors, half-widths (6,) at the start, would make first on a move, the first of them first."""
    best: dict[PrimitiveContact, _Met] = {}
    for claim, place in _places(claims, np.flatnonzero(box)):
        for contact, gap, row in _near(assembly, claim, place):
            # Only a few are told: once there are so many, others have to come before the worst of these.
            factors = sorted(met.factor for met in best.values())
            limit = min([LARGEST, *factors[_MOST - 1 : _MOST], *([best[contact].factor] if contact in best else [])])
            r = row @ place.images
            # Bounds can only ask for more: by its distance alone a contact needs λ ≥ gap / Σ|rₖ|.
            planned = claim.piece.goal_contacts
            if gap / max(float(np.abs(r).sum()), 1e-30) >= limit or any(
                implied(assembly, planned, made, contact) for made in planned
            ):
                continue
            rows = _bounding(assembly, contact, place)
            factor = _factor(gap, r, rows)
            if factor < limit:
                best[contact] = _Met(factor, _alone(gap, r, rows), claim, place, gap, row)
    ordered = sorted(best.items(), key=lambda item: (item[1].factor, item[0].id))
    return tuple(_unplanned(assembly, contact, met, friction, rho) for contact, met in ordered[:_MOST])


def _places(claims: Sequence[Claim], axes: Indices) -> Iterator[tuple[Claim, _Place]]:
    """The poses at which contacts are looked for: where the move starts, and where each of its pieces ends."""
    first = claims[0].advance.ends  # between the ends of a piece an error lies between those at its ends
    yield claims[0], _Place(first.start, images_of(first.start_set, axes))
    for claim in claims:
        ends = claim.advance.ends
        yield claim, _Place(ends.goal, images_of(ends.goal_set, axes))


def _near(assembly: Assembly, claim: Claim, place: _Place) -> Iterator[tuple[PrimitiveContact, float, Array]]:
    """Contacts near a place that are not planned, with distance (m) and gradient (6,), those that errors can close."""
    piece, size = claim.piece, LARGEST * np.abs(place.images).sum(axis=1)
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    planned = {*piece.held, *piece.goal_contacts, *piece.left}
    near = near_contacts(body, fixed, place.pose, float(np.linalg.norm(size[:3])), float(np.linalg.norm(size[3:])))
    others = [c for c in near if c not in planned]
    f, N = Surfaces.of(others, body, fixed).values_and_rows(place.pose)
    closing = (f > _OPEN) & (f <= _SURELY * np.abs(N @ place.images).sum(axis=1))
    for k in np.flatnonzero(closing):
        yield others[k], float(f[k]), N[k]


def _bounding(assembly: Assembly, contact: PrimitiveContact, place: _Place) -> list[tuple[Array, Array]]:
    """Distances (m,) that are negative inside the contact's bounds, with their images (m, 6); one of the pairs holds.

    A clause with alternatives, as round a hole, multiplies the pairs.
    """
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    clauses = bounds(contact, body, fixed, place.pose)
    listed = list(dict.fromkeys(bound for clause in clauses for group in clause for bound in group))
    if not listed:
        return [(np.zeros(0), np.zeros((0, 6)))]
    f, N = Surfaces.of([bound.contact for bound in listed], body, fixed).values_and_rows(place.pose)
    signs = np.array([float(bound.sign) for bound in listed])
    g, B = signs * f, signs[:, None] * (N @ place.images)
    usable = np.isfinite(g)
    found = []
    # With further alternatives left out, a factor can only be found too large.
    for chosen in islice(product(*clauses), _ALTERNATIVES):
        places = sorted({listed.index(bound) for group in chosen for bound in group})
        kept = [k for k in places if usable[k]]
        found.append((g[kept], B[kept]))
    return found


def _factor(gap: float, r: Array, rows: Sequence[tuple[Array, Array]]) -> float:
    """The least λ of this module's program; infinite where no λ up to the largest does."""
    least = gap / float(np.abs(r).sum())
    # The errors that close the gap soonest: where they are within the bounds there is nothing to be solved.
    corner = -least * np.sign(r)
    if any(bool((g + B @ corner <= _OPEN).all()) for g, B in rows):
        return least
    return min(_least(gap, r, g, B) for g, B in rows)


def _least(gap: float, r: Array, g: Array, B: Array) -> float:
    """The same where the rows (g, B) bound the contact."""
    n, scale = len(r), 1.0 / gap  # in gaps, numbers are of order 1 as the solver wants them
    beside = np.hstack([np.vstack([np.eye(n), -np.eye(n)]), -np.ones((2 * n, 1))])
    inside = np.hstack([scale * B, np.zeros((len(g), 1))])
    rows = np.vstack([beside, inside]), np.concatenate([np.zeros(2 * n), -scale * g])
    most = np.full(n + 1, LARGEST)
    cost = np.append(np.zeros(n), 1.0)
    made = np.append(scale * r, 0.0)[None], np.array([-1.0])
    x = least_vertex(cost, rows, made, (np.append(-most[:n], 0.0), most))
    return math.inf if x is None else float(x[n])


def _alone(gap: float, r: Array, rows: Sequence[tuple[Array, Array]]) -> tuple[float, str]:
    """The least factor of one start error alone, and its axis; infinite and "" where none makes the contact."""
    found = [(math.inf, "")]
    for k in np.flatnonzero(r):
        u = -gap / float(r[k])
        if abs(u) <= _MOST_ALONE and any(bool((g + u * B[:, k] <= _OPEN).all()) for g, B in rows):
            found.append((abs(u), AXES[k]))
    return min(found)


def _unplanned(
    assembly: Assembly, contact: PrimitiveContact, met: _Met, friction: float, rho: float
) -> UnplannedCandidate:
    body, fixed, pose = assembly.moving.polyhedron, assembly.fixed.polyhedron, met.place.pose
    piece, scale = met.claim.piece, np.array([1.0, 1.0, 1.0, *[1.0 / rho] * 3])
    angle = None
    if piece.made is not None:
        held = contact_rows(assembly, piece.held, piece.held, piece.goal).N * scale if piece.held else np.zeros((0, 6))
        wanted = [scale * _cone(assembly, made, piece.goal, friction) for made in piece.making]
        cone = modulo(held, scale * _cone(assembly, contact, pose, friction))
        angles = [angle_between(modulo(held, one), cone) for one in wanted]
        angle = min((found for found in angles if found is not None), default=None)
    wrench = contact_wrench(contact, body, fixed, pose)
    factor, axis = met.alone
    return UnplannedCandidate(contact, met.factor, axis, factor, met.gap, met.row @ met.place.images, wrench, angle)


def _cone(assembly: Assembly, contact: PrimitiveContact, pose: Pose, friction: float) -> Array:
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    arm = contact_point(contact, body, fixed, pose) - pose.p
    return friction_cone(contact_normal(contact, body, fixed, pose), arm, friction)
