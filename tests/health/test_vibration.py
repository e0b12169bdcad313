"""Vibration over hours: the same medians as numpy's, without sorting everything for every second of flight."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Burst, Clipping, OnboardVibration, Stream, VibrationMeasure
from attlog.health import vibration
from attlog.segments.model import Segment, Segments
from tests.health.shaken import BEGIN, END, SECONDS, case, params, shaken


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_medians_of_beginnings_are_those_of_numpy(n: int) -> None:
    x = np.random.default_rng(n).normal(size=n).round(1)
    assert vibration.running_medians(x).tolist() == [np.median(x[: k + 1]) for k in range(n)]


def test_the_onset_is_the_first_second_that_all_medians_agree_on() -> None:
    level = np.where(np.arange(300) < 200, 1.0, 5.0) + 0.1 * np.random.default_rng(0).normal(size=300)

    def grown(k: int) -> bool:
        before, after, rest = np.median(level[:k]), np.median(level[k : k + 10]), np.median(level[k:])
        return bool(min(after, rest) > 3 * before and level[k] > 1.5 * before)

    assert vibration.find_onset(level) == next(k for k in range(20, 291) if grown(k))
    assert vibration.find_onset(level[:200]) is None
    assert vibration.find_onset(level[:20]) is None


@pytest.mark.parametrize("a", [0.4, -0.3])
def test_a_height_that_rises_faster_and_faster_shows_an_acceleration_upwards(a: float) -> None:
    t = np.arange(0.0, 20.0, 0.1)
    height = Stream(t, (2.0 * t + 0.5 * a * t**2)[:, None], "m", "", "BARO")
    assert vibration._mean_acceleration(height, (4.0, 14.0)) == pytest.approx(a, rel=1e-6)


# The firmwares' own levels: percentiles over flight alone, per unit, with onset and clipping.

T = np.arange(0.05, SECONDS, 0.1)


def told(value: np.ndarray, unit: int = 0, measure: VibrationMeasure = "rest") -> OnboardVibration:
    return OnboardVibration(unit, measure, f"VIBE:{unit}", T, np.broadcast_to(value, T.shape).astype(float))


def test_percentiles_are_those_of_flight_whatever_ground_and_touch_down_do() -> None:
    flying = (T >= BEGIN + 1.0) & (T < END - 2.0)
    second = np.floor(T)
    log = shaken(50.0, 60.0, levels=[told(np.where(flying, 0.1 * second, 99.0))])
    (found,) = vibration.vibration_checks(case(log))
    expected = 0.1 * np.arange(11, 68)
    assert found.n == len(expected)
    assert found.text == (
        f"IMU 0 vibrates by {np.median(expected):.1f} m/s^2 (median). Below {np.quantile(expected, 0.8):.1f} "
        f"for 80 % of the time, {expected.max():.1f} in the worst second."
    )


@pytest.mark.parametrize(
    ("size", "measure", "verdict"),
    [(20.0, "rest", "ok"), (40.0, "rest", "warning"), (70.0, "rest", "fault"), (5.0, "difference", "ok"),
     (12.0, "difference", "warning")],
)  # fmt: skip
def test_each_measure_has_its_own_limits(size: float, measure: VibrationMeasure, verdict: str) -> None:
    log = shaken(50.0, 60.0, levels=[told(np.array(size), measure=measure)])
    (found,) = vibration.vibration_checks(case(log))
    assert found.verdict == verdict
    assert found.settings == []


def test_vibration_that_grows_in_flight_is_a_warning_with_its_time() -> None:
    log = shaken(50.0, 60.0, levels=[told(np.where(T < 40.0, 2.0, 9.0))], throttle=None)
    (found,) = vibration.vibration_checks(case(log))
    assert found.verdict == "warning"
    assert found.t == pytest.approx(40.0, abs=1.0)


def test_a_short_flight_is_unknown_once_for_all_units() -> None:
    log = shaken(50.0, 60.0, levels=[told(np.array(20.0)), told(np.array(40.0), 1)])
    short = case(log)
    assert short.segments is not None
    short.segments.segments = [s for s in short.segments.segments if s.kind != "airborne"]
    (found,) = vibration.vibration_checks(short)
    assert found.verdict == "unknown"
    assert "0 s" in found.text


def test_the_level_of_bursts_is_the_rms_of_a_tone_above_5_hz() -> None:
    t = np.arange(1024) / 2000.0
    x = np.zeros((1024, 3), np.float32)
    x[:, 1] = 4.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 80.0 * t) - 9.81
    one = vibration.burst_levels([Burst("accelerometer", 0, 1.0, 2000.0, x, False, "ISBD:0")])
    assert one.level == pytest.approx([4.0], rel=0.01)
    slow = np.zeros((2000, 3), np.float32)
    slow[:, 0] = 4.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 1.0 * np.arange(2000) / 2000.0)
    passed = 1.0 / np.hypot(1.0, 5.0)  # of a first-order high-pass of 5 Hz at 1 Hz
    assert vibration.burst_levels([Burst("accelerometer", 0, 1.0, 2000.0, slow, False, "")]).level == pytest.approx(
        [4.0 * passed], rel=0.02
    )


def test_the_level_of_differences_is_their_mean_length() -> None:
    log = shaken(200.0, 60.0, firmware="PX4")
    rng = np.random.default_rng(3)
    imu = log.imus[0]
    imu.acc.x[:] = 2.0 * rng.standard_normal(imu.acc.x.shape)
    one = vibration.sample_levels(imu)
    # the length of a difference of two normal vectors: sqrt(2) sigma times the mean of chi with 3 degrees of freedom
    assert np.mean(one.level) == pytest.approx(2.0 * np.sqrt(2.0) * np.sqrt(8.0 / np.pi), rel=0.01)
    (found,) = vibration.vibration_checks(case(log))
    assert found.value == pytest.approx(4.51, rel=0.06)


@pytest.mark.parametrize(
    ("count", "seconds", "verdict"), [(3, 1, None), (50, 1, "warning"), (500, 1, "warning"), (500, 5, "fault")]
)
def test_clipping_counts_in_flight_only(count: int, seconds: int, verdict: str | None) -> None:
    new = np.zeros(len(T), np.int64)
    for k in range(seconds):
        new[np.argmin(np.abs(T - 20.5 - k))] = count // seconds
    new[T >= END - 1.0] = 1000
    log = shaken(50.0, 60.0, clippings=[Clipping("accelerometer", 1, "VIBE:1.Clip", T, new, True)])
    found = vibration.clipping_checks(log, vibration.sound_flight(case(log).segments, log))
    assert [a.verdict for a in found] == ([] if verdict is None else [verdict])
    if found:
        assert (found[0].value, found[0].seconds) == (float(count), float(seconds))


def test_clipping_of_a_copter_that_never_left_the_ground_is_no_clipping_in_flight() -> None:
    new = np.where((T > BEGIN) & (T < END), 10, 0)
    log = shaken(50.0, 60.0, clippings=[Clipping("accelerometer", 1, "VIBE:1.Clip", T, new, True)])
    flown, grounded = case(log), case(log)
    assert any(check.question == "clipping" for check in vibration.vibration_checks(flown))
    kept = [s for s in grounded.segments.segments if s.kind != "airborne"]
    grounded.segments.segments = [*kept, Segment("armed", BEGIN, END)]
    assert not any(check.question == "clipping" for check in vibration.vibration_checks(grounded))


def test_the_vertical_force_is_a_question_to_what_flies() -> None:
    log = shaken(50.0, 60.0)
    assert [a.question for a in vibration.vertical_force_check(case(log))] == ["vertical_force"]
    log.vehicle = "rover"
    assert vibration.vertical_force_check(case(log)) == []


def test_nothing_raises_where_everything_is_missing() -> None:
    log = shaken(50.0, 60.0, imus=[], imu=None, throttle=None, lines=params())
    empty = case(log)
    empty.segments = Segments()
    assert [a.verdict for a in vibration.vibration_checks(empty)] == ["unknown"]
    log.vibration.levels = [told(np.array(np.nan))]
    assert [a.verdict for a in vibration.vibration_checks(case(log))] == ["unknown"]


def test_what_a_wreck_shakes_is_no_vibration_of_the_flight_that_it_ended() -> None:
    log = shaken(50.0, 60.0, levels=[told(np.where(T < 40.0, 10.0, 99.0))])
    whole = case(log)
    assert whole.segments is not None
    whole.segments.segments.append(Segment("impact", 40.0, SECONDS))
    (found,) = vibration.vibration_checks(whole)
    assert (found.verdict, found.value) == ("ok", 10.0)
    assert vibration.sound_flight(whole.segments, log) == [(BEGIN + 1.0, 40.0)]


def test_the_level_of_a_second_stands_at_its_end() -> None:
    log = shaken(200.0, 60.0, firmware="PX4")
    imu = log.imus[0]
    imu.acc.x[:] = 0.0
    begin = float(imu.acc.t[0])
    struck = (imu.acc.t > begin + 20.1) & (imu.acc.t < begin + 20.9)
    imu.acc.x[struck, 1] = 3.0 * (-1.0) ** np.arange(np.count_nonzero(struck))
    one = vibration.sample_levels(imu)
    assert one.t[np.argmax(one.level)] == pytest.approx(begin + 21.0, abs=0.02)
