"""The house: a module imports only from lower floors, libraries only where they belong, and start-up stays light."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import fmopt

PACKAGE = Path(fmopt.__file__).parent

# From the ground up. A room sees every lower floor, never its own: rooms of one floor do not know each other. A room
# inside another that has a floor of its own is named by its path; all others belong to the room around them.
FLOORS: tuple[frozenset[str], ...] = (
    frozenset({"errors"}),
    frozenset({"runtime"}),
    frozenset({"spatial"}),
    frozenset({"geometry/plane"}),
    frozenset({"geometry", "plan"}),
    frozenset({"papers/basanez_suarez", "task/object_model"}),
    frozenset({"execution", "plan/export", "contact", "task", "report"}),
    frozenset({"papers/lee_huang"}),
    frozenset({"certificate"}),
    frozenset({"papers"}),
    frozenset({"planning/optimise", "planning/moves"}),
    frozenset({"planning/search", "planning/placement"}),
    frozenset({"planning/robustness"}),
    frozenset({"planning/control"}),
    frozenset({"planning"}),
    frozenset({"study"}),
    frozenset({"notebook", "press"}),
    frozenset({"manual"}),
    frozenset({"cli"}),
    frozenset({"__main__"}),
)
APART = "verify"
ROOMS = frozenset({APART}).union(*FLOORS)
# Rooms that see less than the floors below them.
ONLY: dict[str, frozenset[str]] = {
    "errors": frozenset(),
    "plan": frozenset({"runtime", "spatial", "errors", APART}),
    "plan/export": frozenset({"plan", "runtime", "spatial", "errors"}),
    "geometry/plane": frozenset({"runtime", "spatial", "errors"}),
    "task/object_model": frozenset({"geometry", "spatial", "errors"}),
    "report": frozenset({"plan", "geometry", "runtime", "spatial", "errors"}),
    "execution": frozenset({"plan", "geometry", "runtime", "spatial", "errors"}),
    "papers/lee_huang": frozenset({"task/object_model", "plan", "geometry", "geometry/plane", "spatial"})
    | {"runtime", "errors"},
    "papers/basanez_suarez": frozenset({"geometry/plane", "plan", "spatial", "errors"}),
    "certificate": frozenset({"contact", "geometry", "spatial", "runtime", "errors"}),
    "manual": frozenset({"report"}),
    APART: frozenset(),
}
# Rooms that only these may import.
CALLERS: dict[str, frozenset[str]] = {
    APART: frozenset({"plan", "planning", "notebook", "cli"}),
    "report": frozenset({"study", "notebook", "manual", "cli"}),
    "task": frozenset({"planning/control", "planning", "study", "notebook", "cli"}),
    "plan/export": frozenset({"notebook", "cli"}),
    "execution": frozenset({"planning", "study", "notebook", "press", "cli"}),
}
# Every library that the package may import, and the files or rooms that may.
LIBRARIES: dict[str, frozenset[str]] = {
    "numpy": frozenset(
        {"spatial", "geometry", "contact", "task", "papers", "certificate", "planning", "plan", "report", "study"}
        | {"execution", "notebook", "runtime/ahead.py"}
    ),
    "scipy": frozenset({"geometry", "contact", "papers", "planning", "study"})
    | {"execution/trials.py", "execution/confidence.py", "execution/worst.py", "execution/engines/drake_engine.py"}
    | {"task/object_model/goal.py"},
    "numba": frozenset({"runtime/compiled.py", "runtime/ahead.py"}),
    "threadpoolctl": frozenset({"runtime/compiled.py"}),
    "distributed": frozenset({"study/running/cluster.py"}),
    "polars": frozenset({"study/__init__.py", "study/outcome.py", "study/results/table.py", "notebook/plan.py"}),
    "sympy": frozenset(
        {"papers/basanez_suarez/surface.py", "papers/lee_huang/symbolic_diagram.py"}
        | {"contact/derive.py", "contact/generate.py"}
    ),
    "casadi": frozenset({"planning/placement/nonlinear_program.py"}),
    "clarabel": frozenset({"planning/optimise/solvers.py"}),
    "daqp": frozenset({"geometry/fit/placing.py", "planning/optimise/solvers.py"}),
    "cvxpy": frozenset({"planning/optimise/cone_program.py", "notebook/placing.py"}),
    "manifold3d": frozenset({"geometry", "papers/lee_huang/touch.py"}),
    "OCP": frozenset({"geometry/step"}),
    "plyfile": frozenset({"geometry/mesh/ply_file.py"}),
    "shapely": frozenset({"planning/press", "geometry", "papers/basanez_suarez", "report"}),
    "matplotlib": frozenset({"report", "study/results/figures.py"}),
    "mpl_toolkits": frozenset({"report/views/surface_view.py"}),
    "pydantic": frozenset({"task", "plan", "study/study_file.py"}),
    "pydantic_core": frozenset({"task"}),
    "pint": frozenset({"task/toml/units.py"}),
    "tree_sitter": frozenset({"task/toml/source.py"}),
    "tree_sitter_toml": frozenset({"task/toml/source.py"}),
    "mujoco": frozenset({"execution"}),
    "pydrake": frozenset({"execution/engines/drake_engine.py"}),
    "PIL": frozenset({"execution/replay.py"}),
    "yaml": frozenset({"plan/export/ros2.py", "plan/export/executor.py"}),
    "rclpy": frozenset({"plan/export/executor.py"}),
    "geometry_msgs": frozenset({"plan/export/executor.py"}),
    "rcl_interfaces": frozenset({"plan/export/executor.py"}),
    "IPython": frozenset({"notebook/display.py"}),
    "typer": frozenset({"cli"}),
    "lib3mf": frozenset({"geometry/mesh/archive.py"}),
    "trimesh": frozenset({"geometry/mesh/archive.py"}),
    "rich": frozenset({"cli/console.py"}),
    "markdown_it": frozenset({"manual"}),
}
SOLVERS = {
    *("numpy", "numba", "scipy", "casadi", "sympy", "matplotlib"),
    *("clarabel", "daqp", "cvxpy", "pydantic", "distributed"),
}
# Imports within functions from which a chain of imports leads back to the file. The table only gets shorter.
CIRCLES: dict[str, set[str]] = {
    "fmopt.notebook.plan": {f"fmopt.notebook.{name}" for name in ("drawing", "sheets")},
    "fmopt.notebook.sheets": {"fmopt.notebook.drawing"},
    "fmopt.notebook.views": {"fmopt.notebook.stages"},
    "fmopt.task.problem": {"fmopt.task.loading"},
}
EVALUATORS = {"eval", "exec", "compile", "__import__"}
PARSERS = {"lambdify", "sympify", "parse_expr"}

FILES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))


def room(file: str) -> str:
    """The innermost room of those on a floor that holds a file, or what else stands at the path of a module."""
    path = file.removesuffix(".py")
    around = [path, *(folder.as_posix() for folder in Path(path).parents)]
    return next((name for name in around if name in ROOMS), path.split("/")[0])


def places(file: str) -> set[str]:
    """The file, its folders and its room."""
    return {file, room(file), *(folder.as_posix() for folder in Path(file).parents)}


def imports(text: str) -> set[str]:
    """Every module that a source text imports, wherever in it; what is imported from one of
    the package counts as a module in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in line {node.lineno}"
            whole = f"{node.module}.".startswith("fmopt.")
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names if whole else {str(node.module)}
    return found


