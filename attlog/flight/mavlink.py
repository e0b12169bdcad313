"""Read MAVLink telemetry (tlog, raw stream) of ArduPilot and PX4 as a flight log.

ArduPilot's RAW_IMU and SCALED_IMU* are calibrated, in the body frame and cut to 1 mrad/s and 1 mg; PX4 sends
HIGHRES_IMU in SI units. EKF_STATUS_REPORT carries the roots of the test ratios under the name of variances (AP_NavEKF3
``getVariances``), ESTIMATOR_STATUS those of ``estimator_status``. VIBRATION counts clipped samples by unit at the
sensor's full rate; its levels are ArduPilot's measure in m/s^2, PX4's are of another kind.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from attlog.core import rotation
from attlog.core.earth import TESLA_PER_GAUSS, TESLA_PER_MILLIGAUSS
from attlog.core.errors import LogUnusable, UsageError
from attlog.core.timestamps import Stamps, changed_records
from attlog.flight import limits, parameters
from attlog.flight.advice import VehicleSettings
from attlog.flight.ardupilot import drive as ardupilot_drive
from attlog.flight.ardupilot import reader as ardupilot
from attlog.flight.ardupilot import vehicle
from attlog.flight.ardupilot.imu import filter_cutoffs
from attlog.flight.builder import LogBuilder, Part, columns, from_euler, optional_column
from attlog.flight.compass import build_mag, choose_mag
from attlog.flight.drive import SERVO_OUTPUTS, Esc, MotorOutputs, esc_telemetry
from attlog.flight.gnss import build_gnss
from attlog.flight.imu import ImuCandidate, add_imus, best_per_unit, low_pass_delay, validate_candidate
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
from attlog.flight.packet_clock import UNIX_US, PacketClock, without_stale_packets
from attlog.flight.panels import PanelRows, Row
from attlog.flight.px4 import drive as px4_drive
from attlog.flight.px4 import reader as px4
from attlog.flight.vehicle import (
    VehicleKind,
    ardupilot_mode,
    firmware_family,
    px4_custom_mode,
    px4_version,
    vehicle_name,
)
from attlog.formats.table import Messages, Table

# Values of HEARTBEAT.autopilot.
ARDUPILOT, PX4 = 3, 12

# --- vehicle ----------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class TelemetryBuilder(LogBuilder):
    """Builder of a flight log from the packets of one autopilot."""

    instance: int = 0
    autopilot: int | None = None
    clock: PacketClock = field(init=False)

    def __post_init__(self) -> None:
        LogBuilder.__post_init__(self)
        self.clock = PacketClock(self.messages, self.instance)

    def packets(self, name: str) -> Table | None:
        """Return the autopilot's packets of a message, None without any."""
        return self.table(name, self.instance)

    def stamps(self, table: Table) -> Stamps:
        """Return the stamps (n,) of a table in us of the boot clock."""
        return self.clock.of(table)


