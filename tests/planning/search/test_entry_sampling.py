"""Ways to begin that are drawn: what is left out before it is looked at closely could not have begun."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import fmopt
from fmopt.planning import motion
from fmopt.planning.posed import Posed
from fmopt.planning.search import entry_sampling
from fmopt.planning.search.best_first import begin
from fmopt.planning.search.symmetry import images
from tests.shared.parts import families

SHAPES = 60


def test_parts_that_could_not_go_in_from_lying_flat_are_not_laid_flat(tmp_path: Path) -> None:
    problem = fmopt.load(families.write_toml(families.pair("6-gon", 102), tmp_path, (0.5, 0.5)))
    posed = Posed.of(problem)
    stood = motion._Stood.of(posed, next(iter(images(posed.assembly, problem.start_box))))
    rate = problem.velocity_error.translation + problem.velocity_error.rotation
    drawing = entry_sampling.Drawing(
        problem.moving, problem.fixed, posed.clearance.play, problem.start_box, rate, problem.settings.max_tilt
    )
    told = {True: 0, False: 0}
    for shape in islice(drawing.shapes(0), SHAPES):
        entry = stood.entry_of(shape)
        could = entry_sampling._could_enter(stood.task, entry)
        assert could or shape.flat is not None
        if shape.flat is None:
            continue
        told[could] += 1
        if not could:
            node = begin(stood.task, entry)
            assert node is None or node.reached.margin <= 0.0
    assert min(told.values()) > 0
