"""Run PX4's EKF2 again on what a log holds of its inputs: from parameters and samples to attitudes and innovations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import F1, F2, Out1, Out2
from attlog.core.sorting import median, quantile
from attlog.estimators.ekf2 import state as s
from attlog.estimators.ekf2.loop import Samples, run_filter
from attlog.estimators.ekf2.parameters import TABLE, era_of, settings_of
from attlog.estimators.ekf2.start import logged_gnss, logged_resets, warm_starts
from attlog.estimators.error_state import NEVER, new_filter, rotation, turn_body
from attlog.estimators.rerun import Mode, Rerun, check_start, held, innovation_tables, local_ned, side_by_side

if TYPE_CHECKING:
    from attlog.flight.px4.ekf2_inputs import Ekf2Inputs, ImuIncrements

Array = NDArray[np.float64]
# Declination and inclination in rad, strength in gauss of the world model.
FieldModel = tuple[float, float, float]
# Rates on board that are not logged: the barometer's, and those that receivers have.
BARO_HZ = 20.0
GNSS_RATES_HZ = (1.0, 2.0, 4.0, 5.0, 8.0, 10.0)
DEFAULT_GNSS_HZ = 5.0
# Below this share of the onboard rate a field is interpolated to it.
THINNED_SHARE = 0.75
# A longer pause of the field is not bridged.
MAX_FIELD_PAUSE_S = 3.0


def rerun(
    inputs: Ekf2Inputs,
    model: FieldModel | None,
    latitude_deg: float,
    changes: Mapping[str, float] | None = None,
    *,
    gnss_hz: float | None = None,
    mode: Mode = "flown",
    cold: bool = False,
) -> Rerun:
    """Run EKF2 with the log's parameters and ``changes`` (short names) over them.

    ``gnss_hz``: the receiver's rate on board; None estimates it from the log. ``mode``: ``flown`` takes heading resets
    and use of GNSS from the log, ``own`` decides by the filter's rules. ``cold``: start from gravity although the log
    holds states.
    """
    era = era_of(inputs.version)
    TABLE.check(changes or {}, inputs.version)
    setting = settings_of(inputs.params, inputs.version) | dict(changes or {})
    steps = steps_of(inputs.imu, predict_seconds(inputs.version, setting))
    t_step, step_s = steps[:, 0].copy(), float(median(steps[:, 7]))
    fill_flags(steps, inputs, era)
    starts = [] if cold else warm_starts(inputs, era, step_s)
    check_start(changes or {}, TABLE.at_start, "warm" if starts else "cold")
    bias = starts[0].x[10:13] if starts else np.zeros(3)
    gnss, gnss_logged_hz = gnss_samples(inputs, setting["GPS_DELAY"], step_s)
    gnss_hz = gnss_hz or receiver_rate(inputs.gnss, gnss_logged_hz)
    aligned, emergencies = (logged_resets(inputs, kind) if mode == "flown" else None for kind in (0, 1))
    if mode == "flown":
        fill_gnss_use(steps, inputs)
    kinds = [side_by_side(t, np.full(len(t), kind)) for kind, t in enumerate((aligned, emergencies)) if t is not None]
    resets = np.concatenate([np.zeros((0, 2)), *kinds])
    samples = Samples(
        side_by_side(inputs.imu.dt, inputs.imu.gyro),
        steps,
        field_samples(inputs, setting, era, bias, step_s),
        gnss,
        baro_samples(inputs, setting["BARO_DELAY"], step_s),
        airspeed_samples(inputs, setting["ASP_DELAY"], step_s),
        side_by_side(inputs.gsf["t"], np.nan_to_num(inputs.gsf["yaw"]), np.nan_to_num(inputs.gsf["var"])),
        np.ascontiguousarray(resets[np.argsort(resets[:, 0])]),
    )
    known = known_facts(inputs, setting, era, model, latitude_deg, step_s)
    known = known._replace(
        n_gnss=1.0 / max(gnss_hz / gnss_logged_hz, 1.0),
        n_baro=1.0 / max(BARO_HZ / rate_of(inputs.baro["t"], BARO_HZ), 1.0),
        flown_alignment=float(aligned is not None),
        flown_emergency=float(emergencies is not None),
    )
    par = s.Parameters(*(setting[name.upper()] for name in s.Parameters._fields))
    par = par._replace(mag_decl=math.radians(par.mag_decl))
    observations = 6 * len(samples.mag) + 8 * len(gnss) + 2 * len(samples.baro) + 2 * len(samples.airspeed)
    q, out = np.full((len(inputs.imu.t), 4), np.nan), np.full((len(steps), 25), np.nan)
    logs = []
    firsts = np.searchsorted(t_step, [start.t for start in starts]).tolist() or [0]
    for number, first in enumerate(firsts):
        f = new_filter(int(known.length), observations + 100, s.N_CONTROL)
        begin = float(t_step[0])
        if starts:
            begin, f.x[:], f.P[:], f.c[:] = starts[number]
            if len(gnss):  # positions are about the first fix of the log, not about where the filter began
                f.x[7:9] = gnss[min(int(np.searchsorted(gnss[:, 1], begin)), len(gnss) - 1), 2:4]
                f.c[s.FALSE_N], f.c[s.FALSE_E] = f.x[7], f.x[8]
        begin_timers(f.c, begin)
        # the lane before runs until this one's output begins
        last = firsts[number + 1] + int(known.length) if number + 1 < len(firsts) else len(steps)
        run_filter(f, par, known, samples, first, min(last, len(steps)), q, out)
        log = f.log[: f.kept[0]]
        logs.append(log[log[:, 1] < (starts[number + 1].t if number + 1 < len(firsts) else np.inf)])
    states = {
        "attitude_variance": out[:, 0:3],
        "velocity_variance": out[:, 3:6],
        "gyro_bias": out[:, 6:9],
        "acc_bias": out[:, 9:12],
        "mag_mode": out[:, 12],
        "gnss": out[:, 13],
        "tilt_aligned": out[:, 14],
        "aligned_in_flight": out[:, 15],
        "gyro_bias_variance": out[:, 16:19],
        "acc_bias_variance": out[:, 19:22],
        "field_bias": out[:, 22:25],
    }
    innovations = innovation_tables(np.concatenate(logs))
    facts = {"era": float(era), "gnss_hz": gnss_hz, "step_s": step_s}
    if aligned is None and np.all(steps[:, 13] < 0.0):
        mode = "own"
    return Rerun(inputs.imu.t, q, t_step, states, innovations, "warm" if starts else "cold", facts, mode)


def fitted_gnss_rate(inputs: Ekf2Inputs, model: FieldModel | None, latitude_deg: float) -> float | None:
    """Return the receiver's rate on board by the logged velocity variances; None without logged states."""
    logged = inputs.states
    if logged is None or len(logged.t) < 5 or len(inputs.gnss["t"]) < 10:
        return None
    first = 3 if era_of(inputs.version) == s.ERA_D else 4
    variance = np.mean(logged.covariances[:, first : first + 2], axis=1)
    apart: dict[float, float] = {}
    for rate in GNSS_RATES_HZ:
        if rate < 0.8 * rate_of(inputs.gnss["t"], DEFAULT_GNSS_HZ):
            continue
        found = rerun(inputs, model, latitude_deg, gnss_hz=rate)
        k = np.clip(np.searchsorted(found.t_step, logged.t), 0, len(found.t_step) - 1)
        ours = np.mean(found.states["velocity_variance"][k, :2], axis=1)
        use = (found.states["gnss"][k] > 0) & (variance > 0) & np.isfinite(ours)
        if np.count_nonzero(use) < 5:
            return None
        apart[rate] = float(median(np.abs(np.log(ours[use] / variance[use]))))
    return min(apart, key=apart.__getitem__) if apart else None


