"""What became of one log, kept beside its files: one JSON file per log in the folder's ``.attlog/records``."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.batch.remote import is_url
from attlog.batch.sources import Source
from attlog.core.errors import AttlogError
from attlog.core.files import write_atomic
from attlog.formats.file_bytes import first_bytes
from attlog.formats.ulog.encrypted import ENCRYPTED_HEADER, has_key, is_encrypted
from attlog.pipeline.config import Config

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


# What is to be done with one log: everything that the process which does it has to know.


@dataclass(frozen=True, slots=True)
class Work:
    """One log and how it is treated; plain and picklable, so that any scheduler can carry it.

    ``name``: of its report, unique in ``folder``. ``settings``: from :func:`settings_key`. ``command`` stands in the
    result. ``timeout`` (s) and ``memory`` (MB, resident) end the log's process; None: no limit. ``resume``: a record
    of the same key whose files are there counts as done. ``keep``: keep a record. ``figures``: how the paths of figures
    begin that are written too.
    """

    source: Source
    name: str
    folder: Path
    config: Config
    settings: str
    command: str = ""
    deterministic: bool = False
    timeout: float | None = None
    memory: float | None = None
    resume: bool = False
    keep: bool = True
    figures: Path | None = None


def settings_key(config: Config, deterministic: bool = False) -> str:
    """A hash of all that decides what is written of a log beside its content and attlog's version.

    That is the resolved configuration and what stands in the files it names: filters, estimates, parameters, truth.
    """
    contents = {
        name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in files_of(config) if os.path.isfile(name)
    }
    folder = config.truth_place
    if os.path.isdir(folder):  # a truth for each log: which are there, and when they were written
        found = sorted((e.name, e.stat().st_size, e.stat().st_mtime_ns) for e in os.scandir(folder))
        contents[folder] = hashlib.sha256(repr(found).encode()).hexdigest()
    told = {"config": config.resolved(), "files": contents, "deterministic": deterministic}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def files_of(config: Config) -> list[str]:
    """The files that a configuration names: filters, estimates, parameters, truth; names of filters are no files."""
    named = [item.partition(":")[0].partition("@")[0] for item in config.estimators] + [config.params or ""]
    return [name for name in [*named, config.truth_place] if Path(name).suffix]


def key(content: str, settings: str) -> str:
    """What a record is found by: content, settings and version."""
    return f"{content}:{settings}:{__version__}"


def content_key(work: Work) -> str:
    """The key of a log whose process was ended before it told it; empty of what would have to be fetched again."""
    if work.source.member or is_url(work.source.place):
        return ""
    try:
        with work.source.local(work.folder) as log:
            return key(log.sha256, work.settings)
    except AttlogError:
        return ""


def done_before(work: Work) -> Record | None:
    """The record of an earlier run where the log needs no new one: same key, every file as it was written.

    An encrypted log that failed is tried again where there is a private key: it may be another one, or the first.
    A log that was named otherwise then (another path to the same bytes) has its record under its new name.
    """
    record = read_record(work.folder, work.name)
    if record is None or not record.for_good:
        return None
    content = record.key.partition(":")[0]
    if record.key != key(content, work.settings) or not intact(work.folder, record):
        return None
    may_open = not record.done and has_key()
    try:
        if record.stamp and record.stamp == stamp(work.source) and not may_open:
            return _from_before(work, record)
        with work.source.local(work.folder) as log:
            if log.sha256 != content or (may_open and is_encrypted(first_bytes(log.path, ENCRYPTED_HEADER.size))):
                return None
            return _from_before(work, record)
    except AttlogError:
        return None


def _from_before(work: Work, record: Record) -> Record:
    """The record of the log as it is named now."""
    if record.log != work.source.name:
        record = replace(record, log=work.source.name)
        write_record(work.folder, record)
    return replace(record, again=True, known=not record.done)


def keep(work: Work, record: Record) -> Record:
    """Keep the record; it then tells whether the log failed like this before. OutputError if it cannot be written."""
    before = read_record(work.folder, work.name) if work.resume else None
    write_record(work.folder, record)
    return replace(record, known=record.fails_as(before))


def stamp(source: Source) -> str:
    """What tells without its bytes whether a log is the same: for URLs and members. A file's own bytes are read."""
    return source.stamp() if source.member or is_url(source.place) else ""
