"""Damaged files of each kind that a command reads: whatever the damage, an exit code and a message, within its time."""

import io
import json
import random
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from unittest.mock import patch

from fmopt.cli.entry import main
from fmopt.geometry.mesh.mesh_file import OWN_UNIT
from tests.shared.files import own
from tests.shared.files.mesh_damage import Mesh
from tests.shared.files.mesh_files import (
    binary_ply,
    binary_stl,
    glb,
    obj_text,
    plate,
    ply_text,
    rounded,
    stl_text,
    three_mf,
    triangles_of,
)
from tests.shared.files.model_text import of_file
from tests.shared.files.shipped import copied
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box, cut
from tests.shared.fuzz.damage import damaged
from tests.shared.plans.table_plan import table_plan

SECONDS = 30  # of the processor, for one file
WAITED = 600  # s by the clock
EXPECTED = {0, 1, 2, 3}
OWN = own.PROBLEM.partition("[settings]")[0].replace("x = 0.2\n", "x = 0.15\n")
PROBLEMS = ("square_peg", "factory_rect_8mm_sources", "kite_prism", "mit_planar_slot", "square_peg_100um")
STUDIES = ("square_peg_bias", "square_peg_clearance", "factory_rect_fits", "factory_rect_8mm_position")


class Overrun(BaseException):
    """A file took longer than its time; no handler of the program's may take it for its own."""


@dataclass(frozen=True)
class Case:
    """A file to damage in a folder, whether it is JSON, and the command lines of fmopt, run there, that read it."""

    file: str
    commands: tuple[tuple[str, ...], ...]
    data: bool = False


def run(arguments: tuple[str, ...]) -> tuple[int | str, str]:
    """The exit code of a command line, as from a shell, and what it writes; a word when it has none."""

    def late(_: int, __: FrameType | None) -> None:
        raise Overrun

    out, err = io.StringIO(), io.StringIO()
    before = {each: signal.signal(each, late) for each in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(WAITED)
    try:
        with patch.object(sys, "argv", ["fmopt", *arguments]), redirect_stdout(out), redirect_stderr(err):
            main()
        code: int | str = 0
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else str(stop.code)
    except Overrun:
        code = "over its time"
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for each, handler in before.items():
            signal.signal(each, handler)
    return code, out.getvalue() + err.getvalue()


def fuzzed(kind: str, count: int, seed: int, folder: Path) -> tuple[Counter[int | str], list[str]]:
    """How often each exit code came of so many damaged files of a kind, one of `KINDS`, and what must not be.

    Whole files are laid out in an empty folder, one of which is damaged at a time.
    """
    cases = KINDS[kind](folder)
    wholes = {case.file: (folder / case.file).read_bytes() for case in cases}
    codes: Counter[int | str] = Counter()
    failures = []
    with chdir(folder):
        for command in dict.fromkeys(command for case in cases for command in case.commands):
            code, said = run(command)
            assert code == 0, f"{' '.join(command)}: {code}: {said}"
        for number in range(count):
            rng = random.Random(f"{kind} {seed} {number}")
            case = rng.choice(cases)
            Path(case.file).write_bytes(damaged(rng, wholes[case.file], data=case.data))
            for command in case.commands:
                code, said = run(command)
                codes[code] += 1
                if code not in EXPECTED or "Traceback" in said or (code == 2 and not said.strip()):
                    failures.append(f"{kind} {seed} {number}: {' '.join(command)}: {code}: {said[-300:].strip()}")
            Path(case.file).write_bytes(wholes[case.file])
    return codes, failures


def _shipped(files: Mapping[str, str], *words: str) -> Callable[[Path], list[Case]]:
    """Cases of shipped files, each with the file that the words after `fmopt` read for it."""

    def cases(folder: Path) -> list[Case]:
        copied(folder)
        return [Case(file, (tuple(word.format(named) for word in words),)) for file, named in files.items()]

    return cases


def _themselves(*names: str) -> dict[str, str]:
    return {f"problems/{name}.toml": f"problems/{name}.toml" for name in names}


def _plans(folder: Path) -> list[Case]:
    """The plan of a table, which needs no search."""
    (folder / "plan.json").write_text(json.dumps(table_plan()))
    return [Case("plan.json", (("verify", "plan.json"), ("show", "plan.json")), data=True)]


def _own(kind: str, content: Callable[[Mesh, str], bytes]) -> Callable[[Path], list[Case]]:
    """Cases of a rod and a plate in files of a kind, their contents by mesh and name."""

    def cases(folder: Path) -> list[Case]:
        (folder / "problem.toml").write_text(OWN)
        damaged = ("plate",) if kind == "step" else ("rod", "plate")
        for name, solid in (("rod", rounded((0.012, 0.008), 0.03, 0.0005)), ("plate", plate((0.0123, 0.0083)))):
            whole = name not in damaged
            unit = 'unit = "mm"\n' if kind not in ("step", *OWN_UNIT) or whole else ""
            suffix = "stl" if whole else kind
            (folder / f"{name}.toml").write_text(of_file(f"{name}.{suffix}", unit))
            (folder / f"{name}.{suffix}").write_bytes((_stl if whole else content)(triangles_of(solid), name))
        return [Case(f"{name}.{kind}", (("check", "problem.toml"),)) for name in damaged]

    return cases


def _stl(mesh: Mesh, name: str) -> bytes:
    return binary_stl(*mesh) if name == "rod" else stl_text(*mesh).encode()


def _step() -> bytes:
    hole = box(12.3, 8.3, 20.0, (0.0, 0.0, -5.0))
    with tempfile.TemporaryDirectory() as folder:
        write_step(Path(folder) / "plate.step", cut(box(40.0, 40.0, 10.0), hole))
        return (Path(folder) / "plate.step").read_bytes()


MODELS = {
    **dict.fromkeys(("square_peg", "square_hole_block"), "square_peg"),
    **dict.fromkeys(("kite_prism", "kite_box"), "kite_prism"),
    **dict.fromkeys(("mit_planar_peg", "mit_planar_slot"), "mit_planar_slot"),
    "keyed_shaft": "keyed_shaft",
}
KINDS: dict[str, Callable[[Path], list[Case]]] = {
    "problem": _shipped(_themselves(*PROBLEMS), "check", "{}"),
    "model": _shipped({f"models/{name}.toml": f"problems/{of}.toml" for name, of in MODELS.items()}, "check", "{}"),
    "assembly": _shipped(_themselves("assemblies/lee_huang_bush"), "check", "{}"),
    "study": _shipped(
        _themselves(*(f"studies/{name}" for name in STUDIES)),
        *("study", "run", "{}", "--limit", "0", "--jobs", "1", "--out", "out"),
    ),
    "allocation": _shipped(_themselves("studies/factory_rect_8mm_tolerances"), "study", "run", "{}", "--dry-run"),
    "plan": _plans,
    "stl": _own("stl", _stl),
    "obj": _own("obj", lambda mesh, _: obj_text(*mesh).encode()),
    "ply": _own("ply", lambda mesh, name: binary_ply(*mesh, "<") if name == "rod" else ply_text(*mesh).encode()),
    "3mf": _own("3mf", lambda mesh, _: three_mf(*mesh, "millimeter", (0.0, 0.0, 0.0))),
    "glb": _own("glb", lambda mesh, _: glb(1e-3 * mesh[0], mesh[1], {})),
    "step": _own("step", lambda *_: _step()),
}
