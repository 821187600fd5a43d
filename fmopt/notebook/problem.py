"""Problems from Python: read from a file, varied by path, given another clearance, said back in words."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fmopt.errors import Fault, InputError
from fmopt.geometry.clearance import mating_clearance
from fmopt.spatial.values import Array
from fmopt.study.targets import Base, assigned, blamed
from fmopt.task import problem as task
from fmopt.task.loading import problem_of
from fmopt.task.model import overrides_of, parameter_values
from fmopt.task.toml.problem_file import spelled_out
from fmopt.task.toml.source import Source, dotted, read
from fmopt.task.toml.tables import Reading
from fmopt.task.toml.units import LENGTH, did_you_mean

if TYPE_CHECKING:
    from fmopt.geometry.clearance import Clearance

Given: TypeAlias = float | str
_STEP = 1e-5  # m, by which a dimension is varied to see what it does
_STEPS = 4
_SAME = 1e-8  # m, between the clearance that was asked for and the measured one


@dataclass(frozen=True, eq=False)
class Problem(task.Problem):
    """An insertion as its file describes it: what `fmopt.solve` takes, in SI units and mating frames.

    >>> problem = fmopt.load(fmopt.example("square_peg"))
    >>> problem.start_box[0], problem.settings.max_tilt
    (np.float64(0.0003), 0.20943951023931953)
    >>> print(problem.explain().splitlines()[2])
    parts      moving: square_peg, 20 x 20 x 40 mm, 6 faces, 1 convex piece; mates by peg (solid, length 40 mm)
    """

    source: Source

    @cached_property
    def measured(self) -> "Clearance":
        """The clearance as measured on the parts, m; computed when it is first asked for.

        >>> round(fmopt.load(fmopt.example("square_peg")).measured.per_side, 9)
        0.0001

        Raises:
            InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        """
        from fmopt.task.sizes import measured_clearance

        return measured_clearance(self)

    @property
    def targets(self) -> tuple[str, ...]:
        """The paths that `with_` takes, such as "uncertainty.start.x" and "model.fixed.width".

        >>> problem = fmopt.load(fmopt.example("square_peg"))
        >>> [path for path in problem.targets if path.startswith("model.moving")]
        ['model.moving.width', 'model.moving.length']
        """
        return tuple(Base.read(self.path).targets())

    def with_(self, values: Mapping[str, Given] | None = None, /, **named: Given) -> "Problem":
        """The same problem with other values; this one stays as it is.

        >>> problem = fmopt.load(fmopt.example("square_peg"))
        >>> other = problem.with_({"uncertainty.start.x": "0.2 mm"}, settings_max_tilt="10 deg")
        >>> float(other.start_box[0])
        0.0002

        Args:
            values: by path, see `targets`: text with a unit ("0.2 mm"), or a number in the units of the problem file.
            named: the same with the dots of the path as underscores. `clearance` is more than a path: it declares the
                clearance on each side, along x and y, and gives the hole the dimensions that make it so.

        Raises:
            InputError: no such path, a value that the file could not have, or no dimension of the hole to set.
        """
        asked = {**(values or {}), **named}
        clearance = asked.pop("clearance", None)
        changed = self._with(asked) if asked else self
        if clearance is None:
            return changed
        axes = ("x",) if self.plane is not None else ("x", "y")
        # Declared first: what is declared is what the hole is given dimensions for.
        return resized(changed._with({f"clearance.{axis}": clearance for axis in axes}), str(clearance))

    def explain(self) -> str:
        """What the problem asks for, one statement a line, as `fmopt check` prints it; lengths in mm, angles in deg.

        Raises:
            InterferenceError: the parts overlap when assembled, or their clearance is not positive.
            TaskError: the task breaks a rule of the knowledge base.
        """
        from fmopt.task.explain import explain

        return explain(self, self.measured)

    def _with(self, values: Mapping[str, Given]) -> "Problem":
        known = Base.read(self.path).targets()
        spoken = {path.replace(".", "_"): path for path in known}
        placed, faults, mine = [], [], {}
        for name, value in values.items():
            path = name if name in known else spoken.get(name)
            if path is None:
                advice = did_you_mean(name, [*known, *spoken]) or "problem.targets lists the paths"
                message = "nothing of this problem has this path"
                faults.append(Fault("with_", 1, 1, name, "unknown-path", message, advice))
                continue
            key = known[path].key
            placed.append((key, value))
            mine[dotted(key)] = Fault("with_", 1, 1, name, "", "")
        if faults:
            raise InputError(*faults)
        try:
            # Spelled out, as a short form such as "1 mm, 1 deg" has no place for the value of one axis.
            return _problem(assigned(spelled_out(self.source)[0], placed))
        except InputError as error:
            raise InputError(*blamed(error.faults, mine)) from error

    def __str__(self) -> str:
        return f"{self.title}: {self.moving.name} into {self.fixed.name}"

    def __repr__(self) -> str:
        return f"<fmopt.Problem {self} ({self.path})>"

    def _repr_html_(self) -> str:
        from fmopt.notebook.sheets import problem_sheet

        return problem_sheet(self)


def load(path: str | PathLike[str]) -> Problem:
    """The problem of a file, checked as a whole with its models.

    >>> fmopt.load(fmopt.example("square_peg")).title
    'Square peg in a blind square hole, 0.1 mm clearance a side'

    Raises:
        InputError: with every fault of the file and of its models, each with its line and column.
    """
    return _problem(read(Path(path)))


def _problem(source: Source) -> Problem:
    return Problem(**vars(problem_of(source)), source=source)


def resized(problem: Problem, asked: str) -> Problem:
    """The problem with the hole's dimensions such that the measured clearance is the declared one.

    Measured play depends on the dimensions nearly linearly, so a few Newton steps on its differences suffice; of
    several dimensions that would do, all change as little as possible.

    Raises:
        InputError: no dimension of the hole changes the clearance, or none gives the wanted one.
    """
    side = "moving" if problem.task.exchanged else "fixed"  # where the file has the hole
    wanted = np.array((problem.declared_clearance or (0.0, 0.0))[: 1 if problem.plane is not None else 2])
    # The lengths among the parameters of its model, m, as the problem has them.
    given, _ = overrides_of(problem.source, Reading.of(problem.source.data), (side, "parameters"))
    values = dict(parameter_values(Base.read(problem.path).models[side])) | {n: o.value for n, o in given.items()}
    sizes = {name: value.value for name, value in values.items() if value.dimension == LENGTH}
    for _ in range(_STEPS):
        base = _play(problem)
        short = wanted - base
        if float(np.abs(short).max()) <= _SAME:
            return problem
        slopes = {name: _slope(problem, base, side, (name, size)) for name, size in sizes.items()}
        # What hardly moves the play, as a depth, would have to change beyond all measure.
        slopes = {name: slope for name, slope in slopes.items() if float(np.abs(slope).max()) > 1e-3}
        if not slopes:
            break
        change, *_ = np.linalg.lstsq(np.column_stack(list(slopes.values())), short, rcond=1e-6)
        sizes |= {name: sizes[name] + float(by) for name, by in zip(slopes, change, strict=True)}
        problem = _set(problem, side, {name: sizes[name] for name in slopes})
    if float(np.abs(wanted - _play(problem)).max()) <= _SAME:
        return problem
    found = ", ".join(f"{1e3 * value:.6g} mm" for value in _play(problem))
    message = f"no dimensions of {getattr(problem, side).name!r} give {asked} on each side, it measures {found}"
    advice = "set the dimensions themselves by path, or give the parts as models with parameters"
    raise InputError(Fault("with_", 1, 1, "clearance", "no-dimension", message, advice))


def _play(problem: Problem) -> Array:
    """Measured clearance on each side along x, and in space along y, m; where the parts overlap, how deep, below 0."""
    found = mating_clearance(problem.moving, problem.fixed, -float(problem.goal[2]))
    play = 0.5 * np.array(found.play[: 1 if problem.plane is not None else 2])
    return play if found.per_side > 0.0 else np.full(len(play), found.per_side)


def _slope(problem: Problem, base: Array, side: str, dimension: tuple[str, float]) -> Array:
    """How the clearance grows with a dimension from `base`; not at all where the model cannot have it any larger."""
    name, size = dimension
    try:
        return (_play(_set(problem, side, {name: size + _STEP})) - base) / _STEP
    except InputError:
        return np.zeros_like(base)


def _set(problem: Problem, side: str, sizes: dict[str, float]) -> Problem:
    return problem.with_({f"model.{side}.{name}": f"{round(size, 15)!r} m" for name, size in sizes.items()})
