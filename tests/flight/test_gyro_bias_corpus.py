"""Size and sign of the onboard gyro bias, on simulated flights whose gyros have a planted bias."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog

WITHIN_DEG_S = {"px4": 0.03, "ardupilot": 0.1}
"""The planted biases are 0.2 to 0.9 deg/s. A mean of 8 s of this noise is good to 0.01 deg/s, the earth's turn is
0.004 deg/s. ArduPilot logs steps of 0.01 deg/s, and its z, seen through the compass only, is still settling at
arming: 0.08 deg/s short at the most."""


@pytest.mark.parametrize(
    "name",
    [
        "px4/px4_static.ulg",
        "px4/px4_hover.ulg",
        "px4/px4_steps.ulg",
        "ardupilot/copter_hover_rest.bin",
        "ardupilot/copter_static_hop.bin",
        "ardupilot/copter_long.bin",
    ],
)
def test_before_arming_it_is_what_the_logged_gyro_shows_standing_still(corpus: Path, name: str) -> None:
    log = attlog.read(corpus / "sitl" / name)
    bias, imu, armed = log.onboard_gyro_bias, log.replay_imu, log.armed
    assert bias is not None
    assert imu is not None
    assert armed is not None
    start = float(armed.t[armed.value.index(True)])
    still = (imu.gyro.t > start - 9.0) & (imu.gyro.t < start - 1.0)
    apart = np.degrees(bias.x[bias.t < start][-1] - imu.gyro.x[still].mean(axis=0))
    assert np.abs(apart).max() < WITHIN_DEG_S[name.split("/")[0]]
