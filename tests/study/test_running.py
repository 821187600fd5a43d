"""The running of a study: every run gets one row, whatever happens to it; nothing is left behind."""

import os
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from fmopt.errors import ResourceError
from fmopt.study.running import running
from fmopt.study.running.batch import Evaluate, Limits
from fmopt.study.running.running import Options, Tally, run
from fmopt.study.running.store import Outcome, Recorded, Row, recorded
from tests.shared.studies import evaluations


def table(folder: Path) -> list[Recorded]:
    return recorded(folder)[1]


def children() -> set[int]:
    found = set()
    for task in Path("/proc/self/task").iterdir():
        found |= {int(pid) for pid in (task / "children").read_text().split()}
    return found


def test_every_run_gets_its_row_whatever_the_number_of_workers_and_nothing_is_left_running(tmp_path: Path) -> None:
    work, before = evaluations.work(200), children()
    one = run(work, tmp_path / "1", evaluations.quick, Options(1))
    two = run(work, tmp_path / "2", evaluations.quick, Options(2))
    assert (one.total, one.done, one.failed, one.fresh) == (two.total, two.done, two.failed, two.fresh)
    assert one.done == 200
    assert children() == before
    assert table(tmp_path / "1") == table(tmp_path / "2")
    row = table(tmp_path / "1")[7].row
    assert row.answers == {"square": 49, "root": 7**0.5, "word": "run 7", "even": False}


def test_the_order_of_work_does_not_show(tmp_path: Path) -> None:
    work = evaluations.work(50)
    run(work, tmp_path / "a", evaluations.quick, Options(2))
    run(replace(work, runs=work.runs[::-1], points=work.points[::-1]), tmp_path / "b", evaluations.quick, Options(2))
    run(work, tmp_path / "b", evaluations.waiting, Options(2))
    assert table(tmp_path / "a") == table(tmp_path / "b")


def test_a_limited_start_goes_on_where_it_ended(tmp_path: Path) -> None:
    work = evaluations.work(30)
    first = run(work, tmp_path / "a", evaluations.quick, Options(2, limit=11))
    second = run(work, tmp_path / "a", evaluations.quick, Options(1))
    run(work, tmp_path / "b", evaluations.quick, Options(1))
    assert (first.fresh, first.done, second.fresh, second.done) == (11, 11, 19, 30)
    assert table(tmp_path / "a") == table(tmp_path / "b")


def test_runs_of_one_key_are_one(tmp_path: Path) -> None:
    work = evaluations.work(3)
    twice = replace(work, runs=[*work.runs, work.runs[1]], points=[*work.points, {"n": 1}])
    assert run(twice, tmp_path, evaluations.quick, Options(1)).fresh == 3
    found = table(tmp_path)
    assert [record.run.number for record in found] == [0, 1, 2, 3]
    assert found[3].row == found[1].row


@pytest.mark.wide
def test_a_hundred_of_a_thousand_fail_and_the_others_do_not_notice(tmp_path: Path) -> None:
    work = evaluations.work(1000, Limits(seconds=1.0, memory=4 << 30))
    tally = run(work, tmp_path, evaluations.mixed, Options(4))
    assert (tally.done, tally.failed) == (1000, 100)
    reasons: dict[tuple[str, str], int] = {}
    for n, record in enumerate(table(tmp_path)):
        assert (record.row.outcome == "done") == (n % 10 != 3)
        if record.row.outcome != "done":
            name = (record.row.outcome, record.row.reason)
            reasons[name] = reasons.get(name, 0) + 1
    assert reasons == {
        ("crash", "the worker died of SIGSEGV"): 20,
        ("timeout", "not done in 1 s"): 20,
        ("memory", "out of memory"): 20,
        ("crash", "the worker ended with exit code 7"): 20,
        ("error", "ValueError: x.toml: nothing fits"): 20,
    }


