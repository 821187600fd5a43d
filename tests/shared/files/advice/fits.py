"""Advice on how two parts go together, followed: which of their features mate, in which unit, with what clearance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import fmopt
from fmopt.errors import GeometryError
from fmopt.geometry.csg import Box, Cylinder
from fmopt.geometry.mating_features import DESCRIBE
from fmopt.planning.pipeline import tried
from fmopt.task.explain import facts
from tests.shared.files.advice.case import Case
from tests.shared.files.advice.edits import BLOCK, LONG, PAIR, PEG, START, edited, files, fitted, problem, written
from tests.shared.files.advice.problems import MATED, NAMED
from tests.shared.files.mesh_damage import subdivided
from tests.shared.files.mesh_files import plate, rounded, stl_text, triangles_of
from tests.shared.files.model_text import UNITS, cuboid
from tests.shared.files.packed import packed_stl


def declared(folder: Path, given: tuple[str, str, str]) -> Any:
    """A problem that declares a clearance on each side, its parts in some unit, its hole a wide one or not."""
    across, unit, name = given
    wide = f'{TWO}[features.wide]\nkind = "hollow"\nat = [60, 0, 40]\nlength = 30\n'
    parts = {"peg.toml": PEG + UNITS, "block.toml": wide + UNITS}
    parts = {file: text.replace('length = "mm"', f'length = "{unit}"') for file, text in parts.items()}
    text = f'moving = "peg.toml"\n{START}[fixed]\nmodel = "block.toml"\nfeature = "{name}"\n'
    return fitted(folder, {**parts, "problem.toml": text + (f'[clearance]\nx = "{across}"\n' if across else "")})


def meshes(folder: Path, noise: float) -> Any:
    """A rod and a plate as meshes, the plate's facets this far off its planes, mm."""
    rng = np.random.default_rng(1)
    points, corners = subdivided(*triangles_of(plate((0.01202, 0.00802))), rng)
    noisy = points + noise * rng.uniform(-1.0, 1.0, points.shape)
    rod = stl_text(*triangles_of(rounded((0.012, 0.008), 0.03)))
    both = {"rod.stl": rod, "plate.stl": packed_stl(noisy, corners)}
    said = {"problem.toml": 'moving = "rod.stl"\nfixed = "plate.stl"\n' + START}
    return fitted(folder, {**both, **said})


def plain(folder: Path, given: tuple[str, str]) -> Any:
    """A problem of the peg and a block, and a feature of that which it names, or none."""
    block, name = given
    named = f'feature = "{name}"\n' if name else ""
    return files(folder, {"block.toml": block + UNITS, "problem.toml": f"{LONG}{named}{START}"})


def far_off(folder: Path, x: float) -> Any:
    """A bar with a feature far from where it is, in mm."""
    far = PEG.replace("at = [0, 0, 0]", f"at = [{x}, 0, 0]")
    return files(folder, {"peg.toml": far + UNITS, "problem.toml": f"{MATED}{START}"})


def bare(folder: Path, where: str) -> Any:
    """A rod as a mesh whose numbers are in m, its unit said somewhere or nowhere."""
    points, corners = triangles_of(Box((0.02, 0.02, 0.05)))
    rod = stl_text(1e-3 * points, corners)
    if where == "--unit":
        written(folder, {**PAIR, "rod.stl": rod})
        return fmopt.problem(
            folder / "rod.stl", folder / "block.toml", "1 mm, 1 deg", unit="m", folder=folder / "asked"
        )
    said = {"rod.stl": rod, "rod.toml": f'[mesh]\nfile = "rod.stl"\nunit = "m"\n{UNITS}'}
    unit, name = 'unit = "m"' if where == "moving" else "", "rod.toml" if where == "mesh" else "rod.stl"
    text = f'[moving]\nmodel = "{name}"\n{unit}\n[fixed]\nmodel = "block.toml"\n{START}'
    return files(folder, {**said, "problem.toml": text})


