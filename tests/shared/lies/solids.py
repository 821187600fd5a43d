"""Lies about the solids: surfaces that are none, and pieces that are not the part."""

from random import Random
from typing import Any

from tests.shared.lies.lie import (
    CONSTRUCTION,
    SIDES,
    Document,
    Point,
    around,
    bodies,
    centre,
    chosen,
    cross,
    drawn,
    minus,
    named,
    normal,
    plus,
    unit,
)

TETRA = ([0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2])


def _part(plan: Document, rng: Random) -> Any:
    return plan["parts"][rng.choice(SIDES)]


def _shell(part: Document, at: Point, size: float, inverse: bool = False) -> None:
    """Adds a tetrahedron of its own to a surface, or one that is inside out."""
    n = len(part["vertices"])
    corners = [[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]]
    part["vertices"] += [plus(at, corner) for corner in corners]
    part["faces"] += [[[n + k for k in (reversed(face) if inverse else face)]] for face in TETRA]


def _edge(part: Document, rng: Random) -> tuple[int, int]:
    return rng.choice([edge for face in part["faces"] for loop in face for edge in around(loop)])


def unused_vertex(plan: Document, rng: Random) -> None:
    """A vertex of no face, 0.3 nm along an edge from its end and a little off the edge's line."""
    part = _part(plan, rng)
    a, b = (part["vertices"][k] for k in _edge(part, rng))
    u = unit(minus(b, a))
    part["vertices"].append(plus(plus(a, u, drawn(rng, -9.6, -9.0)), _across(u, rng), drawn(rng, -12.5, -11.1)))


def _across(u: Point, rng: Random) -> Point:
    """A unit vector across another, drawn."""
    return unit(cross(u, [rng.gauss(0.0, 1.0) for _ in range(3)]))


def unused_vertices_afar(plan: Document, rng: Random) -> None:
    """Vertices of no face, anywhere."""
    part = _part(plan, rng)
    part["vertices"] += [[rng.uniform(-0.02, 0.02) for _ in range(3)] for _ in range(rng.randrange(1, 4))]


def broken_edge(plan: Document, rng: Random) -> None:
    """A vertex within an edge, a little off its line."""
    part = _part(plan, rng)
    i, j = _edge(part, rng)
    a, b = part["vertices"][i], part["vertices"][j]
    u = unit(minus(b, a))
    part["vertices"].append(plus(plus(a, u, drawn(rng, -9.6, -3.0)), _across(u, rng), drawn(rng, -13.0, -11.1)))
    new = len(part["vertices"]) - 1
    for face in part["faces"]:
        for loop in face:
            for edge in ((i, j), (j, i)):
                if edge in list(around(loop)):
                    loop.insert(loop.index(edge[0]) + 1, new)


def bent_face(plan: Document, rng: Random) -> None:
    """A corner of a face with four or more moved out of its plane, in the surface and in all pieces."""
    part = _part(plan, rng)
    faces = [face[0] for face in part["faces"] if len(face[0]) > 3]
    loop = chosen(rng, faces)
    at = part["vertices"][rng.choice(loop)]
    moved = plus(at, normal(part["vertices"], loop), rng.choice((-1.0, 1.0)) * drawn(rng, -15.0, -7.0))
    was = list(at)
    for body in bodies(part):
        for vertex in body["vertices"]:
            if vertex == was:
                vertex[:] = moved


def moved_corner(plan: Document, rng: Random) -> None:
    """A corner of the surface moved, and not in the pieces."""
    part = _part(plan, rng)
    vertex = rng.choice(part["vertices"])
    axis = rng.randrange(3)
    vertex[axis] += rng.choice((-1.0, 1.0)) * drawn(rng, -13.0, -6.0)


def plugged_way(plan: Document, rng: Random) -> None:
    """A plug where the moving part is to be, outweighed by a shell that is inside out."""
    way = plan["segments"][rng.randrange(len(plan["segments"]))]["goal"][:3]
    size, part = drawn(rng, -5.0, -3.3), plan["parts"]["fixed"]
    _shell(part, plus(way, [0.0, 0.0, 1e-3]), size)
    _shell(part, [rng.uniform(0.1, 0.2), rng.uniform(0.1, 0.2), rng.uniform(-0.2, -0.1)], size, inverse=True)


def hollow_piece(plan: Document, rng: Random) -> None:
    """A void inside a piece, outweighed by a solid in the same piece."""
    part = _part(plan, rng)
    middle = centre(rng.choice(part["pieces"])["vertices"])
    size = drawn(rng, -6.0, -4.0)
    _shell(part, middle, size)
    _shell(part, plus(middle, [2.0 * size, 0.0, 0.0]), size, inverse=True)


def crossing_shell(plan: Document, rng: Random) -> None:
    """Two shells through a face of a piece, one of them inside out."""
    part = _part(plan, rng)
    piece = rng.choice(part["pieces"])
    loop = rng.choice(piece["faces"])[0]
    points = [piece["vertices"][k] for k in loop]
    size = drawn(rng, -6.0, -4.5)
    at = plus(centre(points), normal(piece["vertices"], loop), -0.2 * size)
    _shell(part, at, size)
    _shell(part, plus(at, unit(minus(points[1], points[0])), 2.0 * size), size, inverse=True)


def membrane(plan: Document, rng: Random) -> None:
    """A sheet without thickness, seen from both sides."""
    part = _part(plan, rng)
    n, at = len(part["vertices"]), [rng.uniform(-0.01, 0.01) for _ in range(3)]
    part["vertices"] += [plus(at, [3e-3 * (k == j) for j in range(3)]) for k in range(3)]
    part["faces"] += [[[n, n + 1, n + 2]], [[n + 2, n + 1, n]]]


