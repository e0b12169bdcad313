"""A process that calls functions for this one: within limits, and if it dies it is known how."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from attlog.base.processes.memory import resident_mb
from attlog.base.processes.serve import CUT_OFF, FAILED, MESSAGE
from attlog.base.processes.wire import ANY_SIZE, NonsenseError, Wire, value

T = TypeVar("T")
START = "import sys; sys.path[:] = {path!r}; from {module} import main; main({arguments})"
"""Not ``-m``: that would put the current folder first, where a file next to a log could be called numpy.py."""
OWN_GROUP: dict[str, Any] = {"process_group": 0} if hasattr(os, "killpg") else {}
"""What a child starts belongs to its group and ends with it; Ctrl-C goes to the caller alone."""
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Processes are as many as cores already; and sums over several threads may differ in the last bit."""
CRASHES = 0xC0000000
"""From here on exit statuses of Windows are crashes."""
ENDING_S = 2.0
"""Who no longer talks is about to end."""
PAUSE_S, WATCHED_S = 0.5, 0.05
"""How often a child is looked at, and one whose memory is limited: it fills with some GB/s at most."""


@dataclass(frozen=True, slots=True)
class Exit:
    """How a process ended: its status (the negative number of a signal; None where nobody knows) and what it took."""

    status: int | None = None
    cpu_s: float = 0.0
    peak_mb: float = 0.0

    @property
    def signal(self) -> str:
        """The name of the signal that ended it; empty if none did. Not every system knows every signal."""
        return {-known.value: known.name for known in signal.Signals}.get(self.status or 0, "")

    @property
    def crashed(self) -> bool:
        """Whether it ended by an error of memory or of an assertion in machine code."""
        return self.signal not in ("", "SIGKILL", "SIGALRM", "SIGXCPU") or (self.status or 0) >= CRASHES

    def __str__(self) -> str:
        """The end in words, to follow "its process"."""
        if self.signal == "SIGKILL":
            return "was killed from outside (signal 9), as systems do when memory runs out"
        if self.crashed:
            return f"crashed ({self.signal or hex(self.status or 0)})"
        if self.status == CUT_OFF:
            return "cannot answer any more: what it ran closed files or broke modules that are not its own"
        if self.status is None:
            return "is gone without a word, and so is the one that started it"
        return f"ended without a word (exit status {self.status})"


class Died(Exception):
    """A process ended, or was ended, without an answer."""

    def __init__(self, exit_: Exit, why: str = "") -> None:
        super().__init__(why or f"the process {exit_}")
        self.exit = exit_


class TooLong(Died):
    """It was ended because it took longer than allowed."""


class TooMuchMemory(Died):
    """It was ended because it held more memory than allowed."""


class Process(Protocol):
    """A process that was started in one way or the other."""

    @property
    def pid(self) -> int:
        """Its number."""

    def alive(self) -> bool:
        """Whether it runs."""

    def end(self, patience_s: float) -> Exit:
        """End it with all that it started, after so long if it does not end by itself."""


