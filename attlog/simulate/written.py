"""Flights of a scenario to their files, one after the other or in several processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from attlog.base.files.output import staged
from attlog.base.processes.pool import in_processes
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.scenario.scenario import Scenario

Written = list[tuple[Path, int]] | Exception
"""Each path with its bytes, or what went wrong."""


def flights(
    scenario: Scenario, work: Mapping[int, Sequence[Path]], params: Mapping[str, float | int], jobs: int = 1
) -> Iterator[tuple[int, Written]]:
    """What became of each seed of ``work`` and its paths: in their order, or as ``jobs`` processes finish them."""
    if jobs == 1 or len(work) == 1:
        for seed, paths in work.items():
            yield seed, written(scenario, seed, paths, params)
        return
    calls = {seed: (scenario, seed, paths, params) for seed, paths in work.items()}
    yield from in_processes(written, calls, jobs)


def written(scenario: Scenario, seed: int, paths: Sequence[Path], params: Mapping[str, float | int]) -> Written:
    """Fly one seed and write every log of it, all or none."""
    try:
        flight = fly(scenario, seed)
        with ExitStack() as stages:
            stage = {folder: stages.enter_context(staged(folder)) for folder in {path.parent for path in paths}}
            for path in paths:
                write(stage[path.parent] / path.name, flight, params)
        return [(path, path.stat().st_size) for path in paths]
    except Exception as error:
        return error
