"""Which features of two parts mate and how they are turned, where the files do not say it: the pair that fits best."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fmopt.errors import GeometryError, InputError
from fmopt.geometry.bodies import bodies_of
from fmopt.spatial.se3 import Pose
from fmopt.task.toml.source import Source

if TYPE_CHECKING:
    from fmopt.geometry.mating_fit import Fit
    from fmopt.geometry.part import Part
    from fmopt.task.model import Model
    from fmopt.task.toml.problem_file import ProblemFile

Side = Literal["moving", "fixed"]
SIDES: tuple[Side, Side] = ("moving", "fixed")
_ALIKE = 1e-6  # m: pairs whose clearances differ by less fit alike
_MOST = 256  # pairs that are tried


@dataclass(frozen=True)
class Mated:
    """How a part mates, as far as that was found.

    Args:
        frame: of the feature in the model's frame (x, y, z and rotation vector), m and rad; None where the model states
            it.
        turn: angle of the peg about the axis of the hole at the goal, rad.
    """

    side: Side
    feature: str
    frame: tuple[float, ...] | None
    turn: float

    def record(self) -> dict[str, Any]:
        """As a plan holds it."""
        known = {"side": self.side, "feature": self.feature, "turn": self.turn}
        return known if self.frame is None else {**known, "frame": list(self.frame)}


@dataclass(frozen=True)
class _Pair:
    """Two features that could mate, how they fit, and how deep the goal is, m, where a file has the parts seated."""

    names: Mapping[Side, str]
    fit: Fit
    depth: float | None = None


def paired(
    source: Source, file: ProblemFile, models: Mapping[str, Model], parts: dict[str, Part]
) -> tuple[ProblemFile, Mapping[str, Mated], Mapping[str, Model]]:
    """The problem file with features and turn as they were found where it does not state them, and what was found.

    The models are those that it was found on: a peg and its hole are found each on its own, and where none fits another
    about the centre of its section, others are tried, and then the other end of a prism or of a hole that is alike from
    both sides: an L goes into its hole by one end only. In an L the gap may decide which point the centre is.

    Raises:
        InputError: no two features can mate, or several pairs fit alike.
    """
    from fmopt.geometry.mating_fit import goes_in

    stated: dict[Side, str | None] = {side: _operand(file, side).feature for side in SIDES}
    missing = [side for side in SIDES if stated[side] is not None and stated[side] not in models[side].file.features]
    if missing:
        return file, {}, models
    # Frames that are stated say how the peg is turned; only found ones leave that open.
    turning = "turn" not in file.goal.model_fields_set and is_found(models, stated)
    pairs = list(_pairs(source, file, parts, stated, turning))
    if not pairs:
        return file, {}, models
    closest = max(pairs, key=lambda pair: pair.fit.gap)
    if closest.fit.gap <= 0.0:
        for tried, moved in _recentred(models, parts, closest.names):
            matings = _matings(source, file, moved, closest.names)
            if any(goes_in(peg, hole, depth, turning) for _, peg, hole, depth in matings):
                models, parts, pairs = tried, moved, list(_pairs(source, file, moved, stated, turning))
                break
    seated = _seated(file, models)
    best = _best(source, pairs) if seated is None else _in_place(source, pairs, parts, seated)
    exchanged = parts["moving"].feature(best.names["moving"]).kind == "hollow"
    if file.clearance is None:  # who states one means it, however wide
        _require_near(source, best, parts, exchanged)
    turn = best.fit.turn
    operands: dict[str, Any] = {
        side: _operand(file, side).model_copy(update={"feature": best.names[side]}) for side in SIDES
    }
    # The file's turn is of what moves. One of 0 stays unsaid, by which a round peg keeps its angle free.
    update = {"turn": -turn if exchanged else turn} if turn else {}
    if best.depth is not None and "depth" not in file.goal.model_fields_set:
        update["depth"] = best.depth
    goal = file.goal.model_copy(update=update) if update else file.goal
    found: dict[str, Mated] = {
        side: Mated(side, best.names[side], _frame(models[side], best.names[side]), turn)
        for side in SIDES
        if stated[side] is None or models[side].is_found(best.names[side])
    }
    return file.model_copy(update={**operands, "goal": goal}), found, models


def _recentred(
    models: Mapping[str, Model], parts: Mapping[str, Part], names: Mapping[Side, str]
) -> Iterator[tuple[dict[str, Model], dict[str, Part]]]:
    """The models and their parts with found features about other centres of their sections, then by other ends."""
    for both in _about_others(models, parts, names):
        tried: dict[str, Model] = dict(zip(SIDES, both, strict=True))
        yield tried, {side: _with_frame(parts[side], tried[side], names[side]) for side in SIDES}


def _about_others(
    models: Mapping[str, Model], parts: Mapping[str, Part], names: Mapping[Side, str]
) -> Iterator[tuple[Model, Model]]:
    from fmopt.geometry.mating_fit import frames_from_beyond, other_frames

    features = {side: parts[side].feature(names[side]) for side in SIDES}
    moving, fixed = (
        [models[side], *_with_frames(models[side], names[side], other_frames(parts[side].pieces, features[side]))]
        for side in SIDES
    )
    yield from islice(product(moving, fixed), 1, None)  # the first are the models as they are
    # Other ends take a look at all faces of a part: only once no centre was the right one.
    turned, upside_down = (
        [*_with_frames(models[side], names[side], frames_from_beyond(parts[side], features[side]))] for side in SIDES
    )
    yield from product(turned, fixed)
    yield from product(moving, upside_down)


def _with_frames(model: Model, name: str, frames: Iterator[Pose]) -> Iterator[Model]:
    """A model with a feature in other frames, if its place was found."""
    table = model.file.features[name]
    if model.is_found(name) and "at" not in model.source.data.get("features", {}).get(name, {}):
        for frame in frames:
            x, y, z, *turn = frame.vector().tolist()
            features = {**model.file.features, name: table.model_copy(update={"at": (x, y, z), "turn": tuple(turn)})}
            yield replace(model, file=model.file.model_copy(update={"features": features}))


def _with_frame(part: Part, model: Model, name: str) -> Part:
    """A part with a feature where its model has it."""
    table = model.file.features[name]
    frame = Pose.from_vector([*(table.at or (0.0, 0.0, 0.0)), *table.turn])
    moved = [replace(f, frame=frame) if f.name == name else f for f in part.features]
    return replace(part, features=tuple(moved))


def is_found(models: Mapping[str, Model], names: Mapping[Side, str | None]) -> bool:
    """Whether any feature of these names was found on its part rather than stated.

    Args:
        names: by side; None stands for all features of that side.
    """
    return any(
        model.is_found(name)
        for side in SIDES
        for model in (models[side],)
        for name in model.file.features
        if names[side] in (None, name)
    )


def _frame(model: Model, name: str) -> tuple[float, ...] | None:
    table = model.file.features[name]
    return (*(table.at or (0.0, 0.0, 0.0)), *table.turn) if model.is_found(name) else None


def _operand(file: ProblemFile, side: Side) -> Any:
    return file.moving if side == "moving" else file.fixed


def _pairs(
    source: Source, file: ProblemFile, parts: Mapping[str, Part], stated: Mapping[Side, str | None], turning: bool
) -> Iterator[_Pair]:
    """The pairs of a solid and a hollow feature among those that are stated, or of all, and how they fit.

    Raises:
        InputError: there is none.
    """
    from fmopt.geometry.mating_fit import best_fit

    for names, peg, hole, depth in _matings(source, file, parts, stated):
        yield _Pair(names, best_fit(peg, hole, depth, turning))


def _matings(
    source: Source, file: ProblemFile, parts: Mapping[str, Part], stated: Mapping[Side, str | None]
) -> Iterator[tuple[Mapping[Side, str], Part, Part, float]]:
    """For each pair the names of its features, peg and hole in their frames, and how deep the one goes, m.

    Raises:
        InputError: there is none.
    """
    from fmopt.geometry.part import rebased

    own, others = ([one for one in parts[side].features if stated[side] in (None, one.name)] for side in SIDES)
    kinds = [(a, b) for a in own for b in others if a.kind != b.kind]
    if not kinds:
        if all(stated.values()):
            return  # two of one kind are stated, which is told elsewhere
        raise _no_pair(source, parts)
    if len(kinds) > _MOST:
        message = f"there are {len(kinds)} pairs of a peg and a hole"
        one, other = (_said(source, side, name.name) for side, name in zip(SIDES, kinds[0], strict=True))
        place = source.place(("moving",), of_key=True)
        raise InputError(place.fault("ambiguous", message, f"say which, such as {one} and {other}"))
    for a, b in kinds:
        mating = {"moving": rebased(parts["moving"], a.frame), "fixed": rebased(parts["fixed"], b.frame)}
        peg, hole = ("fixed", "moving") if a.kind == "hollow" else ("moving", "fixed")
        depth = file.goal.depth or min(a.length, b.length)
        depth = min(depth, a.length, b.length)  # one that is too deep is told of once the pair is known
        yield {"moving": a.name, "fixed": b.name}, mating[peg], mating[hole], depth


def _no_pair(source: Source, parts: Mapping[str, Part]) -> InputError:
    listed = "; ".join(
        f"{part.name}: {', '.join(f'{one.name} ({one.kind})' for one in part.features) or 'none'}"
        for part in (parts[side] for side in SIDES)
    )
    message = f"no peg of one part and hole of the other were found ({listed})"
    advice = "check that the files are those of a peg and of a part with a hole for it, each drawn by: "
    advice += "fmopt check FILE --out FILE.svg"
    return InputError(source.place(("fixed",), of_key=True).fault("no-pair", message, advice))


def _best(source: Source, pairs: list[_Pair]) -> _Pair:
    """The tightest pair with room; where none has any, the one that overlaps the least.

    Raises:
        InputError: two of them fit alike.
    """
    roomy = sorted((pair for pair in pairs if pair.fit.gap > 0.0), key=lambda pair: pair.fit.gap)
    if not roomy:
        return max(pairs, key=lambda pair: pair.fit.gap)  # how much it lacks is told as its clearance
    alike = [pair for pair in roomy if pair.fit.gap - roomy[0].fit.gap <= _ALIKE]
    for side in SIDES:
        names = list(dict.fromkeys(pair.names[side] for pair in alike))
        if len(names) > 1:
            message = f"{' and '.join(repr(name) for name in names)} of the {side} part fit alike"
            advice = f"say which: {_said(source, side, names[0])}"
            raise InputError(source.place((side,), of_key=True).fault("ambiguous", message, advice))
    return roomy[0]


def _said(source: Source, side: Side, name: str) -> str:
    """How a problem file says which feature of a part mates, also where its name alone stands for the part so far."""
    if (side, "model") in source.keys:
        return f'feature = "{name}" under [{side}]'
    return f'{side} = {{ model = "{source.data[side]["model"]}", feature = "{name}" }}'


def _seated(file: ProblemFile, models: Mapping[str, Model]) -> Pose | None:
    """The pose of the moving part's frame in that of the fixed one, where both are bodies of one file."""
    from fmopt.geometry.body_names import chosen

    paths = {model.source.path for model in models.values()}
    which = [_operand(file, side).body for side in SIDES]
    if len(paths) > 1 or any(model.given for model in models.values()) or None in which:
        return None
    found = bodies_of(paths.pop(), _operand(file, "moving").unit)
    moving, fixed = (found[chosen([body.name for body in found], str(name))] for name in which)
    return fixed.pose.inverse().compose(moving.pose)


