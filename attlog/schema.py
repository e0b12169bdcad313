"""The JSON schema of the result, made from the dataclasses of ``result.py``: they cannot drift apart."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from attlog.result import MEASURED_TIMES, SCHEMA, Result


def schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a result document.

    Non-finite numbers are null, measured times may be absent (``--deterministic``),
    and the figures' traces are not part of the document.
    """
    document = TypeAdapter(Result).json_schema(mode="serialization", ref_template="#/$defs/{model}")
    document["properties"].pop("traces")
    for part in (document, *document.get("$defs", {}).values()):
        if part.get("type") != "object" or "properties" not in part:
            continue
        part["required"] = [name for name in part["properties"] if name not in MEASURED_TIMES]
        part["additionalProperties"] = False
    document.get("$defs", {}).pop("Trace", None)
    document["properties"]["schema"] = {"const": SCHEMA}
    document["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    document["title"] = "attlog result"
    return document
