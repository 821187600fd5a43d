"""Parts and their pieces as sets: honest ones agree, and no lie about them passes, however small."""

import math
import random
from itertools import product

import numpy as np
import pytest

from fmopt.geometry.convex_pieces import pieces, polyhedron
from fmopt.geometry.csg import Box, Cylinder, Difference, Moved, Solid, Union, Wedge
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import load
from fmopt.verify.arithmetic.lattice import FINENESS, TooMuchWork, WorkLeft
from fmopt.verify.arithmetic.rational import number
from fmopt.verify.parts.covering import DEVIATION, ConvexPiece, uncovered
from fmopt.verify.parts.solids import Shape
from fmopt.verify.parts.surface import CutSurface
from tests import PROBLEMS
from tests.shared.parts.solid_bodies import (
    SLABS,
    Cube,
    Faces,
    Vertices,
    block_of_cubes,
    box,
    is_surface,
    of_cubes,
    of_polyhedron,
    pocket,
    shape,
    with_box,
)

SHIPPED = (
    *("square_peg", "bilba_chamfered_60", "bilba_puzzle", "factory_rect_8mm_tight", "factory_round_16mm_tight"),
    *("hexagon_prism", "octagon_prism", "kite_prism", "keyed_shaft", "mit_planar_slot", "two_pegs_slot"),
    *("lee_huang_peg",),
)
PLENTY = 10**7


def found(part: Shape, bodies: list[Shape]) -> str:
    return "; ".join(uncovered(part, bodies))


def flaws(body: tuple[Vertices, Faces]) -> str:
    return "; ".join(CutSurface(shape(*body), WorkLeft(PLENTY)).flaws)


@pytest.mark.parametrize("name", SHIPPED)
def test_pieces_of_shipped_parts_make_them_up(name: str) -> None:
    problem = load(PROBLEMS / f"{name}.toml")
    for part in (problem.moving, problem.fixed):
        assert found(of_polyhedron(part.polyhedron), [of_polyhedron(piece) for piece in part.pieces]) == ""


def cube() -> tuple[Vertices, Faces]:
    """A cube of 20 mm."""
    return with_box(([], []), (-0.01,) * 3, (0.01,) * 3, inside_out=False)


# Lies about a surface.


def test_a_pocketed_block_has_a_surface() -> None:
    assert flaws(pocket()) == ""
    assert flaws(with_box(pocket(), (0.02, 0.02, -0.02), (0.025, 0.025, -0.01), inside_out=True)) == ""


@pytest.mark.parametrize(
    ("low", "high", "inside_out", "what"),
    [
        ((-0.01, -0.01, -0.03), (0.01, 0.01, 0.0), True, "cross or touch"),
        ((-0.009, -0.009, -0.029), (0.009, 0.009, -0.001), True, "shell 1 of the surface is inside out"),
        ((0.02, 0.02, -0.02), (0.025, 0.025, -0.01), False, "shell 1 of the surface stands inside another one"),
        ((0.02, 0.02, -0.02), (0.035, 0.025, -0.01), True, "cross or touch"),
        ((0.02, 0.02, -0.02), (0.025, 0.025, 0.0), True, "cross or touch"),
        ((-0.04, -0.04, -0.05), (0.04, 0.04, 0.01), True, "stands inside another one"),
    ],
)
def test_shells_are_apart(low: tuple[float, ...], high: tuple[float, ...], inside_out: bool, what: str) -> None:
    told = flaws(with_box(pocket(), low, high, inside_out))
    assert what in told or "is inside out" in told


def test_a_vertex_of_no_face_is_told() -> None:
    vertices, faces = pocket()
    assert flaws(([*vertices, [0.0, 0.0, 0.1]], faces)) == "vertex 16 belongs to no face"


@pytest.mark.parametrize("face", range(11))
def test_faces_that_are_missing_double_or_reversed_are_told(face: int) -> None:
    vertices, faces = pocket()
    others = [f for n, f in enumerate(faces) if n != face]
    assert "do not close" in flaws((vertices, others))
    assert "is not the only one left of its edge" in flaws((vertices, [*faces, faces[face]]))
    assert "is not the only one left" in flaws((vertices, [*others, [loop[::-1] for loop in faces[face]]]))


