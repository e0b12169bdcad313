"""MAVLink telemetry of either firmware: which message means what."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from attlog.core import rotation
from attlog.core.errors import LogUnusable, UsageError
from attlog.core.timestamps import Stamps, changed_records
from attlog.flight import compass, gnss, limits, parameters
from attlog.flight import imu as inertial
from attlog.flight.advice import TelemetryLogging
from attlog.flight.ardupilot import reader as ardupilot
from attlog.flight.ardupilot import vehicle
from attlog.flight.ardupilot.imu import filter_cutoffs
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.imu import low_pass_delay
from attlog.flight.model import (
    Array,
    Attitude,
    Clipping,
    Firmware,
    FlightLog,
    Gnss,
    InnovationTest,
    Mag,
    OnboardVibration,
    Stream,
    TimeLine,
)
from attlog.flight.px4 import reader as px4
from attlog.flight.px4.reader import RELEASE_TYPES
from attlog.flight.timestamps import valid_stamp
from attlog.flight.vehicle import ardupilot_mode, firmware_family, px4_custom_mode, vehicle_name
from attlog.formats.mavlink.layout import STAMP_COLUMN
from attlog.formats.mavlink.reader import CLOCK_MESSAGES
from attlog.formats.table import Messages, Table

# The autopilot's clock of MAVLink messages, also of those that carry none.
#
# Most messages hold ``time_boot_ms`` or ``time_usec``. The others (SIM_STATE, AHRS2,
# HEARTBEAT) have only the receiver's packet stamp, which the messages with both
# clocks map to the boot clock; radio delay and clock changes of the computer are
# followed by a running median. Where the stamps do not advance as the boot clock does
# (bursts of a radio link, stamps that stand still or have another unit), a packet's
# place in the file between messages with a clock tells its time better.

UNIX_US = 10**15
"""A time_usec above this is Unix time (2001), not time since boot."""
MAX_UNSTEADY_SHARE = 0.5
"""Stamps that advance by another time between clock packets than the boot clock does, by more than this share of the
mean step, are no clock: 0.01 to 0.25 in logs by wire and by good links, 0.6 by radio links that send in bursts."""
HALF_MILLISECOND_US = 500
"""A clock of whole milliseconds is early by half of one, on average."""
MEDIAN_PACKETS = 21
"""Clock packets whose median gives the difference between packet and boot clock."""


class PacketClock:
    """Boot times in us of the packets of one autopilot (``system``, ``component``)."""

    def __init__(self, messages: Messages, instance: int) -> None:
        offsets, boot, packet = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for name in CLOCK_MESSAGES:
            table = messages.tables.get((name, instance))
            if table is None or "time_boot_ms" not in table:
                continue
            time = boot_milliseconds(table)
            set_ = table["time_boot_ms"] > 0
            offsets.append(table.offsets[set_])
            boot.append(time[set_])
            packet.append((table[STAMP_COLUMN] if STAMP_COLUMN in table else table.offsets)[set_])
        joined = np.concatenate(offsets)
        order = np.argsort(joined, kind="stable")
        self.offsets = joined[order]
        self.boot = np.concatenate(boot)[order]
        stamped = np.concatenate(packet)[order]
        self.ahead = running_median(stamped - self.boot) if len(order) else self.boot
        self.is_steady = is_steady(stamped, self.boot)
        """Whether the packet stamps advance as the boot clock does."""
        self.unix = unix_minus_boot(messages, instance)

    def of(self, table: Table) -> Stamps:
        """Stamps (n,) of a table: its own clock, else the packet's."""
        if "time_boot_ms" in table:
            return boot_milliseconds(table)
        if "time_usec" in table:
            time = table["time_usec"].astype(np.int64)
            if self.unix is not None:
                time = np.where(time > UNIX_US, time - self.unix, time)
            if len(time) and np.median(time) > 0 and np.median(time) < UNIX_US:
                return time
        return self.by_packet(table)

    def by_packet(self, table: Table) -> Stamps:
        """Boot times from packet stamps, where these are missing or no clock from the place between clock messages."""
        if len(self.boot) == 0:
            return np.zeros(len(table), np.int64)
        if STAMP_COLUMN in table and self.is_steady:
            k = np.clip(np.searchsorted(self.offsets, table.offsets), 0, len(self.offsets) - 1)
            return force_rising(table[STAMP_COLUMN] - self.ahead[k])
        return np.interp(table.offsets, self.offsets, self.boot).astype(np.int64)


