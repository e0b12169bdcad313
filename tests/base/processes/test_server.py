"""The program that forks children: what comes together is carried out together."""

from __future__ import annotations

import os
import socket
import sys

import pytest

from attlog.base.processes.server import _Server


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
def test_a_child_that_ends_as_its_caller_lets_go_of_it_ends_nothing_else() -> None:
    """Its end, the end of its life and the end of the orders are read in one batch, in this order."""
    pairs = [socket.socketpair() for _ in range(3)]
    (parent, control), (wake, waker), (held, life) = pairs
    server = _Server(control, wake, waker)
    pid = os.fork()
    if not pid:
        os._exit(0)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # it has ended, and is still to be reaped
    server._lives[pid] = life
    server._events.register(life, 1)
    waker.send(b"x")
    held.close()
    parent.close()
    server.run()
    assert server._lives == {}
    with pytest.raises(ChildProcessError):
        os.waitpid(pid, 0)
    for end in (control, wake, waker):
        end.close()
