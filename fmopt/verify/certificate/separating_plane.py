"""That a moving and a fixed piece stay on two sides of a witness plane, whatever the error does."""

from collections.abc import Sequence
from dataclasses import dataclass

from fmopt.verify.arithmetic.rational import ONE, dot, fixed, length, over, sub, unit, vector
from fmopt.verify.certificate.edge_planes import Known, edge_rows
from fmopt.verify.certificate.propagation import Motion
from fmopt.verify.parts.assembly import PartPair, over_balls
from fmopt.verify.parts.rows import Distance, FaceAbove, Function, PointAbove
from fmopt.verify.parts.solids import Plane, Shape, near
from fmopt.verify.reading.document import StatedWitness


class WitnessError(ValueError):
    """A witness that names no face or edge, or holds nothing to be checked."""


@dataclass(frozen=True)
class Apart:
    """Outcome for a pair, in fixed point: certified margin and nominal clearance, m; the row that is tightest."""

    margin: int
    clearance: int
    tightest: tuple[Distance, Distance] | None


def apart(assembly: PartPair, M: Shape, F: Shape, witness: StatedWitness, motion: Motion, known: Known) -> Apart:
    """Margin and clearance of a witness over a piece of motion.

    Raises:
        WitnessError: see there.
    """
    scale = ONE
    if witness.kind == "edges":
        functions, scale = edge_rows(assembly, M, F, witness, motion, known)
    elif witness.kind == "moving-face":
        functions = _moving_face_rows(assembly, M, F, witness, known)
    else:
        functions = _fixed_plane_rows(assembly, M, F, witness, known)
    # A plane that contacts settle altogether proves nothing by itself: there must be a distance to speak of.
    if not functions:
        raise WitnessError("every row is excused")
    clearance = min([motion.nominal(function) for function in functions])
    margin, tightest = least(motion, functions)
    # Rows of edges are not of unit normal: divided by an upper bound of its length, the margin stays a lower bound.
    if scale != ONE:
        margin, clearance = over(margin, scale), over(clearance, scale)
    return Apart(margin, clearance, tightest)


def least(motion: Motion, functions: Sequence[Function]) -> tuple[int, tuple[Distance, Distance]]:
    """The least certified bound of functions, with the row of the one that has it.

    Those that the errors' box keeps far away are not looked at closely.
    """
    # The quick bounds are not above the exact ones, so that in their order the search can stop.
    quick = sorted([(motion.far(function), k) for k, function in enumerate(functions)])
    tightest = functions[quick[0][1]]
    margin = motion.lowest(tightest)
    for far, k in quick[1:]:
        if far >= margin:
            break
        found = motion.lowest(functions[k])
        if found < margin:
            margin, tightest = found, functions[k]
    return margin, motion.ends(tightest)


def _face(shape: Shape, loop: tuple[int, ...]) -> int:
    found = shape.face_of(loop) if len(loop) >= 3 else None
    if found is None:
        raise WitnessError("names no face of the piece")
    return found


def _fixed_plane_rows(assembly: PartPair, M: Shape, F: Shape, witness: StatedWitness, known: Known) -> list[Function]:
    done: set[int] = set()
    if witness.kind == "plane":
        # Contacts say nothing of a plane of its own: no row is excused.
        normal = vector(witness.normal)
        size = length(normal)
        # Stated in doubles it is nearly of unit length; far from that it is no normal.
        if abs(size - ONE) > ONE >> 1:
            raise WitnessError("has no unit normal")
        n = unit(normal)
        # Moved out to have the whole fixed piece behind it, wherever the plan puts it.
        plane = Plane(n, max(over(fixed(witness.offset), size), *(dot(n, w) for w in F.vertices)))
    elif M.ball:
        face = _face(F, witness.fixed)
        plane, backed = F.supporting(face), assembly.backed(assembly.fixed, F, face)
        if backed is not None and known.presses(assembly, M.vertices[0], backed.wall):
            # The contact settles the ball's row; what is left to say is that its centre is on this side.
            return [PointAbove(backed.cover, M.vertices[0], M.lengths[0])]
    else:
        face = _face(F, witness.fixed)
        plane, backed = F.supporting(face), assembly.backed(assembly.fixed, F, face)
        # Only where the piece's face is one of the part's do contacts say anything about it.
        if backed is not None:
            done = known.facts.not_below(backed.wall, M.vertices, known.above(assembly, backed.wall))
            # What is excused is so over the part's own plane: the others are measured over that then, too.
            plane = backed.cover if done else plane
    kept = [k for k in range(len(M.vertices)) if k not in done]
    if M.ball:
        plane = over_balls(plane, M.radii[0])
    return [PointAbove(plane, M.vertices[k], M.lengths[k]) for k in kept]


def _moving_face_rows(assembly: PartPair, M: Shape, F: Shape, witness: StatedWitness, known: Known) -> list[Function]:
    face = _face(M, witness.moving)
    plane, backed = M.supporting(face), assembly.backed(assembly.moving, M, face)
    done: set[int] = set()
    if backed is not None:
        touching = [t for t in known.all if t.kind == "face-vertex" and t.plane is not None]
        on = [t.fixed[0] for t in touching if t.plane is not None and assembly.agree(t.plane, backed.wall)]
        # Vertices of pieces may be off the part's that contacts are of.
        done = {k for k, w in enumerate(F.vertices) if any(near(sub(w, x)) for x in on)}
        for rim in known.rims:
            if rim.held and assembly.along(rim.face, backed.wall):
                done |= {k for k, w in enumerate(F.vertices) if rim.before(w, backed.wall)}
        plane = backed.cover if done else plane
    return [FaceAbove(plane, w) for k, w in enumerate(F.vertices) if k not in done]
