"""The engines that there are to choose from, by name."""

from fmopt.execution.engines.drake_engine import DRAKE
from fmopt.execution.engines.engine import Maker
from fmopt.execution.engines.mujoco_engine import MUJOCO

ENGINES: dict[str, Maker] = {"mujoco": MUJOCO, "drake": DRAKE}
