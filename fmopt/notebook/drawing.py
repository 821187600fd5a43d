"""Drawings of values by name: what `fmopt.show` gives."""

from collections.abc import Mapping
from typing import Any

from fmopt.errors import ChoiceError, ResourceError
from fmopt.notebook.views import views_of
from fmopt.report.drawing import Drawing as Drawing


def show(value: Any, what: str | None = None) -> Drawing:
    """A drawing of a value, by name or the first: it shows itself in a notebook, and `save` writes it.

    >>> plan = fmopt.read("out/square_peg/plan.json")
    >>> fmopt.show(plan)
    <fmopt.Drawing scene: square_peg going into square_hole_block, to be turned and played>
    >>> "states" in fmopt.drawings(plan)
    True

    Raises:
        ChoiceError: there is no drawing of this name.
        ResourceError: the value has none at all.
    """
    found = drawings(value)
    if what is None:
        return next(iter(found.values()))
    if what not in found:
        message = f"there is no drawing {what!r} of this {type(value).__name__}"
        raise ChoiceError(message, f"choose from {', '.join(found)}")
    return found[what]


def drawings(value: Any) -> Mapping[str, Drawing]:
    """The drawings that there are of a value, by name; none is made before it is asked for.

    >>> list(fmopt.drawings(fmopt.load(fmopt.example("square_peg"))))
    ['parts', 'scene', 'diagrams']

    Raises:
        ResourceError: the value has none.
    """
    found = views_of(value)
    if not found:
        raise ResourceError(f"a {type(value).__name__} has no drawing", "see help(fmopt.show) for what has")
    return found
