"""What became of one log, kept beside its files: one JSON file per log in the folder's ``.attlog/records``."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from attlog.base.files.output import write_atomic

INSIDE = ".attlog"
"""The folder inside a batch folder that belongs to attlog: records, plan, lock, work in progress."""
SCHEMA = "attlog-record/1"
FOR_GOOD = frozenset((0, 2, 65))
"""Exit codes that the same key ends with again; what ended with another may go well next time."""


@dataclass(frozen=True, slots=True)
class Record:
    """One log of a batch.

    ``log``: as it was named (path, URL, member of an archive); ``name``: of its report, ``NAME.html``;
    ``key``: content (SHA-256), settings and version, empty where the content could not be read; ``code`` and
    ``message`` as ``attlog analyze`` ends and says; ``row``: what the index shows of the log; ``files``: size in
    bytes and SHA-256 of each file written; ``stamp``: what tells without its bytes whether a URL or a member is the
    same. ``wall_s``, ``cpu_s`` and ``peak_mb`` (resident memory) are measured and differ from run to run, all else
    does not. ``trace`` belongs to a bug. ``again``: taken from an earlier run.
    ``known``: the log failed like this in an earlier run of the folder already.
    """

    log: str
    name: str
    key: str = ""
    code: int = 0
    message: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    peak_mb: float = 0.0
    row: dict[str, Any] = field(default_factory=dict)
    files: dict[str, tuple[int, str]] = field(default_factory=dict)
    stamp: str = ""
    trace: str = ""
    folder_full: bool = False
    """The output folder takes no more: nothing else can be written there either."""
    again: bool = field(default=False, compare=False)
    known: bool = field(default=False, compare=False)

    @property
    def done(self) -> bool:
        """Whether the log has a report."""
        return self.code == 0

    @property
    def for_good(self) -> bool:
        """Whether the same log ends like this again."""
        return self.code in FOR_GOOD

    def fails_as(self, before: Record | None) -> bool:
        """Whether an earlier record tells the same failure: of the same content, settings and version."""
        return (
            before is not None
            and not self.done
            and bool(self.key)
            and (self.key, self.code) == (before.key, before.code)
        )


MEASURED = ("wall_s", "cpu_s", "peak_mb")
NOT_KEPT = ("again", "known", "folder_full")


def record_path(folder: Path, name: str) -> Path:
    """Where the record of the report of that name stands."""
    return folder / INSIDE / "records" / f"{name}.json"


def write_record(folder: Path, record: Record) -> None:
    """Keep a record (atomically). OutputError if that cannot be done."""
    document = {"schema": SCHEMA} | {k: v for k, v in asdict(record).items() if k not in NOT_KEPT}
    write_atomic(record_path(folder, record.name), json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n")


def read_record(folder: Path, name: str) -> Record | None:
    """The record of the report of that name; None where there is none, or none that this version wrote."""
    return _read(record_path(folder, name))


def records(folder: Path) -> Iterator[Record]:
    """All records of a batch folder, by report name."""
    for path in sorted((folder / INSIDE / "records").glob("*.json")):
        record = _read(path)
        if record is not None:
            yield record


def intact(folder: Path, record: Record) -> bool:
    """Whether every file that the record names is there, byte for byte."""
    return all(written(folder / name) == kept for name, kept in record.files.items())


def written(path: Path) -> tuple[int, str] | None:
    """Size in bytes and SHA-256 of a file; None where it cannot be read."""
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return file.tell(), digest
    except OSError:
        return None


def _read(path: Path) -> Record | None:
    try:
        document = json.loads(path.read_bytes())
        if document.pop("schema") != SCHEMA:
            return None
        document["files"] = {name: (size, digest) for name, (size, digest) in document["files"].items()}
        known = {f.name for f in fields(Record)}
        return Record(**{k: v for k, v in document.items() if k in known})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None  # a record that cannot be read is a log that was not done: it is analysed again
