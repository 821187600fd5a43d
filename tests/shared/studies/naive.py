"""A store as one might write it on a first day: a file kept open, a line for each row. Kills must find it out."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Self

from fmopt.study.running.store import Effort, Numbered, Row, Store


class NaiveStore(Store):
    """Acknowledges what it has written, before the file has it."""

    def __init__(self, folder: Path) -> None:
        self._results = folder / "results.jsonl"
        lines = self._results.read_text().splitlines() if self._results.exists() else []
        self._known = {row["key"]: row["outcome"] for row in map(json.loads, lines)}
        self._lines = self._results.open("a")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.close()

    def design(self, runs: Iterable[Numbered], facts: Mapping[str, str]) -> None:
        pass

    def outcomes(self) -> dict[str, str]:
        return self._known

    def add(self, rows: Sequence[tuple[Row, Effort]]) -> None:
        for row, _ in rows:
            line = {"key": row.key, "outcome": row.outcome, "reason": row.reason, "answers": dict(row.answers)}
            self._lines.write(json.dumps(line) + "\n")
