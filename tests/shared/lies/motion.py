"""Lies about the motion: contacts, their order, poses, witnesses."""

from itertools import pairwise
from random import Random
from typing import Any

from tests.shared.lies.lie import CONSTRUCTION, PROBLEM, SAMPLING, Document, around, chosen, drawn, named


def _later(plan: Document, rng: Random) -> tuple[int, Any]:
    """A segment that is not the first, and its number."""
    k = rng.randrange(1, len(plan["segments"]))
    return k, plan["segments"][k]


def wrong_feature(plan: Document, rng: Random) -> None:
    """A contact of another vertex or edge than the one that touches."""
    contact = chosen(rng, plan["contacts"])
    side = rng.choice(("moving", "fixed"))
    place, part = contact[side], plan["parts"][side]
    loops = [face[0] for face in part["faces"]]
    now = place["vertices"]
    if len(now) > 2:
        others = [loop for loop in loops if set(loop) != set(now)]
    elif len(now) == 2:
        edges = [[a, b] for loop in loops for a, b in around(loop)]
        others = [edge for edge in edges if set(edge) != set(now)]
    else:
        others = [[k] for k in range(len(part["vertices"])) if [k] != now]
    place["vertices"] = list(rng.choice(others))


def swapped_features(plan: Document, rng: Random) -> None:
    """Two contacts of a kind that have taken each other's names."""
    kinds = [[c for c in plan["contacts"] if c["kind"] == kind] for kind in ("vertex-face", "edge-edge")]
    kinds = [found for found in kinds if len(found) > 1]
    one, other = rng.sample(chosen(rng, kinds), 2)
    one["id"], other["id"] = other["id"], one["id"]


def extra_contact(plan: Document, rng: Random) -> None:
    """A contact that is said to be held from a move on, and that nothing made."""
    k, segment = _later(plan, rng)
    unheld = [c["id"] for c in plan["contacts"] if c["id"] not in segment["goal_state"]]
    name = chosen(rng, unheld)
    for later in plan["segments"][k:]:
        for key in ("state", "goal_state"):
            later[key] = [*later[key], *([name] if name not in later[key] else [])]
        later["leaving"] = [x for x in later.get("leaving", []) if x != name]
        if not later["leaving"]:
            del later["leaving"]


def extra_contact_made(plan: Document, rng: Random) -> None:
    """A contact that is said to come with the one that a move makes."""
    making = sorted({s["move"] for s in plan["segments"] if any(b["made"] for b in s["basis"])})
    move = chosen(rng, making)
    unheld = [c["id"] for c in plan["contacts"] if all(c["id"] not in s["goal_state"] for s in plan["segments"])]
    later_on = next(s for s in plan["segments"] if s["move"] == move)["goal_state"]
    unheld += [i for s in plan["segments"] if s["move"] > move for i in s["goal_state"] if i not in later_on]
    name = chosen(rng, sorted(set(unheld)))
    for segment in plan["segments"]:
        if segment["move"] == move and name not in segment["goal_state"]:
            segment["goal_state"].append(name)


def dropped_contact(plan: Document, rng: Random) -> None:
    """A contact that is held, and not spoken of from a move on."""
    holding = [k for k, s in enumerate(plan["segments"]) if s["state"]]
    k = chosen(rng, holding)
    name = rng.choice(plan["segments"][k]["state"])
    for later in plan["segments"][k:]:
        for key in ("state", "goal_state"):
            later[key] = [x for x in later[key] if x != name]
        later["basis"] = [b for b in later["basis"] if b["contact"] != name or b["made"]]
        if "hybrid" in later:
            forces = later["hybrid"]["normal_forces"]
            later["hybrid"]["normal_forces"] = [f for f in forces if f["contact"] != name]


def other_contact_made(plan: Document, rng: Random) -> None:
    """A move that ends by another contact than the one that it makes."""
    making = [s for s in plan["segments"] if any(b["made"] for b in s["basis"])]
    move = chosen(rng, making)["move"]
    moved = [s for s in plan["segments"] if s["move"] == move]
    others = [c["id"] for c in plan["contacts"] if c["id"] not in moved[0]["state"]]
    was = next(b["contact"] for b in moved[0]["basis"] if b["made"])
    name = rng.choice(others)
    if name == was:
        return
    for segment in moved:
        segment["goal_state"] = [x for x in segment["goal_state"] if x not in (was, name)] + [name]
        for entry in segment["basis"]:
            entry["contact"] = name if entry["made"] else entry["contact"]


def nothing_left(plan: Document, rng: Random) -> None:
    """A move that gives contacts up, and says that it does not."""
    leaving = [s for s in plan["segments"] if s.get("leaving")]
    move = chosen(rng, leaving)["move"]
    for segment in plan["segments"]:
        if segment["move"] == move:
            gone = segment.pop("leaving")
            if rng.random() < 0.5:
                segment["state"], segment["goal_state"] = segment["state"] + gone, segment["goal_state"] + gone


