"""One log of a batch: the job that analyses it, and the record that is kept of it in ``.attlog/records``."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.batch.sources import Source
from attlog.core.errors import AttlogError
from attlog.core.files import write_atomic
from attlog.formats.file_bytes import first_bytes
from attlog.formats.ulog.encrypted import ENCRYPTED_HEADER, has_key, is_encrypted
from attlog.pipeline.config import Config

# The folder inside a batch folder that belongs to attlog: records, plan, lock, work in progress.
INSIDE = ".attlog"
SCHEMA = "attlog-record/1"
# Exit codes that the same key ends with again. Any other may change: a timeout, a full disk, a bug.
FINAL_CODES = frozenset((0, 2, 65))
# Fields that differ from run to run, and fields that are not written.
MEASURED = ("wall_s", "cpu_s", "peak_mb")
NOT_WRITTEN = ("again", "known", "folder_full", "gates")


@dataclass(frozen=True, slots=True)
class Job:
    """One log and how it is analysed: picklable, so that any scheduler can carry it.

    ``name``: of its report, unique in ``folder``. ``settings``: from :func:`settings_key`. ``command``: as written in
    the result. ``timeout`` (s) and ``memory`` (MB, resident): limits of the log's process; None: no limit.
    ``resume``: a record with the same key and intact files counts as done. ``keep``: write a record. ``figures``: start
    of the paths of figures that are written too.
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

    ``log``: as named by the user (path, URL, member of an archive); ``name``: of its report, ``NAME.html``.
    ``key``: content (SHA-256), settings and version; empty where the content is unknown. ``code`` and ``message``:
    exit code and error of ``attlog analyze``. ``row``: numbers for index and tables, empty without a result.
    ``files``: size (bytes) and SHA-256 of each file written. ``stamp``: a sign of the content of a URL or member that
    needs no download. ``trace``: of a bug. ``folder_full``: the output folder has no space left. ``gates``: a sentence
    for each gate that failed. ``again``: taken from an earlier run. ``known``: failed the same way in an earlier run.
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
        """True if the same log ends like this again."""
        return self.code in FINAL_CODES

    def fails_as(self, before: Record | None) -> bool:
        """Return True if an earlier record has the same failure of the same content, settings and version."""
        return (
            before is not None
            and not self.done
            and bool(self.key)
            and (self.key, self.code) == (before.key, before.code)
        )


def record_path(folder: Path, name: str) -> Path:
    """Return the path of the record of a report."""
    return folder / INSIDE / "records" / f"{name}.json"


def write_record(folder: Path, record: Record) -> None:
    """Write a record atomically. OutputError if that fails."""
    document = {"schema": SCHEMA} | {k: v for k, v in asdict(record).items() if k not in NOT_WRITTEN}
    write_atomic(record_path(folder, record.name), json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n")


def read_record(folder: Path, name: str) -> Record | None:
    """Return the record of a report; None without one, or if another version wrote it."""
    return _read(record_path(folder, name))


def records(folder: Path) -> Iterator[Record]:
    """Yield the records of a batch folder by report name."""
    for path in sorted((folder / INSIDE / "records").glob("*.json")):
        record = _read(path)
        if record is not None:
            yield record


def _read(path: Path) -> Record | None:
    try:
        document = json.loads(path.read_bytes())
        if document.pop("schema") != SCHEMA:
            return None
        document["files"] = {name: (size, digest) for name, (size, digest) in document["files"].items()}
        known = {f.name for f in fields(Record)}
        return Record(**{k: v for k, v in document.items() if k in known})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None  # a log without a readable record is analysed again


def size_and_hash(path: Path) -> tuple[int, str] | None:
    """Return size (bytes) and SHA-256 of a file; None if it cannot be read."""
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return file.tell(), digest
    except OSError:
        return None


def settings_key(config: Config, deterministic: bool = False) -> str:
    """Hash all that decides a report beside the log's content and the version of attlog.

    That is the resolved configuration and the content of its files: filters, estimates, parameters, truth.
    """
    contents = {
        name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in files_of(config) if os.path.isfile(name)
    }
    folder = config.truth_place
    if os.path.isdir(folder):  # a truth for each log: names, sizes and times
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
    """Return the key of a log by reading its file; empty for URLs and members of archives."""
    if job.source.needs_copy:
        return ""
    try:
        with job.source.local(job.folder) as log:
            return key(log.sha256, job.settings)
    except AttlogError:
        return ""


def done_before(job: Job) -> Record | None:
    """Return the record of an earlier run with the same key and intact files, if the job resumes.

    An encrypted log that failed is tried again where there is a private key. A log with another path to the same bytes
    gets its record under the new path.
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


def keep(job: Job, record: Record) -> Record:
    """Write the record and mark a failure that an earlier run had too. OutputError if it cannot be written."""
    before = read_record(job.folder, job.name) if job.resume else None
    write_record(job.folder, record)
    return replace(record, known=record.fails_as(before))


def stamp(source: Source) -> str:
    """Return a sign of the content of a URL or member that needs no download; empty for files, which are hashed."""
    return source.stamp() if source.needs_copy else ""
