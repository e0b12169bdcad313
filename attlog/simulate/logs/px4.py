"""A flight as PX4 logs one: topics, parameters and states of a ULog; and as a companion computer's bag.

Fields and types are those of PX4 1.16, measured on logs of PX4's own simulation and of vehicles; ``esc_report`` is the
type of the elements of ``esc``. Unset fields are zero, floating-point ones NaN ("not known" in PX4). Increments
(``vehicle_imu``, ``sensor_combined``) where the unit measures means, as PX4 does; raw samples (``sensor_gyro``,
``sensor_accel``) with their calibration where it measures instants. The attitude is that of the estimator in the loop;
values that only PX4's EKF has (test ratios, position) are left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import __version__
from attlog.core import rotation
from attlog.core.earth import TESLA_PER_GAUSS
from attlog.core.rotation import to_euler
from attlog.formats import MessageLayout, ParamChange, Recording
from attlog.formats.recording import Columns, Key
from attlog.simulate.environment import geodetic
from attlog.simulate.flight import Flight, ImuStream
from attlog.simulate.logs.records import (
    START_US,
    held_values,
    logged_samples,
    measured_rates,
    micros,
    number_modes,
    place_while_lost,
    since_start,
    state_times,
    texts,
    vibration,
)
from attlog.simulate.scenario import ROTOR_SIGNS, ROTOR_TURNS

_TYPES = {"b": np.dtype(bool), "u1": np.dtype("u1"), "i1": np.dtype("i1"), "u2": np.dtype("<u2"), "u4": np.dtype("<u4"),
          "i4": np.dtype("<i4"), "u8": np.dtype("<u8"), "f4": np.dtype("<f4"), "f8": np.dtype("<f8")}

# Fields in stored order; a type is that of all names before it, ``[n]`` is an array.
TOPIC_LAYOUTS = {
    "vehicle_imu": "timestamp timestamp_sample:u8 accel_device_id gyro_device_id:u4 delta_angle[3] delta_velocity[3]:f4"
    " delta_angle_dt delta_velocity_dt:u4 delta_angle_clipping delta_velocity_clipping accel_calibration_count"
    " gyro_calibration_count:u1",
    "vehicle_imu_status": "timestamp:u8 accel_device_id gyro_device_id accel_clipping[3] gyro_clipping[3]"
    " accel_error_count gyro_error_count:u4 accel_rate_hz gyro_rate_hz accel_raw_rate_hz gyro_raw_rate_hz"
    " accel_vibration_metric gyro_vibration_metric delta_angle_coning_metric mean_accel[3] mean_gyro[3] var_accel[3]"
    " var_gyro[3] temperature_accel temperature_gyro:f4",
    "sensor_combined": "timestamp:u8 gyro_rad[3]:f4 gyro_integral_dt:u4 accelerometer_timestamp_relative:i4"
    " accelerometer_m_s2[3]:f4 accelerometer_integral_dt:u4 accelerometer_clipping gyro_clipping"
    " accel_calibration_count gyro_calibration_count:u1",
    "sensor_gyro": "timestamp timestamp_sample:u8 device_id:u4 x y z temperature:f4 error_count:u4 clip_counter[3]"
    " samples:u1",
    "sensor_accel": "timestamp timestamp_sample:u8 device_id:u4 x y z temperature:f4 error_count:u4 clip_counter[3]"
    " samples:u1",
    "sensor_selection": "timestamp:u8 accel_device_id gyro_device_id:u4",
    "vehicle_magnetometer": "timestamp timestamp_sample:u8 device_id:u4 magnetometer_ga[3]:f4 calibration_count:u1",
    "vehicle_attitude": "timestamp timestamp_sample:u8 q[4] delta_q_reset[4]:f4 quat_reset_counter:u1",
    "vehicle_attitude_groundtruth": "timestamp timestamp_sample:u8 q[4] delta_q_reset[4]:f4 quat_reset_counter:u1",
    "vehicle_angular_velocity": "timestamp timestamp_sample:u8 xyz[3] xyz_derivative[3]:f4",
    "vehicle_angular_velocity_groundtruth": "timestamp timestamp_sample:u8 xyz[3] xyz_derivative[3]:f4",
    "vehicle_attitude_setpoint": "timestamp:u8 yaw_sp_move_rate q_d[4] thrust_body[3]:f4",
    "vehicle_rates_setpoint": "timestamp:u8 roll pitch yaw thrust_body[3]:f4 reset_integral:b",
    "vehicle_thrust_setpoint": "timestamp timestamp_sample:u8 xyz[3]:f4",
    "vehicle_torque_setpoint": "timestamp timestamp_sample:u8 xyz[3]:f4",
    "actuator_motors": "timestamp timestamp_sample:u8 control[12]:f4 reversible_flags:u2",
    "actuator_armed": "timestamp:u8 armed prearmed ready_to_arm lockdown manual_lockdown force_failsafe"
    " in_esc_calibration_mode:b",
    "vehicle_status": "timestamp armed_time takeoff_time nav_state_timestamp:u8 valid_nav_states_mask"
    " can_set_nav_states_mask:u4 arming_state latest_arming_reason latest_disarming_reason nav_state_user_intention"
    " nav_state executor_in_charge:u1 hil_state vehicle_type:u1 failsafe failsafe_and_user_took_over:b"
    " failsafe_defer_state:u1 gcs_connection_lost:b gcs_connection_lost_counter:u1 high_latency_data_link_lost is_vtol"
    " is_vtol_tailsitter in_transition_mode in_transition_to_fw:b system_type system_id component_id:u1"
    " safety_button_available safety_off power_input_valid usb_connected:b pre_flight_checks_pass:b",
    "vehicle_land_detected": "timestamp:u8 freefall ground_contact maybe_landed landed in_ground_effect in_descend"
    " has_low_throttle vertical_movement horizontal_movement rotational_movement close_to_ground_or_skipped_check"
    " at_rest:b",
    "sensor_gps": "timestamp timestamp_sample:u8 latitude_deg longitude_deg altitude_msl_m altitude_ellipsoid_m:f8"
    " time_utc_usec:u8 device_id:u4 s_variance_m_s c_variance_rad eph epv hdop vdop:f4 noise_per_ms"
    " jamming_indicator:i4 vel_m_s vel_n_m_s vel_e_m_s vel_d_m_s cog_rad:f4 timestamp_time_relative:i4 heading"
    " heading_offset heading_accuracy rtcm_injection_rate:f4 automatic_gain_control:u2 fix_type jamming_state"
    " spoofing_state:u1 vel_ned_valid:b satellites_used selected_rtcm_instance:u1 rtcm_crc_failed:b rtcm_msg_used:u1",
    "sensor_baro": "timestamp timestamp_sample:u8 device_id:u4 pressure temperature:f4 error_count:u4",
    "vehicle_air_data": "timestamp timestamp_sample:u8 baro_device_id:u4 baro_alt_meter baro_pressure_pa"
    " ambient_temperature rho:f4 temperature_source calibration_count:u1",
    "battery_status": "timestamp:u8 voltage_v current_a current_average_a discharged_mah remaining scale"
    " time_remaining_s temperature voltage_cell_v[14] max_cell_voltage_delta full_charge_capacity_wh"
    " remaining_capacity_wh nominal_voltage internal_resistance_estimate ocv_estimate ocv_estimate_filtered"
    " volt_based_soc_estimate voltage_prediction prediction_error estimation_covariance_norm:f4 capacity cycle_count"
    " average_time_to_empty manufacture_date state_of_health max_error interface_error faults over_discharge_count:u2"
    " connected:b cell_count source priority id:u1 is_powering_off is_required:b warning:u1",
    "esc_status": "timestamp:u8 counter:u2 esc_count esc_connectiontype esc_online_flags esc_armed_flags:u1",
    "esc_report": "timestamp:u8 esc_errorcount:u4 esc_rpm:i4 esc_voltage esc_current esc_temperature:f4 failures:u2"
    " esc_address esc_cmdcount esc_state actuator_function:u1 esc_power:i1",
    "estimator_sensor_bias": "timestamp timestamp_sample:u8 gyro_device_id:u4 gyro_bias[3] gyro_bias_limit"
    " gyro_bias_variance[3]:f4 accel_device_id:u4 accel_bias[3] accel_bias_limit accel_bias_variance[3]:f4"
    " mag_device_id:u4 mag_bias[3] mag_bias_limit mag_bias_variance[3]:f4 gyro_bias_valid gyro_bias_stable"
    " accel_bias_valid accel_bias_stable mag_bias_valid mag_bias_stable:b",
    "vehicle_local_position_groundtruth": "timestamp timestamp_sample ref_timestamp:u8 ref_lat ref_lon:f8 x y z vx vy"
    " vz z_deriv ax ay az heading ref_alt eph epv evh evv:f4 xy_valid z_valid v_xy_valid v_z_valid"
    " heading_good_for_control xy_global z_global dist_bottom_valid dead_reckoning:b",
    "vehicle_global_position_groundtruth": "timestamp timestamp_sample:u8 lat lon:f8 alt alt_ellipsoid eph epv:f4"
    " lat_lon_valid alt_valid dead_reckoning:b",
}


def message(name: str, instance: int, **values: Any) -> tuple[Key, Columns]:
    """Return key and columns of a topic's instance, as :func:`topic`."""
    return (name, instance), topic(name, **values)


