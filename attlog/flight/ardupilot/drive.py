"""Read motor outputs and the supply of the board from ArduPilot’s logs and telemetry.

Before 3.4 the flight floor was THR_MIN and the ceiling the pulse limit; since then MOT_SPIN_MIN and MOT_SPIN_MAX bound
the outputs of flight (AP_MotorsMulticopter).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from attlog.flight import limits
from attlog.flight.ardupilot.imu import DataflashBuilder
from attlog.flight.builder import LogBuilder, columns, optional_column
from attlog.flight.drive import Esc, MotorOutputs, MotorReport, ardupilot_geometry, esc_telemetry, pulse_share
from attlog.flight.model import Array, FlightLog, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.formats.table import Table

# SERVOn_FUNCTION of motor m: 32 + m, from motor 9 on 73 + m.
FIRST_FUNCTIONS = {32 + m: m for m in range(1, 9)} | {73 + m: m for m in range(9, 13)}
# Number of outputs and of motors of the largest frame.
MAX_OUTPUTS, MAX_MOTORS = 16, 12
# Number of motors by the vehicle's name; of a tricopter output 3 is no motor.
MOTOR_COUNT = {"quadrotor": 4, "hexarotor": 6, "octorotor": 8, "dodecarotor": 12}
# FRAME_CLASS of a frame whose motors push both ways (6DoF scripting).
SIX_AXES_CLASS = 16
FRAME_TEXT = re.compile(r"frame: (\w+)", re.IGNORECASE)
# Pulse range in us without parameters, of digital protocols (MOT_PWM_TYPE 4 to 7), and the least plausible range.
USUAL_PULSE_US, DIGITAL_TYPES, MIN_PULSE_RANGE_US = (1000.0, 2000.0), range(4, 8), 100.0
# Defaults of MOT_SPIN_MAX, THR_MIN / 1000, and the ceiling of 3.3, which has MOT_THST_EXPO but no MOT_SPIN_MIN.
SPIN_MAX, THROTTLE_MIN, EXPO_CEILING = 0.95, 0.13, 0.95
# A motor's pulses move by this in a log of a flight; those of a free output do not.
MIN_MOVED_US = 100.0
THRUST_LOSS = re.compile(r"potential thrust loss \((\d+)\)", re.IGNORECASE)
# POWR.Flags: overcurrent of the peripheral supplies.
OVERCURRENT_FLAGS = 8 | 16


def motor_outputs(builder: DataflashBuilder) -> MotorOutputs | None:
    """Return a multirotor's motor outputs between floor and ceiling of flight; None without records.

    From RCOU, up to Copter 3.1 from MOT, which counts motors and not outputs.
    """
    for name, prefixes in (("RCOU", ("C", "Ch", "Chan")), ("MOT", ("Mot",))):
        table = builder.sampled(name)
        prefix = None if table is None else next((p for p in prefixes if f"{p}1" in table), None)
        if table is not None and prefix is not None:
            return outputs_of(builder, builder.values, table, f"{prefix}{{}}", name)
    return None


def outputs_of(
    builder: LogBuilder, values: Mapping[str, float], table: Table, column: str, source: str
) -> MotorOutputs | None:
    """Return a multirotor's motor outputs from pulses in us; ``column``: name of a column with {} for the output."""
    log = builder.log
    if log.kind is not VehicleKind.MULTIROTOR or values.get("FRAME_CLASS") == SIX_AXES_CLASS:
        return None
    outputs = _motor_numbers(table, column, values, log.vehicle)
    names = [column.format(n) for n in outputs]
    if len(names) < 2:
        return None
    low, high, known = pulse_limits(values)
    floor, ceiling = flight_limits(values) if known else (0.0, 1.0)
    x = pulse_share(columns(table, *names), low, high, floor, ceiling)
    stream = builder.quiet().stream(builder.stamps(table), x, "1", source)
    if stream is None:
        return None
    frame = next((match[1].upper() for text in builder.messages.texts if (match := FRAME_TEXT.search(text.text))), "")
    geometry = ardupilot_geometry(values, len(names), log.simulated, frame)
    found = MotorOutputs(stream.t, stream.x, source, names, known, geometry)
    found.reports = [
        MotorReport(t, int(match[1]), text) for t, _, text in log.texts if (match := THRUST_LOSS.search(text))
    ]
    found.changes = function_changes(log, outputs)
    return found


