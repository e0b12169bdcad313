"""A fork of this process that does its work and leaves it to say what killed the fork; signals are handed on."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any

from attlog.base.processes import life

INTERRUPTED_S = 2
"""A terminal interrupts both processes, another program (``kill -INT``) this one alone. Which it was cannot be known: a
child that is still there after so long is interrupted by this one."""


def in_fork(run: Callable[[], int]) -> int:
    """What ``run`` returns in a fork of this process; the negative number of the signal that ended it.

    SIGTERM, SIGHUP and SIGINT are handed on, unless they are ignored here. The fork ends with this process. For the
    start of a program: what other threads hold is held for good in a fork.
    """
    watched, kept = life.pipe()
    child = os.fork()
    if not child:
        code = 70
        try:
            life.close(kept)
            life.end_with(watched)
            code = run()
        finally:
            os._exit(code)
    life.close(watched)

    def hand_on(number: int, _: Any) -> None:
        os.kill(child, number)

    def hand_on_later(number: int, _: Any) -> None:
        signal.signal(signal.SIGALRM, lambda *_: os.kill(child, number))
        signal.alarm(INTERRUPTED_S)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    before[signal.SIGALRM] = signal.getsignal(signal.SIGALRM)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        if before[number] != signal.SIG_IGN:
            signal.signal(number, hand_on_later if number == signal.SIGINT else hand_on)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.alarm(0)
    for number, handler in before.items():
        signal.signal(number, handler)
    life.close(kept)
    return code
