"""Jobs as tasks of a Dask cluster.

Each task returns its record and files, so machines share no file system.
"""

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
from dataclasses import replace
from itertools import chain
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from attlog import __version__
from attlog.batch.job import Job, Record, done_before, files_of, keep, read_record
from attlog.batch.process import failed_record, publish, run_one
from attlog.batch.remote import is_url
from attlog.batch.sources import Source
from attlog.core.errors import EXIT_BUG, AttlogError, ClusterError, OutputError, UsageError
from attlog.core.files import is_disk_full

# Client and workers need the same Python version, because jobs are pickled.
PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
# Timeout of the connection: a scheduler answers in milliseconds.
CONNECT_S = 5.0
# Wait for the first worker: clusters that grow on demand start it within minutes of the first task.
NO_WORKER_TIMEOUT_S = 300.0
# Time between two checks of the cluster while no task ends.
CHECK_S = 2.0
CLOSE_S = 5.0
START = "dask worker tcp://host:8786"
# Submitted tasks per task that can run at once: workers never wait for the client, and few results pile up.
JOBS_AHEAD = 2
# Attempts at a log whose worker disappeared after its bytes were sent.
MAX_ATTEMPTS = 3

# Record and files (name: bytes) of a log. The record is None if the worker cannot read the log's file.
TaskResult = tuple[Record | None, dict[str, bytes]]


class OtherVersion(Exception):
    """The worker has a different attlog version from the client."""


class Unseen(Exception):
    """The worker cannot read a file named in the configuration."""


class Cancelled(Exception):
    """The client cancelled the task."""


def file_sign(source: Source) -> str:
    """Return a fingerprint of the worker's file; empty for a URL."""
    if is_url(source.place):
        return ""
    try:
        return Source(source.place).stamp()
    except AttlogError:
        return ""  # missing on both machines: the error appears when the log is read


def run_task(
    version: str, pickled: bytes, sign: str, have: Collection[str] = (), content: bytes | None = None
) -> TaskResult:
    """Analyse one log on a worker, which keeps no files.

    ``pickled``: the :class:`Job`, of attlog ``version``. ``sign``: see :func:`file_sign`. ``have``: names of shared
    files that the client already has. ``content``: the log's bytes if the worker lacks its file. Raises OtherVersion,
    Unseen.
    """
    if version != __version__:
        raise OtherVersion(__version__)
    job: Job = pickle.loads(pickled)
    unseen = [name for name in files_of(job.config) if not os.path.isfile(name)]
    if unseen:
        raise Unseen(unseen[0])
    if content is None and sign and file_sign(job.source) != sign:
        return None, {}
    with tempfile.TemporaryDirectory(prefix="attlog-") as scratch:
        source = job.source
        if content is not None:
            path = Path(scratch) / "log" / source.file_name
            path.parent.mkdir()
            path.write_bytes(content)
            source = replace(source, copy=str(path))
        out = Path(scratch) / "out"
        record = run_one(job._replace(source=source, folder=out, resume=False, keep=False), on_message=_cancellation())
        if record.folder_full:  # the disk of the worker, not the folder of the reports
            why = f"no room in {tempfile.gettempdir()} of the worker {socket.gethostname()}"
            return replace(record, folder_full=False, message=f"attlog: {job.source.name}: {why}"), {}
        made = [path for path in out.iterdir() if os.path.isfile(path) and path.name not in have]
        return record, {path.name: path.read_bytes() for path in made}


def _cancellation() -> Callable[[dict[str, Any]], None]:
    """Return a callback that raises Cancelled once the client has disconnected."""
    from distributed import get_worker

    try:
        worker = get_worker()
        key = worker.get_current_task()
    except ValueError:  # called outside a task
        return lambda _: None

    def stop_if_cancelled(_: dict[str, Any]) -> None:
        task = worker.state.tasks.get(key)
        if task is None or task.state == "cancelled":
            raise Cancelled

    return stop_if_cancelled


