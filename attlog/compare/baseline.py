"""Baseline of a comparison: a result, a file of results, a batch folder.

Only heads of documents are read to find the log of a result, and a document when it is requested. A folder of ten
thousand results costs no memory.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog.core.errors import UsageError
from attlog.result import Result
from attlog.result.document import SCHEMA_NAME

# Bytes at the start of a document that hold its schema, and its log's name unless the configuration is longer.
SCHEMA_BYTES, RESULT_HEAD_BYTES = 200, 64 * 1024
LOG_PATTERN = re.compile(rb'"log":\s*\{\s*"name":\s*("(?:[^"\\]|\\.)*"),\s*"sha256":\s*"([0-9a-f]{64})"')


@dataclass(frozen=True, slots=True)
class DocumentPlace:
    """JSON document: a whole file, or a line of it from byte ``start`` on."""

    path: Path
    start: int = 0
    length: int = -1

    def head(self) -> bytes:
        """Return the first bytes of the document."""
        return self._read(RESULT_HEAD_BYTES if self.length < 0 else min(RESULT_HEAD_BYTES, self.length))

    def result(self) -> Result:
        """Return the result. UsageError for a document that this version does not read."""
        return Result.read(self._read(self.length), self.path.name)

    def _read(self, length: int) -> bytes:
        with open(self.path, "rb") as file:
            file.seek(self.start)
            return file.read(length)


@dataclass(frozen=True, slots=True)
class BaselineResult:
    """Earlier result of a log. ``same_log``: same bytes, so that evidence can be paired."""

    result: Result
    same_log: bool


@dataclass(slots=True)
class Baseline:
    """Results by SHA-256 and by name of their log.

    ``only``: the single result, compared with every log.
    """

    name: str
    by_sha256: dict[str, DocumentPlace] = field(default_factory=dict)
    by_name: dict[str, DocumentPlace] = field(default_factory=dict)
    only: DocumentPlace | None = None
    last: tuple[DocumentPlace, Result] | None = None

    def of(self, log: Mapping[str, Any]) -> BaselineResult | str:
        """Find a log's result by SHA-256, name or as the only one, else the reason."""
        same = self.by_sha256.get(str(log.get("sha256")))
        place = same or self.by_name.get(str(log.get("name"))) or self.only
        if place is None:
            return f"the baseline {self.name} has no result of this log"
        try:
            if self.last is None or self.last[0] != place:
                self.last = place, place.result()
        except (OSError, UsageError) as error:
            return f"the baseline {self.name} cannot be read: {error}"
        return BaselineResult(self.last[1], same is not None)


def read_baseline(path: Path) -> Baseline:
    """Read the results of a file or folder. UsageError where it has none."""
    is_folder = os.path.isdir(path)
    found, count = Baseline(path.name), 0
    try:
        for place in map(DocumentPlace, sorted(path.rglob("*.json"))) if is_folder else _places_in_file(path):
            about = _log_of_place(place)
            if about is None:
                continue
            count += 1
            found.by_name.setdefault(about[0], place)
            if about[1] is not None:
                found.by_sha256.setdefault(about[1], place)
            found.only = place if count == 1 and not is_folder else None
    except OSError as error:
        raise UsageError(f"baseline {path}: cannot be read ({error.strerror or error})") from error
    if not count:
        what = "a folder without a result of attlog (*.json)" if is_folder else "no result of attlog"
        raise UsageError(f"baseline {path}: is {what}")
    return found


def read_baselines(paths: Iterable[Path | None]) -> dict[Path, Baseline]:
    """Read every baseline once. UsageError names all unusable ones."""
    found, wrong = {}, []
    for path in dict.fromkeys(p for p in paths if p is not None):
        try:
            found[path] = read_baseline(path)
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return found


def _places_in_file(path: Path) -> list[DocumentPlace]:
    """Locate the documents of a file: one per line, else the whole file."""
    places: list[DocumentPlace] = []
    at = 0
    with open(path, "rb") as file:
        for line in file:
            if not places and not (line.startswith(b"{") and line.rstrip().endswith(b"}")):
                return [DocumentPlace(path)]
            places.append(DocumentPlace(path, at, len(line)))
            at += len(line)
    return [place for place in places if place.length > 1]


def _log_of_place(place: DocumentPlace) -> tuple[str, str | None] | None:
    """Return name and SHA-256 of a result's log, None for other documents."""
    head = place.head()
    if SCHEMA_NAME.encode() not in head[:SCHEMA_BYTES]:
        return None
    found = LOG_PATTERN.search(head)
    if found is not None:
        return str(json.loads(found[1])), found[2].decode()
    try:
        log = place.result().log
    except UsageError:
        return None
    return str(log.get("name")), log.get("sha256")
