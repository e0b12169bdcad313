"""Everything of a PX4 log that is neither inertial, magnetic nor an attitude."""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight import physics, receiver
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.clock.timing import only_new
from attlog.flight.model import Array, Attitude, Firmware, FlightLog, Gnss, Stream, TimeLine
from attlog.flight.modes import px4_mode
from attlog.flight.px4 import clipping, events, gyro_bias, remedies, vibration, yaw_estimator
from attlog.flight.px4.imus import stamps
from attlog.flight.vehicle import PX4_TYPES, named
from attlog.formats.base import Messages, Table

DECLINATION = {"EKF2_MAG_DECL": 1.0, "ATT_MAG_DECL": 1.0}
"""Parameters of the declination and their factor to degrees, those of the newer estimator first."""
RELEASE_TYPES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}
ARMED = 2
"""``vehicle_status.arming_state`` of an armed vehicle, the same in all versions."""


def firmware(messages: Messages) -> Firmware:
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


def fill(builder: LogBuilder, log: FlightLog) -> None:
    """Add set-points, states, aids and texts to the log."""
    status = builder.messages.tables.get(("vehicle_status", 0))
    log.vehicle = builder.attempt("The vehicle", lambda: vehicle(status, log.param("MAV_TYPE")), "unknown")
    log.simulated = builder.attempt("The simulator", lambda: simulated(builder, status), False)
    log.setpoints = builder.attempt("The attitude set-point", lambda: setpoints(builder), None)
    log.rate_setpoints = builder.attempt("The rate set-point", lambda: rate_setpoints(builder), None)
    log.armed = builder.attempt("Arming", lambda: armed(builder, status), None)
    log.mode = builder.attempt("The flight mode", lambda: mode(builder, status), None)
    log.landed = builder.attempt("The land detector", lambda: landed(builder), None)
    log.gnss = builder.attempt("GNSS", lambda: gnss(builder), [])
    log.utc_offset = builder.attempt("The date", lambda: utc_offset(log.gnss), None)
    log.baro = builder.attempt("The barometer", lambda: baro(builder), [])
    log.rangefinder = builder.attempt("The rangefinder", lambda: rangefinder(builder), None)
    log.airspeed = builder.attempt("Airspeed", lambda: airspeed(builder), None)
    log.throttle = builder.attempt("Throttle", lambda: throttle(builder), None)
    log.rpm = builder.attempt("Rotor speed", lambda: rpm(builder), None)
    log.battery = builder.attempt("The battery", lambda: battery(builder), None)
    log.acc_bias = builder.attempt("estimator_sensor_bias", lambda: acc_bias(builder), None)
    log.onboard_gyro_bias = builder.attempt(
        "The onboard gyro bias", lambda: gyro_bias.gyro_bias(builder, log.replay_imu), None
    )
    log.yaw_estimator = builder.attempt("The yaw estimator", lambda: yaw_estimator.yaw_estimator(builder), None)
    log.clippings = builder.attempt("Clipping", lambda: clipping.clippings(builder), [])
    log.vibrations = builder.attempt("The vibration metric", lambda: vibration.levels(builder), [])
    log.onboard_spectrum = builder.attempt("sensor_gyro_fft", lambda: vibration.spectrum(builder), None)
    log.innovation_tests = builder.attempt("Test ratios", lambda: events.innovation_tests(builder), [])
    log.lane = builder.attempt("The estimator's instance", lambda: events.lane(builder), None)
    events.report(builder)
    told = {n: v for n in log.params if (v := log.param(n)) is not None}
    compass = None if log.mag is None else log.mags[log.mag]
    log.remedies = builder.attempt("Remedies", lambda: remedies.of(told, compass), log.remedies)
    log.texts = builder.attempt("Texts", builder.texts, [])


def armed(builder: LogBuilder, status: Table | None) -> TimeLine | None:
    """Armed or not."""
    if status is not None and "arming_state" in status:
        return builder.time_line(stamps(status), (status["arming_state"] == ARMED).tolist(), "vehicle_status")
    table = builder.messages.tables.get(("actuator_armed", 0))
    if table is None or "armed" not in table:
        return None
    return builder.time_line(stamps(table), (table["armed"] != 0).tolist(), "actuator_armed")


