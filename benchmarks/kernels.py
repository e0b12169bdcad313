"""Cost of one update: every filter, batches of parameter sets against the scalar kernel, and the packages vqf and ahrs.

    python benchmarks/kernels.py

Prints nanoseconds of CPU time per update (one thread, kernels loaded from the cache). What is
compared runs by turns on the same data, so that a shared machine slows both; medians. Batches
keep every 8th output, as a sweep does. Targets: mahony 60 ns and 3000 times faster than
ahrs, ekf12 not slower than vqf, a batch of mahony 4 (float64) and 10 (float32) times faster
than one by one.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from attlog import rotation
from attlog.estimators import get, names
from attlog.estimators.engine import batch, loop
from attlog.estimators.engine.samples import Samples, prepare

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


def scalar(name: str, samples: Samples) -> Work:
    """One filter's own cost, preparation left out."""
    e = get(name)
    values = {k: v for k, (v, _) in e.resolve().items()}
    return lambda: loop.run(e, samples, values).ns_per_update


def batched(name: str, samples: Samples, dtype: str) -> Work:
    """Cost per update and parameter set of a full kernel width."""
    e = get(name)
    packed = e.pack({k: v for k, (v, _) in e.resolve().items()})
    advance = batch.kernel(e, {i: packed[i] for i, p in enumerate(e.own) if p.choices}, dtype)
    width = batch.WIDTH[dtype]
    work = np.zeros((e.state_size + len(packed) + 3, width), dtype)
    work[0] = 1
    work[e.state_size : -3] = packed[:, None]
    out = np.empty((-(-SAMPLES // 8), e.outputs, width), dtype)
    dt, gyr, acc, mag = (np.ascontiguousarray(x, dtype) for x in (samples.dt, samples.gyr, samples.acc, samples.mag))
    flat = work.ravel()
    return clocked(lambda: advance(flat, dt, samples.substeps, gyr, acc, mag, samples.use, 8, out), SAMPLES * width)


def ahrs(gyr: np.ndarray, acc: np.ndarray, mag: np.ndarray) -> Work:
    """The peer's Mahony on the first 1000 samples."""
    from ahrs.filters import Mahony

    n = 1000
    return clocked(lambda: Mahony(gyr=gyr[:n], acc=-acc[:n], mag=mag[:n], frequency=RATE, k_P=0.6, k_I=0.0012), n)


def main() -> None:
    t, gyr, acc, mag = data()
    samples = prepare(t, gyr, acc, mag)
    cost = by_turns({name: scalar(name, samples) for name in names() if name != "fusion"})
    cost["fusion"] = by_turns({"fusion": scalar("fusion", samples)}, 1)["fusion"]
    print(f"{'filter':24}{'ns per update':>14}")
    for name, ns in cost.items():
        print(f"{name:24}{np.median(ns):14.0f}")
    print(f"ekf12 takes {np.median(cost['ekf12'] / cost['vqf']):.2f} of vqf's time")
    print(f"\n{'batch':24}{'ns per set':>14}{'ratio':>8}")
    for name in ("mahony", "complementary", "madgwick"):
        works = {dtype: batched(name, samples, dtype) for dtype in batch.WIDTH}
        cost = by_turns({"scalar": scalar(name, samples), **works})
        for dtype in works:
            ratio = np.median(cost["scalar"] / cost[dtype])
            print(f"{name + ' ' + dtype:24}{np.median(cost[dtype]):14.1f}{ratio:8.1f}")
    cost = by_turns({"ahrs": ahrs(gyr, acc, mag), "mahony": scalar("mahony", samples)}, 3)
    ratio = np.median(cost["ahrs"] / cost["mahony"])
    print(f"\nahrs Mahony {np.median(cost['ahrs']):.0f} ns: {ratio:.0f} times attlog's")


if __name__ == "__main__":
    main()
