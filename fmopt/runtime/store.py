"""What takes seconds to make of a file, kept between processes by the digest of all that it depends on.

An entry is a pickle that may name nothing but arrays and value classes of this package: nothing that it holds is
executed. Where there is no folder for it, all is made anew each time.
"""

import hashlib
import io
import os
import pickle
from collections.abc import Callable
from contextlib import suppress
from dataclasses import is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

from fmopt.errors import ResourceError
from fmopt.runtime.output import save

FOLDER = "FMOPT_STORE"  # environment variable that names another folder, or none where it is empty
_MOST_BYTES = 500_000_000
_PACKAGE = Path(__file__).parents[1]
_VALUES = ("fmopt.geometry.", "fmopt.spatial.")
_ARRAYS = {("numpy", "ndarray"), ("numpy", "dtype")}
_ARRAYS |= {("numpy._core.multiarray", name) for name in ("_reconstruct", "scalar")}
_LIBRARIES = ("numpy", "scipy", "shapely", "manifold3d", "trimesh", "cadquery-ocp", "cadquery-ocp-novtk")

T = TypeVar("T")


def kept(depends: object, make: Callable[[], T]) -> T:
    """What `make` makes, or made before of an equal value that can be pickled, on which all of it depends."""
    folder = _folder()
    if folder is None:
        return make()
    path = folder / hashlib.sha256(_state() + pickle.dumps(depends, protocol=5)).hexdigest()
    try:
        data = path.read_bytes()
        if hashlib.sha256(data[32:]).digest() == data[:32]:
            os.utime(path)  # the entries that were not asked for the longest go first
            found: T = _Reader(io.BytesIO(data[32:])).load()
            return found
    except (OSError, pickle.UnpicklingError):  # of no entry, or of one that something else wrote
        pass
    made = make()
    content = pickle.dumps(made, protocol=4)  # of the next one arrays name more than these
    with suppress(ResourceError, OSError):  # without room on the disk it is made anew
        save(hashlib.sha256(content).digest() + content, path)
        _tidy(folder)
    return made


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """The class of that name, if it is one that entries may name."""
        if (module, name) in _ARRAYS:
            return super().find_class(module, name)
        if module.startswith(_VALUES) and name.isidentifier():
            found = super().find_class(module, name)
            if isinstance(found, type) and (is_dataclass(found) or issubclass(found, tuple | dict)):
                return found
        raise pickle.UnpicklingError(f"an entry of the store names {module}.{name}")


def _folder() -> Path | None:
    stated = os.environ.get(FOLDER)
    if stated is not None:
        return Path(stated) if stated else None
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "fmopt" / "parts"
    except RuntimeError:  # nobody's home
        return None


@cache
def _state() -> bytes:
    """Digest of the code that makes what is kept, and of the libraries that it rests on."""
    digest = hashlib.sha256()
    for path in sorted(file for name in ("geometry", "spatial") for file in (_PACKAGE / name).rglob("*.py")):
        digest.update(path.read_bytes())
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            digest.update(f"{name} {version(name)}".encode())
    return digest.digest()


def _tidy(folder: Path) -> None:
    """Removes the entries that were not asked for the longest where they take too much room."""
    entries = sorted(((one.stat().st_mtime, one.stat().st_size, one) for one in folder.iterdir()), reverse=True)
    total = 0
    for _, size, path in entries:
        total += size
        if total > _MOST_BYTES:
            path.unlink(missing_ok=True)
