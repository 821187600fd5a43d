"""From problem and model files to the problem: read, checked as a whole, parts built in their mating frames."""

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from os.path import normpath
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fmopt.errors import Fault, GeometryError, InputError, TaskError
from fmopt.geometry.bodies import MAX_MESH_BYTES
from fmopt.geometry.mating_features import DESCRIBE, FOUND
from fmopt.geometry.mesh.round_planes import met
from fmopt.geometry.part import Part, Profiles, in_order, outline, rebased, settled
from fmopt.plan.press import ConvexSolid, Surroundings
from fmopt.spatial.se3 import Pose, exp
from fmopt.task import sizes
from fmopt.task.model import Bare, Model, load_model, overrides_of
from fmopt.task.pairing import Mated, paired, without_hollows
from fmopt.task.problem import Attributes, Problem, RobotProperties, Settings, Specification, VelocityError
from fmopt.task.solid_tree import build_part, build_tree, shape_part
from fmopt.task.sources import OF_ALL, Contribution, allowance, as_stated, body_width, budget, faceting, framing, total
from fmopt.task.task_command import attributes, is_round
from fmopt.task.toml import problem_file as files
from fmopt.task.toml.source import NAME_PROBLEM, Key, Source, canonical_digest, dotted, read_bytes
from fmopt.task.toml.tables import Reading, checked
from fmopt.task.toml.units import LENGTH, at_most, did_you_mean, in_words

T = TypeVar("T")
_BESIDE = 0.25  # of the radius of a leading face, by which a part may be beside its way, besides its errors


def problem_of(source: Source) -> Problem:
    """The problem of a document, which may differ from its file.

    Raises:
        InputError: with every fault of the document and of its models.
    """
    if not {"moving", "fixed"} & set(source.data) and {"features", "solids", "mesh"} & set(source.data):
        raise InputError(source.place(()).fault("file-kind", "this is a model file, not a problem", NAME_PROBLEM))
    if {"objects", "tasks"} & set(source.data):
        advice = "check it with fmopt check; a plan is of one task, which a problem file describes"
        raise InputError(source.place(()).fault("file-kind", "this is an assembly, not a problem", advice))
    whole, short = files.spelled_out(source) if _is_short(source) else (source, [])
    reading = Reading.of(whole.data)
    file, faults = checked(files.ProblemFile, whole, reading)
    faults += short
    models: dict[str, Model] = {}
    keys: list[Key] = [("moving",), ("fixed",), *(key for key, _ in files.solid_tables(whole.data))]
    for key in keys:
        model, more = _operand(whole, reading, key)
        faults += more
        if model is not None:
            models[dotted(key)] = model
    solids = {name: models.pop(name) for name in [*models] if name not in ("moving", "fixed")}
    if file is not None:
        faults += [*_cross_checks(whole, file, models), *_cell_faults(whole, file, models, solids)]
    if faults or file is None:
        raise InputError(*dict.fromkeys(faults))  # of a file that both sides name they are there twice
    return _problem(source, whole, file, models, solids)


def _is_short(source: Source) -> bool:
    """Whether text stands for a table anywhere in a problem file."""
    errors = source.data.get("uncertainty")
    start = errors.get("start") if isinstance(errors, Mapping) else None
    short = any(isinstance(value, str) for value in (*map(source.data.get, ("moving", "fixed", "robot")), start))
    return short or any(True for _ in files.solid_tables(source.data))


def _operand(source: Source, reading: Reading, key: Key) -> tuple[Model | None, list[Fault]]:
    """The model of one part, as far as the problem file says which; faults of the problem file are found elsewhere."""
    table = source.get(key) if key[0] in source.data else None
    name = table.get("model") if isinstance(table, Mapping) else None
    if not isinstance(table, Mapping) or not isinstance(name, str) or not 0 < len(name) <= 1000:
        return None, []
    overrides, faults = overrides_of(source, reading, (*key, "parameters"))
    try:
        path, said = Path(normpath(source.path.parent / name)), Bare.of(source, key)
        model, more = load_model(path, source.place((*key, "model")), overrides, said)
    except InputError as error:
        return None, [*faults, *error.faults]
    return (None if faults else model), [*faults, *more]


