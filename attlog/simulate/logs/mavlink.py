"""A flight as a ground station records ArduPilot's telemetry: the packets of a tlog at the rates of a fast link.

RAW_IMU and SCALED_IMU2, 3 have the resolution of MAVLink (1 mrad/s, 1 mg, 1 mGa); a unit that measures means is sent as
means over the link's period, at their middle. GLOBAL_POSITION_INT is the receiver's position: no estimate on board
replaces it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.earth import TESLA_PER_MILLIGAUSS
from attlog.core.rotation import rotate_inverse, to_euler
from attlog.formats import Recording, Text
from attlog.formats.mavlink.layout import STAMP_COLUMN
from attlog.formats.recording import Columns, Key
from attlog.simulate.environment import geodetic
from attlog.simulate.flight import Flight, ImuStream
from attlog.simulate.logs.ardupilot import BANNER, copter_parameters, held_numbers, output_pwm
from attlog.simulate.logs.records import (
    START_US,
    held_values,
    last_before,
    logged_samples,
    measured_rates,
    micros,
    place_while_lost,
    since_start,
    state_times,
    texts,
    vibration,
)

Array = NDArray[np.float64]
SENDER = 1 * 256 + 1
IMU_HZ, QUATERNION_HZ, ATTITUDE_HZ, TARGET_HZ, TRUTH_HZ, SLOW_HZ, STATES_HZ = 50.0, 25.0, 10.0, 10.0, 25.0, 5.0, 1.0
MILLI_G = 9.80665e-3
ARMED_FLAG, CUSTOM_MODE = 128, 1
ON_GROUND, IN_AIR = 1, 2


def telemetry_recording(flight: Flight) -> Recording:
    """Return the flight as the packets of a telemetry log; the receiver's clock is Unix time."""
    flight = since_start(flight)
    ahead_us = round(flight.scenario.place.unix_time * 1e6) - START_US
    messages: dict[Key, Columns] = {}
    for part in (_inertial, _onboard, _receivers, _slow, _states, _truth):
        for name, t_us, columns in part(flight):
            if len(t_us):
                messages[name, SENDER] = {STAMP_COLUMN: t_us.astype(np.int64) + ahead_us, **columns}
    banner = [Text(BANNER, 6, START_US), Text("Frame: QUAD/X", 6, START_US), *texts(flight, START_US)]
    banner = [Text(x.text, x.level, (x.t_us or START_US) + ahead_us) for x in banner]
    return Recording(messages, copter_parameters(flight), banner, {"system": 1, "component": 1}, START_US + ahead_us)


Packets = Iterator[tuple[str, NDArray[np.uint64], dict[str, Any]]]


