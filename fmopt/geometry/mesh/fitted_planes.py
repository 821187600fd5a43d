"""Planes fitted to facets, made to belong together: along one frame, square, at equal turns, meeting in corners."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmopt.errors import GeometryError
from fmopt.geometry.facets import Indices, Loop, place
from fmopt.geometry.mesh.round_planes import Planes, rings
from fmopt.geometry.plane.turning import rotation
from fmopt.geometry.polyhedron import plane_basis
from fmopt.spatial.values import Array, Bits

EXACT = 1e-12  # m: what is this close to a plane lies in it
_LEAST_SLACK = 1e-12  # rad
_LEAST_LEAN = 1e-3  # of planes that are to fix a corner
_STRAY = 100.0  # times how far facets are off their planes: corners may move so far along an edge
_ROUNDS = 20  # of Newton's method
# Into how many parts a turn is divided by normals that belong together; 24 has thirds, sixths, eighths and twelfths.
_TURNS = (4, 24, 5, 7, 9, 11, 16, 18, 22, 32, 36)


@dataclass(frozen=True)
class Fits:
    """The planes that fit groups of points best, with the least largest distance for each normal (k, 3)."""

    normals: Array
    offsets: Array  # (k,), m
    widths: Array  # the least extent of each group in its plane (k,), m
    off: float  # how far any point lies off its plane at most, m

    @staticmethod
    def of(points: Array, groups: Sequence[Sequence[int] | Indices]) -> "Fits":
        """Fit a plane to each group of points (n, 3)."""
        normals, offsets, widths, off = np.empty((len(groups), 3)), np.empty(len(groups)), np.empty(len(groups)), 0.0
        for numbers, which in by_count(groups):
            centres = points[which].mean(axis=1)
            arms = points[which] - centres[:, None]
            own = np.linalg.eigh(np.swapaxes(arms, 1, 2) @ arms)[1]
            heights = (arms @ own[:, :, :1])[..., 0]
            low, high = heights.min(axis=1), heights.max(axis=1)
            normals[numbers], widths[numbers] = own[:, :, 0], np.ptp(arms @ own[:, :, 1:], axis=1).min(axis=1)
            offsets[numbers] = np.vecdot(own[:, :, 0], centres) + 0.5 * (low + high)
            off = max(off, 0.5 * float((high - low).max()))
        return Fits(normals, offsets, widths, off)


def by_count(groups: Sequence[Sequence[int] | Indices]) -> Iterator[tuple[NDArray[np.intp], Indices]]:
    """The numbers (m,) of groups that have equally many members, and these members (m, n)."""
    counts = np.array([len(group) for group in groups])
    for count in np.unique(counts):
        numbers = np.flatnonzero(counts == count)
        yield numbers, np.array([groups[k] for k in numbers.tolist()], dtype=np.int64)


def aligned(normals: Array, areas: Array, slack: Array, wide: Array) -> tuple[Array, Array]:
    """A frame (3, 3) along the faces, and the normals (k, 3) in it, exactly along, square, or at equal turns.

    Args:
        normals: (k, 3).
        areas: of the faces (k,), m².
        slack: by how much each normal may be turned (k,), rad.
        wide: the same where a whole ring of faces is turned, which then belong together (k,), rad.
    """
    z = _axis(normals, areas, slack)
    # Narrow facets may have a slack of a radian; nothing beyond 0.1 rad counts as along or across.
    parallel = np.abs(normals @ z) > np.cos(np.minimum(slack, 0.1))
    square = np.abs(normals @ z) < np.sin(np.minimum(slack, 0.1))
    sides = np.flatnonzero(square)
    first = normals[sides[np.argmax(areas[sides])]] if len(sides) else plane_basis(z)[:, 0]
    x = first - (first @ z) * z
    # By the least slack: the best known face must not be turned by more than it allows.
    turn = _near_axes(np.column_stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z]), slack.min())
    inside = normals @ turn
    if len(sides):
        angle = np.arctan2(inside[sides, 1], inside[sides, 0])
        base = _common_turn(angle, areas[sides], slack[sides])
        about_z = np.eye(3)
        about_z[:2, :2] = rotation(base)
        turn = turn @ about_z
        if np.abs(base) > 0.0:
            turn = _near_axes(turn, slack.min())
        inside = normals @ turn
    whole = _families(np.arctan2(inside[sides, 1], inside[sides, 0]), areas[sides], (slack[sides], wide[sides]))
    for k, angle in zip(sides.tolist(), whole.tolist(), strict=True):
        inside[k] = _direction(angle)
    for k in np.flatnonzero(parallel).tolist():
        inside[k] = (0.0, 0.0, math.copysign(1.0, inside[k, 2]))
    leaning = np.flatnonzero(~square & ~parallel)
    inside[leaning] = _leaning(inside[leaning], areas[leaning], wide[leaning], whole)
    return turn, inside


def _axis(normals: Array, areas: Array, slack: Array) -> Array:
    """The direction along or across which most of the faces lie."""
    large = np.argsort(-areas, kind="stable")[:12]
    choices = [normals[i] for i in large]
    crossed = [np.cross(normals[i], normals[j]) for n, i in enumerate(large[:6]) for j in large[:n]]
    choices += [axis / np.linalg.norm(axis) for axis in crossed if np.linalg.norm(axis) > 0.1]
    best, found = -1.0, choices[0]
    for axis in choices:
        lean = np.abs(normals @ axis)
        along, across = lean > np.cos(np.minimum(3.0 * slack, 0.1)), lean < np.sin(np.minimum(3.0 * slack, 0.1))
        # Of axes that hold the same area the one that more of it is square to.
        score = float(areas[along | across].sum() + 1e-6 * areas[along].sum())
        if score > best * (1.0 + 1e-9):
            # Least squares of n·z for sides and of the sine to z for ends, weighted by how well each normal is known.
            weight = areas / np.maximum(slack, _LEAST_SLACK) ** 2
            spread = np.einsum("k,ki,kj->ij", weight * across, normals, normals)
            spread += (weight * along).sum() * np.eye(3) - np.einsum("k,ki,kj->ij", weight * along, normals, normals)
            refined = np.linalg.eigh(spread)[1][:, 0]
            best, found = score, refined if refined @ axis > 0.0 else -refined
    return np.asarray(found)


def _near_axes(turn: Array, slack: float) -> Array:
    """The frame, along the model's axes where it is so but for the slack."""
    nearest = np.round(turn)
    alike = np.abs(turn - nearest).max() <= slack and np.array_equal(np.abs(nearest).sum(axis=0), np.ones(3))
    if alike:
        return np.asarray(nearest + 0.0)
    for k in range(3):  # one axis may lie along the model's
        axis = np.round(turn[:, k])
        if np.abs(turn[:, k] - axis).max() <= slack and np.abs(axis).sum() == 1.0:
            other = turn[:, (k + 1) % 3] - (turn[:, (k + 1) % 3] @ axis) * axis
            other /= np.linalg.norm(other)
            made = np.empty((3, 3))
            made[:, k], made[:, (k + 1) % 3], made[:, (k + 2) % 3] = axis, other, np.cross(axis, other)
            return made
    return turn


