"""The surface of a part as triangles: closed, seen from outside, and nowhere through or along itself, all exactly.

Triangles that meet in nothing but shared corners and edges, with each edge run once either way and one round of them
about each corner, are closed surfaces apart from one another, the shells. Such a shell winds once around what it
encloses. Outer shells enclose nothing that another has around it, shells of voids what just one has: then every point
off the surface is inside once, or not at all.

Faces cut into triangles: polygons with holes in a plane, exactly.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise

from fmopt.verify.arithmetic.exact import area, inner, outer
from fmopt.verify.arithmetic.lattice import (
    Bounds,
    Corners,
    Flat,
    HalfSpace,
    Loops,
    Place,
    Point,
    WorkLeft,
    apart,
    bounds,
    cross_or_touch,
    folds_back,
    height,
    meets,
    on_lattice,
    place,
    seen_along,
    steepest,
    through,
    turn,
)
from fmopt.verify.parts.solids import Shape

Loop = tuple[int, ...]
Triangle = tuple[int, int, int]


class CutSurface:
    """The faces of a part, cut into triangles.

    Attributes:
        points: vertices on the lattice.
        centres: those of them that are the centres of balls, which need no face.
        triangles: as vertices; empty where a face cannot be cut up.

    Raises:
        TooMuchWork: they take too many steps to compare.
    """

    def __init__(self, shape: Shape, work: WorkLeft) -> None:
        self.points: tuple[Point, ...] = tuple(on_lattice(v) for v in shape.vertices)
        self.centres = {n for n, radius in enumerate(shape.radii) if radius}
        self.loops: tuple[Loops, ...] = tuple(face.loops for face in shape.faces)
        self.triangles: list[Triangle] = []
        self.faces: list[int] = []
        found = list(self._unjoined()) or list(self._cut(work)) or list(self._crossed(work))  # each rests on the former
        self.flaws = tuple(found or self._turned(work))

    def _unjoined(self) -> Iterator[str]:
        """What keeps each edge from having one face on either side, and each vertex one round of faces about it."""
        following: dict[int, dict[int, int]] = {}
        for n, loops in enumerate(self.loops):
            for loop in loops:
                for k, i in enumerate(loop):
                    before, at = loop[k - 2], loop[k - 1]
                    # By directed edges: the same one twice would be two faces on one side.
                    if i in following.setdefault(at, {}):
                        yield f"face {n} is not the only one left of its edge from vertex {at} to {i}"
                        return
                    following[at][i] = before
        for i in range(len(self.points)):
            if i not in following and i not in self.centres:
                yield f"vertex {i} belongs to no face"
                return
        for i, around in following.items():
            first = step = next(iter(around))
            while step in around:
                # The next face about the vertex is left of the edge that this one comes in by.
                step = around.pop(step)
            if step != first:
                yield f"the faces do not close at the edge from vertex {i} to {step}"
                return
            # More than one round about a vertex: the surface touches itself there.
            if around:
                yield f"the surface is pinched at vertex {i}"
                return

    def _cut(self, work: WorkLeft) -> Iterator[str]:
        """Cuts the faces into triangles, and tells those that cannot be cut."""
        for n, loops in enumerate(self.loops):
            normal = area(self.points, loops)
            axis = steepest(normal)
            if normal[axis] == 0:
                yield f"face {n} has no area"
                return
            flat = {i: seen_along(axis, self.points[i]) for loop in loops for i in loop}
            # Seen from behind, the face would run clockwise: x and y are exchanged.
            if normal[axis] < 0:
                flat = {i: (y, x) for i, (x, y) in flat.items()}
            if crossed(flat, loops, work) or (found := triangulated(flat, loops, work)) is None:
                yield f"face {n} crosses or touches itself, or runs the wrong way round"
                return
            self.triangles += found
            self.faces += [n] * len(found)

    def _crossed(self, work: WorkLeft) -> Iterator[str]:
        """Tells two faces that have more in common than vertices and edges."""
        # Sorted by their least x: from the first box that begins beyond the end of one on, none meets it.
        order = sorted(range(len(self.triangles)), key=lambda t: self.boxes[t][0])
        for n, s in enumerate(order):
            box, own = self.boxes[s], self.faces[s]
            for t in order[n + 1 :]:
                other = self.boxes[t]
                if other[0] > box[3]:
                    break
                work.spend(1)
                if own == self.faces[t] or apart(box, other):  # those of one face meet as cut
                    continue
                if self._touch(s, t):
                    yield f"faces {min(own, self.faces[t])} and {max(own, self.faces[t])} cross or touch"
                    return

    def _touch(self, s: int, t: int) -> bool:
        """Whether two triangles have more in common than the corners that both have."""
        one, two = self.triangles[s], self.triangles[t]
        shared = [i for i in one if i in two]
        plane, other = self.planes[s], self.planes[t]
        heights = [height(plane, self.points[i]) for i in two if i not in shared]
        if not heights:  # the same three corners
            return True
        # Two common corners: one edge, along which they may only meet on different sides.
        if len(shared) == 2:
            return heights[0] == 0 and self._same_side(one, two, shared, steepest(plane))
        if min(heights) > 0 or max(heights) < 0:
            return False
        heights = [height(other, self.points[i]) for i in one if i not in shared]
        if min(heights) > 0 or max(heights) < 0:
            return False
        return any(meets(p, q, self.corners(t), other) for p, q in self._sides(one, shared)) or any(
            meets(p, q, self.corners(s), plane) for p, q in self._sides(two, shared)
        )

    def _sides(self, triangle: Triangle, shared: Sequence[int]) -> Iterator[tuple[Point, Point]]:
        """The sides of a triangle away from what it shares: where it meets more, one of them does, or of the other."""
        for k in range(3):
            i, j = triangle[k - 1], triangle[k]
            if i not in shared and j not in shared:
                yield self.points[i], self.points[j]

    def _same_side(self, one: Triangle, two: Triangle, shared: Sequence[int], axis: int) -> bool:
        """Whether two triangles in a plane are on one side of the edge that they share."""
        a, b = (seen_along(axis, self.points[i]) for i in shared)
        p, q = (seen_along(axis, self.points[i]) for t in (one, two) for i in t if i not in shared)
        return (turn(a, b, p) > 0) == (turn(a, b, q) > 0)

    def _turned(self, work: WorkLeft) -> Iterator[str]:
        """Tells a shell that is inside out, or that stands where it bounds nothing."""
        for n, shell in enumerate(self.shells):
            # Six times the signed volume: positive where triangles look outward.
            volume = sum(inner(a, outer(b, c)) for a, b, c in map(self.corners, shell))
            work.spend(len(self.triangles))
            others = [t for other in self.shells if other is not shell for t in other]
            around = self._winding(place(self.points[self.triangles[shell[0]][0]]), others) if others else 0
            # A shell that looks outward must stand outside all others, one that looks inward within just one.
            if around != (0 if volume > 0 else 1):
                what = "is inside out" if around == 0 else "stands inside another one"
                yield f"the surface {what}" if len(self.shells) == 1 else f"shell {n} of the surface {what}"

    def corners(self, t: int) -> Corners:
        """The corners of a triangle."""
        i, j, k = self.triangles[t]
        return (self.points[i], self.points[j], self.points[k])

    @cached_property
    def boxes(self) -> list[Bounds]:
        """A box around each triangle."""
        return [bounds([place(p) for p in self.corners(t)]) for t in range(len(self.triangles))]

    @cached_property
    def planes(self) -> list[HalfSpace]:
        """The half-space behind each triangle."""
        return [through(*self.corners(t)) for t in range(len(self.triangles))]

    @cached_property
    def shells(self) -> list[list[int]]:
        """Triangles joined by edges, together."""
        # The triangle on the left of each directed edge; its neighbour has that edge the other way round.
        left = {(t[k - 1], t[k]): n for n, t in enumerate(self.triangles) for k in range(3)}
        found: list[list[int]] = []
        seen: set[int] = set()
        for first in range(len(self.triangles)):
            if first in seen:
                continue
            seen.add(first)
            shell = [first]
            for n in shell:
                t = self.triangles[n]
                beside = {left[t[k], t[k - 1]] for k in range(3)} - seen
                seen |= beside
                shell += sorted(beside)
            found.append(shell)
        return found

    @cached_property
    def box(self) -> Bounds:
        """A box around the surface."""
        return bounds([place(p) for p in self.points])

    def holds(self, p: Place) -> bool:
        """Whether a place that is not on the surface is inside."""
        x, y, z, w = p
        low, high = self.box[:3], self.box[3:]
        if any(a < l * w or a > h * w for a, l, h in zip((x, y, z), low, high, strict=True)):
            return False
        return self._winding(p, range(len(self.triangles))) != 0

    def _winding(self, p: Place, triangles: Sequence[int]) -> int:
        """How often triangles run around a place: those straight above it, each with the sign of its front.

        The place counts as moved by (ε, ε², 0) with ε as small as it takes to be above and below no edge.
        """
        x, y, _, w = p
        column, row = x // w, y // w
        total = 0
        for t in triangles:
            box = self.boxes[t]
            # By whole lattice columns: what is not above the place, or beside it, does not count.
            if column > box[3] or column < box[0] - 1 or row > box[4] or row < box[1] - 1 or p[2] > box[5] * w:
                continue
            plane = self.planes[t]
            front = (plane[2] > 0) - (plane[2] < 0)
            if front == 0:  # upright: no ray along z goes through it
                continue
            a, b, c = self.corners(t)
            # Moved by (ε, ε²): no ray goes through an edge or a vertex, and each triangle is hit or not.
            if all(_left(u, v, x, y, w) == front for u, v in ((a, b), (b, c), (c, a))):
                above = (plane[0] * x + plane[1] * y + plane[2] * p[2] - plane[3] * w) * front
                assert above, "a place on the surface is neither in nor out"
                if above < 0:
                    total += front
        return total


def _left(u: Point, v: Point, x: int, y: int, w: int) -> int:
    """1 where (x, y)/w, moved by (ε, ε²), is left of the way from u to v seen from above, −1 where it is right."""
    dx, dy = v[0] - u[0], v[1] - u[1]
    # Ties broken by the infinitesimal move: first by its x, then by its y.
    side = dx * (y - u[1] * w) - dy * (x - u[0] * w) or -dy or dx
    return 1 if side > 0 else -1


def crossed(flat: Mapping[int, Flat], loops: Sequence[Loop], work: WorkLeft) -> bool:
    """Whether loops cross, touch or run back along themselves or one another."""
    edges = [(loop[k - 1], i) for loop in loops for k, i in enumerate(loop)]
    work.spend(len(edges) * len(edges) // 8)
    if len({i for i, _ in edges}) != len(edges):
        return True
    # Running back along an edge would make a slit, which bounds nothing.
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


def triangulated(flat: Mapping[int, Flat], loops: Sequence[Loop], work: WorkLeft) -> list[Triangle] | None:
    """Triangles that run counter-clockwise and have the loops as boundary; None where there are none.

    Of loops that neither cross nor touch they fill the polygon once: the number of triangles over a point is then how
    often the loops run around it, outside nothing, inside once, and in a loop that is no hole less than nothing.
    """
    outline = loops[0]
    if len(loops) == 1:
        fan = [(outline[0], i, j) for i, j in pairwise(outline[1:])]
        # A fan works for convex faces, which most are, and for all that see their first corner.
        if all(turn(flat[a], flat[b], flat[c]) > 0 for a, b, c in fan):
            return fan
    whole = list(outline)
    # The hole that reaches farthest right first: from its rightmost vertex a way to what is joined already is free.
    rest = sorted(loops[1:], key=lambda loop: -max(flat[i][0] for i in loop))
    for n, hole in enumerate(rest):
        joined = _joined(flat, whole, hole, rest[n:], work)
        if joined is None:
            return None
        whole = joined
    return _ears(flat, whole, work)


def _joined(
    flat: Mapping[int, Flat], whole: list[int], hole: Loop, others: Sequence[Loop], work: WorkLeft
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
        # There and back along the segment: the outline stays one loop, with two vertices listed twice.
        return [*whole[: k + 1], *hole[start:], *hole[: start + 1], *whole[k:]]
    return None


def _obstructs(flat: Mapping[int, Flat], edge: tuple[int, int], i: int, j: int) -> bool:
    """Whether an edge is in the way between two vertices."""
    a, b = edge
    if a in (i, j) or b in (i, j):
        at, far = (a, b) if a in (i, j) else (b, a)
        end = j if at == i else i
        return far != end and (folds_back(flat[end], flat[at], flat[far]) or folds_back(flat[far], flat[at], flat[end]))
    return cross_or_touch(flat[i], flat[j], flat[a], flat[b])


def _in_corner(before: Flat, at: Flat, after: Flat, p: Flat) -> bool:
    """Whether a point is seen from a corner of a polygon towards its inside."""
    if turn(before, at, after) > 0:
        return turn(at, after, p) > 0 and turn(before, at, p) > 0
    return turn(at, after, p) > 0 or turn(before, at, p) > 0


def _ears(flat: Mapping[int, Flat], whole: list[int], work: WorkLeft) -> list[Triangle] | None:
    """Triangles cut off a polygon one after the other."""
    found: list[Triangle] = []
    at = 0
    while len(whole) > 3:
        size = len(whole)
        for step in range(size):
            k = (at + step) % size
            i, j, l = whole[k - 1], whole[k], whole[(k + 1) % size]
            work.spend(1)
            # An ear has no other vertex in it, its boundary included: cut off, it leaves a polygon without crossings.
            if turn(flat[i], flat[j], flat[l]) > 0 and not any(_within(flat, (i, j, l), whole, work)):
                found.append((i, j, l))
                del whole[k]
                at = k % len(whole)
                break
        else:
            # Every simple polygon has an ear; without one the loops were none.
            return None
    i, j, l = whole
    return [*found, (i, j, l)] if turn(flat[i], flat[j], flat[l]) > 0 else None


def _within(flat: Mapping[int, Flat], ear: Triangle, whole: Sequence[int], work: WorkLeft) -> Iterator[bool]:
    a, b, c = (flat[i] for i in ear)
    for k in (k for k in whole if k not in ear):
        work.spend(1)
        p = flat[k]
        yield turn(a, b, p) >= 0 and turn(b, c, p) >= 0 and turn(c, a, p) >= 0
