"""Lies about what a plan is for: errors, weights, forces, units, frames, the part."""

from random import Random

from tests.shared.lies.lie import PROBLEM, Document, chosen, drawn, named


def _resized(plan: Document, box: list[float]) -> None:
    """Another start box, and retries that cover as much of it."""
    was = plan["uncertainty"]["start_box"]
    plan["uncertainty"]["start_box"] = box
    ratio = [x / y if y else 1.0 for x, y in zip(box, was, strict=True)]
    if "recovery" in plan:
        recovery = plan["recovery"]
        for offset in (recovery["covers"], *recovery["retries"]):
            offset[:] = [x * r for x, r in zip(offset, ratio, strict=True)]


def smaller_box(plan: Document, rng: Random) -> None:
    """Smaller start errors than the problem's."""
    share = 1.0 - drawn(rng, -6.0, -0.3)
    _resized(plan, [x * share for x in plan["uncertainty"]["start_box"]])


def flat_box(plan: Document, rng: Random) -> None:
    """Start errors without one of their axes."""
    box = list(plan["uncertainty"]["start_box"])
    axes = [k for k in range(2, 6) if box[k] > 0.0]
    box[chosen(rng, axes)] = 0.0
    _resized(plan, box)


def slower_drift(plan: Document, rng: Random) -> None:
    """Smaller velocity errors than the problem's."""
    rates = plan["uncertainty"]["velocity_error"]
    k = rng.randrange(2)
    rates[k] *= rng.choice((0.0, 1.0 - drawn(rng, -6.0, -0.1)))


def longer_rho(plan: Document, rng: Random) -> None:
    """Another length that weighs rotation: a longer one hides rotation errors."""
    plan["uncertainty"]["rho"] *= 1.0 + rng.choice((-1.0, 1.0)) * drawn(rng, -6.0, -0.6)


def other_specification(plan: Document, rng: Random) -> None:
    """Other forces, friction or speed than the problem's."""
    specification = plan["specification"]
    key = rng.choice(sorted(specification))
    specification[key] *= 1.0 + rng.choice((-1.0, 1.0)) * drawn(rng, -6.0, -0.5)


def other_problem(plan: Document, rng: Random) -> None:
    """The digest of another problem."""
    plan["problem"]["sha256"] = f"{rng.getrandbits(256):064x}"


def other_units(plan: Document, rng: Random) -> None:
    """Numbers that are said to be of another unit."""
    if "units" not in plan:
        return
    other = {"m": "mm", "rad": "deg", "N": "kN", "N m": "N mm", "s": "min"}
    key = rng.choice(sorted(plan["units"]))
    plan["units"][key] = other.get(plan["units"][key], "mm")


def other_frames(plan: Document, rng: Random) -> None:
    """Frames that are said to be elsewhere, or one another's."""
    if "frames" not in plan:
        return
    frames = plan["frames"]
    one, other = rng.sample(sorted(frames), 2)
    if rng.random() < 0.5:
        frames[one], frames[other] = frames[other], frames[one]
    else:
        frames[one] = frames[one].replace(rng.choice(frames[one].split()), "not", 1)


def other_clearance(plan: Document, rng: Random) -> None:
    """Another declared clearance."""
    part = plan["parts"][rng.choice(("moving", "fixed"))]
    if not part.get("declared_clearance"):
        return
    part["declared_clearance"][0] *= 1.0 + drawn(rng, -6.0, 0.0)


def shifted_part(plan: Document, rng: Random) -> None:
    """A moving part that reaches elsewhere from its reference point than the problem's, the motion moved along."""
    axis, off = rng.randrange(3), drawn(rng, -9.0, -4.0)
    part = plan["parts"]["moving"]
    for body in (part, *part["pieces"]):
        for vertex in body["vertices"]:
            vertex[axis] += off


LIES = (
    *named(PROBLEM, True, smaller_box, flat_box, slower_drift, longer_rho, other_specification, shifted_part),
    *named(PROBLEM, False, other_problem, other_units, other_frames, other_clearance),
)
