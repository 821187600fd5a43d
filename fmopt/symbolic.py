"""SymPy expressions to CasADi functions, by a closed table of node types; nothing is evaluated from a string."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import sympy

Node: TypeAlias = Any  # a CasADi SX node; CasADi has no types


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


_TABLE: dict[Any, Callable[..., Node]] = {
    sympy.Add: _add,
    sympy.Mul: _multiply,
    sympy.Pow: _power,
    sympy.sin: _sin,
    sympy.cos: _cos,
}
