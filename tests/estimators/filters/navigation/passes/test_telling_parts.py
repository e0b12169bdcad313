"""Which part of a long run tells the constants of its sensors, and when it is looked at: rates made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.estimators import Measurements
from attlog.estimators.filters.navigation.passes import learning
from attlog.estimators.filters.navigation.settings import NoiseLevels

STEP, SECONDS = 0.1, 300.0
T = STEP * np.arange(round(SECONDS / STEP) + 1)


def run(turning: list[tuple[float, float, float]], gaps: tuple[float, float] = (-1.0, -1.0), every: float = 1.0) -> Any:
    """A run that turns about y at rates between times; fixes ``every`` s but in ``gaps``; rest before 20 s."""
    gyr = np.zeros((len(T), 3))
    for begin, end, rate in turning:
        gyr[(begin <= T) & (end > T), 1] = rate
    fixes = np.arange(0.0, SECONDS, every)
    fixes = fixes[(fixes < gaps[0]) | (fixes > gaps[1])]
    rest = (T < 20.0).astype(np.int8)
    dt = np.diff(T, prepend=0.0)
    own = SimpleNamespace(
        t=T, sensed_at=T, gyr=gyr, dt=dt, rest=rest, velocity=Measurements(fixes, np.zeros((len(fixes), 3)))
    )
    own.part = lambda a, b: (round(a * STEP, 6), round(b * STEP, 6))
    return own


def test_the_part_that_turns_most_tells() -> None:
    """Looked for every 15 s: a minute that holds the turn from 160 to 200 s."""
    begin, end = learning.telling(run([(40.0, 90.0, 0.3), (160.0, 200.0, 0.6)]), 60.0)
    assert end - begin == pytest.approx(60.0)
    assert begin == 150.0


def test_a_blow_counts_as_one_rad_per_second_rest_and_gaps_count_nothing() -> None:
    slow = (200.0, 240.0, 0.8)
    assert learning.telling(run([(60.0, 62.0, 30.0), slow]), 60.0)[0] in (180.0, 195.0)
    assert learning.telling(run([(0.0, 18.0, 0.9), (230.0, 240.0, 0.9)]), 60.0)[0] >= 180.0
    assert learning.telling(run([(100.0, 140.0, 0.9), slow], gaps=(95.0, 145.0)), 60.0)[0] >= 180.0
    assert learning.telling(run([(100.0, 120.0, 1.6), slow]), 60.0)[0] >= 180.0
    seldom = run([slow], every=2.5)
    assert learning.telling(seldom, 60.0)[0] == 0.0


def test_a_run_without_fixes_or_not_longer_tells_as_a_whole() -> None:
    short = run([(100.0, 140.0, 0.5)])
    assert learning.telling(short, SECONDS) is short
    assert learning.telling(short, SECONDS - 0.2) is not short
    short.velocity = None
    assert learning.telling(short, 60.0) is short


def test_looks_end_at_400_seconds_of_motion_and_begin_with_ten_of_fixes() -> None:
    n = 6001
    t = 0.1 * np.arange(n)
    own: Any = SimpleNamespace(t=t, sensed_at=t, dt=np.full(n, 0.1), rest=np.zeros(n, np.int8))
    own.velocity = Measurements(np.array([6.5, 7.0]), np.zeros((2, 3)))
    looks = [round(a * 0.1, 1) for a, _ in learning.stages(own)]
    assert looks[:2] == [0.0, pytest.approx(25.6, abs=0.2)]
    assert looks[-1] == pytest.approx(10.0 * 1.6**7, abs=0.2)
    own.velocity = Measurements(np.array([5.5, 7.0]), np.zeros((2, 3)))
    assert learning.stages(own)[0][1] * 0.1 == pytest.approx(15.9, abs=0.2)


def test_delays_that_were_found_are_held_and_nothing_else() -> None:
    found = learning.held(NoiseLevels(gnss_delay=0.2))
    assert (found.prior.gnss_delay, found.prior.mag_delay) == (0.010, 0.005)
    assert found.gnss_delay == 0.2
    assert found.prior.hard == NoiseLevels().prior.hard


def test_the_noise_learnt_counts_by_forty_seconds_of_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = NoiseLevels(gyro=1e-4, acc=1e-2)
    following = NoiseLevels(gyro=1e-2, acc=1.0)
    begin, found = SimpleNamespace(x=np.arange(39.0)), SimpleNamespace(first=np.ones(39))
    asked: list[Any] = []

    def solved(inputs: Any, levels: Any, gate: float, **given: Any) -> Any:
        asked.append(given)
        return SimpleNamespace(next=following, begin=begin, found=found)

    monkeypatch.setattr(learning, "solved", solved)
    inputs: Any = SimpleNamespace(
        velocity=None, sensed_at=T, dt=np.full(100, 0.5), rest=(np.arange(100) < 60).astype(int)
    )
    constants = learning.learnt(inputs, begun, 2.5)
    share = 20.0 / 60.0
    assert constants.levels.gyro == pytest.approx(1e-4 * 100.0**share)
    assert constants.levels.acc == pytest.approx(1e-2 * 100.0**share)
    assert constants.state == pytest.approx(np.arange(1.0, 40.0))
    told = learning.told(inputs, begun, 2.5)
    assert told.levels.gyro == 1e-2
    assert told.state == pytest.approx(np.arange(1.0, 40.0))
    assert asked == [{"passes": 3, "spread": False}, {"spread": False}]
