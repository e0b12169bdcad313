"""The JSON schema of the result, made from the dataclasses of ``result.py``: they cannot drift apart."""

from __future__ import annotations

import json
from typing import Any, get_type_hints

from pydantic import ConfigDict, create_model
from pydantic.json_schema import GenerateJsonSchema

from attlog.result import KEPT_OUT, MEASURED_TIMES, SCHEMA, Result

_TYPES = ConfigDict(arbitrary_types_allowed=True)


class _Generator(GenerateJsonSchema):
    """Arrays as lists of numbers; accepts functions, which only fields hold that stay out of the document."""

    def is_instance_schema(self, schema: Any) -> dict[str, Any]:
        return {"type": "array", "items": {"type": "number"}}

    def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> dict[str, Any]:
        return {}


def schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a result document.

    Non-finite numbers are null, measured times may be absent (``--deterministic``),
    and the figures' traces are not part of the document.
    """
    fields = {name: (hint, ...) for name, hint in get_type_hints(Result).items() if name not in ("traces", "schema")}
    model = create_model("Result", __config__=_TYPES, **fields)  # type: ignore[call-overload]
    document: dict[str, Any] = model.model_json_schema(mode="serialization", schema_generator=_Generator)
    _drop_hidden(document)
    document["properties"] = {"schema": {"const": SCHEMA}} | document["properties"]
    for part in (document, *document.get("$defs", {}).values()):
        if "properties" in part:
            part["required"] = [name for name in part["properties"] if name not in MEASURED_TIMES]
            part["additionalProperties"] = False
    document["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    document["title"] = "attlog result"
    return document


def _drop_hidden(document: dict[str, Any]) -> None:
    """Take out the fields that are not in the JSON, and the definitions that only they use."""
    parts = document["$defs"]
    for kind, names in KEPT_OUT.items():
        for name in names:
            del parts[kind]["properties"][name]
    while unused := [name for name in parts if f'"#/$defs/{name}"' not in json.dumps(document)]:
        for name in unused:
            del parts[name]
