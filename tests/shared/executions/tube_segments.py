"""Random pieces of motion between random hulls in contact, and executions of them on the true contact surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import ConvexHull

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.propagation import Advance, advance
from fmopt.certificate.segment_linearisation import Compliance, Piece, Tolerance
from fmopt.contact.primitive import Kind, PrimitiveContact, edge_edge, face_vertex, vertex_face
from fmopt.errors import InfeasibleError
from fmopt.geometry.part import Part
from fmopt.geometry.polyhedron import from_faces
from fmopt.spatial import ellipsoid
from fmopt.spatial.se3 import Pose, exp, hat
from fmopt.spatial.values import Array

RHO = 0.014
SCALE = ellipsoid.metric(RHO)
SEGMENTS = 200
_STEPS = 8
_SETTLED = 3e-9  # m; the step after this is a tenth or less
_BLOCK = 25_000  # executions at a time: what a processor caches
_LEVER = 0.3  # least cosine, in the metric of ρ, at which a contact is approached


@dataclass(frozen=True, eq=False)
class Segment:
    """A piece of motion with start errors `factor` @ u, u in the unit ball or the unit box, and its outcome."""

    assembly: Assembly
    piece: Piece
    factor: Array
    in_ball: bool
    errors: ErrorSet
    tolerance: Tolerance
    outcome: Advance

    @property
    def contacts(self) -> tuple[PrimitiveContact, ...]:
        """The held contacts, then the one being made."""
        return (*(entry.contact for entry in self.piece.basis), *self.piece.making)

    @property
    def directions(self) -> Array:
        """Twists (6, r) along which the held contacts give way."""
        return np.array([entry.direction for entry in self.piece.basis]).reshape(-1, 6).T

    @property
    def linear(self) -> bool:
        """Whether nothing turns and nothing drifts: then the linear picture is the truth."""
        still = not self.factor[3:].any() and not self.piece.start.local(self.piece.goal)[3:].any()
        return still and max(self.tolerance.velocity_error) == 0.0

    @property
    def rates(self) -> Array:
        """Half-axes (6,) of the velocity error per metre of travel, in m and rad."""
        return np.repeat(self.tolerance.velocity_error, 3) / SCALE


def unit_rows(rng: np.random.Generator, k: int, n: int = 6) -> Array:
    u = rng.normal(size=(k, n))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


# A ball's row is that of a vertex over a plane a radius farther out, see `tests/planning/parts/test_balls.py`.
KINDS = (Kind.VERTEX_FACE, Kind.FACE_VERTEX, Kind.EDGE_EDGE)


@cache
def segment(index: int) -> Segment:
    """The segment of this number, the first of its kind that can be made at all.

    Three in four hold contacts, one in two turns, three in five drift; one in five is linear.
    """
    for attempt in range(50):
        found = _segment(np.random.default_rng([3, index, attempt]), index)
        if found is not None:
            return found
    raise AssertionError(f"no segment {index}")


def _segment(rng: np.random.Generator, index: int) -> Segment | None:
    linear, drifts = index % 5 == 0, index % 5 in (1, 2, 3)
    rank = index % 3 if linear else index % 4
    assembly = Assembly(*(_hull(name, rng) for name in ("peg", "block")))
    contacts = _contacts(assembly, rank + 1, KINDS[:2] if linear else KINDS, rng)
    basis, made = contacts[:rank], contacts[rank]
    goal = _settled(assembly, Pose(rng.uniform(-5e-3, 5e-3, 3), exp(rng.normal(size=3))), contacts, np.eye(6))
    if goal is None:
        return None
    rows = contact_rows(assembly, contacts, contacts, goal).N
    C = (unit_rows(rng, rank) + 1.5 * _units(rows[:rank] / SCALE)) / SCALE
    if linear:
        C[:, 3:] = 0.0
    way = _way(rng, rows, linear or index % 2 == 0)
    start = None if way is None else _settled(assembly, goal.moved(-way), basis, C.T)
    if start is None:
        return None
    piece = Piece(start, goal, basis, contacts, tuple(map(Compliance, basis, C)), made, (0.0, 1.0))
    factor, in_ball, errors = _start_errors(rng, index % 3, linear)
    hold, _ = ellipsoid.oblique_projector(contact_rows(assembly, basis, basis, start).N, C.T)
    errors = ErrorSet(
        hold @ errors.shape_root, errors.generators @ hold.T, hold @ errors.slide_root, hold @ errors.swing_root
    )
    velocity = rng.uniform(0.0, 0.05, 2) * drifts
    tolerance = Tolerance((float(velocity[0]), float(velocity[1])), RHO)
    try:
        outcome = advance(assembly, piece, errors, tolerance)
    except InfeasibleError:
        return None
    if outcome.approach is not None and outcome.approach.least <= 0.0:
        return None
    return Segment(assembly, piece, hold @ factor, in_ball, errors, tolerance, outcome)


def _hull(name: str, rng: np.random.Generator) -> Part:
    """A part with twelve random vertices, about 20 mm across."""
    points = unit_rows(rng, 12, 3) * rng.uniform(8e-3, 12e-3, 3)
    faces = []
    for triangle, plane in zip(ConvexHull(points).simplices, ConvexHull(points).equations, strict=True):
        a, b, c = points[triangle]
        outward = np.cross(b - a, c - a) @ plane[:3] > 0.0
        faces.append([[int(i) for i in (triangle if outward else triangle[::-1])]])
    body = from_faces([tuple(p) for p in points], faces)
    return Part(name, body, (body,), (), 0.0)


def _contacts(
    assembly: Assembly, count: int, kinds: Sequence[Kind], rng: np.random.Generator
) -> tuple[PrimitiveContact, ...]:
    """Random contacts that share no vertex of either part."""
    body, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron
    found: list[PrimitiveContact] = []
    while len(found) < count:
        one, other = rng.integers(0, 10_000, 2)
        match kinds[int(rng.integers(len(kinds)))]:
            case Kind.VERTEX_FACE:
                new = vertex_face(fixed, int(one) % len(body.vertices), int(other) % len(fixed.faces))
            case Kind.FACE_VERTEX:
                new = face_vertex(body, int(one) % len(body.faces), int(other) % len(fixed.vertices))
            case Kind.EDGE_EDGE:
                new = edge_edge(body, fixed, np.eye(3), int(one) % len(body.edges), int(other) % len(fixed.edges))
        if not any(set(new.moving) & set(old.moving) or set(new.fixed) & set(old.fixed) for old in found):
            found.append(new)
    return tuple(found)


def _units(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _way(rng: np.random.Generator, rows: Array, straight: bool) -> Array | None:
    """A displacement V (6,) inside the held rows that approaches the last one, up to 3 mm long; None for a poor one."""
    held, made = _units(rows[:-1] / SCALE), _units(rows[-1:] / SCALE)[0]
    fixed = np.vstack([held, np.eye(6)[3:]]) if straight else held
    inside = np.eye(6) - np.linalg.pinv(fixed, rcond=1e-9) @ fixed
    V = inside @ (unit_rows(rng, 1)[0] - 1.5 * made)
    V = V / max(float(np.linalg.norm(V)), 1e-12)
    steep = np.linalg.cond(np.vstack([held, made])) < 20.0 and float(made @ V) < -_LEVER
    way = rng.uniform(2e-4, 3e-3) * V / SCALE
    way[3:] *= not straight
    return np.asarray(way) if steep and np.linalg.norm(V) > 0.5 else None


def _start_errors(rng: np.random.Generator, kind: int, linear: bool) -> tuple[Array, bool, ErrorSet]:
    spread = 3e-4 * 10.0 ** rng.uniform(-1.5, 0.0, 6)
    spread[3:] *= not linear
    if kind == 0:
        turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        if linear:
            turn = np.block([[np.linalg.qr(rng.normal(size=(3, 3)))[0], np.zeros((3, 3))], [np.zeros((3, 6))]])
        factor = turn * spread / SCALE[:, None]
        return factor, True, ErrorSet.from_ellipsoid(factor @ factor.T)
    if kind == 1:
        generators = unit_rows(rng, 5) * spread[:5, None] / SCALE
        generators[:, 3:] *= not linear
        lengths = np.linalg.norm(generators * SCALE, axis=1)
        outer = generators.T * np.sqrt(lengths.sum() / np.maximum(lengths, 1e-12))
        return generators.T, False, ErrorSet(outer, generators, np.zeros((6, 0)))
    return np.diag(spread / SCALE), False, ErrorSet.from_box(spread / SCALE)


def _settled(assembly: Assembly, pose: Pose, contacts: Sequence[PrimitiveContact], C: Array) -> Pose | None:
    """The pose shifted along twists C (6, m) until the contacts touch, None when they do not come together."""
    for _ in range(30):
        rows = contact_rows(assembly, contacts, contacts, pose)
        if np.abs(rows.f).max(initial=0.0) < 1e-16:
            return pose
        shift = np.linalg.lstsq((rows.N / SCALE) @ (C * SCALE[:, None]), rows.f, rcond=1e-9)[0]
        pose = pose.moved(-C @ shift)
        if np.linalg.norm(pose.p) > 0.05:
            return None
    return pose if np.abs(rows.f).max() < 1e-14 else None


# Executions, all at once: vectors as (3, n), errors as (6, n).


def executions(made: Segment, start: Array, drift: Array, share: Array | float = 1.0) -> Array:
    """Errors (6, n) of executions at a share of their own way, measured at the same share of the nominal one.

    An execution goes along the commanded motion with a velocity error, its held contacts kept by compliance, until it
    touches. All distances are those of the true surfaces; the equations f = 0 are solved with one constant Jacobian.
    Start errors (6, n) are those before compliance, velocity errors (6, n) per metre of travel.
    """
    shares = np.broadcast_to(share, start.shape[1])
    parts = [slice(k, k + _BLOCK) for k in range(0, start.shape[1], _BLOCK)]
    return np.hstack([_executed(made, start[:, part], drift[:, part], shares[part]) for part in parts])


def _executed(made: Segment, start: Array, drift: Array, share: Array) -> Array:
    V = made.piece.start.local(made.piece.goal)
    far = float(np.linalg.norm(V * SCALE))
    drift = drift * far
    rows = contact_rows(made.assembly, made.contacts, made.contacts, made.piece.goal).N
    inverse = np.linalg.inv(rows @ np.column_stack([made.directions, V]))
    stop, give = np.ones(start.shape[1]), np.zeros((len(inverse) - 1, start.shape[1]))
    for _ in range(_STEPS):
        change = inverse @ _distances(made, made.contacts, start + drift * stop + made.directions @ give, stop)
        give, stop = give - change[:-1], stop - change[-1]
        if max(np.abs(change[:-1]).max(initial=0.0), far * np.abs(change[-1]).max()) < _SETTLED:
            break
    gone = share * stop
    if (share < 1.0).any() and len(give):
        held = contact_rows(made.assembly, made.contacts[:-1], made.contacts[:-1], made.piece.goal).N
        inverse = np.linalg.inv(held @ made.directions)
        for _ in range(_STEPS):
            error = start + drift * gone + made.directions @ give
            give = give - inverse @ _distances(made, made.contacts[:-1], error, gone)
    return _measured_at(V, start + drift * gone + made.directions @ give, gone, share)


def _distances(made: Segment, contacts: Sequence[PrimitiveContact], error: Array, gone: Array) -> Array:
    """Distances (k, n), those of edges times the sine between them, at errors about nominal poses after `gone`."""
    piece, V = made.piece, made.piece.start.local(made.piece.goal)
    p = piece.start.p[:, None] + V[:3, None] * gone + error[:3]
    body, fixed = made.assembly.moving.polyhedron, made.assembly.fixed.polyhedron
    turned = Turned.of(piece.start.R, V[3:], gone, error[3:])
    found = np.empty((len(contacts), p.shape[1]))
    for row, contact in zip(found, contacts, strict=True):
        match contact.kind:
            case Kind.VERTEX_FACE:
                face = fixed.faces[contact.fixed_feature]
                row[:] = face.normal @ p + turned.along(face.normal, body.vertices[contact.moving[0]]) - face.offset
            case Kind.FACE_VERTEX:
                own = body.faces[contact.moving_feature]
                row[:] = turned.along(fixed.vertices[contact.fixed[0]][:, None] - p, own.normal) - own.offset
            case Kind.EDGE_EDGE:
                (a, b), (c, d) = body.vertices[list(contact.moving)], fixed.vertices[list(contact.fixed)]
                one, other = (b - a) / np.linalg.norm(b - a), (d - c) / np.linalg.norm(d - c)
                # (R one × other)·(p + R a − c)
                row[:] = turned.along(hat(other) @ (p - c[:, None]), one) + turned.along(other, np.cross(a, one))
    return found


@dataclass(frozen=True, eq=False)
class Turned:
    """Rotations exp(w) exp(gone V) R for n vectors w below a quarter turn and n shares `gone` of one turn V."""

    R: Array
    axis: Array
    shares: tuple[Array | float, ...]
    w: Array
    square: Array
    first: Array
    second: Array

    @staticmethod
    def of(R: Array, V: Array, gone: Array, w: Array) -> "Turned":
        angle, t = float(np.linalg.norm(V)), _dot(w, w)
        shares: tuple[Array | float, ...] = (1.0, np.sin(angle * gone), 1.0 - np.cos(angle * gone))
        # Rodrigues' formula about V; about w with its coefficients in series.
        first = 1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0)))
        second = 0.5 * (1.0 - t / 12.0 * (1.0 - t / 30.0 * (1.0 - t / 56.0 * (1.0 - t / 90.0))))
        return Turned(R, V / angle if angle else V, shares[: 3 if angle else 1], w, t, first, second)

    def along(self, q: Array, x: Array) -> Array:
        """q·(rotation of x) (n,), for one q (3,) or n of them (3, n), and one vector x (3,)."""
        X = [self.R @ x]
        for _ in self.shares[1:]:
            X.append(hat(self.axis) @ X[-1])
        parts = np.array(X)
        qx, seen = parts @ q, parts @ self.w
        one = q.ndim == 1
        swung = (parts @ hat(q)) @ self.w if one else parts @ _cross(q, self.w)
        onto = q @ self.w if one else _dot(q, self.w)
        qx = qx[:, None] if one else qx
        terms = qx + self.first * swung + self.second * (onto * seen - self.square * qx)
        return np.asarray(sum(share * term for share, term in zip(self.shares, terms, strict=True)))


def _measured_at(V: Array, error: Array, gone: Array, nominal: Array) -> Array:
    """The errors (6, n) about poses after `nominal`, of errors about those after `gone`."""
    shift = error[:3] + V[:3, None] * (gone - nominal)
    # exp(ε) exp((gone − nominal) V) as quaternions: scalar and vector parts.
    one, other = _quaternion(error[3:]), _quaternion(V[3:, None] * (gone - nominal))
    scalar = one[0] * other[0] - _dot(one[1], other[1])
    vector = one[0] * other[1] + other[0] * one[1] + _cross(one[1], other[1])
    half = np.sqrt(_dot(vector, vector))
    ratio = np.where(half > 1e-12, 2.0 * np.arctan2(half, scalar) / np.maximum(half, 1e-12), 2.0)
    return np.concatenate([shift, ratio * vector])


def _quaternion(w: Array) -> tuple[Array, Array]:
    angle = np.sqrt(_dot(w, w))
    return np.cos(0.5 * angle), 0.5 * np.sinc(0.5 * angle / np.pi) * w


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
