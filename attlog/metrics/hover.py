"""How much does the attitude jitter in hover? Standard deviation between 0.5 and 5 Hz."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, intersect
from attlog.metrics import following
from attlog.metrics import intervals as interval
from attlog.metrics.metric import Answer, Case, Metric, Resolution, applies_to, missing, paragraph, per_row
from attlog.metrics.windows import covered_seconds, detrended, within
from attlog.reference.model import Row

Array = NDArray[np.float64]

BAND_HZ = (0.5, 5.0)
WINDOW_S = 4.0
TOGETHER = 64
"""Windows that are transformed at once."""
MIN_RATE_HZ = 2.0 * BAND_HZ[1]
HUANG_DEG = 5.0
LARGEST_DEG = 180.0
"""No angle is larger: an interval that reaches so far, as of two unlike windows, says nothing."""

HOVER_METRICS: tuple[Metric, ...] = (
    Metric(
        "hover_jitter_deg",
        "Jitter in hover",
        "deg",
        "low",
        ("hover",),
        paragraph(
            """Standard deviation of roll and pitch together between 0.5 and 5 Hz in hover: power in that band of
            windows of 4 s (Hann, half overlapping), summed over both angles. The vehicle's own motion is part of
            it, the same for all rows. Interval: t on the logarithm of the window powers. Beside it the share of
            hover within +-5 deg of the mean (Huang's check)."""
        ),
        resolution=Resolution(5.0, "its order of magnitude", "windows"),
    ),
)


def band_power(x: Array, step: float) -> Array:
    """Power (...) of signals (..., n), sampled every ``step`` s, between 0.5 and 5 Hz; straight line removed, Hann."""
    n = x.shape[-1]
    taper, frequency = np.hanning(n), np.fft.rfftfreq(n, step)
    flat = detrended(np.arange(n, dtype=float), x.reshape(-1, n).T).T.reshape(x.shape)
    power = np.abs(np.fft.rfft(flat * taper, axis=-1)) ** 2 * 2.0 / (n * float(np.sum(taper**2)))
    return np.asarray(np.sum(power[..., (frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1])], axis=-1))


@dataclass(frozen=True, slots=True)
class Powers:
    """Powers (deg^2) of half overlapping windows of hover, the time they stand for, and the share within 5 deg."""

    powers: list[float]
    seconds: float
    near_pct: float


@per_row
def _powers(case: Case, row: Row, spans: list[Span]) -> Powers:
    if max(t1 - t0 for t0, t1 in spans) < WINDOW_S:
        return Powers([], 0.0, 0.0)
    powers, near, total = [], 0, 0
    segments = [p for span in spans for p in within(row.t, span, row.segment) if np.isfinite(row.q[p]).all()]
    for segment in segments:
        t = row.t[segment]
        step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        if step <= 0 or 1.0 / step < MIN_RATE_HZ or t[-1] - t[0] < WINDOW_S:
            continue
        q = row.q[segment]
        away = np.degrees(rotation.to_rotvec(rotation.multiply(rotation.conjugate(rotation.mean(q)), q)))[:, :2]
        near += int(np.sum(np.abs(away).max(axis=1) <= HUANG_DEG))
        total += len(away)
        size = round(WINDOW_S / step)
        if len(away) < size:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(away, size, axis=0)[:: size // 2]
        for a in range(0, len(windows), TOGETHER):
            powers += band_power(windows[a : a + TOGETHER], step).sum(axis=1).tolist()
    return Powers(powers, covered_seconds(row.t, segments), 100.0 * near / max(total, 1))


def compute_hover(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without hover by definition."""
    if not applies_to(window, "all", "airborne", "hover"):
        return {}
    name = "hover_jitter_deg"
    spans = intersect(case.segments.spans("hover"), case.segments.spans(window))
    spans = intersect(spans, [(row.start + 5.0, math.inf)])
    if not spans:
        return {name: missing("not_covered", f"no hover in window {window}", "deg", window)}
    found = _powers(case, row, spans)
    powers = found.powers
    if not powers:
        reason = f"no hover of {WINDOW_S:.0f} s without a gap at {MIN_RATE_HZ:.0f} Hz or more"
        return {name: missing("record_too_short", reason, "deg", window)}
    sigma = math.sqrt(float(np.mean(powers)))
    ci95 = interval.log_sigma_interval(sigma, powers[::2])
    few = "one window of hover gives no interval" if ci95 is None else None
    if ci95 is not None and ci95[1] > LARGEST_DEG:
        ci95, few = None, f"{len(powers[::2])} windows of hover differ too much to give an interval"
    answer = Answer(
        sigma,
        "deg",
        window,
        len(powers[::2]),
        found.seconds,
        ci95,
        f"{len(powers)} windows of 4 s",
        reason=few,
        ranked=few is None,
        detail={"within_5_deg_pct": found.near_pct},
    )
    return {name: following.unrank_frozen(case, row, "roll", answer)}
