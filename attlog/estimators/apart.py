"""A filter that is not ours, in a process of its own: whatever it does, it does to that process alone.

Its code may raise, loop for ever, write beyond its arrays, end its process, take all memory or print. The process that
asked goes on: what came of it is a value, or a PluginError that says what happened. What the file prints, at whatever
moment, goes to standard error; it reads nothing. A process serves one file (or one filter of an installed package) and
many requests, so that a filter is loaded and compiled once; it is a fresh interpreter, which takes a few tenths of a
second and works in threads, on a cluster and on Windows alike. Requests and answers are pickles, because the filter is
chosen by the user: what is kept out is accident, not malice, which the user's own rights already allow.
"""

from __future__ import annotations

import functools
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO, Any, TypeVar

from attlog.base.errors import AttlogError, PluginError, PluginTimeout
from attlog.base.limits import FILTER_S, MAX_ERROR_LETTERS, MAX_FILTER_BYTES
from attlog.estimators.base import Estimator, LogInfo
from attlog.estimators.plugin_errors import broken

T = TypeVar("T")
LIMIT = "ATTLOG_FILTER_TIMEOUT"
"""Seconds that a request may take; 0: any time. An environment variable, because processes within processes ask."""
START = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); sys.path[:] = {path!r}; "
    "from attlog.estimators import apart, registry; apart.main(registry.here)"
)
"""An interrupt is for whoever asked, who then ends this process."""
SIZE = struct.Struct("!Q")
OWN_GROUP: dict[str, Any] = {"process_group": 0} if hasattr(os, "killpg") else {}
"""What a filter starts belongs to the group of its process, and ends with it; in the session of whoever asked."""
CUT_OFF = 74
"""Exit status of a process whose filter broke the way by which it answers."""
GRACE_S = 10
"""After so much more the process ends itself: whoever would have ended it is gone."""


def limit_s() -> float:
    """How many seconds a filter from a file is given for one run; 0: any time."""
    try:
        return max(float(os.environ.get(LIMIT, FILTER_S)), 0.0)
    except ValueError:
        return FILTER_S


def from_file(path: Path) -> Estimator:
    """The estimator that a Python file defines, its functions in another process. PluginError if it cannot be loaded.

    :func:`attlog.estimators.registry.here` loads it into this process.
    """
    found = path.stat()
    return _described(str(path), os.path.abspath(path), (found.st_mtime_ns, found.st_size))


def from_package(name: str, state: str) -> Estimator:
    """The same of the filter ``name`` that an installed package brings, ``state`` being its module and version."""
    return _described(name, "", (state,))


@functools.lru_cache(maxsize=8)
def _described(name: str, place: str, state: tuple[int | str, ...]) -> Estimator:
    """The same, once for every state of the file: metrics ask for a filter again by its name."""
    apart = Apart(name)
    told = apart.call(_description)
    return replace(
        told,
        start=None if told.start is None else Elsewhere(apart, "start"),
        step=None if told.step is None else Elsewhere(apart, "step"),
        run=None if told.run is None else Elsewhere(apart, "run"),
        from_log=None if told.from_log is None else FromLog(apart),
        apart=apart,
    )


