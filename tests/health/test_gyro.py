"""Rates by gyro and by attitude side by side, and a bias that steps, from made-up turns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Array, Firmware, FlightLog, Imu, Stream
from attlog.health import gyro as turns
from attlog.health.check import HealthCase
from attlog.health.gyro import gyro_bias_checks
from attlog.reference.model import GyroJump, Reference
from attlog.segments import Segment as segments_Segment
from attlog.segments import Segments as segments_Segments
from attlog.segments.model import Segment, Segments
from tests.health.imu_cases import case, log_of
from tests.health.imu_cases import told as told_by_smoother
from tests.health.imu_cases import unit as imu_cases_unit
from tests.reference.flights import grouped

RATE_DPS = np.array([4.0, -9.0, 25.0])
T = np.arange(0.0, 30.0, 0.01)


def unit(t: Array = T, factor: float = 1.0) -> Imu:
    """A gyro that reads ``factor`` times a steady turn."""
    gyro = Stream(t, np.tile(np.radians(factor * RATE_DPS), (len(t), 1)), "rad/s", "body FRD", "GYR")
    return Imu(0, gyro, Stream(t, np.zeros((len(t), 3)), "m/s^2", "body FRD", "ACC"))


def reference(t: Array = T[::2], kind: str = "truth", **more: Any) -> Reference:
    q = rotation.from_rotvec(np.radians(RATE_DPS) * t[:, None])
    zeros = np.zeros(len(t), np.int64)
    made: dict[str, Any] = {"rate": 50.0, "segment": zeros, "gap_segment": zeros, **grouped(**more)}
    return Reference(kind, "made-up", t, q, **made)  # type: ignore[arg-type]


def test_a_steady_turn_is_the_same_by_attitude_and_by_gyro_and_each_axis_keeps_its_place() -> None:
    begin, by_gyro, by_attitude = turns.interval_rates(unit(factor=1.1), reference())
    assert len(begin) == 99
    np.testing.assert_allclose(begin, 0.3 * np.arange(99), atol=1e-9)
    np.testing.assert_allclose(np.degrees(by_attitude), np.tile(RATE_DPS, (99, 1)), rtol=1e-9)
    np.testing.assert_allclose(np.degrees(by_gyro), np.tile(1.1 * RATE_DPS, (99, 1)), rtol=1e-9)


def test_intervals_begin_when_scoring_begins() -> None:
    begin, _, _ = turns.interval_rates(unit(), reference(scoring_start=12.0))
    assert begin[0] == pytest.approx(12.0)
    assert len(begin) == 59


def test_no_interval_spans_a_reset_of_the_reference_or_a_gap_of_the_gyro() -> None:
    t = T[::2]
    begin, _, _ = turns.interval_rates(unit(), reference(segment=(t > 10.0).astype(np.int64)))
    assert len(begin) == 98
    assert not np.any(np.abs(begin - 9.9) < 0.01)
    holed = T[(T < 20.05) | (T > 24.95)]
    begin, _, _ = turns.interval_rates(unit(holed), reference())
    assert not np.any((begin > 19.76) & (begin < 24.94))
    assert np.any(begin > 24.94)


@pytest.mark.parametrize(("axis", "size", "at"), [(0, 0.9, 4), (1, -2.0, 6), (2, 0.7, 9)])
def test_the_clearest_step_has_its_axis_sign_size_and_first_block(axis: int, size: float, at: int) -> None:
    """Blocks that swing about by 0.1, 0.2 and 0.3 deg/s: a step of another axis is less clear than it is large."""
    bias = np.array([0.1, 0.2, 0.3]) * np.tile([[0.5], [-0.5]], (6, 1))
    bias[at:, axis] += size
    found, sigma, where, first = turns.largest_step(bias)
    assert (where, first) == (axis, at)
    assert found == pytest.approx(size, abs=0.15 * (axis + 1))
    scatter = 1.4826 * 0.1 * (axis + 1) / np.sqrt(2.0)
    assert sigma == pytest.approx(np.hypot(1.25 * scatter * np.sqrt(1.0 / at + 1.0 / (12 - at)), 0.03))


def test_a_step_that_the_smoother_knows_is_told_with_its_largest_axis() -> None:
    """An interval of 1.96 times the smoother's sigma and 0.03 deg/s."""
    jump = GyroJump(61.26, (0.3, -1.5, 0.6), (0.5, 0.1, 0.7))
    check = turns._smoother_step_check(unit(), (jump,))
    half = 1.96 * np.hypot(0.1, 0.03)
    assert (check.verdict, check.value, check.t) == ("warning", -1.5, 61.3)
    assert check.ci95 == pytest.approx((-1.5 - half, -1.5 + half), abs=0.006)
    assert " about y " in check.text
    assert turns._smoother_step_check(unit(), ()).verdict == "ok"


