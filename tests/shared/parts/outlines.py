"""Problems of prisms that are not shipped: the shipped kite's, with another section."""

import re
from pathlib import Path

import numpy as np
from shapely import Polygon

from fmopt.task.problem import Problem, load
from tests import ROOT
from tests.shared.parts.families import widened

ASLANT = [[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-6.0, 10.0]]  # a square, one of its sides leans inwards


def prism(folder: Path, outline: list[list[float]], clearance: tuple[float, float]) -> Problem:
    """A prism of a section (n, 2), mm, counter-clockwise, in a hole that is 0.1 mm wider all around.

    Frames are at the centroids of both sections; the clearance is a side along x and y, mm.
    """
    (folder / "models").mkdir()
    (folder / "problems").mkdir()
    outer = widened(tuple((x, y) for x, y in outline), 0.1)
    for name, corners in (("kite_prism", np.array(outline)), ("kite_box", np.array(outer))):
        text = (ROOT / "models" / f"{name}.toml").read_text()
        (centre,) = Polygon(corners).centroid.coords
        polygon = f"polygon = {(corners - centre).tolist()}"
        text, count = re.subn(r"polygon = .*?(?=\nheight)", polygon, text, flags=re.DOTALL)
        assert count == 1
        (folder / "models" / f"{name}.toml").write_text(text)
    text = (ROOT / "problems" / "kite_prism.toml").read_text()
    for axis, old, new in zip("xy", ("0.118881", "0.163174"), clearance, strict=True):
        assert f"{axis} = {old}" in text
        text = text.replace(f"{axis} = {old}", f"{axis} = {new}")
    path = folder / "problems" / "kite_prism.toml"
    path.write_text(text)
    return load(path)
