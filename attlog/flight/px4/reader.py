"""PX4 logs (ULog) as a FlightLog: which topic means what, in every era from 1.5 to 1.18.

Topics are told apart by their fields and types, never by a version number: old
logs have none and development builds carry the next one.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from attlog.core import rotation
from attlog.core.timestamps import Stamps, changed_records
from attlog.flight import compass, gnss, limits, parameters, remedies
from attlog.flight import imu as inertial
from attlog.flight.advice import OtherLogging, Px4Logging
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, Attitude, Firmware, FlightLog, Gnss, Stream, TimeLine
from attlog.flight.px4 import estimator, imu, sensors
from attlog.flight.px4 import imu as imus
from attlog.flight.px4.imu import sample_stamps, topic_stamps
from attlog.flight.timestamps import valid_stamp
from attlog.flight.vehicle import PX4_TYPES, px4_mode, vehicle_name
from attlog.formats.table import Messages, Table

# Everything of a PX4 log that is neither inertial, magnetic nor an attitude.

DECLINATION_PARAMETERS = {"EKF2_MAG_DECL": 1.0, "ATT_MAG_DECL": 1.0}
"""Parameters of the declination and their factor to degrees, those of the newer estimator first."""
RELEASE_TYPES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}
ARMED_STATE = 2
"""``vehicle_status.arming_state`` of an armed vehicle, the same in all versions."""


def read_firmware(messages: Messages) -> Firmware:
    """Who wrote the log. Development builds carry the next release number and the word dev."""
    info = messages.info
    number = info.get("ver_sw_release")
    version = ""
    if isinstance(number, (int, np.integer)) and number > 0:
        number = int(number)
        version = f"{number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}"
        kind = RELEASE_TYPES.get(number & 0xFF, f"type {number & 0xFF}")
        version += f" {kind}" if kind else ""
    return Firmware(str(info.get("sys_name", "")), version, str(info.get("ver_sw", "")), str(info.get("ver_hw", "")))


def fill_streams(builder: LogBuilder, log: FlightLog) -> None:
    """Add set-points, states, aids and texts to the log."""
    status = builder.messages.tables.get(("vehicle_status", 0))
    log.vehicle = builder.attempt("The vehicle", lambda: vehicle_type(status, log.param("MAV_TYPE")), "unknown")
    log.simulated = builder.attempt("The simulator", lambda: is_simulated(builder, status), False)
    log.setpoints.attitude = builder.attempt("The attitude set-point", lambda: attitude_setpoint(builder), None)
    log.setpoints.rates = builder.attempt("The rate set-point", lambda: rate_setpoint_stream(builder), None)
    log.state.armed = builder.attempt("Arming", lambda: armed_line(builder, status), None)
    log.state.mode = builder.attempt("The flight mode", lambda: mode_line(builder, status), None)
    log.state.landed = builder.attempt("The land detector", lambda: landed_line(builder), None)
    log.gnss = builder.attempt("GNSS", lambda: read_receivers(builder), [])
    log.utc_offset = builder.attempt("The date", lambda: utc_offset(log.gnss), None)
    log.baro = builder.attempt("The barometer", lambda: baro_streams(builder), [])
    log.rangefinder = builder.attempt("The rangefinder", lambda: rangefinder_stream(builder), None)
    log.airspeed = builder.attempt("Airspeed", lambda: airspeed_stream(builder), None)
    log.power.throttle = builder.attempt("Throttle", lambda: throttle_stream(builder), None)
    log.power.rpm = builder.attempt("Rotor speed", lambda: rpm_stream(builder), None)
    log.power.battery = builder.attempt("The battery", lambda: battery_stream(builder), None)
    log.estimator.acc_bias = builder.attempt("estimator_sensor_bias", lambda: acc_bias_stream(builder), None)
    log.estimator.gyro_bias = builder.attempt(
        "The onboard gyro bias", lambda: estimator.gyro_bias_stream(builder, log.replay_imu), None
    )
    log.estimator.yaw = builder.attempt("The yaw estimator", lambda: estimator.yaw_estimator_stream(builder), None)
    log.vibration.clippings = builder.attempt("Clipping", lambda: imu.clippings(builder), [])
    log.vibration.levels = builder.attempt("The vibration metric", lambda: sensors.vibration_levels(builder), [])
    log.vibration.spectrum = builder.attempt("sensor_gyro_fft", lambda: sensors.onboard_spectrum(builder), None)
    log.estimator.innovation_tests = builder.attempt("Test ratios", lambda: estimator.innovation_tests(builder), [])
    log.estimator.lane = builder.attempt(
        "The estimator's instance", lambda: estimator.selected_instance_line(builder), None
    )
    estimator.report_estimator(builder)
    told = {n: v for n in log.parameters.lines if (v := log.param(n)) is not None}
    compass = None if log.mag is None else log.mags[log.mag]
    log.remedies = builder.attempt("Remedies", lambda: remedies.px4_remedies(told, compass), log.remedies)
    log.texts = builder.attempt("Texts", builder.texts, [])


def armed_line(builder: LogBuilder, status: Table | None) -> TimeLine | None:
    """Armed or not."""
    if status is not None and "arming_state" in status:
        return builder.time_line(
            topic_stamps(status), (status["arming_state"] == ARMED_STATE).tolist(), "vehicle_status"
        )
    table = builder.messages.tables.get(("actuator_armed", 0))
    if table is None or "armed" not in table:
        return None
    return builder.time_line(topic_stamps(table), (table["armed"] != 0).tolist(), "actuator_armed")


def mode_line(builder: LogBuilder, status: Table | None) -> TimeLine | None:
    """Flight modes by name."""
    if status is None or "nav_state" not in status:
        return None
    return builder.time_line(topic_stamps(status), [px4_mode(int(n)) for n in status["nav_state"]], "vehicle_status")


def landed_line(builder: LogBuilder) -> TimeLine | None:
    """On the ground or not, by the land detector."""
    table = builder.messages.tables.get(("vehicle_land_detected", 0))
    if table is None or "landed" not in table:
        return None
    return builder.time_line(topic_stamps(table), (table["landed"] != 0).tolist(), "vehicle_land_detected")


def vehicle_type(status: Table | None, mav_type: float | None) -> str:
    """The kind of vehicle in words, by its status or the parameter MAV_TYPE, "unknown" if neither tells."""
    if status is not None and len(status):
        if "is_vtol" in status and status["is_vtol"].any():
            return "VTOL"
        if "system_type" in status:
            return vehicle_name(int(status["system_type"][-1]))
        if mav_type is None and "vehicle_type" in status:
            return PX4_TYPES.get(int(status["vehicle_type"][-1]), "unknown")
    return "unknown" if mav_type is None else vehicle_name(int(mav_type))


def is_simulated(builder: LogBuilder, status: Table | None) -> bool:
    """Whether the sensors were simulated (SITL or hardware in the loop)."""
    info = builder.messages.info
    board = f"{info.get('ver_hw', '')} {info.get('sys_mcu', '')}".upper()
    hil = status is not None and "hil_state" in status and bool((status["hil_state"] == 1).any())
    truth = ("vehicle_attitude_groundtruth", 0) in builder.messages.tables
    return hil or truth or "SITL" in board


def attitude_setpoint(builder: LogBuilder) -> Attitude | None:
    """The attitude set-point; old versions hold Euler angles beside or instead of ``q_d``."""
    table = builder.messages.tables.get(("vehicle_attitude_setpoint", 0))
    if table is None:
        return None
    q = columns(table, "q_d") if "q_d" in table else np.zeros((len(table), 4))
    unset = ~(np.abs(np.sum(q**2, axis=1) - 1.0) < 0.1)
    if unset.any() and "roll_body" in table:
        euler = columns(table, "roll_body", "pitch_body", "yaw_body")
        q = np.where(unset[:, None], rotation.from_euler(*euler.T), q)
        unset = ~rotation.finite_rows(q)
    if unset.all():
        return None
    return builder.attitude(topic_stamps(table)[~unset], q[~unset], "vehicle_attitude_setpoint")


def rate_setpoint_stream(builder: LogBuilder) -> Stream | None:
    """The body rate set-point in rad/s."""
    table = builder.messages.tables.get(("vehicle_rates_setpoint", 0))
    if table is None or "roll" not in table:
        return None
    rates = columns(table, "roll", "pitch", "yaw")
    return builder.stream(
        topic_stamps(table),
        rates,
        "rad/s",
        "vehicle_rates_setpoint",
        frame="FRD",
        within=limits.RATE_SETPOINT,
        allow_nan=True,
    )


RECEPTION_COLUMNS = {
    "satellites": "satellites_used",
    "hdop": "hdop",
    "noise": "noise_per_ms",
    "jamming": "jamming_indicator",
    "jamming_state": "jamming_state",
    "spoofing_state": "spoofing_state",
}


def read_receivers(builder: LogBuilder) -> list[Gnss]:
    """Receivers: ``vehicle_gps_position`` or ``sensor_gps``, whichever was logged faster."""
    messages = builder.messages
    counts = {
        n: max((len(messages[n, i]) for i in messages.instances(n)), default=0)
        for n in ("vehicle_gps_position", "sensor_gps")
    }
    name = max(counts, key=lambda n: counts[n])
    if counts[name] == 0:
        return []
    return [g for g in (read_receiver(builder, name, i) for i in messages.instances(name)) if g is not None]


def read_receiver(builder: LogBuilder, name: str, instance: int) -> Gnss | None:
    """One receiver; positions are 1e-7 deg integers (mm) before 1.15 and double degrees (m) since."""
    table = builder.messages[name, instance]
    t_us = topic_stamps(table)
    source = f"{name}:{instance}"
    if "latitude_deg" in table:
        place = columns(table, "latitude_deg", "longitude_deg", "altitude_msl_m")
    elif "lat" in table and "lon" in table and "alt" in table:
        place = columns(table, "lat", "lon", "alt") * [1e-7, 1e-7, 1e-3]
    else:
        return None
    fix = table["fix_type"].astype(np.int64)
    velocity = columns(table, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    if "vel_ned_valid" in table:
        velocity[table["vel_ned_valid"] == 0] = np.nan
    return gnss.build_gnss(
        builder,
        instance,
        t_us,
        source,
        place=place,
        velocity=velocity,
        fix=fix,
        accuracy=(
            optional_column(table, "eph"),
            optional_column(table, "epv"),
            optional_column(table, "s_variance_m_s"),
        ),
        yaw=columns(table, "heading")[:, 0] if "heading" in table else None,
        utc_us=table["time_utc_usec"].astype(np.int64) if "time_utc_usec" in table else None,
        reception={name: optional_column(table, column) for name, column in RECEPTION_COLUMNS.items()},
    )


def optional_column(table: Table, column: str) -> Array:
    """An accuracy column, NaN where the topic has none."""
    return table.value(column) if column in table else np.full(len(table), np.nan)


def utc_offset(receivers: list[Gnss]) -> float | None:
    """Seconds that turn the log's clock into Unix time, from GNSS with a fix; None if it never told."""
    for one in receivers:
        if one.utc_us is None:
            continue
        good = (one.utc_us > 0) & (one.fix >= gnss.MIN_FIX_TYPE)
        if good.any():
            return float(np.median(one.utc_us[good] * 1e-6 - one.t[good]))
    return None