def choose_system_id(messages: Messages, path: Path, system: int | None) -> int:
    """Return the table instance (system * 256 + component) of the vehicle's autopilot.

    The vehicle is chosen when the file is opened; ``system`` is only checked. UsageError if it is not in the file,
    LogUnusable without any autopilot.
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
    return int(chosen * 256 + component)


def read(messages: Messages, imu: int | None, mag: int | str | None, system: int | None) -> FlightLog:
    """Read the flight of one vehicle in a MAVLink file; ``imu`` and ``mag`` select units."""
    instance = choose_system_id(messages, messages.path, system)
    messages, stale = without_stale_packets(messages, instance, [name for _, _, name in INERTIAL])
    systems = messages.info.get("systems", {})
    autopilot = systems.get(instance >> 8, {}).get("autopilot")
    builder = TelemetryBuilder(messages, instance=instance, autopilot=autopilot)
    log, read_optional = builder.log, builder.read_optional
    _report_other_systems(builder, systems)
    if stale:
        builder.problem("stale_packets", "note", stale)
    candidates = best_per_unit(builder, read_optional("The inertial messages", partial(imu_candidates, builder), []))
    log.firmware = read_optional("The firmware", partial(read_firmware, builder), Firmware("unknown autopilot"))
    suffix = {"PX4": ".ulg", "ArduPilot": ".bin"}.get(log.firmware.name, ".bin or .ulg")
    log.settings = VehicleSettings("telemetry", name=suffix)
    boot = builder.clock.boot
    add_imus(builder, candidates, 0, "the first one", imu, lambda: int(boot[0]) if len(boot) else 0)
    log.mags = read_optional("The magnetometer", partial(magnetometers, builder), [])
    log.mag = read_optional("The compass", partial(choose_mag, builder, 0, "the first one", mag), None)
    log.vehicle = "unknown"
    builder.read_parts(STREAMS)
    states = any(builder.packets(name) is not None for name in ("SIM_STATE", "SIMSTATE"))
    log.simulated = vehicle.is_simulated(states, log.texts, [p.name for p in messages.params])
    return log


def _report_other_systems(builder: TelemetryBuilder, systems: dict[int, dict[str, int | None]]) -> None:
    """Report the other vehicles of a file."""
    own = builder.instance >> 8
    others = [s for s, d in systems.items() if d["autopilot"] is not None and s != own]
    if others:
        text = f"The file holds {len(others) + 1} vehicles; this is system {own}. --system chooses another "
        builder.problem("several_systems", "note", f"{text}({', '.join(map(str, others))}).", count=len(others) + 1)


def read_firmware(builder: TelemetryBuilder) -> Firmware:
    """Return the firmware by ArduPilot's banner, else by AUTOPILOT_VERSION."""
    name = {ARDUPILOT: "ArduPilot", PX4: "PX4"}.get(builder.autopilot or 0, "unknown autopilot")
    if builder.autopilot == ARDUPILOT:
        by_message = vehicle.read_firmware(builder.messages)
        if by_message.version:
            return by_message
    table = builder.packets("AUTOPILOT_VERSION")
    if table is None or len(table) == 0 or not int(table["flight_sw_version"][-1]):
        return Firmware(name)
    return Firmware(name, px4_version(int(table["flight_sw_version"][-1])))


def add_trim_and_declination(builder: TelemetryBuilder) -> None:
    """Add declination and trim from the autopilot's parameters."""
    names = px4.DECLINATION_PARAMETERS if builder.autopilot == PX4 else ardupilot.DECLINATION_PARAMETERS
    parameters.add_values(builder, names)
    if builder.autopilot == ARDUPILOT:
        own = builder.log.parameters
        own.trim, own.trim_source = ardupilot.read_trim(builder.log), ", ".join(ardupilot.TRIM_PARAMETERS)


# --- sensors ----------------------------------------------------------------------------------------------------

STANDARD_GRAVITY_M_S2 = 9.80665
# Unit, rank and name of inertial messages.
INERTIAL = (
    (0, 0, "HIGHRES_IMU"),
    (0, 1, "RAW_IMU"),
    (0, 2, "SCALED_IMU"),
    (1, 2, "SCALED_IMU2"),
    (2, 2, "SCALED_IMU3"),
)
# Least share of nonzero records of a unit in use.
MIN_NONZERO_SHARE = 0.01
# Unset values of unsigned 16 bits.
UNSET = 0xFFFF
RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")


def imu_candidates(builder: TelemetryBuilder) -> list[ImuCandidate]:
    """Return every inertial message: HIGHRES_IMU (SI), RAW_IMU of ArduPilot, SCALED_IMU, _IMU2, _IMU3."""
    ardupilot_flew = builder.autopilot == ARDUPILOT
    gyro_cut, acc_cut = filter_cutoffs(builder.messages.params, 0) if ardupilot_flew else (0.0, 0.0)
    found = []
    for unit, rank, name in INERTIAL:
        table = builder.packets(name)
        if table is None or (name == "RAW_IMU" and builder.autopilot == PX4):
            continue  # PX4's RAW_IMU is in sensor units
        gyro, acc = columns(table, "xgyro", "ygyro", "zgyro"), columns(table, "xacc", "yacc", "zacc")
        if name != "HIGHRES_IMU":
            gyro, acc = gyro * 1e-3, acc * 1e-3 * STANDARD_GRAVITY_M_S2
        if np.mean((gyro != 0).any(axis=1) | (acc != 0).any(axis=1)) < MIN_NONZERO_SHARE:
            text = f"{name}: its gyro and accelerometer values are zero; this unit is not used."
            builder.problem("imu_all_zero", "note" if unit else "error", text)
            continue
        one = ImuCandidate(unit, rank, builder.stamps(table), gyro, acc, name, "instant")
        one.filtered = f"low-pass {gyro_cut:.0f} Hz" if gyro_cut else "unknown"
        one.gyro_delay, one.acc_delay = low_pass_delay(gyro_cut), low_pass_delay(acc_cut)
        one.note = "" if name == "HIGHRES_IMU" else "steps of 0.057 deg/s and 0.0098 m/s^2"
        valid = validate_candidate(builder, one)
        found += [valid] if valid is not None else []
    return found


