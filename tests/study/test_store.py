"""The store of a study: durable and whole or nothing, one owner, errors in words."""

import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from fmopt.errors import InputError, ResourceError
from fmopt.study.running.store import Effort, Numbered, Row, Store, efforts, kept, owned, recorded

EFFORT = Effort(0.5, 1000)


def row(key: str, value: float = 1.0) -> Row:
    return Row(key, "done", "", {"value": value, "word": "é", "none": None, "sure": True})


def design(*keys: str) -> list[Numbered]:
    return [Numbered(n, key, {"x": 0.1 * n}) for n, key in enumerate(keys)]


def test_what_was_taken_reads_back_in_the_order_of_the_design(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.design(design("b", "a", "c"), {"title": "t"})
        store.add([(row("a", 0.1 + 0.2), EFFORT), (Row("b", "crash", "SIGSEGV", {}, b"kept"), EFFORT)])
    facts, found = recorded(tmp_path)
    assert facts["title"] == "t"
    assert [record.run for record in found] == design("b", "a", "c")
    assert [record.row and record.row.key for record in found] == ["b", "a", None]
    assert found[1].row == row("a", 0.1 + 0.2)
    assert kept(tmp_path, "b") == b"kept"
    assert kept(tmp_path, "a") is None
    assert efforts(tmp_path)["a"] == EFFORT


def test_a_row_that_is_done_stays_and_a_failed_one_gives_way(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.add([(row("a", 1.0), EFFORT), (Row("b", "killed", "SIGKILL", {}), EFFORT)])
        store.add([(row("a", 2.0), EFFORT), (row("b", 3.0), EFFORT)])
        store.add([(Row("b", "timeout", "late", {}), EFFORT)])
        store.design(design("a", "b"), {})
    _, found = recorded(tmp_path)
    assert [record.row and record.row.answers["value"] for record in found] == [1.0, 3.0]


def test_a_batch_is_taken_whole_or_not_at_all(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        with pytest.raises(ValueError, match="not JSON compliant"):
            store.add([(row("a"), EFFORT), (row("b", float("nan")), EFFORT)])
        assert store.outcomes() == {}
        store.add([(row("a"), EFFORT)])
        assert store.outcomes() == {"a": "done"}


def test_results_outlive_a_change_of_the_design(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.design(design("a", "b"), {})
        store.add([(row("a"), EFFORT)])
        store.design(design("c", "a"), {})
        with pytest.raises(sqlite3.IntegrityError), store._file:
            store._file.execute("INSERT INTO runs VALUES (0, 'x', '{}')")
    _, found = recorded(tmp_path)
    assert [(record.run.key, record.row is not None) for record in found] == [("c", False), ("a", True)]


def test_the_settings_that_make_it_durable_hold(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        assert store._file.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert store._file.execute("PRAGMA synchronous").fetchone() == (2,)


def test_what_is_no_store_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no study in this folder"):
        recorded(tmp_path)
    (tmp_path / "study.sqlite").write_bytes(b"no database " * 1000)
    with pytest.raises(ResourceError, match="not a database"):
        Store(tmp_path)
    with pytest.raises(ResourceError, match="not a database"):
        recorded(tmp_path)
    with pytest.raises(ResourceError, match="unable to open"):
        Store(tmp_path / "missing")


def test_a_store_of_another_format_is_refused(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.design([], {"format": "fmopt.study/99"})
    with pytest.raises(ResourceError, match=r"fmopt\.study/99"):
        Store(tmp_path)


def test_a_folder_has_one_owner_who_is_named(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom fmopt.study.running.store import owned\n"
        "with owned(Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ResourceError, match=f"process {other.pid} runs a study"), owned(tmp_path):
            pass
        other.kill()
    with owned(tmp_path):
        with pytest.raises(ResourceError, match=f"process {os.getpid()} runs a study"), owned(tmp_path):
            pass
        with pytest.raises(ResourceError, match=f"process {os.getpid()} runs a study"), owned(tmp_path):
            pass
    with owned(tmp_path):
        pass


def test_a_folder_that_cannot_be_locked_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResourceError, match="No such file"), owned(tmp_path / "missing"):
        pass
