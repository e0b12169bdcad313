"""Read the sensors of PX4 logs beside the IMU, what drives the vehicle, and its state.

``vehicle_imu_status.accel_vibration_metric`` (1.11 on; ``VehicleIMU.cpp``): 0.99 of itself and 0.01 of the length of
the difference of successive samples, in m/s^2. 1.11 and 1.12 take the difference of velocity increments instead, in
m/s, 200 times less at the default rate; those have no ``var_accel`` beside it. ``sensor_gyro_fft`` (1.12 on) holds the
peaks where IMU_GYRO_FFT_EN is set.
"""

from __future__ import annotations

import numpy as np

from attlog.core.earth import TESLA_PER_GAUSS
from attlog.core.sorting import median, unique
from attlog.core.timestamps import changed_records
from attlog.flight import limits
from attlog.flight.builder import columns, optional_column
from attlog.flight.calibration import compass_priority, px4_calibrate, px4_slot
from attlog.flight.compass import build_mag
from attlog.flight.gnss import build_gnss
from attlog.flight.model import Gnss, Mag, OnboardSpectrum, OnboardVibration, Stream, TimeLine
from attlog.flight.px4.imu import TopicBuilder, sample_stamps, topic_device
from attlog.flight.vehicle import PX4_TYPES, px4_mode, vehicle_name
from attlog.formats.table import Table

# --- magnetometers ----------------------------------------------------------------------------------------------

# Number of raw compass records kept, enough to estimate a bias that the firmware subtracts beside the parameters.
RAW_RECORDS = 400


def magnetometers(builder: TopicBuilder) -> list[Mag]:
    """Return every compass: calibrated topics, then raw ones calibrated by the vehicle's parameters."""
    calibrated = published_magnetometers(builder) or combined_magnetometer(builder)
    devices = {m.device for m in calibrated}
    if calibrated and devices == {None}:
        return calibrated  # without device ids a raw topic may be the same compass
    return calibrated + raw_magnetometers(builder, devices, {m.index for m in calibrated})


def published_magnetometers(builder: TopicBuilder) -> list[Mag]:
    """Read ``vehicle_magnetometer``: calibrated and rotated, gauss, sampled before its stamp."""
    found = []
    for i, table in builder.topics("vehicle_magnetometer").items():
        device, source = topic_device(table), f"vehicle_magnetometer:{i}"
        field, sampled = columns(table, "magnetometer_ga") * TESLA_PER_GAUSS, sample_stamps(table)
        name = str(device) if device else None
        mag = build_mag(builder, i, builder.stamps(table), field, source, t_sample_us=sampled, device=name)
        if mag is not None:
            single = "device_id" in table and len(unique(table["device_id"])) == 1  # else two sensors alternate
            mag.raw = uncalibrated_field(builder, device) if single else None
            found.append(mag)
    return found


def uncalibrated_field(builder: TopicBuilder, device: int) -> Stream | None:
    """Return RAW_RECORDS of a device's ``sensor_mag`` spread over the log, None if not logged."""
    for i, table in builder.topics("sensor_mag").items() if device else ():
        if topic_device(table) != device or "x" not in table:
            continue
        some = table.rows(unique(np.linspace(0, len(table) - 1, RAW_RECORDS).astype(np.int64)))
        field, sampled = columns(some, "x", "y", "z") * TESLA_PER_GAUSS, sample_stamps(some)
        return builder.quiet().stream(builder.stamps(some), field, "T", f"sensor_mag:{i}", t_sample_us=sampled)
    return None


def combined_magnetometer(builder: TopicBuilder) -> list[Mag]:
    """Read the field in ``sensor_combined`` (1.5 to 1.7), repeated at the IMU's rate with a relative time."""
    table = builder.table("sensor_combined")
    if table is None or "magnetometer_ga" not in table:
        return []
    field, t = columns(table, "magnetometer_ga") * TESLA_PER_GAUSS, builder.stamps(table)
    if "magnetometer_timestamp_relative" in table:
        t = t + table["magnetometer_timestamp_relative"].astype(np.int64)
    new = changed_records(field, t)
    mag = build_mag(builder, 0, t[new], field[new], "sensor_combined.magnetometer_ga")
    return [mag] if mag is not None else []


