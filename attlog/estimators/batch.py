"""One filter with many parameter sets over the same samples, on all cores.

Set i returns what a run of its own with the same values returns, to the bit. Machine code runs outside Python's lock,
so threads suffice. Filters that call packages or that numba cannot compile run one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from attlog.core.machine import cores
from attlog.estimators.aids import Aids
from attlog.estimators.interface import Estimate, Estimator, LogFacts
from attlog.estimators.run import run, with_line
from attlog.estimators.samples import Sampling, prepare


def estimate_batch(
    estimator: Estimator,
    params: Sequence[Mapping[str, float | str]],
    t: ArrayLike,
    gyr: ArrayLike,
    acc: ArrayLike | None = None,
    mag: ArrayLike | None = None,
    *,
    preset: str | None = None,
    sampling: Sampling = "interval",
    q0: ArrayLike | None = None,
    dt: ArrayLike | None = None,
    every: int = 1,
    aids: Aids | None = None,
    log: LogFacts | None = None,
) -> list[Estimate]:
    """Run one filter with each parameter set of ``params``; arguments as in :func:`attlog.estimate`.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) any unit, body axes; ``dt`` (n,) s.
    Returns the estimates in the order of ``params``. UsageError for unknown or impossible values.
    """
    if estimator.process is not None:
        facts = None if log is None else replace(log, params=dict(log.params), given=dict(log.given))
        options: dict[str, Any] = {"preset": preset, "sampling": sampling, "q0": q0, "dt": dt, "every": every}
        plain = [dict(p) for p in params]
        return estimator.process.call(estimate_batch, plain, t, gyr, acc, mag, aids=aids, log=facts, **options)
    resolved = [{k: v for k, (v, _) in estimator.resolve(preset, p, log=log).items()} for p in params]
    samples = prepare(t, gyr, acc, mag, dt=dt, sampling=sampling, hold_mag=estimator.hold_mag)

    def one(values: Mapping[str, float | str]) -> Estimate:
        return with_line(estimator, lambda: run(estimator, samples, values, q0, every, aids))

    if estimator.step is None or estimator.origin != "attlog" or len(resolved) < 2:
        return [one(values) for values in resolved]
    found = [one(resolved[0])]  # loads the loop before threads ask for it
    with ThreadPoolExecutor(cores()) as pool:
        return found + list(pool.map(one, resolved[1:]))
