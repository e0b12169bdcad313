"""Innovations of a re-run onboard filter by aid, and its attitude resets.

An innovation is a measurement minus its prediction: the filter's own prediction error, known without any reference. Its
root mean square is smaller for a better filter. The test ratio is relative to the gate, so that a larger noise or gate
lowers the ratio by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.estimators import rerun
from attlog.flight.model import Attitude
from attlog.metrics.intervals import student
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, paragraph, per_row
from attlog.metrics.statistics import UnitValues, make_ids
from attlog.reference.model import Track
from attlog.segments import resets

Array = NDArray[np.float64]
# Length of blocks: innovations of GNSS at 5 Hz are correlated over some 2 s.
BLOCK_S = 5.0
# Smallest number of an aid's samples in a window.
MIN_SAMPLES = 20


class AidGroup(NamedTuple):
    """Innovations of one sensor.

    ``channels`` of :data:`attlog.estimators.rerun.AIDS`; ``factor`` converts them to ``unit``.
    """

    title: str
    unit: str
    factor: float
    channels: tuple[str, ...]


AID_GROUPS: Mapping[str, AidGroup] = {
    "compass_field": AidGroup("compass", "uT", 100.0, ("mag_x", "mag_y", "mag_z")),
    "compass_heading": AidGroup("compass heading", "deg", math.degrees(1.0), ("heading",)),
    "gnss_velocity": AidGroup("GNSS velocity", "m/s", 1.0, ("velocity_n", "velocity_e", "velocity_d")),
    "gnss_position": AidGroup("GNSS position", "m", 1.0, ("position_n", "position_e")),
    "height": AidGroup("height", "m", 1.0, ("baro_height", "gnss_height")),
    "airspeed": AidGroup("airspeed", "m/s", 1.0, ("airspeed",)),
}


class Statistic(NamedTuple):
    """Statistic of an aid's innovations; ``unit`` None: that of the aid."""

    noun: str
    unit: str | None
    definition: str


STATISTICS: Mapping[str, Statistic] = {
    "innovation_rms": Statistic(
        "innovation",
        None,
        "Root mean square of the innovations, as vectors of all axes. Compared by the mean squares of blocks of 5 s.",
    ),
    "test_ratio_rms": Statistic(
        "ratio",
        "1",
        """Root mean square of the innovation in gates, sqrt(innovation^2 / (gate^2 variance)), of a sample's
        worst axis: the root of the mean test ratio. 1 is at the gate. A larger noise or gate lowers it by itself.""",
    ),
    "rejected_pct": Statistic("rejected", "%", "Share of the aid's samples with a test ratio above 1 in any axis."),
    "innovation_bias": Statistic("innovation bias", None, "Length of the vector of the axes' mean innovations."),
    "innovation_correlation": Statistic(
        "innovation correlation",
        "1",
        """Correlation of successive innovations, mean of the axes. A filter that predicts all that can be predicted
        leaves none; a wrong delay or too small a gain leaves much.""",
    ),
}
RESETS = Metric(
    "attitude_resets",
    "Resets of the attitude",
    "1",
    "low",
    "Jumps of a re-run's attitude that the gyro does not explain, found as those of logged attitudes are.",
)


def _metric(statistic: str, aid: str) -> Metric:
    known, group = STATISTICS[statistic], AID_GROUPS[aid]
    title = f"{group.title[:1].upper()}{group.title[1:]} {known.noun}"
    return Metric(
        f"{statistic}.{aid}",
        title,
        group.unit if known.unit is None else known.unit,
        "zero" if statistic == "innovation_correlation" else "low",
        paragraph(known.definition),
        scale="ratio" if statistic.endswith("_rms") else "difference",
    )


@dataclass(frozen=True, slots=True)
class AidSamples:
    """Innovations ``e`` (n,) of one aid at ``t`` (n,) s."""

    t: Array
    e: Array
    ratio: Array
    channel: NDArray[np.int64]


