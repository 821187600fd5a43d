"""Every fault of problem and model files is provoked once: its code, place, message and advice are read."""

from itertools import pairwise
from pathlib import Path

import pytest

from fmopt.errors import Fault, InputError
from fmopt.task.problem import load
from tests import ROOT

PROBLEM, PEG, BLOCK = "problems/square_peg.toml", "models/square_peg.toml", "models/square_hole_block.toml"

Texts = dict[str, str]


@pytest.fixture
def texts() -> Texts:
    return {name: (ROOT / name).read_text(encoding="utf-8") for name in (PROBLEM, PEG, BLOCK)}


def faults(tmp_path: Path, texts: Texts) -> tuple[Fault, ...]:
    for name, text in texts.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(tmp_path / PROBLEM)
    assert caught.value.exit_code == 2
    return caught.value.faults


def changed(text: str, old: str, new: str) -> tuple[str, int, int]:
    """The text with `old` replaced, and the line and column of «…» in `new`, which is then taken as written."""
    assert text.count(old) == 1
    before = text[: text.index(old)] + new[: new.index("«")]
    text = text.replace(old, new.replace("«", "").replace("»", ""))
    return text, before.count("\n") + 1, len(before) - before.rfind("\n")


VALUES = [
    ("rx = 0.3", "rx = «nan»", "not-finite", "nan is not a finite number"),
    ("rx = 0.3", "rx = «inf»", "not-finite", "inf is not a finite number"),
    ("rx = 0.3", "rx = «1e400»", "not-finite", "inf is not a finite number"),
    ("rx = 0.3", "rx = «-1»", "negative", "-1 is negative; make it zero or positive"),
    ("rx = 0.3", "rx = «50»", "out-of-range", "50 is too large; keep it at most 28.6478897 deg"),
    ("rx = 0.3", 'rx = «"0.3 mm"»', "wrong-unit", "'0.3 mm' is a length, not an angle; write a number, or text"),
    ("height = 1", "height = «-5»", "negative", "-5 is negative; make it positive"),
    ("height = 1", "height = «0»", "zero", "0 is zero; make it positive"),
    ("height = 1", "height = «1e-12»", "out-of-range", "too small; keep it at least 1e-06 mm, and check the unit"),
    ("height = 1", 'height = «"-5 mm"»', "negative", "'-5 mm' = -5 mm is negative"),
    ("height = 1", 'height = «"5 kg"»', "wrong-unit", "'5 kg' is a mass, not a length"),
    ("height = 1", 'height = «"5 foo"»', "unknown-unit", "'foo' is no unit"),
    ("height = 1", 'height = «"five"»', "expression", "'five' is not a number"),
    ("height = 1", 'height = «"5"»', "wrong-unit", "'5' is a plain number, not a length"),
    ("height = 1", "height = «true»", "wrong-type", "a boolean stands where a length is asked for"),
    ("height = 1", "height = «[5]»", "wrong-type", "an array stands where a length is asked for"),
    ("height = 1", "height = «{ mm = 5 }»", "wrong-type", "a table stands where a length is asked for"),
    ("height = 1", "height = «2020-01-01»", "wrong-type", "a date or time stands where a length is asked for"),
    ("speed = 20", "speed = «1e9»", "out-of-range", "keep it at most 100000 mm/s"),
    ("speed = 20", "speed = «1e-6»", "out-of-range", "keep it at least 0.001 mm/s"),
    ("on_force = 2", "on_force = «20.5»", "out-of-range", "20.5 N on the contact that ends a move exceed the contact"),
    ("friction = 0.3", "friction = «-0.3»", "negative", "-0.3 is negative"),
    ("\nx = 0.3", "\nx = «400»", "out-of-range", "the start error along x is 400 mm; check [units], or write the unit"),
    ("torque_limit = 1", 'torque_limit = «"5 N"»', "wrong-unit", "is a force, not a torque"),
    ("translation = 0.01", "translation = «1.5»", "out-of-range", "1.5 is too large; keep it at most 1"),
    ('method = "sound"', 'method = «"loud"»', "unknown-choice", "'loud' is none of the choices; write 'sound' or"),
    ('length = "mm"', 'length = «"furlong"»', "unknown-choice", "'furlong' is none of the choices; write 'm', 'cm'"),
    ('depth = "full"', 'depth = «"half"»', "expression", "'half' is not a number"),
    ('depth = "full"', "depth = «31»", "out-of-range", "31 mm is deeper than hole and peg allow, 30 mm; lower it"),
    ('feature = "peg"', 'feature = «"pge"»', "unknown-feature", "no feature 'pge'; did you mean 'peg'?"),
    ('feature = "peg"', "feature = «1»", "wrong-type", "a number stands here; write text"),
    ('feature = "peg"', 'feature = «"a b"»', "bad-name", "'a b' is no name"),
    ('title = "Square', 'title = «"\\u001b[31mSquare', "bad-name", "is no name"),
    ("square_peg.toml", "«»no_peg.toml", "file-missing", "models/no_peg.toml does not exist; correct the path"),
    ("square_peg.toml", "«»", "file-kind", "models is a directory; name a file"),
    ("square_peg.toml", "«»a\\u0000b.toml", "file-missing", "is no file name"),
    ('"../models/square_peg.toml"', "«3»", "wrong-type", "a number stands here; write text"),
    ("[goal]", "«[goal]»]", "toml-syntax", "Expected newline or end of document"),
]


