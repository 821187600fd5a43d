"""The attitude that parts are planned for: which of their images it is, and how moves come back from it."""

from typing import Any

import numpy as np
import pytest

from fmopt.certificate.assembly import Assembly
from fmopt.contact.c_surface import Surfaces
from fmopt.contact.primitive import Kind, near_contacts
from fmopt.geometry import csg
from fmopt.geometry.csg import Box, Prism, Union
from fmopt.geometry.part import Part, part_of, rebased, with_balls
from fmopt.planning import motion
from fmopt.planning.pipeline import certified_motion, proved
from fmopt.planning.placement.sequence_program import Placed
from fmopt.planning.posed import placement
from fmopt.planning.search.symmetry import Attitude, Image, Searched, all_attitudes, image_in, images
from fmopt.spatial import se3
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Array
from fmopt.task.problem import load
from tests import ROOT

BOX = np.array([1e-3, 1e-3, 0.0, 0.01, 0.01, 0.01])
CHIRAL = Prism(((-0.01, -0.008), (0.01, -0.008), (0.01, 0.004), (-0.01, 0.009)), 0.03)
BAR = Box((0.02, 0.01, 0.03))
HEXAGON = Prism(tuple((0.01 * np.cos(a), 0.01 * np.sin(a)) for a in np.arange(6) * np.pi / 3), 0.03)
FIN = csg.Moved(Box((0.004, 0.02, 0.03)), Pose.from_vector([0.004, 0.0, 0.0, 0.0, 0.0, 0.0]))
FINNED = Union((BAR, FIN))
PENTAGON = Prism(tuple((0.01 * np.cos(a), 0.01 * np.sin(a)) for a in np.arange(5) * 2 * np.pi / 5), 0.03)
HEAD = csg.Moved(Box((0.03, 0.03, 0.01)), Pose.from_vector([0.0, 0.0, 0.03, 0.0, 0.0, 0.0]))
HEADED = Union((PENTAGON, HEAD))  # whose moments are those of its images, and whose head reaches as far
NOTCH = csg.Moved(Prism(((0.0, 0.0), (0.02, 0.02), (-0.02, 0.02)), 0.05), Pose.from_vector([0, 0, -0.01, 0, 0, 0]))
NOTCHED = csg.Difference(Box((0.02, 0.02, 0.03)), (NOTCH,))
FIXED = part_of("floor", Box((0.1, 0.1, 0.01)))


def pair(solid: csg.Solid, fixed: Part = FIXED) -> Assembly:
    return Assembly(rebased(part_of("moving", solid), Pose.identity()), fixed)


def shape(assembly: Assembly) -> bytes:
    """Vertices and faces of both parts."""
    bodies = (assembly.moving.polyhedron, assembly.fixed.polyhedron)
    return b"".join(body.vertices.tobytes() + repr([face.loops for face in body.faces]).encode() for body in bodies)


@pytest.mark.parametrize(
    ("solid", "box", "count"),
    [
        (Box((0.02, 0.02, 0.03)), BOX, 1),
        (Box((0.02, 0.02, 0.03)), BOX * [1, 2, 1, 1, 1, 1], 2),
        (BAR, BOX, 2),
        (HEXAGON, BOX, 2),
        (FINNED, BOX, 4),
        (CHIRAL, BOX, 8),
        (HEADED, BOX, 4),
        (NOTCHED, BOX, 4),  # its corners alone would be those of all images
    ],
)
def test_images_are_as_many_as_differ(solid: csg.Solid, box: Array, count: int) -> None:
    found = list(images(pair(solid), box))
    assert len(found) == count
    assert len({shape(image.assembly) + image.attitude.of_widths(box).tobytes() for image in found}) == count


@pytest.mark.parametrize("solid", [BAR, HEXAGON, FINNED, CHIRAL, HEADED, NOTCHED])
def test_all_images_of_a_shape_are_planned_for_in_the_same_one(solid: csg.Solid) -> None:
    own = pair(solid)
    plain = next(images(own, BOX)).assembly
    for attitude in all_attitudes(planar=False):
        other = next(images(image_in(own, attitude).assembly, BOX)).assembly
        for one, same in ((plain.moving, other.moving), (plain.fixed, other.fixed)):
            assert one.polyhedron.vertices.tobytes() == same.polyhedron.vertices.tobytes()
            assert one.polyhedron.normals.tobytes() == same.polyhedron.normals.tobytes()
            assert [f.loops for f in one.polyhedron.faces] == [f.loops for f in same.polyhedron.faces]
            assert [p.vertices.tobytes() for p in one.pieces] == [p.vertices.tobytes() for p in same.pieces]


