"""What the program says of itself: every public name has a docstring, names in it exist, examples do as they say."""

import ast
import doctest
import importlib
import re
import shutil
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
        tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                names = re.findall(r"`(fmopt(?:\.\w+)+)", ast.get_docstring(node) or "")
                dead += [f"{file}: {name}" for name in names if not resolved(name)]
    assert dead == []
    assert not resolved("fmopt.plan.raed")
    assert resolved("fmopt.plan.read")


def test_names_in_the_readme_exist() -> None:
    text = (PACKAGE.parent / "README.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`(fmopt\.[\w.]+\w)", text))
    assert names
    assert [name for name in sorted(names) if not resolved(name)] == []


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
def test_examples_in_docstrings_do_as_they_say(
    name: str, square_peg_plan_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
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


def test_files_in_the_readme_exist() -> None:
    root = PACKAGE.parent
    text = (root / "README.md").read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    named = re.findall(r"`((?:problems|models|notebooks|tests|fmopt)/[\w./]*)`", text)
    assert "notebooks/square_peg.svg" in links
    assert len(named) > 5
    assert [name for name in (*links, *named) if not (root / name).exists()] == []
    notebooks = {path.stem for path in (root / "notebooks").glob("*.py")}
    assert notebooks <= set(re.findall(r"\| `(\d\d_\w+)` \|", text))
