"""Refusals of model, problem and assembly files that no other test meets: the message, and the advice at its end."""

import io
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

import fmopt
from fmopt.errors import FmoptError
from fmopt.geometry.csg import Box
from fmopt.geometry.mating_features import DESCRIBE
from fmopt.task.toml import source
from tests.shared.files.mesh_files import glb, stl_text, triangles_of
from tests.shared.files.model_text import UNITS
from tests.shared.files.pair import BLOCK, PAIR, PEG, SHORT, START, assembly, files, model, problem, raw_model
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box

POINTS, TRIANGLES = triangles_of(Box((0.02, 0.02, 0.05)))
STL = stl_text(POINTS, TRIANGLES)
WHOLE = f"{SHORT}{START}"
ROBOT = '[uncertainty.sources]\nrobot = { position = "0.1 mm" }\ngrasp = { height = "20 mm" }\n'
IMPACT = f'{WHOLE}[specification]\nimpact_force = "30 N"\ncontact_stiffness = "20 N/mm"'
BALL = "[balls.tip]\nat = [0, 0, 0]\nradius = 8\n"
ON_IT = '[features.peg]\nkind = "solid"\nat = [0, 0, 0]\nlength = 50\n'
PROFILE = "[profile]\npolygons = [[[-10, 0], [10, 0], [10, 50], [-10, 50]]]\n"
TWO = "[profile]\npolygons = [[[-10, 0], [0, 0], [0, 50], [-10, 50]], [[0, 0], [10, 0], [10, 50], [0, 50]]]\n"
HOLLOW = ON_IT.replace("peg", "hole").replace("solid", "hollow")
SLOT = "[profile]\npolygons = [[[-30, 0], [-10.1, 0], [-10.1, 40], [-30, 40]],"
SLOT += " [[10.1, 0], [30, 0], [30, 40], [10.1, 40]], [[-30, 0], [30, 0], [30, 10], [-30, 10]]]\n"
SLOT += '[features.hole]\nkind = "hollow"\nat = [0, 0, 40]\nlength = 30\n'
PLANE = {"peg.toml": f"{PROFILE}{ON_IT}{UNITS}", "block.toml": f"{SLOT}{UNITS}"}
WALL = '[obstacles.wall]\nshape = "box"\nsize = ["10 mm", "50 mm", "20 mm"]\nat = ["60 mm", 0, "40 mm"]\n'
HELD = f'{WHOLE}[tool.solids]\ngripper = "held.toml"\n'
LEVEL = '[uncertainty.start]\nx = "1 mm"\nz = "1 mm"\nry = "1 deg"\n'
TCP = '[tool]\ntcp = { at = [0, 0, "10 mm"] }\n'
FLAT_ERROR = '[uncertainty.start]\nx = "1 mm"\ny = "1 mm"\nz = "1 mm"\nry = "1 deg"\n'
LARGE = {name: text.replace('"mm"', '"cm"') for name, text in PAIR.items()}
PIN = 'part = "rod"\n[solids.rod]\nshape = "cylinder"\nradius = 10\nheight = 30\n'
ROUND = f'{PIN}{{}}\n[features.pin]\nkind = "solid"\nat = [0, 0, 0]\nlength = 30'
TASK = """title = "a peg"
[objects.peg]
model = "peg.toml"
[tasks.first]
moving = "peg"
fixed = "peg.peg"
attachment = "prismatic"
goal = ["free", "free", "free", "free", "free", "free"]
specification = { speed = "20 mm/s", contact_force = "20 N", torque_limit = "1 N*m" }
"""
START_ERROR = 'write a distance and an angle with their units, such as "1 mm, 1 deg": how far off the part may start'
Contents = Mapping[str, str | bytes]


def come_in(folder: Path, content: bytes | None) -> Any:
    """A model from standard input; None for one that cannot be read."""
    stream = mock.Mock(buffer=io.BytesIO(content or b""))
    if content is None:
        stream.buffer = mock.Mock(read=mock.Mock(side_effect=OSError(21, "Is a directory")))
    with mock.patch.object(sys, "stdin", stream):
        return source.read(source.STDIO)


def loaded(folder: Path, name: str) -> Any:
    """A file as a problem, whatever it is."""
    contents = {**PAIR, "rod.stl": STL, "plan.json": "{}", "assembly.toml": TASK}
    for file, content in contents.items():
        (folder / file).write_text(content)
    return fmopt.load(folder / name)


def moving(folder: Path, lines: str) -> Any:
    """A problem of a moving part that these lines name, among files of rods."""
    if "step" in lines:
        write_step(folder / "rod.step", box(20.0, 20.0, 50.0))
    table = f'[moving]\n{lines}\n[fixed]\nmodel = "block.toml"\n{START}'
    metres = stl_text(1e-3 * POINTS, TRIANGLES)
    rods: Contents = {"rod.stl": STL, "rod.toml": f'[mesh]\nfile = "rod.stl"\n{UNITS}', "metres.stl": metres}
    return files(folder, {**rods, "problem.toml": table})


def meshed(folder: Path, content: str | bytes) -> Any:
    """A model of a mesh whose unit is not stated."""
    name = "rod.stl" if isinstance(content, str) else "rod.glb"
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return model(folder, f'[mesh]\nfile = "{name}"')


def spelled(folder: Path, text: str) -> Any:
    """A problem with a start error as text."""
    return problem(folder, f'{SHORT}[uncertainty]\nstart = "{text}"')


