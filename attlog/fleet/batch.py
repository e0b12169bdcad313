"""Many logs into one folder: what was done stays done, and the folder tells the same whatever interrupted it."""

from __future__ import annotations

import json
import logging
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol

from attlog import __version__
from attlog.config import Config
from attlog.errors import INTERRUPTED, ClusterError, OutputError, UsageError
from attlog.fleet.entry import Entry
from attlog.fleet.index_page import INDEX, write_index
from attlog.fleet.locally import Runner
from attlog.fleet.lock import locked
from attlog.fleet.one import report_names
from attlog.fleet.record import INSIDE, Record, read_record, record_path, records
from attlog.fleet.results_file import CSV, PARQUET, write_results
from attlog.fleet.row import light
from attlog.fleet.sources import Source
from attlog.fleet.work import Work, settings_key
from attlog.output import remove_unfinished, write_atomic

SCHEMA = "attlog-batch/1"
INDEX_EVERY_S = 10.0
"""The index is written anew this often at most, and never for more than a twentieth of the time."""


@dataclass(frozen=True, slots=True)
class Job:
    """A batch: which logs, into which folder, and how each is treated (see :class:`attlog.fleet.work.Work`).

    ``commands``: for each log the command that makes its report alone. ``resume``: what is done in the folder stays;
    ``fresh``: what an earlier batch left there is removed first. Neither: a folder with a batch is refused.
    """

    sources: Sequence[Source]
    folder: Path
    config: Config
    commands: Sequence[str] = ()
    plotly: Literal["inline", "shared"] = "inline"
    deterministic: bool = False
    timeout: float | None = None
    memory: float | None = None
    resume: bool = False
    fresh: bool = False


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
        return analyse_all(job, run, watcher, judge)


def analyse_all(job: Job, run: Runner, watcher: Watcher, judge: Judge | None = None) -> Outcome:
    """The same for a caller that holds the lock of the folder."""
    tidy(job.folder)
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
                outcome.again += record.again
                outcome.codes |= {record.code, 1} if entry.gates else {record.code}
                watcher.finished(record, entry)
                index.write_if_due(lambda: _ordered(found))
                if record.folder_full:
                    outcome.stopped = f"{job.folder} takes no more files"
                    break
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


def tidy(folder: Path) -> None:
    """Remove what a run that was killed left behind: rooms of its processes, files that were being written."""
    shutil.rmtree(folder / INSIDE / "rooms", ignore_errors=True)
    remove_unfinished(folder / INSIDE)
    remove_unfinished(folder / INSIDE / "records")
    remove_unfinished(folder, INDEX, PARQUET, CSV)


def planned(job: Job) -> list[Work]:
    """The work for each log, under names that stay the same for the life of the folder."""
    earlier = _earlier(job)
    settings = settings_key(job.config, job.plotly, job.deterministic)
    logs = [source.name for source in job.sources]
    new = [source for source in job.sources if source.name not in earlier]
    names = earlier | dict(zip(
        (source.name for source in new), report_names((s.file_name for s in new), earlier.values()), strict=True,
    ))  # fmt: skip
    plan = {"schema": SCHEMA, "version": __version__, "settings": settings, "names": names}
    write_atomic(_plan(job.folder), json.dumps(plan, indent=1) + "\n")
    commands = job.commands or [""] * len(logs)
    return [
        Work(
            source, names[log], job.folder, job.config, settings, command, job.plotly, job.deterministic,
            job.timeout, job.memory, job.resume,
        )
        for source, log, command in zip(job.sources, logs, commands, strict=True)
    ]  # fmt: skip


def _plan(folder: Path) -> Path:
    return folder / INSIDE / "batch.json"


def _earlier(job: Job) -> dict[str, str]:
    """Names of reports that logs have in the folder already, by log."""
    try:
        plan = json.loads(_plan(job.folder).read_bytes())
        names: dict[str, str] = dict(plan["names"])
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError):
        names = {record.log: record.name for record in records(job.folder)}
    if job.fresh:
        _forget(job.folder, names.values())
        return {}
    if not job.resume:
        done = sum(record_path(job.folder, name).exists() for name in names.values())
        raise UsageError(
            f"{job.folder} holds a batch ({done} of {len(names)} logs were reached): --resume goes on with it "
            "(what is done and unchanged is not done again), --fresh removes its reports and begins again, "
            "-o chooses another folder"
        )
    return names


def _forget(folder: Path, names: Iterable[str]) -> None:
    """Remove what an earlier batch wrote: nothing but files that it is known to have made."""
    try:
        for name in names:
            record = read_record(folder, name)
            for file in record.files if record else ():
                (folder / file).unlink(missing_ok=True)
            record_path(folder, name).unlink(missing_ok=True)
        for page in (_plan(folder), folder / INDEX, folder / PARQUET, folder / CSV):
            page.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another place with -o") from error


def entry_of(record: Record, judge: Judge | None = None) -> Entry:
    """What index and summary keep of a record in memory."""
    gates = judge(record) if judge is not None else ()
    row = light(record.row) if record.done else None
    return Entry(record.log, record.name, record.code, record.message.removeprefix("attlog: "), row, gates)


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
