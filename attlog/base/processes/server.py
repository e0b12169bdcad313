"""The program that has everything imported and forks one child after the other.

A fresh interpreter takes 1 s of processor time to import numpy and the analysis and to load compiled filters, a
third of what a small log takes. This program does that once, and then only forks and waits; it works on nothing
itself, so whatever a child does to its process (crash, leak, endless loop) ends with that process.
:class:`attlog.base.processes.forks.Forks` starts it.

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
from collections.abc import Sequence
from contextlib import suppress

from attlog.base.processes.child import Exit, end_session
from attlog.base.processes.serve import answer, serve
from attlog.base.processes.wire import Wire

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