def _common_turn(angle: Array, areas: Array, slack: Array) -> float:
    """By how much side faces at equal turns from the largest are turned from it on average, rad."""
    parts, _ = _whole_parts(angle, slack)
    known = parts != angle
    weight = areas[known] / slack[known] ** 2
    whole = float(weight.sum())  # nothing where the only ones are facets without area
    return float(np.sum(weight * (angle - parts)[known])) / whole if whole > 0.0 else 0.0


def _families(angle: Array, areas: Array, slacks: tuple[Array, Array]) -> Array:
    """Angles (k,) of side faces about z, rad, at whole parts of a turn from each other where they are so but for slack.

    Those that go with x come first, then those that go with the largest of the others, and so on.
    """
    turns = (*_TURNS, len(angle), 2 * len(angle)) if len(angle) > 2 else _TURNS
    made, left, base = np.array(angle), np.arange(len(angle)), 0.0
    slack, wide = slacks
    for ring, step, spread in rings(angle, wide):
        off = angle[ring] - step * np.round(angle[ring] / step)
        # A mean on the circle of one step: what is off by nearly half a step either way lies together there.
        phase = math.atan2(float(np.sin(off * (math.tau / step)).mean()), float(np.cos(off * (math.tau / step)).mean()))
        phase *= step / math.tau
        # Three standard errors of the mean.
        error = 3.0 * spread / math.sqrt(len(ring))
        phase = float(_whole_parts(np.array([phase]), np.array([error]), (round(math.tau / step), *_TURNS))[0][0])
        made[ring] = phase + step * np.round((angle[ring] - phase) / step)
        left = np.setdiff1d(left, ring)
    while len(left):
        parts, near = _whole_parts(angle[left] - base, slack[left], turns)
        own, parts = left[near], parts[near]
        # x is the mean of its family already, by `_common_turn`.
        if base != 0.0:
            weight = areas[own] / np.maximum(slack[own], _LEAST_SLACK) ** 2
            base += float(weight @ (angle[own] - base - parts) / weight.sum())
        made[own], left = base + parts, left[~near]
        if len(left):
            base = float(angle[left[np.argmax(areas[left])]])
    return made


