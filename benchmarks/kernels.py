"""Cost of one update: every filter, lanes against the scalar kernel, and Mahony against the ahrs package.

    python benchmarks/kernels.py

Prints nanoseconds per update (best of several runs, one thread, kernels loaded from the
cache), lanes at every 8th output as a sweep uses them, and the ratios. Targets: mahony
60 ns on a quiet core, 3000 times faster than ahrs, lanes 4 (float64) and 10 (float32)
times faster than one by one.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from attlog import rotation
from attlog.estimators import get, lanes, loop, names
from attlog.estimators.samples import Samples, prepare

SAMPLES = 20_000
RATE = 250.0
REPEAT = 30


def data() -> tuple[np.ndarray, ...]:
    """Noisy motion, 80 s at 250 Hz: t, gyr, acc, mag."""
    rng = np.random.default_rng(1)
    t = np.arange(SAMPLES) / RATE
    q = rotation.from_euler(0.4 * np.sin(t), 0.3 * np.cos(1.3 * t), 0.5 * t)
    gyr = np.vstack([np.zeros(3), rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) * RATE])
    noise = [rng.normal(0, s, (SAMPLES, 3)) for s in (0.01, 0.3, 0.3)]
    acc, mag = (rotation.rotate_inverse(q, v) for v in ([0, 0, -9.81], [20.0, 0, 40.0]))
    return t, gyr + noise[0], acc + noise[1], mag + noise[2]


def best_ns(work: Callable[[], object], updates: int, repeat: int = REPEAT) -> float:
    """Nanoseconds per update of the fastest run."""
    times = []
    for _ in range(repeat):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return 1e9 * min(times) / updates


def scalar_ns(name: str, samples: Samples) -> float:
    """One filter's own cost, preparation left out."""
    e = get(name)
    values = {k: v for k, (v, _) in e.resolve().items()}
    return min(loop.run(e, samples, values).ns_per_update for _ in range(REPEAT if e.step else 2))


def lanes_ns(name: str, samples: Samples, dtype: str) -> float:
    """Cost per update and lane of a full kernel width."""
    e = get(name)
    packed = e.pack({k: v for k, (v, _) in e.resolve().items()})
    advance = lanes.kernel(e, {i: packed[i] for i, p in enumerate(e.own) if p.choices}, dtype)
    width = lanes.WIDTH[dtype]
    work = np.zeros((e.state_size + len(packed) + 3, width), dtype)
    work[0] = 1
    work[e.state_size : -3] = packed[:, None]
    out = np.empty((-(-SAMPLES // 8), e.outputs, width), dtype)
    dt, gyr, acc, mag = (np.ascontiguousarray(x, dtype) for x in (samples.dt, samples.gyr, samples.acc, samples.mag))
    flat = work.ravel()
    return best_ns(lambda: advance(flat, dt, samples.parts, gyr, acc, mag, samples.use, 8, out), SAMPLES * width)


def ahrs_ns(t: np.ndarray, gyr: np.ndarray, acc: np.ndarray, mag: np.ndarray) -> float:
    """The peer's Mahony on the first 2000 samples."""
    from ahrs.filters import Mahony

    n = 2000
    return best_ns(lambda: Mahony(gyr=gyr[:n], acc=-acc[:n], mag=mag[:n], frequency=RATE, k_P=0.6, k_I=0.0012), n, 3)


def main() -> None:
    x = data()
    samples = prepare(*x)
    print(f"{'filter':20}{'ns per update':>14}")
    cost = {name: scalar_ns(name, samples) for name in names()}
    for name, ns in cost.items():
        print(f"{name:20}{ns:14.0f}")
    print(f"\n{'lanes':20}{'ns per lane':>14}{'ratio':>8}")
    for name in ("mahony", "complementary", "madgwick"):
        for dtype in lanes.WIDTH:
            ns = lanes_ns(name, samples, dtype)
            print(f"{name + ' ' + dtype:20}{ns:14.1f}{cost[name] / ns:8.1f}")
    peer = ahrs_ns(*x)
    print(f"\nahrs Mahony {peer:.0f} ns: {peer / cost['mahony']:.0f} times attlog's")


if __name__ == "__main__":
    main()
