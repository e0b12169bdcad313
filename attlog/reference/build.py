"""A reference made of an attitude, with every step between the two."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Attitude, FlightLog, Imu
from attlog.reference import brought, clock, declination, floor, scoring, trim
from attlog.reference.model import AlignmentStep, Reference, ReferenceOptions
from attlog.reference.physics import delay, gravity
from attlog.segments import Segments, gaps, resets

Array = NDArray[np.float64]
Kind = Literal["truth", "smoother", "onboard"]

SLOW_HZ = 5.0

FROZEN_DPS = 5.0
"""A gyro that varies by more than this does not belong to an attitude that never changes."""


def build(
    log: FlightLog,
    segments: Segments,
    options: ReferenceOptions,
    kind: Kind,
    name: str,
    attitude: Attitude,
    why: str,
    restarts: NDArray[np.int64] | None = None,
) -> Reference:
    """The reference that an attitude makes; ``restarts`` (n,) are its segments if it has its own and no resets."""
    imu, which = log.replay_imu, _clock(options)
    t, q, kept = clock.usable(attitude, which)
    gap_segment = _gap_segments(t, segments)
    if restarts is not None:
        found, sentences = np.zeros(0, np.int64), list[str]()
        gap_segment = gaps.renumber(gap_segment, restarts[kept])
    elif kind == "onboard":
        found, sentences = resets.known(log, name, segments)
    else:
        found, sentences = resets.find(attitude, imu)
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[found] = 1
    segment = gap_segment + np.cumsum(jumped)[kept]
    reference = Reference(kind, attitude.source, t, q, gap_segment, gaps.renumber(segment), name=name, clock=which)
    reference.rate = gaps.rate(t)
    if attitude.fit is not None:
        brought.adopt(reference, attitude.fit)
    reference.trim, trim_step = trim.step(log, _in_axes_of(log, kind, attitude), options.trim)
    if kind == "smoother" and reference.trim is not None:
        reference.q = q = trim.apply(q, reference.trim)
    reference.floor_deg, reference.step_deg, floor_step = floor.step(t, q, attitude.step_deg, imu)
    start_step = _score(reference, _imu_times(imu, t), segments, options)
    aligned = scoring.aligned_at(attitude, found, segments) if kind == "onboard" else None
    if aligned is not None:
        reference.unscored = [(-np.inf, aligned), *reference.unscored]
        text = "its own alignment: nothing is compared with it before this jump"
        start_step.append(AlignmentStep("alignment", text, aligned, "s", attitude.source))
    reference.declination_deg, north = declination.step(log, options.declination)
    reference.input_delay_s, lag = delay.step(log, imu, reference, options.input_delay)
    reference.fault, gravity_step = gravity.check(reference, imu, segments)
    reference.fault = reference.fault or frozen(reference, imu)
    reference.steps = [
        AlignmentStep("reference", why, kind, source=attitude.source, option="--reference"),
        clock.step(log, attitude, which, kind == "smoother"),
        *(() if attitude.fit is None else brought.steps(attitude.fit)),
        lag,
        _resampling(reference),
        AlignmentStep("resets", _reset_text(sentences), float(len(found)), "", attitude.source, len(found) > 0),
        *_north(log, reference, north),
        trim_step,
        *gravity_step,
        *start_step,
        floor_step,
    ]
    return reference


def _in_axes_of(log: FlightLog, kind: Kind, attitude: Attitude) -> Attitude:
    """The attitude whose axes the comparison is made in: a smoother, made from the IMU, comes to the onboard ones."""
    return log.onboard_attitude or attitude if kind == "smoother" else attitude


def _clock(options: ReferenceOptions) -> clock.Clock:
    return "publication" if options.clock == "publication" else "sample"


def without(log: FlightLog, imu: Imu | None, segments: Segments, options: ReferenceOptions, why: str) -> Reference:
    """No reference: only questions at rest can be answered."""
    zero = np.zeros(0)
    index = np.zeros(0, np.int64)
    reference = Reference("none", "", zero, np.zeros((0, 4)), index, index, clock=_clock(options))
    reference.declination_deg, north = declination.step(log, options.declination)
    start = _score(reference, _imu_times(imu, zero), segments, options)
    reference.steps = [AlignmentStep("reference", why, "none", option="--reference"), north, *start]
    return reference


def _imu_times(imu: Imu | None, otherwise: Array) -> Array:
    t = otherwise if imu is None else imu.gyro.t_best
    return t[np.isfinite(t)]


def _gap_segments(t: Array, segments: Segments) -> NDArray[np.int64]:
    """The segment number of each time (n,): a gap of the attitude or of the replayed IMU begins a new one."""
    starts = np.array([s.t0 for s in segments.of("continuous")][1:])
    return gaps.renumber(gaps.number(t), np.searchsorted(starts, t, side="right"))


def _score(reference: Reference, t: Array, segments: Segments, options: ReferenceOptions) -> list[AlignmentStep]:
    """Set start, end and unscored segments of a reference; returns the steps that tell them."""
    reference.scoring_start, reference.unscored = scoring.start_and_unscored(t, options.score_from)
    why = (
        "given by the user"
        if options.score_from is not None
        else ("15 s after the first IMU sample, a third of a log shorter than 30 s")
    )
    if reference.unscored:
        why += f"; {len(reference.unscored)} restarts after gaps, each followed by unscored seconds"
    steps = [AlignmentStep("scoring_start", why, reference.scoring_start, "s", "the IMU", option="config: score_from")]
    reference.unscored += [(lost.t0, lost.t1) for lost in segments.of("loss_of_control")]
    impacts = segments.of("impact")
    if impacts:
        reference.end = impacts[0].t0
        steps.append(AlignmentStep("scoring_end", impacts[0].why, reference.end, "s", "impact"))
    return steps


def _resampling(reference: Reference) -> AlignmentStep:
    text = f"{reference.rate:.1f} Hz; faster rows are compared at its times, slower ones at their own"
    if reference.rate < SLOW_HZ:
        text += "; too slow for lag, only rest and drift are answered"
    return AlignmentStep("resampling", text, reference.rate, "Hz", reference.source)


def _reset_text(sentences: list[str]) -> str:
    if not sentences:
        return "no reset of this attitude found"
    different = list(dict.fromkeys(sentences))
    count = f"{len(sentences)} reset{'s' if len(sentences) > 1 else ''}"
    return f"{count}, cut out: {'; '.join(different[:3])}{' ...' if len(different) > 3 else ''}"


def _north(log: FlightLog, reference: Reference, north: AlignmentStep) -> list[AlignmentStep]:
    """The declination, and where a reference that knows north sees the magnetic one."""
    seen = None if reference.heading_by == "relative" else declination.measured_deg(log, reference)
    if seen is None:
        return [north]
    text = f"the measured field, turned by {reference.source}, points this far east of its north (median)"
    return [north, AlignmentStep("declination_seen", text, seen, "deg", "the log", False)]


def frozen(reference: Reference, imu: Imu | None) -> str:
    """A sentence if the reference never moves while the gyro turns faster than an offset explains, else nothing."""
    if imu is None or not len(imu.gyro.x):
        return ""
    t = imu.gyro.t_best
    known = rotation.finite(imu.gyro.x) & (t >= reference.t[0]) & (t <= reference.t[-1])
    good = imu.gyro.x[known]
    spread = np.std(good, axis=0) if len(good) else np.zeros(3)
    turning = float(np.degrees(np.sqrt(np.sum(spread**2))))
    if turning < FROZEN_DPS or np.ptp(reference.q, axis=0).max() > 1e-9:
        return ""
    return f"{reference.source} never changes while the gyro turns by {turning:.0f} deg/s rms: it holds no attitude"