def swapped_basis(plan: Document, rng: Random) -> None:
    """Contacts of a basis in another order, or one of them another contact of the state."""
    long = [s for s in plan["segments"] if len(s["basis"]) > 1]
    segment = chosen(rng, long)
    entry = rng.choice([b for b in segment["basis"] if not b["made"]] or segment["basis"])
    if entry["made"] or rng.random() < 0.3:
        segment["basis"].reverse()
    else:
        entry["contact"] = rng.choice(segment["state"])


def dropped_segment(plan: Document, rng: Random) -> None:
    """A piece of motion left out, the one after it from where it began."""
    if len(plan["segments"]) < 3:
        return
    k = rng.randrange(len(plan["segments"]) - 1)
    gone = plan["segments"].pop(k)
    after = plan["segments"][k]
    after["start"] = list(gone["start"])
    if after["move"] == gone["move"]:
        after["progress"][0] = gone["progress"][0]


def swapped_moves(plan: Document, rng: Random) -> None:
    """Two moves that follow each other in the other order."""
    moves = sorted({s["move"] for s in plan["segments"]})
    if len(moves) < 3:
        return
    m = rng.choice(moves[:-1])
    first, second = ([s for s in plan["segments"] if s["move"] == n] for n in (m, m + 1))
    k = plan["segments"].index(first[0])
    for segment in (*first, *second):
        segment["move"] = 2 * m + 1 - segment["move"]
    plan["segments"][k : k + len(first) + len(second)] = [*second, *first]


def renumbered_moves(plan: Document, rng: Random) -> None:
    """Moves with a number left out or told twice."""
    k, _ = _later(plan, rng)
    shift = rng.choice((-1, 1))
    numbers = [max(0, s["move"] + shift * (j >= k)) for j, s in enumerate(plan["segments"])]
    if any(b - a not in (0, 1) for a, b in pairwise(numbers)):
        for segment, number in zip(plan["segments"], numbers, strict=True):
            segment["move"] = number


def uneven_progress(plan: Document, rng: Random) -> None:
    """Pieces of a move that take another share of it than they say."""
    inner = [k for k, s in enumerate(plan["segments"]) if s["progress"][1] < 1.0]
    k = chosen(rng, inner)
    one, other = plan["segments"][k : k + 2]
    share = drawn(rng, -9.0, -1.0) * rng.choice((-1.0, 1.0))
    at = one["progress"][1] + share * (one["progress"][1] - one["progress"][0])
    if not one["progress"][0] < at < other["progress"][1]:
        return
    one["progress"][1] = other["progress"][0] = at


def displaced_pose(plan: Document, rng: Random) -> None:
    """A pose between two segments elsewhere."""
    k, segment = _later(plan, rng)
    axis = rng.randrange(6)
    off = drawn(rng, -12.0, -3.0) * rng.choice((-1.0, 1.0)) * (1.0 if axis < 3 else 50.0)
    pose = list(segment["start"])
    pose[axis] += off
    segment["start"], plan["segments"][k - 1]["goal"] = pose, list(pose)


def ends_short(plan: Document, rng: Random) -> None:
    """A goal that is not the problem's."""
    last, axis = plan["segments"][-1], rng.choice((2, 3, 4, 5))
    pose = list(last["goal"])
    pose[axis] += drawn(rng, -5.5, -3.0)
    last["goal"], plan["goal"] = pose, list(pose)


def ends_early(plan: Document, rng: Random) -> None:
    """The last moves left out."""
    moves = plan["segments"][-1]["move"]
    if moves < 1:
        return
    keep = rng.randrange(moves)
    plan["segments"] = [s for s in plan["segments"] if s["move"] <= keep]
    plan["goal"] = list(plan["segments"][-1]["goal"])
    if "recovery" in plan:
        plan["recovery"]["moves"] = [m for m in plan["recovery"]["moves"] if m["move"] <= keep]


def other_witness(plan: Document, rng: Random) -> None:
    """Another face between two pieces."""
    item = rng.choice(rng.choice(plan["segments"])["separations"])
    side = rng.choice(("moving", "fixed"))
    loop = rng.choice(plan["parts"][side]["pieces"][item[f"{side}_piece"]]["faces"])[0]
    item["witness"] = {"kind": f"{side}-face", "moving": [], "fixed": [], side: list(loop)}


def tilted_witness(plan: Document, rng: Random) -> None:
    """A plane between two pieces, tilted or shifted."""
    planes = [i for s in plan["segments"] for i in s["separations"] if i["witness"]["kind"] == "plane"]
    witness = chosen(rng, planes)["witness"]
    witness["normal"] = [x + drawn(rng, -9.0, 0.0) * rng.gauss(0.0, 1.0) for x in witness["normal"]]
    witness["normal"] = [max(-1.0, min(1.0, x)) for x in witness["normal"]]
    witness["offset"] -= drawn(rng, -9.0, -2.0)


LIES = (
    *named(SAMPLING, True, wrong_feature, swapped_features, extra_contact, extra_contact_made, dropped_contact),
    *named(SAMPLING, True, other_contact_made, nothing_left, swapped_basis, dropped_segment, swapped_moves),
    *named(SAMPLING, True, uneven_progress, displaced_pose, other_witness, tilted_witness),
    *named(CONSTRUCTION, True, renumbered_moves),
    *named(PROBLEM, True, ends_short, ends_early),
)
