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
SURE_DEG = 5.0
"""A heading by motion alone that is surer than this turns velocities well enough (SENSORS 1)."""


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
    times = [x.t[-1] for x in (*log.attitudes.values(), *log.gnss, *log.innovation_tests) if len(x.t)]
    return float(max(times, default=log.seconds))


def attitude_path(case: HealthCase) -> AttitudePath | None:
    """The attitude by motion alone where it knows its heading, else truth or a smoother; None without any."""
    motion, reference = case.motion, case.reference
    if motion is not None and sure(motion.quality.get("sigma_heading_deg")):
        return AttitudePath(motion.t, motion.q, motion.segment, "the smoother without compass")
    if reference is not None and reference.kind in ("truth", "smoother") and reference.heading_by == "own":
        return AttitudePath(reference.t, reference.q, reference.gap_segment, f"the {reference.kind}")
    return None


def sure(sigma_deg: float | str | None) -> bool:
    """Whether a smoother's own heading sigma is small enough."""
    return isinstance(sigma_deg, float) and sigma_deg <= SURE_DEG


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
    return np.minimum(np.append(step, usual), 3.0 * usual)
