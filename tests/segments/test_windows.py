"""Windows of the IMU: what numpy says of each; none reaches, and none is joined, across a gap."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.segments import rest
from attlog.segments.rest import FlagSpans, ImuWindows


def test_windows_on_both_sides_of_a_gap_are_not_joined_however_short_it_is() -> None:
    """A gap is told from 50 ms on; less than a tenth of a window stands between the two windows."""
    t = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(2.045, 4.0, 0.01)])
    still = rest.build_windows(t, np.zeros((len(t), 3)), np.tile([0.0, 0.0, -9.8], (len(t), 1)))
    (before, after) = rest.join_windows(still, np.ones(len(still.t0), bool))
    assert (before, after) == (pytest.approx((0.0, 2.0)), pytest.approx((2.045, 4.0), abs=0.02))
    assert 0.0 < after[0] - before[1] < 0.1 * still.seconds


def test_the_statistics_of_each_window_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two windows at a time, other noise and another mean in each axis, and a window that is not full."""
    monkeypatch.setattr(rest, "WINDOWS_PER_PASS", 2)
    rng = np.random.default_rng(3)
    t = 7.0 + np.arange(0.0, 2.7, 0.01)
    gyro = np.radians([5.0, -2.0, 30.0] + rng.normal(size=(len(t), 3)) * [0.5, 2.0, 8.0])
    acc = np.array([1.0, 3.0, -9.0]) + rng.normal(size=(len(t), 3)) * [0.2, 0.9, 0.1]
    found = rest.build_windows(t, gyro, acc)
    np.testing.assert_allclose(found.t0, 7.0 + 0.5 * np.arange(6))
    np.testing.assert_allclose(found.t1, [*(7.5 + 0.5 * np.arange(5)), 9.7])
    np.testing.assert_allclose(found.middle, 0.5 * (found.t0 + found.t1))
    for k in range(6):
        inside = slice(50 * k, min(50 * k + 50, len(t)))
        rate, force = np.degrees(gyro[inside]), np.linalg.norm(acc[inside], axis=1)
        np.testing.assert_allclose(found.rate[k], rate.mean(axis=0))
        assert found.rate_std[k] == pytest.approx(np.sqrt(np.mean(rate.var(axis=0))))
        assert found.rate_rms[k] == pytest.approx(np.sqrt(np.mean(np.sum(rate**2, axis=1))))
        assert (found.force[k], found.force_std[k]) == (pytest.approx(force.mean()), pytest.approx(force.std()))


def test_a_slow_log_has_windows_of_five_samples_and_one_of_two_samples_is_left_out() -> None:
    t = 0.25 * np.arange(17)
    found = rest.build_windows(t, np.zeros((17, 3)), np.zeros((17, 3)))
    assert found.seconds == pytest.approx(1.25)
    np.testing.assert_allclose(found.t0, [0.0, 1.25, 2.5])
    assert len(rest.build_windows(t[:13], np.zeros((13, 3)), np.zeros((13, 3))).t0) == 3


def made(n: int = 40, **more: Any) -> ImuWindows:
    """Half seconds of a vehicle that lies still, and whose gyro has an offset."""
    t0 = 0.5 * np.arange(n)
    fields: dict[str, Any] = {
        "rate": np.tile([0.4, -0.2, 0.1], (n, 1)),
        "rate_std": np.full(n, 0.05),
        "rate_rms": np.full(n, 0.5),
        "force": np.full(n, 9.8),
        "force_std": np.full(n, 0.02),
        "segment": np.zeros(n, np.int64),
        **more,
    }
    return ImuWindows(t0, t0 + 0.5, seconds=0.5, **fields)


def test_windows_are_joined_where_they_follow_each_other_in_one_segment() -> None:
    passed = np.ones(40, bool)
    passed[[5, 20]] = False
    segment = (np.arange(40) >= 10).astype(np.int64)
    assert rest.join_windows(made(segment=segment), passed) == [(0.0, 2.5), (3.0, 5.0), (5.0, 10.0), (10.5, 20.0)]
    assert rest.join_windows(made(), ~np.ones(40, bool)) == []


def flags(spans: list[tuple[float, float]] | None = None, measured: bool = False, known: bool = True) -> FlagSpans:
    return FlagSpans(known, spans or [], "armed", measured)


@pytest.mark.parametrize(
    ("quantity", "still", "moved"), [("rate_std", 0.19, 0.21), ("force_std", 0.14, 0.16), ("force", 1.1, 0.9)]
)
def test_a_window_is_still_by_each_of_its_signs(quantity: str, still: float, moved: float) -> None:
    for value, expected in ((still, True), (moved, False)):
        one = made()
        getattr(one, quantity)[17] = value
        found = rest.still_windows(one, flags())
        assert found[17] == expected
        assert found.sum() == 39 + expected


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mean_rate_that_is_not_that_of_the_windows_around_is_no_rest(axis: int) -> None:
    for off, expected in ((0.29, True), (-0.29, True), (0.31, False), (-0.31, False)):
        one = made()
        one.rate[17, axis] += off
        assert rest.still_windows(one, flags())[17] == expected


def test_motors_that_are_measured_to_stand_still_raise_the_limit_where_they_do() -> None:
    one = made(rate_std=np.where(np.arange(40) < 20, 0.05, 0.5))
    found = rest.still_windows(one, flags([(15.2, 18.0)], measured=True))
    assert np.flatnonzero(~found).tolist() == list(range(30, 37))
    assert rest.still_windows(one, flags([(15.2, 18.0)])).sum() == 20


def test_the_median_around_a_window_is_that_of_quiet_ones_within_thirty_seconds() -> None:
    rng = np.random.default_rng(4)
    one = made(400, rate=rng.normal(size=(400, 3)) * [1.0, 2.0, 3.0])
    quiet = rng.random(400) < 0.7
    found = rest._median_around(one, quiet)
    for k in (0, 3, 120, 121, 200, 398, 399):
        near = quiet & (np.abs(one.middle - one.middle[k]) <= 30.0)
        assert quiet[k] == bool(np.isfinite(found[k]).all())
        if quiet[k]:
            np.testing.assert_allclose(found[k], np.median(one.rate[near], axis=0), atol=1e-12)


def test_rest_lasts_two_seconds_and_is_long_from_ten_on() -> None:
    one, still = made(60), np.ones(60, bool)
    still[[3, 8, 29, 49]] = False  # 1.5, 2, 10, 9.5 and 5 s
    found = rest.find_rests(one, still, flags(), flags(), [], np.zeros(60, bool))
    assert [(s.kind, s.t0, s.t1) for s in found] == [
        ("rest.short", 2.0, 4.0),
        ("rest.long", 4.5, 14.5),
        ("rest.short", 15.0, 24.5),
        ("rest.short", 25.0, 30.0),
    ]
    assert "gyro noise 0.050 deg/s (limit 0.20)" in found[0].why


def test_without_rest_three_degrees_per_second_may_be_the_gyros_own_offset() -> None:
    for rate, found in ((2.9, [(0.0, 10.0)]), (3.1, [])):
        one = made(20, rate=np.tile([0.0, rate, 0.0], (20, 1)))
        idle = rest.find_idles(one, np.zeros(20, bool), flags([(50.0, 60.0)]), flags([(0.0, 25.0)]), [])
        assert [(s.t0, s.t1) for s in idle] == found


# Vibration second by second: its size, and which seconds count.
