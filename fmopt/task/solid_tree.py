"""The tree of named solids of a model file: its references checked, and the part it describes built."""

from collections.abc import Iterator
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, assert_never

import numpy as np

from fmopt.errors import Fault, InputError, TaskError
from fmopt.geometry import csg
from fmopt.geometry.convex_pieces import polyhedron
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.outline_solids import stack
from fmopt.geometry.part import Part, mesh_part, part_of, ridge, slab, with_balls
from fmopt.geometry.section import reach
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.mesh_source import imported
from fmopt.task.object_model.classify import MADE, FeatureClaim, is_made, object_tree
from fmopt.task.object_model.tree import Chain, ObjectTree, Term, chain_of, chain_solid, joined, moved_chain, without
from fmopt.task.round_solids import round_notes, round_solid
from fmopt.task.toml import model_file as files
from fmopt.task.toml.source import Key, Source
from fmopt.task.toml.units import did_you_mean

if TYPE_CHECKING:
    from fmopt.geometry.mesh.mesh_import import Imported

MAX_INSTANCES = 1000  # n solids, each naming the next one twice, make 2ⁿ
_MERIDIANS = 16  # of the polyhedron that stands for a ball in the tree of features


def tree_faults(source: Source, file: files.ModelFile) -> list[Fault]:
    """Faults of the references: unknown solids, cycles, solids that nothing uses, trees that grow too large."""
    if file.part is None:
        return [source.missing((), "part", "name the solid that the part is")]
    faults = []
    references = {name: list(_references(name, solid)) for name, solid in file.solids.items()}
    for key, target in [(("part",), file.part), *(pair for pairs in references.values() for pair in pairs)]:
        if target not in file.solids:
            advice = did_you_mean(target, dict(file.solids)) or f"solids: {', '.join(file.solids)}"
            faults.append(source.place(key).fault("unknown-solid", f"there is no solid {target!r}", advice))
    if faults:  # counting needs all that is named
        return faults
    order: dict[str, int] = {}
    for name in file.solids:
        cycle = _count(name, references, order, ())
        if cycle is not None:
            message = f"the solid {cycle!r} is made of itself"
            return [source.place(("solids", cycle), of_key=True).fault("cycle", message, "break the circle of names")]
    if order[file.part] > MAX_INSTANCES:
        message = f"the tree has {order[file.part]} instances"
        return [source.place(("part",)).fault("too-large", message, f"use at most {MAX_INSTANCES}")]
    used: dict[str, int] = {}
    _count(file.part, references, used, ())
    advice = "name it in a union or difference, or remove it"
    places = ((name, source.place(("solids", name), of_key=True)) for name in file.solids if name not in used)
    return [place.fault("unused-solid", f"nothing uses the solid {name!r}", advice) for name, place in places]


def _references(name: str, solid: files.Shape) -> Iterator[tuple[Key, str]]:
    match solid:
        case files.UnionTable(of=of):
            yield from ((("solids", name, "of", i), target) for i, target in enumerate(of))
        case files.DifferenceTable(of=base, minus=minus):
            yield ("solids", name, "of"), base
            yield from ((("solids", name, "minus", i), target) for i, target in enumerate(minus))


def _count(
    name: str, references: dict[str, list[tuple[Key, str]]], counts: dict[str, int], above: tuple[str, ...]
) -> str | None:
    """Fills in how many instances each solid expands to; returns a solid that contains itself, if any."""
    if name in above:
        return name
    if name not in counts:
        total = 1
        for _, target in references[name]:
            cycle = _count(target, references, counts, (*above, name))
            if cycle is not None:
                return cycle
            total += counts[target]
        counts[name] = min(total, 10**9)  # numbers that double for each name stay short
    return None


def part_reach(source: Source, file: files.ModelFile) -> Array:
    """Points (n, 3) in m whose bounding box holds the part of a checked model file with solids or a profile.

    Raises:
        InputError: a solid has no volume; at its place in the file.
    """
    if file.profile is None:
        round_ = [centre + side * radius for centre, radius in _balls(file) for side in (-1.0, 1.0)]
        return np.vstack([reach(_solid(source, file, file.part or "")), *round_])
    return np.array([(x, 0.0, z) for polygon in file.profile.polygons for x, z in polygon])