def is_steady(packet: Stamps, boot: Stamps) -> bool:
    """Whether packet stamps (n,) advance as the boot times (n,) of the same packets do; too few are taken as such."""
    if len(boot) < MEDIAN_PACKETS:
        return True
    steps = np.abs(np.diff(boot))
    return float(np.median(np.abs(np.diff(packet) - np.diff(boot)))) <= MAX_UNSTEADY_SHARE * float(steps.mean())


def boot_milliseconds(table: Table) -> Stamps:
    """Boot times (n,) in us of ``time_boot_ms``, which counts whole milliseconds that have passed: half of one more."""
    return table["time_boot_ms"].astype(np.int64) * 1000 + HALF_MILLISECOND_US


def force_rising(t_us: Stamps) -> Stamps:
    """The stamps without the small backward steps that an estimated clock difference makes; real ones stay.

    Each is at least 1 us after the one before; those that rise by themselves stay as they are.
    """
    count = np.arange(len(t_us))
    least: Stamps = np.maximum.accumulate(t_us - count) + count
    return np.where(least - t_us < 1_000_000, least, t_us)


def running_median(x: Stamps) -> Stamps:
    """The median of WINDOW neighbours of every entry (fewer at the ends)."""
    half = MEDIAN_PACKETS // 2
    if len(x) <= half:
        return np.full(len(x), int(np.median(x)), np.int64)
    padded = np.concatenate([x[half:0:-1], x, x[-2 : -half - 2 : -1]])
    medians: Stamps = np.median(np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_PACKETS), axis=1).astype(
        np.int64
    )
    return medians


def unix_minus_boot(messages: Messages, instance: int) -> int | None:
    """Unix time minus boot time in us (SYSTEM_TIME), None where the autopilot never knew the date."""
    table = messages.tables.get(("SYSTEM_TIME", instance))
    if table is None:
        return None
    unix, boot = table["time_unix_usec"].astype(np.int64), table["time_boot_ms"].astype(np.int64) * 1000
    known = (unix > UNIX_US) & (unix < limits.UTC_US.high) & (boot > 0)
    return int(np.median(unix[known] - boot[known])) if known.any() else None


# What telemetry tells of the onboard estimator: how far its aids were from what it expected.
#
# ArduPilot's EKF_STATUS_REPORT carries the roots of the test ratios under the name of variances (AP_NavEKF3
# ``getVariances``), PX4's ESTIMATOR_STATUS those of ``estimator_status``: innovation over gate and standard
# deviation,
# above 1 rejected.

TEST_RATIO_COLUMNS = {
    "EKF_STATUS_REPORT": {
        "compass": "compass_variance",
        "velocity": "velocity_variance",
        "position": "pos_horiz_variance",
        "height": "pos_vert_variance",
        "airspeed": "airspeed_variance",
    },
    "ESTIMATOR_STATUS": {
        "compass": "mag_ratio",
        "velocity": "vel_ratio",
        "position": "pos_horiz_ratio",
        "height": "pos_vert_ratio",
        "airspeed": "tas_ratio",
    },
}


def innovation_tests(builder: LogBuilder, clock: PacketClock, instance: int) -> list[InnovationTest]:
    """The test ratios that were sent, one for each aid."""
    for name, by_aid in TEST_RATIO_COLUMNS.items():
        table = builder.messages.tables.get((name, instance))
        if table is None or len(table) < 2:
            continue
        stamps = clock.of(table)
        near = builder.near(stamps)
        table, t = table.rows(near), builder.seconds(stamps[near])
        order = np.argsort(t, kind="stable")
        found = []
        for aid, column in by_aid.items():
            if column in table:
                ratio = np.asarray(table.value(column), np.float64)[order]
                possible = (ratio >= limits.TEST_RATIO.low) & (ratio <= limits.TEST_RATIO.high)
                found.append(InnovationTest(aid, t[order], np.where(possible, ratio, np.nan), f"{name}.{column}"))
        return found
    return []


# VIBRATION: how much the vehicle shakes, and how many accelerometer samples were at the end of their range.
#
# ``clipping_0`` to ``clipping_2`` count by unit at the sensor's full rate. The levels are ArduPilot's measure in
# m/s^2;
# PX4's are of another kind.

CLIPPING_UNITS = 3