def raw_magnetometers(builder: TopicBuilder, known: set[str | None], taken: set[int]) -> list[Mag]:
    """Read ``sensor_mag`` of devices that are not ``known``; indices in ``taken`` are not reused."""
    values, found = builder.values, []
    for i, table in builder.topics("sensor_mag").items():
        device, source = topic_device(table), f"sensor_mag:{i}"
        if str(device) in known or "x" not in table:
            continue
        field, calibrated = px4_calibrate("MAG", values, device, columns(table, "x", "y", "z"))
        enabled = compass_priority(values, device) != 0 and values.get("SYS_HAS_MAG", 1.0) != 0
        mag = build_mag(
            builder,
            i if i not in taken else max(taken) + 1,
            builder.stamps(table),
            field * TESLA_PER_GAUSS,
            source,
            t_sample_us=sample_stamps(table),
            calibrated=calibrated,
            device=str(device),
            enabled=enabled,
        )
        if mag is None:
            continue
        taken = taken | {mag.index}
        found.append(mag)
        if enabled and calibrated:  # others are reported by choose_mag
            slot = f"CAL_MAG{px4_slot('MAG', values, device)}"
            text = f"{source} (device {device}): only raw values are logged; it is calibrated with {slot}."
            builder.problem("mag_raw", "note", text)
    return found