def build_part(source: Source, file: files.ModelFile, mesh: "Imported | None" = None, few: float = np.inf) -> Part:
    """The part of a checked model file, in its model frame.

    Args:
        mesh: what stands for the one of the file, if anything.
        few: reflex edges; a mesh with more of them gets no convex pieces.

    Raises:
        InputError: no solid comes out; at the place of the solid or mesh in the file.
    """
    features = [_feature(name, feature) for name, feature in file.features.items() if feature.is_whole]
    if file.mesh is not None:
        mesh = mesh or imported(source, file.mesh)
        with source.place(("mesh", "file")).solid():
            return mesh_part(file.name, mesh, features, None if file.mesh.is_step else file.mesh.deviation, few)
    if file.profile is not None:
        with source.place(("profile", "polygons")).solid():
            return part_of(file.name, _extruded(file, file.profile), features)
    root = file.part or ""
    solid = _solid(source, file, root)
    turned = any(isinstance(table, files.TurnedTable) for table in file.solids.values())
    notes = tuple(dict.fromkeys(round_notes(file, root))) if turned else ()
    with source.place(("solids", root), of_key=True).solid():
        part = replace(part_of(file.name, solid, features), notes=notes)
    if file.balls:
        with source.place(("balls",), of_key=True).solid():
            part = with_balls(part, _balls(file))
    return part


def _balls(file: files.ModelFile) -> list[tuple[Array, float]]:
    """Centres (3,) and radii of the balls of a model, m."""
    return [(np.array(ball.at), ball.radius) for ball in file.balls.values()]


def shape_part(source: Source, key: Key, shape: files.Primitive) -> Part:
    """The part that a shape is by itself, which stands at `key`.

    Raises:
        InputError: no solid comes out; at that place.
    """
    with source.place(key, of_key=True).solid():
        solid = _shape(source, files.ModelFile(), shape, False)
        return part_of(str(key[-1]), csg.Moved(solid, Pose.from_vector([*shape.at, *shape.turn])))


def build_tree(source: Source, file: files.ModelFile, mesh: "Imported | None" = None) -> ObjectTree:
    """The object tree of a checked model file, after [LeeHuang1985] section 3.

    A mesh, and a part with a feature that none of its solids make (a hole that others leave between them), becomes its
    convex hull less convex bodies.

    Raises:
        InputError: no solid comes out, or a feature breaks a rule; at its place in the file.
    """
    whole = {name: feature for name, feature in file.features.items() if feature.is_whole}
    features = [_feature(name, feature) for name, feature in whole.items()]
    claims = {name: FeatureClaim(feature.classification or "", feature.solids or ()) for name, feature in whole.items()}
    try:
        with source.place(("solids", file.part) if file.part else ("mesh", "file"), of_key=True).solid():
            chain = _whole_chain(source, file)
            if not (chain and all(claims[feature.name].terms or is_made(chain, feature) for feature in features)):
                chain = chain_of(_hull_less_others(source, file, mesh, chain), file.name)
            tree = object_tree(file.name, chain, features, claims)
    except TaskError as error:
        key = ("features", error.feature) if error.feature in file.features else ("features",)
        advice = "check the feature's frame" if not file.solids and error.rule == MADE else error.advice
        raise InputError(source.place(key, of_key=True).fault("frame-rule", error.message, advice)) from error
    return tree


def _hull_less_others(source: Source, file: files.ModelFile, mesh: "Imported | None", chain: Chain) -> csg.Solid:
    """The part as its convex hull less convex bodies, from its chain or its mesh."""
    from fmopt.geometry.inverse_csg import MESH_NOISE, apart
    from fmopt.geometry.mesh.mesh_solid import decomposed

    if file.mesh is not None:
        return decomposed(mesh or imported(source, file.mesh)).solid
    body = polyhedron(chain_solid(chain))
    return apart(body, MESH_NOISE * body.diameter)[0]


