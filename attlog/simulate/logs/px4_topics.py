"""The topics of PX4 that a simulated log holds, with fields and types as PX4 1.16 logs them.

Measured on logs of PX4's own simulation and of vehicles; ``esc_report`` is the type of the elements of ``esc``.
Fields that nobody sets stay zero, floating-point ones NaN ("not known" in PX4).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.recording import Columns

_TYPES = {"b": np.dtype(bool), "u1": np.dtype("u1"), "i1": np.dtype("i1"), "u2": np.dtype("<u2"), "u4": np.dtype("<u4"),
          "i4": np.dtype("<i4"), "u8": np.dtype("<u8"), "f4": np.dtype("<f4"), "f8": np.dtype("<f8")}

LAYOUTS = {
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
"""Fields in stored order; a type holds for all names before it, ``[n]`` is an array."""


def topic(name: str, **values: Any) -> Columns:
    """The columns of a topic; ``values`` are arrays or one value for all records. KeyError for unknown fields."""
    n = len(values["timestamp"])
    columns: dict[str, NDArray[Any]] = {}
    waiting: list[str] = []
    for word in LAYOUTS[name].split():
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
