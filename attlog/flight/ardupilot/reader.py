"""Read ArduPilot DataFlash logs (binary and text) as a flight log, from 3.1 to 4.7.

Records are interpreted by their columns, not by version: early logs have no version, and forks have arbitrary ones.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from attlog.core.sorting import median
from attlog.flight import parameters
from attlog.flight.advice import VehicleSettings
from attlog.flight.ardupilot import drive, estimator, sensors, vehicle
from attlog.flight.ardupilot.ekf3_inputs import read_inputs
from attlog.flight.ardupilot.imu import DataflashBuilder, imu_candidates, primary_core, unit_of_core
from attlog.flight.builder import Part
from attlog.flight.compass import choose_mag
from attlog.flight.gnss import utc_offset
from attlog.flight.imu import FlownUnits, add_imus, best_per_unit, longest_held
from attlog.flight.model import Array, Firmware, FlightLog
from attlog.formats.table import Messages

# Parameter of the declination with its factor to degrees.
DECLINATION_PARAMETERS = {"COMPASS_DEC": math.degrees(1.0)}
TRIM_PARAMETERS = ("AHRS_TRIM_X", "AHRS_TRIM_Y")
# Records whose time is t = 0 in a log without inertial data.
FIRST_RECORDS = ("ATT", "AHR2", "GPS", "CTUN")

ATTITUDES = (
    Part("attitudes", "The attitudes", estimator.attitudes),
    Part("onboard", "The onboard attitude", lambda builder: onboard_attitude(builder)),
    Part("truth", "SIM", estimator.simulated_attitude),
    Part("poses", "VISP", estimator.vision_poses),
    Part("setpoints.attitude", "Set-points", estimator.attitude_setpoint),
    Part("parameters.lines", "PARM", lambda builder: parameters.parameter_lines(builder, "PARM")),
)
STREAMS = (
    Part("vehicle", "The vehicle", vehicle.vehicle_type),
    Part("state.armed", "Arming", vehicle.armed_line),
    Part("state.landed", "Landing", vehicle.landed_line),
    Part("state.mode", "The flight mode", vehicle.mode_line),
    Part("state.mode_reason", "The reason of the flight mode", vehicle.mode_reason_line),
    Part("pilot.sticks", "RCIN", vehicle.stick_stream),
    Part("pilot.signal", "RCIN", vehicle.radio_signal),
    Part("setpoints.rates", "The rate set-point", sensors.rate_setpoint_stream),
    Part("gnss", "GPS", sensors.receivers),
    Part("utc_offset", "The date", utc_offset),
    Part("baro", "BARO", sensors.baro_streams),
    Part("rangefinder", "The rangefinder", sensors.rangefinder_stream),
    Part("airspeed", "ARSP", sensors.airspeed_stream),
    Part("power.throttle", "Throttle", sensors.throttle_stream),
    Part("power.motors", "Motor outputs", sensors.motor_outputs),
    Part("power.rpm", "Rotor speed", sensors.rpm_stream),
    Part("power.battery", "The battery", sensors.battery_stream),
    Part("processor.loops", "PM", sensors.loop_stream),
    Part("processor.load", "PM", sensors.processor_load),
    Part("estimator.acc_bias", "XKF2", estimator.acc_bias_stream),
    Part("estimator.gyro_bias", "The onboard gyro bias", estimator.gyro_bias_stream),
    Part("estimator.height", "POS", estimator.height_stream),
    Part("vibration.level", "VIBE", sensors.vibration_stream),
    Part("vibration.levels", "VIBE", sensors.vibration_levels),
    Part("vibration.bursts", "ISBH and ISBD", sensors.read_bursts),
    Part("estimator.yaw", "The yaw estimator", estimator.yaw_estimator_stream),
    Part("vibration.clippings", "Clipping", sensors.clippings),
    Part("estimator.innovation_tests", "Test ratios", estimator.innovation_tests),
    Part("estimator.lane", "The EKF's lane", estimator.primary_core_line),
    Part("", "ERR and EV", vehicle.report_events),
    Part("texts", "Texts", lambda builder: builder.texts(lambda at: int(builder.clock.at(np.array([at]))[0]))),
    Part("power.outputs", "RCOU", drive.motor_outputs),
    Part("power.escs", "ESC", drive.esc_list),
    Part("power.board", "POWR", drive.board_voltage),
    Part("power.overcurrent", "POWR", drive.overcurrent),
)


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """Read the flight in an ArduPilot log; ``imu`` and ``mag`` select other units than those that flew."""
    builder = DataflashBuilder(messages)
    log, read_optional = builder.log, builder.read_optional
    _report_clock(builder)
    candidates = best_per_unit(builder, imu_candidates(builder))
    flown = read_optional(
        "The primary EKF lane", partial(flown_units, builder, [c.index for c in candidates]), FlownUnits()
    )
    flew, why = longest_held(flown.t_us, flown.units), f"it fed the primary EKF lane ({flown.source})"
    if flew is None and candidates:
        flew, why = candidates[0].index, "the first; the log does not say which is primary"
    log.firmware = read_optional("The firmware", partial(vehicle.read_firmware, messages), Firmware("ArduPilot"))
    builder.family = read_optional("The vehicle", partial(vehicle.detect_family, messages), "")
    log.settings = VehicleSettings("ArduPilot", log.firmware.version, builder.family, builder.values)
    add_imus(builder, candidates, flew, why, imu, partial(first_stamp, builder))
    log.imu_that_flew = read_optional(
        "The primary EKF lane", partial(builder.time_line, flown.t_us, flown.units, flown.source), None
    )
    log.mags = read_optional("MAG", partial(sensors.magnetometers, builder), [])
    preferred = sensors.primary_compass(builder)
    log.mag = read_optional("The compass", partial(choose_mag, builder, preferred, "the primary compass", mag), None)
    builder.read_parts(ATTITUDES)
    parameters.add_values(builder, DECLINATION_PARAMETERS)
    log.parameters.trim, log.parameters.trim_source = read_trim(log), ", ".join(TRIM_PARAMETERS)
    log.vehicle = "unknown"
    builder.read_parts(STREAMS)
    log.simulated = vehicle.is_simulated("SIM" in messages.names(), log.texts, builder.values)
    log.estimator.inputs = partial(read_inputs, builder)
    return log


def _report_clock(builder: DataflashBuilder) -> None:
    """Report logs of early versions: without any stamps, or with stamps in GPS records only."""
    if not builder.clock.known:
        text = (
            "No record of this log carries a time stamp, as in ArduPilot 3.0 and older: nothing in it can be replayed."
        )
        builder.problem("no_clock", "error", text)
    elif builder.clock.interpolates:
        text = "Only GPS records carry a time, as in ArduPilot 3.1 and older: others are placed between them, to 0.2 s."
        builder.problem("clock_between_gps", "note", text)


def flown_units(builder: DataflashBuilder, have: list[int]) -> FlownUnits:
    """Return the IMU of the primary EKF lane over time; ``have``: logged units."""
    family, t_us, lanes = primary_core(builder)
    unit = {core: unit_of_core(builder, family, core, have) for core in set(lanes)}
    return FlownUnits(t_us, [unit[core] for core in lanes], f"{family}F4.PI")


def first_stamp(builder: DataflashBuilder) -> int:
    """Return t = 0 in us for a log without inertial data, 0 without stamps."""
    for name in FIRST_RECORDS:
        table = builder.messages.first(name)
        stamps = None if table is None else builder.clock.of_samples(table)
        if stamps is not None and len(stamps):
            return int(median(stamps[:5]))
    return 0


def onboard_attitude(builder: DataflashBuilder) -> str | None:
    """Return the name of the attitude that flew, and note why it is not ATT."""
    family, _, lanes = primary_core(builder)
    name = estimator.onboard_source(builder.log.attitudes, family, lanes[-1] if lanes else None)
    if name == "ANG":
        builder.log.choices["onboard"] = "ANG holds the values of ATT at loop rate"
    elif name not in (None, "ATT"):
        builder.log.choices["onboard"] = "the log holds neither ATT nor ANG"
    return name


def read_trim(log: FlightLog) -> Array | None:
    """Return AHRS_TRIM as a rotation vector (3,) in rad, None if not logged."""
    x, y = (log.param(name) for name in TRIM_PARAMETERS)
    if x is None or y is None or not (math.isfinite(x) and math.isfinite(y)):
        return None
    return np.array([x, y, 0.0])