def clippings(builder: LogBuilder, clock: PacketClock, instance: int) -> list[Clipping]:
    """New clipped samples of every unit over time; a counter that falls began anew."""
    table = builder.messages.tables.get(("VIBRATION", instance))
    if table is None or len(table) < 2:
        return []
    t, found = builder.seconds(clock.of(table)), []
    for unit in range(CLIPPING_UNITS):
        counter = table[f"clipping_{unit}"].astype(np.int64)
        new = np.maximum(np.diff(counter, prepend=counter[:1]), 0)
        found.append(Clipping("accelerometer", unit, f"VIBRATION.clipping_{unit}", t, new, True))
    return found


def vibration_stream(builder: LogBuilder, clock: PacketClock, instance: int) -> Stream | None:
    """ArduPilot's own level (n, 3) in m/s^2."""
    table = builder.messages.tables.get(("VIBRATION", instance))
    if table is None:
        return None
    x = columns(table, "vibration_x", "vibration_y", "vibration_z")
    return builder.stream(clock.of(table), x, "m/s^2", "VIBRATION", frame="FRD", within=limits.VIBRATION)


def vibration_levels(level_: Stream | None) -> list[OnboardVibration]:
    """The same of the worst axis; the message tells of the primary unit, here 0."""
    return [] if level_ is None else [OnboardVibration(0, "rest", level_.source, level_.t, level_.x.max(axis=1))]


# Everything of a MAVLink log that is neither inertial, magnetic nor an attitude.

ARDUPILOT_STATE, PX4_STATE = 3, 12
ARMED_FLAG = 128
"""MAV_MODE_FLAG_SAFETY_ARMED of HEARTBEAT.base_mode."""
SEA_LEVEL_HPA = 1013.25
RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")


def read_firmware(messages: Messages, instance: int, autopilot: int | None) -> Firmware:
    """Who flew: ArduPilot by its start message, else the version number of AUTOPILOT_VERSION."""
    name = {ARDUPILOT_STATE: "ArduPilot", PX4_STATE: "PX4"}.get(autopilot or 0, "unknown autopilot")
    if autopilot == ARDUPILOT_STATE:
        told = vehicle.read_firmware(messages)
        if told.version:
            return told
    table = messages.tables.get(("AUTOPILOT_VERSION", instance))
    if table is None or len(table) == 0 or not int(table["flight_sw_version"][-1]):
        return Firmware(name)
    number = int(table["flight_sw_version"][-1])
    kind = RELEASE_TYPES.get(number & 0xFF, "")
    return Firmware(name, f"{number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}" + (f" {kind}" if kind else ""))


def fill_streams(builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None, log: FlightLog) -> None:
    """Add set-points, states, aids and texts to the log."""
    messages = builder.messages
    log.vehicle = "unknown"
    builder.attempt("HEARTBEAT", lambda: add_heartbeats(builder, clock, instance, autopilot, log), None)
    log.simulated = any((n, instance) in messages.tables for n in ("SIM_STATE", "SIMSTATE")) or any(
        p.name.startswith("SIM_") for p in messages.params
    )
    log.state.landed = builder.attempt("EXTENDED_SYS_STATE", lambda: landed_line(builder, clock, instance), None)
    builder.attempt("ATTITUDE_TARGET", lambda: add_setpoints(builder, clock, instance, autopilot, log), None)
    for unit in (0, 1):
        one = builder.attempt(RECEIVERS[unit], partial(read_receiver, builder, clock, instance, unit), None)
        log.gnss += [] if one is None else [one]
    if clock.unix is not None:
        log.utc_offset = valid_date(builder, clock.unix + builder.t0_us)
    for suffix in ("", "2", "3"):
        height = builder.attempt("The barometer", partial(baro_stream, builder, clock, instance, suffix), None)
        log.baro += [] if height is None else [height]
    builder.attempt("VFR_HUD", lambda: add_hud(builder, clock, instance, log), None)
    log.power.rpm = builder.attempt("Rotor speed", lambda: rpm_stream(builder, clock, instance), None)
    log.power.battery = builder.attempt("SYS_STATUS", lambda: battery_stream(builder, clock, instance), None)
    log.vibration.clippings = builder.attempt("Clipping", lambda: clippings(builder, clock, instance), [])
    if autopilot == ARDUPILOT_STATE:
        log.vibration.level = builder.attempt("VIBRATION", lambda: vibration_stream(builder, clock, instance), None)
        log.vibration.levels = vibration_levels(log.vibration.level)
    log.estimator.innovation_tests = builder.attempt(
        "Test ratios", lambda: innovation_tests(builder, clock, instance), []
    )
    log.texts = builder.attempt("Texts", builder.texts, [])