def _cross_checks(source: Source, file: files.ProblemFile, models: Mapping[str, Model]) -> Iterator[Fault]:
    """What one key cannot see: features, the pair, the depth against the hole, and one description of the errors."""
    yield from _feature_faults(source, file, models)
    start, sources = file.uncertainty.start, file.uncertainty.sources
    if (start is None) == (sources is None):
        message = "the start error is described twice" if start else "the start error is not described"
        place = source.place(("uncertainty",), of_key=True)
        advice = f"give either [uncertainty.start], or [uncertainty] start = {files.EXAMPLE}, or [uncertainty.sources]"
        yield place.fault("conflict", message, advice)
    if sources is not None and any(model.file.balls for model in models.values()):
        message = "the tip is a ball, and the sources add up what they displace its leading face by"
        advice = "give [uncertainty.start]: errors of the ball's lowest point against the hole"
        yield source.place(("uncertainty", "sources"), of_key=True).fault("not-supported", message, advice)
    yield from sizes.configuration_faults(source, sources)
    yield from sizes.force_faults(source, file.specification, file.robot.properties())
    yield from _plane_faults(source, file, models)
    yield from _pair_faults(source, file, models)


def _cell_faults(
    source: Source, file: files.ProblemFile, models: Mapping[str, Model], solids: Mapping[str, Model]
) -> Iterator[Fault]:
    """Solids around the parts where none is kept clear of, and those that have no convex pieces."""
    for key, _ in files.solid_tables(source.data):
        place = source.place(key, of_key=True)
        if any(model.file.profile is not None for model in models.values()):
            advice = "leave [tool] solids and [obstacles] out"
            yield place.fault("not-supported", "planar problems keep nothing clear of other solids", advice)
        elif file.settings.evidence == "certified":
            advice = 'write settings.evidence = "tested", or leave [tool] solids and [obstacles] out'
            yield place.fault("not-supported", "guarded moves do not keep clear of other solids", advice)
        elif (model := solids.get(dotted(key))) and (model.file.profile is not None or model.file.balls):
            message = f"the model {model.file.name!r} has {'balls' if model.file.balls else 'a profile'}"
            yield place.fault("not-supported", message, "give [solids] or [mesh] alone")


def _pair_faults(source: Source, file: files.ProblemFile, models: Mapping[str, Model]) -> Iterator[Fault]:
    """Sources with the hollow part in the hand, and a goal deeper than hole and peg allow."""
    if file.uncertainty.sources is not None and _is_exchanged(file, models):
        message = "with the hollow part in the hand the sources do not say how far the peg's leading face is off"
        advice = "give [uncertainty.start]: errors of the peg's leading face against the hole"
        yield source.place(("uncertainty", "sources"), of_key=True).fault("conflict", message, advice)
    if file.tool.tcp is not None and _is_exchanged(file, models):
        message = "the hollow part is in the hand, and programs lead the peg"
        yield source.place(("tool", "tcp"), of_key=True).fault("not-supported", message, "leave it out")
    deepest = _deepest(file, models)
    if deepest is not None and file.goal.depth is not None and file.goal.depth > deepest:
        message = f"{in_words(file.goal.depth, LENGTH)} is deeper than hole and peg allow, {at_most(deepest, LENGTH)}"
        yield source.place(("goal", "depth")).fault("out-of-range", message, 'lower it, or write "full"')


def _feature_faults(source: Source, file: files.ProblemFile, models: Mapping[str, Model]) -> Iterator[Fault]:
    """Features that are not there, and two of one kind."""
    kinds = {}
    for side, model in models.items():
        features, name = model.file.features, file.operand(side).feature
        if name is None:
            continue
        if name in FOUND and not features:
            kinds[side] = FOUND[name]
        elif name not in features:
            message = f"the model {model.file.name!r} has no feature {name!r}"
            advice = did_you_mean(name, features) or f"features: {', '.join(features)}"
            if not features:
                advice = f"leave 'feature' out, to have it found with the other part; or {DESCRIBE}"
            yield source.place((side, "feature")).fault("unknown-feature", message, advice)
        else:
            kinds[side] = features[name].kind
    if len(kinds) == 2 and kinds["moving"] == kinds["fixed"]:
        message = f"{file.moving.feature!r} and {file.fixed.feature!r} are both {kinds['moving']}"
        place = source.place(("moving", "feature"))
        yield place.fault("feature-kind", message, "name the peg of one part and the hole of the other")


