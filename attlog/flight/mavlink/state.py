"""Everything of a MAVLink log that is neither inertial, magnetic nor an attitude."""

from __future__ import annotations

from functools import partial

import numpy as np

from attlog.flight import physics, receiver
from attlog.flight.ardupilot import vehicle
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.mavlink import ekf, vibration
from attlog.flight.mavlink.clock import UNIX_US, PacketClock
from attlog.flight.model import Firmware, FlightLog, Gnss, Stream, TimeLine
from attlog.flight.modes import ardupilot_mode, px4_custom_mode
from attlog.flight.px4.state import RELEASE_TYPES
from attlog.flight.vehicle import family_of, named
from attlog.formats.base import Messages

ARDUPILOT, PX4 = 3, 12
ARMED_FLAG = 128
"""MAV_MODE_FLAG_SAFETY_ARMED of HEARTBEAT.base_mode."""
SEA_LEVEL_HPA = 1013.25
RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")


def firmware(messages: Messages, instance: int, autopilot: int | None) -> Firmware:
    """Who flew: ArduPilot by its start message, else the version number of AUTOPILOT_VERSION."""
    name = {ARDUPILOT: "ArduPilot", PX4: "PX4"}.get(autopilot or 0, "unknown autopilot")
    if autopilot == ARDUPILOT:
        told = vehicle.firmware(messages)
        if told.version:
            return told
    table = messages.tables.get(("AUTOPILOT_VERSION", instance))
    if table is None or len(table) == 0 or not int(table["flight_sw_version"][-1]):
        return Firmware(name)
    number = int(table["flight_sw_version"][-1])
    kind = RELEASE_TYPES.get(number & 0xFF, "")
    return Firmware(name, f"{number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}" + (f" {kind}" if kind else ""))


def fill(builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None, log: FlightLog) -> None:
    """Add set-points, states, aids and texts to the log."""
    messages = builder.messages
    log.vehicle = "unknown"
    builder.attempt("HEARTBEAT", lambda: heartbeats(builder, clock, instance, autopilot, log), None)
    log.simulated = any((n, instance) in messages.tables for n in ("SIM_STATE", "SIMSTATE")) or any(
        p.name.startswith("SIM_") for p in messages.params
    )
    log.landed = builder.attempt("EXTENDED_SYS_STATE", lambda: landed(builder, clock, instance), None)
    builder.attempt("ATTITUDE_TARGET", lambda: targets(builder, clock, instance, autopilot, log), None)
    for unit in (0, 1):
        one = builder.attempt(RECEIVERS[unit], partial(one_receiver, builder, clock, instance, unit), None)
        log.gnss += [] if one is None else [one]
    if clock.unix is not None:
        log.utc_offset = date(builder, clock.unix + builder.t0_us)
    for suffix in ("", "2", "3"):
        height = builder.attempt("The barometer", partial(baro, builder, clock, instance, suffix), None)
        log.baro += [] if height is None else [height]
    builder.attempt("VFR_HUD", lambda: hud(builder, clock, instance, log), None)
    log.rpm = builder.attempt("Rotor speed", lambda: rpm(builder, clock, instance), None)
    log.battery = builder.attempt("SYS_STATUS", lambda: battery(builder, clock, instance), None)
    log.clippings = builder.attempt("Clipping", lambda: vibration.clippings(builder, clock, instance), [])
    if autopilot == ARDUPILOT:
        log.onboard_vibration = builder.attempt("VIBRATION", lambda: vibration.level(builder, clock, instance), None)
        log.vibrations = vibration.levels(log.onboard_vibration)
    log.innovation_tests = builder.attempt("Test ratios", lambda: ekf.innovation_tests(builder, clock, instance), [])
    log.texts = builder.attempt("Texts", builder.texts, [])


def date(builder: LogBuilder, unix_us: int) -> float | None:
    """Unix time in s, None and a problem where it is none of a flight."""
    if physics.UTC_US.low <= unix_us <= physics.UTC_US.high:
        return unix_us * 1e-6
    text = f"SYSTEM_TIME: its date is none of a flight ({physics.UTC_US.why})."
    builder.problem("values_out_of_range", "warning", text)
    return None


def heartbeats(builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None, log: FlightLog) -> None:
    """Add vehicle, arming and modes to the log."""
    messages = builder.messages
    heartbeat = messages.tables.get(("HEARTBEAT", instance))
    if heartbeat is not None and len(heartbeat):
        log.vehicle = named(int(heartbeat["type"][-1]))
        quadplane = any(p.name == "Q_ENABLE" and p.value > 0 for p in messages.params)
        log.vehicle = "VTOL" if log.vehicle == "fixed wing" and quadplane else log.vehicle
        t = clock.of(heartbeat)
        base = heartbeat["base_mode"].astype(np.int64)
        log.armed = builder.time_line(t, (base & ARMED_FLAG != 0).tolist(), "HEARTBEAT")
        family = family_of(log.vehicle)
        names = [
            px4_custom_mode(int(m)) if autopilot == PX4 else ardupilot_mode(family, int(m))
            for m in heartbeat["custom_mode"]
        ]
        log.mode = builder.time_line(t, names, "HEARTBEAT")