class Apart:
    """The process of one filter; started when it is first asked, and again after it died."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._answers: SimpleQueue[bytes] = SimpleQueue()
        self._end: Callable[[], Any] = _nothing
        self._lock = threading.RLock()
        self._too_long = ""

    def call(self, function: Callable[..., T], *arguments: Any, also_s: float = 0.0, **options: Any) -> T:
        """``function(estimator, *arguments, **options)`` there. Functions, arguments and results must pickle.

        PluginError says what the filter did: its own exceptions with file and line, or how its process ended;
        PluginTimeout where it took longer than :func:`limit_s` (and ``also_s`` for what is not its own work), and from
        then on without trying again.
        """
        with self._lock:
            if self._too_long:
                raise PluginTimeout(self._too_long)
            limit = limit_s()
            limit += also_s if limit else 0.0
            try:
                answer = self._asked(pickle.dumps((limit, function, arguments, options), 5), limit)
                fine, value = pickle.loads(answer)
            except AttlogError:
                raise
            except Exception as error:  # not even that came whole: its memory is spoilt
                self._stop()
                raise PluginError(f"{self.name}: its process answers nonsense ({type(error).__name__})") from error
        if fine:
            return value  # type: ignore[no-any-return]
        raise value

    def _asked(self, request: bytes, limit: float) -> bytes:
        process = self._started()
        assert process.stdin is not None
        threading.Thread(target=_tell, args=(process.stdin, request), daemon=True).start()
        try:
            answer = self._answers.get(timeout=limit or None)
        except Empty:
            self._stop()
            self._too_long = (
                f"{self.name}: took longer than {limit:g} s and was ended; ATTLOG_FILTER_TIMEOUT allows more, 0 no end"
            )
            raise PluginTimeout(self._too_long) from None
        except BaseException:  # interrupted too: an answer that comes later would be taken for that of another request
            self._stop()
            raise
        if not answer:
            _end_group(process)
            status = process.wait()
            self._stop()
            raise PluginError(f"{self.name}: {_died(status)}")
        return answer

    def _started(self) -> subprocess.Popen[bytes]:
        """The process, begun where there is none; one that a fork inherited belongs to another."""
        if self._process is not None and self._owner == os.getpid() and self._process.poll() is None:
            return self._process
        path = [os.path.abspath(p) if p else os.getcwd() for p in sys.path]
        self._process = process = subprocess.Popen(
            [sys.executable, "-P", "-c", START.format(path=path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=_environment(),
            **OWN_GROUP,
        )
        self._owner = os.getpid()
        self._answers = answers = SimpleQueue[bytes]()
        assert process.stdin is not None
        assert process.stdout is not None
        self._end = weakref.finalize(self, _ended, process, self._owner)
        threading.Thread(target=_listen, args=(process.stdout, answers), daemon=True).start()
        with suppress(OSError):
            process.stdin.write(pickle.dumps(self.name))
        return process

    def _stop(self) -> None:
        self._end()
        self._process = None


class Elsewhere:
    """Stands for a filter's function that runs in another process: that it exists is all that this process knows."""

    def __init__(self, apart: Apart, name: str) -> None:
        self._apart, self._name = apart, name

    def __call__(self, *_: Any) -> Any:
        raise TypeError(f"{self._name} of a filter that is not ours runs in its process, by attlog.estimators.estimate")


class FromLog(Elsewhere):
    """``from_log``, asked there."""

    def __init__(self, apart: Apart) -> None:
        super().__init__(apart, "from_log")

    def __call__(self, params: Mapping[str, float], info: LogInfo) -> dict[str, float | str]:
        return self._apart.call(_from_log, dict(params), info)


def _from_log(estimator: Estimator, params: dict[str, float], info: LogInfo) -> dict[str, float | str]:
    from types import MappingProxyType

    assert estimator.from_log is not None
    return dict(estimator.from_log(MappingProxyType(params), info))


def _description(estimator: Estimator) -> Estimator:
    """An estimator without what cannot travel: its functions become a sign that they are there."""
    return replace(
        estimator,
        presets={name: dict(values) for name, values in estimator.presets.items()},
        slices=dict(estimator.slices),
        start=estimator.start and _nothing,
        step=estimator.step and _nothing,
        run=estimator.run and _nothing,
        from_log=estimator.from_log and _nothing,
    )


def _nothing() -> None:
    """Stands for a function that is somewhere else."""


def _tell(requests: IO[bytes], request: bytes) -> None:
    """Send a request, in a thread: whoever does not read it must not stop the clock."""
    with suppress(OSError, ValueError):  # it died before it could read, which the answer's end tells
        requests.write(SIZE.pack(len(request)))
        requests.write(request)
        requests.flush()