def _is_exchanged(file: files.ProblemFile, models: Mapping[str, Model]) -> bool:
    """Whether the moving feature is a hollow one."""
    name = file.moving.feature or ""
    feature = models["moving"].file.features.get(name) if "moving" in models else None
    return (FOUND.get(name) if feature is None else feature.kind) == "hollow"


_OUT_OF_PLANE = (("clearance", "y"), *(("uncertainty", "start", name) for name in ("y", "rx", "rz")))


def _plane_faults(source: Source, file: files.ProblemFile, models: Mapping[str, Model]) -> Iterator[Fault]:
    """Two profiles make a planar problem, which states nothing out of its plane; any other states all six freedoms."""
    profiles = [side for side, model in models.items() if model.file.profile is not None]
    if len(profiles) == 1 and len(models) == 2:
        message = f"the {profiles[0]} part is a profile, the other one is a body"
        yield source.place(("fixed", "model")).fault("conflict", message, "give both models a [profile], or none")
        return
    for key in _OUT_OF_PLANE if profiles and len(models) == 2 else ():
        table = file.clearance if key[0] == "clearance" else file.uncertainty.start
        if table is not None and getattr(table, key[-1]):  # a 0 stays in it
            message = f"{key[-1]!r} leaves the plane of a planar problem"
            yield source.place(key).fault("out-of-plane", message, "leave it out")
    box, above = file.uncertainty.start, ("uncertainty", "start")
    for name, of_all in OF_ALL.items():
        asked = (*above, name) not in _OUT_OF_PLANE or (len(models) == 2 and not profiles)
        if box is not None and asked and not {name, of_all} & box.model_fields_set:
            yield source.missing(above, name, f"add {name!r} to [uncertainty.start], or {of_all!r} for all three axes")


def _deepest(file: files.ProblemFile, models: Mapping[str, Model]) -> float | None:
    """The full depth in m: to the floor of a blind hole or the far side of a through hole, or the peg's length."""
    lengths = []
    for side, model in models.items():
        feature = model.file.features.get(file.feature(side))
        if feature is not None and feature.length is not None:
            lengths.append(feature.length)
    return min(lengths) if len(lengths) == 2 else None