def predict_seconds(version: tuple[int, int], setting: Mapping[str, float]) -> float:
    """Return the filter's step: 8 ms to 1.10, 10 ms to 1.12, then a parameter."""
    if version <= (1, 10):
        return 0.008
    return 0.010 if version <= (1, 12) else setting["PREDICT_US"] * 1e-6


def known_facts(
    inputs: Ekf2Inputs,
    setting: Mapping[str, float],
    era: int,
    model: FieldModel | None,
    latitude_deg: float,
    step_s: float,
) -> s.Known:
    """Return what a step needs beside parameters; rates are set by the caller."""
    flown = longest_delay(settings_of(inputs.params, inputs.version), era)
    horizon = (flown if inputs.horizon is None else inputs.horizon) + longest_delay(setting, era) - flown
    declination, inclination, strength = model or (0.0, 0.0, 0.0)
    if model is None or not int(setting["DECL_TYPE"]) & 1:
        declination = math.radians(setting["MAG_DECL"])
    plane = inputs.vehicle_type == 2
    minor = inputs.version[1]
    reset = 0 if minor >= 18 or (plane and era <= s.ERA_B) else 2 if 13 <= minor <= 15 else 1
    return s.Known(
        era=float(era),
        reset_in_climb=float(reset),
        latitude=math.radians(latitude_deg),
        declination=declination,
        inclination=inclination,
        strength=strength,
        step_s=step_s,
        length=float(round(horizon / step_s) + 1),
        plane=float(plane),
        n_gnss=1.0,
        n_baro=1.0,
        flown_alignment=0.0,
        flown_emergency=0.0,
        brief_checks=float(minor >= 17),
        imu_period=float(median(inputs.imu.dt)),
    )


