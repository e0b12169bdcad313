"""Alignment of attitudes for a comparison: clock, trim, declination, floor, delay."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, rotation, timestamps
from attlog.core.errors import UsageError
from attlog.core.kinematics import body_rates
from attlog.core.sorting import median
from attlog.flight.model import Angles, Attitude, FlightLog, Imu, TruthFit
from attlog.reference.model import AlignmentStep, HeadingOrigin, Reference, ReferenceSigma
from attlog.segments import increments, model
from attlog.segments.model import interpolate_attitudes

Array = NDArray[np.float64]
Clock = Literal["sample", "publication"]


def attitude_times(attitude: Attitude, clock: Clock) -> Array:
    """Return the times (n,) of an attitude on a clock.

    Times of measurement for ``sample`` where logged, else of publication.
    """
    return attitude.t if clock == "publication" or attitude.t_sample is None else attitude.t_sample


def usable_samples(attitude: Attitude, clock: Clock) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return times (m,), unit quaternions (m, 4) and their mask (n,).

    Samples without a finite attitude or a rising time are left out.
    """
    t = attitude_times(attitude, clock)
    norm = rotation.length(attitude.q)
    good = np.isfinite(t) & np.isfinite(norm) & (norm > 0.5) & (norm < 2.0)
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= highest[1:] > highest[:-1]
    t, q = model.select_good(good, t, attitude.q)
    return t, q if attitude.normal else rotation.normalize(q), good


def clock_step(log: FlightLog, attitude: Attitude, clock: Clock, own: bool = False) -> AlignmentStep:
    """Return the alignment step for the clock and publication delay.

    ``own``: the attitude was computed from the IMU samples.
    """
    if own:
        text = "made at the IMU's stamps, without the delay of its filter"
        return AlignmentStep("clock", text, "sample", source=attitude.source, option="config: clock")
    if attitude.t_sample is None:
        text = f"{attitude.source} has one time stamp; it is taken for the time of the attitude"
        return AlignmentStep("clock", text, "stamp", source=attitude.source, option="config: clock")
    delays = attitude.t - attitude_times(attitude, "sample")
    delay = float(median(delays[~np.isnan(delays)])) * 1e3 if len(delays) else 0.0
    used = "the time of measurement" if clock == "sample" else "the time of publication"
    text = f"{attitude.source} is compared at {used}; it was published {delay:.1f} ms after the measurement (median)"
    return AlignmentStep("clock", text, delay, "ms", attitude.source, clock == "sample", "config: clock")


# Trim: the small rotation between IMU and vehicle, already removed from the autopilot's attitudes.


def apply_trim(q: Array, trim: Array) -> Array:
    """Return vehicle attitudes (n, 4) from IMU attitudes: ``q_imu (x) exp(-trim)``."""
    return rotation.multiply(q, rotation.from_rotvec(-trim))


def untrim(q: Array, trim: Array | None) -> Array:
    """Return IMU attitudes (n, 4) from vehicle attitudes."""
    return q if trim is None else apply_trim(q, -trim)


def trim_step(log: FlightLog, attitude: Attitude, wanted: bool) -> tuple[Array | None, AlignmentStep]:
    """Return the trim (rotation vector, rad, or None) and its alignment step."""
    if not attitude.has_trim:
        text = f"{attitude.source} is the attitude of the IMU itself: nothing to take out"
        return None, AlignmentStep("trim", text, 0.0, "deg", attitude.source, False, "config: trim")
    trim = log.parameters.trim
    if trim is None:
        missing = log.parameters.trim_source.replace(", ", " and ") or "it"
        text = f"{attitude.source} has a trim taken out, but the log does not hold {missing}"
        return None, AlignmentStep("trim", text, None, "deg", "", False, "config: trim")
    size = math.degrees(float(np.sqrt(np.sum(trim**2))))
    text = f"roll {math.degrees(trim[0]):.2f}, pitch {math.degrees(trim[1]):.2f} deg are inside {attitude.source}"
    applied = wanted and size > 0
    text += ": taken out of the replays once" if applied else ": nothing to do" if size == 0 else ": switched off"
    step = AlignmentStep("trim", text, size, "deg", log.parameters.trim_source, applied, "config: trim")
    return (trim if applied else None), step


