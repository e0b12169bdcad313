"""Call functions in worker processes with limits of time and memory, isolated against crashes.

A :class:`Worker` calls functions one after the other in a fresh interpreter or in a fork of a :class:`ForkServer`, a
program that has imported everything: an interpreter of its own would cost 1 s of processor time a log, a third of what
a small log takes. ``multiprocessing``'s fork server does not serve here: it leaves children running whose parent was
killed while they held the interpreter lock, and starts nothing inside a daemonic worker such as Dask's.
"""

from __future__ import annotations

import faulthandler
import gc
import importlib
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from pickle import PicklingError, dumps, loads
from queue import Empty, SimpleQueue
from typing import Any, Protocol, TypeVar

from attlog.core.errors import UsageError

K = TypeVar("K")
T = TypeVar("T")
MESSAGE, DONE, FAILED = "message", "done", "failed"
# Not ``-m``, which puts the current folder first: a file beside a log may be called numpy.py.
START = "import sys; sys.path[:] = {path!r}; from attlog.core import workers; workers.{function}({arguments})"
# Own process group: children end with the process, and Ctrl-C interrupts only the caller.
OWN_GROUP: dict[str, Any] = {"process_group": 0} if hasattr(os, "killpg") else {}
# One thread per process: there are as many processes as cores, and threaded sums differ in the last bit.
SINGLE_THREADED = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
EXIT_CUT_OFF = 74  # exit status of a process whose work broke its own connection
MIN_CRASH_STATUS = 0xC0000000  # Windows
UNLIMITED_BYTES = 1 << 62
CHECK_PERIOD_S = 0.5
MEMORY_CHECK_PERIOD_S = 0.05  # a process fills some GB/s at most
CLOSING_S = 2.0  # for a process that has closed its connection, or a fork server that compiles a filter
SELF_LIMIT_MARGIN_S = 10  # a process whose caller is gone ends itself so long after its limit


@dataclass(frozen=True, slots=True)
class Exit:
    """End of a process: status (negative signal number, None if unknown), CPU time and peak resident memory."""

    status: int | None = None
    cpu_s: float = 0.0
    peak_mb: float = 0.0

    @property
    def signal(self) -> str:
        """Name of the signal that ended the process, or an empty text."""
        return {-known.value: known.name for known in signal.Signals}.get(self.status or 0, "")

    @property
    def crashed(self) -> bool:
        """True after a memory error or failed assertion in machine code."""
        return self.signal not in ("", "SIGKILL", "SIGALRM", "SIGXCPU") or (self.status or 0) >= MIN_CRASH_STATUS

    def __str__(self) -> str:
        """Describe the end, as a continuation of "its process"."""
        if self.signal == "SIGKILL":
            return "was killed from outside (signal 9), as systems do when memory runs out"
        if self.crashed:
            return f"crashed ({self.signal or hex(self.status or 0)})"
        if self.status == EXIT_CUT_OFF:
            return "cannot answer any more: its work closed files or broke modules that are not its own"
        if self.status is None:
            return "is gone without an answer, and so is the process that started it"
        return f"ended without an answer (exit status {self.status})"


class Died(Exception):
    """Process that ended, or was ended, without a result."""

    def __init__(self, exit_: Exit, why: str = "") -> None:
        super().__init__(why or f"the process {exit_}")
        self.exit = exit_


class TooLong(Died):
    """Process ended at its time limit."""


class TooMuchMemory(Died):
    """Process ended at its memory limit."""


class Closed(Exception):
    """Call on a closed fork server, as during an interrupt."""


class Channel:
    """Transfer of pickles over a socket, each with its length; receive in one thread only.

    Unpickling executes code of the sender. Both ends belong to one user: the isolation is no protection from malice.
    """

    def __init__(self, connection: socket.socket, max_bytes: int = UNLIMITED_BYTES) -> None:
        self.connection, self._max_bytes = connection, max_bytes
        self._lock = threading.Lock()

    def send(self, value: Any, seconds: float | None = None) -> None:
        """Send a value. TimeoutError after ``seconds``, OSError without a reader."""
        frame = dumps(value, 5)
        with self._lock:
            self.connection.settimeout(seconds)
            self.connection.sendall(struct.pack("!Q", len(frame)))
            self.connection.sendall(frame)

    def receive(self, start_s: float | None = None, until: float | None = None) -> bytearray:
        """Receive the pickle of a value.

        TimeoutError if nothing comes within ``start_s`` or the rest not before ``until`` (monotonic clock); EOFError at
        the end of the connection; ValueError for more than the allowed bytes.
        """
        head = self._read(8, start_s, until)
        (size,) = struct.unpack("!Q", head)
        if size > self._max_bytes:
            raise ValueError(f"{size} bytes")
        return self._read(size, None, until)

    def _read(self, size: int, start_s: float | None, until: float | None) -> bytearray:
        found = bytearray(size)
        left, patience = memoryview(found), start_s
        while left:
            self.connection.settimeout(patience)
            count = self.connection.recv_into(left)
            if not count:
                raise EOFError
            left = left[count:]
            patience = None if until is None else max(until - time.monotonic(), 1e-3)
        return found


