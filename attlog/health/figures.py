"""Which samples of a stream a figure keeps: before the first crash, few enough, gaps as gaps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, inside
from attlog.flight.model import Array, Attitude, Gnss, Mag, covered_seconds, guarded_part, without_pauses
from attlog.flight.vehicle import VehicleKind
from attlog.health import compass, compass_fit, innovations, notch, vibration
from attlog.health.check import Check, HealthCase
from attlog.health.compass_fit import (
    MAX_SIGMA_HEADING_RAD,
    MIN_CURRENT_RANGE_A,
    MIN_THROTTLE_RANGE,
    CompassStudy,
    Power,
    compass_flight_spans,
    compass_studies,
    motor_drive,
    power_at,
)
from attlog.health.flown import crash_spans
from attlog.metrics.trace import Trace
from attlog.reference import alignment
from attlog.segments.model import Segments, select_rising
from attlog.story.flight_events import clipping_spans

MAX_LINE_SAMPLES = 1500
"""Samples of a line: a figure is at most as many pixels wide."""


def figure_end(segments: Segments) -> float:
    """Where figures end, s: at the first crash, else never."""
    wrecks = crash_spans(segments)
    return wrecks[0][0] if wrecks else math.inf


def flight_before_crash(segments: Segments) -> list[Span]:
    """Spans in the air before the first crash, s."""
    end = figure_end(segments)
    spans = segments.spans("airborne")
    return [(a, min(b, end)) for a, b in spans if a < end]


def break_at_pauses(t: Array, columns: Array) -> Array:
    """Columns (n,) or (n, k) with NaN at the first sample after a pause, so that no line crosses it."""
    out = np.array(columns, np.float64)
    if len(t) > 1:
        out[1:][~without_pauses(t)] = np.nan
    return out


# The arrays that figures of the compasses are drawn from.

MIN_SURE_SHARE = 0.5
"""The attitude by motion is drawn with where its heading is sure in this share of the flight."""
MAX_COMPASS_SAMPLES = 1500
"""A figure is not wider than so many dots."""


@dataclass(frozen=True, slots=True)
class FieldHistory:
    """The field of one compass at ``t`` (n,) s in body axes, all (n, 3) uT.

    ``measured`` as logged, ``expected`` the earth's by an attitude (NaN where there is none), ``corrected`` as logged
    less the offset that is offered, None where none is. ``by``: whose attitude.
    """

    source: str
    t: Array
    measured: Array
    expected: Array
    corrected: Array | None
    by: str


@dataclass(frozen=True, slots=True)
class Interference:
    """The motors' power against the field of one compass in flight: ``power`` (n,) in A or 0 to 1 as ``kind`` says,
    ``excess`` (n,) uT how much larger the field is than the earth's.
    """

    source: str
    kind: Power
    power: Array
    excess: Array


def field_against_expected(case: HealthCase) -> list[FieldHistory]:
    """Every compass over the whole log, at most POINTS samples each; nothing without an attitude or a position."""
    model = alignment.earth_field(case.log)
    attitude = _compass_attitude(case)
    if model is None or attitude is None:
        return []
    t, q, segment, by = attitude
    offered = {study.samples.source: study for study in compass_studies(case)[0]}
    found = []
    for mag in case.log.mags:
        at, measured = _thinned_field(mag, np.ones(len(mag.field.t_best), bool))
        turned, _ = rotation.slerp_in_segments(t, q, segment, at)
        expected = np.full(measured.shape, np.nan)
        known = rotation.finite_rows(turned)
        if known.any():
            expected[known] = rotation.rotate_inverse(turned[known], 1e6 * np.array(model.ned_t))
        corrected = _corrected_field(case, offered.get(mag.field.source), measured)
        found.append(FieldHistory(mag.field.source, at, measured, expected, corrected, by))
    return found


def interference_points(case: HealthCase) -> list[Interference]:
    """Power against the field's size for every compass in flight; nothing without position, flight or power."""
    model = alignment.earth_field(case.log)
    kind, drive = motor_drive(case.log)
    if model is None or drive is None:
        return []
    flown, earth = compass_flight_spans(case.segments), 1e6 * model.strength_t
    found = []
    for mag in case.log.mags:
        at, field = _thinned_field(mag, inside(mag.field.t_best, flown))
        power = power_at(drive, at)
        known = np.isfinite(power)
        if known.any():
            excess = np.linalg.norm(field[known], axis=1) - earth
            found.append(Interference(mag.field.source, kind, power[known], excess))
    return found


