"""What is to be done with one log: everything that the process which does it has to know."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

from attlog import __version__
from attlog.analysis.config import Config
from attlog.base.errors import AttlogError
from attlog.fleet.records.record import Record, intact, read_record, write_record
from attlog.fleet.sources.remote import is_url
from attlog.fleet.sources.source import Source
from attlog.formats.compression import first_bytes
from attlog.formats.ulog.encrypted import HEADER, has_key, is_encrypted


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
            if log.sha256 != content or (may_open and is_encrypted(first_bytes(log.path, HEADER.size))):
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
