"""What travels between the one who keeps a study and those who work for it: runs, batches and their results."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from fmopt.errors import ResourceError
from fmopt.runtime import output
from fmopt.study.running.store import Effort, Outcome, Row
from fmopt.task.toml.source import Key

Assigned = str | int | float | bool


@dataclass(frozen=True)
class StudyContext:
    """What all runs of a study have in common; files of problem and plan are relative to the folder of inputs."""

    problem: str
    quantities: tuple[str, ...]
    keep: tuple[str, ...] = ()
    plan: str = ""


@dataclass(frozen=True)
class Run:
    """One evaluation.

    Args:
        assigned: values put into the base problem, by key path; texts with units, numbers and choices as TOML has them.
    """

    key: str
    assigned: tuple[tuple[Key, Assigned], ...]
    question: StudyContext


Evaluate = Callable[[Run, Path], Row]
"""The row of a run, given the folder of its input files; a pure function, importable by name where workers live."""


@dataclass(frozen=True)
class Limits:
    """What one run may take: seconds, and bytes of address space; None for no limit."""

    seconds: float | None = None
    memory: int | None = None


@dataclass(frozen=True)
class Batch:
    """Runs that one worker does in one go.

    The folder is None where only the contents of the files are known: on another machine. The host must run the
    program, too, if one is named.
    """

    runs: tuple[Run, ...]
    evaluate: Evaluate
    limits: Limits
    inputs: Mapping[str, bytes]
    folder: Path | None
    program: str = ""


@dataclass(frozen=True)
class Loss:
    """How the process of a run ended that has no answer; the outcome is "killed" where it was ended from outside."""

    outcome: Outcome
    reason: str
    seconds: float


@dataclass(frozen=True)
class Returned:
    """What came of a batch: rows of its first runs in order, and how the next one was lost, if it was."""

    rows: tuple[tuple[Row, Effort], ...]
    loss: Loss | None = None


_FOLDERS: dict[str, Path] = {}  # this process's own, until it ends


def digest(inputs: Mapping[str, bytes]) -> str:
    """SHA-256 (hex) of files with their names."""
    whole = hashlib.sha256()
    for name in sorted(inputs):
        # With its length, so that no content passes for the name and content of another file.
        whole.update(f"{name}\0{len(inputs[name])}\0".encode() + inputs[name])
    return whole.hexdigest()


def laid_out(inputs: Mapping[str, bytes], home: Path | None) -> Path:
    """The folder that holds these files, below `home` or one that goes with this process, made whole or not at all.

    Raises:
        ResourceError: it cannot be written.
    """
    # By content: what is there under this name need not be written, and changed files get a folder of their own.
    name = digest(inputs)[:16]
    if home is None:
        home = _FOLDERS[name] = _FOLDERS.get(name) or output.own_folder()
    folder = home / name
    try:
        if not folder.is_dir():
            with output.fresh(folder) as partial:
                for file, content in inputs.items():
                    output.save(content, partial / file)
    except ResourceError:
        if not folder.is_dir():  # unless another thread was faster
            raise
    return folder
