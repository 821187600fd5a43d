"""Files that are written: whole or not at all, and to regular files only."""

import errno
import os
import socket
import stat
from pathlib import Path
from typing import Any

import pytest

from fmopt.errors import ResourceError
from fmopt.runtime import output


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_whole_and_alone(tmp_path: Path) -> None:
    output.save(b"one", tmp_path / "a" / "b" / "file")
    output.save(b"two", tmp_path / "a" / "b" / "file")
    assert (tmp_path / "a" / "b" / "file").read_bytes() == b"two"
    assert left(tmp_path / "a" / "b") == ["file"]


def test_who_may_read_a_file_stays(tmp_path: Path) -> None:
    file = tmp_path / "file"
    output.save(b"one", file)
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(file.stat().st_mode) == 0o666 & ~mask
    file.chmod(0o640)
    output.save(b"two", file)
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


def test_a_link_is_followed_and_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "file")
    for content in (b"one", b"two"):
        output.save(content, tmp_path / "link")
        assert (tmp_path / "there" / "file").read_bytes() == content
    assert (tmp_path / "link").is_symlink()
    assert left(tmp_path) == ["link", "there"]
    assert left(tmp_path / "there") == ["file"]


@pytest.mark.parametrize("kind", ["device", "link to a device", "pipe", "socket", "folder", "ring"])
def test_what_is_no_file_stays_as_it_is(tmp_path: Path, kind: str) -> None:
    place = tmp_path / "place"
    if kind == "device":
        place = Path("/dev/full")
    elif kind == "link to a device":
        place.symlink_to("/dev/null")
    elif kind == "pipe":
        os.mkfifo(place)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as door:
            door.bind(str(place))
    elif kind == "folder":
        place.mkdir()
    else:
        place.symlink_to(place)
    before = os.lstat(place)
    with pytest.raises(ResourceError, match=kind.split()[-1] if kind != "ring" else "links") as caught:
        output.save(b"text", place)
    assert caught.value.exit_code == 4
    assert "--out" in caught.value.advice
    after = os.lstat(place)
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
    assert left(tmp_path) == ([] if kind == "device" else ["place"])


def test_a_disk_that_is_full_keeps_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output.save(b"before", tmp_path / "file")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResourceError, match="No space left"):
        output.save(b"after", tmp_path / "file")
    with pytest.raises(ResourceError, match="No space left"), output.fresh(tmp_path / "bag") as folder:
        output.save(b"inside", folder / "one")
    assert left(tmp_path) == ["file"]
    assert (tmp_path / "file").read_bytes() == b"before"


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError, SystemExit])
def test_an_interruption_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type) -> None:
    def interrupted(*_: Any) -> None:
        raise error

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(error):
        output.save(b"text", tmp_path / "file")

    def bag() -> None:
        with output.fresh(tmp_path / "bag") as folder:
            folder.mkdir()
            (folder / "one").write_text("text")
            raise error

    with pytest.raises(error):
        bag()
    assert left(tmp_path) == []


def test_what_is_being_written_is_abandoned_at_once(tmp_path: Path) -> None:
    def bag() -> None:
        with output.fresh(tmp_path / "bag") as folder:
            output.save(b"text", folder / "one")
            output.abandon()
            assert left(tmp_path) == []
            (folder / "two").write_text("text")

    with pytest.raises(ResourceError):
        bag()


def test_a_folder_comes_whole_and_replaces_nothing(tmp_path: Path) -> None:
    with output.fresh(tmp_path / "a" / "bag") as folder:
        assert folder.name == "bag"
        output.save(b"text", folder / "deep" / "one")
        assert not (tmp_path / "a" / "bag").exists()
    assert (tmp_path / "a" / "bag" / "deep" / "one").read_bytes() == b"text"
    assert left(tmp_path / "a") == ["bag"]
    with pytest.raises(ResourceError, match="exists already"), output.fresh(tmp_path / "a" / "bag"):
        raise AssertionError("nothing is done")


def test_a_folder_for_results_is_one(tmp_path: Path) -> None:
    output.prepare(tmp_path / "a" / "b")
    assert left(tmp_path / "a" / "b") == []
    (tmp_path / "file").write_text("text")
    for place in (tmp_path / "file", tmp_path / "file" / "below", Path("/dev/full"), Path("/proc/none")):
        with pytest.raises(ResourceError) as caught:
            output.prepare(place)
        assert caught.value.exit_code == 4
