"""The sum K of the friction cones of held contacts, and its dual cone K* of twists, which prove what K cannot balance.

A twist v is in K* where it opens every contact at least as steeply as friction holds it, vₙ ≥ μ |vₜ| at the contact's
point: then v·k ≥ 0 for every force k of these contacts. Wrenches (f, τ/ρ) and twists (v, ρω) are scaled by the
characteristic length ρ.

By Farkas' lemma −F lies outside K just where some v ∈ K* has v·F > 0: forces of the contacts cannot balance F. One such
v speaks for a half-space of wrenches, so that a few of them prove whole ranges of directions. The steepest one is the
rest that is left of F when the nearest forces −k are taken off, v = F + k, by Moreau's theorem: v ∈ K*, v·k = 0.

Twists v (6,) that open a contact by some measure against sliding to any side e, vₙ + μ e·vₜ ≥ least, are cut out by the
half-spaces of rays vₙ + μ e·vₜ: a few of each contact to begin with, then those against the sliding of the answer so
far. The nearest twist of so many half-spaces is a quadratic program.
"""

import math
from dataclasses import dataclass

import numpy as np

from fmopt.contact.c_surface import sliding_maps
from fmopt.planning.control.compliance_frame import twist_scale
from fmopt.planning.optimise.cone_program import ConeProgram, Norm
from fmopt.planning.optimise.solvers import ClarabelSolver, nearest_point
from fmopt.spatial.se3 import length
from fmopt.spatial.values import Array, Value

_RAYS = 8  # of each cone, to begin with
_EXACT = 5e-10  # of the wrench, by which the answer may open contacts too little
_STILL = 1e-300  # a sliding that has no side
_ROUNDS = 50  # of cuts, and of twists each of which goes further, at most
_SAME = 1e-9  # relative change that settles an iteration
_NOTHING = 1e-3  # of the wrench: a smaller rest is none
_OPEN = 1e-4  # of unit twists: contacts that none opens by more may wedge
_INSIDE = 2e-6  # by which stated unit twists open every contact beyond friction
NEARLY = 2e-3  # rad: an angle so near to π is as good; a share of its power that a twist keeps
_DIGITS = 10  # of a stated number
_DOWN = 1e-12  # rad or share, by which what is proved is rounded


def nearest_opening(wrench: Array, normal: Array, tangent: Array, least: float) -> tuple[Array, bool]:
    """The scaled twist (6,) nearest to a scaled wrench that opens each contact by `least`, and whether it is settled.

    The wrench is (6,), the rest as in `FrictionCones`.
    """
    angles, size = np.arange(_RAYS) * (math.tau / _RAYS), length(wrench) or 1.0
    sides = np.column_stack([np.cos(angles), np.sin(angles)])
    rows = (normal[:, None] + np.einsum("rs,msk->mrk", sides, tangent)).reshape(-1, 6)
    for _ in range(_ROUNDS):
        found = nearest_point(wrench / size, rows, least / size)
        if found is None:
            break
        twist = size * found
        sliding = tangent @ twist
        speed = np.linalg.norm(sliding, axis=1)
        broken = normal @ twist - speed < least - _EXACT * max(length(twist), length(wrench))
        if not broken.any():
            return twist, True
        sides = -sliding[broken] / np.maximum(speed[broken], _STILL)[:, None]
        rows = np.vstack([rows, normal[broken] + np.einsum("ms,msk->mk", sides, tangent[broken])])
    return np.zeros(6), False


