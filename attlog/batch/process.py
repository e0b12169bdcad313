"""Child process of one log, with limits of time and memory: job to record."""

from __future__ import annotations

import functools
import secrets
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.batch.job import RECORDS_FOLDER, Job, Record, content_key, done_before, keep, read_record, size_and_hash
from attlog.batch.log_file import CHANGED, file_state
from attlog.batch.report_files import PRINTED, kind_of_report, load_shared, process_log
from attlog.core import limits
from attlog.core.errors import EXIT_BUG, LogUnreadable, OutputError, error_message, exit_code, is_out_of_processes
from attlog.core.files import is_disk_full, write_atomic
from attlog.core.own_files import REPORT, hash_named_in, require_replaceable
from attlog.core.workers import Closed, Died, ForkServer, TooLong, TooMuchMemory

# Exit code of a log that exceeded its limit of time or memory.
LIMIT_REACHED = 75
# Folder inside :data:`RECORDS_FOLDER` for scratch folders of processes. Runs without records remove those a day old.
SCRATCH = "scratch"
SCRATCH_S = 86_400.0
# Modules loaded before the fork, because nearly every log needs them. A process imports others itself.
PRELOADED = (
    "attlog.pipeline.evaluation",
    "attlog.batch.report_files",
    "attlog.batch.index_row",
    "attlog.flight.ardupilot.reader",
    "attlog.flight.px4.reader",
    "attlog.formats.dataflash.reader",
    "attlog.formats.ulog.reader",
    "attlog.report.page",
    "llvmlite.binding",
    "numpy.fft",
    "numpy.ma",
    "platformdirs",
    "pygeomag",
    "tomli_w",
    "vqf",
)
OnMessage = Callable[[dict[str, Any]], None]


def start_fork_server() -> ForkServer:
    """Start the server that forks one process per log."""
    return ForkServer(PRELOADED, {limits.MAPPED: "1"})


# Server for callers without their own, such as a task of a cluster.
shared = functools.lru_cache(maxsize=1)(start_fork_server)


def run_one(job: Job, processes: ForkServer | None = None, on_message: OnMessage | None = None) -> Record:
    """Analyse one log in a child process and return its record.

    The log's files are moved into place and the record is written. Errors of the log, its process or the folder are
    reported in the record, never raised. The child writes to a scratch folder only, so an orphan cannot change a
    report. ``on_message`` receives the child's stages, and an empty message now and then; its exceptions end the
    child. Raises :class:`attlog.core.workers.Closed` if the server is closed.
    """
    if before := done_before(job):
        return before
    scratch = job.folder / RECORDS_FOLDER / SCRATCH / secrets.token_hex(8)
    try:
        (scratch / "out").mkdir(parents=True)
        record = _analyse(job, scratch, processes or shared(), on_message or (lambda _: None))
        before = read_record(job.folder, job.name) if job.keep else None
        if record.done:
            publish(job, before, {path.name: path for path in (scratch / "out").iterdir()})
        if job.keep:
            record = keep(job, record, before)
    except (OSError, OutputError) as error:
        failure: Exception = error
        if isinstance(error, OSError) and not is_out_of_processes(error):
            failure = OutputError(f"{job.folder}: cannot be written ({error.strerror})")
        record = failed_record(job, failure, is_disk_full(error if isinstance(error, OSError) else error.__cause__))
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return record


def failed_record(job: Job, error: Exception, folder_full: bool = False) -> Record:
    """Return the record of a log whose error occurred outside its own process."""
    log = job.source.name
    message = error_message(error, __version__, log)
    return Record(log, job.name, code=exit_code(error), message=message, folder_full=folder_full)


