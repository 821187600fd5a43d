"""Models: a model file with its parameters bound, checked as a whole, and the part it describes.

Mating features that a model file leaves to be found are found with the other part of a problem.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from fmopt.errors import Fault, InputError, SizeError
from fmopt.geometry.bodies import MAX_MESH_BYTES
from fmopt.geometry.section import require_plausible
from fmopt.task.mesh_source import MESHES, OWN_UNIT, assumed, called, mesh_faults, takes
from fmopt.task.sizes import implausible
from fmopt.task.solid_tree import build_part, part_reach, tree_faults
from fmopt.task.toml.model_file import ModelFile, ProfileTable
from fmopt.task.toml.source import Key, Place, Source, read, read_bytes
from fmopt.task.toml.tables import Reading, checked
from fmopt.task.toml.units import RATIO, UNITS, Quantity, QuantityError, did_you_mean

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import Imported

USUAL_UNIT = "mm"  # of the numbers of a mesh file for which nobody says one


@dataclass(frozen=True)
class Model:
    """A valid model file with its parameters bound, or a mesh or STEP file in place of one that would name it."""

    source: Source
    file: ModelFile
    given: bool = True
    notes: tuple[str, ...] = ()
    mesh: "Imported | None" = None

    @property
    def kind(self) -> str:
        """What its shape is read from, in a word."""
        mesh = self.file.mesh
        return "part" if mesh is None else "STEP file" if mesh.is_step else "mesh"


@dataclass(frozen=True)
class Override:
    """A parameter's value as a problem gives it, and where."""

    value: Quantity
    place: Place


@dataclass(frozen=True)
class Bare:
    """What a problem says of a mesh or STEP file that it names itself: the unit of its numbers, or which body of it."""

    unit: str | None = None
    body: str | int | None = None
    places: Mapping[str, Place] = field(default_factory=dict)

    @staticmethod
    def of(source: Source, key: Key) -> "Bare":
        """What a problem says in a table, as far as it is right; the rest is told elsewhere."""
        table = source.get(key)
        unit, body = table.get("unit"), table.get("body")
        known = isinstance(unit, str) and unit in UNITS["length"][1]
        named = isinstance(body, str | int) and not isinstance(body, bool)  # TOML's true is an int to Python
        places = {name: source.place((*key, name), of_key=True) for name in ("unit", "body")}
        return Bare(unit if known else None, body if named else None, places)

    def misplaced(self, name: str, cited: Place, message: str, advice: str) -> list[Fault]:
        """The fault of the unit or the body, where one is stated for a file that takes none."""
        place = self.places.get(name, cited)
        return [] if getattr(self, name) is None else [place.fault("conflict", message, advice)]


def load_model(
    path: Path, cited: Place, overrides: Mapping[str, Override], said: Bare = Bare()
) -> tuple[Model | None, list[Fault]]:
    """A model file with parameters overridden, or all its faults.

    A mesh or STEP file is taken for a part without parameters, whose features are found.

    Raises:
        InputError: the file cannot be read or is not TOML.
    """
    if path.suffix.lower() in MESHES:
        return _bare(path, cited, said, overrides)
    source = read(path, cited)
    if {"moving", "fixed"} <= set(source.data):
        advice = "name a model file, which describes one part by [solids], [mesh] or [profile] and its [features]"
        raise InputError(source.place(()).fault("file-kind", "this is a problem file, not a model", advice))
    reading, faults = _parameters(source, replace(Reading.of(source.data), names={}), overrides)
    file, more = checked(ModelFile, source, reading)
    faults += more
    there = ", or put it under [mesh] of the model file"
    for name in ("unit", "body"):
        advice = f"leave {name!r} out{there if file and file.mesh and takes(file.mesh, name) else ''}"
        faults += said.misplaced(name, cited, "this is for mesh and STEP files", advice)
    if file is not None:
        file = file if file.name else file.model_copy(update={"name": called(path.stem)})
        faults += _cross_checks(source, file)
        if file.mesh is None and not faults:  # the size of a mesh is looked at as it is read
            faults += _size_faults(source, file)
    return (Model(source, file) if file is not None and not faults else None), faults


