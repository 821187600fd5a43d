"""Drake's point contact as the rig's engine, a second opinion: a context for each body, stepped one after the other.

Contacts are springs with a linear damping, solved as a convex program (SAP). The library finds one contact for each
pair of convex bodies, the deepest, so that a part on flush faces would rock about a contact that jumps from end to end;
the moving part's pieces are joined by their corners, which hold the ends of the patch.

Corners of convex pieces as convex pieces of their own, for engines that find one contact a pair of pieces.

A piece shrunk about one of its vertices lies in the piece, and so does the hull of two such copies: beside the piece
they leave the solid as it is.
"""

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from fmopt.errors import FmoptError, ResourceError, SettingsError
from fmopt.execution.engines.engine import FIELDS, THROWN, Maker, Put, Setup
from fmopt.execution.engines.physics import Physics
from fmopt.execution.rotation import from_quaternions
from fmopt.spatial.values import Array, Indices

_STIFF = 4e7  # N/m of each part at a contact, at least
_BENT = 1000.0  # N that would bend it by the clearance
_STEPS = 0.5  # of MuJoCo's time step: the kick of a contact that jumps between the ends of flush faces grows with it
_SHIFTS = (0.0, 1e-9, -2e-9, 4e-9)  # m, by which a part is moved for its contacts to be looked for again

_DAMPED = 0.9  # of the momentum of the part that damping takes in a time step, at most

_SIZE = 0.001  # m across a corner
_LARGEST = 0.5  # of the piece
_LENGTHWISE = 0.9  # |z| of the unit direction from which an edge runs along the insertion
_ON = 1e-9  # m from a plane up to which a vertex lies on it


