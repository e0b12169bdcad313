"""Run ArduPilot's EKF3 again on what a log holds of its inputs: from parameters and samples to attitudes.

A log with holes is run in spans, each from the states logged at its beginning. Only the first may begin cold, where the
log holds the start of the filter itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, rotation
from attlog.core.errors import UsageError
from attlog.core.sorting import median, nanmedian, unique
from attlog.estimators.ekf3 import state as s
from attlog.estimators.ekf3.loop import Samples, run_filter
from attlog.estimators.ekf3.parameters import TABLE, settings_of, sources_of
from attlog.estimators.error_state import (
    BA,
    BG,
    MI,
    N_ERR,
    N_STATE,
    NEVER,
    POS,
    TH,
    VEL,
    WIND,
    Filter,
    forget_rows,
    new_filter,
)
from attlog.estimators.rerun import Mode, Rerun, attitude_variances, held, innovation_tables, local_ned, side_by_side

if TYPE_CHECKING:
    from attlog.flight.ardupilot.ekf3_inputs import Ekf3Inputs, Ekf3States

Array = NDArray[np.float64]
# The filter's nominal step, and what the firmware adds to delays: half a step in whole ms.
STEP_S, HALF_STEP_S = 0.012, 0.006
# Delays of sensors in s that are no parameters.
MAG_DELAY_S, AIRSPEED_DELAY_S = 0.060, 0.100
# Delays in ms that the firmware reserves buffers for, used or not: beacons, compass, one step; airspeed.
RESERVED_MS, AIRSPEED_MS, MAX_GNSS_LAG_MS = 60.0, 100.0, 250.0
# Samples of one sensor that are closer are dropped.
MIN_INTERVAL_S = 0.05
# Rate of barometer samples on board; of fewer logged ones each weighs more.
BARO_HZ = 10.0
# Longer holes of the IMU end a span.
MAX_HOLE_S = 0.4
MIN_SPAN_S = 3.0
# Correlations of a warm start are those after so many seconds of a run from it, repeated from the correlations found:
# that of heading and z gyro bias takes longer to build up.
CORRELATION_S, CORRELATION_RUNS = 20.0, 4
# A log that begins so soon after arming begins with horizontal accelerometer biases that have not learned yet.
ARMED_S = 1.0
# Variances of a warm start where none are logged: attitude, velocity, position (horizontal, vertical), gyro bias,
# accelerometer bias, fields.
ATTITUDE_VARIANCE, VELOCITY_VARIANCE, POSITION_VARIANCE, HEIGHT_VARIANCE = 1.2e-3, 0.02, 0.15, 0.3
GYRO_BIAS_VARIANCE, ACC_BIAS_VARIANCE, FIELD_VARIANCE = math.radians(0.06) ** 2, 0.01, 1e-3
MIN_ATTITUDE_VARIANCE = 1e-9
# Grid of the firmware's field table in deg, and the epochs of its nodes by version.
GRID_DEG = 10.0
TABLE_EPOCHS = (((4, 1), 2018.0), ((4, 7), 2023.0), ((99, 0), 2025.5))
COMPASS_SCALE_LIMITS = (0.8, 1.3)
# Seconds in the air after which the vehicle's word counts as flight, and height that ends a take-off.
FLYING_S, LEFT_M = 5.0, 0.5
OUT_COLUMNS = 52


class Span(NamedTuple):
    """A part of the log without holes: its first and last step."""

    first: int
    last: int


def rerun(
    inputs: Ekf3Inputs, changes: Mapping[str, float] | None = None, *, mode: Mode = "flown", cold: bool = False
) -> Rerun:
    """Run EKF3 with the log's parameters and ``changes`` (short names) over them.

    ``mode``: resets and the use of GNSS as ``flown``, or by the filter's ``own`` rules. ``cold``: start from gravity
    although the log holds states.
    """
    TABLE.check(changes or {}, inputs.version)
    setting = settings_of(inputs.params, inputs.version, inputs.plane) | dict(changes or {})
    setting = sources_of(setting, inputs.version)
    if int(setting["MAG_MASK"]) >> inputs.core & 1:
        setting["MAG_CAL"] = 2.0
    step_s, frames, spread = filter_step(inputs)
    lag_ms = setting["GPS_DELAY_MS"] or inputs.gnss_lag_ms
    length = ring_length(inputs, setting, lag_ms)
    spans, steps = steps_of(inputs, step_s, frames)
    horizon_s = (length - 1) * step_s
    if inputs.states is None and not any(len(times) for times in inputs.events.values()):
        mode = "own"
    samples = samples_of(inputs, setting, steps, horizon_s, lag_ms, mode)
    known = known_facts(inputs, setting, samples, step_s, length, mode)
    known = known._replace(spread_2=spread[0], spread_4=spread[1])
    par = s.Parameters(*(setting[name.upper()] for name in s.Parameters._fields))
    q, out = np.full((len(steps), 4), np.nan), np.full((len(steps), OUT_COLUMNS), np.nan)
    logs, starts = [], []
    for number, span in enumerate(spans):
        start = None if cold and number == 0 else warm_start(inputs, known, samples, steps, span)
        first = span.first
        if start is None:
            if number and not cold:
                continue
            first = cold_begin(inputs, steps, span)
        else:
            first = start.first
        if span.last - first < length + 10:
            continue
        f, w = begin(inputs, known, par, samples, steps, first, start, span)
        run_filter(f, w, par, known, samples, first, span.last, q, out)
        logs.append(f.log[: f.kept[0]].copy())
        starts.append("cold" if start is None else "warm")
    if not starts:
        raise UsageError("EKF3 cannot be run again: the log holds neither its states nor its start.")
    states = {
        "attitude_variance": out[:, N_STATE + TH : N_STATE + TH + 3],
        "velocity": out[:, 4:7],
        "velocity_variance": out[:, N_STATE + VEL : N_STATE + VEL + 3],
        "position": out[:, 7:10],
        "position_variance": out[:, N_STATE + POS : N_STATE + POS + 3],
        "gyro_bias": out[:, 10:13],
        "gyro_bias_variance": out[:, N_STATE + BG : N_STATE + BG + 3],
        "acc_bias": out[:, 13:16],
        "acc_bias_variance": out[:, N_STATE + BA : N_STATE + BA + 3],
        "earth_field": out[:, 16:19],
        "body_field": out[:, 19:22],
        "field_variance": out[:, N_STATE + MI : N_STATE + MI + 6],
        "wind": out[:, 22:24],
        "mag_mode": out[:, 47],
        "gnss": out[:, 48],
        "tilt_aligned": out[:, 49],
        "in_flight": out[:, 50],
        "aligned_in_flight": out[:, 51],
    }
    facts = {"version": known.version, "step_s": step_s, "horizon_s": horizon_s, "gnss_lag_ms": lag_ms}
    t_step = steps[:, 0].copy()
    return Rerun(t_step, q, t_step, states, innovation_tables(np.concatenate(logs)), starts[0], facts, mode)


def filter_step(inputs: Ekf3Inputs) -> tuple[float, int, tuple[float, float]]:
    """Return the mean step of the filter in s, the main loop's frames in it, and the spread of steps.

    A step has a whole number of frames, which varies where the mean is not whole. Spread: mean square and mean fourth
    power of steps, over those of the mean.
    """
    loop_s = 1.0 / max(inputs.params.get("SCHED_LOOP_RATE", 50.0 if inputs.plane else 400.0), 25.0)
    frames = max(math.ceil((STEP_S - 0.5 * loop_s) / loop_s - 1e-6), 1)
    if inputs.step_s is None or not 0.005 < inputs.step_s < 0.05:
        return frames * loop_s, frames, (1.0, 1.0)
    mean = max(inputs.step_s / loop_s, 1.0)
    longer = mean % 1.0
    counts, shares = np.array([int(mean), int(mean) + 1]) / mean, np.array([1.0 - longer, longer])
    spread = float(shares @ counts**2), float(shares @ counts**4)
    return inputs.step_s, max(round(inputs.step_s / loop_s), 1), spread


def ring_length(inputs: Ekf3Inputs, setting: Mapping[str, float], lag_ms: float) -> int:
    """Return the length of the firmware's IMU buffer in steps."""
    delays = [setting["HGT_DELAY"], inputs.params.get("EK3_FLOW_DELAY", 10.0), RESERVED_MS]
    if setting["SRC1_POSXY"] == s.BY_GNSS or setting["SRC1_VELXY"] == s.BY_GNSS:
        delays.append(min(lag_ms, MAX_GNSS_LAG_MS))
    if uses_airspeed(inputs):
        delays.append(AIRSPEED_MS)
    return int(max(delays) // 12.0) + 1


def uses_airspeed(inputs: Ekf3Inputs) -> bool:
    """Return whether the vehicle has an airspeed sensor in use."""
    use = inputs.airspeed["use"]
    return inputs.plane and len(use) > 0 and float(np.nanmean(use)) > 0.5


def steps_of(inputs: Ekf3Inputs, step_s: float, frames: int) -> tuple[list[Span], Array]:
    """Average the IMU over the filter's steps, span by span: rows as of :class:`Samples`.

    The EKF integrates unfiltered increments: the logged rates are read later by the delay of their filters.
    """
    t = inputs.t
    late_gyro, late_acc = (inputs.gyro_late, inputs.acc_late)
    if inputs.intervals:
        late_gyro = late_acc = 0.5 * float(median(np.diff(t)))
    holes = np.flatnonzero(np.diff(t) > MAX_HOLE_S)
    spans, parts, count = [], [], 0
    for a, b in zip([0, *(holes + 1)], [*holes, len(t) - 1], strict=True):
        n = int((t[b] - t[a]) / step_s)
        if n * step_s < MIN_SPAN_S:
            continue
        dt = step_s / frames
        middle = t[a] + (np.arange(n * frames) + 0.5) * dt
        gyro = np.column_stack(
            [np.interp(middle + late_gyro, t[a : b + 1], inputs.gyro[a : b + 1, i]) for i in range(3)]
        )
        acc = np.column_stack([np.interp(middle + late_acc, t[a : b + 1], inputs.acc[a : b + 1, i]) for i in range(3)])
        turn, velocity = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
        for i in range(frames):
            turn = rotation.multiply(turn, rotation.from_rotvec(gyro[i::frames] * dt))
            velocity += rotation.rotate(turn, acc[i::frames]) * dt
        steps = np.zeros((n, 11))
        steps[:, 0] = t[a] + (np.arange(n) + 1) * step_s
        steps[:, 1:4], steps[:, 4:7], steps[:, 7] = rotation.to_rotvec(turn) / step_s, velocity / step_s, step_s
        spans.append(Span(count, count + n))
        parts.append(steps)
        count += n
    if not parts:
        raise UsageError("EKF3 cannot be run again: the log holds no 3 s of IMU without a hole.")
    return spans, np.concatenate(parts)


def fill_flags(inputs: Ekf3Inputs, steps: Array, tas: Array) -> None:
    """Set armed, flying for 5 s, and 1 for take-off, 2 for touch-down in ground effect, of each step."""
    t = steps[:, 0]
    armed = held(inputs.armed["t"], inputs.armed["on"], t, 0.0) > 0
    landed = held(inputs.landed["t"], inputs.landed["on"], t, 1.0) > 0
    steps[:, 8] = armed
    if inputs.plane:
        steps[:, 9] = np.isfinite(tas[0, 0]) and held(tas[:, 1], tas[:, 2], t, 0.0) > 10.0
        return
    if not len(inputs.landed["t"]):
        return
    grounded = ~armed | landed
    begin = np.maximum.accumulate(np.where(grounded, t, -np.inf))
    since = np.where(np.isfinite(begin), t - begin, np.inf)
    steps[:, 9] = since > FLYING_S
    if inputs.params.get("GND_EFFECT_COMP", 1.0 if inputs.version >= (4, 1) else 0.0) <= 0:
        return
    steps[:, 10] = 2.0 * (armed & (held(inputs.touch_down["t"], inputs.touch_down["on"], t, 0.0) > 0))
    leaving = since < FLYING_S
    if inputs.states is not None and len(inputs.states.t):
        height = -np.interp(t, inputs.states.t, inputs.states.x[:, 9])
        leaving &= height - np.interp(np.where(np.isfinite(begin), begin, t), t, height) < LEFT_M
    else:
        leaving &= landed
    steps[armed & leaving, 10] = 1.0


def samples_of(
    inputs: Ekf3Inputs, setting: Mapping[str, float], steps: Array, horizon_s: float, lag_ms: float, mode: Mode
) -> Samples:
    """Return what the loop reads, each sample with the time of measurement that the firmware gives it."""
    events = inputs.events
    tas = airspeed_rows(inputs)
    fill_flags(inputs, steps, tas)
    b = inputs.baro
    baro = side_by_side(
        np.maximum(b["t_sample"] - 1e-3 * setting["HGT_DELAY"] - HALF_STEP_S, b["t"] - horizon_s), b["t"], b["alt"]
    )
    if inputs.states is not None and len(baro) and len(inputs.states.t):
        logged = np.interp(baro[:, 0], inputs.states.t, inputs.states.x[:, 9])
        baro[:, 2] -= nanmedian(baro[:, 2] + logged)
    gsf = np.isfinite(inputs.gsf["yaw"]) & (inputs.gsf["sigma"] > 0) & (inputs.gsf["sigma"] < math.radians(15.0))
    return Samples(
        steps=steps,
        mag=compass_rows(inputs, mode),
        gnss=gnss_rows(inputs, horizon_s, lag_ms),
        baro=_spaced(baro),
        airspeed=tas,
        gsf=side_by_side(inputs.gsf["t"], inputs.gsf["yaw"], inputs.gsf["sigma"] ** 2)[gsf],
        final_resets=events["final_reset"],
        anomaly_resets=events["anomaly_reset"],
        gnss_starts=events["gnss_on"],
        compass_changes=events["compass"] if mode == "flown" else np.zeros(0),
    )


def _spaced(rows: Array) -> Array:
    """Drop rows with missing values or less than 50 ms after the last; at least one row stays, which may never come."""
    width = rows.shape[1]
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return np.full((1, width), np.inf)  # never due
    keep = np.ones(len(rows), bool)
    last = -np.inf
    for i, t in enumerate(rows[:, 1].tolist()):
        keep[i] = t - last >= MIN_INTERVAL_S - 1e-3
        last = t if keep[i] else last
    return np.ascontiguousarray(rows[keep])


def compass_rows(inputs: Ekf3Inputs, mode: Mode) -> Array:
    """Return rows of the field of :class:`Samples`, of the compass in use, in own mode of all of them."""
    sources = [inputs.mag, inputs.other_mag] if mode == "own" else [inputs.mag]
    t, x, unit = (np.concatenate([m[name] for m in sources]) for name in ("t", "x", "unit"))
    rows = side_by_side(t - MAG_DELAY_S - HALF_STEP_S, t, x, unit)
    rows = rows[np.argsort(rows[:, 1], kind="stable")]
    each = [_spaced(rows[rows[:, 5] == number]) for number in unique(unit)] or [_spaced(rows)]
    joined = np.concatenate(each)
    return np.ascontiguousarray(joined[np.argsort(joined[:, 1], kind="stable")])


def gnss_rows(inputs: Ekf3Inputs, horizon_s: float, lag_ms: float) -> Array:
    """Return GNSS rows of :class:`Samples`; positions are about the filter's origin where its own are logged."""
    g = inputs.gnss
    good = (g["fix"] >= 3) & np.isfinite(g["lat"]) & np.isfinite(g["lon"]) & (np.abs(g["lat"]) + np.abs(g["lon"]) > 0)
    if not good.any():
        return np.full((1, 14), np.inf)
    i = int(np.argmax(good))
    north, east = local_ned(g["lat"], g["lon"], g["lat"][i], g["lon"][i])
    stamp = np.clip(g["t_message"] - 1e-3 * lag_ms - HALF_STEP_S, g["t"] - horizon_s, g["t"])
    down = g["alt"][i] - g["alt"]
    states = inputs.states
    if states is not None and len(states.t):
        aided = good & (stamp > states.t[0]) & (stamp < states.t[-1])
        bits = held(states.t_status, states.status, stamp, 0.0).astype(np.int64)
        aided &= (bits >> 4) & 1 > 0
        if aided.any():
            q = rotation.slerp(states.t, states.x[:, :4], stamp[aided])
            arm = rotation.rotate(q, np.broadcast_to(inputs.antenna, (len(q), 3)))
            for i, column in enumerate((north, east, down)):
                at_imu = column[aided] - arm[:, i]
                column += median(np.interp(stamp[aided], states.t, states.x[:, 7 + i]) - at_imu)
    accuracy = [np.nan_to_num(g[name]) for name in ("sacc", "hacc", "vacc")]
    vd = np.nan_to_num(g["vd"])
    rows = side_by_side(
        stamp, g["t"], north, east, down, g["vn"], g["ve"], vd, *accuracy, g["fix"], g["satellites"],
        np.nan_to_num(g["hdop"], nan=1.0),
    )  # fmt: skip
    return _spaced(rows[good])


def airspeed_rows(inputs: Ekf3Inputs) -> Array:
    """Return rows of true airspeed of :class:`Samples`, by the density of the standard atmosphere."""
    a = inputs.airspeed
    if not uses_airspeed(inputs):
        return np.full((1, 3), np.inf)
    altitude = 0.0 if not len(inputs.gnss["t"]) else held(inputs.gnss["t"], inputs.gnss["alt"], a["t"], 0.0)
    ratio = (1.0 - 2.2558e-5 * np.clip(np.nan_to_num(altitude), -500.0, 9000.0)) ** -2.12794
    rows = side_by_side(a["t"] - AIRSPEED_DELAY_S - HALF_STEP_S, a["t"], a["eas"] * ratio)
    return _spaced(rows)


def table_field(inputs: Ekf3Inputs, lat: float, lon: float) -> tuple[float, float, float] | None:
    """Return declination, inclination (rad) and strength (gauss) of the firmware's table: bilinear on 10 deg."""
    year = next(epoch for version, epoch in TABLE_EPOCHS if inputs.version < version)
    unix = (year - 1970.0) * 365.2425 * 86400.0
    south, west = math.floor(lat / GRID_DEG) * GRID_DEG, math.floor(lon / GRID_DEG) * GRID_DEG
    share_n, share_e = (lat - south) / GRID_DEG, (lon - west) / GRID_DEG
    total = np.zeros(3)
    for n, e, weight in (
        (0, 0, (1 - share_n) * (1 - share_e)),
        (0, 1, (1 - share_n) * share_e),
        (1, 0, share_n * (1 - share_e)),
        (1, 1, share_n * share_e),
    ):
        node_lon = (west + e * GRID_DEG + 180.0) % 360.0 - 180.0
        node = earth.field(min(south + n * GRID_DEG, 90.0), node_lon, 0.0, unix)
        if node is None:
            return None
        parts = np.array([math.radians(node.declination_deg), math.radians(node.inclination_deg), node.strength_t])
        total += weight * parts
    return float(total[0]), float(total[1]), float(total[2]) * earth.GAUSS_PER_TESLA


def known_facts(
    inputs: Ekf3Inputs, setting: Mapping[str, float], samples: Samples, step_s: float, length: int, mode: Mode
) -> s.Known:
    """Return what a step needs beside parameters and samples."""
    g, params = inputs.gnss, inputs.params
    good = (g["fix"] >= 3) & np.isfinite(g["lat"]) & (np.abs(g["lat"]) + np.abs(g["lon"]) > 0)
    stored = params.get("COMPASS_DEC", 0.0)
    declination, field, latitude, t_fix = stored, (0.0, 0.0, 0.0), 0.0, np.inf
    automatic = params.get("COMPASS_AUTODEC", 1.0) > 0
    scale = params.get("COMPASS_SCALE", 1.0)
    has_table = False
    if good.any():
        i = int(np.argmax(good))
        latitude, t_fix = math.radians(float(g["lat"][i])), float(g["t"][i])
        table = table_field(inputs, float(g["lat"][i]), float(g["lon"][i]))
        if table is not None and automatic:
            declination = table[0]
            level = table[2] * math.cos(table[1])
            field = (level * math.cos(table[0]), level * math.sin(table[0]), table[2] * math.sin(table[1]))
            inside = scale == 0.0 or COMPASS_SCALE_LIMITS[0] <= scale <= COMPASS_SCALE_LIMITS[1]
            has_table = setting["MAG_EF_LIM"] > 0 and inside and inputs.version >= (4, 0)
    compass = (
        bool(np.isfinite(samples.mag[0, 0]))
        and params.get("COMPASS_USE", 1.0) > 0
        and setting["SRC1_YAW"] == s.YAW_BY_COMPASS
    )
    return s.Known(
        version=inputs.version[0] + 0.1 * inputs.version[1],
        latitude=latitude,
        declination=declination,
        stored_declination=stored,
        t_fix=t_fix,
        table_n=field[0],
        table_e=field[1],
        table_d=field[2],
        has_table=float(has_table),
        step_s=step_s,
        length=float(length),
        spread_2=1.0,
        spread_4=1.0,
        plane=float(inputs.plane),
        airspeed=float(uses_airspeed(inputs)),
        compass=float(compass),
        compasses=float(np.max(np.concatenate([inputs.mag["unit"], inputs.other_mag["unit"]]), initial=0.0) + 1.0),
        unit=float(inputs.mag["unit"][0]) if len(inputs.mag["unit"]) else 0.0,
        t_start=float(inputs.events["initialised"][0]) if len(inputs.events["initialised"]) else -np.inf,
        flown=float(mode == "flown"),
        t_origin=float(inputs.events["origin"][0]) if mode == "flown" and len(inputs.events["origin"]) else np.inf,
        n_baro=max(BARO_HZ * float(median(np.diff(inputs.baro["t"]))), 1.0) if len(inputs.baro["t"]) > 2 else 1.0,
        arm_x=inputs.antenna[0],
        arm_y=inputs.antenna[1],
        arm_z=inputs.antenna[2],
    )


class WarmStart(NamedTuple):
    """A logged state: first step, time, state (24,), covariance (23, 23), modes."""

    first: int
    t: float
    x: Array
    P: Array
    gnss_on: bool
    mag_learns: bool


def cold_begin(inputs: Ekf3Inputs, steps: Array, span: Span) -> int:
    """Return the step of a cold start: where the log says that the filter was initialised, else the first."""
    times = inputs.events["initialised"]
    if not len(times):
        return span.first
    return min(max(int(np.searchsorted(steps[:, 0], times[0])), span.first), span.last)


def warm_start(inputs: Ekf3Inputs, known: s.Known, samples: Samples, steps: Array, span: Span) -> WarmStart | None:
    """Return the first logged state of a span; None where there is none, or where the filter began in the span."""
    states = inputs.states
    t0, t1 = steps[span.first, 0], steps[span.last - 1, 0]
    begun = inputs.events["initialised"]
    if states is None or ((begun >= t0 - 2.0) & (begun <= t1)).any():
        return None
    inside = np.flatnonzero((states.t >= t0) & (states.t <= t1 - 1.0))
    if not len(inside):
        return None
    t = float(states.t[inside[0]])
    x = states.x[inside[0]].copy()
    x[:4] /= np.linalg.norm(x[:4])
    first = min(span.first + int(np.searchsorted(steps[span.first : span.last, 0], t)), span.last - 1)
    P, mag_learns = start_covariance(states, x, t, known.step_s)
    bits = int(held(states.t_status, states.status, np.array([t]), 0.0)[0])
    mode = fusion_mode(states, t)
    return WarmStart(first, t, x, P, bool(bits >> 4 & 1), mag_learns if mode is None else mode == s.MAG_3D)


def fusion_mode(states: Ekf3States, t: float) -> int | None:
    """Return the logged mode of the compass at a time; None where it is not logged."""
    if not len(states.t_mag_fusion):
        return None
    return int(np.nan_to_num(held(states.t_mag_fusion, states.mag_fusion, np.array([t]), 0.0))[0])


def start_covariance(states: Ekf3States, x: Array, t: float, step_s: float) -> tuple[Array, bool]:
    """Return the logged variances as a diagonal (23, 23), and whether the field learns; usual ones without a log."""
    P = np.zeros((N_ERR, N_ERR))
    k = int(np.searchsorted(states.t_variances, t))
    if len(states.t_variances) and states.t_variances[min(k, len(states.t_variances) - 1)] - t < 2.0:
        v = np.maximum(states.variances[min(k, len(states.t_variances) - 1)], 0.0).copy()
        v[10:16] /= step_s**2
        np.fill_diagonal(P, v[1:])
        tilt, yaw = attitude_variances(x[:4], v[:4])
        P[0, 0] = P[1, 1] = max(tilt, MIN_ATTITUDE_VARIANCE)
        P[2, 2] = max(yaw, MIN_ATTITUDE_VARIANCE)
        return P, bool(v[19] > 0)
    learns = bool(np.any(x[19:22] != 0.0))
    values = [ATTITUDE_VARIANCE] * 3 + [VELOCITY_VARIANCE] * 3 + [POSITION_VARIANCE] * 2 + [HEIGHT_VARIANCE]
    values += [GYRO_BIAS_VARIANCE] * 3 + [ACC_BIAS_VARIANCE] * 3 + [FIELD_VARIANCE * learns] * 6 + [0.0] * 2
    np.fill_diagonal(P, values)
    return P, learns


def begin(
    inputs: Ekf3Inputs,
    known: s.Known,
    par: s.Parameters,
    samples: Samples,
    steps: Array,
    first: int,
    start: WarmStart | None,
    span: Span,
) -> tuple[Filter, s.Work]:
    """Return a filter at its start; a warm one takes correlations of runs of 20 s from there."""
    if start is None:
        return new_arrays(known, samples, steps, first, None)
    resets = np.concatenate([inputs.events["final_reset"], inputs.events["anomaly_reset"]])
    until = min([start.t + CORRELATION_S, *resets[resets > start.t]])
    last = min(first + int((until - start.t) / known.step_s), span.last)
    q, out = np.full((len(steps), 4), np.nan), np.full((len(steps), OUT_COLUMNS), np.nan)
    earlier = held(inputs.armed["t"], inputs.armed["on"], np.array([start.t - ARMED_S]), 0.0)[0] > 0
    frozen = np.abs(rotation.to_matrix(start.x[:4])[2]) <= s.OBSERVABLE_SHARE if not earlier else np.zeros(3)
    found = start
    for _ in range(CORRELATION_RUNS):
        f, w = new_arrays(known, samples, steps, first, found)
        run_filter(f, w, par, known, samples, first, last, q, out)
        found = start._replace(P=correlated(start.P, f.P))
        for i in np.flatnonzero(frozen):
            forget_rows(found.P, BA + int(i), 1, start.P[BA + i, BA + i])
    return new_arrays(known, samples, steps, first, found)


def correlated(P: Array, other: Array) -> Array:
    """Give a diagonal covariance the correlations of another one, but not those within the attitude."""
    sigma = np.sqrt(np.maximum(np.diag(other), 1e-300))
    c = np.where(np.outer(sigma, sigma) > 1e-200, other / np.outer(sigma, sigma), 0.0)
    c[:3, :3] = np.eye(3)
    np.fill_diagonal(c, 1.0)
    values, vectors = np.linalg.eigh(0.5 * (c + c.T))
    c = (vectors * np.maximum(values, 0.0)) @ vectors.T
    scale = np.sqrt(np.maximum(np.diag(P), 0.0)) / np.sqrt(np.diag(c))
    return np.ascontiguousarray(c * np.outer(scale, scale))


def new_arrays(
    known: s.Known, samples: Samples, steps: Array, first: int, start: WarmStart | None
) -> tuple[Filter, s.Work]:
    """Return filter and work arrays with all timers at the first step."""
    n = 6 * len(samples.mag) + 6 * len(samples.gnss) + 2 * len(samples.baro) + 2 * len(samples.airspeed) + 100
    f = new_filter(int(known.length), n + len(steps) // 5, len(s.CONTROL))
    z = np.zeros
    w = s.Work(z(14), z(14), z(14), z(3), z(3), z((3, 8)), z(3), z(3), z(6), z(4), z(4), z(12))
    c, t = f.c, float(steps[first, 0])
    w.q_mag[0] = w.q_reset[0] = 1.0
    for i in (s.T_MAG, s.T_SYNTHETIC, s.T_VELOCITY, s.T_POSITION, s.T_HEIGHT, s.T_GOOD, s.T_BAD_RATIO, s.T_PASSED):
        c[i] = t
    c[s.T_BAD_IMU] = c[s.T_AIRSPEED] = c[s.T_GNSS] = NEVER
    c[s.NOISE_SCALE], c[s.ON_GROUND] = 1.0, 1.0
    c[s.MAG_HEALTHY] = 1.0
    c[s.COMPASS] = known.unit
    g = samples.gnss[min(int(np.searchsorted(samples.gnss[:, 1], t)), len(samples.gnss) - 1)]
    if start is not None and np.isfinite(g[1]):
        c[s.GNSS_N : s.GNSS_N + 2] = g[2:4]
        c[s.GNSS_VN : s.GNSS_VN + 3] = g[5:8]
        c[s.SACC], c[s.HACC], c[s.VACC], c[s.T_GNSS] = g[8], g[9], g[10], g[1]
        c[s.GOOD_GNSS] = 1.0
    if start is None:
        return f, w
    f.x[:], f.P[:] = start.x, start.P
    f.P[0, 0] = max(f.P[0, 0], MIN_ATTITUDE_VARIANCE)
    c[s.TILT] = c[s.YAW] = c[s.BIAS_ON] = c[s.FIELD_SET] = 1.0
    c[s.GNSS_ON] = float(start.gnss_on)
    c[s.ORIGIN] = 1.0
    c[s.MAG_LEARN] = float(start.mag_learns)
    armed = steps[first, 8] > 0
    c[s.ON_GROUND] = float(not armed)
    c[s.GROUND] = c[s.DOWN_AT_RESET] = f.x[9]
    if armed and (steps[first, 9] > 0 or start.mag_learns):
        c[s.IN_FLIGHT] = 1.0
    if start.mag_learns:
        c[s.FINAL_YAW] = c[s.FINAL_MAG] = 1.0
        for i in range(6):
            w.field_variance[i] = f.P[MI + i, MI + i]
        c[s.FIELD_LEARNED] = float(max(f.P[MI, MI], f.P[MI + 1, MI + 1], f.P[MI + 2, MI + 2]) < 1e-4)
    c[s.WIND_ON] = float(f.P[WIND, WIND] > 0)
    c[s.HELD_N], c[s.HELD_E] = f.x[7], f.x[8]
    c[s.HEIGHT] = c[s.TAKE_OFF_HEIGHT] = -f.x[9]
    for i in range(4):
        w.q_mag[i] = w.q_reset[i] = f.x[i]
    return f, w
