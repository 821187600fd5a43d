"""Lies about control, recovery, bounds of errors, and what is not covered."""

from collections.abc import Iterator
from random import Random
from typing import Any

from tests.shared.lies.lie import CONSTRUCTION, SAMPLING, Document, chosen, drawn, named


def not_covered(plan: Document, rng: Random) -> None:
    """Fewer words, or other ones, about what is left out."""
    texts = plan["not_covered"]
    k = rng.randrange(len(texts))
    if rng.random() < 0.5:
        texts.pop(k)
    else:
        texts[k] = texts[k] + " or not"


def _recovery(plan: Document) -> Any:
    found = plan.get("recovery")
    return found if found and found["lift"] is not None else None


def more_room(plan: Document, rng: Random) -> None:
    """More room to back off than there is."""
    recovery = _recovery(plan)
    if recovery is None:
        return
    entry = rng.choice(recovery["moves"])
    entry["room"] += drawn(rng, -9.0, -1.0)
    entry["back_off"] = entry["room"] > 0.0


def wider_cover(plan: Document, rng: Random) -> None:
    """More start errors covered than retries cover."""
    recovery = plan.get("recovery")
    if not recovery:
        return
    axis = rng.randrange(6)
    recovery["covers"][axis] += drawn(rng, -9.0, -2.0)


def moved_retry(plan: Document, rng: Random) -> None:
    """A retry elsewhere, so that something between the boxes is not covered."""
    recovery = plan.get("recovery")
    if not recovery or not recovery["retries"]:
        return
    # The last one is the start again.
    outer = [offset for offset in recovery["retries"] if any(offset)]
    offset = rng.choice(outer)
    axis = rng.choice([k for k in range(2) if offset[k]])
    offset[axis] *= 1.0 + drawn(rng, -9.0, -1.0)


def lower_lift(plan: Document, rng: Random) -> None:
    """A lift that begins lower, or is carried lower, than nothing is in the way."""
    recovery = _recovery(plan)
    if recovery is None:
        return
    if rng.random() < 0.5:
        recovery["lift"]["above"] -= drawn(rng, -9.0, -2.0)
    elif recovery["retries"]:
        recovery["lift"]["clear"] = max(v[2] for v in plan["parts"]["fixed"]["vertices"]) - drawn(rng, -9.0, -3.0)


def _controls(plan: Document) -> Iterator[Any]:
    for segment in plan["segments"]:
        if "hybrid" in segment:
            yield segment["hybrid"]


def surer_contacts(plan: Document, rng: Random) -> None:
    """Held contacts that are said to stay closed under more than they do."""
    told = [hybrid for hybrid in _controls(plan) if hybrid.get("stays", "push") != "push"]
    hybrid = chosen(rng, told)
    hybrid["stays"] = "push" if hybrid["stays"] == "stop" else rng.choice(("push", "stop"))


def pulled_contact(plan: Document, rng: Random) -> None:
    """A held contact that the bias pulls at, or does not press."""
    pressing = [hybrid for hybrid in _controls(plan) if hybrid["normal_forces"]]
    item = rng.choice(chosen(rng, pressing)["normal_forces"])
    item["force"] = rng.choice((0.0, -1.0)) * item["force"]


def weaker_push(plan: Document, rng: Random) -> None:
    """A push too weak to make the contact felt."""
    pushing = [hybrid for hybrid in _controls(plan) if hybrid["push"] > 0.0 and hybrid["termination"]["contacts"]]
    chosen(rng, pushing)["push"] *= 1e-3


def stronger_bias(plan: Document, rng: Random) -> None:
    """More force than the specification allows."""
    pressing = [hybrid for hybrid in _controls(plan) if hybrid["normal_forces"]]
    item = rng.choice(chosen(rng, pressing)["normal_forces"])
    item["force"] += plan["specification"]["contact_force"]


def wider_jam_free(plan: Document, rng: Random) -> None:
    """A wrench that may turn further than its twists prove."""
    told = [h["jam_free"] for h in _controls(plan) if h.get("jam_free", {}).get("angle")]
    stated = chosen(rng, told)
    if rng.random() < 0.5:
        stated["angle"] = min(stated["angle"] * (1.0 + drawn(rng, -6.0, 0.0)), 3.14)
    else:
        stated["planes"] = [{**plane, "angles": [3.1, 3.1]} for plane in stated["planes"]]


def shrunk_sets(plan: Document, rng: Random) -> None:
    """Bounds of errors drawn together alike, all along."""
    share = 1.0 - drawn(rng, -6.0, -1.0)
    for segment in plan["segments"]:
        tube = segment["tube"]
        for key in ("offset_box", "angle_box"):
            tube[key] = [x * share for x in tube[key]]
        tube["theta_max"] *= share


LIES = (
    *named(CONSTRUCTION, False, not_covered, more_room, wider_cover, moved_retry, lower_lift),
    *named(CONSTRUCTION, False, wider_jam_free, shrunk_sets),
    *named(SAMPLING, False, surer_contacts),
    *named(CONSTRUCTION, True, pulled_contact, weaker_push, stronger_bias),
)
