"""Traces for figures of sensors and onboard estimator, up to the first crash.

``compass``: the field (uT, body axes) of a compass (``key``), the one in use first: x y z measured, expected_x ... the
earth's field turned by an attitude, corrected_x ... less the offset that is offered; value ``by_motion`` 1 where that
attitude has its heading by motion alone.
``interference``: ``residual`` (uT), size of the field less the earth's, against the drive ``t`` (A with ``key``
current, % with ``key`` throttle); values ``slope`` (uT per unit of the drive), ``start`` (uT), ``r``, ``seconds``.
``levels``: vibration in flight (m/s^2) second by second by the firmware's measure, ``key`` its record; values
``p50 p80 worst``, and ``limit`` and ``fault`` of the firmware where it has one.
``clipping``: clipped samples of the accelerometer second by second, of the counter (``key``) with most; value
``samples`` in all.
``rotor``: rotors' fundamental and harmonics (Hz, ``t``), ``low`` and ``high`` their range in flight.
``notches``: middle of the gyro's notch filters (Hz, ``t``), ``low`` and ``high`` their edges, ``key`` set or proposed.
``ratios``: test ratio of an aid (``key``) of the onboard estimator, above 1 rejected.
``track``: path over ground by GNSS (``key`` the receiver): see :func:`track_path`; it does not end at a crash.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import quantile
from attlog.core.spans import Span, inside
from attlog.flight.compass import motor_drive, power_at
from attlog.flight.model import (
    FIX_3D,
    VIBRATION_LIMITS,
    Array,
    Attitude,
    Gnss,
    Mag,
    covered_seconds,
    guarded_part,
    without_pauses,
)
from attlog.flight.vehicle import VehicleKind
from attlog.health import notch, vibration
from attlog.health.check import Check, HealthCase
from attlog.health.compass_offset import MAX_SIGMA_HEADING_RAD, compass_studies, reason_no_heading
from attlog.health.compass_power import MIN_RANGES
from attlog.health.flown import first_crash, flight_before_crash
from attlog.metrics.trace import Trace
from attlog.reference import alignment
from attlog.segments.model import select_rising
from attlog.story.flight_events import clipping_spans

# Maximum points of a trace, about the width of a figure in pixels.
MAX_POINTS = 1500
AXES = ("x", "y", "z")


def traces(case: HealthCase, found: list[Check]) -> list[Trace]:
    """Return all traces with data; ``found``: checks of the log, for the proposed offsets."""
    parts: dict[str, Callable[[], list[Trace]]] = {
        "The figure of the field": partial(field_traces, case, found),
        "The figure of the interference": partial(interference_traces, case),
        "The figure of the vibration": lambda: [*level_traces(case), *clipping_traces(case)],
        "The bands of the spectrum": lambda: [*rotor_traces(case), *notch_traces(case)],
        "The figure of the test ratios": partial(ratio_traces, case),
        "The ground track": partial(track_traces, case),
    }
    return [trace for name, make in parts.items() for trace in guarded_part(case.log, name, make, list[Trace])]


def break_at_pauses(t: Array, columns: Array) -> Array:
    """Set columns (n,) or (n, k) to NaN after a pause, to break lines there."""
    out = np.array(columns, np.float64)
    if len(t) > 1:
        out[1:][~without_pauses(t)] = np.nan
    return out


# Compasses.

# Minimum share of the flight with known heading for the attitude from motion.
MIN_SURE_SHARE = 0.5
# Minimum points of the traces.
MIN_FIELD_SAMPLES, MIN_INTERFERENCE_POINTS = 10, 50


def field_traces(case: HealthCase, found: list[Check]) -> list[Trace]:
    """Return traces of every compass and the earth's field; none without position or attitude."""
    model, attitude = alignment.earth_field(case.log), field_attitude(case)
    if model is None or attitude is None:
        return []
    t, q, segment, by = attitude
    offered = {check.sensor for check in found if check.question == "compass_offset" and check.settings}
    studies = {study.samples.source: study for study in compass_studies(case)[0] if study.samples.source in offered}
    drawn = []
    for mag in mags_in_use_first(case):
        at, measured = thinned_field(mag, np.ones(len(mag.field.t_best), bool))
        turned, _ = rotation.slerp_in_segments(t, q, segment, at)
        use = (at < first_crash(case.segments)) & rotation.finite_rows(turned)
        if np.count_nonzero(use) < MIN_FIELD_SAMPLES:
            continue
        parts = {"": measured[use], "expected_": rotation.rotate_inverse(turned[use], 1e6 * np.array(model.ned_t))}
        if mag.field.source in studies:
            parts["corrected_"] = measured[use] - studies[mag.field.source].air.offset
        columns = {
            f"{name}{axis}": column
            for name, part in parts.items()
            for axis, column in zip(AXES, break_at_pauses(at[use], part).T, strict=True)
        }
        values = {"by_motion": float(by == "motion")}
        drawn.append(Trace("compass", "", at[use], columns, mag.field.source, values=values))
    return drawn


