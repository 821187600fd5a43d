"""All advice that a room gives, read from its sources: each text as a pattern, its holes open for what is put in."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import fmopt

PACKAGE = Path(fmopt.__file__).parent
_PLACE = {"Damage": 2, "InterferenceError": 3, "SizeError": 2, "TaskError": 3}  # of advice among the arguments
_HOLE = ".+"


@dataclass(frozen=True)
class Given:
    """One advice: where it stands, and what it says as a pattern."""

    file: str
    line: int
    pattern: str

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
            for line, node in _advice(scope, self.functions):
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
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and any(alias.name == name for alias in node.names):
                path = PACKAGE.parent / f"{str(node.module).replace('.', '/')}.py"
                module = _Module(path)
                for value in module.names[name]:
                    yield from module._patterns(value, module.names, set())
                return
        raise AssertionError(f"{self.path}: nobody knows what {name} stands for")


def _assigned(scope: ast.AST) -> dict[str, list[ast.expr]]:
    """The values that names get within a module, outside of its functions, or within a function; sums as they grow."""
    found: dict[str, list[ast.expr]] = {}
    inner = scope.body if isinstance(scope, ast.Module) else list(ast.walk(scope))
    for node in sorted((one for one in inner if isinstance(one, ast.stmt)), key=lambda one: one.lineno):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                found.setdefault(name, []).append(value)
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                for target, value in zip(targets, values, strict=True):
                    if isinstance(target, ast.Name):
                        found.setdefault(target.id, []).append(value)
            case ast.AugAssign(target=ast.Name(id=name), op=ast.Add(), value=value) if name in found:
                found[name] = [ast.BinOp(before, ast.Add(), value) for before in found[name]]
    return found


def _advice(scope: ast.AST, functions: Mapping[str, ast.FunctionDef]) -> Iterator[tuple[int, ast.expr]]:
    """The expressions within a scope that are advice: of errors, of what becomes one, and of answers of a process."""
    for node in ast.walk(scope):
        if isinstance(node, ast.Call):
            name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            if not (name.endswith("Error") or name in ("Damage", "fault")):
                continue
            yield from ((node.lineno, one.value) for one in node.keywords if one.arg == "advice")
            place = _PLACE.get(name, 1)
            if len(node.args) > place:
                yield node.lineno, node.args[place]
            for one in node.args:
                if isinstance(one, ast.Starred) and isinstance(one.value, ast.Call):
                    yield from _returned(functions[ast.unparse(one.value.func)])
        elif isinstance(node, ast.Dict):
            keys = [key.value if isinstance(key, ast.Constant) else None for key in node.keys]
            yield from ((node.lineno, v) for key, v in zip(keys, node.values, strict=True) if key == "advice")
        elif isinstance(node, ast.FunctionDef):
            arguments = node.args.args[len(node.args.args) - len(node.args.defaults) :]
            values = zip(arguments, node.args.defaults, strict=True)
            yield from ((node.lineno, value) for one, value in values if one.arg == "advice")


def _returned(function: ast.FunctionDef) -> Iterator[tuple[int, ast.expr]]:
    """The second of each pair that a function returns."""
    for node in ast.walk(function):
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple):
            yield node.lineno, node.value.elts[1]
