"""The JSON schema of the result, made from the dataclasses of ``result.py``: they cannot drift apart."""

from __future__ import annotations

from typing import Any, get_type_hints

from pydantic import create_model

from attlog.result import MEASURED_TIMES, SCHEMA, Result


def schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a result document.

    Non-finite numbers are null, measured times may be absent (``--deterministic``),
    and the figures' traces are not part of the document.
    """
    fields = {name: (hint, ...) for name, hint in get_type_hints(Result).items() if name not in ("traces", "schema")}
    model = create_model("Result", **fields)  # type: ignore[call-overload]
    document: dict[str, Any] = model.model_json_schema(mode="serialization")
    document["properties"] = {"schema": {"const": SCHEMA}} | document["properties"]
    for part in (document, *document.get("$defs", {}).values()):
        if "properties" in part:
            part["required"] = [name for name in part["properties"] if name not in MEASURED_TIMES]
            part["additionalProperties"] = False
    document["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    document["title"] = "attlog result"
    return document
