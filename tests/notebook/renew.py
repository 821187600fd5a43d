"""Runs notebooks and keeps their outputs in them: `python -m tests.notebook.renew [NAME…]`, all if none is named.

What is kept shows the same on every machine: pictures, tables and text. Scenes and sliders, which need scripts, are
left out; they come when the cells are run. With the outputs goes a digest of the cells that made them, so that a test
can say when the cells are others.
"""

import hashlib
import json
import re
import sys
import tempfile
from base64 import b64decode, b64encode
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient

from tests import ROOT

FOLDER = ROOT / "notebooks"
KEPT = ("image/svg+xml", "image/png", "text/latex", "text/markdown", "text/html", "text/plain")
MOST = 300_000  # characters of one output; what is larger is left out, but for its text
LONGEST = 4_000  # characters of plain text
_PICTURE = re.compile(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)")
_PLACES = re.compile(r'\b(?:d|points|x|y|x1|y1|x2|y2|cx|cy)="[^"]*"')
_NUMBER = re.compile(r"-?\d+\.\d{2,}")
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def digest(notebook: Any) -> str:
    """What its outputs depend on: kinds and sources of the cells, in their order."""
    cells = [[cell.cell_type, cell.source] for cell in notebook.cells]
    return hashlib.sha256(json.dumps(cells).encode()).hexdigest()


def renewed(name: str) -> Any:
    """The notebook with outputs as they are kept."""
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    notebook.cells = jupytext.read(FOLDER / f"{name}.py").cells
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, timeout=1800, kernel_name="python3", resources=resources, record_timing=False)
        client.execute()
    for cell in notebook.cells:
        cell.pop("id", None)
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs = [settled(output, folder) for output in cell.outputs if output.get("name") != "stderr"]
    notebook.metadata = {
        "jupytext": {"formats": "ipynb,py:percent"},
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
        "outputs_of": digest(notebook),
    }
    notebook.nbformat, notebook.nbformat_minor = 4, 4
    return notebook


def settled(output: Any, folder: str) -> Any:
    """An output without what only this run has: the folder, addresses, scripts, digits that nobody sees."""
    if output.output_type == "stream":
        output.text = _placeless(output.text, folder)
        return output
    output.metadata = {}
    shown = {kind: output.data[kind] for kind in KEPT if kind in output.data}
    html = shown.get("text/html", "")
    whole = re.fullmatch(r'\s*<img src="' + _PICTURE.pattern + r'"[^>]*>\s*', html)
    if whole:
        shown["image/svg+xml"] = _rounded(b64decode(whole[1]).decode())
    if whole or "<iframe" in html or "<script" in html:
        shown.pop("text/html")
    for kind, text in shown.items():
        said = _PICTURE.sub(_smaller, text) if kind == "text/html" else text
        shown[kind] = said if kind.startswith("image") else _placeless(said, folder)
    output.data = {kind: text for kind, text in shown.items() if len(text) <= MOST or kind == "text/plain"}
    if len(output.data.get("text/plain", "")) > LONGEST:
        output.data["text/plain"] = output.data["text/plain"][:LONGEST] + " …"
    return output


def _placeless(text: str, folder: str) -> str:
    """Without addresses in memory, and with files named from the folder of the run, or of the project."""
    return _ADDRESS.sub("", text).replace(f"{folder}/", "").replace(f"{FOLDER.parent}/", "").replace(folder, ".")


def _smaller(found: re.Match[str]) -> str:
    picture = _rounded(b64decode(found[1]).decode())
    return f"data:image/svg+xml;base64,{b64encode(picture.encode()).decode()}"


def _rounded(svg: str) -> str:
    """Coordinates to a tenth of a point, without comments; words stay as they are."""
    bare = re.sub(r"(?s)<!--.*?-->|<metadata>.*?</metadata>", "", svg)
    return re.sub(r"\n\s*", "\n", _PLACES.sub(lambda found: _NUMBER.sub(_short, found[0]), bare))


def _short(number: re.Match[str]) -> str:
    return f"{float(number[0]):.1f}".rstrip("0").rstrip(".")


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(path.stem for path in FOLDER.glob("*.py")):
        made = renewed(name)
        nbformat.validate(made)
        (FOLDER / f"{name}.ipynb").write_text(nbformat.writes(made) + "\n", encoding="utf-8")
        print(f"{name}: {len(nbformat.writes(made)) / 1e3:.0f} kB", flush=True)
