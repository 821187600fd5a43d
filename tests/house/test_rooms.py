"""Rooms: no entries of a folder need each other; tests stand in rooms of the package, each starts in a new folder."""

import ast
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import fmopt
from tests import ROOT

PACKAGE = Path(fmopt.__file__).parent
TESTS = ROOT / "tests"


def needed(text: str, known: Iterable[str]) -> set[str]:
    """The modules, of those known, that a source text imports as it is loaded, not within its functions."""
    found: set[str] = set()
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom):
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (names & {*known}) or {str(node.module)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & {*known}


def in_circles(ways: Mapping[str, set[str]]) -> set[str]:
    """Those that need each other, by whatever way round, and those that need such."""
    left = dict(ways)
    while ends := {name for name, others in left.items() if not others & left.keys() - {name}}:
        left = {name: others for name, others in left.items() if name not in ends}
    return {*left}


def sources() -> dict[str, str]:
    """Every source text of the package, by the dotted name of its module."""
    files = sorted(PACKAGE.rglob("*.py"))
    names = [".".join(("fmopt", *file.relative_to(PACKAGE).with_suffix("").parts)) for file in files]
    return {name: file.read_text(encoding="utf-8") for name, file in zip(names, files, strict=True)}


def entries_needed(folder: tuple[str, ...], texts: Mapping[str, str]) -> dict[str, set[str]]:
    """For each entry of a folder, a room taken as one, the other entries of that folder that it imports."""
    whole = {name.removesuffix(".__init__"): name for name in texts}
    ways: dict[str, set[str]] = {}
    depth = len(folder)
    for name, text in texts.items():
        parts = tuple(name.split("."))
        if parts[:depth] != folder:
            continue
        others = (tuple(whole[other].split(".")) for other in needed(text, whole))
        within = {other[depth] for other in others if other[:depth] == folder}
        ways.setdefault(parts[depth], set()).update(within - {parts[depth]})
    return ways


def test_tests_stand_in_rooms_of_the_package_and_share_by_no_test() -> None:
    files = sorted(TESTS.rglob("*.py"))
    rooms = {file.relative_to(TESTS).parts[0] for file in files if file.name.startswith("test_")}
    assert rooms - {path.name for path in PACKAGE.iterdir() if path.is_dir()} == {"house", "benchmarks"}
    names = {".".join(("tests", *file.relative_to(TESTS).with_suffix("").parts)) for file in files}
    tests = {name for name in names if name.rpartition(".")[2].startswith("test_")}
    assert len(tests) > 150
    assert {str(file): found for file in files if (found := needed(file.read_text("utf-8"), tests))} == {}
    assert needed("from tests.verify.test_plan import spoilt", tests) == {"tests.verify.test_plan"}


def test_a_test_starts_in_an_empty_folder_of_its_own(tmp_path: Path) -> None:
    assert Path.cwd() == tmp_path.resolve()
    assert [*Path().iterdir()] == []


def test_no_two_classes_have_one_name() -> None:
    trees = [ast.parse(text) for text in sources().values()]
    names = Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    # Those of notebooks are named after what they wrap.
    assert {name for name, count in names.items() if count > 1} == {"Plan", "Problem", "Segment", "Trials"}


def test_no_entries_of_a_folder_need_each_other() -> None:
    texts = sources()
    rooms = sorted({tuple(name.split(".")[:k]) for name in texts for k in range(1, name.count(".") + 1)})
    assert ("fmopt", "planning", "search") in rooms
    circles = {".".join(room): found for room in rooms if (found := in_circles(entries_needed(room, texts)))}
    assert circles == {}


def test_circles_are_seen() -> None:
    assert in_circles({"a": {"b"}, "b": {"a"}, "c": set(), "d": {"c"}}) == {"a", "b"}
    assert in_circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"c"}}) == {"a", "b", "c", "d"}
    assert in_circles({"a": {"a"}}) == set()
    texts = {
        "fmopt.a.one": "from fmopt.b import two",
        "fmopt.b.two": "",
        "fmopt.b.three": "from fmopt.a.one import f",
        "fmopt.b.__init__": "def g():\n    from fmopt.a import one",
    }
    assert entries_needed(("fmopt",), texts) == {"a": {"b"}, "b": {"a"}}
    assert entries_needed(("fmopt", "b"), texts) == {"two": set(), "three": set(), "__init__": set()}
