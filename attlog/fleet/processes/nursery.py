"""One child process per log, from a program that has everything imported and only forks: the side of the caller.

Where there is no fork, each child is a fresh interpreter: :class:`attlog.fleet.processes.fresh.Fresh`.
"""

from __future__ import annotations

import functools
import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from attlog.base import limits
from attlog.fleet.processes.forking import HEADER
from attlog.fleet.processes.fresh import Fresh
from attlog.fleet.records.work import Work

START = "import sys; sys.path[:] = {path!r}; from attlog.fleet.processes.forking import main; main({fd})"
"""Not ``-m``: that would put the current folder first, where a file next to a log could be called numpy.py."""
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Processes are as many as cores already; and sums over several threads may differ in the last bit."""


BUSY_S = 2.0
"""So long the forking program is given to end its children and itself."""


class Closed(Exception):
    """The nursery was closed while a child worked: the run is being interrupted."""


class Nursery:
    """Starts children; may be used from several threads. Closed or dead, it takes its children with it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None
        self._fresh: weakref.WeakSet[Fresh] = weakref.WeakSet()
        self.closed = False

    def child(self, work: Work, room: Path) -> Child | Fresh:
        """A child that does the work and writes its files to ``room``. Closed if the nursery is."""
        if not hasattr(os, "fork"):
            with self._lock:
                if self.closed:
                    raise Closed
                fresh = Fresh(work, room, _environment())
                self._fresh.add(fresh)
            return fresh
        ours, theirs = socket.socketpair()
        payload = pickle.dumps((work, str(room)))
        with self._lock, theirs:
            if self.closed:
                ours.close()
                raise Closed
            for _ in range(2):  # the program may die just now; if the new one does too, that is told like any death
                control = self._started()
                with suppress(OSError):
                    socket.send_fds(control, [HEADER.pack(len(payload))], [theirs.fileno()])
                    control.sendall(payload)
                    break
            owner = self._process
        return Child(ours, owner)

    @property
    def alive(self) -> bool:
        """Whether the forking program runs."""
        return self._process is not None and self._process.poll() is None

    def close(self) -> None:
        """End all children and start none any more."""
        with self._lock:
            self.closed = True
            for fresh in self._fresh:
                fresh.kill()
            self._end()

    def _started(self) -> socket.socket:
        """The way to the forking program, which is started first where none runs."""
        if self._control is not None and self.alive:
            return self._control
        self._end()
        ours, theirs = socket.socketpair()
        with theirs:
            start = START.format(path=sys.path, fd=theirs.fileno())
            # a session of its own: Ctrl-C goes to the caller alone
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", start],
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=_environment(),
            )
        self._control = ours
        return ours

    def _end(self) -> None:
        if self._control is not None:
            self._control.close()
        if self._process is not None:
            try:
                self._process.wait(BUSY_S)
            except subprocess.TimeoutExpired:  # it compiles a filter, which comes before the first child
                self._process.kill()
                self._process.wait()
        self._control = self._process = None


@functools.lru_cache(maxsize=1)
def shared() -> Nursery:
    """The nursery of this process, for callers that bring none (a task of a cluster)."""
    return Nursery()


class Child:
    """A process at work on one log."""

    def __init__(self, ours: socket.socket, owner: subprocess.Popen[bytes] | None) -> None:
        self._socket, self._owner = ours, owner
        self._pid = 0

    def messages(self, pause: float) -> Iterator[dict[str, Any]]:
        """What is told, with an empty message after each ``pause`` seconds of silence; ``exit`` is the last.

        Where the forking program was killed, its orphan is ended too, and there is no ``exit``.
        """
        self._socket.settimeout(pause)
        rest = b""
        while True:
            try:
                block = self._socket.recv(1 << 16)
            except TimeoutError:
                if self._owner is not None and self._owner.poll() is None:
                    yield {}
                    continue
                self._end_orphan()
                block = b""
            except ConnectionResetError:
                block = b""
            if not block:
                return
            *lines, rest = (rest + block).split(b"\n")
            for line in lines:
                message = _message(line)
                self._pid = message.get("pid", self._pid)
                if message:
                    yield message
                if "exit" in message:
                    return

    def _end_orphan(self) -> None:
        """End a child whose parent is gone, and what it started."""
        if self._pid:
            with suppress(OSError):
                os.killpg(self._pid, signal.SIGKILL)

    def kill(self) -> None:
        """End the process now; its ``exit`` is told as ever."""
        with suppress(OSError):  # it has ended meanwhile
            self._socket.sendall(b"k")

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()  # a child that still runs is killed with that


def _environment() -> dict[str, str]:
    """What children see; where a mapped file is cut, the process that waits for them says so."""
    return dict.fromkeys(ONE_THREAD, "1") | {limits.MAPPED: "1"} | os.environ


def _message(line: bytes) -> dict[str, Any]:
    """A line as a message; empty for a line that a dying process broke off."""
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
