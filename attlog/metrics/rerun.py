"""Onboard filter run again: agreement with what flew, innovations by aid, resets, figure data.

An innovation is a measurement minus its prediction: the filter's own prediction error, known without any reference. Its
root mean square is smaller for a better filter. The test ratio is relative to the gate, so that a larger noise or gate
lowers the ratio by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import unique
from attlog.estimators.rerun import AIDS, innovations
from attlog.flight.model import Attitude, without_pauses
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, paragraph, per_row
from attlog.metrics.statistics import UnitValues, make_ids, student
from attlog.metrics.trace import Trace, envelope
from attlog.reference.model import Track
from attlog.segments import increments

Array = NDArray[np.float64]
# Name in ``Track.aux`` of the table (m, 3) with time, tilt and heading (deg) between re-run and onboard attitude.
DIFFERENCE = "onboard_difference"
# Largest number of points of a line.
MAX_POINTS = 4000
# Units of figures by unit of a re-run, with the factor.
FIGURE_UNITS = {"rad": ("deg", float(np.degrees(1.0))), "gauss": ("uT", 100.0)}
# Aids with a common innovation test in the onboard filter.
TESTED_TOGETHER = {
    "compass": ("mag_x", "mag_y", "mag_z", "heading"),
    "velocity": ("velocity_n", "velocity_e", "velocity_d"),
    "position": ("position_n", "position_e"),
    "height": ("gnss_height", "baro_height"),
    "airspeed": ("airspeed",),
}


AGREEMENT = (
    Metric(
        "rerun_tilt_deg",
        "Re-run, tilt from onboard",
        "deg",
        "low",
        "Median tilt between the onboard filter run again with the log's parameters and the attitude that flew.",
    ),
    Metric(
        "rerun_heading_deg",
        "Re-run, heading from onboard",
        "deg",
        "low",
        "Median heading difference between the onboard filter run again and the attitude that flew.",
    ),
    Metric(
        "rerun_follows",
        "Re-run follows onboard",
        "1",
        "high",
        "1 where the onboard filter run again follows the attitude that flew closely enough for studies of parameters, "
        "else 0: within 0.5 deg of tilt (1.5 deg at 95 %) and 2 deg of heading.",
    ),
)


def compute_agreement(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the agreement of a re-run with the onboard attitude."""
    found = row.reproduction
    if found is None or window != ("airborne" if found.airborne else "all"):
        return {}
    why = "compared with the attitude that flew, not with the reference"
    values = (found.tilt_median_deg, found.heading_median_deg, float(found.follows))
    return {
        m.name: Answer(value, m.unit, window, found.n, found.seconds, method="median", ranked=False, reason=why)
        for m, value in zip(AGREEMENT, values, strict=True)
    }


def rerun_traces(case: Case, row: Track, logged: Mapping[str, Array]) -> list[Trace]:
    """Return traces of a re-run and of the logged onboard filter.

    ``logged``: tables by name with the log's time in the first column: ``sigma`` (tilt, heading in rad), innovations;
    they have the row name ``onboard``. ``key`` of a trace: ``difference``, ``bias``, ``sigma``, ``ratio`` (root of the
    test ratio), ``innovation``.
    """
    found = []

    def add(name: str, key: str, t: Array, columns: Mapping[str, Array]) -> None:
        at, kept = envelope(t, np.column_stack(list(columns.values())), MAX_POINTS)
        pauses = np.flatnonzero(~without_pauses(at)) + 1  # pauses of an aid break the line
        at, kept = np.insert(at, pauses, at[pauses]), np.insert(kept, pauses, np.nan, axis=0)
        found.append(Trace("rerun", name, at, {c: kept[:, k] for k, c in enumerate(columns)}, key))

    t, tilt, heading = row.aux[DIFFERENCE].T
    add(row.name, "difference", t, {"tilt": tilt, "heading": heading})
    onboard = case.log.estimator.gyro_bias
    for name, t, bias in (
        (row.name, row.t, row.bias),
        *(() if onboard is None else (("onboard", onboard.t, onboard.x),)),
    ):
        if bias is not None:
            add(name, "bias", t, dict(zip("xyz", np.degrees(bias).T, strict=True)))
    sigmas = np.column_stack([row.t, row.aux["sigma_tilt"], row.aux["sigma_heading"]])
    for name, table in ((row.name, sigmas), ("onboard", logged.get("sigma"))):
        if table is not None:
            t, tilt, heading = table.T
            add(name, "sigma", t, {"tilt": np.degrees(tilt), "heading": np.degrees(heading)})
    ours = innovations(row.aux)
    for aid, names in TESTED_TOGETHER.items():
        tables = [ours[name][:, [0, 3]] for name in names if name in ours]
        if tables:
            t, ratio = np.concatenate(tables)[np.argsort(np.concatenate(tables)[:, 0], kind="stable")].T
            add(row.name, "ratio", t, {aid: np.sqrt(ratio)})
    for test in case.log.estimator.innovation_tests:
        if test.aid in TESTED_TOGETHER:
            add("onboard", "ratio", test.t, {test.aid: test.ratio})
    for name, by_aid in ((row.name, ours), ("onboard", innovations(logged))):
        for aid, table in by_aid.items():
            _, scale = FIGURE_UNITS.get(AIDS[aid], ("", 1.0))
            add(name, "innovation", table[:, 0], {aid: scale * table[:, 1]})
    return found


