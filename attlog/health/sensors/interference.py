"""Does the measured field follow throttle or current? Then motors bend the compass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Stream
from attlog.health.model import Check, not_judged
from attlog.health.sound import in_use
from attlog.segments.model import Segments
from attlog.segments.spans import inside

Array = NDArray[np.float64]

NAME = "field against motors"
LEAST_R = 0.6
"""Weaker correlation is no sign: the field also changes with attitude and place."""
LEAST_UT = 1.0
"""The earth's field has 22 uT and more: a line that ends below this, or below zero, is compared with this."""
SHARE_PCT = (12.0, 30.0)
"""Change of the field over the range of throttle: ardupilot.org, "Magnetic Interference", calls 30 % the limit."""
LEAST_THROTTLE, LEAST_AMPERE = 0.1, 2.0
"""A drive that varies by less tells nothing."""
SECONDS, SAMPLES = 10.0, 50
STEADIER, TURNED_DEG = 0.5, 15.0
"""Offsets explain a field whose size then varies by half; only where the vehicle turned can they be known."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """The strength of the field against the motors' current, else their throttle."""
    if log.mag is None:
        return []
    limit = f"ok up to {SHARE_PCT[0]:.0f} % or r below {LEAST_R}, fault above {SHARE_PCT[1]:.0f} %"
    field = log.mags[log.mag].field
    use = in_use(log, segments, field.t_best, ("armed", "airborne"))
    use &= inside(field.t_best, segments.spans("armed") or segments.spans("airborne"))
    flown = use & inside(field.t_best, segments.spans("airborne"))
    best: Check | None = None
    for what, stream, least in drives(log):
        seen = follow(field, stream, use, least)
        if seen is None:
            continue
        r, low, high = seen
        change = 100.0 * abs(high - low) / max(min(low, high), LEAST_UT)
        follows = abs(r) >= LEAST_R and change > SHARE_PCT[0]
        verdict = "ok" if not follows else "fault" if change > SHARE_PCT[1] else "warning"
        text = f"The field goes from {low:.1f} to {high:.1f} uT with {what} (r = {r:.2f})."
        if follows and offsets_explain(field, stream, flown if flown.sum() >= SAMPLES else use):
            verdict, text = "ok", f"{text[:-1]}, but offsets of the compass explain that: not the motors."
        check = Check(NAME, verdict, text, round(change, 1), "%", limit)
        if best is None or (verdict != "ok" and change > float(best.value or 0.0)):
            best = check
    return [best or not_judged(NAME, "The log holds no throttle or current that changes while armed.", limit)]


def drives(log: FlightLog) -> list[tuple[str, Stream, float]]:
    """What may bend the field: name, stream, and the least range that tells something."""
    found = []
    if log.battery is not None and log.battery.x.shape[1] > 1 and np.isfinite(log.battery.x[:, 1]).any():
        current = Stream(log.battery.t, log.battery.x[:, 1:2], "A", "", log.battery.source)
        found.append(("the current", current, LEAST_AMPERE))
    if log.throttle is not None and len(log.throttle.t) > 1:
        found.append(("the throttle", log.throttle, LEAST_THROTTLE))
    return found


def follow(field: Stream, drive: Stream, use: NDArray[np.bool_], least: float) -> tuple[float, float, float] | None:
    """Correlation of the field's size with a drive, and the line through both (uT) at the drive's 5th and 95th
    percentile, over the samples ``use`` (n,); None where the drive varies by less than ``least`` or there are few."""
    x = drive.x[:, 0]
    known = np.isfinite(x)
    t = field.t_best
    size = np.sqrt(np.sum(field.x**2, axis=1)) * 1e6
    use = np.isfinite(size) & (size > 0) & use
    if known.sum() < SAMPLES or use.sum() < SAMPLES or np.ptp(t[use]) < SECONDS:
        return None
    power = np.interp(t[use], drive.t[known], x[known])
    near = np.abs(t[use] - drive.t[known][np.clip(np.searchsorted(drive.t[known], t[use]), 0, known.sum() - 1)]) < 1.0
    power, size = power[near], size[use][near]
    if len(power) < SAMPLES:
        return None
    low, high = np.quantile(power, 0.05), np.quantile(power, 0.95)
    if high - low < least or np.std(size) == 0:
        return None
    r = float(np.corrcoef(power, size)[0, 1])
    slope, start = np.polyfit(power, size, 1)
    return r, float(start + slope * low), float(start + slope * high)


def offsets_explain(field: Stream, drive: Stream, use: NDArray[np.bool_]) -> bool:
    """Whether constant offsets of the compass explain why its size follows a drive, as where it flies one way fast.

    The field less the offsets of the best sphere has a size that follows the drive by less than LEAST_R.
    """
    use = use & np.isfinite(field.x).all(axis=1)
    x = 1e6 * field.x[use]
    if len(x) < SAMPLES:
        return False
    unit = x / np.linalg.norm(x, axis=1, keepdims=True)
    middle = unit.mean(axis=0) / max(float(np.linalg.norm(unit.mean(axis=0))), 1e-9)
    if np.degrees(np.quantile(np.arccos(np.clip(unit @ middle, -1.0, 1.0)), 0.95)) < TURNED_DEG:
        return False
    scale = float(np.median(np.linalg.norm(x, axis=1)))
    centre, *_ = np.linalg.lstsq(np.column_stack([2.0 * x, np.ones(len(x))]), np.sum(x**2, axis=1), rcond=1e-3 / scale)
    before, after = np.linalg.norm(x, axis=1), np.linalg.norm(x - centre[:3], axis=1)
    known = np.isfinite(drive.x[:, 0])
    power = np.interp(field.t_best[use], drive.t[known], drive.x[known, 0])
    if np.std(after) > STEADIER * np.std(before) or np.std(power) == 0 or np.std(after) == 0:
        return False
    return abs(float(np.corrcoef(power, after)[0, 1])) < LEAST_R
