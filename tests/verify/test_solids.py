"""Parts and pieces: closed surfaces, convex pieces, pieces that make up the part, and collisions with proof."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmopt.verify.arithmetic.rational import Vector, length
from fmopt.verify.check import overlap
from fmopt.verify.parts.rows import pose
from fmopt.verify.parts.solids import SHORT, short
from tests.shared.parts.solid_bodies import SLABS, box, pocket, shape, with_box


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
    for off in (1e-9, 1e-13, 5e-324 * 2.0**900):
        vertices[0][2] = off
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


@given(st.tuples(*(st.integers(-2 * SHORT, 2 * SHORT),) * 3))
def test_short_vectors_are_told_by_their_squares_as_by_their_lengths(far: Vector) -> None:
    assert short(far) == (length(far) <= SHORT)
