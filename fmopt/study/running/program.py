"""Which program computes: its version and its sources, so that results of different programs are never mixed."""

import hashlib
from functools import cache
from importlib import metadata
from pathlib import Path

import fmopt

_LIBRARIES = (
    *("casadi", "clarabel", "daqp", "manifold3d", "numpy", "scipy", "shapely", "sympy"),
    *("cadquery-ocp", "cadquery-ocp-novtk", "mujoco"),  # of extras, where they are installed
)


@cache
def program() -> str:
    """Version, and a hash of the package's own files and of the versions of the libraries that compute."""
    whole = hashlib.sha256()
    root = Path(fmopt.__file__).parent
    for path in sorted(root.rglob("*.py")):  # a disk lists them in any order
        content = path.read_bytes()
        whole.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode() + content)
    for name in _LIBRARIES:
        whole.update(f"{name} {_version(name)}\0".encode())
    return f"{fmopt.__version__}+{whole.hexdigest()[:16]}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "none"  # that it is missing tells programs apart, too
