"""STEP files of shapes of the CAD kernel."""

from pathlib import Path
from typing import Any


def write_step(path: Path, shape: Any) -> None:
    """A STEP file, the kernel silenced."""
    from OCP.Message import Message
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
