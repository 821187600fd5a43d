"""The problems and models that come with the program."""

from os import PathLike
from pathlib import Path

import fmopt
from fmopt.errors import ChoiceError, ResourceError
from fmopt.runtime import output

_FOLDERS = ("models", "problems")


def _root() -> Path:
    """The folder that holds `models` and `problems`: inside an installed package, beside a checkout's."""
    package = Path(fmopt.__file__).parent
    return package / "shipped" if (package / "shipped").is_dir() else package.parent


def examples() -> tuple[str, ...]:
    """Names of the shipped problems.

    >>> "square_peg" in fmopt.examples()
    True
    """
    return tuple(sorted(file.stem for file in (_root() / "problems").glob("*.toml")))


def example(name: str) -> Path:
    """The file of a shipped problem.

    >>> fmopt.example("square_peg").name
    'square_peg.toml'

    Raises:
        ChoiceError: there is none of this name.
    """
    if name not in examples():
        raise ChoiceError(f"no shipped problem is called {name!r}", f"choose from {', '.join(examples())}")
    return _root() / "problems" / f"{name}.toml"


def copy_examples(folder: str | PathLike[str]) -> tuple[Path, ...]:
    """Copies the folders of shipped problems and models, to be changed at will; gives the files written, in order.

    Raises:
        ResourceError: a file is there already, or cannot be written; nothing is overwritten.
    """
    target = Path(folder)
    files = [file for name in _FOLDERS for file in sorted((_root() / name).rglob("*")) if file.is_file()]
    pairs = [(file, target / file.relative_to(_root())) for file in files]
    # Looked at before anything is written, so that nothing is left half copied.
    there = [str(copy) for _, copy in pairs if copy.exists()]
    if there:
        raise ResourceError(f"{there[0]} is there already", "choose an empty folder with --out")
    for file, copy in pairs:
        output.save(file.read_bytes(), copy)
    return tuple(copy for _, copy in pairs)