@pytest.mark.parametrize(("old", "new", "code", "words"), VALUES, ids=[f"{row[2]}-{row[1]}" for row in VALUES])
def test_faults_of_values(tmp_path: Path, texts: Texts, old: str, new: str, code: str, words: str) -> None:
    texts[PROBLEM], line, column = changed(texts[PROBLEM], old, new)
    (fault,) = faults(tmp_path, texts)
    if old == "square_peg.toml":
        column -= len('"../models/')
    if code == "toml-syntax":
        column += len("[goal]")
    assert (fault.file, fault.line, fault.column, fault.code) == (str(tmp_path / PROBLEM), line, column, code)
    assert words in str(fault)
    assert fault.advice


KEYS = [
    ("height = 1", "«heigth» = 5", "unknown-key", "start.heigth", "did you mean 'height'?"),
    ("max_tilt = 12", "«zzz» = 12", "unknown-key", "settings.zzz", "known keys here: method, placement, max_tilt"),
    ("[goal]", "[«wishes»]\n[goal]", "unknown-key", "wishes", "known keys here: title, units"),
    ("\n[goal]", "\n[moving.«parameter»]\n[goal]", "unknown-key", "moving.parameter", "did you mean 'parameters'?"),
]


@pytest.mark.parametrize(("old", "new", "code", "key", "words"), KEYS)
def test_unknown_keys(tmp_path: Path, texts: Texts, old: str, new: str, code: str, key: str, words: str) -> None:
    texts[PROBLEM], line, column = changed(texts[PROBLEM], old, new)
    found = [fault for fault in faults(tmp_path, texts) if fault.code == code]
    assert [(fault.line, fault.column, fault.key) for fault in found] == [(line, column, key)]
    assert words in found[0].advice


@pytest.mark.parametrize(
    ("old", "key", "line", "column", "advice"),
    [
        ("\ny = 0.3\n", "uncertainty.start.y", 27, 14, "add 'y' to [uncertainty.start], or 'position' for all three"),
        ("\nrx = 0.3\n", "uncertainty.start.rx", 27, 14, "add 'rx' to [uncertainty.start], or 'angle' for all three"),
        ("\nry = 0.3\n", "uncertainty.start.ry", 27, 14, "add 'ry' to [uncertainty.start], or 'angle' for all three"),
        ("\nrz = 0.3\n", "uncertainty.start.rz", 27, 14, "add 'rz' to [uncertainty.start], or 'angle' for all three"),
        ("z = 0\n", "uncertainty.start.z", 27, 14, "add 'z' to [uncertainty.start], or 'position' for all three axes"),
        ('model = "../models/square_peg.toml"\n', "moving.model", 9, 2, "add 'model' to [moving]"),
    ],
)
def test_missing_keys(tmp_path: Path, texts: Texts, old: str, key: str, line: int, column: int, advice: str) -> None:
    texts[PROBLEM] = texts[PROBLEM].replace(old, "\n" * old.startswith("\n"))
    (fault,) = faults(tmp_path, texts)
    assert (fault.line, fault.column, fault.key, fault.code) == (line, column, key, "missing-key")
    assert advice in fault.advice


