"""An accelerometer's offset becomes parameters with which the firmware's own correction shows it no more."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.health.settings import accelerometer
from tests.flight.calibration.made import OLD, ardupilot, px4, raw_field

BIAS, OFFSET, SCALE = np.array([0.3, -0.2, 0.15]), np.array([0.05, -0.1, 0.6]), np.array([1.02, 0.97, 1.01])
TURN = Rotation.from_euler("z", 90.0, degrees=True)
RAW = np.random.default_rng(5).normal(size=(30, 3))


def named(pattern: str, values: np.ndarray) -> dict[str, float]:
    return {pattern.format(axis): float(v) for axis, v in zip("XYZ", values, strict=True)}


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_the_bias_vanishes_with_the_proposed_parameters(firmware: str) -> None:
    """Both firmwares: turned by the board after (raw - offset) * scale."""
    if firmware == "ardupilot":
        names = "INS_ACCOFFS_{}"
        log = ardupilot(OLD | {"AHRS_ORIENTATION": 2.0} | named(names, OFFSET) | named("INS_ACCSCAL_{}", SCALE))
    else:
        names = "CAL_ACC3_{}OFF"
        own = {"CAL_ACC3_ID": 7.0, "SENS_BOARD_ROT": 2.0} | named("CAL_ACC3_{}SCALE", SCALE)
        log = px4(own | named(names, OFFSET), raw_field(), None)
    found = accelerometer.proposal(log, log.imus[0], BIAS)
    assert found.refused == ""
    new = {s.name: s.new for s in found.settings}
    assert {s.unit for s in found.settings} == {"m/s^2"}
    moved = np.array([new[names.format(axis)] for axis in "XYZ"])
    before, after = (TURN.apply((RAW - offset) * SCALE) for offset in (OFFSET, moved))
    np.testing.assert_allclose(before - after, np.tile(BIAS, (30, 1)), atol=1e-4)


def test_without_a_slot_or_beyond_the_range_nothing_is_proposed() -> None:
    log = px4({"CAL_ACC0_ID": 8.0}, raw_field(), None)
    assert "device 7" in accelerometer.proposal(log, log.imus[0], BIAS).refused
    log = ardupilot(OLD | named("INS_ACCOFFS_{}", OFFSET))
    assert "range of -3.5 to 3.5" in accelerometer.proposal(log, log.imus[0], np.array([0.0, 0.0, 5.0])).refused
    log.imus[0].index = 1
    assert "INS_ACC2OFFS_X" in accelerometer.proposal(log, log.imus[0], BIAS).refused


def test_an_axis_without_an_error_keeps_its_value_to_the_last_digit() -> None:
    log = ardupilot(OLD | named("INS_ACCOFFS_{}", np.array([-0.27269041, 0.10993993, -0.66610938])))
    found = accelerometer.proposal(log, log.imus[0], np.array([0.0, 0.0, -0.41]))
    assert [(s.name, s.new) for s in found.settings] == [("INS_ACCOFFS_Z", pytest.approx(-1.0761, abs=1e-4))]