def round_peg(sides: int) -> dict[str, str]:
    """A problem of a round peg as a mesh of so many sides."""
    rod = stl_text(*triangles_of(Cylinder(0.01, 0.05, sides)))
    return {"rod.stl": rod, "problem.toml": NAMED_STL.format('unit = "mm"\n')}


WIDE = cuboid("wide", "24, 24, 40", "60, 0, 10")
TWO = BLOCK.replace("60, 60, 40", "200, 60, 40").replace('["pocket"]', '["pocket", "wide"]') + WIDE
BARE_BLOCK = BLOCK[: BLOCK.index("[features")]
PEG_TOO = '[features.p]\nkind = "solid"\nat = [15, 0, 0]\nlength = 40\n'
BARE = 'set unit = "m" where the file is named, under [moving], [fixed] or [mesh], or by --unit m, if that is meant'
FITTING = ("2 mm", "mm", "wide")
CENTIMETRES = "[uncertainty.start]\nposition = 2\nangle = 1"
WHOLE = f"{MATED}{START}"
CHECK = "check the units of the model files, [mesh] unit among them, and which features are to mate; "
EITHER = f"{CHECK}or correct [clearance]"
CASES: tuple[Case, ...] = (
    edited("a feature misspelt", "did you mean 'hole'?", problem, WHOLE.replace('"hole"', '"hle"'), WHOLE),
    edited("no such feature", "features: hole", problem, WHOLE.replace('"hole"', '"slot"'), WHOLE),
    edited(
        "no such feature of a part that states none",
        f"leave 'feature' out, to have it found with the other part; or {DESCRIBE}",
        plain,
        (BARE_BLOCK, "slot"),
        (BARE_BLOCK, ""),
        (BLOCK.replace("[features.hole]", "[features.slot]"), "slot"),
    ),
    edited("a peg each", DESCRIBE, plain, (f"{BARE_BLOCK}{PEG_TOO}", ""), (BLOCK, "")),
    edited("two pegs", NAMED, problem, WHOLE.replace("block", "peg").replace("hole", "peg"), WHOLE),
    edited("another clearance", EITHER, declared, ("0.1 mm", "mm", "wide"), ("0.1 mm", "mm", "hole"), FITTING),
    edited("another unit of the parts", EITHER, declared, ("0.1 mm", "cm", "wide"), FITTING),
    edited("facets off their planes", "export the mesh with more digits, its plane faces plane", meshes, 0.01, 0.0),
    edited("a feature elsewhere", "check where the feature is", far_off, 5000, 0),
    edited("metres for millimetres", BARE, bare, "", "moving", "mesh", "--unit"),
)


def warned(folder: Path, changed: Mapping[str, str]) -> float:
    """A problem of a peg that is checked without a warning.

    Raises:
        GeometryError: with the warnings as advice.
    """
    problem_ = files(folder, changed)
    warnings = facts(problem_, tried(problem_))["warnings"]
    if warnings:
        raise GeometryError("there are warnings", "\n".join(warnings))
    return 1.0


STL = stl_text(*triangles_of(Box((0.02, 0.02, 0.05))))
NAMED_STL = '[moving]\nmodel = "rod.stl"\n{}[fixed]\nmodel = "block.toml"\n' + START
WARNED: tuple[tuple[str, Mapping[str, str], Mapping[str, str]], ...] = (
    (
        "rod.stl has no unit; its numbers are taken for mm, so that the part is 20 x 20 x 50 mm: state its unit",
        {"rod.stl": STL, "problem.toml": NAMED_STL.format("")},
        {"rod.stl": STL, "problem.toml": NAMED_STL.format('unit = "mm"\n')},
    ),
    (
        "it may begin beside the hole altogether; check the units",
        {"problem.toml": f'[units]\nlength = "cm"\nangle = "deg"\n{LONG}{CENTIMETRES}'},
        {"problem.toml": f'[units]\nlength = "mm"\nangle = "deg"\n{LONG}{CENTIMETRES}'},
    ),
    ("which is the clearance and more; give finer facets", round_peg(18), round_peg(96)),
)
