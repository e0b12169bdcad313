"""Vibration over hours: the same medians as numpy's, without sorting everything for every second of flight."""

from __future__ import annotations

import time

import numpy as np
import pytest

from attlog.flight.model import Stream
from attlog.health.sensors import vibration
from tests.segments.flights import imu_log


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_medians_of_beginnings_are_those_of_numpy(n: int) -> None:
    x = np.random.default_rng(n).normal(size=n).round(1)
    assert vibration.medians(x).tolist() == [np.median(x[: k + 1]) for k in range(n)]


def test_the_onset_is_the_first_second_that_all_medians_agree_on() -> None:
    level = np.where(np.arange(300) < 200, 1.0, 5.0) + 0.1 * np.random.default_rng(0).normal(size=300)

    def grown(k: int) -> bool:
        before, after, rest = np.median(level[:k]), np.median(level[k : k + 10]), np.median(level[k:])
        return bool(min(after, rest) > 3 * before and level[k] > 1.5 * before)

    assert vibration.onset(level) == next(k for k in range(20, 291) if grown(k))
    assert vibration.onset(level[:200]) is None
    assert vibration.onset(level[:20]) is None


@pytest.mark.slow
def test_twenty_hours_of_flight_take_no_minutes() -> None:
    level = 1.0 + np.random.default_rng(0).random(72_000)
    begin = time.process_time()
    assert vibration.onset(level) is None
    assert time.process_time() - begin < 5.0


@pytest.mark.parametrize(
    ("shaking", "own", "verdict"),
    [
        (0.5, 10.0, "ok"),
        (6.0, 10.0, "ok"),
        (0.5, 40.0, "warning"),
        (0.5, 70.0, "fault"),
        (60.0, 40.0, "fault"),
        (60.0, 10.0, "fault"),
    ],
)
def test_the_worse_of_what_is_measured_and_what_the_autopilot_says_is_told(
    shaking: float, own: float, verdict: str
) -> None:
    """White noise on each axis; the autopilot's level clears what little its logged samples show, not a fault."""
    t = np.arange(0.0, 60.0, 0.005)
    force = np.random.default_rng(2).standard_normal((len(t), 3)) * shaking + [0.0, 0.0, -9.81]
    log = imu_log(t, np.zeros((len(t), 3)), force)
    told = Stream(np.arange(0.0, 60.0, 0.1), np.full((600, 3), own), "m/s^2", "FRD", "VIBE")
    log.onboard_vibration = told
    assert vibration.level(log, log.imus[0], [(5.0, 55.0)]).verdict == verdict


@pytest.mark.parametrize("a", [0.4, -0.3])
def test_a_height_that_rises_faster_and_faster_shows_an_acceleration_upwards(a: float) -> None:
    t = np.arange(0.0, 20.0, 0.1)
    height = Stream(t, (2.0 * t + 0.5 * a * t**2)[:, None], "m", "", "BARO")
    assert vibration._acceleration(height, (4.0, 14.0)) == pytest.approx(a, rel=1e-6)
