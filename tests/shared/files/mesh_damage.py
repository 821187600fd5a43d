"""Meshes as programs leave them: rounded, noisy, cut up, turned, with facets doubled, flipped or lost; from a seed."""

from collections.abc import Callable

import numpy as np

from fmopt.spatial.se3 import exp

Mesh = tuple[np.ndarray, np.ndarray]  # points (n, 3) in mm, triangles (m, 3)
Damage = Callable[[np.ndarray, np.ndarray, np.random.Generator], Mesh]


def rounded_to_singles(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Coordinates as binary STL holds them."""
    return points.astype(np.float32).astype(np.float64), triangles


def in_inches(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Written in inches, as binary STL holds them, and read as such."""
    return 25.4 * (points / 25.4).astype(np.float32).astype(np.float64), triangles


def noisy(size: float) -> Damage:
    """Each vertex moved by up to a size (mm) along each axis."""

    def damage(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
        return points + rng.uniform(-size, size, points.shape), triangles

    return damage


def subdivided(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Each triangle cut in four."""
    sides = np.sort(np.vstack([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    edges, which = np.unique(sides, axis=0, return_inverse=True)
    ab, bc, ca = (which.ravel().reshape(3, -1) + len(points))[[0, 1, 2]]
    a, b, c = triangles.T
    cut = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.vstack([points, points[edges].mean(axis=1)]), np.vstack([np.stack(t, axis=1) for t in cut])


def decimated(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Vertices drawn onto a neighbour wherever that leaves the surface where it is, in random order."""
    star: list[set[int]] = [set() for _ in points]
    alive = dict(enumerate(map(tuple, triangles.tolist())))
    for number, triangle in alive.items():
        for vertex in triangle:
            star[vertex].add(number)

    def area(triangle: tuple[int, ...]) -> np.ndarray:
        a, b, c = points[list(triangle)]
        return np.cross(b - a, c - a)

    for vertex in rng.permutation(len(points)).tolist():
        for onto in sorted({v for number in star[vertex] for v in alive[number]} - {vertex}):
            gone = star[vertex] & star[onto]
            sides = [sum(v in alive[number] for number in star[vertex]) for v in {*_around(alive, star[vertex])}]
            shared = _around(alive, star[vertex]) & _around(alive, star[onto]) - {vertex, onto}
            moved = {n: tuple(onto if v == vertex else v for v in alive[n]) for n in star[vertex] - gone}
            if len(gone) != 2 or any(count not in (2, len(star[vertex])) for count in sides) or len(shared) != 2:
                continue
            before, after = ([area(t) for t in ts] for ts in ((alive[n] for n in moved), moved.values()))
            size = [float(np.linalg.norm(a) * np.linalg.norm(b)) for a, b in zip(before, after, strict=True)]
            if all(a @ b > (1.0 - 1e-12) * s > 0.0 for a, b, s in zip(before, after, size, strict=True)):
                for number in gone:
                    for v in alive.pop(number):
                        star[v].discard(number)
                alive.update(moved)
                star[onto] |= moved.keys()
                star[vertex] = set()
                break
    return points, np.array([alive[n] for n in sorted(alive)])


def _around(alive: dict[int, tuple[int, ...]], star: set[int]) -> set[int]:
    """The vertices of some triangles."""
    return {vertex for number in star for vertex in alive[number]}


def finely_noisy(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Cut in sixteen, and noise of 1 µm."""
    return noisy(1e-3)(*subdivided(*subdivided(points, triangles, rng), rng), rng)


def loose(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Each triangle with vertices of its own."""
    return points[triangles].reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def loose_and_apart(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Each triangle with vertices of its own, 0.1 µm off."""
    return noisy(1e-4)(*loose(points, triangles, rng), rng)


def shuffled(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Triangles and vertices in another order."""
    order = rng.permutation(len(points))
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    turned = [np.roll(t, rng.integers(3)) for t in rng.permutation(triangles)]
    return points[order], back[np.array(turned)]


def reflected(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """In a mirror, facing outward."""
    return points * (-1.0, 1.0, 1.0), triangles[:, ::-1]


def inside_out(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """In a mirror that nobody turned the triangles for."""
    return points * (-1.0, 1.0, 1.0), triangles


def with_t_junctions(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Some triangles cut in two at a side that their neighbour keeps whole."""
    cut = set(rng.choice(len(triangles), size=max(1, len(triangles) // 5), replace=False).tolist())
    more, kept = [*points], []
    for number, (a, b, c) in enumerate(triangles.tolist()):
        if number in cut:
            more.append(0.5 * (points[a] + points[b]))
            kept += [(a, len(more) - 1, c), (len(more) - 1, b, c)]
        else:
            kept.append((a, b, c))
    return np.array(more), np.array(kept)


def one_flipped(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """One triangle facing the other way."""
    turned = np.array(triangles)
    k = rng.integers(len(turned))
    turned[k] = turned[k, ::-1]
    return points, turned


def one_missing(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """One triangle less."""
    return points, np.delete(triangles, rng.integers(len(triangles)), axis=0)


def one_twice(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """One triangle twice."""
    return points, np.vstack([triangles, triangles[rng.integers(len(triangles))]])


def turned(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Anywhere in space, as singles."""
    pose = exp(rng.normal(size=3))
    return rounded_to_singles(points @ pose.T + rng.uniform(-50.0, 50.0, 3), triangles, rng)


def turned_and_noisy(points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> Mesh:
    """Anywhere in space, with noise of 1 µm."""
    return noisy(1e-3)(*turned(points, triangles, rng), rng)


DAMAGES: dict[str, Damage] = {
    "singles": rounded_to_singles,
    "inches": in_inches,
    "decimated": decimated,
    "noise of 0.1 µm": noisy(1e-4),
    "noise of 1 µm": noisy(1e-3),
    "noise of 10 µm": noisy(1e-2),
    "subdivided": subdivided,
    "subdivided and noisy": finely_noisy,
    "unmerged": loose,
    "unmerged and apart": loose_and_apart,
    "shuffled": shuffled,
    "reflected": reflected,
    "inside out": inside_out,
    "T-junctions": with_t_junctions,
    "one flipped": one_flipped,
    "one missing": one_missing,
    "one twice": one_twice,
    "turned": turned,
    "turned and noisy": turned_and_noisy,
}
