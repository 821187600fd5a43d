"""That convex pieces make up a part: no piece sticks out of it, and nothing of it is left over.

A solid is held as its faces, a face as directed segments (a chain: sums of segments count, not their order). Clipping
a solid by a half-space clips every segment, closes every face along the cut, and closes the solid by a cap made of the
same cuts reversed. Volume is linear in chains, so that clipping is right for solids with holes and re-entrant corners
as well. Proven are two equations between volumes, to `TOLERANCE`: part ∩ piece = piece for every piece, and union of
the pieces = part; a skin thinner than about 10⁻¹⁵ m of the part's surface would go unnoticed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fmopt.verify.rational import Vector, add, cross, dot, fixed, sub
from fmopt.verify.solids import Plane, Shape

Segment = tuple[Vector, Vector]
Chain = list[Segment]
TOLERANCE = fixed(1e-17)  # m³: a cube of 2 µm
_SLIVER = fixed(1e-22)
_LARGEST_WORK = 40_000


class _TooManyCells(Exception):
    pass


def _chains(shape: Shape) -> list[Chain]:
    v = shape.vertices
    return [
        [(v[i], v[j]) for loop in face.loops for i, j in zip(loop, (*loop[1:], loop[0]), strict=True)]
        for face in shape.faces
    ]


def volume(solid: Sequence[Chain]) -> int:
    """The volume, m³: one third of Σ x·A over the faces."""
    total = 0
    for face in solid:
        if face:
            base = face[0][0]
            area = (0, 0, 0)
            for p, q in face:
                area = add(area, cross(sub(p, base), sub(q, base)))
            total += dot(base, area)
    return total // 6


def clip(solid: Sequence[Chain], plane: Plane) -> list[Chain]:
    """The part of a solid behind a plane."""
    kept: list[Chain] = []
    cap: Chain = []
    heights: dict[Vector, int] = {}
    for face in solid:
        inside: Chain = []
        exits: list[Vector] = []
        entries: list[Vector] = []
        for p, q in face:
            h = heights.get(p)
            if h is None:
                h = heights[p] = plane.height(p)
            g = heights.get(q)
            if g is None:
                g = heights[q] = plane.height(q)
            if h <= 0 and g <= 0:
                inside.append((p, q))
            elif h <= 0 or g <= 0:
                cut = _cut(p, q, h, g)
                if h <= 0:
                    inside.append((p, cut))
                    exits.append(cut)
                else:
                    inside.append((cut, q))
                    entries.append(cut)
        for out, back in zip(exits, entries, strict=True):
            inside.append((out, back))
            cap.append((back, out))
        if inside:
            kept.append(inside)
    if cap:
        kept.append(cap)
    return kept


def _cut(p: Vector, q: Vector, h: int, g: int) -> Vector:
    if (p, h) > (q, g):
        p, q, h, g = q, p, g, h
    d = h - g
    return (
        p[0] + (q[0] - p[0]) * h // d,
        p[1] + (q[1] - p[1]) * h // d,
        p[2] + (q[2] - p[2]) * h // d,
    )


def _behind(plane: Plane) -> Plane:
    n = plane.normal
    return Plane((-n[0], -n[1], -n[2]), -plane.offset)


def _apart(a: Shape, b: Shape) -> bool:
    return any(
        max(v[k] for v in a.vertices) <= min(w[k] for w in b.vertices)
        or max(w[k] for w in b.vertices) <= min(v[k] for v in a.vertices)
        for k in range(3)
    )


def _left_over(solid: list[Chain], others: Sequence[Shape], work: list[int]) -> int:
    """The volume of a convex solid outside all of the other pieces."""
    if not others:
        return volume(solid)
    total = 0
    first, rest = others[0], others[1:]
    for face in first.faces:
        work[0] += 1
        if work[0] > _LARGEST_WORK:
            raise _TooManyCells
        outside = clip(solid, _behind(face.plane))
        if volume(outside) > _SLIVER:
            total += _left_over(outside, rest, work)
            solid = clip(solid, face.plane)
            if volume(solid) <= _SLIVER:
                break
    return total


def uncovered(part: Shape, pieces: Sequence[Shape]) -> Iterator[str]:
    """What keeps the pieces from being the part."""
    whole = _chains(part)
    size = volume(whole)
    if size <= 0:
        yield "the surface is inside out or encloses nothing"
    for n, piece in enumerate(pieces):
        own = volume(_chains(piece))
        if own <= _SLIVER:
            yield f"piece {n} has no volume"
        inside = whole
        for face in piece.faces:
            inside = clip(inside, face.plane)
        if abs(volume(inside) - own) > TOLERANCE:
            yield f"piece {n} sticks out of the part by {(own - volume(inside)) / (1 << 256) * 1e9:.3g} mm³"
    work = [0]
    try:
        union = sum(
            _left_over(_chains(piece), [p for p in pieces[:n] if not _apart(piece, p)], work)
            for n, piece in enumerate(pieces)
        )
    except _TooManyCells:
        yield "the pieces overlap in too many ways to be summed up"
        return
    if abs(union - size) > TOLERANCE:
        yield f"the pieces leave {(size - union) / (1 << 256) * 1e9:.3g} mm³ of the part uncovered"
