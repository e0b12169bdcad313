"""Everything of an ArduPilot log that is neither inertial, magnetic nor an attitude, put into its FlightLog."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from attlog.flight import physics
from attlog.flight.ardupilot import ekf, events, phases, power, receivers, remedies, vehicle, vibration
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.ardupilot.imus import units
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, FlightLog, Imu, Stream
from attlog.flight.px4.state import utc_offset

DECLINATION = {"COMPASS_DEC": math.degrees(1.0)}
"""The parameter of the declination and its factor to degrees."""
TRIM = ("AHRS_TRIM_X", "AHRS_TRIM_Y")


def trim(log: FlightLog) -> Array | None:
    """AHRS_TRIM as a rotation vector (3,) in rad; None where the log does not hold it."""
    x, y = (log.param(name) for name in TRIM)
    if x is None or y is None or not (math.isfinite(x) and math.isfinite(y)):
        return None
    return np.array([x, y, 0.0])


def fill(builder: LogBuilder, clock: Clock, log: FlightLog, values: dict[str, float]) -> None:
    """Add states, aids and texts to the log."""
    messages = builder.messages
    family = builder.attempt("The vehicle", lambda: vehicle.family_of(messages, values), "")
    imu = None if log.imu is None else log.imus[log.imu]
    log.vehicle = builder.attempt("The vehicle", lambda: vehicle.vehicle(messages, values, family), "unknown")
    log.simulated = "SIM" in messages.names() or any(n.startswith("SIM_") for n in values)
    log.armed = builder.attempt("Arming", lambda: phases.armed(builder, clock), None)
    log.landed = builder.attempt("Landing", lambda: phases.landed(builder, clock, log.armed), None)
    log.mode = builder.attempt("The flight mode", lambda: phases.mode(builder, clock, family), None)
    log.rate_setpoints = builder.attempt("The rate set-point", lambda: rate_setpoints(builder, clock, imu), None)
    for unit, table in units(messages, "GPS").items():
        one = builder.attempt("GPS", partial(receivers.one_receiver, builder, clock, unit, table), None)
        log.gnss += [] if one is None else [one]
    if not log.gnss:
        log.gnss = builder.attempt("RGPJ", lambda: receivers.replay_receivers(builder), [])
    log.utc_offset = builder.attempt("The date", lambda: utc_offset(log.gnss), None)
    log.baro = builder.attempt("BARO", lambda: baro(builder, clock), [])
    log.rangefinder = builder.attempt("The rangefinder", lambda: rangefinder(builder, clock), None)
    log.airspeed = builder.attempt("ARSP", lambda: airspeed(builder, clock), None)
    log.throttle = builder.attempt("Throttle", lambda: power.throttle(builder, clock, family), None)
    log.motors = builder.attempt("Motor outputs", lambda: power.motors(builder, clock, log.vehicle, values), None)
    log.rpm = builder.attempt("Rotor speed", lambda: power.rpm(builder, clock), None)
    log.battery = builder.attempt("The battery", lambda: power.battery(builder, clock), None)
    log.acc_bias = builder.attempt("XKF2", lambda: acc_bias(builder, clock), None)
    log.onboard_gyro_bias = builder.attempt(
        "The onboard gyro bias", lambda: ekf.gyro_bias(builder, clock, values, imu), None
    )
    log.onboard_vibration = builder.attempt("VIBE", lambda: vibration.level(builder, clock, imu), None)
    log.vibrations = builder.attempt("VIBE", lambda: vibration.levels(builder, clock), [])
    log.bursts = builder.attempt("ISBH and ISBD", lambda: vibration.bursts(builder, values), [])
    log.yaw_estimator = builder.attempt("The yaw estimator", lambda: ekf.yaw_estimator(builder, clock, values), None)
    log.clippings = builder.attempt("Clipping", lambda: vibration.clippings(builder, clock), [])
    log.innovation_tests = builder.attempt("Test ratios", lambda: ekf.innovation_tests(builder, clock, values), [])
    log.lane = builder.attempt("The EKF's core", lambda: ekf.lane(builder, clock, values), None)
    builder.attempt("ERR and EV", lambda: events.report(builder, clock), None)
    compass = 0 if log.mag is None else log.mags[log.mag].index
    log.remedies = builder.attempt("Remedies", lambda: remedies.of(values, compass), log.remedies)
    log.compass_switches = remedies.compass_switches(values)
    log.compass_first = remedies.compass_first(values)
    log.texts = builder.attempt("Texts", lambda: builder.texts(lambda offset: int(clock.at(np.array([offset]))[0])), [])


def rate_setpoints(builder: LogBuilder, clock: Clock, imu: Imu | None) -> Stream | None:
    """The body rate set-point in rad/s.

    RATE holds deg/s since 3.4 and hundredths of it before, in columns of the same
    name: the measured rate beside the set-point, against the gyro, tells which.
    """
    table = builder.messages.first("RATE")
    if table is None:
        return None
    for wanted, measured in (
        (("RDes", "PDes", "YDes"), ("R", "P", "Y")),
        (("RllDes", "PitDes", "YawDes"), ("Rll", "Pit", "Yaw")),
    ):
        if not all(c in table for c in (*wanted, *measured)):
            continue
        t = clock.of(table)
        scale = np.pi / 180.0
        if imu is not None and hundredths(builder.seconds(t), columns(table, *measured), imu):
            scale *= 0.01
        return builder.stream(
            t, columns(table, *wanted) * scale, "rad/s", "RATE", frame="FRD", within=physics.RATE_SETPOINT
        )
    return None


def hundredths(t: Array, measured: Array, imu: Imu) -> bool:
    """Whether measured rates (n, 3) fit the gyro better as 0.01 deg/s than as deg/s."""
    gyro = np.column_stack([np.interp(t, imu.gyro.t, imu.gyro.x[:, k]) for k in range(3)])
    known = measured[np.isfinite(measured)]
    if len(known) == 0:
        return False
    spread = np.median(np.abs(np.radians(known))), np.median(np.abs(gyro))
    return bool(spread[0] > 10.0 * spread[1] and spread[1] > 0)


def baro(builder: LogBuilder, clock: Clock) -> list[Stream]:
    """Barometric altitude in m above the take-off pressure: BARO.Alt, in 3.2 and older CTUN.BarAlt."""
    tables = units(builder.messages, "BARO")
    control = builder.messages.first("CTUN")
    if not tables and control is not None and "BarAlt" in control and (t := clock.of_samples(control)) is not None:
        one = builder.stream(t, control.value("BarAlt"), "m", "CTUN.BarAlt", within=physics.BARO)
        return [] if one is None else [one]
    for extra in (2, 3):
        table = builder.messages.first(f"BAR{extra}")
        if table is not None:
            tables.setdefault(extra - 1, table)
    found = [
        builder.stream(clock.of(t), t.value("Alt"), "m", f"BARO:{unit}", within=physics.BARO)
        for unit, t in sorted(tables.items())
        if "Alt" in t
    ]
    return [f for f in found if f is not None]


DOWNWARD, RANGE_GOOD = 25, 4
"""RFND.Orient of a rangefinder that looks at the ground, RFND.Stat of a reading within its range."""


def rangefinder(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Distance (n, 1) in m of the downward rangefinder (RFND, else CTUN), readings out of range left out."""
    for name, columns_of in (("RFND", ("Dist", "Dist1")), ("CTUN", ("SAlt", "SonAlt"))):
        for table in units(builder.messages, name).values():
            column = next((c for c in columns_of if c in table), None)
            if column is None or clock.of_samples(table) is None:
                continue
            x = table.value(column).astype(np.float64)
            good = np.isfinite(x) & (x > 0)
            if "Stat" in table:
                good &= table["Stat"] == RANGE_GOOD
            orient = next((c for c in ("Orient", "Orient1") if c in table), None)
            if orient is not None:
                good &= table[orient] == DOWNWARD
            if np.count_nonzero(good) > 1:
                own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # nothing to report of what only tells flight
                return own.stream(clock.of(table)[good], x[good], "m", f"{name}.{column}", within=physics.RANGE)
    return None