REFUSED: tuple[tuple[Callable[[Path, Any], Any], Any, str], ...] = (
    (come_in, b"#" * 1_000_001, "more than 1000000 bytes come in; name a smaller file"),
    (come_in, None, "standard input: Is a directory; give something to read, or a file"),
    (loaded, "rod.stl", "is a mesh or CAD file, not TOML; name a problem file, which names two models"),
    (loaded, "plan.json", "is JSON, not TOML; name a problem or model file; a plan goes to fmopt verify"),
    (loaded, "peg.toml", "this is a model file, not a problem; name a problem file, which names two models under [mo"),
    (loaded, "assembly.toml", "this is an assembly, not a problem; check it with fmopt check"),
    (raw_model, "", "part.toml is empty; copy a shipped problem or model and change it"),
    (problem, f'moving = "peg.toml"\n{START}', "this key is missing; add 'fixed' above the first table, or as a table"),
    (problem, f"moving = 1\n{WHOLE[20:]}", "moving: a number stands here; write a table"),
    (problem, f'moving = ""\n{WHOLE[20:]}', "moving.model: '' is not accepted; it should have at least 1 character"),
    (problem, f"{WHOLE}[settings]\ncharacteristic_length = true", "a boolean stands where a length is asked for"),
    (problem, f'{WHOLE}[goal]\nattachment = "planar"', "the knowledge base answers such tasks; describe it in an"),
    (problem, IMPACT, "add 'apparent_mass' to [specification], or drop 'impact_force' and 'contact_stiffness'"),
    (assembly, TASK, 'write "object.feature"'),
    *((spelled, text, START_ERROR) for text in ("1 mm", "1 mm, 1 mm", "1 mm, 1 kg", "a little")),
    (model, ROUND.format("sides = 2"), "it should be greater than or equal to 3"),
    (model, ROUND.format("sides = 20\nsagitta = 0.1"), "both sides and sagitta are given; give one of them"),
    (model, ROUND.format("sagitta = 1e-6"), "its sagitta asks for 7028 sides; give one for which 1998 sides do"),
    (model, f'{PEG}[parameters]\nw = "1 kg"', 'write a number, or text such as "2 mm"'),
    (model, f"{PEG}through = true", "a solid feature cannot be through; remove 'through'"),
    (raw_model, PEG.replace("50]", "50e6]") + UNITS.replace("mm", "um"), "more than 4 m; check its numbers"),
    (model, f"{PROFILE}{ON_IT}{BALL}", "there are balls without solids; give [solids] and part as the only shape"),
    (model, f"{BLOCK}{BALL}", 'give them to the part that goes in, or a solid of shape = "sphere" to this one'),
    (model, PROFILE, "add [features.NAME] with kind, at and length: where the part mates"),
    (model, f'part = "peg"\n{PROFILE}{ON_IT}', "a profile has no solids; remove 'part'"),
    (model, f"{PROFILE}{ON_IT}".replace("length = 50\n", ""), "this key is missing; add 'length' to the feature"),
    (model, f"{PROFILE}{ON_IT}{HOLLOW}", "a profile has both solid and hollow features; keep one kind"),
    (model, f"{TWO}{ON_IT}", "what moves in a plane is to be one convex polygon"),
    (model, f"{PROFILE}{ON_IT}".replace("0, 0, 0", "0, 1, 0"), "write at = [x, 0, z] without turn, z out of the mouth"),
    (meshed, "solid", "add 'unit' to [mesh]: m, cm, mm, um or in; and mend the file"),
    (meshed, glb(POINTS, TRIANGLES, {}), "its file says its unit itself: export it again, in the size that is meant"),
    (moving, 'model = "metres.stl"', 'set unit = "m" where the file is named, under [moving], [fixed] or [mesh], or b'),
    (moving, 'model = "peg.toml"\nunit = "mm"', "this is for mesh and STEP files; leave 'unit' out"),
    (moving, 'model = "rod.toml"\nunit = "mm"', "leave 'unit' out, or put it under [mesh] of the model file"),
    (moving, 'model = "rod.step"\nunit = "mm"', "rod.step says its unit itself; leave 'unit' out"),
    (moving, 'model = "rod.stl"\nparameters.width = "1 mm"', "has no parameters; name a model file, or leave it out"),
    (moving, 'model = "problem.toml"', "this is a problem file, not a model; name a model file, which describes one p"),
    (files, {"block.toml": f"{BLOCK[: BLOCK.index('[features')]}{ON_IT}{UNITS}"}, f"are solid; {DESCRIBE}"),
    (files, {"peg.toml": f"{PEG}{BALL}{UNITS}", "problem.toml": f"{SHORT}{ROBOT}"}, "of the ball's lowest point"),
    (files, {"block.toml": PLANE["block.toml"]}, "give both models a [profile], or none"),
    (files, {**PLANE, "problem.toml": SHORT + FLAT_ERROR}, "'y' leaves the plane of a planar problem; leave it out"),
    (files, {**PLANE, "problem.toml": SHORT + LEVEL + WALL}, "leave [tool] solids and [obstacles] out"),
    (problem, f'{WHOLE}{WALL}[settings]\nevidence = "certified"', 'write settings.evidence = "tested", or leave'),
    (files, {"held.toml": f"{PEG}{BALL}{UNITS}", "problem.toml": HELD}, "give [solids] or [mesh] alone"),
    (problem, 'moving = "block.toml"\nfixed = "peg.toml"\n' + f"{START}{TCP}", "leave it out"),
    (files, {**LARGE, "problem.toml": SHORT + ROBOT.replace("0.1", "300")}, "add up to 600 mm; keep them at most 500"),
)


@pytest.mark.parametrize(("read", "given", "words"), REFUSED, ids=[row[2][:40] for row in REFUSED])
def test_what_is_no_use_gets_advice(read: Callable[[Path, Any], Any], given: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(FmoptError, match=re.escape(words)) as caught:
        read(tmp_path, given)
    assert caught.value.exit_code in (2, 4)