def longest_delay(setting: Mapping[str, float], era: int) -> float:
    """Return in s how late the filter runs with these settings."""
    delays = [setting[f"{aid}_DELAY"] for aid in ("GPS", "MAG", "BARO", "ASP")]
    return 1e-3 * (setting["DELAY_MAX"] if era == s.ERA_D else max(delays))


def begin_timers(c: Array, begin: float) -> None:
    """Start all timers of the control state at ``begin``; what has not happened yet never did."""
    for i in (
        s.T_VEL,
        s.T_POS,
        s.T_GNSS,
        s.T_MAG,
        s.T_HEADING,
        s.T_FALSE,
        s.T_HEIGHT,
        s.T_ZERO,
        s.GOOD_SINCE,
        s.MAG_SINCE,
    ):
        c[i] = begin
    for i in (s.T_ALIGNED, s.T_OBSERVABLE, s.T_BAD_ACC, s.T_LANDED):
        c[i] = NEVER
    if c[s.GNSS_CHECKED]:
        c[s.GOOD_SINCE] = NEVER


def steps_of(imu: ImuIncrements, predict_s: float) -> Array:
    """Average the IMU over the filter's steps: rows as of :class:`Samples`, flags still zero."""
    n = max(round(predict_s / float(median(imu.dt))), 1)
    ends = np.arange(n - 1, len(imu.t), n)
    steps = np.full((len(ends), 14), -1.0)
    steps[:, 0], steps[:, 12] = imu.t[ends], ends
    work = np.zeros(4), np.zeros(4), np.zeros((3, 3)), np.zeros(3)
    down_sample(imu.gyro, imu.acc, imu.dt, imu.clip.astype(np.float64), n, *work, steps)
    return steps


@jit.loop("EKF2's steps from IMU samples")
def down_sample(gyro: F2, acc: F2, dt: F1, clips: F1, n: int, q: Out1, g: Out1, r: Out2, v: Out1, steps: Out2) -> None:
    """Accumulate ``n`` samples a step: rotation and velocity change in the axes of its end, as mean rate and force."""
    for k in range(len(steps)):
        for i in range(4):
            q[i] = 1.0 if i == 0 else 0.0
        for i in range(3):
            v[i] = 0.0
        total = 0.0
        clip = 0
        for j in range(k * n, k * n + n):
            d = dt[j]
            turn_body(q, gyro[j, 0] * d, gyro[j, 1] * d, gyro[j, 2] * d)
            for i in range(4):
                g[i] = 1.0 if i == 0 else 0.0
            turn_body(g, gyro[j, 0] * d, gyro[j, 1] * d, gyro[j, 2] * d)
            rotation(g, r)
            # dv <- dR' dv + (dv_k + dR' dv_k) / 2
            a, b, c = v[0] + 0.5 * d * acc[j, 0], v[1] + 0.5 * d * acc[j, 1], v[2] + 0.5 * d * acc[j, 2]
            for i in range(3):
                v[i] = r[0, i] * a + r[1, i] * b + r[2, i] * c + 0.5 * d * acc[j, i]
            total += d
            clip |= int(clips[j])
        half = math.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        angle = 2.0 * math.atan2(half, abs(q[0])) * (1.0 if q[0] >= 0.0 else -1.0)
        scale = angle / half if half > 1e-9 else 2.0
        for i in range(3):
            steps[k, 1 + i] = q[1 + i] * scale / total
            steps[k, 4 + i] = v[i] / total
        steps[k, 7] = total
        steps[k, 8] = clip