class Process(Protocol):
    """A process started as an interpreter or as a fork."""

    pid: int

    def alive(self) -> bool: ...

    def end(self, patience_s: float) -> Exit:
        """Kill the process and its children if it does not end by itself within ``patience_s``."""


class Worker:
    """A process that calls functions, until it is ended or garbage-collected."""

    def __init__(self, process: Process, connection: socket.socket, max_bytes: int = UNLIMITED_BYTES) -> None:
        self._process, self._channel = process, Channel(connection, max_bytes)
        self._exit: Exit | None = None
        self._owner = os.getpid()
        self._finalizer = weakref.finalize(self, _end_if_owner, process, connection, self._owner)

    @classmethod
    def start(cls, environment: Mapping[str, str] | None = None, max_bytes: int = UNLIMITED_BYTES) -> Worker:
        """Start a fresh interpreter; a result beyond ``max_bytes`` raises Died."""
        ours, theirs = socket.socketpair()
        with theirs:
            return cls(Interpreter("serve_in_interpreter", theirs, environment or {}), ours, max_bytes)

    @property
    def alive(self) -> bool:
        """Return whether the process runs and belongs to this process, not to one that forked it."""
        return self._exit is None and self._owner == os.getpid() and self._process.alive()

    def call(
        self,
        function: Callable[..., T],
        *arguments: Any,
        seconds: float = 0.0,
        memory_mb: float = 0.0,
        on_message: Callable[[dict[str, Any]], None] | None = None,
        **options: Any,
    ) -> T:
        """Call a function in the process; function, arguments and result must pickle.

        Exceptions of the function are raised here. TooLong after ``seconds``, TooMuchMemory beyond ``memory_mb``
        (resident), Died without an answer; these and every other exception raised while waiting end the process.
        With ``on_message`` the function gets an argument of that name. What it passes to it is received here, and an
        empty message after each silent period.
        """
        until = time.monotonic() + seconds if seconds else None
        period = MEMORY_CHECK_PERIOD_S if memory_mb else CHECK_PERIOD_S
        try:
            with suppress(BrokenPipeError, ConnectionResetError):  # a dead process is reported by _receive
                self._channel.send((seconds, on_message is not None, function, arguments, options), seconds or None)
            while True:
                kind, answer = self._receive(period, until)
                if kind != MESSAGE:
                    break
                if on_message is not None:
                    on_message(answer)
                if until is not None and time.monotonic() > until:
                    raise TimeoutError
                if memory_mb and (held := resident_mb(self._process.pid)) > memory_mb:
                    why = f"needed more than {memory_mb:g} MB of memory ({held:.0f} MB when it was ended)"
                    raise TooMuchMemory(self.end(), why)
        except TimeoutError:
            raise TooLong(self.end(), f"took longer than {seconds:g} s and was ended") from None
        except BaseException:  # a late result must not be taken for that of the next call
            self.end()
            raise
        if kind == FAILED:
            raise answer
        return answer  # type: ignore[no-any-return]

    def end(self, patience_s: float = 0.0) -> Exit:
        """End the process with everything it started."""
        if self._exit is None:
            self._channel.connection.close()
            mine = self._finalizer.detach() and self._owner == os.getpid()
            self._exit = self._process.end(patience_s) if mine else Exit()
        return self._exit

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _receive(self, period: float, until: float | None) -> tuple[str, Any]:
        """Receive the next message, an empty one if none comes within ``period``. Died after the process's end."""
        for wait in (period, 1e-3):
            if until is not None:
                wait = min(wait, max(until - time.monotonic(), 1e-3))
            try:
                kind, answer = loads(self._channel.receive(wait, until))
                return kind, answer
            except TimeoutError:
                if self._process.alive():  # a process that has ended may have sent a result before
                    return MESSAGE, {}
            except (EOFError, OSError):
                break
            except Exception as error:  # damaged memory
                raise Died(self.end(), f"its process answers nonsense ({type(error).__name__}: {error})") from error
        raise Died(self.end(CLOSING_S))


