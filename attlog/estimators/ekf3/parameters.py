"""EKF3's parameters that the re-run takes: unit, default, documented range, meaning, and their versions.

Ranges and meanings: ArduPilot parameter lists of 3.6 to 4.8. :func:`settings_of` knows defaults that changed.
"""

from __future__ import annotations

from collections.abc import Mapping

from attlog.estimators.firmware import ParameterTable, Version

FIRST, SOURCES = (3, 6), (4, 1)

_ROWS = (
    ("VELNE_M_NSE", "m/s", 0.3, 0.05, 5.0, "least noise of the horizontal GNSS velocity"),
    ("VELD_M_NSE", "m/s", 0.5, 0.05, 5.0, "least noise of the vertical GNSS velocity"),
    ("VEL_I_GATE", "sigma/100", 500, 100, 1000, "gate of the GNSS velocity"),
    ("POSNE_M_NSE", "m", 0.5, 0.1, 10.0, "least noise of the GNSS position"),
    ("POS_I_GATE", "sigma/100", 500, 100, 1000, "gate of the GNSS position"),
    ("GLITCH_RAD", "m", 25, 0, 100, "radius of a position reset; 0 rejects no GNSS"),
    ("ALT_M_NSE", "m", 2.0, 0.1, 100.0, "noise of the barometer"),
    ("HGT_I_GATE", "sigma/100", 500, 100, 1000, "gate of the height"),
    ("HGT_DELAY", "ms", 60, 0, 250, "delay of the height against the IMU"),
    ("MAG_M_NSE", "gauss", 0.05, 0.01, 0.5, "noise of the compass"),
    ("MAG_CAL", "", 3, 0, 6, "field learns 0 in flight, 1 in manoeuvres, 2 never, 3 after the climb, 4 always"),
    ("MAG_I_GATE", "sigma/100", 300, 100, 1000, "gate of the compass axes"),
    ("MAG_EF_LIM", "mgauss", 50, 0, 500, "allowed difference of the earth field to the table; 0 no table", (4, 0)),
    ("YAW_M_NSE", "rad", 0.5, 0.05, 1.0, "noise of a heading"),
    ("YAW_I_GATE", "sigma/100", 300, 100, 1000, "gate of a heading"),
    ("EAS_M_NSE", "m/s", 1.4, 0.5, 5.0, "noise of the airspeed"),
    ("EAS_I_GATE", "sigma/100", 400, 100, 1000, "gate of the airspeed"),
    ("GYRO_P_NSE", "rad/s", 0.015, 0.0001, 0.1, "gyro noise of the covariance prediction"),
    ("ACC_P_NSE", "m/s^2", 0.35, 0.01, 1.0, "accelerometer noise of the covariance prediction"),
    ("GBIAS_P_NSE", "rad/s^2", 0.001, 0.00001, 0.001, "process noise of the gyro bias"),
    ("ABIAS_P_NSE", "m/s^3", 0.02, 0.00001, 0.02, "process noise of the accelerometer bias"),
    ("MAGE_P_NSE", "gauss/s", 0.001, 0.00001, 0.01, "process noise of the earth field"),
    ("MAGB_P_NSE", "gauss/s", 0.0001, 0.00001, 0.01, "process noise of the body field"),
    ("WIND_P_NSE", "m/s^2", 0.1, 0.01, 2.0, "process noise of the wind"),
    ("WIND_PSCALE", "", 1.0, 0.0, 2.0, "growth of the wind's noise with the climb rate"),
    ("GPS_CHECK", "bits", 31, 0, 255, "checks before GNSS is used"),
    ("CHECK_SCALE", "%", 100, 50, 200, "scale of these checks' limits"),
    ("NOAID_M_NSE", "m", 10, 0.5, 50.0, "noise of the held position without aid"),
    ("BETA_MASK", "bits", 0, 0, 3, "1 air data may correct more than the wind beside GNSS", (4, 0)),
    ("ACC_BIAS_LIM", "m/s^2", 1.0, 0.5, 2.5, "largest accelerometer bias"),
    ("GND_EFF_DZ", "m", 4, 0, 10, "dead zone of the barometer in ground effect", (4, 1)),
    ("MAG_MASK", "bits", 0, 0, 255, "lanes that fuse a heading only"),
    ("SRC1_POSXY", "", 3, 0, 6, "source of the horizontal position: 0 none, 3 GNSS", SOURCES),
    ("SRC1_VELXY", "", 3, 0, 7, "source of the horizontal velocity: 0 none, 3 GNSS", SOURCES),
    ("SRC1_VELZ", "", 3, 0, 6, "source of the vertical velocity: 0 none, 3 GNSS", SOURCES),
    ("SRC1_POSZ", "", 1, 0, 6, "source of the height: 1 barometer, 3 GNSS", SOURCES),
    ("SRC1_YAW", "", 1, 0, 8, "source of the heading: 0 none, 1 compass, 8 GSF", SOURCES),
    ("GPS_TYPE", "", 0, 0, 3, "GNSS: 0 velocity, 1 horizontal velocity, 2 position only, 3 none", FIRST, (4, 0)),
    ("ALT_SOURCE", "", 0, 0, 3, "source of the height: 0 barometer, 2 GNSS", FIRST, (4, 0)),
    ("GPS_DELAY_MS", "ms", 0, 0, 250, "lag of the receiver; 0: that of its driver"),
)  # fmt: skip
# Defaults of planes.
PLANE_DEFAULTS = {"VELNE_M_NSE": 0.5, "VELD_M_NSE": 0.7, "ALT_M_NSE": 3.0, "CHECK_SCALE": 150.0, "MAG_CAL": 0.0}

