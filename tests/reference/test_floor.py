"""The step of time stamps, of the attitude's own too."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.reference import floor
from attlog.reference.floor import TICK_S, tick_s


def test_stamps_in_whole_milliseconds_that_differ_show_their_step() -> None:
    rng = np.random.default_rng(0)
    assert tick_s(np.cumsum(rng.choice([0.020, 0.021], 200))) == TICK_S
    assert tick_s(np.arange(200) * 0.02) == 0.0, "nothing shows where all are equal"
    assert tick_s(np.cumsum(rng.uniform(0.01, 0.03, 200))) == 0.0


def test_intervals_none_of_which_is_usual_show_no_step() -> None:
    assert tick_s(np.cumsum([0.0, *[0.010, 0.090] * 40])) == 0.0  # the median of an even number lies between them


def test_a_gap_that_ends_an_estimate_leaves_no_error_and_a_bridged_one_a_quarter_of_its_turn():
    """Rates that change by 40 deg/s over 0.4 s: 4 deg; over 0.8 s a filter starts anew and nothing is integrated."""
    found = []
    for seconds in (0.4, 0.8):
        t = np.concatenate([np.arange(0.0, 5.0, 0.01), np.arange(5.0 - 0.01 + seconds, 10.0, 0.01)])
        rate = np.radians(np.where(t < 5.0, 0.0, 40.0))[:, None] * [0.0, 0.0, 1.0]
        unit = Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU"), Stream(t, 0.0 * rate, "m/s^2", "FRD", "IMU"))
        found.append(floor.missing_deg(unit))
    assert found == [pytest.approx(4.0), 0.0]