def _end_if_owner(process: Process, connection: socket.socket, owner: int) -> None:
    if os.getpid() == owner:
        connection.close()
        process.end(0.0)


class Interpreter:
    """A fresh interpreter that runs a function of this module with a socket as its first argument."""

    def __init__(self, function: str, theirs: socket.socket, environment: Mapping[str, str], *arguments: Any) -> None:
        path = [os.path.abspath(p) if p else os.getcwd() for p in sys.path]
        number = theirs.fileno()
        words = ", ".join(map(repr, (number, *arguments)))
        windows = sys.platform == "win32"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", START.format(path=path, function=function, arguments=words)],
            pass_fds=[] if windows else [number],
            stdin=subprocess.PIPE if windows else subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=SINGLE_THREADED | dict(environment) | os.environ,
            **OWN_GROUP,
        )
        if sys.platform == "win32":  # not tried
            self._process.communicate(theirs.share(self._process.pid))
        self.pid = self._process.pid
        self._lock = threading.Lock()

    def alive(self) -> bool:
        """Return whether the interpreter runs, without reaping it, so that its process id stays reserved."""
        with self._lock:
            if not OWN_GROUP or self._process.returncode is not None:
                return self._process.poll() is None
            with suppress(ChildProcessError):
                return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is None
        return False

    def end(self, patience_s: float = 0.0) -> Exit:
        """Kill the interpreter and its process group if it does not end by itself within ``patience_s``."""
        until = time.monotonic() + patience_s
        while patience_s and self.alive() and time.monotonic() < until:
            time.sleep(0.01)
        with self._lock:
            if self._process.returncode is None:
                with suppress(OSError):
                    os.killpg(self.pid, signal.SIGKILL) if OWN_GROUP else self._process.kill()
            return Exit(self._process.wait())


class ForkServer:
    """Server that starts workers as forks of one program; usable from several threads."""

    def __init__(self, preloaded: Sequence[str] = (), environment: Mapping[str, str] | None = None) -> None:
        """``preloaded``: modules that the program imports; ``environment``: variables beside those of this process."""
        self._preloaded, self._environment = list(preloaded), dict(environment or {})
        self._lock = threading.Lock()
        self._program: _ForkProgram | None = None
        self._prepared = False
        self._workers: weakref.WeakSet[Worker] = weakref.WeakSet()
        self.closed = False

    def prepare(
        self, function: Callable[..., Any], *arguments: Any, on_message: Callable[..., None] | None = None
    ) -> None:
        """Call a function once in the program, so that forks inherit its loaded data. Died if the program ends."""
        with self._lock:
            if self._prepared or not hasattr(os, "fork"):
                return
            program, connection, _ = self._order(CALL)
            self._prepared = True
        Worker(_Shared(program), connection).call(function, *arguments, on_message=on_message)

    def worker(self) -> Worker:
        """Start a worker. Closed after :meth:`close`."""
        with self._lock:
            if self.closed:
                raise Closed
            if not hasattr(os, "fork"):
                started = Worker.start(self._environment)
            else:
                program, connection, pid = self._order(FORK)
                started = Worker(_Fork(program, pid), connection)
            self._workers.add(started)
        return started

    def close(self) -> None:
        """End all workers and start no more."""
        self.closed = True  # without the lock, which a thread may hold until the program answers
        if self._program is not None:
            self._program.end()
        for worker in list(self._workers):
            worker.end()

    def _order(self, order: bytes) -> tuple[_ForkProgram, socket.socket, int]:
        """Send an order with a new connection to the program, started if necessary; return also the fork's id."""
        ours, theirs = socket.socketpair()
        with theirs:
            for _ in range(2):  # the program may have died just now
                program = self._running()
                try:
                    return program, ours, program.order(order, theirs)
                except (OSError, EOFError):
                    program.end()  # a dying program still counts as alive, and would get the second order too
        return program, ours, 0

    def _running(self) -> _ForkProgram:
        if self._program is None or not self._program.alive():
            if self._program is not None:
                self._program.end()
            self._program, self._prepared = _ForkProgram(self._environment, self._preloaded), False
        if self.closed:  # meanwhile
            self._program.end()
            raise Closed
        return self._program


FORK, CALL, POLL, END = b"f", b"c", b"p", b"e"
ORDER = struct.Struct("!cQ")


