"""Several logs to files, one after the other or in several processes: what became of each, as it comes."""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from attlog import __version__
from attlog.errors import BUG, exit_code, message
from attlog.fleet.one import Written, analyze_to_files
from attlog.processes import Died, in_processes

if TYPE_CHECKING:
    from attlog.config import Config


@dataclass(frozen=True, slots=True)
class Task:
    """How every log is treated; the arguments of :func:`attlog.fleet.one.analyze_to_files`."""

    config: Config
    folder: Path
    command: str = ""
    plotly: Literal["inline", "shared"] = "inline"
    deterministic: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a log: the files written, or ``code`` and ``message``; ``trace`` of a bug."""

    log: Path
    written: Written | None = None
    code: int = 0
    message: str = ""
    trace: str = ""


def outcome(log: Path, name: str, task: Task) -> Outcome:
    """Analyse one log to files; whatever goes wrong, a bug too, is told by the outcome."""
    try:
        return Outcome(log, analyze_to_files(
            log, task.config, task.folder, name,
            command=task.command, plotly=task.plotly, deterministic=task.deterministic,
        ))  # fmt: skip
    except Exception as error:
        return failed(log, error)


def failed(log: Path, error: Exception) -> Outcome:
    """The outcome of a log whose analysis raised this."""
    code = exit_code(error)
    trace = "".join(traceback.format_exception(error)) if code == BUG else ""
    return Outcome(log, None, code, message(error, __version__, str(log)), trace)


def outcomes(logs: Sequence[Path], names: Sequence[str], task: Task, jobs: int = 1) -> Iterator[Outcome]:
    """The outcome of every log: in order with one job, else as they come from ``jobs`` processes.

    From a process comes the result without traces. A process that dies (out of memory,
    a plug-in that crashes) costs its own log alone. Processes end with the caller's loop,
    also where that is interrupted.
    """
    if jobs == 1 or len(logs) == 1:
        for log, name in zip(logs, names, strict=True):
            yield outcome(log, name, task)
        return
    work = {log: (log, name, task) for log, name in zip(logs, names, strict=True)}
    for log, found in in_processes(_without_traces, work, jobs):
        yield Outcome(log, None, BUG, message(found, __version__, str(log))) if isinstance(found, Died) else found


def _without_traces(log: Path, name: str, task: Task) -> Outcome:
    found = outcome(log, name, task)
    if found.written is None:
        return found
    from attlog.result import Result

    return replace(found, written=replace(found.written, result=Result.load(found.written.json)))
