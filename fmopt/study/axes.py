"""The axes of a study: names, values and what they set, read from its file and resolved against the base problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fmopt.errors import Fault, InputError
from fmopt.study import study_file as files
from fmopt.study.running.batch import Assigned
from fmopt.study.sampling import CUBES, Normal, Uniform, cube, grid, rounded, stepped
from fmopt.study.targets import Target, in_file, target
from fmopt.task.toml.source import Key, Place, Source, dotted
from fmopt.task.toml.tables import Reading, shown
from fmopt.task.toml.units import LENGTH, Dimension, Quantity, QuantityError, did_you_mean, evaluate, in_words

Number = float | str


@dataclass(frozen=True)
class Axis:
    """A parameter that varies.

    Args:
        dimension: of its values; None when they are words.
        values: those that it takes in turn; empty when it has a distribution.
        sets: key path and dimension of each parameter that it sets, and the arithmetic that gives its value, or nothing
            for the axis's own.
    """

    name: str
    dimension: Dimension | None
    values: tuple[Number, ...]
    distribution: Uniform | Normal | None
    sets: tuple[tuple[Target, str], ...]
    linked: int | None
    place: Key

    def at(self, quantile: float) -> Number:
        """The value of a quantile in [0, 1)."""
        if self.distribution is None:
            # The product may be rounded up to the number of values.
            return self.values[min(int(quantile * len(self.values)), len(self.values) - 1)]
        return rounded(self.distribution.at(quantile))


def axes_of(
    source: Source, file: files.StudyFile, reading: Reading, targets: Mapping[str, Target]
) -> tuple[list[Axis], list[Fault]]:
    """The axes of a study file, and everything that is wrong with them."""
    axes, faults = [], list[Fault]()
    names = [axis.name for axis in file.axes]
    for i, axis in enumerate(file.axes):
        reader = _AxisReader(source, file, reading, targets, ("axes", i), names)
        found = reader.axis(axis, i)
        faults += reader.faults
        if found is not None:
            axes.append(found)
    # Links are numbers of axes, which are right only where no axis is missing.
    if not faults:
        faults += _faults_between(source, axes)
    return axes, faults


@dataclass
class _AxisReader:
    """Reads one axis and collects its faults."""

    source: Source
    file: files.StudyFile
    reading: Reading
    targets: Mapping[str, Target]
    key: Key
    names: list[str]
    faults: list[Fault] = field(default_factory=list)

    def _fault(self, key: Key, code: str, message: str, advice: str) -> None:
        self.faults.append(self.source.place((*self.key, *key)).fault(code, message, advice))

    def axis(self, axis: files.AxisTable, number: int) -> Axis | None:
        if axis.name in self.names[:number]:
            self._fault(("name",), "conflict", f"there are two axes {axis.name!r}", "rename one of them")
        sets = self._sets(axis)
        if self.faults:
            return None
        dimension = self._dimension(axis, sets)
        values = self._values(axis, dimension, sets)
        distribution = self._distribution(axis, dimension) if values is None else None
        linked = self._linked(axis, number)
        if self.faults:
            return None
        steps = axis.steps
        if values is None and self.file.sampling.method not in CUBES:
            # `_distribution` has refused means and missing steps where points are not drawn.
            assert isinstance(distribution, Uniform)
            assert steps is not None
            values, distribution = tuple(stepped(distribution, steps)), None
        return Axis(axis.name, dimension, values or (), distribution, sets, linked, self.key)

    def _sets(self, axis: files.AxisTable) -> tuple[tuple[Target, str], ...]:
        pairs = axis.sets.items() if isinstance(axis.sets, Mapping) else ((path, "") for path in axis.sets)
        found = []
        for n, (path, expression) in enumerate(pairs):
            key: Key = ("sets", path if isinstance(axis.sets, Mapping) else n)
            goal = target(self.targets, path)
            if isinstance(goal, str):
                self._fault(key, "unknown-path", f"there is no parameter {path!r} to vary", goal)
            else:
                found.append((goal, expression))
        # Paths with arithmetic are judged by what it gives, in `_expression_faults`.
        plain = [goal for goal, expression in found if not expression]
        kinds = {"true or false" if goal.truth else str(goal.dimension or "a choice of words") for goal in plain}
        if len(kinds) > 1:
            words = " and ".join(sorted(kinds))
            self._fault(("sets",), "wrong-unit", f"one value is to be {words}", "make two linked axes of it")
        return tuple(found)

    def _dimension(self, axis: files.AxisTable, sets: Sequence[tuple[Target, str]]) -> Dimension | None:
        """What the axis measures: what it sets as it is, else what the unit of its first number says, else a length."""
        own = [goal for goal, expression in sets if expression in ("", axis.name)]
        if own:
            return own[0].dimension
        for raw in (*(axis.values or ()), axis.low, axis.mean):
            if isinstance(raw, str):
                try:
                    return evaluate(raw).dimension
                except QuantityError:
                    continue  # told with its place when the value is read
        return LENGTH

    def _quantity(self, raw: object, dimension: Dimension, *key: str | int) -> float | None:
        try:
            return self.reading.quantity(raw, dimension).value
        except QuantityError as error:
            self._fault(key, error.code, error.message, error.advice)
            return None

    def _values(
        self, axis: files.AxisTable, dimension: Dimension | None, sets: Sequence[tuple[Target, str]]
    ) -> tuple[Number, ...] | None:
        others = [name for name in ("low", "high", "steps", "mean", "deviation") if getattr(axis, name) is not None]
        if axis.values is None:
            if not others:
                self._fault((), "missing-key", "the axis has neither values nor a range", "add values, or low and high")
            return None
        if others:
            advice = f"remove {', '.join(others)}, or values"
            self._fault((others[0],), "conflict", "the axis has values already", advice)
        if not axis.values:
            self._fault(("values",), "empty-axis", "the axis has no values", "give it at least one")
        if dimension is None:
            return self._words(axis.values, sets)
        read = [self._quantity(raw, dimension, "values", n) for n, raw in enumerate(axis.values)]
        return tuple(value for value in read if value is not None)

    def _words(self, values: Sequence[object], sets: Sequence[tuple[Target, str]]) -> tuple[str, ...]:
        truth = any(goal.truth for goal, _ in sets)
        for n, raw in enumerate(values):
            if not isinstance(raw, bool if truth else str):
                what, advice = ("no truth", "write true or false") if truth else ("no word", "write one of the choices")
                self._fault(("values", n), "wrong-type", f"{shown(raw)} is {what}", advice)
        # Truths as TOML writes them; `assignments` makes truths of them again.
        return tuple(str(raw).lower() if isinstance(raw, bool) else str(raw) for raw in values)

    def _distribution(self, axis: files.AxisTable, dimension: Dimension | None) -> Uniform | Normal | None:
        if self.faults:
            return None
        if dimension is None:
            self._fault((), "conflict", "words have no range", "give the axis values")
            return None
        low, high, mean, deviation = (
            None if getattr(axis, name) is None else self._quantity(getattr(axis, name), dimension, name)
            for name in ("low", "high", "mean", "deviation")
        )
        if self.faults:
            return None
        sampled = self.file.sampling.method in CUBES
        if (mean is None) != (deviation is None):
            self._fault((), "missing-key", "a normal distribution has mean and deviation", "give both")
        elif mean is None and (low is None or high is None):
            self._fault((), "missing-key", "a range has low and high", "give both, or values, or mean and deviation")
        elif low is not None and high is not None and not low < high:
            words = f"low {in_words(low, dimension)} is not below high {in_words(high, dimension)}"
            self._fault(("low",), "empty-axis", words, "exchange them, or give one value in values")
        elif deviation is not None and not deviation > 0.0:
            self._fault(("deviation",), "out-of-range", "the deviation is not positive", "make it positive")
        elif axis.spacing == "log" and not (low is not None and low > 0.0):
            self._fault(("low",), "out-of-range", "a logarithm needs a positive range", "raise low, or space linearly")
        elif not sampled and (mean is not None or axis.steps is None):
            words = "a grid or list takes values, or low, high and steps"
            self._fault((), "conflict", words, 'give those, or sample: [sampling] method = "sobol"')
        elif sampled and axis.steps is not None:
            self._fault(("steps",), "conflict", "a sampled axis has no steps", "remove steps, or use a grid")
        if self.faults:
            return None
        if mean is not None and deviation is not None:
            return Normal(mean, deviation, *(b if b is not None else s * np.inf for b, s in ((low, -1), (high, 1))))
        assert low is not None
        assert high is not None
        return Uniform(low, high, axis.spacing == "log")

    def _linked(self, axis: files.AxisTable, number: int) -> int | None:
        if axis.linked is None:
            return None
        if axis.linked in self.names[:number]:
            return self.names.index(axis.linked)
        advice = did_you_mean(axis.linked, self.names[:number]) or "link it to an axis above it"
        self._fault(("linked",), "unknown-axis", f"there is no axis {axis.linked!r} above this one", advice)
        return None


def _faults_between(source: Source, axes: Sequence[Axis]) -> list[Fault]:
    """What one axis cannot see: parameters set twice, chains of links, expressions that do not fit."""
    faults, seen = [], dict[Key, str]()
    names = {a.name: Quantity(1.0, a.dimension) for a in axes if a.dimension is not None}
    for axis in axes:
        # `points_of` follows a single link.
        if axis.linked is not None and axes[axis.linked].linked is not None:
            place = source.place((*axis.place, "linked"))
            words = "the axis it is linked to is linked itself"
            faults.append(place.fault("conflict", words, "link both to the first"))
        key = (*axis.place, "sets")
        table = source.get(key) if axis.sets else None
        stated = table.items() if isinstance(table, Mapping) else ()
        for goal, expression in axis.sets:
            place = source.place((*key, *[path for path, text in stated if text == expression][:1]))
            if goal.key in seen:
                words = f"{dotted(goal.key)} is set by axis {seen[goal.key]!r} already"
                faults.append(place.fault("conflict", words, "let one axis set it, by arithmetic on both names"))
            seen[goal.key] = axis.name
            if expression:
                faults += _expression_faults(place, expression, goal, names)
    return faults


def _expression_faults(place: Place, expression: str, goal: Target, names: Mapping[str, Quantity]) -> list[Fault]:
    """Whether arithmetic is understood and gives what its parameter asks for, all names being one."""
    try:
        value = evaluate(expression, names)
    except QuantityError as error:
        if "division by zero" in error.message:
            return []  # with the names at one; the real values are judged run by run
        return [place.fault(error.code, error.message, error.advice)]
    if goal.dimension is None:
        return [place.fault("wrong-type", "a choice of words has no arithmetic", "list the path instead")]
    if value.dimension != goal.dimension:
        words = f"{expression!r} is {value.dimension}, not {goal.dimension}"
        return [place.fault("wrong-unit", words, "give every number its unit, and axes the right one")]
    return []


def points_of(axes: Sequence[Axis], sampling: files.Sampling) -> list[tuple[Number, ...]]:
    """The points of a study, each a value for every axis; the axes' place in the design is that of the file."""
    free = [i for i, axis in enumerate(axes) if axis.linked is None]
    row = {number: column for column, number in enumerate(free)}
    # A linked axis reads the column of the one that it moves along with: the same quantile, or the same index.
    column = [row[i if axis.linked is None else axis.linked] for i, axis in enumerate(axes)]
    if sampling.method in CUBES:
        places = cube(sampling.method, len(free), sampling.runs or 0, sampling.seed or 0)
        return [tuple(a.at(float(p[c])) for a, c in zip(axes, column, strict=True)) for p in places]
    lengths = [len(axes[i].values) for i in free]
    indices = grid(lengths) if sampling.method == "grid" else np.repeat(np.arange(lengths[0])[:, None], len(free), 1)
    return [tuple(a.values[int(p[c])] for a, c in zip(axes, column, strict=True)) for p in indices]


