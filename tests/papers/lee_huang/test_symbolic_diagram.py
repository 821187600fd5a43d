"""Symbolic cut-diagrams: numbers put into the expressions give the curves of the numeric sections."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import pytest
import sympy

from fmopt.geometry.csg import Box, Cone, Cylinder, Primitive, Prism, Sphere, Wedge
from fmopt.geometry.plane.region import Region
from fmopt.papers.lee_huang import symbolic_diagram as symbolic
from fmopt.papers.lee_huang.cut_diagram import instance_sections
from fmopt.papers.lee_huang.symbolic_diagram import Ball, Shape, SymbolicCurve, any_pose, shape_of, symbolic_diagram
from fmopt.spatial.se3 import Pose, exp
from fmopt.spatial.values import Array

Values: TypeAlias = Mapping[Any, float]

X, Y, Z, TOP, A, B, H = sympy.symbols("x y z top a b h", positive=True)
CORNERS = sympy.symbols("c:6", real=True)
TRIANGLE = ((0.5, -0.3), (0.0, 0.6), (-0.5, 0.1))

# Instances with numbers, the same with symbols, and what to put in for them.
KINDS: dict[str, tuple[Primitive, Shape, Values]] = {
    "box": (Box((1.0, 0.8, 0.6)), symbolic.box(X, Y, Z), {X: 1.0, Y: 0.8, Z: 0.6}),
    "wedge": (Wedge((1.0, 0.9, 0.8), 0.3), symbolic.wedge(X, Y, Z, TOP), {X: 1.0, Y: 0.9, Z: 0.8, TOP: 0.3}),
    "prism": (
        Prism(TRIANGLE, 0.7),
        symbolic.prism(list(zip(CORNERS[::2], CORNERS[1::2], strict=True)), H),
        dict(zip((*CORNERS, H), (*(c for corner in TRIANGLE for c in corner), 0.7), strict=True)),
    ),
    "cylinder": (Cylinder(0.4, 0.9), symbolic.cylinder(A, H), {A: 0.4, H: 0.9}),
    "cone": (Cone(0.5, 0.2, 0.8), symbolic.cone(A, B, H), {A: 0.5, B: 0.2, H: 0.8}),
    "pointed cone": (Cone(0.0, 0.5, 0.8), symbolic.cone(0, B, H), {B: 0.5, H: 0.8}),
    "sphere": (Sphere(0.5), Ball(A), {A: 0.5}),
}


def posed(pose: Pose) -> tuple[sympy.Matrix, sympy.Matrix]:
    return sympy.Matrix(pose.R.tolist()), sympy.Matrix(pose.p.tolist())


def bounding(curves: tuple[SymbolicCurve, ...], values: Values) -> list[SymbolicCurve]:
    return [curve for curve in curves if curve.bounds(values)]


def area_and_length(curve: SymbolicCurve, values: Values) -> tuple[float, float, Array]:
    """½ ∮ (u dv − v du), ∮ ds, and points, by the polynomial through Chebyshev nodes: two for a straight curve."""
    count = 72 if (curve.u + curve.v).has(sympy.sin, sympy.cos) else 2
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    points = curve.points(0.5 + 0.5 * nodes, values)
    series = np.polynomial.chebyshev.chebfit(nodes, points, count - 1)
    x, weights = np.polynomial.legendre.leggauss(80)
    place = np.polynomial.chebyshev.chebval(x, series)
    rate = np.polynomial.chebyshev.chebval(x, np.polynomial.chebyshev.chebder(series))
    area = 0.5 * float(weights @ (place[0] * rate[1] - place[1] * rate[0]))
    return area, float(weights @ np.hypot(*rate)), points


def agree(curves: tuple[SymbolicCurve, ...], values: Values, region: Region) -> None:
    """The same closed boundary: points on it, ends that meet, the same signed area and length."""
    area = length = 0.0
    starts, ends = [], []
    found = bounding(curves, values)
    for curve in found:
        own_area, own_length, points = area_and_length(curve, values)
        assert region.boundary_distance(points).max() <= 1e-12
        area, length = area + own_area, length + own_length
        first, last = curve.points((0.0, 1.0), values)
        starts.append(first)
        ends.append(last)
    assert area == pytest.approx(region.area, rel=1e-9)
    assert length == pytest.approx(sum(curve.length for curve in region.curves), rel=1e-6)
    gaps = np.linalg.norm(np.array(ends)[:, None] - np.array(starts), axis=2)
    assert gaps.min(axis=1).max() <= 1e-12
    assert len(set(gaps.argmin(axis=1).tolist())) == len(found)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_put_in_give_the_numeric_section(kind: str) -> None:
    """Dimensions as symbols; pose by numbers, wherever the plane cuts or misses."""
    rng = np.random.default_rng(11)
    primitive, shape, values = KINDS[kind]
    met = 0
    for _ in range(3):
        pose = Pose(np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.6, 0.1)]), exp(rng.normal(size=3)))
        region = instance_sections(primitive, pose)[0]
        curves = symbolic_diagram(shape, *posed(pose))
        assert bool(bounding(curves, values)) == (not region.empty)
        if not region.empty:
            agree(curves, values, region)
            met += 1
    assert met > 1


@pytest.mark.parametrize("kind", ["box", "cylinder", "cone", "sphere"])
def test_orientation_and_place_as_symbols(kind: str) -> None:
    rng = np.random.default_rng(12)
    primitive, shape, values = KINDS[kind]
    R, p = any_pose()
    curves = symbolic_diagram(shape, R, p)
    for _ in range(2):
        pose = Pose(np.array([*rng.uniform(-0.3, 0.3, 2), -0.2]), exp(rng.normal(size=3)))
        numbers = dict(zip((*R, *p), (*pose.R.ravel(), *pose.p), strict=True))
        agree(curves, {**values, **numbers}, instance_sections(primitive, pose)[0])


def test_some_symbols_may_be_replaced_before_others() -> None:
    primitive, shape, values = KINDS["cylinder"]
    R, p = any_pose()
    pose = Pose(np.array([0.1, -0.2, -0.3]), exp([0.5, 0.4, 0.3]))
    placed = {symbol: sympy.Float(number) for symbol, number in zip((*R, *p), (*pose.R.ravel(), *pose.p), strict=True)}
    curves = tuple(curve.substituted(placed) for curve in symbolic_diagram(shape, R, p))
    agree(curves, values, instance_sections(primitive, pose)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_upright_and_level_instances(kind: str) -> None:
    """The plane square to the axis, and the planes through the axis but for cones, whose apex is a corner."""
    primitive, shape, values = KINDS[kind]
    level = Pose(np.array([0.1, 0.2, -0.3]), np.eye(3))
    agree(symbolic_diagram(shape, *posed(level)), values, instance_sections(primitive, level)[0])
    lying = Pose(np.array([0.1, 0.2, -0.03]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))
    agree(symbolic_diagram(shape, *posed(lying)), values, instance_sections(primitive, lying)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_shapes_with_numbers(kind: str) -> None:
    primitive, _, _ = KINDS[kind]
    shape = shape_of(primitive)
    pose = Pose(np.array([0.05, -0.1, -0.25]), exp([0.4, 0.3, -0.2]))
    agree(symbolic_diagram(shape, *posed(pose)), {}, instance_sections(primitive, pose)[0])


def test_the_section_of_a_tilted_cylinder_in_symbols() -> None:
    """Semi-axes a and a / cos q of the ellipse, as the expressions say it."""
    q = sympy.Symbol("q", positive=True)
    tilted = sympy.Matrix([[1, 0, 0], [0, sympy.cos(q), -sympy.sin(q)], [0, sympy.sin(q), sympy.cos(q)]])
    curve = symbolic_diagram(symbolic.cylinder(A, H), tilted, sympy.Matrix([0, 0, -H / 2]))[1]
    points = curve.points(np.linspace(0.0, 1.0, 9), {A: 0.2, H: 5.0, q: 0.7})
    shifted = points[:, 1] - 0.5 * (points[0, 1] + points[-1, 1])
    np.testing.assert_allclose((points[:, 0] / 0.2) ** 2 + (shifted * math.cos(0.7) / 0.2) ** 2, 1.0, atol=1e-12)
