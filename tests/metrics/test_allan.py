import allantools
import numpy as np
import pytest

from attlog.core import rotation
from attlog.metrics import allan
from attlog.segments.model import Segment
from tests.metrics import flights

STEP = 0.01


def test_the_deviation_is_that_of_allantools():
    phase = np.cumsum(np.random.default_rng(0).standard_normal(4000)) * STEP
    ours = allan.deviation(phase, STEP)
    tau, theirs, _, _ = allantools.oadev(phase, rate=1 / STEP, data_type="phase", taus=ours.tau)
    np.testing.assert_allclose(ours.tau, tau)
    np.testing.assert_allclose(ours.sigma, theirs, rtol=1e-9)


def test_the_degrees_of_freedom_are_those_of_allantools():
    phase = np.cumsum(np.random.default_rng(0).standard_normal(2001))
    ours = allan.deviation(phase, 1.0)
    m = np.round(ours.tau).astype(int)
    theirs = [allantools.edf_simple(len(phase), int(k), 0) for k in m]
    np.testing.assert_allclose(ours.dof, theirs, rtol=1e-6)


REST = [Segment("continuous", 0, 400), Segment("rest.long", 0, 400)]


def walking_row(seconds, density=0.01, seed=3):
    t = np.arange(0.0, seconds, STEP)
    rate = density / np.sqrt(STEP) * np.random.default_rng(seed).standard_normal(len(t))
    return flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(np.cumsum(rate) * STEP)))


def test_a_floor_that_the_rest_is_too_short_for_is_not_invented():
    row = walking_row(100.0)
    answers = allan.ALLAN.ask(flights.case([row], REST), row, "rest")
    assert answers["allan_bias_deg_per_h"].code == "rest_too_short"
    short = walking_row(50.0)
    assert (
        allan.ALLAN.ask(flights.case([short], REST), short, "rest")["allan_arw_deg_per_sqrt_h"].code == "rest_too_short"
    )


def test_white_heading_noise_is_no_angle_random_walk():
    t = np.arange(0.0, 200.0, STEP)
    noise = np.radians(0.01) * np.random.default_rng(1).standard_normal(len(t))
    row = flights.row(t, rotation.from_euler(0.0, 0.0, noise))
    assert allan.ALLAN.ask(flights.case([row], REST), row, "rest")["allan_arw_deg_per_sqrt_h"].code == "not_applicable"


def test_averages_of_white_angle_noise_fall_with_the_root_of_tau():
    angle = 0.02 * np.random.default_rng(5).standard_normal(20_000)
    d = allan.average_deviation(angle, STEP)
    short = d.tau < 1.5
    np.testing.assert_allclose(d.sigma[short], 0.02 * np.sqrt(STEP / d.tau[short]), rtol=0.1)


def test_the_answer_is_the_floor_over_0_664_in_degrees_per_hour():
    bowl = np.array([3.0, 1.0, 2.0]) * 1e-3
    d = allan.Deviation(np.array([1.0, 10.0, 20.0]), bowl, 0.9 * bowl, 1.2 * bowl, np.array([90.0, 20.0, 9.0]))
    answer = allan.floor_answer(d, 200.0, "rest")
    assert answer.value == pytest.approx(3600.0 * 1e-3 / 0.664, rel=1e-3)
    assert answer.ci95 == pytest.approx((0.9 * answer.value, 1.2 * answer.value))
    assert allan.floor_answer(d, 90.0, "rest").code == "rest_too_short"


def test_the_interval_of_the_walk_is_that_of_allantools_at_one_second():
    row = walking_row(300.0)
    answer = allan.ALLAN.ask(flights.case([row], REST), row, "rest")["allan_arw_deg_per_sqrt_h"]
    edf = allantools.edf_simple(len(row.t), round(1.0 / STEP), 0)
    low, high = allantools.confidence_interval(answer.value, edf, ci=0.95)
    assert answer.ci95 == pytest.approx((low, high), rel=0.01)
