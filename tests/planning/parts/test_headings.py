"""Ways to begin for outlines that are no rectangles: each corner that differs goes in between its own two walls."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fmopt.contact.primitive import Kind
from fmopt.geometry.section import leading_corners
from fmopt.planning.control.controlled_motion import least_steady
from fmopt.planning.search.best_first import MoveSequence, begin, best_sequences, search
from fmopt.planning.search.entry import Approach, Entry, lowest, tilted_entry
from fmopt.planning.search.entry_sampling import headings
from fmopt.planning.search.entry_tuning import TuningLimits, tuned
from fmopt.planning.search.guarded_move import freedoms
from fmopt.planning.search.successors import SearchTask, follow
from fmopt.spatial.se3 import exp
from fmopt.task.problem import Problem, load
from fmopt.task.sizes import measured_clearance
from tests import PROBLEMS
from tests.shared.executions.model import execute
from tests.shared.parts.outlines import ASLANT, prism
from tests.shared.searched import certified_plan, drawn_shapes, steadier, task_of, tilted_motion

KITE = Approach(0.34907, 0.43633, 0.06092, 0.001635, (0.003788, 0.004788), heading=0.25 * math.pi)
PEGS = Approach(0.36622, 0.42713, 0.1027, 0.000837, (0.003131, 0.002425), heading=-0.5 * math.pi)


@pytest.fixture(scope="module")
def kite() -> Problem:
    return load(PROBLEMS / "kite_prism.toml")


@pytest.mark.parametrize(
    ("name", "degrees"),
    [
        ("square_peg", [0]),  # its corners are all the same
        ("factory_rect_8mm_tight", [0, -90]),  # the other two are those turned by half a turn
        ("factory_round_8mm_tight", [0]),
        ("hexagon_prism", [0, -15]),
        ("kite_prism", [0, -51, -219, -135, 45]),  # the two at its sides, the right one, the sharp one
        ("octagon_prism", []),  # all of them are obtuse
        ("keyed_shaft", [-90, -180]),  # those of the key
    ],
)
def test_one_heading_for_each_corner_that_differs(name: str, degrees: list[float]) -> None:
    found = headings(load(PROBLEMS / f"{name}.toml").moving)
    assert [round(math.degrees(heading)) for heading in found] == degrees


def test_every_corner_that_has_a_heading_goes_in(kite: Problem) -> None:
    shapes = [shape for kind in range(3) for shape in drawn_shapes(kite, kind, 30) if shape.between is None]
    tip = leading_corners(kite.moving)
    assert {shape.heading for shape in shapes} == {*headings(kite.moving)}
    assert {tuple(lowest(tip, shape)) for shape in shapes} == {*map(tuple, tip)}


def test_a_turned_part_has_the_same_entry_with_another_heading() -> None:
    """The square looks the same turned by a right angle: so do its entries, turned as well."""
    problem = load(PROBLEMS / "square_peg_100um.toml")
    play = measured_clearance(problem).play
    shape = Approach(0.35, 0.43, 0.06, 0.0016, (0.0038, 0.0048))
    turned = replace(shape, heading=0.5 * math.pi)
    R = exp([0.0, 0.0, 0.5 * math.pi])
    one, other = (tilted_entry(problem.moving, play, problem.approach, s) for s in (shape, turned))
    assert lowest(leading_corners(problem.moving), turned) == pytest.approx(R @ one.corner)
    for a, b in ((one.start, other.start), (one.inside, other.inside)):
        assert b.p == pytest.approx(R @ a.p, abs=1e-12)
        assert np.abs(b.R - R @ a.R @ R.T).max() < 1e-12


def test_moves_go_along_the_axes_of_the_heading() -> None:
    axes = exp([0.0, 0.0, 0.3])
    for plain, turned in zip(freedoms(1.0, 1.0, 1.0), freedoms(1.0, 1.0, 1.0, axes=axes), strict=True):
        assert plain.name == turned.name
        assert turned.twist == pytest.approx(np.concatenate([axes @ plain.twist[:3], axes @ plain.twist[3:]]))
        assert not np.signbit(plain.twist[plain.twist == 0.0]).any()


def test_a_kite_is_certified_at_errors_of_millimetres(kite: Problem) -> None:
    motion = tilted_motion(kite, KITE)
    assert motion.placed.margin > 2e-5
    document = certified_plan(kite, motion)
    assert document["description"]["search"]["heading"] == KITE.heading
    assert execute(document, 20, seed=3).broken == {}


def test_edges_that_turn_parallel_as_they_meet_are_no_contact() -> None:
    """Where rounding says that they cross may be anywhere: of two pegs, once 15 mm off their ends."""
    problem = load(PROBLEMS / "two_pegs.toml")
    task = task_of(problem)
    node = begin(task, tilted_entry(problem.moving, measured_clearance(problem).play, problem.approach, PEGS))
    for name in ("-y", "-rz", "-rx", "-x", "+ry"):
        assert node is not None
        last, node = node, follow(task, node, name)
    moves = last.moves if node is None else node.moves
    body, fixed = problem.moving.polyhedron.vertices, problem.fixed.polyhedron.vertices
    met = [(move.goal, contact) for move in moves for contact in move.making if contact.kind is Kind.EDGE_EDGE]
    assert met
    for pose, contact in met:
        (a, b), (q, r) = pose.apply(body[list(contact.moving)]), fixed[list(contact.fixed)]
        assert np.linalg.norm(np.cross(b - a, r - q)) > 1e-6 * np.linalg.norm(b - a) * np.linalg.norm(r - q)


OBTUSE = (  # flush first with the wall towards -x, or towards -y: what it goes in with, and the moves from there
    (Approach(0.17453, 0.07418, -0.02094, 0.00014, (0.002383, 0.003972), (0.001748, 0.000248)), "-x +rz +ry -y -rx -z"),
    (Approach(0.07418, 0.17453, 0.03389, 0.00014, (0.003972, 0.002383), (0.001748, 0.000248)), "-y -rz -rx -x +ry -z"),
)


def test_of_corners_that_come_together_that_one_is_met_which_errors_leave_sure() -> None:
    """As the part turns upright both corners of the second wall come onto it; the one that it turns on hardly moves.

    Which of the two is the last in the list depends on which way the part goes in.
    """
    problem, margins = load(PROBLEMS / "octagon_prism.toml"), list[float]()
    task, play = task_of(problem), measured_clearance(problem).play
    for shape, names in OBTUSE:
        node = begin(task, tilted_entry(problem.moving, play, problem.approach, shape))
        for name, rank in zip(names.split(), [1, 2, 3, 4, 5, 5], strict=True):
            node = node and follow(task, node, name)
            assert node.rank == rank
        assert task.seated(node.place.pose)
        margins.append(node.reached.margin)
    assert margins[0] == pytest.approx(margins[1], abs=1e-6)
    assert margins[0] > 2e-5


BLUNT, RIGHT = (-1.669494106719837, 0.000843), (0.5 * math.pi, 0.000854)  # heading of a corner, and how deep it goes in


@pytest.fixture(scope="module")
def aslant(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    return steadier(prism(tmp_path_factory.mktemp("aslant"), ASLANT, (0.101, 0.1)))


def corner(problem: Problem, heading: float, depth: float) -> Entry:
    shape = Approach(0.34907, 0.43633, 0.060923, depth, (0.003755, 0.004755), (0.001515, 0.000316), heading=heading)
    return tilted_entry(problem.moving, measured_clearance(problem).play, problem.approach, shape)


def steadiness(problem: Problem, task: SearchTask, found: MoveSequence) -> float:
    return least_steady(problem, task.assembly, found.reached.claims, task.tolerance)


def test_a_corner_that_friction_leaves_on_its_walls_is_preferred(aslant: Problem) -> None:
    """Between walls that are more than a right angle apart friction turns the part off one of them as it turns upright.

    Of 40 trials in the physics engine none seated from there, all from a right angle.
    """
    task = task_of(aslant)
    ways = [(corner(aslant, *BLUNT),), (corner(aslant, *RIGHT),)]
    blunt, right = (search(task, way) for way in ways)
    assert min(blunt.reached.margin, right.reached.margin) > 5e-5
    assert steadiness(aslant, task, blunt) == pytest.approx(0.0, abs=1e-9)
    assert steadiness(aslant, task, right) > 0.1

    def steady(found: MoveSequence) -> bool:
        return steadiness(aslant, task, found) >= 0.05

    found = [best_sequences(task, iter(listed), steady=steady)[0] for listed in (ways, ways[::-1], ways[:1])]
    assert [one.entry.heading for one in found] == [RIGHT[0], RIGHT[0], BLUNT[0]]
    assert best_sequences(task, iter(ways))[0].entry.heading == BLUNT[0]  # where that does not count


def test_a_steady_sequence_of_much_less_margin_is_kept_for_want_of_another(aslant: Problem) -> None:
    task = task_of(aslant)
    ways = [(corner(aslant, *BLUNT),), (corner(aslant, RIGHT[0], 2.0 * RIGHT[1]),)]
    blunt, right = (search(task, way) for way in ways)
    assert 0.0 < right.reached.margin < 0.5 * blunt.reached.margin
    found = best_sequences(task, iter(ways), steady=lambda one: one.entry.heading == RIGHT[0])
    assert [one.entry.heading for one in found] == [BLUNT[0], RIGHT[0]]


def test_tuning_keeps_what_is_steady(aslant: Problem) -> None:
    task, clearance = task_of(aslant), 1e-4
    entry_of = partial(tilted_entry, aslant.moving, measured_clearance(aslant).play, aslant.approach)
    first = search(task, (corner(aslant, RIGHT[0], 2.0 * RIGHT[1]),))
    asked: list[MoveSequence] = []

    def first_alone(found: MoveSequence) -> bool:
        asked.append(found)
        return found is first

    limits = TuningLimits(math.inf, 12, clearance)
    free = tuned(task, (first,), entry_of, limits)
    assert free.reached.margin > first.reached.margin
    assert tuned(task, (first,), entry_of, limits, steady=first_alone) is first
    assert len(asked) > 1
