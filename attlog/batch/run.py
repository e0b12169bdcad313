"""Batch run into one folder: plan, lock, run, index.

Finished logs stay finished whatever interrupts the run.
"""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import socket
import sys
import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Protocol

from attlog import __version__
from attlog.batch.index_page import INDEX, write_index
from attlog.batch.index_row import without_metrics
from attlog.batch.job import RECORDS_FOLDER, Job, Record, read_record, record_path, records, settings_key, size_and_hash
from attlog.batch.process import SCRATCH, run_one, start_fork_server
from attlog.batch.report_files import report_names
from attlog.batch.results_file import CSV, PARQUET, write_results
from attlog.batch.sources import Source
from attlog.core.brief import counted
from attlog.core.errors import EXIT_INTERRUPTED, ClusterError, OutputError, UsageError
from attlog.core.files import file_name, remove_unfinished, write_atomic
from attlog.core.machine import cores
from attlog.core.own_files import INDEX as INDEX_PAGE
from attlog.core.own_files import RECORD, REPORT, RESULTS, require_replaceable
from attlog.core.workers import ForkServer
from attlog.pipeline.config import Config

# Windows refuses to read a locked byte: this one is beyond the end of the file.
LOCKED_BYTE = 1 << 30
# Beginning of a lock file.
LOCK_START = b"process "
PLAN_SCHEMA = "attlog-batch/1"
# Shortest time between two writes of the index, and the largest share of the run spent on them.
INDEX_EVERY_S = 10.0
INDEX_SHARE = 0.05

Records = Generator[Record, None, None]
# Runs jobs and yields their records as they finish. Closing it ends all running jobs.
Runner = Callable[[Sequence[Job]], Records]
OnMessage = Callable[[Job, dict[str, Any]], None]
# Returns one sentence for each gate that a log fails. It is called for logs without a report too.
Judge = Callable[[Record], tuple[str, ...]]


class Watcher(Protocol):
    """Receiver of the progress of a batch."""

    def planned(self, jobs: Sequence[Job]) -> None:
        """Receive the jobs before the first one starts."""

    def finished(self, record: Record) -> None:
        """Receive one log that is done or failed."""


@dataclass(slots=True)
class BatchOutcome:
    """Records of the analysed logs in the given order, without table metrics.

    ``ended``: why the batch ended early; empty otherwise.
    """

    records: list[Record] = field(default_factory=list)
    total: int = 0
    seconds: float = 0.0
    ended: str = ""
    codes: set[int] = field(default_factory=set)

    @property
    def again(self) -> int:
        """Number of logs that were done in an earlier run."""
        return sum(record.again and record.done for record in self.records)


def run_batch(
    sources: Sequence[Source],
    folder: Path,
    config: Config,
    run: Runner,
    watcher: Watcher,
    judge: Judge | None = None,
    *,
    commands: Sequence[str] = (),
    fresh: bool = False,
    **options: Any,
) -> BatchOutcome:
    """Analyse logs into a folder with index and table of results.

    ``commands``: for each log the command that reproduces its report. ``fresh``: remove an earlier batch first.
    ``options``: ``deterministic``, ``timeout``, ``memory`` and ``resume`` of :class:`attlog.batch.job.Job`. OutputError
    if the folder cannot be written or another batch uses it. UsageError if it holds a batch and neither ``resume`` nor
    ``fresh`` is set. After an interrupt (KeyboardInterrupt) index and results hold the finished logs; where none has a
    report, those of an earlier run that gave some are kept.
    """
    with lock_folder(folder) as warning:
        if warning:
            logging.getLogger("attlog.batch").warning(warning)
        _remove_leftovers(folder)
        for name, kind in ((INDEX, INDEX_PAGE), (PARQUET, RESULTS), (CSV, RESULTS)):
            require_replaceable(folder / name, kind)
        jobs = plan_jobs(sources, folder, config, commands, fresh, options)
        outcome = BatchOutcome(total=len(jobs))
        place = {job.name: k for k, job in enumerate(jobs)}
        found: dict[int, Record] = {}
        started, index, stopped = time.monotonic(), Index(folder), ""
        try:
            watcher.planned(jobs)
            with closing(run(jobs)) as coming:
                for whole in coming:
                    record = in_memory(whole, judge)
                    found[place[record.name]] = record
                    outcome.codes |= {0 if record.known else record.code} | ({1} if record.gates else set())
                    watcher.finished(record)
                    index.write_if_due(found)
                    if record.folder_full:
                        stopped = f"{folder} takes no more files"
                        break
        except OutputError as error:  # raised by writing the index
            stopped = str(error)
            outcome.codes |= {error.exit_code}
        except KeyboardInterrupt:
            reports = sum(record.done for record in found.values())
            outcome.ended = f"interrupted; {reports} of {len(jobs)} reports are in {folder}; --resume goes on"
            outcome.codes |= {EXIT_INTERRUPTED}
        except ClusterError as error:
            outcome.ended = str(error)
            outcome.codes |= {error.exit_code}
        if stopped:
            outcome.ended = (
                f"stopped: {stopped}, {len(jobs) - len(found)} of {counted(len(jobs), 'log')} not reached; "
                "--resume goes on when there is room"
            )
        outcome.records = [found[k] for k in sorted(found)]
        outcome.seconds = time.monotonic() - started
        if index.may_write(outcome.records):
            try:
                index.write_all(outcome.records)
            except OutputError:
                if not stopped:
                    raise
        elif outcome.records:
            outcome.ended = outcome.ended or f"no log gave a report; {index.page} of the earlier run is kept"
        return outcome


