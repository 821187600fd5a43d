"""All advice that a room gives, read from its sources: each text as a pattern, its holes open for what is put in."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import fmopt

PACKAGE = Path(fmopt.__file__).parent
_PLACE = {"Damage": 2, "InterferenceError": 3, "QuantityError": 2, "SizeError": 2, "TaskError": 3}
_PLACE |= {"fault": -1, "missing": -1}
"""Of advice among the arguments; it is the second of those of any other error."""
_OTHERS = {"PydanticCustomError", "VelocityError"}  # whose arguments are no advice
_HOLE = ".+"


@dataclass(frozen=True)
class Given:
    """One advice: where it stands, and what it says as a pattern."""

    file: str
    line: int
    pattern: str

    @property
    def words(self) -> int:
        """How much of it is not left open."""
        return len(self.pattern.replace(_HOLE, ""))

    def says(self, text: str) -> bool:
        """Whether a text is this advice."""
        return re.fullmatch(self.pattern, text, re.DOTALL) is not None


def given(folder: str) -> tuple[Given, ...]:
    """All advice of the modules below a folder of the package; what is handed on of another error is none of its own.

    Raises:
        AssertionError: advice is put together in a way that nobody can read here.
    """
    root = PACKAGE / folder
    found = [one for path in sorted(root.rglob("*.py")) for one in _Module(path).given(path.relative_to(root))]
    return tuple(sorted({(one.file, one.pattern): one for one in reversed(found)}.values(), key=lambda one: one.file))


class _Module:
    """A source, and what its names stand for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.tree = ast.parse(path.read_text(encoding="utf-8"))
        self.names = _assigned(self.tree)
        self.functions = {one.name: one for one in ast.walk(self.tree) if isinstance(one, ast.FunctionDef)}

    def given(self, file: Path) -> Iterator[Given]:
        """All its advice, as of a file."""
        for scope in self.tree.body:
            names = self.names | (_assigned(scope) if isinstance(scope, ast.FunctionDef | ast.ClassDef) else {})
            taken = {one.arg for one in ast.walk(scope) if isinstance(one, ast.arg)}
            for line, node in self._advice(scope):
                for pattern in self._patterns(node, names, taken):
                    yield Given(file.as_posix(), line, pattern)

    def _patterns(self, node: ast.expr, names: Mapping[str, list[ast.expr]], taken: set[str]) -> Iterator[str]:
        """What an expression may be, as patterns; nothing where it is another error's."""
        match node:
            case ast.Constant(value=str(text)):
                yield from [re.escape(text)] if text else []
            case ast.JoinedStr(values=parts):
                yield "".join(re.escape(str(p.value)) if isinstance(p, ast.Constant) else _HOLE for p in parts)
            case ast.IfExp():
                yield from self._patterns(node.body, names, taken)
                yield from self._patterns(node.orelse, names, taken)
            case ast.BinOp(op=ast.Add()):
                for first in self._patterns(node.left, names, taken):
                    yield from (first + last for last in self._patterns(node.right, names, taken))
            case ast.BoolOp(op=ast.Or(), values=values):
                for value in values:
                    yield from self._patterns(value, names, taken)
            case ast.Call(func=ast.Name(id=name)):
                yield from self._returned(name, None)
            case ast.Subscript(value=ast.Call(func=ast.Name(id=name)), slice=ast.Constant(value=int(place))):
                yield from self._returned(name, place)
            case ast.Name(id=name) if name in names:
                for value in names[name]:
                    yield from self._patterns(value, names, taken)
            case ast.Name(id=name) if name not in taken:
                yield from self._elsewhere(name)
            case ast.Name() | ast.Attribute(attr="advice") | ast.Subscript(slice=ast.Constant(value="advice")):
                return
            case _:
                raise AssertionError(f"{self.path}:{node.lineno}: {ast.unparse(node)} is no advice that can be read")

    def _elsewhere(self, name: str) -> Iterator[str]:
        """What a name stands for that comes from another module."""
        module = self._home(name)
        for value in module.names[name]:
            yield from module._patterns(value, module.names, set())

    def _returned(self, name: str, place: int | None) -> Iterator[str]:
        """What a function returns, of tuples the one at a place."""
        if name not in self.functions:
            yield from self._home(name)._returned(name, place)
            return
        function = self.functions[name]
        names, taken = (
            self.names | _assigned(function),
            {one.arg for one in ast.walk(function) if isinstance(one, ast.arg)},
        )
        for node in ast.walk(function):
            if isinstance(node, ast.Return) and node.value is not None:
                value = (
                    node.value.elts[place] if place is not None and isinstance(node.value, ast.Tuple) else node.value
                )
                yield from self._patterns(value, names, taken)

    def _home(self, name: str) -> _Module:
        """The module that a name comes from."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and any(alias.name == name for alias in node.names):
                return _Module(PACKAGE.parent / f"{str(node.module).replace('.', '/')}.py")
        raise AssertionError(f"{self.path}: nobody knows what {name} stands for")

    def _advice(self, scope: ast.AST) -> Iterator[tuple[int, ast.expr]]:
        """The expressions in a scope that are advice: of errors, of what becomes one, and of answers of a process."""
        for node in ast.walk(scope):
            if isinstance(node, ast.Call):
                yield from ((node.lineno, one) for one in self._argued(node))
            elif isinstance(node, ast.Dict):
                keys = [key.value if isinstance(key, ast.Constant) else None for key in node.keys]
                yield from ((node.lineno, v) for key, v in zip(keys, node.values, strict=True) if key == "advice")
            elif isinstance(node, ast.FunctionDef):
                arguments = node.args.args[len(node.args.args) - len(node.args.defaults) :]
                values = zip(arguments, node.args.defaults, strict=True)
                yield from ((node.lineno, value) for one, value in values if one.arg == "advice")

    def _argued(self, call: ast.Call) -> Iterator[ast.expr]:
        """The arguments of a call that are advice."""
        name = call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")
        taken = [one.arg for one in self.functions[name].args.args] if name in self.functions else []
        if "advice" in taken and name != "fault":
            place = taken.index("advice") - (taken[0] == "self")
        elif name in _OTHERS or not (name.endswith("Error") or name in _PLACE):
            return
        else:
            place = _PLACE.get(name, 1)
        yield from (one.value for one in call.keywords if one.arg == "advice")
        if len(call.args) > max(place, 1):
            yield call.args[place]
        for one in call.args:
            match one:
                case ast.Starred(value=ast.Call(func=ast.Name(id=other)) as value) if other in self.functions:
                    yield ast.Subscript(value, ast.Constant(1))


def _assigned(scope: ast.AST) -> dict[str, list[ast.expr]]:
    """The values that names get within a module, outside of its functions, or within a function; sums as they grow."""
    found: dict[str, list[ast.expr]] = {}
    inner = scope.body if isinstance(scope, ast.Module) else list(ast.walk(scope))
    branches = [body for one in inner if isinstance(one, ast.If) for body in (one.body, one.orelse)]
    may_grow = {id(one) for body in branches if not any(map(_is_new, body)) for one in body}
    for node in sorted((one for one in inner if isinstance(one, ast.stmt)), key=lambda one: one.lineno):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                found.setdefault(name, []).append(value)
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                for target, value in zip(targets, values, strict=True):
                    if isinstance(target, ast.Name):
                        found.setdefault(target.id, []).append(value)
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Call(func=ast.Name()) as value):
                for place, target in enumerate(targets):
                    if isinstance(target, ast.Name):
                        found.setdefault(target.id, []).append(ast.Subscript(value, ast.Constant(place)))
            case ast.AugAssign(target=ast.Name(id=name), op=ast.Add(), value=value) if name in found:
                longer: list[ast.expr] = [ast.BinOp(before, ast.Add(), value) for before in found[name]]
                found[name] = [*(found[name] if id(node) in may_grow else ()), *longer]
    return found


def _is_new(node: ast.stmt) -> bool:
    """Whether a statement sets something, not just makes it longer."""
    return isinstance(node, ast.Assign)
