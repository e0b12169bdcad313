"""A folder that is watched: logs are analysed as they arrive, and the index tells of all that came."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from attlog.base.errors import INTERRUPTED, AttlogError, LogUnreadable, OutputError
from attlog.base.output import write_atomic
from attlog.fleet.records.entry import Entry
from attlog.fleet.records.lock import locked
from attlog.fleet.records.plan import Job, planned
from attlog.fleet.records.record import INSIDE, Record, records, write_record
from attlog.fleet.records.work import key, settings_key
from attlog.fleet.schedulers.arrivals import Arrivals, State, state_of
from attlog.fleet.schedulers.batch import Index, Judge, Outcome, Watcher, entry_of, tidy
from attlog.fleet.schedulers.local import Runner
from attlog.fleet.sources.find import logs_of
from attlog.fleet.sources.source import Source

SCHEMA = "attlog-watch/1"
LOOK_S = 2.0
"""Between two looks, and never more than a fiftieth of the time is spent looking."""
SHARE = 50


class Listener(Watcher, Protocol):
    """Who is told what is seen."""

    def same(self, source: Source, as_log: str) -> None:
        """A file with the content of a log that was analysed before, which is all that happens to it."""


@dataclass(frozen=True, slots=True)
class _Arrived:
    """A log in a file that has settled."""

    source: Source
    file: Path
    state: State


def watch(
    job: Job,
    arrivals: Arrivals,
    run: Runner,
    listener: Listener,
    at_a_time: int,
    judge: Judge | None = None,
    commands: Callable[[Sequence[Source]], Sequence[str]] | None = None,
    pause: Callable[[float], None] = time.sleep,
) -> Outcome:
    """Analyse what arrives until an interrupt (KeyboardInterrupt) comes; ``job.sources`` is not looked at.

    What a folder's records know is not done again, whatever it is called by now; a changed file is. A log that
    vanishes or changes while it is read is left for later; records of logs that are gone stay. ``commands``: see
    :class:`attlog.fleet.schedulers.batch.Job`; ``at_a_time``: files between two looks.
    OutputError if the folder cannot be written or another batch is at work there.
    """
    with locked(job.folder):
        tidy(job.folder)
        planned(replace(job, sources=[], commands=(), resume=not job.fresh))
        watched = _Watched(replace(job, resume=True, fresh=False), arrivals, run, listener, judge)
        started = time.monotonic()
        interrupted = False
        try:
            while True:
                looked = time.monotonic()
                watched.arrived(arrivals.settled(looked))
                seconds = time.monotonic() - looked
                watched.take(at_a_time, commands)
                if not watched.waiting:
                    pause(max(LOOK_S, SHARE * seconds))
        except KeyboardInterrupt:
            interrupted = True
        finally:
            watched.keep()
        outcome = watched.outcome()
        outcome.interrupted, outcome.seconds = interrupted, time.monotonic() - started
        outcome.codes |= {INTERRUPTED}
        return outcome


class _Watched:
    """What is known of a watched folder."""

    def __init__(self, job: Job, arrivals: Arrivals, run: Runner, listener: Listener, judge: Judge | None) -> None:
        self._job, self._arrivals, self._run, self._listener, self._judge = job, arrivals, run, listener, judge
        self._settings = settings_key(job.config, job.plotly, job.deterministic)
        self._entries: dict[str, Entry] = {}
        self._done: dict[str, str] = {}
        """Which log has this key."""
        self._keys: dict[str, str] = {}
        for record in records(job.folder):
            self._remember(record)
        self._files = self._read()
        self._index = Index(job.folder)
        self._stale = bool(self._entries)
        self.waiting: list[tuple[Path, State]] = []
        self.keep()

    def arrived(self, files: Sequence[tuple[Path, State]]) -> None:
        """These have settled; those that are known are known."""
        self.waiting += [(file, state) for file, state in files if self._files.get(str(file)) != state[:2]]

    def take(self, most: int, commands: Callable[[Sequence[Source]], Sequence[str]] | None) -> None:
        """Analyse the logs in so many of the files that wait."""
        new = []
        for file, state in self.waiting[:most]:
            if state_of(file) == state:
                new.append((file, state))
            else:
                self._arrivals.again(file)
        del self.waiting[:most]
        if not new:
            return
        arrived = {log.source.name: log for log in self._logs(new)}
        left = {str(log.file) for log in arrived.values()}
        for file, state in new:
            if str(file) not in left and state_of(file) == state:
                self._files[str(file)] = state[:2]  # no log, or one that is known
        if not arrived:
            self.keep()
            return
        sources = [log.source for log in arrived.values()]
        works = planned(replace(self._job, sources=sources, commands=commands(sources) if commands else ()))
        self._listener.planned(works)
        waiting = {file: sum(str(log.file) == file for log in arrived.values()) for file in left}
        with closing(self._run([replace(work, keep=False) for work in works])) as coming:
            for record in coming:
                log = arrived[record.log]
                if record.code == LogUnreadable.exit_code and state_of(log.file) != log.state:
                    self._arrivals.again(log.file)
                    continue
                if record.folder_full:
                    raise OutputError(record.message.removeprefix("attlog: "))
                if not record.again:
                    write_record(self._job.folder, record)
                entry = self._remember(record)
                self._stale = True
                waiting[str(log.file)] -= record.for_good
                if not waiting[str(log.file)]:
                    self._files[str(log.file)] = log.state[:2]
                self._listener.finished(record, entry)
                self._index.write_if_due(self._ordered)
        self.keep()

    def keep(self) -> None:
        """Bring index, table and memory of the folder up to date."""
        if self._stale:
            self._index.write_all(self._ordered())
            self._stale = False
        document = {"schema": SCHEMA, "made": self._made(), "files": self._files}
        write_atomic(self._memory(), json.dumps(document) + "\n")

    def outcome(self) -> Outcome:
        """All that is in the folder."""
        return Outcome(self._ordered(), len(self._entries))

    def _logs(self, files: Sequence[tuple[Path, State]]) -> Iterator[_Arrived]:
        """The logs in files that were not analysed before, under any name."""
        now: dict[str, str] = {}
        for file, state in files:
            for source in logs_of(file):
                try:
                    with source.local() as log:
                        found = key(log.sha256, self._settings)
                except AttlogError:
                    found = source.name  # what analyses it will say why
                known = self._done.get(found) or now.setdefault(found, source.name)
                if known == source.name:
                    yield _Arrived(source, file, state)
                else:
                    self._listener.same(source, known)

    def _remember(self, record: Record) -> Entry:
        self._done.pop(self._keys.pop(record.log, ""), None)
        if record.key and record.for_good:
            self._done[record.key] = record.log
            self._keys[record.log] = record.key
        entry = self._entries[record.log] = entry_of(record, self._judge)
        return entry

    def _ordered(self) -> list[Entry]:
        return [self._entries[log] for log in sorted(self._entries)]

    def _made(self) -> str:
        return key("", self._settings)

    def _memory(self) -> Path:
        return self._job.folder / INSIDE / "watch.json"

    def _read(self) -> dict[str, tuple[int, int]]:
        """Size and time of files that an earlier watch with the same settings was done with."""
        try:
            document = json.loads(self._memory().read_bytes())
            if (document["schema"], document["made"]) != (SCHEMA, self._made()):
                return {}
            return {file: (size, changed) for file, (size, changed) in document["files"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return {}  # a memory that is lost: each file is read once more, none is analysed again
