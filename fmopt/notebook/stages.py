"""The stages of `fmopt.solve`, to be called one by one; each takes and gives values, and changes nothing.

>>> problem = fmopt.load(fmopt.example("square_peg"))
>>> nominal = fmopt.stages.nominal(problem)
>>> [critical.name for critical in nominal.critical]
['mouth', 'mid-depth', 'bottom']
>>> graph = fmopt.stages.contact_graph(problem, nominal.critical[1].pose)
>>> graph.count()
{1: 18, 2: 64, 3: 88, 4: 56, 5: 16, 6: 1}
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fmopt.geometry.clearance import Clearance
from fmopt.notebook.plan import Plan
from fmopt.spatial.se3 import Pose
from fmopt.task.problem import Problem
from fmopt.task.sizes import characteristic_length, measured_clearance

if TYPE_CHECKING:
    from fmopt.certificate.error_set import ErrorSet
    from fmopt.contact.primitive import PrimitiveContact
    from fmopt.contact.state_graph import ContactGraph
    from fmopt.planning.plan_record import NominalMotion
    from fmopt.planning.robustness.error_tolerance import CertifiedMotion

Progress = Callable[[str], None]


def clearance(problem: Problem) -> Clearance:
    """The clearance as measured on the parts, m.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        GeometryError: it is not of the size that the problem declares.
    """
    return measured_clearance(problem)


def start_errors(problem: Problem) -> ErrorSet:
    """The set of start errors (d, δ), m and rad, as it is carried along the motion."""
    from fmopt.certificate.error_set import ErrorSet

    return ErrorSet.of(problem.start_box, problem.framing)


def nominal(problem: Problem) -> NominalMotion:
    """The T-C mapping, [LeeHuang1985] section 4.1: diagrams, P(t) (m, rad), S(t), and the critical poses on the way.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
    """
    from fmopt.planning.pipeline import nominal_motion

    return nominal_motion(problem, start_errors(problem), _rho(problem))


def near_contacts(problem: Problem, pose: ArrayLike, reach: float | None = None) -> tuple[PrimitiveContact, ...]:
    """The primitive contacts that can close near a pose (6,), m and rad, [DakinPopplestone1993] section 2.

    They are looked for up to `reach` off, m, else up to three clearances.
    """
    from fmopt.contact.primitive import near_contacts as near

    at, far = Pose.from_vector(np.asarray(pose, dtype=np.float64)), reach or 3.0 * clearance(problem).per_side
    return tuple(near(problem.moving.polyhedron, problem.fixed.polyhedron, at, far, far / _rho(problem)))


def contact_graph(problem: Problem, pose: ArrayLike, reach: float | None = None) -> ContactGraph:
    """All contact states near a pose (6,), m and rad, in the linear picture, [DakinPopplestone1993] sections 2 and 3.

    Raises:
        InfeasibleError: the contacts violate each other there.
    """
    from fmopt.contact.state_graph import Scale, faces, local_space
    from fmopt.contact.state_graph import contact_graph as graph

    contacts = near_contacts(problem, pose, reach)
    at = Pose.from_vector(np.asarray(pose, dtype=np.float64))
    moving, fixed = problem.moving.polyhedron, problem.fixed.polyhedron
    space = local_space(contacts, moving, fixed, at, Scale(clearance(problem).per_side, _rho(problem)))
    return graph(space, faces(space))


def motion(problem: Problem, progress: Progress = lambda _: None) -> CertifiedMotion:
    """The search for a sequence of contact states and the placement of its goal poses; takes seconds to minutes.

    Raises:
        InterferenceError: the parts overlap when assembled, or their clearance is not positive.
        SearchError: no motion was found, which proves nothing.
    """
    from fmopt.planning.pipeline import certified_motion
    from fmopt.planning.posed import Stages

    return certified_motion(problem, Stages(progress))


def plan(problem: Problem, found: CertifiedMotion, progress: Progress = lambda _: None) -> Plan:
    """The plan of a motion: contact states on the way, control strategies, position/force trajectory, and the check.

    Raises:
        InfeasibleError: no bias force holds the contacts.
    """
    from fmopt.planning.pipeline import planned
    from fmopt.planning.posed import Stages

    document, _ = planned(problem, found, Stages(progress))
    return Plan(document)


def _rho(problem: Problem) -> float:
    return characteristic_length(problem, clearance(problem))


def placed(problem: Problem, motion: CertifiedMotion, progress: Progress = lambda _: None) -> CertifiedMotion:
    """The contact states that a motion goes through, placed anew, without a search: wherever its poses are now.

    It takes a second or two where a search takes many, and serves for poses that were moved by hand, and for a problem
    with the same parts and other errors. Where the motion cannot be followed under all errors these are grown as its
    poses come to bear them.

    Raises:
        InfeasibleError: the errors cannot be followed from there.
    """
    from fmopt.planning.posed import Posed, placed_anew

    posed = Posed.of(problem)
    return posed.certified(motion.found, placed_anew(posed, motion.placed.moves, progress))