def field_attitude(case: HealthCase) -> tuple[Array, Array, np.ndarray | None, str] | None:
    """Return times, quaternions, segments and name of the attitude for the earth's field.

    Motion alone if its heading is known, else the reference, else (without replay) onboard; None without heading.
    """
    known, own, reference = case.motion, case.log.onboard_attitude, case.reference
    if known is not None and not reason_no_heading(case):
        sure = known.sigma_heading <= MAX_SIGMA_HEADING_RAD
        if sure[inside(known.t, flight_before_crash(case.segments))].mean() >= MIN_SURE_SHARE:
            return known.t, np.where(sure[:, None], known.q, np.nan), known.segment, "motion"
    if reference is None and own is not None and len(own.t) > 1:
        return own.t, own.q, None, own.source
    if reference is None or reference.kind == "none" or len(reference.t) < 2:
        return None
    if reference.heading.by in ("none", "relative"):
        return None
    return reference.t, reference.q, reference.gap_segment, reference.source


def interference_traces(case: HealthCase) -> list[Trace]:
    """Return the trace of the field against motor power; none with constant power."""
    model = alignment.earth_field(case.log)
    kind, drive = motor_drive(case.log)
    for mag in mags_in_use_first(case) if model is not None and drive is not None else []:
        assert model is not None
        at, field = thinned_field(mag, inside(mag.field.t_best, flight_before_crash(case.segments)))
        power = power_at(drive, at)
        known = np.isfinite(power)
        if not known.any():
            continue
        power, residual = power[known], np.linalg.norm(field[known], axis=1) - 1e6 * model.strength_t
        if len(power) < MIN_INTERFERENCE_POINTS or np.ptp(quantile(power, [0.05, 0.95])) < MIN_RANGES[kind]:
            return []
        power = (1.0 if kind == "current" else 100.0) * power
        slope, start = np.polyfit(power, residual, 1)
        spread = float(np.std(power) * np.std(residual))
        r = float(np.mean((power - power.mean()) * (residual - residual.mean()))) / spread if spread > 0 else 0.0
        seconds = sum(b - a for a, b in flight_before_crash(case.segments, 0.0))
        values = {"slope": float(slope), "start": float(start), "r": r, "seconds": seconds}
        return [Trace("interference", "", power, {"residual": residual}, kind, values=values)]
    return []


def mags_in_use_first(case: HealthCase) -> list[Mag]:
    """Return the compasses, the one in use first."""
    return sorted(case.log.mags, key=lambda mag: case.log.mag is None or mag is not case.log.mags[case.log.mag])


