"""The cone program that places the goal poses of a plan, to be changed and solved in a notebook, and what follows."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, assert_never

import numpy as np

from fmopt.contact.primitive import Kind, PrimitiveContact, ball_face, crossed, face_vertex, vertex_face
from fmopt.errors import ResourceError, SolverError
from fmopt.geometry.polyhedron import Polyhedron
from fmopt.plan import Plan, StatedContact
from fmopt.planning.moves.moves import Move, Reached
from fmopt.planning.optimise.cone_program import as_cvxpy
from fmopt.planning.placement.sequence_program import Aim, certified, displaced, sequence_program
from fmopt.planning.posed import FINE, Posed
from fmopt.planning.robustness.error_tolerance import CertifiedMotion
from fmopt.planning.search.symmetry import Searched
from fmopt.report.moves import moves
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem

if TYPE_CHECKING:
    import cvxpy

_RADIUS = 0.1  # of the clearance on each side


@dataclass(frozen=True, eq=False)
class Placing:
    """Goal poses to be placed: a CVXPY problem, and the motion that its answer makes.

    >>> import cvxpy
    >>> problem = fmopt.load(fmopt.example("square_peg"))
    >>> placing = fmopt.read("out/square_peg/plan.json").placement(problem)
    >>> upright = [placing.shift[1, 3:] == 0]  # the first goal pose keeps its tilt
    >>> own = cvxpy.Problem(placing.program.objective, [*placing.program.constraints, *upright])
    >>> _ = own.solve(solver="CLARABEL")
    >>> motion = placing.motion()
    >>> plan = fmopt.stages.plan(problem, motion)
    >>> plan.verdict
    'CERTIFIED'

    Args:
        shift: displacements (m + 1, 6) of the start and of the goals of m moves, m and rad: positions, then turns.
        margin: what the program says of the margin, m; what holds is the margin of `motion`.
    """

    program: "cvxpy.Problem"
    shift: "cvxpy.Expression"
    margin: "cvxpy.Expression"
    now: CertifiedMotion
    aim: Aim

    def motion(self) -> CertifiedMotion:
        """The motion with its poses where the solved program has them, on the true surfaces, certified anew.

        Raises:
            SolverError: nothing was solved yet.
            InfeasibleError: a pose leaves its contact state, or a move is impossible.
        """
        if self.shift.value is None:
            raise SolverError("the program has no solution yet")
        placed = displaced(self.aim, self.now.placed, np.asarray(self.shift.value, dtype=np.float64))
        return replace(self.now, placed=placed)


def placing(plan: Plan, problem: Problem, radius: float | None = None) -> Placing:
    """The placement of a plan's goal poses; see `fmopt.Plan.placement`.

    Raises:
        ResourceError: CVXPY is not installed.
    """
    # The motion of the plan, certified once more on the parts of its problem.
    posed, said = Posed.of(problem), plan.description.search
    run = tuple(_moves(plan, posed.assembly.moving.polyhedron, posed.assembly.fixed.polyhedron))
    placed = certified(posed.assembly, run, posed.start, posed.tolerance, FINE)
    found = Searched(0.0, (), 0.0, 0.0, 0)
    if said is not None:
        found = Searched(said.heading, said.moves, said.cost, said.lower_bound, said.states_expanded)
    now = posed.certified(found, placed)
    aim = Aim(now.assembly, Reached(now.errors, (), ()), now.tolerance, FINE)  # it begins free: no basis, no claims
    program = sequence_program(aim, now.placed, _RADIUS * now.clearance.per_side if radius is None else radius)
    try:
        found, y = as_cvxpy(program.scaled())
    except ImportError as error:
        raise ResourceError("the placement of a plan needs the extra cvxpy", "install fmopt[cvxpy]") from error
    import cvxpy

    # Solvers want unknowns of one size: y are theirs, x those of the program, in m and rad.
    x = cvxpy.multiply(program.units, y)
    return Placing(found, cvxpy.reshape(x[:-1], (len(now.placed.moves) + 1, 6), order="C"), x[-1], now, aim)


def _moves(plan: Plan, moving: Polyhedron, fixed: Polyhedron) -> Iterator[Move]:
    contacts = {contact.id: _contact(contact, moving, fixed) for contact in plan.contacts}
    for move in moves(plan):
        first, last = move.segments[0], move.segments[-1]
        held, left = ([contacts[name] for name in names] for names in (last.state, first.leaving))
        made = [contacts[name] for name in last.goal_state if name not in last.state]
        start, goal = (Pose.from_vector(np.array(pose)) for pose in (first.start, last.goal))
        yield Move(start, goal, tuple(held), tuple(made), tuple(left))


def _contact(contact: StatedContact, moving: Polyhedron, fixed: Polyhedron) -> PrimitiveContact:
    """A contact of a plan as one of the parts that the plan was made for, whose features have the same numbers."""
    one, other = (int(name[1:]) for name in contact.id.split("-"))
    match Kind(contact.kind):
        case Kind.VERTEX_FACE:
            return vertex_face(fixed, one, other)
        case Kind.BALL_FACE:
            return ball_face(fixed, one, other)
        case Kind.FACE_VERTEX:
            return face_vertex(moving, one, other)
        case Kind.EDGE_EDGE:
            # In which order the plan has its ends says which way the moving edge runs.
            return crossed(moving, fixed, one, other, tuple(contact.moving) == moving.edges[one].vertices)
        case kind:
            assert_never(kind)
