"""Pages without a browser: well formed, nothing from outside, named for who cannot see them, and their scripts run.

The scripts run in V8, the engine of Chromium, over a stub of the page that fails for anything it does not know. Where a
Chromium is installed, tests/report/test_browser.py opens the same pages in it.
"""

import base64
import re
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import fmopt
from tests.shared.pages.engine import Node, Page, Thrown, Tree, walk, words
from tests.shared.plans.press_plan import press_plan_document
from tests.shared.plans.report_plans import cube_plan, with_graph


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, square_peg_plan_file: Path) -> str:
    file = fmopt.read(square_peg_plan_file).report(tmp_path_factory.mktemp("report") / "report.html")
    return file.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def pages(report: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    plan = fmopt.Plan(with_graph())
    frames = [("one", fmopt.show(plan, "margin")), ("two", fmopt.show(plan, "margin"))]
    part = fmopt.show(fmopt.load(fmopt.example("square_peg")).fixed, "scene")
    made = {"slider": fmopt.slider("place", frames), "part": part}
    file = fmopt.Plan(press_plan_document()).report(tmp_path_factory.mktemp("presses") / "report.html")
    presses = file.read_text(encoding="utf-8")
    return {"report": report, "presses": presses, **{name: drawing.html() for name, drawing in made.items()}}


NAMES = ("report", "slider", "part", "presses")


def attribute(tree: Node, name: str) -> list[str]:
    return [node[1][name] for node in walk(tree) if name in node[1]]


@pytest.mark.parametrize("name", NAMES)
def test_a_page_is_well_formed_and_fetches_nothing(pages: dict[str, str], name: str) -> None:
    tree = Tree(pages[name]).root
    sources = [value for key in ("src", "href", "srcset", "poster", "data", "action") for value in attribute(tree, key)]
    assert sources
    assert [value[:40] for value in sources if not value.startswith(("data:", "#"))] == []
    assert re.findall(r"@import|url\((?!['\"]?data:)", pages[name]) == []
    scripts = "".join("".join(node[2]) for node in walk(tree) if node[0] == "script")
    assert re.findall(r"\b(?:fetch|XMLHttpRequest|WebSocket|EventSource|import|Worker|sendBeacon)\s*\(", scripts) == []
    assert len(pages[name].encode()) < 3_000_000
    (policy,) = [node[1]["content"] for node in walk(tree) if "http-equiv" in node[1]]
    assert policy.startswith("default-src 'none'")


@pytest.mark.parametrize("name", NAMES)
def test_every_picture_in_a_page_can_be_drawn(pages: dict[str, str], name: str) -> None:
    pictures = [node[1]["src"] for node in walk(Tree(pages[name]).root) if node[0] == "img"]
    assert name in ("part", "presses") or pictures
    for source in pictures:
        head, data = source.split(",", 1)
        assert head == "data:image/svg+xml;base64"
        drawing = ElementTree.fromstring(base64.b64decode(data, validate=True))
        assert drawing.tag.endswith("svg")
        assert drawing.get("viewBox")
        links = [value for node in drawing.iter() for key, value in node.attrib.items() if key.endswith("href")]
        assert [link for link in links if not link.startswith(("#", "data:"))] == []


def named(node: Node, tree: Node) -> bool:
    """Whether a screen reader has a name for an element."""
    tag, attributes = node[0], node[1]
    labels = [label for label in walk(tree) if label[0] == "label" and any(inner is node for inner in walk(label))]
    own = attributes.get("aria-label") or attributes.get("alt") or attributes.get("title")
    told = [words(other) for other in walk(tree) if other[1].get("id") in attributes.get("aria-labelledby", "").split()]
    caption = [words(inner) for inner in walk(node) if inner[0] == "caption"]
    return bool(own or any(map(words, labels)) or any(told) or any(caption) or (tag == "button" and words(node)))


@pytest.mark.parametrize("name", NAMES)
def test_whatever_can_be_used_or_looked_at_has_a_name(pages: dict[str, str], name: str) -> None:
    tree = Tree(pages[name]).root
    kinds = ("img", "canvas", "button", "input", "select", "table", "nav", "iframe")
    assert [node[:2] for node in walk(tree) if node[0] in kinds and not named(node, tree)] == []
    lists = [*attribute(tree, "aria-labelledby"), *attribute(tree, "aria-describedby")]
    references = [target for value in lists for target in value.split()]
    identities = attribute(tree, "id")
    assert set(references) <= set(identities)
    assert len(identities) == len(set(identities))
    assert {link[1:] for link in attribute(tree, "href") if link.startswith("#")} <= set(identities)
    assert [node[1] for node in walk(tree) if node[0] == "th" and not node[1].get("scope")] == []
    assert [node[1] for node in walk(tree) if node[0] == "html"] == [{"lang": "en"}]
    assert not [value for value in attribute(tree, "tabindex") if int(value) > 0]


def test_the_headings_of_a_report_go_down_one_level_at_a_time(report: str) -> None:
    headings = [(int(node[0][1]), words(node)) for node in walk(Tree(report).root) if re.fullmatch("h[1-6]", node[0])]
    assert [level for level, _ in headings].count(1) == headings[0][0] == 1
    assert headings[0][1].startswith("Square peg")
    assert "What was not checked" in [said for _, said in headings]
    assert all(level <= above + 1 for (above, _), (level, _) in pairwise(headings))


def test_a_print_shows_the_words_without_the_controls(report: str) -> None:
    style = "".join("".join(node[2]) for node in walk(Tree(report).root) if node[0] == "style")
    printed = re.findall(r"@media print\s*\{((?:[^{}]|\{[^{}]*\})*)\}", style)
    hidden = [rule for block in printed for rule in re.findall(r"([^{}]+)\{[^{}]*display:\s*none", block)]
    selectors = {selector.strip() for rule in hidden for selector in rule.split(",")}
    assert {"nav", ".scene-row"} <= selectors
    assert not any("verdict" in selector for selector in selectors)


def test_the_scene_plays_and_pauses(report: str) -> None:
    with Page(report) as page:
        before, way = page.drawn(), "Number(document.querySelector('.scene').dataset.way)"
        page.run("document.querySelector('[data-do=play]').click()")
        assert page.run("document.querySelector('[data-do=play]').textContent") == "Pause"
        for _ in range(30):
            page.run("passed(40)")
        after = float(page.run(way))
        assert after > 0.02
        page.run("document.querySelector('[data-do=play]').click()")
        still = page.drawn()
        assert still != before
        page.run("passed(40)")
        assert (page.drawn(), float(page.run(way))) == (still, after)
        page.run("document.querySelector('[data-do=on]').click()")
        assert page.run("document.querySelector('[data-say=move]').textContent").startswith("Move 2 of ")
        assert re.search(r"\. Tilted by \d+\.\d°\.$", page.run("document.querySelector('[data-say=held]').textContent"))


def test_the_scene_plays_to_its_end(report: str) -> None:
    with Page(report) as page:
        page.run("document.querySelector('[data-do=play]').click()")
        way = "passed(100); Number(document.querySelector('.scene').dataset.way)"
        ways = [float(page.run(way)) for _ in range(250)]
        assert ways == sorted(ways)
        assert ways[-1] == 1.0
        assert page.run("document.querySelector('[data-do=play]').textContent") == "Play"
        moves = page.run("document.querySelector('[data-say=move]').textContent")
        assert re.match(r"Move (\d+) of \1: ", moves)


def test_the_scene_is_not_blank_and_changes_with_each_choice(report: str) -> None:
    with Page(report) as page:
        assert page.run("document.querySelector('canvas').pen.colours()") > 10
        page.run("document.querySelector('[data-do=on]').click(); document.querySelector('[data-do=on]').click()")
        seen = [page.drawn()]
        choices = ("fixed", "whole"), ("fixed", "lines"), ("moving", "lines"), ("look", "contact"), ("names", "dots")
        for control, value in choices:
            choice = f"document.querySelector('[data-do={control}]')"
            page.run(f"{choice}.value = '{value}'; {choice}.dispatchEvent(happened('change')); 0")
            seen.append(page.drawn())
        assert len(set(seen)) == len(seen)
        page.run("document.querySelector('[data-do=reset]').click()")
        assert page.run("document.querySelector('[data-do=look]').value") == "whole"


def test_the_scene_names_the_contacts_that_touch(report: str, square_peg_plan_file: Path) -> None:
    run = {k: list(pieces) for k, pieces in groupby(fmopt.read(square_peg_plan_file).segments, key=lambda s: s.move)}
    with Page(report) as page:
        for pieces in run.values():
            said = page.run("document.querySelector('canvas').pen.strokes.filter(w => w.startsWith('text')).join('|')")
            lines = [line.split()[1:-2] for line in said.split("|")]
            named = sorted(name.strip(",") for line in lines for name in line if "-" in name)
            assert named == sorted({*pieces[0].state, *pieces[0].goal_state})
            places = [line.split()[-2:] for line in said.split("|") if "-" in line.split()[1]]
            assert len({tuple(place) for place in places}) == len(places)
            page.run("document.querySelector('[data-do=on]').click()")


def test_the_scene_turns_by_keyboard_and_by_pointer(report: str) -> None:
    with Page(report) as page:
        page.run("document.querySelector('canvas').focus()")
        seen = [page.drawn()]
        for key in ("ArrowLeft", "ArrowUp", "+", ".", "ArrowRight"):
            assert page.press(key)
            seen.append(page.drawn())
        assert len(set(seen)) == len(seen)
        assert not page.press("Tab")
        event = "happened('{}', {{clientX: {}, clientY: 5, pointerId: 1}})"
        drag = f"document.querySelector('canvas').dispatchEvent({event}); 0"
        for kind, x in (("pointerdown", 0), ("pointermove", 60), ("pointerup", 60)):
            page.run(drag.format(kind, x))
        turned = page.drawn()
        assert turned != seen[-1]
        page.run(drag.format("pointermove", 90))
        assert page.drawn() == turned


CHOOSE = "(c => { c.value = '%s'; c.dispatchEvent(happened('change')); })(document.querySelector('[data-do=%s]')); 0"
STROKES = "document.querySelector('canvas').pen.strokes.join('\\n')"
SAID = "document.querySelector('[data-say=move]').textContent"


def test_each_press_has_its_arrows_and_the_places_where_trials_came_to_rest(pages: dict[str, str]) -> None:
    with Page(pages["presses"]) as page:
        for number in range(1, 8):
            assert page.run(SAID).startswith(f"Move {number} of 11: ")
            assert re.search(r"^text [\d.]+ N ", page.run(STROKES), re.MULTILINE)
            # 73 trials seat; the one that does not is a cross where it came to the press.
            assert page.run(STROKES).count("\narc ") == 73
            page.run("document.querySelector('[data-do=on]').click()")
        for control, value, dots, numbers in (("cloud", "none", 0, True), ("names", "none", 0, False)):
            page.run(CHOOSE % (value, control))
            assert page.run(STROKES).count("\narc ") == dots
            assert (re.search(r"^text [\d.]+ N ", page.run(STROKES), re.MULTILINE) is not None) is numbers
        page.run(CHOOSE % ("end", "cloud"))
        whole = page.run(STROKES)
        page.run(CHOOSE % ("rests", "look"))
        (ruler,) = re.findall(r"^text ([\d.]+ \S+) ", page.run(STROKES), re.MULTILINE)[-1:]
        assert " µm" in ruler or float(ruler.split()[0]) < 0.1
        assert whole != page.run(STROKES)


@pytest.mark.parametrize("by", ["button", "choice", "cross"])
def test_a_trial_that_does_not_seat_is_shown_on_its_way(pages: dict[str, str], by: str) -> None:
    with Page(pages["presses"]) as page:
        page.run(CHOOSE % ("end", "cloud"))
        if by == "button":
            page.run("document.querySelector('[data-trial]').click()")
            assert page.run("page.seen === document.querySelector('.scene') && page.active.tagName") == "CANVAS"
        elif by == "choice":
            page.run(CHOOSE % ("vertex 63", "run"))
        else:
            x, y = re.findall(r"^arc (\S+) (\S+)", page.run(STROKES), re.MULTILINE)[-1]
            where = "{{clientX: 5, clientY: 5, pointerId: 1, offsetX: {}, offsetY: {}}}"
            event = f"document.querySelector('canvas').dispatchEvent(happened('{{}}', {where})); 0"
            for away in (900.0, 0.0):
                for kind in ("pointerdown", "pointerup"):
                    page.run(event.format(kind, float(x) + away, y))
                assert page.run("document.querySelector('[data-do=run]').value") == ("" if away else "vertex 63")
        moves = []
        for _ in range(4):
            moves.append(page.run(SAID))
            page.run("document.querySelector('[data-do=on]').click()")
        head = "Vertex 63 (stopped on the way, tilted; attempt 2, go in), move "
        assert [words.removeprefix(head).split(": ")[:2] for words in moves] == [
            ["1 of 5", "come down"], ["2 of 5", "turn upright"], ["3 of 5", "out along its way, to the next start."],
            ["4 of 5", "come down"],
        ]  # fmt: skip
        page.run(CHOOSE % ("", "run"))
        assert page.run(SAID).startswith("Move 1 of 11: come down: wrench towards −z ")


def test_a_drawing_of_a_part_and_a_slider_work_alone(pages: dict[str, str]) -> None:
    with Page(pages["part"]) as page:
        assert page.run("document.querySelector('canvas').pen.colours()") > 5
    with Page(pages["slider"]) as page:
        hidden = "JSON.stringify(document.querySelectorAll('img').map(image => image.hidden))"
        assert page.run(hidden) == "[false,true]"
        page.run("(i => { i.value = 1; i.dispatchEvent(happened('input')); })(document.querySelector('input'))")
        assert page.run(hidden) == "[true,false]"
        assert page.run("document.querySelector('input').getAttribute('aria-valuetext')") == "two"


def test_a_notebooks_picture_is_a_frame_that_may_run_scripts_and_nothing_else() -> None:
    (frame,) = [node for node in walk(Tree(str(fmopt.Plan(cube_plan())._repr_html_())).root) if node[0] == "iframe"]
    assert frame[1]["sandbox"] == "allow-scripts"
    with Page(frame[1]["srcdoc"]) as page:
        assert page.run("document.querySelector('canvas').pen.colours()") > 5


BAD: list[tuple[str, Any, str]] = [
    ("<script>undefinedName.x</script>", Thrown, "undefinedName"),
    ("<script>fetch('x')</script>", Thrown, "fetch"),
    ("<script>let x = ;</script>", Thrown, "SyntaxError"),
    ("<p><b>words</p>", AssertionError, "closes"),
    ("<p>words", AssertionError, "never closed"),
]


@pytest.mark.parametrize(("text", "kind", "said"), BAD)
def test_faults_of_a_page_are_noticed(text: str, kind: type[Exception], said: str) -> None:
    with pytest.raises(kind, match=said):
        Page(text)