def test_a_rim_before_its_outline_is_told() -> None:
    vertices, faces = pocket()
    swapped = [[face[1], face[0]] if len(face) == 2 else face for face in faces]
    assert any("wrong way round" in flaw for flaw in shape(vertices, swapped).flaws())
    outside = [list(v) for v in vertices]
    for v in outside[8:]:
        v[0] += 0.07  # the pocket beside the block
    assert "runs the wrong way round" in flaws((outside, faces))


def test_a_surface_that_crosses_itself_is_told() -> None:
    vertices, faces = pocket()
    deep = [list(v) for v in vertices]
    for v in deep[8:]:
        v[2] -= 0.011 if v[2] < -0.01 else 0.0  # the floor of the pocket below the block
    assert "cross or touch" in flaws((deep, faces))
    for v in deep[8:]:
        v[2] = -0.04 if v[2] < -0.01 else v[2]  # and in its bottom
    assert "cross or touch" in flaws((deep, faces))
    wide = [list(v) for v in vertices]
    wide[9][0] = 0.02  # a rim that crosses itself
    assert flaws((wide, faces)) != ""
    assert "inside out" in flaws((vertices, [[loop[::-1] for loop in face] for face in faces]))


def test_a_pinched_vertex_is_told() -> None:
    two = of_cubes([(0, 0, 0), (1, 1, 1)])
    assert "pinched" in "; ".join(CutSurface(two, WorkLeft(PLENTY)).flaws)
    edge = of_cubes([(0, 0, 0), (1, 1, 0)])
    assert "is not the only one left of its edge" in "; ".join(CutSurface(edge, WorkLeft(PLENTY)).flaws)


# Lies about a covering.


def test_a_pocketed_block_is_its_five_slabs() -> None:
    assert found(shape(*pocket()), SLABS) == ""


@pytest.mark.parametrize("missing", range(5))
def test_a_missing_slab_is_found(missing: int) -> None:
    told = found(shape(*pocket()), [s for n, s in enumerate(SLABS) if n != missing])
    assert told.startswith("the pieces leave the part uncovered at (")


def test_a_shell_that_covers_the_surface_alone_is_not_enough() -> None:
    hollow = [box(-10, -9, -10, 10, -10, 10), box(9, 10, -10, 10, -10, 10), box(-10, 10, -10, -9, -10, 10)]
    hollow += [box(-10, 10, 9, 10, -10, 10), box(-10, 10, -10, 10, -10, -9), box(-10, 10, -10, 10, 9, 10)]
    assert "uncovered" in found(shape(*cube()), hollow)
    around = with_box(cube(), (-0.009,) * 3, (0.009,) * 3, inside_out=True)
    assert found(shape(*around), hollow) == ""


def test_a_plug_with_a_shell_inside_out_is_found() -> None:
    plug = box(-10, 10, -10, 10, -30, 0)
    for gap in (0.0, 1e-9, 1e-3):
        low, high = (-0.01 + gap, -0.01 + gap, -0.03 + gap), (0.01 - gap, 0.01 - gap, -gap)
        body = with_box(pocket(), low, high, inside_out=True)
        assert found(shape(*body), [*SLABS, plug]) != ""
    assert "piece 5 sticks out" in found(shape(*pocket()), [*SLABS, plug])
    assert "piece 5 sticks out" in found(shape(*pocket()), [*SLABS, box(-10, 10, -10, 10, -30, -29.9)])
    assert "piece 4 sticks out" in found(shape(*pocket()), [*SLABS[:-1], box(-30, 30, 9.99, 30, -40, 0)])


def without_corner(size: float) -> tuple[Vertices, Faces]:
    """A cube of 20 mm without one corner, `size` along its edges."""
    vertices, quads = cube()
    a, b, c = ([0.01 - size * (k == axis) for k in range(3)] for axis in range(3))
    faces = [*quads[:1], [[4, 6, 9, 8, 5]], quads[2], [[2, 3, 7, 9, 6]], quads[4], [[1, 5, 8, 7, 3]], [[8, 9, 7]]]
    return [*vertices[:7], a, b, c], faces


def without_edge(size: float) -> tuple[Vertices, Faces]:
    """A cube of 20 mm without one edge."""
    vertices, quads = cube()
    vertices[5], vertices[7] = [0.01 - size, -0.01, 0.01], [0.01 - size, 0.01, 0.01]
    vertices += [[0.01, -0.01, 0.01 - size], [0.01, 0.01, 0.01 - size]]
    faces = [quads[0], [[4, 6, 9, 8]], [[0, 4, 8, 5, 1]], [[2, 3, 7, 9, 6]], *quads[4:], [[8, 9, 7, 5]]]
    return vertices, faces