def mode(builder: LogBuilder, status: Table | None) -> TimeLine | None:
    """Flight modes by name."""
    if status is None or "nav_state" not in status:
        return None
    return builder.time_line(stamps(status), [px4_mode(int(n)) for n in status["nav_state"]], "vehicle_status")


def landed(builder: LogBuilder) -> TimeLine | None:
    """On the ground or not, by the land detector."""
    table = builder.messages.tables.get(("vehicle_land_detected", 0))
    if table is None or "landed" not in table:
        return None
    return builder.time_line(stamps(table), (table["landed"] != 0).tolist(), "vehicle_land_detected")


def vehicle(status: Table | None, mav_type: float | None) -> str:
    """The kind of vehicle in words, by its status or the parameter MAV_TYPE, "unknown" if neither tells."""
    if status is not None and len(status):
        if "is_vtol" in status and status["is_vtol"].any():
            return "VTOL"
        if "system_type" in status:
            return named(int(status["system_type"][-1]))
        if mav_type is None and "vehicle_type" in status:
            return PX4_TYPES.get(int(status["vehicle_type"][-1]), "unknown")
    return "unknown" if mav_type is None else named(int(mav_type))


def simulated(builder: LogBuilder, status: Table | None) -> bool:
    """Whether the sensors were simulated (SITL or hardware in the loop)."""
    info = builder.messages.info
    board = f"{info.get('ver_hw', '')} {info.get('sys_mcu', '')}".upper()
    hil = status is not None and "hil_state" in status and bool((status["hil_state"] == 1).any())
    truth = ("vehicle_attitude_groundtruth", 0) in builder.messages.tables
    return hil or truth or "SITL" in board


def setpoints(builder: LogBuilder) -> Attitude | None:
    """The attitude set-point; old versions hold Euler angles beside or instead of ``q_d``."""
    table = builder.messages.tables.get(("vehicle_attitude_setpoint", 0))
    if table is None:
        return None
    q = columns(table, "q_d") if "q_d" in table else np.zeros((len(table), 4))
    unset = ~(np.abs(np.sum(q**2, axis=1) - 1.0) < 0.1)
    if unset.any() and "roll_body" in table:
        euler = columns(table, "roll_body", "pitch_body", "yaw_body")
        q = np.where(unset[:, None], rotation.from_euler(*euler.T), q)
        unset = ~rotation.finite(q)
    if unset.all():
        return None
    return builder.attitude(stamps(table)[~unset], q[~unset], "vehicle_attitude_setpoint")


def rate_setpoints(builder: LogBuilder) -> Stream | None:
    """The body rate set-point in rad/s."""
    table = builder.messages.tables.get(("vehicle_rates_setpoint", 0))
    if table is None or "roll" not in table:
        return None
    rates = columns(table, "roll", "pitch", "yaw")
    return builder.stream(
        stamps(table),
        rates,
        "rad/s",
        "vehicle_rates_setpoint",
        frame="FRD",
        within=physics.RATE_SETPOINT,
        allow_nan=True,
    )


RECEPTION = {
    "satellites": "satellites_used",
    "hdop": "hdop",
    "noise": "noise_per_ms",
    "jamming": "jamming_indicator",
    "jamming_state": "jamming_state",
    "spoofing_state": "spoofing_state",
}


def gnss(builder: LogBuilder) -> list[Gnss]:
    """Receivers: ``vehicle_gps_position`` or ``sensor_gps``, whichever was logged faster."""
    messages = builder.messages
    counts = {
        n: max((len(messages[n, i]) for i in messages.instances(n)), default=0)
        for n in ("vehicle_gps_position", "sensor_gps")
    }
    name = max(counts, key=lambda n: counts[n])
    if counts[name] == 0:
        return []
    return [g for g in (one_receiver(builder, name, i) for i in messages.instances(name)) if g is not None]