def topic(name: str, **values: Any) -> Columns:
    """Return the columns of a topic; ``values`` are arrays or one value for all records. KeyError for unknown fields.
    """
    n = len(values["timestamp"])
    columns: dict[str, NDArray[Any]] = {}
    waiting: list[str] = []
    for word in TOPIC_LAYOUTS[name].split():
        field, _, kind = word.partition(":")
        waiting.append(field)
        if not kind:
            continue
        for one in waiting:
            plain, _, count = one.rstrip("]").partition("[")
            shape = (n, int(count)) if count else (n,)
            dtype = _TYPES[kind]
            given = values.pop(plain, np.nan if dtype.kind == "f" else 0)
            columns[plain] = np.ascontiguousarray(np.broadcast_to(np.asarray(given), shape)).astype(dtype)
        waiting = []
    if values:
        raise KeyError(f"{name} has no field {', '.join(values)}")
    return columns


# Device ids of PX4's simulated sensors.
GYROS = ACCS = (1310988, 1310996, 1311004, 1311012)
MAGS = (197388, 197644, 197900, 198156)
BAROS = (6620172, 6620428)
GNSS_ID = 11469065
# Offsets of the raw samples, which the calibration subtracts [rad/s, m/s^2].
OFFSETS = {"GYRO": (0.01, -0.02, 0.015), "ACC": (0.1, -0.05, 0.15)}