def count_of(axes: Sequence[Axis], sampling: files.Sampling) -> int:
    """How many points `points_of` will make, without making them."""
    free = [axis for axis in axes if axis.linked is None]
    if sampling.method == "grid":
        # In Python's integers: a product that overflows could pass for a small one.
        return int(np.prod([len(axis.values) for axis in free], dtype=object))
    if sampling.method == "list":
        return len(free[0].values)
    return (sampling.runs or 0) * (len(free) + 2 if sampling.method == "saltelli" else 1)


def assignments(axes: Sequence[Axis], point: Sequence[Number]) -> tuple[tuple[Key, Assigned], ...]:
    """What a point puts into the base problem.

    Raises:
        QuantityError: arithmetic on the values fails.
    """
    pairs = list(zip(axes, point, strict=True))
    names = {a.name: Quantity(v, a.dimension) for a, v in pairs if a.dimension is not None and isinstance(v, float)}
    found = []
    for axis, value in pairs:
        for goal, expression in axis.sets:
            if expression:
                result = evaluate(expression, names)
                # What arithmetic leaves behind the twelfth digit would give runs of the same numbers different keys.
                found.append((goal.key, in_file(replace(result, value=rounded(result.value)))))
            elif isinstance(value, str) or axis.dimension is None:
                found.append((goal.key, value == "true" if goal.truth else value))
            else:
                found.append((goal.key, in_file(Quantity(value, axis.dimension))))
    return tuple(found)


def unusable(faults: Iterable[Fault]) -> None:
    """Refuses what has faults.

    Raises:
        InputError: there are some.
    """
    found = dict.fromkeys(faults)
    if found:
        raise InputError(*found)
