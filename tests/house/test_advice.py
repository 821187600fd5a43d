"""Every error that its reader can act upon gives advice; verdicts of a search (exit code 3) need none.

The advice that matters most is followed to the letter in `tests/cli/test_advice.py`.
"""

import ast
import inspect
from collections.abc import Iterator, Set
from pathlib import Path

import fmopt
from fmopt import errors
from fmopt.task.toml.source import Place
from fmopt.task.toml.units import QuantityError

PACKAGE = Path(fmopt.__file__).parent
ACTED_UPON = [one for one in vars(errors).values() if getattr(one, "exit_code", 3) in (1, 2, 4)]
TAKING = {one.__name__: inspect.signature(one) for one in (*ACTED_UPON, errors.Fault, QuantityError)}
TAKING["fault"] = inspect.signature(Place("").fault)
PLACES = {name: [*given.parameters].index("advice") for name, given in TAKING.items() if "advice" in given.parameters}
CAUGHT = {  # their errors end one way to cut a solid, and the next way is tried
    *("enclosing.py", "inverse_csg.py", "upright_prisms.py"),
    *("mesh/fitted_planes.py", "mesh/mesh_import.py", "mesh/mesh_solid.py"),
}


def may_be_empty(advice: ast.expr | None, empty: Set[str]) -> bool:
    """Whether an expression can be an empty text, as far as its branches and the names for empty texts tell."""
    match advice:
        case None:
            return True
        case ast.Constant(value=value):
            return not value
        case ast.Name(id=name):
            return name in empty
        case ast.IfExp():
            return may_be_empty(advice.body, empty) or may_be_empty(advice.orelse, empty)
        case ast.BoolOp(op=ast.Or()):
            return may_be_empty(advice.values[-1], empty)
    return False


def without_advice(source: str) -> Iterator[int]:
    """Lines of calls that make an error with a message and without advice."""
    nodes = list(ast.walk(ast.parse(source)))
    texts = [node for node in nodes if isinstance(node, ast.Assign) and may_be_empty(node.value, set())]
    empty = {target.id for node in texts for target in node.targets if isinstance(target, ast.Name)}
    for call in (node for node in nodes if isinstance(node, ast.Call)):
        place = PLACES.get(getattr(call.func, "id", getattr(call.func, "attr", "")))
        if place is None or any(isinstance(one, ast.Starred) for one in call.args):
            continue
        given = [*(one.value for one in call.keywords if one.arg == "advice"), *call.args[place : place + 1]]
        if may_be_empty(given[0] if given else None, empty):
            before = call.args[place - 1] if len(call.args) >= place else None
            if not (isinstance(before, ast.Constant) and before.value == ""):  # a place, not an error
                yield call.lineno


def test_every_error_gives_advice() -> None:
    assert len(PLACES) > 10
    found = {
        path.relative_to(PACKAGE).as_posix(): lines
        for path in sorted(PACKAGE.rglob("*.py"))
        if (lines := list(without_advice(path.read_text("utf-8"))))
    }
    assert found.keys() == {f"geometry/{name}" for name in CAUGHT}, found


def test_missing_advice_is_found() -> None:
    source = """
NONE = ""
raise GeometryError("wrong", "mend it")
raise GeometryError("wrong")
raise GeometryError("wrong", "mend it" if x else "")
raise SizeError("wrong", 1.0, NONE) from None
raise InputError(place.fault("code", "wrong", did(x) or "mend it"))
raise InputError(place.fault("code", "wrong"))
raise ResourceError("wrong", advice="")
raise GeometryError(error.message, error.advice)
raise InfeasibleError("not so")
place.fault("", "")
"""
    assert sorted(without_advice(source)) == [4, 5, 6, 8, 9]