class _ForkProgram:
    """The running program of a fork server."""

    def __init__(self, environment: Mapping[str, str], preloaded: Sequence[str]) -> None:
        control, theirs = socket.socketpair()
        with theirs:
            self._interpreter = Interpreter("run_fork_program", theirs, environment, preloaded)
        self._control, self._lock = Channel(control), threading.Lock()
        self.pid = self._interpreter.pid
        # For a server that nobody closes: the program must not outlive it, nor this process.
        weakref.finalize(self, _end_program_if_owner, self._interpreter, control, os.getpid())

    def alive(self) -> bool:
        return self._interpreter.alive()

    def order(self, order: bytes, connection: socket.socket) -> int:
        """Pass a connection to the program; return the process id of a new fork, else 0."""
        with self._lock:
            socket.send_fds(self._control.connection, [ORDER.pack(order, 0)], [connection.fileno()])
            return int(loads(self._control.receive())) if order == FORK else 0

    def exit_of(self, order: bytes, pid: int) -> Exit | None:
        """Return the exit of a fork, killed by END, None if it still runs at POLL.

        OSError or EOFError if the program has ended.
        """
        with self._lock:
            self._control.connection.sendall(ORDER.pack(order, pid))
            found: Exit | None = loads(self._control.receive())
        return found

    def end(self) -> Exit:
        """End the program; a busy one is killed and cannot end its forks."""
        return _end_program(self._interpreter, self._control.connection)


def _end_program(interpreter: Interpreter, control: socket.socket) -> Exit:
    with suppress(OSError):
        control.shutdown(socket.SHUT_RDWR)
    return interpreter.end(CLOSING_S)


def _end_program_if_owner(interpreter: Interpreter, control: socket.socket, owner: int) -> None:
    if os.getpid() == owner:
        _end_program(interpreter, control)
        control.close()


class _Fork:
    """A process that a fork program started."""

    def __init__(self, program: _ForkProgram, pid: int) -> None:
        self._program, self.pid = program, pid
        self._exit: Exit | None = None if pid else Exit()

    def alive(self) -> bool:
        return self._ask(POLL) is None

    def end(self, patience_s: float) -> Exit:
        until = time.monotonic() + patience_s
        while self._ask(POLL) is None and time.monotonic() < until:
            time.sleep(0.01)
        return self._ask(END) or Exit()

    def _ask(self, order: bytes) -> Exit | None:
        if self._exit is None:
            try:
                self._exit = self._program.exit_of(order, self.pid)
            except (EOFError, OSError):
                if self._program.end().status != 0:
                    end_session(self.pid)  # an orphan
                self._exit = Exit()
        return self._exit


class _Shared:
    """Fork program that executes a call itself and is not ended with it."""

    def __init__(self, program: _ForkProgram) -> None:
        self.alive, self.pid = program.alive, program.pid

    def end(self, patience_s: float) -> Exit:
        return Exit()


def run_fork_program(descriptor: int, preloaded: Sequence[str]) -> None:
    """Execute orders until the caller closes the connection, then end all forks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # interrupts are handled by the caller
    for name in preloaded:
        importlib.import_module(name)
    gc.freeze()  # a collection in a fork would copy every page that they share
    forks: set[int] = set()
    with suppress(ConnectionError), socket.socket(fileno=descriptor) as control:  # closed before its answer
        channel = Channel(control)
        while True:
            message, descriptors, _, _ = socket.recv_fds(control, ORDER.size, 1)
            if len(message) < ORDER.size:
                break
            order, pid = ORDER.unpack(message)
            if order == CALL:
                with socket.socket(fileno=descriptors[0]) as connection, suppress(EOFError, OSError):
                    asked = Channel(connection)
                    _answer(asked, asked.receive())
                gc.freeze()
            elif order == FORK:
                connection = socket.socket(fileno=descriptors[0])
                pid = os.fork()
                if not pid:
                    control.close()
                    _serve_as_fork(connection)
                connection.close()
                forks.add(pid)
                channel.send(pid)
            else:
                channel.send(_reap(forks, pid, order == END))
    for pid in list(forks):
        _reap(forks, pid, True)


def _reap(forks: set[int], pid: int, kill: bool) -> Exit | None:
    """Return the exit of a fork, None if it still runs; ``kill``: kill it first."""
    if pid not in forks:
        return Exit()
    if kill:
        end_session(pid)
    ended, status, used = os.wait4(pid, 0 if kill else os.WNOHANG)
    if not ended:
        return None
    forks.discard(pid)
    unit_mb = 1e-6 if sys.platform == "darwin" else 1024e-6
    return Exit(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss * unit_mb)


def _serve_as_fork(connection: socket.socket) -> None:
    try:
        os.setsid()  # whatever the fork starts is killed with it
        serve(connection)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(70)


def serve_in_interpreter(descriptor: int) -> None:
    """Serve calls over a socket descriptor; standard output is redirected to standard error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "win32":  # not tried
        connection = socket.fromshare(sys.stdin.buffer.read())
    else:
        connection = socket.socket(fileno=descriptor)
    with suppress(OSError):
        os.dup2(2, 1)
    serve(connection)