@pytest.mark.parametrize(
    "less",
    [without_corner(1e-7), without_corner(2.2e-6), without_edge(2e-11), without_edge(1e-9), without_edge(1e-6)],
    ids=["corner 100 nm", "corner 2.2 µm", "edge 20 pm", "edge 1 nm", "edge 1 µm"],
)
def test_corners_and_edges_cut_off_are_found(less: tuple[Vertices, Faces]) -> None:
    whole, piece = shape(*cube()), shape(*less)
    assert found(piece, [piece]) == ""
    assert "uncovered" in found(whole, [piece])
    assert "sticks out" in found(piece, [whole])


@pytest.mark.parametrize("size", [1e-9, 1e-11, 2e-12])
def test_pieces_that_are_too_small_or_too_large_by_little_are_found(size: float) -> None:
    whole = shape(*cube())
    for k in range(6):
        sides = [-10.0, 10.0, -10.0, 10.0, -10.0, 10.0]
        for change in (size, -size):
            sides[k] = (-10.0, 10.0)[k % 2] + 1e3 * change
            told = found(whole, [box(*sides)])
            assert told.startswith("piece 0 sticks out" if (change > 0) == (k % 2 == 1) else "the pieces leave")
    half = [box(-10, -1e3 * size, -10, 10, -10, 10), box(0, 10, -10, 10, -10, 10)]
    assert "uncovered" in found(whole, half)
    assert found(whole, [box(-10, 0, -10, 10, -10, 10), half[1]]) == ""


def test_pieces_that_are_no_hulls_are_told() -> None:
    vertices, faces = pocket()
    assert "material on both sides" in found(shape(vertices, faces), [shape(vertices, faces)])
    corners, quads = cube()
    assert "a vertex belongs to no face" in found(shape(corners, quads), [shape([*corners, [0.0, 0.0, 0.0]], quads)])
    assert "meet elsewhere" in found(shape(corners, quads), [shape(corners, quads[:-1])])
    assert "piece 0: it is too thin" in found(shape(corners, quads), [box(-10, 10, -10, 10, 0, 1e-11)])
    needle = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.01, 1e-6, 0.0], [0.01, 0.0, 1e-6]]
    sharp = shape(needle, [[[0, 2, 1]], [[0, 1, 3]], [[0, 3, 2]], [[1, 2, 3]]])
    assert "meet elsewhere" in found(sharp, [sharp])


def test_hulls_reach_no_farther_than_the_deviation() -> None:
    rng = random.Random(3)
    for _ in range(20):
        points = [[rng.uniform(-0.05, 0.05) for _ in range(3)] for _ in range(4)]
        body = shape(points, [[[0, 2, 1]], [[0, 1, 3]], [[0, 3, 2]], [[1, 2, 3]]])
        if "inside out" in "; ".join(CutSurface(body, WorkLeft(PLENTY)).flaws):
            body = shape(points, [[[0, 1, 2]], [[0, 3, 1]], [[0, 2, 3]], [[1, 3, 2]]])
        hull = ConvexPiece(body, WorkLeft(PLENTY))
        if list(hull.flaws()):
            continue
        for x, y, z, w in (p for cell in hull.cells for p in cell.corners):
            away = min(math.dist(p, [c / w / (1 << FINENESS) for c in (x, y, z)]) for p in points)
            assert away < number(DEVIATION) + 1e-16


# Agreement with solids of cubes, where every question has a plain answer.


