"""The advice that users need most is followed to the letter: what the check refused, it takes then."""

import contextlib
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from fmopt.geometry.csg import Box
from fmopt.geometry.mating_features import DESCRIBE
from fmopt.spatial.se3 import Pose
from tests.shared.files.mesh_files import at, glb, obj_text, ply_text, stl_text, three_mf, triangles_of
from tests.shared.files.model_text import UNITS, cuboid
from tests.shared.files.pair import BLOCK, LONG, PAIR, PEG, SHORT, START, written
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box, write_assembly
from tests.shared.fuzz.files import run

Content = str | bytes | Callable[[Path], None]
Files = Mapping[str, Content]
POINTS, TRIANGLES = ROD = triangles_of(Box((0.02, 0.02, 0.05)))
STL = stl_text(*ROD)
MM = 'unit = "mm"'
WHOLE = f"{SHORT}{START}"
MATED = f'{LONG}feature = "hole"\n{START}'
FORMATS: dict[str, Content] = {
    "stl": STL,
    "obj": obj_text(*ROD),
    "ply": ply_text(*ROD),
    "3mf": three_mf(*ROD, "millimeter", (0.0, 0.0, 0.0)),
    "glb": glb(1e-3 * POINTS, TRIANGLES, {}),
    "step": lambda path: write_step(path, box(20.0, 20.0, 50.0)),
}
WIDE = cuboid("wide", "24, 24, 40", "60, 0, 10") + '[features.wide]\nkind = "hollow"\nat = [60, 0, 40]\nlength = 30\n'
TWO = {"block.toml": BLOCK.replace("60, 60", "200, 60").replace('["pocket"]', '["pocket", "wide"]') + WIDE + UNITS}


def peg(width: int) -> Files:
    """A square peg this wide, mm."""
    return {"peg.toml": PEG.replace("20, 20, 50", f"{width}, {width}, 50") + UNITS}


def rod(lines: str, file: str = "rod.stl", content: Content = STL) -> Files:
    """A problem of the rod as a file, and how to read it."""
    text = LONG.replace("peg.toml", file).replace("[fixed]", f"{lines}\n[fixed]")
    return {file: content, "problem.toml": f"{text}{START}"}


def meshed(lines: str, file: str = "rod.stl", content: Content = STL) -> Files:
    """The same, file and reading stated in the model of the peg."""
    return {file: content, "peg.toml": f'[mesh]\nfile = "{file}"\n{lines}\n{UNITS}'}


def scaled(scale: float) -> str:
    """The rod in another unit than mm."""
    return stl_text(scale * POINTS, TRIANGLES)


def two_bodies(path: Path) -> None:
    """A STEP file of the rod and a plate."""
    parts = [("plate", box(40.0, 36.0, 10.0), Pose.identity()), ("rod", box(20.0, 20.0, 50.0), at(60.0))]
    write_assembly(path, parts)


def told(*lines: str) -> Files:
    """A problem with these lines at its end."""
    return {"problem.toml": "\n".join([WHOLE, *lines, ""])}


def error(length: str, position: str) -> Files:
    """A problem in a unit of lengths, with this error of the start."""
    units = UNITS.replace("mm", length)
    return {"problem.toml": f"{units}{LONG}[uncertainty.start]\nposition = {position}\nangle = 1\n"}


def declared(feature: str, across: str) -> Files:
    """A problem of a block with two holes that declares a clearance on each side."""
    return {**TWO, "problem.toml": f'{MATED.replace("hole", feature)}[clearance]\nx = "{across}"\n'}


