"""SymPy expressions to CasADi functions, by a closed table of node types; nothing is evaluated from a string."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import sympy

_TERMS = 16  # the series below is exact to rounding for |s| ≤ π², a rotation by up to π

Node: TypeAlias = Any  # a CasADi SX node; CasADi has no types


class Stumpff(sympy.Function):  # type: ignore[misc]  # SymPy has no types
    """Stumpff's function c_k(s) = Σ (−s)^i / (k + 2i)!, entire in s.

    c₁(θ²) = sin θ / θ and c₂(θ²) = (1 − cos θ) / θ², so a rotation by its rotation vector is smooth at zero.
    """

    nargs = 2

    @classmethod
    def eval(cls, k: sympy.Expr, s: sympy.Expr) -> sympy.Expr | None:
        """The value where it is known exactly."""
        return sympy.Rational(1, math.factorial(int(k))) if s.is_zero else None

    def fdiff(self, argindex: int = 2) -> sympy.Expr:
        """dc_k/ds = (k c_{k+2} − c_{k+1}) / 2."""
        k, s = self.args
        if argindex != 2:
            raise sympy.ArgumentIndexError(self, argindex)
        return (k * Stumpff(k + 2, s) - Stumpff(k + 1, s)) / 2

    def _eval_evalf(self, prec: int) -> sympy.Expr:
        k, s = self.args
        terms = [(-s) ** i / sympy.factorial(k + 2 * i) for i in range(2 * _TERMS)]
        return sympy.Add(*terms)._eval_evalf(prec)


def rotation(r: sympy.Matrix) -> sympy.Matrix:
    """exp([r]×) = I + c₁[r]× + c₂[r]×² as a symbolic 3 × 3 matrix of the rotation vector r (rad)."""
    x, y, z = r
    K = sympy.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s = x**2 + y**2 + z**2
    return sympy.eye(3) + Stumpff(1, s) * K + Stumpff(2, s) * (K * K)


def casadi_function(name: str, inputs: Mapping[str, Sequence[sympy.Symbol]], outputs: Sequence[sympy.Expr]) -> Any:
    """The CasADi function (one column vector per input) ↦ column vector of the outputs.

    Common subexpressions of all outputs are built once.

    Args:
        name: name of the function.
        inputs: for each input its name and its symbols, in order.
        outputs: expressions in those symbols.

    Raises:
        TypeError: an expression holds a node outside the table, or a symbol that is no input.
    """
    import casadi

    columns = {key: casadi.SX.sym(key, len(symbols)) for key, symbols in inputs.items()}
    known: dict[sympy.Expr, Node] = {
        symbol: columns[key][i] for key, symbols in inputs.items() for i, symbol in enumerate(symbols)
    }
    shared, reduced = sympy.cse(list(outputs), order="none")
    for symbol, expression in shared:
        known[symbol] = _translate(expression, known)
    result = casadi.vertcat(*(casadi.SX(_translate(expression, known)) for expression in reduced))
    return casadi.Function(name, list(columns.values()), [result], list(columns), ["value"])


def _translate(expression: sympy.Expr, known: Mapping[sympy.Expr, Node]) -> Node:
    if expression in known:
        return known[expression]
    if expression.is_Number or expression is sympy.pi:
        return float(expression)
    rule = _TABLE.get(expression.func)
    if rule is None:
        raise TypeError(f"{expression.func.__name__} {expression} is not in the table from SymPy to CasADi")
    return rule(*(_translate(argument, known) for argument in expression.args))


def _add(*terms: Node) -> Node:
    return sum(terms[1:], terms[0])


def _multiply(*factors: Node) -> Node:
    return math.prod(factors[1:], start=factors[0])


def _power(base: Node, exponent: Node) -> Node:
    import casadi

    if exponent == 0.5:
        return casadi.sqrt(base)
    if exponent == -0.5:
        return 1.0 / casadi.sqrt(base)
    return base**exponent


def _sin(x: Node) -> Node:
    import casadi

    return casadi.sin(x)


def _cos(x: Node) -> Node:
    import casadi

    return casadi.cos(x)


def _stumpff(k: float, s: Node) -> Node:
    coefficients = [(-1.0) ** i / math.factorial(int(k) + 2 * i) for i in range(_TERMS)]
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = coefficient + s * value
    return value


_TABLE: dict[Any, Callable[..., Node]] = {
    sympy.Add: _add,
    sympy.Mul: _multiply,
    sympy.Pow: _power,
    sympy.sin: _sin,
    sympy.cos: _cos,
    Stumpff: _stumpff,
}
