"""The compliance frame of held contacts, and its position- and force-controlled axes.

Scaled by the characteristic length ρ, a twist (v, ω) reads (v, ρω) and a wrench (f, τ) reads (f, τ/ρ): power is the
plain product of the two, and the space of motions that held contacts allow is the orthogonal complement of the space
that their wrenches span. [DakinPopplestone1993] section 3.1.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fmopt.spatial.se3 import Pose, cross, hat, length
from fmopt.spatial.values import Array, Bits, Indices, Value

_RANK = 1e-6  # singular values of unit rows below this are zero
_FREE = 1e-6  # of unit twists: a smaller part is none
_ALIGNED = 2e-12  # sine between an axis of the frame and a space that still holds it


@dataclass(frozen=True, eq=False)
class Axes(Value, position=(None, 6), force=(None, 6), labels={n: f"{n} axes" for n in ("position", "force")}):
    """Position axes, twists (6 − r, 6), and force axes, wrenches (r, 6), in the coordinates of one frame.

    Position axes are orthonormal in the metric diag(1, 1, 1, ρ², ρ², ρ²), force axes in its dual; each position axis
    is reciprocal to each force axis. `aligned` counts those that lie along or about an axis of the frame.
    """

    position: Array
    force: Array
    aligned: int


def twist_scale(rho: float) -> Array:
    """Factors (6,) that make twists comparable, (1, 1, 1, ρ, ρ, ρ); wrenches take their reciprocals."""
    return np.array([1.0, 1.0, 1.0, rho, rho, rho])


def row_space(wrenches: Array, rho: float) -> Array:
    """Orthonormal basis (r, 6) of the space of scaled wrenches that rows (m, 6), N and N·m of any size, span."""
    rows = wrenches / twist_scale(rho)
    if not len(rows):
        return rows
    _, size, basis = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True), full_matrices=False)
    return np.asarray(basis[size > _RANK])


def free_part(V: Array, basis: Array) -> Array | None:
    """The part of a scaled unit twist (6,) that is free of orthonormal rows (r, 6); None where hardly any is."""
    free = V - basis.T @ (basis @ V)
    return np.asarray(free) if float(np.linalg.norm(free)) > _FREE else None


def axes(wrenches: Array, rho: float) -> Axes:
    """Sparse position and force axes of contact wrenches (m, 6), N and N·m per N, in the coordinates of a frame.

    They are axes of the frame where the spaces hold them, reduced echelon rows for the rest.
    """
    basis = row_space(wrenches, rho)
    projector = basis.T @ basis
    aligned, held = _along_axes(projector), np.diag(projector) > 0.5  # 1 or 0 for aligned ones
    forced, free, rest = np.flatnonzero(aligned & held), np.flatnonzero(aligned & ~held), np.flatnonzero(~aligned)
    inner = projector[np.ix_(rest, rest)]
    scale = twist_scale(rho)
    force = np.vstack([np.eye(6)[forced], _spread(_sparse(inner), rest)])
    position = np.vstack([np.eye(6)[free], _spread(_sparse(np.eye(len(rest)) - inner), rest)])
    return Axes(position / scale, force * scale, forced.size + free.size)


def compliance_frame(wrenches: Array, points: Array, reference: Pose, rho: float) -> Pose:
    """The frame in which most freedoms of held contacts, with wrenches (m, 6) and points (m, 3) in B, lie along axes.

    Tried are the axes of the B-frame, of the moving part, and of each contact normal with another one or an axis of the
    B-frame, at the reference point and at each point; of equals the first. Wrenches are about the reference point,
    points (m) those of contacts and other places through which contacts push.
    """
    orientations = np.array(list(_orientations(wrenches, reference.R)))
    best, most = Pose(reference.p, np.eye(3)), -1
    for origin in [reference.p, *points]:
        basis = row_space(wrenches_in(Pose(origin, np.eye(3)), wrenches, reference), rho)
        aligned = _along_axes(_turned(basis.T @ basis, orientations)).sum(axis=1)
        first = int(aligned.argmax())
        if aligned[first] > most:
            best, most = Pose(origin, orientations[first]), int(aligned[first])
        if most == 6:
            break
    return best


def wrenches_in(frame: Pose, wrenches: Array, reference: Pose) -> Array:
    """Wrenches (m, 6) about the reference point, axes of B, N and N·m, in the coordinates of a frame."""
    force, torque = wrenches[:, :3], wrenches[:, 3:]
    moved = torque - force @ hat(frame.p - reference.p).T
    return np.hstack([force @ frame.R, moved @ frame.R])


def _turned(projector: Array, orientations: Array) -> Array:
    """A projector (6, 6) onto a space of scaled wrenches in the axes of other orientations (k, 3, 3): (k, 6, 6)."""
    blocks = projector.reshape(2, 3, 2, 3).swapaxes(1, 2)
    turned = orientations.swapaxes(1, 2)[:, None, None] @ blocks @ orientations[:, None, None]
    return np.asarray(turned.swapaxes(2, 3).reshape(-1, 6, 6))


def _along_axes(projector: Array) -> Bits:
    """Which axes (…, 6) of the frame lie in the space that a projector (…, 6, 6) leaves, or at right angles to it."""
    across = np.eye(6) - projector
    off = np.minimum(np.vecdot(projector, projector), np.vecdot(across, across))
    return np.asarray(off <= _ALIGNED**2)


def _orientations(wrenches: Array, body: Array) -> Iterator[Array]:
    """Axes of B, of the body, and of contact normals, each normal standing for the axis of B that it is nearest to."""
    yield np.eye(3)
    if np.abs(body - np.eye(3)).max() > 1e-12:
        yield body
    normals: list[Array] = []
    for force in wrenches[:, :3]:
        size = length(force)
        if size > 0.0 and not any(abs(force @ n) > (1.0 - 1e-12) * size for n in normals):
            normals.append(force / size)
    for first in normals:
        for other in [*normals, *np.eye(3)]:
            second = other - (other @ first) * first
            size = length(second)
            if size > 1e-3:  # next to parallel directions fix no frame
                yield _near_axes(first, second / size)


def _near_axes(first: Array, second: Array) -> Array:
    """The rotation with two of its columns along the orthonormal directions, places and signs chosen near to 1."""
    k = int(np.abs(first).argmax())
    j = (k + 1) % 3 if abs(second[(k + 1) % 3]) >= abs(second[(k + 2) % 3]) else (k + 2) % 3
    R = np.empty((3, 3))
    R[:, k] = first * math.copysign(1.0, first[k])
    R[:, j] = second * math.copysign(1.0, second[j])
    R[:, 3 - k - j] = cross(R[:, k], R[:, j]) * (1.0 if (j - k) % 3 == 1 else -1.0)  # right-handed
    return R


def _sparse(projector: Array) -> Array:
    """Orthonormal rows of the projector's range, from its reduced row echelon form with largest pivots."""
    if not projector.size:
        return projector
    values, vectors = np.linalg.eigh(projector)
    rows = vectors[:, values > 0.5].T.copy()  # a projector's are 0 and 1
    for k in range(len(rows)):
        i, j = divmod(int(np.argmax(np.abs(rows[k:]))), rows.shape[1])
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        taken = rows[:, j].copy()
        taken[k] = 0.0
        rows -= np.outer(taken, rows[k])
    q, r = np.linalg.qr(rows.T)
    signed = (q * np.sign(np.diag(r))).T  # qr leaves signs open: those of the echelon rows are kept
    return np.where(np.abs(signed) < 1e-15, 0.0, signed)


def _spread(rows: Array, columns: Indices) -> Array:
    full = np.zeros((len(rows), 6))
    full[:, columns] = rows
    return full
