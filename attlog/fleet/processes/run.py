"""One log in a process of its own, within limits of time and memory: from work to record."""

from __future__ import annotations

import secrets
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.base.errors import BUG, LogUnreadable, OutputError, exit_code, message, no_more_processes
from attlog.base.output import is_full
from attlog.fleet.processes.memory import resident_mb
from attlog.fleet.processes.nursery import Closed, Nursery, shared
from attlog.fleet.records.record import INSIDE, Record, read_record
from attlog.fleet.records.work import Work, content_key, done_before, keep
from attlog.fleet.sources.unchanged import CHANGED, state

LIMIT_REACHED = 75
"""Exit code of a log that took more time or memory than it was given."""
CRASHES = 0xC0000000
"""From here on exit statuses of Windows are crashes."""
A_DAY_S = 86_400.0
PAUSE_S = 0.05
"""How often a process is looked at: memory fills with some GB/s at most, so a limit is overrun by 0.1 GB or so."""


def run_one(work: Work, nursery: Nursery | None = None, tell: Callable[[dict[str, Any]], None] | None = None) -> Record:
    """Analyse one log in a child process, put its files in place, and keep and return its record.

    Never raises for what a log, its process or the folder does: that is told by the record. A child only ever
    writes to a room of its own inside the folder; files are moved from there whole, so an orphan writes to
    nobody's report. ``tell`` hears the child's stages, and in silence an empty message now and
    then; what it raises ends the child. :class:`attlog.fleet.processes.nursery.Closed` if the nursery is closed.
    """
    if work.resume:
        before = done_before(work)
        if before is not None:
            return before
    log = work.source.name
    room = work.folder / INSIDE / "rooms" / secrets.token_hex(8)
    try:
        (room / "out").mkdir(parents=True)
        record = _analysed(work, room, nursery or shared(), tell or _nobody)
        if record.done:
            _publish(room / "out", work.folder)
        if work.keep:
            _remove_outdated(work, record)
            record = keep(work, record)
    except (OSError, OutputError) as error:
        told: Exception = error
        if isinstance(error, OSError) and not no_more_processes(error):
            told = OutputError(f"{work.folder}: cannot be written ({error.strerror})")
        record = Record(
            log,
            work.name,
            code=exit_code(told),
            message=message(told, __version__, log),
            folder_full=is_full(error if isinstance(error, OSError) else error.__cause__),
        )
    finally:
        shutil.rmtree(room, ignore_errors=True)
    return record


@contextmanager
def tidied(folder: Path) -> Iterator[None]:
    """A block whose work keeps no records: afterwards nothing but reports is left in the folder.

    Others may be at work there, so of runs that were killed only what is a day old is removed.
    """
    for room in (folder / INSIDE / "rooms").glob("*"):
        before = state(room)
        if before is not None and time.time() - before[1] / 1e9 > A_DAY_S:
            shutil.rmtree(room, ignore_errors=True)
    try:
        yield
    finally:
        for place in (folder / INSIDE / "rooms", folder / INSIDE):
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def _nobody(_: dict[str, Any]) -> None:
    """Hears nothing."""


def _analysed(work: Work, room: Path, nursery: Nursery, tell: Callable[[dict[str, Any]], None]) -> Record:
    """The record that a child process told, or what became of the process."""
    log = work.source.name
    before = state(Path(work.source.place))
    told: dict[str, Any] = {}
    ended: dict[str, Any] = {}
    pid, limit, started = 0, "", time.monotonic()
    with nursery.child(work, room) as child:
        for said in child.messages(PAUSE_S if work.memory else 0.5):
            if "pid" in said:
                pid, started = said["pid"], time.monotonic()
            elif "exit" in said:
                ended = said
            elif "key" in said:
                told = said
            else:
                tell(said)
            if pid and not limit and not ended:
                limit = _beyond(work, time.monotonic() - started, pid)
                if limit:
                    child.kill()
    if nursery.closed:
        raise Closed
    measured = {
        "wall_s": round(time.monotonic() - started, 3),
        "cpu_s": round(ended.get("cpu_s", 0.0), 3),
        "peak_mb": round(ended.get("peak_mb", 0.0), 1),
    }
    if limit:
        return Record(log, work.name, content_key(work), LIMIT_REACHED, f"attlog: {log}: {limit}", **measured)
    if told:
        told["files"] = {name: (size, digest) for name, (size, digest) in told.get("files", {}).items()}
        return Record(log, work.name, **told, **measured)
    code, why = _died(ended.get("exit"), state(Path(work.source.place)) != before)
    return Record(log, work.name, content_key(work), code, f"attlog: {log}: {why}", trace=_said(room), **measured)


def _beyond(work: Work, seconds: float, pid: int) -> str:
    """Which limit the process is beyond, in words; empty within all."""
    if work.timeout and seconds > work.timeout:
        return f"took longer than {work.timeout:g} s and was ended; --timeout allows more, 0 any time"
    if work.memory:
        held = resident_mb(pid)
        if held > work.memory:
            return (
                f"needed more than {work.memory:g} MB of memory ({held:.0f} MB when it was ended); "
                "--memory allows more, --boot or fewer --estimators need less"
            )
    return ""


def _died(status: int | None, changed: bool) -> tuple[int, str]:
    """Exit code and sentence for a process that ended without a result."""
    signalled = _signal(status)
    if signalled == "SIGBUS" and changed:
        return LogUnreadable.exit_code, CHANGED  # a file that is cut while it is mapped into memory
    if signalled == "SIGKILL":
        return BUG, (
            "its process was killed from outside (signal 9), as systems do when memory runs out; "
            "fewer --jobs or a limit by --memory leaves room for the others"
        )
    if status is None:
        return BUG, "its process is gone without a word, and so is the one that started it"
    if signalled or status >= CRASHES:
        return BUG, (
            f"its process crashed ({signalled or hex(status)}); a filter of yours or a bug in attlog "
            f"{__version__} or its libraries: please report it with the output of -vv"
        )
    return BUG, f"its process ended without a word (exit status {status}); -vv shows what it said last"


def _signal(status: int | None) -> str:
    """The name of the signal that ended a process; empty if none did. Not every system knows every signal."""
    return {-known.value: known.name for known in signal.Signals}.get(status or 0, "")


def _said(room: Path) -> str:
    """The last lines that a process wrote to its standard output and error: where it crashed."""
    try:
        return (room / "said.txt").read_text(encoding="utf-8", errors="replace")[-4000:]
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
