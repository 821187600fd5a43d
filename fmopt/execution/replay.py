"""A trial once more, as a moving picture: its seed and number are all that it needs."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fmopt.errors import ResourceError
from fmopt.execution.engines.engine import Bodies
from fmopt.execution.engines.physics import Physics
from fmopt.execution.engines.scene import compiled, engine, scene
from fmopt.execution.robot import Robot
from fmopt.execution.trials import Trials, grown, run
from fmopt.plan import Plan
from fmopt.runtime import output
from fmopt.spatial.values import Array

FRAMES = 20  # a second of the trial
SLOWER = 2.0  # times that the picture takes for it
SIZE = (480, 360)
AWAY = 3.8  # distance of the camera, in sizes of the moving part


def replay(planned: Plan, trials: Trials, number: int, file: Path) -> dict[str, Any]:
    """Runs one trial again, writes it as a GIF, and gives its record, the same as when it ran among others.

    Raises:
        ResourceError: the extra or a way to draw is missing, or the file cannot be written.
        PlanFormatError: the plan cannot be run.
    """
    period = Robot().period if planned.press_plan is None else planned.press_plan.robot.period
    every = round(1.0 / (FRAMES * period))  # periods from one picture to the next
    poses: list[Array] = []
    ticks = 0

    def look(rig: Any) -> None:
        # Counted through all attempts: each has a rig of its own, whose time begins anew.
        nonlocal ticks
        if ticks % every == 0:
            # A copy: the engine writes the next pose over this one.
            poses.append(np.array(rig.engine.qpos[0]))
        ticks += 1

    [record] = run(planned, trials, [number], look=look)
    output.save(_gif(_frames(grown(planned, trials.growth), poses)), file)
    return dict(record)


def _frames(planned: Plan, poses: list[Array]) -> list[Any]:
    """Pictures of poses (7,) of the part, position and quaternion."""
    mujoco, robot = engine(), Robot()
    # Friction and hardness do not matter: poses are shown, no time step is taken.
    model = compiled(scene(Bodies.of(planned), Physics(), robot.mass, robot.inertia, 0.0))
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.azimuth, camera.elevation = 35.0, -20.0
    size = float(np.ptp(np.array(planned.moving.body.vertices)[:, 2]))
    camera.distance, camera.lookat = AWAY * size, np.array([0.0, 0.0, 0.0])
    pictures = []
    try:
        with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
            for pose in poses:
                data.qpos[:] = pose
                mujoco.mj_forward(model, data)
                renderer.update_scene(data, camera)
                pictures.append(renderer.render().copy())
    except (ImportError, AttributeError, RuntimeError, mujoco.FatalError) as error:
        raise ResourceError(f"nothing here can draw: {error}", "install EGL, and set MUJOCO_GL=egl") from error
    return pictures


def _gif(pictures: list[Any]) -> bytes:
    from PIL import Image

    images = [Image.fromarray(picture).quantize(64) for picture in pictures]
    buffer = BytesIO()
    duration = round(1000.0 * SLOWER / FRAMES)  # ms a picture
    images[0].save(buffer, "GIF", save_all=True, append_images=images[1:], duration=duration, loop=0)
    return buffer.getvalue()
