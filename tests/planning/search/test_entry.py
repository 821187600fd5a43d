"""Ways to begin: one corner goes in below the funnel, away from the walls next to it, whatever the outline is."""

from pathlib import Path

import numpy as np
import pytest

from fmopt.geometry.section import corner_walls, leading_corners
from fmopt.planning import motion
from fmopt.planning.posed import Posed
from fmopt.planning.search.entry import straight_entry, tilted_entry
from fmopt.planning.search.entry_room import funnel
from fmopt.planning.search.symmetry import images
from fmopt.task.problem import load
from fmopt.task.sizes import measured_clearance
from tests import PROBLEMS
from tests.shared.parts import families
from tests.shared.parts.outlines import prism
from tests.shared.searched import drawn_shapes

SQUARE, CHAMFERED, KITE, KEYED = "square_peg_100um", "factory_rect_8mm_tight", "kite_prism", "keyed_shaft"
HEXAGON, TWO, FUNNEL, LEGS = "hexagon_prism", "two_pegs", "bilba_chamfered_60", "bilba_puzzle"
# Free travel is known along x and y alone: at a slanted wall the room is off by a part of it, m.
SMALL, OFF = "factory_rect_4mm_tight", {HEXAGON: 5e-4, KITE: 2e-4}


@pytest.mark.parametrize("name", [SQUARE, CHAMFERED, HEXAGON, KITE, TWO, FUNNEL, SMALL, KEYED, LEGS])
def test_of_what_can_begin_the_lowest_corner_alone_is_in(name: str) -> None:
    posed = Posed.of(load(PROBLEMS / f"{name}.toml"))
    stood = motion._Stood.of(posed, next(iter(images(posed.assembly, posed.problem.start_box))))
    problem, found = stood.posed.problem, stood._beginnings(1.0, 0)
    assert found
    for entry in found:
        depth = entry.shape.depth
        heights = entry.inside.apply(problem.moving.polyhedron.vertices)[:, 2]
        assert entry.inside.apply(entry.corner)[2] == pytest.approx(-depth, abs=1e-12)
        assert heights.min() >= -depth - 2e-3 * depth - 1e-3
        assert name != KITE or np.sort(heights)[1] > 1e-4 - depth
        assert depth > funnel(problem.fixed)[0]
        assert entry.start.apply(problem.moving.polyhedron.vertices)[:, 2].min() == pytest.approx(problem.approach)
        assert entry.leant is not None or np.abs(entry.start.R - entry.inside.R).max() < 1e-12


@pytest.mark.parametrize("name", [SQUARE, CHAMFERED, HEXAGON, KITE, TWO, SMALL])
def test_the_corner_is_as_far_from_the_walls_next_to_it_as_its_shape_says(name: str) -> None:
    """The walls are those of the hole: faces that look inward, read off the fixed part itself."""
    problem = load(PROBLEMS / f"{name}.toml")
    play = measured_clearance(problem).play
    upright = [face for face in problem.fixed.polyhedron.faces if abs(face.normal[2]) < 1e-9 and face.offset > -0.5]
    shapes = [shape for kind in range(3) for shape in drawn_shapes(problem, kind, 24)]
    assert [shape.varied(shape.numbers) for shape in shapes] == shapes
    for shape in (shape for shape in shapes if shape.between is None):
        entry = tilted_entry(problem.moving, play, problem.approach, shape)
        at = entry.inside.apply(entry.corner)
        sides = [inward for inward, _ in corner_walls(problem.moving, entry.corner)]
        ways = [[f.normal @ at - f.offset for f in upright if f.normal[:2] @ side > 1.0 - 1e-9] for side in sides]
        gaps = [min(gap for gap in along if gap > 0.0) for along in ways]
        assert sorted(gaps) == pytest.approx(sorted(shape.room), abs=OFF.get(name, 2e-5)), shape


