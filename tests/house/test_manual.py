"""The manual: one page that opens and is searched offline, names what there is, and does what its examples say."""

import json
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from markdown_it import MarkdownIt
from py_mini_racer import MiniRacer
from typer.testing import CliRunner

from fmopt.cli import app
from fmopt.geometry.csg import Box
from fmopt.manual import FOLDER, PAGES, manual
from fmopt.manual.book import anchor, inside, text_of
from tests import ROOT
from tests.shared.files.mesh_files import write_stl
from tests.shared.files.shipped import copied
from tests.shared.pages.engine import Page, Tree, walk, words

README = (ROOT / "README.md").read_text(encoding="utf-8")
# What is not to be used before it is explained; each with the page that explains it.
EXPLAINED = {r"S\(t\)": "concepts", "ρ": "concepts", r"[Zz]onotope": "concepts", "[Cc]-surface": "concepts"}


def commands() -> Iterator[tuple[str, Any]]:
    """Every command with its words, those of commands inside commands as well."""
    whole: Any = typer.main.get_command(app)
    waiting = [("fmopt", whole)]
    while waiting:
        said, command = waiting.pop()
        waiting += [(f"{said} {name}", one) for name, one in getattr(command, "commands", {}).items()]
        if said != "fmopt":
            yield said, command


@pytest.fixture(scope="module")
def page() -> str:
    return manual()


def test_every_page_is_in_the_book_and_has_one_heading() -> None:
    assert sorted(PAGES) == sorted(path.stem for path in FOLDER.glob("*.md"))
    for name in PAGES:
        plain = re.sub(r"(?ms)^```.*?^```$", "", text_of(name))
        heads = re.findall(r"^(#+) (.+)$", plain, re.MULTILINE)
        assert heads[0][0] == "#", name
        assert [level for level, _ in heads].count("#") == 1, name
        anchors = [anchor(said) for _, said in heads]
        assert len(set(anchors)) == len(anchors), name


def test_the_one_page_opens_offline_and_its_links_lead_somewhere(page: str) -> None:
    nodes = walk(Tree(page).root)
    names = [node[1]["id"] for node in nodes if "id" in node[1]]
    assert len(set(names)) == len(names)
    links = [node[1]["href"] for node in nodes if node[0] == "a"]
    assert len(links) > 100
    assert [link for link in links if link.startswith("#") and link[1:] not in names] == []
    assert [link for link in links if not re.match(r"#|https://", link)] == []
    sources = [node[1][key] for node in nodes for key in ("src", "href") if key in node[1] and node[0] != "a"]
    assert [source for source in sources if not source.startswith("data:")] == []
    pictures = [node for node in nodes if node[0] == "img"]
    assert len(pictures) >= 2
    assert all(node[1]["alt"] and node[1]["src"].startswith("data:image/svg+xml") for node in pictures)
    assert next(words(node) for node in nodes if node[0] == "h1") == "First steps"
    assert [words(node) for node in nodes if node[0] == "p" and words(node).startswith("|")] == []  # tables all
    assert manual() == page


def test_links_within_pages_are_rewritten() -> None:
    assert inside("problem.md#meshes", "start") == "#problem.meshes"
    assert inside("#meshes", "problem") == "#problem.meshes"
    assert inside("problem.md", "start") == "#problem.top"
    assert inside("https://example.org/a.md", "start") == "https://example.org/a.md"


def test_the_search_finds_sections_that_hold_all_words_headings_first() -> None:
    engine = MiniRacer()
    engine.eval((FOLDER / "book" / "manual.js").read_text(encoding="utf-8") + "\n;0")
    sections = [
        {"id": "a", "page": "Robots", "head": "Exports", "text": "a program of URScript, its base in m"},
        {"id": "b", "page": "Robots", "head": "The base", "text": "of the hole in the robot"},
        {"id": "c", "page": "Errors", "head": "Codes", "text": "0 and 1"},
    ]

    def found(query: str) -> list[str]:
        asked = f"JSON.stringify(matches({json.dumps(sections)}, {json.dumps(query)}).map((s) => s.id))"
        return list(json.loads(str(engine.eval(asked))))

    assert found("BASE") == ["b", "a"]
    assert found("base urscript") == ["a"]
    assert found("robots codes") == []
    assert found("  ") == []
    assert "URScript" in str(engine.eval(f"excerpt({json.dumps('x' * 300 + ' URScript ' + 'y' * 300)}, 'urscript')"))