class DrakeEngine:
    """n bodies in a scene, begun at positions (n, 3) and quaternions (n, 4); see `Engine`."""

    def __init__(self, diagram: Any, starts: tuple[Array, Array]) -> None:
        n = len(starts[0])
        self.qpos, self.qvel, self.depth = np.hstack(starts), np.zeros((n, 6)), np.zeros(n)
        self._damping = np.zeros((n, 3))
        self._diagram, self._plant = diagram, diagram.GetSubsystemByName("plant")
        self._part = self._plant.GetBodyByName("part")
        self._mass = float(self._part.default_mass())
        self._found = self._plant.get_contact_results_output_port()
        self._pressed = self._plant.get_generalized_contact_forces_output_port(self._part.model_instance())
        self._roots = [diagram.CreateDefaultContext() for _ in range(n)]
        self._contexts = [self._plant.GetMyMutableContextFromRoot(root) for root in self._roots]
        port = self._plant.get_applied_generalized_force_input_port()
        self._applied = [port.FixValue(context, np.zeros(6)).GetMutableData() for context in self._contexts]
        self._reaction, self._over_period = np.zeros((2, n, 6))
        (self._last, self.deepest), self.deepest_at = np.zeros((2, n)), self.qpos.copy()
        self._results: list[Any] = [None] * n

    @property
    def reaction(self) -> Array:
        """As `Engine`."""
        return self._reaction.copy()

    @property
    def reaction_over_period(self) -> Array:
        """As `Engine`."""
        return self._over_period.copy()

    @property
    def contacts(self) -> Array:
        """As `Engine`; forces on the part, axes of B."""
        found = [[] if results is None else _contacts(results) for results in self._results]
        rows = np.zeros((len(found), max(map(len, found)), FIELDS))
        for row, every in zip(rows, found, strict=True):
            for k, one in enumerate(every):
                # The library states the force on the second body of the pair, which may be either.
                force = one.contact_force() if one.bodyB_index() == self._part.index() else -one.contact_force()
                row[k] = 1.0, *force, -one.point_pair().depth, *one.contact_point()
        return rows

    def damp(self, damping: Array) -> None:
        """As `Engine`, explicitly: no more than the apparent mass lets a time step take."""
        self._damping = np.minimum(damping, _DAMPED * self._mass / self._plant.time_step())

    def advance(self, wrench: Array, period: float, bodies: Indices | None = None) -> None:
        """As `Engine`; the library has rotations first, and turning in axes of the world."""
        R = from_quaternions(self.qpos[:, 3:])
        turning = np.einsum("nij,nj->ni", R, self.qvel[:, 3:])
        # Anew in each period: who owns the arrays may have written to them.
        states = np.hstack([self.qpos[:, 3:], self.qpos[:, :3], turning, self.qvel[:, :3]])
        for k in range(len(states)) if bodies is None else bodies:
            context = self._contexts[k]
            self._plant.SetPositionsAndVelocities(context, states[k])
            steps, self._over_period[k] = max(round(period / self._plant.time_step()), 1), 0.0
            self.deepest[k] = 0.0
            for _ in range(steps):
                damped = -self._damping[k] * self._plant.GetVelocities(context)[3:]
                applied = np.concatenate([wrench[k, 3:], wrench[k, :3] + damped])
                self._applied[k].get_mutable_value().SetFromVector(applied)
                self._step(k)
                self._over_period[k] += self._reaction[k] / steps
            states[k] = self._plant.GetPositionsAndVelocities(context)
        q, turning = states[:, :4], states[:, 7:10]
        self.qpos[:, :3], self.qpos[:, 3:] = states[:, 4:7], q / np.linalg.norm(q, axis=1, keepdims=True)
        R = from_quaternions(self.qpos[:, 3:])
        self.qvel[:, :3], self.qvel[:, 3:] = states[:, 10:], np.einsum("nji,nj->ni", R, turning)

    def _step(self, k: int) -> None:
        """One time step of body k, with the contacts at its beginning."""
        context = self._contexts[k]
        self._results[k], self._last[k] = self._looked_for(k)
        if self._last[k] > self.deepest[k]:
            self.deepest[k], self.deepest_at[k] = self._last[k], np.roll(self._plant.GetPositions(context), 3)
        self.depth[k] = max(self.depth[k], self.deepest[k])
        self._reaction[k] = np.roll(self._pressed.Eval(context), 3)
        self._roots[k].SetDiscreteState(self._diagram.EvalUniquePeriodicDiscreteUpdate(self._roots[k]))

    def _looked_for(self, k: int) -> tuple[Any, float]:
        """Contacts of body k and the greatest penetration, m, from 1 nm beside where a contact cannot be.

        Where convex bodies barely touch, the library's collision may give up, or take a wrong face for the nearest.

        Raises:
            FmoptError: it gives up beside as well.
        """
        context, reason = self._contexts[k], ""
        here = self._plant.GetPositions(context)
        results, deepest = None, np.inf
        for shift in _SHIFTS:
            if shift:
                self._plant.SetPositions(context, here + shift * np.repeat([0.0, 1.0], [4, 3]))
            try:
                results = self._found.Eval(context)
            except RuntimeError as error:
                reason = str(error)
                continue
            deepest = max((float(one.point_pair().depth) for one in _contacts(results)), default=0.0)
            # What is as deep at every one of the places is taken for true.
            if deepest <= self._last[k] + THROWN:
                break
        if results is None:
            message = f"the engine finds no contacts at {here.tolist()}: {reason}"
            raise FmoptError(message, "choose another seed or engine")
        return results, deepest


def _contacts(results: Any) -> list[Any]:
    return [results.point_pair_contact_info(k) for k in range(results.num_point_pair_contacts())]


def _library() -> Any:
    """The engine's library.

    Raises:
        ResourceError: the extra is missing.
    """
    try:
        import pydrake.multibody.plant
    except ImportError as error:
        raise ResourceError("execution in Drake needs the extra drake", "install fmopt[drake]") from error
    return pydrake


