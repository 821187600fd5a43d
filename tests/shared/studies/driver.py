"""A small study in a process of its own, to be killed or starved by tests.

python -m tests.shared.studies.driver FOLDER RUNS JOBS EVALUATION STORE [FAILING CALL NUMBER OF THE CALL]

Acknowledged keys go to FOLDER/acknowledged, one a line, straight to the kernel; runs that are begun to FOLDER/begun.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from fmopt.errors import FmoptError
from fmopt.study.running.running import Options, run
from fmopt.study.running.store import Effort, Row, Store
from tests.shared.studies import evaluations
from tests.shared.studies.naive import NaiveStore

STORES = {"store": Store, "naive": NaiveStore}


def main(folder: Path, runs: int, jobs: int, evaluation: str, store: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    os.environ[evaluations.BEGUN] = str(folder / "begun")
    told = os.open(folder / "acknowledged", os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    class Acknowledging(STORES[store]):  # type: ignore[misc]
        def add(self, rows: Sequence[tuple[Row, Effort]]) -> None:
            super().add(rows)
            os.write(told, "".join(f"{row.key}\n" for row, _ in rows).encode())

    answer, options = getattr(evaluations, evaluation), Options(jobs, retry_failed=True)
    tally = run(evaluations.work(runs), folder, answer, options, store_of=Acknowledging)
    print(f"{tally.done} of {tally.total}, {tally.failed} failed")


if __name__ == "__main__":
    if len(sys.argv) > 6:
        from tests.shared.studies.faults import fail

        fail(sys.argv[6], int(sys.argv[7]), int(sys.argv[8]), sys.argv[1])
    try:
        main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4], sys.argv[5])
    except FmoptError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
