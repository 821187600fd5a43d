"""One part by itself: read from a mesh, STEP or model file, and what is found on it in words and as data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmopt.errors import FmoptError, InputError
from fmopt.geometry.bodies import bodies_of, lie_apart
from fmopt.plan import STDIO
from fmopt.task.explain import aligned, mm
from fmopt.task.mesh_source import MESHES
from fmopt.task.model import Bare, load_model
from fmopt.task.solid_tree import build_part, build_tree
from fmopt.task.toml.model_file import STEP
from fmopt.task.toml.source import Place, read

if TYPE_CHECKING:
    from fmopt.geometry.part import Part

_FEW_REFLEX = 24  # reflex edges of a part that is cut into convex pieces in a second
_OF_PART = {"features", "solids", "mesh", "profile", "part", "parameters"}


def is_part(file: Path) -> bool:
    """Whether a file is one part, a mesh, STEP or model file, to go by its name and its tables."""
    if file.suffix.lower() in MESHES:
        return True
    if file == STDIO or file.suffix.lower() != ".toml":
        return False
    data = read(file).data
    return bool(_OF_PART & set(data)) and not {"moving", "fixed", "objects", "tasks"} & set(data)


def load_part(file: Path, unit: str | None = None) -> tuple[Part, ...]:
    """The part of a file in its model's frame, of an assembly (STEP, OBJ) all of its bodies, with what is found on it.

    Raises:
        InputError: with every fault.
        ResourceError: no library that reads STEP files.
    """
    names: list[str | None] = [None]
    if holds_several(file) and file.is_file():  # of no file the reader of models says what is wrong
        with Place(str(file)).solid():
            found = bodies_of(file, unit)
        names = [body.name or str(body.number) for body in found] if len(found) > 1 else names
    return tuple(_loaded(file, Bare(unit, name)) for name in names)


def holds_several(file: Path) -> bool:
    """Whether a file is one of STEP, or a mesh of several bodies; what is wrong with it is told by who reads it."""
    if file.suffix.lower() in STEP:
        return True
    try:
        return file.suffix.lower() in MESHES and lie_apart(file)
    except FmoptError:
        return False


def _loaded(file: Path, said: Bare) -> Part:
    model, faults = load_model(file, Place(str(file)), {}, said)
    if model is None:
        raise InputError(*faults)
    part = build_part(model.source, model.file, few=_FEW_REFLEX)  # what is in its hollows is not known yet
    if part.features:
        build_tree(model.source, model.file)  # for its faults: nothing here needs the tree
    return replace(part, notes=(*model.notes, *part.notes))


def part_words(part: Part) -> str:
    """What is found on a part, one statement a line, lengths in mm and angles in degrees."""
    shape = part.polyhedron
    extent = " x ".join(map(mm, shape.widths.tolist()))
    pieces = "1 convex piece" if len(part.pieces) == 1 else f"{len(part.pieces) or 'no'} convex pieces"
    pieces += "" if part.pieces else " before it is known what it mates with"
    off = f"facets lie up to {mm(part.chord_error)} mm off the true surface, which adds to the start error"
    form = f"faces lie up to {1e6 * part.form:.3g} µm off the facets of the file, which margins lose"
    features = [
        f"{one.name}: {one.kind}, {mm(one.length)} mm long, at ({', '.join(map(mm, one.frame.p.tolist()))}) mm"
        for one in part.features
    ]
    counts = f"{len(shape.faces)} faces, {len(shape.edges)} edges, {len(shape.vertices)} corners"
    rows = [
        ("part", f"{part.name}: {extent} mm, volume {1e9 * shape.volume:.6g} mm3"),
        ("surface", f"{counts}, closed; {pieces}"),
        ("deviation", off if part.chord_error else "none: every face is plane"),
        *([("form", form)] if part.form else []),
        *(("feature", words) for words in features or ["none stated: what goes where is found with the other part"]),
        *(("", note) for note in part.notes),
    ]
    return aligned(*rows)


def part_facts(part: Part) -> dict[str, Any]:
    """The same as data, in SI units, poses as (x, y, z, rotation vector) in the model's frame."""
    shape = part.polyhedron
    return {
        "name": part.name,
        "extent": shape.widths.tolist(),
        "volume": shape.volume,
        "faces": len(shape.faces),
        "edges": len(shape.edges),
        "vertices": len(shape.vertices),
        "convex_pieces": len(part.pieces),
        "deviation": part.chord_error,
        "form": part.form,
        "features": [{**vars(one), "frame": one.frame.vector().tolist()} for one in part.features],
        "notes": list(part.notes),
    }
