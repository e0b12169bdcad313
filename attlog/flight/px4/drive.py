"""Read motor outputs and the supply of the board from a PX4 log.

``actuator_motors`` (1.13 on) holds the normalised command of each motor, NaN while it is off; before,
``actuator_outputs`` holds pulses in us, DShot or CAN numbers by output.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from attlog.core.sorting import median
from attlog.flight import limits
from attlog.flight.builder import LogBuilder, columns, optional_column
from attlog.flight.drive import (
    MAX_ROTORS,
    PX4_FRAMES,
    SERVO_OUTPUTS,
    Esc,
    MotorOutputs,
    MotorReport,
    esc_telemetry,
    pulse_share,
    px4_geometry,
)
from attlog.flight.model import Array, Stream
from attlog.flight.px4.imu import TopicBuilder
from attlog.flight.vehicle import VehicleKind
from attlog.formats.table import Table

# Number of motors by the vehicle's name.
MOTOR_COUNT = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8}
# Function of motor 1 in PWM_MAIN_FUNCn.
FIRST_FUNCTION = 101
# Groups of outputs, by the start of their parameters; before 1.13 outputs had no functions.
MAIN, AUX = "PWM_MAIN", "PWM_AUX"
GROUPS = (MAIN, AUX, "UAVCAN_EC", "HIL_ACT")
MAX_OUTPUTS, MAX_ESCS = 16, 12
# Parameters of which every vehicle has one: up to 1.11, in 1.12, and from 1.13 on.
LIMIT_NAMES = ("PWM_MIN", "PWM_MAIN_MIN", "PWM_MAIN_MIN1", "PWM_MAIN_FUNC1")
# Limits of the pulses without parameters.
USUAL_PULSE_US = (1000.0, 2000.0)
# Largest normalised output, and largest pulse in us; CAN numbers reach 8191.
MAX_SHARE, MAX_PULSE_US, CAN_RANGE = 1.05, 2600.0, (0.0, 8191.0)
# Shortest pulse in us: with more than this share of lower values above 0 the outputs are DShot or CAN numbers.
MIN_PULSE_US, MIN_NUMBER_SHARE = 700.0, 0.01
# Greatest DShot number, default of the share DSHOT_MIN of it, and UAVCAN_ENABLE of CAN motors.
DSHOT_FULL, DSHOT_MIN, CAN_MOTORS = 1999.0, 0.055, 3.0


def motor_outputs(builder: TopicBuilder) -> MotorOutputs | None:
    """Return a multirotor's motor outputs between floor and ceiling of flight; None without records."""
    if builder.log.kind is not VehicleKind.MULTIROTOR:
        return None
    count, table = motor_count(builder.values, builder.log.vehicle), builder.table("actuator_motors")
    if count < 2 or int(builder.values.get("CA_R_REV", 0.0)) & ((1 << count) - 1):  # a reversed motor is not off
        return None
    names = [f"control[{k}]" for k in range(count)]
    if table is not None and all(name in table for name in names):
        return _outputs(builder, table, columns(table, *names), names, "actuator_motors", True)
    found, (group, numbers) = None, motor_numbers(builder.values, count)
    wanted, moved = [f"output[{n - 1}]" for n in numbers], 0.0
    for instance, each in builder.topics("actuator_outputs").items():
        if not wanted or not all(name in each for name in wanted):
            continue
        x = columns(each, *wanted)
        varies = float(median(np.std(np.nan_to_num(x), axis=0))) if len(x) else 0.0
        if varies > moved:
            found, moved = (each, x, f"actuator_outputs:{instance}"), varies
    if found is None:
        return None
    if not group:  # before 1.13 the second instance of a board with IO processor are its auxiliary outputs
        group = AUX if found[2].endswith(":1") and builder.values.get("SYS_USE_IO", 0.0) else MAIN
    low, high, known = output_limits(found[1], builder.values, group, numbers)
    return _outputs(builder, found[0], pulse_share(found[1], low, high, 0.0, 1.0), wanted, found[2], known)


def telemetry_outputs(builder: LogBuilder, values: Mapping[str, float], table: Table) -> MotorOutputs | None:
    """Return a multirotor's motor outputs from SERVO_OUTPUT_RAW of PX4, whose first port has the main outputs."""
    count = motor_count(values, builder.log.vehicle)
    group, numbers = motor_numbers(values, count)
    names = [f"servo{n}_raw" for n in numbers]
    if count < 2 or group not in ("", MAIN) or not all(name in table for name in names):
        return None
    x = columns(table, *names)
    low, high, known = output_limits(x, values, MAIN, numbers)
    known &= any(name in values for name in LIMIT_NAMES)  # else the list of parameters is sent in part
    stream = builder.quiet().stream(builder.stamps(table), pulse_share(x, low, high, 0.0, 1.0), "1", SERVO_OUTPUTS)
    geometry = px4_geometry(values, count)
    return None if stream is None else MotorOutputs(stream.t, stream.x, stream.source, names, known, geometry)


def _outputs(
    builder: TopicBuilder, table: Table, x: Array, names: list[str], source: str, known: bool
) -> MotorOutputs | None:
    stream = builder.quiet().stream(builder.stamps(table), x, "1", source, allow_nan=True)
    if stream is None:
        return None
    found = MotorOutputs(stream.t, stream.x, source, names, known, px4_geometry(builder.values, len(names)))
    found.reports = failure_reports(builder)
    return found