def baro_streams(builder: LogBuilder) -> list[Stream]:
    """Barometric altitude in m."""
    for name in ("vehicle_air_data", "sensor_combined", "sensor_baro"):
        column = "altitude" if name == "sensor_baro" else "baro_alt_meter"
        tables = [builder.messages[name, i] for i in builder.messages.instances(name)]
        tables = [t for t in tables if column in t]
        if not tables:
            continue
        found = []
        for table in tables:
            t, x = topic_stamps(table), table.value(column)
            if name == "sensor_combined":
                new = changed_records(x, t)
                t, x = t[new], x[new]
            found.append(builder.stream(t, x, "m", f"{name}:{table.instance}", within=limits.BARO))
        return [f for f in found if f is not None]
    return []


DOWNWARD_ORIENTATION = 25
"""MAV_SENSOR_ROTATION_PITCH_270: the rangefinder looks at the ground."""


def rangefinder_stream(builder: LogBuilder) -> Stream | None:
    """Distance (n, 1) in m of the first downward rangefinder, readings out of its range left out."""
    for instance in builder.messages.instances("distance_sensor"):
        table = builder.messages["distance_sensor", instance]
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
        if np.count_nonzero(good) < 2:
            continue
        source = f"distance_sensor:{instance}"
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # nothing to report of what only tells flight
        return own.stream(topic_stamps(table)[good], x[good], "m", source, within=limits.RANGE)
    return None