# Innovations of a re-run onboard filter by aid, and its attitude resets.

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


class AidSamples(NamedTuple):
    """Innovations ``e`` (n,) of all axes of one aid at ``t`` (n,) s, test ratios and numbers of the axes."""

    t: Array
    e: Array
    ratio: Array
    axis: NDArray[np.int64]


@per_row
def _samples(case: Case, row: Track) -> dict[str, AidSamples]:
    """Return the innovations of a re-run by aid; empty for other rows."""
    tables = innovations(row.aux)
    found = {}
    for aid, group in AID_GROUPS.items():
        some = [tables[name] for name in group.channels if name in tables]
        if some:
            table, axis = np.concatenate(some), np.repeat(np.arange(len(some)), [len(one) for one in some])
            good = np.isfinite(table).all(axis=1) & (table[:, 2] > 0.0)
            found[aid] = AidSamples(table[good, 0], group.factor * table[good, 1], table[good, 3], axis[good])
    return found


def compute_innovations(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the statistics of each fused aid, and resets, of a re-run."""
    aids = _samples(case, row)
    answers: dict[str, Answer] = {}
    for aid, samples in aids.items():
        inside = case.segments.mask(samples.t, window)
        if np.count_nonzero(inside) >= MIN_SAMPLES:
            some = AidSamples(samples.t[inside], samples.e[inside], samples.ratio[inside], samples.axis[inside])
            answers |= _answers(aid, some, window)
    if aids:
        times = row.t[increments.find_resets(Attitude(row.t, row.q, row.name), row.imu)[0]]
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
    ids, answers = make_ids(BLOCK_S * block), {}
    for name, x in (("innovation_rms", square), ("test_ratio_rms", ratio), ("rejected_pct", rejected)):
        metric, rms, mean = METRICS[f"{name}.{aid}"], name.endswith("_rms"), float(np.mean(x))
        value = math.sqrt(mean) if rms else mean
        units = UnitValues("mean_square" if rms else "slope_group", ids, np.bincount(place, x) / count)
        answers[metric.name] = Answer(
            value,
            metric.unit,
            window,
            len(block),
            BLOCK_S * len(block),
            _rms_interval(units.values, value) if rms else None,
            "blocks of 5 s",
            units=units,
        )
    axes = [s.e[s.axis == k] for k in unique(s.axis)]
    varying = [e - np.mean(e) for e in axes if len(e) >= MIN_SAMPLES and np.ptp(e) > 0.0]
    values = {"innovation_bias": math.hypot(*(float(np.mean(e)) for e in axes))}
    if varying:
        values["innovation_correlation"] = float(np.mean([d[1:] @ d[:-1] / (d @ d) for d in varying]))
    for name, value in values.items():
        metric = METRICS[f"{name}.{aid}"]
        answers[metric.name] = Answer(value, metric.unit, window, len(block), BLOCK_S * len(block), method="samples")
    return answers


def _rms_interval(squares: Array, value: float) -> tuple[float, float] | None:
    """Return the t interval of the RMS from block mean squares (k,)."""
    k, centre = len(squares), value**2
    if k < 3:
        return None
    half = student(0.975, k - 1) * float(np.std(squares, ddof=1)) / math.sqrt(k)
    return math.sqrt(max(centre - half, 0.0)), math.sqrt(centre + half)


METRICS: Mapping[str, Metric] = {m.name: m for s in STATISTICS for aid in AID_GROUPS for m in (_metric(s, aid),)}
METRIC_GROUPS = (
    MetricGroup("reproduction", "Onboard filter run again", AGREEMENT, compute_agreement),
    MetricGroup("innovations", "Innovations", (*METRICS.values(), RESETS), compute_innovations, ("all", "airborne")),
)