def _bare(path: Path, cited: Place, said: Bare, overrides: Mapping[str, Override]) -> tuple[Model | None, list[Fault]]:
    """The model that a mesh or STEP file is by itself."""
    read_bytes(path, cited, MAX_MESH_BYTES)
    advice = "name a model file, or leave it out"
    message = f"{path.name} has no parameters"
    faults = [given.place.fault("unknown-parameter", message, advice) for given in overrides.values()]
    own = path.suffix.lower() in OWN_UNIT
    if own:
        faults += said.misplaced("unit", cited, f"{path.name} says its unit itself", "leave 'unit' out")
    table: dict[str, object] = {"file": path.name}
    if said.body is not None:
        table["body"] = said.body
    if not own:
        table["unit"] = said.unit or USUAL_UNIT
    name = called(said.body if isinstance(said.body, str) else path.stem)
    source = Source(path, {"name": name, "mesh": table}, {}, {})  # without places: nobody wrote it
    file, more = checked(ModelFile, source, Reading())
    if file is None or faults or more:
        return None, [*faults, *more]
    notes = () if own or said.unit is not None else (assumed(source, build_part(source, file, few=-1)),)
    return Model(source, file, given=False, notes=notes), []


def overrides_of(source: Source, reading: Reading, key: Key) -> tuple[dict[str, Override], list[Fault]]:
    """The parameter values that a file gives for a model in the table at `key`, and those that are at fault."""
    table: object = source.data
    for part in key:
        table = table.get(part) if isinstance(table, Mapping) else None
    overrides: dict[str, Override] = {}
    faults: list[Fault] = []
    for name, raw in (table if isinstance(table, Mapping) else {}).items():
        place = source.place((*key, name))
        try:
            overrides[name] = Override(reading.quantity(raw, None), place)
        except QuantityError as error:
            faults.append(place.fault(error.code, error.message, error.advice))
    return overrides, faults


def parameter_values(source: Source) -> Mapping[str, Quantity]:
    """The parameters of a model file by name, as the file gives them; those at fault are left out."""
    reading, _ = _parameters(source, replace(Reading.of(source.data), names={}), {})
    return reading.names or {}


def _parameters(source: Source, reading: Reading, overrides: Mapping[str, Override]) -> tuple[Reading, list[Fault]]:
    """The reading with the parameters of the file, in its order, each seeing those above it."""
    table = source.data.get("parameters", {})
    names: dict[str, Quantity] = {}
    broken: set[str] = set()
    faults: list[Fault] = []
    for name, raw in (table if isinstance(table, Mapping) else {}).items():
        above = replace(reading, names=names, broken=frozenset(broken))
        if above.excuses(raw):
            broken.add(name)
            continue
        try:
            names[name] = above.quantity(raw, None)
        except QuantityError as error:
            faults.append(source.place(("parameters", name)).fault(error.code, error.message, error.advice))
            broken.add(name)
            continue
        if name in overrides:
            given = overrides[name]
            if given.value.dimension != names[name].dimension:
                message = f"{given.value.dimension} replaces {names[name].dimension} of the model"
                plain = names[name].dimension == RATIO
                advice = 'write it as text, such as "2"' if plain else "give it the unit of the model's parameter"
                faults.append(given.place.fault("wrong-unit", message, advice))
                broken.add(name)
            names[name] = given.value
    for name in sorted(overrides.keys() - names.keys() - broken):  # one at fault is there all the same
        advice = did_you_mean(name, names) or f"its parameters: {', '.join(names) or 'none'}"
        message = f"the model {source.path.name} has no parameter {name!r}"
        faults.append(overrides[name].place.fault("unknown-parameter", message, advice))
    return replace(reading, names=names, broken=frozenset(broken)), faults


