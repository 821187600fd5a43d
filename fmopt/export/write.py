"""`fmopt export`: a plan into one of the formats, where it belongs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from fmopt import output, plan
from fmopt.export.cautions import base_pose, insertion_words, turning_words, verdict_words
from fmopt.guarded.moves import moves

FORMATS = ("urscript", "ros2", "csv", "json")
_TABLES = ("csv", "json")
_NAMES = {"urscript": "plan.script", "ros2": "ros2", "csv": "samples.csv", "json": "samples.json"}


class Written(NamedTuple):
    """What was written.

    Args:
        paths: files and folders; none where the text is for standard output.
        notes: what to know before a robot runs them.
        text: for standard output; empty where there are files.
    """

    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    text: str = ""


def export(file: Path, to: str, out: Path | None, base: tuple[float, ...] | None, rate: float) -> Written:
    """Writes a plan in another format.

    Args:
        file: plan file.
        to: one of `FORMATS`.
        out: file, or folder for ros2; None for one beside the plan, "-" for the text itself.
        base: pose (x, y, z, rx, ry, rz) of the hole's frame in the robot's base, m and rad; None for tables.
        rate: samples a second.

    Raises:
        ValueError: the format is unknown, or it is for robots and the base is missing or in other units, or `out` is
            the plan.
        FmoptError: the plan cannot be read, exported or written.
    """
    if to not in FORMATS:
        raise ValueError(f"{to!r} is no format; choose from {', '.join(FORMATS)}")
    target = out if out is not None else file.parent / _NAMES[to]
    if target.resolve() == file.resolve() and out != plan.STDIO:
        raise ValueError(f"--out is {file}, the plan itself, which would be lost")
    document = plan.read_document(file)
    text = text_of(document, to, base, rate) if out == plan.STDIO else ""
    paths = () if out == plan.STDIO else exported(document, to, target, base, rate)
    if base is None or to in _TABLES:
        return Written(paths, () if base is None else (f"{to} is in the hole's frame: --base is not used",), text)
    notes = (*verdict_words(document), insertion_words(base_pose(base)), _turning(document, to))
    return Written(paths, notes, text)


def _turning(document: Mapping[str, Any], to: str) -> str:
    """The greatest turning rate of what was written."""
    from fmopt.export.urscript import commanded

    rows = moves(plan.parsed(document))
    return turning_words(commanded(rows) if to == "urscript" else [m.twist for m in rows], [m.number for m in rows])


def exported(
    document: Mapping[str, Any], to: str, target: Path, base: tuple[float, ...] | None, rate: float
) -> tuple[Path, ...]:
    """Writes a plan document in another format to `target`, and says what was written; the rest as of `export`."""
    if to == "ros2":
        from fmopt.export import ros2

        return ros2.export(document, base_pose(_given(base, to)), rate, target)
    output.save(text_of(document, to, base, rate).encode(), target)
    return (target,)


def text_of(document: Mapping[str, Any], to: str, base: tuple[float, ...] | None, rate: float) -> str:
    """A plan document as the text of another format; the rest as of `export`."""
    if to not in FORMATS:
        raise ValueError(f"{to!r} is no format; choose from {', '.join(FORMATS)}")
    if to == "ros2":
        raise ValueError("ros2 is several files: --out has to be a folder")
    if to in _TABLES:
        from fmopt.export.sampled import csv_text, json_text

        return (csv_text if to == "csv" else json_text)(document, rate)
    from fmopt.export.urscript import program

    return program(document, base_pose(_given(base, to)))


def _given(base: tuple[float, ...] | None, to: str) -> tuple[float, ...]:
    if base is None:
        raise ValueError(f"{to} needs the hole's frame in the robot's base: give --base X Y Z RX RY RZ, in m and rad")
    return base
