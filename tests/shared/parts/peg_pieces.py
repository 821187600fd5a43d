"""A square peg set into its hole by hand, move by move: poses and contacts for tests of the certificate."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from fmopt.certificate.assembly import Assembly, contact_rows
from fmopt.certificate.claim import Claim, claimed, stepped
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.segment_linearisation import Compliance, Piece, Tolerance
from fmopt.contact.primitive import PrimitiveContact, edge_edge, vertex_face
from fmopt.geometry.csg import Box, Difference, Moved
from fmopt.geometry.part import part_of
from fmopt.planning.moves.separating_planes import choose_separations
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

HALF, CLEAR, DEPTH = 0.010, 0.0101, 0.030
START_BOX = (3e-4, 3e-4, 0.0, 0.005, 0.005, 0.005)
TOLERANCE = Tolerance((0.01, 0.01), float(np.hypot(HALF, HALF)))
DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class Peg:
    """The assembly, the contacts of the motion by name, and the body corner that leads."""

    assembly: Assembly
    contacts: dict[str, PrimitiveContact]
    corner: Array


@dataclass(frozen=True)
class Way:
    """One move: both poses, contacts held before and after, the contact that counts, and in how many pieces."""

    start: Pose
    goal: Pose
    held: tuple[PrimitiveContact, ...]
    after: tuple[PrimitiveContact, ...]
    made: PrimitiveContact | None
    pieces: int

    @property
    def whole(self) -> Piece:
        """The move as one piece, without a basis."""
        return Piece(self.start, self.goal, self.held, self.after, (), self.made, (0.0, 1.0))


@cache
def peg() -> Peg:
    """A peg of 20 mm, 0.1 mm clear a side, over a pocket 30 mm deep."""
    hole = Moved(Box((2 * CLEAR, 2 * CLEAR, DEPTH)), Pose(np.array([0.0, 0.0, 0.01]), np.eye(3)))
    block = Difference(Box((0.06, 0.06, 0.04)), (hole,))
    down = Pose(np.array([0.0, 0.0, -0.04]), np.eye(3))
    assembly = Assembly(part_of("peg", Box((2 * HALF, 2 * HALF, 0.04))), part_of("block", Moved(block, down)))
    own, fixed = assembly.moving.polyhedron, assembly.fixed.polyhedron

    def vertex(x: int, y: int, z: float) -> int:
        return int(np.argmin(np.linalg.norm(own.vertices - [x * HALF, y * HALF, z], axis=1)))

    def wall(axis: int, offset: float) -> int:
        hits = (n for n, f in enumerate(fixed.faces) if f.normal[axis] > 0.999 and abs(f.offset - offset) < 1e-9)
        return next(hits)

    def rim(axis: int) -> int:
        spans = ((n, fixed.vertices[list(e.vertices)]) for n, e in enumerate(fixed.edges))
        return next(n for n, v in spans if np.allclose(v[:, axis], -CLEAR) and np.allclose(v[:, 2], 0.0))

    def edge(a: int, b: int) -> int:
        return next(n for n, e in enumerate(own.edges) if set(e.vertices) == {a, b})

    v0, v1, v2, v3 = (vertex(x, y, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    t0, t1 = vertex(-1, -1, 0.04), vertex(1, -1, 0.04)
    R = _tilted(8.0 * DEGREE, 8.0 * DEGREE, 0.0)
    floor = wall(2, -DEPTH)
    contacts = {
        "left edge": edge_edge(own, fixed, R, edge(v0, t0), rim(0)),
        "front edge": edge_edge(own, fixed, R, edge(v0, t0), rim(1)),
        "other front edge": edge_edge(own, fixed, R, edge(v1, t1), rim(1)),
        "leading edge": edge_edge(own, fixed, R, edge(v0, v3), rim(0)),
        "left corner": vertex_face(fixed, v0, wall(0, -CLEAR)),
        "other left corner": vertex_face(fixed, v3, wall(0, -CLEAR)),
        "front corner": vertex_face(fixed, v0, wall(1, -CLEAR)),
        "other front corner": vertex_face(fixed, v1, wall(1, -CLEAR)),
        **{f"floor {n}": vertex_face(fixed, v, floor) for n, v in enumerate((v0, v1, v2, v3))},
    }
    return Peg(assembly, contacts, own.vertices[v0])


def _tilted(about_x: float, about_y: float, turn: float) -> Array:
    return exp([about_x, 0.0, 0.0]) @ exp([0.0, -about_y, 0.0]) @ exp([0.0, 0.0, turn])


def settled(
    pose: Pose,
    contacts: Sequence[PrimitiveContact],
    directions: Array,
    together: Sequence[PrimitiveContact],
    about: Pose | None = None,
) -> Pose:
    """The pose moved along directions (r, 6) until r contacts are zero, by Newton's method.

    Directions are twists in error coordinates about `about`, the pose itself by default; `together` has all contacts
    under consideration.
    """
    about = pose if about is None else about
    error = about.local(pose)
    for _ in range(20):
        rows = contact_rows(peg().assembly, contacts, together, about.moved(error))
        if np.abs(rows.f).max(initial=0.0) < 1e-15:
            break
        error = error - directions.T @ np.linalg.solve(rows.N @ directions.T, rows.f)
    return about.moved(error)


@cache
def moves() -> tuple[Way, ...]:
    """Down, to the left wall's rim, upright against the wall in two turns, to the front wall, upright, to the floor."""
    c, corner = peg().contacts, peg().corner

    def at(R: Array, x: float, y: float, z: float) -> Pose:
        return Pose(np.array([x, y, z]) - R @ corner, R)

    y, depth = -CLEAR + 1.501e-3, -0.75e-3
    tilted = at(_tilted(12.5 * DEGREE, 9.5 * DEGREE, -0.4 * DEGREE), -CLEAR + 5e-4, y, depth)
    X2 = settled(tilted, [c["left edge"]], np.eye(6)[:1], [c["left edge"]])
    X1 = X2.moved([1.151e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
    X0 = X1.moved([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0])
    pair = [c["left corner"], c["left edge"]]
    X3 = at(_tilted(12.5 * DEGREE, 0.0, -1.15 * DEGREE), -CLEAR, y, depth)
    X3 = settled(X3, pair, np.eye(6)[[0, 4]], pair)
    X4 = at(_tilted(12.5 * DEGREE, 0.0, 0.0), -CLEAR, y, depth)
    X5 = settled(X4, [c["front edge"]], np.eye(6)[[1]], [c["front edge"]])
    X6 = at(np.eye(3), -CLEAR, -CLEAR, depth)
    X7 = at(np.eye(3), -CLEAR, -CLEAR, -DEPTH)
    edge, hinged = (c["left edge"],), (c["left edge"], c["left corner"])
    flush = (*hinged, c["leading edge"])
    front = (*flush, c["other left corner"], c["front edge"], c["other front edge"])
    seated = (*front, c["front corner"], c["other front corner"])
    return (
        Way(X0, X1, (), (), None, 1),
        Way(X1, X2, (), edge, c["left edge"], 1),
        Way(X2, X3, edge, hinged, c["left corner"], 8),
        Way(X3, X4, hinged, flush, c["leading edge"], 4),
        Way(X4, X5, flush, (*flush, c["front edge"], c["other front edge"]), c["front edge"], 1),
        Way(X5, X6, front, seated, c["front corner"], 11),
        Way(X6, X7, seated, (*seated, *(c[f"floor {n}"] for n in range(4))), c["floor 0"], 1),
    )


def pieces_of(way: Way, basis: Sequence[Compliance]) -> list[tuple[Pose, Pose, tuple[float, float]]]:
    """The pieces of a move: poses at both ends, and which fraction of the move each is."""
    x, found, at = way.start.local(way.goal), [], way.start
    for k in range(way.pieces):
        share = (k / way.pieces, (k + 1) / way.pieces)
        to = way.goal if k == way.pieces - 1 else way.start.moved(x * share[1])
        if basis and to is not way.goal:
            to = settled(to, [b.contact for b in basis], np.array([b.direction for b in basis]), way.held)
        found.append((at, to, share))
        at = to
    return found


@cache
def claims() -> tuple[Claim, ...]:
    """The certified pieces of all moves."""
    errors: ErrorSet = ErrorSet.from_box(START_BOX)
    basis: tuple[Compliance, ...] = ()
    found: list[Claim] = []
    for way in moves():
        for start, goal, share in pieces_of(way, basis):
            piece = Piece(start, goal, way.held, way.after, basis, way.made, share)
            step = stepped(peg().assembly, piece, errors, TOLERANCE)
            found += claimed(peg().assembly, [(piece, step)], TOLERANCE, choose_separations)
            errors = found[-1].advance.ends.goal_set
        basis = found[-1].advance.basis
    return tuple(found)