def _put(setup: Setup) -> Put:
    """The scene, with contacts as stiff as the clearance asks for, relaxing over the time constant of MuJoCo's."""
    _library()
    if np.ndim(setup.friction) and np.ptp(setup.friction) > 0.0:
        raise SettingsError("Drake's scene has one coefficient of friction", "give a single value, or use mujoco")
    from pydrake.geometry import AddContactMaterial, ProximityProperties, Sphere
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
    from pydrake.multibody.tree import SpatialInertia, UnitInertia
    from pydrake.systems.framework import DiagramBuilder

    robot = setup.robot
    step = _STEPS * Physics.of_fit(setup.clearance, robot.period).time_step
    step = step if setup.time_step is None else setup.time_step
    physics = Physics.of_fit(setup.clearance, robot.period, step).trusted()
    config = MultibodyPlantConfig(
        time_step=physics.time_step,
        contact_model="point",
        discrete_contact_approximation="sap",
        use_sampled_output_ports=False,  # or contacts would be those of the last time step, not of poses that are set
    )
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))  # the robot bears the weight
    inertia = UnitInertia.TriaxiallySymmetric(robot.inertia / robot.mass)
    part = plant.AddRigidBody("part", SpatialInertia(robot.mass, np.zeros(3), inertia))
    # Two parts in contact are half as stiff as one, and relax over both their times together.
    material, friction = ProximityProperties(), CoulombFriction(*(2 * [float(np.max(setup.friction))]))
    AddContactMaterial(material, point_stiffness=max(_STIFF, _BENT / setup.clearance), friction=friction)
    material.AddProperty("material", "relaxation_time", physics.contact[0])
    _register(plant, plant.world_body(), "fixed", setup.bodies.fixed, material)
    corners = [corner for piece in setup.bodies.moving for corner in with_corners(piece)]
    _register(plant, part, "moving", corners, material)
    for i, (centre, radius) in enumerate(setup.bodies.balls):
        at, name = RigidTransform(centre), f"ball{i}"
        plant.RegisterCollisionGeometry(part, at, Sphere(radius), name, material)
    plant.Finalize()
    return partial(DrakeEngine, builder.Build())


def _register(plant: Any, body: Any, side: str, hulls: Sequence[Array], material: Any) -> None:
    from pydrake.geometry import Convex
    from pydrake.math import RigidTransform

    for i, points in enumerate(hulls):
        name = f"{side}{i}"
        plant.RegisterCollisionGeometry(body, RigidTransform(), Convex(points.T.copy(), name), name, material)


DRAKE = Maker(_library, _put)


def with_corners(vertices: Array) -> list[Array]:
    """The vertices (v, 3), m, of a piece, of its corners, and of strips along its edges in the direction of z.

    A part that goes in along z lies flush on a wall from its leading corners to the mouth, which its lengthwise edges
    cross: those are the ends of the patch of contact.
    """
    hull = ConvexHull(vertices)
    corners = {int(k): _corner(vertices, int(k)) for k in hull.vertices}
    return [vertices, *corners.values(), *(np.vstack([corners[i], corners[j]]) for i, j in _lengthwise(hull))]


def _corner(vertices: Array, k: int) -> Array:
    """The piece shrunk about its vertex k to the size of a corner."""
    arms = vertices - vertices[k]
    return np.asarray(vertices[k] + min(_LARGEST, _SIZE / float(np.linalg.norm(arms, axis=1).max())) * arms)


def _lengthwise(hull: Any) -> list[tuple[int, int]]:
    """Pairs of vertices that an edge along z joins: those on two planes of faces at once."""
    points, planes = hull.points, hull.equations
    on = np.abs(points @ planes[:, :3].T + planes[:, 3]) <= _ON
    pairs = []
    for i, j in combinations(sorted(int(k) for k in hull.vertices), 2):
        along = points[j] - points[i]
        shared = planes[on[i] & on[j], :3]
        # By rank, not by number: the hull is in triangles, and has the plane of a face several times.
        if abs(along[2]) >= _LENGTHWISE * np.linalg.norm(along) and np.linalg.matrix_rank(shared, tol=1e-6) > 1:
            pairs.append((i, j))
    return pairs
