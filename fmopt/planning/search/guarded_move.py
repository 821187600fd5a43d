"""Guarded moves: from a pose, along one freedom of the compliance frame, until the first new contact is made."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import compress, groupby, product

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.contact_implications import aligned, flushes
from fmopt.certificate.facet_margin import cornered
from fmopt.certificate.kernels_rows import Table
from fmopt.certificate.segment_linearisation import Compliance
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.facet_bounds import BoundTable
from fmopt.contact.primitive import Kind, PrimitiveContact, feature_distances, near_contacts, near_tips
from fmopt.contact.realisation import Poses
from fmopt.errors import InfeasibleError
from fmopt.planning.moves.constrained_path import along, roots
from fmopt.planning.moves.moves import Move, held_by, kept
from fmopt.spatial.se3 import Pose, cross
from fmopt.spatial.values import Array, Indices

_TOUCH = 1e-9  # m; contacts that are apart by ten of it at most touch
_BESIDE = 1e-6  # m; features that touch are no farther apart
_ALIKE = 1e-12  # difference of unit normals that are parallel
_SAMPLES = 24  # parts of a way: what closes and opens again within one of them is not met
_HALVINGS = 4  # of the way, where held contacts cannot be kept all along
_TOGETHER = 1e-11  # of how far a move may go: contacts met within this are met at once
_PARALLEL = 1e-7  # sine of the angle between edges, up to which rounding decides where they cross
IN_PLANE = ("x", "z", "ry")
_OPPOSITE = -0.9999  # cosine of the angle between the normals of faces that face each other
_MATING = 10.0  # clearances a side, as near to each other as planes of faces are that mate
_STILL = 0.02  # rad, the turn that compliance may add to a slide


@dataclass(frozen=True, eq=False)
class Freedom:
    """An elementary motion in the B-frame through a body point: name, twist (6,) about that point, how far to try."""

    name: str
    twist: Array
    limit: float


def freedoms(
    max_turn: float, depth: float, reach: float, planar: bool = False, axes: Array | None = None
) -> tuple[Freedom, ...]:
    """Both ways along and about the axes of the compliance frame; down as far as the goal. In the plane x, z, about y.

    Limits are the greatest turn, rad, the greatest way down (`depth`) and in any other direction (`reach`), m. The axes
    (3, 3) of the frame are those of the B-frame turned about z; None for these themselves.
    """
    found = []
    for axis, letter in enumerate("xyz"):
        along = np.eye(3)[axis] if axes is None else axes[:, axis]
        for sign in (-1.0, 1.0):
            slide, turn = np.zeros(6), np.zeros(6)
            slide[:3] = turn[3:] = sign * along + 0.0  # no negative zeros
            limit = depth if (axis, sign) == (2, -1.0) else reach
            found.append(Freedom(f"{'-' if sign < 0 else '+'}{letter}", slide, limit))
            found.append(Freedom(f"{'-' if sign < 0 else '+'}r{letter}", turn, max_turn))
    return tuple(f for f in found if not planar or f.name.lstrip("+-") in IN_PLANE)


@dataclass(frozen=True, eq=False)
class ContactPose:
    """A nominal pose in a contact state: the pose, all held contacts, their basis, and the pivot (3,) in the body."""

    pose: Pose
    held: tuple[PrimitiveContact, ...]
    basis: tuple[Compliance, ...]
    pivot: Array


def _own(values: Array) -> Array:
    """A copy such as kernels are compiled for."""
    return np.array(values, order="C")


@dataclass(frozen=True, eq=False)
class _Course:
    """A motion along a freedom, as kernels take it; held are contacts' functions (r,) and compliant twists (r, 6)."""

    held: tuple[Table, Array]
    motion: tuple[Array, Array, Array, Array]

    @staticmethod
    def of(assembly: Assembly, place: ContactPose, freedom: Freedom) -> "_Course":
        """From a place along a freedom."""
        pivot, at = place.pivot, place.pose.apply(place.pivot)
        motion = _own(place.pose.R), _own(pivot), _own(at), _own(freedom.twist)
        return _Course(held_by(assembly, place.basis, place.held), motion)

    def after(self, amounts: Array) -> Poses:
        """The poses after motions by amounts (n,), held contacts kept by their compliance.

        Raises:
            InfeasibleError: the contacts cannot be kept.
        """
        p, R = np.empty((len(amounts), 3)), np.empty((len(amounts), 3, 3))
        kept(along(self.held, self.motion, amounts, p, R))
        return Poses(p, R)

    def meeting(self, near: Surfaces, which: Indices, between: Array, values: Array) -> Array:
        """Amounts (m,) at which distances `which` (m,), m, vanish, of `values` (2, m) at both ends: positive, then not.

        Raises:
            InfeasibleError: the held contacts cannot be kept.
        """
        found, asked = np.empty(len(which)), near.order[which]
        kept(roots(self.held, self.motion, near.tables, asked, (_own(between), _own(values)), found))
        return found


