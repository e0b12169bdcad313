"""What the tests have done in other processes."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np


def negated(x: np.ndarray) -> np.ndarray:
    return -x


def process() -> int:
    return os.getpid()


def parent() -> int:
    return os.getppid()


def raising() -> None:
    raise ValueError("no good")


def lambda_() -> Any:
    return lambda: 0


def sleeping(seconds: float) -> None:
    time.sleep(seconds)


def filling(megabytes: float) -> None:
    held = bytearray(int(megabytes * 1e6))
    time.sleep(60)
    del held


def ending(status: int) -> None:
    os._exit(status)


def killing(number: int) -> None:
    os.kill(os.getpid(), number)


def interrupting() -> str:
    os.kill(os.getpid(), signal.SIGINT)
    return "went on"


def counting(count: int, *, on_message: Callable[[dict[str, Any]], None]) -> str:
    for k in range(count):
        on_message({"at": k})
    return "done"


def starting() -> int:
    """The number of a process that was started by this one."""
    child = os.fork()
    if not child:
        time.sleep(60)
        os._exit(0)
    return child


def square(x: int) -> int:
    if x == 3:
        os._exit(5)
    return x * x


MARK: list[str] = []


def mark(text: str) -> None:
    MARK.append(text)


def marks() -> list[str]:
    return MARK