def _whole_parts(angle: Array, slack: Array, turns: Sequence[int] = _TURNS) -> tuple[Array, Bits]:
    """The whole parts of a turn nearest to angles (k,), of the first division that has one within the slack (k,).

    Angles without any stay as they are. The other value says which have one.
    """
    steps = np.array([2.0 * math.pi / parts for parts in turns])
    near = steps * np.round(angle[:, None] / steps)
    within = np.abs(angle[:, None] - near) <= slack[:, None]
    found = np.asarray(within.any(axis=1))
    return np.where(found, near[np.arange(len(angle)), within.argmax(axis=1)], angle), found


def _direction(angle: float) -> tuple[float, float, float]:
    """The unit vector at an angle from x about z, with exact zeros and ones."""
    quarter, rest = divmod(angle + 0.25 * math.pi, 0.5 * math.pi)
    rest -= 0.25 * math.pi
    c, s = (1.0, 0.0) if abs(rest) < 1e-14 else (math.cos(rest), math.sin(rest))
    x, y = ((c, s), (-s, c), (-c, -s), (s, -c))[int(quarter) % 4]
    return x + 0.0, y + 0.0, 0.0


def _leaning(normals: Array, areas: Array, slack: Array, sides: Array) -> Array:
    """Normals (k, 3) neither along z nor across it, with turns about z and slopes in common where they are so.

    Args:
        normals: (k, 3).
        areas: (k,), m².
        slack: (k,), rad.
        sides: angles about z of faces that are along it, rad.
    """
    level = np.hypot(normals[:, 0], normals[:, 1])
    around = _shared(np.arctan2(normals[:, 1], normals[:, 0]), areas, slack / np.maximum(level, 0.05), sides)
    slope = np.copysign(_shared(np.arctan2(np.abs(normals[:, 2]), level), areas, slack, np.zeros(0)), normals[:, 2])
    flat = np.array([_direction(angle) for angle in around.tolist()]).reshape(-1, 3)
    return np.asarray(np.cos(slope)[:, None] * flat + np.outer(np.sin(slope), (0.0, 0.0, 1.0)))


def _shared(angle: Array, areas: Array, slack: Array, known: Array) -> Array:
    """Angles (k,), rad: half-turns from known ones, whole parts of a turn, or half-turns from the mean of like ones."""
    (made, _), like = _whole_parts(angle, slack), np.full(len(angle), -1)
    alone = made == angle
    for k in np.argsort(-areas, kind="stable").tolist():
        near = known[np.argmin(_off_half_turn(angle[k] - known))] if len(known) else angle[k]
        if len(known) and _off_half_turn(angle[k] - near) <= slack[k]:
            made[k] = near + math.pi * round((angle[k] - near) / math.pi)
        elif alone[k]:
            others = np.flatnonzero((like >= 0) & (_off_half_turn(angle - angle[k]) <= slack[k]))
            like[k] = like[others[0]] if len(others) else k
    for first in np.unique(like[like >= 0]):
        own = np.flatnonzero(like == first)
        beyond = math.pi * np.round((angle[own] - angle[first]) / math.pi)
        weight = areas[own] / np.maximum(slack[own], _LEAST_SLACK) ** 2
        made[own] = float(weight @ (angle[own] - beyond)) / float(weight.sum()) + beyond
    return made


def _off_half_turn(angle: Array) -> Array:
    return np.asarray(np.abs(angle - math.pi * np.round(np.asarray(angle) / math.pi)))


