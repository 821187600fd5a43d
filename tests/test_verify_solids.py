"""Parts and pieces: closed surfaces, convex pieces, pieces that make up the part, and collisions with proof."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from solid_bodies import SLABS, box, pocket, shape, with_box

from fmopt.verify.overlap import overlap
from fmopt.verify.rational import Vector, cross, length
from fmopt.verify.rows import pose
from fmopt.verify.solids import NEAR, SHORT, aligned, short, vanishes


def test_a_pocketed_block_and_its_slabs_close() -> None:
    block = shape(*pocket())
    assert list(block.flaws()) == []
    assert [flaw for slab in SLABS for flaw in (*slab.flaws(), *slab.bulges())] == []
    assert list(block.bulges()) != []


def test_convexity_of_edges() -> None:
    block = shape(*pocket())
    assert block.convex(1, 5)  # outer rim
    assert block.convex(9, 11)  # rim of the hole
    assert not block.convex(8, 9)  # corner of the hole
    assert not block.convex(8, 10)  # floor of the hole
    assert not block.convex(0, 7)  # no edge at all


def test_open_and_twisted_surfaces_are_named() -> None:
    vertices, faces = with_box(([], []), (0.0, 0.0, 0.0), (0.01, 0.01, 0.01), inside_out=False)
    assert any("do not close" in flaw for flaw in shape(vertices, faces[:-1]).flaws())
    vertices[0][2] = 1e-9
    assert any("not flat" in flaw for flaw in shape(vertices, faces).flaws())


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