def valid_date(builder: LogBuilder, unix_us: int) -> float | None:
    """Unix time in s, None and a problem where it is none of a flight."""
    if limits.UTC_US.low <= unix_us <= limits.UTC_US.high:
        return unix_us * 1e-6
    text = f"SYSTEM_TIME: its date is none of a flight ({limits.UTC_US.why})."
    builder.problem("values_out_of_range", "warning", text)
    return None


def add_heartbeats(
    builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None, log: FlightLog
) -> None:
    """Add vehicle, arming and modes to the log."""
    messages = builder.messages
    heartbeat = messages.tables.get(("HEARTBEAT", instance))
    if heartbeat is not None and len(heartbeat):
        log.vehicle = vehicle_name(int(heartbeat["type"][-1]))
        quadplane = any(p.name == "Q_ENABLE" and p.value > 0 for p in messages.params)
        log.vehicle = "VTOL" if log.vehicle == "fixed wing" and quadplane else log.vehicle
        t = clock.of(heartbeat)
        base = heartbeat["base_mode"].astype(np.int64)
        log.state.armed = builder.time_line(t, (base & ARMED_FLAG != 0).tolist(), "HEARTBEAT")
        family = firmware_family(log.vehicle)
        names = [
            px4_custom_mode(int(m)) if autopilot == PX4_STATE else ardupilot_mode(family, int(m))
            for m in heartbeat["custom_mode"]
        ]
        log.state.mode = builder.time_line(t, names, "HEARTBEAT")


def landed_line(builder: LogBuilder, clock: PacketClock, instance: int) -> TimeLine | None:
    """On the ground or not, where the autopilot tells."""
    state = builder.messages.tables.get(("EXTENDED_SYS_STATE", instance))
    if state is None:
        return None
    known = state["landed_state"] > 0
    on_ground = (state["landed_state"][known] == 1).tolist()
    return builder.time_line(clock.of(state)[known], on_ground, "EXTENDED_SYS_STATE")


def add_setpoints(
    builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None, log: FlightLog
) -> None:
    """Add the set-points of attitude and rates to the log."""
    target = builder.messages.tables.get(("ATTITUDE_TARGET", instance))
    if target is not None:
        t = clock.of(target)
        log.setpoints.attitude = builder.attitude(
            t, columns(target, "q"), "ATTITUDE_TARGET", has_trim=autopilot == ARDUPILOT_STATE
        )
        rates = columns(target, "body_roll_rate", "body_pitch_rate", "body_yaw_rate")
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # the stamps were reported with the attitude
        log.setpoints.rates = own.stream(t, rates, "rad/s", "ATTITUDE_TARGET", frame="FRD", within=limits.RATE_SETPOINT)
        builder.take_values(own)


def add_hud(builder: LogBuilder, clock: PacketClock, instance: int, log: FlightLog) -> None:
    """Add throttle and, of a plane, airspeed to the log."""
    table = builder.messages.tables.get(("VFR_HUD", instance))
    if table is None:
        return
    t = clock.of(table)
    log.power.throttle = builder.stream(t, table.value("throttle") * 0.01, "1", "VFR_HUD", within=limits.THROTTLE)
    if firmware_family(log.vehicle) == "plane":
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # the stamps were reported with the throttle
        log.airspeed = own.stream(t, table.value("airspeed"), "m/s", "VFR_HUD", within=limits.AIRSPEED)
        builder.take_values(own)


def read_receiver(builder: LogBuilder, clock: PacketClock, instance: int, unit: int) -> Gnss | None:
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
    return gnss.build_gnss(
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


def baro_stream(builder: LogBuilder, clock: PacketClock, instance: int, suffix: str) -> Stream | None:
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
    return builder.stream(clock.of(table), altitude, "m", name, within=limits.BARO, allow_nan=True)


def rpm_stream(builder: LogBuilder, clock: PacketClock, instance: int) -> Stream | None:
    """Rotor speeds (n, rotors) in rev/min of the first four ESCs."""
    table = builder.messages.tables.get(("ESC_TELEMETRY_1_TO_4", instance))
    if table is None:
        return None
    x = columns(table, "rpm")
    turning = x.any(axis=0)
    if not turning.any():
        return None
    return builder.stream(clock.of(table), x[:, turning], "rpm", "ESC_TELEMETRY_1_TO_4", within=limits.RPM)


def battery_stream(builder: LogBuilder, clock: PacketClock, instance: int) -> Stream | None:
    """Battery (n, 2): voltage in V and current in A, NaN where not measured."""
    table = builder.messages.tables.get(("SYS_STATUS", instance))
    if table is None:
        return None
    volts = np.where(table["voltage_battery"] == 0xFFFF, np.nan, table["voltage_battery"] * 1e-3)
    amperes = np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 1e-2)
    return builder.battery(clock.of(table), np.column_stack([volts, amperes]), "SYS_STATUS")


