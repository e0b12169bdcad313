"""Is the filter's own gyro bias right? Its estimate against the mean rate of the gyro at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, Resolution, applies_to, paragraph
from attlog.metrics.evidence.phases import rest_spans, why_none
from attlog.metrics.evidence.samples import imu_of, seconds
from attlog.metrics.noise.windows import filled_in
from attlog.metrics.statistics import intervals as interval
from attlog.reference.model import Row
from attlog.segments.spans import between

Array = NDArray[np.float64]

METRICS: tuple[Metric, ...] = (
    Metric(
        "gyro_bias_error_dps",
        "Gyro bias error",
        "deg/s",
        "low",
        ("rest",),
        paragraph(
            """Length of the difference between the gyro bias that the filter subtracts (its own estimate, and what is
            subtracted for every filter alike: `--gyro-bias`) and the mean rate that the logged gyro
            shows at rest, averaged over windows of 5 s (one window where the rest is shorter) once the filter has
            settled. Interval: t over the windows. The rate at rest contains the earth's turn (0.004 deg/s)."""
        ),
        resolution=Resolution(1.0, "1 deg/s", "windows"),
        asked="rest",
    ),
)


def window_errors(t: Array, gyro: Array, row: Row, windows: list[slice]) -> Array:
    """Bias estimate minus mean gyro (k, 3) in deg/s for windows of gyro samples that have an estimate."""
    found = []
    for w in windows:
        inside = between(row.t, t[w.start], t[w.stop - 1])
        if row.bias is not None and inside.stop > inside.start and np.isfinite(row.bias[inside]).all():
            found.append(np.degrees(_mean(row.bias[inside]) - _mean(gyro[w])))
    return np.array(found).reshape(-1, 3)


def _mean(x: Array) -> Array:
    """The mean (k,) of rows (n, k), column by column: many times faster than along a short last axis."""
    return np.array([float(column.sum()) / len(column) for column in x.T])


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without rest by definition."""
    if not applies_to(window, "all", "rest", "rest.long"):
        return {}
    name, unit = "gyro_bias_error_dps", "deg/s"
    imu = imu_of(case, row)
    if row.kind != "replay" or row.bias is None or imu is None or not (row.estimates_bias and np.any(row.bias)):
        reason = "this row has no gyro bias estimate of the replayed gyro"
        return {name: missing("not_applicable", reason, unit, window)}
    gyro = imu.gyro
    laid = [w for span in rest_spans(case, row, window) for _, w in filled_in(case, gyro.t, "rest", span)]
    windows = [w for w in laid if w is not None and rotation.finite(gyro.x[w]).all()]
    errors = window_errors(gyro.t, gyro.x, row, windows)
    if len(errors) == 0:
        return {name: missing(*why_none(case, "rest", window), unit, window)}
    lengths = np.sqrt(np.sum(errors**2, axis=1))
    few = None if len(errors) > 1 else "one window of rest gives no interval"
    return {
        name: Answer(
            float(np.mean(lengths)),
            unit,
            window,
            len(errors),
            seconds(gyro.t, windows),
            interval.of_mean(lengths),
            f"mean over {len(errors)} windows",
            reason=few,
            ranked=few is None,
            detail={"mean_error_dps": [float(x) for x in np.mean(errors, axis=0)]},
        )
    }