def neighbourhood(assembly: Assembly, place: ContactPose, freedom: Freedom, reach: float) -> Surfaces:
    """The primitive contacts within `reach`, m, that a move along a freedom, or one of its kind and limit, may meet.

    A turn is not taken to bring parts nearer than `reach` (m) do.
    """
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    return Surfaces.of(near_contacts(body, fixed, place.pose, *_range(freedom, reach)), body, fixed)


def _range(freedom: Freedom, reach: float) -> tuple[float, float]:
    """How near (m) features are, and how far from turned against each other (rad), that a move may bring together."""
    turning = bool(freedom.twist[3:].any())
    return (reach, 1.2 * freedom.limit) if turning else (1.2 * freedom.limit, _STILL)


def tips(assembly: Assembly, place: ContactPose, freedom: Freedom, reach: float) -> tuple[PrimitiveContact, ...]:
    """Those of a `neighbourhood` that are of a moving vertex on a fixed face."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    return near_tips(body, fixed, place.pose, *_range(freedom, reach))


def guarded(assembly: Assembly, place: ContactPose, freedom: Freedom, near: Surfaces) -> Move | None:
    """The move along a freedom until the first new contact.

    None when it meets none, or two independent ones at once, or cannot keep the held contacts. Where these cannot be
    kept as far as it may go, it is tried less far.
    """
    for halvings in range(_HALVINGS):
        with suppress(InfeasibleError):
            return _first_contact(assembly, place, replace(freedom, limit=0.5**halvings * freedom.limit), near)
    return None


def meetings(assembly: Assembly, place: ContactPose, freedom: Freedom, near: Surfaces) -> Iterator[Move]:
    """The guarded move along a freedom, once for each contact of those that come together as the one that is met.

    Which of them errors leave sure to be met is for the certificate to say. Arguments as of `guarded`.
    """
    move = guarded(assembly, place, freedom, near)
    if move is None:
        return
    yield move
    closed = (near.values(place.pose) > 10.0 * _TOUCH) & (np.abs(near.values(move.goal)) <= 10.0 * _TOUCH)
    others = [contact for contact in compress(near.contacts, closed) if contact not in move.making]
    for contact in _touching(assembly, others, move.goal):
        other = _arrival(assembly, place, move.goal, contact, near)
        if other is not None and other.making[0] == contact:
            yield other


def _first_contact(assembly: Assembly, place: ContactPose, freedom: Freedom, near: Surfaces) -> Move | None:
    course = _Course.of(assembly, place, freedom)
    # A floor that lies at the limit, as the goal's does, is met there, whatever rounding makes of it.
    amounts = np.append(np.linspace(0.0, freedom.limit, _SAMPLES + 1), freedom.limit + _TOUCH)
    poses = course.after(amounts)
    values = near.heights(poses.p, poses.R)
    closed = values[1:] <= 0.0
    # What touches to begin with is not met on the way: it has to be open first.
    closing = np.flatnonzero((values[0] > 10.0 * _TOUCH) & closed.any(axis=0))
    crossings = sorted(zip(closed[:, closing].argmax(axis=0).tolist(), closing.tolist(), strict=True))
    best: tuple[float, int, Pose] | None = None
    # Distances may vanish beside the features: the first to vanish need not touch, and later ones are looked at then.
    for k, cell in groupby(crossings, lambda crossing: crossing[0]):
        if best is not None and amounts[k] > best[0]:
            break
        met = np.array([i for _, i in cell if values[k, i] > 0.0], dtype=np.intp)  # nan brackets no root
        found = course.meeting(near, met, amounts[k : k + 2], values[k : k + 2, met])
        there = course.after(found)
        for n in np.argsort(found, kind="stable").tolist():
            amount, i = float(found[n]), int(met[n])
            if best is not None and amount >= best[0] + _TOGETHER * freedom.limit:
                break
            # Of several that come together, to rounding, the last in the list counts: edges before vertices.
            if best is None or i > best[1]:
                pose = there.pose(n)
                if _touching(assembly, [near.contacts[i]], pose):
                    best = amount, i, pose
    if best is None or best[0] <= 0.0:
        return None
    return _arrival(assembly, place, best[2], near.contacts[best[1]], near)


def _arrival(
    assembly: Assembly, place: ContactPose, goal: Pose, first: PrimitiveContact, near: Surfaces
) -> Move | None:
    pairs = zip(near.contacts, near.values(goal).tolist(), strict=True)
    grazing = [c for c, f in pairs if abs(f) <= 10.0 * _TOUCH and c not in place.held]
    touching = {first, *_touching(assembly, [c for c in grazing if c != first], goal)}
    made = [c for c in grazing if c in touching and (c == first or not cornered(assembly, c, goal))]
    # Which of several that come together was met first is a matter of rounding: their order in the list decides.
    first = next((c for c in made if implied(assembly, place.held, c, first)), first)
    made = [first, *(c for c in made if c != first)]
    together = tuple(c for c in made if c == first or implied(assembly, place.held, first, c))
    # Contacts met at once that add more than one rank to what is held are independent.
    several, held = len(together) < len(made), place.held
    if several and pinned(assembly, goal, (*held, *made)) > pinned(assembly, goal, held) + 1:
        return None
    return Move(place.pose, goal, place.held, together)


def insides(assembly: Assembly, contacts: Sequence[PrimitiveContact], pose: Pose) -> Array:
    """How far within their features contacts (n,) lie, m; edges that have turned parallel cross nowhere."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    found = BoundTable.of(contacts, body, fixed, pose).insides(pose)
    found[Surfaces.of(contacts, body, fixed).sines(pose) <= _PARALLEL] = -np.inf
    return found


