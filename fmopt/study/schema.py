"""The published JSON Schemas of study and allocation files, for editors and other readers."""

from __future__ import annotations

from typing import Any

from fmopt.study.study_file import AllocationFile, StudyFile
from fmopt.task.schema import DIALECT


def study_schema() -> dict[str, Any]:
    """JSON Schema of a study file with axes."""
    return {"$schema": DIALECT, **StudyFile.model_json_schema()}


def allocation_schema() -> dict[str, Any]:
    """JSON Schema of a study file with tolerances."""
    return {"$schema": DIALECT, **AllocationFile.model_json_schema()}
