"""The program that has everything imported and forks one child for each log.

A fresh interpreter takes 1 s of processor time to import numpy and the analysis and to load compiled filters, a
third of what a small log takes. This program does that once, and then only forks and waits; it analyses nothing
itself, so whatever a log does to its process (crash, leak, endless loop) ends with that process.
:class:`attlog.fleet.processes.nursery.Nursery` starts it.

Not ``multiprocessing``'s forkserver: when the parent is killed it ends no child that holds the interpreter lock; it
runs inside no daemonic worker (Dask), and (Python 3.11) imports what lies in the current folder, main in each child.

One socket stands for one log. Over the control socket comes its far end, with the work pickled; back go lines of
JSON: ``{"pid": ...}``, what the child tells, and at last ``{"exit": status, "cpu_s": ..., "peak_mb": ...}``. A byte on
the socket, or its end, is the order to kill the child; a parent that is gone, for whatever reason, gives that order
for all of them.
"""

from __future__ import annotations

import gc
import importlib
import json
import logging
import os
import pickle
import selectors
import signal
import socket
import struct
import sys
from pathlib import Path
from typing import Any

HEADER = struct.Struct("!Q")
PRELOADED = (
    "attlog.analysis.pipeline",
    "attlog.fleet.processes.child",
    "attlog.flight.ardupilot.reader",
    "attlog.flight.px4.reader",
    "attlog.formats.dataflash.reader",
    "attlog.formats.ulog.reader",
    "attlog.report.page",
    "attlog.report.templates",
    "llvmlite.binding",
    "numpy.fft",
    "numpy.ma",
    "pygeomag",
    "tomli_w",
    "vqf",
)
"""What nearly every log needs; what is left out is imported by the child that needs it."""


def main(control_fd: int) -> None:
    """Serve until the parent is gone."""
    for name in PRELOADED:
        importlib.import_module(name)
    gc.freeze()  # a collection in a child would copy every page that they share
    wake, waker = socket.socketpair()
    for end in (wake, waker):
        end.setblocking(False)
    signal.set_wakeup_fd(waker.fileno())
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is interrupted, and decides
    with socket.socket(fileno=control_fd) as control:
        _serve(control, wake, waker)


def _serve(control: socket.socket, wake: socket.socket, waker: socket.socket) -> None:
    events = selectors.DefaultSelector()
    events.register(control, selectors.EVENT_READ)
    events.register(wake, selectors.EVENT_READ)
    jobs: dict[int, socket.socket] = {}
    warm = False
    while True:
        for ready in [key.fileobj for key, _ in events.select()]:
            if ready is control:
                payload, job = _received(control)
                if job is None:
                    for pid in jobs:
                        _kill(pid)
                    for pid in jobs:
                        os.waitpid(pid, 0)
                    return
                if not warm:
                    _warm(payload, job)
                    warm = True
                pid = _forked(payload, job, [control, wake, waker, *jobs.values()])
                jobs[pid] = job
                _tell(job, {"pid": pid})
                events.register(job, selectors.EVENT_READ)
            elif ready is wake:
                wake.recv(4096)
                for pid in list(jobs):
                    done, status, used = os.wait4(pid, os.WNOHANG)
                    if done:
                        job = jobs.pop(pid)
                        events.unregister(job) if job in _registered(events) else None
                        _tell(
                            job,
                            {
                                "exit": os.waitstatus_to_exitcode(status),
                                "cpu_s": used.ru_utime + used.ru_stime,
                                "peak_mb": used.ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6,
                            },
                        )
                        job.close()
            else:
                events.unregister(ready)
                for pid, job in jobs.items():
                    if job is ready:
                        _kill(pid)


def _warm(payload: bytes, job: socket.socket) -> None:
    """Load the filters of the first log here, once for all; where they have to be compiled that log tells so."""
    from attlog.analysis.preload import preload
    from attlog.fleet.processes.child import Telling

    logger, telling = logging.getLogger("attlog.compiling"), Telling(lambda told: _tell(job, told))
    logger.addHandler(telling)
    logger.setLevel(logging.INFO)
    preload(pickle.loads(payload)[0].config.estimators)
    logger.removeHandler(telling)
    gc.freeze()


def _registered(events: selectors.BaseSelector) -> list[Any]:
    return [key.fileobj for key in events.get_map().values()]


def _received(control: socket.socket) -> tuple[bytes, socket.socket | None]:
    """One order: the pickled work and the socket of its log, which is None when the parent is gone."""
    head, fds, _, _ = socket.recv_fds(control, HEADER.size, 1)
    if not head or not fds:
        return b"", None
    while len(head) < HEADER.size:
        head += control.recv(HEADER.size - len(head))
    (size,) = HEADER.unpack(head)
    payload = bytearray()
    while len(payload) < size:
        block = control.recv(min(size - len(payload), 1 << 20))
        if not block:
            return b"", None
        payload += block
    return bytes(payload), socket.socket(fileno=fds[0])


def _forked(payload: bytes, job: socket.socket, others: list[socket.socket]) -> int:
    """The process number of a child that does the work."""
    pid = os.fork()
    if pid:
        return pid
    status = 70
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for other in others:
            other.close()
        os.setsid()  # whatever the child starts is killed with it
        _do(payload, job)
        status = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _do(payload: bytes, job: socket.socket) -> None:
    from attlog.fleet.processes.child import analyse, quietly

    work, room = pickle.loads(payload)
    quietly(Path(room))
    analyse(work, Path(room), lambda told: _tell(job, told))


def _tell(job: socket.socket, told: dict[str, Any]) -> None:
    """One line to the parent, begun anew: a child may have died within its own. A parent that is gone hears nothing."""
    try:
        job.sendall(b"\n" + json.dumps(told).encode() + b"\n")
    except OSError:
        return


def _kill(pid: int) -> None:
    """End a child and what it started; before its ``setsid`` it has no group of its own."""
    groups = {pid} | _groups_of_session(pid)
    for end, number in [*((os.killpg, group) for group in groups), (os.kill, pid)]:
        try:
            end(number, signal.SIGKILL)
        except OSError:
            continue


def _groups_of_session(leader: int) -> set[int]:
    """The process groups in the session of a child, such as those of filters' processes; none where nothing tells."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            group, session = stat.read_text(errors="replace").rpartition(")")[2].split()[2:4]
        except (OSError, ValueError):
            continue
        if int(session) == leader:
            found.add(int(group))
    return found
