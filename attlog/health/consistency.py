"""Sensors that must agree over a flight: heights of GNSS and barometer, and gravity at rest before and after it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, between, inside
from attlog.flight.model import FIX_3D, Array, Gnss, Imu, Stream
from attlog.health.check import Check, HealthCase, unknown
from attlog.health.flown import flight_spans
from attlog.health.gravity import degrees_between
from attlog.segments.increments import gyro_increments
from attlog.segments.model import Segment, Segments
from attlog.story.flight_events import Event

# --- height ------------------------------------------------------------------------------------------------------

# Expected change of GNSS height against the barometer: 10 m of the barometer (ground effect, weather; in wind and speed
# the dynamic pressure v^2/2g; aloft 10 % of the climb, from 30 K beside the standard atmosphere), and three times the
# accuracy of GNSS, at least 2 m.
BARO_M, CLIMB_SHARE, ACCURACIES, MIN_ACCURACY_M = 10.0, 0.1, 3.0, 2.0
# Limit in these sums: the largest change of a log, log-normal on 41 real ones without a broken sensor (median 0.24,
# deviation of the logarithm 0.77), is below it on 98 %; each of them is below the limit that the others give.
MAX_EXPECTED = 1.25
# Maximum time from a fix to a record of the barometer: across longer pauses its height is unknown.
MAX_BARO_DISTANCE_S = 2.0
STANDARD_GRAVITY_M_S2 = 9.80665
MIN_FIXES = 20
# Share of a difference from which one of two sensors explains it, and up to which the other one is sound: a height
# against the integrated GNSS velocity, a rest against one on ground that did not move.
ERRS_SHARE, SOUND_SHARE = 0.6, 0.4
# Change of a height from fix to fix, in the running median of five, that no vehicle climbs.
MAX_CLIMB_M_S = 30.0
BARO_STEPS = "The barometer is wrong: its height steps, that of GNSS does not."
UNKNOWN_HEIGHT = "GNSS or the barometer is wrong; the log does not show which."
HEIGHT_LIMIT = "ok up to 1.25 times 10 m (or v²/2g, or 10 % of the climb) and three times the accuracy of GNSS"
HEIGHT_SOURCE = "58 flights of 41 real logs"


def height_checks(case: HealthCase) -> list[Check]:
    """Check GNSS height against the barometer in each flight; the worst flight counts."""
    receiver = next((g for g in case.log.gnss if (g.fix >= FIX_3D).any()), None)
    flown = flight_spans(case.segments)
    if receiver is None or not case.log.baro or not flown:
        return []
    found = [one for span in flown if (one := _height_check(case.log.baro[0], receiver, span)) is not None]
    if not found:
        why = f"No flight has {MIN_FIXES} fixes with a height."
        return [unknown("gnss_height", why, HEIGHT_LIMIT, sensor=receiver.source)]
    return [max(found, key=lambda check: (check.is_trouble, check.value or 0.0))]


def _height_check(baro: Stream, receiver: Gnss, flight: Span) -> Check | None:
    """Check the heights in one flight, None for too few fixes."""
    part = between(receiver.t, *flight)
    use = np.flatnonzero((receiver.fix[part] >= FIX_3D) & np.isfinite(receiver.alt[part])) + part.start
    known = np.isfinite(baro.x[:, 0])
    baro_t, baro_m = baro.t[known], baro.x[known, 0]
    if np.count_nonzero(inside(baro_t, [flight])) < MIN_FIXES:
        return None
    at = receiver.t[use]
    after = np.clip(np.searchsorted(baro_t, at), 1, len(baro_t) - 1)
    near = np.minimum(np.abs(at - baro_t[after - 1]), np.abs(at - baro_t[after])) <= MAX_BARO_DISTANCE_S
    use = use[near]
    if len(use) < MIN_FIXES:
        return None
    t, v = receiver.t[use], receiver.vel_ned[use]
    high = _without_spikes(receiver.alt[use])
    flat = _without_spikes(np.interp(t, baro_t, baro_m))
    apart = high - flat
    change = float(np.ptp(apart))
    accuracy = receiver.v_acc[use][np.isfinite(receiver.v_acc[use])]
    speed = np.hypot(v[:, 0], v[:, 1])
    fast = float(quantile(speed[np.isfinite(speed)], 0.95)) if np.isfinite(speed).any() else 0.0
    climb = min(float(np.ptp(high)), float(np.ptp(flat)))
    allowed = max(BARO_M, fast**2 / (2.0 * STANDARD_GRAVITY_M_S2), CLIMB_SHARE * climb)
    allowed += ACCURACIES * max(MIN_ACCURACY_M, float(median(accuracy)) if len(accuracy) else 0.0)
    allowed *= MAX_EXPECTED
    text = f"GNSS height and barometer stay within {change:.1f} m of each other in flight."
    check = Check("gnss_height", "ok", text, round(change, 1), "m", HEIGHT_LIMIT, sensor=receiver.source)
    check.n, check.seconds, check.source = len(use), round(float(t[-1] - t[0]), 1), HEIGHT_SOURCE
    if change <= allowed:
        return check
    begin = float(median(apart[: max(MIN_FIXES // 4, 1)]))
    away = np.abs(apart - begin)
    beyond = np.flatnonzero(away > min(allowed, 0.5 * float(away.max())))
    check.verdict, check.t, check.t_end = "warning", round(float(t[beyond[0]]), 1), round(float(t[beyond[-1]]), 1)
    check.about, check.cause = _wrong_height(t, v[:, 2], high, flat, change)
    check.kind = "barometer" if check.about == "barometer" else ""
    what = {"GNSS height": "GNSS height is wrong", "barometer": "The barometer is wrong"}.get(check.about, "")
    other = {"GNSS height": " against the barometer", "barometer": " against GNSS"}.get(check.about, "")
    what = what or "Heights of GNSS and barometer differ"
    check.text = f"{what} by {change:.0f} m{other} in flight, from {check.t:.0f} s."
    check.action = "Compare both heights with a known height before flying an altitude-hold mode."
    return check


def _without_spikes(x: Array) -> Array:
    """Return the running median (n,) of five samples."""
    return np.asarray(median(np.lib.stride_tricks.sliding_window_view(np.pad(x, 2, mode="edge"), 5), axis=1))


def _wrong_height(t: Array, down: Array, high: Array, flat: Array, change: float) -> tuple[str, str]:
    """Return which height errs, and the cause.

    A height that steps errs; else the one that leaves the integrated GNSS velocity, which is measured apart (Doppler).
    """
    gnss_steps, baro_steps = (float(np.max(np.abs(np.diff(x)) / np.diff(t))) > MAX_CLIMB_M_S for x in (high, flat))
    if gnss_steps != baro_steps:
        return ("barometer", BARO_STEPS) if baro_steps else ("GNSS height", "The GNSS height steps.")
    if not np.isfinite(down).all() or not np.any(down):
        return "", UNKNOWN_HEIGHT
    climbed = np.concatenate([[0.0], np.cumsum(-0.5 * (down[1:] + down[:-1]) * np.diff(t))])
    gnss, baro = (float(np.ptp(x - climbed)) / change for x in (high, flat))
    if gnss >= ERRS_SHARE and baro <= SOUND_SHARE:
        return "GNSS height", "The GNSS position is wrong: its own vertical speed agrees with the barometer."
    if baro >= ERRS_SHARE and gnss <= SOUND_SHARE:
        return "barometer", "The barometer is wrong: height and vertical speed of GNSS agree."
    return "", UNKNOWN_HEIGHT


# --- gravity at rest ---------------------------------------------------------------------------------------------

# Rest before and after a flight, and its part that is used, next to the flight.
MIN_REST_S, MAX_REST_S = 2.0, 10.0
# Longest time between both rests: longer, the gyro drifts by as much as an offset tilts.
MAX_BETWEEN_S = 200.0
STEP_S = 0.1
# Allowed angle between gravity as the gyro turned it and as measured after the flight, root sum of squares: twice 2 deg
# (0.3 m/s^2 by the warmth of the accelerometer and 1 deg of gyro within a minute), half of what the change of the bias
# of the gyro makes, and 0.3 % of all turns. On 24 simulated flights it is up to half of this, 1.05 of it the 99 % limit
# of the next one (log-normal); a bias that moves by 0.2 deg/s makes 6.8 deg.
ANGLE_DEG, BIAS_SHARE, TURN_SHARE = 4.0, 0.5, 0.003
# Sigmas of the random walk by rates between the samples, within which a larger angle is no fault.
WALK_SIGMAS = 3.0
GRAVITY_LIMIT = "ok up to 4°, half the drift by the change of the gyro's bias, 0.3 % of all turns (root sum of squares)"
GRAVITY_SOURCE = "24 simulated flights"


def gravity_kept_checks(case: HealthCase) -> list[Check]:
    """Check gravity at rest after each flight against that before it, turned by the gyro; the worst counts."""
    found = []
    for imu in case.log.imus:
        mine = [one for pair in _rest_pairs(case.segments) if (one := _gravity_check(imu, *pair)) is not None]
        if mine:
            found.append(max(mine, key=lambda check: (check.is_trouble, check.value or 0.0)))
    if not found and case.log.imus and case.segments.spans("airborne"):
        why = f"No flight below {MAX_BETWEEN_S:.0f} s without a crash has {MIN_REST_S:.0f} s of rest on both sides."
        return [unknown("gravity_kept", why, GRAVITY_LIMIT)]
    return found


def _rest_pairs(segments: Segments) -> list[tuple[Segment, Segment]]:
    """Return the rests before and after each flight, without crash between them."""
    rests = [s for s in segments.of("rest") if s.t1 - s.t0 >= MIN_REST_S]
    lost = [s.t0 for kind in ("impact", "loss_of_control") for s in segments.of(kind)]
    pairs = []
    for a, b in segments.spans("airborne"):
        before, after = [s for s in rests if s.t1 <= a + 0.5], [s for s in rests if s.t0 >= b - 0.5]
        if before and after and not any(before[-1].t1 <= t <= after[0].t0 for t in lost):
            pairs.append((before[-1], after[0]))
    return list(dict.fromkeys(pairs))


def _gravity_check(imu: Imu, before: Segment, after: Segment) -> Check | None:
    """Check one unit over one flight, None where its samples have a gap."""
    first, last = (max(before.t0, before.t1 - MAX_REST_S), before.t1), (after.t0, min(after.t1, after.t0 + MAX_REST_S))
    start, end = _mean_at_rest(imu, first), _mean_at_rest(imu, last)
    if start is None or end is None or last[1] - first[0] > MAX_BETWEEN_S:
        return None
    (force0, bias0, t0), (force1, bias1, t1) = start, end
    gyro = gyro_increments(imu)
    edges = np.linspace(t0, t1, max(int((t1 - t0) / STEP_S), 2))
    if not gyro.known(edges[:1], edges[-1:]).all():
        return None
    share = ((0.5 * (edges[1:] + edges[:-1]) - t0) / (t1 - t0))[:, None]
    turns = gyro.between(edges[:-1], edges[1:]) - (bias0 + share * (bias1 - bias0)) * np.diff(edges)[:, None]
    expected = np.asarray(rotation.rotate_inverse(rotation.product(rotation.from_rotvec(turns)), force0))
    angle, moved = _degrees(expected, force1), _degrees(force0, force1)
    drift = math.degrees(float(np.linalg.norm(bias1 - bias0))) * (t1 - t0) / 2.0
    turned = math.degrees(float(np.linalg.norm(turns, axis=1).sum()))
    allowed = math.hypot(ANGLE_DEG, BIAS_SHARE * drift, TURN_SHARE * turned)
    text = f"Gravity at rest after the flight agrees within {angle:.1f}° with that before it, turned by the gyro."
    check = Check("gravity_kept", "ok", text, round(angle, 1), "°", GRAVITY_LIMIT, t=round(before.t1, 1))
    check.t_end, check.sensor, check.source = round(after.t0, 1), imu.acc.source, GRAVITY_SOURCE
    if angle <= allowed:
        return check
    walk = WALK_SIGMAS * _sampling_walk_deg(imu, before.t1, after.t0)
    if angle <= allowed + walk:
        why = f"The gyro's samples are too few for its motion: they leave up to {walk:.0f}° unknown."
        return unknown("gravity_kept", why, GRAVITY_LIMIT, sensor=imu.acc.source)
    check.verdict, by_gyro = "warning", _degrees(force0, expected)
    check.text = f"Gravity at rest turned by {moved:.1f}° over the flight, where the gyro shows {by_gyro:.1f}°."
    step = force1 - expected
    axis = int(np.argmax(np.abs(step)))
    check.evidence = [f"{imu.acc.source} changed by {step[axis]:+.2f} m/s^2 along {'xyz'[axis]} against the gyro."]
    if moved > ERRS_SHARE * angle and by_gyro < SOUND_SHARE * angle:
        check.about, check.cause = (
            "accelerometer",
            "The accelerometer's offset changed in flight, or its mount gave way.",
        )
        check.action = "Check that the autopilot is fixed, and calibrate the accelerometer in six positions."
    elif by_gyro > ERRS_SHARE * angle and moved < SOUND_SHARE * angle:
        check.about, check.kind = "gyro", "gyro_bias"
        check.cause = "The gyro's bias in flight differs from that at rest, or its scale is wrong."
        check.action = "Calibrate the gyro, keep it still as it starts, and reduce vibration."
    else:
        check.cause = "The accelerometer's offset or the gyro's bias changed in flight."
        check.action = "Check that the autopilot is fixed, and calibrate gyro and accelerometer."
    return check


def _sampling_walk_deg(imu: Imu, t0: float, t1: float) -> float:
    """Return the angle in deg, 1 sigma, that the samples of the gyro miss between two times.

    Rates that change by d from sample to sample by noise have the variance d^2 / 2; integrated, they walk at random.
    """
    part = between(imu.gyro.t, t0, t1)
    changes, dt = np.diff(imu.gyro.x[part], axis=0), np.diff(imu.gyro.t[part])
    return math.degrees(math.sqrt(0.5 * float(np.nansum((changes * dt[:, None]) ** 2))))


def _mean_at_rest(imu: Imu, span: Span) -> tuple[Array, Array, float] | None:
    """Return mean force, mean rate and mean time of a unit in a span, None for too few samples."""
    part = between(imu.gyro.t, *span)
    good = rotation.finite_rows(imu.acc.x[part]) & rotation.finite_rows(imu.gyro.x[part])
    if np.count_nonzero(good) < MIN_FIXES:
        return None
    force, rate, t = imu.acc.x[part][good], imu.gyro.x[part][good], imu.gyro.t[part][good]
    return force.mean(axis=0), rate.mean(axis=0), float(t.mean())


def _degrees(a: Array, b: Array) -> float:
    return float(degrees_between(a[None], b[None])[0])


# --- events ------------------------------------------------------------------------------------------------------


def _step_words(check: Check) -> str:
    return f"Gyro bias stepped by {abs(check.value or 0.0):.1f}°/s at {check.t:.0f} s."


def _height_words(check: Check) -> str:
    return check.text.replace(" in flight,", "")


def _gravity_words(check: Check) -> str:
    what = check.about or "accelerometer or gyro"
    return f"{what.capitalize()} changed in flight: gravity at rest is {check.value:.1f}° off."


def _jump_words(check: Check) -> str:
    return check.text.replace(" in flight,", ",")


# Words of the event of a sensor that failed in flight, by the question of its check.
EVENT_WORDS: Mapping[str, Callable[[Check], str]] = {
    "frozen_gyro": lambda check: f"Gyro froze at {check.t:.0f} s.",
    "gyro_bias_step": _step_words,
    "gnss_height": _height_words,
    "gnss_jumps": _jump_words,
    "gravity_kept": _gravity_words,
}


def with_sensor_events(events: Sequence[Event], checks: Iterable[Check], segments: Segments) -> list[Event]:
    """Return events in time order, with those of sensors in use that failed in flight by their checks."""
    flights = segments.spans("airborne")
    found = list(events)
    for check in checks:
        if check.question not in EVENT_WORDS or not (check.is_trouble and check.in_use) or check.t is None:
            continue
        if check.question == "gnss_jumps" and any(e.kind == "gnss_jump" and e.severity == "warning" for e in events):
            continue
        if any(a <= (check.t_end or check.t) and check.t <= b for a, b in flights):
            t = check.t_end if check.question == "gravity_kept" and check.t_end is not None else check.t
            text = EVENT_WORDS[check.question](check)
            found.append(Event("sensor_fault", t, "warning", text, None, check.value, check.unit, [check.text]))
    return sorted(found, key=lambda event: event.t)
