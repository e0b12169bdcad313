"""PX4's sdlog2 logs of 2013 to 2016 (``.px4log``) as a FlightLog.

All records between two TIME records share that time. IMU, IMU1, IMU2 are sensors in
the body frame; ATT holds Euler angles in rad and, in later versions, a quaternion
that some of them left at zero.
"""

from __future__ import annotations

import numpy as np

from attlog.core import rotation
from attlog.flight import compass, gnss, limits, parameters
from attlog.flight import imu as inertial
from attlog.flight.advice import Sdlog2Logging
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.limits import Quantity
from attlog.flight.model import Array, Attitude, Firmware, FlightLog, Gnss, Mag, Stream
from attlog.flight.px4.reader import ARMED_STATE, DECLINATION_PARAMETERS, utc_offset
from attlog.flight.timestamps import Stamps, changed_records, read_stamps, valid_stamp
from attlog.flight.vehicle import px4_mode, vehicle_name
from attlog.formats.sdlog2 import TIME
from attlog.formats.table import Messages, Table

UNITS = (("IMU", 0), ("IMU1", 1), ("IMU2", 2))


def stamps(table: Table) -> Stamps:
    """Boot times (n,) in us; records before the first TIME record get a negative one and are left out."""
    return read_stamps(table, TIME)


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """The flight in an sdlog2 log; ``imu`` and ``mag`` ask for a unit."""
    builder = LogBuilder(messages)
    chosen = inertial.best_per_unit(builder, builder.attempt("IMU", lambda: candidates(builder), []))
    values = parameters.boot_values(messages.params)
    logging = Sdlog2Logging(values)
    position = inertial.choose_imu(builder, chosen, 0, "the first one, which the estimator used", imu, logging)
    clock = messages.first("TIME")
    begin = int(chosen[position or 0].t_us[0]) if chosen else 0
    if not chosen and clock:
        begin = builder.attempt("TIME", lambda: int(read_stamps(clock, "StartTime")[0]), 0)
    builder.t0_us = valid_stamp(begin)

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware(messages), "")
    log.vehicle = vehicle_name(int(values.get("MAV_TYPE", -1)))
    log.logging = logging
    log.imus = [inertial.build_imu(builder, c) for c in chosen]
    log.imu = position
    log.mags = builder.attempt("The magnetometer", lambda: magnetometers(builder), [])
    flying = None if position is None else log.imus[position]
    log.mag = builder.attempt(
        "The compass", lambda: compass.choose_mag(builder, log.mags, flying, 0, "the first one", mag, logging), None
    )
    attitude = builder.attempt("ATT", lambda: euler_or_quaternion(builder, "ATT", ("Roll", "Pitch", "Yaw")), None)
    if attitude is not None:
        log.attitudes, log.onboard = {"ATT": attitude}, "ATT"
    wanted = ("RollSP", "PitchSP", "YawSP")
    log.setpoints = builder.attempt("ATSP", lambda: euler_or_quaternion(builder, "ATSP", wanted), None)
    builder.attempt("STAT", lambda: states(builder, log), None)
    aids(builder, log)
    log.params = builder.attempt("PARM", lambda: parameters.parameter_lines(builder, messages.params, "PARM"), {})
    log.declination_param, log.declination_source = parameters.declination(log, DECLINATION_PARAMETERS)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def firmware(messages: Messages) -> Firmware:
    """PX4 of the sdlog2 time; the log tells board and git hash, no version."""
    own = messages.info.get("VER")
    told = own if isinstance(own, dict) else {}
    return Firmware("PX4", "", str(told.get("FwGit", "")), str(told.get("Arch", "")))


def candidates(builder: LogBuilder) -> list[inertial.ImuCandidate]:
    """Every inertial record type, cleaned."""
    found = []
    for name, unit in UNITS:
        table = builder.messages.first(name)
        if table is None or "GyroX" not in table or "AccX" not in table:
            continue
        gyro, acc = columns(table, "GyroX", "GyroY", "GyroZ"), columns(table, "AccX", "AccY", "AccZ")
        if unit and not gyro.any() and not acc.any():
            continue  # a board without a second sensor logs zeros
        one = inertial.validate_candidate(
            builder,
            inertial.ImuCandidate(
                unit,
                0,
                stamps(table),
                gyro,
                acc,
                name,
                "instant",
                temperature=table.value("tG") if "tG" in table else None,
            ),
        )
        found += [one] if one is not None else []
    return found