def lid(plan: Document, rng: Random) -> None:
    """A hole closed by a sheet in the plane of its mouth."""
    part = plan["parts"]["fixed"]
    holed = [face for face in part["faces"] if len(face) > 1]
    face = chosen(rng, holed)
    part["faces"].append([face.pop(rng.randrange(1, len(face)))])


def doubled_face(plan: Document, rng: Random) -> None:
    """A face told twice."""
    part = _part(plan, rng)
    part["faces"].append([list(loop) for loop in rng.choice(part["faces"])])


def dropped_loop(plan: Document, rng: Random) -> None:
    """A hole of a face left out."""
    holed = [face for face in plan["parts"]["fixed"]["faces"] if len(face) > 1]
    chosen(rng, holed).pop()


def inside_out(plan: Document, rng: Random) -> None:
    """A surface seen from inside."""
    for face in _part(plan, rng)["faces"]:
        for loop in face:
            loop.reverse()


def cut_corner(plan: Document, rng: Random) -> None:
    """A corner that the part has and its only piece there has not."""
    part = _part(plan, rng)
    corners = {tuple(v) for v in part["vertices"]}
    places = [
        (piece, k)
        for piece in part["pieces"]
        for k, v in enumerate(piece["vertices"])
        if tuple(v) in corners
        and sum(k in face[0] for face in piece["faces"]) == 3
        and not any(_holds(other, v) for other in part["pieces"] if other is not piece)
    ]
    piece, k = chosen(rng, places)
    _truncate(piece, k, drawn(rng, -8.0, -5.41))


def _holds(piece: Document, at: Point) -> bool:
    """Whether a convex piece has a point inside or on its surface."""
    vertices, loops = piece["vertices"], [face[0] for face in piece["faces"]]
    ways = [(normal(vertices, loop), minus(at, vertices[loop[0]])) for loop in loops]
    return all(sum(x * y for x, y in zip(n, way, strict=True)) <= 1e-9 for n, way in ways)


def _truncate(piece: Document, k: int, depth: float) -> None:
    """Cuts the corner k, in which three faces meet, off of a piece."""
    vertices, faces = piece["vertices"], [face[0] for face in piece["faces"]]
    corner, new = list(vertices[k]), dict[int, int]()
    for end in sorted({edge[1] for loop in faces for edge in around(loop) if edge[0] == k}):
        point = plus(corner, unit(minus(vertices[end], corner)), depth)
        if new:
            vertices.append(point)
        else:
            vertices[k] = point
        new[end] = len(vertices) - 1 if new else k
    order = []
    for loop in faces:
        if k in loop:
            n = loop.index(k)
            before, after = loop[n - 1], loop[(n + 1) % len(loop)]
            loop[n : n + 1] = [new[before], new[after]]
            order.append((new[after], new[before]))
    # The cut's edges run against those of the faces that it cuts.
    follow = dict(order)
    piece["faces"].append([[k, follow[k], follow[follow[k]]]])


def shrunk_piece(plan: Document, rng: Random) -> None:
    """A piece drawn together."""
    piece, share = rng.choice(_part(plan, rng)["pieces"]), 1.0 - drawn(rng, -7.0, -2.0)
    middle = centre(piece["vertices"])
    for vertex in piece["vertices"]:
        vertex[:] = plus(middle, minus(vertex, middle), share)


def thin_skin(plan: Document, rng: Random) -> None:
    """A face of a piece moved in or out, where no other piece makes up for it."""
    pieces = _part(plan, rng)["pieces"]
    piece = rng.choice(pieces)
    loop = rng.choice(piece["faces"])[0]
    n, shift = normal(piece["vertices"], loop), rng.choice((-1.0, 1.0)) * drawn(rng, -11.5, -6.0)
    was = [list(piece["vertices"][k]) for k in loop]
    now = [plus(vertex, n, shift) for vertex in was]
    if not any(all(_holds(other, v) for v in (*was, *now)) for other in pieces if other is not piece):
        for k, vertex in zip(loop, now, strict=True):
            piece["vertices"][k] = vertex


def missing_piece(plan: Document, rng: Random) -> None:
    """A piece left out, with all that is said of it."""
    side = rng.choice(SIDES)
    pieces = plan["parts"][side]["pieces"]
    if len(pieces) < 2:
        return
    k = rng.randrange(len(pieces))
    pieces.pop(k)
    key = f"{side}_piece"
    for segment in plan["segments"]:
        segment["separations"] = [item for item in segment["separations"] if item[key] != k]
        for item in segment["separations"]:
            item[key] -= item[key] > k


def other_fraction(plan: Document, rng: Random) -> None:
    """A corner at another fraction than its plane's, or at none."""
    part = _part(plan, rng)
    if not part.get("exact"):
        return
    entry = rng.choice(part["exact"])
    if rng.random() < 0.3:
        part["exact"].remove(entry)
        return
    k = rng.randrange(3)
    p, _, q = entry["at"][k].partition("/")
    scale = 10 ** rng.randrange(9, 30)
    entry["at"][k] = f"{int(p) * scale + rng.choice((-1, 1))}/{int(q or 1) * scale}"


LIES = (
    *named(CONSTRUCTION, True, unused_vertex, unused_vertices_afar, broken_edge, bent_face, moved_corner, plugged_way),
    *named(CONSTRUCTION, True, hollow_piece, crossing_shell, membrane, lid, doubled_face, dropped_loop, inside_out),
    *named(CONSTRUCTION, True, cut_corner, shrunk_piece, thin_skin, missing_piece, other_fraction),
)
