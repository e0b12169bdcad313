"""Cost of one update: every filter, and the packages vqf and ahrs.

    python benchmarks/kernels.py [--filters LIST] [--turns 15]

Prints nanoseconds of CPU time per update (one thread, kernels loaded from the cache: each runs once before it counts).
What is compared runs by turns on the same data, so that a shared machine slows both; medians.
``vqf`` is the package, called as attlog calls it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import cache

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


def ahrs(gyr: np.ndarray, acc: np.ndarray, mag: np.ndarray) -> Work:
    """The peer's Mahony on the first 1000 samples."""
    from ahrs.filters import Mahony  # type: ignore[import-untyped]

    n = 1000
    return clocked(lambda: Mahony(gyr=gyr[:n], acc=-acc[:n], mag=mag[:n], frequency=RATE, k_P=0.6, k_I=0.0012), n)


def per_update(filters: Sequence[str], turns: int = TURNS) -> dict[str, np.ndarray]:
    """Nanoseconds per update (turns,) of filters, by turns on the same data."""
    samples = prepare(*data())
    return by_turns({name: scalar(name, samples) for name in filters}, turns)


def against_ahrs(turns: int = 3) -> dict[str, np.ndarray]:
    """Nanoseconds per update (turns,) of ``mahony`` and of the package's."""
    t, gyr, acc, mag = data()
    return by_turns({"ahrs": ahrs(gyr, acc, mag), "mahony": scalar("mahony", prepare(t, gyr, acc, mag))}, turns)


GROUP = "Filters, per update"


def tasks(turns: int = TURNS) -> list[Task]:
    """Every row about filters; each in a process of its own."""

    def ratio(ours: str, theirs: str, found: dict[str, np.ndarray], peer: str, faster: bool = False) -> Measured:
        a, b = float(np.median(found[ours])), float(np.median(found[theirs]))
        return Measured(b / a if faster else a / b, f"{a:.3g} ns", f"{peer} {b:.3g} ns", len(found[ours]))

    @cache
    def costs() -> dict[str, np.ndarray]:
        return apart(per_update, ("mahony", "madgwick", "ekf12", "vqf", "mekf", "eskf"), turns)

    def of(name: str) -> Callable[[], Measured]:
        return lambda: ratio(name, "vqf", costs(), "vqf")

    return [
        Task(GROUP, "mahony", None, of("mahony")),
        Task(GROUP, "madgwick", None, of("madgwick")),
        Task(GROUP, "ekf12", Target("≤", 0.8, earlier=1.0), of("ekf12")),
        Task(GROUP, "mekf", None, of("mekf")),
        Task(GROUP, "eskf", None, of("eskf")),
        Task(
            GROUP,
            "mahony against Mahony of ahrs (Python)",
            Target("≥", 3000),
            lambda: ratio("mahony", "ahrs", apart(against_ahrs), "ahrs", faster=True),
        ),
    ]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--filters", default="all", help="with commas")
    parser.add_argument("--turns", type=int, default=TURNS)
    options = parser.parse_args(arguments)
    filters = [name for name in names() if name != "fusion"] if options.filters == "all" else options.filters.split(",")
    cost = per_update(filters, options.turns)
    if options.filters == "all":
        cost |= per_update(["fusion"], 1)
    print(f"{'filter':24}{'ns per update':>14}")
    for name, ns in cost.items():
        print(f"{name:24}{np.median(ns):14.0f}")
    if {"ekf12", "vqf"} <= set(cost):
        print(f"ekf12 takes {np.median(cost['ekf12']) / np.median(cost['vqf']):.2f} of vqf's time")
    cost = against_ahrs()
    ratio = np.median(cost["ahrs"]) / np.median(cost["mahony"])
    print(f"\nahrs Mahony {np.median(cost['ahrs']):.0f} ns: {ratio:.0f} times attlog's")


if __name__ == "__main__":
    main()
