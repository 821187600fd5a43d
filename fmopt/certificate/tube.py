"""The tube of errors along a piece of motion, compiled: how rows bend, the box of all errors, the set at the goal.

What is computed is said in `curvature` and `segment`, whose letters these are.
"""

import math
from typing import NamedTuple

import numpy as np

from fmopt.certificate.kernels_ellipsoids import extent, mapped, narrow, outer_sum, radius, spread
from fmopt.certificate.kernels_rows import Bending, end_of, power, reach, remainder, together, unsteady
from fmopt.runtime.compiled import compiled, part
from fmopt.spatial.kernels import halves, size
from fmopt.spatial.values import Array

_ROUNDS = 80
_FAR = 0.5  # m or rad; errors as wide as this certify nothing
_ALLOWANCE = 4e-15  # m or rad; what the independent check adds to the bounds of errors before it uses them
_SETTLED = 2e-13  # relative rounding of the computed bounds of errors
_TIGHT = 5e-11  # relative: bounds as near to the computed ones as the check asks
_ABOVE = 1e-11  # stated bounds of errors exceed the computed ones by about this share

SETTLED, PAST, LARGE, THICK = range(4)
"""What comes of a piece: its errors settle; they could carry the part past its contact; they are too large for it; the
contact surfaces are too thick."""


class ThicknessLayers(NamedTuple):
    """What the thickness of contact surfaces at both ends of a piece is made up of, whatever the errors."""

    # Rows of the held basis (h), and on the last piece that of the contact being made, along the piece (r)
    bending: Bending
    f: Array  # values (h,) of the rows of those held at the start, m
    N: Array  # their gradients (h, 6)
    off: Array  # how far the nominal pose at the goal is off the surfaces (r,), m
    residue: Array  # what rounding leaves of the made one under the projection, per m and per rad (2,)
    start_dual: Array  # T^S (6, h), dual to the rows at the start
    goal_dual: Array  # T^G (6, r), dual to those at the goal
    shares: Array  # of the rows (r,) in what says how far the execution goes until it touches, 1 of the made one
    form: Array  # what tolerances of form add to the thickness of each (r,), m


class Numbers(NamedTuple):
    """A piece of motion, in numbers."""

    length: float  # L in the metric of ρ, m
    turn: float
    rate: float  # how much nearer the contact being made comes, m; 0 without one
    leaning: float  # |turning part of N′|, m
    share: float
    rates: tuple[float, float]  # velocity errors per unit of length, in translation and in angle (1/m)
    seen: Array  # N′ (6,)
    projector: Array  # Π (6, 6)


class StartRoots(NamedTuple):
    """A start set without its old thickness, in the roots of its parts."""

    core: Array  # generators (k, 6)
    slide: Array  # root (6, a) of the drift in translation
    swing: Array  # root (6, b) of the drift in rotation
    shape: Array  # root (6, s) of the shape
    moved: Array  # the generators (k, 6) as the motion alone would carry them on, before contacts take errors up
    moved_shape: Array  # root (6, s′) of the shape, likewise
    links: Array  # sizes of the errors in different frames (5,), see `coupled`


@compiled
def left(bending: Bending, half: Array, coupling: Array) -> Array:
    """What the linear picture of rows leaves over a piece (k,), m, with errors up to `half` (6,); see `coupled`."""
    table, turned, twist = bending.table, bending.turned, halves(bending.twist)
    found, box = np.empty(len(table)), halves(half)
    for i in range(len(table)):
        start, goal = end_of(turned, 0, i), end_of(turned, 1, i)
        found[i] = remainder(table[i], (start, goal), twist, box)
        found[i] += coupling[0] + coupling[1] * reach(table[i], start, goal)
    return found


@compiled
def varied(bending: Bending, half: Array, motion: Array) -> Array:
    """Bounds (k,) of how much N·v may differ between poses of a piece, errors included, m.

    The box around the errors has half-widths (6,), v is (6,).
    """
    table, turned = bending.table, bending.turned
    (move, turn), (offset, angles), (slide, spin) = halves(bending.twist), halves(half), halves(motion)
    apart, lengths = (size(offset) + size(move), size(angles) + size(turn)), (size(slide), size(spin))
    found = np.empty(len(table))
    for i in range(len(table)):
        arm = reach(table[i], end_of(turned, 0, i), end_of(turned, 1, i))
        found[i] = unsteady(table[i], arm, lengths, apart)
    return found


@compiled
def powers(bending: Bending) -> Array:
    """How N·V, V the twist, changes with the error at the start, to first order: rows (k, 6)."""
    move, turn = halves(bending.twist)
    found = np.empty((len(bending.table), 6))
    for i in range(len(found)):
        moving, spinning = power(bending.table[i], end_of(bending.turned, 0, i), move, turn)
        for j in range(3):
            found[i, j], found[i, 3 + j] = moving[j], spinning[j]
    return found


