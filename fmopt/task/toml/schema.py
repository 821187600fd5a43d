"""The published JSON Schemas of problem, model and assembly files, for editors and other readers."""

from __future__ import annotations

import json
from typing import Any

from fmopt.task.toml.assembly_file import AssemblyFile
from fmopt.task.toml.model_file import ModelFile
from fmopt.task.toml.problem_file import ProblemFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def problem_schema() -> dict[str, Any]:
    """JSON Schema of a problem file."""
    return {"$schema": DIALECT, **ProblemFile.model_json_schema()}


def model_schema() -> dict[str, Any]:
    """JSON Schema of a model file."""
    return {"$schema": DIALECT, **ModelFile.model_json_schema()}


def assembly_schema() -> dict[str, Any]:
    """JSON Schema of an assembly file."""
    return {"$schema": DIALECT, **AssemblyFile.model_json_schema()}


def text(schema: dict[str, Any]) -> str:
    """A schema as its file holds it."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