def _cross_checks(source: Source, file: ModelFile) -> Iterator[Fault]:
    """What one key cannot see: which of part and mesh, references between solids, features that contradict."""
    words = {"solids": "solids", "mesh": "a mesh", "profile": "a profile"}
    given = [name for name in words if getattr(file, name)]
    if len(given) != 1:
        message = f"there are both {' and '.join(words[name] for name in given)}" if given else "there is no shape"
        key = (given[-1],) if given else ()
        advice = "give [solids] and part, or [mesh], or [profile]"
        yield source.place(key, of_key=True).fault("conflict", message, advice)
    elif file.solids:
        yield from tree_faults(source, file)
    elif file.part is not None:
        message = f"{words[given[0]]} has no solids"
        yield source.place(("part",), of_key=True).fault("conflict", message, "remove 'part'")
    if not file.features and file.profile is not None:
        advice = "add [features.NAME] with kind, at and length: where the part mates"
        yield source.missing((), "features", advice)
    if given == ["mesh"] and file.mesh is not None:
        yield from mesh_faults(source, file.mesh)
    if file.profile is not None:
        yield from _profile_faults(source, file, file.profile)
    if file.balls:
        yield from _ball_faults(source, file)
    for name, feature in file.features.items():
        if feature.kind == "solid" and feature.through:
            place = source.place(("features", name, "through"))
            yield place.fault("conflict", "a solid feature cannot be through", "remove 'through'")
        for i, solid in enumerate(feature.solids or ()):
            if solid not in file.solids:
                known = f"solids: {', '.join(file.solids)}" if file.solids else "leave 'solids' out"
                advice = did_you_mean(solid, dict(file.solids)) or known
                place = source.place(("features", name, "solids", i))
                yield place.fault("unknown-solid", f"there is no solid {solid!r}", advice)


def _size_faults(source: Source, file: ModelFile) -> Iterator[Fault]:
    """A part of an implausible size."""
    try:
        require_plausible(part_reach(source, file))
    except SizeError as error:
        unit = file.units.length
        if unit is None:
            yield source.place(()).fault("implausible-size", error.message, error.advice)
        else:
            yield implausible(source, ("units", "length"), unit, error)


def _ball_faults(source: Source, file: ModelFile) -> Iterator[Fault]:
    """Balls go with solids, and on what goes in: a wall is no ball."""
    place = source.place(("balls",), of_key=True)
    if not file.solids:
        yield place.fault("conflict", "there are balls without solids", "give [solids] and part as the only shape")
    elif any(feature.kind == "hollow" for feature in file.features.values()):
        advice = 'give them to the part that goes in, or a solid of shape = "sphere" to this one'
        yield place.fault("not-supported", "a part with a hollow feature has balls", advice)


def _profile_faults(source: Source, file: ModelFile, profile: ProfileTable) -> Iterator[Fault]:
    """A profile mates by features of one kind in its plane; what moves is one convex polygon."""
    kinds = sorted({feature.kind for feature in file.features.values()})
    if len(kinds) > 1:
        message, place = "a profile has both solid and hollow features", source.place(("features",), of_key=True)
        yield place.fault("conflict", message, "keep one kind")
    if kinds == ["solid"] and len(profile.polygons) > 1:
        message, place = f"a moving profile of {len(profile.polygons)} polygons", source.place(("profile", "polygons"))
        yield place.fault("not-supported", message, "what moves in a plane is to be one convex polygon")
    for name, feature in file.features.items():
        for key in ("at", "length"):
            if getattr(feature, key) is None:
                yield source.missing(("features", name), key, f"add {key!r} to the feature")
        if feature.at is not None and (feature.at[1] != 0.0 or any(feature.turn)):
            place = source.place(("features", name), of_key=True)
            message = "a feature of a profile is turned, or beside the plane"
            yield place.fault("bad-value", message, "write at = [x, 0, z] without turn, z out of the mouth")