def flown_compass(builder: TopicBuilder) -> int | None:
    """Return the index of the magnetometer that the estimator used, None if not logged."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = builder.table(name)
        if table is None or "mag_device_id" not in table:
            continue
        device = int(table["mag_device_id"][-1])
        match = [m.index for m in builder.log.mags if m.device == str(device)]
        if device and match:
            return match[0]
    return None


# --- GNSS, height, airspeed -------------------------------------------------------------------------------------

RECEPTION_COLUMNS = {
    "satellites": "satellites_used",
    "hdop": "hdop",
    "noise": "noise_per_ms",
    "jamming": "jamming_indicator",
    "jamming_state": "jamming_state",
    "spoofing_state": "spoofing_state",
}
# MAV_SENSOR_ROTATION_PITCH_270: a rangefinder that points down.
DOWNWARD_ORIENTATION = 25


def receivers(builder: TopicBuilder) -> list[Gnss]:
    """Return receivers of ``vehicle_gps_position`` or ``sensor_gps``, by the larger number of records."""
    topics = {name: builder.topics(name) for name in ("vehicle_gps_position", "sensor_gps")}
    counts = {name: max((len(t) for t in tables.values()), default=0) for name, tables in topics.items()}
    name = max(counts, key=lambda n: counts[n])
    if counts[name] == 0:
        return []
    found = [read_receiver(builder, name, i, table) for i, table in topics[name].items()]
    return [receiver for receiver in found if receiver is not None]


def read_receiver(builder: TopicBuilder, name: str, instance: int, table: Table) -> Gnss | None:
    """Read a receiver; positions are integers (1e-7 deg, mm) before 1.15 and doubles (deg, m) since."""
    if "latitude_deg" in table:
        place = columns(table, "latitude_deg", "longitude_deg", "altitude_msl_m")
    elif "lat" in table and "lon" in table and "alt" in table:
        place = columns(table, "lat", "lon", "alt") * [1e-7, 1e-7, 1e-3]
    else:
        return None
    velocity = columns(table, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    if "vel_ned_valid" in table:
        velocity[table["vel_ned_valid"] == 0] = np.nan
    h_acc, v_acc, s_acc = (optional_column(table, column) for column in ("eph", "epv", "s_variance_m_s"))
    return build_gnss(
        builder,
        instance,
        builder.stamps(table),
        f"{name}:{instance}",
        place=place,
        velocity=velocity,
        fix=table["fix_type"].astype(np.int64),
        accuracy=(h_acc, v_acc, s_acc),
        yaw=columns(table, "heading")[:, 0] if "heading" in table else None,
        utc_us=table["time_utc_usec"].astype(np.int64) if "time_utc_usec" in table else None,
        reception={quality: optional_column(table, column) for quality, column in RECEPTION_COLUMNS.items()},
    )


def baro_streams(builder: TopicBuilder) -> list[Stream]:
    """Return barometric altitudes in m."""
    for name in ("vehicle_air_data", "sensor_combined", "sensor_baro"):
        column = "altitude" if name == "sensor_baro" else "baro_alt_meter"
        tables = [table for table in builder.topics(name).values() if column in table]
        found = []
        for table in tables:
            t, x = builder.stamps(table), table.value(column)
            if name == "sensor_combined":
                new = changed_records(x, t)
                t, x = t[new], x[new]
            found.append(builder.stream(t, x, "m", f"{name}:{table.instance}", within=limits.BARO))
        if tables:
            return [stream for stream in found if stream is not None]
    return []


def rangefinder_stream(builder: TopicBuilder) -> Stream | None:
    """Return the distance (n, 1) in m of the first downward rangefinder within its range."""
    for instance, table in builder.topics("distance_sensor").items():
        if "current_distance" not in table or len(table) < 2:
            continue
        if "orientation" in table and not (table["orientation"] == DOWNWARD_ORIENTATION).all():
            continue
        x = table.value("current_distance").astype(np.float64)
        good = np.isfinite(x) & (x > 0)
        if "max_distance" in table and "min_distance" in table:
            good &= (x >= table.value("min_distance")) & (x < table.value("max_distance"))
        if "signal_quality" in table:
            good &= table["signal_quality"] != 0
        if np.count_nonzero(good) > 1:
            stamps, source = builder.stamps(table)[good], f"distance_sensor:{instance}"
            return builder.quiet().stream(stamps, x[good], "m", source, within=limits.RANGE)
    return None


def airspeed_stream(builder: TopicBuilder) -> Stream | None:
    """Return the true airspeed in m/s."""
    for name in ("airspeed_validated", "airspeed"):
        table, column = builder.table(name), ("true_airspeed_m_s",)
        stream = builder.column_stream(table, column, "m/s", name, limits.AIRSPEED, allow_nan=True)
        if stream is not None:
            return stream
    return None


# --- drive and set-points ---------------------------------------------------------------------------------------

# Topics of the demanded thrust, newest first.
THRUST_COLUMNS = (
    ("vehicle_thrust_setpoint", "xyz"),
    ("vehicle_rates_setpoint", "thrust_body"),
    ("vehicle_attitude_setpoint", "thrust_body"),
    ("vehicle_rates_setpoint", "thrust"),
    ("vehicle_attitude_setpoint", "thrust"),
)
MAX_ESCS = 16


def throttle_stream(builder: TopicBuilder) -> Stream | None:
    """Return the commanded thrust 0 to 1, as norm of the thrust set-point."""
    for name, column in THRUST_COLUMNS:
        table = builder.table(name)
        if table is not None and column in table:
            size = np.sqrt(np.sum(columns(table, column) ** 2, axis=1))
            return builder.stream(builder.stamps(table), size, "1", name, within=limits.THROTTLE, allow_nan=True)
    return None


def rpm_stream(builder: TopicBuilder) -> Stream | None:
    """Return the speeds (n, rotors) in rev/min of rotors that turned."""
    table = builder.table("esc_status")
    names = [f"esc[{k}].esc_rpm" for k in range(MAX_ESCS)]
    names = [name for name in names if table is not None and name in table]
    if table is None or not names:
        return None
    x = columns(table, *names)
    turned = x.any(axis=0)
    if not turned.any():
        return None
    return builder.stream(builder.stamps(table), x[:, turned], "rpm", "esc_status", within=limits.RPM)


def battery_stream(builder: TopicBuilder) -> Stream | None:
    """Return the battery (n, 2), voltage in V and current in A, NaN where not measured."""
    table = builder.messages.first("battery_status")
    if table is None or "voltage_v" not in table:
        return None
    x = columns(table, "voltage_v", "current_a")
    x[(x < 0) & (x >= -limits.VOLTAGE.high)] = np.nan  # -1: no current sensor
    return builder.battery_stream(builder.stamps(table), x, "battery_status")


def cpuload_stream(builder: TopicBuilder, name: str) -> Stream | None:
    """Return a column (n, 1) of cpuload, the share of the processor's time or memory in use."""
    table = builder.table("cpuload")
    return builder.quiet().column_stream(table, (name,), "1", "cpuload", limits.SHARE_IN_USE, allow_nan=True)


