"""Values between two processes over a socket, each whole or not at all.

A frame is the number of its parts, their sizes and the parts: the pickle of a value, then the arrays in it, which are
neither copied into the pickle nor out of it. Pickles run code of whoever sent them: both ends are processes of one
user, and what a process of a filter is kept from is accident, not malice.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from pickle import PickleBuffer, PicklingError, dumps, loads
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from attlog.core.errors import UsageError

COUNT, SIZE = struct.Struct("!I"), struct.Struct("!Q")
ANY_SIZE = 1 << 62
MOST_PARTS = 1 << 20


class NonsenseError(Exception):
    """What came is no frame: the memory of the process that sent it is spoilt."""


class Wire:
    """One end of a socket; both ends may be used by several threads, each end by one thread that receives."""

    def __init__(self, connection: socket.socket, most_bytes: int = ANY_SIZE) -> None:
        """``most_bytes``: what is larger is nonsense."""
        self._connection, self._most = connection, most_bytes
        self._lock = threading.Lock()

    def fileno(self) -> int:
        """The descriptor to wait for."""
        return self._connection.fileno()

    def send(self, value: Any, seconds: float | None = None) -> None:
        """Send a value. TimeoutError where it is not taken in time, OSError where nobody is there."""
        self.send_parts(parts(value), seconds)

    def send_parts(self, sent: Sequence[Any], seconds: float | None = None) -> None:
        """Send what :func:`parts` made."""
        with self._lock:
            self._connection.settimeout(seconds)
            sizes = [len(part) for part in sent]
            self._connection.sendall(b"".join([COUNT.pack(len(sizes)), *map(SIZE.pack, sizes)]))
            for part in sent:
                self._connection.sendall(part)

    def receive(self, begins_s: float | None = None, ends_s: float | None = None) -> list[bytearray]:
        """The parts of the next value, for :func:`value`.

        TimeoutError where nothing comes within ``begins_s``, or not all of it within ``ends_s`` after that; EOFError
        where the other end is closed.
        """
        self._connection.settimeout(begins_s)
        try:
            begin = self._connection.recv(1)
        except BlockingIOError:
            raise TimeoutError from None
        if not begin:
            raise EOFError
        until = None if ends_s is None else time.monotonic() + ends_s
        (count,) = COUNT.unpack(begin + self._exactly(COUNT.size - 1, until))
        if not 0 < count <= MOST_PARTS:
            raise NonsenseError(f"{count} parts")
        sizes = [size for (size,) in SIZE.iter_unpack(self._exactly(SIZE.size * count, until))]
        if sum(sizes) > self._most:
            raise NonsenseError(f"{sum(sizes)} bytes")
        return [self._exactly(size, until) for size in sizes]

    def close(self) -> None:
        """End it: the other side reads an end."""
        self._connection.close()

    def _exactly(self, size: int, until: float | None) -> bytearray:
        found = bytearray(size)
        left = memoryview(found)
        while left:
            self._connection.settimeout(None if until is None else max(until - time.monotonic(), 1e-3))
            count = self._connection.recv_into(left)
            if not count:
                raise EOFError
            left = left[count:]
        return found


def parts(value: Any) -> list[Any]:
    """A value as the parts of a frame: its pickle, then the memory of its arrays."""
    buffers: list[PickleBuffer] = []
    pickled = dumps(value, 5, buffer_callback=buffers.append)
    return [pickled, *(buffer.raw() for buffer in buffers)]


def value(received: Sequence[bytearray]) -> Any:
    """The value of a frame; its arrays lie in what was received. Any exception, where the pickle is none."""
    return loads(received[0], buffers=received[1:])


# How much memory does a process hold?
#
# The limit of ``--memory`` is kept by looking at this number, not by RLIMIT_AS: an address space counts libraries,
# mapped logs and reserved room that never becomes memory (a gigabyte before the first log), and an allocation that is
# refused inside a filter would end as a failed row of a report that looks whole. A process that is ended leaves no
# result at all.


def resident_mb(pid: int) -> float:
    """Resident memory of a process and of those that it started, which run filters from files, in MB (10^6 bytes).

    Mapped pages of its log count; 0 for one that is gone. UsageError where the system has no /proc and psutil is not
    installed.
    """
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            own = int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        return own + sum(map(resident_mb, _children(pid)))
    except (FileNotFoundError, ProcessLookupError, IndexError):
        if os.path.exists("/proc/self/statm"):
            return 0.0
    try:
        import psutil
    except ImportError:
        raise UsageError("--memory needs the package psutil on this system: pip install psutil") from None
    try:
        process = psutil.Process(pid)
        return float(sum(one.memory_info().rss for one in (process, *process.children(recursive=True)))) / 1e6
    except psutil.Error:
        return 0.0


def _children(pid: int) -> list[int]:
    """The processes that a process started, as far as the system keeps a list of them."""
    try:
        with open(f"/proc/{pid}/task/{pid}/children", "rb") as file:
            return [int(number) for number in file.read().split()]
    except (OSError, ValueError):
        return []


# The side of a child process: it calls the functions that it is asked for, until nobody asks any more.

Tell = Callable[[dict[str, Any]], None]
"""Sends a message to whoever waits for the answer."""
MESSAGE, DONE, FAILED = "message", "done", "failed"
CUT_OFF = 74
"""Exit status of a process that cannot answer: what it ran broke the way by which it answers."""
GRACE_S = 10
"""After so much more than its limit a process ends itself: whoever would have ended it is gone."""


def main(descriptor: int) -> None:
    """A fresh interpreter: serve over the socket with this number. Interrupts are for whoever asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    connection = received(descriptor)
    with suppress(OSError):
        os.dup2(2, 1)  # what is printed goes to standard error
    serve(connection)