def test_who_types_gets_a_list_of_links_and_enter_takes_the_first(page: str) -> None:
    typed = """(() => {
        const field = document.getElementById("words"), found = document.getElementById("found");
        field.value = "%s";
        field.dispatchEvent(happened("input"));
        document.querySelector("form").dispatchEvent(happened("submit"));
        const links = found.querySelectorAll("a").map((link) => link.getAttribute("href"));
        return JSON.stringify([location.hash, links, found.textContent]);
    })()"""
    with Page(page) as opened:
        hash_, links, said = json.loads(opened.run(typed % "no plan was found"))
        assert hash_ == links[0] == "#errors.no-plan-was-found"
        assert "sections" in said
        assert json.loads(opened.run(typed % "qwertz"))[1:] == [[], "no section has all of these words"]
        assert json.loads(opened.run(typed % ""))[1:] == [[], ""]


def test_the_command_writes_it(tmp_path: Path, page: str) -> None:
    target = tmp_path / "manual.html"
    done = CliRunner().invoke(app, ["manual", "--out", str(target), "--json"])
    assert (done.exit_code, json.loads(done.stdout)) == (0, {"written": [str(target)]})
    assert target.read_text(encoding="utf-8") == page


def test_every_command_and_option_is_on_the_page_of_commands() -> None:
    text = text_of("commands")
    missing = []
    for said, command in commands():
        if f"`{said}`" not in text and f"## {said}\n" not in text and f"`{said} " not in text:
            missing.append(said)
        section = text.partition(f"## {' '.join(said.split()[:2])}\n")[2].partition("\n## ")[0]
        for option in [name for param in command.params for name in (*param.opts, *param.secondary_opts)]:
            shared = option in {"--json", "--quiet", "-q", "--help"}
            if option.startswith("-") and not shared and not re.search(rf"{option}\b", section):
                missing.append(f"{said} {option}")
    assert missing == []


@pytest.mark.parametrize("name", [*PAGES, "README"])
def test_files_and_links_of_a_page_exist(name: str) -> None:
    file = ROOT / "README.md" if name == "README" else FOLDER / f"{name}.md"
    text = re.sub(r"(?ms)^```.*?^```$", "", file.read_text(encoding="utf-8"))
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    for link in links:
        path, _, at = link.partition("#")
        target = file.parent / path if path else file
        assert target.exists(), link
        heads = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE) if at else []
        assert not at or at in [anchor(said) for said in heads], link
    named = re.findall(r"`((?:problems|models|notebooks|tests|fmopt)/[\w./]*)`", text)
    if name == "glossary":
        named += [f"fmopt/{path}" for path in re.findall(r"\| `([\w/]+\.py)` \|$", text, re.MULTILINE)]
        assert len(named) > 60
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_readme_is_for_one_sitting() -> None:
    assert len(README.splitlines()) <= 200
    assert len(README.split()) < 2500
    plain = re.sub(r"(?ms)^```.*?^```$", "", README)
    for word in EXPLAINED:
        assert not re.search(word, plain.partition("| where is")[0]), word
    shown = README.partition("fmopt/\n")[2].partition("```")[0]
    rooms = {path.stem for path in (ROOT / "fmopt").iterdir() if not path.name.startswith("_")} - {"py"}
    assert {room for room in rooms if not re.search(rf"\b{room}\b", shown)} == set()
    table = re.findall(r"^\| .+ \| (.+) \|$", README.partition("| where is")[2], re.MULTILINE)
    assert len(table) == 6
    for row in table:
        files = re.findall(r"`(fmopt/[\w/]+\.py)`", row)
        assert files, row
        for function in re.findall(r"`(\w+)` in", row):
            assert f"def {function}(" in (ROOT / files[0]).read_text(encoding="utf-8")