def magnetometers(builder: TelemetryBuilder) -> list[Mag]:
    """Return every compass of the inertial messages; only records with a new value."""
    found: list[Mag] = []
    for unit, _, name in INERTIAL:
        table = builder.packets(name)
        if table is None or any(m.index == unit for m in found):
            continue
        scale = TESLA_PER_GAUSS if name == "HIGHRES_IMU" else TESLA_PER_MILLIGAUSS
        field_t, t = columns(table, "xmag", "ymag", "zmag") * scale, builder.stamps(table)
        if unit and not field_t.any():
            continue  # a unit without compass sends zeros
        new = changed_records(field_t, t)
        mag = build_mag(builder, unit, t[new], field_t[new], name)
        found += [mag] if mag is not None else []
    return found


def receivers(builder: TelemetryBuilder) -> list[Gnss]:
    """Return the receivers."""
    every = [
        builder.read_optional(name, partial(read_receiver, builder, unit), None) for unit, name in enumerate(RECEIVERS)
    ]
    return [receiver for receiver in every if receiver is not None]


def read_receiver(builder: TelemetryBuilder, unit: int) -> Gnss | None:
    """Return a receiver; MAVLink does not carry its vertical speed."""
    name = RECEIVERS[unit]
    table = builder.packets(name)
    if table is None:
        return None
    speed = np.where(table["vel"] == UNSET, np.nan, table["vel"] * 0.01)
    course = np.where(table["cog"] == UNSET, np.nan, np.radians(table["cog"] * 0.01))
    h_acc, v_acc, s_acc = (
        np.where(table[c] > 0, table[c] * 1e-3, np.nan) if c in table else np.full(len(table), np.nan)
        for c in ("h_acc", "v_acc", "vel_acc")
    )
    yaw = None
    if "yaw" in table:
        known = (table["yaw"] > 0) & (table["yaw"] != UNSET)
        yaw = np.where(known, (np.radians(table["yaw"] * 0.01) + np.pi) % (2 * np.pi) - np.pi, np.nan)
    unix = table["time_usec"].astype(np.int64)
    return build_gnss(
        builder,
        unit,
        builder.stamps(table),
        name,
        place=columns(table, "lat", "lon", "alt") * [1e-7, 1e-7, 1e-3],
        velocity=np.column_stack([speed * np.cos(course), speed * np.sin(course), np.full(len(speed), np.nan)]),
        fix=table["fix_type"].astype(np.int64),
        accuracy=(h_acc, v_acc, s_acc),
        yaw=yaw,
        utc_us=unix if (unix > UNIX_US).any() else None,
        reception={
            "satellites": optional_column(table, "satellites_visible"),
            "hdop": optional_column(table, "eph") * 0.01,
        },
        repeats=True,
    )


def utc_offset(builder: TelemetryBuilder) -> float | None:
    """Return Unix time in s at t = 0, None if unknown or implausible; the latter is reported."""
    if builder.clock.unix is None:
        return None
    unix_us = builder.clock.unix + builder.t0_us
    if limits.UTC_US.low <= unix_us <= limits.UTC_US.high:
        return unix_us * 1e-6
    text = f"SYSTEM_TIME: its date is none of a flight ({limits.UTC_US.why})."
    builder.problem("values_out_of_range", "warning", text)
    return None


# Controllers of a message of ESC telemetry.
ESCS_A_MESSAGE = 4
# Standard atmosphere: pressure in hPa at sea level, and height = SCALE_M (1 - (pressure / sea level) ** EXPONENT).
SEA_LEVEL_HPA, HEIGHT_SCALE_M, HEIGHT_EXPONENT = 1013.25, 44330.77, 0.190263
BAROMETERS = ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3")


def baro_streams(builder: TelemetryBuilder) -> list[Stream]:
    """Return barometric altitudes in m from pressures by the standard atmosphere."""
    every = [builder.read_optional("The barometer", partial(_baro_stream, builder, name), None) for name in BAROMETERS]
    return [stream for stream in every if stream is not None]


