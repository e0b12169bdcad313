"""What a task of a cluster does with one log: fetch or find it, analyse it in a child process, return the files."""

from __future__ import annotations

import logging
import os
import pickle
import secrets
import socket
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from attlog import __version__
from attlog.batch.job import Record, Work, done_before, files_of, keep
from attlog.batch.process import run_one
from attlog.batch.remote import is_url
from attlog.batch.sources import Source
from attlog.core.errors import EXIT_BUG, AttlogError, ClusterError, OutputError, UsageError, error_message
from attlog.core.files import is_disk_full, write_atomic


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


# The same work as tasks of a Dask cluster: what became of each log, as it comes; the files come with it.
#
# A task is one log: it fetches the log where it runs, starts the same child process as a batch on
# one machine and returns record and files as bytes, so client and workers share no file system.
# A log that lies on the client's disk alone is sent along.

PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
CONNECT_S = 5.0
"""A scheduler that is there answers in milliseconds."""
WORKERS_S = 300.0
"""Clusters that grow on demand start their first worker within minutes of the first task."""
LOOK_S = 2.0
"""How often the cluster is looked at while no log ends."""
CLOSE_S = 5.0
START = "dask worker tcp://host:8786"
AHEAD = 2
"""Tasks in the cluster for each that can run: none waits for the client, and no more results wait for it either."""
ATTEMPTS = 3
"""At a log whose bytes were sent to a worker that went away."""


def cluster_runner(
    address: str, at_once: int | None = None, say: Callable[[str], None] | None = None
) -> Callable[[Sequence[Work]], Generator[Record, None, None]]:
    """A runner on the cluster of that scheduler, see :func:`records_of`."""
    return lambda works: records_of(address, works, at_once, say)


def records_of(
    address: str, works: Sequence[Work], at_once: int | None = None, say: Callable[[str], None] | None = None
) -> Generator[Record, None, None]:
    """What became of every log, as it comes from the cluster; its files and its record are in place before.

    ``at_once``: tasks in the cluster at a time, by default twice what it can run. ``say`` hears what there is to wait
    for. A worker that dies costs its logs another attempt elsewhere (as many as the scheduler allows) and becomes
    a record in the end. ClusterError: nobody answers, no worker comes, or the scheduler goes away; UsageError:
    packages or versions do not fit. Tasks are cancelled with the caller's loop, also where that is interrupted.
    """
    todo = iter(works)
    for work in todo:
        before = _before(work)
        if before is None:  # from here on a cluster is needed
            with _client(address) as client:
                yield from _Run(client, address, at_once, say or _nobody).records(chain([work], todo))
            return
        yield before


class _Run:
    """The tasks of one batch on one cluster."""

    def __init__(self, client: Any, address: str, at_once: int | None, say: Callable[[str], None]) -> None:
        self._client, self._address, self._at_once, self._say = client, address, at_once, say
        self._token = secrets.token_hex(4)
        self._count = 0
        self._send = False
        """Whether logs are sent along, because a worker did not see one."""
        self._beside: set[str] = set()
        """Files that stand beside all reports and came with the first."""
        self._at_work: dict[str, tuple[Any, Work, int]] = {}
        self._ended: SimpleQueue[str] = SimpleQueue()

    def records(self, todo: Iterator[Work]) -> Iterator[Record]:
        self._fits()
        try:
            while True:
                record = self._more(todo)
                if record is None and not self._at_work:
                    return
                if record is None:
                    record = self._became(*self._at_work.pop(self._next()))
                if record is not None:
                    yield record
        except OSError as error:  # of a connection: what goes wrong with files is in records
            raise self._gone() from error
        finally:
            if self._client.status == "running":
                self._client.cancel([future for future, _, _ in self._at_work.values()], force=True)

    def _next(self) -> str:
        """The key of a task that ended."""
        silent_since = None
        while True:
            try:
                return self._ended.get(timeout=LOOK_S)
            except Empty:
                self._there()
            if self._client.nthreads():
                silent_since = None
            elif silent_since is None:
                silent_since = time.monotonic()
                self._say(f"{self._address}: the scheduler has no worker; waiting for one")
            elif time.monotonic() - silent_since > WORKERS_S:
                raise ClusterError(f"{self._address}: no worker for {WORKERS_S:.0f} s; start some: {START}")

    def _more(self, todo: Iterator[Work]) -> Record | None:
        """Hand out work until the cluster has enough, or a log comes that was done before: its record."""
        enough = self._at_once or AHEAD * max(sum(self._client.nthreads().values()), 1)
        while len(self._at_work) < enough and (work := next(todo, None)) is not None:
            before = _before(work)
            if before is not None:
                return before
            self._submit(work, 1)
        return None

    def _submit(self, work: Work, attempt: int) -> None:
        signed, content = sign(work.source), None
        if self._send and signed:
            try:
                with work.source.local() as log:
                    content = self._client.scatter(log.path.read_bytes(), hash=False)
            except (AttlogError, OSError) as error:
                # Not even here: a worker tells it in the words of every other log.
                logging.getLogger("attlog.batch").info("%s: %s", work.source.name, error)
                signed = ""
        self._count += 1
        key = f"attlog-{self._token}-{self._count}"
        arguments = __version__, pickle.dumps(work), signed, sorted(self._beside), content
        future = self._client.submit(_doing(), *arguments, key=key, pure=False)
        self._at_work[key] = future, work, attempt
        future.add_done_callback(lambda ended: self._ended.put(ended.key))

    def _became(self, future: Any, work: Work, attempt: int) -> Record | None:
        """The record of a task that ended; None where the log gets another attempt."""
        if future.status == "finished":
            returned: TaskResult = future.result()
            if returned.record is not None:
                self._beside |= set(returned.files) - set(returned.record.files)
                return _kept(work, returned.record, returned.files)
            self._send = True
            self._submit(work, attempt)
            return None
        if future.status == "error":
            error = future.exception()
            if isinstance(error, ImportError | OtherVersion):
                self._fits()
            if isinstance(error, Unseen):
                raise UsageError(
                    f"a worker does not see {error}; files that options name have to lie on every worker under the "
                    "same path: name them by an absolute one"
                )
            return _kept(work, _failed(work, error), {})
        self._there()
        if attempt < ATTEMPTS:  # a worker that went away with the bytes that were sent to it
            self._submit(work, attempt + 1)
            return None
        return _kept(work, _failed(work, RuntimeError(f"its task was lost {attempt} times")), {})

    def _there(self) -> None:
        """ClusterError where the scheduler is gone."""
        if self._client.status != "running":
            raise self._gone()

    def _gone(self) -> ClusterError:
        return ClusterError(
            f"{self._address}: the scheduler is gone; what was finished is kept, the same command with --resume "
            "does the rest"
        )

    def _fits(self) -> None:
        """UsageError where a worker does not fit to this side."""
        for worker, told in self._client.get_versions()["workers"].items():
            there = ".".join(told["host"]["python"].split(".")[:2])
            if there != PYTHON:
                raise UsageError(f"worker {worker} runs Python {there} and this side {PYTHON}; use the same on both")
        for worker, version in self._client.run(_asking(), on_error="return").items():
            if isinstance(version, Exception):
                continue  # it went away meanwhile
            if version is None:
                raise UsageError(f"worker {worker} has no attlog; install attlog {__version__} there")
            if version != __version__:
                raise UsageError(f"worker {worker} has attlog {version} and this side {__version__}; use one version")


