"""What is shipped: wheel and source distribution build, and the wheel alone solves a shipped example.

A function takes six parameters at most: what always travels together is a value. Commands have an option each.
"""

import ast
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import fmopt
from fmopt.manual import PAGES
from tests import ROOT

MOST_PARAMETERS = 6


@pytest.mark.slow
def test_the_wheel_works_from_an_empty_folder_and_no_kernel_reaches_beyond_its_arrays(tmp_path: Path) -> None:
    """Compiled, kernels do not look where they read and write; as they are written, and run here, Python does."""
    from hatchling.builders.sdist import SdistBuilder
    from hatchling.builders.wheel import WheelBuilder

    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path / "dist"), versions=["standard"])
    (source,) = SdistBuilder(str(ROOT)).build(directory=str(tmp_path / "dist"), versions=["standard"])
    assert source.endswith(".tar.gz")
    installed, empty = tmp_path / "installed", tmp_path / "empty"
    empty.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        assert not [name for name in archive.namelist() if name.startswith(("tests", "notebooks"))]
        assert {f"fmopt/manual/{name}.md" for name in PAGES} <= {*archive.namelist()}
        archive.extractall(installed)
    environment = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_DISABLE_JIT": "1"}
    code = (
        "import fmopt, fmopt.manual, sys\nassert fmopt.__file__.startswith(sys.argv[1]), fmopt.__file__\n"
        "plan = fmopt.solve(fmopt.load(fmopt.example('ball_pin')))\n"
        "plan.save('plan.json'), plan.report('report.html'), print(plan.verify().verdict, plan.document['sha256'])\n"
        "assert len(fmopt.manual.manual()) > 200_000"
    )
    words = [sys.executable, "-c", code, str(installed)]
    done = subprocess.run(words, cwd=empty, env=environment, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr
    compiled = fmopt.solve(fmopt.load(fmopt.example("ball_pin")))
    assert done.stdout.split() == ["CERTIFIED", compiled.document["sha256"]]
    assert (empty / "report.html").stat().st_size > 100_000


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> int:
    """How many a function takes, but for self and cls."""
    listed = function.args
    names = [argument.arg for argument in (*listed.posonlyargs, *listed.args, *listed.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def command(function: ast.AST) -> bool:
    """Whether it is a command of the command line."""
    decorators = [item.func for item in getattr(function, "decorator_list", []) if isinstance(item, ast.Call)]
    return any(isinstance(item, ast.Attribute) and item.attr == "command" for item in decorators)


def wide(source: str) -> list[str]:
    """Functions with too many parameters that are no commands."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
    found = [node for node in ast.walk(ast.parse(source)) if isinstance(node, functions) and not command(node)]
    return [getattr(node, "name", "lambda") for node in found if parameters(node) > MOST_PARAMETERS]


def test_no_function_has_more_than_six_parameters_but_commands() -> None:
    files = sorted((ROOT / "fmopt").rglob("*.py"))
    assert len(files) > 100
    assert {str(path.relative_to(ROOT)): names for path in files if (names := wide(path.read_text("utf-8")))} == {}


def test_parameters_are_counted() -> None:
    seven, six = "a, b, /, c, d, *, e, f, g=1", "a, b, /, c, d, *rest, e, f=1, **more"
    long = f"def long({seven}): ...\nasync def slow({seven}): ...\nlambda {seven}: 0"
    assert wide(long) == ["long", "slow", "lambda"]
    assert wide(f"class A:\n    def method(self, {seven}): ...") == ["method"]
    assert wide(f"def short({six}): ...\nlambda {six}: 0") == []
    assert wide(f"class A:\n    def method(self, {six}): ...\n    def made(cls, {six}): ...") == []
    assert wide(f"@app.command('go')\ndef go({seven}): ...") == []
    assert wide(f"@app.callback()\n@part\ndef go({seven}): ...") == ["go"]
