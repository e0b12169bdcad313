"""What a smoother says of biases: which run counts, whether two agree in each axis, and the total error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Stream
from attlog.health import gyro, imu
from attlog.health import imu_checks as temperature
from attlog.health.check import Limits
from attlog.health.imu import blocks, stream_blocks
from attlog.health.imu_checks import ACC, GYRO, TemperatureSlope, difference, imu_differences
from attlog.reference.model import Reference
from attlog.segments import Segment, Segments
from tests.health.imu_cases import AIR_S, REST_S, case, log_of, phases, told, unit
from tests.segments.flights import imu_log

NO_SMOOTHER_BIAS = (0.0, 0.0, 0.0)
LOG = log_of(unit(0, 100.0, NO_SMOOTHER_BIAS, NO_SMOOTHER_BIAS))


def smoother(acc: tuple[float, float, float], sigma: float = 0.01, kind: str = "smoother") -> Reference:
    t = np.arange(3.0)
    zeros = np.zeros(3, np.int64)
    found = Reference(kind, kind, t, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), zeros, zeros)  # type: ignore[arg-type]
    found.quality = told(acc, sigma)
    return found


def total(sigma: float) -> np.ndarray:
    return np.asarray(np.hypot(1.5 * sigma, [0.03, 0.03, 0.05]))


def test_without_a_compass_its_own_sigma_is_believed_up_to_three_hundredths() -> None:
    for sigma, known in ((0.029, True), (0.031, False)):
        found = imu.smoothed_acc_bias(case(LOG, told((0.3, -0.2, 0.5), sigma)))
        assert found is not None
        assert found.known == (known,) * 3
        assert found.sure is known
        np.testing.assert_allclose(found.mean, [0.3, -0.2, 0.5])
        np.testing.assert_allclose(found.sigma, total(sigma))
    assert (found.n, found.seconds) == (12000, pytest.approx(119.99))
    assert imu.smoothed_acc_bias(case(LOG)) is None


@pytest.mark.parametrize("axis", [0, 1])
def test_runs_with_and_without_a_compass_must_agree_in_either_horizontal_axis(axis: int) -> None:
    doubt = float(np.hypot(total(0.02)[0], total(0.04)[0]))
    for factor, agree in ((1.95, True), (-1.95, True), (2.05, False), (-2.05, False)):
        both = np.array([0.1, 0.2, 0.3])
        both[axis] += factor * doubt
        reference = smoother((both[0], both[1], both[2]), 0.04)
        found = imu.smoothed_acc_bias(case(LOG, told((0.1, 0.2, 0.3), 0.02), reference=reference))
        assert found is not None
        assert found.known == (agree, agree, True)
        np.testing.assert_allclose(found.mean, both)
        np.testing.assert_allclose(found.sigma, total(0.04))
        assert found.by.endswith("and compass")


def test_along_z_the_runs_need_not_agree_and_with_a_compass_more_is_believed() -> None:
    found = imu.smoothed_acc_bias(case(LOG, told((0.1, 0.2, 0.3), 0.02), reference=smoother((0.1, 0.2, 3.0), 0.044)))
    assert found is not None
    assert found.sure
    found = imu.smoothed_acc_bias(case(LOG, told((0.1, 0.2, 0.3), 0.02), reference=smoother((0.1, 0.2, 0.3), 0.046)))
    assert found is not None
    assert found.known == (False, False, False)


def test_only_a_smoother_whose_compass_agrees_with_motion_takes_the_place_of_the_run_without_one() -> None:
    other = smoother((0.5, 0.5, 0.5))
    other.quality = {**other.quality, "heading_from": "mag"}
    for reference in (other, smoother((0.5, 0.5, 0.5), kind="truth")):
        found = imu.smoothed_acc_bias(case(LOG, told((0.1, 0.2, 0.3)), reference=reference))
        assert found is not None
        np.testing.assert_allclose(found.mean, [0.1, 0.2, 0.3])


def test_the_gyros_bias_has_its_own_limits_for_each_axis() -> None:
    quality = told(NO_SMOOTHER_BIAS, gyro=(1.0, -2.0, 0.5))
    quality["gyro_bias_y_sigma_dps"], quality["gyro_bias_z_sigma_dps"] = 0.29, 0.31
    found = imu.smoothed_gyro_bias(case(LOG, quality))
    assert found is not None
    assert found.known == (True, True, False)
    np.testing.assert_allclose(found.mean, [1.0, -2.0, 0.5])
    np.testing.assert_allclose(found.sigma, np.hypot(1.5 * np.array([0.02, 0.29, 0.31]), 0.05))


# Where a signal stands, and how surely: against the scatter of many repetitions, on sound and on damaged streams.


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


@pytest.mark.parametrize("n", [0, 1, 3])
def test_streams_without_samples_or_numbers_tell_nothing(n: int) -> None:
    t = np.arange(float(n))
    assert stream_blocks(stream(t, np.ones((n, 3))), [(0.0, 100.0)]) is None
    assert stream_blocks(stream(np.arange(0.0, 50.0, 0.1), np.full((500, 3), np.nan)), [(0.0, 50.0)]) is None
    assert stream_blocks(stream(np.arange(0.0, 50.0, 0.1), np.ones((500, 3))), []) is None


def test_times_that_run_backwards_and_missing_numbers_do_no_harm() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    x = np.full((len(t), 3), 2.5)
    x[::7] = np.nan
    t[1000:1100] = t[1000:1100][::-1]
    found = stream_blocks(stream(t, x), [(0.0, 60.0)])
    assert found is not None
    assert found.middle == pytest.approx([2.5, 2.5, 2.5])


# Limits of the questions about inertial units from both sides, by statistics of given size; lines by numpy.

NO_LIMIT_BIAS = (0.0, 0.0, 0.0)


def told_of(question: Limits, size: float, sigma: float, span: float):
    """The answer to a slope of so much, deg/s or m/s^2 per kelvin, with one sigma."""
    factor = np.radians(1.0) if question == GYRO else 1.0
    each = np.array([0.1 * size, size, -0.2 * size]) if question == GYRO else np.array([size])
    line = TemperatureSlope(factor * each, factor * np.full(len(each), sigma), 20.0, 20.0 + span, 100, 50.0)
    log = log_of(unit(0, 10.0, NO_LIMIT_BIAS, NO_LIMIT_BIAS))
    return temperature._slope_check(case(log), log.imus[0], question, line)


@pytest.mark.parametrize(
    ("question", "size", "sigma", "span", "verdict"),
    [
        (GYRO, 0.099, 0.001, 10.0, "ok"),
        (GYRO, -0.101, 0.001, 10.0, "warning"),
        (GYRO, 0.299, 0.001, 10.0, "warning"),
        (GYRO, 0.301, 0.001, 10.0, "fault"),
        (GYRO, 0.301, 0.0754, 10.0, "ok"),
        (GYRO, 0.301, 0.075, 10.0, "fault"),
        (ACC, 0.0149, 0.001, 20.0, "ok"),
        (ACC, 0.0151, 0.001, 20.0, "warning"),
        (ACC, -0.0499, 0.001, 20.0, "warning"),
        (ACC, -0.0501, 0.001, 20.0, "fault"),
    ],
)
def test_a_slope_is_judged_by_its_change_over_the_span_beyond_four_sigmas(
    question: Limits, size: float, sigma: float, span: float, verdict: str
) -> None:
    found = told_of(question, size, sigma, span)
    assert (found.verdict, bool(found.why_no_setting)) == (verdict, verdict != "ok")
    assert found.value == pytest.approx(size, abs=1e-4)
    assert found.ci95 == pytest.approx((size - 1.96 * sigma, size + 1.96 * sigma), abs=1e-4)
    assert f"20 to {20 + span:.0f} degC" in found.text
    assert ("about y" in found.text, len(found.vector)) == ((True, 3) if question == GYRO else (False, 0))


def rising(kelvin: float, slope: float = 0.02, seconds: float = 300.0) -> tuple[Stream, Stream]:
    """A stream that follows a temperature in steps of its own, which warms evenly."""
    t = np.arange(0.0, seconds, 0.1)
    warm = 20.0 + kelvin * t / seconds
    x = slope * (warm - 20.0) + 0.003 * np.sign(np.sin(2.0 * np.pi * t / 40.0))
    return Stream(t, np.column_stack([x, -2.0 * x]), "", "", "made"), Stream(t, warm[:, None], "degC", "", "made")


@pytest.mark.parametrize(("kelvin", "known"), [(5.8, False), (7.5, True)])
def test_a_slope_needs_five_kelvin_between_the_means_of_its_bins(kelvin: float, known: bool) -> None:
    stream, warm = rising(kelvin)
    assert (temperature.fit_temperature(stream, warm, [(0.0, 300.0)]) is not None) is known


def test_a_slope_is_the_line_through_medians_of_bins_of_a_kelvin() -> None:
    stream, warm = rising(12.0)
    found = temperature.fit_temperature(stream, warm, [(0.0, 300.0)])
    made = blocks(stream.t, stream.x, [(0.0, 300.0)])
    assert found is not None
    assert made is not None
    at = 20.0 + 12.0 * made.t / 300.0
    bins = [np.floor(at) == k for k in np.unique(np.floor(at))]
    middles = np.array([at[b].mean() for b in bins])
    for k in range(2):
        y = np.array([np.median(made.x[b, k]) for b in bins])
        (line, _), covariance = np.polyfit(middles, y, 1, cov=True)
        assert found.slope[k] == pytest.approx(line, rel=1e-9)
        assert found.sigma[k] == pytest.approx(1.5 * np.sqrt(covariance[0, 0]), rel=1e-6)
    assert (found.low, found.high) == (pytest.approx(middles[0]), pytest.approx(middles[-1]))
    assert found.span == pytest.approx(middles[-1] - middles[0])


# Differences of units and blocks of a signal: closed forms with another number in every axis.

NO_SIZE_BIAS = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("apart", "verdict"), [(0.45, "ok"), (0.6, "warning"), (0.72, "warning"), (0.9, "fault")], ids=lambda x: str(x)
)
def test_accelerometers_may_differ_by_half_a_metre_per_second_squared(apart: float, verdict: str) -> None:
    log = log_of(
        unit(0, 100.0, NO_SIZE_BIAS, NO_SIZE_BIAS), unit(1, 50.0, (0.0, 0.6 * apart, 0.8 * apart), NO_SIZE_BIAS)
    )
    assert imu_differences(case(log))[0].verdict == verdict


@pytest.mark.parametrize(("apart", "verdict"), [(0.9, "ok"), (1.2, "warning"), (4.8, "warning"), (5.3, "fault")])
def test_gyros_may_differ_by_a_degree_per_second(apart: float, verdict: str) -> None:
    log = log_of(
        unit(0, 100.0, NO_SIZE_BIAS, NO_SIZE_BIAS), unit(1, 50.0, NO_SIZE_BIAS, (0.6 * apart, 0.0, -0.8 * apart))
    )
    assert imu_differences(case(log))[1].verdict == verdict


def test_blocks_of_five_seconds_have_the_median_and_the_robust_deviation_of_their_samples() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 40.0, 0.1)
    x = rng.normal(size=(400, 2)) * [1.0, 4.0] + [5.0, -3.0]
    found = blocks(t, x, [(0.0, 26.0), (30.0, 35.0)])
    assert found is not None
    parts = [slice(50 * k, 50 * k + 50) for k in range(5)] + [slice(300, 350)]
    np.testing.assert_allclose(found.x, [np.median(x[p], axis=0) for p in parts])
    np.testing.assert_allclose(found.t, [0.5 * (t[p][0] + t[p][-1]) for p in parts])
    mad = [1.4826 * np.median(np.abs(x[p] - np.median(x[p], axis=0)), axis=0) for p in parts]
    np.testing.assert_allclose(found.spread, np.median(mad, axis=0))
    assert (found.samples, found.seconds) == (300, pytest.approx(30.0, rel=0.01))


# What the gyro reads while the vehicle stands still.


@pytest.mark.parametrize(
    ("before", "after", "verdict"), [(-0.6, 0.6, "warning"), (-0.4, 0.4, "ok"), (-1.6, 1.6, "fault"), (0.6, 0.6, "ok")]
)
def test_a_bias_that_changes_counts_though_each_reading_is_small(before: float, after: float, verdict: str) -> None:
    """Two rests: ok up to 1 deg/s, fault above 3, for the reading and for its change."""
    t = np.arange(0.0, 60.0, 0.01)
    x = np.zeros((len(t), 3))
    x[:, 1] = np.radians(np.where(t < 30.0, before, after))
    log = imu_log(t, x, np.tile([0.0, 0.0, -9.81], (len(t), 1)))
    rests = Segments([Segment("rest.long", 0.0, 20.0), Segment("rest.long", 40.0, 60.0)])
    assert gyro._rest_bias(log.imus[0], rests).verdict == verdict


# Units against each other: the size with its sign, which one is off, and streams that are the same sensor.


NONE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("rates", [(100.0, 50.0), (100.0, 2.0), (25.0, 100.0)])
def test_the_difference_comes_back_with_its_sign_whichever_unit_is_faster(rates: tuple[float, float]) -> None:
    a, b = unit(0, rates[0], NONE, NONE), unit(1, rates[1], (0.3, -0.2, 0.6), (0.0, 1.4, 0.0))
    for spans in ([(0.0, 28.0)], [(31.0, 89.0)]):
        found = difference(a.acc, b.acc, spans)
        assert found is not None
        assert np.abs(found.middle - [0.3, -0.2, 0.6]).max() < max(1.96 * found.sigma(0.02).max(), 0.05)


def test_gravity_tells_which_accelerometer_is_off_and_rest_which_gyro() -> None:
    one = case(log_of(unit(0, 100.0, (0.0, 0.0, 0.7), NONE), unit(1, 50.0, NONE, (0.0, 1.4, 0.0))))
    force, rate = imu_differences(one)
    assert (force.verdict, force.sensor) == ("warning", "IMU:0")
    assert "IMU:0 is off" in force.text
    assert (rate.verdict, rate.sensor) == ("warning", "IMU:1")
    assert force.vector[2] == pytest.approx(-0.7, abs=0.03)
    assert rate.vector[1] == pytest.approx(1.4, abs=0.05)
    assert force.ci95 is not None
    assert force.ci95[0] < 0.7 < force.ci95[1]


def test_a_horizontal_difference_that_gravity_hardly_shows_the_smoother_attributes() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, (0.6, 0.0, 0.0), NONE))
    assert imu_differences(case(log, told((0.0, 0.0, 0.0))))[0].sensor == "IMU:1"
    undecided = imu_differences(case(log))[0]
    assert "shows which one is off" in undecided.text


def test_units_that_agree_are_ok_and_two_that_are_both_off_are_both_named() -> None:
    sound = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, NONE, NONE))))
    assert [a.verdict for a in sound] == ["ok", "ok"]
    both = imu_differences(case(log_of(unit(0, 100.0, (0.0, 0.0, 1.0), NONE), unit(1, 50.0, (0.0, 0.0, -0.8), NONE))))[
        0
    ]
    assert both.verdict == "fault"
    assert "both are off" in both.text


def test_a_stream_that_repeats_another_one_is_no_second_unit() -> None:
    """PX4's selected unit after a switch: the same numbers twice."""
    a = unit(0, 100.0, NONE, NONE)
    assert difference(a.acc, replace(a.acc, t=a.acc.t[::10], x=a.acc.x[::10]), [(0.0, 28.0)]) is None


