"""From the definition of a contact to its formula, its wrench and its second derivatives, by SymPy.

A vector b of the moving part enters as y = R b alone, and a small motion (d, δ) of the pose that is reached moves p by
d and y by δ × y. So the gradient is (∂f/∂p, Σ y × ∂f/∂y), by virtual work the wrench of a unit contact force, and the
second derivative is one more of the same, made symmetric.

The definition of a contact as a formula in vectors: it is called with names instead of numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import sympy

from fmopt.contact.algebra import Definition, Role
from fmopt.contact.definitions import CONTACTS

_SUM, _PRODUCT, _FACTOR, _ATOM = range(4)


@dataclass(frozen=True)
class Derived:
    """A kind of contact as SymPy expressions.

    Args:
        p: position (3, 1) of the moving part.
        parameters: of the kind; those that turn with the part stand for R b.
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

    # Derivatives are taken in the turned vectors, so that no parameters of a rotation are ever needed.
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
    # Second derivatives of N·X, a number: their matrix is that of f along X.
    X = sympy.Matrix(sympy.symbols("d_0:3 w_0:3"))
    twice = _gradient(N.dot(X), p, vectors).jacobian(X)
    # Where a base vanishes a root has no derivative: it is kept as what says how regular the contact is.
    roots = sorted((power.base for power in f.atoms(sympy.Pow) if not power.exp.is_integer), key=sympy.default_sort_key)
    # N turns with the pose as well, which leaves an antisymmetric part; only the symmetric one is curvature.
    return Derived(name, p, parameters, turned, f, N, (twice + twice.T) / 2, tuple(roots))


def _symbol(name: str, role: Role) -> Any:
    if role is Role.SCALAR:
        return sympy.Symbol(name, real=True)
    return sympy.Matrix(sympy.symbols(f"{name}_0:3", real=True))


def _gradient(f: Any, p: Any, turned: list[Any]) -> Any:
    """∂f/∂(d, δ) (6, 1) about the pose."""
    moment = sympy.zeros(3, 1)
    # A turn by δ moves y by δ × y, and f by ∇f·(δ × y) = (y × ∇f)·δ.
    for y in turned:
        moment += y.cross(sympy.Matrix([f.diff(s) for s in y]))
    return sympy.Matrix([*(f.diff(s) for s in p), *moment])


def latex(kind: Definition) -> str:
    """The formula of a kind, as LaTeX writes it."""
    return str(kind(Word("p"), Word("R"), **{name: Word(name) for name in kind.roles}).text)


@dataclass(frozen=True)
class Word:
    """A term of a formula, and how tightly it holds together."""

    text: str
    level: int = _ATOM

    def _in(self, level: int) -> str:
        return self.text if self.level >= level else rf"\left({self.text}\right)"

    def __add__(self, other: Any) -> Word:
        return Word(f"{self.text} + {_word(other).text}", _SUM)

    def __sub__(self, other: Any) -> Word:
        return Word(f"{self.text} - {_word(other)._in(_PRODUCT)}", _SUM)

    def __matmul__(self, other: Any) -> Word:
        return Word(rf"{self._in(_FACTOR)}\,{_word(other)._in(_FACTOR)}", _FACTOR)

    def __truediv__(self, other: Any) -> Word:
        return Word(rf"\frac{{{self.text}}}{{{_word(other).text}}}", _FACTOR)

    def dotted(self, other: Any) -> Word:
        """Its inner product with another one."""
        if self == other:
            return Word(rf"|{self.text}|^2", _FACTOR)
        return Word(rf"{self._in(_FACTOR)} \cdot {_word(other)._in(_FACTOR)}", _PRODUCT)

    def crossed(self, other: Any) -> Word:
        """Its cross product with another one."""
        return Word(rf"{self._in(_FACTOR)} \times {_word(other)._in(_FACTOR)}", _PRODUCT)

    def rooted(self) -> Word:
        """Its square root; of a square, its length."""
        if self.text.startswith("|") and self.text.endswith("|^2"):
            return Word(self.text[:-2])
        return Word(rf"\sqrt{{{self.text}}}")


def _word(other: Any) -> Word:
    return other if isinstance(other, Word) else Word(str(other))