def cluster_runner(
    address: str, at_once: int | None = None, say: Callable[[str], None] = lambda _: None
) -> Callable[[Sequence[Job]], Generator[Record, None, None]]:
    """Return a runner on the cluster of a scheduler.

    The runner writes the files and record of a log before it yields the record. ``at_once``: tasks in the cluster at a
    time, default twice the number that can run. ``say`` receives messages about waiting. Logs of a dead worker are
    retried elsewhere, as often as the scheduler allows. ClusterError: no answer, no worker, or the scheduler is gone.
    UsageError: incompatible packages or versions. Closing the runner cancels its tasks.
    """

    def run(jobs: Sequence[Job]) -> Generator[Record, None, None]:
        todo = iter(jobs)
        for job in todo:
            if before := done_before(job):
                yield before
                continue
            with _client(address) as client:  # needed from here on
                yield from _Run(client, address, at_once, say).records(chain([job], todo))

    return run


class _Run:
    """Tasks of one batch on one cluster."""

    def __init__(self, client: Any, address: str, at_once: int | None, say: Callable[[str], None]) -> None:
        self._client, self._address, self._at_once, self._say = client, address, at_once, say
        self._token = secrets.token_hex(4)
        self._count = 0
        self._send = False  # True once a worker could not read a log: logs are sent along
        self._beside: set[str] = set()  # names of the files shared by all reports, received with the first log
        self._at_work: dict[str, tuple[Any, Job, int]] = {}
        self._ended: SimpleQueue[str] = SimpleQueue()

    def records(self, todo: Iterator[Job]) -> Iterator[Record]:
        self._check_versions()
        try:
            while True:
                record = self._fill(todo)
                if record is None and not self._at_work:
                    return
                if record is None:
                    record = self._collect(*self._at_work.pop(self._next_key()))
                if record is not None:
                    yield record
        except OSError as error:  # connection lost: file errors are in the records
            raise self._lost() from error
        finally:
            if self._client.status == "running":
                self._client.cancel([future for future, _, _ in self._at_work.values()], force=True)

    def _next_key(self) -> str:
        """Wait for a task to end and return its key."""
        silent_since = None
        while True:
            try:
                return self._ended.get(timeout=CHECK_S)
            except Empty:
                self._check_scheduler()
            if self._client.nthreads():
                silent_since = None
            elif silent_since is None:
                silent_since = time.monotonic()
                self._say(f"{self._address}: the scheduler has no worker; waiting for one")
            elif time.monotonic() - silent_since > NO_WORKER_TIMEOUT_S:
                raise ClusterError(f"{self._address}: no worker for {NO_WORKER_TIMEOUT_S:.0f} s; start some: {START}")

    def _fill(self, todo: Iterator[Job]) -> Record | None:
        """Submit jobs until the cluster is full; return a record finished earlier."""
        enough = self._at_once or JOBS_AHEAD * max(sum(self._client.nthreads().values()), 1)
        while len(self._at_work) < enough and (job := next(todo, None)) is not None:
            if before := done_before(job):
                return before
            self._submit(job, 1)
        return None

    def _submit(self, job: Job, attempt: int) -> None:
        sign, content = file_sign(job.source), None
        if self._send and sign:
            try:
                with job.source.local() as log:
                    content = self._client.scatter(log.path.read_bytes(), hash=False)
            except (AttlogError, OSError) as error:
                # unreadable here too: the worker reports the error, as for any other log
                logging.getLogger("attlog.batch").info("%s: %s", job.source.name, error)
                sign = ""
        self._count += 1
        key = f"attlog-{self._token}-{self._count}"
        arguments = __version__, pickle.dumps(job), sign, sorted(self._beside), content
        future = self._client.submit(_task(), *arguments, key=key, pure=False)
        self._at_work[key] = future, job, attempt
        future.add_done_callback(lambda ended: self._ended.put(ended.key))

    def _collect(self, future: Any, job: Job, attempt: int) -> Record | None:
        """Return the record of a finished task; None if the log is retried."""
        if future.status == "finished":
            record, files = future.result()
            if record is not None:
                self._beside |= set(files) - set(record.files)
                return _store(job, record, files)
            self._send = True
            self._submit(job, attempt)
            return None
        if future.status == "error":
            error = future.exception()
            if isinstance(error, ImportError | OtherVersion):
                self._check_versions()
            if isinstance(error, Unseen):
                raise UsageError(
                    f"a worker does not see {error}; files that options name have to lie on every worker under the "
                    "same path: name them by an absolute one"
                )
            return _store(job, _failed(job, error), {})
        self._check_scheduler()
        if attempt < MAX_ATTEMPTS:  # the worker that received the bytes has disappeared
            self._submit(job, attempt + 1)
            return None
        return _store(job, _failed(job, RuntimeError(f"its task was lost {attempt} times")), {})

    def _check_scheduler(self) -> None:
        """Raise ClusterError if the scheduler is gone."""
        if self._client.status != "running":
            raise self._lost()

    def _lost(self) -> ClusterError:
        return ClusterError(
            f"{self._address}: the scheduler is gone; what was finished is kept, the same command with --resume "
            "does the rest"
        )

    def _check_versions(self) -> None:
        """Raise UsageError for a worker with a different Python or attlog."""
        for worker, about in self._client.get_versions()["workers"].items():
            there = ".".join(about["host"]["python"].split(".")[:2])
            if there != PYTHON:
                raise UsageError(f"worker {worker} runs Python {there} and this side {PYTHON}; use the same on both")
        for worker, version in self._client.run(_version_query(), on_error="return").items():
            if isinstance(version, Exception):
                continue  # the worker disappeared meanwhile
            if version is None:
                raise UsageError(f"worker {worker} has no attlog; install attlog {__version__} there")
            if version != __version__:
                raise UsageError(f"worker {worker} has attlog {version} and this side {__version__}; use one version")