# Declination: direction of magnetic north at the place and date of the flight.


def flight_place(log: FlightLog) -> tuple[float, float, float] | None:
    """Return latitude, longitude (deg), altitude (m): medians of the first receiver."""
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.lat) & np.isfinite(gnss.lon)
        good &= (np.abs(gnss.lat) <= 90) & (np.abs(gnss.lon) <= 180) & ((gnss.lat != 0) | (gnss.lon != 0))
        if np.count_nonzero(good):
            altitude = gnss.alt[good]
            altitude = altitude[np.isfinite(altitude)]
            height = float(median(altitude)) if len(altitude) else 0.0
            return float(median(gnss.lat[good])), earth.middle_longitude(gnss.lon[good]), height
    return None


def earth_field(log: FlightLog) -> earth.MagneticField | None:
    """Return the earth's field at place and date; None without a place."""
    where = flight_place(log)
    if where is None:
        return None
    dated = earth.field(*where, log.utc_offset) if log.utc_offset is not None else None
    return dated or earth.field(*where, None)


def declination_step(log: FlightLog, option: str | float) -> tuple[float | None, AlignmentStep]:
    """Return the declination in deg, None if unknown, and its step."""
    if option not in ("auto", "model", "param"):
        try:
            given = float(option)
        except ValueError:
            raise UsageError(f"declination {option!r}: use auto, model, param or degrees") from None
        return given, AlignmentStep(
            "declination", "given by the user", given, "deg", "option", option="config: declination"
        )
    field, set_deg = earth_field(log), log.parameters.declination
    by_model = "no position, so no model" if field is None else f"{field.declination_deg:.1f} deg by {field.model}"
    by_param = (
        "no declination parameter that is set"
        if set_deg is None
        else f"{set_deg:.1f} deg by {log.parameters.declination_source}"
    )
    text = f"{by_model}; {by_param}"
    value, source = None, ""
    if field is not None and option != "param":
        value, source = field.declination_deg, field.model
    elif set_deg is not None and option != "model":
        value, source = set_deg, log.parameters.declination_source
    if value is not None:
        return value, AlignmentStep("declination", text, value, "deg", source, option="config: declination")
    text += "; unknown, so headings are magnetic and compared with their offset removed"
    return None, AlignmentStep("declination", text, None, "deg", "", False, "config: declination")


def observed_declination_deg(log: FlightLog, reference: Reference) -> float | None:
    """Return the declination in deg by magnetometer and reference attitude.

    Circular median between scoring start and end. With truth: declination plus magnetometer errors. None without
    magnetometer or reference.
    """
    if log.mag is None or len(reference.t) == 0:
        return None
    field = log.mags[log.mag].field
    q, _ = interpolate_attitudes(reference.t, reference.q, reference.segment, field.t_best)
    good = rotation.finite_rows(q) & rotation.finite_rows(field.x)
    good &= (field.t_best >= reference.scoring.start) & (field.t_best <= reference.scoring.end)
    if np.count_nonzero(good) < 10:
        return None
    north = rotation.rotate(q[good], field.x[good])
    direction = np.arctan2(north[:, 1], north[:, 0])
    middle = math.atan2(float(np.mean(np.sin(direction))), float(np.mean(np.cos(direction))))
    return math.degrees(float(rotation.wrap(middle + median(rotation.wrap(direction - middle)))))


# The replay floor: the smallest difference between attitudes that a log can resolve.

# Angle that float32 quaternions resolve from their vector part.
FLOAT32_DEG = 1e-5

REPEATED_SHARE, MULTIPLE_SHARE = 0.01, 0.9  # of differences equal to the step, and to its multiples
TICK_S = 1e-3  # logs that count in ms
FLOOR_SAMPLES = 20_000  # enough to detect a step


