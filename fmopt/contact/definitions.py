"""C-surface functions f(X) of the primitive contacts: signed distances, f < 0 inside the forbidden zone.

The moving part is at (p, R): its point v is at p + R v, its direction n along R n. Normals and directions have unit
length, and point out of their own part. A kind of contact is what stands here and nothing else: its gradient (the
contact's wrench) and its second derivatives, the compiled kernels of `kernels_generated` (`python -m
fmopt.contact.generate` writes them anew), the functions of nonlinear programs and the formula in a notebook follow from
it. [DakinPopplestone1993] section 2 and Appendix I.
"""

from fmopt.contact.algebra import CONTACTS, Body, Matrix, Scalar, Vector, World, contact, cross, dot, norm

__all__ = ["CONTACTS"]


@contact
def vertex_face(p: Vector, R: Matrix, v: Body, n: World, c: Scalar) -> Scalar:
    """A point v of the moving part over the fixed plane n·x = c."""
    return dot(n, p + R @ v) - c


@contact
def face_vertex(p: Vector, R: Matrix, n: Body, w: World, c: Scalar) -> Scalar:
    """A fixed point w over the plane n·x = c of the moving part."""
    return dot(R @ n, w - p) - c


@contact
def edge_edge(p: Vector, R: Matrix, a: Body, v: Body, e: World, q: World) -> Scalar:
    """The edge through v along a of the moving part across the fixed edge through q along e."""
    m = cross(R @ a, e)  # out of the fixed part
    return dot(m, p + R @ v - q) / norm(m)


@contact
def ball_face(p: Vector, R: Matrix, v: Body, n: World, c: Scalar, r: Scalar) -> Scalar:
    """A ball of the moving part, of radius r about its point v, over the fixed plane n·x = c."""
    return dot(n, p + R @ v) - c - r
