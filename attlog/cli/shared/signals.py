"""Signals that end a long run as Ctrl-C does, so that it ends in order."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def ended_by_signals() -> Iterator[list[int]]:
    """A block that SIGTERM, SIGHUP (a terminal that is closed) and SIGINT interrupt; it is given those that came.

    They raise KeyboardInterrupt. One that is ignored (SIGHUP under nohup) stays so.
    """
    received: list[int] = []

    def stop(number: int, _: Any) -> None:
        received.append(number)
        raise KeyboardInterrupt

    known = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGINT") if hasattr(signal, name)]
    watched = [s for s in known if signal.getsignal(s) != signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in watched}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
