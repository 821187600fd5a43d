"""Problems of two parts and a start error, whose problem file is written, so that plans can be held against it."""

import json
import os
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from fmopt.errors import Fault, InputError
from fmopt.geometry.bodies import bodies_of
from fmopt.notebook.problem import Problem, load
from fmopt.runtime import output
from fmopt.task.mesh_source import MESHES
from fmopt.task.toml.model_file import STEP
from fmopt.task.toml.problem_file import error_of
from fmopt.task.toml.source import Place
from fmopt.task.toml.units import QuantityError

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import Unit

Size: TypeAlias = str | float
Named: TypeAlias = str | PathLike[str]
Part: TypeAlias = Named | Any
UNITLESS = frozenset(MESHES) - frozenset(STEP)
_UNITS = ("m", "cm", "mm", "um", "in")
_BODIES_ADVICE = "say which with --moving NAME and --fixed NAME, or by their numbers"


@dataclass(frozen=True)
class Asked:
    """Two parts, moving and fixed, and a start error, in place of a problem file; one file twice for an assembly.

    Units are of the numbers of mesh files, mm where not given; bodies go by name or number, None for the only one.
    """

    files: tuple[Path, Path]
    error: str
    units: tuple[str | None, str | None] = (None, None)
    bodies: tuple[str | None, str | None] = (None, None)

    def text(self, folder: Path) -> str:
        """The problem file that it stands for, as it would be in a folder.

        Raises:
            InputError: the error is not understood, the unit is none, or a file has a name that TOML cannot hold.
        """
        try:
            error_of(self.error)
        except QuantityError as error:
            raise wrong("--error", error.code, error.message, error.advice) from error
        moving, fixed = self.operands(folder)
        return "\n".join([*moving, *fixed, "[uncertainty]", f"start = {quoted(self.error)}", ""])

    def operands(self, folder: Path) -> list[list[str]]:
        """The tables [moving] and [fixed] of a problem file in a folder, line by line.

        Raises:
            InputError: the unit is none, or a file has a name that TOML cannot hold.
        """
        found = []
        for side, file, unit, body in zip(("moving", "fixed"), self.files, self.units, self.bodies, strict=True):
            lines = [f"[{side}]", f"model = {quoted(_from(file, folder))}"]
            if unit is not None and unit not in _UNITS:
                advice = f"write one of {', '.join(_UNITS)}"
                raise wrong("--unit", "unknown-unit", f"{unit!r} is no unit of a mesh", advice)
            # STEP files say their unit themselves, and model files are no meshes.
            if unit is not None and file.suffix.lower() in UNITLESS:
                lines.append(f"unit = {quoted(unit)}")
            if body is not None:
                lines.append(f"body = {int(body) if body.isdecimal() else quoted(body)}")
            found.append(lines)
        return found

    def written(self, file: Path) -> Problem:
        """The problem, its file written first.

        Raises:
            InputError: as of `fmopt.load`; the file stays, to be mended.
        """
        for part in self.files:
            _require_file(part)
        output.save(self.text(file.parent).encode(), file)
        return load(file)


def wrong(where: Path | str, code: str, message: str, advice: str) -> InputError:
    """What is wrong with a file or an option as a whole, as an error to be raised."""
    return InputError(Fault(str(where), 1, 1, "", code, message, advice))


def _from(file: Path, folder: Path) -> str:
    """A file as a problem file in a folder names it."""
    name = os.path.relpath(file.absolute(), folder.absolute())
    # A name in bytes that are no UTF-8 reaches Python with lone surrogates, which no TOML file can hold.
    try:
        name.encode()
    except UnicodeEncodeError:
        raise wrong(ascii(str(file)), "file-name", "its name is no text", "give the file another name") from None
    return Path(name).as_posix()


def _require_file(file: Path) -> None:
    if not file.is_file():
        what = "is no file" if file.exists() else "does not exist"
        advice = "name the two files of the parts: mesh (.stl, .obj, .ply), STEP or model files (.toml)"
        raise wrong(file, "file-missing", f"{file} {what}", advice)


