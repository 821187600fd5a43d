"""Where the middle of a section is, and which way its x axis points."""

import numpy as np
from shapely import Polygon, maximum_inscribed_circle

from fmopt.spatial.values import Array

_WITHIN = 0.2  # of the radius of a largest circle inside: how far inside a middle is
_LONGEST = 1e-5  # of a length: sides that differ by less are equally long
_MANY, _EVEN = 16, 0.02  # so many sides that differ by less than this share make a section round


def centre(ring: Array) -> Array:
    """A point (2,) well inside an outline (n, 2), m: its centroid where it is, else the middle of a large circle."""
    shape = Polygon(ring)
    # shapely gives the circle as a line from its centre to its rim: the length is the radius.
    circle = maximum_inscribed_circle(shape, tolerance=1e-3 * float(np.sqrt(shape.area)))
    if shape.contains(shape.centroid) and shape.exterior.distance(shape.centroid) > _WITHIN * circle.length:
        return np.array(shape.centroid.coords[0])
    return np.array(circle.coords[0])


def axis(ring: Array, known: Array) -> Array:
    """The direction (2,) along the longest side of an outline.

    Args:
        ring: corners (n, 2) in order, m.
        known: (2, k); of directions along sides that are as long the one with the greatest d·known, column by column.
    """
    steps = np.roll(ring, -1, axis=0) - ring
    lengths = np.linalg.norm(steps, axis=1)
    longest = lengths >= (1.0 - _LONGEST) * lengths.max()
    along = steps[longest] / lengths[longest, None]
    return np.asarray(max((*along, *-along), key=lambda d: np.round(d @ known, 6).tolist()))


def is_round(ring: Array) -> bool:
    """Whether an outline (n, 2), m, has so many sides of about one length that it stands for a circle."""
    lengths = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    return bool(np.count_nonzero(lengths >= lengths.max() * (1.0 - _EVEN)) > _MANY)
