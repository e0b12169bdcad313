import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.metrics.errors import bias
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 60.0, 0.01)


def error(believed_dps, true_dps, segments=None, **fields):
    gyro = np.radians(true_dps) + np.radians(0.05) * np.random.default_rng(0).standard_normal((len(T), 3))
    row = flights.row(T, np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1)), **fields)
    row.bias = None if believed_dps is None else np.tile(np.radians(believed_dps), (len(T), 1))
    case = flights.case([row], segments or [Segment("continuous", 0, 60), Segment("rest.long", 0, 40)])
    acc = Stream(T, np.tile([0.0, 0.0, -9.81], (len(T), 1)), "m/s^2", "FRD", "imu")
    case.log.imus, case.log.imu = [Imu(0, Stream(T, gyro, "rad/s", "FRD", "imu"), acc)], 0
    return bias.compute(case, row, "rest")["gyro_bias_error_dps"]


def test_the_error_is_the_length_of_the_difference_from_the_mean_rate_at_rest():
    found = error([0.5, 0.2, -0.1], [0.2, 0.2, 0.3])
    assert found.value == pytest.approx(0.5, abs=0.01)
    assert found.detail["mean_error_dps"] == pytest.approx([0.3, 0.0, -0.4], abs=0.01)
    assert found.ci95[0] < found.value < found.ci95[1]
    assert found.n == 6


def test_a_filter_without_a_bias_and_a_log_without_rest_have_none():
    assert error(None, [0.2, 0.2, 0.3]).code == "not_applicable"
    assert error([0.0, 0.0, 0.0], [0.2, 0.2, 0.3]).code == "not_applicable"
    assert error([0.5, 0.2, -0.1], [0.2, 0.2, 0.3], [Segment("continuous", 0, 60)]).code == "no_rest"


def test_one_window_of_rest_has_neither_an_interval_nor_a_rank():
    for end, windows in ((16.0, 1), (22.0, 2)):
        found = error([0.5, 0.2, -0.1], [0.2, 0.2, 0.3], [Segment("continuous", 0, 60), Segment("rest.long", 0, end)])
        assert (found.n, found.ranked, found.ci95 is None) == (windows, windows > 1, windows == 1)
