"""Files that others wrote, whole, odd and damaged: what is read, what is refused and where, and in what time."""

import time
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from fmopt.errors import FmoptError, GeometryError, ResourceError, SizeError
from fmopt.geometry.mesh.mesh_file import read_triangles
from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.mesh.surface import MAX_TRIANGLES
from fmopt.geometry.step import step_import as step
from fmopt.runtime import confined
from tests.shared.files.mesh_files import binary_ply, binary_stl, obj_text, ply_text, rounded, stl_text, triangles_of
from tests.shared.files.shipped import edit
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box
from tests.shared.fuzz.files import KINDS, fuzzed, run

POINTS, TRIANGLES = triangles_of(rounded((0.012, 0.008), 0.03))
OBJ, PLY, STL = obj_text(POINTS, TRIANGLES), ply_text(POINTS, TRIANGLES), stl_text(POINTS, TRIANGLES)
COUNTS = {"problem": 25, "model": 25, "assembly": 6, "study": 15, "allocation": 25, "plan": 40, "step": 4, "glb": 4}


def written(folder: Path, name: str, content: bytes | str) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("times", [1, pytest.param(10, marks=pytest.mark.wide)])
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_end_with_an_exit_code_and_a_message(kind: str, times: int, tmp_path: Path) -> None:
    codes, failures = fuzzed(kind, times * COUNTS.get(kind, 30), times, tmp_path)
    assert failures == []
    assert codes[2] > codes[0] / 4


def mixed(content: bytes) -> bytes:
    """The lines, each with another end than the one before."""
    return b"".join(map(bytes.__add__, content.split(b"\n"), cycle((b"\r\n", b"\r", b"\n"))))


QUADS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
QUADS += "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
WHOLE: dict[str, tuple[str, bytes]] = {
    "latin-1 comment": ("a.obj", b"# gr\xfc\xdfe \xb2\n" + OBJ.encode()),
    "latin-1 names": ("a.obj", OBJ.replace("o part", "o d\xe9coup\xe9").encode("latin-1")),
    "mixed line ends": ("a.obj", mixed(OBJ.encode())),
    "normals and textures": ("a.obj", OBJ.replace("\nf ", "\nf  ").replace(" 1 ", " 1/1/1 ").encode()),
    "back from the last": (
        "a.obj",
        "\n".join(
            " ".join(["f", *(str(int(i) - 1 - len(POINTS)) for i in row.split()[1:])]) if row.startswith("f") else row
            for row in OBJ.split("\n")
        ).encode(),
    ),
    "continued lines": ("a.obj", OBJ.replace("\nf 1 ", "\nf \\\n1 ").encode()),
    "latin-1 in a PLY": ("a.ply", PLY.replace("ply\n", "ply\ncomment \xe9\nobj_info \xb2\n", 1).encode("latin-1")),
    "PLY, small end first": ("a.ply", binary_ply(POINTS, TRIANGLES, "<")),
    "PLY, big end first": ("a.ply", binary_ply(POINTS, TRIANGLES, ">")),
    "STL in capitals": ("a.stl", STL.upper().encode()),
    "STL, named in latin-1": ("a.stl", STL.replace("solid part", "solid Gr\xf6\xdfe").encode("latin-1")),
    "binary STL that begins with solid": ("a.stl", b"solid " + binary_stl(POINTS, TRIANGLES)[6:]),
}


@pytest.mark.parametrize("name", WHOLE)
def test_odd_files_are_read(name: str, tmp_path: Path) -> None:
    file, content = WHOLE[name]
    body = load_mesh(written(tmp_path, file, content), "mm").body
    assert (len(body.faces), body.volume) == (6, pytest.approx(0.012 * 0.008 * 0.03, rel=1e-6))


def test_polygons_become_triangles_and_idle_points_go(tmp_path: Path) -> None:
    points, triangles = read_triangles(written(tmp_path, "a.obj", QUADS + "v 9 9 9\nf 1 2 3 4 4\n"))
    assert len(points) == 8
    assert triangles.tolist()[:2] == [[3, 2, 1], [1, 0, 3]]
    assert len(triangles) == 15