def thinned_field(mag: Mag, use: np.ndarray) -> tuple[Array, Array]:
    """Return times and field (uT) of at most MAX_POINTS of the selected finite samples."""
    where = np.flatnonzero(use & rotation.finite_rows(mag.field.x))
    where = where[:: max(1, -(-len(where) // MAX_POINTS))]
    return mag.field.t_best[where], 1e6 * mag.field.x[where]


# Vibration.

# Minimum seconds of flight, or rotor records, for a trace.
MIN_LEVELS = 10
# Bin of clipped samples.
CLIPPING_BIN_S = 1.0
# Number of harmonics of the rotor speed.
HARMONICS = 3
# Minimum speed of a rotor in flight.
TURNING_RPM = 300.0


def level_traces(case: HealthCase) -> list[Trace]:
    """Return the firmware's vibration level of each IMU in flight, thinned by maxima."""
    within, found = vibration.sound_flight(case.segments, case.log), []
    for one in vibration.imu_vibrations(case.log):
        t, level = vibration.levels_in_flight(one, within)
        groups = np.arange(0, len(t), max(1, -(-len(t) // MAX_POINTS)))
        limits = VIBRATION_LIMITS[one.measure]
        if len(groups) < MIN_LEVELS:
            continue
        t, level = t[groups], np.maximum.reduceat(level, groups)
        p50, p80 = quantile(level, [0.5, 0.8])
        values = {"p50": float(p50), "p80": float(p80), "worst": float(level.max()), "limit": limits.warning}
        values |= {"fault": limits.fault} if math.isfinite(limits.fault) else {}
        found.append(Trace("levels", "", t, {"level": break_at_pauses(t, level)}, one.source, values=values))
    return found


def clipping_traces(case: HealthCase) -> list[Trace]:
    """Return clipped samples of the IMU with most, in flight or armed."""
    within = clipping_spans(case.segments)
    found: list[Trace] = []
    for one in case.log.vibration.clippings:
        mine = inside(one.t, within) & (one.new > 0)
        if one.sensor == "accelerometer" and mine.any():
            second, place = np.unique(np.floor(one.t[mine] / CLIPPING_BIN_S), return_inverse=True)
            samples = np.bincount(place, one.new[mine].astype(np.float64)).astype(np.float64)
            kept = np.sort(np.argsort(-samples, kind="stable")[:MAX_POINTS])
            at, total = CLIPPING_BIN_S * (second + 0.5), {"samples": float(samples.sum())}
            found.append(Trace("clipping", "", at[kept], {"samples": samples[kept]}, one.source, values=total))
    return sorted(found, key=lambda trace: -trace.values["samples"])[:1]


def rotor_traces(case: HealthCase) -> list[Trace]:
    """Return rotor fundamental and harmonics in flight, if rotor speed is logged."""
    rpm = case.log.power.rpm
    if rpm is None or len(rpm.t) < MIN_LEVELS:
        return []
    x = rpm.x[inside(rpm.t, flight_before_crash(case.segments, 0.0))]
    turning = x[np.isfinite(x) & (x > TURNING_RPM)]
    if len(turning) < MIN_LEVELS:
        return []
    low, middle, high = quantile(turning, [0.1, 0.5, 0.9]) / 60.0
    order = np.arange(1, HARMONICS + 1)
    return [Trace("rotor", "", middle * order, {"low": low * order, "high": high * order})]


def notch_traces(case: HealthCase) -> list[Trace]:
    """Return the active and the proposed gyro notches of fixed frequency."""
    found = []
    for key, bands in notch.notch_bands(case).items():
        if bands:
            f, width = np.array(sorted(bands)).T
            found.append(Trace("notches", "", f, {"low": f - 0.5 * width, "high": f + 0.5 * width}, key))
    return found


# Test ratios.

# Fewer ratios make no line.
MIN_RATIOS = 10


def ratio_traces(case: HealthCase) -> list[Trace]:
    """Return test ratios of each aid in use, thinned by maxima."""
    end = first_crash(case.segments)
    found = []
    for test in case.log.estimator.innovation_tests:
        good = np.isfinite(test.ratio) & np.isfinite(test.t)
        t, ratio = thin_by_maxima(test.t[good], test.ratio[good])
        own = t <= end
        if own.sum() >= MIN_RATIOS and ratio[own].any():
            found.append(Trace("ratios", "", t[own], {"ratio": ratio[own]}, test.aid))
    return found


def thin_by_maxima(t: Array, x: Array) -> tuple[Array, Array]:
    """Return at most MAX_POINTS samples (n,), the maximum of each group at its time."""
    if len(t) <= MAX_POINTS:
        return t, x
    starts = np.linspace(0, len(t), MAX_POINTS + 1).astype(np.int64)[:-1]
    part = np.searchsorted(starts, np.arange(len(t)), side="right") - 1
    largest = np.flatnonzero(x == np.maximum.reduceat(x, starts)[part])
    at = largest[np.unique(part[largest], return_index=True)[1]]
    return t[at], x[at]


# The path over ground.

# Points of the path.
MAX_TRACK_POINTS, MIN_TRACK_POINTS = 2000, 10
# Metres per degree of latitude on a sphere of mean earth radius.
M_PER_DEG = 6371008.8 * math.pi / 180.0
# Minimum extent of a path: MIN_COURSE_M with a course for MIN_COURSE_S, else MIN_PATH_M; drift at rest is less.
MIN_COURSE_M, MIN_PATH_M, MIN_COURSE_S = 5.0, 15.0, 3.0
# Minimum speed for a course.
SLOW_M_S = 1.0
# Minimum speed for comparison of heading and course, and that of planes.
FAST_M_S, WINGED_M_S = 2.0, 5.0
# Maximum time to the nearest attitude for a heading.
MAX_ATTITUDE_DISTANCE_S = 1.0


def track_traces(case: HealthCase) -> list[Trace]:
    """Return the path of the receiver with most fixes; none for a vehicle at rest."""
    log = case.log
    receiver = max(log.gnss, key=lambda g: int(np.count_nonzero(_has_position(g))), default=None)
    if receiver is None or np.count_nonzero(_has_position(receiver)) < MIN_TRACK_POINTS:
        return []
    spans = case.segments.spans("airborne" if log.kind.flies else "armed")
    forward = log.kind.fixed_wing or log.kind in (VehicleKind.ROVER, VehicleKind.BOAT)
    least = WINGED_M_S if log.kind.fixed_wing else FAST_M_S
    found = track_path(receiver, log.onboard_attitude, spans, least, first_crash(case.segments))
    driven = found.columns["driven"] > 0 if spans else np.ones(len(found.t), bool)
    moving = driven & np.isfinite(found.columns["course"])
    enough = MIN_COURSE_M if covered_seconds(found.t[moving]) >= MIN_COURSE_S else MIN_PATH_M
    if driven.sum() < MIN_TRACK_POINTS or _extent_m(found, driven) < enough:
        return []
    found.values["forward"] = float(forward)
    return [found]


def track_path(receiver: Gnss, attitude: Attitude | None, spans: list[Span], least: float, end: float) -> Trace:
    """Return the path of a receiver, with the heading of the onboard attitude beside the course.

    Columns: ``north east`` (m), ``heading course`` (deg, NaN below SLOW_M_S), ``speed`` (m/s), ``driven`` 1 within
    ``spans``. Values: ``lat lon`` (deg) of zero; ``forward`` 1 where heading and course agree by design; ``least``
    speed and ``difference low high``: median and quartiles of heading minus course (deg) while driven before ``end`` s
    at that speed, over ``seconds``.
    """
    use = _has_position(receiver)
    t, x = select_rising(
        np.where(use, receiver.t, np.nan), np.column_stack([receiver.lat, receiver.lon]).astype(np.float64)
    )
    velocity = receiver.vel_ned[np.searchsorted(receiver.t, t).clip(max=len(receiver.t) - 1), :2]
    driven = inside(t, spans)
    lat, lon = (float(v) for v in x[int(np.argmax(driven))])  # where it started
    north = (x[:, 0] - lat) * M_PER_DEG
    east = ((x[:, 1] - lon + 180.0) % 360.0 - 180.0) * M_PER_DEG * math.cos(math.radians(lat))
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    slow = ~(speed >= SLOW_M_S)
    course = np.where(slow, np.nan, np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0])))
    heading = np.where(slow, np.nan, heading_at(attitude, t))
    columns = {"north": north, "east": east, "heading": heading, "course": course, "speed": speed, "driven": driven}
    values = {"lat": lat, "lon": lon, "least": least} | off_course(
        t, heading - course, driven & (t <= end) & (speed >= least)
    )
    kept = slice(None, None, -(-len(t) // MAX_TRACK_POINTS))
    pause = np.append(False, ~without_pauses(t[kept]))
    columns = {name: np.where(pause, np.nan, y[kept]) for name, y in columns.items()}
    return Trace("track", "", t[kept], columns, receiver.source, values=values)


def heading_at(attitude: Attitude | None, t: Array) -> Array:
    """Return the heading (n,) deg of an attitude at ``t`` (n,) s; NaN where no sample is near."""
    if attitude is None or len(attitude.t) < 2:
        return np.full(len(t), np.nan)
    at, q = select_rising(attitude.t, attitude.q)
    if len(at) < 2:
        return np.full(len(t), np.nan)
    after = np.searchsorted(at, t).clip(1, len(at) - 1)
    near = np.minimum(np.abs(at[after] - t), np.abs(t - at[after - 1])) < MAX_ATTITUDE_DISTANCE_S
    return np.where(near, np.degrees(rotation.to_euler(rotation.slerp(at, q, t))[:, 2]), np.nan)


def off_course(t: Array, difference: Array, use: NDArray[np.bool_]) -> dict[str, float]:
    """Return median and quartiles in deg of angles (n,) about their circular mean."""
    use = use & np.isfinite(difference)
    if np.count_nonzero(use) < MIN_TRACK_POINTS:
        return {}
    angle = np.radians(difference[use])
    mean = math.atan2(float(np.mean(np.sin(angle))), float(np.mean(np.cos(angle))))
    around = np.degrees(rotation.wrap(angle - mean)) + math.degrees(mean)
    low, middle, high = (float(v) for v in quantile(around, [0.25, 0.5, 0.75]))
    turn = 360.0 * round(middle / 360.0)
    return {"difference": middle - turn, "low": low - turn, "high": high - turn, "seconds": covered_seconds(t[use])}


def _has_position(receiver: Gnss) -> NDArray[np.bool_]:
    """Mark records (n,) with a 3D fix and a position other than 0, 0."""
    known = np.isfinite(receiver.lat) & np.isfinite(receiver.lon) & (receiver.fix >= FIX_3D)
    return np.asarray(known & ((receiver.lat != 0.0) | (receiver.lon != 0.0)))


def _extent_m(found: Trace, use: NDArray[np.bool_]) -> float:
    """Return the larger side in m of the box of the middle 98 % of points."""
    places = [found.columns[name][use] for name in ("north", "east")]
    sides = [quantile(x[~np.isnan(x)], [0.01, 0.99]) for x in places]
    return max(float(high - low) for low, high in sides)