def motor_count(values: Mapping[str, float], vehicle: str) -> int:
    """Return the number of motors by parameter, airframe or the vehicle's name, 0 if unknown."""
    count = int(values.get("CA_ROTOR_COUNT", 0.0))
    if not count:
        row = PX4_FRAMES.get(int(values.get("SYS_AUTOSTART", 0.0) // 1000), "")
        count = len(row.split()) or MOTOR_COUNT.get(vehicle, 0)
    return min(count, MAX_ROTORS)


def esc_list(builder: TopicBuilder) -> list[Esc]:
    """Return the speed controllers whose rotors turned, from esc_status; since 1.13 their motors are logged."""
    table, found = builder.table("esc_status"), []
    if table is None:
        return []
    stamps = builder.stamps(table)
    near = builder.near(stamps)
    for k in range(MAX_ESCS):
        if f"esc[{k}].esc_rpm" not in table:
            break
        names = [f"esc[{k}].{name}" for name in ("esc_rpm", "esc_current", "esc_temperature")]
        x = np.column_stack([optional_column(table, name) for name in names])
        functions = optional_column(table, f"esc[{k}].actuator_function")
        motor = float(median(functions)) - FIRST_FUNCTION + 1
        known = 1 <= motor <= MAX_ROTORS
        esc = esc_telemetry(builder.seconds(stamps[near]), x[near], f"esc[{k}]", int(motor) if known else None)
        found += [] if esc is None else [esc]
    return found


def motor_numbers(values: Mapping[str, float], count: int) -> tuple[str, list[int]]:
    """Return the group of the motors' outputs and their numbers (motors) from 1, by motor.

    Without assigned functions the first outputs, in no group; no numbers where groups share the motors, since the
    topic's instances have no names.
    """
    shared = False
    for group in GROUPS:
        functions = {int(values.get(f"{group}_FUNC{n}", 0.0)) - FIRST_FUNCTION: n for n in range(1, MAX_OUTPUTS + 1)}
        held = [functions[motor] for motor in range(count) if motor in functions]
        if len(held) == count:
            return group, held
        shared |= bool(held)
    return "", [] if shared else list(range(1, count + 1))


def output_limits(
    x: Array, values: Mapping[str, float], group: str, numbers: Sequence[int]
) -> tuple[Array, Array, bool]:
    """Return outputs (motors,) at floor and ceiling by size and parameters, and whether they are known."""
    largest, low, high, known = float(np.nanmax(x, initial=0.0)), *USUAL_PULSE_US, bool(values)  # firmware’s defaults
    positive = x[x > 0.0]
    if largest <= MAX_SHARE:
        low, high, known = (-1.0 if np.nanmin(x, initial=0.0) < 0.0 else 0.0), 1.0, True
    elif largest > MAX_PULSE_US:
        low, high, known = *CAN_RANGE, True
    elif np.mean(positive < MIN_PULSE_US) > MIN_NUMBER_SHARE:
        if values.get("DSHOT_CONFIG", 0.0) > 0.0:
            low, high, known = values.get("DSHOT_MIN", DSHOT_MIN) * DSHOT_FULL, DSHOT_FULL, True
        else:
            low, high, known = *CAN_RANGE, values.get("UAVCAN_ENABLE") == CAN_MOTORS
    else:
        pairs = np.array([[pulse_limit(values, group, n, end) for end in ("MIN", "MAX")] for n in numbers])
        if (pairs[:, 1] > pairs[:, 0]).all():
            return pairs[:, 0], pairs[:, 1], known
    return np.full(len(numbers), low), np.full(len(numbers), high), known


def pulse_limit(values: Mapping[str, float], group: str, number: int, end: str) -> float:
    """Return the pulse in us of an output at its ``end``, MIN or MAX.

    That of the output itself counts, but where all outputs of the group have a value (up to 1.13), its default yields.
    """
    usual = USUAL_PULSE_US[end == "MAX"]
    common = next((x for name in (f"{group}_{end}", f"PWM_{end}") if (x := values.get(name, 0.0)) > 0.0), 0.0)
    own = values.get(f"{group}_{end}{number}", 0.0)
    return own if own > 0.0 and not (common and own == usual) else common or usual


def failure_reports(builder: TopicBuilder) -> list[MotorReport]:
    """Return the motor failures that the failure detector or the control allocator reports, each once."""
    found: dict[tuple[str, int], MotorReport] = {}
    for name, column in (
        ("failure_detector_status", "motor_failure_mask"),
        ("control_allocator_status", "handled_motor_failure_mask"),
        ("failure_detector_status", "fd_motor"),
    ):
        table = builder.table(name)
        if table is None or column not in table or any(key[0] == name for key in found):
            continue
        t, mask = builder.seconds(builder.stamps(table)), table[column].astype(np.int64)
        for motor in range(1, MAX_ROTORS + 1) if column.endswith("mask") else (0,):
            on = np.flatnonzero(mask & (1 << (motor - 1)) if motor else mask)
            if len(on):
                found[name, motor] = MotorReport(float(t[on[0]]), motor, f"{name}.{column} {int(mask[on[0]])}")
    return sorted(found.values(), key=lambda report: report.t)


def board_voltage(builder: TopicBuilder) -> Stream | None:
    """Return the supply of the autopilot (n, 1) in V, from system_power."""
    table = builder.table("system_power")
    return builder.quiet().column_stream(table, ("voltage5v_v",), "V", "system_power.voltage5v_v", limits.VOLTAGE)


def overcurrent(builder: TopicBuilder) -> Stream | None:
    """Return 1 while the board reports overcurrent of a supply (n, 1), from system_power."""
    table = builder.table("system_power")
    names = [n for n in ("periph_5v_oc", "hipower_5v_oc") if table is not None and n in table]
    if table is None or not names:
        return None
    on = (columns(table, *names).max(axis=1) > 0).astype(np.float64)
    return builder.quiet().stream(builder.stamps(table), on, "1", "system_power")