def px4_parameters(flight: Flight) -> list[ParamChange]:
    """Return parameters, with PX4's defaults where the scenario differs from them."""
    control, loop = flight.scenario.controller, flight.scenario.loop
    instant = any(imu.sampling == "instant" for imu in flight.imus)
    values: list[tuple[str, float | int, float | int]] = [  # name, value, PX4's default
        ("MAV_TYPE", 2, 2), ("SYS_AUTOSTART", 4001, 0), ("SYS_HAS_MAG", int(bool(flight.mags)), 1),
        ("SDLOG_PROFILE", 1 << 0 | 1 << 4, 1), ("SDLOG_MODE", 2, 0),
        ("IMU_INTEG_RATE", round(flight.imus[0].rate_hz) if flight.imus else 200, 200),
        ("IMU_GYRO_RATEMAX", round(loop.rate_hz), 400),
        ("EKF2_MAG_DECL", float(flight.declination_deg), 0.0), ("EKF2_DECL_TYPE", 0, 3),
        ("SENS_BOARD_ROT", 0, 0), ("SENS_BOARD_X_OFF", 0.0, 0.0), ("SENS_BOARD_Y_OFF", 0.0, 0.0),
        ("SENS_BOARD_Z_OFF", 0.0, 0.0),
        ("MC_ROLL_P", control.angle_kp, 6.5), ("MC_PITCH_P", control.angle_kp, 6.5),
        ("MC_YAW_P", control.yaw_angle_kp, 2.8), ("MC_ROLLRATE_P", control.rate_kp, 0.15),
        ("MC_ROLLRATE_I", control.rate_ki, 0.2), ("MC_ROLLRATE_D", control.rate_kd, 0.003),
        ("MC_PITCHRATE_P", control.rate_kp, 0.15), ("MC_PITCHRATE_I", control.rate_ki, 0.2),
        ("MC_PITCHRATE_D", control.rate_kd, 0.003), ("MC_YAWRATE_P", control.yaw_rate_kp, 0.2),
        ("MC_YAWRATE_I", control.yaw_rate_ki, 0.1),
    ]
    side = flight.scenario.vehicle.arm_m / math.sqrt(2.0)
    values += [("CA_AIRFRAME", 0, 0), ("CA_ROTOR_COUNT", len(ROTOR_SIGNS), 0)]
    for k, ((ahead, right), turn) in enumerate(zip(ROTOR_SIGNS, ROTOR_TURNS, strict=True)):
        values += [(f"CA_ROTOR{k}_PX", ahead * side, 0.0), (f"CA_ROTOR{k}_PY", right * side, 0.0),
                   (f"CA_ROTOR{k}_KM", turn * 0.05, 0.05)]
    for kind, ids, count in (("GYRO", GYROS, len(flight.imus)), ("ACC", ACCS, len(flight.imus)),
                             ("MAG", MAGS, len(flight.mags))):
        for k in range(min(count, len(ids))):
            values += [(f"CAL_{kind}{k}_ID", ids[k], 0), (f"CAL_{kind}{k}_PRIO", 75 - 25 * (k > 0), -1)]
            external = kind == "MAG" and flight.scenario.sensors.mag[k].is_external
            values += [(f"CAL_{kind}{k}_ROT", flight.scenario.sensors.mag[k].orientation if external else -1, -1)]
            values += [(f"CAL_MAG{k}_{axis}OFF", 0.0, 0.0) for axis in "XYZ" if external]
            if instant and kind in OFFSETS:
                values += [(f"CAL_{kind}{k}_{axis}OFF", x, 0.0) for axis, x in zip("XYZ", OFFSETS[kind], strict=True)]
    found = [ParamChange(name, default, None, True) for name, value, default in values if value != default]
    return [ParamChange(name, value) for name, value, _ in values] + found


