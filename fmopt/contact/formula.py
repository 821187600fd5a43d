"""The definition of a contact as a formula in vectors: it is called with names instead of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fmopt.contact.algebra import Definition

_SUM, _PRODUCT, _FACTOR, _ATOM = range(4)


def latex(kind: Definition) -> str:
    """The formula of a kind, as LaTeX writes it."""
    names = {name: Word(name) for name in kind.roles}
    return str(kind(Word("p"), Word("R"), **names).text)


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

    def __rsub__(self, other: Any) -> Word:
        return _word(other) - self

    def __mul__(self, other: Any) -> Word:
        return Word(rf"{self._in(_FACTOR)}\,{_word(other)._in(_FACTOR)}", _FACTOR)

    __matmul__ = __mul__

    def __truediv__(self, other: Any) -> Word:
        return Word(rf"\frac{{{self.text}}}{{{_word(other).text}}}", _FACTOR)

    def __pow__(self, n: int) -> Word:
        return Word(rf"{self._in(_ATOM)}^{n}", _FACTOR)

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