def in_memory(record: Record, judge: Judge | None = None) -> Record:
    """Judge a record and drop its metrics, which only tables need."""
    return replace(record, row=without_metrics(record.row), gates=judge(record) if judge is not None else ())


@contextmanager
def lock_folder(folder: Path) -> Iterator[str]:
    """Lock the folder against other batches.

    OutputError names the other batch, or reports that the folder cannot be written. The lock file stays, because a lock
    on a removed and recreated file would not lock. Yields a warning if the file system cannot lock, else "".
    """
    place = folder / RECORDS_FOLDER / "lock"
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        for own in (place.parent, place):  # of a stranger's folder: what it leads to would be emptied
            if os.path.islink(own):
                raise OutputError(f"{own}: is a link, so it is not written; choose another place with -o")
        if place.exists() and place.read_bytes()[: len(LOCK_START)] not in (b"", LOCK_START):
            raise OutputError(f"{place}: exists and is not of attlog; choose another place with -o")
        file = place.open("a+")
    except OSError as error:
        raise _not_written(folder, error) from error
    with file:
        warning = ""
        try:
            _lock(file)
        except BlockingIOError:
            file.seek(0)
            raise OutputError(
                f"{folder}: another batch is writing there ({file.read(200).strip() or 'just started'}); "
                "wait for it, or choose another folder with -o"
            ) from None
        except OSError as error:
            warning = f"{folder}: no locks on this file system ({error.strerror}); let no other batch write there"
        try:
            file.truncate(0)
            file.write(f"{LOCK_START.decode()}{os.getpid()} on {socket.gethostname()}\n")
            file.flush()
        except OSError as error:
            raise _not_written(folder, error) from error
        yield warning


def _lock(file: IO[str]) -> None:
    """Lock the file until it is closed. BlockingIOError if locked, OSError if impossible."""
    if sys.platform == "win32":
        import msvcrt

        file.seek(LOCKED_BYTE)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(error.errno, error.strerror) from None
        file.seek(0)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _not_written(folder: Path, error: OSError) -> OutputError:
    return OutputError(f"{folder}: cannot be written ({error.strerror}); choose another place with -o")


def plan_jobs(
    sources: Sequence[Source],
    folder: Path,
    config: Config,
    commands: Sequence[str],
    fresh: bool,
    options: dict[str, Any],
) -> list[Job]:
    """Return a job for each log; report names stay stable."""
    earlier = _earlier_names(folder, fresh, options.get("resume", False))
    settings = settings_key(config, options.get("deterministic", False))
    earlier |= _moved(sources, folder, earlier)
    new = [source for source in sources if source.name not in earlier]
    made = report_names((source.file_name for source in new), earlier.values())
    names = earlier | dict(zip((source.name for source in new), made, strict=True))
    plan = {"schema": PLAN_SCHEMA, "version": __version__, "settings": settings, "names": names}
    write_atomic(_plan_path(folder), json.dumps(plan, indent=1) + "\n", RECORD)
    return [
        Job(source, names[source.name], folder, config, settings, command, **options)
        for source, command in zip(sources, commands or [""] * len(sources), strict=True)
    ]


def _plan_path(folder: Path) -> Path:
    return folder / RECORDS_FOLDER / "batch.json"


def _earlier_names(folder: Path, fresh: bool, resume: bool) -> dict[str, str]:
    """Return log -> report name of the batch in the folder.

    UsageError if the folder holds a batch that is neither resumed nor removed.
    """
    try:
        planned = dict(json.loads(_plan_path(folder).read_bytes())["names"])
        names = {log: name for log, name in planned.items() if isinstance(name, str) and file_name(name) == name}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError):
        names = {record.log: record.name for record in records(folder)}
    if fresh:
        _remove_batch(folder, names.values())
        return {}
    if not resume:
        done = sum(record_path(folder, name).exists() for name in names.values())
        raise UsageError(
            f"{folder} holds a batch ({done} of {counted(len(names), 'log')} reached): --resume goes on with it "
            "(what is done and unchanged is not done again), --fresh removes its reports and begins again, "
            "-o chooses another folder"
        )
    return names


