"""Results as a report reads them: axes and answers in the units that people read, and whether a run came out well."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmopt.spatial.values import Array, Bits
from fmopt.study.results.table import Results, Varied
from fmopt.study.running.store import Scalar

READ: Mapping[str, tuple[float, str]] = {
    "m": (1e3, "mm"),
    "rad": (180.0 / math.pi, "deg"),
    "m/s": (1e3, "mm/s"),
    "N*m": (1.0, "N m"),
}
ANSWERS: Mapping[str, tuple[str, float, str]] = {
    "margin": ("least margin", 1e6, "µm"),
    "tolerated_factor": ("tolerated start error, as a factor", 1.0, ""),
    "rate": ("draws that seat", 100.0, "%"),
    "bound": ("lower bound of their rate", 100.0, "%"),
    "cycle_time": ("median cycle time", 1.0, "s"),
    "success": ("success when executed", 100.0, "%"),
    "least_normal_force": ("least normal force of the bias", 1.0, "N"),
    "clearance": ("measured clearance a side", 1e3, "mm"),
    "cost": ("cost of the sequence", 1.0, ""),
}


@dataclass(frozen=True, eq=False)
class View:
    """A table of results, column by column."""

    results: Results

    @cached_property
    def free(self) -> tuple[Varied, ...]:
        """The axes that move on their own."""
        return tuple(axis for axis in self.results.axes if axis.linked is None)

    @cached_property
    def answers(self) -> tuple[str, ...]:
        """The answers that are worth a figure: those that differ between runs."""
        named = [name for name in ANSWERS if name in self.results.columns]
        return tuple(name for name in named if len(set(self.answer(name)[np.isfinite(self.answer(name))])) > 1)

    @cached_property
    def done(self) -> Bits:
        """Which runs have answers."""
        return np.array([line["outcome"] == "done" for line in self.results.lines], dtype=bool)

    @cached_property
    def good(self) -> Bits:
        """Which runs came out well: certified, tested, held by their bias; all that are done where none was asked."""
        return np.array([line["outcome"] == "done" and self._well(line) for line in self.results.lines], dtype=bool)

    @cached_property
    def goodness(self) -> str:
        """What coming out well means, in a word."""
        columns = self.results.columns
        # Columns of the quantities that make a plan, whose verdict then decides.
        if {"margin", "moves", "trials"} & set(columns):
            return "certified"
        if "bound" in columns:
            return "tested"
        return "held" if "holds" in columns else "feasible"

    def _well(self, line: Mapping[str, Scalar]) -> bool:
        if self.goodness == "held":
            return line["holds"] is True
        return line.get("verdict") == (None if self.goodness == "feasible" else self.goodness.upper())

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """What became of each run, in a word: its verdict, else "held" or not, else the kind of its failure."""
        return tuple(self._kind(line, bool(good)) for line, good in zip(self.results.lines, self.good, strict=True))

    @cached_property
    def bindings(self) -> tuple[str | None, ...]:
        """What binds in each run, in words and by its name in the plan; None where a run has no motion."""
        return tuple(_bound(line.get("binding_contact"), line.get("binding_words")) for line in self.results.lines)

    def _kind(self, line: Mapping[str, Scalar], good: bool) -> str:
        if line["outcome"] != "done":
            return "not done yet" if line["outcome"] is None else str(line["outcome"])
        verdict = line.get("verdict")
        return str(verdict) if verdict is not None else self.goodness if good else f"not {self.goodness}"

    def answer(self, name: str) -> Array:
        """An answer (n,) in the unit of `ANSWERS`, not a number where a run has none."""
        return self.column(name) * ANSWERS[name][1]

    def axis(self, axis: Varied) -> Array:
        """The values (n,) of an axis as people read them; words by their number in `words`."""
        if axis.unit == "word":
            words = self.words(axis)
            return np.array([float(words.index(str(line[axis.name]))) for line in self.results.lines])
        return self.column(axis.name) * READ.get(axis.unit, (1.0, axis.unit))[0]

    def words(self, axis: Varied) -> list[str]:
        """The words of an axis in the order in which they come."""
        return list(dict.fromkeys(str(line[axis.name]) for line in self.results.lines))

    def column(self, column: str) -> Array:
        """A column (n,) of numbers as the table has it, not a number where a run has none."""
        values = [line[column] for line in self.results.lines]
        return np.array([np.nan if value is None else float(value) for value in values], dtype=np.float64)


def _bound(name: Scalar, words: Scalar) -> str | None:
    if name is None:
        return None
    return f"{words} ({name})" if words is not None and str(name) not in str(words) else str(words or name)


def ticks(values: Array) -> list[str]:
    """Different numbers in as few digits as tell them apart, rounded by a twentieth of their least step at most."""
    step = float(np.min(np.diff(np.sort(values)))) if len(values) > 1 else math.inf
    # A lone value has nothing to be told from, so that its first four digits do.
    for digits in range(3 if len(values) > 1 else 4, 17):
        words = [f"{value:.{digits}g}" for value in values]
        if all(abs(float(word) - value) <= 0.05 * step for word, value in zip(words, values, strict=True)):
            break
    return [word.replace("-", "−") for word in words]


def axis_label(axis: Varied) -> str:
    """The name of an axis with its unit."""
    unit = "" if axis.unit == "word" else READ.get(axis.unit, (1.0, axis.unit))[1]
    return axis.name.replace("_", " ") + (f", {unit}" if unit else "")


def answer_label(name: str) -> str:
    """The name of an answer with its unit."""
    words, _, unit = ANSWERS[name]
    return words + (f", {unit}" if unit else "")
