"""The notebooks: pairs in step, without outputs, and each runs from first cell to last in a folder of its own."""

import shutil
from pathlib import Path

import jupytext
import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parent.parent / "notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))


def test_there_is_a_pair_of_each() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == NAMES
    assert len({name[:2] for name in NAMES}) == len(NAMES) > 5


@pytest.mark.parametrize("name", NAMES)
def test_pairs_say_the_same_and_hold_no_outputs(name: str) -> None:
    text, paired = jupytext.read(FOLDER / f"{name}.py"), nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    assert [(cell.cell_type, cell.source) for cell in text.cells] == [(c.cell_type, c.source) for c in paired.cells]
    code = [cell for cell in paired.cells if cell.cell_type == "code"]
    assert code
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    assert paired.cells[0].source.startswith("# ")


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