def test_units_that_differ_in_flight_only_are_parted_by_vibration_and_slow_ones_are_not_compared_there() -> None:
    fast, slow = (unit(1, rate, NONE, NONE) for rate in (50.0, 2.0))
    for one in (fast, slow):
        one.acc.x[(one.acc.t > REST_S) & (one.acc.t < AIR_S), 2] += 1.3
    shaken = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), fast)))[0]
    assert shaken.verdict == "warning"
    assert "vibration" in shaken.text
    assert shaken.value == pytest.approx(1.3, abs=0.05)
    folded = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), slow)))[0]
    assert (folded.verdict, folded.seconds < 60.0) == ("ok", True)


@pytest.mark.parametrize("odd", [0, 1, 2])
def test_of_three_units_the_one_that_differs_from_two_that_agree_is_off(odd: int) -> None:
    """Horizontally, where neither gravity nor a smoother shows which."""
    units = [unit(k, 50.0, (0.9, 0.0, 0.0) if k == odd else NONE, NONE) for k in range(3)]
    troubles = [c for c in imu_differences(case(log_of(*units))) if c.is_trouble]
    assert [(c.sensor, c.verdict) for c in troubles] == [(f"IMU:{odd}", "fault")]
    assert "others agree" in troubles[0].text


def test_an_accelerometer_that_scatters_more_in_flight_vibrates_and_needs_no_calibration() -> None:
    shaken = unit(1, 50.0, NONE, NONE)
    air = (shaken.acc.t > REST_S) & (shaken.acc.t < AIR_S)
    shaken.acc.x[air] += np.array([2.0, -1.0, 0.5]) + np.random.default_rng(3).normal(0.0, 3.0, (int(air.sum()), 3))
    aloft = Segments([Segment("airborne", REST_S, AIR_S)])
    check = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), shaken), segments=aloft))[0]
    assert (check.sensor, check.verdict, "vibration at IMU:1" in check.text) == ("IMU:1", "warning", True)
    assert "alibrate" not in check.action


