"""Insertion motions that work although the clearance is smaller than the error, with proof.

A problem file names two parts, a goal and honest tolerances; a plan is the certified motion for it:

    >>> import fmopt
    >>> problem = fmopt.load(fmopt.example("square_peg"))
    >>> print(problem)
    Square peg in a blind square hole, 0.1 mm clearance a side: square_peg into square_hole_block
    >>> tighter = problem.with_(clearance="0.05 mm", uncertainty_start_x="0.2 mm")
    >>> round(1e3 * tighter.measured.per_side, 6)
    0.05

`fmopt.solve(problem)` returns a plan and takes from seconds to minutes; `fmopt.read` reads one from a file:

    >>> plan = fmopt.read("out/square_peg/plan.json")
    >>> plan.verify().verdict
    'CERTIFIED'
    >>> len(plan.segments) >= len(plan.moves) > 1
    True

`fmopt.show(value)` draws problems, plans, contact graphs, error sets and regions; in a notebook they draw themselves.
`fmopt.study("study.toml")` carries a batch study out, `fmopt.stages` holds the stages of `fmopt.solve` one by one.

Lengths are in m, angles in rad, forces in N and torques in N·m everywhere but in text that names its unit. What goes
wrong on purpose raises a `fmopt.FmoptError`, which says where, by how much, and what to change.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fmopt.errors import ChoiceError as ChoiceError
    from fmopt.errors import FmoptError as FmoptError
    from fmopt.errors import GeometryError as GeometryError
    from fmopt.errors import InfeasibleError as InfeasibleError
    from fmopt.errors import InputError as InputError
    from fmopt.errors import InterferenceError as InterferenceError
    from fmopt.errors import PlanFormatError as PlanFormatError
    from fmopt.errors import ResourceError as ResourceError
    from fmopt.errors import SearchError as SearchError
    from fmopt.errors import SolverError as SolverError
    from fmopt.execution.trials import Trials as Trials
    from fmopt.notebook import stages as stages
    from fmopt.notebook.asking import problem as problem
    from fmopt.notebook.drawing import Drawing as Drawing
    from fmopt.notebook.drawing import drawings as drawings
    from fmopt.notebook.drawing import show as show
    from fmopt.notebook.plan import Plan as Plan
    from fmopt.notebook.plan import Segment as Segment
    from fmopt.notebook.plan import read as read
    from fmopt.notebook.plan import solve as solve
    from fmopt.notebook.problem import Problem as Problem
    from fmopt.notebook.problem import load as load
    from fmopt.notebook.shipped import copy_examples as copy_examples
    from fmopt.notebook.shipped import example as example
    from fmopt.notebook.shipped import examples as examples
    from fmopt.notebook.slider import slider as slider
    from fmopt.study.outcome import study as study

__version__ = "0.1.0"

# Where each public name lives; it is imported when it is first used, so that `import fmopt` stays light.
_HOMES = {
    "load": "fmopt.notebook.problem",
    "solve": "fmopt.notebook.plan",
    "problem": "fmopt.notebook.asking",
    "read": "fmopt.notebook.plan",
    "show": "fmopt.notebook.drawing",
    "drawings": "fmopt.notebook.drawing",
    "slider": "fmopt.notebook.slider",
    "study": "fmopt.study",
    "stages": "fmopt.notebook.stages",
    "example": "fmopt.notebook.shipped",
    "examples": "fmopt.notebook.shipped",
    "copy_examples": "fmopt.notebook.shipped",
    "Problem": "fmopt.notebook.problem",
    "Plan": "fmopt.notebook.plan",
    "Segment": "fmopt.notebook.plan",
    "Drawing": "fmopt.notebook.drawing",
    "Trials": "fmopt.execution.trials",
    "ChoiceError": "fmopt.errors",
    "FmoptError": "fmopt.errors",
    "GeometryError": "fmopt.errors",
    "InfeasibleError": "fmopt.errors",
    "InputError": "fmopt.errors",
    "InterferenceError": "fmopt.errors",
    "PlanFormatError": "fmopt.errors",
    "ResourceError": "fmopt.errors",
    "SearchError": "fmopt.errors",
    "SolverError": "fmopt.errors",
}
_MODULES = {"study", "stages"}
__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'fmopt' has no attribute {name!r}; it has {', '.join(_HOMES)}")
    module = import_module(home)
    found = module if name in _MODULES else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


if "IPython" in sys.modules:
    import_module("fmopt.notebook.display").introduce()
