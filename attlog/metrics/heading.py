"""Heading error by GNSS acceleration, without a reference or a compass."""

from __future__ import annotations

from attlog.estimators.evidence import HeadingOffset
from attlog.flight.model import Imu
from attlog.metrics.metric import (
    Answer,
    Case,
    Metric,
    MetricGroup,
    SpanAnswer,
    Wording,
    missing,
    paragraph,
    per_object,
    per_row,
)
from attlog.metrics.step_fit import timing
from attlog.metrics.windows import imu_of, own_start
from attlog.reference.heading_sources import GnssMotion, gnss_motion
from attlog.reference.model import Track
from attlog.reference.sensor_faults import FRAME
from attlog.segments import model

GNSS_HEADING_NAME, GNSS_HEADING_UNIT = "gnss_heading_deg", "deg"
GNSS_HEADING_METRICS: tuple[Metric, ...] = (
    Metric(
        GNSS_HEADING_NAME,
        "Heading error by GNSS acceleration",
        GNSS_HEADING_UNIT,
        "zero",
        paragraph(
            """Angle by which specific force, turned to earth by this row, is turned against GNSS acceleration in
            flight, clockwise positive. Changes of velocity over 1 s; means of 30 s removed; one delay of GNSS for the
            flight. Interval: jackknife of blocks of 5 s, 0.3 deg, and what the delay leaves open. Answered where both
            show one motion: correlation 0.7 or more, scale 0.7 to 1.3, sigma up to 10 deg, more than one movement.
            Every row shares the errors of GNSS, so no row is ranked."""
        ),
        wording=Wording("errs", "less", "more", "heading by GNSS acceleration"),
    ),
)
SHARED = "every row shares the errors of GNSS"
T_95 = 1.96  # normal: sigma is from many blocks


def why_no_motion(case: Case, row: Track, window: str) -> tuple[str, str] | None:
    """Return code and reason if a heading error by GNSS is unavailable."""
    if _motion_of(case, row) is None:
        return "no_gnss", "the log holds no GNSS velocity with a 3D fix"
    if own_north(row) is None:
        return "not_applicable", "it has no north of its own: its heading was turned to the reference's"
    return None


def compute_gnss_heading(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the heading error of a row by GNSS acceleration."""
    turned = own_north(row) or 0.0
    whole, parts = _offsets(case, row, window)
    wrong = [_record(part, turned) for part in parts if _shifted(part, turned).wrong]
    if not whole.known:
        answer = missing("too_uncertain", whole.why, GNSS_HEADING_UNIT, window)
    else:
        value = _shifted(whole, turned).offset_deg
        half = T_95 * whole.sigma_deg
        answer = Answer(
            value,
            GNSS_HEADING_UNIT,
            window,
            max(1, int(whole.blocks)),
            whole.t1 - whole.t0,
            (value - half, value + half),
            "rotation between force and GNSS acceleration, 1 s windows",
            reason=SHARED,
            ranked=False,
        )
    answer.records = wrong
    return {GNSS_HEADING_NAME: answer}


def _motion_of(case: Case, row: Track) -> GnssMotion | None:
    """Return force and GNSS velocities with the row's IMU."""
    imu = imu_of(case, row)
    return None if imu is None else _motion_by(case, imu)


@per_object
def _motion_by(case: Case, imu: Imu) -> GnssMotion | None:
    wrong = imu is case.log.replay_imu and FRAME in case.reference.faults.sensors
    return None if wrong else gnss_motion(case.log, case.segments, imu)


@per_row
def _offsets(case: Case, row: Track, window: str) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """Return the heading error over the flight and per 30 s."""
    motion = _motion_of(case, row)
    assert motion is not None
    segment = model.merge_numbers(timing(case, row.t).number, row.segment)
    within = case.segments.spans(window) if ":" in window else None
    return motion.offsets(row.t, row.q, segment, own_start(case, row), within)


def own_north(row: Track) -> float | None:
    """Return the removed heading offset, deg; None without a single own north."""
    if row.heading_offset_deg is None:
        return 0.0
    one = len(row.segment) > 0 and row.segment[0] == row.segment[-1]
    return row.heading_offset_deg if row.knows_north and one else None


def _shifted(found: HeadingOffset, turned: float) -> HeadingOffset:
    """Return the heading error before removal of the heading offset."""
    if not turned:
        return found
    return found._replace(offset_deg=float((found.offset_deg + turned + 180.0) % 360.0 - 180.0))


def _record(found: HeadingOffset, turned: float) -> SpanAnswer:
    """Return the answer for 30 s with a wrong heading."""
    value, half = _shifted(found, turned).offset_deg, T_95 * found.sigma_deg
    return SpanAnswer(found.t0, found.t1, found.t1 - found.t0, value, (value - half, value + half))


GNSS_HEADING = MetricGroup(
    "heading by GNSS", "Accuracy", GNSS_HEADING_METRICS, compute_gnss_heading, ("all",), needs=(why_no_motion,)
)
METRIC_GROUPS = (GNSS_HEADING,)