def rate_setpoint_stream(builder: TopicBuilder) -> Stream | None:
    """Return the body rate set-point in rad/s."""
    name, axes = "vehicle_rates_setpoint", ("roll", "pitch", "yaw")
    quantity = limits.RATE_SETPOINT
    return builder.column_stream(builder.table(name), axes, "rad/s", name, quantity, frame="FRD", allow_nan=True)


# --- vibration --------------------------------------------------------------------------------------------------

# IMU_INTEG_RATE: default and largest value.
DEFAULT_INTEGRATION_HZ, MAX_INTEGRATION_HZ = 200.0, 1000.0


def vibration_levels(builder: TopicBuilder) -> list[OnboardVibration]:
    """Return the vibration level of every IMU in m/s^2."""
    found = []
    for unit, table in builder.topics("vehicle_imu_status").items():
        if "accel_vibration_metric" not in table:
            continue
        scale = 1.0 if "var_accel" in table else 1.0 / increment_seconds(builder, unit)
        source = f"vehicle_imu_status:{unit}"
        x = table.value("accel_vibration_metric") * scale
        stream = builder.stream(builder.stamps(table), x, "m/s^2", source, within=limits.VIBRATION)
        if stream is not None:
            found.append(OnboardVibration(unit, "difference", source, stream.t, stream.x[:, 0]))
    return found


def increment_seconds(builder: TopicBuilder, unit: int) -> float:
    """Return the integration time in s of a unit's velocity increments."""
    table = builder.table("vehicle_imu", unit)
    if table is not None and "delta_velocity_dt" in table and len(table):
        dt = float(median(table["delta_velocity_dt"])) * 1e-6
        if 1.0 / MAX_INTEGRATION_HZ <= dt < 1.0:
            return dt
    return 1.0 / DEFAULT_INTEGRATION_HZ


def onboard_spectrum(builder: TopicBuilder) -> OnboardSpectrum | None:
    """Return the peaks (n, k) in Hz of the onboard gyro spectrum over all axes, None if not logged."""
    table = builder.messages.first("sensor_gyro_fft")
    names = [f"peak_frequencies_{axis}" for axis in "xyz"]
    needed = (*names, "sensor_sample_rate_hz", "resolution_hz")
    if table is None or len(table) < 2 or not all(c in table for c in needed):
        return None
    peaks = np.column_stack([columns(table, name) for name in names])
    rate = float(median(table["sensor_sample_rate_hz"]))
    with np.errstate(invalid="ignore"):
        peaks[~((peaks > 0) & (peaks < 0.5 * rate))] = np.nan
    t = builder.seconds(builder.stamps(table))
    rising = np.isfinite(t) & np.concatenate([[True], np.diff(t) > 0])
    if not np.isfinite(rate) or not rising.any():
        return None
    resolution = float(median(table["resolution_hz"]))
    return OnboardSpectrum(t[rising], peaks[rising], rate, resolution, f"sensor_gyro_fft:{table.instance}")


# --- vehicle and state ------------------------------------------------------------------------------------------

# ``vehicle_status.arming_state`` of an armed vehicle, the same in all versions.
ARMED_STATE = 2


def vehicle_type(builder: TopicBuilder) -> str:
    """Return the vehicle's usual name by its status or the parameter MAV_TYPE, else "unknown"."""
    status, mav_type = builder.table("vehicle_status"), builder.log.param("MAV_TYPE")
    if status is not None and len(status):
        if "is_vtol" in status and status["is_vtol"].any():
            return "VTOL"
        if "system_type" in status:
            return vehicle_name(int(status["system_type"][-1]))
        if mav_type is None and "vehicle_type" in status:
            return PX4_TYPES.get(int(status["vehicle_type"][-1]), "unknown")
    return "unknown" if mav_type is None else vehicle_name(int(mav_type))


