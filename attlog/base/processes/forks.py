"""Children forked from one program that has everything imported; where nothing can fork, fresh interpreters."""

from __future__ import annotations

import os
import signal
import socket
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from attlog.base.processes.child import Child, Exit, Interpreter
from attlog.base.processes.server import FORK, SELF
from attlog.base.processes.wire import Wire, value

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
                module = "attlog.base.processes.server"
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
