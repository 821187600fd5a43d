"""Body directions that are known to be turned onto world directions, and what follows for others, exactly."""

from __future__ import annotations

from typing import NamedTuple

from fmopt.verify.exact import balanced, inner, outer, parallel
from fmopt.verify.rational import ONE, Vector, add, cross, dot, length, over, root, scaled, sub, times

_STEEP = ONE >> 6
_APART = ONE >> 4
# rad: no error may be larger where an edge is known by its nominal direction; the other one is 1/4 from it.
LARGEST_ERROR = (ONE >> 3) + (ONE >> 4)


class Turn(NamedTuple):
    """A body direction that is known to be turned onto a world direction.

    Attributes:
        body, world: unit vectors.
        exact: the body direction exactly.
        onto: the world direction exactly; None for an edge in a wall at an odd angle to a flush.
        level: for such an edge the normal of the wall exactly, else None.
    """

    body: Vector
    world: Vector
    exact: Vector
    onto: Vector | None
    level: Vector | None

    def keeps(self, normal: Vector) -> bool:
        """Whether the world direction is level with planes of a normal."""
        if self.onto is not None:
            return inner(self.onto, normal) == 0
        return self.level is not None and parallel(self.level, normal)


def steep(one: Turn, two: Turn) -> bool:
    """Whether two directions are far enough from parallel to tell together how all is turned."""
    axis = cross(one.body, two.body)
    return dot(axis, axis) >= _STEEP


def image_of(one: Turn, two: Turn, w: Vector) -> Vector:
    """R w from two directions that R turns."""
    axis, turned_axis = cross(one.body, two.body), cross(one.world, two.world)
    sine = dot(axis, axis)
    g = dot(one.body, two.body)
    x, y = dot(one.body, w), dot(two.body, w)
    alpha, beta = over(x - times(g, y), sine), over(y - times(g, x), sine)
    gamma = over(dot(axis, w), sine)
    return add(add(scaled(alpha, one.world), scaled(beta, two.world)), scaled(gamma, turned_axis))


def cancel(one: Turn, two: Turn, normal: Vector, d: Vector) -> bool:
    """Whether a normal is exactly across R d, for d = α n₁ + β n₂ + γ n₁ × n₂ of two directions that R turns.

    With R nᵢ = kᵢ mᵢ, kᵢ² = |nᵢ|²/|mᵢ|², it is when α k₁ (normal·m₁) + β k₂ (normal·m₂) + γ k₁ k₂ (normal·m₁ × m₂) = 0.
    """
    n1, n2 = one.exact, two.exact
    g11, g12, g22 = inner(n1, n1), inner(n1, n2), inner(n2, n2)
    x, y = inner(n1, d), inner(n2, d)
    alpha, beta, gamma = x * g22 - y * g12, y * g11 - x * g12, inner(outer(n1, n2), d)
    if one.onto is None or two.onto is None:
        # Of an edge's direction only the wall that it is level with is known exactly.
        crossed = any(turn.onto is not None and parallel(turn.onto, normal) for turn in (one, two))
        flat = (alpha == 0 or one.keeps(normal)) and (beta == 0 or two.keeps(normal))
        return flat and (gamma == 0 or crossed)
    m1, m2 = one.onto, two.onto
    terms = alpha * inner(m1, normal), beta * inner(m2, normal), gamma * inner(outer(m1, m2), normal)
    return balanced(*terms, (g11, inner(m1, m1)), (g22, inner(m2, m2)))


def about(along: Vector) -> tuple[Vector, Vector]:
    """Two directions across one, and across each other."""
    a, b, c = along
    first = (0, c, -b) if abs(a) <= max(abs(b), abs(c)) else (c, 0, -a)
    return first, outer(along, first)


def directed(normal: Vector, w: Vector, cosine: int, nominal: Vector) -> Vector | None:
    """The unit direction level with a plane and at a known angle to w that is nearly a nominal one.

    None where the nominal one is neither of the two that there are, or they are too near each other.
    """
    axis = cross(normal, w)
    square = dot(axis, axis)
    if square < _STEEP:
        return None
    rest = ONE - over(times(cosine, cosine), square)
    if rest < _STEEP:
        return None
    along = scaled(over(cosine, square), sub(w, scaled(dot(normal, w), normal)))
    aside = scaled(root(over(rest, square)), axis)
    for there in (add(along, aside), sub(along, aside)):
        if length(sub(there, nominal)) < _APART:
            return there
    return None


def crossing(normal: Vector, turn: Turn, edge: Vector, there: Vector) -> Vector | None:
    """The direction of an edge in a wall exactly, when it is square to a direction that is turned exactly."""
    if turn.onto is None or inner(turn.exact, edge) != 0:
        return None
    along = outer(normal, turn.onto)
    return along if inner(along, there) > 0 else (-along[0], -along[1], -along[2])