def corners_of(points: Array, faces: Sequence[Sequence[Loop]], planes: Planes, off: float, frame: Array) -> Array:
    """The points with the corners of the faces moved into all of their planes.

    Where more than three planes meet, offsets give way; where that is not enough, normals that are neither along z nor
    across it as well.

    Args:
        points: (n, 3), m.
        planes: unit normals (k, 3) and offsets (k,) in m, a row a face.
        off: how far a corner may move, m.
        frame: (3, 3), of the points in the mesh, where places in messages are.

    Raises:
        GeometryError: there is no such place near a corner; names it.
    """
    around: dict[int, list[int]] = {}
    for number, loops in enumerate(faces):
        for vertex in {vertex for loop in loops for vertex in loop}:
            around.setdefault(vertex, []).append(number)
    normals, offsets = planes
    if any(len(own) > 3 for own in around.values()):
        normals, offsets = _agreed(points, around, planes)
    vertices = np.array(list(around))
    moved, lean, missed = points[vertices], np.zeros(len(vertices)), np.zeros(len(vertices))
    for numbers, own in by_count(list(around.values())):
        if own.shape[1] < 3:
            continue
        rows, wanted, found = normals[own], offsets[own], moved[numbers]
        lean[numbers] = np.linalg.svd(rows, compute_uv=False)[:, 2]
        inverse = np.linalg.pinv(rows)
        # Once more for what rounding left.
        for _ in range(2):
            found += np.einsum("nij,nj->ni", inverse, wanted - np.einsum("nij,nj->ni", rows, found))
        # Across an axis the coordinate is the offset to the bit, not but for the rounding of a solution.
        one, plane = np.nonzero(np.count_nonzero(rows, axis=2) == 1)
        found[one, np.abs(rows[one, plane]).argmax(axis=1)] = rows[one, plane].sum(axis=1) * wanted[one, plane]
        missed[numbers] = np.abs(np.einsum("nij,nj->ni", rows, found) - wanted).max(axis=1)
        moved[numbers] = found
    strayed = np.linalg.norm(moved - points[vertices], axis=1) > _STRAY * max(off, EXACT)
    if len(bad := np.flatnonzero((lean < _LEAST_LEAN) | (missed > EXACT) | strayed)):
        at = place(frame @ points[vertices[bad[0]]])
        if lean[bad[0]] < _LEAST_LEAN:
            raise GeometryError(f"the faces at {at} are {1e6 * off:.3g} µm off planes that meet there")
        raise GeometryError(f"the faces at {at} have no corner in common near it")
    whole = np.array(points)
    whole[vertices] = moved
    return whole


def _agreed(points: Array, around: dict[int, list[int]], planes: Planes) -> Planes:
    """Normals and offsets of planes (k,) that meet in corners, changed by as little as does it, by Newton's method.

    Unknown are corners and offsets, and where these alone do not do it, normals that are neither along z nor across it;
    the step is the shortest one that solves the linear equations n·v = o.
    """
    leaning = (planes[0][:, 2] != 0.0) & (np.abs(planes[0][:, 2]) != 1.0)
    (normals, offsets), off = _met(points, around, planes, np.zeros_like(leaning))
    return (normals, offsets) if off <= 0.1 * EXACT else _met(points, around, planes, leaning)[0]


def _met(points: Array, around: dict[int, list[int]], planes: Planes, free: Bits) -> tuple[Planes, float]:
    """As `_agreed`, with the normals free that are said to be (k,); and how far corners are off their planes, m."""
    from scipy.sparse import coo_array, diags_array, eye_array
    from scipy.sparse.linalg import splu

    normals, offsets = np.array(planes[0]), np.array(planes[1])
    vertices = np.array(sorted(around))
    at, face = np.array([(i, f) for i, v in enumerate(vertices.tolist()) for f in around[v]]).T
    row = np.arange(len(at))
    moved = points[vertices]
    size = float(np.linalg.norm(np.ptp(moved, axis=0)))
    first = 3 * len(vertices)
    # As variances: planes give way a tenth of what corners do, normals by what moves a point `size` away as much.
    weights = np.concatenate([np.ones(first), np.full(len(offsets), 0.1), np.repeat(0.1 / size**2 * free, 3)])
    weigh = diags_array(weights)
    for _ in range(_ROUNDS):
        missed = np.einsum("ij,ij->i", normals[face], moved[at]) - offsets[face]
        off = float(np.abs(missed).max())
        if off <= 0.1 * EXACT:
            break
        columns = [
            *(3 * at + k for k in range(3)),
            first + face,
            *(first + len(offsets) + 3 * face + k for k in range(3)),
        ]
        values = [*normals[face].T, -np.ones(len(at)), *moved[at].T]
        slope = coo_array(
            (np.concatenate(values), (np.tile(row, 7), np.concatenate(columns))), shape=(len(at), len(weights))
        ).tocsr()
        # The small multiple of the identity keeps it regular where rows depend on each other.
        square = (slope @ weigh @ slope.T + 1e-12 * eye_array(len(at))).tocsc()
        try:
            step = -(weigh @ (slope.T @ splu(square).solve(missed)))
        except RuntimeError as error:  # of weights that are not numbers, as where faces have no area
            raise GeometryError("its faces have no corners in common") from error
        moved = moved + step[:first].reshape(-1, 3)
        offsets = offsets + step[first : first + len(offsets)]
        normals = normals + step[first + len(offsets) :].reshape(-1, 3)
        length = np.linalg.norm(normals[free], axis=1)
        normals[free] /= length[:, None]
        offsets[free] /= length
    return (normals, offsets), off