MODEL_FAULTS = [
    ("width = 20.2", "width = «nan»", "not-finite", "nan is not a finite number"),
    ("width = 20.2", "width = «true»", "wrong-type", "a boolean stands where a length is asked for"),
    ("width = 20.2", '«"wi dth"» = 1\nwidth = 20.2', "bad-name", "'wi dth' is no name; use up to 64 letters, digits"),
    ("depth = 30", 'depth = «"dpeth / 2"»', "unknown-parameter", "there is no parameter 'dpeth'"),
    ("depth = 30", 'depth = «"30 kg"»', "wrong-unit", "is a mass"),
    ('["block_x"', '[«"blok_x"»', "unknown-parameter", "there is no parameter 'blok_x'; did you mean 'block_x'?"),
    ('["block_x"', '[«"block_x - 60 mm"»', "zero", "'block_x - 60 mm' = 0 mm is zero; make it positive"),
    ('["block_x"', '[«"block_x * block_x"»', "wrong-unit", "is an area, not a length"),
    ('["block_x"', "[«-60»", "negative", "-60 is negative; make it positive"),
    ('["block_x", "block_y", "block_z"]', '«["block_x", "block_y"]»', "wrong-length", "there are 2 entries"),
    ('["block_x", "block_y", "block_z"]', "«[1, 2, 3, 4]»", "wrong-length", "there are 4 entries"),
    ('["block_x", "block_y", "block_z"]', "«3»", "wrong-type", "a number stands here; write an array"),
    ('[solids.hole]\nshape = "box"', "[solids.«hole»]", "missing-key", "the key 'shape' is"),
    ('[solids.hole]\nshape = "box"', '[solids.«hole»]\nshape = "bix"', "unknown-choice", "there is no shape 'bix'"),
    ('of = "block"', 'of = «"blck"»', "unknown-solid", "there is no solid 'blck'; did you mean 'block'?"),
    ('minus = ["hole"]', 'minus = [«"whole"»]', "unknown-solid", "no solid 'whole'; did you mean 'hole'?"),
    ('part = "drilled"', 'part = «"drill"»', "unknown-solid", "no solid 'drill'; did you mean 'drilled'?"),
    (
        '[solids.drilled]\nshape = "difference"\nof = "block"',
        '[solids.«drilled»]\nshape = "difference"\nof = "drilled"',
        "cycle",
        "the solid 'drilled' is made of itself",
    ),
    (
        "[features.hole]",
        '[solids.«spare»]\nshape = "box"\nsize = [1, 1, 1]\n[features.hole]',
        "unused-solid",
        "nothing uses the solid 'spare'",
    ),
    ('part = "drilled"', "«»", "missing-key", "name the solid that the part is"),
    ('kind = "hollow"', 'kind = "hollow"\nthrouhg = true', "unknown-key", "did you mean 'through'?"),
    ('kind = "hollow"', 'kind = «"hole"»', "unknown-choice", "write 'solid' or 'hollow'"),
    ("[features.hole]", '[«mesh»]\nfile = "x.stl"\nunit = "mm"\n[features.hole]', "conflict", "both solids and a mesh"),
    ('minus = ["hole"]', 'minus = ["hole", "block"]', "geometry", "empty"),
]


@pytest.mark.parametrize(
    ("old", "new", "code", "words"), MODEL_FAULTS, ids=[f"{row[2]}-{row[1]}" for row in MODEL_FAULTS]
)
def test_faults_of_models(tmp_path: Path, texts: Texts, old: str, new: str, code: str, words: str) -> None:
    place = None
    if "«" in new:
        texts[BLOCK], *place = changed(texts[BLOCK], old, new)
    else:
        texts[BLOCK] = texts[BLOCK].replace(old, new)
    if old == 'part = "drilled"' and not new.strip("«»"):
        place = [1, 1]
    (fault,) = [fault for fault in faults(tmp_path, texts) if fault.code == code]
    assert fault.file == str(tmp_path / BLOCK)
    assert place is None or [fault.line, fault.column] == place
    assert words in str(fault)
    assert fault.advice


def test_all_faults_at_once_in_order_of_place(tmp_path: Path, texts: Texts) -> None:
    texts[PROBLEM] = texts[PROBLEM].replace("height = 1", "height = -5").replace("rx = 0.3", "rx = nan")
    texts[PROBLEM] = texts[PROBLEM].replace("time_limit = 600", "time_limt = 600")
    texts[PEG] = texts[PEG].replace("length = 40", "length = inf")
    texts[BLOCK] = texts[BLOCK].replace('kind = "hollow"', 'kind = "hole"').replace("width = 20.2", "width = 0")
    found = faults(tmp_path, texts)
    assert list(found) == sorted(found)
    assert [(Path(fault.file).name, fault.code) for fault in found] == [
        ("square_hole_block.toml", "zero"),
        ("square_hole_block.toml", "zero"),
        ("square_hole_block.toml", "unknown-choice"),
        ("square_peg.toml", "not-finite"),
        ("square_peg.toml", "negative"),
        ("square_peg.toml", "not-finite"),
        ("square_peg.toml", "unknown-key"),
    ]


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        ("lenght = 3", "unknown-parameter", "no parameter 'lenght'; did you mean 'length'?"),
        ("width = nan", "not-finite", "nan is not a finite number"),
        ('width = "3 deg"', "wrong-unit", "an angle replaces a length of the model"),
        ('width = "length"', "expression", "'length' is not a number"),
    ],
)
def test_overridden_parameters(tmp_path: Path, texts: Texts, given: str, code: str, words: str) -> None:
    texts[PROBLEM] = texts[PROBLEM].replace("[fixed]", f"[moving.parameters]\n{given}\n\n[fixed]")
    found = [fault for fault in faults(tmp_path, texts) if fault.code == code and fault.file.endswith(PROBLEM)]
    assert [(fault.line, fault.column) for fault in found] == [(14, given.index("=") + 3)]
    assert words in str(found[0])


