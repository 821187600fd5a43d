"""Parts and pieces: closed surfaces, convex pieces, pieces that make up the part, and collisions with proof."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table_plan import box_body

from fmopt.verify.covering import uncovered, volume
from fmopt.verify.document import Body
from fmopt.verify.overlap import overlap
from fmopt.verify.rational import Vector, cross, length, number
from fmopt.verify.rows import pose
from fmopt.verify.solids import NEAR, SHORT, Shape, aligned, short, vanishes

MM = 1e-3


def shape(body: dict[str, Any]) -> Shape:
    faces = tuple(tuple(tuple(loop) for loop in face) for face in body["faces"])
    return Shape(Body(tuple(tuple(v) for v in body["vertices"]), faces))


def box(*sides: float) -> Shape:
    return shape(box_body([x * MM for x in sides[::2]], [x * MM for x in sides[1::2]]))


def pocket() -> Shape:
    """A block of 60 × 60 × 40 mm with a square blind hole of 20 mm, 30 mm deep."""
    outer, inner = (
        box_body((-0.03, -0.03, -0.04), (0.03, 0.03, 0.0)),
        box_body((-0.01, -0.01, -0.03), (0.01, 0.01, 0.0)),
    )
    faces = [face for face in outer["faces"] if face != [[1, 5, 7, 3]]]
    faces.append([[1, 5, 7, 3], [9, 11, 15, 13]])
    faces += [[[8 + i for i in reversed(face[0])]] for face in inner["faces"] if face != [[1, 5, 7, 3]]]
    return shape({"vertices": outer["vertices"] + inner["vertices"], "faces": faces})


SLABS = [
    box(-30, 30, -30, 30, -40, -30),
    box(-30, -10, -30, 30, -40, 0),
    box(10, 30, -30, 30, -40, 0),
    box(-30, 30, -30, -10, -40, 0),
    box(-30, 30, 10, 30, -40, 0),
]


def test_a_pocketed_block_is_its_five_slabs() -> None:
    block = pocket()
    assert list(block.flaws()) == []
    assert [flaw for slab in SLABS for flaw in (*slab.flaws(), *slab.bulges())] == []
    assert list(uncovered(block, SLABS)) == []
    assert list(block.bulges()) != []


@pytest.mark.parametrize("missing", range(5))
def test_a_missing_slab_is_found(missing: int) -> None:
    found = list(uncovered(pocket(), [s for n, s in enumerate(SLABS) if n != missing]))
    assert len(found) == 1
    assert "uncovered" in found[0]


def test_a_shell_that_covers_the_surface_alone_is_not_enough() -> None:
    cube = box(-10, 10, -10, 10, -10, 10)
    shell = [box(-10, -9, -10, 10, -10, 10), box(9, 10, -10, 10, -10, 10), box(-10, 10, -10, -9, -10, 10)]
    shell += [box(-10, 10, 9, 10, -10, 10), box(-10, 10, -10, 10, -10, -9), box(-10, 10, -10, 10, 9, 10)]
    assert list(uncovered(cube, shell)) == ["the pieces leave 5.83e+03 mm³ of the part uncovered"]


def test_a_piece_in_the_hole_is_found() -> None:
    found = list(uncovered(pocket(), [*SLABS, box(-10, 10, -10, 10, -30, -29.9)]))
    assert any("sticks out" in flaw for flaw in found)
    assert any("sticks out" in flaw for flaw in uncovered(pocket(), [*SLABS[:-1], box(-30, 30, 9.99, 30, -40, 0)]))


def test_convexity_of_edges() -> None:
    block = pocket()
    assert block.convex(1, 5)  # outer rim
    assert block.convex(9, 11)  # rim of the hole
    assert not block.convex(8, 9)  # corner of the hole
    assert not block.convex(8, 10)  # floor of the hole
    assert not block.convex(0, 7)  # no edge at all


def test_open_twisted_and_inverted_surfaces_are_named() -> None:
    body = box_body((0.0, 0.0, 0.0), (0.01, 0.01, 0.01))
    assert any("do not close" in flaw for flaw in shape({**body, "faces": body["faces"][:-1]}).flaws())
    bent = [list(v) for v in body["vertices"]]
    bent[0][2] = 1e-9
    assert any("not flat" in flaw for flaw in shape({**body, "vertices": bent}).flaws())
    inverted = shape({**body, "faces": [[face[0][::-1]] for face in body["faces"]]})
    assert any("inside out" in flaw for flaw in uncovered(inverted, [shape(body)]))


def test_volume_of_a_box() -> None:
    cube = box(0, 10, 0, 20, 0, 30)
    chains = [
        [
            (cube.vertices[i], cube.vertices[j])
            for i, j in zip(f.loops[0], (*f.loops[0][1:], f.loops[0][0]), strict=True)
        ]
        for f in cube.faces
    ]
    assert number(volume(chains)) == pytest.approx(6e-6, rel=1e-15)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        ((0.0, 0.0, 0.0149, 0.0, 0.0, 0.0), True),
        ((0.0, 0.0, 0.0151, 0.0, 0.0, 0.0), False),
        ((0.0, 0.0, 0.0150, 0.0, 0.0, 0.0), False),
        ((0.0, 0.0, 0.017, 0.78, 0.0, 0.0), True),
        ((0.0, 0.014, 0.014, 0.785, 0.0, 0.0), False),
    ],
)
def test_overlaps_have_a_common_point(x: tuple[float, ...], expected: bool) -> None:
    depth = overlap(box(-10, 10, -10, 10, -10, 10), box(-5, 5, -5, 5, -5, 5), pose(x), 1e-9)
    assert (depth > 0.0) is expected


def vectors(size: int) -> st.SearchStrategy[Vector]:
    """Vectors of about a size, in fixed point."""
    return st.tuples(*(st.integers(-2 * size, 2 * size),) * 3)


@given(vectors(NEAR), vectors(SHORT), vectors(NEAR), vectors(1 << 256))
def test_small_vectors_are_told_by_their_squares_as_by_their_lengths(
    near: Vector, far: Vector, u: Vector, v: Vector
) -> None:
    assert vanishes(near) == (length(near) <= NEAR)
    assert short(far) == (length(far) <= SHORT)
    assert aligned(u, v) == (length(cross(u, v)) <= NEAR)


def test_vectors_at_the_limit_count_as_long() -> None:
    assert vanishes((NEAR - 1, 0, 0))
    assert not vanishes((NEAR, 0, 0))
    assert length((NEAR - 1, 0, 0)) == NEAR
