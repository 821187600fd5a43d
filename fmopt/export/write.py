"""`fmopt export`: a plan into one of the formats, where it belongs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmopt import plan
from fmopt.se3 import Pose

FORMATS = ("urscript", "ros2", "csv", "json")
_NAMES = {"urscript": "plan.script", "ros2": "ros2", "csv": "samples.csv", "json": "samples.json"}


def export(file: Path, to: str, out: Path | None, base: tuple[float, ...] | None, rate: float) -> tuple[Path, ...]:
    """Writes a plan in another format.

    Args:
        file: plan file.
        to: one of `FORMATS`.
        out: file, or folder for ros2; None for one beside the plan.
        base: pose (x, y, z, rx, ry, rz) of the hole's frame in the robot's base, m and rad; None for tables.
        rate: samples a second.

    Returns:
        The files and folders that were written.

    Raises:
        ValueError: the format is unknown, or it is for robots and the base is missing.
        FmoptError: the plan cannot be read, exported or written.
    """
    if to not in FORMATS:
        raise ValueError(f"{to!r} is no format; choose from {', '.join(FORMATS)}")
    return exported(plan.read(file), to, out if out is not None else file.parent / _NAMES[to], base, rate)


def exported(
    document: Mapping[str, Any], to: str, target: Path, base: tuple[float, ...] | None, rate: float
) -> tuple[Path, ...]:
    """Writes a plan document in another format to `target`; arguments and errors as of `export`."""
    if to not in FORMATS:
        raise ValueError(f"{to!r} is no format; choose from {', '.join(FORMATS)}")
    if to in ("csv", "json"):
        return _table(document, to, target, rate)
    if base is None:
        raise ValueError(f"{to} needs the hole's frame in the robot's base: give --base X Y Z RX RY RZ, in m and rad")
    if to == "ros2":
        from fmopt.export import ros2

        return ros2.export(document, Pose.from_vector(base), rate, target)
    from fmopt.export.urscript import program

    plan.save(program(document, Pose.from_vector(base)).encode(), target)
    return (target,)


def _table(document: Mapping[str, Any], to: str, target: Path, rate: float) -> tuple[Path, ...]:
    from fmopt.export.sampled import csv_text, json_text

    plan.save((csv_text if to == "csv" else json_text)(document, rate).encode(), target)
    return (target,)