def one_receiver(builder: LogBuilder, name: str, instance: int) -> Gnss | None:
    """One receiver; positions are 1e-7 deg integers (mm) before 1.15 and double degrees (m) since."""
    table = builder.messages[name, instance]
    t_us = stamps(table)
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
    return receiver.build(
        builder,
        instance,
        t_us,
        source,
        place=place,
        velocity=velocity,
        fix=fix,
        accuracy=(accuracy(table, "eph"), accuracy(table, "epv"), accuracy(table, "s_variance_m_s")),
        yaw=columns(table, "heading")[:, 0] if "heading" in table else None,
        utc_us=table["time_utc_usec"].astype(np.int64) if "time_utc_usec" in table else None,
        reception={name: accuracy(table, column) for name, column in RECEPTION.items()},
    )


def accuracy(table: Table, column: str) -> Array:
    """An accuracy column, NaN where the topic has none."""
    return table.value(column) if column in table else np.full(len(table), np.nan)


def utc_offset(receivers: list[Gnss]) -> float | None:
    """Seconds that turn the log's clock into Unix time, from GNSS with a fix; None if it never told."""
    for one in receivers:
        if one.utc_us is None:
            continue
        good = (one.utc_us > 0) & (one.fix >= receiver.FIX)
        if good.any():
            return float(np.median(one.utc_us[good] * 1e-6 - one.t[good]))
    return None


def baro(builder: LogBuilder) -> list[Stream]:
    """Barometric altitude in m."""
    for name in ("vehicle_air_data", "sensor_combined", "sensor_baro"):
        column = "altitude" if name == "sensor_baro" else "baro_alt_meter"
        tables = [builder.messages[name, i] for i in builder.messages.instances(name)]
        tables = [t for t in tables if column in t]
        if not tables:
            continue
        found = []
        for table in tables:
            t, x = stamps(table), table.value(column)
            if name == "sensor_combined":
                new = only_new(x, t)
                t, x = t[new], x[new]
            found.append(builder.stream(t, x, "m", f"{name}:{table.instance}", within=physics.BARO))
        return [f for f in found if f is not None]
    return []


DOWNWARD = 25
"""MAV_SENSOR_ROTATION_PITCH_270: the rangefinder looks at the ground."""


def rangefinder(builder: LogBuilder) -> Stream | None:
    """Distance (n, 1) in m of the first downward rangefinder, readings out of its range left out."""
    for instance in builder.messages.instances("distance_sensor"):
        table = builder.messages["distance_sensor", instance]
        if "current_distance" not in table or len(table) < 2:
            continue
        if "orientation" in table and not (table["orientation"] == DOWNWARD).all():
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
        return own.stream(stamps(table)[good], x[good], "m", source, within=physics.RANGE)
    return None


def airspeed(builder: LogBuilder) -> Stream | None:
    """True airspeed in m/s."""
    for name in ("airspeed_validated", "airspeed"):
        table = builder.messages.tables.get((name, 0))
        if table is not None and "true_airspeed_m_s" in table:
            stream = builder.stream(
                stamps(table), table.value("true_airspeed_m_s"), "m/s", name, within=physics.AIRSPEED, allow_nan=True
            )
            if stream is not None:
                return stream
    return None


def throttle(builder: LogBuilder) -> Stream | None:
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
            return builder.stream(stamps(table), size, "1", name, within=physics.THROTTLE, allow_nan=True)
    return None


def rpm(builder: LogBuilder) -> Stream | None:
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
    return builder.stream(stamps(table), x[:, turning], "rpm", "esc_status", within=physics.RPM)


def battery(builder: LogBuilder) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A, NaN where not measured."""
    table = builder.messages.first("battery_status")
    if table is None or "voltage_v" not in table:
        return None
    x = columns(table, "voltage_v", "current_a")
    x[(x < 0) & (x >= -physics.VOLTAGE.high)] = np.nan  # -1: no current sensor
    return builder.battery(stamps(table), x, "battery_status")


def acc_bias(builder: LogBuilder) -> Stream | None:
    """Accelerometer bias (n, 3) in m/s^2 of the first EKF instance (``estimator_sensor_bias``, since 1.11)."""
    table = builder.messages.tables.get(("estimator_sensor_bias", 0))
    if table is None or "accel_bias" not in table:
        return None
    return builder.stream(
        stamps(table),
        columns(table, "accel_bias"),
        "m/s^2",
        "estimator_sensor_bias",
        frame="FRD",
        within=physics.ACC_BIAS,
    )