def fill_flags(steps: Array, inputs: Ekf2Inputs, era: int) -> None:
    """Set landed, at rest and ground effect of each step; before 1.12 rest is judged from the IMU."""
    land, t = inputs.landed, steps[:, 0]
    steps[:, 9] = held(land["t"], land["landed"], t, 1.0)
    if era == s.ERA_A or not np.isfinite(land["at_rest"]).any():
        quiet = rest_by_imu(inputs.imu, held(land["t"], land["landed"], inputs.imu.t, 1.0))
        steps[:, 10] = quiet[steps[:, 12].astype(int)]
    else:
        steps[:, 10] = np.nan_to_num(held(land["t"], land["at_rest"], t, 0.0))
    steps[:, 11] = np.nan_to_num(held(land["t"], land["ground_effect"], t, 0.0))


def fill_gnss_use(steps: Array, inputs: Ekf2Inputs) -> None:
    """Set the logged use of GNSS of each step, which is as late as the flags are early."""
    t, on = logged_gnss(inputs)
    if len(t):
        steps[:, 13] = held(t, on, steps[:, 0] + (inputs.horizon or 0.0), 0.0)


def rest_by_imu(imu: ImuIncrements, landed: Array) -> Array:
    """Mark samples at rest on the ground: forces within 0.25 m/s^2 of the last and rates below 0.05 rad/s for 1 s."""
    same = np.concatenate([[False], np.abs(np.diff(imu.acc, axis=0)).max(axis=1) < 0.25])
    quiet = same & (np.linalg.norm(imu.gyro, axis=1) < 0.05)
    moved = np.maximum.accumulate(np.where(quiet, -np.inf, imu.t))
    return ((imu.t - moved > 1.0) & (landed > 0)).astype(np.float64)


def field_samples(inputs: Ekf2Inputs, setting: Mapping[str, float], era: int, bias: Array, step_s: float) -> Array:
    """Return the field's rows of :class:`Samples`, averaged or interpolated to the onboard rate."""
    t, x = inputs.mag["t"], inputs.mag["x"]
    late = float(median(inputs.mag["t_arrival"] - t)) if len(t) else 0.0
    onboard_hz = float(inputs.params.get("SENS_MAG_RATE", 15.0))
    if era == s.ERA_A:
        onboard_hz = min(50.0, 1000.0 / max(setting["MIN_OBS_DT"], 20.0))
        offsets = np.array([setting[f"MAGBIAS_{axis}"] for axis in "XYZ"])
        x = x - (offsets * 1e-3 if np.abs(offsets).max() > 1.0 else offsets)  # in mG up to 1.8
    logged_hz = rate_of(t, onboard_hz)
    if logged_hz > 1.2 * onboard_hz:
        t, x = averaged(t, x, 1.0 / onboard_hz)
    elif len(t) > 2 and logged_hz < THINNED_SHARE * onboard_hz:
        t, x = interpolated_field(inputs.imu, t, x, onboard_hz, bias)
    return side_by_side(fusion_time(t, setting["MAG_DELAY"], step_s), t + late, x, np.ones(len(t)))


def averaged(t: Array, x: Array, dt: float) -> tuple[Array, Array]:
    """Return means over successive spans of ``dt`` s."""
    _, first, count = np.unique(np.floor((t - t[0]) / dt).astype(int), return_index=True, return_counts=True)
    return np.add.reduceat(t, first) / count, np.add.reduceat(x, first, axis=0) / count[:, None]


