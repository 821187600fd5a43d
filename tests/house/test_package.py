"""What is shipped: wheel and source distribution build, and the wheel alone solves a shipped example."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import fmopt
from fmopt.manual import PAGES
from tests import ROOT


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
