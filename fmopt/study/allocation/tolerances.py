"""The question of a tolerance allocation: read from its file, checked as a whole before anything starts."""

from collections.abc import Sequence
from dataclasses import dataclass
from os.path import isfile, normpath
from pathlib import Path
from typing import Any

from fmopt.errors import Fault, InputError
from fmopt.study.axes import unusable
from fmopt.study.study_file import AllocationFile, ToleranceTable
from fmopt.study.targets import UNIT_NAMES, Base, Target, assigned, in_file, target
from fmopt.task.loading import problem_of
from fmopt.task.problem import Problem, load
from fmopt.task.toml.source import Source, read
from fmopt.task.toml.tables import Reading, checked, factors
from fmopt.task.toml.units import Dimension, Quantity, QuantityError, in_words

_LOOSEST = 10.0  # times the present value, if the file does not say


@dataclass(frozen=True)
class Allowed:
    """A tolerance with its range, in SI."""

    name: str
    targets: tuple[Target, ...]
    dimension: Dimension
    weight: float
    now: float
    low: float
    high: float

    def record(self) -> dict[str, Any]:
        """As JSON, SI units."""
        numbers = {name: getattr(self, name) for name in ("now", "low", "high", "weight")}
        return {"name": self.name, "unit": UNIT_NAMES.get(self.dimension, ""), **numbers}

    def words(self) -> str:
        """For people."""
        now, low, high = (in_words(x, self.dimension) for x in (self.now, self.low, self.high))
        return f"{self.name}: {now}, may become {low} to {high}, weight {self.weight:g}"


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked: the file with the margin that must stay, the base problem, and its tolerances."""

    file: AllocationFile
    base: Base
    tolerances: tuple[Allowed, ...]

    def problem(self, values: Sequence[float]) -> Problem:
        """The problem with these tolerances."""
        pairs = zip(self.tolerances, values, strict=True)
        given = [(goal.key, in_file(Quantity(v, one.dimension))) for one, v in pairs for goal in one.targets]
        return problem_of(assigned(self.base.problem, given))


def load_allocation(path: Path) -> Question:
    """The question of a file.

    Raises:
        InputError: with every fault of the file, or of the base problem.
    """
    source = read(path)
    reading = Reading(factors(source.data.get("units")))
    file, faults = checked(AllocationFile, source, reading)
    if file is None:
        raise InputError(*faults)
    problem = Path(normpath(path.parent / file.problem))
    if not isfile(problem):  # also where no file can have such a name
        advice = "correct the path; it is relative to this file"
        raise InputError(source.place(("problem",)).fault("file-missing", f"{problem} does not exist", advice))
    load(problem)
    base = Base.read(problem)
    if not file.tolerances:
        none = "there are no tolerances"
        faults.append(source.place(("tolerances",)).fault("empty-axis", none, "add [[tolerances]]"))
    found = [_allowed(source, reading, base, table, n) for n, table in enumerate(file.tolerances)]
    unusable([*faults, *(one for one in found if isinstance(one, Fault))])
    return Question(file, base, tuple(one for one in found if isinstance(one, Allowed)))


def _allowed(source: Source, reading: Reading, base: Base, table: ToleranceTable, n: int) -> Allowed | Fault:
    # Present values are in the units of the problem file, low and high in those of this one.
    here = Reading(factors(base.problem.data.get("units")))
    targets, values = [], []
    for k, path in enumerate(table.sets):
        place = source.place(("tolerances", n, "sets", k))
        goal = target(base.targets(), path)
        if isinstance(goal, str):
            return place.fault("unknown-path", f"there is no parameter {path!r}", goal)
        if goal.key[0] != "uncertainty" or goal.dimension is None:
            message = f"{path!r} is no tolerance: another value makes another motion"
            return place.fault("bad-value", message, "name paths below uncertainty, and vary others by a study")
        try:
            values.append(here.quantity(base.problem.get(goal.key), goal.dimension).value)
        except KeyError:
            return place.fault("missing-key", f"the base problem does not state {path!r}", "state it there first")
        targets.append(goal)
    now, dimension = values[0], targets[0].dimension
    place = source.place(("tolerances", n), of_key=True)
    assert dimension is not None  # choices of words were refused above
    if any(goal.dimension != dimension for goal in targets) or any(value != now for value in values):
        return place.fault("conflict", "what it sets is not the same now", "make several tolerances of it")
    # What is sought is a multiple of it.
    if now <= 0.0:
        return place.fault("out-of-range", "the present value is zero", "leave it out, or state a value")
    bounds = {"low": now, "high": _LOOSEST * now}
    for name in bounds:
        raw = getattr(table, name)
        if raw is not None:
            try:
                bounds[name] = reading.quantity(raw, dimension).value
            except QuantityError as error:
                return source.place(("tolerances", n, name)).fault(error.code, error.message, error.advice)
    if not 0.0 < bounds["low"] < bounds["high"]:
        return place.fault("empty-axis", "low is not positive, or not below high", "correct low or high")
    return Allowed(table.name, tuple(targets), dimension, table.weight, now, bounds["low"], bounds["high"])