def _ms(t_us: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return whole milliseconds since boot, as the autopilot counts them."""
    return t_us // np.uint64(1000)


def _inertial(flight: Flight) -> Packets:
    """Return inertial units with the compass of the same number."""
    for imu, name in zip(flight.imus, ("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3"), strict=False):
        t, gyro, acc, temperature = _sent(imu, flight.scenario.logging.imu_hz or IMU_HZ)
        t_us = micros(t)
        columns: dict[str, Any] = {"time_usec": t_us} if name == "RAW_IMU" else {"time_boot_ms": _ms(t_us)}
        columns |= dict(zip(("xacc", "yacc", "zacc"), _int16(acc / MILLI_G), strict=True))
        columns |= dict(zip(("xgyro", "ygyro", "zgyro"), _int16(gyro * 1e3), strict=True))
        mags = [m for m in flight.mags if m.instance == imu.instance and len(m.t)]
        if mags:
            field = mags[0].field[last_before(mags[0].t, t)]
            columns |= dict(zip(("xmag", "ymag", "zmag"), _int16(field / TESLA_PER_MILLIGAUSS), strict=True))
        columns["temperature"] = temperature * 100.0
        yield name, t_us, columns
    if flight.imus:
        first = flight.imus[0]
        k = logged_samples(first.t, STATES_HZ)
        x, y, z = vibration(first)[k].T
        t_us = micros(first.t[k])
        yield (
            "VIBRATION", t_us,
            {"time_usec": t_us, "vibration_x": x, "vibration_y": y, "vibration_z": z,
             "clipping_0": np.cumsum(first.clipped[:, 1])[k]},
        )


def _sent(imu: ImuStream, hz: float) -> tuple[Array, Array, Array, Array]:
    """Return times, rates, forces and temperatures of a unit at the link's rate.

    Means over intervals become means over the link's period, at its middle; of instants one in each period is sent.
    """
    k = logged_samples(imu.t_sample, hz)
    if imu.sampling == "instant" or len(k) == 0:
        return imu.t_sample[k], imu.gyro[k], imu.acc[k], imu.temperature[k]
    seconds = np.add.reduceat(imu.dt, k)
    gyro, acc = (np.add.reduceat(x * imu.dt[:, None], k, axis=0) / seconds[:, None] for x in (imu.gyro, imu.acc))
    last = np.append(k[1:], len(imu.t)) - 1
    middle = 0.5 * (imu.t_sample[k] - imu.dt[k] + imu.t_sample[last])
    return middle, gyro, acc, imu.temperature[k]


def _int16(x: Array) -> Array:
    """Return the axes (3, n) as two bytes hold them: the sensors of the link saturate."""
    return np.clip(x, -32768, 32767).T


def _onboard(flight: Flight) -> Packets:
    """Return attitude, outputs and set-points."""
    board = flight.onboard
    if len(board.t) == 0:
        return
    k = logged_samples(board.t, QUATERNION_HZ)
    t_us, rates = micros(board.t[k]), measured_rates(flight, board.t[k]).T
    q = dict(zip(("q1", "q2", "q3", "q4"), board.q[k].T, strict=True))
    speeds = ("rollspeed", "pitchspeed", "yawspeed")
    yield "ATTITUDE_QUATERNION", t_us, {"time_boot_ms": _ms(t_us), **q, **dict(zip(speeds, rates, strict=True))}
    k = logged_samples(board.t, ATTITUDE_HZ)
    t_us, rates = micros(board.t[k]), measured_rates(flight, board.t[k]).T
    angles = dict(zip(("roll", "pitch", "yaw"), to_euler(board.q[k]).T, strict=True))
    yield "ATTITUDE", t_us, {"time_boot_ms": _ms(t_us), **angles, **dict(zip(speeds, rates, strict=True))}
    if len(board.motors):
        k = logged_samples(board.t, TARGET_HZ)
        t_us, pwm = micros(board.t[k]), output_pwm(board.motors[k]).T
        pulses = {f"servo{n}_raw": pulse for n, pulse in enumerate(pwm, 1)}
        yield "SERVO_OUTPUT_RAW", t_us, {"time_usec": t_us, "port": np.zeros(len(k)), **pulses}
    if len(board.q_setpoint) and len(board.rate_setpoint):
        k = logged_samples(board.t, TARGET_HZ)
        t_us = micros(board.t[k])
        wanted = dict(
            zip(("body_roll_rate", "body_pitch_rate", "body_yaw_rate"), board.rate_setpoint[k].T, strict=True)
        )
        thrust = board.thrust_setpoint[k] if len(board.thrust_setpoint) else np.zeros(len(k))
        yield "ATTITUDE_TARGET", t_us, {"time_boot_ms": _ms(t_us), "q": board.q_setpoint[k], **wanted, "thrust": thrust}


def _receivers(flight: Flight) -> Packets:
    """Return GPS_RAW_INT, GPS2_RAW and the position of the first receiver."""
    for gnss, name in zip(flight.gnss, ("GPS_RAW_INT", "GPS2_RAW"), strict=False):
        lat, lon, alt, vel = place_while_lost(gnss)
        has, t_us = gnss.fix > 0, micros(gnss.t)
        course = np.rint(np.degrees(np.arctan2(vel[:, 1], vel[:, 0])) % 360.0 * 100.0) % 36000
        speed = np.hypot(vel[:, 0], vel[:, 1]) * 100.0
        columns: dict[str, Any] = {
            "time_usec": micros(gnss.t_sample), "fix_type": np.where(has, gnss.fix, 1), "lat": lat * 1e7,
            "lon": lon * 1e7, "alt": alt * 1e3, "eph": np.where(has, 90, 0xFFFF), "epv": np.where(has, 120, 0xFFFF),
            "vel": np.where(has, speed, 0xFFFF), "cog": np.where(has, course, 0xFFFF),
            "satellites_visible": gnss.satellites, "alt_ellipsoid": alt * 1e3, "h_acc": gnss.h_acc * 1e3,
            "v_acc": gnss.v_acc * 1e3, "vel_acc": gnss.s_acc * 1e3,
        }
        if name == "GPS2_RAW":
            del columns["eph"], columns["epv"]
        yield name, t_us, columns
        if name == "GPS_RAW_INT":
            k = np.flatnonzero(has)
            heading = np.full(len(k), 65535.0)
            if len(flight.onboard.t):
                q = flight.onboard.q[last_before(flight.onboard.t, gnss.t[k])]
                heading = np.rint(np.degrees(to_euler(q)[:, 2]) % 360.0 * 100.0) % 36000
            vx, vy, vz = np.clip(vel[k] * 100.0, -32767, 32767).T
            yield (
                "GLOBAL_POSITION_INT", t_us[k],
                {"time_boot_ms": _ms(t_us[k]), "lat": lat[k] * 1e7, "lon": lon[k] * 1e7, "alt": alt[k] * 1e3,
                 "relative_alt": (alt[k] - flight.scenario.place.alt_m) * 1e3, "vx": vx, "vy": vy, "vz": vz,
                 "hdg": heading},
            )


def _slow(flight: Flight) -> Packets:
    """Return pressure, battery, rotor speeds, throttle."""
    for baro, name in zip(flight.baro, ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"), strict=False):
        k = logged_samples(baro.t, SLOW_HZ)
        t_us = micros(baro.t[k])
        yield (
            name, t_us,
            {"time_boot_ms": _ms(t_us), "press_abs": baro.pressure[k] * 0.01, "temperature": baro.temperature[k] * 100},
        )
    if flight.battery is not None:
        battery = flight.battery
        k = logged_samples(battery.t, SLOW_HZ)
        capacity = flight.scenario.sensors.battery.capacity_ah
        current = np.clip(battery.current[k] * 1e2, 0, 32767)
        yield (
            "SYS_STATUS", micros(battery.t[k]),
            {"voltage_battery": battery.voltage[k] * 1e3, "current_battery": current,
             "battery_remaining": np.clip(100 * (1 - battery.used[k] / capacity), 0, 100)},
        )
    if flight.rpm is not None:
        k = logged_samples(flight.rpm.t, SLOW_HZ)
        yield "ESC_TELEMETRY_1_TO_4", micros(flight.rpm.t[k]), {"rpm": np.clip(flight.rpm.rpm[k], 0, 65535)}
    if len(flight.onboard.thrust_setpoint):
        k = logged_samples(flight.onboard.t, SLOW_HZ)
        truth = last_before(flight.truth.t, flight.onboard.t[k])
        v = flight.truth.v[truth]
        throttle = np.clip(flight.onboard.thrust_setpoint[k], 0, 1) * 100
        yield (
            "VFR_HUD", micros(flight.onboard.t[k]),
            {"groundspeed": np.hypot(v[:, 0], v[:, 1]), "throttle": throttle,
             "alt": flight.scenario.place.alt_m - flight.truth.p[truth, 2], "climb": -v[:, 2],
             "heading": np.rint(np.degrees(to_euler(flight.onboard.q[k])[:, 2])) % 360},
        )


def _states(flight: Flight) -> Packets:
    """Return heartbeat, landing, clock, version."""
    board = flight.onboard
    t = state_times(flight, [board.armed, board.mode, board.landed], STATES_HZ)
    t_us, armed = micros(t), np.array(held_values(board.armed, t), bool)
    landed = np.array(held_values(board.landed, t), bool)
    yield (
        "HEARTBEAT", t_us,
        {"type": np.full(len(t), 2), "autopilot": np.full(len(t), 3), "base_mode": CUSTOM_MODE + ARMED_FLAG * armed,
         "custom_mode": held_numbers(board.mode, t), "system_status": np.where(armed, 4, 3),
         "mavlink_version": np.full(len(t), 3)},
    )
    yield "EXTENDED_SYS_STATE", t_us, {"landed_state": np.where(landed, ON_GROUND, IN_AIR)}
    unix = np.rint((flight.scenario.place.unix_time + t) * 1e6).astype(np.uint64)
    yield "SYSTEM_TIME", t_us, {"time_unix_usec": unix, "time_boot_ms": _ms(t_us)}
    yield "AUTOPILOT_VERSION", t_us[:1], {"flight_sw_version": np.array([4 << 24 | 6 << 16])}


def _truth(flight: Flight) -> Packets:
    """Return the true motion: SIM_STATE, which has no clock of its own."""
    truth = flight.truth
    k = logged_samples(truth.t, min(TRUTH_HZ, flight.scenario.logging.truth_hz or TRUTH_HZ))
    q = dict(zip(("q1", "q2", "q3", "q4"), truth.q[k].T, strict=True))
    angles = dict(zip(("roll", "pitch", "yaw"), to_euler(truth.q[k]).T, strict=True))
    force = rotate_inverse(truth.q[k], truth.a[k] - [0.0, 0.0, flight.gravity])
    lat, lon, alt = geodetic(flight.scenario, truth.p[k])
    columns: dict[str, Any] = {**q, **angles, "lat": lat * 1e7, "lon": lon * 1e7, "alt": alt}
    columns |= {"lat_int": lat * 1e7, "lon_int": lon * 1e7}
    columns |= dict(zip(("xacc", "yacc", "zacc"), force.T, strict=True))
    columns |= dict(zip(("xgyro", "ygyro", "zgyro"), truth.w[k].T, strict=True))
    columns |= dict(zip(("vn", "ve", "vd"), truth.v[k].T, strict=True))
    yield "SIM_STATE", micros(truth.t[k]), columns
