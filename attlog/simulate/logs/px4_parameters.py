"""Parameters of a simulated PX4 log: device ids, calibrations, and the gains that flew, beside PX4's defaults."""

from __future__ import annotations

from attlog.formats import ParamChange
from attlog.simulate.flight import Flight

GYROS = ACCS = (1310988, 1310996, 1311004, 1311012)
MAGS = (197388, 197644, 197900, 198156)
BAROS = (6620172, 6620428)
GNSS_ID = 11469065
"""Device ids of PX4's simulated sensors."""
OFFSETS = {"GYRO": (0.01, -0.02, 0.015), "ACC": (0.1, -0.05, 0.15)}
"""What the raw samples of a unit carry and its calibration takes off [rad/s, m/s^2]."""


def parameters(flight: Flight) -> list[ParamChange]:
    """Parameters with PX4's defaults where the scenario differs from them."""
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
    for kind, ids, count in (("GYRO", GYROS, len(flight.imus)), ("ACC", ACCS, len(flight.imus)),
                             ("MAG", MAGS, len(flight.mags))):
        for k in range(min(count, len(ids))):
            values += [(f"CAL_{kind}{k}_ID", ids[k], 0), (f"CAL_{kind}{k}_PRIO", 75 - 25 * (k > 0), -1)]
            values += [(f"CAL_{kind}{k}_ROT", -1, -1)]
            if instant and kind in OFFSETS:
                values += [(f"CAL_{kind}{k}_{axis}OFF", x, 0.0) for axis, x in zip("XYZ", OFFSETS[kind], strict=True)]
    found = [ParamChange(name, default, None, True) for name, value, default in values if value != default]
    return [ParamChange(name, value) for name, value, _ in values] + found
