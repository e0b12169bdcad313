"""Many logs into one folder: what was done stays done, and the folder tells the same whatever interrupted it."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from attlog.base.errors import INTERRUPTED, ClusterError, OutputError
from attlog.base.files.output import remove_unfinished
from attlog.fleet.pages.index import INDEX, write_index
from attlog.fleet.processes.run import SCRATCH
from attlog.fleet.records.entry import Entry, light
from attlog.fleet.records.lock import locked
from attlog.fleet.records.plan import Job, planned
from attlog.fleet.records.record import INSIDE, Record, read_record
from attlog.fleet.records.results_file import CSV, PARQUET, write_results
from attlog.fleet.records.work import Work
from attlog.fleet.schedulers.local import Runner

INDEX_EVERY_S = 10.0
"""The index is written anew this often at most, and never for more than a twentieth of the time."""


class Watcher(Protocol):
    """Who is told how a batch goes."""

    def planned(self, works: Sequence[Work]) -> None:
        """What will be done, before it begins."""

    def finished(self, record: Record, entry: Entry) -> None:
        """One log is done or has failed."""


Judge = Callable[[Record], tuple[str, ...]]
"""Which gates a log failed, a sentence for each; it is also shown logs that have no report, which fail none."""


@dataclass(slots=True)
class Outcome:
    """What became of a batch: an entry for each log that was reached, in the order in which logs were named."""

    entries: list[Entry] = field(default_factory=list)
    total: int = 0
    again: int = 0
    """Logs that were done in an earlier run."""
    seconds: float = 0.0
    interrupted: bool = False
    stopped: str = ""
    """Why the batch gave up before all logs were reached: the folder is full."""
    lost: str = ""
    """What became of the cluster, where that was the reason."""
    codes: set[int] = field(default_factory=set)


def run_batch(job: Job, run: Runner, watcher: Watcher, judge: Judge | None = None) -> Outcome:
    """Analyse all logs of the job into its folder, with index and table of results.

    OutputError if the folder cannot be written or another batch is at work there, UsageError if it holds a batch and
    the job neither resumes nor begins afresh. An interrupt (KeyboardInterrupt) ends what runs; index and results are
    those of the logs that were done, and the outcome says so.
    """
    with locked(job.folder) as warning:
        if warning:
            logging.getLogger("attlog.fleet").warning(warning)
        return _analyse_all(job, run, watcher, judge)


def _analyse_all(job: Job, run: Runner, watcher: Watcher, judge: Judge | None) -> Outcome:
    _tidy(job.folder)
    works = planned(job)
    place = {work.name: k for k, work in enumerate(works)}
    found: dict[int, Entry] = {}
    outcome = Outcome(total=len(works))
    started = time.monotonic()
    index = Index(job.folder)
    try:
        watcher.planned(works)
        with closing(run(works)) as coming:
            for record in coming:
                entry = entry_of(record, judge)
                found[place[record.name]] = entry
                outcome.again += record.again and record.done
                outcome.codes |= {0 if record.known else record.code} | ({1} if entry.gates else set())
                watcher.finished(record, entry)
                index.write_if_due(lambda: _ordered(found))
                if record.folder_full:
                    outcome.stopped = f"{job.folder} takes no more files"
                    break
    except OutputError as error:  # of the index
        outcome.stopped = str(error)
        outcome.codes |= {error.exit_code}
    except KeyboardInterrupt:
        outcome.interrupted = True
        outcome.codes |= {INTERRUPTED}
    except ClusterError as error:
        outcome.lost = str(error)
        outcome.codes |= {error.exit_code}
    outcome.entries = _ordered(found)
    outcome.seconds = time.monotonic() - started
    if outcome.entries:
        try:
            index.write_all(outcome.entries)
        except OutputError:
            if not outcome.stopped:
                raise
    return outcome


def _tidy(folder: Path) -> None:
    """Remove what a run that was killed left behind: scratch folders, files that were being written."""
    shutil.rmtree(folder / INSIDE / SCRATCH, ignore_errors=True)
    remove_unfinished(folder / INSIDE)
    remove_unfinished(folder / INSIDE / "records")
    remove_unfinished(folder, INDEX, PARQUET, CSV)


def entry_of(record: Record, judge: Judge | None = None) -> Entry:
    """What index and summary keep of a record in memory."""
    gates = judge(record) if judge is not None else ()
    row = light(record.row) if record.done else None
    return Entry(
        record.log, record.name, record.code, record.message.removeprefix("attlog: "), row, gates, record.known
    )


def _ordered(found: dict[int, Entry]) -> list[Entry]:
    return [found[k] for k in sorted(found)]


class Index:
    """The page and the table of a batch, written anew now and then."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._due = time.monotonic() + INDEX_EVERY_S
        self._results = ""

    def write_if_due(self, entries: Callable[[], Sequence[Entry]]) -> None:
        """The index of what is done by now, where the last one is old enough."""
        if time.monotonic() >= self._due:
            self.write(entries())

    def write(self, entries: Sequence[Entry]) -> None:
        """The index of these logs."""
        started = time.monotonic()
        write_index(self._folder, entries, results=self._results)
        self._due = time.monotonic() + max(INDEX_EVERY_S, 20 * (time.monotonic() - started))

    def write_all(self, entries: Sequence[Entry]) -> None:
        """Table and index of these logs; rows are taken from the records, one after the other."""

        def whole() -> Iterator[Entry]:
            for entry in entries:
                record = read_record(self._folder, entry.name) if entry.row is not None else None
                yield entry if record is None else replace(entry, row=record.row)

        self._results = write_results(self._folder, whole()).name
        self.write(entries)