@dataclass(frozen=True, eq=False)
class FrictionCones(
    Value, normal=(None, 6), tangent=("normal", 2, 6), labels={n: f"{n} rows" for n in ("normal", "tangent")}
):
    """The friction cones of m held contacts, by what a scaled twist (6,) does at their points."""

    normal: Array  # (m, 6), normal velocity at a contact point, positive where the contact opens
    tangent: Array  # (m, 2, 6), its sliding velocity times the coefficient of friction
    rho: float

    @staticmethod
    def of(wrenches: Array, arms: Array, rho: float, friction: float) -> "FrictionCones":
        """Of contacts with normal wrenches (m, 6) of unit force, and arms (m, 3) from the reference point, m."""
        rows = friction * sliding_maps(wrenches[:, :3], arms)
        return FrictionCones(wrenches / twist_scale(rho), rows / twist_scale(rho), rho)

    def opening(self, twist: Array) -> Array:
        """vₙ − μ |vₜ| (m,) at the contacts for a scaled twist (6,): none negative for one in K*."""
        return np.asarray(self.normal @ twist - np.linalg.norm(self.tangent @ twist, axis=1))

    def rest(self, wrench: Array) -> Array:
        """What the nearest contact forces leave of a scaled wrench (6,): the twist of K* with the most power on it.

        Its length is the distance of the wrench from −K; a distance that is hardly any is none.

        Raises:
            SolverError: no solver settles it.
        """
        twist, settled = nearest_opening(wrench, self.normal, self.tangent, 0.0)
        if not settled:
            # The nearest twist of K* lies along the unit one with the most power, and is as long as that.
            unit = self._opened(wrench / length(wrench), 1.0, 0.0)[:6]
            twist = float(unit @ wrench) * unit
        return twist if length(twist) > _NOTHING * length(wrench) else np.zeros(6)

    def inner(self) -> Array | None:
        """The scaled unit twist (6,) that opens the least opened contact most; None where that is hardly any.

        It is along the shortest one that opens all by 1. Where there is none, forces inside the cones may balance each
        other whatever is applied: the contacts wedge.

        Raises:
            SolverError: no solver settles it.
        """
        twist, settled = nearest_opening(np.zeros(6), self.normal, self.tangent, 1.0)
        if not settled:
            twist = self._opened(np.zeros(6), 1.0, 1.0)[:6]
        size = length(twist)
        return twist / size if size > 0.0 and float(np.min(self.opening(twist / size))) > _OPEN else None

    def _opened(self, power: Array, longest: float, share: float) -> Array:
        """The scaled twist and t (7,) with the greatest power·v + share t, for |v| ≤ longest, t ≤ vₙ − μ |vₜ|, t ≤ 1.

        Without a share t is 0. Slower than cuts, but no symmetry of contacts keeps it from its optimum.
        """
        m = len(self.normal)
        lift = -np.ones((m, 1))
        norms = (*(np.hstack([rows, np.zeros((2, 1))]) for rows in self.tangent), np.eye(6, 7))
        program = ConeProgram(
            np.append(power, share),
            G=np.vstack([np.hstack([self.normal, lift]), np.zeros(7)]),
            h=np.append(np.zeros(m), longest),
            W=np.eye(m + 1),
            norms=tuple(Norm(rows, np.zeros(len(rows))) for rows in norms),
            lower=np.append(np.full(6, -np.inf), 0.0),
            upper=np.append(np.full(6, np.inf), 1.0 if share else 0.0),
        )
        return np.asarray(ClarabelSolver().solve(program).x)

    def turn(self, a: Array, d: Array) -> Array | None:
        """The scaled twist (6,) of K* that keeps power on a cos θ + d sin θ from 0 up to the greatest θ, or nearly π.

        Both are scaled wrenches (6,), of unit length, at right angles; None where a itself is balanced. From where one
        twist ends, the steepest one for the wrench there goes further.

        Raises:
            SolverError: no solver settles them.
        """
        first = best = self.rest(a)
        angle = 0.0
        if not length(first) > _NOTHING:
            return None
        for _ in range(_ROUNDS):
            reached = float(plane_angle(best, a, d))
            if not reached > angle + _SAME or reached > math.pi - NEARLY:
                break
            angle = reached
            further = self.rest(a * math.cos(angle) + d * math.sin(angle))
            if not length(further) > _NOTHING:
                break
            if not float(further @ a) > 0.0:
                lost = max(-float(further @ a), _NOTHING * length(further))
                return np.asarray(best + (1.0 - NEARLY) * float(best @ a) / lost * further)
            best = further
        # A little of the first twist keeps power on a itself, without which `plane_angle` grants nothing.
        return np.asarray(best / length(best) + 0.1 * NEARLY * first / length(first))

    def freeing(self, held: Array, along: Array) -> Array | None:
        """The scaled twist (6,) of K* that has power on held + b along for the least b; None where no b is free.

        Both are scaled wrenches (6,), `along` of unit length. From the steepest twist along the push on: at the least
        push of one, the steepest for the wrench needs less.

        Raises:
            SolverError: no solver settles them.
        """
        best, push = self.rest(along), math.inf
        if not length(best) > _NOTHING:
            return None
        for _ in range(_ROUNDS):
            needed = least_push(best, held, along)
            if not needed < push * (1.0 - _SAME):
                break
            push = needed
            wrench = held + push * along
            further = self.rest(wrench)
            steep = length(further) > _NOTHING * length(wrench)
            if not (steep and float(further @ along) > 0.0):
                break
            best = further
        return best

    def stated(self, twist: Array, inner: Array) -> Array:
        """A scaled twist (6,) of K* as a plan states it, unscaled: moved along an inner one by more than rounding."""
        unit = twist / length(twist)
        inside = unit + _INSIDE / float(np.min(self.opening(inner))) * inner
        rounded = np.where(np.abs(inside) < 10.0 ** -(_DIGITS + 1), 0.0, inside) / twist_scale(self.rho)
        return np.array([float(f"{x:.{_DIGITS}g}") for x in rounded])


def cone_angle(twist: Array, wrench: Array) -> float:
    """By what angle (rad) a scaled wrench (6,) may turn in any direction while a scaled twist (6,) has power on it."""
    sine = float(twist @ wrench) / (length(twist) * length(wrench))
    return float(_rounded_down(np.arcsin(min(sine, 1.0))))


def plane_angle(twists: Array, a: Array, d: Array) -> Array:
    """Angles θ (…), rad, up to which scaled twists (…, 6) have power on a cos θ + d sin θ, a and d unit wrenches.

    With power on a, that is up to cot θ = −v·d / v·a; 0 without.
    """
    ahead = twists @ a
    return np.where(ahead > 0.0, _rounded_down(np.arctan2(ahead, -(twists @ d))), 0.0)


def least_push(twist: Array, held: Array, along: Array) -> float:
    """Above what push b a scaled twist (6,) has power on held + b along, scaled (6,); infinite if none on along."""
    if not float(twist @ along) > 0.0:
        return math.inf
    push = -float(twist @ held) / float(twist @ along)
    return max(push + _DOWN * max(abs(push), 1.0), 0.0)


def _rounded_down(angle: Array) -> Array:
    return angle * (1.0 - _DOWN) - _DOWN