def logged_step_deg(q: Array) -> float:
    """Return the quantisation step in deg of logged attitudes (n, 4).

    Quantised roll and pitch differ by multiples of the step. Without quantisation: the resolution of float32.
    """
    angles = np.degrees(rotation.to_euler(q[:FLOOR_SAMPLES])[:, :2])
    d = np.abs(np.diff(angles, axis=0)).ravel()
    d = d[np.isfinite(d) & (d > FLOAT32_DEG)]
    if len(d) < 20:
        return FLOAT32_DEG
    values, count = np.unique(np.round(d, 4), return_counts=True)
    repeated = values[(count >= max(5, REPEATED_SHARE * len(d))) & (values > 1e-3)]
    if len(repeated) == 0:
        return FLOAT32_DEG
    step = float(repeated[0])
    small = d[d < 50 * step]
    off = np.abs(small / step - np.round(small / step))
    return step if len(small) and np.mean(off < 0.05) >= MULTIPLE_SHARE else FLOAT32_DEG


def timestamp_tick_s(t: Array) -> float:
    """Return the resolution in s of time stamps (n,).

    1 ms where all intervals are whole ms and differ, else 0.
    """
    dt = np.diff(t[:FLOOR_SAMPLES])
    dt = dt[(dt > 0) & (dt < 1.0)]
    if len(dt) < 10:
        return 0.0
    ticks = dt / TICK_S
    usual = np.abs(ticks - median(ticks)) < 1.5
    whole = bool(np.all(np.abs(ticks - np.round(ticks)) < 1e-2))
    return TICK_S if whole and usual.any() and np.ptp(np.round(ticks[usual])) > 0 else 0.0


def bridged_gap_deg(imu: Imu | None) -> float:
    """Return the attitude error in deg due to bridged gyro gaps.

    Filters integrate a gap with the mean rate of its neighbours. The error is a quarter of the gap times the change of
    rate, root sum of squares over all gaps.
    """
    if imu is None or len(imu.gyro.t) < 3:
        return 0.0
    t, rate = model.select_rising(imu.gyro.t_best, imu.gyro.x)
    dt = np.diff(t)
    bridged = (dt > timestamps.gap_limit_of_times(t)) & (dt <= timestamps.MAX_BRIDGED_GAP_S)
    change = rotation.length(rate[1:][bridged] - rate[:-1][bridged])
    return float(np.degrees(np.sqrt(np.sum((0.25 * dt[bridged] * change) ** 2))))


def floor_step(t: Array, q: Array, known_step: float, imu: Imu | None) -> tuple[float, float, AlignmentStep]:
    """Return replay floor and logged step (deg) with the alignment step."""
    own = known_step if known_step > 0 else logged_step_deg(q)
    tick = timestamp_tick_s(t)
    rate = 0.0
    if imu is not None and len(imu.gyro.x):
        (x,) = model.select_good(rotation.finite_rows(imu.gyro.x), imu.gyro.x)
        centred = x - median(x, axis=0) if len(x) else x
        rate = float(np.degrees(np.sqrt(np.mean(np.einsum("ij,ij->i", centred, centred))))) if len(x) else 0.0
    timing = tick / np.sqrt(12) * rate
    missing = bridged_gap_deg(imu)
    floor = float(np.sqrt(own**2 + timing**2 + missing**2))
    text = f"logged step {own:.2g} deg, time stamps {timing:.2g} deg, bridged gaps {missing:.2g} deg"
    return floor, own, AlignmentStep("replay_floor", text, floor, "deg", "measured in this log")


# Input delay: how late the logged gyro is, by the firmware's filter and by measurement.

# Slower rotation is mostly noise and shows no delay.
MIN_ACTIVE_DPS = 12.0
# Searched range of delays, either way, and its grid: a low-pass at 20 Hz delays by 11 ms.
DELAY_RANGE_S, DELAY_GRID_S = 0.06, 5e-3
# Largest number of examined and of fitted intervals, to bound the time on long logs.
MAX_INTERVALS, MAX_FITTED_INTERVALS = 100_000, 1200
INTERVAL_SAMPLES, MAX_INTERVAL_S = 8, 0.2  # noise biases the delay in shorter ones
MIN_INTERVALS = 100  # fewer give no delay
MIN_DELAY_RATE_HZ = 5.0  # slower references smear turns
# Agreement of filter formula and fit; largest standard error of a fit that is used.
DELAY_TOLERANCE_S, MAX_DELAY_SIGMA_S = 2e-3, 1e-3
# A larger difference is a reset of the reference, not a delay.
OUTLIER_RAD_S = np.radians(60.0)