OUTLINES = {
    "rectangle": [[30.0, 3.0], [-30.0, 3.0], [-30.0, -3.0], [30.0, -3.0]],
    "bevelled": [[x * side, y * side] for side in (1.0, -1.0) for x, y in ((20, -3), (20, 3), (19, 4), (-19, 4))],
    "octagon": [[10.0 * np.cos(turn), 10.0 * np.sin(turn)] for turn in np.radians(np.arange(0.0, 360.0, 45.0))],
    "pencil": [[20.0, 0.0], [16.0, 4.0], [-20.0, 4.0], [-20.0, -4.0], [16.0, -4.0]],
    "slanted": [[29.0, -4.0], [20.0, 4.0], [-20.0, 4.0], [-20.0, -4.0]],
    "obround": [
        [side * (6.0 + 6.0 * np.cos(turn)), side * 6.0 * np.sin(turn)]
        for side in (1.0, -1.0)
        for turn in np.radians(np.linspace(-90.0, 90.0, 9))
    ],
}


@pytest.mark.parametrize("name", OUTLINES)
def test_every_corner_of_an_outline_has_two_walls_at_an_angle(name: str, tmp_path: Path) -> None:
    """Ends of slender ones are short beside the sides; of the obround they are many sides that are shorter still."""
    problem = prism(tmp_path, OUTLINES[name], (0.1, 0.1))
    for corner in leading_corners(problem.moving):
        (one, on_one), (two, on_two) = corner_walls(problem.moving, corner)
        assert abs(np.linalg.det(np.array([one, two]))) > 0.3
        for normal, point in ((one, on_one), (two, on_two)):
            assert (leading_corners(problem.moving)[:, :2] @ normal).min() == pytest.approx(normal @ point, abs=1e-12)
            if name in ("rectangle", "bevelled", "octagon"):
                assert float(normal @ (corner[:2] - point)) < 2e-3


def test_a_part_on_legs_begins_with_them() -> None:
    """What stands out below the leading face of the mating feature goes in first, upright or tilted."""
    problem = load(PROBLEMS / f"{LEGS}.toml")
    vertices = problem.moving.polyhedron.vertices
    assert vertices[:, 2].min() == pytest.approx(-0.02)
    (upright,) = straight_entry(problem.moving, (5e-4, 1e-3), 0.05 * problem.start_box, problem.approach)
    assert upright.start.apply(vertices)[:, 2].min() == pytest.approx(problem.approach)
    assert upright.inside.apply(vertices)[:, 2].min() == pytest.approx(-2.5e-4)
    for shape in drawn_shapes(problem, 0, 12):
        entry = tilted_entry(problem.moving, measured_clearance(problem).play, problem.approach, shape)
        assert entry.corner[2] == pytest.approx(-0.02)


@pytest.mark.parametrize("seed", range(4))
def test_walls_begin_above_chamfers_of_the_tip(seed: int, tmp_path: Path) -> None:
    """The corners that go in are those of the whole outline, at the height where the walls begin."""
    pair = families.pair("chamfered", seed)
    moving = load(families.write_toml(pair, tmp_path)).moving
    corners, outline = leading_corners(moving), 1e-3 * np.array(pair.peg[-1].outline)
    assert len(corners) == len(outline)
    assert np.ptp(corners[:, 2]) < 1e-9
    assert corners[0, 2] - moving.polyhedron.vertices[:, 2].min() == pytest.approx(1e-3 * pair.peg[1].at, abs=1e-9)
    sides = np.sort(np.linalg.norm(np.roll(corners, 1, axis=0) - corners, axis=1))
    assert sides == pytest.approx(np.sort(np.linalg.norm(np.roll(outline, 1, axis=0) - outline, axis=1)), abs=1e-9)


def test_a_taper_is_no_chamfer(tmp_path: Path) -> None:
    moving = load(families.write_toml(families.pair("tapered", 0), tmp_path)).moving
    assert leading_corners(moving)[:, 2] == pytest.approx(moving.polyhedron.vertices[:, 2].min(), abs=1e-12)
