"""What `fmopt study` does: start or continue, foretell, report."""

import json
import math
import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fmopt.study.design import Study, load_study
from fmopt.study.evaluation import evaluate
from fmopt.study.results.table import csv_text, parquet, results
from fmopt.study.running.batch import Batch, laid_out
from fmopt.study.running.running import Options, Tally, Work, hands, run
from fmopt.study.running.store import NAME, efforts, owned, recorded
from fmopt.study.running.workers import Local, run_batch
from fmopt.task.toml.source import read
from fmopt.task.toml.units import in_words

_SHOWN = 10  # runs that a dry run lists
_ALLOCATION = "allocation.json"


def carry_out(file: Path, folder: Path, options: Options, progress: Callable[[Tally], None]) -> Tally:
    """Starts or continues the study of a file in a folder, and writes its table.

    Raises:
        InputError: the file cannot be used.
        ResourceError: the folder, the workers or the cluster cannot be had.
    """
    from fmopt.runtime import output

    tally = run(load_study(file).work(), folder, evaluate, options, progress)
    # From the store, not from memory: it has what earlier starts did, too, and nothing that is not durable.
    output.save(csv_text(results(folder)).encode(), folder / "table.csv")
    return tally


def report(folder: Path) -> list[Path]:
    """Writes what a folder's results say, and names the files.

    Raises:
        InputError: there is no study in this folder.
        ResourceError: a file cannot be read or written.
    """
    from fmopt.runtime import output
    from fmopt.study.allocation.allocation import allocation_page
    from fmopt.study.results.figures import figures
    from fmopt.study.results.page import page
    from fmopt.study.results.view import View

    if (folder / _ALLOCATION).is_file() and not (folder / NAME).is_file():
        output.save(allocation_page(json.loads((folder / _ALLOCATION).read_text())).encode(), folder / "report.html")
        return [folder / "report.html"]
    found = results(folder)
    view = View(found)
    contents = {"report.html": page(view, figures(view)).encode(), "table.csv": csv_text(found).encode()}
    if find_spec("polars") is not None:
        contents["table.parquet"] = parquet(found)
    for name, content in contents.items():
        output.save(content, folder / name)
    return [folder / name for name in contents]


def allocates(file: Path) -> bool:
    """Whether a study file asks for tolerances rather than for runs.

    Raises:
        InputError: it cannot be read.
    """
    return "tolerances" in read(file).data


def asked_for(file: Path) -> tuple[dict[str, Any], list[str]]:
    """The tolerances of a file with their ranges, as data in SI units and in words; computes and writes nothing.

    Raises:
        InputError: the file cannot be used.
    """
    from fmopt.study.allocation.tolerances import load_allocation

    question = load_allocation(file)
    record = {"title": question.file.title, "tolerances": [allowed.record() for allowed in question.tolerances]}
    return record, [f"{file}: {question.file.title}", *(f"  {allowed.words()}" for allowed in question.tolerances)]


def allocated(file: Path, folder: Path, progress: Callable[[str], None]) -> tuple[dict[str, Any], list[str]]:
    """Allocates the tolerances of a file, writes allocation.json and plan.json; the answer as data and in words.

    Raises:
        InputError: the file cannot be used.
        ResourceError: the folder is owned by another, or cannot be written.
        SearchError, InfeasibleError: there is no motion for the present tolerances, or its margin is too small already.
    """
    from fmopt import plan
    from fmopt.runtime import output
    from fmopt.study.allocation.allocation import allocate
    from fmopt.study.allocation.tolerances import load_allocation

    question = load_allocation(file)
    output.prepare(folder)
    with owned(folder):
        answer = allocate(question, progress)
        record = answer.record()
        plan.write(answer.document, folder / "plan.json")
        # Last, as `report` goes by it: where it is, the plan that it speaks of is there, too.
        output.save((json.dumps(record, indent=1) + "\n").encode(), folder / _ALLOCATION)
    return record, answer.words()


@dataclass(frozen=True)
class Forecast:
    """What a study will be: its runs, how many are done, seconds of one, unless its trial failed, and of the rest."""

    total: int
    done: int
    asked: int
    seconds: float | None
    rest: float | None
    source: str
    listing: tuple[str, ...]


def forecast(file: Path, folder: Path, options: Options, progress: Callable[[str], None]) -> Forecast:
    """Says what a study would do; writes nothing.

    The time of a run is the median of the runs in the folder, or that of a trial of the middle run, on this machine.

    Raises:
        InputError: the file cannot be used.
        ResourceError: no worker starts, or the cluster cannot be had.
    """
    study = load_study(file)
    work = study.work()
    with hands(options) as (_, count):
        pass  # for a cluster that cannot be had
    keys = list(dict.fromkeys(run.key for run in work.runs))
    outcomes, known = dict[str, str](), list[float]()
    if (folder / NAME).is_file():
        outcomes = {r.run.key: r.row.outcome for r in recorded(folder)[1] if r.row is not None}
        # The store may hold a design that this file had before: only runs of the present one count.
        outcomes = {key: outcomes[key] for key in keys if key in outcomes}
        known = [effort.seconds for key, effort in efforts(folder).items() if key in outcomes]
    again = {key for key, outcome in outcomes.items() if outcome != "done"} if options.retry_failed else set()
    left = len([key for key in keys if key not in outcomes or key in again][: options.limit])
    seconds: float | None
    if known:
        seconds, source = statistics.median(known), f"the median of {len(known)} runs that are done"
    else:
        progress(f"trying run {len(work.runs) // 2} of {len(work.runs)}, to see how long it takes")
        seconds, source = _trial(work)
    rest = None if seconds is None else seconds * math.ceil(left / count)
    return Forecast(len(keys), len(outcomes), left, seconds, rest, source, tuple(_listing(study)))


def _trial(work: Work) -> tuple[float | None, str]:
    middle = work.runs[len(work.runs) // 2]
    # In a worker under the study's limits: a trial that hangs or crashes ends as the run itself would.
    with Local(1) as local:
        # Inputs go to a folder of this process's own, as a dry run writes nothing into that of the study.
        batch = Batch((middle,), evaluate, work.limits, work.inputs, laid_out(work.inputs, None))
        returned = local.submit(run_batch, batch).result()
    if returned.loss is None and returned.rows[0][0].outcome == "done":
        return returned.rows[0][1].seconds, "a trial of the middle run"
    failure = returned.loss or returned.rows[0][0]
    return None, f"a trial of the middle run failed ({failure.outcome}: {failure.reason})"


def _listing(study: Study) -> Iterator[str]:
    """The runs in words, those in the middle left out."""
    count = len(study.points)
    shown = [*range(min(count, _SHOWN)), *range(max(count - 2, _SHOWN), count)]
    for before, number in zip([-1, *shown], shown, strict=False):
        if number != before + 1:
            yield "…"
        pairs = zip(study.axes, study.points[number], strict=True)
        words = [f"{a.name} = {v if a.dimension is None else in_words(float(v), a.dimension)}" for a, v in pairs]
        yield f"{number}: " + ", ".join(words)
