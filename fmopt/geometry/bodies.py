"""The bodies of a file that may hold several: products of a STEP file, objects of a mesh, or what lies apart in it."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from fmopt.runtime.store import kept

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import NamedBody, Unit

T = TypeVar("T")
MAX_MESH_BYTES = 100_000_000


def bodies_of(path: Path, unit: str | None) -> "tuple[NamedBody, ...]":
    """All bodies of a STEP or mesh file, the numbers of the latter in mm if no unit is given.

    Raises:
        ResourceError, SizeError, GeometryError: it cannot be read.
    """
    if path.suffix.lower() in (".step", ".stp"):
        from fmopt.geometry.step.step_import import bodies

        return kept_of(path, "", lambda: bodies(path))
    from fmopt.geometry.mesh.mesh_file import OWN_UNIT
    from fmopt.geometry.mesh.mesh_import import mesh_bodies

    own = cast("Unit", "m" if path.suffix.lower()[1:] in OWN_UNIT else unit or "mm")
    return kept_of(path, own, lambda: mesh_bodies(path, own))


def lie_apart(path: Path) -> bool:
    """Whether a mesh file has several objects that are not one part; errors as of `bodies_of`."""
    from fmopt.geometry.mesh import mesh_import

    return kept_of(path, "apart", lambda: mesh_import.lie_apart(path))


def kept_of(path: Path, how: object, make: Callable[[], T]) -> T:
    """What is made of a file, kept; of none, or of one that is too large, its reader says what is wrong."""
    if not path.is_file() or path.stat().st_size > MAX_MESH_BYTES:
        return make()
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return kept((digest, path.suffix.lower(), how), make)
