"""Pages in a real browser: they open without an error, fetch nothing, play, and can be used by keyboard and by ear.

Collected where a Chromium is installed; tests/report/test_scripts.py checks the same pages everywhere.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

import fmopt
from tests.shared.pages import browser
from tests.shared.plans.report_plans import cube_plan, with_graph

CANVAS = "document.querySelector('canvas')"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Page]:
    with browser.browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, square_peg_plan_file: Path) -> Path:
    return fmopt.read(square_peg_plan_file).report(tmp_path_factory.mktemp("report") / "report.html")


def opened(page: browser.Page, file: Path) -> browser.Page:
    page.errors.clear()
    page.requests.clear()
    page.open(file)
    return page


def drawn(page: browser.Page) -> str:
    return str(page.run(f"{CANVAS}.toDataURL()"))


def test_a_report_opens_without_an_error_and_fetches_nothing(page: browser.Page, report: Path) -> None:
    opened(page, report)
    assert page.errors == []
    assert [url for url in page.requests if not url.startswith("data:")] == [report.as_uri()]
    assert report.stat().st_size < 3_000_000
    assert page.run("document.querySelectorAll('img').length") > 5
    assert page.run("[...document.images].every(image => image.complete && image.naturalWidth > 0)") is True


def test_errors_and_fetches_are_noticed(page: browser.Page, tmp_path: Path) -> None:
    bad = tmp_path / "bad.html"
    bad.write_text('<img src="missing.png"><script>undefinedName.x</script>', encoding="utf-8")
    opened(page, bad)
    page.until(lambda: len(page.requests) == 2)
    assert any("undefinedName" in error for error in page.errors)


def test_the_scene_plays_and_pauses(page: browser.Page, report: Path) -> None:
    opened(page, report)
    before = drawn(page)
    page.run("document.querySelector('[data-do=play]').click()")
    page.until(lambda: float(page.run("document.querySelector('.scene').dataset.way")) > 0.02)
    page.run("document.querySelector('[data-do=play]').click()")
    assert drawn(page) != before
    still = drawn(page)
    assert drawn(page) == still
    page.run("document.querySelector('[data-do=on]').click()")
    assert page.run("document.querySelector('[data-say=move]').textContent").startswith("Move 2 of ")
    assert page.errors == []


def test_the_scene_is_not_blank(page: browser.Page, report: Path) -> None:
    opened(page, report)
    colours = page.run(
        f"new Set(new Uint32Array({CANVAS}.getContext('2d').getImageData(0, 0, {CANVAS}.width, {CANVAS}.height)"
        ".data.buffer)).size"
    )
    assert colours > 10


def test_the_scene_turns_by_keyboard_alone(page: browser.Page, report: Path) -> None:
    opened(page, report)
    for _ in range(200):
        page.press("Tab")
        if page.run("document.activeElement.tagName") == "CANVAS":
            break
    assert page.run("document.activeElement.tagName") == "CANVAS"
    before = drawn(page)
    page.press("ArrowLeft")
    turned = drawn(page)
    page.press("+", "+")
    assert len({before, turned, drawn(page)}) == 3


def test_the_page_says_itself_to_a_screen_reader(page: browser.Page, report: Path) -> None:
    opened(page, report)
    nodes = page.call("Accessibility.getFullAXTree")["nodes"]
    seen = [(node.get("role", {}).get("value"), node.get("name", {}).get("value", "")) for node in nodes]
    headings = [name for role, name in seen if role == "heading"]
    assert headings[0].startswith("Square peg")
    assert "What was not checked" in headings
    named = ("image", "img", "button", "slider", "combobox", "table")
    assert [role for role, name in seen if role in named and not name] == []
    assert any(role == "navigation" for role, _ in seen)


def test_a_print_shows_the_words_without_the_controls(page: browser.Page, report: Path) -> None:
    opened(page, report)
    page.call("Emulation.setEmulatedMedia", media="print")
    shown = "getComputedStyle(document.querySelector('{}')).display"
    assert page.run(shown.format("nav")) == "none"
    assert page.run(shown.format(".scene-row")) == "none"
    assert page.run(shown.format(".verdict")) == "block"
    page.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("name", ["part", "slider"])
def test_other_pages_stand_alone_too(page: browser.Page, name: str, tmp_path: Path) -> None:
    plan = fmopt.Plan(with_graph())
    part = fmopt.load(fmopt.example("square_peg")).fixed
    frames = [("one", fmopt.show(plan, "margin")), ("two", fmopt.show(plan, "margin"))]
    drawing = fmopt.show(part, "scene") if name == "part" else fmopt.slider("place", frames)
    opened(page, drawing.save(tmp_path / f"{name}.html"))
    assert page.errors == []
    assert len([url for url in page.requests if not url.startswith("data:")]) == 1
    if name == "slider":
        hidden = "[...document.images].map(image => image.hidden)"
        assert page.run(hidden) == [False, True]
        page.run("(i => { i.value = 1; i.dispatchEvent(new Event('input')); })(document.querySelector('input'))")
        assert page.run(hidden) == [True, False]
    else:
        assert page.run("getComputedStyle(document.querySelector('[data-do=play]').parentElement).display") == "none"


def test_a_notebooks_picture_moves_inside_its_frame(page: browser.Page, tmp_path: Path) -> None:
    file = tmp_path / "cell.html"
    html = fmopt.Plan(cube_plan())._repr_html_()
    file.write_text(f'<!DOCTYPE html><meta charset="utf-8"><link rel="icon" href="data:,">{html}', encoding="utf-8")
    opened(page, file)
    assert page.errors == []
    assert page.run("document.querySelector('iframe').sandbox.value") == "allow-scripts"
