"""EKF2's parameters that the re-run takes: unit, default, documented range, meaning, and their versions.

Ranges and meanings: PX4 parameter reference of 1.8 to 1.17. :func:`settings_of` knows defaults that changed.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.estimators.ekf2.state import ERA_A, ERA_B, ERA_C, ERA_D
from attlog.estimators.firmware import LAST, ParameterTable, Version

# First and last versions of the eras.
A, B, C, D = (1, 8), (1, 12), (1, 14), (1, 15)
A_END, B_END = (1, 11), (1, 13)

_ROWS = (
    ("PREDICT_US", "us", 10000, 1000, 20000, "time between predictions of the filter", B),
    ("GYR_NOISE", "rad/s", 0.015, 0.0001, 0.1, "gyro noise of the covariance prediction"),
    ("ACC_NOISE", "m/s^2", 0.35, 0.01, 1.0, "accelerometer noise of the covariance prediction"),
    ("GYR_B_NOISE", "rad/s^2", 0.001, 0.0, 0.01, "process noise of the gyro bias"),
    ("ACC_B_NOISE", "m/s^3", 0.003, 0.0, 0.01, "process noise of the accelerometer bias"),
    ("GYR_B_LIM", "rad/s", 0.15, 0.0, 0.4, "largest gyro bias", C),
    ("GBIAS_INIT", "rad/s", 0.1, 0.0, 0.2, "sigma of the gyro bias at switch-on", A, LAST, True),
    ("ABIAS_INIT", "m/s^2", 0.2, 0.0, 0.5, "sigma of the accelerometer bias at switch-on", A, LAST, True),
    ("ANGERR_INIT", "rad", 0.1, 0.0, 0.5, "sigma of the tilt after the first alignment", A, LAST, True),
    ("ABL_LIM", "m/s^2", 0.4, 0.0, 0.8, "largest accelerometer bias"),
    ("ABL_ACCLIM", "m/s^2", 25, 20, 200, "no accelerometer bias is learnt above this force"),
    ("ABL_GYRLIM", "rad/s", 3, 2, 20, "no accelerometer bias is learnt above this rate"),
    ("ABL_TAU", "s", 0.5, 0.1, 1.0, "time constant of the two limits above"),
    ("MAG_NOISE", "gauss", 0.05, 0.001, 1.0, "noise of the magnetometer"),
    ("HEAD_NOISE", "rad", 0.3, 0.01, 1.0, "noise of a magnetic heading"),
    ("MAG_E_NOISE", "gauss/s", 0.001, 0.0, 0.1, "process noise of the earth field"),
    ("MAG_B_NOISE", "gauss/s", 0.0001, 0.0, 0.1, "process noise of the body field"),
    ("MAG_TYPE", "", 0, 0, 6, "0 automatic, 1 heading, 2 three axes (to 1.14), 5 none, 6 at the start (1.15+)"),
    ("MAG_ACCLIM", "m/s^2", 0.5, 0.0, 5.0, "horizontal acceleration that makes heading observable"),
    ("MAG_YAWLIM", "rad/s", 0.2, 0.0, 1.0, "yaw rate from which three axes are fused", A, C),
    ("MAG_GATE", "sigma", 3, 1, 1000, "gate of the magnetometer's axes"),
    ("HDG_GATE", "sigma", 2.6, 1, 1000, "gate of a magnetic heading"),
    ("DECL_TYPE", "bits", 7, 0, 7, "1 declination of the world model, 2 kept in MAG_DECL, 4 fused"),
    ("MAG_DECL", "deg", 0, -180, 180, "declination where no model is used"),
    ("MAG_CHECK", "bits", 1, 0, 7, "1 strength is checked against the model"),
    ("MAG_CHK_STR", "gauss", 0.2, 0.0, 1.0, "allowed difference of the strength", D),
    ("MAGBIAS_X", "gauss", 0, -0.5, 0.5, "field subtracted from x", A, A_END),
    ("MAGBIAS_Y", "gauss", 0, -0.5, 0.5, "field subtracted from y", A, A_END),
    ("MAGBIAS_Z", "gauss", 0, -0.5, 0.5, "field subtracted from z", A, A_END),
    ("MIN_OBS_DT", "ms", 20, 10, 50, "least time between samples of one sensor", A, A_END),
    ("GPS_V_NOISE", "m/s", 0.3, 0.01, 5.0, "least noise of the GNSS velocity"),
    ("GPS_P_NOISE", "m", 0.5, 0.01, 10.0, "least noise of the GNSS position"),
    ("GPS_V_GATE", "sigma", 5, 1, 1000, "gate of the GNSS velocity"),
    ("GPS_P_GATE", "sigma", 5, 1, 1000, "gate of the GNSS position"),
    ("NOAID_NOISE", "m", 10, 0.5, 50, "noise of the held position without aid"),
    ("BARO_NOISE", "m", 3.5, 0.01, 15, "noise of the barometer"),
    ("BARO_GATE", "sigma", 5, 1, 1000, "gate of the barometer"),
    ("GND_EFF_DZ", "m", 4, 0, 10, "dead zone of the barometer in ground effect"),
    ("GPS_DELAY", "ms", 110, 0, 300, "delay of GNSS against the IMU"),
    ("MAG_DELAY", "ms", 0, 0, 300, "delay of the magnetometer against the IMU"),
    ("BARO_DELAY", "ms", 0, 0, 300, "delay of the barometer against the IMU"),
    ("ASP_DELAY", "ms", 100, 0, 300, "delay of the airspeed against the IMU"),
    ("DELAY_MAX", "ms", 200, 0, 1000, "longest delay of any aid: how late the filter runs", D),
    ("AID_MASK", "bits", 1, 0, 511, "1 GNSS", A, B_END),
    ("HGT_MODE", "", 0, 0, 3, "height by 0 barometer, 1 GNSS", A, B_END),
    ("GPS_CTRL", "bits", 7, 0, 15, "GNSS: 1 position, 2 height, 4 velocity", C),
    ("BARO_CTRL", "", 1, 0, 1, "barometer in use", C),
    ("HGT_REF", "", 1, 0, 3, "height reference: 0 barometer, 1 GNSS", C),
    ("IMU_CTRL", "bits", 7, 0, 7, "4 gravity is fused without GNSS", C),
    ("REQ_EPH", "m", 3, 2, 100, "horizontal accuracy that GNSS needs to start"),
    ("REQ_EPV", "m", 5, 2, 100, "vertical accuracy that GNSS needs to start"),
    ("REQ_SACC", "m/s", 0.5, 0.5, 5.0, "speed accuracy that GNSS needs to start"),
    ("REQ_NSATS", "", 6, 4, 12, "satellites that GNSS needs to start"),
    ("REQ_GPS_H", "s", 10, 0.1, 60, "how long GNSS must be good to start"),
    ("GPS_POS_X", "m", 0, -10, 10, "antenna forward of the IMU"),
    ("GPS_POS_Y", "m", 0, -10, 10, "antenna right of the IMU"),
    ("GPS_POS_Z", "m", 0, -10, 10, "antenna below the IMU"),
    ("GRAV_NOISE", "", 1, 0.1, 10, "noise of the direction of gravity", C),
    ("ARSP_THR", "m/s", 0, 0, 50, "airspeed is fused above this; 0 never"),
    ("EAS_NOISE", "m/s", 1.4, 0.5, 5.0, "noise of the airspeed"),
    ("TAS_GATE", "sigma", 3, 1, 1000, "gate of the airspeed"),
    ("FUSE_BETA", "", 0, 0, 1, "sideslip is held small"),
    ("BETA_NOISE", "rad", 0.3, 0.1, 1.0, "noise of the sideslip"),
    ("BETA_GATE", "sigma", 5, 1, 1000, "gate of the sideslip"),
    ("WIND_NSD", "m/s^2/sqrt(Hz)", 0.05, 0.0, 1.0, "process noise of the wind"),
)  # fmt: skip

# Names that another version uses for the same thing.
_ALIASES = {
    "EKF2_WIND_NOISE": "WIND_NSD",
    "EKF2_GB_LIM": "GYR_B_LIM",
    "EKF2_CHECK_MAG": "MAG_CHECK",
    "SENS_GPS0_DELAY": "GPS_DELAY",
    "SENS_GPS0_OFFX": "GPS_POS_X",
    "SENS_GPS0_OFFY": "GPS_POS_Y",
    "SENS_GPS0_OFFZ": "GPS_POS_Z",
}
# Parameters of EKF2 that the re-run does not offer, and why.
_NOT_OFFERED = {
    "EKF2_MULTI_": "other IMUs and magnetometers are logged too slowly",
    "EKF2_SEL_": "the choice of the lane is taken from the log",
    "EKF2_OF_": "optical flow is not modelled",
    "EKF2_EV": "vision is not modelled",
    "EKF2_RNG": "the range finder is not modelled",
    "EKF2_DRAG_": "drag is not modelled",
    "EKF2_BCOEF_": "drag is not modelled",
    "EKF2_IMU_POS_": "the position of the IMU is not modelled",
    "EKF2_PCOEF_": "the pressure error is not modelled",
    "EKF2_SYNT_MAG_Z": "a synthetic vertical field is not modelled",
    "EKF2_TAU_": "attitude does not depend on it",
}


TABLE = ParameterTable("EKF2_", "PX4 parameter reference", ParameterTable.rows_of(_ROWS, A), _ALIASES, _NOT_OFFERED)


def era_of(version: Version) -> int:
    """Return the era of a firmware version."""
    if version <= A_END:
        return ERA_A
    if version <= B_END:
        return ERA_B
    return ERA_C if version == C else ERA_D


def settings_of(params: Mapping[str, float], version: tuple[int, int]) -> dict[str, float]:
    """Return the settings by short name: those of ``params`` (full names), else the defaults of the version."""
    era = era_of(version)
    found = {name: float(p.default) for name, p in TABLE.rows.items()}
    if era == ERA_A:
        found |= {"GPS_V_NOISE": 0.5}
        if version <= (1, 10):
            found |= {"BARO_NOISE": 2.0, "REQ_EPH": 5.0, "REQ_EPV": 8.0, "REQ_SACC": 1.0}
    if era <= ERA_B:
        found |= {"GYR_B_LIM": 0.35}
    found |= TABLE.logged(params)
    if era <= ERA_B:
        # AID_MASK and HGT_MODE choose the aids; before 1.14 height has one source
        found["GPS_CTRL"] = 7.0 if int(found["AID_MASK"]) & 1 else (2.0 if found["HGT_MODE"] == 1.0 else 0.0)
        found["HGT_REF"], found["BARO_CTRL"], found["IMU_CTRL"] = found["HGT_MODE"], 1.0, 3.0
    return found