# nav_state.
MODES = {"STABILIZE": 15, "ALTCTL": 1, "ALT_HOLD": 1, "POSCTL": 2, "LOITER": 2, "GUIDED": 14, "OFFBOARD": 14,
         "AUTO": 3, "MISSION": 3, "HOLD": 4, "RTL": 5, "ACRO": 10, "TAKEOFF": 17, "LAND": 18}
RELEASE = 1 << 24 | 16 << 16 | 255
STATES_HZ, STATUS_HZ = 2.0, 1.0


def ulog_recording(flight: Flight) -> Recording:
    """Return the flight as the topics of a ULog."""
    flight = since_start(flight)
    messages: dict[Key, Columns] = {}
    for imu in flight.imus:
        messages |= dict(_inertial(flight, imu))
    messages |= dict(_sensors(flight))
    messages |= dict(_states(flight))
    if len(flight.onboard.t):
        messages |= dict(_onboard(flight))
    messages |= dict(_truth(flight))
    return Recording(
        {key: columns for key, columns in messages.items() if len(columns["timestamp"])},
        px4_parameters(flight),
        texts(flight, START_US),
        {
            "sys_name": "PX4", "ver_hw": "SITL_ATTLOG", "ver_sw": f"attlog {__version__} simulate",
            "ver_sw_release": RELEASE, "sys_os_name": "attlog", "sys_uuid": f"seed {flight.seed}",
            "simulated_scenario": flight.scenario.name or "unnamed",
        },
        START_US,
        {"esc_status": MessageLayout(nested={"esc": "esc_report"})} if flight.rpm is not None else {},
    )