BROKEN: tuple[tuple[str, str, bytes, str], ...] = (
    ("no number", "a.obj", b"v 1 2 nan\n", "line 1: 'nan' is no finite number"),
    ("superscript", "a.obj", "v 1 2 3\nv 1 2 ²\n".encode(), "line 2: '.*' is no finite number"),
    ("underscore", "a.obj", b"v 1 2 1_0\n", "'1_0' is no finite number"),
    ("beyond doubles", "a.obj", b"v 1 2 1e400\n", r"line 1: a coordinate is not a number of at most 1e\+09"),
    ("a thousand digits", "a.obj", b"v 1 2 " + b"9" * 1000 + b"\n", "is no finite number"),
    ("index 0", "a.obj", b"v 0 0 0\nf 0 1 1\n", "line 2: a face names point 0 when there are 1, counted from 1"),
    ("index beyond", "a.obj", b"v 0 0 0\nf 1 1 7\n", "triangle 0 names point 6 of 1, counted from 0"),
    ("index far beyond", "a.obj", b"v 0 0 0\nf 1 1 99999999999\n", "is no index"),
    ("index too far back", "a.obj", b"v 0 0 0\nf 1 1 -2\n", "names point -2"),
    ("two corners", "a.obj", b"v 0 0 0\nf 1 1\n", "line 2: a face has 2 corners"),
    ("no keyword", "a.obj", b"w 0 0 0\n", "line 1: 'w' is no keyword of OBJ files"),
    ("nothing", "a.obj", b"# nothing\n", "holds no triangles"),
    ("a long line", "a.obj", b"v " + b"1 " * 200_000, "line 1: the line has 400002 bytes"),
    ("not whole", "a.stl", STL.encode()[: STL.index("endsolid")], "ends without 'endsolid'"),
    ("a lost line", "a.stl", STL.replace("endloop\n", "", 1).encode(), "line 7: 'endfacet' stands where 'endloop'"),
    ("two coordinates", "a.stl", b"solid\nfacet normal 0 0 1\nouter loop\nvertex 1 2\n", "line 4: a vertex has 2"),
    ("count that lies", "a.stl", binary_stl(POINTS, TRIANGLES)[:-50], "the header says 12 triangles, and the file"),
    ("too short", "a.stl", b"\x00" * 50, "nor long enough"),
    ("no header", "a.ply", b"ply\n" + b"x" * 300_000, "no header from 'ply' to 'end_header'"),
    ("no format", "a.ply", PLY.replace("format ascii 1.0\n", "").encode(), "line 2: the header is not understood"),
    ("no axis", "a.ply", PLY.replace("double z", "double w").encode(), "'vertex' has no property 'z'"),
    ("lists of numbers", "a.ply", PLY.replace("list uchar", "list a").encode(), "header is not understood"),
    ("a huge count", "a.ply", PLY.replace("vertex 8", "vertex 99999999").encode(), "the header says 99999999"),
    ("more rows said", "a.ply", PLY.replace("face 12", "face 13").encode(), "face 12 of 13: early end-of-file"),
    ("fewer rows said", "a.ply", PLY.replace("face 12", "face 11").encode(), "goes on after what its header tells"),
    ("cut", "a.ply", binary_ply(POINTS, TRIANGLES, "<")[:-5], "face 11 of 12: early end-of-file"),
    ("a negative corner", "a.ply", PLY.replace("\n3 ", "\n3 -", 1).encode(), "a face names point -"),
)


@pytest.mark.parametrize(("file", "content", "words"), [row[1:] for row in BROKEN], ids=[row[0] for row in BROKEN])
def test_broken_files_are_refused_with_the_place(file: str, content: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=words):
        read_triangles(written(tmp_path, file, content))