def test_one_unit_says_nothing_and_units_without_common_time_that_they_cannot_be_compared() -> None:
    assert imu_differences(case(log_of(unit(0, 100.0, NONE, NONE)))) == []
    late = unit(1, 50.0, NONE, NONE)
    late.acc.t, late.gyro.t = late.acc.t + 1e4, late.gyro.t + 1e4
    assert [a.verdict for a in imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), late), segments=phases()))] == [
        "unknown"
    ]


# Bias against temperature: planted slopes, and what is too little to tell one.


REST = Segments([Segment("rest.long", 0.0, 600.0)])


def warming(dps_per_k: float, m_s2_per_k: float, kelvin: float, seed: int = 1) -> FlightLog:
    """Ten minutes standing still while it warms up, faster at first; noise that lasts for seconds."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 600.0, 0.2)
    warmer = kelvin * (1.0 - np.exp(-t / 200.0)) / (1.0 - np.exp(-3.0))
    slow = 0.02 * rng.normal(size=(61, 3))[(t // 10.0).astype(int)]
    gyro = np.radians(np.outer(warmer, [0.0, dps_per_k, 0.0]) + slow + 0.05 * rng.normal(size=(len(t), 3)))
    acc = np.tile([0.0, 0.0, -9.81], (len(t), 1)) + 0.02 * rng.normal(size=(len(t), 3))
    acc[:, 2] -= m_s2_per_k * warmer
    log = imu_log(t, gyro, acc)
    log.imus[0].temperature = Stream(t, 25.0 + warmer[:, None], "degC", "", "IMU:0")
    return log


def of(log: FlightLog, segments: Segments = REST):
    from attlog.health.check import HealthCase

    one = HealthCase(log, segments)
    return temperature.gyro_temperature(one), temperature.accelerometer_temperature(one)


@pytest.mark.parametrize(("slope", "verdict"), [(0.0, "ok"), (0.03, "ok"), (-0.1, "warning"), (0.3, "fault")])
def test_a_planted_slope_of_the_gyro_lies_inside_its_interval(slope: float, verdict: str) -> None:
    missed = 0
    for seed in range(3):
        (found,), _ = of(warming(slope, 0.0, 20.0, seed))
        assert (found.verdict, found.unit) == (verdict, "deg/s/K")
        assert found.vector_ci95[1] < 0.01
        missed += abs(found.vector[1] - slope) > found.vector_ci95[1]
    assert missed <= 1


@pytest.mark.parametrize(("slope", "verdict"), [(0.0, "ok"), (0.03, "warning")])
def test_a_planted_slope_of_gravity_s_size(slope: float, verdict: str) -> None:
    _, (found,) = of(warming(0.0, slope, 20.0))
    assert found.verdict == verdict
    assert found.ci95 is not None
    assert found.ci95[0] <= slope <= found.ci95[1]
    assert bool(found.action) == (verdict != "ok")


def test_too_little_warming_no_rest_and_no_thermometer_are_unknown() -> None:
    cold, no_thermometer = warming(1.0, 0.0, 3.0), warming(1.0, 0.0, 20.0)
    no_thermometer.imus[0].temperature = None
    for log, segments in ((cold, REST), (no_thermometer, REST), (warming(1.0, 0.0, 20.0), Segments())):
        for found in of(log, segments):
            assert [a.verdict for a in found] == ["unknown"]
            assert found[0].action


def test_a_thermometer_without_numbers_does_no_harm() -> None:
    log = warming(0.1, 0.0, 20.0)
    assert log.imus[0].temperature is not None
    log.imus[0].temperature.x[:] = np.nan
    assert [a.verdict for found in of(log) for a in found] == ["unknown", "unknown"]
