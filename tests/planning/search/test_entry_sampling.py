"""Ways to begin that are drawn: what is left out before it is looked at closely could not have begun."""

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
    posed = Posed.of(fmopt.load(families.write_toml(families.pair("6-gon", 102), tmp_path, (0.5, 0.5))))
    stood = motion._Stood.of(posed, next(iter(images(posed.assembly, posed.problem.start_box))))
    told = {True: 0, False: 0}
    for shape in islice(motion.drawing(posed).shapes(0), SHAPES):
        entry = stood.entry_of(shape)
        could = entry_sampling._could_enter(stood.task, entry)
        assert could or shape.flat is not None
        told[could] += shape.flat is not None
        if not could:
            node = begin(stood.task, entry)
            assert node is None or node.reached.margin <= 0.0
    assert min(told.values()) > 0