def test_the_page_on_tests_names_files_that_exist() -> None:
    text = (ROOT / "tests" / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 50
    named = set(re.findall(r"`([\w*/]+(?:\.py|/))`", text))
    assert len(named) > 20
    assert {name for name in named if not [*(ROOT / "tests").glob(name)]} == {"fmopt/"}


@pytest.mark.parametrize("word", EXPLAINED)
def test_words_are_explained_before_they_are_used(word: str) -> None:
    assert re.search(word, text_of(EXPLAINED[word]))
    for name in PAGES[: PAGES.index(EXPLAINED[word])]:
        assert not re.search(word, text_of(name)), name


@pytest.mark.parametrize(("what", "figure"), [("cut", "square_peg"), ("margin", "margin")])
def test_pictures_are_of_the_plan_of_today(what: str, figure: str, square_peg_plan_file: Path, tmp_path: Path) -> None:
    """Where this fails, `fmopt show out/square_peg/plan.json --what cut --out fmopt/manual/figures/square_peg.svg`."""
    drawn = tmp_path / "drawn.svg"
    assert (
        CliRunner().invoke(app, ["show", str(square_peg_plan_file), "--what", what, "--out", str(drawn)]).exit_code == 0
    )
    said = [
        re.findall(r"<!-- (.+?) -->", path.read_text("utf-8")) for path in (drawn, FOLDER / f"figures/{figure}.svg")
    ]
    assert said[0] == said[1]
    assert len(said[0]) > 15


def sections(name: str) -> dict[str, str]:
    """The sections of a page by their heading."""
    parts = re.split(r"(?m)^## (.+)$", text_of(name))
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_changes_are_of_three_files_at_most_that_are_as_the_page_has_them() -> None:
    shown = sections("changes")
    assert len(shown) == 5
    for head, text in shown.items():
        rows = re.findall(r"^\| `(fmopt/[\w/.]+)( \(new\))?` \| (.+) \|$", text, re.MULTILINE)
        assert 1 <= len(rows) <= 3, head
        changed = dict(_hunks(text))
        assert changed.keys() <= {path for path, *_ in rows}, head
        for path, new, said in rows:
            assert (ROOT / path).exists() != bool(new), path
            whole = "" if new else (ROOT / path).read_text(encoding="utf-8")
            for hunk in changed.get(path, []):
                old = "\n".join(line[1:] for line in hunk if not line.startswith("+"))
                assert old in whole, f"{path}:\n{old}"
                whole += "\n".join(line[1:] for line in hunk if line.startswith("+"))
            for name in re.findall(r"`(\w+)`", said):
                assert re.search(rf"\b{name}\b", whole), f"{path}: {name}"


def _hunks(text: str) -> Iterator[tuple[str, list[list[str]]]]:
    """The files of a section's diffs, with the lines of their hunks."""
    for path, body in re.findall(r"(?ms)^```diff\n--- (\S+)\n(.*?)\n```$", text):
        yield path, [hunk.split("\n") for hunk in body.split("\n@@\n")]


def blocks(text: str) -> list[tuple[str, str, int]]:
    """The examples in a text of Markdown: language, text, and the line that each begins in, counted from 1."""
    tokens: Any = MarkdownIt("commonmark").parse(text)
    return [(token.info, token.content, token.map[0] + 1) for token in tokens if token.type == "fence"]


TEXTS = {"README": README, **{name: text_of(name) for name in PAGES}}
EXAMPLES = [
    (name, language, text, line)
    for name, whole in TEXTS.items()
    for language, text, line in blocks(whole)
    if language in {"sh", "python", "toml"}
]
FIRST = {(language, text): name for name, language, text, _ in reversed(EXAMPLES)}


def test_every_block_is_of_a_kind_that_is_tested() -> None:
    kinds = {language for name in PAGES for language, *_ in blocks(text_of(name))}
    assert kinds <= {"sh", "python", "toml", "text", "diff"}
    assert len(EXAMPLES) > 25


@pytest.fixture
def place(tmp_path: Path, square_peg_plan_file: Path) -> Path:
    """A folder with what the examples take for granted: the shipped files, and a plan of the square peg."""
    copied(tmp_path)
    (tmp_path / "out" / "square_peg").mkdir(parents=True)
    shutil.copy(square_peg_plan_file, tmp_path / "out" / "square_peg" / "plan.json")
    write_stl(tmp_path / "models" / "my_peg.stl", Box((0.02, 0.02, 0.04)))
    return tmp_path


@pytest.mark.parametrize("name", dict.fromkeys(name for name, *_ in EXAMPLES))
def test_examples_of_a_page_do_as_they_say(name: str, place: Path) -> None:
    space: dict[str, Any] = {}
    done = 0
    for page, language, text, line in EXAMPLES:
        if page != name or FIRST[language, text] != name:
            continue
        done += 1
        if language == "sh":
            for command in text.splitlines():
                _run(command, f"{name}.md:{line}")
        elif language == "toml":
            _read(text, place)
        else:
            exec(compile(text, f"{name}.md:{line}", "exec"), space)
    assert done or name == "studies"


def _run(command: str, where: str) -> None:
    """Runs a command of fmopt; of others, says that what they name exists."""
    said, _, expected = command.partition("  # exit ")
    first, *rest = shlex.split(said, comments=True)
    if first == "fmopt":
        outcome = CliRunner().invoke(app, rest)
        assert outcome.exit_code == int(expected or 0), f"{where}: {command}\n{outcome.output}\n{outcome.exception!r}"
        return
    if said not in README:  # its two commands are the gate's
        assert first in {".uv/bin/uv", "python"}, where
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        named = [rest[i + 1] for i, word in enumerate(rest) if word == "--extra"]
        assert set(named) <= project["optional-dependencies"].keys(), where
        files = [word for word in rest if word.startswith("tests/")]
        assert named or files, where
        assert all((ROOT / file).exists() for file in files), where


def _read(text: str, place: Path) -> None:
    """Reads a whole file by its kind; what is only some tables takes the place of these in the square peg's problem."""
    from fmopt.study.allocation.tolerances import load_allocation
    from fmopt.study.design import load_study
    from fmopt.task.problem import load

    kind = re.match(r"#:schema \./(\w+)\.schema\.json", text)
    readers: dict[str, tuple[str, Any]] = {
        "problem": ("problems", load),
        "model": ("models", lambda file: load(_with_the_model(file))),
        "study": ("problems/studies", load_study),
        "allocation": ("problems/studies", load_allocation),
    }
    folder, reader = readers[kind[1]] if kind else readers["problem"]
    file = place / folder / "example.toml"
    file.write_text(text if kind else _put_into_the_square_peg(text), encoding="utf-8")
    assert reader(file) is not None


def _with_the_model(file: Path) -> Path:
    """The square peg's problem with this model of the peg."""
    problem = file.parent.parent / "problems" / "square_peg.toml"
    said = problem.read_text(encoding="utf-8")
    assert "models/square_peg.toml" in said
    written = problem.with_name("with_the_model.toml")
    written.write_text(said.replace("models/square_peg.toml", f"models/{file.name}"), encoding="utf-8")
    return written


def _put_into_the_square_peg(text: str) -> str:
    head, *tables = re.split(r"(?m)^(?=\[)", (ROOT / "problems" / "square_peg.toml").read_text(encoding="utf-8"))
    new = re.findall(r"(?m)^\[([\w.]+)\]", text)
    assert new
    gone = {*new, "uncertainty.start"} if "uncertainty.sources" in new else {*new}
    kept = [table for table in tables if re.match(r"\[([\w.]+)\]", table)[1] not in gone]  # type: ignore[index]
    return head + "".join(kept) + "\n" + text
