"""Random sections of pegs and holes."""

import numpy as np
from shapely import Polygon, affinity

from fmopt.geometry.plane.region import polygon_region
from fmopt.papers.lee_huang.diagram import of_region
from fmopt.papers.lee_huang.line_contact import Leg


def random_case(seed):
    rng = np.random.default_rng(seed)
    own = Polygon(rng.normal(0.0, 1.0, (6, 2))).convex_hull
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 7))
    star = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.8, 2.5, (7, 1))
    other = affinity.translate(Polygon(star).buffer(0.0), 4.0, 0.5)
    if other.geom_type != "Polygon" or other.contains(affinity.translate(own, 4, 0.5)):
        return None
    radius, cone = rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.3)
    start = rng.uniform([-2.0, -4.0], [1.0, 4.0])
    return own, other, Leg(start, rng.uniform([0.0, -3.0], [6.0, 3.0]), radius, cone, 3.0)


def loop(shape):
    return np.array(shape.exterior.coords)[:-1] if shape.exterior.is_ccw else np.array(shape.exterior.coords)[:0:-1]


def polygon(*rings):
    """The diagram of polygons (n, 2) in m: outlines counter-clockwise, holes clockwise."""
    return of_region(polygon_region(*rings))
