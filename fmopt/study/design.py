"""A study: read from its file, checked as a whole before anything starts, and laid out as runs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os.path import isfile, normpath
from pathlib import Path

from fmopt.errors import Fault, FmoptError, InputError
from fmopt.plan import read as read_plan
from fmopt.study import study_file as files
from fmopt.study.axes import Axis, Number, assignments, axes_of, count_of, points_of, unusable
from fmopt.study.evaluation import QUANTITIES, missing
from fmopt.study.running.batch import Limits, Run, StudyContext
from fmopt.study.running.program import program
from fmopt.study.running.running import Work
from fmopt.study.sampling import CUBES
from fmopt.study.targets import UNIT_NAMES, Base, assigned, blamed
from fmopt.task.loading import problem_of
from fmopt.task.problem import load
from fmopt.task.toml.source import Source, canonical_digest, dotted, read
from fmopt.task.toml.tables import Reading, checked, factors
from fmopt.task.toml.units import QuantityError, did_you_mean

_COMMON = ("number", "outcome", "reason")  # columns that every table has


@dataclass(frozen=True, eq=False)
class Study:
    """A study whose file is in order."""

    source: Source
    file: files.StudyFile
    base: Base
    axes: tuple[Axis, ...]
    points: Sequence[tuple[Number, ...]]

    @property
    def question(self) -> StudyContext:
        """What is computed of each run."""
        return StudyContext(self.base.name, self.file.compute, self.file.keep, self.base.plan)

    @property
    def limits(self) -> Limits:
        """What a run may take."""
        given = self.file.limits
        return Limits(given.time, None if given.memory_mb is None else 1_000_000 * given.memory_mb)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table of results, axes first."""
        answers = dict.fromkeys(column for name in self.file.compute for column in QUANTITIES[name].columns)
        return (_COMMON[0], *(axis.name for axis in self.axes), *_COMMON[1:], *answers)

    def runs(self) -> Iterator[Run]:
        """The runs, point by point."""
        question, base, code = self.question, self.base, program()
        # Once for all runs, as it may be long; without the name of the problem's file, which changes nothing of them.
        problem = {"problem": base.problem.data}
        common = canonical_digest([code, base.content, question.quantities, question.keep, problem])
        for point in self.points:
            given = assignments(self.axes, point)
            # Sorted, as the order of axes in the file changes nothing of what is computed.
            key = canonical_digest([common, sorted((list(path), value) for path, value in given)])
            yield Run(key, given, question)

    def work(self) -> Work:
        """All there is to do."""
        names = [axis.name for axis in self.axes]
        points = [dict(zip(names, point, strict=True)) for point in self.points]
        return Work(list(self.runs()), points, self.facts(), self.base.inputs, self.limits)

    def facts(self) -> Mapping[str, str]:
        """What the store says of the study, for its report."""
        sampling = self.file.sampling
        axes = [
            {
                "name": axis.name,
                "unit": "word" if axis.dimension is None else UNIT_NAMES.get(axis.dimension, ""),
                "linked": axis.linked,
                "sets": [dotted(goal.key) for goal, _ in axis.sets],
                "log": self.file.axes[number].spacing == "log",
            }
            for number, axis in enumerate(self.axes)
        ]
        return {
            "title": self.file.title,
            "problem": self.file.problem,
            "columns": json.dumps(self.columns),
            "axes": json.dumps(axes),
            "quantities": json.dumps(self.file.compute),
            "sampling": json.dumps({"method": sampling.method, "runs": sampling.runs, "seed": sampling.seed}),
            "program": program(),
        }


def load_study(path: Path) -> Study:
    """The study of a file, with all its runs, after every check that can be made without solving.

    Raises:
        InputError: with every fault of the file, or of the base problem.
    """
    source = read(path)
    if "axes" not in source.data and {"moving", "fixed"} <= set(source.data):
        advice = "solve it with fmopt solve, or name it as 'problem' in a study file"
        raise InputError(source.place(()).fault("file-kind", "this is a problem file, not a study", advice))
    reading = Reading(factors(source.data.get("units")))
    file, faults = checked(files.StudyFile, source, reading)
    if file is None:
        raise InputError(*faults)
    problem = Path(normpath(path.parent / file.problem))
    place = source.place(("problem",))
    if not isfile(problem):  # also where no file can have such a name
        advice = "correct the path; it is relative to the study file"
        raise InputError(*faults, place.fault("file-missing", f"{problem} does not exist", advice))
    if {"axes", "compute"} & set(read(problem).data):
        advice = "name the problem that it varies"
        raise InputError(*faults, place.fault("file-kind", f"{problem} is a study, not a problem", advice))
    # Its faults are told by themselves, with places in its own file: what follows takes it for sound.
    load(problem)
    plan = None if file.plan is None else Path(normpath(path.parent / file.plan))
    unusable([*faults, *_plan_faults(source, file, plan)])
    base = Base.read(problem, plan)
    axes, more = axes_of(source, file, reading, base.targets())
    faults += [*more, *_quantity_faults(source, file), *_sampling_faults(source, file)]
    unusable(faults)
    # Before the points are made, of which there may be too many by accident.
    unusable(_size_faults(source, file, axes))
    study = Study(source, file, base, tuple(axes), points_of(axes, file.sampling))
    unusable(_value_faults(study))
    return study