def airspeed_stream(builder: LogBuilder) -> Stream | None:
    """True airspeed in m/s."""
    for name in ("airspeed_validated", "airspeed"):
        table = builder.messages.tables.get((name, 0))
        if table is not None and "true_airspeed_m_s" in table:
            stream = builder.stream(
                topic_stamps(table),
                table.value("true_airspeed_m_s"),
                "m/s",
                name,
                within=limits.AIRSPEED,
                allow_nan=True,
            )
            if stream is not None:
                return stream
    return None


def throttle_stream(builder: LogBuilder) -> Stream | None:
    """Demanded thrust 0 to 1: norm of the thrust set-point, in old versions the throttle control."""
    for name, column in (
        ("vehicle_thrust_setpoint", "xyz"),
        ("vehicle_rates_setpoint", "thrust_body"),
        ("vehicle_attitude_setpoint", "thrust_body"),
        ("vehicle_rates_setpoint", "thrust"),
        ("vehicle_attitude_setpoint", "thrust"),
    ):
        table = builder.messages.tables.get((name, 0))
        if table is not None and column in table:
            x = columns(table, column)
            size = np.sqrt(np.sum(x**2, axis=1))
            return builder.stream(topic_stamps(table), size, "1", name, within=limits.THROTTLE, allow_nan=True)
    return None


