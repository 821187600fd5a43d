"""Cut-diagrams of instances as expressions: parametric curve pairs u(t), v(t), the interior on the left.

Dimensions, orientation and place may be numbers or symbols, each on its own. Which faces a plane cuts depends on them,
so that every curve that may bound the section comes with the condition under which it does ([LeeHuang1985] section 4).
The curves hold for planes that do not run in a face, along an edge or through a corner.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, assert_never

import numpy as np
import sympy
from numpy.typing import ArrayLike

from fmopt.geometry.csg import Box, Cone, Cylinder, Prism, Sphere, Wedge
from fmopt.spatial.values import Array

Expression: TypeAlias = Any  # a SymPy expression or a number; SymPy has no types

T = sympy.Symbol("t", real=True)


@dataclass(frozen=True)
class SymbolicCurve:
    """The curve (u(t), v(t)), 0 ≤ t ≤ 1, which bounds the section where `present` is true.

    Args:
        u: expression in t and the symbols of instance and plane, in m.
    """

    u: Expression
    v: Expression
    present: Expression

    def substituted(self, values: Mapping[Expression, Expression]) -> "SymbolicCurve":
        """The curve with numbers or expressions for some of its symbols."""
        return SymbolicCurve(*(part.xreplace(dict(values)) for part in (self.u, self.v, self.present)))

    def bounds(self, values: Mapping[Expression, float]) -> bool:
        """Whether the curve bounds the section, given numbers for all symbols."""
        # All branches are evaluated, the ones that do not hold as well; those may divide by zero.
        with np.errstate(divide="ignore", invalid="ignore"):  # what else is asked of a curve that is not there
            return bool(_value(self.present, dict(values)))

    def points(self, t: ArrayLike, values: Mapping[Expression, float]) -> Array:
        """Points (…, 2) in m at parameters (…), given numbers for all symbols; the curve must bound the section."""
        t = np.asarray(t, dtype=np.float64)
        known = {**values, T: t}
        return np.stack([np.broadcast_to(_value(part, known), t.shape) for part in (self.u, self.v)], axis=-1)


@dataclass(frozen=True)
class HalfSpaces:
    """A convex polyhedron n·x ≤ o as rows (n_x, n_y, n_z, o); the normals need no unit length."""

    rows: tuple[tuple[Expression, Expression, Expression, Expression], ...]


@dataclass(frozen=True)
class Round:
    """An instance about z with radius a + b z for 0 ≤ z ≤ height."""

    a: Expression
    b: Expression
    height: Expression


@dataclass(frozen=True)
class Ball:
    """A ball about the origin."""

    radius: Expression


Shape: TypeAlias = HalfSpaces | Round | Ball


def box(x: Expression, y: Expression, z: Expression) -> HalfSpaces:
    """The box of `fmopt.geometry.csg.Box`, its size in m."""
    # A wedge whose top is as long as its base.
    return wedge(x, y, z, x)


def wedge(x: Expression, y: Expression, z: Expression, top_x: Expression) -> HalfSpaces:
    """The wedge of `fmopt.geometry.csg.Wedge`: full widths x, y, z and width `top_x` along x at its top, m."""
    sides = [(-1, 0, 0, x / 2), (0, -1, 0, y / 2), (0, 1, 0, y / 2), (z, 0, x - top_x, z * x / 2)]
    return HalfSpaces((*_caps(z), *sides))


def prism(polygon: Sequence[tuple[Expression, Expression]], height: Expression) -> HalfSpaces:
    """The prism of `fmopt.geometry.csg.Prism`: corners (x, y) counter-clockwise and a height along z, m."""
    ends = zip(polygon, [*polygon[1:], polygon[0]], strict=True)
    sides = [(by - ay, ax - bx, 0, (by - ay) * ax + (ax - bx) * ay) for (ax, ay), (bx, by) in ends]
    return HalfSpaces((*_caps(height), *sides))


def cylinder(radius: Expression, height: Expression) -> Round:
    """The cylinder of `fmopt.geometry.csg.Cylinder`, in m."""
    return Round(radius, 0, height)


def cone(bottom: Expression, top: Expression, height: Expression) -> Round:
    """The cone of `fmopt.geometry.csg.Cone`: radii and height in m."""
    return Round(bottom, (top - bottom) / height, height)


def shape_of(primitive: Box | Cylinder | Cone | Sphere | Prism | Wedge) -> Shape:
    """The shape of an instance whose dimensions are known."""
    match primitive:
        case Box(size):
            return box(*size)
        case Wedge(size, top_x):
            return wedge(*size, top_x)
        case Prism(polygon, height):
            return prism(polygon, height)
        case Cylinder(radius, height, _):
            return cylinder(radius, height)
        case Cone(bottom, top, height, _):
            return cone(bottom, top, height)
        case Sphere(radius, _):
            return Ball(radius)
        case _:
            assert_never(primitive)


def any_pose() -> tuple[sympy.Matrix, sympy.Matrix]:
    """R (3, 3) and p (3, 1) of an instance anywhere, of symbols R_00, R_01, …, R_22 and p_0, p_1, p_2."""
    R = [[sympy.Symbol(f"R_{row}{column}", real=True) for column in range(3)] for row in range(3)]
    return sympy.Matrix(R), sympy.Matrix(sympy.symbols("p_0 p_1 p_2", real=True))


def symbolic_diagram(shape: Shape, R: sympy.Matrix, p: sympy.Matrix) -> tuple[SymbolicCurve, ...]:
    """The curves that may bound the section of a placed instance by the plane z = 0.

    The instance, and R (3, 3) and p (3, 1), m, which take it to the plane, are of symbols or numbers.
    """
    match shape:
        case HalfSpaces(rows):
            return _polygon(rows, R, p)
        case Round():
            return (_level(shape, R, p), *_slanted(shape, R, p))
        case Ball(radius):
            square = radius**2 - p[2] ** 2
            return (_circle(p[0], p[1], sympy.sqrt(square), _more(square, 0)),)
        case _:
            assert_never(shape)


def _caps(height: Expression) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    return (0, 0, -1, 0), (0, 0, 1, height)


def _polygon(rows: Sequence[Sequence[Expression]], R: sympy.Matrix, p: sympy.Matrix) -> tuple[SymbolicCurve, ...]:
    """One segment for each face: what the others leave of the line n·q = o, run along n turned left."""
    turned = [(R * sympy.Matrix(n), o) for *n, o in rows]
    planes = [(n[0], n[1], o + n.dot(p)) for n, o in turned]
    curves = []
    for k, (x, y, o) in enumerate(planes):
        square = x**2 + y**2
        if square.is_zero:
            # A face along z is cut by no line: it has no curve.
            continue
        others = [other for g, other in enumerate(planes) if g != k]
        first, last, wide = _span([(go - (gx * x + gy * y) * o / square, gx * y - gy * x) for gx, gy, go in others])
        place = first + (last - first) * T
        present = sympy.And(_more(square, 0), wide, evaluate=False)
        curves.append(SymbolicCurve(x * o / square - place * y, y * o / square + place * x, present))
    return tuple(curves)


def _span(lines: Sequence[tuple[Expression, Expression]]) -> tuple[Expression, Expression, Expression]:
    """The interval (first, last) on which all c₀ + c₁ s > 0, and the condition that it has points.

    Comparisons stay unevaluated: SymPy draws wrong conclusions from the infinities inside of them.
    """
    low = [_bound(_root(c0, c1), _more(c1, 0), -sympy.oo) for c0, c1 in lines if not c1.is_zero]
    high = [_bound(_root(c0, c1), _more(0, c1), sympy.oo) for c0, c1 in lines if not c1.is_zero]
    first, last = sympy.Max(*low, evaluate=False), sympy.Min(*high, evaluate=False)
    level = [sympy.Or(sympy.Ne(c1, 0, evaluate=False), _more(c0, 0), evaluate=False) for c0, c1 in lines]
    # Unevaluated throughout: SymPy would try to decide inequalities of symbols, and does not come back.
    return first, last, sympy.And(*level, _more(last, first), evaluate=False)


def _root(c0: Expression, c1: Expression) -> Expression:
    """The s at which c₀ + c₁ s = 0, any where it has no slope."""
    return _bound(-c0 / c1, sympy.Ne(c1, 0, evaluate=False), sympy.Integer(0))


def _more(one: Expression, other: Expression) -> Expression:
    return sympy.Gt(one, other, evaluate=False)


def _bound(value: Expression, condition: Expression, otherwise: Expression) -> Expression:
    return sympy.Piecewise((value, condition), (otherwise, True), evaluate=False)


def _level(instance: Round, R: sympy.Matrix, p: sympy.Matrix) -> SymbolicCurve:
    """The circle where the plane is square to the axis."""
    height = -p[2] * R[2, 2]
    level = (sympy.Eq(R[0, 2], 0, evaluate=False), sympy.Eq(R[1, 2], 0, evaluate=False))
    present = sympy.And(*level, _more(height, 0), _more(instance.height, height), evaluate=False)
    return _circle(p[0], p[1], instance.a + instance.b * height, present)


def _circle(x: Expression, y: Expression, radius: Expression, present: Expression) -> SymbolicCurve:
    angle = 2 * sympy.pi * T
    return SymbolicCurve(x + radius * sympy.cos(angle), y + radius * sympy.sin(angle), present)


def _slanted(instance: Round, R: sympy.Matrix, p: sympy.Matrix) -> tuple[SymbolicCurve, ...]:
    """Both branches w = ∓√((R − D)(R + D)) and the chords at the caps, where the plane is not square to the axis.

    s runs along the plane's steepest line and w across, w = 0 nearest the axis; z = z₀ + z₁ s is the height over the
    base, D = d₀ + d₁ s the distance of the steepest line's point from the axis. Along a branch s = first + (last −
    first) sin²(π t / 2), so that no speed is infinite where the branches meet.
    """
    x, y, z = R[:, 2]
    square = x**2 + y**2
    if square.is_zero:
        return ()
    rise = sympy.sqrt(square)
    along, across = (x / rise, y / rise), (-y / rise, x / rise)
    z0, z1 = -p.dot(R[:, 2]), rise
    d0, d1 = p[2] * rise - (p[0] * along[0] + p[1] * along[1]) * z, z
    radius = (instance.a + instance.b * z0, instance.b * z1)
    low, high = (radius[0] - d0, radius[1] - d1), (radius[0] + d0, radius[1] + d1)
    first, last, wide = _span([(z0, z1), (instance.height - z0, -z1), low, high])
    middle = p[0] * across[0] + p[1] * across[1]
    present = sympy.And(_more(square, 0), wide, evaluate=False)

    def width(s: Expression) -> Expression:
        places, slopes = zip(*(_factors(*line, s) for line in (low, high)), strict=True)
        return sympy.sqrt(sympy.Max((places[0] * places[1]) * (slopes[0] * slopes[1]), 0, evaluate=False))

    def curve(s: Expression, w: Expression, when: Expression) -> SymbolicCurve:
        u, v = (s * along[k] + (middle + w) * across[k] for k in range(2))
        return SymbolicCurve(u, v, when)

    # cos² and sin² run from end to end with zero speed there, where the root has infinite slope.
    early, late = sympy.cos(sympy.pi * T / 2) ** 2, sympy.sin(sympy.pi * T / 2) ** 2
    forth, back = first * early + last * late, last * early + first * late
    chords = [(last, 2 * T - 1), (first, 1 - 2 * T)]
    return (
        curve(forth, -width(forth), present),
        curve(back, width(back), present),
        *(curve(s, side * width(s), sympy.And(present, _more(width(s), 0), evaluate=False)) for s, side in chords),
    )


def _factors(c0: Expression, c1: Expression, s: Expression) -> tuple[Expression, Expression]:
    """c₀ + c₁ s as (s − root, c₁), or as (1, c₀) without a slope: at the root itself nothing is left by rounding."""
    if c1.is_zero:
        return sympy.Integer(1), c0
    level = sympy.Eq(c1, 0, evaluate=False)
    return _bound(sympy.Integer(1), level, s - _root(c0, c1)), _bound(c0, level, c1)


def _value(expression: Expression, known: dict[Expression, Any]) -> Any:
    """The value of an expression by a closed table of node types; of a Piecewise only the branch that holds."""
    # Each node once, as expressions share their parts; never by evaluation of text.
    if expression not in known:
        if expression.is_Number or expression is sympy.pi:
            known[expression] = float(expression)
        elif expression.func is sympy.Piecewise:
            known[expression] = next(_value(value, known) for value, when in expression.args if _value(when, known))
        elif expression in (sympy.true, sympy.false):
            known[expression] = expression is sympy.true
        else:
            rule = _TABLE.get(expression.func)
            if rule is None:
                raise TypeError(f"{expression.func.__name__} {expression} is not in the table of a cut-diagram's nodes")
            known[expression] = rule([_value(argument, known) for argument in expression.args])
    return known[expression]


_TABLE: dict[Any, Callable[[list[Any]], Any]] = {
    sympy.Add: sum,
    sympy.Mul: math.prod,
    sympy.Pow: lambda pair: np.power(*pair),
    sympy.Abs: lambda size: np.abs(size[0]),
    sympy.sin: lambda angle: np.sin(angle[0]),
    sympy.cos: lambda angle: np.cos(angle[0]),
    sympy.Max: lambda values: functools.reduce(np.maximum, values),
    sympy.Min: lambda values: functools.reduce(np.minimum, values),
    sympy.And: all,
    sympy.Or: any,
    sympy.Gt: lambda pair: pair[0] > pair[1],
    sympy.Lt: lambda pair: pair[0] < pair[1],
    sympy.Eq: lambda pair: pair[0] == pair[1],
    sympy.Ne: lambda pair: pair[0] != pair[1],
}