def _whole_chain(source: Source, file: files.ModelFile) -> Chain:
    """The chain of the part; none for a mesh, one term for a profile. Polyhedra stand for balls."""
    if file.profile is not None:
        return (Term("+", file.name, _extruded(file, file.profile)),)
    if file.mesh is not None:
        return ()
    found = _chain(source, file, file.part or "")
    for name, ball in file.balls.items():
        solid = csg.Moved(csg.Sphere(ball.radius, _MERIDIANS), Pose.from_vector([*ball.at, 0.0, 0.0, 0.0]))
        found = joined(found, (Term("+", name, solid),))
    return found


def _chain(source: Source, file: files.ModelFile, name: str, hollow: bool = False) -> Chain:
    """The chain of a named solid, its terms called by the names of the file; `hollow` where it is taken away."""
    table = file.solids[name]
    match table:
        case files.UnionTable(of=of):
            first = reduce(joined, [_chain(source, file, target, hollow) for target in of])
        case files.DifferenceTable(of=base, minus=minus):
            first = _chain(source, file, base, hollow)
            for target in minus:
                first = without(first, _chain(source, file, target, not hollow))
        case files.PrismTable(holes=holes) if holes:  # a feature may be made of each hole alone
            outer, cuts = _prism(table)
            tools = tuple(Term("+", f"{name}-hole-{i}", cut) for i, cut in enumerate(cuts, 1))
            first = without((Term("+", name, outer),), tools)
        case _:
            return (Term("+", name, _solid(source, file, name, hollow)),)  # placed by `at` and `turn` already
    return moved_chain(first, Pose.from_vector([*table.at, *table.turn]))


def _solid(source: Source, file: files.ModelFile, name: str, hollow: bool = False) -> csg.Solid:
    table = file.solids[name]
    with source.place(("solids", name), of_key=True).solid():
        solid = _shape(source, file, table, hollow)
    frame = (*table.at, *table.turn)
    return csg.Moved(solid, Pose.from_vector(frame)) if any(frame) else solid


def _extruded(file: files.ModelFile, profile: files.ProfileTable) -> csg.Solid:
    """The solid that stands for a profile: a ridge where it mates by a solid feature, a slab where by a hollow one."""
    moving = all(feature.kind == "solid" for feature in file.features.values())
    return ridge(profile.polygons[0]) if moving else slab(profile.polygons)


def _shape(source: Source, file: files.ModelFile, table: files.Shape, hollow: bool) -> csg.Solid:
    match table:
        case files.BoxTable(size=size, chamfer=chamfer):
            return csg.chamfered_box(size, chamfer) if chamfer > 0.0 else csg.Box(size)
        case files.CylinderTable() | files.ConeTable():
            return round_solid(table, hollow)
        case files.SphereTable(radius=radius, sides=sides):
            return csg.Sphere(radius, sides)
        case files.PrismTable():
            outer, holes = _prism(table)
            return csg.Difference(outer, holes) if holes else outer
        case files.StackTable(sections=sections):
            return stack([(section.at, section.polygon) for section in sections])
        case files.WedgeTable(size=size, top_x=top_x):
            return csg.Wedge(size, top_x)
        case files.HullTable(points=points):
            return csg.Hull(points)
        case files.UnionTable(of=of):
            return csg.Union(tuple(_solid(source, file, target, hollow) for target in of))
        case files.DifferenceTable(of=base, minus=minus):
            tools = tuple(_solid(source, file, target, not hollow) for target in minus)
            return csg.Difference(_solid(source, file, base, hollow), tools)
        case _:
            assert_never(table)


def _prism(table: files.PrismTable) -> tuple[csg.Solid, tuple[csg.Solid, ...]]:
    """A prism without its holes, and what is cut out of it for them, standing out at both ends."""
    height, proud = table.height, 0.5 * table.height
    outer = stack([(0.0, table.polygon), (height, table.polygon)])
    return outer, tuple(stack([(-proud, hole), (height + proud, hole)]) for hole in table.holes)


def _feature(name: str, table: files.MatingFeature) -> Feature:
    at, length = table.at or (0.0, 0.0, 0.0), table.length or 0.0
    return Feature(name, table.kind, Pose.from_vector([*at, *table.turn]), length, table.through)
