"""Wrenches placed by cone programs: they lead away from contacts short of a state, and hold the part in that state.

For a fixed wrench each set of contacts has a cone program over its escape twist; for fixed twists one over the wrench.
They alternate, and a wrench is taken only if the margin that is computed again rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.solvers import ClarabelSolver
from fmopt.planning.press.placed.touches import PressWrench, Touches, escape, escaped, largest_friction
from fmopt.spatial.values import Array

_RISES = 1e-3  # of friction and margin, by which a round counts
_WITHIN = 0.95  # of the largest friction, at which escapes leave a margin
_LEADS = 0.1  # margin of a direction into a corner that is enough for both walls
_OUT = 1e-6  # of friction, by which a solution of the cone program may be off


@dataclass(frozen=True, eq=False)
class PlacedPush:
    """A push with the friction up to which the part escapes from contacts short of a state, and its margin there.

    The margin is the least of the powers along unit twists that escape, and of the normal forces that hold the part in
    the state without friction, as a share of the push.
    """

    push: PressWrench
    friction: float
    margin: float
    twists: tuple[Array, ...]

    def better_than(self, other: PlacedPush) -> bool:
        """Whether it escapes up to a larger friction, or up to the same one with a larger margin."""
        if abs(self.friction - other.friction) > _RISES:
            return self.friction > other.friction
        return self.margin > other.margin + _RISES


def placed_push(push: PressWrench, short: Sequence[Touches], held: Touches, friction: float) -> PlacedPush:
    """The push that leads away best, up to enough friction, from each set of contacts `short` of those `held`."""
    best = _placed(push, short, held, friction)
    while best.twists:
        w = ClarabelSolver().proposed(strongest(best.push, best.twists, held))[:-1]
        found = _placed(replace(push, wrench=push.whole(w * push.size)), short, held, friction)
        if not found.better_than(best):
            break
        best = found
    return best


@cache
def stroke(turn: float, friction: float) -> tuple[bool, float]:
    """Whether one push into a corner of an exterior angle, rad, leads away from both walls, between which it points.

    Also the angle, rad, from that push to the one which leads away from the first wall best.
    """
    normals = np.array([[-math.cos(0.5 * turn), sign * math.sin(0.5 * turn), 0.0] for sign in (1.0, -1.0)])
    held = Touches.at(("one", "other"), np.zeros(2), normals, np.zeros((2, 3)))
    push, walls = PressWrench(np.eye(6)[0], np.arange(6) < 2, 1.0), [held.some([k]) for k in range(2)]
    mean, (x, y) = placed_push(push, walls, held, friction), placed_push(push, walls[:1], held, friction).push.free
    return bool(mean.friction >= friction - _RISES and mean.margin >= _LEADS), math.atan2(y, x)


def strongest(push: PressWrench, twists: Sequence[Array], held: Touches) -> ConeProgram:
    """The program over a scaled wrench of size 1 and the margin: power along twists, and normal forces that hold."""
    towards = np.array([(one * push.scale)[push.gives] for one in twists])
    rows = np.vstack([towards / np.linalg.norm(towards, axis=1, keepdims=True), -_answers(push, held)])
    n = rows.shape[1]
    G = np.vstack([np.hstack([rows, -np.ones((len(rows), 1))]), np.zeros(n + 1)])
    W, h = np.zeros((len(G), 1)), np.zeros(len(G))
    W[-1] = h[-1] = 1.0
    return ConeProgram(np.eye(n + 1)[-1], G=G, h=h, W=W, norms=(Norm(np.eye(n, n + 1), np.zeros(n)),))


def _answers(push: PressWrench, held: Touches) -> Array:
    """Normal forces (k, n) that hold against unit forces on the axes that give way."""
    return np.asarray(np.linalg.pinv(push.rows(held.N).T))


def _placed(push: PressWrench, short: Sequence[Touches], held: Touches, friction: float) -> PlacedPush:
    """A push with its friction and its margin there, a little below that friction where it is not enough."""
    reached = min(largest_friction(one, push, friction)[0] for one in short)
    if reached < 0.0:
        return PlacedPush(push, reached, -1.0, ())
    at = friction if reached >= friction - _RISES else _WITHIN * reached
    twists = [push.twist(ClarabelSolver().proposed(escape(one, push, at))[:-1]) for one in short]
    powers = [push.wrench @ one / (push.size * np.linalg.norm(one * push.scale)) for one in twists]
    if any(escaped(one, push, twist) < at - _OUT for one, twist in zip(short, twists, strict=True)):
        return PlacedPush(push, reached, -1.0, ())
    return PlacedPush(push, reached, min(*powers, *(-_answers(push, held) @ push.free / push.size)), tuple(twists))
