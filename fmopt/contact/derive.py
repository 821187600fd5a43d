"""From the definition of a contact to its formula, its wrench and its second derivatives, by SymPy.

A vector b of the moving part enters as y = R b alone, and a small motion (d, δ) of the pose that is reached moves p by
d and y by δ × y. So the gradient is (∂f/∂p, Σ y × ∂f/∂y), by virtual work the wrench of a unit contact force, and the
second derivative is one more of the same, made symmetric.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import sympy

from fmopt.contact.algebra import Role
from fmopt.contact.definitions import CONTACTS
from fmopt.contact.formula import latex


@dataclass(frozen=True)
class Derived:
    """A kind of contact as SymPy expressions.

    Args:
        name: of the kind.
        p: position (3, 1) of the moving part.
        parameters: of the kind; those that turn with the part stand for R b.
        turned: names of these.
        f: value.
        N: gradient (6, 1) in local coordinates X = (d, δ) about the pose, the contact's wrench.
        H: second derivatives (6, 6).
        regular: what f takes roots of; where one is zero, f has no gradient.
    """

    name: str
    p: Any
    parameters: Mapping[str, Any]
    turned: tuple[str, ...]
    f: Any
    N: Any
    H: Any
    regular: tuple[Any, ...]

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle f = {latex(CONTACTS[self.name])}$"


class _Turned:
    """R in a definition: R @ b is the symbol of b, which stands for the turned vector."""

    def __matmul__(self, b: Any) -> Any:
        return b


@cache
def derived(name: str) -> Derived:
    """What follows from the definition of a kind of contact."""
    kind = CONTACTS[name]
    p = sympy.Matrix(sympy.symbols("p_0:3", real=True))
    parameters = {key: _symbol(key, role) for key, role in kind.roles.items()}
    turned = tuple(key for key, role in kind.roles.items() if role is Role.BODY)
    f = kind(p, _Turned(), **parameters)
    vectors = [parameters[key] for key in turned]
    N = _gradient(f, p, vectors)
    X = sympy.Matrix(sympy.symbols("d_0:3 w_0:3"))
    twice = _gradient(N.dot(X), p, vectors).jacobian(X)
    roots = sorted((power.base for power in f.atoms(sympy.Pow) if not power.exp.is_integer), key=sympy.default_sort_key)
    return Derived(name, p, parameters, turned, f, N, (twice + twice.T) / 2, tuple(roots))


def _symbol(name: str, role: Role) -> Any:
    if role is Role.SCALAR:
        return sympy.Symbol(name, real=True)
    return sympy.Matrix(sympy.symbols(f"{name}_0:3", real=True))


def _gradient(f: Any, p: Any, turned: list[Any]) -> Any:
    """∂f/∂(d, δ) (6, 1) about the pose."""
    moment = sympy.zeros(3, 1)
    for y in turned:
        moment += y.cross(sympy.Matrix([f.diff(s) for s in y]))
    return sympy.Matrix([*(f.diff(s) for s in p), *moment])