SEA_LEVEL_PA, DENSITY_EXPONENT = 101_325.0, 0.81
"""Standard atmosphere: pressure at sea level, and (density) = (pressure)^0.81, both relative to sea level."""


def airspeed(builder: LogBuilder, clock: Clock) -> Stream | None:
    """True airspeed in m/s of the primary sensor while it is sound and in use; ARSP tells the equivalent one."""
    tables = units(builder.messages, "ARSP")
    primary = next((int(t["Pri"][-1]) for t in tables.values() if "Pri" in t and len(t)), 0)
    table = tables.get(primary, next(iter(tables.values()), None))
    if table is None or "Airspeed" not in table or clock.of_samples(table) is None:
        return None
    t, x = clock.of(table), table.value("Airspeed").astype(np.float64)
    good = np.ones(len(t), bool)
    for flag in ("H", "U"):
        good &= table[flag] > 0 if flag in table else True
    baro = units(builder.messages, "BARO").get(0)
    if baro is not None and "Press" in baro and clock.of_samples(baro) is not None:
        pressure = np.interp(t, clock.of(baro), baro.value("Press").astype(np.float64))
        thin = np.where(pressure > 0.0, pressure, SEA_LEVEL_PA) / SEA_LEVEL_PA
        x = x * thin ** (-0.5 * DENSITY_EXPONENT)
    return builder.stream(t[good], x[good], "m/s", "ARSP", within=physics.AIRSPEED)


def acc_bias(builder: LogBuilder, clock: Clock) -> Stream | None:
    """Accelerometer bias (n, 3) in m/s^2 of EKF3's primary core (XKF2 of XKF4.PI; the first where that is unknown)."""
    status = builder.messages.first("XKF4")
    core = int(np.median(status["PI"])) if status is not None and "PI" in status and len(status) else 0
    table = units(builder.messages, "XKF2").get(core)
    if table is None or not all(c in table for c in ("AX", "AY", "AZ")):
        return None
    return builder.stream(
        clock.of(table), columns(table, "AX", "AY", "AZ"), "m/s^2", "XKF2", frame="FRD", within=physics.ACC_BIAS
    )