def _baro_stream(builder: TelemetryBuilder, name: str) -> Stream | None:
    table = builder.packets(name)
    if table is None:
        return None
    pressure = table.value("press_abs")
    with np.errstate(invalid="ignore"):
        height = HEIGHT_SCALE_M * (1.0 - np.maximum(pressure / SEA_LEVEL_HPA, 0.0) ** HEIGHT_EXPONENT)
        height = np.where(pressure > 1.0, height, np.nan)
    return builder.stream(builder.stamps(table), height, "m", name, within=limits.BARO, allow_nan=True)


def airspeed_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the airspeed of a plane (VFR_HUD)."""
    if firmware_family(builder.log.vehicle) != "plane":
        return None
    own = builder.quiet()  # the stamps were reported with the throttle
    found = own.column_stream(builder.packets("VFR_HUD"), ("airspeed",), "m/s", "VFR_HUD", limits.AIRSPEED)
    builder.add_value_problems(own)
    return found


def throttle_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the throttle 0 to 1 (VFR_HUD)."""
    table = builder.packets("VFR_HUD")
    return builder.column_stream(table, ("throttle",), "1", "VFR_HUD", limits.THROTTLE, scale=0.01)


def rpm_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the speeds (n, rotors) in rev/min of the first four ESCs, without those that never turned."""
    table = builder.packets("ESC_TELEMETRY_1_TO_4")
    if table is None:
        return None
    x = columns(table, "rpm")
    turned = x.any(axis=0)
    if not turned.any():
        return None
    return builder.stream(builder.stamps(table), x[:, turned], "rpm", "ESC_TELEMETRY_1_TO_4", within=limits.RPM)


def esc_list(builder: TelemetryBuilder) -> list[Esc]:
    """Return the speed controllers whose rotors turned; their numbers are not those of the motors."""
    found = []
    for first, name in enumerate(("ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8")):
        table = builder.packets(name)
        if table is None:
            continue
        table, t = builder.near_rows(table)
        parts = [columns(table, c) * scale for c, scale in (("rpm", 1.0), ("current", 0.01), ("temperature", 1.0))]
        for k in range(ESCS_A_MESSAGE):
            number = ESCS_A_MESSAGE * first + k
            found.append(esc_telemetry(t, np.column_stack([part[:, k] for part in parts]), f"ESC[{number}]"))
    return [esc for esc in found if esc is not None]


def motor_outputs(builder: TelemetryBuilder) -> MotorOutputs | None:
    """Return a multirotor's motor outputs between floor and ceiling of flight.

    A list of parameters that is only in part sent gives no limits: the missing ones have other defaults.
    """
    table = builder.packets(SERVO_OUTPUTS)
    if table is None or builder.log.kind is not VehicleKind.MULTIROTOR:
        return None
    table = table.rows(table["port"] == 0) if "port" in table else table
    values = parameters.boot_values(builder.messages.params)
    if builder.autopilot == PX4:
        return px4_drive.telemetry_outputs(builder, values, table)
    if "THR_MIN" not in values and not all(name in values for name in ("MOT_PWM_MIN", "MOT_PWM_MAX", "MOT_SPIN_MIN")):
        values = {name: x for name, x in values.items() if not name.startswith(("MOT_", "RC"))}
    return ardupilot_drive.outputs_of(builder, values, table, "servo{}_raw", SERVO_OUTPUTS)


def battery_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the battery (n, 2), voltage in V and current in A, NaN where not measured."""
    table = builder.packets("SYS_STATUS")
    if table is None:
        return None
    volts = np.where(table["voltage_battery"] == UNSET, np.nan, table["voltage_battery"] * 1e-3)
    amperes = np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 1e-2)
    return builder.battery_stream(builder.stamps(table), np.column_stack([volts, amperes]), "SYS_STATUS")


# --- attitude ---------------------------------------------------------------------------------------------------

# The onboard attitude is the first of these; AHRS3 never flies.
ATTITUDE_MESSAGES = ("ATTITUDE_QUATERNION", "ATTITUDE", "AHRS2", "AHRS3")


def attitudes(builder: TelemetryBuilder) -> dict[str, Attitude]:
    """Return every attitude message by name; AHRS2 and AHRS3 are stamped by packet."""
    found = {}
    for name in ATTITUDE_MESSAGES:
        table = builder.packets(name)
        if table is None:
            continue
        trimmed = builder.autopilot == ARDUPILOT
        attitude = builder.attitude(builder.stamps(table), quaternions(table), name, has_trim=trimmed)
        if attitude is not None:
            found[name] = attitude
    builder.log.onboard = next((n for n in ATTITUDE_MESSAGES[:3] if n in found), None)
    return found