UNIT = {"m": 1e-3, "cm": 0.1, "mm": 1.0, "um": 1e3, "in": 1.0 / 25.4}
FOLLOWED: dict[str, tuple[str, int, Files, list[Files]]] = {
    "too thick": (
        "make the peg thinner or the hole wider, and check the units of both",
        1,
        peg(21),
        [peg(20), {**peg(21), "block.toml": BLOCK.replace("20.2, 20.2", "21.2, 21.2") + UNITS}],
    ),
    "no hole": (
        f"check the units of both, and that one has an opening for the other; or {DESCRIBE}",
        2,
        {"rod.stl": STL, "problem.toml": f'moving = "rod.stl"\nfixed = "rod.stl"\n{START}'},
        [rod(MM)],
    ),
    "an open mesh": (
        "repair the mesh: close it, orient all triangles outward, keep the solid free of edges of no thickness",
        2,
        rod(MM, content=stl_text(POINTS, TRIANGLES[4:])),
        [rod(MM)],
    ),
    "a mesh without a unit": (
        "add 'unit' to [mesh]: m, cm, mm, um or in",
        2,
        meshed(""),
        [meshed(f'unit = "{unit}"', content=scaled(scale)) for unit, scale in UNIT.items()],
    ),
    "a mesh in another unit": ('set unit = "mm" if that is meant', 2, meshed('unit = "m"'), [meshed(MM)]),
    "a number without a unit": (
        'write text with its unit, such as "2 mm", or add length = "mm" under [units]',
        2,
        told("[start]", "height = 2"),
        [told("[start]", 'height = "2 mm"'), told("[start]", "height = 2", "[units]", 'length = "mm"')],
    ),
    "no format of meshes": (
        "use .stl, .obj, .ply, .3mf or .glb, or .step with the extra step",
        2,
        meshed(MM, "rod.iges"),
        [meshed(MM * (form in ("stl", "obj", "ply")), f"rod.{form}", content) for form, content in FORMATS.items()],
    ),
    "several bodies": (
        'say which by body = "plate", under [mesh], [moving] or [fixed], where the file is named; or export one part '
        "on its own",
        2,
        rod("", "fit.step", two_bodies),
        [
            rod('body = "rod"', "fit.step", two_bodies),
            meshed('body = "rod"', "fit.step", two_bodies),
            rod("", "rod.step", FORMATS["step"]),
        ],
    ),
    "too deep": (
        'lower it, or write "full"',
        2,
        told("[goal]", 'depth = "31 mm"'),
        [told("[goal]", 'depth = "30 mm"'), told("[goal]", 'depth = "full"')],
    ),
    "an error beyond the parts": (
        'check [units], or write the unit beside the number, as in "0.4 mm"',
        2,
        error("cm", "12"),
        [error("mm", "12"), error("cm", '"0.4 mm"')],
    ),
    "another clearance than measured": (
        "check the units of the model files, [mesh] unit among them, and which features are to mate; "
        "or correct [clearance]",
        2,
        declared("wide", "0.1 mm"),
        [declared("hole", "0.1 mm"), declared("wide", "2 mm")],
    ),
    "a key misspelt": (
        "did you mean 'turn'?",
        2,
        {"peg.toml": f"{PEG}trn = [0, 0, 0]\n{UNITS}"},
        [{"peg.toml": f"{PEG}turn = [0, 0, 0]\n{UNITS}"}],
    ),
}


def checked(folder: Path, files: Files) -> tuple[int | str, str]:
    """The exit code and the words of a check of a problem about the peg and the block, some of their files changed."""
    folder.mkdir()
    whole = {**PAIR, "problem.toml": WHOLE, **files}
    written(folder, {name: content for name, content in whole.items() if not callable(content)})
    for name, content in whole.items():
        if callable(content):
            content(folder / name)
    with contextlib.chdir(folder):
        return run(("check", "problem.toml"))


@pytest.mark.parametrize("name", FOLLOWED)
def test_advice_that_is_followed_helps(name: str, tmp_path: Path) -> None:
    advice, code, wrong, right = FOLLOWED[name]
    refused, said = checked(tmp_path / "refused", wrong)
    assert refused == code
    assert advice in said
    for number, files in enumerate(right):
        taken, said = checked(tmp_path / str(number), files)
        assert taken == 0, said