def rpm_stream(builder: LogBuilder) -> Stream | None:
    """Rotor speeds (n, rotors) in rev/min."""
    table = builder.messages.tables.get(("esc_status", 0))
    if table is None:
        return None
    names = [f"esc[{k}].esc_rpm" for k in range(16) if f"esc[{k}].esc_rpm" in table]
    if not names:
        return None
    x = columns(table, *names)
    turning = x.any(axis=0)
    if not turning.any():
        return None
    return builder.stream(topic_stamps(table), x[:, turning], "rpm", "esc_status", within=limits.RPM)


def battery_stream(builder: LogBuilder) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A, NaN where not measured."""
    table = builder.messages.first("battery_status")
    if table is None or "voltage_v" not in table:
        return None
    x = columns(table, "voltage_v", "current_a")
    x[(x < 0) & (x >= -limits.VOLTAGE.high)] = np.nan  # -1: no current sensor
    return builder.battery(topic_stamps(table), x, "battery_status")


def acc_bias_stream(builder: LogBuilder) -> Stream | None:
    """Accelerometer bias (n, 3) in m/s^2 of the first EKF instance (``estimator_sensor_bias``, since 1.11)."""
    table = builder.messages.tables.get(("estimator_sensor_bias", 0))
    if table is None or "accel_bias" not in table:
        return None
    return builder.stream(
        topic_stamps(table),
        columns(table, "accel_bias"),
        "m/s^2",
        "estimator_sensor_bias",
        frame="FRD",
        within=limits.ACC_BIAS,
    )


POSE_TOPICS = ("vehicle_visual_odometry", "vehicle_mocap_odometry")
"""Topics with an attitude and a position that others measured."""


def is_px4(firmware: Firmware, messages: Messages) -> bool:
    """Whether PX4, or a fork that logs its topics, wrote a ULog; other programs write this format as well."""
    known = any(name in ("vehicle_status", "sensor_combined", "vehicle_attitude") for name, _ in messages.tables)
    return known or not firmware.name or "px4" in firmware.name.lower()


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """The flight in a PX4 ULog; ``imu`` and ``mag`` ask for an instance instead of the one that flew."""
    builder = LogBuilder(messages)
    values = parameters.boot_values(messages.params)
    nothing: tuple[Stamps, list[int], str] = (np.zeros(0, np.int64), [], "")
    when, units, source = builder.attempt("The choice of IMU", lambda: imus.selected_units(builder), nothing)
    flew = builder.attempt("The choice of IMU", lambda: inertial.longest_held(when, units), None)
    why = f"it flew ({source})" if source else "the only source of the voted unit"
    found = imus.imu_candidates(builder, values, 0 if flew is None else flew)
    chosen = inertial.best_per_unit(builder, found)
    if flew is None and len(chosen) > 1:
        flew, why = next((c.index for c in chosen if c.source == "sensor_combined"), None), "it is the voted unit"
    firmware = builder.attempt("The firmware", lambda: read_firmware(messages), Firmware(""))
    logging = Px4Logging(firmware.version, values) if is_px4(firmware, messages) else OtherLogging(firmware.name)
    position = inertial.choose_imu(builder, chosen, flew, why, imu, logging)
    begin = builder.attempt("The first time stamp", lambda: first_stamp(builder, chosen, position), 0)
    builder.t0_us = valid_stamp(begin)

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware, "")
    log.logging = logging
    log.imus = [inertial.build_imu(builder, c) for c in chosen]
    log.imu = position
    log.imu_that_flew = builder.attempt(source, lambda: builder.time_line(when, units, source), None)
    flying = None if position is None else log.imus[position]
    flew_line = log.imu_that_flew
    if flew_line is not None and len(flew_line.value) > 1 and flying is not None:
        if flying.gyro.source == "sensor_combined":
            builder.problem(
                "imu_switched",
                "warning",
                f"The autopilot changed its gyro ({' -> '.join(str(u) for u in flew_line.value[:6])}): "
                "sensor_combined jumps from one sensor to the other.",
                t=float(flew_line.t[1]),
                count=len(flew_line.value) - 1,
            )
    log.mags = builder.attempt("The magnetometer", lambda: sensors.magnetometers(builder, values), [])
    used = builder.attempt("The choice of compass", lambda: sensors.flown_compass(builder, log.mags), None)
    log.mag = builder.attempt(
        "The compass", lambda: compass.choose_mag(builder, log.mags, flying, used, "it flew", mag, logging), None
    )
    log.attitudes = attitudes(builder)
    log.onboard = "vehicle_attitude" if "vehicle_attitude" in log.attitudes else None
    truth = "vehicle_attitude_groundtruth"
    log.truth = builder.attempt(truth, lambda: read_attitude(builder, truth, 0, ()), None)
    log.parameters.lines = builder.attempt(
        "Parameters", lambda: parameters.parameter_lines(builder, messages.params, "parameter"), {}
    )
    log.parameters.defaults = parameters.logged_defaults(messages.params)
    log.parameters.declination, log.parameters.declination_source = parameters.declination(log, DECLINATION_PARAMETERS)
    fill_streams(builder, log)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def first_stamp(builder: LogBuilder, chosen: list[inertial.ImuCandidate], position: int | None) -> int:
    """The boot time in us that becomes t = 0: the replayed IMU's first sample, else the first sample of anything."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    for name in ("vehicle_attitude", "vehicle_status", "vehicle_gps_position"):
        table = builder.messages.tables.get((name, 0))
        if table is not None and "timestamp" in table:
            return int(np.median(topic_stamps(table)[:5]))
    first = [topic_stamps(t)[0] for t in builder.messages.tables.values() if "timestamp" in t and len(t)]
    return int(min(first)) if first else 0