def quaternions(table: Table) -> Array:
    """Return quaternions (n, 4) of a message with q1..q4 or Euler angles in rad."""
    if "q1" in table:
        return columns(table, "q1", "q2", "q3", "q4")
    return from_euler(columns(table, "roll", "pitch", "yaw"), 4 * np.pi)


def simulated_attitude(builder: TelemetryBuilder) -> Attitude | None:
    """Return the simulator's attitude: SIM_STATE (quaternion) or SIMSTATE (Euler angles), stamped by packet."""
    for name in ("SIM_STATE", "SIMSTATE"):
        table = builder.packets(name)
        if table is None:
            continue
        attitude = builder.attitude(builder.clock.by_packet(table), quaternions(table), name)
        if attitude is not None:
            how = "packet stamps mapped to the boot clock are good to a few ms."
            if not builder.clock.is_steady:
                how = "the packet stamps do not advance as the boot clock does, so its place between messages with "
                how += "a clock is taken."
            builder.problem("truth_packet_times", "note", f"{name} carries no time of its own; {how}")
            return attitude
    return None


def attitude_setpoint(builder: TelemetryBuilder) -> Attitude | None:
    """Return the attitude set-point."""
    table = builder.packets("ATTITUDE_TARGET")
    if table is None:
        return None
    trimmed = builder.autopilot == ARDUPILOT
    return builder.attitude(builder.stamps(table), columns(table, "q"), "ATTITUDE_TARGET", has_trim=trimmed)


def rate_setpoint_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the body rate set-point in rad/s."""
    own = builder.quiet()  # the stamps were reported with the attitude
    axes = ("body_roll_rate", "body_pitch_rate", "body_yaw_rate")
    table = builder.packets("ATTITUDE_TARGET")
    found = own.column_stream(table, axes, "rad/s", "ATTITUDE_TARGET", limits.RATE_SETPOINT, frame="FRD")
    builder.add_value_problems(own)
    return found


# --- state, estimator, vibration --------------------------------------------------------------------------------

# MAV_MODE_FLAG_SAFETY_ARMED of HEARTBEAT.base_mode, MAV_LANDED_STATE_ON_GROUND of EXTENDED_SYS_STATE.
ARMED_FLAG, ON_GROUND = 128, 1
# MAV_SYS_STATUS_SENSOR_RC_RECEIVER.
RADIO_RECEIVER = 65536
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
CLIPPING_UNITS = 3
VIBRATION_COLUMNS = ("vibration_x", "vibration_y", "vibration_z")


def processor_load(builder: TelemetryBuilder) -> Stream | None:
    """Return the load (n, 1) of the main loop, 0 to 1; None where it is always 0, as in the simulator."""
    table = builder.packets("SYS_STATUS")
    if table is None or "load" not in table or not np.any(table["load"]):
        return None
    return builder.quiet().column_stream(table, ("load",), "1", "SYS_STATUS", limits.SHARE_IN_USE, scale=1e-3)


def radio_signal(builder: TelemetryBuilder) -> TimeLine | None:
    """Return whether the radio is received, by its bit of SYS_STATUS; None where the vehicle uses none."""
    table = builder.packets("SYS_STATUS")
    names = [f"onboard_control_sensors_{state}" for state in ("present", "enabled", "health")]
    if table is None or not all(name in table for name in names):
        return None
    present, enabled, healthy = (table[name].astype(np.int64) & RADIO_RECEIVER != 0 for name in names)
    used = present & enabled
    return builder.time_line(builder.stamps(table)[used], healthy[used].tolist(), "SYS_STATUS")


def vehicle_type(builder: TelemetryBuilder) -> str:
    """Return the vehicle's usual name by HEARTBEAT.type."""
    heartbeat = builder.packets("HEARTBEAT")
    if heartbeat is None or not len(heartbeat):
        return "unknown"
    name = vehicle_name(int(heartbeat["type"][-1]))
    quadplane = any(p.name == "Q_ENABLE" and p.value > 0 for p in builder.messages.params)
    return "VTOL" if name == "fixed wing" and quadplane else name