@part
def _coupled(links: Array, offset: float, angle: float, turn: float) -> tuple[float, float]:
    """What `coupled` gives for bounds of translation (m) and angle (rad); see `certificate.error_set`."""
    shift, askew, off, slant, travel = links[0], links[1], links[2], links[3], links[4]
    moved, a, arc = offset + shift + askew * travel + off, angle + askew + slant, turn * turn / 8.0
    c = a + slant
    straight = 0.5 * askew * askew * travel + askew * (moved + off) + (a + arc) * off
    return straight, 0.5 * a * slant * (1.0 + c) + 0.5 * askew * c * (1.0 + askew + c) + arc * slant


@compiled
def coupled(links: Array, half: Array, turn: float) -> Array:
    """What the linear picture leaves of errors in different frames (2,), m and rad.

    The links are sizes of h_p, h, g_p and g_r, and P (5,), m and rad, all zero where errors are fixed in one frame; the
    half-widths (6,) are of a box around the errors, m and rad, and the turn is that of the piece, rad.
    """
    found = np.zeros(2)
    if links[0] + links[1] + links[2] + links[3] > 0.0:
        offset, angle = size((half[0], half[1], half[2])), size((half[3], half[4], half[5]))
        found[0], found[1] = _coupled(links, offset, angle, turn)
    return found


@part
def _grown(
    half: Array, layers: ThicknessLayers, rest: Array, way: Numbers, late: tuple[float, float], links: Array
) -> tuple[int, Array, float, tuple[float, float], Array]:
    """What follows from half-widths (6,) of all errors.

    Args:
        half: the half-widths, m and rad.
        rest: what does not depend on the half-widths, of the thickness of each (r,), m.
        late: how much the errors at the start and the drift delay the contact that is made, as a share of the piece.
        links: sizes of the errors in different frames (5,), see `coupled`.

    Returns:
        how it ends, thickness of the contacts at the goal (r,), overtravel, radii of the drift, of the translation and
        of the angle with the turn's second order (m, rad), and what the linear picture leaves of different frames (2,).
    """
    far, turn, rate, leaning, share, rates = way.length, way.turn, way.rate, way.leaning, way.share, way.rates
    held, residue = len(layers.f), layers.residue
    box = half + _ALLOWANCE
    theta = size((box[3], box[4], box[5]))
    # Bounds of translation and angle with their drift, before contacts take it up.
    wide, wider = size((box[0], box[1], box[2])) + 2.0 * rates[0] * far, theta + 2.0 * rates[1] * far
    coupling = coupled(links, box, turn)
    final = left(layers.bending, box, coupling)
    for i in range(len(final)):
        final[i] += rest[i] if i < held else rest[i] + residue[0] * wide + residue[1] * wider
    beyond, nothing = 0.0, (0.0, 0.0)
    if rate > 0.0:
        room = 1.0 - share * (late[1] + 0.75 * wider * turn * leaning / rate)
        if room < 0.5:
            return PAST, final, beyond, nothing, coupling
        delayed = 0.0
        if len(final) > held:
            # The execution goes on until all rows together say that it touches: what they share does not delay it.
            off = together(layers.bending, layers.shares, rest, box, coupling)
            delayed = (off + residue[0] * wide + residue[1] * wider) / rate
        beyond = (share * (late[0] + late[1]) + delayed) / room
    gone = far * (1.0 + beyond)
    a, b, swung = rates[0] * gone, rates[1] * gone, beyond * turn
    if beyond > 1.0 or theta + b + swung > _FAR:
        return LARGE, final, beyond, nothing, coupling
    return SETTLED, final, beyond, (a, b + 0.5 * (theta + b) * swung * (1.0 + theta + b + swung)), coupling


@part
def _drifted(far: float, drifts: Array) -> tuple[float, float]:
    """Of what a drift is made up, the carried one and a unit's (2, 7), in squares; see `outer_sum` and `spread`."""
    s1, s2 = math.sqrt(drifts[0, 6]), far * math.sqrt(drifts[1, 6])
    if s1 == 0.0:
        return 0.0, far * far
    if s2 == 0.0:
        return 1.0, 0.0
    return 1.0 + s2 / s1, (1.0 + s1 / s2) * far * far


@part
def _boxes(core: Array, image: Array, slide: Array, swing: Array) -> Array:
    """Half-widths (3, 6): of the start set without thickness, of its carried core alone, and to begin with.

    What errors are at the start is a good first guess, and too wide where the motion takes much of their drift away.
    """
    found = np.empty((3, 6))
    for i in range(6):
        start, goal = np.abs(core[:, i]).sum(), np.abs(image[:, i]).sum()
        width = math.sqrt((slide[i] * slide[i]).sum()) + math.sqrt((swing[i] * swing[i]).sum())
        found[0, i], found[1, i], found[2, i] = start + width, goal, max(start, goal) + width
    return found


