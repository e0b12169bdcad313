"""The magnetometer: alive, size of the field, and a field that stands still while the vehicle turns."""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight import magnetic
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.health.model import Check, graded, not_judged
from attlog.health.sensors import frozen
from attlog.health.sensors.accelerometer import of_imu
from attlog.health.sound import in_use
from attlog.reference import declination, scoring
from attlog.segments import resets
from attlog.segments.model import Segments

STRENGTH_UT = (15.0, 90.0)
"""Outside this no place on earth lies: 22 to 67 uT with room for an iron vehicle."""

LEAST, LEAST_S = 10, 8.0
"""Fewer samples, or seconds of them, tell no size."""
ALIGNED_S = 5.0
"""In its first seconds an onboard heading may lie anywhere: there sound compasses spread by 20 to 92 deg."""
MIDDLE_SIGMAS = 3.29
"""Standard deviations between the 5th and the 95th percentile of a normal distribution."""
FAST_DPS = 60.0
"""Faster turns are left out: 50 ms between a field and its stamp are 3 deg then, and no fault of the compass."""
SLOW_HZ, SLOW_DPS = 8.0, 15.0
"""Below this rate field and attitude are not of one moment, unless the vehicle turns slower than that."""
STEADY_DEG, UNSTEADY_DEG = 5.0, 20.0
"""How much the direction of the field may vary in earth axes; beyond the second a mean within it tells none."""

NORTH_DEG, FAR_DEG = 4.0, 15.0
"""How far the field's north may lie from the model's, twice that below SLOW_HZ; beyond the second compass or heading is
wrong."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Field strength, steadiness in earth axes, declination."""
    if not log.mags:
        return [not_judged("field", "There is no magnetometer data in this log.", "15 to 90 uT")]
    found = [
        Check(
            f"magnetometer {m.index}",
            "fault",
            f"{_named(log, m.field.source)}: {reason}.",
            "dead",
            "",
            "must follow the field",
        )
        for m in log.mags
        if (reason := magnetic.dead(m, log.replay_imu))
    ]
    if log.mag is None:
        return [*found, not_judged("field", "No usable magnetometer in this log.", "15 to 90 uT")]
    held = frozen.compass(log)
    if held:
        why = f"The compass stops at {held[0][0]:.1f} s: its field says nothing from there on."
        return [
            *found,
            strength(log, segments),
            *(not_judged(name, why) for name in ("field against attitude", "declination")),
        ]
    return [*found, strength(log, segments), *against_attitude(log, segments)]


def strength(log: FlightLog, segments: Segments) -> Check:
    """The size of the field against the world magnetic model, and how much it varies, while the vehicle is in use."""
    mag = log.mags[log.mag or 0]
    norm = np.sqrt(np.nansum(mag.field.x**2, axis=1)) * 1e6
    used = (norm > 0) & in_use(log, segments, mag.field.t_best)
    t = mag.field.t_best[used]
    if len(t) < LEAST or (len(t) - 1) * float(np.median(np.diff(t))) < LEAST_S:
        return not_judged("field", f"{mag.field.source} measured for less than {LEAST_S:.0f} s in use.")
    norm = norm[used]
    value, spread = float(np.median(norm)), float(np.std(norm) / np.median(norm))
    model = declination.model(log)
    text = f"{mag.field.source} reads {value:.1f} uT, varying by {100 * spread:.0f} %"
    verdict = "ok" if STRENGTH_UT[0] <= value <= STRENGTH_UT[1] else "fault"
    limit = "ok within 20 % of the model and varying up to 10 %; fault outside 15 to 90 uT"
    if model is not None:
        expected = model.strength_t * 1e6
        text += f"; the earth has {expected:.1f} uT there"
        if verdict == "ok" and abs(value / expected - 1) > 0.2:
            verdict = "warning"
    elif verdict == "fault":
        text += "; the earth has 22 to 67 uT anywhere"
    if verdict == "ok" and spread > 0.1:
        verdict = "warning"
    if not mag.calibrated:
        verdict = "warning" if verdict == "ok" else verdict
        text += "; uncalibrated"
    return Check("field", verdict, text + ".", round(value, 2), "uT", limit)


def _named(log: FlightLog, source: str) -> str:
    """A compass by its record, and as a compass where an IMU stands in the same record (RAW_IMU of MAVLink)."""
    return f"The compass of {source}" if any(imu.gyro.source == source for imu in log.imus) else source