def _inertial(flight: Flight, imu: ImuStream) -> Iterator[tuple[Key, Columns]]:
    """Return the samples of a unit and its slow status."""
    k = logged_samples(imu.t_sample, flight.scenario.logging.imu_hz)
    unit = min(imu.instance, len(GYROS) - 1)
    gyro_id, acc_id = GYROS[unit], ACCS[unit]
    sampled, published = micros(imu.t_sample[k]), micros(imu.t[k])
    clipped = (imu.clipped[k] > 0) * 7  # the flight counts all axes together
    if imu.sampling == "interval":
        dt_us = np.rint(imu.dt[k] * 1e6)
        yield message("vehicle_imu", imu.instance, timestamp=published, timestamp_sample=sampled,
                      accel_device_id=acc_id, gyro_device_id=gyro_id, delta_angle=imu.gyro[k] * dt_us[:, None] * 1e-6,
                      delta_velocity=imu.acc[k] * dt_us[:, None] * 1e-6, delta_angle_dt=dt_us, delta_velocity_dt=dt_us,
                      delta_angle_clipping=clipped[:, 0], delta_velocity_clipping=clipped[:, 1],
                      accel_calibration_count=1, gyro_calibration_count=1)
        if imu.instance == 0:
            yield message("sensor_combined", 0, timestamp=sampled, gyro_rad=imu.gyro[k], gyro_integral_dt=dt_us,
                          accelerometer_m_s2=imu.acc[k], accelerometer_integral_dt=dt_us,
                          accelerometer_clipping=clipped[:, 1], gyro_clipping=clipped[:, 0], accel_calibration_count=1,
                          gyro_calibration_count=1)
    else:
        for name, kind, x, device, clips in (
            ("sensor_gyro", "GYRO", imu.gyro, gyro_id, clipped[:, 0]),
            ("sensor_accel", "ACC", imu.acc, acc_id, clipped[:, 1]),
        ):
            raw = x[k] + OFFSETS[kind]
            yield message(name, imu.instance, timestamp=published, timestamp_sample=sampled, device_id=device,
                          x=raw[:, 0], y=raw[:, 1], z=raw[:, 2], temperature=imu.temperature[k],
                          clip_counter=np.tile(clips[:, None] > 0, 3), samples=1)
    yield ("vehicle_imu_status", imu.instance), _imu_status(imu, gyro_id, acc_id)


