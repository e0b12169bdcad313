"""Work done on this machine: so many logs at a time, each in a process of its own, records as they come."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

from attlog.base.processes.forks import Forks
from attlog.fleet.processes.run import forks, run_one
from attlog.fleet.records.record import Record
from attlog.fleet.records.work import Work

Records = Generator[Record, None, None]
Runner = Callable[[Sequence[Work]], Records]
"""Does the work, wherever, and gives one record for each as it comes; ends what runs when it is closed."""
Tell = Callable[[Work, dict[str, Any]], None]


def local_runner(workers: int | None = None, tell: Tell | None = None, processes: Forks | None = None) -> Runner:
    """A runner on this machine; as many ``workers`` as it has cores by default. ``tell`` hears the stages of each log.

    ``tell`` is called from threads. ``processes``: used again, and closed by whoever made them.
    """

    def run(works: Sequence[Work]) -> Records:
        return _run(works, min(workers or cores(), max(len(works), 1)), tell, processes)

    return run


def cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run(works: Sequence[Work], workers: int, tell: Tell | None, kept: Forks | None) -> Records:
    processes = kept or forks()

    def one(work: Work) -> Record:
        return run_one(work, processes, None if tell is None else lambda told: tell(work, told))

    pool = ThreadPoolExecutor(workers, "attlog")
    try:
        if workers == 1:  # in order: the next begins when its predecessor was taken
            yield from map(one, works)
            return
        for future in as_completed(pool.submit(one, work) for work in works):
            yield future.result()
    finally:
        if kept is None:
            processes.close()  # first: a thread waits for its child
        pool.shutdown(wait=True, cancel_futures=True)
