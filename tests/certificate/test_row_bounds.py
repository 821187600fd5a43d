"""Kernels of certified lower bounds, against the formulas of rows, supports and remainders, one by one."""

import numpy as np
import pytest

from fmopt.certificate.remainder import Curvature, EndsBatch
from fmopt.certificate.row_bounds import PieceMotions, Witnesses, best, over
from fmopt.certificate.rows import Forms, points_above, stacked
from fmopt.certificate.tube import left
from fmopt.planning.moves.plane_arcs import SHARES
from fmopt.planning.moves.separating_planes import fans
from fmopt.spatial.se3 import lengths
from fmopt.spatial.values import Array
from tests.shared.parts.peg_pieces import claims, peg
from tests.shared.random_rows import KINDS, box, forms, moved, pose

PIECES = 3
CUTS = (4, 6, 7, 9)  # generators, slide, swing, shape; the rest is slack
COLUMNS = 11
FORM = 3e-6  # m


def motion(rng: np.random.Generator) -> PieceMotions:
    """Pieces of motion at random."""
    poses = [(start, *moved(rng, start, 0.05)) for start in (pose(rng) for _ in range(PIECES))]
    p = np.array([[start.p for start, _, _ in poses], [goal.p for _, goal, _ in poses]])
    R = np.array([[start.R for start, _, _ in poses], [goal.R for _, goal, _ in poses]])
    columns = rng.normal(size=(2, PIECES, COLUMNS, 6)) * 1e-3
    twist = np.array([twist for _, _, twist in poses])
    half = np.array([box(tuple(rng.uniform(0.0, 0.05, 3).tolist())) for _ in range(PIECES)])
    return PieceMotions(p, R, columns, np.array(CUTS), twist, half, rng.uniform(0.0, 1e-4, (PIECES, 2)), FORM)


def plain(rows: Forms, pieces: PieceMotions) -> tuple[Array, Array, Array, Array]:
    """What `over` finds, from each formula's own place."""
    p, R, columns, cuts, twist, half, coupling, form = pieces
    start, goal = rows.ends(p, R)
    N = np.array([start.N, goal.N])
    spread, slide, swing, shape, slack = np.split(N @ np.swapaxes(columns, -1, -2), cuts, axis=-1)
    inside = np.abs(spread).sum(axis=-1) + lengths(slide) + lengths(swing)
    reach = np.minimum(lengths(shape), inside) + np.abs(slack).sum(axis=-1)
    bends = [Curvature.of(start.end(n), goal.end(n), twist[n]) for n in range(PIECES)]
    lost = form * (1.0 + rows.directed)
    rest = [left(bent.bending, half[n], coupling[n]) + lost for n, bent in enumerate(bends)]
    return np.array([start.f, goal.f]), N, reach, np.array(rest)


@pytest.mark.parametrize("seed", range(4))
def test_rows_over_pieces_are_what_the_formulas_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, pieces = stacked(*(forms(kind, rng) for kind in KINDS)), motion(rng)
    for found, expected in zip(over(rows.table, pieces), plain(rows, pieces), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-16)


def witnesses(rng: np.random.Generator, rows: int) -> Witnesses:
    """Six witnesses of six rows each, three a pair with the last one's twice; one along edges, one with a wall."""
    edges, behind = np.zeros((6, 2, 3)), np.zeros((1, 6), dtype=np.bool_)
    edges[1] = edges[4] = [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]
    behind[0, 1] = True
    always = np.array([6, 6, 6, 6, 4, 6])
    surely = np.ones(rows, dtype=np.bool_)
    surely[[4 * 6 + 1, 4 * 6 + 4, 4 * 6 + 5]] = False
    places = np.array([[0, 1, 2, 2], [3, 4, 5, 5]])
    return Witnesses(np.arange(7) * 6, places, always, surely, edges, np.array([[4, 4, 5]]), behind)


@pytest.mark.parametrize("seed", range(12))
def test_the_best_witness_is_the_one_with_the_largest_margin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, pieces = stacked(*(forms(KINDS[k % 4], rng) for k in range(6))), motion(rng)
    listed = witnesses(rng, len(rows))
    # Rows near zero, some of them below it, so that what holds nominally differs from what the errors leave.
    f = over(rows.table, pieces)[0]
    rows.table["c"] += f.min(axis=(0, 1)) - rng.uniform(-1e-4 if seed % 2 else 0.02, 0.05, len(rows))
    f, _, reach, rest = over(rows.table, pieces)
    lower, nominal = (f - reach).min(axis=0) - rest, f.min(axis=0)
    least = np.full((PIECES, 2), -np.inf if seed % 3 else 0.01)
    found = best(rows.table, listed, pieces, least, 2e-6)
    for n in range(PIECES):
        for m, places in enumerate(listed.places[:, :3].tolist()):
            chosen, margin, clearance = -1, least[n, m], -np.inf
            for w in places:
                which = np.arange(6) < listed.always[w]
                if w == 4 and lower[n, 6 * w + 4] > 0.0:
                    which[5], which[1] = True, False
                cosines = [listed.edges[w, 1] @ R[n] @ listed.edges[w, 0] for R in pieces.R]
                sine = max(np.sqrt(1.0 - cosine**2) for cosine in cosines)
                wander = np.linalg.norm(pieces.half[n, 3:]) + np.linalg.norm(pieces.twist[n, 3:])
                scale = min(1.0, sine + wander) if listed.edges[w].any() else 1.0
                own, room = (of[n, 6 * w : 6 * w + 6][which].min() / scale for of in (lower, nominal))
                if room >= -2e-6 and (own > margin or (own == margin and chosen < 0)):
                    chosen, margin, clearance = w, own, room
            assert found[0][n, m] == chosen
            if chosen >= 0:
                assert (found[1][n, m], found[2][n, m]) == pytest.approx((margin, clearance), rel=1e-12)


def test_the_plane_through_an_edge_is_at_least_as_good_as_those_tried_first() -> None:
    seen = 0
    moving, fixed = peg().assembly.moving.pieces[0], peg().assembly.fixed.pieces
    table = fans(moving, fixed)
    for claim in claims()[::4]:
        course = EndsBatch.of((claim.advance.ends, claims()[0].advance.ends))
        planes = table.best(course)
        shared = table.edges.normals
        for m, piece in enumerate(fixed):
            first, last = table.edges.cuts[m], table.edges.cuts[m + 1]
            heights = np.array([(piece.vertices @ normal).max() for normal in shared])
            for n in range(2):
                normal = planes.normals[n, m]
                offset = (piece.vertices @ normal).max()
                assert planes.offsets[n, m] == pytest.approx(offset, abs=1e-16)
                own = course.piece(n).over(points_above(moving.vertices, normal, offset))
                assert planes.margins[n, m] == pytest.approx(own.lower.min(), abs=1e-14)
                assert planes.clearances[n, m] == pytest.approx(own.f.min(), abs=1e-14)
                for q in np.unique(table.edges.which[first:last])[:: SHARES // 3]:
                    other = course.piece(n).over(points_above(moving.vertices, shared[q], heights[q]))
                    assert other.lower.min() <= planes.margins[n, m] + 1e-14
                    seen += 1
    assert seen > 200