def quoted(text: str) -> str:
    """A text as TOML has it."""
    # JSON's strings are TOML's, but for U+007F; its escapes of letters beyond U+FFFF are not, hence none are written.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def of_assembly(file: Path, error: str, moving: str | None, fixed: str | None, unit: str | None = None) -> Asked:
    """The question that an assembly asks: one of its bodies into another, as they stand there.

    Bodies are named, or numbered. Where neither of two is named, the one that goes into the other is found: the one
    with the peg; where both could, the smaller one moves. The unit is that of an OBJ file's numbers; mm if not given.

    Raises:
        InputError: there are too few or too many bodies to choose from, or one does not exist.
        ResourceError: no library that reads STEP files.
    """
    from fmopt.geometry.body_names import chosen, listed

    _require_file(file)
    with Place(str(file)).solid():
        found = bodies_of(file, unit)
        names = [body.name for body in found]
        known = listed(names)
        if len(found) < 2:
            raise wrong(file, "one-body", f"{file} holds one body", "name the file of the other part, too")
        picks = [None if which is None else chosen(names, which) for which in (moving, fixed)]
    rest = [n for n in range(len(found)) if n not in picks]
    if picks[0] is not None and picks[0] == picks[1]:
        message = f"{names[picks[0]] or picks[0] + 1!r} is to move and to stand"
        raise wrong(file, "conflict", message, f"name two of {known}")
    if None in picks and len(rest) != picks.count(None):
        named = {n for n in picks if n is not None}
        message = f"{file} holds {len(rest)} {'other ' if named else ''}bodies: {listed(names, named)}"
        raise wrong(file, "ambiguous", message, _BODIES_ADVICE)
    # Of two bodies the smaller one moves.
    smaller = iter(sorted(rest, key=lambda n: found[n].mesh.body.volume))
    picks = [next(smaller) if pick is None else pick for pick in picks]
    # Digits would be read as the number of a body: one whose name is digits goes by its number.
    called = [names[n] if names[n] and not names[n].isdecimal() else str(n + 1) for n in picks if n is not None]
    return Asked((file, file), error, (unit, unit), (called[0], called[1]))


def problem(
    peg: Part, hole: Part, error: str | tuple[Size, Size], unit: str | None = None, folder: Named | None = None
) -> Problem:
    """The problem of two parts and a start error; all the rest is found, as `explain` says.

    >>> folder = fmopt.example("square_peg").parent.parent / "models"
    >>> problem = fmopt.problem(folder / "square_peg.toml", folder / "square_hole_block.toml", ("0.3 mm", "0.3 deg"))
    >>> problem.hole.length, round(problem.measured.per_side, 9)
    (0.03, 0.0001)

    Args:
        peg: the part that moves: path of a mesh, STEP or model file; a mesh of trimesh or manifold3d; a solid of
            CadQuery or build123d; or a pair of an outline (n, 2) and a height.
        error: half-widths of the start error along and about every axis: a distance and an angle as text with their
            units, or in m and rad.
        unit: of the numbers of meshes and outlines that do not say it; mm if not given.
        folder: where the problem file goes that this stands for, and files of parts that have none; a temporary one if
            not given, which is there as long as the interpreter runs.

    Raises:
        InputError: with every fault.
        GeometryError: an object that is no part.
        ResourceError: a file cannot be written.
    """
    place = Path(folder) if folder is not None else output.own_folder()
    output.prepare(place)
    one, two = (_file(part, place / name, unit) for part, name in ((peg, "peg"), (hole, "hole")))
    if not isinstance(error, str):
        pairs = zip(error, ("m", "rad"), strict=True)
        error = ", ".join(size if isinstance(size, str) else f"{float(size)!r} {unit}" for size, unit in pairs)
    return Asked((one[0], two[0]), error, (one[1], two[1])).written(place / "problem.toml")


def _file(part: Part, stem: Path, unit: str | None) -> tuple[Path, str | None]:
    """The file of a part and the unit of its numbers; what stands in Python is written, with all of its digits."""
    if isinstance(part, str | PathLike):
        return Path(part), unit
    from fmopt.geometry.polyhedron import triangulated
    from fmopt.geometry.python_objects import imported_of, step_of

    target = stem.with_suffix(".step")
    if step_of(part, target, unit):
        return target, None
    known = unit or getattr(part, "units", None)
    mesh = imported_of(part, cast("Unit | None", unit) if known else "mm").body
    # Not STL, which has single precision, and corners that are not shared.
    target = stem.with_suffix(".ply")
    output.save(_ply(1e3 * mesh.vertices, triangulated(mesh)), target)
    return target, "mm" if known else None  # None: that mm are taken for granted is to be said


def _ply(points: Any, triangles: Any) -> bytes:
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    rows["count"], rows["corners"] = 3, triangles
    return head.encode() + np.ascontiguousarray(points, dtype="<f8").tobytes() + rows.tobytes()
