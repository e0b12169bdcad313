"""Each parameter that is computed with has the limits of its quantity, both ends of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.flight import physics
from attlog.flight.parameters import limits

GROUPS = [
    ("EKF2_MAG_DECL ATT_MAG_DECL", -180.0, 180.0),
    ("COMPASS_DEC", -math.pi, math.pi),
    ("AHRS_TRIM_X AHRS_TRIM_Z", -0.5 * math.pi, 0.5 * math.pi),
    ("INS_GYRO_FILTER INS_ACCEL_FILTER IMU_GYRO_CUTOFF IMU_ACCEL_CUTOFF", 1.0, 10_000.0),
    ("CAL_GYRO0_XOFF CAL_GYRO2_ZOFF", -10.0, 10.0),
    ("CAL_ACC1_YOFF", -100.0, 100.0),
    ("CAL_MAG3_XOFF", -50.0, 50.0),
    ("CAL_ACC0_XSCALE CAL_MAG0_ZSCALE CAL_MAG1_YODIAG", -20.0, 20.0),
    ("CAL_GYRO0_ROT CAL_ACC0_ROT CAL_MAG0_ROT SENS_BOARD_ROT", -1.0, 200.0),
    ("CAL_MAG0_ROLL CAL_MAG1_YAW SENS_BOARD_X_OFF SENS_BOARD_Z_OFF", -360.0, 360.0),
    ("MOT_PWM_MIN MOT_PWM_MAX RC3_MIN RC16_MAX", 0.0, 10_000.0),
    ("ATT_W_ACC ATT_W_GYRO_BIAS ATT_BIAS_MAX AHRS_RP_P AHRS_YAW_P AHRS_GPS_GAIN", 0.0, 100.0),
    ("FRAME_CLASS SYSID_SW_TYPE RCMAP_THROTTLE INS_RAW_LOG_OPT", -1.0, 65_535.0),
    ("SCHED_LOOP_RATE", 0.0, 32_000.0),
]


@pytest.mark.parametrize(("names", "low", "high"), GROUPS)
def test_a_parameter_has_the_limits_of_its_quantity(names: str, low: float, high: float) -> None:
    for name in names.split():
        found = limits.quantity_of(name)
        assert found is not None, name
        assert (found.low, found.high) == (low, high), name
        assert limits.impossible(name, low) is limits.impossible(name, high) is None
        beyond = high + 1e-6 * max(abs(high), 1.0)
        assert limits.impossible(name, beyond) is found
        below = low - 1e-6 * max(abs(low), 1.0)
        assert limits.impossible(name, below) is found
        assert limits.impossible(name, math.nan) is found


def test_a_filter_that_is_off_is_possible_and_one_below_a_hertz_is_not() -> None:
    for value, possible in ((0.0, True), (-1.0, True), (-0.5, True), (-1.01, False), (0.01, False), (0.99, False)):
        assert (limits.impossible("IMU_GYRO_CUTOFF", value) is None) is possible
    assert limits.impossible("SCHED_LOOP_RATE", -0.5) is not None


@pytest.mark.parametrize("name", ["XEKF2_MAG_DECL", "CAL_ACC0_XOFFS", "RC_MIN", "CAL_GYRO0_XSCALE", "ATT_W_EXT_HDG"])
def test_a_parameter_that_is_not_computed_with_has_no_limits(name: str) -> None:
    assert limits.quantity_of(name) is None
    assert limits.impossible(name, 1e30) is None


QUANTITIES = {
    "LATITUDE": (-90.0, 90.0),
    "LONGITUDE": (-180.0, 180.0),
    "HEIGHT": (-1e3, 1e5),
    "SPEED": (-1e3, 1e3),
    "PLACE_ACCURACY": (0.0, 1e5),
    "SPEED_ACCURACY": (0.0, 1e4),
    "SATELLITES": (0.0, 100.0),
    "HDOP": (0.1, 50.0),
    "GNSS_YAW": (-2.0 * math.pi, 2.0 * math.pi),
    "ESTIMATED_YAW": (-2.0 * math.pi, 2.0 * math.pi),
    "BARO": (-5e3, 1e5),
    "RANGE": (0.0, 5e3),
    "AIRSPEED": (-100.0, 1e3),
    "THROTTLE": (-10.0, 10.0),
    "RPM": (-1e6, 1e6),
    "VOLTAGE": (0.0, 1e3),
    "CURRENT": (-1e4, 1e4),
    "RATE_SETPOINT": (-200.0, 200.0),
    "ACC_BIAS": (-10.0, 10.0),
    "GYRO_BIAS": (-10.0, 10.0),
    "TEST_RATIO": (0.0, 1e6),
    "QUATERNION_NORM": (0.95, 1.05),
    "EULER_DEG": (-720.0, 720.0),
}


@pytest.mark.parametrize("name", QUANTITIES)
def test_a_quantity_lies_within_what_the_docs_say(name: str) -> None:
    low, high = QUANTITIES[name]
    found = getattr(physics, name)
    assert (found.low, found.high) == (low, high)
    at = [low, high, 0.5 * (low + high), math.nan, low - 1e-3 * max(1.0, -low), high + 1e-3 * high]
    assert found.outside(np.array(at)).tolist() == [False] * 4 + [True] * 2


def test_clocks_and_rates_end_where_no_autopilot_goes() -> None:
    """2010-01-01 and 2100-01-01, three days, and records of 40, 10 and 0.5 kHz."""
    assert (physics.UTC_US.low, physics.UTC_US.high) == (1_262_304_000_000_000, 4_102_444_800_000_000)
    assert (physics.CLOCK_US.low, physics.CLOCK_US.high) == (0, 4_102_444_800_000_000)
    assert (physics.RAW_HZ, physics.FUSED_HZ, physics.AIDING_HZ, physics.LONGEST_S) == (4e4, 1e4, 500.0, 259_200.0)


def test_limits_in_words_have_their_unit_and_a_true_minus() -> None:
    assert physics.HEIGHT.limits == "−1,000 to 100,000 m"
    assert physics.SATELLITES.limits == "0 to 100"