def attitudes(builder: LogBuilder) -> dict[str, Attitude]:
    """Every attitude in the log: the published one, each EKF instance, and cameras or motion capture."""
    found: dict[str, Attitude] = {}
    switches = builder.attempt("estimator_selector_status", lambda: instance_changes(builder), ())
    for name in (
        "vehicle_attitude",
        "estimator_attitude",
        "vehicle_vision_attitude",
        "vehicle_visual_odometry",
        "vehicle_mocap_odometry",
    ):
        instances = builder.messages.instances(name)
        for i in instances:
            times = switches if name == "vehicle_attitude" else ()
            attitude = builder.attempt(name, partial(read_attitude, builder, name, i, times), None)
            if attitude is not None and name in POSE_TOPICS:
                attitude.position = builder.attempt(name, partial(read_positions, builder, name, i, attitude), None)
            if attitude is not None:
                single = name != "estimator_attitude" and i == 0
                found[name if single else f"{name}.{i}"] = attitude
    return found


def read_positions(builder: LogBuilder, name: str, instance: int, attitude: Attitude) -> Array | None:
    """Where a pose was (n, 3) m at the times of its attitude, in axes of its own; None where the topic does not say."""
    table = builder.messages[name, instance]
    names = ("position",) if "position" in table else ("x", "y", "z")
    if not all(column in table for column in names):
        return None
    return builder.positions(topic_stamps(table), columns(table, *names), attitude.t)


def read_attitude(builder: LogBuilder, name: str, instance: int, switches_us: tuple[int, ...]) -> Attitude | None:
    """One attitude topic, None if the log has none; resets come from its counter and from instance switches."""
    table = builder.messages.tables.get((name, instance))
    if table is None or "q" not in table:
        return None
    source = name if instance == 0 and name != "estimator_attitude" else f"{name}:{instance}"
    return builder.attitude(
        topic_stamps(table),
        columns(table, "q"),
        source,
        t_sample_us=sample_stamps(table),
        counter=table["quat_reset_counter"] if "quat_reset_counter" in table else None,
        reset_times_us=switches_us,
    )


def instance_changes(builder: LogBuilder) -> tuple[int, ...]:
    """Boot times in us at which another EKF instance took over."""
    table = builder.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return ()
    t, primary = topic_stamps(table), table["primary_instance"].astype(np.int64)
    at = np.flatnonzero(np.diff(primary)) + 1
    if "last_instance_change" in table:
        t = np.where(table["last_instance_change"] > 0, topic_stamps(table, "last_instance_change"), t)
    if len(at):
        builder.problem(
            "estimator_instance_changed",
            "note",
            "The autopilot changed its estimator instance "
            + ", ".join(f"from {primary[i - 1]} to {primary[i]}" for i in at[:5])
            + ": the onboard attitude steps there.",
            count=len(at),
        )
    return tuple(int(t[i]) for i in at)
