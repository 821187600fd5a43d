"""What definitions of contacts are written in: dot, cross, root and norm, of whatever vectors they are called with.

One definition is called with SymPy's matrices (formula, derivatives, kernels), CasADi's, mpmath's
numbers (tests), NumPy's arrays, and names (what a notebook shows). Nothing is parsed.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Any, TypeAlias, get_type_hints

import numpy as np

_ALGEBRAS = ("casadi", "mpmath", "sympy")  # libraries with numbers and matrices of their own


class Role(Enum):
    """What a parameter of a definition is, and how many numbers it has."""

    BODY = "a vector that turns with the moving part"
    WORLD = "a vector that does not"
    SCALAR = "a number"

    @property
    def width(self) -> int:
        """How many numbers."""
        return 1 if self is Role.SCALAR else 3


Vector: TypeAlias = Any
Matrix: TypeAlias = Any
Body: TypeAlias = Annotated[Any, Role.BODY]
World: TypeAlias = Annotated[Any, Role.WORLD]
Scalar: TypeAlias = Annotated[Any, Role.SCALAR]


@dataclass(frozen=True)
class Definition:
    """A function f(p, R, …) of a pose and of named parameters, whose roles stand in the order of a record's numbers."""

    name: str
    function: Callable[..., Any]
    roles: Mapping[str, Role]

    def __call__(self, p: Vector, R: Matrix, **parameters: Any) -> Any:
        """The value at a pose, in whatever algebra it is called with."""
        return self.function(p, R, **parameters)

    @cached_property
    def width(self) -> int:
        """How many numbers a contact of this kind has."""
        return sum(role.width for role in self.roles.values())

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """A record of these numbers."""
        return np.dtype([(name, "f8", () if role is Role.SCALAR else 3) for name, role in self.roles.items()])


_CONTACTS: dict[str, Definition] = {}
# Read-only, as generated kernels and tables go by its order
CONTACTS: Mapping[str, Definition] = MappingProxyType(_CONTACTS)
"""The kinds of primitive contacts, in the order of their tables."""


def contact(function: Callable[..., Any]) -> Definition:
    """Makes a function f(p, R, …) the definition of a kind of contact; annotations tell the roles of its parameters."""
    hints = get_type_hints(function, include_extras=True)
    roles = {name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")}
    roles.pop("return", None)
    # The first definition of a name stays: a module that is loaded twice does not change the tables.
    name = function.__name__
    return _CONTACTS.setdefault(name, Definition(name, function, MappingProxyType(roles)))


def dot(a: Vector, b: Vector) -> Any:
    """a·b."""
    if hasattr(a, "dotted"):
        return a.dotted(b)
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    if hasattr(a, "crossed"):
        return a.crossed(b)
    found = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    library = _library(a)
    if library == "casadi":
        return sys.modules[library].vertcat(*found)
    # The same class of matrix again: results of mpmath and SymPy have to go on in their own precision.
    return np.array(found) if library not in _ALGEBRAS else type(a)(found)


def root(s: Any) -> Any:
    """The square root of a number."""
    if hasattr(s, "rooted"):
        return s.rooted()
    library = _library(s)
    return np.sqrt(s) if library not in _ALGEBRAS else sys.modules[library].sqrt(s)


def norm(a: Vector) -> Any:
    """|a|."""
    return root(dot(a, a))


def _library(value: Any) -> str:
    return type(value).__module__.split(".")[0]
