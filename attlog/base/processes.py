"""The same work on several things, in several processes: results as they come, a dead process costs its own alone."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

K = TypeVar("K")
R = TypeVar("R")
SAFE_PATH = "PYTHONSAFEPATH"


class Died(Exception):
    """A process that is gone without a word (out of memory, a plug-in that crashes)."""


def in_processes(
    function: Callable[..., R], work: Mapping[K, tuple[Any, ...]], count: int
) -> Iterator[tuple[K, R | Died]]:
    """``function(*arguments)`` for each key of ``work``, ``count`` at a time, as they finish.

    Function, arguments and results must pickle, and the function must not raise. Processes end with the
    caller's loop, also where that is interrupted.
    """
    waiting = dict(work)
    for key, result in _pool(function, waiting, min(count, len(waiting))):
        del waiting[key]
        yield key, result
    for key, arguments in waiting.items():  # a process died, which ends all of its pool: who was it?
        yield next(_pool(function, {key: arguments}, 1), (key, Died("the process ended without a word")))


def _pool(function: Callable[..., R], work: dict[K, tuple[Any, ...]], count: int) -> Iterator[tuple[K, R]]:
    """Results from a pool of processes, until one of them dies."""
    others = set(multiprocessing.active_children())
    with _without_current_folder():  # the pool's own helper process starts with it
        pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _leave_interrupts_to_the_parent)
    try:
        with _without_current_folder():
            keys: dict[Future[R], K] = {pool.submit(function, *arguments): key for key, arguments in work.items()}
        for future in as_completed(keys):
            try:
                yield keys[future], future.result()
            except BrokenProcessPool:
                continue  # results that were finished before still come
        pool.shutdown()
    finally:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()  # an interrupted analysis would go on for minutes
            child.join()
        pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _without_current_folder() -> Iterator[None]:
    """Processes started meanwhile import nothing from the current folder, where a file may be called numpy.py.

    An environment variable: ``multiprocessing`` takes no options for the interpreters that it starts.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