@pytest.mark.parametrize("solid", [BAR, HEXAGON, FINNED, CHIRAL])
def test_rounding_in_files_does_not_matter(solid: csg.Solid) -> None:
    there = Pose.from_vector([0.1, -0.05, 0.03, 0.0, 0.0, 0.6])
    turned = Assembly(rebased(part_of("moving", csg.Moved(solid, there)), there), FIXED)
    one, same = (next(images(own, BOX)).assembly.moving for own in (pair(solid), turned))
    assert one.polyhedron.vertices.tobytes() == same.polyhedron.vertices.tobytes()
    assert one.polyhedron.normals.tobytes() == same.polyhedron.normals.tobytes()


def test_long_parts_lie_along_x() -> None:
    for size in ((0.05, 0.01, 0.03), (0.01, 0.05, 0.03)):
        body = next(images(pair(Box(size)), BOX)).assembly.moving.polyhedron
        assert np.ptp(body.vertices, axis=0).tolist() == pytest.approx([0.05, 0.01, 0.03])


def test_uneven_errors_lie_along_x() -> None:
    box = BOX * [1, 2, 1, 3, 1, 1]
    assert (
        next(images(pair(Box((0.02, 0.02, 0.03))), box)).attitude.of_widths(box).tolist()
        == box[[1, 0, 2, 4, 3, 5]].tolist()
    )


@pytest.mark.parametrize("number", range(8))
def test_contacts_of_an_image_are_those_of_the_parts(number: int) -> None:
    problem = load(ROOT / "problems" / "kite_prism.toml")
    rng, kinds = np.random.default_rng(number), set[Kind]()
    for peg_moves in (True, False, True, False):
        pose = Pose(rng.uniform(-1e-3, 1e-3, 3) - [0, 0, 0.005], se3.exp(rng.uniform(-0.2, 0.2, 3)))
        peg = with_balls(problem.moving, [((0.001, 0.002, 0.004), 0.008)])
        parts = (peg, problem.fixed) if peg_moves else (problem.fixed, problem.moving)
        kinds |= compare(Assembly(*parts), pose if peg_moves else pose.inverse(), number)
    assert kinds == set(Kind)


def compare(own: Assembly, pose: Pose, number: int) -> set[Kind]:
    """Holds the contacts near a pose of an image against those of the parts; which kinds there are."""
    image = image_in(own, all_attitudes(planar=False)[number])
    parts = image.assembly.moving.polyhedron, image.assembly.fixed.polyhedron
    own_parts = own.moving.polyhedron, own.fixed.polyhedron
    near, back = near_contacts(*parts, pose, 2e-3, 0.05), Attitude(image.attitude.axes.T).of_pose(pose)
    mine = image.own_contacts(near)
    assert set(mine) == set(near_contacts(*own_parts, back, 2e-3, 0.05))
    assert Surfaces.of(mine, *own_parts).values(back) == pytest.approx(
        Surfaces.of(near, *parts).values(pose), abs=1e-13
    )
    return {contact.kind for contact in near}


@pytest.mark.parametrize("number", range(8))
def test_moves_come_back_with_the_same_margin(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = load(ROOT / "problems" / "factory_rect_8mm_tight_300um.toml")
    placed: list[Placed] = []

    def in_one(own: Assembly, _: Array) -> list[Image]:
        return [image_in(own, all_attitudes(planar=False)[number])]

    def watched(*arguments: Any) -> Placed:
        placed.append(placement(*arguments))
        return placed[-1]

    monkeypatch.setattr(motion, "images", in_one)
    monkeypatch.setattr(motion, "placement", watched)
    done = certified_motion(problem)
    assert done.placed.margin == pytest.approx(placed[-1].margin, rel=1e-10)
    assert str(proved(problem, done)[1].verdict) == "CERTIFIED"


def test_freedoms_are_named_in_the_parts_own_axes() -> None:
    found = Searched(0.5, ("approach", "-x", "+rz", "+ry", "-y", "-rx", "-z"), 1.0, 1.0, 1)
    for attitude in all_attitudes(planar=False):
        named = image_in(pair(CHIRAL), attitude).own_search(found)
        own = se3.exp([0.0, 0.0, named.heading])
        there = se3.exp([0.0, 0.0, found.heading])
        for mine, its in zip(named.names[1:], found.names[1:], strict=True):
            twist, other = _twist(mine, own), _twist(its, there)
            mirror = np.linalg.det(attitude.axes)
            assert attitude.axes @ twist[:3] == pytest.approx(other[:3])
            assert mirror * (attitude.axes @ twist[3:]) == pytest.approx(other[3:])


def _twist(name: str, axes: Array) -> Array:
    sign, turn, axis = (1.0 if name[0] == "+" else -1.0), len(name) == 3, "xyz".index(name[-1])
    return np.roll(np.append(sign * axes[:, axis], np.zeros(3)), 3 * turn)
