"""What is shipped: wheel and source distribution build, and the wheel alone solves a shipped example."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

from fmopt.manual import PAGES

ROOT = Path(__file__).parent.parent


def test_the_wheel_holds_the_examples_and_works_from_an_empty_folder(tmp_path: Path) -> None:
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
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    code = (
        "import fmopt, fmopt.manual, sys\nassert fmopt.__file__.startswith(sys.argv[1]), fmopt.__file__\n"
        "plan = fmopt.solve(fmopt.load(fmopt.example('lee_huang_peg')))\n"
        "plan.save('plan.json'), plan.report('report.html'), print(plan.verify().verdict)\n"
        "assert len(fmopt.manual.manual()) > 200_000"
    )
    words = [sys.executable, "-c", code, str(installed)]
    done = subprocess.run(words, cwd=empty, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "CERTIFIED"
    assert (empty / "report.html").stat().st_size > 100_000
