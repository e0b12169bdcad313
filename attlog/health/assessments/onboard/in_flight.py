"""When a vehicle flew, and by which attitude its other sensors are compared: for every question of this folder."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Array, FlightLog
from attlog.health.assessments.model import HealthCase
from attlog.health.fits.delays import AttitudePath
from attlog.health.sound import crashed
from attlog.segments.spans import Span, complement, intersect

EDGE_S = 1.0
"""Left out at both ends of a flight: the ground pushes there."""
BLOCK_S = 5.0
"""Samples within so long are not independent: intervals come from blocks."""
SURE_HEADING_DEG, SURE_TILT_DEG = 5.0, 1.0
"""A smoother that is surer than this knows its heading by motion alone; its tilt, where only that is needed."""


def flown(case: HealthCase) -> list[Span]:
    """Spans (t0, t1) s in the air before any crash; while armed, where a log cannot tell of flight."""
    segments = case.segments
    if segments is None or "airborne" in segments.unknown:
        spans = armed(case.log)
    else:
        spans = segments.spans("airborne")
    spans = [(a + EDGE_S, b - EDGE_S) for a, b in spans if b - a > 2.0 * EDGE_S]
    return spans if segments is None else intersect(spans, complement(crashed(segments), -np.inf, np.inf))


def armed(log: FlightLog) -> list[Span]:
    """Spans (t0, t1) s armed; none where the log does not tell."""
    if log.armed is None or len(log.armed.t) == 0:
        return []
    ends = [*log.armed.t[1:].tolist(), _last(log)]
    return [(a, b) for a, b, on in zip(log.armed.t.tolist(), ends, log.armed.value, strict=True) if on and b > a]


def _last(log: FlightLog) -> float:
    """The last time of anything that is asked for here, s."""
    every = [a.t for a in log.attitudes.values()] + [g.t for g in log.gnss] + [i.t for i in log.innovation_tests]
    return max((float(t[-1]) for t in every if len(t)), default=log.seconds)


def attitude_path(case: HealthCase) -> AttitudePath | None:
    """The attitude that the delays of other sensors are measured by; None where none is sound.

    By motion alone where that knows its heading, else truth or a smoother with its own heading, else motion alone
    with a heading that the fits turn as they need.
    """
    motion, reference = case.motion, case.reference
    by_motion = None if motion is None else AttitudePath(motion.t, motion.q, motion.segment, "motion alone")
    if motion is not None and _at_most(motion.quality, "sigma_heading_deg", SURE_HEADING_DEG):
        return by_motion
    if reference is not None and reference.kind in ("truth", "smoother") and reference.heading_by == "own":
        return AttitudePath(reference.t, reference.q, reference.gap_segment, f"the {reference.kind}")
    if motion is not None and _at_most(motion.quality, "sigma_tilt_deg", SURE_TILT_DEG):
        return by_motion
    return None


def _at_most(quality: dict[str, float | str], name: str, limit: float) -> bool:
    value = quality.get(name)
    return isinstance(value, float) and value <= limit


def no_path(case: HealthCase) -> str:
    """Why there is no attitude to measure delays by, and what would give one."""
    if case.log.replay_imu is None:
        return f"No IMU of this log can be replayed. {case.log.advice('imu')}".strip()
    return "No attitude of this log is sure enough to measure delays by; fly longer with GNSS, faster and slower."


def median_interval(t: Array, x: Array) -> tuple[float, float]:
    """The 95 % interval of the median of ``x`` (n,) at ``t`` (n,) s: order statistics of medians of blocks of 5 s."""
    block = (t // BLOCK_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    medians = np.sort([float(np.median(part)) for part in np.split(x, starts[1:])])
    n = len(medians)
    reach = 0.98 * np.sqrt(n)
    low, high = int(np.floor(0.5 * n - reach)), int(np.ceil(0.5 * n + reach))
    return float(medians[max(low, 0)]), float(medians[min(high, n - 1)])


def held_seconds(t: Array) -> Array:
    """How long each sample (n,) at ``t`` stands for, s: to the next, at most three usual steps."""
    if len(t) < 2:
        return np.zeros(len(t))
    step = np.diff(t)
    usual = float(np.median(step))
    return np.asarray(np.minimum(np.append(step, usual), 3.0 * usual))
