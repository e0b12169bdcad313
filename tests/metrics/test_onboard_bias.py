"""The onboard estimator's gyro bias as a line of the figure."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Stream
from attlog.metrics.figures.traces import onboard_bias
from tests.metrics import flights

T = np.arange(0.0, 20.0, 0.01)
Q = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))


def test_it_is_drawn_in_deg_per_s_at_its_own_times_with_the_onboard_row_only():
    case = flights.case([], [])
    onboard, other = flights.row(T, Q, "onboard"), flights.row(T, Q, "filter")
    assert onboard_bias(case, onboard) == []
    x = np.array([[0.01, -0.02, 0.03], [0.02, -0.02, 0.03]])
    case.log.onboard_gyro_bias = Stream(np.array([3.0, 4.0]), x, "rad/s", "FRD", "XKF1:0")
    (trace,) = onboard_bias(case, onboard)
    assert (trace.figure, trace.row) == ("bias", "onboard")
    np.testing.assert_array_equal(trace.t, [3.0, 4.0])
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(trace.columns[axis], x[:, k] * 180.0 / np.pi)
    assert onboard_bias(case, other) == []
