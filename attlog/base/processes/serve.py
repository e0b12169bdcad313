"""The side of a child process: it calls the functions that it is asked for, until nobody asks any more."""

from __future__ import annotations

import faulthandler
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from pickle import PicklingError
from queue import SimpleQueue
from typing import Any

from attlog.base.processes.wire import Wire, parts, value

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
