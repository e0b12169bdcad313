"""Processor time of a filter per update."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core.errors import AttlogError
from attlog.estimators.run import run
from attlog.estimators.samples import prepare
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, paragraph
from attlog.reference.model import Track

Array = NDArray[np.float64]

SAMPLES, STEP_S = 3000, 0.004  # 12 s at 250 Hz: some ms a run
MAG_EVERY = 5  # 50 Hz, as usual for compasses
# Number of runs. The range of 6 contains the median with 97 % (1 - 2 / 2^6) for any distribution; that of 5 with 94 %.
REPEATS = 6

_MEASURED = f"""Processor time of the filter's own loop per IMU sample, on the machine that made this result: median of
    {REPEATS} runs over the same {SAMPLES} made samples (250 Hz, magnetometer 50 Hz). Interval: from the fastest to the
    slowest run. Never ranked: another machine, another number."""
COST_METRICS = (Metric("cost_ns", "Cost per update", "ns", "low", paragraph(_MEASURED)),)


def compute_cost(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the time per update of a row's filter (whole log only)."""
    if window != "all":
        return {}
    times = measure_cost(row)
    if times is None:
        reason = "flew on board: its time is not in the log" if row.kind == "onboard" else "its time was not measured"
        return COST.without("not_applicable", reason, window)
    ci95 = (float(np.min(times)), float(np.max(times)))
    return {
        "cost_ns": Answer(
            float(np.median(times)),
            "ns",
            window,
            len(times),
            1e-9 * SAMPLES * len(times),
            ci95 if len(times) > 1 else None,
            f"median of {len(times)} runs" if len(times) > 1 else "one replay",
            reason="depends on the machine and what else it does",
            ranked=False,
        )
    }


COST = MetricGroup("cost", "", COST_METRICS, compute_cost)


def measure_cost(row: Track) -> Array | None:
    """Return times per update in ns (k,) of repeated runs.

    Of the one replay if it cannot be repeated; None for onboard rows.
    """
    if row.kind != "replay" or not row.ns_per_update:
        return None
    try:
        return np.array(_repeated(row.estimator, tuple(sorted(row.parameters.items())), row.uses_mag))
    except AttlogError:
        return np.array([row.ns_per_update])


@functools.cache
def _repeated(estimator: str, parameters: tuple[tuple[str, float | str], ...], uses_mag: bool) -> tuple[float, ...]:
    """Return times per update in ns of repeated runs."""
    t = STEP_S * np.arange(SAMPLES)
    swing = np.sin(np.outer(t, [1.0, 1.3, 0.7]))
    acc = np.array([0.0, 0.0, -9.81]) + swing
    mag = np.where(np.arange(SAMPLES)[:, None] % MAG_EVERY == 0, np.array([20.0, 0.0, 40.0]) + swing, np.nan)
    asked = estimators.EstimatorSpec(estimators.get(estimator), params=dict(parameters))
    runs = []
    if asked.estimator.process is not None:  # its own process reports its errors
        runs.append(estimators.estimate(asked, t, 0.3 * swing, acc, mag if uses_mag else None, check_units=False))
    # Samples are cleaned once, so that only the filter's loop is timed.
    made = prepare(t, 0.3 * swing, acc, mag if uses_mag else None, hold_mag=asked.estimator.hold_mag)
    values = {name: value for name, (value, _) in asked.resolved().items()}
    while len(runs) < REPEATS:
        runs.append(run(asked.estimator, made, values, aids=estimators.Aids(sampling="interval")))
    return tuple(one.ns_per_update for one in runs)
