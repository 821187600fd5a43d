"""Names of bodies of a file that holds several: told apart, and chosen by name or number."""

from collections import Counter
from collections.abc import Container, Sequence

from fmopt.errors import GeometryError


def chosen(names: Sequence[str], which: str, file: object = "") -> int:
    """The index of the body that is meant by its name or its number, counted from 1, or by nothing where it is alone.

    Raises:
        GeometryError: it is not there, or there are several to choose from; says which, and names the file if given.
    """
    known, within = listed(names), f"{file}: " if file else ""
    if not which and len(names) == 1:
        return 0
    if not which:
        example = f'"{names[0]}"' if names[0] else "1"
        advice = f"say which by body = {example}, under [mesh], [moving] or [fixed], where the file is named"
        advice += "; or export one part on its own"
        raise GeometryError(f"{within}it holds {len(names)} bodies: {known}", advice)
    # Digits are a number: a body whose name is digits goes by its number.
    if which.isdecimal() and 1 <= int(which) <= len(names):
        return int(which) - 1
    if which in names:
        return names.index(which)
    raise GeometryError(f"{within}it has no body {which!r}", f"name one that it has, or give its number: {known}")


def listed(names: Sequence[str], left_out: Container[int] = ()) -> str:
    """Numbers, from 1, and names of bodies in words, but for those at some indices."""
    bodies = [(n, name) for n, name in enumerate(names) if n not in left_out]
    return ", ".join(f"{n + 1} {name!r}" if name else str(n + 1) for n, name in bodies)


def told_apart(names: Sequence[str]) -> list[str]:
    """Names that differ: of those that are the same, each gets its number among them as well."""
    often, taken, count = Counter(names), set(names), Counter[str]()
    told = []
    for own in names:
        name = own
        # Names are all taken from the beginning: each body of several gets a number, and none the name of another one.
        while name and often[own] > 1 and name in taken:
            count[own] += 1
            name = f"{own}_{count[own]}"
        taken.add(name)
        told.append(name)
    return told
