"""The notebooks: pairs in step, outputs of the cells as they are, and each runs in a folder of its own."""

import re
import shutil
from base64 import b64encode
from pathlib import Path

import jupytext
import nbformat
import pytest
from nbclient import NotebookClient

from tests import ROOT
from tests.notebook.renew import digest, settled

FOLDER = ROOT / "notebooks"
PICTURES = ("image/svg+xml", "image/png", "text/html")
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))


def test_there_is_a_pair_of_each() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == NAMES
    assert len({name[:2] for name in NAMES}) == len(NAMES) > 5


@pytest.mark.parametrize("name", NAMES)
def test_pairs_say_the_same(name: str) -> None:
    text, paired = jupytext.read(FOLDER / f"{name}.py"), nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    assert [(cell.cell_type, cell.source) for cell in text.cells] == [(c.cell_type, c.source) for c in paired.cells]
    assert paired.cells[0].source.startswith("# ")


@pytest.mark.parametrize("name", NAMES)
def test_outputs_are_those_of_the_cells(name: str) -> None:
    """Where this fails, `python -m tests.notebook.renew NAME` runs the notebook and keeps what it shows."""
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    assert notebook.metadata.get("outputs_of") == digest(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == [*range(1, len(code) + 1)]
    outputs = [output for cell in code for output in cell.outputs]
    assert len(outputs) > 2
    assert not [output for output in outputs if output.output_type == "error"]
    written = (FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    assert len(written) < 2_000_000
    shown = "".join(str(output.get("data", output.get("text"))) for output in outputs)
    assert not re.search(r"<iframe|<script| at 0x[0-9a-f]{6}|/tmp/|/home/|/root/|site-packages", shown)
    assert any(kind in output.get("data", {}) for output in outputs for kind in PICTURES)


def test_a_changed_cell_makes_outputs_stale() -> None:
    notebook = nbformat.read(FOLDER / f"{NAMES[0]}.ipynb", as_version=4)
    before = digest(notebook)
    notebook.cells[1].source += " "
    assert digest(notebook) != before


def test_what_is_kept_of_an_output_is_the_same_on_every_machine() -> None:
    picture = '<svg><path d="M1.23456 -0.0001" transform="scale(0.015625)"/><text>1.2345</text></svg>'
    drawn = f'<img src="data:image/svg+xml;base64,{b64encode(picture.encode()).decode()}" alt="">'
    data = {"text/html": drawn, "text/plain": "<a thing at 0x7f00aa> in /tmp/abc/out"}
    made = nbformat.v4.new_output("display_data", data)
    assert settled(made, "/tmp/abc").data == {
        "image/svg+xml": '<svg><path d="M1.2 -0" transform="scale(0.015625)"/><text>1.2345</text></svg>',
        "text/plain": "<a thing> in out",
    }
    scene = nbformat.v4.new_output("display_data", {"text/html": "<iframe></iframe>", "text/plain": "a scene"})
    assert settled(scene, "/tmp/abc").data == {"text/plain": "a scene"}


@pytest.mark.wide
@pytest.mark.parametrize("name", NAMES)
def test_each_notebook_runs(name: str, tmp_path: Path) -> None:
    notebook = nbformat.read(shutil.copy(FOLDER / f"{name}.ipynb", tmp_path), as_version=4)
    NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert outputs
    assert not [output for output in outputs if output.output_type == "error"]
    assert not [output.text for output in outputs if output.get("name") == "stderr"]
    nbformat.validate(notebook)
    assert len(nbformat.writes(notebook)) < 5_000_000
