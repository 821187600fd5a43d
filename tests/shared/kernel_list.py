"""Writes the list of kernels that are compiled ahead: `python -m tests.shared.kernel_list`, in the project's folder.

They are those that a plan of the square peg calls; those that share what they call together, the most first.
"""

import ast
import inspect
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numba import types
from numba.np.numpy_support import as_dtype

from fmopt.planning.pipeline import synthesise
from fmopt.runtime.ahead import Listed
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


def json_of(kind: Any) -> Any:
    """A type of an argument of a kernel as JSON; `type_of` of `fmopt.runtime.ahead` reads it.

    Raises:
        TypeError: kernels of the list take no such type.
    """
    match kind:
        case types.Array():
            return ["array", json_of(kind.dtype), kind.ndim, kind.layout, not kind.mutable, kind.aligned]
        case types.Record():
            return ["record", np.lib.format.dtype_to_descr(as_dtype(kind))]
        case types.BaseNamedTuple():  # before plain tuples, which it is as well
            name = f"{kind.instance_class.__module__}:{kind.instance_class.__qualname__}"
            return ["named", name, list(map(json_of, kind.types))]
        case types.BaseTuple():
            return ["tuple", list(map(json_of, kind.types))]
        case types.Number() | types.Boolean():
            return kind.name
    raise TypeError(f"no kernel that is compiled ahead takes {kind}")


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
