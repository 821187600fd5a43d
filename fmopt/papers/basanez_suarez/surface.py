"""The families of C-surfaces (13) and (14) of [BasanezSuarez] with k eliminated, and their envelopes, as expressions.

All symbols are real; lengths in m, angles in rad.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import sympy

from fmopt.papers.basanez_suarez.contact import CU, ContactType
from fmopt.papers.basanez_suarez.reach import Reach


@dataclass(frozen=True)
class Family:
    """A family of C-surfaces F(configuration; deviations) = 0, with the symbols that its expressions hold.

    Args:
        function: signed distance of vertex and edge line, positive when apart; eq. (13) or (14) with k eliminated.
        k: place of the contact on the edge, 0 at its first end and 1 at its second, from the same equations.
        geometry: type 1: a₁ₓ, a₁ᵧ, a₂ₓ, a₂ᵧ, h, γ; type 2: aₓ, aᵧ, h₁, γ₁, h₂, γ₂.
    """

    function: sympy.Expr
    k: sympy.Expr
    configuration: tuple[sympy.Symbol, ...]
    geometry: tuple[sympy.Symbol, ...]
    deviations: tuple[sympy.Symbol, ...]

    @property
    def symbols(self) -> tuple[sympy.Symbol, ...]:
        """All symbols: configuration, geometry, deviations."""
        return (*self.configuration, *self.geometry, *self.deviations)

    def envelope(self) -> tuple[sympy.Expr, ...]:
        """What vanishes, beside F, on the envelope: ∂F/∂δ_φ, ∂F/∂θ_p, ∂F/∂θ_a.

        The first belongs to a stationary turn; where δ_φ is at one of its limits ±ε_φ only the other two hold. δ_p and
        δ_a enter linearly and are at their limits ε_prpgv and ε_a.
        """
        turn, _, theta_p, _, theta_a = self.deviations
        # On the boundary of CU all derivatives by deviations vanish, or a deviation is at its bound.
        return tuple(sympy.diff(self.function, symbol) for symbol in (turn, theta_p, theta_a))


@cache
def family(kind: ContactType) -> Family:
    """The family of type-1 C-surfaces, from eq. (13), or of type-2 ones, from eq. (14)."""
    configuration = sympy.symbols("p_x p_y phi", real=True)
    deviations = sympy.symbols("delta_phi delta_p theta_p delta_a theta_a", real=True)
    if kind is ContactType.TYPE_1:
        geometry = sympy.symbols("a_1x a_1y a_2x a_2y h gamma", real=True)
        first, second = sympy.Matrix(geometry[:2]), sympy.Matrix(geometry[2:4])
        grasped = _swung(configuration, deviations, *geometry[4:])
        edge, vertex = (first + _arm(*deviations[3:]), second + _arm(*deviations[3:])), grasped
    else:
        geometry = sympy.symbols("a_x a_y h_1 gamma_1 h_2 gamma_2", real=True)
        edge = (_swung(configuration, deviations, *geometry[2:4]), _swung(configuration, deviations, *geometry[4:]))
        vertex = sympy.Matrix(geometry[:2]) + _arm(*deviations[3:])
    along, to = edge[1] - edge[0], vertex - edge[0]
    length = _length(kind, geometry)
    # The height of the vertex over the line of the edge, and where its foot is, as a share of the edge.
    function = (to[0] * along[1] - to[1] * along[0]) / length
    k = (to[0] * along[0] + to[1] * along[1]) / length**2
    return Family(function, k, tuple(configuration), tuple(geometry), tuple(deviations))


def geometry_values(cu: CU) -> tuple[float, ...]:
    """The numbers of a contact for `Family.geometry`, m and rad."""
    if cu.kind is ContactType.TYPE_1:
        polar = Reach.of(cu.vertex)
        return (*cu.edge.ravel().tolist(), polar.h, polar.gamma)
    ends = [Reach.of(end) for end in cu.edge]
    return (*cu.vertex.tolist(), *(number for end in ends for number in (end.h, end.gamma)))


def boundary_rank(kind: ContactType) -> sympy.Expr:
    """What vanishes on the envelope of the family of points p(k, δ_φ, θ), both in the edge and in the turn.

    The reference points that make a contact are p = a(k) − h u(φ + δ_φ + γ) + …; a curve of the boundary along which
    neither k nor δ_φ is at a limit has both of these derivatives parallel: their determinant vanishes. With k = 0 or 1
    it is the arcs of the ends that remain.
    """
    found = family(kind)
    k, turn = sympy.Symbol("k", real=True), found.deviations[0]
    phi, g = found.configuration[2], found.geometry
    if kind is ContactType.TYPE_1:
        point = sympy.Matrix(g[:2]) + k * (sympy.Matrix(g[2:4]) - sympy.Matrix(g[:2])) - _arm(g[4], phi + turn + g[5])
    else:
        first, second = _arm(g[2], phi + turn + g[3]), _arm(g[4], phi + turn + g[5])
        point = sympy.Matrix(g[:2]) - first - k * (second - first)
    # The boundary is where the two families of curves are parallel: their Jacobian vanishes.
    one, other = point.diff(k), point.diff(turn)
    return sympy.expand(one[0] * other[1] - one[1] * other[0])


def _arm(h: sympy.Expr, angle: sympy.Expr) -> sympy.Matrix:
    return h * sympy.Matrix([sympy.cos(angle), sympy.sin(angle)])


def _swung(
    configuration: Sequence[sympy.Symbol], deviations: Sequence[sympy.Symbol], h: sympy.Symbol, gamma: sympy.Symbol
) -> sympy.Matrix:
    """b of eq. (7): a point of the grasped object."""
    x, y, phi = configuration
    return sympy.Matrix([x, y]) + _arm(h, phi + deviations[0] + gamma) + _arm(*deviations[1:3])


def _length(kind: ContactType, geometry: Sequence[sympy.Symbol]) -> sympy.Expr:
    if kind is ContactType.TYPE_1:
        return sympy.sqrt((geometry[2] - geometry[0]) ** 2 + (geometry[3] - geometry[1]) ** 2)
    h, gamma, other, angle = geometry[2:]
    return sympy.sqrt(h**2 + other**2 - 2 * h * other * sympy.cos(angle - gamma))
