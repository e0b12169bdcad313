"""The same experiment for many seeds, in several processes; results in the order of the seeds."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from attlog.base.errors import AttlogError
from attlog.base.processes.child import Died
from attlog.base.processes.pool import in_processes
from attlog.reproduce.paper import PaperOptions

R = TypeVar("R")
STAGES = logging.getLogger("attlog.stages")


def each_seed(what: str, experiment: Callable[..., R], options: PaperOptions, *arguments: Any) -> list[R]:
    """``experiment(seed, *arguments)`` for seeds 0, 1, ... as ``options`` say. AttlogError if a process dies.

    ``experiment`` is a function of a module and its result pickles; ``what`` is said while it works.
    """
    return each(what, experiment, [(seed, *arguments) for seed in range(options.seeds)], options)


def each(what: str, experiment: Callable[..., R], work: Sequence[tuple[Any, ...]], options: PaperOptions) -> list[R]:
    """``experiment(*arguments)`` for each of ``work``, in its order."""
    if options.processes <= 1 or len(work) <= 1:
        found: dict[int, R] = {}
        for k, arguments in enumerate(work):
            STAGES.info("%s, %d of %d", what, k + 1, len(work))
            found[k] = experiment(*arguments)
        return list(found.values())
    found = {}
    for k, result in in_processes(experiment, dict(enumerate(work)), options.processes):
        if isinstance(result, Died):
            raise AttlogError(f"{what}, number {k}: {result}")
        found[k] = result
        STAGES.info("%s, %d of %d", what, len(found), len(work))
    return [found[k] for k in range(len(work))]
