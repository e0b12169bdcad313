"""The JSON schema of a result document, made from the dataclasses of ``model.py``."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from attlog import metrics
from attlog.core.plain import IN_JSON
from attlog.core.settings import adapter
from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import Answer
from attlog.metrics.statistics import UnitValues
from attlog.result.document import MEASURED_TIMES, SCHEMA
from attlog.result.model import Result


class DocumentSchema(GenerateJsonSchema):
    """JSON schema generator that accepts functions and arrays."""

    def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> dict[str, Any]:
        """Accept anything."""
        return {}

    def is_instance_schema(self, schema: Any) -> dict[str, Any]:
        """Accept anything."""
        return {}


def schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a result document.

    It includes the meaning of each metric. Fields with their default and traces are not in the document. Non-finite
    numbers are null.
    """
    document: dict[str, Any] = adapter(Result).json_schema(schema_generator=DocumentSchema)
    document["$defs"]["Answers"] = {"type": "object", "properties": _metrics(), "additionalProperties": False}
    _drop_hidden(document)
    del document["properties"]["schema"]
    document["properties"] = {"schema": {"const": SCHEMA}} | document["properties"]
    document["required"] = ["schema", *document["required"]]
    _name_answers(document["$defs"])
    for part in (document, *document["$defs"].values()):
        if "properties" in part:
            part["required"] = [name for name in part.get("required", []) if name not in MEASURED_TIMES]
            part["additionalProperties"] = False
    document["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    document["title"] = "attlog result"
    return document


def _metrics() -> dict[str, Any]:
    """Return every metric by its id: an answer and its meaning."""
    return {
        name: {
            "allOf": [{"$ref": "#/$defs/Answer"}],
            "title": metric.title,
            "unit": metric.unit,
            "better": metric.better,
            "description": metric.definition,
        }
        for name, metric in metrics.definitions().items()
    }


def _name_answers(parts: dict[str, Any]) -> None:
    """Set the schema of a row's metrics by window."""
    parts["EstimatorRow"]["properties"]["metrics"] = {
        "type": "object",
        "description": "window -> metric -> answer",
        "additionalProperties": {"$ref": "#/$defs/Answers"},
    }


def _drop_hidden(document: dict[str, Any]) -> None:
    """Remove fields outside the JSON, and definitions that only they use."""
    parts = document["$defs"]
    for kind in (Result, Answer, CommonBias, UnitValues):
        properties = (document if kind is Result else parts[kind.__name__])["properties"]
        for name in [f.name for f in fields(kind) if not f.metadata.get(IN_JSON, True)]:
            del properties[name]
    while unused := [name for name in parts if name != "Answers" and f'"#/$defs/{name}"' not in json.dumps(document)]:
        for name in unused:
            del parts[name]
