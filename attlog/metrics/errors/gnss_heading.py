"""How far is a row's heading off by GNSS acceleration? It needs neither a reference nor a compass."""

from __future__ import annotations

from dataclasses import replace

from attlog.estimators.evidence.gnss_heading import HeadingOffset
from attlog.metrics.answer import Answer, SpanAnswer, missing
from attlog.metrics.base import Case, Metric, Wording, applies_to, paragraph, per_case, per_row
from attlog.metrics.evidence.phases import own_start
from attlog.metrics.evidence.samples import imu_of, logged_unit
from attlog.reference.model import Row
from attlog.reference.physics.gnss_motion import GnssMotion, motion_of
from attlog.segments import gaps

NAME, UNIT = "gnss_heading_deg", "deg"
METRICS: tuple[Metric, ...] = (
    Metric(
        NAME,
        "Heading error by GNSS acceleration",
        UNIT,
        "zero",
        ("gnss",),
        paragraph(
            """Angle by which specific force, turned to earth by this row, is turned against GNSS acceleration in
            flight, clockwise positive. Changes of velocity over 1 s; means of 30 s removed; one delay of GNSS for the
            flight. Interval: jackknife of blocks of 5 s, 0.3 deg, and what the delay leaves open. Answered where both
            show one motion: correlation 0.7 or more, scale 0.7 to 1.3, sigma up to 10 deg, more than one movement.
            Every row shares the errors of GNSS, so nobody is ranked."""
        ),
        wording=Wording("errs", "less", "more", "heading by GNSS acceleration"),
    ),
)
SHARED = "every row shares the errors of GNSS"
T_95 = 1.96


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows on the ground."""
    if not applies_to(window, "all"):
        return {}
    motion = _motion_of(case, row)
    if motion is None:
        return {NAME: missing("no_gnss", "the log holds no GNSS velocity with a 3D fix", UNIT, window)}
    turned = own_north(row)
    if turned is None:
        reason = "it has no north of its own: its heading was turned to the reference's"
        return {NAME: missing("not_applicable", reason, UNIT, window)}
    whole, parts = _offsets(case, row, window)
    wrong = [_record(part, turned) for part in parts if _shifted(part, turned).wrong]
    if not whole.told:
        answer = missing("too_uncertain", whole.why, UNIT, window)
    else:
        value = _shifted(whole, turned).offset_deg
        half = T_95 * whole.sigma_deg
        answer = Answer(
            value,
            UNIT,
            window,
            max(1, int(whole.blocks)),
            whole.t1 - whole.t0,
            (value - half, value + half),
            "rotation between force and GNSS acceleration, 1 s windows",
            reason=SHARED,
            ranked=False,
            detail={"delay_s": whole.delay_s, "scale": whole.scale, "correlation": whole.correlation},
        )
    answer.records = wrong
    return {NAME: answer}


def _motion_of(case: Case, row: Row) -> GnssMotion | None:
    """The motion by the unit that a row was made of; what rows share is made once."""
    imu = imu_of(case, row)
    unit = None if imu is None else logged_unit(case, imu)
    return motion_of(case.log, case.segments, imu) if unit is None else _motion_by(case, unit)


@per_case
def _motion_by(case: Case, unit: int) -> GnssMotion | None:
    return motion_of(case.log, case.segments, case.log.imus[unit])


@per_row
def _offsets(case: Case, row: Row, window: str) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """Of the flight and of each 30 s, as the row now stands."""
    motion = _motion_of(case, row)
    assert motion is not None
    segment = gaps.renumber(gaps.number(row.t), row.segment)
    within = case.segments.spans(window) if ":" in window else None
    return motion.offsets(row.t, row.q, segment, own_start(case, row), within)


def own_north(row: Row) -> float | None:
    """The heading that was taken out of a row with a north of its own, deg; None where it has none, or not one."""
    if row.heading_offset_deg is None:
        return 0.0
    one = len(row.segment) > 0 and row.segment[0] == row.segment[-1]
    return row.heading_offset_deg if row.knows_north and one else None


def _shifted(found: HeadingOffset, turned: float) -> HeadingOffset:
    """The same of the heading as the filter gave it."""
    if not turned:
        return found
    return replace(found, offset_deg=float((found.offset_deg + turned + 180.0) % 360.0 - 180.0))


def _record(found: HeadingOffset, turned: float) -> SpanAnswer:
    """One of the 30 s in which the heading is wrong."""
    value, half = _shifted(found, turned).offset_deg, T_95 * found.sigma_deg
    return SpanAnswer(found.t0, found.t1, found.t1 - found.t0, value, (value - half, value + half))
