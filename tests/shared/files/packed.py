"""Meshes as bytes of STL files."""

from __future__ import annotations

import struct

import numpy as np


def packed_stl(points: np.ndarray, faces: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0.0, 0.0, 0.0, *points[f].ravel().tolist(), 0) for f in faces]
    return b"solid by name alone".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)
