"""Sizes that no part, way or tolerance has, and most often a wrong unit: refused, with the unit that would be right.

Forces of a problem's specification, and configurations of its sources, that do not go together.

The clearance of a problem as measured on its parts, held against the declared one.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fmopt.errors import Fault, GeometryError, InputError, SizeError
from fmopt.geometry.clearance import Clearance, checked_clearance
from fmopt.geometry.facets import place
from fmopt.geometry.part import Part
from fmopt.geometry.section import LARGEST, SMALLEST, told
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array, remembered
from fmopt.task.problem import Problem
from fmopt.task.sources import Contribution, least_altitude, total
from fmopt.task.toml import problem_file as files
from fmopt.task.toml.source import Key, Source, holds
from fmopt.task.toml.units import ANGLE, FORCE, LENGTH, TORQUE, UNITS, at_most, in_words

_LARGEST_ERROR = 0.5  # m and rad: what the check of a plan takes
_USUAL = 0.05  # m: about how long a part is
IMPACT = ("impact_force", "apparent_mass", "contact_stiffness")
_LEAST_HEIGHT = 1e-3  # m: of the lowest point at the start
_ROOM = 1.25  # times what the start errors could bring the lowest point down by, it starts above the mouth
LEAST_LEVER = 2.0**-10  # m: what the check of a plan takes
_FAR = 10.0  # times the declared clearance: no tolerance, but another part or another unit


def implausible(source: Source, key: Key, unit: str | None, error: SizeError) -> Fault:
    """The fault of a part's size, with the unit for which it would be plausible, at the key of its unit.

    The unit is that of its plain numbers; None where that is not for the model file to say.
    """
    lengths = UNITS["length"][1]
    given = lengths.get(unit or "", 1.0)
    others = {name: error.size * factor / given for name, factor in lengths.items() if name != unit}
    fitting = {name: size for name, size in others.items() if SMALLEST <= size <= LARGEST}
    message, advice = error.message, "check its numbers"
    if unit is None:
        advice = "its file says its unit itself: export it again, in the size that is meant"
    elif fitting:
        right = min(fitting, key=lambda name: abs(math.log(fitting[name] / _USUAL)))
        message += f"; in {right} it would be {told(fitting[right])}"
        advice = f'set {key[-1]} = "{right}" if that is meant'
        if not source.keys:  # of a mesh file that is named itself
            where = "where the file is named, under [moving], [fixed] or [mesh], or by --unit"
            advice = f'set unit = "{right}" {where} {right}, if that is meant'
    return source.place(key).fault("implausible-size", message, advice)


def refuse_reaching(source: Source, parts: Mapping[str, Part]) -> None:
    """Refuses parts that reach further from their mating features, whose frames they are in, than a plan can say.

    Raises:
        InputError: at the feature.
    """
    for side, part in parts.items():
        # By component, as the check of a plan takes coordinates; a ball reaches beyond its centre.
        far = float((np.abs(part.polyhedron.vertices) + part.polyhedron.radii[:, None]).max())
        if far > LARGEST:
            message, place = f"the part reaches {told(far)} from this feature", source.place((side, "feature"))
            advice = "check where the feature is"
            raise InputError(place.fault("out-of-range", f"{message}, more than {told(LARGEST)}", advice))


def refuse_wild(source: Source, shares: Sequence[Contribution]) -> None:
    """Refuses errors of orientation that a stated box could not have either.

    Raises:
        InputError: the sources together may turn the parts by more than 0.5 rad.
    """
    angle = float(np.max(total(shares)[3:]))
    if angle > _LARGEST_ERROR:
        largest = max(shares, key=lambda share: float(np.max(share.box[3:])))
        message = f"the sources may turn the parts by {in_words(angle, ANGLE)}, most of it by: {largest.source}"
        place = source.place(("uncertainty", "sources"), of_key=True)
        advice = f"keep all together at most {at_most(_LARGEST_ERROR, ANGLE)}"
        raise InputError(place.fault("out-of-range", message, advice))


def refuse_far(source: Source, box: Array, parts: Sequence[Part]) -> None:
    """Refuses errors of position (6,), m and rad, larger than both parts: no tolerance, but another unit.

    Raises:
        InputError: at the component, or at the sources that add up to it; also where a plan cannot say the sum.
    """
    size = max(float(np.linalg.norm(part.polyhedron.widths)) for part in parts)
    for axis, error in zip("xyz", box[:3].tolist(), strict=True):
        if error > size:
            stated = ("uncertainty", "start", axis)
            # A component that `position` or the sources make has no key of its own.
            key = stated if holds(source.data.get("uncertainty", {}).get("start"), axis) else ("uncertainty",)
            message = (
                f"the parts measure {in_words(float(f'{size:.3g}'), LENGTH)} at most from corner to corner, the start "
                f"error along {axis} is {in_words(error, LENGTH)}"
            )
            advice = 'check [units], or write the unit beside the number, as in "0.4 mm"'
            raise InputError(source.place(key, of_key=len(key) == 1).fault("out-of-range", message, advice))
    if np.max(box[:3]) > _LARGEST_ERROR:  # the check takes no more, however large the parts are
        message = f"the start errors add up to {in_words(float(np.max(box[:3])), LENGTH)}"
        place = source.place(("uncertainty",), of_key=True)
        raise InputError(place.fault("out-of-range", message, f"keep them at most {at_most(_LARGEST_ERROR, LENGTH)}"))


def force_faults(source: Source, table: files.MotionSpecificationTable, robot: Mapping[str, Any]) -> Iterator[Fault]:
    """Of forces that no push or no such robot brings about, and of limits on impacts without what meets there."""
    for key, limit, dimension in (("contact_force", "max_force", FORCE), ("torque_limit", "max_torque", TORQUE)):
        if getattr(table, key) > robot[limit]:
            message = f"{in_words(getattr(table, key), dimension)} are more than the robot controls"
            advice = f"lower it to {in_words(robot[limit], dimension)}, or state {limit} in [robot]"
            yield source.place(("specification", key)).fault("out-of-range", message, advice)
    wanted, most = table.termination_force, table.contact_force
    if wanted > most:
        message = f"{in_words(wanted, FORCE)} on the contact that ends a move exceed the contact force"
        advice = f"lower it to well below {in_words(most, FORCE)}, or raise contact_force"
        yield source.place(("specification", "termination_force")).fault("out-of-range", message, advice)
    stated = [name for name in IMPACT if getattr(table, name) is not None]
    for name in IMPACT if stated else ():
        if name not in stated:
            advice = f"add {name!r} to [specification], or drop {' and '.join(map(repr, stated))}"
            yield source.missing(("specification",), name, advice)


def configuration_faults(source: Source, sources: files.Sources | None) -> Iterator[Fault]:
    """Configurations that are stated twice, or not at all, or by points on a line."""
    for name in ("configuration", "feeder"):
        table: files.Configuration | None = getattr(sources, name, None)
        if table is None:
            continue
        key = ("uncertainty", "sources", name)
        stated = [k for k in ("position", "known", "observed") if getattr(table, k) is not None]
        if len(stated) > 1 or not (stated or table.placed):
            message = f"states {' and '.join(stated)}" if stated else "states nothing"
            advice = "give one of position (with angle), known, observed; or placed alone, from an exact place"
            yield source.place(key).fault("conflict", message, advice)
        alone = [k for k in ("angle", "about") if k in table.model_fields_set and table.position is None]
        for k in alone:
            message, advice = f"{k!r} stands without 'position'", "drop it" if stated else "add 'position', or drop it"
            yield source.place((*key, k)).fault("conflict", message, advice)
        if table.observed is not None and least_altitude(table.observed.points) < 1e-6:
            message = "the three points lie on a line, a turn about it was not observed"
            place = source.place((*key, "observed", "points"))
            yield place.fault("bad-value", message, "give three points at the corners of a wide triangle")


def measured_clearance(problem: Problem) -> Clearance:
    """The clearance as measured on the parts, m.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        GeometryError: along x or y it is not of the size that the problem declares.
    """
    found = _checked(problem.moving, problem.fixed, *problem.goal.tolist())
    _require_even((problem.moving, problem.fixed), found.per_side)
    for axis, declared, play in zip("xy", problem.declared_clearance or (0.0, 0.0), found.play, strict=True):
        side = 0.5 * play
        # None may be declared, and in the plane none is along y, where nothing stops the part.
        if declared > 0.0 and math.isfinite(side) and not declared / _FAR <= side <= declared * _FAR:
            raise GeometryError(
                f"along {axis} the parts leave {1e3 * side:.6g} mm a side, where [clearance] declares "
                f"{1e3 * declared:.6g} mm",
                "check the units of the model files, [mesh] unit among them, and which features are to mate; or "
                "correct [clearance]",
            )
    return found


@remembered(1)
def _checked(moving: Part, fixed: Part, *goal: float) -> Clearance:
    """See `checked_clearance`; the goal as numbers, since variants of a problem have the same parts there."""
    return checked_clearance(moving, fixed, Pose.from_vector(goal), -goal[2])


def _require_even(parts: Sequence[Part], clearance: float) -> None:
    """Refuses parts whose facets lie farther off the plane faces that they stand for than the clearance allows.

    Raises:
        GeometryError: they do, together; with the place of the larger one.
    """
    if sum(part.off for part in parts) < clearance:
        return
    worst = max(parts, key=lambda part: part.off)
    raise GeometryError(
        f"the facets of {worst.name!r} are up to {1e6 * worst.off:.3g} µm off plane faces, most at "
        f"{place(worst.where)} of its file; with the other part's that is {1e6 * sum(part.off for part in parts):.3g} "
        f"µm, and the clearance is {1e6 * clearance:.3g} µm a side",
        "export the mesh with more digits, its plane faces plane",
    )


def characteristic_length(problem: Problem, clearance: Clearance) -> float:
    """The length ρ that weighs angles against lengths, m: stated, or half the diagonal of the mating section.

    Of a small section, the least that the check of a plan takes.
    """
    return problem.settings.characteristic_length or max(clearance.half_diagonal, LEAST_LEVER)


def tip_radius(peg: Part) -> float:
    """How far the leading face of a peg, in the frame of its feature, reaches from the axis, m."""
    tip = peg.polyhedron.vertices[np.abs(peg.polyhedron.vertices[:, 2]) <= 1e-9]
    return float(np.linalg.norm(tip[:, :2], axis=1).max(initial=0.0))


def brought_down(peg: Part, box: Array) -> float:
    """How far start errors (6,), m and rad, could bring the leading face of a peg in its feature's frame down, m."""
    # Tilts about both axes at once, each sine at most its angle.
    return float(box[2]) + tip_radius(peg) * math.hypot(float(box[3]), float(box[4]))


