"""Recovery: lifting touches nothing new, shifted boxes cover, orders follow from contacts, false claims are refused."""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmopt.geometry.convex_pieces import pieces, polyhedron
from fmopt.geometry.csg import Box, Difference, Hull, Moved, Prism, Solid, Union
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.plan import parsed
from fmopt.plan.export.cautions import failing_words
from fmopt.plan.export.urscript import program
from fmopt.planning.control.recovery import underside
from fmopt.report.recovery_tables import recovery_chapter, recovery_words
from fmopt.spatial.se3 import Pose, exp
from fmopt.verify import PlanError, verify
from fmopt.verify.arithmetic.rational import number
from fmopt.verify.control.recovery import underside as checked_underside
from fmopt.verify.parts.solids import Shape
from fmopt.verify.reading.document import Body
from tests.shared.executions.geometry import Convex, gaps, rotations
from tests.shared.lies.mutations import changed
from tests.shared.solids import frustum, raised

Array = np.ndarray[Any, np.dtype[np.float64]]
Plan = dict[str, Any]


# Bottoms lie at z = 0. The last three look down above that: a hole wider below, a cut from the side, legs.
BLOCK = Difference(Box((0.06, 0.06, 0.04)), (raised(Box((0.0202, 0.0202, 0.04)), 0.01),))
FUNNEL = Difference(BLOCK, (raised(frustum((0.0202, 0.0202), (0.0302, 0.0302), 0.006), 0.035),))
PLATE = Difference(Box((0.06, 0.06, 0.009)), (raised(Box((0.0202, 0.0202, 0.02)), -0.005),))
HEXAGON = tuple((0.012 * np.cos(k * np.pi / 3.0), 0.012 * np.sin(k * np.pi / 3.0)) for k in range(6))
WIDER = Difference(
    Box((0.06, 0.06, 0.04)), (raised(Box((0.0202, 0.0202, 0.06)), -0.01), raised(Box((0.04, 0.04, 0.02)), 0.01))
)
SLOTTED = Difference(BLOCK, (Moved(Box((0.05, 0.02, 0.006)), Pose(np.array([0.03, 0.0, 0.018]), np.eye(3))),))
LEGS = Difference(Box((0.06, 0.06, 0.04)), (Box((0.08, 0.03, 0.01)), raised(Box((0.0202, 0.0202, 0.04)), 0.005)))
FIXED: dict[str, tuple[Solid, float]] = {
    "block": (BLOCK, 0.0),
    "funnel": (FUNNEL, 0.0),
    "plate": (PLATE, 0.0),
    "six sides": (Difference(Box((0.06, 0.06, 0.03)), (raised(Prism(HEXAGON, 0.04), 0.01),)), 0.0),
    "wider below": (WIDER, 0.03),
    "slotted": (SLOTTED, 0.024),
    "legs": (LEGS, 0.01),
}
PEG = Box((0.02, 0.02, 0.05))
KNOB = Union((Box((0.012, 0.012, 0.019)), raised(Box((0.019, 0.019, 0.006)), 0.012)))  # looks up as well as down
UP = np.array([0.0, 0.0, 1.0])
MOVING = {"peg": PEG, "knob": KNOB}


def bodies(solid: Solid) -> list[Convex]:
    found = [(piece.vertices, [[list(loop) for loop in face.loops] for face in piece.faces]) for piece in pieces(solid)]
    return [Convex.read({"vertices": vertices, "faces": faces}) for vertices, faces in found]


def room(moving: list[Convex], fixed_: list[Convex], p: Array, R: Array) -> Array:
    """Widest slab between the parts (n,), at the pair of pieces where it is least."""
    return np.min([gaps(a, b, p, R) for a in moving for b in fixed_], axis=0)


def touching_poses(moving: list[Convex], fixed_: list[Convex], seed: int, count: int) -> tuple[Array, Array]:
    """Poses free of collision, in and around a hole, each moved on at random until it all but touches."""
    rng = np.random.default_rng(seed)
    p = rng.uniform((-0.008, -0.008, 0.0), (0.008, 0.008, 0.05), (count, 3))
    p[:, :2] *= 10.0 ** rng.uniform(-3.0, 0.0, (count, 1))
    R = rotations(rng.uniform(-0.4, 0.4, (count, 3)) * 10.0 ** rng.uniform(-3.0, 0.0, (count, 1)))
    free = room(moving, fixed_, p, R) > 0.0
    p, R = p[free], R[free]
    way = rng.normal(size=(len(p), 3)) * (0.01, 0.01, 0.02)
    low, high = np.zeros(len(p)), np.ones(len(p))
    for _ in range(40):
        middle = 0.5 * (low + high)
        clear = room(moving, fixed_, p + middle[:, None] * way, R) > 0.0
        low, high = np.where(clear, middle, low), np.where(clear, high, middle)
    return p + low[:, None] * way, R