def armed_line(builder: TelemetryBuilder) -> TimeLine | None:
    """Return arming over time."""
    heartbeat = builder.packets("HEARTBEAT")
    if heartbeat is None:
        return None
    armed = heartbeat["base_mode"].astype(np.int64) & ARMED_FLAG != 0
    return builder.time_line(builder.stamps(heartbeat), armed.tolist(), "HEARTBEAT")


def mode_line(builder: TelemetryBuilder) -> TimeLine | None:
    """Return flight modes by name over time."""
    heartbeat = builder.packets("HEARTBEAT")
    if heartbeat is None:
        return None
    family = firmware_family(builder.log.vehicle)
    names = [
        px4_custom_mode(int(m)) if builder.autopilot == PX4 else ardupilot_mode(family, int(m))
        for m in heartbeat["custom_mode"]
    ]
    return builder.time_line(builder.stamps(heartbeat), names, "HEARTBEAT")


def landed_line(builder: TelemetryBuilder) -> TimeLine | None:
    """Return ground contact over time, None if not sent."""
    state = builder.packets("EXTENDED_SYS_STATE")
    if state is None:
        return None
    known = state["landed_state"] > 0
    on_ground = (state["landed_state"][known] == ON_GROUND).tolist()
    return builder.time_line(builder.stamps(state)[known], on_ground, "EXTENDED_SYS_STATE")


def innovation_tests(builder: TelemetryBuilder) -> list[InnovationTest]:
    """Return the test ratios that were sent, one for each aid."""
    for name, by_aid in TEST_RATIO_COLUMNS.items():
        table = builder.packets(name)
        if table is None or len(table) < 2:
            continue
        table, t = builder.near_rows(table)
        order = np.argsort(t, kind="stable")
        found = []
        for aid, column in by_aid.items():
            if column in table:
                ratio = np.asarray(table.value(column), np.float64)[order]
                ratio = np.where(limits.TEST_RATIO.outside(ratio), np.nan, ratio)
                found.append(InnovationTest(aid, t[order], ratio, f"{name}.{column}"))
        return found
    return []


def clippings(builder: TelemetryBuilder) -> list[Clipping]:
    """Return the clipped samples of every unit, counted between records."""
    table = builder.packets("VIBRATION")
    if table is None or len(table) < 2:
        return []
    names = [f"clipping_{unit}" for unit in range(CLIPPING_UNITS)]
    return [
        builder.clipping("accelerometer", unit, f"VIBRATION.{name}", table, name) for unit, name in enumerate(names)
    ]


def height_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the estimator's height (n, 1) in m above home."""
    name, own = "GLOBAL_POSITION_INT", builder.quiet()
    quantity = limits.ESTIMATED_HEIGHT
    return own.column_stream(builder.packets(name), ("relative_alt",), "m", name, quantity, scale=1e-3)


def speed_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return the estimator's speed (n, 1) over ground in m/s."""
    table = builder.packets("GLOBAL_POSITION_INT")
    if table is None or "vx" not in table or "vy" not in table:
        return None
    speed = rotation.length(columns(table, "vx", "vy") * 0.01)
    own, quantity = builder.quiet(), limits.ESTIMATED_SPEED
    return own.stream(builder.stamps(table), speed, "m/s", "GLOBAL_POSITION_INT", within=quantity)


def vibration_stream(builder: TelemetryBuilder) -> Stream | None:
    """Return ArduPilot's vibration level (n, 3) in m/s^2, None for other autopilots."""
    if builder.autopilot != ARDUPILOT:
        return None
    table = builder.packets("VIBRATION")
    return builder.column_stream(table, VIBRATION_COLUMNS, "m/s^2", "VIBRATION", limits.VIBRATION, frame="FRD")


def vibration_levels(builder: TelemetryBuilder) -> list[OnboardVibration]:
    """Return the vibration level of the worst axis; VIBRATION is of the primary IMU, taken as unit 0."""
    level = builder.log.vibration.level
    return [] if level is None else [OnboardVibration(0, "rest", level.source, level.t, level.x.max(axis=1))]


