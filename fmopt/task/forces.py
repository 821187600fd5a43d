"""Forces of a problem's specification that do not go together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from fmopt.errors import Fault
from fmopt.task import problem_file as files
from fmopt.task.tables import in_words
from fmopt.task.toml_source import Source
from fmopt.task.units import FORCE

_IMPACT = ("impact_force", "apparent_mass", "contact_stiffness")


def force_faults(source: Source, table: files.Specification) -> Iterator[Fault]:
    """The faults of forces that end moves, and of those that limit impacts."""
    yield from _end_faults(source, table)
    yield from _impact_faults(source, table)


def _end_faults(source: Source, table: files.Specification) -> Iterator[Fault]:
    """A force that ends moves which no push within the contact force brings about."""
    wanted, most = table.termination_force, table.contact_force
    if wanted > most:
        message = f"{in_words(wanted, FORCE)} on the contact that ends a move exceed the contact force"
        advice = f"lower it to well below {in_words(most, FORCE)}, or raise contact_force"
        yield source.place(("specification", "termination_force")).fault("out-of-range", message, advice)


def _impact_faults(source: Source, table: files.Specification) -> Iterator[Fault]:
    """A limit on impacts without what meets there, or the other way round."""
    stated = [name for name in _IMPACT if getattr(table, name) is not None]
    for name in _IMPACT if stated else ():
        if name not in stated:
            place = source.place(("specification",), of_key=True)
            message, advice = "this key is missing", f"add {name!r} to [specification], or drop {stated[0]!r}"
            yield replace(place, key=f"specification.{name}").fault("missing-key", message, advice)