def lowest(moving: list[Convex], p: Array, R: Array) -> Array:
    points = np.concatenate([piece.vertices for piece in moving])
    return np.asarray((p[:, None] + points @ R.transpose(0, 2, 1))[:, :, 2].min(axis=1))


@pytest.mark.parametrize("name", FIXED)
def test_the_underside_is_where_faces_look_down_highest(name: str) -> None:
    solid, height = FIXED[name]
    body = polyhedron(solid)
    assert underside(body) == pytest.approx(height, abs=1e-12)
    assert number(checked_underside(shape_of(body))) == underside(body)


def shape_of(body: Polyhedron) -> Shape:
    return Shape(Body(tuple(map(tuple, body.vertices.tolist())), tuple(face.loops for face in body.faces)))


def test_walls_may_lean_over_by_less_than_what_is_the_same_point() -> None:
    for lean, height in ((5e-13, 0.0), (5e-12, 0.03)):
        half = np.array([0.01, 0.01])
        top = half + lean
        points = [[x * a, y * b, z] for z, (a, b) in ((0.0, half), (0.03, top)) for x in (-1, 1) for y in (-1, 1)]
        body = polyhedron(Hull(tuple(tuple(float(v) for v in point) for point in points)))
        assert underside(body) == pytest.approx(height, abs=1e-12)
        assert number(checked_underside(shape_of(body))) == pytest.approx(height, abs=1e-12)


@pytest.mark.parametrize("part", MOVING)
@pytest.mark.parametrize("name", FIXED)
def test_what_is_lifted_from_above_the_underside_touches_nothing(name: str, part: str) -> None:
    moving, fixed_ = bodies(MOVING[part]), bodies(FIXED[name][0])
    p, R = touching_poses(moving, fixed_, seed=7, count=400)
    above = lowest(moving, p, R) > FIXED[name][1]
    p, R = p[above], R[above]
    assert len(p) > 60
    assert (room(moving, fixed_, p, R) < 1e-6).sum() > 30
    for height in (1e-5, 1e-4, 5e-4, 2e-3, 5e-3, 0.01, 0.02, 0.05):
        assert room(moving, fixed_, p + height * UP, R).min() > -1e-12


def test_below_the_underside_lifting_collides() -> None:
    for name, part in (("wider below", "knob"), ("plate", "knob")):
        moving, fixed_ = bodies(MOVING[part]), bodies(FIXED[name][0])
        p, R = np.array([[0.008, 0.0, 0.0105 if name == "wider below" else -0.03]]), np.eye(3)[None]
        assert room(moving, fixed_, p, R)[0] > 0.0
        assert lowest(moving, p, R)[0] < FIXED[name][1]
        assert min(room(moving, fixed_, p + h * UP, R)[0] for h in np.linspace(0.0, 0.05, 50)) < -1e-3


def test_the_plan_offers_to_back_off_and_to_try_again(square_peg_plan: Plan) -> None:
    said = square_peg_plan["recovery"]
    assert square_peg_plan["verdict"] == "CERTIFIED"
    assert (said["lift"]["above"], len(said["retries"])) == (-0.04, 9)
    assert said["retries"][-1] == [0.0] * 6
    assert all(move["order"][felt][-1] == 8 for move in said["moves"] for felt in ("early", "late"))
    assert said["why"] == ""
    assert [move["back_off"] for move in said["moves"]] == [True] * 7
    box = square_peg_plan["uncertainty"]["start_box"]
    assert said["covers"] == pytest.approx([3.0 * box[0], 3.0 * box[1], *box[2:]], rel=1e-15)
    # The peg ends on the floor of the hole, 10 mm above the underside of the block.
    assert 0.0085 < said["moves"][-1]["room"] < 0.01


def test_every_error_that_is_covered_is_one_of_a_start(square_peg_plan: Plan) -> None:
    said, box = square_peg_plan["recovery"], np.array(square_peg_plan["uncertainty"]["start_box"])
    errors = np.random.default_rng(3).uniform(-1.0, 1.0, (4000, 6)) * said["covers"]
    errors[:64] = np.sign(errors[:64]) * said["covers"]
    errors[64:128, 0] = np.array(box[0])  # where two boxes meet
    starts = np.vstack([np.zeros(6), said["retries"]])
    inside = (np.abs(errors[:, None] + starts) <= box * (1.0 + 1e-12)).all(axis=2)
    assert inside.any(axis=1).all()
    assert not inside[:, 0].all()


