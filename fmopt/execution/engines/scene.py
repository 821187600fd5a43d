"""The scene: the parts' convex pieces as they are, the fixed part in the world, the moving part as the robot's tool.

Pieces become convex meshes, which the engine collides by their exact hulls; round surfaces are n-gons. The
moving part is one free body about its reference point, with the apparent mass of the robot; its weight is compensated.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.errors import ResourceError
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.physics import Physics
from fmopt.plan.press import ALONE, ConvexSolid, Surroundings
from fmopt.spatial.values import Array

CONTACTS = 16  # contacts that a sensor reports

_COLOUR = "0.85 0.45 0.1 1"  # of the moving part


def scene(
    bodies: Bodies, physics: Physics, mass: float, inertia: float, friction: float, cell: Surroundings = ALONE
) -> str:
    """The scene as MJCF; of robot and part the apparent mass, kg, and the inertia about each axis of the frame, kg·m².

    Solids of a cell collide as the parts do; their geoms are called by side, name and number of the piece.

    Raises:
        SettingsError: the settings cannot be trusted.
    """
    physics.trusted()
    found = {"fixed": _named("fixed", bodies.fixed, cell.fixed), "moving": _named("moving", bodies.moving, cell.moving)}
    meshes = [
        f'    <mesh name="{name}" inertia="exact" vertex="{numbers(vertices.ravel().tolist())}"/>'
        for side in found.values()
        for name, vertices in side.items()
    ]
    spheres = (  # which the engine collides as they are
        f'\n      <geom name="ball{i}" type="sphere" size="{radius!r}" pos="{numbers(at.tolist())}" rgba="{_COLOUR}"/>'
        for i, (at, radius) in enumerate(bodies.balls)
    )
    template = Path(__file__).with_name("scene.xml").read_text("utf-8")
    return template.format(
        step=physics.time_step,
        cone=physics.cone,
        impratio=physics.impratio,
        margin=physics.margin,
        solref=numbers(physics.contact),
        solimp=numbers(physics.solimp),
        friction=friction,
        meshes="\n".join(meshes),
        fixed=_geoms(found["fixed"], "0.6 0.65 0.7 0.35"),  # see-through, for what goes on in the hole
        moving=_geoms(found["moving"], _COLOUR) + "".join(spheres),
        mass=mass,
        inertia=inertia,
        contacts=CONTACTS,
    )


def engine() -> Any:
    """The engine's library.

    Raises:
        ResourceError: the extra is missing.
    """
    # What the library would choose by itself needs a display.
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")  # read once, as the library is imported
    try:
        import mujoco
    except ImportError as error:
        raise ResourceError("execution needs MuJoCo, which is not installed", "install mujoco") from error
    return mujoco


def compiled(text: str) -> Any:
    """The engine's model of a scene.

    Raises:
        ResourceError: the extra is missing.
    """
    return engine().MjModel.from_xml_string(text)


def _named(side: str, pieces: Sequence[Array], solids: Sequence[ConvexSolid]) -> dict[str, Array]:
    """Corners of the pieces of a part, and of the solids beside it, by the names of their geoms."""
    own = {f"{side}{i}": vertices for i, vertices in enumerate(pieces)}
    beside = {f"{side}_{one.name}_{i}": np.array(piece) for one in solids for i, piece in enumerate(one.pieces)}
    return {**own, **beside}


def _geoms(names: Iterable[str], colour: str) -> str:
    return "\n".join(f'      <geom name="{name}" mesh="{name}" rgba="{colour}"/>' for name in names)


def numbers(values: Sequence[float]) -> str:
    """Numbers (n,) that read back exactly: vertices are rounded by the engine's single precision alone."""
    return " ".join(repr(value) for value in values)
