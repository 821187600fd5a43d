"""What a definition of a contact comes to as a row: it is called with vectors that are affine in the pose.

    f = n·p + u·(R k) + (R b)·(σ p + a × p + s) − c

All vectors may be many at once, (r, 3).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmopt.certificate.kernels_rows import ROW
from fmopt.contact.algebra import Definition, Role
from fmopt.se3 import cross, lengths
from fmopt.values import Array


def rows(definition: Definition, **parameters: Array | float) -> Any:
    """Records (r,) of rows.

    Args:
        definition: of the function.
        parameters: its own: vectors (r, 3) or one for all (3,), numbers (r,) or one.

    Raises:
        TypeError: the definition is no row of this form.
    """
    given = {name: np.asarray(parameters[name], dtype=np.float64) for name in definition.roles}
    kinds: dict[Role, Any] = {Role.BODY: _Body, Role.WORLD: _Affine, Role.SCALAR: np.asarray}
    found = definition(_Affine(sign=1.0), _Rotation(), **{n: kinds[definition.roles[n]](x) for n, x in given.items()})
    if not isinstance(found, _Form):
        raise TypeError(f"{definition.name} is no row of this form")
    leading = (x.shape[: x.ndim - (definition.roles[n] is not Role.SCALAR)] for n, x in given.items())
    table = np.zeros(np.broadcast_shapes((1,), *leading), ROW)
    for name in ("n", "u", "k", "b", "a", "s", "c", "sign", "bilinear"):
        table[name] = getattr(found, name)
    table["lever"] = lengths(table["u"]) * lengths(table["k"])
    return table


def _zero() -> Array:
    return np.zeros(3)


class _Rotation:
    """R: it turns vectors of the moving part."""

    def __matmul__(self, b: _Body) -> _Affine:
        return _Affine(turned=b.value)


@dataclass(frozen=True, eq=False)
class _Body:
    """A vector of the moving part."""

    value: Array

    def crossed(self, other: _Body) -> _Body:
        """Its cross product with another one, which turns with the part, too."""
        return _Body(cross(self.value, other.value))


@dataclass(frozen=True, eq=False)
class _Affine:
    """s + σ p + a × p + R b; without b where nothing turns."""

    s: Array = field(default_factory=_zero)
    sign: float = 0.0
    a: Array = field(default_factory=_zero)
    turned: Array | None = None

    @property
    def _constant(self) -> bool:
        return self.turned is None and self.sign == 0.0 and not self.a.any()

    @property
    def _turns(self) -> bool:
        """Whether it is R b alone."""
        return self.turned is not None and self.sign == 0.0 and not self.a.any() and not self.s.any()

    def __add__(self, other: _Affine) -> _Affine:
        turned = _one(self.turned, other.turned)
        return _Affine(self.s + other.s, self.sign + other.sign, self.a + other.a, turned)

    def __sub__(self, other: _Affine) -> _Affine:
        turned = None if other.turned is None else -other.turned
        return self + _Affine(-other.s, -other.sign, -other.a, turned)

    def crossed(self, other: _Affine) -> _Affine:
        """e × (σ p + s) of a constant e."""
        if not self._constant or other.turned is not None or other.a.any():
            raise TypeError("a cross product that is not affine in the position")
        return _Affine(cross(self.s, other.s), 0.0, other.sign * self.s)

    def dotted(self, other: _Affine) -> _Form:
        """The inner product with another one, of which one is constant or both are of the form's last product."""
        if self._constant:
            inner, n = -np.vecdot(self.s, other.s), other.sign * self.s + cross(self.s, other.a)
            if other.turned is None:
                return _Form(n=n, c=inner)
            return _Form(n=n, c=inner, u=self.s, k=other.turned)
        if other._constant:
            return other.dotted(self)
        if self._turns and other.turned is None:
            assert self.turned is not None
            return _Form(b=self.turned, sign=other.sign, a=other.a, s=other.s, bilinear=True)
        raise TypeError("an inner product that is not of the form")


@dataclass(frozen=True, eq=False)
class _Form:
    """The row; see the module."""

    n: Array = field(default_factory=_zero)
    c: Any = 0.0
    u: Array = field(default_factory=_zero)
    k: Array = field(default_factory=_zero)
    b: Array = field(default_factory=_zero)
    sign: float = 0.0
    a: Array = field(default_factory=_zero)
    s: Array = field(default_factory=_zero)
    bilinear: bool = False

    def __add__(self, other: _Form) -> _Form:
        plain = other if self.bilinear else self
        if plain.bilinear or (self.u.any() and other.u.any()):
            raise TypeError("a sum that is not of the form")
        curved = self if self.bilinear else other
        turning = self if self.u.any() else other
        return replace(curved, n=self.n + other.n, c=self.c + other.c, u=turning.u, k=turning.k)

    def __sub__(self, number: Array | float) -> _Form:
        return replace(self, c=self.c + number)


def _one(a: Array | None, b: Array | None) -> Array | None:
    if a is not None and b is not None:
        raise TypeError("a sum of two vectors that turn")
    return b if a is None else a