def test_what_is_carried_back_stays_above_the_top(square_peg_plan: Plan) -> None:
    said, rng = square_peg_plan["recovery"], np.random.default_rng(5)
    points = np.array(square_peg_plan["parts"]["moving"]["vertices"])
    top = max(v[2] for v in square_peg_plan["parts"]["fixed"]["vertices"])
    first = Pose.from_vector(square_peg_plan["segments"][0]["start"])
    box = np.array(square_peg_plan["uncertainty"]["start_box"])
    lows = []
    for segment in square_peg_plan["segments"]:
        pose = Pose.from_vector(segment["goal"])
        turn = Pose(np.zeros(3), pose.R).local(Pose(np.zeros(3), first.R))[3:]
        assert np.linalg.norm(turn) <= said["lift"]["turn"]
        for share in np.linspace(0.0, 1.0, 9):
            e = rng.choice([-1.0, 1.0], 6) * box
            along = exp(share * turn) @ pose.R
            heights = (1.0 - share) * (points @ pose.R.T)[:, 2].min() + share * (points @ first.R.T)[:, 2].min()
            z = said["lift"]["clear"] - heights  # of the reference point, going evenly from one end to the other
            lows.append(z + e[2] + (points @ (exp(e[3:]) @ along).T)[:, 2].min())
    assert min(lows) > top


def _set(*path: Any) -> Callable[[Any], Callable[[Plan], None]]:
    def to(value: Any) -> Callable[[Plan], None]:
        def change(plan: Plan) -> None:
            place: Any = plan["recovery"]
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = value(place[path[-1]]) if callable(value) else value

        return change

    return to


FALSE: dict[str, tuple[Callable[[Plan], None], str]] = {
    "above": (_set("lift", "above")(-0.0400001), "looks down"),
    "clear": (_set("lift", "clear")(0.0008), "lift.clear: is short by"),
    "below the start": (_set("lift", "clear")(0.0005), "is below the start"),
    "turn": (_set("lift", "turn")(lambda x: 0.5 * x), "is turned further"),
    "room": (_set("moves", 6, "room")(lambda x: x + 1e-7), "of room are stated"),
    "no back-off": (_set("moves", 2, "back_off")(False), "does not where it has"),
    "covers": (_set("covers", 0)(lambda x: x * (1.0 + 1e-14)), "no start covers"),
    "turns": (_set("covers", 5)(lambda x: 2.0 * x), "otherwise than in x and y"),
    "a retry less": (
        lambda plan: (
            plan["recovery"]["retries"].pop(0),
            [m["order"].update(early=list(range(8)), late=list(range(8))) for m in plan["recovery"]["moves"]],
        )[0],
        "no start covers",
    ),
    "a retry aside": (_set("retries", 7, 0)(lambda x: 0.999 * x), "no start covers"),
    "a retry lower": (_set("retries", 1, 2)(-1e-4), "otherwise than in x and y"),
    "a move less": (_set("moves")(lambda moves: moves[1:]), "one entry for each move"),
    "no lift": (_set("lift")(None), "without a lift"),
}


@pytest.mark.parametrize("name", FALSE)
def test_false_claims_are_not_certified(square_peg_plan: Plan, name: str) -> None:
    change, words = FALSE[name]
    verdict = verify(changed(square_peg_plan, change))
    assert verdict.verdict == "NOT_PROVED"
    assert all(finding.what.startswith("recovery") for finding in verdict.findings)
    assert any(words in str(finding) for finding in verdict.findings)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_set("moves", 0, "order", "late")([0, 1, 2, 3, 4, 5, 6, 7, 7]), "repeats an index"),
        (_set("moves", 0, "order", "late")([0, 1, 2]), "must name each retry once"),
        (_set("lift", "direction")([0.0, 1.0, 0.0]), "must be the z"),
        (_set("retries")([[0.0] * 6] * 65), "at most 64"),
        (_set("first")([]), "unknown key"),
    ],
)
def test_recoveries_of_another_form_are_refused(square_peg_plan: Plan, change: Any, words: str) -> None:
    with pytest.raises(PlanError, match=words):
        verify(changed(square_peg_plan, change))


def test_a_start_below_the_top_is_nowhere_to_carry_the_part_to(square_peg_plan: Plan) -> None:
    def change(plan: Plan) -> None:
        plan["uncertainty"]["start_box"][3] = plan["recovery"]["covers"][3] = 0.2

    found = [str(finding) for finding in verify(changed(square_peg_plan, change)).findings]
    assert any("below the top" in words for words in found)
    assert any("lift.clear: is short" in words for words in found)