def against_attitude(log: FlightLog, segments: Segments) -> list[Check]:
    """Direction of the horizontal field, rotated by truth or the onboard attitude: steady, and the declination.

    From the attitude's own alignment on, in use: no wreck, not upside down, not the ground where something flew. Where
    field or attitude are slow they are not of one moment: only slow turns count there, and less strictly.
    """
    limit = f"ok up to {STEADY_DEG:.0f} deg, twice that below {SLOW_HZ:.0f} Hz, fault above {UNSTEADY_DEG:.0f} deg"
    truth = log.truth_with_north
    name, attitude = ("truth", truth) if truth is not None else (log.onboard, log.onboard_attitude)
    if attitude is None:
        return [not_judged("field against attitude", "There is no attitude to rotate the field by.", limit)]
    q = attitude.q if name == "truth" else of_imu(log, attitude)
    field = log.mags[log.mag or 0].field
    turned = rotation.slerp(attitude.t, q, field.t_best)
    good = rotation.finite(turned) & rotation.finite(field.x) & in_use(log, segments, field.t_best)
    good &= field.t_best >= aligned(log, attitude, segments)
    slow = min(field.rate, attitude.rate) < SLOW_HZ
    good &= turning_dps(attitude.t, q, field.t_best) < (SLOW_DPS if slow else FAST_DPS)
    if good.sum() < LEAST:
        said = f"{name} covers {good.sum()} magnetometer samples only, at slow turns."
        return [not_judged("field against attitude", said, limit)]
    north = rotation.rotate(turned[good], field.x[good])
    azimuth, spread = circular(np.arctan2(north[:, 1], north[:, 0]))
    model = declination.model(log)
    off = azimuth if model is None else float(np.degrees(rotation.wrap(np.radians(azimuth - model.declination_deg))))
    whose = "the true" if name == "truth" else f"{name}'s"
    less = "" if model is None else f", less the declination of {model.declination_deg:.1f} deg,"
    text = f"The field's north lies {off:.1f} deg from {whose} north{less} and varies by {spread:.1f} deg (1 sigma)."
    verdict = graded(spread, STEADY_DEG * (2.0 if slow else 1.0), UNSTEADY_DEG)
    found = [Check("field against attitude", verdict, text, round(spread, 2), "deg", limit)]
    within = NORTH_DEG * (2.0 if slow else 1.0)
    limit = f"ok within {within:.0f} deg of the model, fault above {FAR_DEG:.0f} deg"
    if model is None:
        return [
            *found,
            not_judged("declination", "There is no GNSS position, so no declination to compare with.", limit),
        ]
    if max(UNSTEADY_DEG, abs(off)) < spread:
        return [*found, not_judged("declination", "The field varies too much to determine a declination.", limit)]
    expected = f"the model says {model.declination_deg:.1f} deg"
    text = f"The field's north lies {azimuth:.1f} deg from {whose} north; {expected}."
    found.append(Check("declination", graded(abs(off), within, FAR_DEG), text, round(azimuth, 2), "deg", limit))
    return found


def aligned(log: FlightLog, attitude: Attitude, segments: Segments) -> float:
    """When the attitude had its own heading, s: after its last jump before the flight, and ALIGNED_S from its start."""
    if attitude is log.truth:
        return -np.inf
    index, _ = resets.known(log, log.onboard or "", segments)
    jumped = scoring.aligned_at(attitude, index, segments)
    began = float(attitude.t[0]) + ALIGNED_S
    return began if jumped is None else max(jumped, began)


def turning_dps(t: Array, q: Array, at: Array) -> Array:
    """How fast (n,) in deg/s an attitude (m, 4) at ``t`` (m,) turns around times ``at`` (n,); infinite beyond it."""
    if len(t) < 2:
        return np.full(len(at), np.inf)
    rate = np.degrees(rotation.length(rotation.increments(q))) / np.maximum(np.diff(t), 1e-6)
    k = np.searchsorted(t, at) - 1
    around = [rate[np.clip(k + j, 0, len(rate) - 1)] for j in (-1, 0, 1)]
    return np.where((at >= t[0]) & (at <= t[-1]), np.maximum.reduce(around), np.inf)


def circular(angle: Array) -> tuple[float, float]:
    """Circular mean and standard deviation in deg of angles (n,) in rad, this by the middle 90 % of them.

    A twentieth at either end does not count: turns that the field's clock is late in.
    """
    mean = float(np.angle(np.mean(np.exp(1j * angle))))
    low, high = np.quantile(np.degrees(rotation.wrap(angle - mean)), [0.05, 0.95])
    return float(np.degrees(mean)), float(high - low) / MIDDLE_SIGMAS
