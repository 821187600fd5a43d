"""Problems and assemblies back in words, as `fmopt check` prints them: statements, each behind what it is about."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from typing import Any

import numpy as np

from fmopt.geometry.clearance import Clearance
from fmopt.geometry.mating_features import Feature
from fmopt.geometry.part import Part
from fmopt.plan.press import ConvexSolid
from fmopt.spatial.values import Array
from fmopt.task.assembly import AssemblySequence, AssemblyStep
from fmopt.task.problem import Problem
from fmopt.task.sizes import drift
from fmopt.task.task_command import problem_answer

_WARNING = "warning: "
_FREE = {"p_z": "free_depth", "q_z": "free_turn"}


def facts(problem: Problem, clearance: Clearance) -> dict[str, Any]:
    """The same as data: SI units, half-widths of errors in the order x, y, z, rx, ry, rz."""
    return {
        "valid": True,
        "title": problem.title,
        "sha256": problem.sha256,
        "parts": {"moving": problem.moving.name, "fixed": problem.fixed.name},
        "features": {"moving": problem.peg.name, "fixed": problem.hole.name},
        "planar": problem.plane is not None,
        "goal": problem.goal.tolist(),
        "task": {
            "attachment": problem.task.attachment,
            "exchanged": problem.task.exchanged,
            "grasp": problem.task.grasp.vector().tolist(),
            "turn": problem.task.turn,
            "free": [name for name, free in _FREE.items() if getattr(problem.task, free)],
            "start": problem.start.tolist(),
            "trapezoid": None if problem.trapezoid is None else list(problem.trapezoid),
        },
        "start_height": problem.approach,
        "start_box": problem.start_box.tolist(),
        "budget": [share.record() for share in problem.budget],
        "velocity_error": asdict(problem.velocity_error),
        "declared_clearance": None if problem.declared_clearance is None else list(problem.declared_clearance),
        "measured_clearance": clearance.per_side,
        "play": [width if math.isfinite(width) else None for width in clearance.play],  # JSON has no infinity
        "specification": problem.specification.record(),
        "tcp": problem.tcp.tolist(),
        "cell": {side: [one.name for one in getattr(problem.cell, side)] for side in ("moving", "fixed")},
        "settings": asdict(problem.settings),
        "warnings": list(_warnings(problem, clearance)),
    }


def explain(problem: Problem, clearance: Clearance) -> str:
    """What a problem asks for, one statement a line, lengths in mm and angles in degrees."""
    return aligned(problem.title, f"{problem.path}  sha256 {problem.sha256}", *statements(problem, clearance))


def statements(problem: Problem, clearance: Clearance) -> list[tuple[str, str]]:
    """What a problem asks for, each statement behind what it is about, lengths in mm and angles in degrees."""
    return listed(
        {
            "parts": _parts(problem),
            "task": _task(problem),
            "goal": [_goal(problem)],
            "clearance": _clearance(problem, clearance),
            "start": chain(_start(problem), _drift(problem, clearance)),
            "motion": _motion(problem),
            "settings": _settings(problem),
        }
    )


def listed(sections: Mapping[str, Iterable[str]]) -> list[tuple[str, str]]:
    """Statements in order, the first of each section behind its name."""
    return [(name if i == 0 else "", said) for name, lines in sections.items() for i, said in enumerate(lines)]


def aligned(*lines: str | tuple[str, str]) -> str:
    """Lines of text, statements in a column of their own."""
    return "\n".join(line if isinstance(line, str) else f"{line[0]:<10} {line[1]}" for line in lines)


def mm(length: float) -> str:
    """A length in mm, to six digits, without its unit."""
    return f"{round(1e3 * length, 9) + 0.0:.6g}"


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):.6g}"


def _parts(problem: Problem) -> Iterator[str]:
    for side, part, feature in (("moving", problem.moving, problem.peg), ("fixed", problem.fixed, problem.hole)):
        yield _part(side, part, feature)
        yield from (note for note in part.notes if not note.startswith(_WARNING))
    for place, solids in (("moving", problem.cell.moving), ("fixed", problem.cell.fixed)):
        if solids:
            yield f"beside the {place} part, kept clear of what the other one has: {', '.join(map(_solid, solids))}"


def _solid(solid: ConvexSolid) -> str:
    return f"{solid.name}, {' x '.join(map(mm, np.ptp(np.vstack(solid.pieces), axis=0).tolist()))} mm"


def _part(side: str, part: Part, feature: Feature) -> str:
    shape = part.polyhedron
    extent = " x ".join(mm(float(width)) for width in shape.widths)
    pieces = "1 convex piece" if len(part.pieces) == 1 else f"{len(part.pieces)} convex pieces"
    if shape.balls:
        pieces += " and 1 ball" if len(shape.balls) == 1 else f" and {len(shape.balls)} balls"
    kind = "length" if feature.kind == "solid" else "open at both ends, depth" if feature.through else "blind, depth"
    words = f"{side}: {part.name}, {extent} mm, {len(shape.faces)} faces, {pieces}"
    words += f"; mates by {feature.name} ({feature.kind}, {kind} {mm(feature.length)} mm)"
    words += f"; curves are off by up to {mm(part.chord_error)} mm" if part.chord_error else ""
    return words + (f"; tolerance of form {1e6 * part.form:.3g} µm" if part.form else "")


def _task(problem: Problem) -> Iterator[str]:
    """The pair, what the goal leaves free and how that is settled, and who is in the hand."""
    wanted = problem.task
    found = problem_answer(problem)
    yield f"{found.task.moving} into a {wanted.attachment} pair with {found.task.fixed}"
    if wanted.exchanged:
        yield "the hollow part is in the hand: planned as if the peg moved, in the frame of the hole"
    yield from map(str, found.settled)
    if wanted.turn:
        yield f"at the goal the peg is turned by {_deg(wanted.turn)} deg about the axis of the hole"
    if wanted.grasp.vector().any():
        x, y, z, *r = wanted.grasp.vector().tolist()
        yield (
            f"the grasped feature is at ({mm(x)}, {mm(y)}, {mm(z)}) mm in the hand, "
            f"turned by ({', '.join(map(_deg, r))}) deg"
        )


def _goal(problem: Problem) -> str:
    depth, full = -float(problem.goal[2]), min(problem.peg.length, problem.hole.length)
    share = "full depth" if depth == full else f"{depth / full:.0%} of full depth"
    return f"leading face {mm(depth)} mm below the mouth ({share}), anywhere within the play"


def _clearance(problem: Problem, clearance: Clearance) -> Iterator[str]:
    if problem.declared_clearance is not None:
        x, y = problem.declared_clearance
        across = "" if problem.plane is not None else f", {mm(y)} mm along y"
        yield f"declared on each side: {mm(x)} mm along x{across}"
    found = f"measured on the parts: {mm(round(clearance.per_side, 12))} mm where it is least"
    error = max(float(problem.start_box[0]), float(problem.start_box[1]))
    if error > clearance.per_side:
        found += f"; the start error is {error / clearance.per_side:.3g} times that, so contacts have to shrink it"
    yield found
    yield from _warnings(problem, clearance)


def _warnings(problem: Problem, clearance: Clearance) -> Iterator[str]:
    yield from _mismatch(problem, clearance)
    for part in (problem.moving, problem.fixed):
        yield from (note for note in part.notes if note.startswith(_WARNING))
    yield from _far(problem)
    rounds = sum(part.chord_error + part.form for part in (problem.moving, problem.fixed))
    if rounds >= clearance.per_side:
        yield (
            f"warning: the curved surfaces lie up to {mm(rounds)} mm from their facets, which is the clearance and "
            "more; give finer facets"
        )


def _far(problem: Problem) -> Iterator[str]:
    """Where the start error may put the peg beside the hole altogether, which is a wrong unit more often than not."""
    widths = problem.moving.polyhedron.widths.tolist()
    for axis, error, width in zip("xy", problem.start_box.tolist(), widths, strict=False):
        if error > 0.5 * width:
            yield (
                f"warning: the start error along {axis}, {mm(error)} mm, is more than half the width of the moving "
                f"part, {mm(width)} mm: it may begin beside the hole altogether; check the units"
            )


def _mismatch(problem: Problem, clearance: Clearance) -> Iterator[str]:
    """Where the drawing and the parts disagree by more than 1 % and 1 µm; the plan rests on the parts."""
    for axis, declared, play in zip("xy", problem.declared_clearance or (), clearance.play, strict=False):
        side = 0.5 * play
        if math.isfinite(side) and abs(side - declared) > max(1e-6, 0.01 * declared):
            yield (
                f"warning: along {axis}, {mm(declared)} mm a side are declared, {mm(round(side, 12))} mm measured; "
                "the plan rests on the measured one"
            )


def _start(problem: Problem) -> Iterator[str]:
    yield f"lowest point {mm(problem.approach)} mm above the mouth, tilted and beside the axis as the plan says"
    yield f"nominal trajectory from {_pose(problem.start, ',')} of the hole's frame"
    (x, y, z), (rx, ry, rz) = map(mm, problem.start_box[:3]), map(_deg, problem.start_box[3:])
    origin = ("as listed below" if problem.budget else "as stated") if problem.sources is None else "from its sources"
    box = f"{x}, {y}, {z} mm along x, y, z; +-{rx}, {ry}, {rz} deg about them"
    planar = f"{x}, {z} mm along x, z; +-{ry} deg about y, none out of the plane"
    yield f"error {origin}: +-{box if problem.plane is None else planar}"
    if not problem.framing.still and not problem.budget:
        where = "hole, which is askew by it" if problem.framing.hole.any() else "hand, so that it turns with the part"
        yield f"error fixed in the {where}"
    yield from _sources(problem)
    if problem.sources is not None:
        yield f"grasped {mm(problem.sources.grasp.height)} mm above the leading face"
    if problem.trapezoid is not None:
        ball, cone = problem.trapezoid
        yield f"S(t) for a ball of {mm(ball)} mm and a cone of {_deg(cone)} deg, for which nothing is proved"


def _drift(problem: Problem, clearance: Clearance) -> Iterator[str]:
    """How far velocity errors carry the part on its way down to the mouth, where that is more than a clearance."""
    far = drift(problem, clearance)
    if far.any():
        yield (
            f"beside that error it drifts by up to {mm(far[0])} mm and {_deg(far[3])} deg on its way down; "
            "a lower start.height has less of it"
        )


def _pose(P: Array, comma: str = "") -> str:
    turn = f"{comma} turned by ({', '.join(map(_deg, P[3:]))}) deg{comma}" if P[3:].any() else ""
    return f"({', '.join(map(mm, P[:3]))}) mm{turn}"


def _sources(problem: Problem) -> Iterator[str]:
    """The budget: each source with what it adds across the axis and about it, and its part of both."""
    # Along x and about y, as problems in the plane have these, too.
    across, angle = float(problem.start_box[0]), float(problem.start_box[4])
    for share in problem.budget:
        x, turn = float(share.box[0]), float(share.box[4])
        parts = f"{x / across if across else 0.0:.0%} and {turn / angle if angle else 0.0:.0%}"
        name = f"{share.source} ({share.symbol})" if share.symbol else share.source
        yield f"{name}: {mm(x)} mm along x, {_deg(turn)} deg ({parts}), fixed in the {share.frame}"


def _motion(problem: Problem) -> Iterator[str]:
    wanted, error = problem.specification, problem.velocity_error
    yield (
        f"at most {mm(wanted.speed)} mm/s; velocity off by up to "
        f"{100.0 * error.translation:.4g} % in translation, {100.0 * error.rotation:.4g} % in rotation"
    )
    yield (
        f"contacts held with {wanted.contact_force:.6g} N, torque at most {wanted.torque_limit:.6g} N*m, "
        f"friction {wanted.friction:.4g}; a guarded move ends at {wanted.termination_force:.6g} N"
    )
    if wanted.impact_force is not None and wanted.apparent_mass is not None and wanted.contact_stiffness is not None:
        yield (
            f"contacts met with at most {wanted.impact_force:.6g} N by {wanted.apparent_mass:.6g} kg on "
            f"{1e-3 * wanted.contact_stiffness:.6g} N/mm, at lower speed where that takes it"
        )


def _settings(problem: Problem) -> Iterator[str]:
    settings = problem.settings
    rho = settings.characteristic_length
    length = "half the diagonal of the mating section" if rho is None else f"{mm(rho)} mm"
    yield f"uncertainty: {settings.method}; placement: {settings.placement}; characteristic length: {length}"
    about = "y" if problem.plane is not None else "each of x and y"
    yield (
        f"tilted by up to about {_deg(settings.max_tilt)} deg about {about} at the start; "
        f"time limit {settings.time_limit:.6g} s"
    )
    if settings.evidence == "certified":
        yield "asked for: guarded moves, certified"
        return
    robot, (low, high) = problem.robot, problem.friction
    yield (
        f"asked for: presses, tested: a rate of {settings.min_rate:.4g} by {settings.draws} draws, "
        f"seed {settings.seed}; friction {low:.4g} to {high:.4g}"
        + ("" if settings.max_time is None else f"; 95 % within {settings.max_time:.4g} s")
    )
    yield (
        f"robot: {robot.preset}, {1e-3 * robot.stiffness:.6g} N/mm, {robot.turning:.6g} N m/rad where it holds, "
        f"{robot.mass:.6g} kg; wrench off by up to {robot.force_offset:.6g} N, {robot.torque_offset:.6g} N m"
    )


def assembly_facts(assembly: AssemblySequence, steps: Sequence[AssemblyStep]) -> dict[str, Any]:
    """The same as data: SI units, poses as (x, y, z, rotation vector)."""
    objects, tasks = [tree.name for tree in assembly.workcell.objects], [_step_facts(step) for step in steps]
    return {"valid": True, "title": assembly.title, "objects": objects, "tasks": tasks}


def _step_facts(step: AssemblyStep) -> dict[str, Any]:
    found = step.answer
    return {
        "name": step.name,
        "attachment": found.task.attachment,
        "exchanged": found.exchanged,
        "operands": {
            side: {
                "feature": str(operand.ref),
                "members": [str(ref) for ref in operand.members],
                "frame": operand.frame.vector().tolist(),
            }
            for side, operand in (("1", found.moving), ("2", found.fixed))
        },
        "start": found.P0.tolist(),
        "goal": found.PT.tolist(),
        "settled": [str(one) for one in found.settled],
        "carried": list(found.carried),
        "obstacles": [obstacle.name for obstacle in found.obstacles],
        "frames": {tree.name: tree.frame.vector().tolist() for tree in step.after.objects},
        "links": [{"kind": link.kind, "one": str(link.one), "other": str(link.other)} for link in step.after.links],
    }


def explain_assembly(assembly: AssemblySequence, steps: Sequence[AssemblyStep]) -> str:
    """The workcell and what each task comes to, one statement a line, lengths in mm and angles in degrees."""
    objects = ", ".join(tree.name for tree in assembly.workcell.objects)
    rows = listed({"objects": [objects], **{step.name: _statements(step) for step in steps}})
    return aligned(assembly.title, str(assembly.source.path), *rows)


def _statements(step: AssemblyStep) -> Iterator[str]:
    found = step.answer
    wanted = found.task
    yield f"{wanted.moving} into a {wanted.attachment} pair with {wanted.fixed}"
    if found.exchanged:
        yield "the hollow part is in the hand: answered as if the peg moved, in the frame of the hole"
    for side, operand in (("1", found.moving), ("2", found.fixed)):
        yield f"operand {side}: {', '.join(str(ref) for ref in operand.members)}"
    yield f"from {_pose(found.P0)} to {_pose(found.PT)}"
    yield from map(str, found.settled)
    others = ", ".join(found.carried[1:])
    if others:
        yield f"carried along: {others}"
    if found.obstacles:
        yield f"obstacles: {', '.join(obstacle.name for obstacle in found.obstacles)}"
    yield f"then linked: {', '.join(f'{link.one} - {link.other} ({link.kind})' for link in step.after.links)}"