def _compass_attitude(case: HealthCase) -> tuple[Array, Array, np.ndarray | None, str] | None:
    """The attitude by motion where its heading judges compasses, else the reference of the analysis, else (of a log
    that is not replayed) the onboard one: times, quaternions, segments and a name. None where nobody knows heading."""
    known, own = case.motion, case.log.onboard_attitude
    if known is not None and not compass_fit.reason_no_heading(case):
        sure = known.sigma_heading <= MAX_SIGMA_HEADING_RAD
        if sure[inside(known.t, compass_flight_spans(case.segments))].mean() >= MIN_SURE_SHARE:
            return known.t, np.where(sure[:, None], known.q, np.nan), known.segment, "motion"
    reference = case.reference
    if reference is None and own is not None and len(own.t) > 1:
        return own.t, own.q, None, own.source
    if reference is None or reference.kind == "none" or len(reference.t) < 2:
        return None
    if reference.heading.by in ("nobody", "relative"):
        return None
    return reference.t, reference.q, reference.gap_segment, reference.source


def _corrected_field(case: HealthCase, study: CompassStudy | None, measured: Array) -> Array | None:
    """The field less the offset that may be set; None where none may."""
    if study is None or not study.air.counts or compass.offset_refusal(case, study):
        return None
    return np.asarray(measured - study.air.offset)