@pytest.mark.parametrize("both", [False, True])
def test_the_start_error_is_described_once(tmp_path: Path, texts: Texts, both: bool) -> None:
    text = texts[PROBLEM]
    sources = "[uncertainty.sources]\nrobot = { position = 0.1 }\ngrasp = { height = 30 }\n"
    start = text[text.index("[uncertainty.start]") : text.index("[uncertainty.velocity]")]
    texts[PROBLEM] = text.replace(start, start + sources if both else "")
    (fault,) = faults(tmp_path, texts)
    assert fault.code == "conflict"
    assert fault.message == ("the start error is described twice" if both else "the start error is not described")


@pytest.mark.parametrize(
    ("side", "model", "other", "kind"), [("fixed", PEG, "peg", "solid"), ("moving", BLOCK, "hole", "hollow")]
)
def test_two_features_of_one_kind(tmp_path: Path, texts: Texts, side: str, model: str, other: str, kind: str) -> None:
    start = texts[PROBLEM].index(f"[{side}]")
    table = f'[{side}]\nmodel = "../{model}"\nfeature = "{other}"\n\n'
    end = texts[PROBLEM].index("[", start + 1)
    texts[PROBLEM] = texts[PROBLEM][:start] + table + texts[PROBLEM][end:]
    (fault,) = faults(tmp_path, texts)
    assert (fault.line, fault.column, fault.code) == (11, 11, "feature-kind")
    assert fault.message == f"{other!r} and {other!r} are both {kind}"


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        ("configuration = { known = 0.1, position = 0.2 }", "conflict", "states position and known"),
        ("feeder = { }", "conflict", "states nothing"),
        ("feeder = { known = 0.1, angle = 1 }", "conflict", "'angle' stands without 'position'"),
        (
            "configuration = { observed = { points = [[0, 0, 0], [1, 1, 1], [2, 2, 2]], deviation = 0.1 } }",
            "bad-value",
            "lie on a line",
        ),
        ("configuration = { observed = { points = [[0, 0, 0]], deviation = 0.1 } }", "wrong-length", "1 entries"),
        ("feeder = { placed = [] }", "wrong-length", "0 entries"),
        ('feeder = { known = "1 deg" }', "wrong-unit", "is an angle, not a length"),
        ("feeder = { position = 0.1, angel = 1 }", "unknown-key", "did you mean 'angle'"),
        ("configuration = { known = 50 }", "out-of-range", "most of it by: fixed part, configuration known a priori"),
    ],
)
def test_sources_that_make_no_sense(tmp_path: Path, texts: Texts, given: str, code: str, words: str) -> None:
    text = texts[PROBLEM]
    start, end = text.index("[uncertainty.start]"), text.index("[uncertainty.velocity]")
    sources = f"[uncertainty.sources]\n{given}\nrobot = {{ position = 0.1 }}\ngrasp = {{ height = 30 }}\n"
    texts[PROBLEM] = text[:start] + sources + text[end:]
    (fault,) = faults(tmp_path, texts)
    assert fault.code == code
    assert words in str(fault)
    assert fault.line >= text[:start].count("\n") + 1
    assert fault.advice


def test_a_tree_that_explodes_is_refused(tmp_path: Path, texts: Texts) -> None:
    names = ["block", *(f"u{i}" for i in range(60))]
    doubled = "".join(f'[solids.{name}]\nshape = "union"\nof = ["{one}", "{one}"]\n' for one, name in pairwise(names))
    texts[BLOCK] = texts[BLOCK].replace('of = "block"', 'of = "u59"') + doubled
    (fault,) = faults(tmp_path, texts)
    assert (fault.code, fault.line, fault.column) == ("too-large", 5, 8)


def test_an_open_mesh_and_a_missing_one(tmp_path: Path, texts: Texts) -> None:
    start, end = texts[PEG].index("[solids.peg]"), texts[PEG].index("[features.peg]")
    texts[PEG] = (
        texts[PEG][:start].replace('part = "peg"\n', "") + '[mesh]\nfile = "x.stl"\nunit = "mm"\n\n' + texts[PEG][end:]
    )
    (fault,) = faults(tmp_path, texts)
    assert (fault.code, fault.line, fault.column) == ("file-missing", 15, 8)
    triangle = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    (tmp_path / "models" / "x.stl").write_text(f"solid x\n{triangle}endsolid x\n")
    (fault,) = faults(tmp_path, texts)
    assert (fault.code, fault.line, fault.column) == ("geometry", 15, 8)
    assert "open" in fault.message
