"""Yaw drift in the air: the slope of the heading error against each heading reference that the log holds."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, HeadingReference, Metric, Wording, applies_to, paragraph, per_row
from attlog.metrics.drift import slope as drift
from attlog.metrics.drift.rest import bias_beside
from attlog.metrics.errors.rmse import own_sigma
from attlog.metrics.evidence.phases import why_never_airborne
from attlog.metrics.evidence.samples import DRIFT_AIR_S
from attlog.metrics.statistics import intervals as interval
from attlog.reference.model import Row
from attlog.segments import gaps
from attlog.segments.spans import inside, intersect

Array = NDArray[np.float64]

HEADING_REFERENCES = {
    "onboard": "the onboard heading",
    "truth": "the true heading (simulation or motion capture)",
    "smoother": "the smoothed heading",
    "mag": "the tilt-compensated magnetometer heading",
    "gnss_yaw": "the heading of a dual-antenna GNSS receiver",
    "yaw_estimator": "the heading that the autopilot finds from GNSS motion without a compass",
    "course": "the direction of the GNSS velocity of a plane (wind-compensated where its text says so)",
}
ABSENT = {
    "onboard": ("not_applicable", "the onboard attitude is not logged"),
    "truth": ("no_reference", "the log holds no ground truth"),
    "smoother": ("no_reference", "no smoothed attitude was built"),
    "mag": ("no_magnetometer", "the log holds no usable magnetometer heading"),
    "gnss_yaw": ("no_gnss", "the log holds no heading of a dual-antenna GNSS receiver"),
    "yaw_estimator": ("not_applicable", "the autopilot logged no valid yaw estimator, or the reference contradicts it"),
    "course": ("no_gnss", "needs GNSS velocity of a plane faster than 5 m/s"),
}
STEEP_RAD = math.radians(60.0)
"""Beyond this pitch the direction of the nose says little about heading."""

METRICS: tuple[Metric, ...] = tuple(
    Metric(
        f"drift_air_deg_per_min.{name}",
        f"Yaw drift in the air against {name.replace('_', ' ')}",
        "deg/min",
        "zero",
        ("airborne", name),
        paragraph(
            f"""Mean slope of the row's heading error against {words}, airborne, after the scoring start, from 20 s on:
            1 s block means, cut at gaps and at resets of the heading reference; one group for each 10 s of the
            record, 4 to 12, each with its own offset; value = mean of the group slopes, interval = t over them (and
            2 sigma of a smoother over the record). The drift is significant where the interval excludes zero, else
            bounded by its larger end: how the row drifts away from this heading reference, whose own drift counts
            too."""
        ),
        resolution=drift.RESOLUTION,
        wording=Wording("drifts", "less in the air", "more in the air", "drift in the air"),
        covers=True,
    )
    for name, words in HEADING_REFERENCES.items()
)


def heading_error(row: Row, heading_reference: HeadingReference) -> tuple[Array, NDArray[np.int64]]:
    """The row's heading minus the reference's in deg at the reference's times, and the segment of each; both (n,).

    NaN where the row has no attitude within 0.5 s on each side or its nose points steeply up or down.
    """
    q, before = rotation.interpolated(row.t, row.q, None, heading_reference.t)
    w, x, y, z = q.T
    nose = 2.0 * (w * y - z * x)  # the sine of the pitch
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    e = np.degrees(rotation.wrap(heading - np.radians(heading_reference.heading_deg)))
    after = np.clip(before + (row.t[before] < heading_reference.t), 1, max(len(row.t) - 1, 1))
    known = (len(row.t) > 1) & (np.abs(nose) < math.sin(STEEP_RAD))
    if len(row.t) > 1:
        known &= (row.t[after] - row.t[after - 1] < 0.5) & (row.segment[after] == row.segment[after - 1])
        labels = heading_reference.segment * (int(row.segment.max()) + 1) + row.segment[after]
    else:
        labels = heading_reference.segment
    return np.where(known, e, np.nan), labels


def error_blocks(case: Case, row: Row, name: str, window: str) -> drift.HeadingBlocks | None:
    """1 s means of the heading error against a heading reference, airborne and scored; None where it is absent."""
    spans = intersect(case.segments.spans("airborne"), case.segments.spans(window))
    return _error_blocks(case, row, name, spans)


@per_row
def _error_blocks(case: Case, row: Row, name: str, spans: list[tuple[float, float]]) -> drift.HeadingBlocks | None:
    reference, heading_reference = case.reference, case.heading_references.get(name)
    if name == reference.kind and row.errors is not None:
        errors = row.errors
        keep = inside(errors.t, spans) & errors.scored
        return drift.block_means(errors.t[keep], errors.heading[keep], split(errors.segment, keep)[keep])
    if heading_reference is None:
        return None
    e, segment = heading_error(row, heading_reference)
    keep = (
        inside(heading_reference.t, spans)
        & (heading_reference.t >= reference.scoring_start)
        & (heading_reference.t <= reference.end)
    )
    return drift.block_means(heading_reference.t[keep], e[keep], split(segment, keep)[keep])


def split(segment: NDArray[np.int64], keep: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Segments (n,) that also end where time was left out between samples that are kept."""
    return gaps.renumber(segment, np.concatenate([[0], np.cumsum(~keep)])[: len(keep)])


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows that are not about flight."""
    if not applies_to(window, "all", "airborne"):
        return {}
    return {f"drift_air_deg_per_min.{name}": _against(case, row, name, window) for name in HEADING_REFERENCES}


def _against(case: Case, row: Row, name: str, window: str) -> Answer:
    reference = case.reference
    if name in reference.refused:
        return missing("no_reference", reference.refused[name], "deg/min", window)
    if name not in case.heading_references and name != reference.kind:
        return missing(*ABSENT[name], "deg/min", window)
    if name == "smoother" and reference.heading_by != "own":
        return missing("no_reference", reference.heading_why, "deg/min", window)
    if name == row.name or (row.is_reference and name == reference.kind):
        return missing("not_applicable", "this row is the heading reference itself", "deg/min", window)
    if not case.segments.spans("airborne"):
        return missing("not_covered", why_never_airborne(case), "deg/min", window)
    blocks = error_blocks(case, row, name, window)
    if blocks is None or len(blocks.t) == 0:
        return missing(
            "not_covered", f"there is no scored flight in common with {HEADING_REFERENCES[name]}", "deg/min", window
        )
    found = drift.slope(blocks)
    if found.value is None:
        reason = f"flight to compare with {HEADING_REFERENCES[name]}: {drift.too_short(found, DRIFT_AIR_S)}"
        return missing("record_too_short", reason, "deg/min", window)
    if name == reference.kind and found.ci95 is not None:
        per_min = 60.0 * own_sigma(case, "heading", window) / found.seconds
        found.ci95 = interval.with_reference(found.value, found.ci95, per_min)
    answer = drift.answer(found, window, name)
    answer.detail |= bias_beside(row, answer.value, [(float(blocks.t[0]), float(blocks.t[-1]))])
    if name in case.heading_references and case.heading_references[name].text:
        answer.detail["heading_reference"] = case.heading_references[name].text
    return answer
