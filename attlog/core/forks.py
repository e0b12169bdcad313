"""The program that has everything imported and forks one child after the other.

A fresh interpreter takes 1 s of processor time to import numpy and the analysis and to load compiled filters, a
third of what a small log takes. This program does that once, and then only forks and waits; it works on nothing
itself, so whatever a child does to its process (crash, leak, endless loop) ends with that process.
:class:`attlog.core.forks.Forks` starts it.

Not ``multiprocessing``'s forkserver: when the parent is killed it ends no child that holds the interpreter lock; it
runs inside no daemonic worker (Dask), and (Python 3.11) imports what lies in the current folder, main in each child.

Over the control socket come orders: a letter, and the far end of a child's connection with that of its life. On
the connection the child serves. On its life this program tells the child's number and at last how it ended; its end
is the order to kill the child. A parent that is gone, for whatever reason, gives that order for all of them.
"""

from __future__ import annotations

import gc
import importlib
import os
import selectors
import signal
import socket
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from attlog.core.workers import Child, Died, Exit, Interpreter, Wire, answer, end_session, serve, value

FORK, SELF = b"f", b"s"
"""Orders: a child, or a request that this program answers itself."""


def main(descriptor: int, preloaded: Sequence[str]) -> None:
    """Serve until the parent is gone."""
    for name in preloaded:
        importlib.import_module(name)
    gc.freeze()  # a collection in a child would copy every page that they share
    wake, waker = socket.socketpair()
    for end in (wake, waker):
        end.setblocking(False)
    signal.set_wakeup_fd(waker.fileno())
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is interrupted, and decides
    with socket.socket(fileno=descriptor) as control:
        _Server(control, wake, waker).run()


class _Server:
    """Children by their numbers, each with the socket of its life."""

    def __init__(self, control: socket.socket, wake: socket.socket, waker: socket.socket) -> None:
        self._control, self._wake, self._waker = control, wake, waker
        self._lives: dict[int, socket.socket] = {}
        self._events = selectors.DefaultSelector()
        for end in (control, wake):
            self._events.register(end, selectors.EVENT_READ)

    def run(self) -> None:
        while True:
            for ready in [key.fileobj for key, _ in self._events.select()]:
                if ready is self._wake:
                    self._wake.recv(4096)
                    self._reap()
                elif ready is not self._control:
                    # a child that ended in the same moment is reaped, its life closed and forgotten already
                    for pid in [pid for pid, life in self._lives.items() if life is ready]:
                        self._events.unregister(ready)
                        end_session(pid)
                elif not self._ordered():
                    for pid in self._lives:
                        end_session(pid)
                    for pid in self._lives:
                        os.waitpid(pid, 0)
                    return

    def _ordered(self) -> bool:
        """Carry out one order; False where the parent is gone."""
        order, descriptors, _, _ = socket.recv_fds(self._control, 1, 2)
        if not order or not descriptors:
            return False
        connection = socket.socket(fileno=descriptors[0])
        if order == SELF:
            with connection, suppress(EOFError, OSError):
                wire = Wire(connection)
                answer(wire, wire.receive())
            gc.freeze()
            return True
        life = socket.socket(fileno=descriptors[1])
        pid = os.fork()
        if not pid:
            self._be_child(connection, life)
        connection.close()
        self._lives[pid] = life
        self._events.register(life, selectors.EVENT_READ)
        _tell(life, pid)
        return True

    def _be_child(self, connection: socket.socket, life: socket.socket) -> None:
        status = 70
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for other in (self._control, self._wake, self._waker, life, *self._lives.values()):
                other.close()
            os.setsid()  # whatever the child starts is killed with it
            serve(connection)
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)

    def _reap(self) -> None:
        for pid in list(self._lives):
            done, status, used = os.wait4(pid, os.WNOHANG)
            if done:
                life = self._lives.pop(pid)
                with suppress(KeyError):
                    self._events.unregister(life)
                peak_mb = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6
                _tell(life, Exit(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, peak_mb))
                life.close()


def _tell(life: socket.socket, news: int | Exit) -> None:
    with suppress(OSError):  # the parent needs it no more
        Wire(life).send(news)


# Children forked from one program that has everything imported; where nothing can fork, fresh interpreters.

BUSY_S = 2.0
"""So long the forking program is given to end its children and itself."""


class Closed(Exception):
    """The forks were closed while a child worked: the run is being interrupted."""