def is_simulated(builder: TopicBuilder) -> bool:
    """Return whether the sensors were simulated (SITL or hardware in the loop)."""
    info, status = builder.messages.info, builder.table("vehicle_status")
    board = f"{info.get('ver_hw', '')} {info.get('sys_mcu', '')}".upper()
    hil = status is not None and "hil_state" in status and bool((status["hil_state"] == 1).any())
    return hil or builder.table("vehicle_attitude_groundtruth") is not None or "SITL" in board


def armed_line(builder: TopicBuilder) -> TimeLine | None:
    """Return arming over time."""
    for name, column, value in (("vehicle_status", "arming_state", ARMED_STATE), ("actuator_armed", "armed", 1)):
        table = builder.table(name)
        if table is not None and column in table:
            on = table[column] == value if name == "vehicle_status" else table[column] != 0
            return builder.time_line(builder.stamps(table), on.tolist(), name)
    return None


def mode_line(builder: TopicBuilder) -> TimeLine | None:
    """Return flight modes by name over time."""
    status = builder.table("vehicle_status")
    if status is None or "nav_state" not in status:
        return None
    names = [px4_mode(int(n)) for n in status["nav_state"]]
    return builder.time_line(builder.stamps(status), names, "vehicle_status")


def mode_reason_line(builder: TopicBuilder) -> TimeLine | None:
    """Return "failsafe" while the autopilot's failsafe chooses the mode, else an empty text."""
    status = builder.table("vehicle_status")
    if status is None or "failsafe" not in status:
        return None
    return builder.time_line(
        builder.stamps(status), ["failsafe" if on else "" for on in status["failsafe"].tolist()], "vehicle_status"
    )


def landed_line(builder: TopicBuilder) -> TimeLine | None:
    """Return ground contact over time, by the land detector."""
    table = builder.table("vehicle_land_detected")
    if table is None or "landed" not in table:
        return None
    return builder.time_line(builder.stamps(table), (table["landed"] != 0).tolist(), "vehicle_land_detected")


# --- pilot ------------------------------------------------------------------------------------------------------

# Roll, pitch and yaw of the sticks since 1.14 and before; forward is nose down.
STICK_COLUMNS = (("roll", "pitch", "yaw"), ("y", "x", "r"))
NOSE_UP = (1.0, -1.0, 1.0)
# Flags that are set while the pilot's input is lost, by topic.
LOST_FLAGS = (
    ("input_rc", ("rc_lost", "rc_failsafe")),
    ("failsafe_flags", ("manual_control_signal_lost",)),
    ("vehicle_status", ("rc_signal_lost",)),
)


def stick_stream(builder: TopicBuilder) -> Stream | None:
    """Return roll, pitch (nose up) and yaw sticks (n, 3), from manual_control_setpoint."""
    name = "manual_control_setpoint"
    table = builder.table(name)
    names = None if table is None else next((c for c in STICK_COLUMNS if all(x in table for x in c)), None)
    if table is None or names is None:
        return None
    x = columns(table, *names) * NOSE_UP
    return builder.quiet().stream(builder.stamps(table), x, "1", name, within=limits.STICK, allow_nan=True)


def radio_signal(builder: TopicBuilder) -> TimeLine | None:
    """Return whether the pilot's input is received, by the receiver's flags and the autopilot's."""
    found = []
    for topic, flags in LOST_FLAGS:
        table = builder.table(topic)
        known = [flag for flag in flags if table is not None and flag in table]
        if table is None or not known:
            continue
        lost = np.any([table[flag].astype(np.int64) != 0 for flag in known], axis=0)
        line = builder.time_line(builder.stamps(table), (~lost).tolist(), f"{topic}.{known[0]}")
        found += [] if line is None else [line]
    if len(found) < 2:
        return found[0] if found else None
    times = unique(np.concatenate([line.t for line in found]))
    received = [all(bool(line.at(t)) for line in found) for t in times.tolist()]
    new = [k for k, on in enumerate(received) if k == 0 or on != received[k - 1]]
    return TimeLine(times[new], [received[k] for k in new], " and ".join(line.source for line in found))
