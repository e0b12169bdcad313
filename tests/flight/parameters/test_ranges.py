"""Ranges of parameters as the firmwares' own lists give them (@Range of ArduPilot 4.5, @min and @max of PX4 1.14)."""

from __future__ import annotations

import pytest

from attlog.flight.parameters.ranges import documented, is_whole


@pytest.mark.parametrize(
    ("names", "low", "high"),
    [
        ("COMPASS_OFS_X COMPASS_OFS2_Y COMPASS_OFS3_Z", -400.0, 400.0),
        ("COMPASS_MOT_X COMPASS_MOT3_Z", -1000.0, 1000.0),
        ("COMPASS_MOTCT INS_TCAL2_ENABLE", 0.0, 2.0),
        ("COMPASS_USE COMPASS_USE3 INS_HNTCH_ENABLE INS_HNTC2_ENABLE INS_HNTCH_REF", 0.0, 1.0),
        ("COMPASS_DEC", -3.142, 3.142),
        ("INS_ACCOFFS_X INS_ACC2OFFS_Y INS_ACC3OFFS_Z INS4_ACCOFFS_X CAL_ACC0_XOFF CAL_ACC3_ZOFF", -3.5, 3.5),
        ("INS_ACCSCAL_X INS_ACC2SCAL_Y INS5_ACCSCAL_Z", 0.8, 1.2),
        ("INS_GYRO_FILTER INS_ACCEL_FILTER", 0.0, 256.0),
        ("INS_HNTCH_MODE", 0.0, 5.0),
        ("INS_HNTCH_FREQ INS_HNTC2_FREQ", 10.0, 495.0),
        ("INS_HNTCH_BW", 5.0, 250.0),
        ("INS_HNTCH_ATT", 5.0, 50.0),
        ("INS_HNTCH_FM_RAT", 0.1, 1.0),
        ("GPS_DELAY_MS GPS_DELAY_MS2 GPS1_DELAY_MS GPS2_DELAY_MS EK3_HGT_DELAY", 0.0, 250.0),
        ("EK2_MAG_M_NSE EK3_MAG_M_NSE", 0.01, 0.5),
        ("EK3_VELNE_M_NSE EK3_VELD_M_NSE EK2_VELNE_M_NSE", 0.05, 5.0),
        ("EK3_POSNE_M_NSE", 0.1, 10.0),
        ("EK3_ALT_M_NSE", 0.1, 100.0),
        ("EK3_EAS_M_NSE EKF2_EAS_NOISE", 0.5, 5.0),
        ("CAL_MAG0_PRIO CAL_MAG3_PRIO IMU_GYRO_NF0_BW", 0.0, 100.0),
        ("IMU_GYRO_NF0_FRQ IMU_GYRO_NF_FREQ IMU_GYRO_CUTOFF IMU_ACCEL_CUTOFF", 0.0, 1000.0),
        ("IMU_GYRO_DNF_EN CAL_MAG_COMP_TYP", 0.0, 3.0),
        ("IMU_GYRO_DNF_BW", 5.0, 30.0),
        ("IMU_GYRO_DNF_HMC", 1.0, 7.0),
        ("EKF2_GPS_DELAY EKF2_MAG_DELAY EKF2_BARO_DELAY SENS_GPS0_DELAY", 0.0, 300.0),
        ("EKF2_MAG_NOISE", 0.001, 1.0),
        ("EKF2_HEAD_NOISE", 0.01, 1.0),
        ("EKF2_GPS_V_NOISE", 0.01, 5.0),
        ("EKF2_GPS_P_NOISE", 0.01, 10.0),
        ("EKF2_BARO_NOISE", 0.01, 15.0),
    ],
)
def test_a_parameter_has_the_range_of_its_firmware(names: str, low: float, high: float) -> None:
    assert {name: documented(name) for name in names.split()} == dict.fromkeys(names.split(), (low, high))


@pytest.mark.parametrize(
    "name", ["COMPASS_OFS4_X", "XCOMPASS_OFS_X", "COMPASS_OFS_X2", "EKF2_GPS_DELAYS", "ARMING_CHECK", ""]
)
def test_a_parameter_that_is_in_no_list_is_never_offered(name: str) -> None:
    assert documented(name) is None


def test_counts_switches_and_devices_are_whole_numbers() -> None:
    whole = ["COMPASS_USE2", "INS_HNTCH_OPTS", "CAL_MAG0_ROT", "GPS_DELAY_MS", "IMU_GYRO_DNF_HMC", "EK3_HGT_DELAY"]
    assert [name for name in whole if not is_whole(name)] == []
    assert not any(is_whole(name) for name in ("COMPASS_OFS_X", "INS_HNTCH_FREQ", "EKF2_GPS_DELAY", "CAL_MAG0_XOFF"))
