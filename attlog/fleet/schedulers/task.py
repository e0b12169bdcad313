"""What a task of a cluster does with one log: fetch or find it, analyse it in a child process, return the files."""

from __future__ import annotations

import os
import pickle
import socket
import tempfile
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from attlog import __version__
from attlog.base.errors import AttlogError
from attlog.fleet.processes.run import run_one
from attlog.fleet.records.record import Record
from attlog.fleet.records.work import Work, files_of
from attlog.fleet.sources.remote import is_url
from attlog.fleet.sources.source import Source


class OtherVersion(Exception):
    """The worker runs another attlog than the client."""


class Unseen(Exception):
    """The worker does not see a file that the configuration names."""


class Cancelled(Exception):
    """Nobody waits for the task any more."""


@dataclass(frozen=True, slots=True)
class TaskResult:
    """Record and files (name: bytes) of a log; without record: the worker does not see the log's file."""

    record: Record | None
    files: dict[str, bytes] = field(default_factory=dict)


def sign(source: Source) -> str:
    """What a worker must find under the same path to have the same file; empty for a URL, which all can fetch."""
    if is_url(source.place):
        return ""
    try:
        return Source(source.place).stamp()
    except AttlogError:
        return ""  # missing here too: whoever reads it says so


def do(version: str, order: bytes, signed: str, have: Collection[str] = (), content: bytes | None = None) -> TaskResult:
    """Analyse one log. ``order``: the pickled :class:`Work` of an attlog of that version; ``signed``: see :func:`sign`;
    ``have``: files beside reports that the client has; ``content``: the log's bytes where this machine lacks its file.

    Nothing stays on the machine. OtherVersion if ``version`` is not this one; Unseen.
    """
    if version != __version__:
        raise OtherVersion(__version__)
    work: Work = pickle.loads(order)
    unseen = [name for name in files_of(work.config) if not os.path.isfile(name)]
    if unseen:
        raise Unseen(unseen[0])
    if content is None and signed and sign(work.source) != signed:
        return TaskResult(None)
    with tempfile.TemporaryDirectory(prefix="attlog-") as room:
        source = work.source
        if content is not None:
            path = Path(room) / "log" / source.file_name
            path.parent.mkdir()
            path.write_bytes(content)
            source = replace(source, copy=str(path))
        out = Path(room) / "out"
        record = run_one(replace(work, source=source, folder=out, resume=False, keep=False), tell=_unless_cancelled())
        if record.folder_full:  # this machine's trouble, not that of the folder where reports are kept
            log = work.source.name
            why = f"no room in {tempfile.gettempdir()} of the worker {socket.gethostname()}"
            return TaskResult(replace(record, folder_full=False, message=f"attlog: {log}: {why}"))
        written = [path for path in out.iterdir() if os.path.isfile(path) and path.name not in have]
        return TaskResult(record, {path.name: path.read_bytes() for path in written})


def _unless_cancelled() -> Callable[[dict[str, Any]], None]:
    """Hears what the child tells, and ends it with Cancelled where the client went away."""
    from distributed import get_worker

    try:
        worker = get_worker()
        key = worker.get_current_task()
    except ValueError:  # no task: called by itself
        return lambda _: None

    def stop_if_cancelled(_: dict[str, Any]) -> None:
        task = worker.state.tasks.get(key)
        if task is None or task.state == "cancelled":
            raise Cancelled

    return stop_if_cancelled
