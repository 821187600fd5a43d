"""What is made of files is made once, of the same file by the same code; an entry that is none is made anew."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.csg import Box
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.runtime import store


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(store.FOLDER, str(tmp_path / "store"))
    return tmp_path / "store"


def box(made: list[int], size: float = 1.0) -> Polyhedron:
    def make() -> Polyhedron:
        made.append(1)
        return polyhedron(Box((size, size, 2.0)))

    return store.kept(("box", size), make)


def test_what_was_made_is_found_again_and_stays_frozen(folder: Path) -> None:
    made: list[int] = []
    first, again, other = box(made), box(made), box(made, 3.0)
    assert len(made) == len(list(folder.iterdir())) == 2
    assert again is not first
    assert again.faces[0].loops == first.faces[0].loops
    assert np.array_equal(again.vertices, first.vertices)
    assert other.volume == pytest.approx(18.0)
    with pytest.raises(ValueError, match="read-only"):
        again.vertices[0] = 0.0


class Run:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return exec, ("raise SystemExit('executed')",)


@pytest.mark.parametrize("harm", ["cut", "changed", "forged", "folder"])
def test_an_entry_that_is_none_is_made_anew_and_nothing_of_it_is_executed(folder: Path, harm: str) -> None:
    made: list[int] = []
    volume = box(made).volume
    (entry,) = folder.iterdir()
    data = entry.read_bytes()
    if harm == "folder":
        entry.unlink()
        entry.mkdir()
    elif harm == "forged":
        content = pickle.dumps(Run(), protocol=4)
        entry.write_bytes(store.hashlib.sha256(content).digest() + content)
    else:
        entry.write_bytes(data[:-9] if harm == "cut" else data[:-9] + bytes(9))
    assert (box(made).volume, len(made)) == (volume, 2)


def test_without_a_folder_all_is_made_anew_and_unused_goes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    monkeypatch.setenv(store.FOLDER, "")
    assert box(made) is not box(made)
    assert len(made) == 2
    monkeypatch.setenv(store.FOLDER, str(folder))
    monkeypatch.setattr(store, "_MOST_BYTES", 5000)
    for size in (1.0, 2.0, 3.0, 4.0, 1.0):
        box(made, size)
    assert len(made) > 5
    assert 0 < sum(one.stat().st_size for one in folder.iterdir()) <= 5000