def _task() -> Callable[..., TaskResult]:
    """Return the task function, pickled by value.

    The scheduler deserialises every task and needs no attlog this way.
    """

    def run(*arguments: Any) -> Any:
        from attlog.batch import cluster

        return cluster.run_task(*arguments)

    return run


def _version_query() -> Callable[[], str | None]:
    """Return a version query, pickled by value, for workers without attlog."""

    def version() -> str | None:
        try:
            import attlog
        except ImportError:
            return None
        return attlog.__version__

    return version


def _store(job: Job, record: Record, files: dict[str, bytes]) -> Record:
    """Write files and record of a log, the JSON last."""
    try:
        before = read_record(job.folder, job.name) if job.keep else None
        publish(job, before, files)
        return keep(job, record, before) if job.keep else record
    except OutputError as error:
        return failed_record(job, error, is_disk_full(error.__cause__))


def _failed(job: Job, error: Exception) -> Record:
    """Return the record of a log whose task failed outside the child process."""
    from distributed import KilledWorker

    log = job.source.name
    if isinstance(error, KilledWorker):
        why = (
            f"the workers that had it died, one after the other ({error.last_worker.address} last): killed from "
            "outside, out of memory or restarted; their own logs say why"
        )
        return Record(log, job.name, code=EXIT_BUG, message=f"attlog: {log}: {why}")
    trace = "".join(traceback.format_exception(error))
    return replace(failed_record(job, error), code=EXIT_BUG, trace=trace)


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """Connect to a scheduler. UsageError: missing packages, bad address; ClusterError: no answer."""
    try:
        import distributed as dask
    except ImportError as error:
        raise UsageError(
            f"--scheduler needs dask and distributed ({error}): pip install dask distributed, "
            'or pip install ".[cluster]" in the source folder'
        ) from None
    library = logging.getLogger("distributed")
    before = library.level
    library.setLevel(logging.CRITICAL)  # errors are reported in our own words
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dask.versions.VersionMismatchWarning)
            # First: a client that cannot be made prints a traceback when it is collected.
            dask.comm.addressing.resolve_address(address)
            connect: Any = dask.Client
            client = connect(address, timeout=CONNECT_S, set_as_default=False, name="attlog")
    except ValueError as error:
        library.setLevel(before)
        raise UsageError(f"--scheduler {address}: {error}; it looks like tcp://host:8786") from None
    except (OSError, TimeoutError, AssertionError) as error:  # AssertionError: its event loop did not start
        library.setLevel(before)
        raise ClusterError(f"--scheduler {address}: no Dask scheduler answers there ({error})") from None
    try:
        yield client
    finally:
        client.close(timeout=CLOSE_S)
        library.setLevel(before)