def rooms_imported(file: str, text: str) -> set[str]:
    found = {room(name.removeprefix("fmopt.").replace(".", "/")) for name in imports(text) if name.startswith("fmopt.")}
    return found - {room(file), "__version__"}


def module(file: str) -> str:
    """The module that a file of the package is."""
    return ".".join(("fmopt", *Path(file).with_suffix("").parts)).removesuffix(".__init__")


def imports_of_known(text: str, known: set[str], lazy: bool) -> set[str]:
    """The known modules that a source text imports as it is loaded, and, if `lazy`, those within its functions.

    Imports under an `if`, which are for types alone, do not count.
    """
    body = [node for node in ast.parse(text).body if not isinstance(node, ast.If)]
    found: set[str] = set()
    for node in (inner for outer in body for inner in (ast.walk(outer) if lazy else [outer])):
        if isinstance(node, ast.ImportFrom):
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (names & known) or {str(node.module)}
    return found & known


def in_circles(ways: dict[str, set[str]]) -> dict[str, set[str]]:
    """The ways from which others lead back."""

    def reached(start: str) -> set[str]:
        found, waiting = {start}, [start]
        while waiting:
            new = ways[waiting.pop()] - found
            found |= new
            waiting += new
        return found

    back = {name: reached(name) for name in ways}
    circles = {name: {other for other in others if name in back[other]} for name, others in ways.items()}
    return {name: others for name, others in circles.items() if others}