def received(descriptor: int) -> socket.socket:
    """The socket that an interpreter was started with."""
    if sys.platform == "win32":  # not tried
        return socket.fromshare(sys.stdin.buffer.read())
    return socket.socket(fileno=descriptor)


def serve(connection: socket.socket) -> None:
    """Answer requests; ends the process where the other end of the connection is closed, whatever it is doing."""
    wire = Wire(connection)
    requests: SimpleQueue[Sequence[bytearray]] = SimpleQueue()
    threading.Thread(target=_listen, args=(wire, requests), daemon=True).start()
    while True:
        answer(wire, requests.get())


def answer(wire: Wire, request: Sequence[bytearray]) -> None:
    """Call what a request asks for, and send what it returns or raises.

    What ends an interpreter (SystemExit) ends this one. Called functions may break what they find.
    """
    try:
        seconds, tells, function, arguments, options = value(request)
        del request
        _ends_by_itself(seconds)
        if tells:
            options = options | {"tell": lambda message: _tell(wire, message)}
        kind, answered = DONE, function(*arguments, **options)
    except Exception as error:
        kind, answered = FAILED, error
    _ends_by_itself(0.0)
    try:
        try:
            sent = parts((kind, answered))
        except Exception as error:
            if kind == FAILED:
                raise
            sent = parts((FAILED, PicklingError(str(error))))
        if sys.stdout is not None:
            sys.stdout.flush()
        wire.send_parts(sent)
    except Exception:
        os._exit(CUT_OFF)


def write_output_to(file: Path) -> None:
    """Let all that this process prints, also when it crashes, go to a file; it reads nothing."""
    output = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for standard, instead in ((0, nothing), (1, output), (2, output)):
        os.dup2(instead, standard)
    faulthandler.enable(output)


def _tell(wire: Wire, message: dict[str, Any]) -> None:
    with suppress(OSError):  # nobody waits any more, which ends this process
        wire.send((MESSAGE, message))


def _listen(wire: Wire, requests: SimpleQueue[Sequence[bytearray]]) -> None:
    """Take requests, in a thread, so that the end of whoever asks ends what is being done."""
    with suppress(OSError, EOFError):
        while True:
            requests.put(wire.receive())
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)  # with what it has started
    os._exit(0)


def _ends_by_itself(seconds: float) -> None:
    """A compiled loop lets no thread run, so the system is asked to end the process then; 0: not any more."""
    if hasattr(signal, "alarm"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(int(seconds) + GRACE_S if seconds else 0)


# A process that calls functions for this one: within limits, and if it dies it is known how.

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
            return cls(Interpreter("attlog.core.workers", theirs, environment or {}), ours, most_bytes)

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
