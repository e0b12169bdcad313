"""A flight as PX4 logs one: topics, parameters and statements of a ULog.

Increments (``vehicle_imu``, ``sensor_combined``) where the unit measures means over intervals, as PX4 does; raw
samples (``sensor_gyro``, ``sensor_accel``) with their calibration where it measures instants. The attitude is that
of the estimator in the loop: nothing that only PX4's EKF knows (test ratios, position) is made up.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import __version__
from attlog.base.rotation import to_euler
from attlog.formats import MessageLayout, Recording
from attlog.formats.recording import Columns, Key
from attlog.simulate.flight import Flight, ImuStream
from attlog.simulate.logs.px4_parameters import ACCS, BAROS, GNSS_ID, GYROS, MAGS, OFFSETS, parameters
from attlog.simulate.logs.px4_topics import topic
from attlog.simulate.logs.records import (
    START_US,
    every,
    held,
    measured_rates,
    micros,
    numbered,
    place_while_lost,
    since_start,
    state_times,
    texts,
    vibration,
)
from attlog.simulate.physics.environment import geodetic

MODES = {"STABILIZE": 15, "ALTCTL": 1, "ALT_HOLD": 1, "POSCTL": 2, "LOITER": 2, "GUIDED": 14, "OFFBOARD": 14,
         "AUTO": 3, "MISSION": 3, "HOLD": 4, "RTL": 5, "ACRO": 10, "TAKEOFF": 17, "LAND": 18}
"""nav_state."""
GAUSS = 1e-4
RELEASE = 1 << 24 | 16 << 16 | 255
STATES_HZ, STATUS_HZ = 2.0, 1.0


def recording(flight: Flight) -> Recording:
    """The flight as the topics of a ULog."""
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
        parameters(flight),
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
    """The samples of a unit and its slow status."""
    k = every(imu.t_sample, flight.scenario.logging.imu_hz)
    unit = min(imu.instance, len(GYROS) - 1)
    gyro_id, acc_id = GYROS[unit], ACCS[unit]
    sampled, published = micros(imu.t_sample[k]), micros(imu.t[k])
    clipped = (imu.clipped[k] > 0) * 7  # the flight counts all axes together
    if imu.sampling == "interval":
        dt_us = np.rint(imu.dt[k] * 1e6)
        yield (
            ("vehicle_imu", imu.instance),
            topic(
                "vehicle_imu", timestamp=published, timestamp_sample=sampled, accel_device_id=acc_id,
                gyro_device_id=gyro_id, delta_angle=imu.gyro[k] * dt_us[:, None] * 1e-6,
                delta_velocity=imu.acc[k] * dt_us[:, None] * 1e-6, delta_angle_dt=dt_us, delta_velocity_dt=dt_us,
                delta_angle_clipping=clipped[:, 0], delta_velocity_clipping=clipped[:, 1],
                accel_calibration_count=1, gyro_calibration_count=1,
            ),
        )
        if imu.instance == 0:
            yield (
                ("sensor_combined", 0),
                topic(
                    "sensor_combined", timestamp=sampled, gyro_rad=imu.gyro[k], gyro_integral_dt=dt_us,
                    accelerometer_m_s2=imu.acc[k], accelerometer_integral_dt=dt_us,
                    accelerometer_clipping=clipped[:, 1], gyro_clipping=clipped[:, 0], accel_calibration_count=1,
                    gyro_calibration_count=1,
                ),
            )
    else:
        for name, kind, x, device, clips in (
            ("sensor_gyro", "GYRO", imu.gyro, gyro_id, clipped[:, 0]),
            ("sensor_accel", "ACC", imu.acc, acc_id, clipped[:, 1]),
        ):
            raw = x[k] + OFFSETS[kind]
            yield (
                (name, imu.instance),
                topic(
                    name, timestamp=published, timestamp_sample=sampled, device_id=device, x=raw[:, 0], y=raw[:, 1],
                    z=raw[:, 2], temperature=imu.temperature[k], clip_counter=np.tile(clips[:, None] > 0, 3), samples=1,
                ),
            )
    yield ("vehicle_imu_status", imu.instance), _imu_status(imu, gyro_id, acc_id)


def _imu_status(imu: ImuStream, gyro_id: int, acc_id: int) -> Columns:
    """Once a second: counts, vibration, temperature, and mean and variance over the second."""
    k = every(imu.t_sample, STATUS_HZ)
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
    """Magnetometers, receivers, barometers, battery and rotor speeds; which unit flies."""
    yield (
        ("sensor_selection", 0),
        topic("sensor_selection", timestamp=micros(np.zeros(1)), accel_device_id=ACCS[0], gyro_device_id=GYROS[0]),
    )
    for mag in flight.mags:
        yield (
            ("vehicle_magnetometer", mag.instance),
            topic(
                "vehicle_magnetometer", timestamp=micros(mag.t), timestamp_sample=micros(mag.t_sample),
                device_id=MAGS[min(mag.instance, len(MAGS) - 1)], magnetometer_ga=mag.field / GAUSS,
                calibration_count=1,
            ),
        )
    for gnss in flight.gnss:
        lat, lon, alt, vel = place_while_lost(gnss)
        speed = np.hypot(vel[:, 0], vel[:, 1])
        yield (
            ("sensor_gps", gnss.instance),
            topic(
                "sensor_gps", timestamp=micros(gnss.t), timestamp_sample=micros(gnss.t_sample), latitude_deg=lat,
                longitude_deg=lon, altitude_msl_m=alt, altitude_ellipsoid_m=alt,
                time_utc_usec=np.where(gnss.fix > 0, np.rint(gnss.utc * 1e6), 0), device_id=GNSS_ID + gnss.instance,
                s_variance_m_s=gnss.s_acc, eph=gnss.h_acc, epv=gnss.v_acc, hdop=0.9, vdop=1.2, vel_m_s=speed,
                vel_n_m_s=vel[:, 0], vel_e_m_s=vel[:, 1], vel_d_m_s=vel[:, 2], cog_rad=np.arctan2(vel[:, 1], vel[:, 0]),
                fix_type=gnss.fix, vel_ned_valid=gnss.fix > 0, satellites_used=gnss.satellites,
            ),
        )
    for baro in flight.baro:
        device = BAROS[min(baro.instance, len(BAROS) - 1)]
        stamps = {"timestamp": micros(baro.t), "timestamp_sample": micros(baro.t_sample)}
        own = topic("sensor_baro", **stamps, device_id=device, pressure=baro.pressure, temperature=baro.temperature)
        yield ("sensor_baro", baro.instance), own
        yield (
            ("vehicle_air_data", baro.instance),
            topic(
                "vehicle_air_data", **stamps, baro_device_id=device, baro_alt_meter=baro.height,
                baro_pressure_pa=baro.pressure, ambient_temperature=baro.temperature,
                rho=baro.pressure / (287.05 * (baro.temperature + 273.15)),
            ),
        )
    if flight.battery is not None:
        cell = flight.battery.voltage / 4.0
        capacity = flight.scenario.sensors.battery.capacity_ah
        cells = np.zeros((len(cell), 14))
        cells[:, :4] = cell[:, None]
        yield (
            ("battery_status", 0),
            topic(
                "battery_status", timestamp=micros(flight.battery.t), voltage_v=flight.battery.voltage,
                current_a=flight.battery.current, discharged_mah=flight.battery.used * 1e3,
                remaining=np.clip(1.0 - flight.battery.used / capacity, 0.0, 1.0), scale=1.0, voltage_cell_v=cells,
                capacity=round(capacity * 1000), connected=True, cell_count=4, id=1,
            ),
        )
    if flight.rpm is not None:
        yield ("esc_status", 0), _esc(flight)


def _esc(flight: Flight) -> Columns:
    """Rotor speeds as ESC reports; the last four of eight stay empty."""
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
    """Arming, mode and landing, twice a second and at each change."""
    board = flight.onboard
    t = state_times(flight, [board.armed, board.landed, board.mode], STATES_HZ)
    stamps = micros(t)
    armed, landed = np.array(held(board.armed, t), bool), np.array(held(board.landed, t), bool)
    mode = np.array(numbered(held(board.mode, t), MODES, "PX4"))
    first = next((when for when, value in board.armed if value), None)
    since = np.where(armed, micros(np.array(first or 0.0)), 0)
    yield (
        ("vehicle_status", 0),
        topic(
            "vehicle_status", timestamp=stamps, armed_time=since, arming_state=np.where(armed, 2, 1),
            nav_state_user_intention=mode, nav_state=mode, vehicle_type=1, system_type=2, system_id=1, component_id=1,
            power_input_valid=True, pre_flight_checks_pass=True,
        ),
    )
    yield ("actuator_armed", 0), topic("actuator_armed", timestamp=stamps, armed=armed, ready_to_arm=True)
    yield (
        ("vehicle_land_detected", 0),
        topic("vehicle_land_detected", timestamp=stamps, ground_contact=landed, maybe_landed=landed, landed=landed,
              has_low_throttle=landed),
    )


def _onboard(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """What the estimator in the loop thought and the controller wanted."""
    board, logging = flight.onboard, flight.scenario.logging
    k = every(board.t, logging.attitude_hz)
    stamps = _both(board.t[k])
    yield ("vehicle_attitude", 0), topic("vehicle_attitude", **stamps, q=board.q[k], delta_q_reset=[1.0, 0.0, 0.0, 0.0])
    k = every(board.t, logging.setpoint_hz)
    yield (
        ("vehicle_angular_velocity", 0),
        topic("vehicle_angular_velocity", **_both(board.t[k]), xyz=measured_rates(flight, board.t[k])),
    )
    k = every(board.t, STATUS_HZ)
    if len(board.bias):
        yield (
            ("estimator_sensor_bias", 0),
            topic("estimator_sensor_bias", **_both(board.t[k]), gyro_device_id=GYROS[0], gyro_bias=board.bias[k],
                  accel_device_id=ACCS[0], accel_bias=0.0, gyro_bias_valid=True),
        )
    k = every(board.t, logging.setpoint_hz)
    thrust = np.zeros((len(k), 3))
    if len(board.thrust_setpoint):
        thrust[:, 2] = -board.thrust_setpoint[k]
        yield ("vehicle_thrust_setpoint", 0), topic("vehicle_thrust_setpoint", **_both(board.t[k]), xyz=thrust)
    if len(board.q_setpoint):
        yield (
            ("vehicle_attitude_setpoint", 0),
            topic("vehicle_attitude_setpoint", timestamp=micros(board.t[k]), q_d=board.q_setpoint[k],
                  thrust_body=thrust),
        )
    if len(board.rate_setpoint):
        roll, pitch, yaw = board.rate_setpoint[k].T
        yield (
            ("vehicle_rates_setpoint", 0),
            topic("vehicle_rates_setpoint", timestamp=micros(board.t[k]), roll=roll, pitch=pitch, yaw=yaw,
                  thrust_body=thrust),
        )
    if len(board.torque_setpoint):
        torque = topic("vehicle_torque_setpoint", **_both(board.t[k]), xyz=board.torque_setpoint[k])
        yield ("vehicle_torque_setpoint", 0), torque
    if len(board.motors):
        k = every(board.t, logging.motors_hz)
        control = np.full((len(k), 12), np.nan)
        control[:, : board.motors.shape[1]] = board.motors[k]
        yield ("actuator_motors", 0), topic("actuator_motors", **_both(board.t[k]), control=control)


def _truth(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """What happened, under the names of PX4's own simulators."""
    truth, place = flight.truth, flight.scenario.place
    k = every(truth.t, flight.scenario.logging.truth_hz)
    stamps = _both(truth.t[k])
    yield (
        ("vehicle_attitude_groundtruth", 0),
        topic("vehicle_attitude_groundtruth", **stamps, q=truth.q[k], delta_q_reset=[1.0, 0.0, 0.0, 0.0]),
    )
    yield (
        ("vehicle_angular_velocity_groundtruth", 0),
        topic("vehicle_angular_velocity_groundtruth", **stamps, xyz=truth.w[k], xyz_derivative=truth.w_dot[k]),
    )
    (x, y, z), (vx, vy, vz), (ax, ay, az) = truth.p[k].T, truth.v[k].T, truth.a[k].T
    yield (
        ("vehicle_local_position_groundtruth", 0),
        topic(
            "vehicle_local_position_groundtruth", **stamps, ref_timestamp=START_US, ref_lat=place.lat_deg,
            ref_lon=place.lon_deg, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, z_deriv=vz, ax=ax, ay=ay, az=az,
            heading=to_euler(truth.q[k])[:, 2], ref_alt=place.alt_m, eph=0.0, epv=0.0, evh=0.0, evv=0.0, xy_valid=True,
            z_valid=True, v_xy_valid=True, v_z_valid=True, heading_good_for_control=True, xy_global=True, z_global=True,
        ),
    )
    lat, lon, alt = geodetic(flight.scenario, truth.p[k])
    yield (
        ("vehicle_global_position_groundtruth", 0),
        topic("vehicle_global_position_groundtruth", **stamps, lat=lat, lon=lon, alt=alt, alt_ellipsoid=alt, eph=0.0,
              epv=0.0, lat_lon_valid=True, alt_valid=True),
    )


def _both(t: NDArray[np.float64]) -> dict[str, Any]:
    """Stamps of what is published when it is computed."""
    return {"timestamp": micros(t), "timestamp_sample": micros(t)}
