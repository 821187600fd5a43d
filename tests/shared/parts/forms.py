"""The same two parts in TOML, as binary STL and as STEP, read as the same."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from tests.shared.parts import families

WRITERS = {"toml": families.write_toml, "stl": families.write_stl, "step": families.write_step}
_CLOSE = 1e-6  # m


def read(pair: families.Pair, form: str, folder: Path) -> Problem:
    """The problem of a pair, read from files of one form."""
    return load(WRITERS[form](pair, folder / form))


def differences(pair: families.Pair, problems: Mapping[str, Problem]) -> list[str]:
    """What differs from the pair as it was drawn, and between two forms of it, frames up to the symmetry of the part.

    Where both parts lie alike in their mating frames, the frames are one or differ by a symmetry.
    """
    found = []
    first = next(iter(problems.values()))
    for form, problem in problems.items():
        clearance = measured_clearance(problem).per_side
        if not abs(clearance - 1e-3 * pair.clearance) < _CLOSE:
            found.append(f"{form}: clearance {1e6 * clearance:.2f} µm, not {1e3 * pair.clearance:.2f}")
        if not abs(-problem.goal[2] - 1e-3 * pair.depth) < _CLOSE:
            found.append(f"{form}: depth {-1e3 * problem.goal[2]:.4f} mm, not {pair.depth}")
        if problem.hole.through != pair.through:
            found.append(f"{form}: the hole is read as {'through' if problem.hole.through else 'blind'}")
        if np.abs(problem.start_box - first.start_box).max() > _CLOSE:
            found.append(f"{form}: the start error is {problem.start_box}, not {first.start_box}")
        for side in ("moving", "fixed"):
            one, other = getattr(first, side).polyhedron, getattr(problem, side).polyhedron
            a, b = one.vertices, other.vertices
            apart = np.linalg.norm(a[:, None] - b, axis=2)
            if max(apart.min(axis=0).max(), apart.min(axis=1).max()) > _CLOSE:
                found.append(f"{form}: the {side} part lies elsewhere in its mating frame")
            elif [face.loops for face in one.faces] != [face.loops for face in other.faces]:
                found.append(f"{form}: corners and faces of the {side} part are in another order")
            names = getattr(first, f"{side}_feature"), getattr(problem, f"{side}_feature")
            if names[0] != names[1]:
                found.append(f"{form}: the {side} part mates with {names[1]}, not {names[0]}")
    return found
