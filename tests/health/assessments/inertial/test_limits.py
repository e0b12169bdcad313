"""Limits of the questions about inertial units from both sides, by statistics of given size; lines by numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.flight.model import Stream
from attlog.health.assessments.inertial import gyro_bias, imu_instances, temperature
from attlog.health.assessments.inertial.blocks import Blocks, blocks, good
from attlog.health.assessments.inertial.imu_instances import AIR, Difference
from attlog.health.assessments.inertial.temperature import ACC, GYRO, Slope
from attlog.health.model import Check
from tests.health.assessments.inertial.cases import case, log_of, told, unit

NONE = (0.0, 0.0, 0.0)


def told_of(question: str, size: float, sigma: float, span: float):
    """The answer to a slope of so much, deg/s or m/s^2 per kelvin, with one sigma."""
    factor = np.radians(1.0) if question == GYRO else 1.0
    each = np.array([0.1 * size, size, -0.2 * size]) if question == GYRO else np.array([size])
    line = Slope(factor * each, factor * np.full(len(each), sigma), 20.0, 20.0 + span, 100, 50.0)
    log = log_of(unit(0, 10.0, NONE, NONE))
    return temperature._assessed(case(log), log.imus[0], question, line)


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
    question: str, size: float, sigma: float, span: float, verdict: str
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
    assert (temperature.slope(stream, warm, [(0.0, 300.0)]) is not None) is known


def test_a_slope_is_the_line_through_medians_of_bins_of_a_kelvin() -> None:
    stream, warm = rising(12.0)
    found = temperature.slope(stream, warm, [(0.0, 300.0)])
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


def apart(size: float, sigma: float, phase: str) -> Difference:
    """A difference along y of a size with one sigma."""
    made = Blocks(np.zeros(4), np.zeros((4, 3)), 100, 50.0, np.zeros(3))
    return Difference(np.array([0.0, size, 0.0]), np.array([9.0, sigma, 9.0]), made, phase)


@pytest.mark.parametrize(
    ("kind", "every", "verdict"),
    [
        ("acc", [apart(0.49, 0.01, AIR)], "ok"),
        ("acc", [apart(0.51, 0.01, AIR)], "warning"),
        ("acc", [apart(0.76, 0.01, AIR)], "warning"),
        ("acc", [apart(0.78, 0.01, AIR)], "fault"),
        ("acc", [apart(0.7, 0.18, AIR)], "ok"),
        ("acc", [apart(0.7, 0.17, AIR)], "warning"),
        ("gyro", [apart(0.99, 0.01, AIR)], "ok"),
        ("gyro", [apart(1.01, 0.01, AIR)], "warning"),
        ("gyro", [apart(5.03, 0.01, AIR)], "fault"),
        ("gyro", [apart(5.01, 0.01, AIR)], "warning"),
        ("acc", [apart(0.9, 0.01, AIR), apart(0.47, 0.01, "at rest")], "warning"),
        ("acc", [apart(0.9, 0.01, AIR), apart(0.49, 0.01, "at rest")], "fault"),
        ("acc", [apart(0.4, 0.01, AIR), apart(0.9, 0.01, "at rest")], "fault"),
    ],
)
def test_two_units_differ_beyond_their_limits_and_four_sigmas(
    monkeypatch: pytest.MonkeyPatch, kind: imu_instances.Kind, every: list[Difference], verdict: str
) -> None:
    monkeypatch.setattr(imu_instances, "_differences", lambda *given: every)
    monkeypatch.setattr(imu_instances, "_which", lambda *given: (None, "Nobody knows."))
    log = log_of(unit(0, 10.0, NONE, NONE), unit(1, 10.0, NONE, NONE))
    found = imu_instances._assessed(case(log), kind, *log.imus)
    assert found is not None
    assert found.verdict == verdict
    worst = max(every, key=lambda one: one.size)
    assert found.value == worst.size
    half = 1.96 * worst.unsure
    assert found.ci95 == pytest.approx((worst.size - half, worst.size + half), abs=1e-3)
    assert ("vibration parts them" in found.text) is (len(every) > 1 and verdict == "warning")


def test_the_size_of_a_difference_is_as_unsure_as_it_is_along_it() -> None:
    one = replace(apart(0.0, 0.0, AIR), middle=np.array([3.0, 0.0, 4.0]), sigma=np.array([0.5, 7.0, 0.25]))
    assert one.size == 5.0
    assert one.unsure == pytest.approx(np.hypot(3.0 * 0.5, 4.0 * 0.25) / 5.0)
    assert replace(one, middle=np.zeros(3)).unsure == 7.0


@pytest.mark.parametrize(
    ("sizes", "wrong"),
    [([0.3, 0.149], 0), ([0.3, 0.151], None), ([0.05, 0.16], 1), ([0.05, 0.14], None), ([0.4], None), ([0.2, 0.4], 1)],
)
def test_of_two_errors_the_larger_one_is_twice_the_other_and_one_that_counts(
    sizes: list[float], wrong: int | None
) -> None:
    assert imu_instances._larger(sizes, 0.15) == wrong


@pytest.mark.parametrize(
    ("check", "moved", "reads", "verdict"),
    [
        (None, 0.0, 0.99, "ok"),
        (None, 0.0, 1.01, "warning"),
        (None, 3.1, 0.1, "fault"),
        (None, 1.1, -0.1, "warning"),
        ("ok", 0.0, 1.5, "ok"),
        ("ok", 1.1, 0.0, "warning"),
        ("fault", 1.1, 0.0, "fault"),
        ("warning", 3.1, 0.0, "fault"),
        ("unknown", 0.0, 1.5, "warning"),
    ],
)
def test_a_bias_has_the_verdict_of_its_check_unless_it_moved_further(
    check: str | None, moved: float, reads: float, verdict: str
) -> None:
    log = log_of(unit(0, 10.0, NONE, NONE))
    asked = case(log, checks=[] if check is None else [Check("gyro bias", check, "It reads.", 0.1, "deg/s")])
    assert gyro_bias._verdict(asked, log.imus[0], np.array([0.2, reads, 0.0]), moved) == verdict


def test_a_bias_that_changes_in_flight_is_the_largest_change_beyond_four_sigmas() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    air = gyro_bias.gyro_bias(case(log, told(NONE, gyro=NONE)))
    assert air is not None
    rest = Blocks(np.arange(4.0), np.zeros((4, 3)), 100, 50.0, np.zeros(3))
    flown = replace(air, mean=np.array([0.5, -0.8, 1.9]), sigma=np.array([0.1, 0.1, 0.5]))
    assert gyro_bias._moved(rest, flown) == 0.8
    assert gyro_bias._moved(replace(rest, x=np.radians(np.tile([0.0, 0.3, 0.0], (4, 1)))), flown) == pytest.approx(1.1)
    assert gyro_bias._moved(None, flown) == gyro_bias._moved(rest, None) == 0.0


def test_good_samples_lie_up_to_a_second_around_the_spans_and_without_spans_there_are_none() -> None:
    t = np.arange(0.0, 20.0, 0.5)
    stream = Stream(t, np.column_stack([t, -t]), "", "", "made")
    at, x = good(stream, [(5.0, 6.0), (9.0, 10.0)])
    np.testing.assert_array_equal(at, np.arange(4.0, 11.1, 0.5))
    np.testing.assert_array_equal(x[:, 1], -at)
    assert [len(y) for y in good(stream, [])] == [0, 0]
    empty = Stream(t[:0], np.zeros((0, 2)), "", "", "made")
    assert [len(y) for y in good(empty, [(5.0, 6.0)])] == [0, 0]


def test_few_blocks_are_as_sure_as_their_samples_and_more_as_their_scatter() -> None:
    x = np.array([[1.0], [2.0], [4.0], [7.0]])
    made = Blocks(np.arange(4.0), x, 100, 20.0, np.array([0.3]))
    factor = 1.5 * 1.2533
    assert made.sigma(0.0)[0] == pytest.approx(factor * 1.4826 * 1.5 / 2.0)  # deviations from 3: 2, 1, 1, 4
    assert made.sigma(5.0)[0] == pytest.approx(np.hypot(5.0, factor * 1.4826 * 1.5 / 2.0))
    two = replace(made, x=x[:2])
    assert two.sigma(0.0)[0] == pytest.approx(factor * 0.3 / np.sqrt(2.0))
