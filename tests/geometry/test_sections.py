"""Plane sections of solids that are given as convex pieces."""

import pytest
from shapely import Polygon, union_all

from fmopt.geometry.section import united

# A shaft of sixteen sides less two, and its key, in metres: their common side is one but for rounding.
BODY = [
    (-0.00029542801960048305, -0.0013684034961193219),
    (-0.0007929117499166452, -0.0011687390523880134),
    (-0.0011761185079691636, -0.0007938944068822766),
    (-0.001386708478626912, -0.0003009362551139917),
    (-0.0013926212607198677, 0.00023508712473219433),
    (-0.0011929566679769483, 0.0007325708550483569),
    (-0.0008181119581842427, 0.0011157776232063187),
    (-0.00032515382109487906, 0.001326367587593284),
    (0.00021086933032932534, 0.0013322803658515794),
    (0.000708353054518095, 0.0011326157755678825),
    (0.0013080625776885953, -0.0002712103288596212),
    (0.0011083980979150808, -0.0007686939555137768),
    (0.0007335534546436752, -0.0011519006530071518),
    (0.00024059515899756004, -0.001362490685128998),
    (-0.00029542801960048305, -0.0013684034961193219),
]
KEY = [
    (0.0011355450533310062, 0.00013262618666547393),
    (0.0008808705425261709, 0.0007287793451313069),
    (0.0014096460645034326, 0.0009546703690616089),
    (0.001664320575308268, 0.0003585172105957761),
    (0.0011355450533310062, 0.00013262618666547393),
]


def test_a_piece_is_not_lost_beside_another() -> None:
    parts = [Polygon(BODY), Polygon(KEY)]
    whole = united(parts)
    assert whole.area == pytest.approx(sum(part.area for part in parts), rel=1e-6)
    assert united(parts[::-1]).area == pytest.approx(whole.area, rel=1e-6)


def test_what_is_not_lost_is_left_as_it_is() -> None:
    parts = [Polygon([(0.0, 0.0), (0.1, 0.0), (0.1, 0.3)]), Polygon([(0.05, 0.01), (0.3, 0.02), (0.3, 0.1)])]
    assert united(parts).equals_exact(union_all(parts), 0.0)
    assert united([]).is_empty
