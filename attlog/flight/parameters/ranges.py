"""In which range may a parameter be set that a log gives a value for?

The documented ranges of the firmwares' parameter tables (``@Range`` of ArduPilot, ``@min`` and ``@max`` of PX4). PX4
documents none for offsets: there it is what ArduPilot documents, or a few times the earth's field. A parameter that is
not here is never offered.
"""

from __future__ import annotations

import re

RANGES: tuple[tuple[str, float, float], ...] = (
    (r"COMPASS_OFS[23]?_[XYZ]", -400.0, 400.0),
    (r"COMPASS_MOT[23]?_[XYZ]", -1000.0, 1000.0),
    (r"COMPASS_MOTCT", 0.0, 2.0),
    (r"COMPASS_USE[23]?", 0.0, 1.0),
    (r"COMPASS_DEC", -3.142, 3.142),
    (r"INS_ACC[23]?OFFS_[XYZ]|INS[45]_ACCOFFS_[XYZ]", -3.5, 3.5),
    (r"INS_ACC[23]?SCAL_[XYZ]|INS[45]_ACCSCAL_[XYZ]", 0.8, 1.2),
    (r"INS_GYRO_FILTER|INS_ACCEL_FILTER", 0.0, 256.0),
    (r"INS_HNT(CH|C2)_ENABLE", 0.0, 1.0),
    (r"INS_HNT(CH|C2)_MODE", 0.0, 5.0),
    (r"INS_HNT(CH|C2)_FREQ", 10.0, 495.0),
    (r"INS_HNT(CH|C2)_BW", 5.0, 250.0),
    (r"INS_HNT(CH|C2)_ATT", 5.0, 50.0),
    (r"INS_HNT(CH|C2)_REF", 0.0, 1.0),
    (r"INS_HNT(CH|C2)_FM_RAT", 0.1, 1.0),
    (r"INS_HNT(CH|C2)_HMNCS", 0.0, 65_535.0),
    (r"INS_HNT(CH|C2)_OPTS", 0.0, 63.0),
    (r"INS_TCAL[123]_ENABLE", 0.0, 2.0),
    (r"GPS_DELAY_MS2?|GPS[12]_DELAY_MS|EK[23]_HGT_DELAY", 0.0, 250.0),
    (r"EK[23]_MAG_M_NSE", 0.01, 0.5),
    (r"EK[23]_VELN?E?D?_M_NSE", 0.05, 5.0),
    (r"EK[23]_POSNE_M_NSE", 0.1, 10.0),
    (r"EK[23]_ALT_M_NSE", 0.1, 100.0),
    (r"EK[23]_EAS_M_NSE", 0.5, 5.0),
    (r"CAL_MAG\d_[XYZ]OFF", -2.0, 2.0),
    (r"CAL_MAG\d_[XYZ]COMP", -100.0, 100.0),
    (r"CAL_MAG_COMP_TYP", 0.0, 3.0),
    (r"CAL_MAG\d_PRIO", 0.0, 100.0),
    (r"CAL_ACC\d_[XYZ]OFF", -3.5, 3.5),
    (r"IMU_GYRO_NF\d?_FR(EQ|Q)", 0.0, 1000.0),
    (r"IMU_GYRO_NF\d?_BW", 0.0, 100.0),
    (r"IMU_GYRO_DNF_EN", 0.0, 3.0),
    (r"IMU_GYRO_DNF_BW", 5.0, 30.0),
    (r"IMU_GYRO_DNF_HMC", 1.0, 7.0),
    (r"IMU_GYRO_CUTOFF|IMU_ACCEL_CUTOFF", 0.0, 1000.0),
    (r"EKF2_(GPS|MAG|BARO|ASP|OF|RNG|EV)_DELAY|SENS_GPS\d_DELAY", 0.0, 300.0),
    (r"EKF2_MAG_NOISE", 0.001, 1.0),
    (r"EKF2_HEAD_NOISE", 0.01, 1.0),
    (r"EKF2_GPS_V_NOISE", 0.01, 5.0),
    (r"EKF2_GPS_P_NOISE", 0.01, 10.0),
    (r"EKF2_BARO_NOISE", 0.01, 15.0),
    (r"EKF2_EAS_NOISE", 0.5, 5.0),
)
"""By the whole name: lowest and highest value."""
WHOLE = re.compile(
    r"COMPASS_(MOTCT|USE[23]?|PRIO\d_ID)|INS_HNT(CH|C2)_(ENABLE|MODE|HMNCS|OPTS)|INS_TCAL\d_ENABLE|GPS\d?_DELAY_MS2?"
    r"|EK[23]_HGT_DELAY|CAL_MAG_COMP_TYP|CAL_(MAG|ACC|GYRO)\d_(PRIO|ROT|ID)|IMU_GYRO_DNF_(EN|HMC)"
)
"""Parameters that hold whole numbers: int32 in a file of QGroundControl's form."""


def documented(name: str) -> tuple[float, float] | None:
    """Lowest and highest value of a parameter; None for one that is never offered."""
    return next(((low, high) for pattern, low, high in RANGES if re.fullmatch(pattern, name)), None)


def is_whole(name: str) -> bool:
    """Whether a parameter holds a whole number."""
    return WHOLE.fullmatch(name) is not None