@part
def _widths(
    final: Array, radii: tuple[float, float], boxes: Array, drifts: Array, layers: ThicknessLayers, coupling: Array
) -> Array:
    """Half-widths (6,) of the box around the errors at both ends."""
    held, start_dual, goal_dual = len(layers.f), layers.start_dual, layers.goal_dual
    (x, y), (z, w) = _drifted(radii[0], drifts[0]), _drifted(radii[1], drifts[1])
    found = np.empty(6)
    for i in range(6):
        own, slid = boxes[0, i], math.sqrt(x * drifts[0, 0, i] + y * drifts[0, 1, i])
        after = boxes[1, i] + slid + math.sqrt(z * drifts[1, 0, i] + w * drifts[1, 1, i])
        for k in range(held):
            own += abs(start_dual[i, k]) * final[k]
        for k in range(len(final)):
            after += abs(goal_dual[i, k]) * final[k]
        found[i] = max(own, after) + coupling[i // 3]
    return found


@part
def _raised(half: Array, wider: Array) -> tuple[bool, bool]:
    """Raises half-widths (6,) to those computed with them; whether any was short, and whether all are tight."""
    short = (wider > half * (1.0 - _SETTLED)).any()
    close, tight = (wider <= half * (1.0 + 10.0 * _ABOVE)).all(), (half <= wider * (1.0 + _TIGHT)).all()
    for i in range(6):
        if wider[i] > half[i] * (1.0 - _SETTLED):
            # Close to the fixed point a little is added, that rounding does not matter.
            half[i] = max(half[i], wider[i]) * (1.0 + _ABOVE if close else 1.0)
    return bool(short), bool(tight)


@compiled
def carried(
    layers: ThicknessLayers, way: Numbers, errors: StartRoots, rho: float
) -> tuple[int, Array, Array, float, Array, Array, Array, Array]:
    """Carries an error set through a piece of motion; see `segment`.

    Returns:
        how it ends; half-widths (6,) of a box around the errors all along; thickness of the contacts at the goal (r,);
        overtravel; and generators (k + r, 6), roots of both drifts (6, …) and of the shape (6, s′) at the goal.
    """
    core, slide, swing, shape, moved, moved_shape, links = errors
    N, seen, projector, rates = layers.N, way.seen, way.projector, way.rates
    image = mapped(projector, moved.T).T
    slide_there, swing_there = mapped(projector, slide), mapped(projector, swing)
    shape_there = mapped(projector, moved_shape)
    rest = layers.off.copy()
    for k in range(len(layers.f)):
        along = min(extent(N[k], core, slide, swing), radius(N[k], shape))
        rest[k] = max(abs(layers.f[k]) + along, rest[k])
    rest += layers.form
    drifts, boxes = spread(slide_there, swing_there, projector, rho), _boxes(core, image, slide, swing)
    late = (0.0, 0.0)
    if way.rate > 0.0:
        leaning = size((seen[0], seen[1], seen[2])) * rates[0] + way.leaning * rates[1]
        late = (extent(seen, moved, slide, swing) / way.rate, leaning * way.length / way.rate)
    radii, code, final, beyond, half = (0.0, 0.0), THICK, rest, 0.0, np.empty(6)
    for attempt in range(2):
        for i in range(6):  # at first from what is likely; where that is not tight, from below
            half[i] = boxes[2, i] if attempt == 0 else max(boxes[0, i], boxes[1, i])
        code, tight = THICK, False
        for _ in range(_ROUNDS):
            code, final, beyond, radii, coupling = _grown(half, layers, rest, way, late, links)
            if code != SETTLED:
                break
            short, tight = _raised(half, _widths(final, radii, boxes, drifts, layers, coupling))
            if not short:
                break
            code = THICK
            if half.max() > _FAR:
                break
        if code != SETTLED or tight:
            break
    generators = np.empty((len(core) + len(final), 6))
    if code != SETTLED:
        return code, half, final, beyond, generators, slide_there, swing_there, shape_there
    slid, swung = radii[0] * projector[:, :3], radii[1] * projector[:, 3:]
    slide_there, swing_there = outer_sum(slide_there, slid, rho), outer_sum(swing_there, swung, rho)
    shape_there = outer_sum(outer_sum(shape_there, slid, rho), swung, rho)
    thick = layers.goal_dual * final
    generators[: len(core)] = image
    generators[len(core) :] = thick.T
    thick *= math.sqrt(len(final))
    shape_there = outer_sum(shape_there, thick, rho)
    return code, half, final, beyond, generators, narrow(slide_there), narrow(swing_there), narrow(shape_there)