def _problem(
    said: Source, source: Source, file: files.ProblemFile, models: Mapping[str, Model], solids: Mapping[str, Model]
) -> Problem:
    """The problem of tables without fault: `said` as they stand in the file, `source` spelled out."""
    mated: Mapping[str, Mated] = {}
    meshed = any(model.file.mesh is not None for model in models.values())
    known = all(_is_known(model, file.operand(side).feature) for side, model in models.items())
    bodies = {} if known and not meshed else _both(lambda model: build_part(model.source, model.file, few=-1), models)
    if not known:
        stated_depth = file.goal.depth
        file, mated, models = paired(source, file, models, bodies)
        goal = file.goal.model_copy(update={"depth": stated_depth})  # a head may let the tip stand out of the hole
        if faults := list(_pair_faults(source, file.model_copy(update={"goal": goal}), models)):
            raise InputError(*faults)
    exchanged = _is_exchanged(file, models)
    peg, hole = ("fixed", "moving") if exchanged else ("moving", "fixed")
    depth, stated = file.goal.depth or _deepest(file, models) or 0.0, as_stated(file.uncertainty.start)
    if meshed and not file.goal.turn and not any(file.start.turn):
        models = without_hollows(file, models, bodies, (peg, hole), depth)
    built = _both(_noted, models)  # with their features, at which a mesh is to be whole
    parts = {side: in_order(rebased(part, part.feature(file.feature(side)).frame)) for side, part in built.items()}
    sizes.refuse_reaching(source, parts)
    if meshed:
        beside = _BESIDE * sizes.tip_radius(parts[peg]) + float(stated.box[:3].max())
        parts[peg], parts[hole] = met(parts[peg], parts[hole], depth, beside)
    trees = _both(lambda model: build_tree(model.source, model.file, model.mesh), models)
    height = sizes.start_height(parts[peg], stated.box) if file.start.height is None else file.start.height
    begin, grasp = _start(file, height, exchanged), Pose.from_vector([*file.grasp.at, *file.grasp.turn])
    task = _attributes(source, file, is_round(trees[peg].feature(file.feature(peg))), begin, exchanged, grasp)
    turned = Pose(np.zeros(3), exp([0.0, 0.0, -task.turn]))
    moving, fixed = _settled(rebased(parts[peg], turned), parts[hole], models)
    frames = {side: part.feature(file.feature(side)).frame for side, part in built.items()}
    frames[peg] = frames[peg].compose(turned)
    tcp = None if (at := file.tool.tcp) is None else Pose.from_vector([*at.at, *at.turn])
    trapezoid = file.uncertainty.trapezoid
    widths = body_width(parts["moving"].polyhedron.vertices), body_width(parts["fixed"].polyhedron.vertices)
    sources = file.uncertainty.sources
    shares = (stated,) if sources is None else _budget(file, sources, widths, moving, height)
    shares = (*shares, *faceting(models, parts))
    shares = (*shares, *allowance(file.uncertainty.velocity, shares))
    plane = _plane(file, models)
    if plane is not None:
        shares = tuple(share.in_plane() for share in shares)
    if exchanged:
        shares = tuple(share.exchanged() for share in shares)
    box = total(shares)
    sizes.refuse_wild(source, shares)
    sizes.refuse_far(source, box, (moving, fixed))
    either = file.specification.friction
    friction = () if either is None else (either,) if isinstance(either, float) else either
    return Problem(
        title=file.title or f"{parts['moving'].name} into {parts['fixed'].name}",
        path=source.path,
        sha256=_sha256(said, {**models, **solids}),
        moving=moving,
        fixed=fixed,
        trees=(trees[peg], trees[hole]),
        moving_feature=file.feature(peg),
        fixed_feature=file.feature(hole),
        mated=(mated.get(peg), mated.get(hole)),
        goal=Pose(np.array([0.0, 0.0, -depth]), np.eye(3)).vector(),
        start=begin.compose(turned).vector(),
        task=task,
        declared_clearance=_declared(file, plane is not None),
        approach=height,
        start_box=box,
        framing=framing(shares),
        trapezoid=None if trapezoid is None else (trapezoid.ball, trapezoid.cone),
        sources=sources,
        budget=shares if sources or len(shares) > 1 else (),
        tcp=np.zeros(6) if tcp is None else frames[peg].inverse().compose(tcp).vector(),
        cell=_cell(source, file, solids, (frames[peg], frames[hole]), exchanged),
        plane=plane,
        velocity_error=VelocityError(**file.uncertainty.velocity.model_dump()),
        specification=Specification(**{**file.specification.model_dump(), "friction": max(friction, default=0.3)}),
        friction=(min(friction, default=0.1), max(friction, default=0.5)),
        robot=RobotProperties(**file.robot.properties()),
        settings=Settings(**file.settings.model_dump()),
    )


def _cell(
    source: Source, file: files.ProblemFile, models: Mapping[str, Model], frames: tuple[Pose, Pose], exchanged: bool
) -> Surroundings:
    """Tool and obstacles in the frames of peg and hole, which are given in their models' frames."""
    held, standing = list[ConvexSolid](), list[ConvexSolid]()
    for key, table in file.solids.items():
        is_held = key[0] == "tool"
        frame = frames[is_held == exchanged]
        if isinstance(table, files.FileSolid):
            model = models[dotted(key)]
            part = build_part(model.source, model.file)
            frame = Pose.from_vector([*table.at, *table.turn]).inverse().compose(frame)
        else:
            part = shape_part(source, key, table)
        pieces = tuple(tuple((x, y, z) for x, y, z in one.vertices.tolist()) for one in rebased(part, frame).pieces)
        (held if is_held else standing).append(ConvexSolid(str(key[-1]), pieces))
    return Surroundings(tuple(standing), tuple(held)) if exchanged else Surroundings(tuple(held), tuple(standing))


def _is_known(model: Model, name: str | None) -> bool:
    """Whether a feature is named, and all of it stated."""
    table = model.file.features.get(name or "")
    return table is not None and (table.is_whole or model.file.profile is not None)


def _noted(model: Model) -> Part:
    """The part of a model in its frame, with what is to be known of how the model was taken."""
    part = build_part(model.source, model.file, model.mesh)
    # Nothing is certified of a filled part: what touches it may touch nothing.
    return replace(part, notes=(*model.notes, *part.notes), enclosed=part.enclosed or model.mesh is not None)