def _in_place(source: Source, pairs: list[_Pair], parts: Mapping[str, Part], seated: Pose) -> _Pair:
    """The pair that the file has on one axis, in each other, with the depth and the turn that it has.

    Raises:
        InputError: there is none.
    """
    from fmopt.geometry.mating_fit import turned_to

    placed, aside = list[_Pair](), list[tuple[float, _Pair]]()
    for pair in pairs:
        frames = {side: parts[side].feature(pair.names[side]).frame for side in SIDES}
        pose = frames["fixed"].inverse().compose(seated.compose(frames["moving"]))  # T_fixed_moving, of the features
        exchanged = parts["moving"].feature(pair.names["moving"]).kind == "hollow"
        at = pose.inverse() if exchanged else pose
        off, lean, depth = float(np.hypot(*at.p[:2])), float(at.R[2, 2]), -float(at.p[2])
        # Anywhere within its play a peg is seated; the cosine of its lean allows for 45 µrad.
        room = max(_ALIKE, pair.fit.gap)
        if lean > 1.0 - 1e-9 and off <= room and depth > _ALIKE:
            turn = turned_to(float(np.arctan2(at.R[1, 0], at.R[0, 0])))
            full = min(parts[side].feature(pair.names[side]).length for side in SIDES)
            stated = depth if depth < full - _ALIKE else None
            placed.append(replace(pair, depth=stated, fit=replace(pair.fit, turn=turn)))
        aside.append((off, pair))
    if placed:
        return _best(source, placed)
    off, pair = min(aside, key=lambda one: one[0])
    message = (
        f"in the file {pair.names['moving']!r} of {parts['moving'].name!r} does not stand in "
        f"{pair.names['fixed']!r} of {parts['fixed'].name!r}: {1e3 * off:.4g} mm beside its axis, leaning or outside"
    )
    advice = "export the assembly with the parts seated; or export each part on its own and name both files"
    raise InputError(source.place(("moving",), of_key=True).fault("not-seated", message, advice))


def _require_near(source: Source, best: _Pair, parts: Mapping[str, Part], exchanged: bool) -> None:
    from fmopt.geometry.mating_fit import require_near

    peg, hole = (parts[side].name for side in (SIDES[::-1] if exchanged else SIDES))
    try:
        require_near(best.fit, peg, hole)
    except GeometryError as error:
        place = source.place(("fixed",), of_key=True)
        raise InputError(place.fault("implausible-fit", error.message, error.advice)) from error
