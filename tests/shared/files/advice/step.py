"""Advice on STEP files, followed: exported in another way, or as one body, or cut into fewer facets."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

from fmopt.geometry.mesh.mesh_import import load_mesh
from fmopt.geometry.step import step_import
from fmopt.geometry.step.facets import facets_of
from fmopt.geometry.step.step_import import load_step
from fmopt.spatial.se3 import Pose
from tests.shared.files.advice.case import Case, modelled, volume
from tests.shared.files.mesh_files import at, write_stl
from tests.shared.files.model_text import cuboid, difference, part
from tests.shared.files.step_files import write_step
from tests.shared.files.step_parts import box, cylinder, shell, write_assembly

SIZE, OTHER = 0.012 * 0.008 * 0.03, 0.04 * 0.036 * 0.01
AGAIN = "export it again, as AP203, AP214 or AP242; or export the part as STL"
LARGER = "give a larger 'deviation' under [mesh] of a model file"
SIMPLER = f"export one part on its own, with simpler surfaces, or {LARGER}"
RING, ROD, COARSE_ROD = 1.7201e-6, 3.38747e-6, 3.37116e-6  # what facets of these leave, m³


def block() -> Any:
    """A block of 12 x 8 x 30 mm."""
    return box(12.0, 8.0, 30.0)


def ring() -> Any:
    """A ring of 20 mm, 6 mm thick, all of it curved both ways."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeTorus

    return BRepPrimAPI_MakeTorus(10.0, 3.0).Shape()


