"""Several logs to files, one after the other or in several processes: what became of each, as it comes."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from attlog import __version__
from attlog.errors import BUG, exit_code, message
from attlog.fleet.one import Written, analyze_to_files

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
    waiting = dict(zip(logs, names, strict=True))
    for found in _in_processes(waiting, task, min(jobs, len(logs))):
        del waiting[found.log]
        yield found
    for log, name in waiting.items():  # a process died, which ends all of its pool: who was it?
        alone = next(_in_processes({log: name}, task, 1), None)
        yield alone or Outcome(
            log, None, BUG, message(_Died("the process ended without a word"), __version__, str(log))
        )


class _Died(Exception):
    """A process that is gone."""


def _in_processes(names: dict[Path, str], task: Task, jobs: int) -> Iterator[Outcome]:
    """Outcomes from a pool of processes, until one of them dies."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _leave_interrupts_to_the_parent)
    try:
        futures: list[Future[Outcome]] = [pool.submit(_without_traces, log, name, task) for log, name in names.items()]
        for future in as_completed(futures):
            try:
                yield future.result()
            except BrokenProcessPool:
                continue  # outcomes that were finished before still come
        pool.shutdown()
    finally:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()  # an interrupted analysis would go on for minutes
            child.join()
        pool.shutdown(wait=False, cancel_futures=True)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _without_traces(log: Path, name: str, task: Task) -> Outcome:
    found = outcome(log, name, task)
    if found.written is None:
        return found
    from attlog.result import Result

    return replace(found, written=replace(found.written, result=Result.load(found.written.json)))