def strangers(file: str, text: str) -> list[str]:
    """Rooms that this file imports and must not know."""
    here = room(file)
    if here in ONLY:
        allowed = ONLY[here]
    else:
        height = next(i for i, floor in enumerate(FLOORS) if here in floor)
        allowed = frozenset().union(*FLOORS[:height], {APART})
    return sorted(
        other
        for other in rooms_imported(file, text)
        if other not in allowed or here not in CALLERS.get(other, frozenset({here}))
    )


def foreign(file: str, text: str) -> list[str]:
    """Libraries that this file imports and must not."""
    tops = {name.split(".")[0] for name in imports(text)} - set(sys.stdlib_module_names) - {"fmopt"}
    if room(file) == APART:
        return sorted(tops)
    return sorted(top for top in tops if not places(file) & LIBRARIES.get(top, frozenset()))


def evaluations(text: str) -> list[str]:
    """Calls that would run or parse text as code."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in EVALUATORS:
            found.append(f"{node.func.id} in line {node.lineno}")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in {"eval", "exec"}:
            found.append(f".{node.func.attr} in line {node.lineno}")
        elif isinstance(node, ast.Attribute) and node.attr in PARSERS:
            found.append(f"{node.attr} in line {node.lineno}")
        elif isinstance(node, ast.alias) and node.name.split(".")[-1] in PARSERS:
            found.append(f"{node.name} imported")
    return sorted(found)


def source(file: str) -> str:
    return (PACKAGE / file).read_text(encoding="utf-8")


def test_every_room_stands_on_one_floor() -> None:
    placed = [name for floor in FLOORS for name in floor]
    assert len(placed) == len(set(placed))
    assert {room(file) for file in FILES} - {"__init__"} == {*placed, APART}


def test_exceptions_still_point_down() -> None:
    height = {name: i for i, floor in enumerate(FLOORS) for name in floor}
    for name, allowed in ONLY.items():
        assert all(height[other] < height[name] for other in allowed - {APART} if name != APART)


def test_imports_point_down() -> None:
    assert rooms_imported("__init__.py", source("__init__.py")) == {"notebook", "errors", "execution", "study"}
    inside = [file for file in FILES if file != "__init__.py"]
    assert {file: found for file in inside if (found := strangers(file, source(file)))} == {}


def test_no_files_import_each_other_but_those_of_the_table() -> None:
    known = {module(file) for file in FILES}
    loaded, every = (
        {module(file): imports_of_known(source(file), known, lazy) - {module(file)} for file in FILES}
        for lazy in (False, True)
    )
    assert in_circles(loaded) == {}
    within = {name: others - loaded[name] for name, others in in_circles(every).items()}
    assert {name: others for name, others in within.items() if others} == CIRCLES


def test_circles_are_seen() -> None:
    assert in_circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == {"a": {"b"}, "b": {"c"}, "c": {"a"}}
    text = "if TYPE_CHECKING:\n    from x import a\nfrom x import b\ndef f():\n    from x.c import name"
    known = {"x.a", "x.b", "x.c"}
    assert imports_of_known(text, known, lazy=False) == {"x.b"}
    assert imports_of_known(text, known, lazy=True) == {"x.b", "x.c"}


def test_libraries_stay_in_their_rooms() -> None:
    assert {file: found for file in FILES if (found := foreign(file, source(file)))} == {}


def test_the_table_of_libraries_has_no_dead_row() -> None:
    used = {(name.split(".")[0], file) for file in FILES for name in imports(source(file))}
    for library, rooms in LIBRARIES.items():
        for place in rooms:
            assert any(top == library and place in places(file) for top, file in used), (library, place)


def test_no_text_is_run_as_code() -> None:
    assert {file: found for file in FILES if (found := evaluations(source(file)))} == {}


def test_the_readers_see_what_they_should() -> None:
    inside = "def f():\n    from fmopt.contact.state_graph import ContactGraph"
    assert strangers("papers/lee_huang/touch.py", inside) == ["contact"]
    assert strangers("geometry/csg.py", "from fmopt.planning import search") == ["planning/search"]
    assert strangers("contact/state_graph.py", "import fmopt.papers.lee_huang.touch") == ["papers/lee_huang"]
    assert strangers("geometry/csg.py", "from fmopt import cli, errors") == ["cli"]
    assert strangers("planning/search/best_first.py", "from fmopt.verify import verify") == ["verify"]
    assert strangers("planning/control/hybrid_strategy.py", "from fmopt.report.page import report_page") == ["report"]
    assert strangers("verify/check.py", "from fmopt.spatial.values import frozen") == ["spatial"]
    assert foreign("verify/check.py", "import math, numpy") == ["numpy"]
    assert foreign("contact/state_graph.py", "if True:\n    import matplotlib.pyplot, numpy, torch") == [
        "matplotlib",
        "torch",
    ]
    assert evaluations("eval('1')\nsympy.lambdify(x, y)\nfrom sympy import sympify\nnp.frompyfunc(a)") == [
        "eval in line 1",
        "lambdify in line 2",
        "sympify imported",
    ]


def test_every_cited_paper_is_among_the_references() -> None:
    cited = {key for file in FILES for key in re.findall(r"\[([A-Z]\w+(?:19|20)\d\d|BasanezSuarez)\]", source(file))}
    references = (PACKAGE / "manual" / "references.md").read_text(encoding="utf-8")
    assert cited == set(re.findall(r"^- \*\*\[(\w+)\]\*\*", references, re.MULTILINE))


def test_the_gate_runs_the_readmes_commands_in_their_order_and_the_tests_last() -> None:
    readme = (PACKAGE.parent / "README.md").read_text(encoding="utf-8")
    solve, test = re.findall(r"```sh\n(.+)\n```", readme)[:2]
    gate = (PACKAGE.parent / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    wanted = [*solve.split(" && "), test]
    lines = [line.partition(" #")[0] for line in gate]
    assert [line for line in lines if line in wanted] == wanted
    assert lines[-1] == test


def loaded(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after `code`, its own output thrown away."""
    ending = "\nimport json, sys\nsys.stderr.write(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    done = subprocess.run([sys.executable, "-c", code + ending], capture_output=True, text=True, timeout=60, check=True)
    return set(json.loads(done.stderr))