def _declared(file: files.ProblemFile, planar: bool) -> tuple[float, float] | None:
    """The clearance on each side as declared; one that is declared along x alone holds along y, too."""
    if file.clearance is None:
        return None
    y = file.clearance.y
    return file.clearance.x, (0.0 if planar else file.clearance.x) if y is None else y


def _start(file: files.ProblemFile, height: float, exchanged: bool) -> Pose:
    """P(0): pose of the peg's feature in the frame of the hole where the nominal trajectory begins."""
    if file.start.at is None:
        turn = exp(file.start.turn)
        return Pose(np.array([0.0, 0.0, height]), turn.T if exchanged else turn)  # in the file it is of what moves
    given = Pose.from_vector([*file.start.at, *file.start.turn])
    return given.inverse() if exchanged else given


def _attributes(
    source: Source, file: files.ProblemFile, round_peg: bool, begin: Pose, exchanged: bool, grasp: Pose
) -> Attributes:
    try:
        return attributes(file.goal, round_peg, begin, exchanged, grasp)
    except TaskError as error:
        place = source.place(("goal", "turn") if file.goal.model_fields_set & {"turn"} else ("goal",), of_key=True)
        raise InputError(place.fault("task-rule", error.message, error.advice)) from error


def _settled(moving: Part, fixed: Part, models: Mapping[str, Model]) -> tuple[Part, Part]:
    """Both parts at exact coordinates; of those from files as they are where there are none."""
    try:
        return settled(moving, fixed)
    except GeometryError as error:
        if all(model.file.mesh is None for model in models.values()):
            raise
        note = f"warning: nothing is certified of these parts: {error.message}"
        return replace(moving, enclosed=True), replace(fixed, enclosed=True, notes=(*fixed.notes, note))


def _both(build: Callable[[Model], T], models: Mapping[str, Model]) -> dict[str, T]:
    """What is built of the two models; faults of both are found."""
    built, faults = {}, list[Fault]()
    for side, model in models.items():
        try:
            built[side] = build(model)
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(*dict.fromkeys(faults))
    return built


def _budget(
    file: files.ProblemFile, sources: files.Sources, widths: tuple[float, float], moving: Part, start: float
) -> tuple[Contribution, ...]:
    """What each source contributes to the start error.

    Where the part starts is for the planner to choose. The sources' box holds for all that it may choose: leaning by
    1.3 times the tilts, beside the axis by a few times the errors and what the lean shortens.
    """
    lean = min(1.3 * math.sqrt(2.0) * file.settings.max_tilt, 0.5 * math.pi)  # √2: about x and y at once
    radius = sizes.tip_radius(moving)
    height = start + radius * math.sin(lean)
    upright = total(budget(sources, widths, height, 0.0, lean))  # a first box, to say how far beside the axis it may be
    swing = radius * float(np.linalg.norm(upright[3:]))
    aside = 7.0 * float(upright[0]) + 3.0 * swing + radius * (1.0 - math.cos(lean))
    return budget(sources, widths, height, aside, lean)


def _plane(file: files.ProblemFile, models: Mapping[str, Model]) -> Profiles | None:
    """The profiles of a planar problem in their mating frames."""
    found = {}
    for side, model in models.items():
        if model.file.profile is None:
            return None
        at = model.file.features[file.feature(side)].at or (0.0, 0.0, 0.0)
        found[side] = [np.subtract(polygon, (at[0], at[2])) for polygon in model.file.profile.polygons]
    return Profiles(found["moving"][0], outline(found["fixed"]))


def _sha256(source: Source, models: Mapping[str, Model]) -> str:
    """Hash of what the files say: their data in one canonical form, meshes byte by byte."""
    content: dict[str, Any] = {"problem": source.data, "models": {}, "meshes": {}}
    for side, model in models.items():
        if model.given:  # a mesh that is named itself is all in its bytes
            content["models"][side] = model.source.data
        if model.file.mesh is not None:
            path = model.source.path.parent / model.file.mesh.file
            mesh = read_bytes(path, model.source.place(("mesh", "file")), MAX_MESH_BYTES)
            content["meshes"][side] = hashlib.sha256(mesh).hexdigest()
    return canonical_digest(content)
