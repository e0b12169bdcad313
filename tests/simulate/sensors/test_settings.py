"""What a sensor is like without a word said: the data sheets and accuracies that the settings name."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from attlog.simulate.sensors.settings import GyroSettings, MagSettings, SensorSettings


def test_the_gyro_is_the_data_sheets() -> None:
    """TDK DS-000143: 0.006 deg/s/sqrt(Hz); a hundredth of it per root of hour would walk 0.0002 deg/s/sqrt(s)."""
    gyro = GyroSettings()
    assert gyro.noise_dps_rthz == 0.006
    assert gyro.walk_dps_rts * math.sqrt(3600.0) == pytest.approx(0.012)
    assert gyro.bias_spread_dps == 0.1


def test_the_magnetometer_is_a_magneto_inductive_one() -> None:
    """PNI RM3100 at 200 counts: 13 nT a count, 1100 uT, 50 nT at 1 Hz."""
    mag = MagSettings()
    assert (mag.step_ut, mag.range_ut, mag.noise_ut_rthz, mag.rate_hz) == (0.013, 1100.0, 0.05, 50.0)
    assert mag.hard_iron_spread_ut == 0.3


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"noise_ut_rthz": -0.1}, {"range_ut": 0.0}, {"other": 1.0}])
def test_what_no_sensor_can_have_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        MagSettings(**wrong)  # type: ignore[arg-type]


def test_a_board_has_one_of_each() -> None:
    board = SensorSettings()
    assert [len(part) for part in (board.imu, board.mag, board.gnss, board.baro)] == [1, 1, 1, 1]