@per_row
def _samples(case: Case, row: Track) -> dict[str, AidSamples]:
    """Return the innovations of a re-run by aid; empty for other rows."""
    tables = rerun.innovations(row.aux)
    found = {}
    for aid, group in AID_GROUPS.items():
        some = [(k, tables[name]) for k, name in enumerate(group.channels) if name in tables]
        if some:
            table = np.concatenate([t for _, t in some])
            channel = np.concatenate([np.full(len(t), k) for k, t in some])
            good = np.isfinite(table).all(axis=1) & (table[:, 2] > 0.0)
            found[aid] = AidSamples(table[good, 0], group.factor * table[good, 1], table[good, 3], channel[good])
    return found


def compute_innovations(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the statistics of each fused aid, and resets, of a re-run."""
    aids = _samples(case, row)
    answers: dict[str, Answer] = {}
    for aid, samples in aids.items():
        inside = case.segments.mask(samples.t, window)
        if np.count_nonzero(inside) >= MIN_SAMPLES:
            some = AidSamples(*(getattr(samples, name)[inside] for name in ("t", "e", "ratio", "channel")))
            answers |= _answers(aid, some, window)
    if aids:
        times = row.t[resets.find_resets(Attitude(row.t, row.q, row.name), row.imu)[0]]
        count = int(np.count_nonzero(case.segments.mask(times, window)))
        answers[RESETS.name] = Answer(float(count), "1", window, 1, float(row.t[-1] - row.t[0]), method="counted")
    return answers


def _answers(aid: str, s: AidSamples, window: str) -> dict[str, Answer]:
    """Return every statistic of one aid's samples."""
    t, sample = np.unique(s.t, return_inverse=True)  # the axes of one sample have one time
    square, ratio = np.bincount(sample, s.e**2), np.zeros(len(t))
    np.maximum.at(ratio, sample, s.ratio)
    rejected = 100.0 * (ratio > 1.0)
    block, place, count = np.unique(np.floor(t / BLOCK_S), return_inverse=True, return_counts=True)
    ids, units = make_ids(BLOCK_S * block), {}
    for name, x, kind in (
        ("innovation_rms", square, "mean_square"),
        ("test_ratio_rms", ratio, "mean_square"),
        ("rejected_pct", rejected, "slope_group"),
    ):
        units[name] = UnitValues(kind, ids, np.bincount(place, x) / count)  # type: ignore[arg-type]
    channels = [s.e[s.channel == k] for k in np.unique(s.channel)]
    correlations = [r for e in channels if (r := _lag_one(e)) is not None]
    values = {
        "innovation_rms": math.sqrt(np.mean(square)),
        "test_ratio_rms": math.sqrt(np.mean(ratio)),
        "rejected_pct": float(np.mean(rejected)),
        "innovation_bias": math.hypot(*(float(np.mean(e)) for e in channels)),
    }
    if correlations:
        values["innovation_correlation"] = float(np.mean(correlations))
    answers = {}
    for statistic, value in values.items():
        metric = METRICS[f"{statistic}.{aid}"]
        answers[metric.name] = Answer(
            value,
            metric.unit,
            window,
            len(block),
            BLOCK_S * len(block),
            _rms_interval(units[statistic].values, value) if statistic.endswith("_rms") else None,
            "blocks of 5 s",
            detail={"samples": len(t)},
            units=units.get(statistic),
        )
    return answers


def _lag_one(e: Array) -> float | None:
    """Return the correlation of successive values (n,), None if undefined."""
    d = e - np.mean(e)
    power = float(d @ d)
    return float(d[1:] @ d[:-1]) / power if len(e) >= MIN_SAMPLES and power > 0.0 else None


def _rms_interval(squares: Array, value: float) -> tuple[float, float] | None:
    """Return the t interval of the RMS from block mean squares (k,)."""
    k, centre = len(squares), value**2
    if k < 3:
        return None
    half = student(0.975, k - 1) * float(np.std(squares, ddof=1)) / math.sqrt(k)
    return math.sqrt(max(centre - half, 0.0)), math.sqrt(centre + half)


METRICS: Mapping[str, Metric] = {m.name: m for s in STATISTICS for aid in AID_GROUPS for m in (_metric(s, aid),)}
METRIC_GROUPS = (
    MetricGroup("innovations", "Innovations", (*METRICS.values(), RESETS), compute_innovations, ("all", "airborne")),
)