def magnetometers(builder: LogBuilder) -> list[Mag]:
    """The magnetometer beside each IMU (gauss, calibrated); only records with a new value."""
    found = []
    for name, unit in UNITS:
        table = builder.messages.first(name)
        if table is None or "MagX" not in table:
            continue
        field = columns(table, "MagX", "MagY", "MagZ") * compass.GAUSS
        if unit and not field.any():
            continue
        new = changed_records(field, stamps(table))
        mag = compass.build_mag(builder, unit, stamps(table)[new], field[new], name)
        found += [mag] if mag is not None else []
    return found


def euler_or_quaternion(builder: LogBuilder, name: str, angles: tuple[str, str, str]) -> Attitude | None:
    """An attitude record: its quaternion where it is one, else the Euler angles in rad."""
    table = builder.messages.first(name)
    if table is None or not all(a in table for a in angles):
        return None
    euler = columns(table, *angles)
    q = columns(table, "qw", "qx", "qy", "qz") if "qw" in table else np.zeros((len(table), 4))
    with np.errstate(invalid="ignore"):
        unset = ~(np.sum(q**2, axis=1) > 0.25)
        sane = (np.abs(euler) < 10.0).all(axis=1)
    q[unset & sane] = rotation.from_euler(*euler[unset & sane].T)
    q[unset & ~sane] = np.nan
    return builder.attitude(stamps(table), q, name)


def states(builder: LogBuilder, log: FlightLog) -> None:
    """Add arming, landing and modes to the log."""
    status = builder.messages.first("STAT")
    if status is None:
        return
    t = stamps(status)
    arm = next((c for c in ("ArmS", "ArmState") if c in status), None)
    if arm is not None:
        log.armed = builder.time_line(t, (status[arm] == ARMED_STATE).tolist(), "STAT")
    if "Landed" in status:
        log.landed = builder.time_line(t, (status["Landed"] != 0).tolist(), "STAT")
    if "MainState" in status:
        log.mode = builder.time_line(t, [px4_mode(int(m)) for m in status["MainState"]], "STAT")


def aids(builder: LogBuilder, log: FlightLog) -> None:
    """Add GNSS, barometer, battery, throttle and rate set-points to the log."""
    one = builder.attempt("GPS", lambda: one_receiver(builder), None)
    log.gnss = [] if one is None else [one]
    log.utc_offset = builder.attempt("The date", lambda: utc_offset(log.gnss), None)
    altitude = column(builder, "SENS", ("BaroAlt",), "m", limits.BARO)
    log.baro = [] if altitude is None else [altitude]
    log.battery = builder.attempt("BATT", lambda: battery(builder), None)
    log.throttle = column(builder, "ATTC", ("Thrust",), "1", limits.THROTTLE)
    log.rate_setpoints = column(
        builder, "ARSP", ("RollRateSP", "PitchRateSP", "YawRateSP"), "rad/s", limits.RATE_SETPOINT
    )


def column(builder: LogBuilder, name: str, names: tuple[str, ...], unit: str, within: Quantity) -> Stream | None:
    """A stream of some columns, None where the log has none."""
    table = builder.messages.first(name)
    if table is None or not all(n in table for n in names):
        return None
    return builder.attempt(
        name,
        lambda: builder.stream(stamps(table), columns(table, *names), unit, name, within=within, allow_nan=True),
        None,
    )


def battery(builder: LogBuilder) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A."""
    table = builder.messages.first("BATT")
    if table is None or not all(n in table for n in ("V", "C")):
        return None
    return builder.battery(stamps(table), columns(table, "V", "C"), "BATT")


def one_receiver(builder: LogBuilder) -> Gnss | None:
    """The GNSS receiver."""
    table = builder.messages.first("GPS")
    if table is None or "GPSTime" not in table:
        return None
    t_us = stamps(table)
    place: Array = columns(table, "Lat", "Lon", "Alt")
    return gnss.build_gnss(
        builder,
        0,
        t_us,
        "GPS",
        place=place,
        velocity=columns(table, "VelN", "VelE", "VelD"),
        fix=table["Fix"].astype(np.int64),
        accuracy=(table.value("EPH"), table.value("EPV"), np.full(len(table), np.nan)),
        utc_us=table["GPSTime"].astype(np.int64),
    )
