"""The end of a parent ends its child, whatever the child is doing.

A child that holds the interpreter lock (a compiled loop, a regular expression) runs no thread that could notice that
its parent was killed. So the system is asked: the parent keeps the writing end of a pipe, and the kernel kills the
child when that end closes. Linux alone knows such a signal; elsewhere the thread of ``serve`` has to do.

Not ``PR_SET_PDEATHSIG``: it comes when the *thread* ends that started the child, and it spares what the child started.
"""

from __future__ import annotations

import os
import select
import signal
import sys

NO_LIFE = -1
"""In place of a pipe where there is none."""


def pipe() -> tuple[int, int]:
    """The two ends: what the child watches, and what the parent keeps open."""
    return os.pipe() if sys.platform == "linux" else (NO_LIFE, NO_LIFE)


def end_with(life: int) -> int:
    """Let the system kill this process, with its group where it leads one, when the parent's end of a pipe closes.

    Returns a descriptor of its own: closing it takes the order back. Called once in every process that is forked.
    """
    if life == NO_LIFE or sys.platform != "linux":
        return NO_LIFE
    import fcntl

    watched = os.open(f"/proc/self/fd/{life}", os.O_RDONLY | os.O_NONBLOCK)  # a fork shares the order of its parent's
    leads = os.getpgrp() == os.getpid()
    fcntl.fcntl(watched, fcntl.F_SETOWN, -os.getpid() if leads else os.getpid())
    fcntl.fcntl(watched, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(watched, fcntl.F_SETFL, os.O_ASYNC | os.O_NONBLOCK)
    ended = select.poll()
    ended.register(watched, select.POLLHUP)
    if ended.poll(0):  # before it was asked
        os.kill(-os.getpid() if leads else os.getpid(), signal.SIGKILL)
    return watched


def close(*descriptors: int) -> None:
    """Close ends of pipes that are there."""
    for descriptor in descriptors:
        if descriptor != NO_LIFE:
            os.close(descriptor)