@contextmanager
def clean_up(folder: Path) -> Iterator[None]:
    """Clean up around runs without records: only reports stay in the folder.

    Another run may use the folder, so scratch folders of killed runs are removed only when a day old.
    """
    for scratch in (folder / RECORDS_FOLDER / SCRATCH).glob("*"):
        before = file_state(scratch)
        if before is not None and time.time() - before[1] / 1e9 > SCRATCH_S:
            shutil.rmtree(scratch, ignore_errors=True)
    try:
        yield
    finally:
        for place in (folder / RECORDS_FOLDER / SCRATCH, folder / RECORDS_FOLDER):
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def _analyse(job: Job, scratch: Path, processes: ForkServer, on_message: OnMessage) -> Record:
    before = file_state(Path(job.source.place))
    with suppress(Died):  # a filter that crashes here also crashes the log's process, which reports it
        processes.prepare(load_shared, list(job.config.estimators), on_message=on_message)
    found: dict[str, Any]
    with processes.worker() as worker:
        started = time.monotonic()
        try:
            found = worker.call(
                process_log,
                job,
                scratch,
                seconds=job.timeout or 0.0,
                memory_mb=job.memory or 0.0,
                on_message=on_message,
            )
        except Died as died:
            code, why = _why(died, file_state(Path(job.source.place)) != before)
            found = {"code": code, "message": f"attlog: {job.source.name}: {why}"}
            if code != LIMIT_REACHED:
                with suppress(OSError):
                    printed = (scratch / PRINTED).read_text(encoding="utf-8", errors="replace")
                    found["trace"] = printed[-4000:]
        seconds, took = time.monotonic() - started, worker.end()
    if processes.closed:
        raise Closed
    if "key" not in found:
        found["key"] = content_key(job)
    found |= {"wall_s": round(seconds, 3), "cpu_s": round(took.cpu_s, 3), "peak_mb": round(took.peak_mb, 1)}
    return Record(job.source.name, job.name, **found)


def _why(died: Died, changed: bool) -> tuple[int, str]:
    """Return exit code and reason of a process that died without a result."""
    if isinstance(died, TooLong):
        return LIMIT_REACHED, f"{died}; --timeout allows more, 0 any time"
    if isinstance(died, TooMuchMemory):
        return LIMIT_REACHED, f"{died}; --memory allows more, --boot or fewer --estimators need less"
    ended = died.exit
    if ended.signal == "SIGBUS" and changed:
        return LogUnreadable.exit_code, CHANGED  # the file was truncated while mapped into memory
    if ended.signal == "SIGKILL":
        return EXIT_BUG, f"its process {ended}; fewer --jobs or a limit by --memory leaves room for the others"
    if ended.crashed:
        return EXIT_BUG, (
            f"its process {ended}; a filter of yours or a bug in attlog {__version__} or its libraries: please report "
            "it with the output of -vv"
        )
    return EXIT_BUG, f"its process {ended}" + ("; -vv shows what it said last" if ended.status is not None else "")


def publish(job: Job, before: Record | None, made: Mapping[str, Path | bytes]) -> None:
    """Move files into place, or write their content, each atomically and the JSON last.

    They replace what the record ``before`` holds, and reports of the same log. OutputError on failure: nothing is
    replaced where a file is another's; where a disk fails in between, the JSON is still that of the earlier run.
    """
    known = before.files if before else {}
    result = made.get(f"{job.name}.json")
    log = "" if result is None else hash_named_in(result if isinstance(result, bytes) else result.read_bytes())
    kind = kind_of_report(Path(job.source.place), log, job.folder / f"{job.name}.json")
    names = sorted(made, key=lambda name: (name.endswith(".json"), name))
    for name in names:
        place = job.folder / name
        if name not in known or size_and_hash(place) != known[name]:
            require_replaceable(place, kind)
    for name in names:
        place, content = job.folder / name, made[name]
        if isinstance(content, bytes):
            write_atomic(place, content, REPORT)
            continue
        try:
            content.replace(place)
        except OSError as error:
            raise OutputError(f"{place}: cannot be written ({error.strerror}); choose another place with -o") from error
