"""Advice of the geometry room is followed to the letter, and what was refused is taken; each advice that there is."""

from pathlib import Path

import pytest

from fmopt.errors import FmoptError
from tests.shared.files.advice import meshes, objects, outlines, solids, step
from tests.shared.files.advice.case import Case, advice_of
from tests.shared.files.advice.given import Given, given

CASES = (*meshes.CASES, *step.CASES, *objects.CASES, *solids.CASES, *outlines.CASES)
UNFOLLOWED = {  # advice that no test can follow, and why
    "install it anew: pip install --force-reinstall --no-deps {}=={}": "an installation that is broken",
    "install the package anew that it comes from, or export the part as STL": "an installation that is broken",
    "export the bodies as they are, each by itself": "no program at hand writes bodies that are mirrored or scaled",
    "report the model: its faces do not close": "a fault of this program: convex bodies are made closed",
    "check both outlines": "outlines are refused before walls are made between them, unless they are all but one line",
    "name files of one part each, to have another fit found": "an undercut stays one: test_fit",
    "mend the files; or {}": "sections that shapely cannot unite",
}


@pytest.mark.parametrize(
    "case", [pytest.param(one, id=one.name, marks=pytest.mark.wide if one.slow else ()) for one in CASES]
)
def test_advice_that_is_followed_helps(case: Case, tmp_path: Path) -> None:
    with pytest.raises(FmoptError) as told:
        case.wrong(tmp_path)
    assert advice_of(told.value) == case.advice
    assert case.followed(tmp_path) == pytest.approx(case.gives, rel=1e-3)


def test_all_advice_is_followed() -> None:
    known = given("geometry")
    assert len(known) > 90
    told = [*(case.advice for case in CASES), *UNFOLLOWED]
    assert [one for one in known if not any(one.says(text) for text in told)] == []
    assert [text for text in told if not any(one.says(text) for one in known)] == []


def test_advice_is_seen_however_it_is_put_together(tmp_path: Path) -> None:
    """In a constant, a sum, a choice, what a function returns or takes by default, an answer; not what is handed on."""
    (tmp_path / "other.py").write_text('FAR = "from afar"\n')
    (tmp_path / "room.py").write_text(SOURCE)
    found = given(str(tmp_path))
    assert {one.pattern.replace("\\", "") for one in found} == {
        *("plain", "named", "from a keyword", "grown longer", "one way", "the other way", "returned", "by default"),
        *("answered", "for .+ of them", "as a fault", "by code", "did you", "or else", "the third", "maybe"),
        *("maybe not", "passed on"),
    }
    assert Given("", 1, "for .+ of them").says("for 3 of them")
    assert not Given("", 1, "plain").says("plainer")


SOURCE = """
NAMED = "named"

def f(x, error, mesh, advice="by default"):
    longer = "grown"
    longer += " longer"
    if x:
        raise GeometryError("wrong", "plain")
    if x > 1:
        raise GeometryError("wrong", NAMED) from InterferenceError("wrong", 0.0, "there", longer)
    if x > 2:
        raise ResourceError("wrong", advice="from a keyword")
    if x > 3:
        raise GeometryError("wrong", "one way" if x else "the other way") from mesh.fault("wrong", "as a fault")
    if x > 4:
        raise GeometryError(*g()) from SizeError("wrong", 1.0, f"for {x} of them")
    if x > 5:
        return {"message": "wrong", "advice": "answered"}
    if x > 6:
        raise QuantityError("code", "wrong", "by code") from place.fault("code", "wrong", did(x) or "or else")
    if x > 7:
        code, message, said = h()
        raise place.fault(code, message, said)
    if x > 8:
        some = "maybe"
        if x > 9:
            some += " not"
        raise GeometryError("wrong", some) from misplaced("unit", "passed on")
    raise GeometryError("wrong", error.advice) from GeometryError("wrong", advice)

def did(x):
    return "did you" if x else ""

def h():
    return "code", "wrong", "the third"

def misplaced(name, advice):
    return place.fault("code", "wrong", advice)

def g():
    return "wrong", "returned"
"""
