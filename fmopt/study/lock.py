"""One owner of a folder at a time: a POSIX record lock, which the kernel drops when its owner dies."""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fmopt.errors import ResourceError

_FLOCK = "hhqqi4x"  # struct flock: type, whence, start, length, pid
_HERE: set[tuple[int, int]] = set()  # files that this process holds: the kernel lets a process lock a file twice


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Holds a folder until the block ends.

    Args:
        folder: it exists.

    Raises:
        ResourceError: it is held already, by which process; or it cannot be written to.
    """
    path = folder / "lock"
    if path.exists() and _name(path.stat()) in _HERE:  # opening and closing it would give up the lock
        raise _taken(folder, os.getpid())
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise ResourceError(f"{path}: {error.strerror or error}", "choose another folder with --out") from error
    name = _name(os.fstat(descriptor))
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        owner = _owner(descriptor)
        os.close(descriptor)
        raise _taken(folder, owner) from None
    except OSError as error:
        os.close(descriptor)
        raise ResourceError(f"{path}: {error.strerror or error}", "choose a folder whose disk knows locks") from error
    _HERE.add(name)
    try:
        yield
    finally:
        _HERE.discard(name)
        os.close(descriptor)


def _name(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def _owner(descriptor: int) -> int:
    """The process that holds the lock, as the kernel knows it; 0 when it has just let go."""
    asked = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
    kind, _, _, _, pid = struct.unpack(_FLOCK, fcntl.fcntl(descriptor, fcntl.F_GETLK, asked))
    return 0 if kind == fcntl.F_UNLCK else int(pid)


def _taken(folder: Path, owner: int) -> ResourceError:
    who = f"process {owner}" if owner else "another process, which is just ending,"
    return ResourceError(f"{folder}: {who} runs a study in this folder", "wait for it, or choose another with --out")