def _moved(sources: Sequence[Source], folder: Path, earlier: dict[str, str]) -> dict[str, str]:
    """Return log -> report name of moved logs: same file name, same bytes.

    Their old paths are removed from ``earlier``.
    """
    named = {source.name for source in sources}
    gone: dict[str, list[str]] = {}
    for log in earlier:
        if log not in named:
            gone.setdefault(re.split(r"[/\\]", log)[-1], []).append(log)
    found: dict[str, str] = {}
    for source in sources:
        if source.name in earlier or source.needs_copy or source.file_name not in gone:
            continue
        now = size_and_hash(Path(source.place))
        for log in gone[source.file_name]:
            record = read_record(folder, earlier[log])
            if now is not None and record is not None and record.key.startswith(f"{now[1]}:"):
                found[source.name] = earlier.pop(log)
                gone[source.file_name].remove(log)
                break
    return found


def _remove_batch(folder: Path, names: Iterable[str]) -> None:
    """Remove the files of an earlier batch, and no others.

    OutputError, before the first is removed, where a file of another is in the place of a report.
    """
    names, own = list(names), []
    for name in names:
        record = read_record(folder, name)
        for file, kept in record.files.items() if record else ():
            if size_and_hash(folder / file) != kept:
                require_replaceable(folder / file, REPORT)
            own.append(folder / file)
    try:
        for report in own:
            report.unlink(missing_ok=True)
        for name in names:
            record_path(folder, name).unlink(missing_ok=True)
        for page in (_plan_path(folder), folder / INDEX, folder / PARQUET, folder / CSV):
            if any(kind.includes(page) for kind in (RECORD, INDEX_PAGE, RESULTS)):
                page.unlink()
    except OSError as error:
        raise _not_written(folder, error) from error


def _remove_leftovers(folder: Path) -> None:
    """Remove scratch folders and unfinished files of a killed run."""
    shutil.rmtree(folder / RECORDS_FOLDER / SCRATCH, ignore_errors=True)
    remove_unfinished(folder / RECORDS_FOLDER)
    remove_unfinished(folder / RECORDS_FOLDER / "records")
    remove_unfinished(folder, INDEX, PARQUET, CSV)


def local_runner(
    workers: int | None = None, on_message: OnMessage | None = None, processes: ForkServer | None = None
) -> Runner:
    """Return a runner on this machine with one process per log.

    ``workers``: processes at a time, default the number of cores. ``on_message`` receives the stages of each log, from
    several threads. ``processes``: a server that its owner closes.
    """

    def run(jobs: Sequence[Job]) -> Records:
        server = processes or start_fork_server()

        def one(job: Job) -> Record:
            return run_one(job, server, None if on_message is None else lambda stage: on_message(job, stage))

        count = min(workers or cores(), max(len(jobs), 1))
        pool = ThreadPoolExecutor(count, "attlog")
        try:
            if count == 1:  # sequential: the next job starts after the caller took the previous record
                yield from map(one, jobs)
                return
            for future in as_completed(pool.submit(one, job) for job in jobs):
                yield future.result()
        finally:
            if processes is None:
                server.close()  # first: a thread waits for its child
            pool.shutdown(wait=True, cancel_futures=True)

    return run


class Index:
    """Index page and table of a batch, rewritten at intervals."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._due = time.monotonic() + INDEX_EVERY_S
        self._results = ""
        self.page = folder / INDEX

    def may_write(self, found: Collection[Record]) -> bool:
        """Return whether logs have a report, or an earlier run left none: a run without any answer replaces none."""
        if not found or any(record.done for record in found):
            return bool(found)
        return not self.page.exists() or not any(record.files for record in records(self._folder))

    def write_if_due(self, found: dict[int, Record]) -> None:
        """Write the index of finished logs if the last write is old enough."""
        if time.monotonic() >= self._due and self.may_write(found.values()):
            self._write([found[k] for k in sorted(found)])

    def _write(self, found: Sequence[Record]) -> None:
        started = time.monotonic()
        write_index(self._folder, found, results=self._results)
        self._due = time.monotonic() + max(INDEX_EVERY_S, (time.monotonic() - started) / INDEX_SHARE)

    def write_all(self, found: Sequence[Record]) -> None:
        """Write table and index; full rows are read from the records one by one."""
        whole = (read_record(self._folder, one.name) or one if one.done else one for one in found)
        self._results = write_results(self._folder, whole).name
        self._write(found)
