"""A log too large to be read into memory is mapped; where it is cut meanwhile the system ends the process (SIGBUS).

Then another process has to say so. It costs a fork before anything is imported, and only where a log is so large.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from attlog import __version__
from attlog.base import limits
from attlog.base.errors import LogUnreadable, exit_code, message

INTERRUPTED_S = 2
"""A terminal interrupts both processes, another program (``kill -INT``) this one alone. Which it was cannot be told: a
child that is still there after so long is interrupted by this one."""


def guarded(run: Callable[[], int], words: Sequence[str]) -> int:
    """The exit code of ``run``, in a child process where one of the ``words`` names a file that is mapped."""
    large = [word for word in words if os.path.isfile(word) and os.path.getsize(word) > limits.READ_BYTES]
    if not large or not hasattr(os, "fork"):
        return run()
    child = os.fork()
    if not child:
        os.environ[limits.MAPPED] = "1"
        code = 70
        try:
            code = run()
        except BaseException as error:  # ``run`` tells errors itself, unless memory is too short even for that
            code = exit_code(error)
            os.write(2, f"{message(error, __version__)}\n".encode(errors="replace"))
        finally:
            os._exit(code)

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
    if code == -signal.SIGBUS:
        print(f"attlog: {large[0]}: became shorter while it was read; try again when it is whole", file=sys.stderr)
        return LogUnreadable.exit_code
    if code < 0:
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code