@pytest.mark.parametrize(
    "code",
    [
        "import fmopt.cli",
        "import sys\nfrom fmopt.cli import main\nsys.argv = ['fmopt', '--help']\n"
        "try:\n    main()\nexcept SystemExit as stop:\n    assert not stop.code",
    ],
    ids=["import", "--help"],
)
def test_the_command_line_starts_without_solvers(code: str) -> None:
    assert loaded(code) & SOLVERS == set()


def test_the_package_itself_loads_nothing_but_the_standard_library() -> None:
    before = loaded("")
    assert loaded("import fmopt; dir(fmopt)") - before - set(sys.stdlib_module_names) == {"fmopt"}


def test_the_check_of_a_problem_loads_no_solver() -> None:
    assert (
        loaded("import fmopt.task.problem") & {"casadi", "sympy", "matplotlib", "clarabel", "cvxpy", "trimesh"} == set()
    )


def test_a_plan_of_a_problem_file_loads_only_what_it_uses(tmp_path: Path) -> None:
    problem, out = PACKAGE.parent / "problems" / "square_peg.toml", tmp_path / "out"
    words = ["solve", str(problem), "-q", "--trials", "0", "--out", str(out)]
    code = f"from fmopt.cli.entry import app\napp({words}, standalone_mode=False)"
    others = {"sympy", "mpmath", "matplotlib", "networkx", "cvxpy", "pint", "OCP", "mujoco", "polars", "distributed"}
    assert loaded(code) & others == set()
    assert (out / "plan.json").is_file()


def test_the_independent_check_loads_the_standard_library_alone() -> None:
    before = loaded("")
    assert loaded("import fmopt.verify") - before - set(sys.stdlib_module_names) == {"fmopt"}
