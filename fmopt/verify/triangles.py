"""Faces cut into triangles: polygons with holes in a plane, exactly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

from fmopt.verify.lattice import Flat, Work, cross_or_touch, folds_back, turn

Loop = tuple[int, ...]
Triangle = tuple[int, int, int]


def crossed(flat: Mapping[int, Flat], loops: Sequence[Loop], work: Work) -> bool:
    """Whether loops cross, touch or run back along themselves or one another."""
    edges = [(loop[k - 1], i) for loop in loops for k, i in enumerate(loop)]
    work.spend(len(edges) * len(edges) // 8)
    if len({i for i, _ in edges}) != len(edges):
        return True
    if any(folds_back(flat[loop[k - 2]], flat[loop[k - 1]], flat[i]) for loop in loops for k, i in enumerate(loop)):
        return True
    ordered = sorted(edges, key=lambda edge: min(flat[edge[0]][0], flat[edge[1]][0]))
    for n, (i, j) in enumerate(ordered):
        p, q = flat[i], flat[j]
        end = max(p[0], q[0])
        for k, l in ordered[n + 1 :]:
            a, b = flat[k], flat[l]
            if a[0] > end and b[0] > end:
                break
            # Edges that follow one another share an end, and more only where they fold back.
            if j != k and l != i and cross_or_touch(p, q, a, b):
                return True
    return False


def triangulated(flat: Mapping[int, Flat], loops: Sequence[Loop], work: Work) -> list[Triangle] | None:
    """Triangles that run counter-clockwise and have the loops as boundary; None where there are none.

    Of loops that neither cross nor touch they fill the polygon once: the number of triangles over a point is then how
    often the loops run around it, outside nothing, inside once, and in a loop that is no hole less than nothing.

    Args:
        flat: points by index.
        loops: the outline counter-clockwise, then holes clockwise.
        work: counts the steps.
    """
    outline = loops[0]
    if len(loops) == 1:
        fan = [(outline[0], i, j) for i, j in pairwise(outline[1:])]
        if all(turn(flat[a], flat[b], flat[c]) > 0 for a, b, c in fan):
            return fan
    whole = list(outline)
    rest = sorted(loops[1:], key=lambda loop: -max(flat[i][0] for i in loop))
    for n, hole in enumerate(rest):
        joined = _joined(flat, whole, hole, rest[n:], work)
        if joined is None:
            return None
        whole = joined
    return _ears(flat, whole, work)


def _joined(
    flat: Mapping[int, Flat], whole: list[int], hole: Loop, others: Sequence[Loop], work: Work
) -> list[int] | None:
    """The outline with a hole joined to it along a segment that crosses nothing, there and back."""
    start = max(range(len(hole)), key=lambda k: flat[hole[k]])
    i = hole[start]
    edges = [(whole[k - 1], j) for k, j in enumerate(whole)]
    edges += [(loop[k - 1], j) for loop in others for k, j in enumerate(loop)]
    work.spend(len(edges))
    x, y = flat[i]
    near = sorted(range(len(whole)), key=lambda k: (flat[whole[k]][0] - x) ** 2 + (flat[whole[k]][1] - y) ** 2)
    for k in near:
        j = whole[k]
        work.spend(len(edges) // 4 + 1)
        before, after = flat[whole[k - 1]], flat[whole[(k + 1) % len(whole)]]
        if not _in_corner(before, flat[j], after, flat[i]):
            continue
        if any(_obstructs(flat, edge, i, j) for edge in edges):
            continue
        return [*whole[: k + 1], *hole[start:], *hole[: start + 1], *whole[k:]]
    return None


def _obstructs(flat: Mapping[int, Flat], edge: tuple[int, int], i: int, j: int) -> bool:
    """Whether an edge is in the way between two vertices."""
    a, b = edge
    if a in (i, j) or b in (i, j):
        own, far = (a, b) if a in (i, j) else (b, a)
        other = j if own == i else i
        return far != other and (
            folds_back(flat[other], flat[own], flat[far]) or folds_back(flat[far], flat[own], flat[other])
        )
    return cross_or_touch(flat[i], flat[j], flat[a], flat[b])


def _in_corner(before: Flat, at: Flat, after: Flat, p: Flat) -> bool:
    """Whether a point is seen from a corner of a polygon towards its inside."""
    if turn(before, at, after) > 0:
        return turn(at, after, p) > 0 and turn(before, at, p) > 0
    return turn(at, after, p) > 0 or turn(before, at, p) > 0


def _ears(flat: Mapping[int, Flat], whole: list[int], work: Work) -> list[Triangle] | None:
    """Triangles cut off a polygon one after the other."""
    found: list[Triangle] = []
    at = 0
    while len(whole) > 3:
        size = len(whole)
        for step in range(size):
            k = (at + step) % size
            i, j, l = whole[k - 1], whole[k], whole[(k + 1) % size]
            work.spend(1)
            if turn(flat[i], flat[j], flat[l]) > 0 and not any(_within(flat, (i, j, l), _others(whole, i, j, l), work)):
                found.append((i, j, l))
                del whole[k]
                at = k % len(whole)
                break
        else:
            return None
    i, j, l = whole
    return [*found, (i, j, l)] if turn(flat[i], flat[j], flat[l]) > 0 else None


def _others(whole: Sequence[int], i: int, j: int, l: int) -> Iterator[int]:
    return (k for k in whole if k not in (i, j, l))


def _within(flat: Mapping[int, Flat], ear: Triangle, others: Iterator[int], work: Work) -> Iterator[bool]:
    a, b, c = (flat[i] for i in ear)
    for k in others:
        work.spend(1)
        p = flat[k]
        yield turn(a, b, p) >= 0 and turn(b, c, p) >= 0 and turn(c, a, p) >= 0