def heaps() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points and triangles that bound nothing, in numbers that would take for ever to look at in pairs."""
    rng = np.random.default_rng(1)
    count = 30_000
    loose = np.arange(3 * count).reshape(-1, 3)
    near = 1e-9 * rng.normal(size=(3 * count, 3))
    near[:2] = [[10.0, 0.0, 0.0], [-10.0, 0.0, 0.0]]
    small = rng.uniform(-10.0, 10.0, (count, 1, 3)) + rng.uniform(-0.01, 0.01, (count, 3, 3))
    return {
        "all over each other": (rng.uniform(-10.0, 10.0, (3 * count, 3)), loose),
        "confetti": (small.reshape(-1, 3), loose),
        "almost one point": (near, loose),
        "one triangle": (np.tile(np.eye(3), (count, 1)), loose),
        "a few points": (rng.uniform(-10.0, 10.0, (60, 3)), rng.integers(0, 60, (count, 3))),
    }


@pytest.mark.parametrize("name", heaps())
def test_heaps_of_triangles_are_refused_in_bounded_time(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, "a.stl", binary_stl(*heaps()[name]))
    began = time.process_time()
    with pytest.raises(GeometryError):
        load_mesh(path, "mm")
    assert time.process_time() - began < 30.0


def test_more_triangles_than_a_part_has_are_refused(tmp_path: Path) -> None:
    many = np.zeros((MAX_TRIANGLES + 1, 3), dtype=np.int64)
    with pytest.raises(GeometryError, match="there are 100001 triangles, more than 100000"):
        read_triangles(written(tmp_path, "a.stl", binary_stl(POINTS, many)))


MESH = "stl", "plate.toml", "unit", "plate.toml:9:8: implausible-size: mesh.unit: the part is 40", "problem.toml"
MODEL = "problem", "models/square_hole_block.toml", "length", "units.length: the part is 60", "problems/square_peg.toml"


@pytest.mark.parametrize(("unit", "words"), [("m", "m long, more than 4 m"), ("um", "µm long, less than 100 µm")])
@pytest.mark.parametrize(("kind", "file", "key", "said", "problem"), [MESH, MODEL], ids=["mesh", "model"])
def test_an_implausible_size_is_told_with_its_unit(
    kind: str, file: str, key: str, said: str, problem: str, unit: str, words: str, tmp_path: Path
) -> None:
    KINDS[kind](tmp_path)
    edit(Path(file), f'{key} = "mm"', f'{key} = "{unit}"')
    for command in ("check", "solve"):
        code, output = run((command, problem))
        assert code == 2
        assert f"{said} {words}; in mm it would be {said[-2:]} mm" in output
        assert f'set {key} = "mm" if that is meant' in output


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("problems/square_peg.toml", "height = 1", "height = 4001", "start.height: 4001 is too large; keep it at most"),
        ("problems/square_peg.toml", "\nx = 0.3", "\nx = 501", "keep it at most 500 mm"),
        ("problems/square_peg.toml", "rx = 0.3", "rx = 30", "keep it at most 28.6478897 deg"),
        ("models/square_peg.toml", "at = [0, 0, 0]", "at = [0, 4.1e3, 0]", "the part reaches 4.1"),
    ],
)
def test_the_check_refuses_what_no_plan_can_say(file: str, old: str, new: str, words: str, tmp_path: Path) -> None:
    KINDS["problem"](tmp_path)
    edit(Path(file), old, new)
    code, said = run(("check", "problems/square_peg.toml"))
    assert code == 2
    assert "out-of-range" in said
    assert words in said


def test_a_step_file_in_another_unit_is_told(tmp_path: Path) -> None:
    write_step(tmp_path / "block.step", box(40.0, 40.0, 10.0))
    edit(tmp_path / "block.step", ".MILLI.,.METRE.", "$,.METRE.")
    with pytest.raises(SizeError, match="the part is 40 m long, more than 4 m"):
        step.load_step(tmp_path / "block.step")


@pytest.mark.parametrize(
    ("does", "error", "words"),
    [
        ("import os; os.kill(os.getpid(), 11)", GeometryError, r"breaks down on it \(SIGSEGV\); export it again"),
        ("import os; os.abort()", GeometryError, r"breaks down on it \(SIGABRT\)"),
        ("import resource as r; r.setrlimit(r.RLIMIT_CPU, (1, 9))\nwhile True: pass", GeometryError, "comes to no end"),
        ("import time; time.sleep(99)", GeometryError, "has not read it in 2 s; export one part on its own"),
        ("import os; os.kill(os.getpid(), 9)", ResourceError, "was ended by SIGKILL; free memory"),
        ("raise KeyError(5)", FmoptError, "ended with exit code 1: KeyError: 5"),
        ("bytearray(9 << 30)", GeometryError, "the kernel needs more than 4 GiB for it; export one part on its own"),
    ],
)
def test_what_befalls_a_reader_befalls_no_other(
    does: str, error: type[FmoptError], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "does.py").write_text(does)
    monkeypatch.setattr(confined, "SECONDS", 2.0 if "sleep" in does else 60.0)
    reader = confined.FileReader("the kernel", "runpy:run_path", "export one part on its own", "export it again")
    with pytest.raises(error, match=f"does.py: .*{words}"):
        confined.read(tmp_path / "does.py", reader)


def test_a_solid_of_next_to_no_thickness_is_refused(tmp_path: Path) -> None:
    KINDS["model"](tmp_path)
    edit(Path("models/keyed_shaft.toml"), "across = 20 ", "across = 2e-8 ")
    code, said = run(("check", "problems/keyed_shaft.toml"))
    assert code == 2
    assert "models/keyed_shaft.toml" in said
