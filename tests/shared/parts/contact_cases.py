"""Contacts of every kind between the square peg, with a ball in its tip, and what it can touch."""

import numpy as np

from fmopt.contact.primitive import PrimitiveContact, face_vertex, near_contacts
from fmopt.geometry.polyhedron import Polyhedron, from_faces
from fmopt.spatial.se3 import Pose
from tests.shared.parts.square import block, peg, spike, tilted

PLAIN, BLOCK, SPIKE = peg(), block(), from_faces(*spike())
BALL = len(PLAIN.vertices), 0.0095  # about the middle of the tip, m
PEG = Polyhedron(np.vstack([PLAIN.vertices, [0.0, 0.0, 0.001]]), PLAIN.faces, PLAIN.edges, (BALL,))
LEANING = tilted((0.03, -0.05, 0.02))


def cases() -> list[tuple[Polyhedron, tuple[PrimitiveContact, ...], Pose]]:
    mouth = near_contacts(PEG, BLOCK, LEANING, reach=3e-3, angle=0.05)
    above = Pose.from_vector((0.001, -0.002, 0.0003, 0.1, 0.2, -0.3))
    return [(BLOCK, mouth, LEANING), (SPIKE, tuple(face_vertex(PEG, face, 4) for face in (0, 2, 3)), above)]


CASES = cases()
