"""Compass field strength against motor current or throttle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median, quantile
from attlog.core.spans import inside
from attlog.flight.compass import MotorPower, motor_drives
from attlog.flight.model import FlightLog, Mag, Stream
from attlog.health.check import Check, Verdict, unknown
from attlog.health.flown import EDGE_S, flight_before_crash, samples_in_use
from attlog.segments.model import Segments

MOVE_ADVICE = "Move the compass away from power wires, or calibrate it against the motors."
# Minimum correlation; the field also changes with attitude and place.
MIN_CORRELATION = 0.6
# Lower bound of the fitted field in a relative change; the earth's field is at least 22 uT.
MIN_FIELD_UT = 1.0
# Change of the field over the range of the drive: ardupilot.org, "Magnetic Interference", limits it to 30 %.
INTERFERENCE_PCT = (12.0, 30.0)
LIMIT = f"ok up to {INTERFERENCE_PCT[0]:.0f} % or r below {MIN_CORRELATION}, fault above {INTERFERENCE_PCT[1]:.0f} %"
# Minimum range of the drive for a slope: 0.1 of throttle, twice the noise of a current sensor.
MIN_RANGES: dict[MotorPower, float] = {"throttle": 0.1, "current": 2.0}
# Minimum time and samples against correlation by chance.
MIN_FIELD_S, MIN_FIELD_SAMPLES = 10.0, 50
# Time before take-off, and samples, for the field on the ground.
GROUND_S, MIN_GROUND_SAMPLES = 20.0, 10
# Offsets explain the variation if a sphere fit halves it, with a minimum turn for the fit.
STEADIER_SHARE, MIN_SPHERE_TURN_DEG = 0.5, 15.0


def interference_check(log: FlightLog, segments: Segments, mag: Mag) -> Check:
    """Check field strength of a compass against current and throttle."""
    field = mag.field
    use = samples_in_use(log, segments, field.t_best, ("armed", "airborne"))
    use &= inside(field.t_best, segments.spans("armed") or segments.spans("airborne"))
    flown = use & inside(field.t_best, segments.spans("airborne"))
    best: Check | None = None
    for kind, drive in motor_drives(log).items():
        seen = follow_drive(field, drive, use, MIN_RANGES[kind])
        if seen is None:
            continue
        r, low, high = seen
        change = 100.0 * abs(high - low) / max(min(low, high), MIN_FIELD_UT)
        follows = abs(r) >= MIN_CORRELATION and change > INTERFERENCE_PCT[0]
        verdict: Verdict = "ok" if not follows else "fault" if change > INTERFERENCE_PCT[1] else "warning"
        text = f"The field goes from {low:.1f} to {high:.1f} uT with the {kind} (r = {r:.2f})."
        if follows and offsets_explain(field, drive, flown if flown.sum() >= MIN_FIELD_SAMPLES else use):
            verdict, text = "ok", f"{text[:-1]}, but offsets of the compass explain that: not the motors."
        if best is None or (verdict != "ok" and change > float(best.value or 0.0)):
            best = Check("compass_motors", verdict, text, round(change, 1), "%", LIMIT, sensor=field.source)
            best.about = "field_size"
    if best is None:
        best = ground_against_air(segments, mag)
    if best is None:
        why = "The log holds no throttle or current that changes while armed."
        return unknown("compass_motors", why, LIMIT, sensor=field.source)
    best.source = "correlation in flight; ardupilot.org, Magnetic Interference"
    if best.is_trouble:
        best.why_no_setting = "Without a heading by motion no value is known. Fly with GNSS, turning and braking."
        best.action = log.remedy("interference") or MOVE_ADVICE
    return best


def ground_against_air(segments: Segments, mag: Mag) -> Check | None:
    """Check field strength in flight against that on the ground before; None with too few samples or no change.

    For logs without throttle and current. In flight the field must leave its value on the ground at every heading, as
    offsets change it with the heading.
    """
    flights, t = flight_before_crash(segments), mag.field.t_best
    if not flights:
        return None
    size = 1e6 * np.sqrt(np.sum(mag.field.x**2, axis=1))
    begin = flights[0][0] - EDGE_S
    parts = [size[inside(t, spans) & (size > 0)] for spans in ([(begin - GROUND_S, begin - EDGE_S)], flights)]
    if len(parts[0]) < MIN_GROUND_SAMPLES or len(parts[1]) < MIN_FIELD_SAMPLES:
        return None
    ground, air = (float(median(part)) for part in parts)
    change = 100.0 * abs(air - ground) / max(min(air, ground), MIN_FIELD_UT)
    low, high = quantile(parts[1], [0.01, 0.99])
    if change <= INTERFERENCE_PCT[0] or low <= ground <= high:
        return None
    text = f"The field goes from {ground:.1f} uT on the ground to {air:.1f} uT in flight: motors or the place bend it."
    verdict: Verdict = "fault" if change > INTERFERENCE_PCT[1] else "warning"
    return Check(
        "compass_motors", verdict, text, round(change, 1), "%", LIMIT, sensor=mag.field.source, about="field_size"
    )


def follow_drive(
    field: Stream, drive: Stream, use: NDArray[np.bool_], min_range: float
) -> tuple[float, float, float] | None:
    """Return the correlation of field strength and drive, and the ends of the fitted line.

    The ends are field strengths in uT at the drive's 5th and 95th percentile. ``use`` (n,) selects field samples. None
    where the drive varies by less than ``min_range``, or with too few samples.
    """
    size = np.sqrt(np.sum(field.x**2, axis=1)) * 1e6
    use = np.isfinite(size) & (size > 0) & use
    known = np.isfinite(drive.x[:, 0])
    t, at, x = field.t_best[use], drive.t[known], drive.x[known, 0]
    if len(at) < MIN_FIELD_SAMPLES or len(t) < MIN_FIELD_SAMPLES or np.ptp(t) < MIN_FIELD_S:
        return None
    near = np.abs(t - at[np.clip(np.searchsorted(at, t), 0, len(at) - 1)]) < 1.0
    power, size = np.interp(t, at, x)[near], size[use][near]
    if len(power) < MIN_FIELD_SAMPLES:
        return None
    low, high = quantile(power, [0.05, 0.95])
    if high - low < min_range or np.std(size) == 0:
        return None
    slope, start = np.polyfit(power, size, 1)
    return float(np.corrcoef(power, size)[0, 1]), float(start + slope * low), float(start + slope * high)


def offsets_explain(field: Stream, drive: Stream, use: NDArray[np.bool_]) -> bool:
    """Return whether compass offsets explain the correlation of field strength and drive.

    Happens in fast flight in one direction. After removal of the sphere fit's offsets the field strength must vary less
    and no longer correlate with the drive.
    """
    use = use & rotation.finite_rows(field.x)
    x = 1e6 * field.x[use]
    if len(x) < MIN_FIELD_SAMPLES:
        return False
    size = np.linalg.norm(x, axis=1)
    middle = np.mean(x / size[:, None], axis=0)
    middle = middle / max(float(np.linalg.norm(middle)), 1e-9)
    if np.degrees(quantile(np.arccos(np.clip(x @ middle / size, -1.0, 1.0)), 0.95)) < MIN_SPHERE_TURN_DEG:
        return False
    scale = float(median(size))
    center, *_ = np.linalg.lstsq(np.column_stack([2.0 * x, np.ones(len(x))]), np.sum(x**2, axis=1), rcond=1e-3 / scale)
    after = np.linalg.norm(x - center[:3], axis=1)
    known = np.isfinite(drive.x[:, 0])
    power = np.interp(field.t_best[use], drive.t[known], drive.x[known, 0])
    if np.std(after) > STEADIER_SHARE * np.std(size) or np.std(power) == 0 or np.std(after) == 0:
        return False
    return abs(float(np.corrcoef(power, after)[0, 1])) < MIN_CORRELATION
