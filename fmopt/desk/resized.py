"""Holes of other dimensions: a parametric hole is given those with which a clearance measures as declared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmopt.errors import Fault, InputError
from fmopt.geometry.clearance import mating_clearance
from fmopt.study.targets import Base
from fmopt.task.model import overrides_of, parameter_values
from fmopt.task.tables import Reading, factors
from fmopt.task.units import LENGTH
from fmopt.values import Array

if TYPE_CHECKING:
    from fmopt.desk.problem import Problem

_STEP = 1e-5  # m, by which a dimension is varied to see what it does
_STEPS = 4
_SAME = 1e-8  # m, between the clearance that was asked for and the measured one


def resized(problem: Problem, asked: str) -> Problem:
    """The problem with the hole's dimensions such that the measured clearance is the declared one.

    Measured play depends on the dimensions nearly linearly, so a few Newton steps on its differences suffice; of
    several dimensions that would do, all change as little as possible.

    Args:
        problem: declares the wanted clearance.
        asked: the clearance as it was asked for, for messages.

    Raises:
        InputError: no dimension of the hole changes the clearance, or none gives the wanted one.
    """
    side = "moving" if problem.task.exchanged else "fixed"
    wanted = _wanted(problem)
    sizes = _dimensions(problem, side)
    for _ in range(_STEPS):
        base = _play(problem)
        short = wanted - base
        if float(np.abs(short).max()) <= _SAME:
            return problem
        slopes = {name: _slope(problem, base, side, (name, size)) for name, size in sizes.items()}
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


def _wanted(problem: Problem) -> Array:
    x, y = problem.declared_clearance
    return np.array([x] if problem.plane is not None else [x, y])


def _play(problem: Problem) -> Array:
    """Measured clearance on each side along x, and in space along y, m; where the parts overlap, how deep, below 0."""
    found = mating_clearance(problem.moving, problem.fixed, -float(problem.goal[2]))
    play = 0.5 * np.array(found.play[: 1 if problem.plane is not None else 2])
    return play if found.per_side > 0.0 else np.full(len(play), found.per_side)


def _dimensions(problem: Problem, side: str) -> dict[str, float]:
    """The lengths among the parameters of a part's model, m, as the problem has them."""
    reading = Reading(factors(problem.source.data.get("units")))
    given, _ = overrides_of(problem.source, reading, (side, "parameters"))
    values = dict(parameter_values(Base.read(problem.path).models[side])) | {n: o.value for n, o in given.items()}
    return {name: value.value for name, value in values.items() if value.dimension == LENGTH}


def _slope(problem: Problem, base: Array, side: str, dimension: tuple[str, float]) -> Array:
    """How the clearance grows with a dimension from `base`; not at all where the model cannot have it any larger."""
    name, size = dimension
    try:
        return (_play(_set(problem, side, {name: size + _STEP})) - base) / _STEP
    except InputError:
        return np.zeros_like(base)


def _set(problem: Problem, side: str, sizes: dict[str, float]) -> Problem:
    return problem.with_({f"model.{side}.{name}": f"{round(size, 15)!r} m" for name, size in sizes.items()})