def test_solids_of_cubes_are_judged_as_their_cubes_are() -> None:
    rng = random.Random(5)
    told = {True: 0, False: 0}
    for _ in range(120):
        density = rng.choice((0.08, 0.2, 0.5, 0.85, 0.95))
        cubes: set[Cube] = {c for c in product(range(3), repeat=3) if rng.random() < density}
        if not cubes:
            continue
        surface = CutSurface(of_cubes(cubes), WorkLeft(PLENTY))
        plain = is_surface(cubes)
        told[plain] += 1
        assert (not surface.flaws) == plain
        if not plain:
            continue
        for _ in range(5):
            p = [rng.randrange(-3, 13) * 25 + rng.randrange(1, 24) for _ in range(3)]
            inside = tuple(x // 100 for x in p) in cubes
            scale = (1 << FINENESS) * 100 // 10**6
            assert surface.holds((p[0] * scale, p[1] * scale, p[2] * scale, 1)) == inside
    assert min(told.values()) > 12


def test_blocks_of_cubes_cover_what_their_cubes_cover() -> None:
    rng = random.Random(7)
    agreed = {True: 0, False: 0}
    for _ in range(100):
        blocks = []
        for _ in range(rng.randrange(1, 5)):
            low = tuple(rng.randrange(3) for _ in range(3))
            blocks.append((low, tuple(min(2, x + rng.randrange(3)) for x in low)))
        filled = [set(product(*(range(a, b + 1) for a, b in zip(low, high, strict=True)))) for low, high in blocks]
        cubes = set().union(*filled)
        lie = rng.random() < 0.5
        if lie:
            cubes = (cubes | {(rng.randrange(3), rng.randrange(3), rng.randrange(3))}) - {rng.choice(sorted(cubes))}
        if not cubes or not is_surface(cubes):
            continue
        told = found(of_cubes(cubes), [block_of_cubes(*block) for block in blocks])
        assert (told == "") == (set().union(*filled) == cubes)
        for n, own in enumerate(filled):
            assert (f"piece {n} sticks out" in told) == (not own <= cubes)
        assert ("uncovered" in told) == (not cubes <= set().union(*filled))
        agreed[told == ""] += 1
    assert min(agreed.values()) > 15


# Solids as problem files describe them.


def solid(rng: random.Random) -> Solid:
    """A block with bores, slots and bevels in it, and something on it, all in general position."""

    def somewhere(body: Solid, reach: float) -> Solid:
        p = [rng.uniform(-reach, reach) for _ in range(3)]
        return Moved(body, Pose.from_vector(np.array([*p, *(rng.uniform(-0.6, 0.6) for _ in range(3))])))

    def tool() -> Solid:
        size = tuple(rng.uniform(0.004, 0.03) for _ in range(3))
        kind = rng.randrange(3)
        if kind == 0:
            return Box((size[0], size[1], size[2]))
        if kind == 1:
            return Cylinder(size[0] / 2, 0.05, rng.randrange(3, 9))
        return Wedge((size[0], size[1], size[2]), size[0] / 3)

    base: Solid = Box((0.04, 0.05, 0.03))
    if rng.random() < 0.5:
        base = Union((base, somewhere(tool(), 0.02)))
    return Difference(base, tuple(somewhere(tool(), 0.02) for _ in range(rng.randrange(1, 3))))


@pytest.mark.parametrize("seed", range(12))
def test_random_solids_are_their_pieces_and_no_others(seed: int) -> None:
    rng = random.Random(seed)
    made = solid(rng)
    part, bodies = of_polyhedron(polyhedron(made)), [of_polyhedron(piece) for piece in pieces(made)]
    assert found(part, bodies) == ""
    missing = rng.randrange(len(bodies))
    if len(bodies) > 1:
        assert "uncovered" in found(part, [b for n, b in enumerate(bodies) if n != missing])
    low, high = polyhedron(made).vertices.min(axis=0), polyhedron(made).vertices.max(axis=0)
    surface = CutSurface(part, WorkLeft(PLENTY))
    hulls = [ConvexPiece(body, WorkLeft(PLENTY)) for body in bodies]
    for _ in range(60):
        p = [round(rng.uniform(a, b) * 2**60) << (FINENESS - 60) for a, b in zip(low, high, strict=True)]
        inside = any(all(a * p[0] + b * p[1] + c * p[2] <= d for a, b, c, d in hull.outer) for hull in hulls)
        assert surface.holds((p[0], p[1], p[2], 1)) == inside


# Work.


def test_bodies_that_take_too_many_steps_are_told_so() -> None:
    rng = random.Random(1)
    cube = box(0, 10, 0, 10, 0, 10)
    slivers = []
    for _ in range(400):
        low = [rng.uniform(0, 8) for _ in range(3)]
        slivers.append(box(*(x for a in low for x in (a, a + rng.uniform(1, 2)))))
    assert found(cube, slivers) != ""
    with pytest.raises(TooMuchWork):
        CutSurface(cube, WorkLeft(20))
