"""Kernels of primitive contacts, written by `python -m fmopt.contact.generate`: do not edit.

`tables` has records of the contacts of each kind, in the order of the definitions; all contacts
together are numbered in that order. A pose is its position p (3) in m and its rotation R (3, 3); distances are in m.
"""

from typing import Any, TypeAlias

from numpy import sqrt

from fmopt.runtime.compiled import part
from fmopt.spatial.kernels import turned, vector
from fmopt.spatial.values import Array

Tables: TypeAlias = tuple[Any, ...]
Row: TypeAlias = Any
Position: TypeAlias = Any


@part
def _vertex_face_height(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    v_0, v_1, v_2 = turned(R, vector(row["v"]))
    n_0, n_1, n_2 = vector(row["n"])
    c = row["c"]
    return -c + n_0*(p_0 + v_0) + n_1*(p_1 + v_1) + n_2*(p_2 + v_2)


@part
def _vertex_face_wrench(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    v_0, v_1, v_2 = turned(R, vector(row["v"]))
    n_0, n_1, n_2 = vector(row["n"])
    c = row["c"]
    return (-c + n_0*(p_0 + v_0) + n_1*(p_1 + v_1) + n_2*(p_2 + v_2), n_0, n_1, n_2, -n_1*v_2 + n_2*v_1, n_0*v_2 - n_2*v_0, -n_0*v_1 + n_1*v_0)


@part
def _face_vertex_height(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    n_0, n_1, n_2 = turned(R, vector(row["n"]))
    w_0, w_1, w_2 = vector(row["w"])
    c = row["c"]
    return -c + n_0*(-p_0 + w_0) + n_1*(-p_1 + w_1) + n_2*(-p_2 + w_2)


@part
def _face_vertex_wrench(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    n_0, n_1, n_2 = turned(R, vector(row["n"]))
    w_0, w_1, w_2 = vector(row["w"])
    c = row["c"]
    s0 = -p_0 + w_0
    s1 = -p_1 + w_1
    s2 = -p_2 + w_2
    return (-c + n_0*s0 + n_1*s1 + n_2*s2, -n_0, -n_1, -n_2, n_1*s2 - n_2*s1, -n_0*s2 + n_2*s0, n_0*s1 - n_1*s0)


@part
def _edge_edge_height(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    a_0, a_1, a_2 = turned(R, vector(row["a"]))
    v_0, v_1, v_2 = turned(R, vector(row["v"]))
    e_0, e_1, e_2 = vector(row["e"])
    q_0, q_1, q_2 = vector(row["q"])
    s0 = a_0*e_1 - a_1*e_0
    s1 = -a_0*e_2 + a_2*e_0
    s2 = a_1*e_2 - a_2*e_1
    root_0 = sqrt((s0 * s0) + (s1 * s1) + (s2 * s2))
    return (s0*(p_2 - q_2 + v_2) + s1*(p_1 - q_1 + v_1) + s2*(p_0 - q_0 + v_0))/root_0


@part
def _edge_edge_wrench(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    a_0, a_1, a_2 = turned(R, vector(row["a"]))
    v_0, v_1, v_2 = turned(R, vector(row["v"]))
    e_0, e_1, e_2 = vector(row["e"])
    q_0, q_1, q_2 = vector(row["q"])
    s0 = a_0*e_1 - a_1*e_0
    s1 = -a_0*e_2 + a_2*e_0
    s2 = a_1*e_2 - a_2*e_1
    root_0 = sqrt((s0 * s0) + (s1 * s1) + (s2 * s2))
    s3 = (1.0 / root_0)
    s4 = p_2 - q_2 + v_2
    s5 = p_1 - q_1 + v_1
    s6 = p_0 - q_0 + v_0
    s7 = s0*s4 + s1*s5 + s2*s6
    s8 = s2*s3
    s9 = s1*s3
    s10 = s0*s3
    s11 = s7/(root_0 * root_0 * root_0)
    s12 = s11*(-e_0*s1 + e_1*s2) + s3*(e_0*s5 - e_1*s6)
    s13 = s11*(e_0*s0 - e_2*s2) + s3*(-e_0*s4 + e_2*s6)
    s14 = s11*(-e_1*s0 + e_2*s1) + s3*(e_1*s4 - e_2*s5)
    return (s3*s7, s8, s9, s10, a_1*s12 - a_2*s13 + s10*v_1 - s9*v_2, -a_0*s12 + a_2*s14 - s10*v_0 + s2*s3*v_2, a_0*s13 - a_1*s14 - s8*v_1 + s9*v_0)


@part
def _edge_edge_regularity(row: Row, p: Position, R: Array) -> Any:
    a_0, a_1, a_2 = turned(R, vector(row["a"]))
    e_0, e_1, e_2 = vector(row["e"])
    return ((a_0*e_1 - a_1*e_0) * (a_0*e_1 - a_1*e_0)) + ((-a_0*e_2 + a_2*e_0) * (-a_0*e_2 + a_2*e_0)) + ((a_1*e_2 - a_2*e_1) * (a_1*e_2 - a_2*e_1))


@part
def _ball_face_height(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    v_0, v_1, v_2 = turned(R, vector(row["v"]))
    n_0, n_1, n_2 = vector(row["n"])
    c = row["c"]
    r = row["r"]
    return -c + n_0*(p_0 + v_0) + n_1*(p_1 + v_1) + n_2*(p_2 + v_2) - r


@part
def _ball_face_wrench(row: Row, p: Position, R: Array) -> Any:
    p_0, p_1, p_2 = vector(p)
    v_0, v_1, v_2 = turned(R, vector(row["v"]))
    n_0, n_1, n_2 = vector(row["n"])
    c = row["c"]
    r = row["r"]
    return (-c + n_0*(p_0 + v_0) + n_1*(p_1 + v_1) + n_2*(p_2 + v_2) - r, n_0, n_1, n_2, -n_1*v_2 + n_2*v_1, n_0*v_2 - n_2*v_0, -n_0*v_1 + n_1*v_0)


@part
def height(tables: Tables, i: int, p: Position, R: Array) -> float:
    """The distance of a contact at a pose p (3,), R (3, 3)."""
    vertex_face, face_vertex, edge_edge, ball_face = tables
    if i < len(vertex_face):
        return float(_vertex_face_height(vertex_face[i], p, R))
    i -= len(vertex_face)
    if i < len(face_vertex):
        return float(_face_vertex_height(face_vertex[i], p, R))
    i -= len(face_vertex)
    if i < len(edge_edge):
        return float(_edge_edge_height(edge_edge[i], p, R))
    i -= len(edge_edge)
    return float(_ball_face_height(ball_face[i], p, R))


@part
def wrench(tables: Tables, i: int, p: Position, R: Array, N: Array) -> float:
    """The distance of a contact at a pose p (3,), R (3, 3), and its wrench into the first six numbers of N."""
    vertex_face, face_vertex, edge_edge, ball_face = tables
    if i < len(vertex_face):
        f, N[0], N[1], N[2], N[3], N[4], N[5] = _vertex_face_wrench(vertex_face[i], p, R)
        return float(f)
    i -= len(vertex_face)
    if i < len(face_vertex):
        f, N[0], N[1], N[2], N[3], N[4], N[5] = _face_vertex_wrench(face_vertex[i], p, R)
        return float(f)
    i -= len(face_vertex)
    if i < len(edge_edge):
        f, N[0], N[1], N[2], N[3], N[4], N[5] = _edge_edge_wrench(edge_edge[i], p, R)
        return float(f)
    i -= len(edge_edge)
    f, N[0], N[1], N[2], N[3], N[4], N[5] = _ball_face_wrench(ball_face[i], p, R)
    return float(f)


@part
def regularity(tables: Tables, i: int, p: Position, R: Array) -> float:
    """At a pose p (3,), R (3, 3) the least of what a distance has roots of, as the squared sine of edges; else 1."""
    vertex_face, face_vertex, edge_edge, ball_face = tables
    if i < len(vertex_face):
        return 1.0
    i -= len(vertex_face)
    if i < len(face_vertex):
        return 1.0
    i -= len(face_vertex)
    if i < len(edge_edge):
        return float(_edge_edge_regularity(edge_edge[i], p, R))
    i -= len(edge_edge)
    return 1.0


@part
def number_of(tables: Tables) -> int:
    """How many contacts there are."""
    vertex_face, face_vertex, edge_edge, ball_face = tables
    return len(vertex_face) + len(face_vertex) + len(edge_edge) + len(ball_face)