def start_height(peg: Part, box: Array) -> float:
    """How high above the mouth the lowest point should start for what errors (6,), m and rad, bring it down by, m."""
    down = brought_down(peg, box)
    # Whole millimetres up, rounded first: a last digit too many would cost another one.
    return max(_LEAST_HEIGHT, math.ceil(round(_ROOM * down / _LEAST_HEIGHT, 6)) * _LEAST_HEIGHT)


def short_of_height(problem: Problem) -> tuple[float, float] | None:
    """How far errors could bring a part down that starts no higher than that, and how high it should start, m."""
    given = problem.fixed if problem.task.exchanged else problem.moving, problem.start_box
    down = brought_down(*given)
    return (down, start_height(*given)) if problem.approach <= down else None


def drift(problem: Problem, clearance: Clearance) -> Array:
    """How far velocity errors carry the part at most on its way down to the mouth (6,), m and rad.

    Zero where that is a clearance or less, next to which it does not count.
    """
    t, r = problem.velocity_error.translation, problem.velocity_error.rotation
    if problem.approach * max(t, r) <= clearance.per_side:
        return np.zeros(6)
    # An error of rotation is stated on an arm of ρ: for each metre it turns the part by r/ρ.
    return problem.approach * np.array([t, t, t, *[r / characteristic_length(problem, clearance)] * 3])
