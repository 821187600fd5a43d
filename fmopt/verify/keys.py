"""What each key of a plan file counts for: proved, compared with the problem, or commentary."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

PROVED = "proved"  # derived again from what is compared, a choice that the proof rests on, or the format's only value
COMPARED = "compared with the problem"  # an assumption, which `verify --problem` holds against the problem
COMMENTARY = "commentary"  # of the right form, and judged by nobody
CLASSES = (PROVED, COMPARED, COMMENTARY)


@dataclass(frozen=True)
class Fields:
    """The keys that an object of a plan file may have.

    Attributes:
        where: its place, such as "segments[].tube".
        classes: what each key counts for; one whose value is an object or a list of such has the classes of its keys.
        required: the keys that must be there.
        known: all keys.
    """

    where: str
    classes: tuple[tuple[str, str], ...]
    required: tuple[str, ...]
    known: frozenset[str]


def fields(
    where: str,
    *,
    proved: str = "",
    compared: str = "",
    commentary: str = "",
    objects: str = "",
    optional: Iterable[str] = (),
) -> Fields:
    """The keys of an object, by class, separated by spaces.

    Args:
        where: its place in the plan.
        proved, compared, commentary: keys of these classes.
        objects: keys that hold objects, or lists of them, whose keys stand in fields of their own.
        optional: keys that may be missing.
    """
    told = ((PROVED, proved), (COMPARED, compared), (COMMENTARY, commentary))
    classes = tuple((key, kind) for kind, keys in told for key in keys.split())
    known = [key for key, _ in classes] + objects.split()
    missing = set(optional)
    return Fields(where, classes, tuple(key for key in known if key not in missing), frozenset(known))


def table(rows: Iterable[Fields]) -> list[str]:
    """A table in Markdown of what each key counts for, one line for each object and class."""
    lines = ["| where | counts as | keys |", "|---|---|---|"]
    for row in rows:
        for kind in CLASSES:
            keys = [f"`{key}`" for key, said in row.classes if said == kind]
            if keys:
                lines.append(f"| {f'`{row.where}`' if row.where else 'the plan'} | {kind} | {', '.join(keys)} |")
    return lines
