"""MAVLink telemetry (tlog, raw stream) of ArduPilot and PX4 as a FlightLog.

Message clocks are used throughout. ArduPilot's RAW_IMU and SCALED_IMU* are
calibrated, in the body frame and cut to 1 mrad/s and 1 mg; PX4 sends HIGHRES_IMU in
SI units.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from attlog.base import rotation
from attlog.base.errors import LogUnusable, UsageError
from attlog.flight import inertial, magnetic
from attlog.flight.ardupilot import state as ardupilot
from attlog.flight.ardupilot.imus import cutoffs
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.clock.timing import on_a_clock, only_new
from attlog.flight.inertial import low_pass_delay
from attlog.flight.mavlink import state
from attlog.flight.mavlink.advice import TelemetryLogging
from attlog.flight.mavlink.clock import PacketClock
from attlog.flight.model import Array, Attitude, Firmware, FlightLog, Mag
from attlog.flight.parameters import history as parameters
from attlog.flight.px4 import state as px4
from attlog.formats.base import Messages, Table

ARDUPILOT, PX4 = 3, 12
STANDARD_GRAVITY = 9.80665
"""m/s^2 per g of the accelerations in mg."""
MILLIGAUSS = 1e-7


def of_system(messages: Messages, path: Path, system: int | None) -> tuple[Messages, int]:
    """The messages with the vehicle's parameters and texts, and the instance of its autopilot.

    UsageError if the system asked for is not in the file, LogUnusable if none flies.
    """
    systems = messages.info.get("systems", {})
    if system is not None and system not in systems:
        raise UsageError(f"{path}: there is no system {system}; the file holds {', '.join(map(str, systems))}")
    chosen = messages.info.get("system")
    if chosen is None:
        raise LogUnusable(f"{path}: no vehicle in this MAVLink file: no heartbeat and no attitude of an autopilot")
    component = systems.get(chosen, {}).get("component")
    if component is None:
        senders = [i & 0xFF for n, i in messages.tables if i >> 8 == chosen and n in ("ATTITUDE", "RAW_IMU")]
        component = min(senders, default=1)
    return messages, chosen * 256 + component


def read(messages: Messages, imu: int | None, mag: int | str | None, system: int | None) -> FlightLog:
    """The flight of one vehicle in a MAVLink file; ``imu`` and ``mag`` ask for a unit."""
    messages, instance = of_system(messages, messages.path, system)
    builder = LogBuilder(messages)
    clock = PacketClock(messages, instance)
    autopilot = messages.info.get("systems", {}).get(instance >> 8, {}).get("autopilot")
    others = [
        s for s, d in messages.info.get("systems", {}).items() if d["autopilot"] is not None and s != instance >> 8
    ]
    if others:
        builder.problem(
            "several_systems",
            "note",
            f"The file holds {len(others) + 1} vehicles; this is system {instance >> 8}. --system chooses another "
            f"({', '.join(map(str, others))}).",
            count=len(others) + 1,
        )
    found = builder.attempt("The inertial messages", lambda: candidates(builder, clock, instance, autopilot), [])
    chosen = inertial.best_per_unit(builder, found)
    nobody = Firmware("unknown autopilot")
    firmware = builder.attempt("The firmware", lambda: state.firmware(messages, instance, autopilot), nobody)
    logging = TelemetryLogging(firmware.name)
    position = inertial.choose_unit(builder, chosen, 0, "the first one", imu, logging)
    builder.t0_us = on_a_clock(first_stamp(clock, chosen, position))

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware, "")
    log.logging = logging
    log.imus = [inertial.build(builder, c) for c in chosen]
    log.imu = position
    flying = None if position is None else log.imus[position]
    log.mags = builder.attempt("The magnetometer", lambda: magnetometers(builder, clock, instance), [])
    log.mag = builder.attempt(
        "The compass", lambda: magnetic.choose(builder, log.mags, flying, 0, "the first one", mag, logging), None
    )
    log.attitudes = builder.attempt(
        "The attitude", lambda: attitudes(builder, clock, instance, autopilot == ARDUPILOT), {}
    )
    log.onboard = next((n for n in ("ATTITUDE_QUATERNION", "ATTITUDE", "AHRS2") if n in log.attitudes), None)
    log.truth = builder.attempt("The simulator's attitude", lambda: truth(builder, clock, instance), None)
    log.params = builder.attempt(
        "PARAM_VALUE", lambda: parameters.time_lines(builder, messages.params, "PARAM_VALUE"), {}
    )
    of_parameters(log, autopilot)
    state.fill(builder, clock, instance, autopilot, log)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def of_parameters(log: FlightLog, autopilot: int | None) -> None:
    """Add what the autopilot's parameters tell of trim and declination."""
    names = px4.DECLINATION if autopilot == PX4 else ardupilot.DECLINATION
    log.declination_param, log.declination_source = parameters.declination(log, names)
    if autopilot == ARDUPILOT:
        log.trim, log.trim_source = ardupilot.trim(log), ", ".join(ardupilot.TRIM)


