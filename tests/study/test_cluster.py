"""The same study on a Dask scheduler with two workers: the same rows, byte for byte."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from fmopt.errors import ResourceError
from fmopt.study.running import workers
from fmopt.study.running.batch import Batch, Limits, digest
from fmopt.study.running.cluster import cluster
from fmopt.study.running.running import Options, run
from fmopt.study.running.store import Effort, Row, Store, recorded
from tests import ROOT
from tests.shared.studies import evaluations

PATH = {"PYTHONPATH": str(ROOT)}
SCHEDULER = (
    "import sys\nfrom distributed import LocalCluster\n"
    "with LocalCluster(n_workers=0, dashboard_address=None) as cluster:\n"
    "    print(cluster.scheduler_address, flush=True)\n    sys.stdin.read()\n"
)
WORKER = ("-m", "distributed.cli.dask_worker", "--no-nanny", "--no-dashboard", "--nthreads", "1")


def started(**settings: str) -> subprocess.Popen[str]:
    """A scheduler without workers, in a process of its own as a user runs it; its first line is its address."""
    return subprocess.Popen(
        [sys.executable, "-c", SCHEDULER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, **PATH, **settings},
    )


@contextmanager
def running_scheduler() -> Iterator[str]:
    """The address of a scheduler without workers, which forgives no loss."""
    with started(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as running:
        yield running.stdout.readline().strip()
        running.communicate(timeout=60)


def kept_alive(address: str, over: threading.Event, lives: int) -> None:
    """A worker, and another one whenever it is lost, so many in all."""
    for _ in range(lives):
        if over.is_set():
            break
        words, environment = [sys.executable, *WORKER, address], {**os.environ, **PATH}
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment) as worker:
            while worker.poll() is None and not over.wait(0.1):
                pass
            worker.kill()


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a scheduler with two workers."""
    over = threading.Event()
    with running_scheduler() as address:
        hosts = [threading.Thread(target=kept_alive, args=(address, over, 1000)) for _ in range(2)]
        for host in hosts:
            host.start()
        yield address
        over.set()
        for host in hosts:
            host.join()


def test_a_cluster_gives_the_same_rows(scheduler: str, tmp_path: Path) -> None:
    work = replace(evaluations.work(60, Limits(seconds=2.0, memory=4 << 30)))
    run(work, tmp_path / "here", evaluations.mixed, Options(2))
    tally = run(work, tmp_path / "there", evaluations.mixed, Options(limit=25, cluster=scheduler))
    assert (tally.done, tally.total) == (25, 60)
    tally = run(work, tmp_path / "there", evaluations.mixed, Options(cluster=scheduler))
    assert (tally.done, tally.failed) == (60, 6)
    assert recorded(tmp_path / "there") == recorded(tmp_path / "here")


def test_a_host_that_is_lost_costs_one_run(scheduler: str, tmp_path: Path) -> None:
    tally = run(evaluations.work(6), tmp_path, evaluations.hostile, Options(cluster=scheduler))
    assert (tally.done, tally.failed) == (6, 1)
    rows = [record.row for record in recorded(tmp_path)[1]]
    assert [row and row.outcome for row in rows] == ["killed", "done", "done", "done", "done", "done"]
    assert rows[0].reason == "its host was lost, 3 times"


@pytest.mark.wide
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
    monkeypatch.setattr("fmopt.study.running.cluster._COMING", 1.0)
    no_workers = pytest.raises(ResourceError, match="the scheduler has no workers")
    with running_scheduler() as address, no_workers, cluster(address):
        pass


def test_a_study_without_hosts_ends_and_goes_on_later(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("fmopt.study.running.cluster._RETURN", 2.0)
    work, over = evaluations.work(6), threading.Event()
    with running_scheduler() as address:
        host = threading.Thread(target=kept_alive, args=(address, over, 1))
        host.start()
        with pytest.raises(ResourceError, match="lost all its workers"):
            run(work, tmp_path, evaluations.hostile, Options(cluster=address))
        over.set()
        host.join()
    assert sum(record.row is not None for record in recorded(tmp_path)[1]) < 6
    assert run(work, tmp_path, evaluations.quick, Options(1)).done == 6


def test_no_scheduler_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmopt.study.running.cluster._PATIENCE", 1.0)
    began = time.monotonic()
    with pytest.raises(ResourceError, match=r"127\.0\.0\.1:9: no scheduler answers"), cluster("tcp://127.0.0.1:9"):
        pass
    assert time.monotonic() - began < 30.0


@pytest.mark.parametrize("address", ["nonsense", "nonsense://x:1", "tcp://", "tcp://host", "tcp://host:port", ""])
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    with pytest.raises(ResourceError, match="this is no address of a scheduler"), cluster(address):
        pass


def test_a_scheduler_that_dies_ends_the_study_without_failures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("fmopt.study.running.cluster._PATIENCE", 3.0)
    work, over = evaluations.work(400), threading.Event()
    with started() as running:
        address = running.stdout.readline().strip()
        host = threading.Thread(target=kept_alive, args=(address, over, 1))
        host.start()

        class Fatal(Store):
            def add(self, rows: Sequence[tuple[Row, Effort]]) -> None:
                super().add(rows)
                running.kill()

        try:
            with pytest.raises(ResourceError, match="the scheduler is gone"):
                run(work, tmp_path, evaluations.slow, Options(cluster=address), store_of=Fatal)
        finally:
            running.kill()
            over.set()
            host.join()
    rows = [record.row for record in recorded(tmp_path)[1]]
    assert 0 < sum(row is not None for row in rows) < 400
    assert {row.outcome for row in rows if row is not None} == {"done"}
    assert run(work, tmp_path, evaluations.quick, Options(1)).done == 400