def interpolated_field(imu: ImuIncrements, t: Array, m: Array, onboard_hz: float, bias: Array) -> tuple[Array, Array]:
    """Interpolate a thinned field in axes that the gyro holds still, and turn it back to the body."""
    r = np.zeros((len(imu.t), 3, 3))
    integrate(imu.gyro, imu.dt, np.ascontiguousarray(bias), np.array([1.0, 0.0, 0.0, 0.0]), r)
    at = np.arange(t[0], t[-1], 1.0 / onboard_hz)
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    share = ((at - t[i]) / (t[i + 1] - t[i]))[:, None]
    still = np.einsum("nij,nj->ni", r[np.clip(np.searchsorted(imu.t, t), 0, len(r) - 1)], m)
    mixed = (1.0 - share) * still[i] + share * still[i + 1]
    body = np.einsum("nji,nj->ni", r[np.clip(np.searchsorted(imu.t, at), 0, len(r) - 1)], mixed)
    bridged = t[i + 1] - t[i] <= MAX_FIELD_PAUSE_S
    return at[bridged], body[bridged]


@jit.loop("rotation by gyro alone")
def integrate(gyro: F2, dt: F1, bias: F1, q: Out1, r: jit.Out3) -> None:
    """Integrate rates (n, 3) from ``q`` on; ``r`` (n, 3, 3) takes the rotations from body axes."""
    for i in range(len(dt)):
        turn_body(q, (gyro[i, 0] - bias[0]) * dt[i], (gyro[i, 1] - bias[1]) * dt[i], (gyro[i, 2] - bias[2]) * dt[i])
        rotation(q, r[i])


def gnss_samples(inputs: Ekf2Inputs, delay_ms: float, step_s: float) -> tuple[Array, float]:
    """Return GNSS rows of :class:`Samples`, positions about the first 3D fix, and their logged rate in Hz."""
    g = inputs.gnss
    good = g["fix"] >= 3
    if not good.any():
        return np.zeros((0, 13)), DEFAULT_GNSS_HZ
    i = int(np.argmax(good))
    north, east = local_ned(g["lat"], g["lon"], g["lat"][i], g["lon"][i])
    columns = [north, east, g["alt"][i] - g["alt"], g["vn"], g["ve"], g["vd"]]
    rows = side_by_side(
        fusion_time(g["t"], delay_ms, step_s),
        g["t"],
        *columns,
        g["eph"],
        g["epv"],
        g["sacc"],
        g["fix"],
        g["satellites"],
    )
    rows = rows[np.isfinite(rows).all(axis=1)]
    return rows, rate_of(rows[:, 1], DEFAULT_GNSS_HZ)


def baro_samples(inputs: Ekf2Inputs, delay_ms: float, step_s: float) -> Array:
    """Return the barometer's rows of :class:`Samples`."""
    b = inputs.baro
    if not len(b["t"]):
        return np.zeros((0, 3))
    rows = side_by_side(fusion_time(b["t_sample"], delay_ms, step_s), b["t"], -b["alt"])
    return rows[np.isfinite(rows).all(axis=1)]


def airspeed_samples(inputs: Ekf2Inputs, delay_ms: float, step_s: float) -> Array:
    """Return rows of true airspeed of :class:`Samples`."""
    a = inputs.airspeed
    rows = side_by_side(fusion_time(a["t"], delay_ms, step_s), a["t"], a["tas"])
    return rows[np.isfinite(rows).all(axis=1)]


def receiver_rate(gnss: Mapping[str, Array], logged_hz: float) -> float:
    """Return the receiver's rate by its shortest steps of UTC, else 5 Hz."""
    steps = np.diff(gnss["utc"])
    steps = steps[(steps > 0.01) & (steps < 5.0)]
    if len(steps) > 10 and (rate := 1.0 / float(quantile(steps, 0.05))) > 1.3 * logged_hz:
        return min(rate, GNSS_RATES_HZ[-1])
    return max(DEFAULT_GNSS_HZ, logged_hz)


def fusion_time(t: Array, delay_ms: float, step_s: float) -> Array:
    """Return the delayed time from which on a sample is fused."""
    return t - delay_ms * 1e-3 - 0.5 * step_s


def rate_of(t: Array, otherwise: float) -> float:
    """Return the rate in Hz by the median interval, ``otherwise`` for fewer than three samples."""
    return 1.0 / float(median(np.diff(t))) if len(t) > 2 and median(np.diff(t)) > 0 else otherwise
