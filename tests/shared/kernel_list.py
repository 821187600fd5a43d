"""Writes the list of kernels that are compiled ahead: `python -m tests.shared.kernel_list`, in the project's folder.

They are those that a plan of the square peg calls; those that share what they call together, the most first.
"""

from __future__ import annotations

import ast
import inspect
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

from fmopt.planning.pipeline import synthesise
from fmopt.runtime.ahead import Listed, json_of
from fmopt.runtime.compiled import KERNELS, LIST
from fmopt.task.problem import load

PROBLEM = Path(__file__).parents[2] / "problems" / "square_peg.toml"


def called() -> dict[str, list[tuple[Any, ...]]]:
    """The kernels that have been called in this process, and with what types."""
    return {name: list(kernel.signatures) for name, kernel in KERNELS.items() if kernel.signatures}


def listed() -> str:
    """What the list is to say: solves the square peg and lists what that calls."""
    synthesise(load(PROBLEM))
    groups, lengths = defaultdict[str, Listed](dict), defaultdict[str, int](int)
    for name, (signature,) in sorted(called().items()):
        groups[_group(name)][name] = [json_of(kind) for kind in signature]
    for module in {name.split(":")[0] for name in called()}:
        # By its code: a comment more makes no other list.
        lengths[_group(module)] += len(ast.unparse(ast.parse(inspect.getsource(sys.modules[module]))))
    order = sorted(groups, key=lambda group: -lengths[group])
    lines = (
        ",\n".join(f"  {json.dumps(name)}: {json.dumps(kinds)}" for name, kinds in groups[g].items()) for g in order
    )
    return "[\n" + ",\n".join(f" {{\n{line}\n }}" for line in lines) + "\n]\n"


def _group(name: str) -> str:
    """Whose parts a kernel calls besides those of its own file: the file itself where there are none."""
    module = name.split(":")[0]
    parts = (getattr(found, "py_func", None) for found in vars(sys.modules[module]).values())
    shared = {part.__module__ for part in parts if part is not None and ".kernels_" in part.__module__}
    return max(shared, default=module)


if __name__ == "__main__":
    if sys.argv[1:] == ["--show"]:
        sys.stdout.write(listed())
    else:
        LIST.write_text(listed())