STREAMS = (
    Part("attitudes", "The attitude", attitudes),
    Part("truth", "The simulator's attitude", simulated_attitude),
    Part("parameters.lines", "PARAM_VALUE", lambda builder: parameters.parameter_lines(builder, "PARAM_VALUE")),
    Part("", "PARAM_VALUE", add_trim_and_declination),
    Part("vehicle", "HEARTBEAT", vehicle_type),
    Part("state.armed", "HEARTBEAT", armed_line),
    Part("state.mode", "HEARTBEAT", mode_line),
    Part("state.landed", "EXTENDED_SYS_STATE", landed_line),
    Part("setpoints.attitude", "ATTITUDE_TARGET", attitude_setpoint),
    Part("setpoints.rates", "ATTITUDE_TARGET", rate_setpoint_stream),
    Part("gnss", "GNSS", receivers),
    Part("utc_offset", "SYSTEM_TIME", utc_offset),
    Part("baro", "The barometer", baro_streams),
    Part("power.throttle", "VFR_HUD", throttle_stream),
    Part("airspeed", "VFR_HUD", airspeed_stream),
    Part("power.rpm", "Rotor speed", rpm_stream),
    Part("power.battery", "SYS_STATUS", battery_stream),
    Part("power.outputs", SERVO_OUTPUTS, motor_outputs),
    Part("power.escs", "ESC_TELEMETRY", esc_list),
    Part("processor.load", "SYS_STATUS", processor_load),
    Part("pilot.signal", "SYS_STATUS", radio_signal),
    Part("vibration.clippings", "Clipping", clippings),
    Part("vibration.level", "VIBRATION", vibration_stream),
    Part("vibration.levels", "VIBRATION", vibration_levels),
    Part("estimator.innovation_tests", "Test ratios", innovation_tests),
    Part("estimator.height", "GLOBAL_POSITION_INT", height_stream),
    Part("estimator.speed", "GLOBAL_POSITION_INT", speed_stream),
    Part("texts", "Texts", TelemetryBuilder.texts),
)

# --- figures of flight data -------------------------------------------------------------------------------------

DEGREES = float(np.degrees(1.0))
PANEL_ROWS: PanelRows = {
    "climb": (Row("onboard", "VFR_HUD.climb"), Row("onboard", "GLOBAL_POSITION_INT.vz", -1.0)),
    "speed": (Row("onboard", "VFR_HUD.groundspeed"),),
    "roll_rate": (Row("onboard", "ATTITUDE.rollspeed", DEGREES),),
    "pitch_rate": (Row("onboard", "ATTITUDE.pitchspeed", DEGREES),),
    "yaw_rate": (Row("onboard", "ATTITUDE.yawspeed", DEGREES),),
    "outputs": (Row("output {}", "SERVO_OUTPUT_RAW.servo{}_raw"),),
    "stick_pulses": tuple(
        Row(stick, f"{message}.chan#_raw")
        for message in ("RC_CHANNELS", "RC_CHANNELS_RAW")
        for stick in ("roll", "pitch", "throttle", "yaw")
    ),
    "channels": tuple(
        Row(f"channel {k}", f"{message}.chan{k}_raw")
        for message in ("RC_CHANNELS", "RC_CHANNELS_RAW")
        for k in range(5, 13)
    ),
    "volts": (Row("battery 2", "BATTERY2.voltage"),),
    "amperes": (Row("battery 2", "BATTERY2.current_battery"), Row("battery", "BATTERY_STATUS.current_battery")),
    "used": (Row("battery", "BATTERY_STATUS.current_consumed"),),
    "remaining": (Row("battery", "SYS_STATUS.battery_remaining"), Row("battery", "BATTERY_STATUS.battery_remaining")),
    "rails": (Row("board", "POWER_STATUS.Vcc"), Row("board", "HWSTATUS.Vcc"), Row("servo rail", "POWER_STATUS.Vservo")),
    "load": (Row("CPU", "SYS_STATUS.load"), Row("lost packets", "SYS_STATUS.drop_rate_comm")),
    "link": (
        Row("signal on the ground", "RADIO_STATUS.rssi"),
        Row("signal on board", "RADIO_STATUS.remrssi"),
        Row("noise on the ground", "RADIO_STATUS.noise"),
        Row("noise on board", "RADIO_STATUS.remnoise"),
        Row("receiver signal", "RC_CHANNELS.rssi"),
        Row("receiver signal", "RC_CHANNELS_RAW.rssi"),
    ),
    "temperature": (
        Row("IMU", "RAW_IMU.temperature"),
        Row("barometer", "SCALED_PRESSURE.temperature"),
        Row("barometer 2", "SCALED_PRESSURE2.temperature"),
        Row("battery", "BATTERY_STATUS.temperature"),
        Row("processor", "MCU_STATUS.MCU_temperature"),
    ),
}
