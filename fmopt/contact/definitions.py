"""C-surface functions f(X) of the primitive contacts: signed distances, f < 0 inside the forbidden zone.

The moving part is at (p, R): its point v is at p + R v, its direction n along R n. Normals and directions have unit
length, and point out of their own part. A kind of contact is what stands here and nothing else: its gradient (the
contact's wrench) and its second derivatives, the compiled kernels of `kernels_generated` (`python -m
fmopt.contact.generate` writes them anew), the functions of nonlinear programs and the formula in a notebook follow from
it. [DakinPopplestone1993] section 2 and Appendix I.
"""

from __future__ import annotations

from fmopt.contact.algebra import CONTACTS, Body, Matrix, Scalar, Vector, World, contact, cross, dot, norm, row

__all__ = ["CONTACTS"]


@contact
def vertex_face(p: Vector, R: Matrix, v: Body, n: World, c: Scalar) -> Scalar:
    """A point v of the moving part over the fixed plane n·x = c.

    Args:
        p: body origin in the B-frame, m.
        R: orientation of the body frame.
        v: of the moving part, in its body frame, m.
        n: outward unit normal, axes of B.
        c: offset, m.
    """
    return dot(n, p + R @ v) - c


@contact
def face_vertex(p: Vector, R: Matrix, n: Body, w: World, c: Scalar) -> Scalar:
    """A fixed point w over the plane n·x = c of the moving part.

    Args:
        p, R: as for `vertex_face`.
        n: outward unit normal of the moving face, body axes.
        w: in the B-frame, m.
        c: offset, m.
    """
    return dot(R @ n, w - p) - c


@contact
def edge_edge(p: Vector, R: Matrix, a: Body, v: Body, e: World, q: World) -> Scalar:
    """The edge through v along a of the moving part across the fixed edge through q along e.

    Args:
        p, R: as for `vertex_face`.
        a: direction, body axes; it points so that R a × e leads out of the fixed part.
        v: a point of that edge, in the body frame, m.
        e: direction, axes of B.
        q: a point of that edge, in the B-frame, m.
    """
    m = cross(R @ a, e)  # out of the fixed part
    return dot(m, p + R @ v - q) / norm(m)


@contact
def ball_face(p: Vector, R: Matrix, v: Body, n: World, c: Scalar, r: Scalar) -> Scalar:
    """A ball of the moving part, of radius r about its point v, over the fixed plane n·x = c.

    Args:
        p, R, n, c: as for `vertex_face`.
        v: the ball's centre, in the body frame, m.
        r: m.
    """
    return dot(n, p + R @ v) - c - r


@row
def edges_apart(p: Vector, R: Matrix, a: Body, v: Body, e: World, q: World) -> Scalar:
    """The distance of edges times the sine between them, |R a × e|; of any point v over the plane along both.

    Args:
        p, R, a, v, e, q: as for `edge_edge`.
    """
    # The triple product: v and q may be any points of the two lines, as moving one along its line changes nothing.
    return dot(R @ a, cross(e, p - q)) + dot(e, R @ cross(v, a))


@row
def hinge(p: Vector, R: Matrix, k: Body, u: World) -> Scalar:
    """An edge held in a wall, or a face level with a rim: only turning moves it.

    Args:
        p, R: as for `vertex_face`.
        k: body axes.
        u: axes of B.
    """
    return dot(u, R @ k)