class Forks:
    """Starts children; may be used from several threads. Closed or dead, it takes its children with it."""

    def __init__(self, preloaded: Sequence[str] = (), environment: Mapping[str, str] | None = None) -> None:
        """``preloaded``: modules that the program imports; ``environment``: variables beside those of this process."""
        self._preloaded, self._environment = list(preloaded), dict(environment or {})
        self._lock = threading.Lock()
        self._program: Interpreter | None = None
        self._control: socket.socket | None = None
        self._prepared = False
        self._fresh: weakref.WeakSet[Child] = weakref.WeakSet()
        self.closed = False

    def prepare(self, function: Callable[..., Any], *arguments: Any, tell: Callable[..., None] | None = None) -> None:
        """Call a function in the program itself, once: all children have what it loaded. Died if that ended it."""
        with self._lock:
            if self._prepared or not hasattr(os, "fork"):
                return
            ours, theirs = socket.socketpair()
            with theirs:
                program = self._ordered(SELF, theirs)
            self._prepared = True
            Child(_Borrowed(program), ours).call(function, *arguments, tell=tell)

    def child(self) -> Child:
        """A new child. Closed if the forks are."""
        with self._lock:
            if not hasattr(os, "fork"):
                if self.closed:
                    raise Closed
                fresh = Child.started(self._environment)
                self._fresh.add(fresh)
                return fresh
            (ours, theirs), (life, their_life) = socket.socketpair(), socket.socketpair()
            with theirs, their_life:
                program = self._ordered(FORK, theirs, their_life)
        return Child(Fork(life, program), ours)

    @property
    def alive(self) -> bool:
        """Whether the forking program runs."""
        return self._program is not None and self._program.alive()

    def close(self) -> None:
        """End all children and start none any more."""
        self.closed = True  # without the lock: who holds it may wait for the program
        for fresh in list(self._fresh):
            fresh.end()
        self._end()

    def _ordered(self, order: bytes, *sockets: socket.socket) -> Interpreter:
        """Send an order to the program, which is started first where none runs."""
        for _ in range(2):  # it may die just now; if the new one does too, that is reported like any death
            program, control = self._running()
            with suppress(OSError):
                socket.send_fds(control, [order], [one.fileno() for one in sockets])
                break
        return program

    def _running(self) -> tuple[Interpreter, socket.socket]:
        if self.closed:
            raise Closed
        if self._program is None or self._control is None or not self._program.alive():
            self._end()
            self._control, theirs = socket.socketpair()
            with theirs:
                module = "attlog.core.forks"
                self._program = Interpreter(module, theirs, self._environment, self._preloaded)
            self._prepared = False
            if self.closed:  # meanwhile
                self._end()
                raise Closed
        return self._program, self._control

    def _end(self) -> None:
        program, control = self._program, self._control
        if control is not None:
            control.close()
        if program is not None:
            program.end(BUSY_S)  # it may be compiling a filter, which comes before the first child


class Fork:
    """A process that the forking program started."""

    def __init__(self, life: socket.socket, program: Interpreter) -> None:
        self._socket, self._life, self._program = life, Wire(life), program
        self._exit: Exit | None = None
        self.pid = 0
        news = self._news(None)
        if isinstance(news, int):
            self.pid = news
        else:
            self._exit = news

    def alive(self) -> bool:
        """Whether it runs."""
        return self._ended(0.0) is None

    def end(self, patience_s: float) -> Exit:
        """End it with all that it started. Where its parent is gone, nobody knows how it ended."""
        found = self._ended(patience_s)
        if found is None:
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_WR)
            found = self._ended(None)
        self._life.close()
        return found or Exit()

    def _ended(self, seconds: float | None) -> Exit | None:
        if self._exit is None:
            news = self._news(seconds)
            self._exit = news if isinstance(news, Exit) else None
        return self._exit

    def _news(self, seconds: float | None) -> int | Exit | None:
        """What the forking program tells within some time; None where it tells nothing."""
        try:
            news: int | Exit = value(self._life.receive(seconds))
        except TimeoutError:
            return None
        except (EOFError, OSError):
            if self.pid:
                with suppress(OSError):
                    os.killpg(self.pid, signal.SIGKILL)  # an orphan
            return Exit()
        return news


class _Borrowed:
    """The forking program, for a request that it answers itself."""

    def __init__(self, program: Interpreter) -> None:
        self._program = program
        self.pid = program.pid

    def alive(self) -> bool:
        """Whether it runs."""
        return self._program.alive()

    def end(self, patience_s: float) -> Exit:
        """Not at all: others use it."""
        return Exit()


# The same work on several things, in several processes: results as they come, a dead process costs its own alone.

K = TypeVar("K")
R = TypeVar("R")


def in_processes(
    function: Callable[..., R], work: Mapping[K, tuple[Any, ...]], count: int
) -> Iterator[tuple[K, R | Died]]:
    """``function(*arguments)`` for each key of ``work``, ``count`` at a time, as they finish.

    Function, arguments and results must pickle; what the function raises is raised here. Processes end with the
    caller's loop, also where that is interrupted.
    """
    forks = Forks([function.__module__])
    idle: SimpleQueue[Child] = SimpleQueue()

    def one(key: K) -> tuple[K, R | Died]:
        try:
            child = idle.get_nowait()
        except Empty:
            child = forks.child()
        try:
            result = child.call(function, *work[key])
        except Died as died:
            if forks.closed:
                raise Closed from None
            return key, died
        idle.put(child)
        return key, result

    threads = ThreadPoolExecutor(max(min(count, len(work)), 1), "attlog")
    try:
        for future in as_completed([threads.submit(one, key) for key in work]):
            yield future.result()
    finally:
        forks.close()
        threads.shutdown(wait=True, cancel_futures=True)
