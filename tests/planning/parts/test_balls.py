"""Balls: their contact from its definition, their clearances, a certified plan for a ball-ended pin, and lies about it.

The contact of a ball on a face is a worked example of a kind of contact that is added by its definition alone.
"""

import inspect
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmopt.certificate.rows import balls_above, points_above
from fmopt.contact import definitions
from fmopt.contact.c_surface import Surfaces, contact_point, definition
from fmopt.contact.derive import derived, latex
from fmopt.contact.primitive import Kind, ball_face, feature_distances, near_contacts
from fmopt.errors import InputError
from fmopt.execution.trials import Trials, run
from fmopt.geometry import csg
from fmopt.geometry.clearance import interference, penetration
from fmopt.geometry.convex_pieces import faceted
from fmopt.geometry.part import Part, part_of, with_balls
from fmopt.geometry.polyhedron import Polyhedron, from_faces, placed
from fmopt.plan import parsed
from fmopt.planning.same_problem import differences
from fmopt.report.bodies import contact_place
from fmopt.report.scene import scene_data
from fmopt.spatial.se3 import Pose, exp
from fmopt.task.problem import load
from fmopt.verify import CERTIFIED, NOT_PROVED, REFUTED, PlanError, verify
from fmopt.verify.reading.parse import parse
from tests import ROOT
from tests.shared.executions.executing import executed
from tests.shared.executions.geometry import Convex, gaps
from tests.shared.files.shipped import copied, edit
from tests.shared.lies.restate import restated
from tests.shared.parts.square import block
from tests.shared.plans.table_plan import sealed

PROBLEM = ROOT / "problems" / "ball_pin.toml"
Document = dict[str, Any]


@cache
def solved() -> str:
    """The plan of the shipped problem, as JSON."""
    from fmopt import plan
    from fmopt.planning.pipeline import synthesise

    return plan.canonical(synthesise(load(PROBLEM)).document)


@pytest.fixture
def ball_plan() -> Document:
    return dict(json.loads(solved()))


def ball(centre: np.ndarray, radius: float) -> Polyhedron:
    return from_faces([centre], (), balls=((0, radius),))


def pin(radius: float = 0.005) -> Part:
    stem = csg.Moved(csg.Box((0.004, 0.004, 0.03)), Pose(np.array([0.0, 0.0, radius]), np.eye(3)))
    return with_balls(part_of("pin", stem), [((0.0, 0.0, radius), radius)])


def poses(count: int, seed: int, far: float) -> list[Pose]:
    rng = np.random.default_rng(seed)
    return [Pose(far * rng.uniform(-1.0, 1.0, 3), exp(rng.normal(size=3))) for _ in range(count)]


def test_the_kind_is_its_definition() -> None:
    """Formula, wrench and second derivatives follow from three lines, and nothing else is said of the kind."""
    kind = definition(Kind.BALL_FACE)
    source = inspect.getsource(definitions.ball_face.function)
    assert len(source.strip().splitlines()) == 4  # the decorator, the name, what it is in words, the function
    assert latex(kind) == r"n \cdot \left(p + R\,v\right) - c - r"
    found = derived(kind.name)
    assert found.regular == ()
    v, n = found.parameters["v"], found.parameters["n"]
    assert list(found.N) == [*n, *v.cross(n)]


def test_rows_and_surfaces_are_distances_of_the_ball() -> None:
    """Against the support of the ball: the least height of points all over it."""
    body, fixed = pin().polyhedron, block()
    centre, radius = body.balls[0]
    rng = np.random.default_rng(1)
    sphere = rng.normal(size=(8000, 3))
    sphere *= radius / np.linalg.norm(sphere, axis=1)[:, None]
    for pose in poses(4, 2, 0.02):
        for number, face in enumerate(fixed.faces):
            contact = ball_face(fixed, centre, number)
            value = float(Surfaces.of([contact], body, fixed).values(pose)[0])
            rows = balls_above(body.vertices[[centre]], face.normal, face.offset, body.radii[[centre]])
            assert rows.at(pose).f[0] == pytest.approx(value, abs=1e-17)
            point_row = points_above(body.vertices[[centre]], face.normal, face.offset + radius)
            assert rows.table == point_row.table
            heights = (pose.apply(body.vertices[centre]) + sphere) @ face.normal - face.offset
            assert value <= heights.min() < value + 4e-3 * radius
            point = contact_point(contact, body, fixed, pose)
            assert float(point @ face.normal) - face.offset == pytest.approx(value, abs=1e-15)