def _thinned_field(mag: Mag, use: np.ndarray) -> tuple[Array, Array]:
    """Times and field (uT) of at most POINTS of the samples that may be used and are numbers."""
    where = np.flatnonzero(use & rotation.finite_rows(mag.field.x))
    where = where[:: max(1, -(-len(where) // MAX_COMPASS_SAMPLES))]
    return mag.field.t_best[where], 1e6 * mag.field.x[where]


# Does each compass show the earth's field, before and after, and does it follow the motors? Arrays of the question.

Shown = TypeVar("Shown", FieldHistory, Interference)
AXES = ("x", "y", "z")
MIN_FIELD_SAMPLES, MIN_INTERFERENCE_POINTS = 10, 50
DRIVE_RANGES = {"current": (1.0, MIN_CURRENT_RANGE_A), "throttle": (100.0, MIN_THROTTLE_RANGE)}
"""By drive: from its own unit to A or %, and the range in its own unit that shows anything."""


def field_traces(case: HealthCase, found: list[Check]) -> list[Trace]:
    """The field of every compass over the flight, the one in use first; nothing without a place or an attitude.

    ``found``: what the questions answered; only an offset that they offer is drawn as a correction.
    """
    offered = {a.sensor for a in found if a.question == "compass_offset" and a.settings}
    histories = _in_use_first(case, field_against_expected(case))
    drawn = (_history_trace(one, one.source in offered, figure_end(case.segments)) for one in histories)
    return [trace for trace in drawn if trace is not None]


def interference_traces(case: HealthCase) -> list[Trace]:
    """Points and line of the compass in use; nothing where the drive does not vary in flight."""
    for one in _in_use_first(case, interference_points(case))[:1]:
        scale, least = DRIVE_RANGES[one.kind]
        if len(one.power) >= MIN_INTERFERENCE_POINTS and np.ptp(np.quantile(one.power, [0.05, 0.95])) >= least:
            seconds = sum(b - a for a, b in flight_before_crash(case.segments))
            return [interference_trace(one.kind, scale * one.power, one.excess, seconds)]
    return []


def interference_trace(key: str, power: np.ndarray, residual: np.ndarray, seconds: float) -> Trace:
    """The trace of residuals (n,) uT against a drive (n,) in A or %, with the line of least squares."""
    slope, start = np.polyfit(power, residual, 1)
    spread = float(np.std(power) * np.std(residual))
    r = float(np.mean((power - power.mean()) * (residual - residual.mean()))) / spread if spread > 0 else 0.0
    values = {"slope": float(slope), "start": float(start), "r": r, "seconds": seconds}
    return Trace("interference", "", power, {"residual": residual}, key, values=values)


def _in_use_first(case: HealthCase, each: list[Shown]) -> list[Shown]:
    log = case.log
    used = "" if log.mag is None else log.mags[log.mag].field.source
    return sorted(each, key=lambda one: one.source != used)


def _history_trace(one: FieldHistory, offered: bool, end: float) -> Trace | None:
    """The trace of one compass up to ``end`` s; None where hardly any sample has an attitude."""
    use = (one.t < end) & rotation.finite_rows(one.expected)
    if np.count_nonzero(use) < MIN_FIELD_SAMPLES:
        return None
    t = one.t[use]
    parts = {"": one.measured, "expected_": one.expected}
    if one.corrected is not None and offered:
        parts["corrected_"] = one.corrected
    columns = {
        f"{name}{axis}": column
        for name, part in parts.items()
        for axis, column in zip(AXES, break_at_pauses(t, part[use]).T, strict=True)
    }
    return Trace("compass", "", t, columns, one.source, values={"by_motion": float(one.by == "motion")})


# How strongly does it vibrate in flight, what was clipped, how fast are rotors, and where are notches?

MIN_LEVELS = 10
CLIPPING_BIN_S = 1.0
HARMONICS = 3
"""Of the rotors' speed: one blade out of balance, two blades, their next."""
TURNING_RPM = 300.0
"""Slower is starting or stopping."""


def level_traces(case: HealthCase) -> list[Trace]:
    """The level of each IMU in flight by the firmware's own measure, second by second, with its percentiles."""
    found = []
    for one in vibration.level_figures(case):
        t, level, fault = np.asarray(one["t"]), np.asarray(one["level"]), one["fault"]
        limits = (float(str(one["warning"])), math.nan if fault is None else float(str(fault)))
        if len(t) >= MIN_LEVELS:
            found.append(level_trace(str(one["source"]), t, level, *limits))
    return found


def level_trace(source: str, t: Array, level: Array, limit: float, fault: float) -> Trace:
    """The trace of levels (n,) m/s^2 with their percentiles, and the firmware's limits (m/s^2, NaN: none)."""
    p50, p80 = np.quantile(level, [0.5, 0.8])
    values = {"p50": float(p50), "p80": float(p80), "worst": float(level.max()), "limit": limit}
    values |= {"fault": fault} if math.isfinite(fault) else {}
    return Trace("levels", "", t, {"level": break_at_pauses(t, level)}, source, values=values)


def clipping_traces(case: HealthCase) -> list[Trace]:
    """Samples that the vehicle counted as clipped, of the unit that clipped most, while it flew or was driven."""
    within = clipping_spans(case.segments)
    found: list[Trace] = []
    for one in case.log.vibration.clippings:
        mine = inside(one.t, within) & (one.new > 0)
        if one.sensor == "accelerometer" and mine.any():
            second, place = np.unique(np.floor(one.t[mine] / CLIPPING_BIN_S), return_inverse=True)
            samples = np.bincount(place, one.new[mine].astype(np.float64)).astype(np.float64)
            kept = np.sort(np.argsort(-samples, kind="stable")[:MAX_LINE_SAMPLES])
            at, total = CLIPPING_BIN_S * (second + 0.5), {"samples": float(samples.sum())}
            found.append(Trace("clipping", "", at[kept], {"samples": samples[kept]}, one.source, values=total))
    return sorted(found, key=lambda trace: -trace.values["samples"])[:1]


def rotor_traces(case: HealthCase) -> list[Trace]:
    """The rotors' fundamental in flight and its harmonics, where their speed was logged."""
    rpm = case.log.power.rpm
    if rpm is None or len(rpm.t) < MIN_LEVELS:
        return []
    x = rpm.x[inside(rpm.t, flight_before_crash(case.segments))]
    turning = x[np.isfinite(x) & (x > TURNING_RPM)]
    if len(turning) < MIN_LEVELS:
        return []
    low, middle, high = np.quantile(turning, [0.1, 0.5, 0.9]) / 60.0
    order = np.arange(1, HARMONICS + 1)
    return [Trace("rotor", "", middle * order, {"low": low * order, "high": high * order})]


def notch_traces(case: HealthCase) -> list[Trace]:
    """Notches of the gyro that the firmware has on, and those that are proposed, where their frequency is fixed."""
    drawn = next((one["notches"] for one in notch.spectrum_figures(case) if one["sensor"] == "gyro"), [])
    found = []
    for key, proposed in (("set", False), ("proposed", True)):
        own = [n for n in cast("list[dict[str, float]]", drawn) if n["proposed"] == proposed]
        if own:
            f, width = np.array(sorted((n["frequency"], n["width"]) for n in own)).T
            found.append(Trace("notches", "", f, {"low": f - 0.5 * width, "high": f + 0.5 * width}, key))
    return found


# What did the onboard estimator reject, and when? Its own test ratios over time, one line for each aid.

MIN_TRACE_RATIOS = 10


def ratio_traces(case: HealthCase) -> list[Trace]:
    """One trace for each aid that was used, up to the first crash; its largest values stay."""
    end = figure_end(case.segments)
    found = []
    for one in innovations.ratio_series(case):
        own = one.t <= end
        if own.sum() >= MIN_TRACE_RATIOS and one.ratio[own].any():
            found.append(Trace("ratios", "", one.t[own], {"ratio": one.ratio[own]}, one.aid))
    return found


# Where did it go, and did its heading point along the course? The path over ground by GNSS, with both directions.

MAX_TRACK_POINTS = 2000
"""Points of the path."""
MIN_TRACK_POINTS = 10
FIX_3D = 3
M_PER_DEG = 6371008.8 * math.pi / 180.0
"""Of latitude on a sphere of the earth's mean radius; a flight is too short for more."""
MIN_COURSE_M, MIN_PATH_M, MIN_COURSE_S = 5.0, 15.0, 3.0
"""So far goes what shows a course for MOVED_S; without velocities a receiver wanders by less than WANDER_M."""
SLOW_M_S = 1.0
"""Slower than this GNSS tells no course."""
FAST_M_S, WINGED_M_S = 2.0, 5.0
"""From this speed on (a plane: from that) heading and course are compared."""
MAX_ATTITUDE_DISTANCE_S = 1.0


def track_traces(case: HealthCase) -> list[Trace]:
    """The path of the receiver with most fixes; nothing where the vehicle stayed in its place while driven."""
    log = case.log
    receiver = max(log.gnss, key=lambda g: int(np.count_nonzero(_has_position(g))), default=None)
    if receiver is None or np.count_nonzero(_has_position(receiver)) < MIN_TRACK_POINTS:
        return []
    spans = case.segments.spans("airborne" if log.kind.flies else "armed")
    forward = log.kind.fixed_wing or log.kind in (VehicleKind.ROVER, VehicleKind.BOAT)
    least = WINGED_M_S if log.kind.fixed_wing else FAST_M_S
    found = track_path(receiver, log.onboard_attitude, spans, least, figure_end(case.segments))
    driven = found.columns["driven"] > 0 if spans else np.ones(len(found.t), bool)
    moving = driven & np.isfinite(found.columns["course"])
    enough = MIN_COURSE_M if covered_seconds(found.t[moving]) >= MIN_COURSE_S else MIN_PATH_M
    if driven.sum() < MIN_TRACK_POINTS or _extent_m(found, driven) < enough:
        return []
    found.values["forward"] = float(forward)
    return [found]


def track_path(receiver: Gnss, attitude: Attitude | None, spans: list[Span], least: float, end: float) -> Trace:
    """The path of a receiver: north and east (m), heading and course (deg), speed (m/s), driven 1 within ``spans``.

    Course and heading are NaN below SLOW_M_S. Values: ``lat``, ``lon`` (deg) of zero; ``difference``, ``low``,
    ``high``: median and quartiles of heading minus course (deg) while driven before ``end`` s at ``least`` m/s or more,
    and ``seconds`` of it.
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
    """Heading (n,) deg of an attitude at ``t`` (n,) s; NaN where no sample is near."""
    if attitude is None or len(attitude.t) < 2:
        return np.full(len(t), np.nan)
    at, q = select_rising(attitude.t, attitude.q)
    if len(at) < 2:
        return np.full(len(t), np.nan)
    after = np.searchsorted(at, t).clip(1, len(at) - 1)
    near = np.minimum(np.abs(at[after] - t), np.abs(t - at[after - 1])) < MAX_ATTITUDE_DISTANCE_S
    return np.where(near, np.degrees(rotation.to_euler(rotation.slerp(at, q, t))[:, 2]), np.nan)


def off_course(t: Array, difference: Array, use: NDArray[np.bool_]) -> dict[str, float]:
    """Median and quartiles (deg) of angles (n,) about their circular mean; nothing from fewer than FEWEST."""
    use = use & np.isfinite(difference)
    if np.count_nonzero(use) < MIN_TRACK_POINTS:
        return {}
    angle = np.radians(difference[use])
    mean = math.atan2(float(np.mean(np.sin(angle))), float(np.mean(np.cos(angle))))
    around = np.degrees(rotation.wrap(angle - mean)) + math.degrees(mean)
    low, middle, high = (float(v) for v in np.quantile(around, [0.25, 0.5, 0.75]))
    turn = 360.0 * round(middle / 360.0)
    return {"difference": middle - turn, "low": low - turn, "high": high - turn, "seconds": covered_seconds(t[use])}


def _has_position(receiver: Gnss) -> NDArray[np.bool_]:
    """Which records (n,) hold a position with a 3D fix; 0, 0 is none."""
    known = np.isfinite(receiver.lat) & np.isfinite(receiver.lon) & (receiver.fix >= FIX_3D)
    return np.asarray(known & ((receiver.lat != 0.0) | (receiver.lon != 0.0)))


def _extent_m(found: Trace, use: NDArray[np.bool_]) -> float:
    """The larger side (m) of the box that holds all points but the outermost hundredth on either end."""
    sides = [np.nanquantile(found.columns[name][use], [0.01, 0.99]) for name in ("north", "east")]
    return max(float(high - low) for low, high in sides)


# Figures of the questions about the sensors, drawn from the questions' own arrays; they go packed into the page.
#
# Traces without a row, all but the track ending at the first crash, with at most MOST samples each:
# ``compass``: the field (uT, body axes) over time, ``key`` the compass, the one in use first: x y z measured,
# expected_x ... of the earth's field turned by an attitude, corrected_x ... less what is offered as an offset; value
# ``by_motion`` 1 where that attitude has its heading by motion alone;
# ``interference``: residual (uT), the field's size less the earth's, against ``t``, which is the drive: A with
# ``key``
# current, % with ``key`` throttle; values ``slope`` (uT per unit of the drive), ``start`` (uT), ``r``, ``seconds``;
# ``levels``: level of vibration in flight (m/s^2) by the firmware's own measure, second by second, ``key`` its
# record;
# values ``p50 p80 worst``, and ``limit`` and ``fault`` of the firmware where it has one;
# ``clipping``: samples of the accelerometer that the vehicle counted as clipped, of the unit with most, by the second
# in
# which they came (where there are any), ``key`` the counter; value ``samples`` in all;
# ``rotor``: ``t`` the rotors' fundamental and its harmonics (Hz), low and high: how far they went in flight;
# ``notches``: ``t`` the middle of notch filters of the gyro (Hz), low and high their edges, ``key`` set or proposed;
# ``ratios``: test ratio of an aid of the onboard estimator, above 1 rejected, ``key`` the aid;
# ``track``: the path over ground by GNSS: north east (m), heading of the onboard attitude and course (deg, NaN where
# too
# slow), speed (m/s), driven (1 in the air, of ground vehicles armed), ``key`` the receiver; values ``lat lon`` of
# zero,
# ``least`` speed for a course, ``forward`` 1 where heading and course agree by design, and where there are enough
# ``difference low high``: median and quartiles of heading minus course, and ``seconds``.


def traces(case: HealthCase, found: list[Check]) -> list[Trace]:
    """All traces that the log can fill; ``found``: what the questions answered, which says what is offered."""
    parts = [
        guarded_part(case.log, "The figure of the field", lambda: field_traces(case, found), list[Trace]),
        guarded_part(case.log, "The figure of the interference", lambda: interference_traces(case), list[Trace]),
        guarded_part(
            case.log, "The figure of the vibration", lambda: [*level_traces(case), *clipping_traces(case)], list[Trace]
        ),
        guarded_part(
            case.log, "The bands of the spectrum", lambda: [*rotor_traces(case), *notch_traces(case)], list[Trace]
        ),
        guarded_part(case.log, "The figure of the test ratios", lambda: ratio_traces(case), list[Trace]),
        guarded_part(case.log, "The ground track", lambda: track_traces(case), list[Trace]),
    ]
    return [trace for part in parts for trace in part]
