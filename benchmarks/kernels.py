"""Cost of one update: every filter, and the package vqf.

    python benchmarks/kernels.py [--filters LIST] [--turns 15]

Prints nanoseconds of CPU time per update (one thread, kernels loaded from the cache: each runs once before it counts).
What is compared runs by turns on the same data, so that a shared machine slows both; medians.
``vqf`` is attlog's row around the package, ``package vqf`` the package's own pass over the same arrays.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from measured import apart
from table import Measured, Target, Task

from attlog.core import rotation
from attlog.estimators import get, names
from attlog.estimators import run as loop
from attlog.estimators.samples import PreparedSamples, prepare

SAMPLES = 50_000
RATE = 250.0
TURNS = 15


def data() -> tuple[np.ndarray, ...]:
    """Noisy motion, 200 s at 250 Hz: t, gyr, acc, mag."""
    rng = np.random.default_rng(1)
    t = np.arange(SAMPLES) / RATE
    q = rotation.from_euler(0.4 * np.sin(t), 0.3 * np.cos(1.3 * t), 0.5 * t)
    gyr = np.vstack([np.zeros(3), rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) * RATE])
    noise = [rng.normal(0, s, (SAMPLES, 3)) for s in (0.01, 0.3, 0.3)]
    acc, mag = (rotation.rotate_inverse(q, v) for v in ([0, 0, -9.81], [20.0, 0, 40.0]))
    return t, gyr + noise[0], acc + noise[1], mag + noise[2]


Work = Callable[[], float]
"""Runs once and gives nanoseconds per update."""


def by_turns(works: dict[str, Work], turns: int = TURNS) -> dict[str, np.ndarray]:
    """Nanoseconds per update (turns,) of each work; every turn runs all of them."""
    for work in works.values():
        work()
    times = [[work() for work in works.values()] for _ in range(turns)]
    return dict(zip(works, np.array(times).T, strict=True))


def clocked(work: Callable[[], object], updates: int) -> Work:
    """The work with CPU time taken around it."""

    def run() -> float:
        begin = time.thread_time()
        work()
        return 1e9 * (time.thread_time() - begin) / updates

    return run


def scalar(name: str, samples: PreparedSamples) -> Work:
    """One filter's own cost, preparation left out."""
    e = get(name)
    values = {k: v for k, (v, _) in e.resolve().items()}
    return lambda: loop.run(e, samples, values).ns_per_update


PACKAGE = "package vqf"


def package(gyr: np.ndarray, acc: np.ndarray, mag: np.ndarray) -> Work:
    """The peer's pass over all samples, in C++."""
    from vqf import VQF

    return clocked(lambda: VQF(1.0 / RATE).updateBatch(gyr, acc, mag), len(gyr))


def per_update(filters: Sequence[str], turns: int = TURNS) -> dict[str, np.ndarray]:
    """Nanoseconds per update (turns,) of filters and of the package vqf, by turns on the same data."""
    arrays = data()
    samples = prepare(*arrays)
    return by_turns({name: scalar(name, samples) for name in filters} | {PACKAGE: package(*arrays[1:])}, turns)


GROUP = "Filters, per update"
ROWS = {
    "mahony": None,
    "madgwick": None,
    "ekf12": Target("≤", 0.8),
    "mekf": None,
    "eskf": None,
    "vqf": Target("≤", 1.1),
}
"""Filters of the table and what their update may take of the package's."""


def tasks(turns: int = TURNS) -> list[Task]:
    """Every row about filters; each in a process of its own."""

    @cache
    def costs() -> dict[str, np.ndarray]:
        return apart(per_update, tuple(ROWS), turns)

    def of(name: str) -> Measured:
        ours, theirs = (float(np.median(costs()[key])) for key in (name, PACKAGE))
        return Measured(ours / theirs, f"{ours:.3g} ns", f"{PACKAGE} {theirs:.3g} ns", turns)

    return [Task(GROUP, name, aim, partial(of, name)) for name, aim in ROWS.items()]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--filters", default="all", help="with commas")
    parser.add_argument("--turns", type=int, default=TURNS)
    options = parser.parse_args(arguments)
    filters = [name for name in names() if name != "fusion"] if options.filters == "all" else options.filters.split(",")
    cost = per_update(filters, options.turns)
    if options.filters == "all":
        cost = per_update(["fusion"], 1) | cost
    print(f"{'filter':24}{'ns per update':>14}")
    for name, ns in cost.items():
        print(f"{name:24}{np.median(ns):14.0f}")


if __name__ == "__main__":
    main()
