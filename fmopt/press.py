"""Presses for simulators and robots of one's own: the controller that carries a plan of presses out, without ours."""

from fmopt.execution.press_controller import Command as Command
from fmopt.execution.press_controller import Controller as Controller
from fmopt.execution.press_controller import Errors as Errors
from fmopt.execution.press_trials import count_presses as count_presses
from fmopt.execution.press_trials import drawn_errors as drawn_errors
