"""The motion in three dimensions: its data are the parts and the path, and nothing in it can leave its element."""

import json
from itertools import pairwise

import numpy as np
import pytest

from fmopt.plan import parsed
from fmopt.report.scene import embedded, resource, scene, scene_data, seating
from fmopt.spatial.se3 import Pose, exp
from tests.shared.plans.press_plan import press_plan_document
from tests.shared.plans.report_plans import box, cube, cube_plan

MM = 1e-3


def volume(polygons: list[list[list[float]]]) -> float:
    """Volume in mm³ inside outward polygons, by the divergence theorem."""
    total = 0.0
    for polygon in polygons:
        a, *rest = np.array(polygon)
        total += sum(a @ np.cross(b, c) for b, c in pairwise(rest)) / 6.0
    return float(total)


def test_the_viewer_is_self_contained_and_the_same_every_time() -> None:
    page = scene(cube())
    assert page == scene(cube())
    assert "http" not in page
    assert len(page) < 200_000


def test_the_path_ends_where_the_plan_ends() -> None:
    plan = cube()
    path = scene_data(plan)["path"]
    assert [leg["move"] for leg in path] == [0, 1, 1]
    for leg, piece in zip(path, plan.segments, strict=True):
        goal = Pose.from_vector(piece.goal)
        np.testing.assert_allclose(MM * np.array(leg["p"][1]), goal.p, atol=1e-7)
        np.testing.assert_allclose(exp(leg["w"]) @ np.array(leg["R"]), goal.R, atol=1e-8)


@pytest.mark.parametrize("goal", [[-1e-4, -1e-4], [1e-4, 1e-4], [-1e-4, 1e-4], [1e-4, -1e-4]])
def test_cutting_open_takes_a_quarter_away(goal: list[float]) -> None:
    plan = cube_plan()
    slab = box((-20, -20, -10), (20, 20, 0))
    plan["parts"]["fixed"] |= {"name": "slab", **slab, "pieces": [slab]}
    plan["contacts"][0]["fixed"] = {"vertices": [0, 1, 2]}
    plan["segments"][-1]["goal"][:2] = goal
    data = scene_data(parsed(plan))
    assert data["quarter"] == [1 if goal[0] <= 0 else -1, 1 if goal[1] < 0 else -1]
    assert volume(data["fixed"]["polygons"]) == pytest.approx(16000.0)
    assert volume(data["open"]["polygons"] + data["open"]["caps"]) == pytest.approx(12000.0)
    inside = [np.mean(line, axis=0) * [*data["quarter"], 1] for line in data["open"]["lines"]]
    assert not any(point[0] > 1e-6 and point[1] > 1e-6 for point in inside)


@pytest.mark.parametrize("towards", [0.0, 0.4, 1.6, 2.4, 3.14, -0.8, -1.5, -2.6])
def test_the_first_view_is_across_the_lean_and_into_the_cut(towards: float) -> None:
    plan = cube_plan()
    lean = np.array([np.cos(towards), np.sin(towards)])
    tilt = [-0.2 * lean[1], 0.2 * lean[0], 0.0]
    assert exp(tilt)[:2, 2] @ lean == pytest.approx(np.sin(0.2))
    plan["segments"][0]["goal"][3:] = plan["segments"][1]["start"][3:] = tilt
    data = scene_data(parsed(plan))
    view = np.array([np.cos(data["azimuth"]), np.sin(data["azimuth"])])
    assert abs(view @ lean) < np.sin(np.radians(20.0))
    assert np.all(view * data["quarter"] > np.sin(np.radians(14.0)))


def test_the_first_view_of_an_upright_part_is_into_the_cut() -> None:
    data = scene_data(cube())
    assert data["azimuth"] == pytest.approx(np.arctan2(data["quarter"][1], 0.8 * data["quarter"][0]), abs=1e-4)


def test_nothing_in_the_data_can_end_the_script() -> None:
    text = embedded({"words": "</script><!--&\u2028"})
    assert not set(text) & set("<>&\u2028")
    assert json.loads(text) == {"words": "</script><!--&\u2028"}


def test_parts_are_shown_on_a_nominal_way() -> None:
    plan = cube()
    page = seating(plan.moving, plan.fixed, cube_plan()["description"]["nominal"]["nodes"])
    data = json.loads(page.split('-data">')[1].split("</script>")[0])
    assert [leg["move"] for leg in data["path"]] == [0]
    assert data["moves"] == []


def test_every_control_has_a_handler() -> None:
    program, frame = resource("scene.js"), scene(parsed(press_plan_document()))
    for name in ("play", "back", "on", "way", "zoom", "fixed", "moving", "look", "names", "reset", "run", "cloud"):
        assert f'data-do="{name}"' in frame
        assert f'"{name}"' in program
