"""A result read back: its schema, the document of an older one in today's words, every value checked by pydantic."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, TypeVar

from pydantic import ValidationError

from attlog.core.errors import UsageError
from attlog.core.settings import adapter, problem_lines
from attlog.result.document import NOT_UTF8, SCHEMA, SCHEMA_NAME, SCHEMA_NUMBER, expanded

T = TypeVar("T")
OLDEST, SHORTENED = 1, 4
"""Schemas from the first number on are read; from the second on a document leaves out what a reader knows."""
WORDS_BEFORE = {
    ("verdict", "good"): "ok",
    ("verdict", "look"): "warning",
    ("verdict", "warn"): "warning",
    ("verdict", "bad"): "fault",
    ("verdict", "cannot_judge"): "unknown",
    ("kind", "run"): "continuous",
    ("code", "bent"): "not_a_pure_delay",
    ("question", "closest"): "accuracy",
    ("question", "quiet"): "noise",
    ("question", "late"): "lag",
    ("question", "drifting"): "yaw_drift",
}
"""(key, value) of older schemas, and what the value is called now."""
FINDING_KEYS = {"code": "kind", "remedy": "action"}
"""Keys of a problem in older schemas, and what they are called in a finding."""
MOST = 3
"""So many things that are wrong are told."""


def read(kind: type[T], content: bytes, name: str) -> T:
    """The result (of the class ``kind``) that a JSON text is. UsageError, which begins with ``name``, for others."""
    document = _document(content, name)
    older = document["schema"] != SCHEMA
    try:
        whole = expanded(document) if _number(document["schema"]) >= SHORTENED else document
        return _checked(kind, _with_findings(_renamed(whole)) if older else whole, older)
    except ValidationError as error:
        wrong = problem_lines(error, kind)
        more = f" (and {len(wrong) - MOST} more)" if len(wrong) > MOST else ""
        raise UsageError(f"{name}: not a result of attlog: {'; '.join(wrong[:MOST])}{more}") from None
    except ValueError as error:
        raise UsageError(f"{name}: not a result of attlog: {error}") from None
    except RecursionError:
        raise UsageError(f"{name}: not a result of attlog: nested too deeply") from None


def _checked(kind: type[T], document: dict[str, Any], older: bool) -> T:
    """The result; what an older version told and this one does not know is left out."""
    try:
        return _validated(kind, document)
    except ValidationError as error:
        unknown = [e["loc"] for e in error.errors() if e["type"] == "unexpected_keyword_argument"]
        if not (older and unknown):
            raise
    for place in unknown:
        _drop(document, place)
    return _validated(kind, document)


def _validated(kind: type[T], document: dict[str, Any]) -> T:
    text = json.dumps(document, ensure_ascii=False)
    if NOT_UTF8.search(text):  # a file name that is no text: pydantic's JSON does not take it, its Python does
        found: T = adapter(kind).validate_python(document, strict=False)
    else:
        found = adapter(kind).validate_json(text)
    return found


def _drop(document: Any, place: Iterable[str | int]) -> None:
    *path, key = place
    for part in path:
        document = document[part]
    del document[key]


def _document(content: bytes, name: str) -> dict[str, Any]:
    """The JSON object of a text, of a schema that this version reads. UsageError else."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(f"{name}: not a result of attlog: no UTF-8 text at byte {error.start}") from None
    try:
        document = json.loads(text, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        cut = " (the file ends there: it was cut off)" if error.pos >= len(text.rstrip()) else ""
        where = f"line {error.lineno}, column {error.colno}"
        raise UsageError(f"{name}: not valid JSON: {error.msg} in {where}{cut}") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{name}: not a result of attlog: {error}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(schema, str) or not schema.startswith(SCHEMA_NAME):
        raise UsageError(f"{name}: not a result of attlog: it has no schema {SCHEMA_NAME}N")
    if not OLDEST <= _number(schema) <= SCHEMA_NUMBER:
        newer = _number(schema) > SCHEMA_NUMBER
        what = "a newer attlog wrote it; update attlog" if newer else "analyse the log again with this version"
        raise UsageError(f"{name}: holds {schema[:40]} and this attlog reads {SCHEMA}: {what}")
    found: dict[str, Any] = document
    return found


def _number(schema: str) -> int:
    """The number of a schema; 0, which none has, where it tells none."""
    number = schema.removeprefix(SCHEMA_NAME)
    return int(number) if number.isdecimal() and len(number) < 9 else 0


def _with_findings(document: dict[str, Any]) -> dict[str, Any]:
    """A document of an older schema with its problems as findings."""
    problems = document.get("problems")
    if not isinstance(problems, list):
        return document
    found = [{FINDING_KEYS.get(k, k): v for k, v in p.items()} for p in problems if isinstance(p, dict)]
    serious = [p | {"severity": "serious"} if p.get("severity") == "error" else p for p in found]
    return {key: value for key, value in document.items() if key != "problems"} | {"findings": serious}


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number of JSON")


def _renamed(value: Any) -> Any:
    """A document of an older schema in today's words."""
    if isinstance(value, dict):
        return {k: WORDS_BEFORE.get((k, v), v) if isinstance(v, str) else _renamed(v) for k, v in value.items()}
    return [_renamed(v) for v in value] if isinstance(value, list) else value