def first_stamp(clock: PacketClock, chosen: list[inertial.ImuCandidate], position: int | None) -> int:
    """The boot time in us that becomes t = 0."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    return int(clock.boot[0]) if len(clock.boot) else 0


# --- sensors ----------------------------------------------------------------------------------------------------


def candidates(
    builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None
) -> list[inertial.ImuCandidate]:
    """Every inertial message, cleaned: HIGHRES_IMU (SI), RAW_IMU of ArduPilot, SCALED_IMU, _IMU2, _IMU3."""
    gyro_cut, acc_cut = cutoffs(builder.messages.params, 0) if autopilot == ARDUPILOT else (0.0, 0.0)
    found = []
    for unit, rank, name in (
        (0, 0, "HIGHRES_IMU"),
        (0, 1, "RAW_IMU"),
        (0, 2, "SCALED_IMU"),
        (1, 2, "SCALED_IMU2"),
        (2, 2, "SCALED_IMU3"),
    ):
        table = builder.messages.tables.get((name, instance))
        if table is None or (name == "RAW_IMU" and autopilot == PX4):
            continue  # PX4's RAW_IMU is in units of the sensor
        gyro, acc = columns(table, "xgyro", "ygyro", "zgyro"), columns(table, "xacc", "yacc", "zacc")
        if name != "HIGHRES_IMU":
            gyro, acc = gyro * 1e-3, acc * 1e-3 * STANDARD_GRAVITY
        if np.mean((gyro != 0).any(axis=1) | (acc != 0).any(axis=1)) < 0.01:
            builder.problem(
                "imu_all_zero",
                "note" if unit else "error",
                f"{name}: its gyro and accelerometer values are zero; this unit is not used.",
            )
            continue
        one = inertial.validate(
            builder,
            inertial.ImuCandidate(
                unit,
                rank,
                clock.of(table),
                gyro,
                acc,
                name,
                "instant",
                filtered=f"low-pass {gyro_cut:.0f} Hz" if gyro_cut else "unknown",
                gyro_delay=low_pass_delay(gyro_cut),
                acc_delay=low_pass_delay(acc_cut),
                note="" if name == "HIGHRES_IMU" else "steps of 0.057 deg/s and 0.0098 m/s^2",
            ),
        )
        found += [one] if one is not None else []
    return found


def magnetometers(builder: LogBuilder, clock: PacketClock, instance: int) -> list[Mag]:
    """Every compass that the inertial messages carry; only records with a new value."""
    found: list[Mag] = []
    for unit, name in ((0, "HIGHRES_IMU"), (0, "RAW_IMU"), (0, "SCALED_IMU"), (1, "SCALED_IMU2"), (2, "SCALED_IMU3")):
        table = builder.messages.tables.get((name, instance))
        if table is None or any(m.index == unit for m in found):
            continue
        scale = magnetic.GAUSS if name == "HIGHRES_IMU" else MILLIGAUSS
        field, t = columns(table, "xmag", "ymag", "zmag") * scale, clock.of(table)
        if unit and not field.any():
            continue  # a unit without compass sends zeros
        new = only_new(field, t)
        mag = magnetic.build(builder, unit, t[new], field[new], name)
        found += [mag] if mag is not None else []
    return found


# --- attitude ---------------------------------------------------------------------------------------------------


def attitudes(builder: LogBuilder, clock: PacketClock, instance: int, trimmed: bool) -> dict[str, Attitude]:
    """Every attitude message by name; AHRS2 and AHRS3 carry no time and get that of their packets."""
    found = {}
    for name in ("ATTITUDE_QUATERNION", "ATTITUDE", "AHRS2", "AHRS3"):
        table = builder.messages.tables.get((name, instance))
        attitude = (
            None if table is None else builder.attitude(clock.of(table), quaternions(table), name, has_trim=trimmed)
        )
        if attitude is not None:
            found[name] = attitude
    return found


def quaternions(table: Table) -> Array:
    """Quaternions (n, 4) of a message that holds q1..q4 or Euler angles in rad."""
    if "q1" in table:
        return columns(table, "q1", "q2", "q3", "q4")
    angles = columns(table, "roll", "pitch", "yaw")
    with np.errstate(invalid="ignore"):
        good = (np.abs(angles) <= 4 * np.pi).all(axis=1)
    q = np.full((len(angles), 4), np.nan)
    q[good] = rotation.from_euler(*angles[good].T)
    return q


def truth(builder: LogBuilder, clock: PacketClock, instance: int) -> Attitude | None:
    """The simulator's attitude: SIM_STATE (quaternion), else SIMSTATE (Euler angles), at the packets' times."""
    for name in ("SIM_STATE", "SIMSTATE"):
        table = builder.messages.tables.get((name, instance))
        if table is None:
            continue
        q = quaternions(table)
        attitude = builder.attitude(clock.by_packet(table), q, name)
        if attitude is not None:
            how = (
                "packet stamps mapped to the boot clock are good to a few ms."
                if clock.is_steady
                else (
                    "the packet stamps do not advance as the boot clock does, so its place between messages with "
                    "a clock is taken."
                )
            )
            builder.problem("truth_packet_times", "note", f"{name} carries no time of its own; {how}")
            return attitude
    return None