def made_log(imu: Imu) -> tuple[FlightLog, Segments]:
    log = FlightLog(Path("made.bin"), "made", 0, 0, Firmware("made"), "quadrotor", imus=[imu], imu=0)
    return log, Segments([Segment("continuous", 0.0, 30.0), Segment("airborne", 2.0, 28.0)])


def test_a_reference_that_follows_this_gyro_judges_nothing() -> None:
    log, spans = made_log(unit())
    for bad in (None, reference(kind="smoother"), reference(gyro_fault="it is made of it")):
        assert [c.verdict for c in turns.step_checks(HealthCase(log, spans, bad))] == ["unknown"]
    assert turns.step_checks(HealthCase(log, Segments([Segment("continuous", 0.0, 30.0)]), reference())) == []


def test_twenty_seconds_in_flight_and_sixty_intervals_are_needed() -> None:
    log, spans = made_log(unit())
    for end, few in ((23.0, False), (21.0, True)):
        (check,) = turns.step_checks(HealthCase(log, spans, reference(end=end)))
        assert check.text.endswith("60 and 20 s are needed.") is few


# The bias of every gyro at rest and in flight; its step by the check, and no verdict against the check's.

NO_ACC_BIAS = (0.0, 0.0, 0.0)


def told(dps: tuple[float, float, float]) -> dict[str, float | str]:
    return told_by_smoother(NO_ACC_BIAS, gyro=dps)


@pytest.mark.parametrize(("dps", "verdict"), [(0.4, "ok"), (-1.6, "warning"), (24.0, "fault")])
def test_the_reading_at_rest_of_every_unit(dps: float, verdict: str) -> None:
    first, second = gyro_bias_checks(
        case(
            log_of(
                imu_cases_unit(0, 100.0, NO_ACC_BIAS, NO_ACC_BIAS),
                imu_cases_unit(1, 50.0, NO_ACC_BIAS, (0.1, dps, 0.0)),
            )
        )
    )
    assert (first.verdict, second.verdict) == ("ok", verdict)
    assert second.vector == pytest.approx([0.1, dps, 0.0], abs=0.03)
    assert second.ci95 is not None
    assert second.ci95[0] < dps < second.ci95[1]
    assert not second.settings


def test_a_bias_that_moves_from_rest_to_flight_counts_and_a_small_one_does_not() -> None:
    log = log_of(imu_cases_unit(0, 100.0, NO_ACC_BIAS, (0.3, 0.0, 0.0)))
    assert gyro_bias_checks(case(log, told((0.4, 0.0, 0.0))))[0].verdict == "ok"
    (moved,) = gyro_bias_checks(case(log, told((2.0, 0.0, 0.0))))
    assert moved.verdict == "warning"
    assert "+2.00" in moved.evidence[0]


def test_without_rest_the_smoother_tells_and_a_second_unit_by_its_difference() -> None:
    air = segments_Segments([segments_Segment("airborne", 30.0, 90.0)])
    log = log_of(
        imu_cases_unit(0, 100.0, NO_ACC_BIAS, (0.3, 0.0, 0.0)), imu_cases_unit(1, 50.0, NO_ACC_BIAS, (0.3, 0.0, 1.5))
    )
    first, second = gyro_bias_checks(case(log, told((0.3, 0.0, 0.0)), segments=air))
    assert (first.verdict, second.verdict) == ("ok", "warning")
    assert second.vector == pytest.approx([0.3, 0.0, 1.5], abs=0.1)
    assert [a.verdict for a in gyro_bias_checks(case(log, segments=air))] == ["unknown"]