def _before(work: Work) -> Record | None:
    """The record of an earlier run, where the work asks for it and it still holds."""
    return done_before(work) if work.resume else None


def _doing() -> Callable[..., TaskResult]:
    """A function that travels by value: the scheduler, which reads every task, needs no attlog."""

    def run_task(*arguments: Any) -> Any:
        from attlog.batch import cluster

        return cluster.do(*arguments)

    return run_task


def _asking() -> Callable[[], str | None]:
    """A function that travels by value, because it must run where there is no attlog."""

    def version() -> str | None:
        try:
            import attlog
        except ImportError:
            return None
        return attlog.__version__

    return version


def _kept(work: Work, record: Record, files: dict[str, bytes]) -> Record:
    """The record, after its files are in place; the JSON last, which others wait for."""
    try:
        for name in sorted(files, key=lambda name: (name.endswith(".json"), name)):
            write_atomic(work.folder / name, files[name])
        if work.keep:
            return keep(work, record)
    except OutputError as error:
        return Record(
            work.source.name,
            work.name,
            code=error.exit_code,
            message=error_message(error, __version__, work.source.name),
            folder_full=is_disk_full(error.__cause__),
        )
    return record


def _failed(work: Work, error: Exception) -> Record:
    """The record of a log whose task failed outside of the child process."""
    from distributed import KilledWorker

    log = work.source.name
    if isinstance(error, KilledWorker):
        why = (
            f"the workers that had it died, one after the other ({error.last_worker.address} last): killed from "
            "outside, out of memory or restarted; their own logs say why"
        )
        return Record(log, work.name, code=EXIT_BUG, message=f"attlog: {log}: {why}")
    trace = "".join(traceback.format_exception(error))
    return Record(log, work.name, code=EXIT_BUG, message=error_message(error, __version__, log), trace=trace)


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A connection to a scheduler. UsageError without the packages or for a bad address, ClusterError: no answer."""
    try:
        import distributed as dask
    except ImportError as error:
        raise UsageError(
            f"--scheduler needs dask and distributed ({error}): pip install dask distributed, "
            'or pip install ".[cluster]" in the source folder'
        ) from None
    library = logging.getLogger("distributed")
    before = library.level
    library.setLevel(logging.CRITICAL)  # what matters is told in our words
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dask.versions.VersionMismatchWarning)
            # A client that cannot be made prints a traceback when it is collected.
            dask.comm.addressing.resolve_address(address)
            connect: Any = dask.Client
            client = connect(address, timeout=CONNECT_S, set_as_default=False, name="attlog")
    except ValueError as error:
        library.setLevel(before)
        raise UsageError(f"--scheduler {address}: {error}; it looks like tcp://host:8786") from None
    except (OSError, TimeoutError, AssertionError) as error:  # the last: no start of its loop on a very busy machine
        library.setLevel(before)
        raise ClusterError(f"--scheduler {address}: no Dask scheduler answers there ({error})") from None
    try:
        yield client
    finally:
        client.close(timeout=CLOSE_S)
        library.setLevel(before)


def _nobody(_: str) -> None:
    """Hears nothing."""
