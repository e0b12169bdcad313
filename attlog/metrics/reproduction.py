"""Onboard filter re-run compared with the logged one: metrics and figure data."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.rerun import AIDS, innovations
from attlog.flight.model import without_pauses
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup
from attlog.metrics.trace import Trace, envelope
from attlog.reference.model import Track

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


METRICS = (
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


def compute(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the agreement of a re-run with the onboard attitude."""
    found = row.reproduction
    if found is None or window != ("airborne" if found.airborne else "all"):
        return {}
    why = "compared with the attitude that flew, not with the reference"
    values = (found.tilt_median_deg, found.heading_median_deg, float(found.follows))
    return {
        m.name: Answer(value, m.unit, window, found.n, found.seconds, method="median", ranked=False, reason=why)
        for m, value in zip(METRICS, values, strict=True)
    }


METRIC_GROUPS = (MetricGroup("reproduction", "Onboard filter run again", METRICS, compute),)


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