def test_memory_is_limited_run_by_run(tmp_path: Path) -> None:
    work = evaluations.work(3)
    tight = run(replace(work, limits=Limits(memory=500_000_000)), tmp_path, evaluations.hungry, Options(1))
    assert [entry.row.outcome for entry in table(tmp_path) if entry.row is not None] == ["memory"] * 3
    wide = run(work, tmp_path, evaluations.hungry, Options(1, retry_failed=True))
    assert (tight.failed, wide.failed, wide.done) == (3, 0, 3)


def test_a_worker_computes_in_one_thread(tmp_path: Path) -> None:
    run(evaluations.work(1), tmp_path, evaluations.multiplied, Options(2))
    found = table(tmp_path)[0].row
    assert found.answers == {"sum": 600.0**3, "threads": 2}  # its own and the one that watches its owner


def test_failures_are_done_again_when_asked(tmp_path: Path) -> None:
    work = evaluations.work(14)
    limited = replace(work, limits=Limits(0.3))
    assert run(limited, tmp_path, evaluations.mixed, Options(2)).failed == 2
    assert run(work, tmp_path, evaluations.quick, Options(2)).fresh == 0
    again = run(work, tmp_path, evaluations.quick, Options(2, retry_failed=True))
    assert (again.fresh, again.failed, again.done) == (2, 0, 14)


@pytest.mark.parametrize(
    ("evaluate", "outcome", "reason"),
    [
        (evaluations.suicidal, "killed", "the worker was killed by SIGKILL, 3 times"),
        (evaluations.infinite, "error", "not a finite number: x"),
    ],
)
def test_a_run_without_an_answer_says_why(evaluate: Evaluate, outcome: Outcome, reason: str, tmp_path: Path) -> None:
    assert run(evaluations.work(2), tmp_path, evaluate, Options(1)).failed >= 1
    assert table(tmp_path)[0].row == Row(evaluations.work(1).runs[0].key, outcome, reason, {})


def test_workers_that_cannot_begin_end_the_study_in_words(tmp_path: Path) -> None:
    before = children()
    small = replace(evaluations.work(4), limits=Limits(memory=1 << 20))
    with pytest.raises(ResourceError, match="before they begin"):
        run(small, tmp_path, evaluations.quick, Options(1))
    assert children() == before


def test_a_signal_ends_it_with_what_is_done_kept(tmp_path: Path) -> None:
    def stop(tally: Tally) -> None:
        if tally.fresh and not sent:
            sent.append(tally.fresh)
            os.kill(os.getpid(), signal.SIGINT)

    sent: list[int] = []
    before = children()
    work = evaluations.work(300)
    first = run(work, tmp_path / "a", evaluations.slow, Options(2), progress=stop)
    assert first.interrupted == signal.SIGINT
    assert sent[0] <= first.done < 300
    assert children() == before
    second = run(work, tmp_path / "a", evaluations.slow, Options(2))
    assert (second.fresh, second.done) == (300 - first.done, 300)
    run(work, tmp_path / "b", evaluations.quick, Options(2))
    assert table(tmp_path / "a") == table(tmp_path / "b")


def test_a_signal_does_not_wait_for_a_run_that_hangs(tmp_path: Path) -> None:
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGTERM))
    timer.start()
    began = time.monotonic()
    tally = run(evaluations.work(4), tmp_path, evaluations.waiting, Options(2))
    timer.join()
    assert (tally.interrupted, tally.done) == (signal.SIGTERM, 0)
    assert time.monotonic() - began < 30.0


def test_batches_grow_to_half_a_second_and_no_longer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    sizes: list[int] = []
    original = running._Desk._next

    def noted(desk: running._Desk) -> running.Batch:
        batch = original(desk)
        sizes.append(len(batch.runs))
        return batch

    monkeypatch.setattr(running._Desk, "_next", noted)
    run(evaluations.work(200), tmp_path, evaluations.slow, Options(1))
    assert sizes[:3] == [1, 4, 16]
    assert 40 <= max(sizes) <= 50
    assert sum(sizes) == 200