def _plan_faults(source: Source, file: files.StudyFile, plan: Path | None) -> Iterator[Fault]:
    """What speaks against trials of presses."""
    others = (QUANTITIES.keys() - {"clearance", "evidence"}) & set(file.compute)
    if "evidence" in file.compute and others:
        message = f"'evidence' is of presses, {', '.join(map(repr, sorted(others)))} of guarded moves"
        yield source.place(("compute",)).fault("conflict", message, "compute them in two studies")
    if plan is None:
        return
    place = source.place(("plan",))
    if "evidence" not in file.compute:
        yield place.fault("conflict", "a plan is named, but no evidence is computed", 'add "evidence" to compute')
    try:
        if read_plan(plan).press_plan is None:
            yield place.fault("conflict", f"{plan} has no presses", "name a plan of presses, or leave it out")
    except FmoptError as error:
        yield place.fault("file-missing", error.message, error.advice)


def _quantity_faults(source: Source, file: files.StudyFile) -> Iterator[Fault]:
    if not file.axes:
        yield source.place(("axes",), of_key=True).fault("empty-axis", "there are no axes", "add [[axes]], or solve it")
    for n, name in enumerate(file.compute):
        place = source.place(("compute", n))
        if name not in QUANTITIES:
            advice = did_you_mean(name, QUANTITIES) or f"quantities: {', '.join(QUANTITIES)}"
            yield place.fault("unknown-quantity", f"there is no quantity {name!r}", advice)
        elif missing(name):
            yield place.fault("missing-extra", f"{name!r} cannot be computed: {missing(name)}", "leave it out")
        elif name in file.compute[:n]:
            yield place.fault("conflict", f"{name!r} is asked for twice", "remove one")
    for n, axis in enumerate(file.axes):
        if axis.name in {*_COMMON, *(column for quantity in QUANTITIES.values() for column in quantity.columns)}:
            advice = "choose another name, such as " + repr(axis.name + "_set")
            place = source.place(("axes", n, "name"))
            yield place.fault("bad-name", f"a column is called {axis.name!r} already", advice)
    if file.keep and not {"plan", "margins", "evidence"} & set(file.compute):
        place = source.place(("keep",))
        yield place.fault("conflict", "plans are to be kept but none is computed", 'add "plan" to compute')


def _sampling_faults(source: Source, file: files.StudyFile) -> Iterator[Fault]:
    sampling = file.sampling
    place = source.place(("sampling",), of_key=True)
    sampled = sampling.method in CUBES
    for name in ("runs", "seed"):
        if sampled and getattr(sampling, name) is None:
            advice = f"add {name} = {64 if name == 'runs' else 1} to [sampling]"
            yield place.fault("missing-key", f"{sampling.method} sampling needs {name!r}", advice)
        elif not sampled and getattr(sampling, name) is not None:
            where, words = source.place(("sampling", name)), f"a {sampling.method} has no {name!r}"
            yield where.fault("conflict", words, f"remove {name}, or choose another method")
    runs = sampling.runs
    if sampling.method in ("sobol", "saltelli") and runs is not None and runs & (runs - 1):
        near = 1 << (runs.bit_length() - 1)
        advice = f"use {near} or {2 * near}"
        yield source.place(("sampling", "runs")).fault("out-of-range", f"{runs} is no power of two", advice)


def _size_faults(source: Source, file: files.StudyFile, axes: Sequence[Axis]) -> Iterator[Fault]:
    method = file.sampling.method
    for axis in axes:
        if method == "grid" and axis.linked is None and len(set(axis.values)) < len(axis.values):
            again = next(n for n, value in enumerate(axis.values) if value in axis.values[:n])
            place = source.place((*axis.place, "values", again))
            yield place.fault("conflict", "this value is there already", "leave it out, or take a list for a sampling")
        linked = axes[axis.linked] if method == "grid" and axis.linked is not None else None
        other = axes[0] if method == "list" else linked
        if other is not None and len(other.values) != len(axis.values):
            message = f"{len(axis.values)} values go along with {len(other.values)} of axis {other.name!r}"
            yield source.place(axis.place, of_key=True).fault("wrong-length", message, "give both the same number")
    count = count_of(axes, file.sampling)
    if count > file.limits.runs:
        key = ("sampling",) if method in CUBES else ("axes",)
        made, meant = (f"{number:,}".replace(",", " ") for number in (count, file.limits.runs))
        message = f"these axes make {made} runs, more than {meant}"
        advice = f"use fewer values; if you mean it, say [limits] runs = {count}"
        yield source.place(key, of_key=True).fault("many-runs", message, advice)


def _of_values(source: Source, axis: Axis) -> tuple[str, ...]:
    """The key that an axis has its values from."""
    table = source.get(axis.place)
    return next(((key,) for key in ("values", "low", "mean") if isinstance(table, Mapping) and key in table), ())


def _value_faults(study: Study) -> list[Fault]:
    """What the base problem says to the values: the first run, and for each axis the runs with its extremes."""
    chosen = {0}
    for column, axis in enumerate(study.axes):
        values = [point[column] for point in study.points]
        if axis.dimension is None:
            chosen |= {values.index(word) for word in axis.values if word in values}
        else:
            chosen |= {values.index(min(values)), values.index(max(values))}
    faults: list[Fault] = []
    places = ((axis, study.source.place((*axis.place, *_of_values(study.source, axis)))) for axis in study.axes)
    mine = {dotted(goal.key): place for axis, place in places for goal, _ in axis.sets}
    # Not all runs: each is a problem to be read. What is missed here gets a row with the outcome "input".
    for number in sorted(chosen):
        try:
            given = assignments(study.axes, study.points[number])
        except QuantityError as error:
            place = study.source.place(("axes",), of_key=True)
            faults.append(place.fault(error.code, f"run {number}: {error.message}", error.advice))
            continue
        try:
            problem_of(assigned(study.base.problem, given))
        except InputError as error:
            faults += blamed(error.faults, {key: place.fault("", "") for key, place in mine.items()})
    return list(dict.fromkeys(faults))
