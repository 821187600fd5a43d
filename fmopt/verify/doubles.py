"""Vectors in double arithmetic, for what rests on no inequality that could be short by a rounding."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul

from fmopt.verify.document import Numbers
from fmopt.verify.rational import number


def doubles(v: Sequence[int]) -> Numbers:
    """The floats nearest to fixed-point numbers."""
    return tuple([number(x) for x in v])


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """a·b of vectors of one size, rounded once."""
    if len(a) != len(b):
        raise ValueError(f"vectors of {len(a)} and {len(b)} numbers have no product")
    return math.fsum(map(mul, a, b))


def cross(a: Sequence[float], b: Sequence[float]) -> Numbers:
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
