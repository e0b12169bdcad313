"""Where a signal stands, and how surely: against the scatter of many repetitions, on sound and on damaged streams."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Stream
from attlog.health.assessments.inertial.blocks import blocks, in_air, intact, of_stream, still
from attlog.segments import Segment, Segments


def stream(t: np.ndarray, x: np.ndarray) -> Stream:
    return Stream(t, x, "m/s^2", "FRD", "IMU")


def test_errors_that_last_for_seconds_are_covered_by_the_sigma_in_nineteen_of_twenty() -> None:
    """Each 5 s has an own error of 0.1: the sigma of 12 blocks must hold it, that of 3000 samples would not."""
    t, missed = np.arange(0.0, 60.0, 0.02), 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        slow = 0.1 * rng.normal(size=13)[(t // 5.0).astype(int)]
        found = blocks(t, (slow + 0.02 * rng.normal(size=len(t)))[:, None], [(0.0, 60.0)])
        assert found is not None
        assert len(found.x) == 12
        missed += abs(found.middle[0]) > 1.96 * found.sigma(0.0)[0]
    assert missed <= 4


def test_a_short_rest_is_cut_into_blocks_of_a_second() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    noise = np.random.default_rng(1).normal(size=(len(t), 3))
    found = blocks(t, noise, [(2.0, 9.0)])
    assert found is not None
    assert len(found.x) == 7
    assert found.seconds == pytest.approx(7.0, abs=0.05)
    assert found.sigma(0.0).max() < 0.15  # 0.05 of seven medians of a hundred samples, and what few blocks add


def test_slow_streams_have_longer_blocks_and_less_than_two_seconds_tell_nothing() -> None:
    t = np.arange(0.0, 60.0, 0.5)
    slow = blocks(t, np.ones((len(t), 3)), [(0.0, 10.0)])
    assert slow is not None
    assert len(slow.x) == 4
    assert blocks(np.arange(0.0, 60.0, 0.01), np.ones((6000, 3)), [(0.0, 1.5)]) is None


@pytest.mark.parametrize("n", [0, 1, 3])
def test_streams_without_samples_or_numbers_tell_nothing(n: int) -> None:
    t = np.arange(float(n))
    assert of_stream(stream(t, np.ones((n, 3))), [(0.0, 100.0)]) is None
    assert of_stream(stream(np.arange(0.0, 50.0, 0.1), np.full((500, 3), np.nan)), [(0.0, 50.0)]) is None
    assert of_stream(stream(np.arange(0.0, 50.0, 0.1), np.ones((500, 3))), []) is None


def test_times_that_run_backwards_and_missing_numbers_do_no_harm() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    x = np.full((len(t), 3), 2.5)
    x[::7] = np.nan
    t[1000:1100] = t[1000:1100][::-1]
    found = of_stream(stream(t, x), [(0.0, 60.0)])
    assert found is not None
    assert found.middle == pytest.approx([2.5, 2.5, 2.5])


def test_wrecks_and_what_follows_an_impact_are_no_rest_and_no_flight() -> None:
    phases = [Segment("rest.long", 0.0, 20.0), Segment("airborne", 20.0, 60.0), Segment("rest.long", 70.0, 100.0)]
    whole = Segments(phases)
    crashed = Segments([*phases, Segment("impact", 50.0, 51.0), Segment("wreck", 51.0, 100.0)])
    assert still(whole) == ([(0.0, 20.0), (70.0, 100.0)], "at rest")
    assert still(crashed)[0] == [(0.0, 20.0)]
    assert in_air(whole) == [(21.0, 59.0)]
    assert in_air(crashed) == [(21.0, 50.0)]
    assert in_air(Segments([*phases, Segment("impact", 40.0, 40.5)])) == [(21.0, 40.0)]  # and flies on, bent
    assert intact(crashed, []) == []


def test_idling_motors_stand_in_for_a_rest() -> None:
    assert still(Segments([Segment("idle", 3.0, 9.0)])) == ([(3.0, 9.0)], "on the ground with motors on")
    assert still(Segments()) == ([], "")
