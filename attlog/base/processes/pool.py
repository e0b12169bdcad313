"""The same work on several things, in several processes: results as they come, a dead process costs its own alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from attlog.base.processes.child import Child, Died
from attlog.base.processes.forks import Closed, Forks

K = TypeVar("K")
R = TypeVar("R")


def in_processes(
    function: Callable[..., R], work: Mapping[K, tuple[Any, ...]], count: int
) -> Iterator[tuple[K, R | Died]]:
    """``function(*arguments)`` for each key of ``work``, ``count`` at a time, as they finish.

    Function, arguments and results must pickle; what the function raises is raised here. Processes end with the
    caller's loop, also where that is interrupted.
    """
    forks = Forks([function.__module__])
    idle: SimpleQueue[Child] = SimpleQueue()

    def one(key: K) -> tuple[K, R | Died]:
        try:
            child = idle.get_nowait()
        except Empty:
            child = forks.child()
        try:
            result = child.call(function, *work[key])
        except Died as died:
            if forks.closed:
                raise Closed from None
            return key, died
        idle.put(child)
        return key, result

    threads = ThreadPoolExecutor(max(min(count, len(work)), 1), "attlog")
    try:
        for future in as_completed([threads.submit(one, key) for key in work]):
            yield future.result()
    finally:
        forks.close()
        threads.shutdown(wait=True, cancel_futures=True)
