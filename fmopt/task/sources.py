"""Sources of uncertainty and the start box they make, after [BasanezSuarez] eqs. (1)-(11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmopt.values import Array


@dataclass(frozen=True)
class Deviation:
    """Greatest deviation of a position (m) and of an orientation about any axis (rad)."""

    position: float = 0.0
    angle: float = 0.0


@dataclass(frozen=True)
class Sources:
    """Greatest deviations of everything that makes the parts' relative pose uncertain, lengths in m.

    Args:
        shape: ε_v, of any point of either part from its model.
        measurement: ε_m, of the fixed part as a sensor sees it, in place of its shape and configuration; or None.
        configuration: ε_pp and ε_φp of the fixed part as it was put down.
        feeder: ε_pp and ε_φp of the moving part before it was grasped.
        robot: ε_pr and ε_φr of the end effector; it counts when grasping and again when inserting.
        slide: ε_td and ε_φd of the moving part in the gripper.
        grasp_height: distance of the grasping point from the centre of the leading face.
    """

    shape: float
    measurement: float | None
    configuration: Deviation
    feeder: Deviation
    robot: Deviation
    slide: Deviation
    grasp_height: float


def start_box(sources: Sources, height: float, aside: float = 0.0, lean: float = 0.0) -> Array:
    """Half-widths (6,) in m and rad of a box that holds every start error the sources can make together.

    Position, eq. (10): ε_a + ε_pr + ε_pg + ε_v with ε_pg = ε_pr + ε_pp + ε_td, and ε_a = ε_v + ε_pp of the fixed part,
    or ε_m. Orientation, eq. (11): ε_φ = ε_φr + ε_φg with ε_φg = ε_φr + ε_φd, to which come both ε_φp. Angles of
    rotations about different axes add at most. Rotation about the grasping point, h above the leading face, moves that
    face's centre by up to h sin ε_φ across the part's axis and h (1 − cos ε_φ) along it; rotation of the fixed part
    moves it, seen from there, by its distance from the mouth, and turns the other displacements.

    A deviation of shape is taken as a displacement: the box covers where the parts first meet. Two deviating walls do
    not share one displacement later on.

    Args:
        sources: the deviations.
        height: of the leading face's centre above the mouth at the start, at most, m.
        aside: its distance from the axis of the hole then, at most, m.
        lean: angle between the two axes then, at most, rad.
    """
    robot, slide = sources.robot, sources.slide
    fixed, fixed_angle = sources.shape + sources.configuration.position, sources.configuration.angle
    if sources.measurement is not None:
        fixed, fixed_angle = sources.measurement, 0.0
    in_gripper = robot.position + sources.feeder.position + slide.position
    position = fixed + robot.position + in_gripper + sources.shape
    grasped = min(2.0 * robot.angle + slide.angle + sources.feeder.angle, 0.5 * np.pi)
    h, turned, shortened = sources.grasp_height, np.sin(fixed_angle), 1.0 - np.cos(fixed_angle)
    across, along = h * np.sin(grasped), h * (1.0 - np.cos(grasped))
    sideways, down = across + along * np.sin(lean), along + across * np.sin(lean)
    x = position + sideways + down * turned + (height + aside) * turned + aside * shortened
    z = position + down + sideways * turned + aside * turned + height * shortened
    angle = grasped + fixed_angle
    return np.array([x, x, z, angle, angle, angle])
