"""Text of plans in pages, figures, notebooks and the terminal: whatever it is, it stays text there.

The plans are made as values, past the reader, which refuses most of what is written into them here.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import fmopt
from fmopt.cli import console
from fmopt.plan import Plan, parsed
from fmopt.report.figures import figures
from fmopt.report.page import report_page
from fmopt.report.scene import scene_data
from tests.shared.plans.report_plans import altered, cube_plan, diagnostics, with_graph

EVIL = (
    '"\'`></script><script>alert(1)</script>"><img src=x onerror=alert(1)> onload=x {{name}}{{kind}}{{label}}\\',
    "<!-- </style>]]>&lt;\u2028\u2029\r\n\x1b[2J\x1b]0;x\x07\x9b1A\u202e[red]$\\frac{x}[/] -->",
)
# Of these the reader takes certain words only, and what is drawn goes by them.
CHOSEN = {"verdict", "kind", "plane", "on", "role", "axis", "change", "name of Sensitivity", "sha256", "problem"}
SVG = {"svg", "defs", "style", "g", "path", "use", "clipPath", "rect", "metadata", "RDF", "Work", "type", "format"}
SVG |= {"creator", "Agent", "title", "pattern", "image"}


def told() -> Plan:
    """A plan that tells all that a plan may tell in free words."""
    said = {
        **with_graph()["description"]["diagnostics"],
        "imported": ["found: a hole"],
        "tolerated": {"factor": 1.5, "start_box": [1e-3] * 6, "sensitivities": []}
        | {"end": {"move": 1, "binding": "pieces 0/1", "reason": "the tube is too wide"}},
        "reduced": {"share": 0.6, "stated_start_box": [0.03, 0, 0, 0, 0.09, 0], "short": "nothing was found"},
        "planar": planar(),
    }
    recovery = {"lift": None, "why": "it cannot", "retries": [], "covers": [0.0] * 6, "moves": []}
    return parsed(cube_plan(diagnostics=diagnostics(**said), recovery={**recovery, "not_covered": ["a dropped part"]}))


def planar() -> dict[str, Any]:
    phase = {"kind": "fine", "start": 0.0, "end": 1.0, "contacts": ["v1-e3"]}
    times = {"both": 1.0, "neither": 0.0, "only_possible": 0.0, "only_stopped": 0.0}
    loop = [{"on": "line", "line": [0.0, 0.0, 1.0, 0.0]}, {"on": "r_M", "arc": [0.5, 0.0, 0.5, 0.0, 3.0]}]
    set_ = {"name": "Uv of vertex 1", "loops": [loop], "nominal": []}
    slices = [{"phi": phi, "boundary": set_} for phi in (0.0, 0.1)]
    return {
        "position": 1e-3,
        "angle": 0.1,
        "nominal": [phase],
        "agreement": {**times, "agrees": True, "words": "they agree"},
        "segments": [{"kind": "fine", "phases": [phase]}] * 3,
        "aside": 1e-3,
        "height": 0.0,
        "sets": [set_],
        "surfaces": [{"contact": "v1-e3", "kind": "type-1", "slices": slices}],
    }


def texts(value: Any, of: str = "") -> Iterator[str]:
    """Every text of a plan but those chosen from certain words."""
    if isinstance(value, str):
        yield value
    elif is_dataclass(value):
        for one in fields(value):
            if one.name not in CHOSEN and f"{one.name} of {type(value).__name__}" not in CHOSEN:
                yield from texts(getattr(value, one.name), one.name)
    elif isinstance(value, tuple):
        for item in value:
            yield from texts(item, of)


def changed(value: Any, words: Mapping[str, str]) -> Any:
    """The value with texts replaced by others, names and what they name alike."""
    if isinstance(value, str):
        return words.get(value, value)
    if is_dataclass(value) and not isinstance(value, type):
        kept = {one.name for one in fields(value) if one.name in CHOSEN}
        kept |= {one.name for one in fields(value) if f"{one.name} of {type(value).__name__}" in CHOSEN}
        found = {f.name: changed(getattr(value, f.name), words) for f in fields(value) if f.name not in kept}
        return altered(value, **found)
    return tuple(changed(item, words) for item in value) if isinstance(value, tuple) else value


PLAN = told()
TEXTS = sorted(set(texts(PLAN)) - {""})


class Elements(HTMLParser):
    """What a browser makes elements, attributes, scripts, data and comments of."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.scripts: list[str] = []
        self.data: list[Any] = []
        self.comments = 0
        self.text = ""
        self.inside = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert not [name for name, _ in attrs if name.startswith("on")]
        assert all((value or "").startswith(("#", "data:")) for name, value in attrs if name in ("src", "href"))
        if tag not in ("span", "wbr"):  # about the names of contacts and in long words
            self.tags[f"{tag} {sorted(name for name, _ in attrs)}"] += 1
        kind = dict(attrs).get("type")
        self.inside = "data" if kind == "application/json" else tag if tag in ("script", "style") else ""

    def handle_endtag(self, tag: str) -> None:
        self.inside = ""

    def handle_data(self, data: str) -> None:
        if self.inside == "data":
            self.data.append(json.loads(data))
        elif self.inside == "script":
            self.scripts.append(data.split("showScene(document")[0])
        elif not self.inside:
            self.text += data

    def handle_comment(self, data: str) -> None:
        self.comments += 1

    @property
    def shape(self) -> tuple[Any, ...]:
        """All that no text of a plan may change."""
        return self.tags, self.scripts, self.comments