# Names that another version uses for the same thing.
_ALIASES = {"GPS1_DELAY_MS": "GPS_DELAY_MS"}
# Parameters of EKF3 that the re-run does not offer, and why.
_NOT_OFFERED = {
    "EK3_IMU_MASK": "the lanes are those that flew",
    "EK3_PRIMARY": "the lane is the one that flew",
    "EK3_AFFINITY": "the choice of sensors is taken from the log",
    "EK3_ERR_THRESH": "the choice of the lane is taken from the log",
    "EK3_FLOW_": "optical flow is not modelled",
    "EK3_MAX_FLOW": "optical flow is not modelled",
    "EK3_RNG_": "the range finder is not modelled",
    "EK3_TERR_": "the range finder is not modelled",
    "EK3_BCN_": "beacons are not modelled",
    "EK3_VIS_": "vision is not modelled",
    "EK3_WENC_": "wheel encoders are not modelled",
    "EK3_DRAG_": "drag is not modelled",
    "EK3_GSF_": "the yaw estimator is taken from the log",
    "EK3_SRC2_": "the second set of sources is not modelled",
    "EK3_SRC3_": "the third set of sources is not modelled",
    "EK3_OGN": "moves of the origin are not modelled",
    "EK3_TAU_OUTPUT": "attitude does not depend on it",
    "EK3_HRT_FILT": "attitude does not depend on it",
    "EK3_LOG_LEVEL": "it changes the log only",
}


TABLE = ParameterTable(
    "EK3_",
    "ArduPilot parameters",
    ParameterTable.rows_of(_ROWS, FIRST),
    _ALIASES,
    _NOT_OFFERED,
    outside=("GPS_DELAY_MS",),
)


def settings_of(params: Mapping[str, float], version: Version, plane: bool) -> dict[str, float]:
    """Return the settings by short name: those of ``params`` (full names), else the defaults of the version."""
    found = {name: float(p.default) for name, p in TABLE.rows.items()}
    if plane:
        found |= PLANE_DEFAULTS
    elif version < SOURCES:
        found |= {"VELNE_M_NSE": 0.5}
    if version < (4, 0):
        found |= {"MAG_EF_LIM": 0.0}
    return found | TABLE.logged(params)


def sources_of(setting: Mapping[str, float], version: Version) -> dict[str, float]:
    """Return the settings with the sources that older parameters name."""
    found = dict(setting)
    if version < SOURCES:
        kind = setting["GPS_TYPE"]
        found["SRC1_POSXY"] = 0.0 if kind == 3.0 else 3.0
        found["SRC1_VELXY"] = 3.0 if kind <= 1.0 else 0.0
        found["SRC1_VELZ"] = 3.0 if kind == 0.0 else 0.0
        found["SRC1_POSZ"] = 3.0 if setting["ALT_SOURCE"] == 2.0 else 1.0
        found["SRC1_YAW"] = 0.0 if setting["MAG_CAL"] >= 5.0 else 1.0
    return found