def _touching(assembly: Assembly, contacts: Sequence[PrimitiveContact], pose: Pose) -> list[PrimitiveContact]:
    """Those of the contacts whose distance is gone at a pose that do touch there, inside their features."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    beside = list(compress(contacts, feature_distances(contacts, body, fixed, pose) <= _BESIDE))
    inside = insides(assembly, beside, pose) > 10.0 * _TOUCH if beside else ()
    return [contact for contact, within in zip(beside, inside, strict=True) if within]


def implied(
    assembly: Assembly, held: Sequence[PrimitiveContact], first: PrimitiveContact, other: PrimitiveContact
) -> bool:
    """Whether a contact is made exactly when `first` is, because flush faces fix the turn between the two.

    Walls and rims of several holes may be met together, too: if they are parallel and as far apart as what meets them.
    """
    if first.kind is not other.kind or first.kind in (Kind.FACE_VERTEX, Kind.BALL_FACE):
        return False
    known = flushes(assembly, held)
    body, fixed = assembly.moving.polyhedron.vertices, assembly.fixed.polyhedron
    if first.kind is Kind.VERTEX_FACE:
        one, two = (fixed.faces[c.fixed_feature] for c in (first, other))
        if (np.abs(one.normal - two.normal) > _ALIKE).any():
            return False
        image = aligned(known, body[first.moving[0]] - body[other.moving[0]])
        return image is not None and bool(abs(float(one.normal @ image) - (one.offset - two.offset)) <= _TOUCH)
    (a, b), (c, d) = body[list(first.moving)], body[list(other.moving)]
    (e, f), (g, h) = fixed.vertices[list(first.fixed)], fixed.vertices[list(other.fixed)]
    for one_way, other_way in ((b - a, d - c), (f - e, h - g)):
        if np.linalg.norm(cross(one_way, other_way)) > _TOUCH * float(np.linalg.norm(one_way)):
            return False
    image = aligned(known, a - c)
    return image is not None and bool(np.linalg.norm(cross(image - (e - g), f - e)) <= _TOUCH * 0.1)


def pinned(assembly: Assembly, pose: Pose, held: Sequence[PrimitiveContact]) -> int:
    """How many freedoms the held contacts take away at a pose."""
    if not held:
        return 0
    return int(np.linalg.matrix_rank(contact_rows(assembly, held, held, pose).N * assembly.units, 1e-6))


def mating_faces(assembly: Assembly, goal: Pose, clearance: float) -> frozenset[tuple[int, int]]:
    """Faces of moving and fixed part, by number, that face each other in the seat, with a clearance a side, m."""
    moving, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    middles = np.array([goal.apply(moving.vertices[list(face.vertices)]).mean(axis=0) for face in moving.faces])
    apart = np.abs(middles @ fixed.normals.T - fixed.offsets) <= _MATING * clearance
    facing = moving.normals @ goal.R.T @ fixed.normals.T < _OPPOSITE
    return frozenset((int(i), int(j)) for i, j in np.argwhere(apart & facing))


def lasts(assembly: Assembly, contact: PrimitiveContact, mates: frozenset[tuple[int, int]]) -> bool:
    """Whether a contact may last until the seat: faces that mate there meet in its features."""
    sides = (assembly.moving.polyhedron, contact.moving), (assembly.fixed.polyhedron, contact.fixed)
    faces = (set.intersection(*(set(body.vertex_faces[v]) for v in vertices)) for body, vertices in sides)
    return not mates.isdisjoint(product(*faces))


def modulo(held: Array, rows: Array) -> Array:
    """Rows (k, n) less their parts in the span of the held rows (h, n)."""
    if not len(held):
        return rows
    _, s, Vt = np.linalg.svd(held, full_matrices=False)
    basis = Vt[s > 1e-9 * s[0]]
    return np.asarray(rows - rows @ basis.T @ basis)
