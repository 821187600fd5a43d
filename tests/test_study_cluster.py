"""The same study on a Dask scheduler with two workers: the same rows, byte for byte."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import study_evaluations as evaluations

from fmopt.errors import ResourceError
from fmopt.study import workers
from fmopt.study.batch import Batch, Limits, digest
from fmopt.study.cluster import cluster
from fmopt.study.running import Options, run
from fmopt.study.store import recorded

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a local cluster, in a process of its own as a user runs it."""
    code = (
        "import sys\nfrom distributed import LocalCluster\n"
        "if __name__ == '__main__':\n"
        "    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:\n"
        "        print(cluster.scheduler_address, flush=True)\n        sys.stdin.read()\n"
    )
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    ) as running:
        assert running.stdout is not None
        yield running.stdout.readline().strip()
        running.communicate(timeout=60)


def test_a_cluster_gives_the_same_rows(scheduler: str, tmp_path: Path) -> None:
    work = replace(evaluations.work(60, Limits(seconds=2.0, memory=4 << 30)))
    run(work, tmp_path / "here", evaluations.mixed, Options(2))
    with cluster(scheduler) as (executor, threads):
        tally = run(work, tmp_path / "there", evaluations.mixed, Options(threads, limit=25), executor)
        assert (tally.done, tally.total) == (25, 60)
    with cluster(scheduler) as (executor, threads):
        tally = run(work, tmp_path / "there", evaluations.mixed, Options(threads), executor)
    assert (tally.done, tally.failed) == (60, 6)
    assert recorded(tmp_path / "there") == recorded(tmp_path / "here")


def test_a_host_that_is_lost_costs_one_run(scheduler: str, tmp_path: Path) -> None:
    with cluster(scheduler) as (executor, threads):
        tally = run(evaluations.work(6), tmp_path, evaluations.hostile, Options(threads), executor)
    assert (tally.done, tally.failed) == (6, 1)
    rows = [record.row for record in recorded(tmp_path)[1]]
    assert [row and row.outcome for row in rows] == ["killed", "done", "done", "done", "done", "done"]
    assert rows[0] is not None
    assert rows[0].reason == "its host was lost 3 times"


def test_the_command_works_on_a_cluster(scheduler: str, tmp_path: Path) -> None:
    study = tmp_path / "gaps.toml"
    study.write_text(
        f'title = "t"\nproblem = "{ROOT}/problems/square_peg.toml"\ncompute = ["clearance"]\n'
        '[units]\nlength = "mm"\nangle = "deg"\n'
        '[[axes]]\nname = "gap"\nvalues = [0.05, 0.1, 0.2]\nsets = { "model.fixed.width" = "20 mm + 2 * gap" }\n'
    )
    command = [sys.executable, "-m", "fmopt", "study", str(study), "--quiet", "--out"]
    subprocess.run([*command, str(tmp_path / "there"), "--cluster", scheduler], check=True, timeout=120)
    subprocess.run([*command, str(tmp_path / "here")], check=True, timeout=120)
    assert (tmp_path / "there" / "table.csv").read_bytes() == (tmp_path / "here" / "table.csv").read_bytes()
    assert not (tmp_path / "there" / "inputs").exists()


def test_another_version_on_a_host_is_refused(tmp_path: Path) -> None:
    work = evaluations.work(1)
    batch = Batch(tuple(work.runs), evaluations.quick, Limits(), work.inputs, None, "0.0.0+other")
    with pytest.raises(ResourceError, match=r"a worker runs fmopt .*, the study 0\.0\.0\+other"):
        workers.run_batch(batch)


def test_inputs_are_told_apart_by_name_and_content() -> None:
    assert digest({"a": b"1", "b": b"2"}) == digest({"b": b"2", "a": b"1"})
    assert len({digest(x) for x in ({"a": b"1"}, {"a": b"2"}, {"b": b"1"}, {"a": b"1", "b": b""})}) == 4


def test_a_scheduler_without_workers_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmopt.study.cluster._PATIENCE", "1s")
    code = (
        "import sys\nfrom distributed import LocalCluster\n"
        "with LocalCluster(n_workers=0, dashboard_address=None) as cluster:\n"
        "    print(cluster.scheduler_address, flush=True)\n    sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as running:
        assert running.stdout is not None
        address = running.stdout.readline().strip()
        with pytest.raises(ResourceError, match="the scheduler has no workers"), cluster(address):
            pass
        running.communicate(timeout=60)


def test_no_scheduler_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmopt.study.cluster._PATIENCE", "1s")
    began = time.monotonic()
    with (
        pytest.raises(ResourceError, match=r"tcp://127\.0\.0\.1:9: no scheduler answers"),
        cluster("tcp://127.0.0.1:9"),
    ):
        pass
    assert time.monotonic() - began < 30.0
    with pytest.raises(ResourceError, match="no scheduler answers"), cluster("nonsense://x"):
        pass
