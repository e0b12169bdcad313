"""Registry of checks, one row for each question, and usual causes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from attlog.core.errors import call_guarded
from attlog.core.log_cache import log_cache
from attlog.health import (
    accelerometer,
    attitude,
    baro,
    compass,
    compass_mounting,
    consistency,
    delays,
    drive,
    gnss,
    gravity,
    gyro,
    gyro_scale,
    heading,
    hover,
    imu_checks,
    innovations,
    notch,
    safety,
    sources,
    supply,
    timing,
    vibration,
)
from attlog.health.check import BUG, Check, HealthCase, Weight, finite, spare_sensors

Maker = Callable[[HealthCase], list[Check]]


class Row(NamedTuple):
    """Registry row of a check: title, maker, and kind of finding.

    ``warning``, ``fault``: severity of the finding by verdict. ``remedy``: key of :meth:`FlightLog.remedy`, None where
    the check itself has an action.
    """

    title: str
    make: Maker
    kind: str
    warning: Weight = "warning"
    fault: Weight = "warning"
    remedy: str | None = None


# Order of rows: that of tables, and of equally severe signs of a finding. A maker runs at its first row, so a check
# that reads ``HealthCase.found`` comes after its inputs; makers in LAST run at the end.
CHECKS: Mapping[str, Row] = {
    "rate": Row("IMU rate", timing.timing_checks, "rate", warning="note", fault="serious"),
    "gaps": Row("gaps of the IMU", timing.timing_checks, "gaps", remedy="gaps"),
    "jitter": Row("jitter", timing.timing_checks, "jitter", warning="note", fault="note", remedy="gaps"),
    "filter_delay": Row("delay of the gyro's filter", delays.imu_delay_checks, "delay", warning="note"),
    "imu_delay": Row("IMU delay", delays.imu_delay_checks, "imu_delay", fault="serious", remedy="clock"),
    "gyro_dead": Row("dead gyro", gyro.gyro_checks, "gyro", fault="serious"),
    "gyro_range": Row("gyro range", gyro.gyro_checks, "gyro_range"),
    "gyro_bias": Row("gyro bias", gyro.gyro_bias_checks, "gyro_bias", fault="serious", remedy="gyro_bias"),
    "frozen_gyro": Row("frozen gyro", timing.frozen_checks, "frozen_gyro", fault="serious", remedy="bus"),
    "frozen_sensors": Row("frozen sensors", timing.frozen_checks, "frozen_sensors", fault="serious", remedy="bus"),
    "gyro_spikes": Row("gyro spikes", timing.sensor_fault_checks, "gyro_spikes", fault="serious", remedy="bus"),
    "accelerometer_axes": Row(
        "accelerometer axes", timing.sensor_fault_checks, "accelerometer_axes", fault="serious", remedy="mounting"
    ),
    "accelerometer_delay": Row(
        "accelerometer delay", timing.sensor_fault_checks, "accelerometer_delay", fault="serious", remedy="bus"
    ),
    "compass_orientation": Row("compass mounting", compass_mounting.orientation_checks, "compass", fault="serious"),
    "compass_iron": Row("iron near the compass", timing.sensor_fault_checks, "compass", warning="note", fault="note"),
    "onboard_against_truth": Row("attitude against truth", attitude.smoother_checks, "attitude", fault="serious"),
    "onboard_against_smoother": Row("attitude against smoother", attitude.smoother_checks, "attitude", fault="serious"),
    "heading_by_gnss": Row(
        "heading by GNSS", heading.gnss_heading_checks, "compass", fault="serious", remedy="compass"
    ),
    "vibration_level": Row("vibration", vibration.vibration_checks, "vibration", remedy="vibration"),
    "clipping": Row("clipping", vibration.vibration_checks, "vibration"),
    "vertical_force": Row(
        "vertical force", vibration.vertical_force_check, "vibration", fault="serious", remedy="vibration"
    ),
    "log_clock": Row("clock of the log", gyro_scale.scale_checks, "log_clock", warning="note"),
    "main_loop": Row("main loop", gyro_scale.scale_checks, "main_loop", warning="note"),
    "processor": Row("processor", timing.processor_checks, "main_loop", warning="note"),
    "gyro_scale": Row("gyro scale", gyro_scale.scale_checks, "gyro_scale", fault="serious"),
    "gyro_bias_step": Row("step of the gyro bias", gyro.step_checks, "gyro_bias", remedy="bus"),
    "force_axes": Row(
        "axes of the force",
        accelerometer.accelerometer_checks,
        "accelerometer_axes",
        fault="serious",
        remedy="mounting",
    ),
    "accelerometer_offset": Row(
        "accelerometer offset", accelerometer.accelerometer_checks, "accelerometer", remedy="accelerometer"
    ),
    "accelerometer_dead": Row("dead accelerometer", gravity.gravity_checks, "accelerometer"),
    "accelerometer_rest": Row("gravity at rest", gravity.gravity_checks, "accelerometer", remedy="accelerometer"),
    "gravity_in_flight": Row("gravity in flight", gravity.gravity_checks, "accelerometer", remedy="accelerometer"),
    "gravity_direction": Row(
        "direction of gravity", gravity.gravity_checks, "mounting", fault="serious", remedy="mounting"
    ),
    "onboard_acc_bias": Row(
        "onboard accelerometer bias", gravity.onboard_acc_bias_check, "accelerometer", remedy="accelerometer"
    ),
    "gravity_kept": Row("gravity before and after", consistency.gravity_kept_checks, "accelerometer"),
    "coverage": Row("attitude coverage", attitude.attitude_checks, "coverage", warning="note"),
    "gyro_against_attitude": Row(
        "gyro against attitude",
        attitude.attitude_checks,
        "mounting",
        warning="note",
        fault="serious",
        remedy="mounting",
    ),
    "trim": Row("trim", attitude.attitude_checks, "trim", warning="note", remedy="trim"),
    "attitude_jumps": Row("attitude jumps", attitude.jump_checks, "reset"),
    "second_source": Row("second attitude", sources.source_checks, "attitude"),
    "compass_dead": Row("dead compass", compass.field_checks, "mag_dead", remedy="compass_wiring"),
    "field": Row("field", compass.field_checks, "compass", remedy="compass"),
    "field_against_attitude": Row("field against attitude", compass.field_checks, "compass", remedy="compass"),
    "declination": Row("declination", compass.field_checks, "compass", warning="note", remedy="compass"),
    "declination_set": Row("declination set", compass.declination_checks, "declination", remedy="declination"),
    "compass_offset": Row("compass offset", compass.compass_checks, "compass", remedy="compass"),
    "compass_turn": Row("compass turn", compass.compass_checks, "compass", fault="serious", remedy="compass_mounting"),
    "compass_motors": Row("compass and motor current", compass.compass_checks, "compass", remedy="interference"),
    "soft_iron": Row("compass soft iron", compass.compass_checks, "compass"),
    "compass_choice": Row("compass in use", compass.compass_checks, "compass"),
    "gnss_quality": Row("GNSS quality", gnss.gnss_checks, "gnss", remedy="gnss"),
    "gnss_jumps": Row("GNSS jumps", gnss.gnss_checks, "gnss"),
    "gnss_height": Row("GNSS height", consistency.height_checks, "gnss"),
    "gnss_interference": Row("GNSS interference", gnss.gnss_checks, "gnss"),
    "innovations": Row("test ratios", innovations.innovation_checks, "estimator"),
    "motor_thrust": Row("thrust of each motor", drive.motor_checks, "motor", fault="serious"),
    "motor_outputs": Row("motor outputs", drive.motor_checks, "motor_output", fault="serious"),
    "thrust_reserve": Row("thrust reserve", drive.motor_checks, "thrust", fault="serious"),
    "yaw_response": Row("yaw response", drive.motor_checks, "propellers", fault="serious"),
    "esc_load": Row("speed controllers", drive.esc_checks, "esc_load", warning="note"),
    "rate_tracking": Row("rates against set-points", drive.control_checks, "control"),
    "oscillation": Row("oscillation", drive.control_checks, "control"),
    "hover_thrust": Row("thrust in hover", hover.hover_checks, "hover", warning="note"),
    "yaw_bias": Row("yaw bias in hover", hover.hover_checks, "yaw_bias", warning="note"),
    "uneven_motors": Row("load of the motors", hover.hover_checks, "uneven_motors", warning="note"),
    "battery": Row("battery", supply.supply_checks, "supply", warning="note"),
    "board_supply": Row("supply of the board", supply.supply_checks, "board_supply", warning="note"),
    "brownout": Row("brownout", supply.supply_checks, "brownout", warning="note"),
    "crash": Row("crash", attitude.crash_checks, "crash", fault="serious"),
    "imu_instances": Row("IMUs against each other", imu_checks.imu_differences, "accelerometer"),
    "accelerometer_temperature": Row(
        "accelerometer and temperature", imu_checks.accelerometer_temperature, "accelerometer"
    ),
    "gyro_temperature": Row("gyro bias and temperature", imu_checks.gyro_temperature, "gyro_bias"),
    "gyro_spectrum": Row("gyro spectrum", notch.gyro_spectrum, "vibration"),
    "notch": Row("notch filter", notch.notch_filter, "vibration"),
    "gnss_delay": Row("GNSS delay", delays.gnss_delays, "estimator"),
    "magnetometer_delay": Row("magnetometer delay", delays.compass_delay, "estimator"),
    "lanes": Row("estimator lane in use", sources.lane_errors, "estimator"),
    "barometer_noise": Row("barometer noise", baro.barometer_noise, "estimator"),
    "unsafe_settings": Row("safety settings", safety.safety_checks, "unsafe_settings", warning="note"),
}

# Usual causes of a warning or a fault.
CAUSES: Mapping[str, str] = {
    "gaps": "The logger lost records: card or link are too slow.",
    "jitter": "The logger was busy.",
    "filter_delay": "Low-pass filters ahead of the logger, or another clock.",
    "imu_delay": "Samples are stamped when published, wait in a queue, or pass a filter that no parameter shows.",
    "gyro_dead": "The sensor does not answer: its wiring, its bus or the sensor itself.",
    "gyro_range": "An impact or vibration beyond the sensor's range.",
    "gyro_bias": "The gyro was not calibrated, was moved while it started, or warms up.",
    "frozen_gyro": "The sensor, its driver or its bus stopped.",
    "frozen_sensors": "The sensor, its driver or its bus stopped.",
    "gyro_spikes": "Errors on the sensor's bus, or samples that leave its range.",
    "accelerometer_axes": "The accelerometer is mounted otherwise than set, or its axes are mixed up.",
    "accelerometer_delay": "Its samples wait in a queue, or are stamped by another clock.",
    "compass_orientation": "The compass is mounted otherwise than its orientation is set.",
    "onboard_against_truth": "The onboard estimator was not aligned, or learned a wrong bias or a wrong field.",
    "onboard_against_smoother": "The onboard estimator was not aligned, or learned a wrong bias or a wrong field.",
    "heading_by_gnss": "The compass is turned, badly calibrated or disturbed, or the declination is wrong.",
    "vibration_level": "Unbalanced or damaged propellers, play in a bearing or arm, or a stiff mounting.",
    "vertical_force": "Vibration that clips or is rectified in the sensor becomes a constant force.",
    "log_clock": "The autopilot's crystal or the divider of its clock.",
    "main_loop": "The processor is overloaded.",
    "processor": "The processor is overloaded.",
    "gyro_scale": "The gyro's own scale or its range setting; no calibration corrects it.",
    "gyro_bias_step": "The gyro warmed up or was struck, or its driver lost its calibration.",
    "force_axes": "The accelerometer is mounted otherwise than set, or its axes are mixed up.",
    "accelerometer_offset": "The accelerometer was not calibrated, or on a slope or at another temperature.",
    "accelerometer_dead": "The sensor does not answer: its wiring, its bus or the sensor itself.",
    "accelerometer_rest": "The accelerometer is not calibrated, has the wrong range set, or vibrates.",
    "gravity_in_flight": "Wrong scale, vibration that the sensor rectifies or clips, or a wrong attitude.",
    "gravity_direction": "The sensor is mounted otherwise than set, or the onboard estimator failed.",
    "onboard_acc_bias": "The accelerometer is off, was calibrated on a slope, or the estimator has learned wrongly.",
    "gyro_against_attitude": "A wrong scale, unit, orientation or clock of the gyro, or a slow or filtered attitude.",
    "trim": "The level was calibrated on a slope, or the autopilot is mounted tilted.",
    "compass_dead": "Its wiring, its bus or the compass itself.",
    "field": "The compass is not calibrated, or iron is near.",
    "field_against_attitude": "A disturbed or badly calibrated compass, or an attitude that turns away.",
    "declination": "The compass does not point forward, or the heading is not of true north.",
    "declination_set": "A value set by hand, or kept from another place.",
    "compass_offset": "Iron or a current near the compass that its calibration does not know.",
    "compass_turn": "The compass is mounted rotated from its setting, or the attitude's heading is off.",
    "compass_motors": "Currents of motors and battery bend the field at the compass.",
    "compass_choice": "The compass in use is disturbed or badly calibrated; another one is not.",
    "gnss_quality": "Bad view of the sky, interference, or a receiver that failed.",
}

LAST = (attitude.smoother_checks,)


def run_checks(case: HealthCase) -> list[Check]:
    """Return all checks of a log in the order of rows; a check with a bug is ``unknown``."""
    makers: dict[Maker, str] = {}
    for question, row in sorted(CHECKS.items(), key=lambda item: item[1].make in LAST):
        makers.setdefault(row.make, question)
    spare = spare_sensors(case.log)
    with log_cache():
        for make, question in makers.items():
            made = call_guarded(f"The check {question}", partial(make, case), partial(_failed, question))
            case.found += [replace(finite(check), in_use=check.sensor not in spare) for check in made]
    place = {question: k for k, question in enumerate(CHECKS)}
    return sorted(case.found, key=lambda check: place[check.question])


def _failed(question: str, sentence: str) -> list[Check]:
    return [Check(question, "unknown", sentence, about=BUG)]
