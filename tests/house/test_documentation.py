"""What the program says of itself: every public name has a docstring, names in it exist, examples do as they say."""

import ast
import doctest
import importlib
import re
import shutil
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import fmopt

PACKAGE = Path(fmopt.__file__).parent
FILES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.name != "__main__.py")
UNITS = re.compile(r"\b(SI|m|mm|µm|rad|deg|N|s|m/s|metres)\b|N·m")


def module_name(file: Path) -> str:
    return ".".join(("fmopt", *file.with_suffix("").parts)).removesuffix(".__init__")


def resolved(name: str) -> bool:
    """Whether a dotted name, such as `fmopt.plan.read`, leads somewhere."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            fields = getattr(found, "__dataclass_fields__", {})
            if not hasattr(found, part) and part not in fields:
                return False
            found = getattr(found, part, None)
        return True
    return False


def public(file: Path) -> list[tuple[str, ast.AST]]:
    """Modules, classes, functions and methods without an underscore, and not inside such."""
    tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
    found: list[tuple[str, ast.AST]] = [(module_name(file), tree)]
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            found.append((node.name, node))
            if isinstance(node, ast.ClassDef):
                inside = [item for item in node.body if isinstance(item, ast.FunctionDef)]
                found += [(f"{node.name}.{item.name}", item) for item in inside if not item.name.startswith("_")]
    return found


def documented(node: ast.AST) -> bool:
    assert isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    return bool(ast.get_docstring(node)) or (isinstance(node, ast.Module) and not node.body)


def test_every_public_name_has_a_docstring() -> None:
    missing = [f"{file}: {name}" for file in FILES for name, node in public(file) if not documented(node)]
    inherited = {"__call__", "__enter__", "__exit__"}
    assert [name for name in missing if name.split(".")[-1] not in inherited] == []


def test_names_in_docstrings_exist() -> None:
    dead = []
    for file in FILES:
        for node in ast.walk(ast.parse((PACKAGE / file).read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                names = re.findall(r"`(fmopt(?:\.\w+)+)", ast.get_docstring(node) or "")
                dead += [f"{file}: {name}" for name in names if not resolved(name)]
    assert dead == []
    assert not resolved("fmopt.plan.raed")
    assert resolved("fmopt.plan.read")


def docstrings(tree: ast.AST) -> list[tuple[ast.AST, str]]:
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    return [(node, text) for node in ast.walk(tree) if isinstance(node, kinds) and (text := ast.get_docstring(node))]


def words_of(tree: ast.AST) -> set[str]:
    """Every name and every short text that a source uses or defines, docstrings apart."""
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Attribute(attr=name) | ast.alias(name=name):
                found.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.keyword(arg=str(name)):
                found.add(name)
            case ast.Constant(value=str(text)) if len(text) < 40:
                found |= set(re.findall(r"\w+", text))
    return found


def defined(trees: dict[Path, ast.Module]) -> dict[str, set[str]]:
    """Modules, classes and functions of the package by their own name, each with the names inside it."""
    found: dict[str, set[str]] = {}
    for file, tree in trees.items():
        found.setdefault(file.stem, set()).update(words_of(tree))
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                found.setdefault(node.name, set()).update(words_of(node))
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                found.setdefault(node.target.id, set()).update(words_of(node.annotation))
    return found


# Words in backticks that are not of this package: builtins, and functions of URScript.
FOREIGN = {"print", "force_mode", "get_tcp_force"}


def leads_nowhere(name: str, own: set[str], everywhere: dict[str, set[str]]) -> bool:
    """Whether a name in backticks is neither of its own file, nor a thing of the package, nor a file of the project."""
    first, *rest = name.split(".")
    if name in own | FOREIGN or (not rest and name in everywhere):
        return False
    inside = everywhere.get(first, set()) | (own if first in own else set())
    if rest and all(part in inside or part in everywhere.get(rest[i - 1], set()) for i, part in enumerate(rest)):
        return False
    return not ((PACKAGE.parent / name).exists() or resolved(name) or resolved(f"fmopt.{name}"))


def test_every_name_in_backticks_leads_somewhere() -> None:
    trees = {file: ast.parse((PACKAGE / file).read_text(encoding="utf-8")) for file in FILES}
    everywhere = defined(trees)
    schema = (PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8")
    extras = set(re.findall(r"^(\w+) = \[", schema, re.MULTILINE))
    rooms = (
        "verify/reading/parse.py",
        "verify/reading/parse_segments.py",
        "verify/reading/parse_segments.py",
        "planning/plan_record.py",
        "planning/robustness/state_trace.py",
    )
    keys = set().union(*(words_of(trees[Path(room)]) for room in rooms))  # of the plan file
    dead, seen = [], 0
    for file, tree in trees.items():
        own = words_of(tree) | extras | keys
        for node, text in docstrings(tree):
            names = re.findall(r"(?<!`)`([A-Za-z_][\w.]*\w)`(?!`)", text)
            seen += len(names)
            dead += [f"{file}: {getattr(node, 'name', '')}: {n}" for n in names if leads_nowhere(n, own, everywhere)]
    assert dead == []
    assert seen > 400
    assert leads_nowhere("load_mseh", words_of(trees[Path("geometry/part.py")]), everywhere)
    assert leads_nowhere("Polyhedron.colour", set(), everywhere)
    assert not leads_nowhere("Polyhedron.volume", set(), everywhere)


def test_pages_of_the_manual_name_what_there_is() -> None:
    manual = PACKAGE / "manual"
    everywhere = defined({file: ast.parse((PACKAGE / file).read_text(encoding="utf-8")) for file in FILES})
    names = set(re.findall(r"`([A-Za-z_][\w.]*\w)`", (manual / "design.md").read_text(encoding="utf-8")))
    assert {name for name in names if leads_nowhere(name, set(), everywhere)} == set()
    run = [name.removeprefix("fmopt.") for name in sorted(names) if name.startswith("fmopt.")]
    assert len(run) > 20
    references = set(re.findall(r"\*\*\[(\w+)\]", (manual / "references.md").read_text(encoding="utf-8")))
    for path in (PACKAGE.parent / "README.md", *manual.glob("*.md")):
        text = path.read_text(encoding="utf-8")
        full = set(re.findall(r"`(fmopt(?:\.\w+)+)", text)) - {"fmopt.plan"}
        assert [name for name in sorted(full) if not resolved(name)] == [], path.name
        assert set(re.findall(r"\[([A-Z]\w+(?:19|20)\d\d|BasanezSuarez)\]", text)) <= references, path.name


ARRAY = re.compile(r"\b(Array|ArrayLike|NDArray|Indices)\b")
SHAPE = re.compile(r"\([\w…][^)]*,[^)]*\)|\(…\)|\bposes?\b|arguments as for `")
# What a notebook calls; the rooms of the search, the certificate and the physics engine work below these.
NOTEBOOK = ("notebook", "report", "plan", "planning/control", "papers/lee_huang", "papers/basanez_suarez", "contact")
NOTEBOOK += ("geometry", "spatial/se3.py", "spatial/ellipsoid.py", "spatial/values.py", "task")
NOTEBOOK += ("certificate/error_set.py",)


def holds_arrays(node: ast.AST) -> bool:
    """Whether a function takes or returns arrays, or a class has them as fields."""
    if isinstance(node, ast.ClassDef):
        return any(isinstance(item, ast.AnnAssign) and ARRAY.search(ast.unparse(item.annotation)) for item in node.body)
    if not isinstance(node, ast.FunctionDef):
        return False
    taken = [arg.annotation for arg in (*node.args.args, *node.args.kwonlyargs) if arg.annotation is not None]
    return any(ARRAY.search(ast.unparse(kind)) for kind in (*taken, *([node.returns] if node.returns else [])))


def test_arrays_have_their_shape_in_the_docstring() -> None:
    silent, seen = [], 0
    for file in FILES:
        if not any(file.is_relative_to(room) for room in NOTEBOOK):
            continue
        for name, node in public(file):
            if holds_arrays(node):
                seen += 1
                assert isinstance(node, ast.ClassDef | ast.FunctionDef)
                if not SHAPE.search(ast.get_docstring(node) or ""):
                    silent.append(f"{file}: {name}")
    assert silent == []
    assert seen > 200


NUMBERS = re.compile(
    UNITS.pattern
    + r"|\b(m²|m³|1/m|unit|units|pose|poses|indices|index|shares?|coordinates|twist|wrench|direction|normals?)\b"
    + r"|\b(axes|vectors?|ratio|parameters?|fractions?|constraints?)\b"
)


def test_numbers_in_arrays_have_a_unit_or_none() -> None:
    """The unit stands with the function, its class or its module; directions, poses and shares have their own."""
    silent = []
    for file in FILES:
        if not any(file.is_relative_to(room) for room in NOTEBOOK):
            continue
        texts = {name: ast.get_docstring(node) or "" for name, node in public(file) if documented(node)}
        module = texts.get(module_name(file), "")
        for name, node in public(file):
            told = (texts.get(name, ""), texts.get(name.split(".")[0], ""), module)
            if holds_arrays(node) and not NUMBERS.search(" ".join(told)):
                silent.append(f"{file}: {name}")
    assert silent == []
    assert not NUMBERS.search("The depth (n,) of a hole.")


def test_what_raises_on_purpose_says_so() -> None:
    """A public function whose own body raises an error of the tree names it under Raises."""
    errors = {name for name in vars(importlib.import_module("fmopt.errors")) if name.endswith("Error")}
    silent, seen = [], 0
    for file in FILES:
        for name, node in public(file) if "cli" not in file.parts else []:  # whose docstrings are its --help
            if not isinstance(node, ast.FunctionDef):
                continue
            raised = {
                call.func.id
                for item in ast.walk(node)
                if isinstance(item, ast.Raise) and isinstance(call := item.exc, ast.Call)
                if isinstance(call.func, ast.Name) and call.func.id in errors
            }
            seen += len(raised)
            said = (ast.get_docstring(node) or "").partition("Raises:")[2]
            silent += [f"{file}: {name}: {error}" for error in sorted(raised) if error not in said]
    assert silent == []
    assert seen > 50


def astray(text: str) -> list[str]:
    """The strings of a source that explain nothing: neither docstrings nor right behind an assignment."""
    found = []
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        for before, one in pairwise(body if isinstance(body, list) else ()):
            if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) and isinstance(one.value.value, str):
                found += [] if isinstance(before, ast.Assign | ast.AnnAssign) else [one.value.value]
    return found


def test_what_a_name_stands_for_is_said_right_behind_it() -> None:
    assert [f"{file}: {one}" for file in FILES for one in astray((PACKAGE / file).read_text(encoding="utf-8"))] == []
    assert astray("'''What.'''\nA = 1\n'''One.'''\n'''Two.'''\ndef f():\n    '''Three.'''\n") == ["Two."]


def test_public_face_is_complete() -> None:
    for name in fmopt.__all__:
        assert getattr(fmopt, name).__doc__, name
    assert set(fmopt.__all__) <= set(dir(fmopt))
    with pytest.raises(AttributeError, match="has no attribute 'slove'; it has load, solve"):
        fmopt.slove  # noqa: B018


def test_arguments_that_are_lengths_or_angles_name_their_unit() -> None:
    for name in ("load", "solve", "Problem", "Plan", "Segment"):
        assert UNITS.search(" ".join(map(str, _texts(getattr(fmopt, name))))) or name == "load", name


def _texts(item: Any) -> list[str | None]:
    inside = [value for key, value in vars(item).items() if not key.startswith("_")] if isinstance(item, type) else []
    return [item.__doc__, *(getattr(value, "__doc__", None) for value in inside)]


def examples() -> list[tuple[str, doctest.DocTest]]:
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = []
    for file in FILES:
        if ">>>" in (PACKAGE / file).read_text(encoding="utf-8"):
            module: ModuleType = importlib.import_module(module_name(file))
            cases = finder.find(module, module_name(file), module=module, extraglobs={"fmopt": fmopt})
            found += [(case.name, case) for case in cases if case.examples]
    return found


EXAMPLES = dict(examples())


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_in_docstrings_do_as_they_say(name: str, square_peg_plan_file: Path) -> None:
    Path("out/square_peg").mkdir(parents=True)
    shutil.copy(square_peg_plan_file, "out/square_peg/plan.json")
    said: list[str] = []
    outcome = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(EXAMPLES[name], out=said.append)
    assert outcome.failed == 0, "".join(said)
    assert outcome.attempted > 0


def test_help_shows_every_public_name_with_what_it_takes() -> None:
    import pydoc

    shown = pydoc.plain(pydoc.render_doc(fmopt))
    for words in ("load(path", "solve(problem", "read(path", "show(value", "class Plan", "class Problem", "with_(self"):
        assert words in shown
    assert "`with_`" in shown


def test_every_notebook_is_in_the_manual() -> None:
    text = (PACKAGE / "manual" / "python.md").read_text(encoding="utf-8")
    notebooks = {path.stem for path in (PACKAGE.parent / "notebooks").glob("*.py")}
    assert notebooks == set(re.findall(r"\| `(\d\d_\w+)` \|", text))
