"""A peg held in a pocket, as the check has it: planes, rims and contacts."""

from fmopt.verify.arithmetic.rational import Vector, fixed, vector
from fmopt.verify.certificate.contact_implications import CheckedFacts
from fmopt.verify.parts.assembly import PartPair, Touch
from fmopt.verify.parts.rows import pose
from fmopt.verify.parts.solids import Plane
from tests.shared.parts.solid_bodies import box, pocket, shape

MM = 1e-3
PEG = box(-10, 10, -10, 10, 0, 40)
BLOCK = shape(*pocket())
LEFT = Plane(vector((1.0, 0.0, 0.0)), fixed(-10 * MM))  # wall of the hole at x = −10 mm
TOP = Plane(vector((0.0, 0.0, 1.0)), 0)


def point(x: float, y: float, z: float) -> tuple[int, int, int]:
    return vector((x * MM, y * MM, z * MM))


def same(a: Vector, b: Vector) -> bool:
    return all(abs(x - y) <= fixed(1e-30) for x, y in zip(a, b, strict=True))


def corner(x: int, y: int, z: int) -> int:
    return next(k for k, v in enumerate(PEG.vertices) if same(v, point(10 * x, 10 * y, 40 * z)))


V0, V1, V2, V3 = (corner(*xy, 0) for xy in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
T0, T1, T3 = corner(-1, -1, 1), corner(1, -1, 1), corner(-1, 1, 1)
RIM_LEFT = (point(-10, -10, 0), point(-10, 10, 0))


def assembled() -> PartPair:
    made = PartPair.__new__(PartPair)
    made.moving, made.fixed = PEG, BLOCK
    made.moving_pieces, made.fixed_pieces = (PEG,), ()
    made.body_points = PEG.vertices
    made.touches = {}
    made.flaws = []
    return made


def vertex_on(k: int, wall: Plane) -> Touch:
    return Touch(f"v{k} on {wall}", "vertex-face", (PEG.vertices[k],), (), wall, (wall,), 0, ((k,), ()))


def edge_on(i: int, j: int, rim: tuple[tuple[int, int, int], ...], wall: Plane) -> Touch:
    moving = (PEG.vertices[i], PEG.vertices[j])
    return Touch(f"e{i}-{j} on {rim}", "edge-edge", moving, rim, None, (wall, TOP), -1, ((i, j), (sum(map(sum, rim)),)))


def facts(assembly: PartPair, *held: Touch) -> CheckedFacts:
    return CheckedFacts(assembly, held, pose((0.0,) * 6).R)


A = edge_on(V0, T0, RIM_LEFT, LEFT)
V0_LEFT, V3_LEFT, T3_LEFT = vertex_on(V0, LEFT), vertex_on(V3, LEFT), vertex_on(T3, LEFT)
