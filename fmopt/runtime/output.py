"""Files that the program writes: regular ones only, whole or not at all, and nothing left over when it fails.

A file is written beside its place under another name, synchronised, and moved over what is there. Devices, pipes and
sockets are no places for files: replacing one by a file would break it for everybody else.
"""

import atexit
import itertools
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from fmopt.errors import ResourceError

_ADVICE = "choose another place with --out"
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}
_NUMBERS = itertools.count()
_unfinished: set[str] = set()  # names of what is being written, for who has to leave at once


def prepare(folder: Path) -> None:
    """Makes a folder for results, before the work is done that would go there.

    Raises:
        ResourceError: it cannot be made or written to, or is none.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refused(folder, error) from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResourceError(f"{folder}: nothing can be written there", _ADVICE)


def own_folder() -> Path:
    """A new folder of this process's own, which goes when the process ends.

    Raises:
        ResourceError: it cannot be made.
    """
    try:
        made = tempfile.mkdtemp(prefix="fmopt-")
    except OSError as error:
        raise ResourceError(f"{error.filename or tempfile.gettempdir()}: {error.strerror}", "free some disk") from error
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return Path(made)


def save(content: bytes, path: Path) -> None:
    """Writes a file, whole or not at all; who may do what with a file that is there stays as it is.

    Raises:
        ResourceError: something else than a regular file is there, or it cannot be written.
    """
    place = Path(os.path.realpath(path))  # a link that were replaced itself would lead nowhere else any more
    partial = _beside(place)
    try:
        before = _regular(place, path)
        place.parent.mkdir(parents=True, exist_ok=True)
        _unfinished.add(str(partial))  # before it is there: a signal may come at any time
        _write(content, partial, before)
        partial.replace(place)
        synchronise(place.parent)  # the name that it has now stands there
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        _forget(partial)


def set_aside(folder: Path, names: Sequence[str]) -> list[Path]:
    """Renames files of an earlier run, so that nobody takes them for what this one found; where they are now.

    Raises:
        ResourceError: one cannot be renamed.
    """
    found = []
    for path in (folder / name for name in names):
        if path.is_file():
            found.append(path.with_name(f"earlier-{path.name}"))
            try:
                path.replace(found[-1])  # over what a run before that had set aside
            except OSError as error:
                raise _refused(path, error) from error
    return found


@contextmanager
def fresh(path: Path) -> Iterator[Path]:
    """A folder to be made and filled, which comes to its place once all of it is written.

    Raises:
        ResourceError: something is there, or it cannot be written.
    """
    home = _beside(Path(os.path.realpath(path)))
    try:
        if os.path.lexists(path):
            raise ResourceError(f"{path}: exists already", "choose another folder with --out")
        _unfinished.add(str(home))
        # Under its last name, after which a writer of bags calls its files, and not made: it makes its folder itself.
        folder = home / path.name
        home.mkdir(parents=True)
        yield folder
        folder.mkdir(exist_ok=True)
        # What `save` wrote is on disk already; what libraries wrote may not be.
        for file in (found for found in folder.rglob("*") if found.is_file()):
            synchronise(file)
        folder.rename(os.path.realpath(path))  # refused where a file or a filled folder has come there meanwhile
        synchronise(home.parent)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        _forget(home)


def abandon() -> None:
    """Takes away what is being written, as this process has to leave at once."""
    for name in list(_unfinished):  # a copy, as each that is taken away leaves the set
        _forget(Path(name))


def synchronise(path: Path) -> None:
    """Makes the content of a file, or the names in a folder, durable.

    Raises:
        OSError: the disk does not take it.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _beside(place: Path) -> Path:
    # In the same folder: a move is at once only within a file system. No two that are being written have one name.
    return place.with_name(f".fmopt-{os.getpid()}-{next(_NUMBERS)}.part")


def _regular(place: Path, path: Path) -> os.stat_result | None:
    """The state of the regular file that is there, None where nothing is."""
    try:
        there = place.stat()
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(there.st_mode):
        kind = _KINDS.get(stat.S_IFMT(there.st_mode), "no regular file")
        raise ResourceError(f"{path}: is {kind}, and stays as it is", f"{_ADVICE}, or - for standard output")
    # Moving a file over another asks for no right to that one: whoever protected it is heeded all the same.
    if not os.access(place, os.W_OK):
        raise ResourceError(f"{path}: is write-protected", f"{_ADVICE}, or allow to write to it")
    return there


def _write(content: bytes, partial: Path, before: os.stat_result | None) -> None:
    # O_EXCL: a link that somebody has put under this name is not followed.
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    with os.fdopen(descriptor, "wb") as file:
        if before is not None:
            mine = os.fstat(descriptor)
            # Only the superuser may give files away.
            if (mine.st_uid, mine.st_gid) != (before.st_uid, before.st_gid) and os.geteuid() == 0:
                os.fchown(descriptor, before.st_uid, before.st_gid)
            # After the owner, whose change drops bits of it; before the content, which may be for few to read.
            os.fchmod(descriptor, stat.S_IMODE(before.st_mode))
        file.write(content)
        file.flush()
        os.fsync(descriptor)  # before it is moved: the name would else survive a crash that the content does not


def _forget(partial: Path) -> None:
    """Takes away what was not finished, as far as the disk allows; what has come to its place has another name."""
    with suppress(OSError):
        shutil.rmtree(partial, ignore_errors=True) if partial.is_dir() else partial.unlink()
    _unfinished.discard(str(partial))


def _refused(path: Path, error: OSError) -> ResourceError:
    return ResourceError(f"{path}: {error.strerror or error}", _ADVICE)