# MAVLink telemetry (tlog, raw stream) of ArduPilot and PX4 as a FlightLog.
#
# Message clocks are used throughout. ArduPilot's RAW_IMU and SCALED_IMU* are
# calibrated, in the body frame and cut to 1 mrad/s and 1 mg; PX4 sends HIGHRES_IMU in
# SI units.

ARDUPILOT, PX4 = 3, 12
STANDARD_GRAVITY = 9.80665
"""m/s^2 per g of the accelerations in mg."""
MILLIGAUSS = 1e-7


def choose_system(messages: Messages, path: Path, system: int | None) -> tuple[Messages, int]:
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
    messages, instance = choose_system(messages, messages.path, system)
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
    found = builder.attempt("The inertial messages", lambda: imu_candidates(builder, clock, instance, autopilot), [])
    chosen = inertial.best_per_unit(builder, found)
    nobody = Firmware("unknown autopilot")
    firmware = builder.attempt("The firmware", lambda: read_firmware(messages, instance, autopilot), nobody)
    logging = TelemetryLogging(firmware.name)
    position = inertial.choose_imu(builder, chosen, 0, "the first one", imu, logging)
    builder.t0_us = valid_stamp(first_stamp(clock, chosen, position))

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware, "")
    log.logging = logging
    log.imus = [inertial.build_imu(builder, c) for c in chosen]
    log.imu = position
    flying = None if position is None else log.imus[position]
    log.mags = builder.attempt("The magnetometer", lambda: magnetometers(builder, clock, instance), [])
    log.mag = builder.attempt(
        "The compass", lambda: compass.choose_mag(builder, log.mags, flying, 0, "the first one", mag, logging), None
    )
    log.attitudes = builder.attempt(
        "The attitude", lambda: attitudes(builder, clock, instance, autopilot == ARDUPILOT), {}
    )
    log.onboard = next((n for n in ("ATTITUDE_QUATERNION", "ATTITUDE", "AHRS2") if n in log.attitudes), None)
    log.truth = builder.attempt("The simulator's attitude", lambda: simulated_attitude(builder, clock, instance), None)
    log.parameters.lines = builder.attempt(
        "PARAM_VALUE", lambda: parameters.parameter_lines(builder, messages.params, "PARAM_VALUE"), {}
    )
    add_parameter_values(log, autopilot)
    fill_streams(builder, clock, instance, autopilot, log)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def add_parameter_values(log: FlightLog, autopilot: int | None) -> None:
    """Add what the autopilot's parameters tell of trim and declination."""
    names = px4.DECLINATION_PARAMETERS if autopilot == PX4 else ardupilot.DECLINATION_PARAMETERS
    log.parameters.declination, log.parameters.declination_source = parameters.declination(log, names)
    if autopilot == ARDUPILOT:
        log.parameters.trim, log.parameters.trim_source = ardupilot.read_trim(log), ", ".join(ardupilot.TRIM_PARAMETERS)


def first_stamp(clock: PacketClock, chosen: list[inertial.ImuCandidate], position: int | None) -> int:
    """The boot time in us that becomes t = 0."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    return int(clock.boot[0]) if len(clock.boot) else 0


# --- sensors ----------------------------------------------------------------------------------------------------


def imu_candidates(
    builder: LogBuilder, clock: PacketClock, instance: int, autopilot: int | None
) -> list[inertial.ImuCandidate]:
    """Every inertial message, cleaned: HIGHRES_IMU (SI), RAW_IMU of ArduPilot, SCALED_IMU, _IMU2, _IMU3."""
    gyro_cut, acc_cut = filter_cutoffs(builder.messages.params, 0) if autopilot == ARDUPILOT else (0.0, 0.0)
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
        one = inertial.validate_candidate(
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
        scale = compass.GAUSS if name == "HIGHRES_IMU" else MILLIGAUSS
        field, t = columns(table, "xmag", "ymag", "zmag") * scale, clock.of(table)
        if unit and not field.any():
            continue  # a unit without compass sends zeros
        new = changed_records(field, t)
        mag = compass.build_mag(builder, unit, t[new], field[new], name)
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


def simulated_attitude(builder: LogBuilder, clock: PacketClock, instance: int) -> Attitude | None:
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