def _listen(answers: IO[bytes], told: SimpleQueue[bytes]) -> None:
    """Hand on whole answers; an empty one at the end. A thread: not every system can wait for a pipe and a clock."""
    with suppress(OSError, ValueError, MemoryError), answers:
        while len(head := answers.read(SIZE.size)) == SIZE.size:
            (size,) = SIZE.unpack(head)
            if size > MAX_FILTER_BYTES:  # spoilt: what the process writes is no longer what it was asked for
                told.put(head)  # which no answer can be
                break
            body = answers.read(size)
            if len(body) < size or not body:
                break
            told.put(body)
    told.put(b"")


def _ended(process: subprocess.Popen[bytes], owner: int) -> None:
    """End a process. A program that was forked leaves it to whoever started it."""
    if os.getpid() != owner:
        return
    if process.returncode is None:
        _end_group(process, at_once=True)
    with suppress(OSError):
        process.kill()
    with suppress(OSError, ChildProcessError):
        process.wait()
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()


def _end_group(process: subprocess.Popen[bytes], *, at_once: bool = False) -> None:
    """End whatever a filter's process has started and what is in its group still, once that process has ended itself.

    It is not reaped before: its number, which is that of the group, could then be another's.
    """
    if not OWN_GROUP:
        return
    with suppress(OSError, ChildProcessError):
        if not at_once:
            os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        os.killpg(process.pid, signal.SIGKILL)


def _died(status: int) -> str:
    """How a process ended that gave no answer, in words."""
    name = {-known.value: known.name for known in signal.Signals}.get(status, "")
    if name == "SIGKILL":
        return "its process was killed from outside (signal 9), as systems do when memory runs out"
    if name == "SIGALRM":
        return "took too long and was ended"
    if name or status >= 0xC0000000:  # from here on exit statuses of Windows are crashes
        return f"its process crashed ({name or hex(status)}): look for indices beyond an array and endless recursion"
    if status == CUT_OFF:
        return "its process cannot answer any more: it closed files or broke modules that are not its own"
    return f"it ended its process (exit status {status})"


def _environment() -> dict[str, str]:
    return dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1") | os.environ


def main(load: Callable[[str], Estimator]) -> None:
    """The other side: load the filter, then answer requests until nobody asks any more."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    dumps, loads = pickle.dumps, pickle.loads  # a filter may break what it finds
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    _with_less_memory()
    name = pickle.load(requests)
    asked: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_hear, args=(requests, asked), daemon=True).start()
    estimator: Estimator | None = None
    while True:
        limit, function, arguments, options = loads(asked.get())
        _ends_by_itself(limit)
        try:
            if estimator is None:
                estimator = load(name)
            answer = (True, function(estimator, *arguments, **options))
        except AttlogError as error:
            answer = (False, error if len(str(error)) <= 2 * MAX_ERROR_LETTERS else broken(name, error))
        except BaseException as error:
            answer = (False, broken(name, error))
        _ends_by_itself(0.0)
        try:
            try:
                told = dumps(answer, 5)
            except Exception as error:
                told = dumps((False, PluginError(f"{name}: its result cannot be handed on ({error})")))
            if sys.stdout is not None:
                sys.stdout.flush()
            answers.write(SIZE.pack(len(told)))
            answers.write(told)
            answers.flush()
        except Exception:  # the filter broke or closed what is not its own: nothing can be told any more
            os._exit(CUT_OFF)


def _hear(requests: IO[bytes], asked: SimpleQueue[bytes]) -> None:
    """Take requests; when nobody is there to ask any more this process ends, whatever it is doing."""
    while len(head := requests.read(SIZE.size)) == SIZE.size:
        asked.put(requests.read(SIZE.unpack(head)[0]))
    if OWN_GROUP and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)  # with what the filter started
    os._exit(0)


def _ends_by_itself(limit: float) -> None:
    """A compiled loop lets no thread run, so the system is asked to end the process then; 0: not any more."""
    if hasattr(signal, "alarm"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(int(limit) + GRACE_S if limit else 0)


def _with_less_memory() -> None:
    """Let an allocation beyond the limit fail in the file's own line; what is mapped by now does not count."""
    try:
        import resource
    except ImportError:
        return
    with suppress(OSError, ValueError):
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        wanted = held + MAX_FILTER_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard < 0 else min(wanted, hard), hard))