def _imu_status(imu: ImuStream, gyro_id: int, acc_id: int) -> Columns:
    """Return counts, vibration, temperature, mean and variance of each second."""
    k = logged_samples(imu.t_sample, STATUS_HZ)
    counts = np.cumsum(imu.clipped, axis=0)[k, :, None] * [1, 0, 0]  # the flight counts all axes together
    shaking = vibration(imu)
    parts = np.add.reduceat(np.ones(len(imu.t)), k) if len(k) else np.zeros(0)
    means = {}
    for name, x in (("accel", imu.acc), ("gyro", imu.gyro)):
        mean = np.add.reduceat(x, k, axis=0) / parts[:, None]
        means[f"mean_{name}"] = mean
        means[f"var_{name}"] = np.maximum(np.add.reduceat(x**2, k, axis=0) / parts[:, None] - mean**2, 0.0)
    return topic(
        "vehicle_imu_status", timestamp=micros(imu.t[k]), accel_device_id=acc_id, gyro_device_id=gyro_id,
        accel_clipping=counts[:, 1], gyro_clipping=counts[:, 0], accel_rate_hz=imu.rate_hz,
        gyro_rate_hz=imu.rate_hz, accel_raw_rate_hz=imu.rate_hz, gyro_raw_rate_hz=imu.rate_hz,
        accel_vibration_metric=np.sqrt(np.sum(shaking[k] ** 2, axis=1)), temperature_accel=imu.temperature[k],
        temperature_gyro=imu.temperature[k], **means,
    )