class Child:
    """A process that calls functions, one after the other, until it is ended or nobody holds it any more."""

    def __init__(self, process: Process, connection: socket.socket, most_bytes: int = ANY_SIZE) -> None:
        self._process, self._wire = process, Wire(connection, most_bytes)
        self._exit: Exit | None = None
        self._last = weakref.finalize(self, _ended, process, connection, os.getpid())
        self._owner = os.getpid()

    @classmethod
    def started(cls, environment: Mapping[str, str] | None = None, most_bytes: int = ANY_SIZE) -> Child:
        """A fresh interpreter: it takes some tenths of a second. What it prints goes to standard error.

        ``environment``: variables beside those of this process; ``most_bytes``: an answer that is larger is nonsense.
        """
        ours, theirs = socket.socketpair()
        with theirs:
            return cls(Interpreter("attlog.base.processes.serve", theirs, environment or {}), ours, most_bytes)

    @property
    def alive(self) -> bool:
        """Whether it runs, and was started by this process: one that a fork inherited belongs to another."""
        return self._exit is None and self._owner == os.getpid() and self._process.alive()

    def call(
        self,
        function: Callable[..., T],
        *arguments: Any,
        seconds: float = 0.0,
        memory_mb: float = 0.0,
        tell: Callable[[dict[str, Any]], None] | None = None,
        **options: Any,
    ) -> T:
        """``function(*arguments, **options)`` there. Functions, arguments and results must pickle.

        What the function raises is raised here. TooLong after ``seconds``, TooMuchMemory beyond ``memory_mb`` (MB,
        resident), Died where there is no answer; the child is ended then, and after any other exception that comes
        while it is waited for (an interrupt). With ``tell`` the function is given an argument ``tell`` too: what it
        calls that with comes here, with an empty message after each pause of silence.
        """
        until = time.monotonic() + seconds if seconds else None
        try:
            self._send((seconds, tell is not None, function, arguments, options), seconds)
            while True:
                kind, answer = self._received(WATCHED_S if memory_mb else PAUSE_S, until)
                if kind != MESSAGE:
                    break
                if tell is not None:
                    tell(answer)
                if until is not None and time.monotonic() > until:
                    raise self._too_long(seconds)
                if memory_mb and (held := resident_mb(self._process.pid)) > memory_mb:
                    raise TooMuchMemory(
                        self.end(), f"needed more than {memory_mb:g} MB of memory ({held:.0f} MB when it was ended)"
                    )
        except BaseException:  # an answer that comes later would be taken for that of another request
            self.end()
            raise
        if kind == FAILED:
            raise answer
        return answer  # type: ignore[no-any-return]

    def end(self, patience_s: float = 0.0) -> Exit:
        """End the process with all that it started; how it ended. ``patience_s``: for one that is about to end."""
        if self._exit is None:
            self._wire.close()
            self._exit = self._process.end(patience_s) if self._last.detach() and self._owner == os.getpid() else Exit()
        return self._exit

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _send(self, request: tuple[Any, ...], seconds: float) -> None:
        try:
            self._wire.send(request, seconds or None)
        except TimeoutError:
            raise self._too_long(seconds) from None
        except (BrokenPipeError, ConnectionResetError):
            pass  # it died, which is seen where its answer is waited for

    def _too_long(self, seconds: float) -> TooLong:
        return TooLong(self.end(), f"took longer than {seconds:g} s and was ended")

    def _received(self, pause: float, until: float | None) -> tuple[str, Any]:
        """The next message, an empty one after a pause. Died where none will come."""
        left = None if until is None else max(until - time.monotonic(), 1e-3)
        for begins_s in (pause if left is None else min(pause, left), 1e-3):
            alive = self._process.alive()
            try:
                received = self._wire.receive(begins_s, left)
            except TimeoutError:
                if alive:
                    return MESSAGE, {}
                continue  # it ended since it was waited for: has it answered before?
            except (EOFError, OSError):
                break
            except (NonsenseError, MemoryError) as error:
                raise Died(self.end(), f"its process answers nonsense ({error})") from error
            try:
                kind, answer = value(received)
            except Exception as error:  # its memory is spoilt
                raise Died(self.end(), f"its process answers nonsense ({type(error).__name__})") from error
            return kind, answer
        raise Died(self.end(ENDING_S))


class Interpreter:
    """A fresh interpreter that runs ``main(number of a socket, *arguments)`` of a module."""

    def __init__(self, module: str, theirs: socket.socket, environment: Mapping[str, str], *arguments: Any) -> None:
        path = [os.path.abspath(p) if p else os.getcwd() for p in sys.path]
        number = theirs.fileno()
        start = START.format(path=path, module=module, arguments=", ".join(map(repr, (number, *arguments))))
        windows = sys.platform == "win32"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", start],
            pass_fds=[] if windows else [number],
            stdin=subprocess.PIPE if windows else subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=dict.fromkeys(ONE_THREAD, "1") | dict(environment) | os.environ,
            **OWN_GROUP,
        )
        if sys.platform == "win32":  # not tried
            self._process.communicate(theirs.share(self._process.pid))
        self._lock = threading.Lock()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    def alive(self) -> bool:
        """Whether it runs. One that has ended is not forgotten by the system yet: its number is that of a group."""
        with self._lock:
            if not OWN_GROUP or self._process.returncode is not None:
                return self._process.poll() is None
            with suppress(ChildProcessError):
                return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is None
        return False

    def end(self, patience_s: float = 0.0) -> Exit:
        """End it with what is in its group still, after so long if it does not end by itself."""
        until = time.monotonic() + patience_s
        while patience_s and self.alive() and time.monotonic() < until:
            time.sleep(0.01)
        with self._lock:
            if self._process.returncode is None:
                with suppress(OSError):
                    os.killpg(self.pid, signal.SIGKILL) if OWN_GROUP else self._process.kill()
            return Exit(self._process.wait())


def end_session(leader: int) -> None:
    """End the process that leads a session and all in that session, such as processes of filters.

    Before its ``setsid`` it leads none.
    """
    groups = {leader}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError):
            group, session = stat.read_text(errors="replace").rpartition(")")[2].split()[2:4]
            if int(session) == leader:
                groups.add(int(group))
    for end, number in [*((os.killpg, group) for group in groups), (os.kill, leader)]:
        with suppress(OSError):
            end(number, signal.SIGKILL)


def _ended(process: Process, connection: socket.socket, owner: int) -> None:
    """End a child that nobody holds. A program that was forked leaves it to whoever started it."""
    if os.getpid() == owner:
        connection.close()
        process.end(0.0)