def esc_list(builder: DataflashBuilder) -> list[Esc]:
    """Return the speed controllers whose rotors turned, from ESC; their numbers are not those of the motors."""
    found = []
    for unit, table in sorted(builder.units("ESC").items()):
        if "RPM" not in table or len(table) < 2:
            continue
        x = np.column_stack([optional_column(table, name) for name in ("RPM", "Curr", "Temp")])
        stamps = builder.stamps(table)
        near = builder.near(stamps)
        found.append(esc_telemetry(builder.seconds(stamps[near]), x[near], f"ESC[{unit}]"))
    return [esc for esc in found if esc is not None]


def _motor_numbers(table: Table, column: str, values: Mapping[str, float], vehicle: str) -> list[int]:
    """Return the outputs of the motors from number 1 on.

    By SERVOn_FUNCTION, else the first outputs: as many as the frame has. An unknown frame is a quadrotor where four
    outputs move; more may drive a gimbal.
    """
    held: dict[int, int] = {}
    for n in range(1, MAX_OUTPUTS + 1):
        motor = FIRST_FUNCTIONS.get(int(values.get(f"SERVO{n}_FUNCTION", 0.0)))
        if motor is not None and column.format(n) in table:
            held.setdefault(motor, n)
    count = MOTOR_COUNT.get(vehicle)
    if held:  # all of them, not those of this message alone
        whole = sorted(held) == list(range(1, (count or len(held)) + 1))
        return [held[motor] for motor in sorted(held)] if whole else []
    have = [n for n in range(1, MAX_MOTORS + 1) if column.format(n) in table]
    if count is not None:
        return have[:count] if len(have) >= count else []
    moved = [float(np.ptp(table.value(column.format(n)))) >= MIN_MOVED_US if len(table) else False for n in have]
    count = next((k for k, moves in enumerate(moved) if not moves), len(have))
    return have[:count] if count == MOTOR_COUNT["quadrotor"] else []


def pulse_limits(values: Mapping[str, float]) -> tuple[float, float, bool]:
    """Return least and greatest pulse in us, and whether parameters give them."""
    channel = int(values.get("RCMAP_THROTTLE", 3.0))
    low = values.get("MOT_PWM_MIN") or values.get(f"RC{channel}_MIN")
    high = values.get("MOT_PWM_MAX") or values.get(f"RC{channel}_MAX")
    if values.get("MOT_PWM_TYPE") in DIGITAL_TYPES:
        return *USUAL_PULSE_US, True
    if not low or not high or high - low < MIN_PULSE_RANGE_US:
        return *USUAL_PULSE_US, False
    return low, high, True


def flight_limits(values: Mapping[str, float]) -> tuple[float, float]:
    """Return floor and ceiling of flight as shares of the pulse range."""
    least = values.get("MOT_SPIN_MIN")
    if least is not None:
        greatest = values.get("MOT_SPIN_MAX", SPIN_MAX)
        return (least, greatest) if 0.0 <= least < greatest <= 1.0 else (0.0, 1.0)
    floor = 1e-3 * values["THR_MIN"] if "THR_MIN" in values else THROTTLE_MIN
    return (floor if 0.0 <= floor < 0.5 else THROTTLE_MIN), EXPO_CEILING if "MOT_THST_EXPO" in values else 1.0


def function_changes(log: FlightLog, outputs: list[int]) -> list[tuple[float, str]]:
    """Return when the function of a motor's output was changed after boot, as time and sentence."""
    found = []
    for motor, n in enumerate(outputs, 1):
        parameter = f"SERVO{n}_FUNCTION"
        line = log.parameters.lines.get(parameter)
        for k in range(1, 0 if line is None else len(line.value)):
            assert line is not None
            before, after, t = line.value[k - 1], line.value[k], float(line.t[k])
            found.append((t, f"{parameter} of motor {motor} changed from {before:g} to {after:g} at {t:.1f} s"))
    return sorted(found)


def board_voltage(builder: DataflashBuilder) -> Stream | None:
    """Return the supply of the autopilot (n, 1) in V, from POWR."""
    table = builder.sampled("POWR", "Vcc")
    return builder.quiet().column_stream(table, ("Vcc",), "V", "POWR.Vcc", limits.VOLTAGE)


def overcurrent(builder: DataflashBuilder) -> Stream | None:
    """Return 1 while the board reports overcurrent of a supply (n, 1), from POWR.Flags."""
    table = builder.sampled("POWR", "Flags")
    if table is None:
        return None
    flags: Array = (table["Flags"].astype(np.int64) & OVERCURRENT_FLAGS != 0).astype(np.float64)
    return builder.quiet().stream(builder.stamps(table), flags, "1", "POWR.Flags")