def _sensors(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return magnetometers, receivers, barometers, battery and rotor speeds, and the unit that flies."""
    yield message("sensor_selection", 0, timestamp=micros(np.zeros(1)), accel_device_id=ACCS[0],
                  gyro_device_id=GYROS[0])
    for mag in flight.mags:
        yield message("vehicle_magnetometer", mag.instance, timestamp=micros(mag.t),
                      timestamp_sample=micros(mag.t_sample), device_id=MAGS[min(mag.instance, len(MAGS) - 1)],
                      magnetometer_ga=mag.field / TESLA_PER_GAUSS, calibration_count=1)
    for gnss in flight.gnss:
        lat, lon, alt, vel = place_while_lost(gnss)
        speed = np.hypot(vel[:, 0], vel[:, 1])
        yield message("sensor_gps", gnss.instance, timestamp=micros(gnss.t), timestamp_sample=micros(gnss.t_sample),
                      latitude_deg=lat, longitude_deg=lon, altitude_msl_m=alt, altitude_ellipsoid_m=alt,
                      time_utc_usec=np.where(gnss.fix > 0, np.rint(gnss.utc * 1e6), 0),
                      device_id=GNSS_ID + gnss.instance, s_variance_m_s=gnss.s_acc, eph=gnss.h_acc, epv=gnss.v_acc,
                      hdop=0.9, vdop=1.2, vel_m_s=speed, vel_n_m_s=vel[:, 0], vel_e_m_s=vel[:, 1], vel_d_m_s=vel[:, 2],
                      cog_rad=np.arctan2(vel[:, 1], vel[:, 0]), fix_type=gnss.fix, vel_ned_valid=gnss.fix > 0,
                      satellites_used=gnss.satellites)
    for baro in flight.baro:
        device = BAROS[min(baro.instance, len(BAROS) - 1)]
        stamps = {"timestamp": micros(baro.t), "timestamp_sample": micros(baro.t_sample)}
        yield message("sensor_baro", baro.instance, **stamps, device_id=device, pressure=baro.pressure,
                      temperature=baro.temperature)
        yield message("vehicle_air_data", baro.instance, **stamps, baro_device_id=device, baro_alt_meter=baro.height,
                      baro_pressure_pa=baro.pressure, ambient_temperature=baro.temperature,
                      rho=baro.pressure / (287.05 * (baro.temperature + 273.15)))
    if flight.battery is not None:
        cell = flight.battery.voltage / 4.0
        capacity = flight.scenario.sensors.battery.capacity_ah
        cells = np.zeros((len(cell), 14))
        cells[:, :4] = cell[:, None]
        yield message("battery_status", 0, timestamp=micros(flight.battery.t), voltage_v=flight.battery.voltage,
                      current_a=flight.battery.current, discharged_mah=flight.battery.used * 1e3,
                      remaining=np.clip(1.0 - flight.battery.used / capacity, 0.0, 1.0), scale=1.0,
                      voltage_cell_v=cells, capacity=round(capacity * 1000), connected=True, cell_count=4, id=1)
    if flight.rpm is not None:
        yield ("esc_status", 0), _esc(flight)


def _esc(flight: Flight) -> Columns:
    """Return rotor speeds as ESC reports; the last four of eight stay empty."""
    assert flight.rpm is not None
    t, rotors = micros(flight.rpm.t), flight.rpm.rpm.shape[1]
    columns = dict(
        topic(
            "esc_status", timestamp=t, counter=np.arange(len(t)) & 0xFFFF, esc_count=rotors, esc_connectiontype=5,
            esc_online_flags=(1 << rotors) - 1, esc_armed_flags=(flight.rpm.rpm > 0) @ (1 << np.arange(rotors)),
        )
    )
    for k in range(8):
        there = k < rotors
        report = topic(
            "esc_report", timestamp=t if there else np.zeros_like(t),
            esc_rpm=np.rint(flight.rpm.rpm[:, k]) if there else 0, esc_voltage=0.0, esc_current=0.0,
            esc_temperature=0.0, esc_address=k, actuator_function=101 + k if there else 0,
        )
        columns |= {f"esc[{k}].{name}": values for name, values in report.items()}
    return columns


def _states(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return arming, mode and landing, twice a second and at each change."""
    board = flight.onboard
    t = state_times(flight, [board.armed, board.landed, board.mode], STATES_HZ)
    stamps = micros(t)
    armed, landed = np.array(held_values(board.armed, t), bool), np.array(held_values(board.landed, t), bool)
    mode = np.array(number_modes(held_values(board.mode, t), MODES, "PX4"))
    first = next((when for when, value in board.armed if value), None)
    since = np.where(armed, micros(np.array(first or 0.0)), 0)
    yield message("vehicle_status", 0, timestamp=stamps, armed_time=since, arming_state=np.where(armed, 2, 1),
                  nav_state_user_intention=mode, nav_state=mode, vehicle_type=1, system_type=2, system_id=1,
                  component_id=1, power_input_valid=True, pre_flight_checks_pass=True)
    yield message("actuator_armed", 0, timestamp=stamps, armed=armed, ready_to_arm=True)
    yield message("vehicle_land_detected", 0, timestamp=stamps, ground_contact=landed, maybe_landed=landed,
                  landed=landed, has_low_throttle=landed)


def _onboard(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return estimates and set-points."""
    board, logging = flight.onboard, flight.scenario.logging
    k = logged_samples(board.t, logging.attitude_hz)
    stamps = _both(board.t[k])
    yield message("vehicle_attitude", 0, **stamps, q=board.q[k], delta_q_reset=[1.0, 0.0, 0.0, 0.0])
    k = logged_samples(board.t, logging.setpoint_hz)
    yield message("vehicle_angular_velocity", 0, **_both(board.t[k]), xyz=measured_rates(flight, board.t[k]))
    k = logged_samples(board.t, STATUS_HZ)
    if len(board.bias):
        yield message("estimator_sensor_bias", 0, **_both(board.t[k]), gyro_device_id=GYROS[0], gyro_bias=board.bias[k],
                      accel_device_id=ACCS[0], accel_bias=0.0, gyro_bias_valid=True)
    k = logged_samples(board.t, logging.setpoint_hz)
    thrust = np.zeros((len(k), 3))
    if len(board.thrust_setpoint):
        thrust[:, 2] = -board.thrust_setpoint[k]
        yield message("vehicle_thrust_setpoint", 0, **_both(board.t[k]), xyz=thrust)
    if len(board.q_setpoint):
        yield message("vehicle_attitude_setpoint", 0, timestamp=micros(board.t[k]), q_d=board.q_setpoint[k],
                      thrust_body=thrust)
    if len(board.rate_setpoint):
        roll, pitch, yaw = board.rate_setpoint[k].T
        yield message("vehicle_rates_setpoint", 0, timestamp=micros(board.t[k]), roll=roll, pitch=pitch, yaw=yaw,
                      thrust_body=thrust)
    if len(board.torque_setpoint):
        yield message("vehicle_torque_setpoint", 0, **_both(board.t[k]), xyz=board.torque_setpoint[k])
    if len(board.motors):
        k = logged_samples(board.t, logging.motors_hz)
        control = np.full((len(k), 12), np.nan)
        control[:, : board.motors.shape[1]] = np.where(board.motors[k] > 0.0, board.motors[k], np.nan)
        yield message("actuator_motors", 0, **_both(board.t[k]), control=control)


def _truth(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return the true motion under the names of PX4's own simulators."""
    truth, place = flight.truth, flight.scenario.place
    k = logged_samples(truth.t, flight.scenario.logging.truth_hz)
    stamps = _both(truth.t[k])
    yield message("vehicle_attitude_groundtruth", 0, **stamps, q=truth.q[k], delta_q_reset=[1.0, 0.0, 0.0, 0.0])
    yield message("vehicle_angular_velocity_groundtruth", 0, **stamps, xyz=truth.w[k], xyz_derivative=truth.w_dot[k])
    (x, y, z), (vx, vy, vz), (ax, ay, az) = truth.p[k].T, truth.v[k].T, truth.a[k].T
    yield message("vehicle_local_position_groundtruth", 0, **stamps, ref_timestamp=START_US, ref_lat=place.lat_deg,
                  ref_lon=place.lon_deg, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, z_deriv=vz, ax=ax, ay=ay, az=az,
                  heading=to_euler(truth.q[k])[:, 2], ref_alt=place.alt_m, eph=0.0, epv=0.0, evh=0.0, evv=0.0,
                  xy_valid=True, z_valid=True, v_xy_valid=True, v_z_valid=True, heading_good_for_control=True,
                  xy_global=True, z_global=True)
    lat, lon, alt = geodetic(flight.scenario, truth.p[k])
    yield message("vehicle_global_position_groundtruth", 0, **stamps, lat=lat, lon=lon, alt=alt, alt_ellipsoid=alt,
                  eph=0.0, epv=0.0, lat_lon_valid=True, alt_valid=True)


def _both(t: NDArray[np.float64]) -> dict[str, Any]:
    """Return both stamps of a value published when it is computed."""
    return {"timestamp": micros(t), "timestamp_sample": micros(t)}


TOPIC, RATE_HZ = "/mocap/pose", 100.0
# Noise of motion capture, and its first axis from east.
NOISE_DEG, TURNED_DEG = 0.05, 30.0


def left_out(topic: str) -> bool:
    """Return whether a bag lacks a topic: simulator's truth, and nested messages."""
    return "groundtruth" in topic or topic == "esc_status"


def bag_recording(flight: Flight) -> Recording:
    """Return the flight as the messages of a bag, without the simulator's truth.

    The pose of a motion capture is the true one in the axes of a laboratory (forward-left-up in east-north-up,
    turned by a heading), on the recorder's clock: ``--truth /mocap/pose``.
    """
    made = ulog_recording(flight)
    messages = {key: columns for key, columns in made.messages.items() if not left_out(key[0])}
    truth = since_start(flight).truth
    k = logged_samples(truth.t, RATE_HZ)
    noise = np.radians(NOISE_DEG) * np.random.default_rng(flight.seed).standard_normal((len(k), 3))
    world = rotation.multiply(rotation.from_rotvec([0.0, 0.0, np.radians(TURNED_DEG)]), rotation.ENU)
    body = rotation.multiply(truth.q[k], rotation.from_rotvec(noise))
    q = rotation.multiply(rotation.multiply(world, body), rotation.FLU)
    messages[TOPIC, 0] = {"timestamp": micros(truth.t[k]), "q": q, "p": rotation.rotate(world, truth.p[k])}
    return replace(made, messages=messages, params=(), texts=(), info={}, layouts={})