def test_near_contacts_are_those_that_a_ball_can_make() -> None:
    """A ball can touch a face with any of its points: what counts is how far it is from the face."""
    body, fixed = pin().polyhedron, block()
    centre, _ = body.balls[0]
    for pose in poses(40, 3, 0.012):
        near = near_contacts(body, fixed, pose, 1e-3, 0.0)
        assert not any(c.kind is Kind.VERTEX_FACE and c.moving == (centre,) for c in near)
        found = {c.fixed_feature for c in near if c.kind is Kind.BALL_FACE}
        every = [ball_face(fixed, centre, number) for number in range(len(fixed.faces))]
        levels = np.abs(Surfaces.of(every, body, fixed).values(pose)) <= 1e-3
        close = (feature_distances(every, body, fixed, pose) <= 1e-3).tolist()
        assert {n for n in range(len(every)) if levels[n] and close[n]} == found


def test_how_far_a_ball_is_from_a_body() -> None:
    """Against the nearest point of the body, by another reckoning."""
    solid = part_of("box", csg.Box((0.02, 0.03, 0.01))).pieces[0]
    other = Convex.read({"vertices": solid.vertices.tolist(), "faces": [[list(face.loops[0])] for face in solid.faces]})
    rng = np.random.default_rng(4)
    for _ in range(300):
        at, radius = 0.03 * rng.uniform(-1.0, 1.0, 3), float(rng.uniform(1e-3, 8e-3))
        apart = float(gaps(Convex.ball([0.0, 0.0, 0.0], radius), other, at[None], np.eye(3)[None])[0])
        assert penetration(ball(at, radius), solid) == pytest.approx(-apart, abs=1e-12)


def test_a_part_with_a_ball_moves_with_it() -> None:
    part, pose = pin(), poses(1, 5, 0.1)[0]
    moved = placed(part.polyhedron, pose)
    assert moved.balls == part.polyhedron.balls
    assert [body.radii.max() for body in part.bodies] == [0.0, 0.005]
    plain = faceted(part.polyhedron)
    assert not plain.balls
    assert len(plain.faces) > len(part.polyhedron.faces)
    floor = part_of("floor", csg.Box((0.1, 0.1, 0.01)))
    for depth in (-1e-4, 1e-4):
        overlap = interference(part, floor, Pose(np.array([0.0, 0.0, 0.01 - depth]), np.eye(3)))
        assert overlap.depth == pytest.approx(max(depth, 0.0), abs=1e-12)
    wall = part_of("wall", csg.Moved(csg.Box((0.02, 0.1, 0.1)), Pose(np.array([0.014, 0.0, -0.05]), np.eye(3))))
    beside = interference(part, wall, Pose(np.array([-0.99e-3, 0.0, 0.0]), np.eye(3)))
    assert beside.depth == pytest.approx(1e-5, abs=1e-12)  # less than facets that stand for the ball leave out
    assert beside.place == "(-0.99, 0, 5) mm"


def test_the_plan_of_a_ball_ended_pin_is_certified(ball_plan: Document) -> None:
    """All contacts are the ball's, and the errors are ten times the clearance."""
    found = verify(ball_plan)
    assert found.verdict == CERTIFIED
    assert differences(parse(ball_plan), load(PROBLEM)) == ()
    assert {contact["kind"] for contact in ball_plan["contacts"]} == {"ball-face"}
    assert ball_plan["uncertainty"]["start_box"][0] >= 10.0 * ball_plan["parts"]["moving"]["declared_clearance"][0]
    assert found.margin is not None
    assert found.margin > 5e-5


def test_sampled_executions_keep_what_the_plan_promises(ball_plan: Document) -> None:
    ledger = executed(ball_plan, 400, 0)
    assert ledger.broken == {}
    assert max(share for (check, _), share in ledger.share.items() if check == "tube") > 0.9


def test_the_pin_gets_in_on_the_rig(ball_plan: Document) -> None:
    records = run(parsed(ball_plan), Trials(4), range(4))
    assert [record["success"] for record in records] == [True] * 4


def without_pairs(plan: Document) -> None:
    for segment in plan["segments"]:
        segment["separations"] = [pair for pair in segment["separations"] if pair["moving_piece"] == 0]


def other_faces(plan: Document) -> None:
    one, two = plan["contacts"][:2]
    one["fixed"], two["fixed"] = two["fixed"], one["fixed"]


def _ball(plan: Document, **said: float) -> None:
    plan["parts"]["moving"]["balls"][0].update(said)