def landed(builder: LogBuilder, clock: PacketClock, instance: int) -> TimeLine | None:
    """On the ground or not, where the autopilot tells."""
    state = builder.messages.tables.get(("EXTENDED_SYS_STATE", instance))
    if state is None:
        return None
    known = state["landed_state"] > 0
    on_ground = (state["landed_state"][known] == 1).tolist()
    return builder.time_line(clock.of(state)[known], on_ground, "EXTENDED_SYS_STATE")


def targets(builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None, log: FlightLog) -> None:
    """Add the set-points of attitude and rates to the log."""
    target = builder.messages.tables.get(("ATTITUDE_TARGET", instance))
    if target is not None:
        t = clock.of(target)
        log.setpoints = builder.attitude(t, columns(target, "q"), "ATTITUDE_TARGET", has_trim=autopilot == ARDUPILOT)
        rates = columns(target, "body_roll_rate", "body_pitch_rate", "body_yaw_rate")
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # the stamps were reported with the attitude
        log.rate_setpoints = own.stream(t, rates, "rad/s", "ATTITUDE_TARGET", frame="FRD", within=physics.RATE_SETPOINT)
        builder.take_values(own)


def hud(builder: LogBuilder, clock: PacketClock, instance: int, log: FlightLog) -> None:
    """Add throttle and, of a plane, airspeed to the log."""
    table = builder.messages.tables.get(("VFR_HUD", instance))
    if table is None:
        return
    t = clock.of(table)
    log.throttle = builder.stream(t, table.value("throttle") * 0.01, "1", "VFR_HUD", within=physics.THROTTLE)
    if family_of(log.vehicle) == "plane":
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # the stamps were reported with the throttle
        log.airspeed = own.stream(t, table.value("airspeed"), "m/s", "VFR_HUD", within=physics.AIRSPEED)
        builder.take_values(own)


def one_receiver(builder: LogBuilder, clock: PacketClock, instance: int, unit: int) -> Gnss | None:
    """One receiver (GPS_RAW_INT, GPS2_RAW); MAVLink does not carry its vertical speed."""
    name = RECEIVERS[unit]
    table = builder.messages.tables.get((name, instance))
    if table is None:
        return None
    t_us = clock.of(table)
    place = columns(table, "lat", "lon", "alt") * [1e-7, 1e-7, 1e-3]
    fix = table["fix_type"].astype(np.int64)
    speed = np.where(table["vel"] == 0xFFFF, np.nan, table["vel"] * 0.01)
    course = np.where(table["cog"] == 0xFFFF, np.nan, np.radians(table["cog"] * 0.01))
    velocity = np.column_stack([speed * np.cos(course), speed * np.sin(course), np.full(len(speed), np.nan)])
    h_acc, v_acc, s_acc = (
        np.where(table[c] > 0, table[c] * 1e-3, np.nan) if c in table else np.full(len(fix), np.nan)
        for c in ("h_acc", "v_acc", "vel_acc")
    )
    yaw = None
    if "yaw" in table and ((table["yaw"] > 0) & (table["yaw"] != 0xFFFF)).any():
        known = (table["yaw"] > 0) & (table["yaw"] != 0xFFFF)
        yaw = np.where(known, (np.radians(table["yaw"] * 0.01) + np.pi) % (2 * np.pi) - np.pi, np.nan)
    unix, unknown = table["time_usec"].astype(np.int64), np.full(len(fix), np.nan)
    return receiver.build(
        builder,
        unit,
        t_us,
        name,
        place=place,
        velocity=velocity,
        fix=fix,
        accuracy=(h_acc, v_acc, s_acc),
        yaw=yaw,
        utc_us=unix if (unix > UNIX_US).any() else None,
        reception={
            "satellites": table["satellites_visible"].astype(np.float64) if "satellites_visible" in table else unknown,
            "hdop": table["eph"] * 0.01 if "eph" in table else unknown,
        },
        repeats=True,
    )


def baro(builder: LogBuilder, clock: PacketClock, instance: int, suffix: str) -> Stream | None:
    """Altitude in m of the standard atmosphere at the measured pressure."""
    name = f"SCALED_PRESSURE{suffix}"
    table = builder.messages.tables.get((name, instance))
    if table is None:
        return None
    pressure = table.value("press_abs")
    with np.errstate(invalid="ignore"):
        altitude = np.where(
            pressure > 1.0, 44330.77 * (1.0 - np.maximum(pressure / SEA_LEVEL_HPA, 0.0) ** 0.190263), np.nan
        )
    return builder.stream(clock.of(table), altitude, "m", name, within=physics.BARO, allow_nan=True)


def rpm(builder: LogBuilder, clock: PacketClock, instance: int) -> Stream | None:
    """Rotor speeds (n, rotors) in rev/min of the first four ESCs."""
    table = builder.messages.tables.get(("ESC_TELEMETRY_1_TO_4", instance))
    if table is None:
        return None
    x = columns(table, "rpm")
    turning = x.any(axis=0)
    if not turning.any():
        return None
    return builder.stream(clock.of(table), x[:, turning], "rpm", "ESC_TELEMETRY_1_TO_4", within=physics.RPM)


def battery(builder: LogBuilder, clock: PacketClock, instance: int) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A, NaN where not measured."""
    table = builder.messages.tables.get(("SYS_STATUS", instance))
    if table is None:
        return None
    volts = np.where(table["voltage_battery"] == 0xFFFF, np.nan, table["voltage_battery"] * 1e-3)
    amperes = np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 1e-2)
    return builder.battery(clock.of(table), np.column_stack([volts, amperes]), "SYS_STATUS")
