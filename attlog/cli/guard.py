"""A log too large to be read into memory is mapped; where it is cut meanwhile the system ends the process (SIGBUS).

Then another process has to say so. It costs a fork before anything is imported, and only where a log is so large.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from attlog import limits
from attlog.errors import LogUnreadable


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
        finally:
            os._exit(code)

    def hand_on(number: int, _: Any) -> None:
        os.kill(child, number)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    for number in (signal.SIGTERM, signal.SIGHUP):
        if before[number] != signal.SIG_IGN:
            signal.signal(number, hand_on)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal interrupts both: the child decides
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    for number, handler in before.items():
        signal.signal(number, handler)
    if code == -signal.SIGBUS:
        print(f"attlog: {large[0]}: became shorter while it was read; try again when it is whole", file=sys.stderr)
        return LogUnreadable.exit_code
    if code < 0:
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code
