"""Read PX4 logs (ULog) as a flight log, from 1.5 to 1.18.

Topics are interpreted by their fields and types, not by version number: old logs have none, and development builds
have that of the next release.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from attlog.core.sorting import median
from attlog.flight import parameters
from attlog.flight.advice import VehicleSettings
from attlog.flight.builder import Part
from attlog.flight.compass import choose_mag
from attlog.flight.gnss import utc_offset
from attlog.flight.imu import FlownUnits, add_imus, best_per_unit, longest_held
from attlog.flight.model import Firmware, FlightLog
from attlog.flight.px4 import drive, estimator, sensors
from attlog.flight.px4.ekf2_inputs import read_inputs
from attlog.flight.px4.imu import TopicBuilder, clippings, flown_units, imu_candidates
from attlog.flight.timestamps import read_stamps
from attlog.flight.vehicle import px4_version
from attlog.formats.table import Messages

# Parameters of the declination with their factor to degrees, those of the newer estimator first.
DECLINATION_PARAMETERS = {"EKF2_MAG_DECL": 1.0, "ATT_MAG_DECL": 1.0}
# Topics that identify PX4 or a fork; other programs write ULogs as well.
PX4_TOPICS = ("vehicle_status", "sensor_combined", "vehicle_attitude")
# Parameters that every PX4 has; other programs write parameters as well.
PX4_PARAMETERS = ("SYS_AUTOSTART", "MAV_SYS_ID", "SENS_BOARD_ROT")
# Topics whose time is t = 0 in a log without inertial data.
FIRST_TOPICS = ("vehicle_attitude", "vehicle_status", "vehicle_gps_position")

STREAMS = (
    Part("attitudes", "The attitudes", estimator.attitudes),
    Part(
        "truth",
        "vehicle_attitude_groundtruth",
        lambda builder: estimator.read_attitude(builder, "vehicle_attitude_groundtruth"),
    ),
    Part("parameters.lines", "Parameters", lambda builder: parameters.parameter_lines(builder, "parameter")),
    Part("", "Parameters", lambda builder: parameters.add_values(builder, DECLINATION_PARAMETERS)),
    Part("vehicle", "The vehicle", sensors.vehicle_type),
    Part("simulated", "The simulator", sensors.is_simulated),
    Part("setpoints.attitude", "The attitude set-point", estimator.attitude_setpoint),
    Part("pilot.sticks", "manual_control_setpoint", sensors.stick_stream),
    Part("pilot.signal", "The radio", sensors.radio_signal),
    Part("setpoints.rates", "The rate set-point", sensors.rate_setpoint_stream),
    Part("state.armed", "Arming", sensors.armed_line),
    Part("state.mode", "The flight mode", sensors.mode_line),
    Part("state.mode_reason", "The reason of the flight mode", sensors.mode_reason_line),
    Part("state.landed", "The land detector", sensors.landed_line),
    Part("gnss", "GNSS", sensors.receivers),
    Part("utc_offset", "The date", utc_offset),
    Part("baro", "The barometer", sensors.baro_streams),
    Part("rangefinder", "The rangefinder", sensors.rangefinder_stream),
    Part("airspeed", "Airspeed", sensors.airspeed_stream),
    Part("power.throttle", "Throttle", sensors.throttle_stream),
    Part("power.rpm", "Rotor speed", sensors.rpm_stream),
    Part("power.battery", "The battery", sensors.battery_stream),
    Part("power.outputs", "Motor outputs", drive.motor_outputs),
    Part("power.escs", "Speed controllers", drive.esc_list),
    Part("power.board", "system_power", drive.board_voltage),
    Part("power.overcurrent", "system_power", drive.overcurrent),
    Part("processor.load", "cpuload", lambda builder: sensors.cpuload_stream(builder, "load")),
    Part("processor.memory", "cpuload", lambda builder: sensors.cpuload_stream(builder, "ram_usage")),
    Part("estimator.acc_bias", "estimator_sensor_bias", estimator.acc_bias_stream),
    Part("estimator.gyro_bias", "The onboard gyro bias", estimator.gyro_bias_stream),
    Part("estimator.yaw", "The yaw estimator", estimator.yaw_estimator_stream),
    Part("estimator.height", "vehicle_local_position", estimator.height_stream),
    Part("estimator.speed", "vehicle_local_position", estimator.speed_stream),
    Part("vibration.clippings", "Clipping", clippings),
    Part("vibration.levels", "The vibration metric", sensors.vibration_levels),
    Part("vibration.spectrum", "sensor_gyro_fft", sensors.onboard_spectrum),
    Part("estimator.innovation_tests", "Test ratios", estimator.innovation_tests),
    Part("estimator.lane", "The EKF's lane", estimator.selected_instance_line),
    Part("", "estimator_status", estimator.report_faults),
    Part("", "vehicle_status", estimator.report_failsafe),
    Part("texts", "Texts", TopicBuilder.texts),
)


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """Read the flight in a PX4 ULog; ``imu`` and ``mag`` select other instances than those that flew."""
    builder = TopicBuilder(messages)
    log, read_optional = builder.log, builder.read_optional
    flown = read_optional("The choice of IMU", partial(flown_units, builder), FlownUnits())
    flew = longest_held(flown.t_us, flown.units)
    why = f"it flew ({flown.source})" if flown.source else "the only source of the voted unit"
    candidates = best_per_unit(builder, imu_candidates(builder, 0 if flew is None else flew))
    if flew is None and len(candidates) > 1:
        flew, why = next((c.index for c in candidates if c.source == "sensor_combined"), None), "it is the voted unit"
    log.firmware = read_optional("The firmware", partial(read_firmware, messages), Firmware(""))
    known = any(name in PX4_TOPICS for name, _ in messages.tables) or "px4" in log.firmware.name.lower()
    if known or not builder.values.keys().isdisjoint(PX4_PARAMETERS):
        log.settings = VehicleSettings("PX4", log.firmware.version, values=builder.values)
    else:
        log.settings = VehicleSettings("other", name=log.firmware.name or "Another program")
    add_imus(builder, candidates, flew, why, imu, partial(first_stamp, builder))
    log.imu_that_flew = builder.time_line(flown.t_us, flown.units, flown.source)
    _report_switches(builder)
    log.mags = read_optional("The magnetometer", partial(sensors.magnetometers, builder), [])
    used = read_optional("The choice of compass", partial(sensors.flown_compass, builder), None)
    log.mag = read_optional("The compass", partial(choose_mag, builder, used, "it flew", mag), None)
    log.vehicle = "unknown"
    builder.read_parts(STREAMS)
    log.onboard = "vehicle_attitude" if "vehicle_attitude" in log.attitudes else None
    if "EKF2_GYR_NOISE" in builder.values:
        log.estimator.inputs = partial(read_inputs, messages, builder.values)
    return log


def read_firmware(messages: Messages) -> Firmware:
    """Return the firmware; development builds have the next release number and "dev"."""
    info = messages.info
    number = info.get("ver_sw_release")
    version = px4_version(int(number)) if isinstance(number, (int, np.integer)) and number > 0 else ""
    return Firmware(str(info.get("sys_name", "")), version, str(info.get("ver_sw", "")), str(info.get("ver_hw", "")))


def first_stamp(builder: TopicBuilder) -> int:
    """Return t = 0 in us for a log without inertial data, 0 without stamps."""
    for name in FIRST_TOPICS:
        table = builder.table(name)
        if table is not None and "timestamp" in table:
            return int(median(builder.stamps(table)[:5]))
    tables = [table for table in builder.messages.tables.values() if "timestamp" in table and len(table)]
    return int(min((read_stamps(table, "timestamp")[0] for table in tables), default=0))


def _report_switches(builder: TopicBuilder) -> None:
    """Report changes of the sensor in ``sensor_combined``, if that is replayed."""
    line, unit = builder.log.imu_that_flew, builder.log.replay_imu
    if line is None or len(line.value) < 2 or unit is None or unit.gyro.source != "sensor_combined":
        return
    text = f"The autopilot changed its gyro ({' -> '.join(str(u) for u in line.value[:6])}): "
    text += "sensor_combined jumps from one sensor to the other."
    builder.problem("imu_switched", "warning", text, t=float(line.t[1]), count=len(line.value) - 1)
