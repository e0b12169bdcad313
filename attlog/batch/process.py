"""One log in a process of its own, within limits of time and memory: from work to record."""

from __future__ import annotations

import functools
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.batch.job import INSIDE, Record, Work, content_key, done_before, keep, read_record
from attlog.batch.log_file import CHANGED, state
from attlog.batch.report_files import PRINTED, load_filters, process_log
from attlog.core import limits
from attlog.core.errors import EXIT_BUG, LogUnreadable, OutputError, error_message, exit_code, is_out_of_processes
from attlog.core.files import is_disk_full
from attlog.core.workers import Closed, Died, Exit, ForkServer, TooLong, TooMuchMemory

LIMIT_REACHED = 75
"""Exit code of a log that took more time or memory than it was given."""
SCRATCH = "scratch"
"""The folder inside a batch's own that holds the scratch folders of its processes."""
A_DAY_S = 86_400.0
PRELOADED = (
    "attlog.pipeline.evaluation",
    "attlog.batch.report_files",
    "attlog.batch.index_row",
    "attlog.flight.ardupilot.reader",
    "attlog.flight.px4.reader",
    "attlog.formats.dataflash.reader",
    "attlog.formats.ulog.reader",
    "attlog.report.page",
    "attlog.report.templates",
    "llvmlite.binding",
    "numpy.fft",
    "numpy.ma",
    "pygeomag",
    "tomli_w",
    "vqf",
)
"""What nearly every log needs; what is left out is imported by the process that needs it."""
Tell = Callable[[dict[str, Any]], None]


def forks() -> ForkServer:
    """Processes for logs. Where a mapped file is cut, the process that waits for them says so."""
    return ForkServer(PRELOADED, {limits.MAPPED: "1"})


shared = functools.lru_cache(maxsize=1)(forks)
"""Those of this process, for callers that bring none (a task of a cluster)."""


def run_one(work: Work, processes: ForkServer | None = None, tell: Tell | None = None) -> Record:
    """Analyse one log in a child process, put its files in place, and keep and return its record.

    Never raises for what a log, its process or the folder does: that is told by the record. A child only ever
    writes to a scratch folder of its own inside the folder; files are moved from there whole, so an orphan writes to
    nobody's report. ``tell`` hears the child's stages, and in silence an empty message now and
    then; what it raises ends the child. :class:`attlog.core.workers.Closed` if the processes are.
    """
    if work.resume:
        before = done_before(work)
        if before is not None:
            return before
    log = work.source.name
    scratch = work.folder / INSIDE / SCRATCH / secrets.token_hex(8)
    try:
        (scratch / "out").mkdir(parents=True)
        record = _analysed(work, scratch, processes or shared(), tell or _ignore)
        if record.done:
            _publish(scratch / "out", work.folder)
        if work.keep:
            _remove_outdated(work, record)
            record = keep(work, record)
    except (OSError, OutputError) as error:
        failure: Exception = error
        if isinstance(error, OSError) and not is_out_of_processes(error):
            failure = OutputError(f"{work.folder}: cannot be written ({error.strerror})")
        record = Record(
            log,
            work.name,
            code=exit_code(failure),
            message=error_message(failure, __version__, log),
            folder_full=is_disk_full(error if isinstance(error, OSError) else error.__cause__),
        )
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return record


@contextmanager
def tidied(folder: Path) -> Iterator[None]:
    """A block whose work keeps no records: afterwards nothing but reports is left in the folder.

    Others may be at work there, so of runs that were killed only what is a day old is removed.
    """
    for scratch in (folder / INSIDE / SCRATCH).glob("*"):
        before = state(scratch)
        if before is not None and time.time() - before[1] / 1e9 > A_DAY_S:
            shutil.rmtree(scratch, ignore_errors=True)
    try:
        yield
    finally:
        for place in (folder / INSIDE / SCRATCH, folder / INSIDE):
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def _ignore(_: dict[str, Any]) -> None:
    """Hears nothing."""


def _analysed(work: Work, scratch: Path, processes: ForkServer, tell: Tell) -> Record:
    """The record that a child process told, or what became of the process."""
    before = state(Path(work.source.place))
    with suppress(Died):  # what a filter does to this process it does to that of its log, which says so
        processes.prepare(load_filters, list(work.config.estimators), tell=tell)
    found: dict[str, Any]
    with processes.worker() as worker:
        started = time.monotonic()
        try:
            found = worker.call(
                process_log, work, scratch, seconds=work.timeout or 0.0, memory_mb=work.memory or 0.0, tell=tell
            )
        except Died as died:
            code, why = _why(died, state(Path(work.source.place)) != before)
            found = {"code": code, "message": f"attlog: {work.source.name}: {why}"}
            if code != LIMIT_REACHED:
                found["trace"] = _printed(scratch)
        seconds, took = time.monotonic() - started, worker.end()
    if processes.closed:
        raise Closed
    if "key" not in found:
        found["key"] = content_key(work)
    return Record(
        work.source.name,
        work.name,
        wall_s=round(seconds, 3),
        cpu_s=round(took.cpu_s, 3),
        peak_mb=round(took.peak_mb, 1),
        **found,
    )


def _why(died: Died, changed: bool) -> tuple[int, str]:
    """Exit code and sentence for a process that ended without a result."""
    if isinstance(died, TooLong):
        return LIMIT_REACHED, f"{died}; --timeout allows more, 0 any time"
    if isinstance(died, TooMuchMemory):
        return LIMIT_REACHED, f"{died}; --memory allows more, --boot or fewer --estimators need less"
    ended: Exit = died.exit
    if ended.signal == "SIGBUS" and changed:
        return LogUnreadable.exit_code, CHANGED  # a file that is cut while it is mapped into memory
    if ended.signal == "SIGKILL":
        return EXIT_BUG, f"its process {ended}; fewer --jobs or a limit by --memory leaves room for the others"
    if ended.crashed:
        return EXIT_BUG, (
            f"its process {ended}; a filter of yours or a bug in attlog {__version__} or its libraries: please report "
            "it with the output of -vv"
        )
    return EXIT_BUG, f"its process {ended}" + ("; -vv shows what it said last" if ended.status is not None else "")


def _printed(scratch: Path) -> str:
    """The last lines that a process wrote to its standard output and error: where it crashed."""
    try:
        return (scratch / PRINTED).read_text(encoding="utf-8", errors="replace")[-4000:]
    except OSError:
        return ""


def _remove_outdated(work: Work, record: Record) -> None:
    """Remove the files of an earlier run that the log has no longer: it failed; its old report is of another key."""
    before = read_record(work.folder, work.name)
    for name in set(before.files if before else ()) - set(record.files):
        (work.folder / name).unlink(missing_ok=True)


def _publish(out: Path, folder: Path) -> None:
    """Put files in their place, each whole; the JSON last, which others wait for. OutputError if one cannot be."""
    for file in sorted(out.iterdir(), key=lambda path: (path.suffix == ".json", path.name)):
        try:
            file.replace(folder / file.name)
        except OSError as error:
            raise OutputError(
                f"{folder / file.name}: cannot be written ({error.strerror}); choose another place with -o"
            ) from error
