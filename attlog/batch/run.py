"""One batch at a time in a folder: a lock that the system gives back when its process ends, however it ends."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import socket
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Protocol

from attlog import __version__
from attlog.batch.index_page import INDEX, write_index
from attlog.batch.index_row import Entry, light
from attlog.batch.job import INSIDE, Record, Work, read_record, record_path, records, settings_key, written
from attlog.batch.process import SCRATCH, forks, run_one
from attlog.batch.remote import is_url
from attlog.batch.report_files import report_names
from attlog.batch.results_file import CSV, PARQUET, write_results
from attlog.batch.sources import Source
from attlog.core.errors import EXIT_INTERRUPTED, ClusterError, OutputError, UsageError
from attlog.core.files import remove_unfinished, write_atomic
from attlog.core.machine import cores
from attlog.core.workers import ForkServer
from attlog.pipeline.config import Config

BEYOND = 1 << 30
"""Windows lets nobody read a byte that is locked: one that the file does not have."""


@contextmanager
def locked(folder: Path) -> Iterator[str]:
    """A block in which no other batch writes to the folder.

    OutputError if one does (it is named), or if the folder cannot be made or written. The file stays behind: a lock
    on a file that is removed and made anew would be no lock. The block is given a warning where the file system
    cannot lock, else an empty text.
    """
    place = folder / INSIDE / "lock"
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        file = place.open("a+")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another place with -o") from error
    with file:
        without = ""
        try:
            _lock(file)
        except BlockingIOError:
            file.seek(0)
            raise OutputError(
                f"{folder}: another batch is writing there ({file.read(200).strip() or 'just started'}); "
                "wait for it, or choose another folder with -o"
            ) from None
        except OSError as error:
            without = f"{folder}: no locks on this file system ({error.strerror}); let no other batch write there"
        try:
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
        except OSError as error:
            raise OutputError(
                f"{folder}: cannot be written ({error.strerror}); choose another place with -o"
            ) from error
        yield without


def _lock(file: IO[str]) -> None:
    """Lock the file until it is closed. BlockingIOError if somebody else has; OSError where files cannot be locked."""
    if sys.platform == "win32":
        import msvcrt

        file.seek(BEYOND)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(error.errno, error.strerror) from None
        file.seek(0)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


# What will be done with which log of a batch, under which name: the same for the life of its folder.

SCHEMA = "attlog-batch/1"


@dataclass(frozen=True, slots=True)
class Job:
    """A batch: which logs, into which folder, and how each is treated (see :class:`attlog.batch.job.Work`).

    ``commands``: for each log the command that makes its report alone. ``resume``: what is done in the folder stays;
    ``fresh``: what an earlier batch left there is removed first. Neither: a folder with a batch is refused.
    """

    sources: Sequence[Source]
    folder: Path
    config: Config
    commands: Sequence[str] = ()
    deterministic: bool = False
    timeout: float | None = None
    memory: float | None = None
    resume: bool = False
    fresh: bool = False


def planned(job: Job) -> list[Work]:
    """The work for each log, under names that stay the same for the life of the folder."""
    earlier = _earlier(job)
    settings = settings_key(job.config, job.deterministic)
    logs = [source.name for source in job.sources]
    earlier |= _moved(job, earlier)
    new = [source for source in job.sources if source.name not in earlier]
    names = earlier | dict(
        zip((source.name for source in new), report_names((s.file_name for s in new), earlier.values()), strict=True)
    )
    plan = {"schema": SCHEMA, "version": __version__, "settings": settings, "names": names}
    write_atomic(_plan(job.folder), json.dumps(plan, indent=1) + "\n")
    commands = job.commands or [""] * len(logs)
    return [
        Work(
            source,
            names[log],
            job.folder,
            job.config,
            settings,
            command,
            job.deterministic,
            job.timeout,
            job.memory,
            job.resume,
        )
        for source, log, command in zip(job.sources, logs, commands, strict=True)
    ]


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


def _moved(job: Job, earlier: dict[str, str]) -> dict[str, str]:
    """Logs that the folder knows by another path: same file name, same bytes. Their reports are taken over."""
    named = {source.name for source in job.sources}
    gone: dict[str, list[str]] = {}
    for log in earlier:
        if log not in named:
            gone.setdefault(re.split(r"[/\\]", log)[-1], []).append(log)
    found: dict[str, str] = {}
    for source in job.sources:
        if source.name in earlier or source.member or is_url(source.place) or source.file_name not in gone:
            continue
        now = written(Path(source.place))
        for log in gone[source.file_name]:
            record = read_record(job.folder, earlier[log])
            if now is not None and record is not None and record.key.startswith(f"{now[1]}:"):
                found[source.name] = earlier.pop(log)
                gone[source.file_name].remove(log)
                break
    return found


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


# Work done on this machine: so many logs at a time, each in a process of its own, records as they come.

Records = Generator[Record, None, None]
Runner = Callable[[Sequence[Work]], Records]
"""Does the work, wherever, and gives one record for each as it comes; ends what runs when it is closed."""
Tell = Callable[[Work, dict[str, Any]], None]


def local_runner(workers: int | None = None, tell: Tell | None = None, processes: ForkServer | None = None) -> Runner:
    """A runner on this machine; as many ``workers`` as it has cores by default. ``tell`` hears the stages of each log.

    ``tell`` is called from threads. ``processes``: used again, and closed by whoever made them.
    """

    def run(works: Sequence[Work]) -> Records:
        return _run(works, min(workers or cores(), max(len(works), 1)), tell, processes)

    return run


def _run(works: Sequence[Work], workers: int, tell: Tell | None, kept: ForkServer | None) -> Records:
    processes = kept or forks()

    def one(work: Work) -> Record:
        return run_one(work, processes, None if tell is None else lambda told: tell(work, told))

    pool = ThreadPoolExecutor(workers, "attlog")
    try:
        if workers == 1:  # in order: the next begins when its predecessor was taken
            yield from map(one, works)
            return
        for future in as_completed(pool.submit(one, work) for work in works):
            yield future.result()
    finally:
        if kept is None:
            processes.close()  # first: a thread waits for its child
        pool.shutdown(wait=True, cancel_futures=True)


# Many logs into one folder: what was done stays done, and the folder tells the same whatever interrupted it.

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
            logging.getLogger("attlog.batch").warning(warning)
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
        outcome.codes |= {EXIT_INTERRUPTED}
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