def serve(connection: socket.socket) -> None:
    """Execute calls until the other end closes the connection, which kills this process at once."""
    channel = Channel(connection)
    calls: SimpleQueue[bytearray] = SimpleQueue()
    threading.Thread(target=_listen, args=(channel, calls), daemon=True).start()
    while True:
        _answer(channel, calls.get())


def _listen(channel: Channel, calls: SimpleQueue[bytearray]) -> None:
    with suppress(OSError, EOFError):
        while True:
            calls.put(channel.receive())
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)  # with everything it started
    os._exit(0)


def _answer(channel: Channel, call: bytearray) -> None:
    """Execute a pickled call and send its result or exception."""

    def on_message(message: dict[str, Any]) -> None:
        with suppress(OSError):  # the caller is gone, which ends this process
            channel.send((MESSAGE, message))

    try:
        seconds, wants_messages, function, arguments, options = loads(call)
        del call
        _limit_self(seconds)
        kind, answer = DONE, function(*arguments, **options, **({"on_message": on_message} if wants_messages else {}))
    except Exception as error:
        kind, answer = FAILED, error
    _limit_self(0.0)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
        try:
            channel.send((kind, answer))
        except OSError:
            raise
        except Exception as error:
            if kind == FAILED:
                raise
            channel.send((FAILED, PicklingError(str(error))))
    except Exception:
        os._exit(EXIT_CUT_OFF)


def _limit_self(seconds: float) -> None:
    """Set an alarm that ends this process after its time limit (0: none).

    Compiled loops block all threads, so the watching thread cannot end it.
    """
    if hasattr(signal, "alarm"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(int(seconds) + SELF_LIMIT_MARGIN_S if seconds else 0)


def write_output_to(file: Path) -> None:
    """Redirect all output of this process, crash reports included, to a file, and its input to nothing."""
    output = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for standard, instead in ((0, os.open(os.devnull, os.O_RDONLY)), (1, output), (2, output)):
        os.dup2(instead, standard)
    faulthandler.enable(output)


def end_session(leader: int) -> None:
    """Kill the leader of a session with all process groups of the session."""
    groups = {leader}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError):
            group, session = stat.read_text(errors="replace").rpartition(")")[2].split()[2:4]
            if int(session) == leader:
                groups.add(int(group))
    for kill, number in [*((os.killpg, group) for group in groups), (os.kill, leader)]:  # leads none before setsid
        with suppress(OSError):
            kill(number, signal.SIGKILL)


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process and its children in MB (10^6 bytes), 0 if it has ended.

    RLIMIT_AS is no alternative: it counts libraries, mapped logs and reserved addresses, and a refused allocation can
    pass for a failed filter. UsageError without /proc and psutil.
    """
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            own = int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        with suppress(OSError, ValueError), open(f"/proc/{pid}/task/{pid}/children", "rb") as file:
            own += sum(resident_mb(int(number)) for number in file.read().split())
        return own
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


def in_processes(
    function: Callable[..., T], work: Mapping[K, tuple[Any, ...]], count: int
) -> Iterator[tuple[K, T | Died]]:
    """Call ``function(*arguments)`` for each key of ``work`` in ``count`` processes; results as they come.

    Function, arguments and results must pickle. Exceptions of the function are raised here; a process that dies is the
    result of its key. The processes end with the caller's loop.
    """
    server = ForkServer([function.__module__])
    idle: SimpleQueue[Worker] = SimpleQueue()

    def call(key: K) -> tuple[K, T | Died]:
        try:
            worker = idle.get_nowait()
        except Empty:
            worker = server.worker()
        try:
            result = worker.call(function, *work[key])
        except Died as died:
            if server.closed:
                raise Closed from None
            return key, died
        idle.put(worker)
        return key, result

    threads = ThreadPoolExecutor(max(min(count, len(work)), 1), "attlog")
    try:
        for future in as_completed([threads.submit(call, key) for key in work]):
            yield future.result()
    finally:
        server.close()
        threads.shutdown(wait=True, cancel_futures=True)