PLAIN = Elements(report_page(PLAN, {}))


@pytest.mark.parametrize("evil", EVIL)
def test_every_text_of_a_plan_stays_text_in_its_page(evil: str) -> None:
    assert len(TEXTS) > 30
    for old in TEXTS:
        plan = changed(PLAN, {old: evil})
        found = Elements(report_page(plan, {}))
        assert found.shape == PLAIN.shape, old
        assert found.data == [json.loads(json.dumps(scene_data(plan)))]
    title = changed(PLAN, {PLAN.title: evil})
    assert " ".join(evil.split()) in " ".join(Elements(report_page(title, {})).text.split())


def test_every_text_of_a_plan_stays_text_in_its_figures() -> None:
    plan = changed(PLAN, {old: f"{EVIL[k % 2]}{k}" for k, old in enumerate(TEXTS)})
    drawn = figures(plan)
    assert [*drawn] == ["cut", "states", "margin", "tube", "budget", "sets", "surfaces", "trajectory"]
    for name, svg in drawn.items():
        for node in ElementTree.fromstring(svg).iter():
            assert str(node.tag).rpartition("}")[2] in SVG, name
            assert not [key for key in node.attrib if key.lower().startswith("on")]
            links = [value for key, value in node.attrib.items() if key.endswith("href")]
            assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    assert Elements(report_page(plan, drawn)).scripts == PLAIN.scripts


@pytest.mark.parametrize("evil", EVIL)
def test_every_text_of_a_plan_stays_text_in_a_notebook(evil: str) -> None:
    plain, plan = fmopt.Plan(cube_plan()), fmopt.Plan(cube_plan())
    object.__setattr__(plan, "stated", changed(plain.stated, {old: f"{evil}{k}" for k, old in enumerate(TEXTS)}))
    for before, after in zip((plain, *plain.segments), (plan, *plan.segments), strict=True):
        assert Elements(after._repr_html_()).shape == Elements(before._repr_html_()).shape
    page, frame = (fmopt.show(plan, "scene").html(), fmopt.show(plan, "scene")._repr_html_())
    assert Elements(page).shape == Elements(fmopt.show(plain, "scene").html()).shape
    assert [*Elements(frame).tags] == ["iframe ['sandbox', 'srcdoc', 'style', 'title']"]


@pytest.mark.parametrize("evil", EVIL)
def test_every_text_of_a_plan_stays_text_in_the_terminal(evil: str, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ({old: f"{evil}{k}" for k, old in enumerate(TEXTS)}, {PLAN.title: evil}):
        console.print_solved(changed(PLAN, words), [evil], Path(f"out{evil}"), report=True)
        said = capsys.readouterr().out
        assert [letter for letter in said if letter != "\n" and not letter.isprintable()] == []
        assert "CERTIFIED: least margin" in said
    assert evil is EVIL[0] or "[red]" in said.replace("\n", "")


def test_lines_for_people_do_not_steer_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    from fmopt.cli.entry import say

    say("one\ntwo" + EVIL[1].replace("\n", ""))
    said = capsys.readouterr().out
    assert said.count("\n") == 2
    assert [letter for letter in said if letter != "\n" and not letter.isprintable()] == []