def test_a_plan_without_recovery_is_judged_as_before(square_peg_plan: Plan) -> None:
    plain = changed(square_peg_plan, lambda plan: plan.pop("recovery"))
    assert verify(plain).verdict == "CERTIFIED"


def test_coverings_are_compared_exactly(square_peg_plan: Plan) -> None:
    """Three boxes in a row and a gap of one unit in the last place between two of them."""
    a = square_peg_plan["uncertainty"]["start_box"][0]
    b = square_peg_plan["uncertainty"]["start_box"][1]

    def of(offsets: list[float], reach: float) -> Plan:
        def change(plan: Plan) -> None:
            said = plan["recovery"]
            said["retries"] = [[x, 0.0, 0.0, 0.0, 0.0, 0.0] for x in offsets]
            said["covers"] = [reach, b, *said["covers"][2:]]
            for move in said["moves"]:
                move["order"] = {"early": [0, 1], "late": [1, 0]}

        return changed(square_peg_plan, change)

    assert verify(of([-2.0 * a, 2.0 * a], 2.99 * a)).verdict == "CERTIFIED"
    assert verify(of([-2.0 * a, np.nextafter(2.0 * a, 1.0)], 2.99 * a)).verdict == "NOT_PROVED"


def test_people_are_told_what_to_do(square_peg_plan: Plan) -> None:
    plan = parsed(square_peg_plan)
    said = plan.recovery
    [lifted, again] = recovery_words(plan)
    assert lifted == "When a move fails the part can be lifted straight out of the hole in moves 1 to 7."
    assert again == "Tried again from 8 starts aside, the plan holds for start errors of x ±0.9 mm, y ±0.9 mm."
    page = recovery_chapter(plan)
    firsts = plan.description.diagnostics.unplanned
    assert page.count(" touches ") == len(firsts) > 5
    assert all(f"{first.factor:.3g}" in page for first in firsts)
    moves = tuple(replace(move, back_off=k not in (2, 6)) for k, move in enumerate(said.moves))
    through = replace(plan, recovery=replace(said, moves=moves, retries=(), why="it is <so>"))
    lifted, again = recovery_words(through)
    assert "in moves 1, 2 and 4 to 6, in moves 3 and 7 only while" in lifted
    assert "lies above z = −40 mm." in lifted
    assert again == "It is not to be tried again: it is <so>."
    assert "it is &lt;so&gt;" in recovery_chapter(through)
    undercut = replace(plan, recovery=replace(said, lift=None, why="it cannot"))
    assert recovery_words(undercut) == ["When a move fails there is no way back that is known to be free: it cannot."]
    assert recovery_words(replace(plan, recovery=None)) == []


def test_exported_programs_tell_which_way_is_out(square_peg_plan: Plan) -> None:
    tipped = Pose(np.zeros(3), exp([0.5 * np.pi, 0.0, 0.0]))
    plan = parsed(square_peg_plan)
    assert plan.recovery is not None
    words = failing_words(plan, tipped)
    assert "lifted along [0, -1, 0] in the base while its lowest point is above z = -0.04 m" in words
    assert failing_words(replace(plan, recovery=None), tipped) == ""
    assert failing_words(replace(plan, recovery=replace(plan.recovery, lift=None)), tipped) == ""
    assert f"# W{words[1:]}.\n" in program(plan, tipped)


@pytest.mark.parametrize("undercut", [False, True])
def test_a_part_with_an_undercut_at_its_mouth_is_not_lifted(square_peg_plan: Plan, undercut: bool) -> None:
    """The block of the plan, and one whose hole is wider below, which a plan made for the first does not know."""
    body = polyhedron(WIDER if undercut else BLOCK)
    shift = -0.04
    vertices = [[x, y, z + shift] for x, y, z in body.vertices.tolist()]
    faces = [[list(loop) for loop in face.loops] for face in body.faces]
    pieces_ = [[p.vertices + shift * UP, p.faces] for p in pieces(WIDER if undercut else BLOCK)]
    listed = [{"vertices": v.tolist(), "faces": [[list(f.loops[0])] for f in fs]} for v, fs in pieces_]

    said = {"vertices": vertices, "faces": faces, "pieces": listed}
    found = verify(changed(square_peg_plan, lambda plan: plan["parts"]["fixed"].update(said))).findings
    assert any("looks down" in str(finding) for finding in found) == undercut


def test_the_copies_are_not_shared(square_peg_plan: Plan) -> None:
    before = copy.deepcopy(square_peg_plan["recovery"])
    changed(square_peg_plan, FALSE["above"][0])
    assert square_peg_plan["recovery"] == before