def filter_delay(imu: Imu) -> tuple[float, str]:
    """Return the gyro's low-pass delay in s (0 if unknown) and source."""
    if imu.gyro.delay > 0:
        return imu.gyro.delay, f"{imu.gyro.source}, {imu.filtered}"
    return 0.0, f"{imu.gyro.source}: no filter known"


def fit_gyro_delay(imu: Imu, reference: Reference) -> tuple[float, float] | None:
    """Return the gyro's delay against the reference and its standard error, s.

    None with little motion. Least squares over tau between the reference's rotation over an interval and the gyro's
    over the interval shifted by tau, offset per axis removed, at rates above 12 deg/s: a grid of 5 ms, then a parabola.
    Intervals have at least 8 IMU samples: gyro noise is lower at half a sample's shift, which biases tau in shorter
    ones.
    """
    turning = increments.gyro_increments(imu)
    t, gyro_t = reference.t, turning.t
    if reference.rate < MIN_DELAY_RATE_HZ or len(t) < MIN_INTERVALS or len(gyro_t) < MIN_INTERVALS:
        return None
    wanted = min(INTERVAL_SAMPLES * (gyro_t[-1] - gyro_t[0]) / (len(gyro_t) - 1), MAX_INTERVAL_S)
    k = max(1, math.ceil(wanted * reference.rate))
    rates = body_rates(t, reference.q, reference.segment, k, max(1, (len(t) - k) // MAX_INTERVALS))
    active = np.degrees(rotation.length(rates.rate)) > MIN_ACTIVE_DPS
    active &= (rates.start >= reference.scoring.start) & (rates.start > gyro_t[0] + DELAY_RANGE_S)
    i = np.flatnonzero(active & (rates.end < gyro_t[-1] - DELAY_RANGE_S))
    if len(i) < MIN_INTERVALS:
        return None
    i = i[:: max(1, len(i) // MAX_FITTED_INTERVALS)]
    start, end, own = rates.start[i], rates.end[i], rates.rate[i]

    def misfits(delays: Array) -> list[float]:
        shifted = ((t + delays[:, None]).ravel() for t in (start, end))
        turned = turning.between(*shifted).reshape(len(delays), len(own), 3)
        return [misfit(rates - own) for rates in turned / (end - start)[:, None]]

    def misfit(off: Array) -> float:
        usual = np.sum((off - median(off, axis=0)) ** 2, axis=1) < OUTLIER_RAD_S**2
        if not usual.any():  # no agreement with the gyro at this shift
            return math.inf
        off = off[usual] - np.mean(off[usual], axis=0)
        return float(np.mean(np.sum(off * off, axis=1)))

    coarse = np.arange(-DELAY_RANGE_S, DELAY_RANGE_S + 1e-9, DELAY_GRID_S)
    best = int(np.argmin(misfits(coarse)))
    if not 0 < best < len(coarse) - 1:
        return None
    fine = np.linspace(-DELAY_GRID_S, DELAY_GRID_S, 5)
    around = misfits(coarse[best] + fine)
    if not np.isfinite(around).all():
        return None
    a, b, c = np.polyfit(fine, around, 2)
    variance = max(c - b * b / (4 * a), 0.0) / (a * len(i) / k) if a > 0 else math.inf
    return None if variance > MAX_DELAY_SIGMA_S**2 else (float(coarse[best] - b / (2 * a)), math.sqrt(variance))


def gyro_delay(imu: Imu, reference: Reference) -> tuple[float, float] | None:
    """Return :func:`fit_gyro_delay`, cached for a unit and a reference."""
    for known, delay in reference.delays:
        if known is imu:
            return delay
    found = fit_gyro_delay(imu, reference)
    reference.delays.append((imu, found))
    return found


def delay_step(
    log: FlightLog, imu: Imu | None, reference: Reference, option: str | float
) -> tuple[float, AlignmentStep]:
    """Return the input delay in s (subtracted from lags) with its step."""
    name, switch = "input_delay", "config: input_delay"
    if option == "off":
        text = "switched off: lags contain the sensor's filters"
        return 0.0, AlignmentStep(name, text, 0.0, "ms", "option", False, switch)
    if option != "auto":
        try:
            option_ms = float(option)
        except ValueError:
            raise UsageError(f"input_delay {option!r}: use auto, off or milliseconds") from None
        return 1e-3 * option_ms, AlignmentStep(name, "given by the user", option_ms, "ms", "option", option=switch)
    if imu is None:
        return 0.0, AlignmentStep(name, "no IMU is replayed", 0.0, "ms", "", False, switch)
    known, source = filter_delay(imu)
    found = None if reference.kind == "smoother" else gyro_delay(imu, reference)
    seen = None if found is None else found[0]
    if reference.kind == "smoother":
        check = "the smoother is without it; made of this gyro, it cannot check it"
    elif seen is None:
        check = "the log turns too little to check it"
    else:
        verdict = "" if abs(seen - known) <= DELAY_TOLERANCE_S else ", which disagrees: look at clock in --config"
        check = f"the rates show {1e3 * seen:.1f} ms against {reference.source}{verdict}"
    text = f"{1e3 * known:.1f} ms by {source}; {check}"
    return known, AlignmentStep(name, text, 1e3 * known, "ms", source, known > 0, switch)


# An external truth: its alignment, noise and north.

NO_NORTH_TEXT = "the north of {name} is unknown: each row is turned to it by its own mean heading"
TRUTH_OPTION = "--truth"


def adopt_fit(reference: Reference, fit: TruthFit) -> None:
    """Set the reference's sigma and north from an external truth's fit."""
    n = len(reference.t)
    reference.fit = fit
    reference.sigma = ReferenceSigma(np.full(n, fit.sigma_tilt_deg), np.full(n, fit.sigma_heading_deg))
    if fit.north == "none":
        reference.heading = HeadingOrigin("relative", NO_NORTH_TEXT.format(name=fit.name))


def fit_steps(fit: TruthFit) -> list[AlignmentStep]:
    """Return the alignment steps of an external truth: clock, axes, noise."""
    clock = f"added to its times, sigma {1e3 * fit.offset_sigma_s:.2g} ms; "
    clock += f"rates correlate by {fit.correlation:.3f} over {fit.seconds:.0f} s, {fit.n} samples"
    drift = f"sigma {fit.drift_sigma_ppm:.1f} ppm"
    if fit.drift_ppm == 0.0:
        drift += ": no different from none"
    north = {
        "file": "its own north is kept",
        "gnss": "its north is from GNSS motion",
        "none": "its north is unknown: only changes of heading are compared",
    }[fit.north]
    noise = f"tilt {fit.sigma_tilt_deg:.2f}, heading {fit.sigma_heading_deg:.2f} deg (one sigma); part of each interval"
    return [
        _fit_step("truth_clock", clock, fit.offset_s, "s"),
        _fit_step("truth_drift", drift, fit.drift_ppm, "ppm", fit.drift_ppm != 0.0),
        _fit_step(
            "truth_body",
            f"{_angles_text(fit.body_deg)} to forward, right, down; read {fit.reading}",
            _turn_deg(fit.body_deg),
        ),
        _fit_step(
            "truth_world", f"{_angles_text(fit.world_deg)} to north, east, down; {north}", _turn_deg(fit.world_deg)
        ),
        _fit_step("truth_residual", "RMS of its angular rates less the gyro's", fit.residual_dps, "deg/s"),
        _fit_step("own_sigma", noise, fit.sigma_tilt_deg),
    ]


def _fit_step(name: str, text: str, value: float, unit: str = "deg", applied: bool = True) -> AlignmentStep:
    return AlignmentStep(name, text, value, unit, "the truth", applied, TRUTH_OPTION)


def _angles_text(angles: Angles) -> str:
    return "roll {:.1f}, pitch {:.1f}, yaw {:.1f} deg".format(*angles)


def _turn_deg(angles: Angles) -> float:
    """Return the angle in deg of a turn by roll, pitch and yaw."""
    return float(np.degrees(rotation.total_angle(rotation.from_euler(*np.radians(angles)))))
