"""Read the inputs of EKF2 from a ULog: samples and flags, with its logged states.

Times are s since boot. Units are SI but for the magnetic field, which EKF2 keeps in gauss.
Topics and fields: PX4-Autopilot ``msg/``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.core.sorting import median
from attlog.formats.table import Messages, Table

Array = NDArray[np.float64]

# Lowest IMU rate of a re-run: EKF2 fuses in steps of about 10 ms, and slower records average over several of them.
MIN_IMU_RATE_HZ = 90.0
# A hole between integration intervals longer than this share of the period is a sample lost by the logger.
LOST_SAMPLE_SHARE = 0.5
# Longest hole that is filled by interpolation; longer ones are pauses of the logger.
MAX_FILLED_S = 0.25
# Aids that the re-run does not model; logs that used one of them are refused.
UNSUPPORTED_AIDS = {
    "cs_ev_pos": "vision position",
    "cs_ev_vel": "vision velocity",
    "cs_ev_yaw": "vision heading",
    "cs_opt_flow": "optical flow",
    "cs_gps_yaw": "dual-antenna heading",
    "cs_gnss_yaw": "dual-antenna heading",  # its name from 1.16 on
}
# Plausible delays of the filter's time horizon; 1.12 stamps some records with the time of writing.
MIN_HORIZON_S, MAX_HORIZON_S = 0.03, 0.5
# Numbers of lanes from here on are placeholders of the selector.
MAX_LANES = 10
# Share of records with an unsupported aid above which a re-run is refused.
MIN_AID_SHARE = 0.05


@dataclass(slots=True)
class ImuIncrements:
    """Mean rates (rad/s) and specific forces (m/s^2) over intervals of ``dt`` s that end at ``t`` (n,).

    ``clip``: bits of clipped accelerometer axes. ``filled``: number of interpolated samples.
    """

    t: Array
    dt: Array
    gyro: Array
    acc: Array
    clip: NDArray[np.uint8]
    filled: int = 0


@dataclass(slots=True)
class EstimatorStates:
    """Logged states and variances of one EKF instance, a row per record, in the order of its version.

    ``t``: time of the delayed horizon.
    """

    t: Array
    states: Array
    covariances: Array
    n_states: int

    def attitude(self) -> tuple[Array, Array, Array]:
        """Return times, attitudes (n, 4) and their variances: of three errors from 1.15 on, else of the quaternion."""
        return self.t, self.states[:, :4], self.covariances[:, : 3 if self.n_states > 24 else 4]


@dataclass(slots=True)
class Ekf2Inputs:
    """Logged inputs of the EKF2 instance (lane) that flew; after a switch they are those of the next one.

    ``switches``: times when another lane took over. Streams are mappings of columns with their time ``t``, empty if
    not logged. ``mag``: ``x`` in gauss, measured at ``t``, received at ``t_arrival``. ``innovations``: by aid as
    logged. ``flags``: columns of ``estimator_status_flags``, or bits of ``control_mode_flags``. ``horizon`` s: delay
    of the filter.
    """

    imu: ImuIncrements
    mag: Mapping[str, Array]
    gnss: Mapping[str, Array]
    baro: Mapping[str, Array]
    airspeed: Mapping[str, Array]
    landed: Mapping[str, Array]
    flags: Mapping[str, Array]
    gsf: Mapping[str, Array]
    states: EstimatorStates | None
    horizon: float | None
    switches: Array
    attitude: Mapping[str, Array]
    bias: Mapping[str, Array]
    innovations: Mapping[str, Array]
    vehicle_type: int
    params: dict[str, float] = field(default_factory=dict)
    version: tuple[int, int] = (0, 0)


def _s(table: Table, column: str = "timestamp") -> Array:
    return table[column].astype(np.float64) * 1e-6


def _sorted(columns: dict[str, Array]) -> dict[str, Array]:
    """Sort columns by ``t`` and drop records without finite ``t``."""
    t = columns["t"]
    keep = np.isfinite(t)
    order = np.argsort(t[keep], kind="stable")
    return {name: x[keep][order] for name, x in columns.items()}


def _stack(table: Table, name: str, n: int) -> Array:
    """Read the first ``n`` elements of an array field as (m, n)."""
    if name in table:
        return np.asarray(table[name], np.float64).reshape(len(table), -1)[:, :n]
    return np.column_stack([table[f"{name}[{i}]"].astype(np.float64) for i in range(n)])


def imu_increments(messages: Messages) -> ImuIncrements:
    """Read ``sensor_combined``; lost samples are replaced by the mean of their neighbours.

    UsageError if the topic is missing or too slow.
    """
    table = messages.first("sensor_combined")
    if table is None or len(table) < 100:
        raise UsageError("EKF2 cannot be run again: the log holds no sensor_combined.")
    dt = table["gyro_integral_dt"].astype(np.float64)
    dt = dt * 1e-6 if median(dt) > 1.0 else dt
    clip = table["accelerometer_clipping"] if "accelerometer_clipping" in table else np.zeros(len(table))
    rows = np.column_stack([_s(table), dt, _stack(table, "gyro_rad", 3), _stack(table, "accelerometer_m_s2", 3), clip])
    rows = rows[np.isfinite(rows).all(axis=1) & (dt > 0) & (dt < 0.1)]
    rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0])]
    t, dt = rows[:, 0], rows[:, 1]
    period, interval = float(median(dt)), float(median(np.diff(t)))
    if period > 1.0 / MIN_IMU_RATE_HZ or interval > 2.0 * period:
        rate = 1.0 / max(period, interval)
        raise UsageError(
            f"EKF2 cannot be run again: its IMU is logged at {rate:.0f} Hz; {MIN_IMU_RATE_HZ:.0f} are needed."
        )
    missing = t[1:] - dt[1:] - t[:-1]
    filled = (missing > LOST_SAMPLE_SHARE * period) & (missing < MAX_FILLED_S)
    lost = np.where(filled, np.rint(missing / period), 0).astype(int)
    where = np.repeat(np.arange(len(lost)), lost)
    within = np.arange(len(where)) - np.repeat(np.cumsum(lost) - lost, lost)
    new = 0.5 * (rows[where] + rows[where + 1])
    new[:, 1] = missing[where] / lost[where]
    new[:, 0], new[:, 8] = t[where] + (within + 1.0) * new[:, 1], 0.0
    rows = np.concatenate([rows, new])
    columns = np.split(rows[np.argsort(rows[:, 0], kind="stable")], [1, 2, 5, 8], axis=1)
    t, dt, gyro, acc, clip = (np.ascontiguousarray(x) for x in columns)
    return ImuIncrements(t[:, 0], dt[:, 0], gyro, acc, clip[:, 0].astype(np.uint8), len(new))


def _magnetometer(messages: Messages, lane_device: int | None) -> dict[str, Array]:
    tables = [messages["vehicle_magnetometer", i] for i in messages.instances("vehicle_magnetometer")]
    if not tables:
        return {"t": np.zeros(0), "t_arrival": np.zeros(0), "x": np.zeros((0, 3))}
    chosen = tables[0]
    for table in tables:
        if lane_device and "device_id" in table and len(table) and int(median(table["device_id"])) == lane_device:
            chosen = table
            break
    t_arrival = _s(chosen)
    t = _s(chosen, "timestamp_sample") if "timestamp_sample" in chosen else t_arrival
    return _sorted({"t": t, "t_arrival": t_arrival, "x": _stack(chosen, "magnetometer_ga", 3)})


def _gnss(messages: Messages) -> dict[str, Array]:
    table = messages.first("vehicle_gps_position")
    names = ("t", "lat", "lon", "alt", "vn", "ve", "vd", "eph", "epv", "sacc", "fix", "satellites", "utc")
    if table is None or not len(table):
        return {name: np.zeros(0) for name in names}
    new = "latitude_deg" in table
    columns = {
        "t": _s(table),
        "lat": table["latitude_deg"].astype(np.float64) if new else table["lat"] * 1e-7,
        "lon": table["longitude_deg"].astype(np.float64) if new else table["lon"] * 1e-7,
        "alt": table["altitude_msl_m"].astype(np.float64) if new else table["alt"] * 1e-3,
        "vn": table["vel_n_m_s"].astype(np.float64),
        "ve": table["vel_e_m_s"].astype(np.float64),
        "vd": table["vel_d_m_s"].astype(np.float64),
        "eph": table["eph"].astype(np.float64),
        "epv": table["epv"].astype(np.float64),
        "sacc": table["s_variance_m_s"].astype(np.float64),
        "fix": table["fix_type"].astype(np.float64),
        "satellites": table["satellites_used"].astype(np.float64),
        "utc": table["time_utc_usec"].astype(np.float64) * 1e-6,
    }
    return _sorted(columns)


def _columns(table: Table | None, names: Mapping[str, str]) -> dict[str, Array]:
    """Read columns of a topic as floats, renamed and sorted; missing columns are NaN, a missing topic is empty."""
    if table is None or not len(table):
        return {"t": np.zeros(0)} | {short: np.zeros(0) for short in names}
    n = len(table)
    found = {
        short: table[long].astype(np.float64) if long in table else np.full(n, np.nan) for short, long in names.items()
    }
    return _sorted({"t": _s(table)} | found)


# Bits of filter_control_status / control_mode_flags (msg/estimator_status.msg).
CONTROL_BITS = {
    "cs_tilt_align": 0,
    "cs_yaw_align": 1,
    "cs_gps": 2,
    "cs_opt_flow": 3,
    "cs_mag_hdg": 4,
    "cs_mag_3d": 5,
    "cs_wind": 8,
    "cs_ev_pos": 12,
    "cs_ev_yaw": 13,
    "cs_mag_aligned_in_flight": 23,
    "cs_gps_yaw": 22,
}


def control_flags(messages: Messages, lane: int) -> dict[str, Array]:
    """Return the control flags of a lane from ``estimator_status_flags``, else bits of ``estimator_status``."""
    key = ("estimator_status_flags", lane)
    if key in messages.tables and len(messages[key]):
        table = messages[key]
        names = [n for n in table.fields if n.startswith("cs_")]
        return _sorted({"t": _s(table)} | {n: table[n].astype(np.float64) for n in names})
    status = messages.tables.get(("estimator_status", lane)) or messages.first("estimator_status")
    if status is None or "control_mode_flags" not in status:
        return {"t": np.zeros(0)}
    bits = status["control_mode_flags"].astype(np.int64)
    return _sorted(
        {"t": _s(status)} | {name: ((bits >> bit) & 1).astype(np.float64) for name, bit in CONTROL_BITS.items()}
    )


def estimator_states(messages: Messages, lane: int) -> EstimatorStates | None:
    """Return the logged states and variances of a lane, None if not logged."""
    for name in ("estimator_states", "estimator_status"):
        table = messages.tables.get((name, lane))
        if table is None or not len(table) or "states" not in table or "covariances" not in table:
            continue
        t = _s(table, "timestamp_sample" if "timestamp_sample" in table else "timestamp")
        states = np.asarray(table["states"], np.float64)
        covariances = np.asarray(table["covariances"], np.float64)
        n = int(median(table["n_states"])) if "n_states" in table else 24
        keep = np.all(np.isfinite(states), 1) & np.all(np.isfinite(covariances), 1) & np.any(states[:, :4] != 0, 1)
        if keep.any():
            return EstimatorStates(t[keep], states[keep], covariances[keep], n)
    return None


def flown_states(messages: Messages, begins: Array, ends: Array, lanes: list[int]) -> EstimatorStates | None:
    """Return the logged states of the lanes that flew, each while it flew; None if not logged."""
    parts = []
    for begin, end, lane in zip(begins, ends, lanes, strict=True):
        part = estimator_states(messages, lane)
        if part is not None:
            use = (part.t >= begin) & (part.t < end)
            parts.append(EstimatorStates(part.t[use], part.states[use], part.covariances[use], part.n_states))
    if not parts:
        return None
    t, states, covariances = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "states", "covariances")
    )
    return EstimatorStates(t, states, covariances, parts[0].n_states)


# Columns of ``estimator_innovations`` (since 1.11) by aid.
INNOVATION_COLUMNS = {
    "mag_x": "mag_field[0]",
    "mag_y": "mag_field[1]",
    "mag_z": "mag_field[2]",
    "heading": "heading",
    "velocity_n": "gps_hvel[0]",
    "velocity_e": "gps_hvel[1]",
    "velocity_d": "gps_vvel",
    "position_n": "gps_hpos[0]",
    "position_e": "gps_hpos[1]",
    "gnss_height": "gps_vpos",
    "baro_height": "baro_vpos",
    "airspeed": "airspeed",
    "sideslip": "beta",
}


def logged_innovations(messages: Messages, lane: int) -> dict[str, Array]:
    """Read the logged innovations of a lane by aid; aids that were never fused are zero or NaN."""
    table = messages.tables.get(("estimator_innovations", lane))
    found = _columns(table, INNOVATION_COLUMNS | {"t_sample": "timestamp_sample"})
    sampled = found.pop("t_sample") * 1e-6
    return found | {"t": np.where(sampled > 0.0, sampled, found["t"])}


def _horizon(messages: Messages, lane: int) -> float | None:
    for name in ("estimator_states", "estimator_status", "estimator_status_flags"):
        table = messages.tables.get((name, lane))
        if table is not None and len(table) and "timestamp_sample" in table:
            late = _s(table) - _s(table, "timestamp_sample")
            late = late[(late > MIN_HORIZON_S) & (late < MAX_HORIZON_S)]
            if len(late):
                return float(median(late))
    return None


def _attitude(messages: Messages) -> dict[str, Array]:
    table = messages.first("vehicle_attitude")
    if table is None:
        raise UsageError("EKF2 cannot be compared: the log holds no vehicle_attitude.")
    t = _s(table, "timestamp_sample") if "timestamp_sample" in table else _s(table)
    columns = {"t": t, "t_now": _s(table), "q": _stack(table, "q", 4)}
    if "quat_reset_counter" in table:
        columns["resets"] = table["quat_reset_counter"].astype(np.float64)
    return _sorted(columns)


# Least release type (lowest byte of ver_sw_release) that is no development build.
ALPHA = 64


def version_of(messages: Messages, params: Mapping[str, float]) -> tuple[int, int]:
    """Return major and minor version of PX4, inferred from EKF2's parameters if not logged.

    UsageError for development builds between 1.14 and 1.15, which mix two filters.
    """
    release = int(messages.info.get("ver_sw_release") or 0)
    if release >> 16:
        version = (release >> 24) & 0xFF, (release >> 16) & 0xFF
        if version == (1, 15) and release & 0xFF < ALPHA:
            raise UsageError("EKF2 cannot be run again: development builds between PX4 1.14 and 1.15 mix two filters.")
        return version
    if "EKF2_GPS_CTRL" in params:
        return (1, 14) if "EKF2_AID_MASK" in params else (1, 15)
    if "EKF2_PREDICT_US" in params:
        return 1, 13
    return (1, 12) if messages.first("estimator_states") is not None else (1, 10)


def flown_lanes(messages: Messages) -> tuple[Array, list[int]]:
    """Return when each lane took over, the first at -inf, and their numbers."""
    selected = _columns(messages.first("estimator_selector_status"), {"primary": "primary_instance"})
    known = selected["primary"] < MAX_LANES
    t, primary = selected["t"][known], selected["primary"][known].astype(int)
    if not len(t):
        return np.array([-np.inf]), [0]
    new = np.concatenate([[True], np.diff(primary) != 0])
    begins = t[new]
    begins[0] = -np.inf
    return begins, primary[new].tolist()


def read_inputs(messages: Messages, params: Mapping[str, float]) -> Ekf2Inputs:
    """Read the inputs of the EKF2 instances (lanes) that flew.

    UsageError if the IMU is missing or too slow, the attitude is missing, or an aid is not modelled.
    """
    version = version_of(messages, params)
    begins, lanes = flown_lanes(messages)
    ends = np.append(begins[1:], np.inf)

    def flown(read: Callable[[int], dict[str, Array]]) -> dict[str, Array]:
        """Join the columns of the lanes, each while it flew."""
        if len(lanes) == 1:
            return read(lanes[0])
        parts = []
        for begin, end, lane in zip(begins, ends, lanes, strict=True):
            part = read(lane)
            use = (part["t"] >= begin) & (part["t"] < end)
            parts.append({name: x[use] for name, x in part.items()})
        common = set(parts[0]).intersection(*parts)
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name in common}

    def of_lane(topic: str, names: Mapping[str, str]) -> dict[str, Array]:
        return flown(lambda lane: _columns(messages.tables.get((topic, lane)) or messages.first(topic), names))

    def magnetometer(lane: int) -> dict[str, Array]:
        status = messages.tables.get(("estimator_status", lane))
        known = status is not None and "mag_device_id" in status
        return _magnetometer(messages, int(median(status["mag_device_id"])) if status and known else None)

    flags = flown(lambda lane: control_flags(messages, lane))
    for name, aid in UNSUPPORTED_AIDS.items():
        if name in flags and len(flags["t"]) and float(np.mean(flags[name])) > MIN_AID_SHARE:
            raise UsageError(f"EKF2 cannot be run again: it used {aid}, which the re-run does not model.")
    baro = messages.first("vehicle_air_data")
    baro_columns = _columns(baro, {"alt": "baro_alt_meter", "t_sample": "timestamp_sample"})
    if len(baro_columns["t"]):
        sample = baro_columns["t_sample"] * 1e-6
        baro_columns["t_sample"] = np.where(np.isfinite(sample), sample, baro_columns["t"])
    vehicle = messages.first("vehicle_status")
    kind = 0
    if vehicle is not None and len(vehicle):
        column = "vehicle_type" if "vehicle_type" in vehicle else None
        kind = int(median(vehicle[column])) if column else 1
    return Ekf2Inputs(
        imu=imu_increments(messages),
        mag=flown(magnetometer),
        gnss=_gnss(messages),
        baro=baro_columns,
        airspeed=_columns(messages.first("airspeed_validated"), {"tas": "true_airspeed_m_s"}),
        landed=_columns(
            messages.first("vehicle_land_detected"),
            {"landed": "landed", "at_rest": "at_rest", "ground_effect": "in_ground_effect"},
        ),
        flags=flags,
        gsf=of_lane("yaw_estimator_status", {"yaw": "yaw_composite", "var": "yaw_variance"}),
        states=flown_states(messages, begins, ends, lanes),
        horizon=_horizon(messages, lanes[0]),
        switches=begins[1:],
        attitude=_attitude(messages),
        bias=of_lane("estimator_sensor_bias", {axis: f"gyro_bias[{i}]" for i, axis in enumerate("xyz")}),
        innovations=flown(lambda lane: logged_innovations(messages, lane)),
        vehicle_type=kind,
        params=dict(params),
        version=version,
    )
