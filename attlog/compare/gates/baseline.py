"""An earlier run to compare with: one result, a file with one result a line, or the folder of a batch.

Only heads are read to know which log a result is of; a document is read when it is asked for, so that a folder of ten
thousand costs no memory.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog.base.errors import UsageError
from attlog.result import Result
from attlog.result.document import SCHEMA_NAME

HEAD = 64 * 1024
"""Bytes in which a result tells its log, unless its configuration is longer."""
OF_LOG = re.compile(rb'"log":\s*\{\s*"name":\s*("(?:[^"\\]|\\.)*"),\s*"sha256":\s*"([0-9a-f]{64})"')


@dataclass(frozen=True, slots=True)
class DocumentPlace:
    """Where a document stands: a whole file, or the line of one that begins at a byte."""

    path: Path
    start: int = 0
    length: int = -1


@dataclass(frozen=True, slots=True)
class BaselineResult:
    """The result that belongs to a log. ``same_log``: of the same bytes, so that evidence can be paired."""

    result: Result
    same_log: bool


@dataclass(slots=True)
class Baseline:
    """Results by the SHA-256 and by the name of their log; ``only``: there is just one, which is compared with all."""

    name: str
    by_sha256: dict[str, DocumentPlace] = field(default_factory=dict)
    by_name: dict[str, DocumentPlace] = field(default_factory=dict)
    only: DocumentPlace | None = None
    last: tuple[DocumentPlace, Result] | None = None

    def of(self, log: Mapping[str, Any]) -> BaselineResult | str:
        """The result of the same log, else that of a log of the same name, else the only one; or why there is none."""
        same = self.by_sha256.get(str(log.get("sha256")))
        place = same or self.by_name.get(str(log.get("name"))) or self.only
        if place is None:
            return f"the baseline {self.name} has no result of this log"
        try:
            if self.last is None or self.last[0] != place:
                self.last = place, _result(place)
        except (OSError, UsageError) as error:
            return f"the baseline {self.name} cannot be read: {error}"
        return BaselineResult(self.last[1], same is not None)


def read(path: Path) -> Baseline:
    """What a file or folder holds. UsageError where it cannot be read or holds no result."""
    try:
        places = [DocumentPlace(p) for p in sorted(path.rglob("*.json"))] if os.path.isdir(path) else _lines(path)
        found = Baseline(path.name)
        count = 0
        for place in places:
            about = _log(place)
            if about is None:
                continue
            count += 1
            found.by_name.setdefault(about[0], place)
            if about[1] is not None:
                found.by_sha256.setdefault(about[1], place)
            found.only = place if count == 1 else None
    except OSError as error:
        raise UsageError(f"baseline {path}: cannot be read ({error.strerror or error})") from error
    if not count:
        what = "a folder without a result of attlog (*.json)" if os.path.isdir(path) else "no result of attlog"
        raise UsageError(f"baseline {path}: is {what}")
    if os.path.isdir(path):
        found.only = None
    return found


def read_all(paths: Iterable[Path | None]) -> dict[Path, Baseline]:
    """Every baseline that gates look into, each read once. UsageError tells all that cannot be used."""
    found, wrong = {}, []
    for path in dict.fromkeys(p for p in paths if p is not None):
        try:
            found[path] = read(path)
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return found


def _lines(path: Path) -> list[DocumentPlace]:
    """The documents of a file: itself, or its lines where it has one a line."""
    starts: list[DocumentPlace] = []
    at = 0
    with open(path, "rb") as file:
        for line in file:
            if not starts and not _is_document(line):
                return [DocumentPlace(path)]
            starts.append(DocumentPlace(path, at, len(line)))
            at += len(line)
    return [place for place in starts if place.length > 1]


def _is_document(line: bytes) -> bool:
    return line.startswith(b"{") and line.rstrip().endswith(b"}")


def _log(place: DocumentPlace) -> tuple[str, str | None] | None:
    """Name and SHA-256 of the log that a document is of; None for what is no result."""
    with open(place.path, "rb") as file:
        file.seek(place.start)
        head = file.read(HEAD if place.length < 0 else min(HEAD, place.length))
    if SCHEMA_NAME.encode() not in head[:200]:
        return None
    found = OF_LOG.search(head)
    if found is not None:
        return str(json.loads(found[1])), found[2].decode()
    try:
        log = _result(place).log
    except UsageError:
        return None
    return str(log.get("name")), log.get("sha256")


def _result(place: DocumentPlace) -> Result:
    """The result at a place. UsageError for what is none that this version reads."""
    with open(place.path, "rb") as file:
        file.seek(place.start)
        return Result.read(file.read(place.length), place.path.name)
