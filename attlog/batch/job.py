"""Job and record of one log; records are kept in ``.attlog/records``."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from attlog import __version__
from attlog.batch.sources import Source
from attlog.core.errors import AttlogError
from attlog.core.files import file_name, write_atomic
from attlog.core.own_files import RECORD
from attlog.formats.file_bytes import first_bytes
from attlog.formats.ulog.encrypted import ENCRYPTED_HEADER, has_key, is_encrypted
from attlog.pipeline.config import Config

# Folder for records, plan, lock and work in progress, inside a batch folder.
RECORDS_FOLDER = ".attlog"
SCHEMA = "attlog-record/1"
# Exit codes that are reproducible for the same key. Others may change: a timeout, a full disk, a bug.
FINAL_CODES = frozenset((0, 2, 65))
# Fields that vary between runs, and fields that are not written.
MEASURED = ("wall_s", "cpu_s", "peak_mb")
NOT_WRITTEN = ("again", "known", "folder_full", "gates")


class Job(NamedTuple):
    """One log and the settings of its analysis; picklable for any scheduler.

    ``name``: of its report, unique in ``folder``. ``settings``: from :func:`settings_key`. ``command``: stored in the
    result. ``timeout`` (s) and ``memory`` (MB, resident): limits of the log's process, None for no limit. ``resume``:
    skip the log if a record with the same key and intact files exists. ``keep``: write a record. ``figures``: path
    prefix of figures to write.
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


@dataclass(frozen=True, slots=True)
class Record:
    """Outcome of one log.

    ``log``: path, URL or archive member as given by the user. ``name``: of its report, ``NAME.html``. ``key``: hash of
    content (SHA-256), settings and version, empty if the content is unknown. ``code`` and ``message``: exit code and
    error of ``attlog analyze``. ``row``: numbers for index and tables, empty without a result. ``files``: size (bytes)
    and SHA-256 of each file written. ``stamp``: fingerprint of a URL or member that needs no download. ``trace``:
    traceback of a bug. ``folder_full``: the output folder has no space left. ``gates``: one sentence per failed gate.
    ``again``: taken from an earlier run. ``known``: failed in the same way in an earlier run.
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
    gates: tuple[str, ...] = ()
    again: bool = field(default=False, compare=False)
    known: bool = field(default=False, compare=False)

    @property
    def done(self) -> bool:
        """True if the log has a report."""
        return self.code == 0

    @property
    def is_final(self) -> bool:
        """True if another attempt would end in the same way."""
        return self.code in FINAL_CODES


def record_path(folder: Path, name: str) -> Path:
    """Return the path of the record of a report."""
    return folder / RECORDS_FOLDER / "records" / f"{name}.json"


def write_record(folder: Path, record: Record) -> None:
    """Write a record atomically. OutputError if that fails."""
    document = {"schema": SCHEMA} | {k: v for k, v in asdict(record).items() if k not in NOT_WRITTEN}
    text = json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n"
    write_atomic(record_path(folder, record.name), text, RECORD)


def read_record(folder: Path, name: str) -> Record | None:
    """Read the record of a report; None if missing or of another version."""
    return _read(record_path(folder, name))


def records(folder: Path) -> Iterator[Record]:
    """Yield the records of a batch folder by report name."""
    for path in sorted((folder / RECORDS_FOLDER / "records").glob("*.json")):
        record = _read(path)
        if record is not None:
            yield record


def _read(path: Path) -> Record | None:
    try:
        document = json.loads(path.read_bytes())
        if document.pop("schema") != SCHEMA:
            return None
        document["files"] = {name: (size, digest) for name, (size, digest) in document["files"].items()}
        if any(file_name(name) != name for name in (*document["files"], document["name"])):
            return None  # a folder can come from a stranger, and these files are replaced and removed
        known = {f.name for f in fields(Record)}
        return Record(**{k: v for k, v in document.items() if k in known})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None  # a log with an unreadable record is analysed again


def size_and_hash(path: Path) -> tuple[int, str] | None:
    """Return size (bytes) and SHA-256 of a file; None if it cannot be read."""
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return file.tell(), digest
    except OSError:
        return None


def settings_key(config: Config, deterministic: bool = False) -> str:
    """Hash everything except log content and version that determines a report.

    This is the resolved configuration and the content of its files: filters, estimates, parameters, truth.
    """
    contents = {
        name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in files_of(config) if os.path.isfile(name)
    }
    folder = config.truth_place
    if os.path.isdir(folder):  # a folder of truth files: names, sizes and times
        found = sorted((e.name, e.stat().st_size, e.stat().st_mtime_ns) for e in os.scandir(folder))
        contents[folder] = hashlib.sha256(repr(found).encode()).hexdigest()
    settings = {"config": config.resolved(), "files": contents, "deterministic": deterministic}
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]


def files_of(config: Config) -> list[str]:
    """Return the files that a configuration names: filters, estimates, parameters, truth."""
    named = [item.partition(":")[0].partition("@")[0] for item in config.estimators] + [config.params or ""]
    return [name for name in [*named, config.truth_place] if Path(name).suffix]


def key(content: str, settings: str) -> str:
    """Join content, settings and version to the key of a record."""
    return f"{content}:{settings}:{__version__}"


def content_key(job: Job) -> str:
    """Return the key of a local log by reading its file, else empty."""
    if job.source.needs_copy:
        return ""
    try:
        with job.source.local(job.folder) as log:
            return key(log.sha256, job.settings)
    except AttlogError:
        return ""


def done_before(job: Job) -> Record | None:
    """Return the finished record of an earlier run, if the job resumes.

    The record has the same key and intact files. A failed encrypted log is retried if a private key is available. A log
    moved to another path gets its record under the new path.
    """
    record = read_record(job.folder, job.name) if job.resume else None
    if record is None or not record.is_final:
        return None
    content = record.key.partition(":")[0]
    intact = all(size_and_hash(job.folder / name) == kept for name, kept in record.files.items())
    if record.key != key(content, job.settings) or not intact:
        return None
    retry_encrypted = not record.done and has_key()
    try:
        if not (record.stamp and record.stamp == stamp(job.source) and not retry_encrypted):
            with job.source.local(job.folder) as log:
                head = first_bytes(log.path, ENCRYPTED_HEADER.size) if retry_encrypted else b""
                if log.sha256 != content or (retry_encrypted and is_encrypted(head)):
                    return None
        if record.log != job.source.name:
            record = replace(record, log=job.source.name)
            write_record(job.folder, record)
    except AttlogError:
        return None
    return replace(record, again=True, known=not record.done)


def keep(job: Job, record: Record, before: Record | None) -> Record:
    """Write the record of a log that was tried; ``before``: that of an earlier run.

    A failed log keeps the files of the earlier run. OutputError if the record cannot be written.
    """
    if before is not None and not record.done:
        record = replace(record, files=before.files)
    write_record(job.folder, record)
    return record


def stamp(source: Source) -> str:
    """Return the fingerprint of a URL or archive member; empty for files."""
    return source.stamp() if source.needs_copy else ""
