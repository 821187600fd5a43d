"""The published JSON Schemas of problem, model, assembly and study files, for editors and other readers."""

from __future__ import annotations

import json

from fmopt.task.toml.tables import Table

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_text(table: type[Table]) -> str:
    """The JSON Schema of the files that a table stands for, as its own file holds it."""
    schema = {"$schema": DIALECT, **table.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
