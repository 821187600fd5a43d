"""The sum K of the friction cones of held contacts, and its dual cone K* of twists, which prove what K cannot balance.

A twist v is in K* where it opens every contact at least as steeply as friction holds it, vₙ ≥ μ |vₜ| at the contact's
point: then v·k ≥ 0 for every force k of these contacts. Wrenches (f, τ/ρ) and twists (v, ρω) are scaled by the
characteristic length ρ.

By Farkas' lemma −F lies outside K just where some v ∈ K* has v·F > 0: forces of the contacts cannot balance F. One such
v speaks for a half-space of wrenches, so that a few of them prove whole ranges of directions. The steepest one is the
rest that is left of F when the nearest forces −k are taken off, v = F + k, by Moreau's theorem: v ∈ K*, v·k = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fmopt.control.compliance import twist_scale
from fmopt.control.opening import nearest_opening
from fmopt.geometry.polyhedron import plane_basis
from fmopt.placement.program import ConeProgram, Norm
from fmopt.placement.socp import ClarabelSolver
from fmopt.se3 import cross, length
from fmopt.values import Array, Value, frozen

_ROUNDS = 50
_SAME = 1e-9  # relative change that settles an iteration
_NOTHING = 1e-3  # of the wrench: a smaller rest is none
_OPEN = 1e-4  # of unit twists: contacts that none opens by more may wedge
_INSIDE = 2e-6  # by which stated unit twists open every contact beyond friction
NEARLY = 2e-3  # rad: an angle so near to π is as good; a share of its power that a twist keeps
_DIGITS = 10  # of a stated number
_DOWN = 1e-12  # rad or share, by which what is proved is rounded


@dataclass(frozen=True, eq=False)
class FrictionCones(Value):
    """The friction cones of held contacts, by what a scaled twist does at their points.

    Args:
        normal: (m, 6), normal velocity at a contact point, positive where the contact opens.
        tangent: (m, 2, 6), its sliding velocity times the coefficient of friction.
        rho: characteristic length, m.
    """

    normal: Array
    tangent: Array
    rho: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", frozen(self.normal, None, 6, name="normal rows"))
        object.__setattr__(self, "tangent", frozen(self.tangent, len(self.normal), 2, 6, name="tangent rows"))

    @staticmethod
    def of(wrenches: Array, arms: Array, rho: float, friction: float) -> FrictionCones:
        """Of contacts with unit normal wrenches (m, 6), at arms (m, 3) from the reference point, m."""
        sides = np.array([plane_basis(n).T for n in wrenches[:, :3]]).reshape(-1, 2, 3)
        rows = friction * np.concatenate([sides, cross(arms[:, None], sides)], axis=2)
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
        program = ConeProgram.of(
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

        For unit wrenches a and d (6,) at right angles; None where a itself is balanced. From where one twist ends, the
        steepest one for the wrench there goes further.

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
        return np.asarray(best / length(best) + 0.1 * NEARLY * first / length(first))

    def freeing(self, held: Array, along: Array) -> Array | None:
        """The scaled twist (6,) of K* that has power on held + b along for the least b; None where no b is free.

        From the steepest twist along the push on: at the least push of one, the steepest for the wrench needs less.

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
        """A scaled twist (6,) as a plan states it: moved to the inside of K* by more than rounding can be, unscaled."""
        unit = twist / length(twist)
        inside = unit + _INSIDE / float(np.min(self.opening(inner))) * inner
        rounded = np.where(np.abs(inside) < 10.0 ** -(_DIGITS + 1), 0.0, inside) / twist_scale(self.rho)
        return np.array([float(f"{x:.{_DIGITS}g}") for x in rounded])


def cone_angle(twist: Array, wrench: Array) -> float:
    """By what angle (rad) a scaled wrench (6,) may turn in any direction while a scaled twist (6,) has power on it."""
    sine = float(twist @ wrench) / (length(twist) * length(wrench))
    return float(_rounded_down(np.arcsin(min(sine, 1.0))))


def plane_angle(twists: Array, a: Array, d: Array) -> Array:
    """Up to what angles θ (…, rad) scaled twists (…, 6) have power on a cos θ + d sin θ, for orthogonal unit wrenches.

    With power on a, that is up to cot θ = −v·d / v·a; 0 without.
    """
    ahead = twists @ a
    return np.where(ahead > 0.0, _rounded_down(np.arctan2(ahead, -(twists @ d))), 0.0)


def least_push(twist: Array, held: Array, along: Array) -> float:
    """Above what push b a scaled twist (6,) has power on held + b along, both (6,); infinite if it has none on that."""
    if not float(twist @ along) > 0.0:
        return math.inf
    push = -float(twist @ held) / float(twist @ along)
    return max(push + _DOWN * max(abs(push), 1.0), 0.0)


def _rounded_down(angle: Array) -> Array:
    return angle * (1.0 - _DOWN) - _DOWN
