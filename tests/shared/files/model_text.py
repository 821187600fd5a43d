"""The text of model files, table by table: units, solids and features."""

UNITS = '[units]\nlength = "mm"\nangle = "deg"\n'


def part(name: str, *tables: str) -> str:
    """The part that a solid of these tables is."""
    return f'part = "{name}"\n{"".join(tables)}'


def of_file(file: str, lines: str = 'unit = "mm"\n') -> str:
    """A model of a mesh or STEP file, called as it is; lines of text on how to read it."""
    return f'name = "{file.partition(".")[0]}"\n\n{UNITS}\n[mesh]\nfile = "{file}"\n{lines}'


def cuboid(name: str, size: str, at: str = "", turn: str = "") -> str:
    """A box among the solids."""
    return f'[solids.{name}]\nshape = "box"\nsize = [{size}]\n{_where(at, turn)}'


def difference(name: str, base: str, *tools: str) -> str:
    """A solid without others."""
    return f'[solids.{name}]\nshape = "difference"\nof = "{base}"\nminus = [{_listed(tools)}]\n'


def union(name: str, *solids: str) -> str:
    """Several solids in one."""
    return f'[solids.{name}]\nshape = "union"\nof = [{_listed(solids)}]\n'


def feature(name: str, kind: str, at: str, length: str, turn: str = "") -> str:
    """A solid or hollow feature."""
    return f'[features.{name}]\nkind = "{kind}"\n{_where(at, turn)}length = {length}\n'


def _where(at: str, turn: str) -> str:
    return "".join(f"{key} = [{value}]\n" for key, value in (("at", at), ("turn", turn)) if value)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(f'"{name}"' for name in names)