def line() -> Any:
    """An edge that no face has."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.gp import gp_Pnt

    return BRepBuilderAPI_MakeEdge(gp_Pnt(0.0, 0.0, 0.0), gp_Pnt(0.0, 0.0, 9.0)).Edge()


def read(folder: Path, shape: Any, deviation: float = 1e-5) -> float:
    """The volume of a shape from a STEP file."""
    write_step(folder / "part.step", shape)
    return volume(load_step(folder / "part.step", deviation))


@cache
def exported() -> float:
    """The volume of the block from a STEP file as it should be, read once for all who are advised to write one."""
    with TemporaryDirectory() as folder:
        return read(Path(folder), block())


def as_stl(folder: Path) -> float:
    """The volume of the block from an STL file."""
    from fmopt.geometry.csg import Box

    write_stl(folder / "part.stl", Box((0.012, 0.008, 0.03)))
    return volume(load_mesh(folder / "part.stl", "mm"))


def either(folder: Path) -> tuple[float, float]:
    """The volume of the block from a STEP file, and from an STL file."""
    return exported(), as_stl(folder)


def in_schema(folder: Path, name: str) -> float:
    """The volume of the block from a STEP file by a schema."""
    from OCP.Interface import Interface_Static

    before = Interface_Static.CVal_s("write.step.schema")
    Interface_Static.SetCVal_s("write.step.schema", name)
    try:
        return read(folder, block())
    finally:
        Interface_Static.SetCVal_s("write.step.schema", before)


def unreadable(folder: Path) -> None:
    (folder / "part.step").write_text("ISO-10303-21;\nHEADER;\n")
    load_step(folder / "part.step")


def without_unit(folder: Path) -> None:
    path = folder / "part.step"
    write_step(path, block())
    path.write_text(path.read_text().replace("LENGTH_UNIT()", "MASS_UNIT()"))
    load_step(path)


def fit(folder: Path) -> Path:
    """A STEP file of two bodies, one of them called plate."""
    path = folder / "fit.step"
    write_assembly(path, [("plate", box(40.0, 36.0, 10.0), Pose.identity()), ("rod", block(), at(60.0))])
    return path


def of_the_fit(folder: Path, line_: str) -> float:
    """The volume of a body of two that a model file names so."""
    fit(folder)
    return volume(modelled(folder, f'[mesh]\nfile = "fit.step"\n{line_}'))


def named_bare(folder: Path, lines: str) -> float:
    """The volume of a body of two that a problem names so."""
    import fmopt

    fit(folder)
    (folder / "hole.toml").write_text(HOLE)
    start = '[uncertainty]\nstart = "0.02 mm, 0.02 deg"\n'
    (folder / "problem.toml").write_text(f'[moving]\nmodel = "fit.step"\n{lines}[fixed]\nmodel = "hole.toml"\n{start}')
    return volume(fmopt.load(folder / "problem.toml").moving)


HOLE = part(
    "plate",
    '[units]\nlength = "mm"\n',
    difference("plate", "whole", "hole"),
    cuboid("whole", "40, 40, 10"),
    cuboid("hole", "12.4, 8.4, 12", "0, 0, -1"),
)


def greedy(*_: str) -> int:
    """A kernel that asks for more than there is for it."""
    return len(bytearray(9 << 30))


def no_memory(folder: Path) -> None:
    kernel = replace(step_import._KERNEL, entry=f"{__name__}:greedy")
    with mock.patch.object(step_import, "_KERNEL", kernel):
        read(folder, ring())


def without_kernel(folder: Path) -> None:
    with (
        mock.patch.object(step_import, "find_spec", return_value=None),
        mock.patch.object(step_import, "version", side_effect=PackageNotFoundError),
    ):
        read(folder, block())


def few_facets(folder: Path, deviation: float) -> float:
    """The volume of a rod where no more than two hundred facets are taken."""
    with mock.patch.object(step_import, "MAX_TRIANGLES", 200):
        return read(folder, cylinder(6.0, 30.0), deviation)


def faceted(shape: Any) -> float:
    """How many facets a shape is cut into, all of them plane."""
    return float(len(facets_of(shape, 0.01)["triangles"]))


CASES = (
    Case(
        "no STEP file",
        "export it again, as AP203, AP214 or AP242",
        unreadable,
        lambda f: (in_schema(f, "AP203"), in_schema(f, "AP214IS"), in_schema(f, "AP242DIS")),
        (SIZE, SIZE, SIZE),
        slow=True,
    ),
    Case("no unit of lengths", AGAIN, without_unit, either, (SIZE, SIZE)),
    Case("no such STEP file", "check the path", lambda f: load_step(f / "prat.step"), lambda f: exported(), SIZE),
    Case("no kernel", "install fmopt[step], or export the part as STL", without_kernel, either, (SIZE, SIZE)),
    Case(
        "several bodies",
        'say which by body = "plate", under [mesh], [moving] or [fixed], where the file is named; or export one part '
        "on its own",
        lambda f: of_the_fit(f, ""),
        lambda f: (of_the_fit(f, 'body = "plate"'), named_bare(f, 'body = "rod"\n'), exported()),
        (OTHER, SIZE, SIZE),
        slow=True,
    ),
    Case(
        "no such body",
        "name one that it has, or give its number: 1 'plate', 2 'rod'",
        lambda f: of_the_fit(f, 'body = "rid"'),
        lambda f: (of_the_fit(f, 'body = "plate"'), of_the_fit(f, "body = 1")),
        (OTHER, OTHER),
        slow=True,
    ),
    Case("no solid", "export the solid, not its surfaces", lambda f: read(f, line()), lambda f: exported(), SIZE),
    Case(
        "an open surface",
        "close the surface where it was made, and export the solid",
        lambda f: read(f, shell(block(), 1)),
        lambda f: exported(),
        SIZE,
    ),
    Case(
        "a closed surface",
        "they close: export them as a solid, not as surfaces",
        lambda f: read(f, shell(block())),
        lambda f: exported(),
        SIZE,
    ),
    Case(
        "a solid with a lost face",
        "heal the solid where it was made",
        lambda f: facets_of(shell(block(), 1), 0.01),
        lambda f: faceted(block()),
        12.0,
    ),
    Case("more memory than there is", SIMPLER, no_memory, lambda f: (exported(), read(f, ring(), 2e-4)), (SIZE, RING)),
    Case(
        "finer than the kernel can",
        f"export it again, or {LARGER}",
        lambda f: read(f, cylinder(6.0, 30.0), 1e-11),
        lambda f: read(f, cylinder(6.0, 30.0), 1e-5),
        ROD,
        slow=True,
    ),
    Case("finer than is taken", LARGER, lambda f: few_facets(f, 1e-5), lambda f: few_facets(f, 1e-4), COARSE_ROD),
)