LIES: dict[str, Callable[[Document], object]] = {
    "smaller": lambda plan: _ball(plan, radius=0.004),
    "larger": lambda plan: _ball(plan, radius=0.00506),
    "other faces": other_faces,
    "without pairs": without_pairs,
    "a little off": lambda plan: plan["parts"]["moving"]["vertices"][8].__setitem__(0, 1e-4),
}


@pytest.mark.parametrize("lie", LIES)
def test_lies_about_a_ball_are_not_proved(ball_plan: Document, lie: str) -> None:
    """As they are, and with every number derived anew from them; a proof of another part is for another problem."""
    LIES[lie](ball_plan)
    assert verify(sealed(ball_plan)).verdict == NOT_PROVED
    anew = restated(ball_plan)
    assert verify(anew).verdict == NOT_PROVED or differences(parse(anew), load(PROBLEM))


@pytest.mark.parametrize("share", [0.8, 1.01])
def test_the_radius_is_held_against_the_model(ball_plan: Document, share: float) -> None:
    ball_plan["parts"]["moving"]["balls"][0]["radius"] *= share
    assert any("its balls are not those" in line for line in differences(parse(sealed(ball_plan)), load(PROBLEM)))


def test_a_missing_ball_is_held_against_the_model(ball_plan: Document) -> None:
    plan = parse(ball_plan)
    body = replace(plan.moving.body, vertices=plan.moving.body.vertices[:-1], balls=())
    told = differences(replace(plan, moving=replace(plan.moving, body=body)), load(PROBLEM))
    assert any("its balls are not those" in line for line in told)


def test_a_ball_too_large_for_the_hole_is_refuted(ball_plan: Document) -> None:
    ball_plan["parts"]["moving"]["balls"][0]["radius"] = 0.0056
    found = verify(sealed(ball_plan))
    assert found.verdict == REFUTED
    assert found.witness.pair[0] == 1


def of_the_wall(plan: Document) -> None:
    fixed = plan["parts"]["fixed"]
    fixed["vertices"].append([0.0, 0.0, -0.025])
    fixed["balls"] = [{"vertex": len(fixed["vertices"]) - 1, "radius": 0.001}]


@pytest.mark.parametrize(
    ("lie", "told"),
    [
        (lambda plan: _ball(plan, radius=-0.005), "must lie between"),
        (lambda plan: plan["parts"]["moving"].pop("balls"), "belongs to no face"),
        (lambda plan: _ball(plan, vertex=0), "belongs to no face"),
        (lambda plan: plan["parts"]["moving"].update(balls=2 * plan["parts"]["moving"]["balls"]), "repeat a vertex"),
        (of_the_wall, "are for the moving part only"),
        (lambda plan: plan["contacts"][0].update(kind="vertex-face"), "is one of a point of the moving part"),
        (lambda plan: plan["contacts"][0]["moving"].update(vertices=[0]), "is one of a ball of the moving part"),
    ],
)
def test_plans_of_what_cannot_be_are_refused(ball_plan: Document, lie: Callable[[Document], object], told: str) -> None:
    lie(ball_plan)
    with pytest.raises(PlanError, match=told):
        parse(sealed(ball_plan))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('radius = "radius"', "radius = -5", "balls.tip.radius"),
        ('at = [0, 0, "radius"]\nradius', "at = [2.5, 2.5, 5]\nradius", "is where a corner"),
        ('kind = "solid"', 'kind = "hollow"', "a part with a hollow feature has balls"),
        ("[balls.tip]", "[balls.tip]\ncolour = 1", "balls.tip.colour"),
    ],
)
def test_balls_that_cannot_be_are_refused_with_their_place(tmp_path: Path, old: str, new: str, told: str) -> None:
    copied(tmp_path)
    edit(tmp_path / "models" / "ball_pin.toml", old, new)
    with pytest.raises(InputError, match=told):
        load(tmp_path / "problems" / "ball_pin.toml")


def test_the_scene_shows_where_a_ball_touches(ball_plan: Document) -> None:
    plan = parsed(ball_plan)
    shown = scene_data(plan)["contacts"]
    touching = [contact for contact in plan.contacts if contact.kind == "ball-face"]
    assert touching
    for contact in touching:
        (centre,), _, to_it = shown[contact.id]
        place = contact_place(plan, contact.id, Pose.identity())
        assert np.add(centre, to_it) == pytest.approx(1e3 * place, abs=1e-3)
        assert np.linalg.norm(to_it) == pytest.approx(1e3 * plan.moving.body.balls[0][1], abs=1e-3)
