"""Clipping, vibration, switches and lost GNSS as events: limits from both sides on made records."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Clipping, FlightLog, Gnss, Problem, Stream, TimeLine
from attlog.segments.model import Segment, Segments
from attlog.story import estimator, sensors
from tests.story.made import log

T = np.arange(0.0, 60.0, 0.1)
FLOWN = [(10.0, 50.0)]
SPANS = Segments([Segment("continuous", 0, 60), Segment("armed", 5, 55), Segment("airborne", 10, 50)])


def own(peak: Any, rest: float = 5.0) -> Stream:
    """The autopilot's measure of three axes, the second the worst."""
    return Stream(T, np.column_stack([0.0 * T + rest, peak + 0.0 * T, 0.0 * T + rest]), "m/s^2", "FRD", "VIBE")


def flying(monkeypatch: pytest.MonkeyPatch, strong: int, size: float) -> FlightLog:
    """A unit whose windows shake by ``size`` for so many seconds."""
    t = np.arange(10.0, 50.0)
    x = np.full((40, 3), 2.0)
    x[7 : 7 + strong, 2] = size
    monkeypatch.setattr(sensors, "levels", lambda imu, flown: (t, x))
    return log(imus=[SimpleNamespace(acc=SimpleNamespace(source="IMU:0"))], imu=0)


@pytest.mark.parametrize(
    ("strong", "size", "told"), [(5, 15.1, True), (4, 40.0, False), (9, 14.9, False)], ids=lambda x: str(x)
)
def test_five_seconds_above_fifteen_are_strong_vibration(
    monkeypatch: pytest.MonkeyPatch, strong: int, size: float, told: bool
) -> None:
    found = sensors._vibration(flying(monkeypatch, strong, size), FLOWN)
    assert (found is not None) is told
    if found is not None:
        assert (found.t, found.t_end, found.value) == (17.0, 17.0 + strong, round(size, 1))


@pytest.mark.parametrize(("size", "count", "told"), [(61.0, 3, True), (61.0, 2, False), (59.0, 200, False)])
def test_the_autopilots_own_measure_is_strong_above_sixty(
    monkeypatch: pytest.MonkeyPatch, size: float, count: int, told: bool
) -> None:
    monkeypatch.setattr(sensors, "_sound", lambda own, flown: False)
    made = flying(monkeypatch, 0, 0.0)
    made.onboard_vibration = own(np.where((np.arange(600) >= 200) & (np.arange(600) < 200 + count), size, 5.0))
    found = sensors._vibration(made, FLOWN)
    assert (found is not None) is told
    if found is not None:
        assert (found.t, found.value) == (pytest.approx(20.0), size)


def test_an_own_measure_that_is_as_it_should_be_speaks_against_strong_vibration() -> None:
    limits = sensors.LIMITS["rest"]
    assert sensors._sound(own(0.99 * limits.warning), FLOWN)
    assert not sensors._sound(own(1.01 * limits.warning), FLOWN)
    assert sensors._sound(own(np.where((T < 10.0) | (T > 50.0), 200.0, 5.0)), FLOWN)
    assert not sensors._sound(own(5.0), [(10.05, 10.95)])
    assert sensors._sound(own(5.0), [(10.05, 11.05)])
    assert not sensors._sound(None, FLOWN)


def clipped(count: int, at: float = 20.0, source: str = "IMU:0", whole: bool = True) -> Clipping:
    new = np.zeros(len(T), np.int64)
    new[np.argmin(np.abs(T - at))] = count
    return Clipping("accelerometer", 0, source, T, new, whole)


@pytest.mark.parametrize(("count", "severity"), [(3, None), (4, "note"), (10, "note"), (11, "warning")])
def test_up_to_three_clipped_samples_are_chance_and_up_to_ten_no_warning(count: int, severity: str | None) -> None:
    found, _ = sensors._clipping(log(clippings=[clipped(count), clipped(1, 30.0, "IMU:1")]), FLOWN)
    assert (None if found is None else found.severity) == severity
    if found is not None:
        assert (found.t, found.t_end, found.value) == (pytest.approx(20.0), pytest.approx(30.0), float(count))


def test_flags_of_the_selected_unit_tell_the_time_and_counters_the_number() -> None:
    made = log(clippings=[clipped(50, 20.0), clipped(12, 25.0, "flags", False), clipped(99, 5.0, "IMU:2")])
    found, _ = sensors._clipping(made, FLOWN)
    assert found is not None
    assert (found.t, found.value) == (pytest.approx(25.0), 50.0)
    assert found.evidence == ["IMU:0: 50 samples", "flags: 12 samples"]


def receiver(lost: tuple[float, float], hz: float = 5.0) -> Gnss:
    t = np.arange(0.0, 60.0, 1.0 / hz)
    zero = np.zeros(len(t))
    fix = np.where((t > lost[0]) & (t < lost[1]), 2, 3)
    return Gnss(0, t, "GPS:0", zero, zero, zero, np.zeros((len(t), 3)), zero, zero, zero, fix)


@pytest.mark.parametrize(
    ("lost", "hz", "told"),
    [
        ((20.1, 21.9), 5.0, None),
        ((20.1, 22.3), 5.0, 2.4),
        ((20.5, 25.5), 1.0, 6.0),
        ((20.5, 24.5), 1.0, None),
        ((52.0, 58.0), 5.0, None),
    ],
)
def test_gnss_is_lost_after_two_seconds_or_five_intervals_in_flight(
    lost: tuple[float, float], hz: float, told: float | None
) -> None:
    found = estimator._gnss_lost(log(gnss=[receiver(lost, hz)]), SPANS)
    assert [e.value for e in found] == ([] if told is None else [pytest.approx(told, abs=0.11)])
    if told is not None:
        assert found[0].t == pytest.approx(20.0, abs=0.11)
        whole = receiver((70.0, 80.0))
        assert estimator._gnss_lost(log(gnss=[receiver(lost, hz), whole]), SPANS) == []


def test_texts_within_a_second_and_a_half_are_one_event() -> None:
    texts: Any = [(1.0, 0, "a"), (2.5, 0, "b"), (4.1, 0, "c")]
    assert [[x[2] for x in group] for group in estimator._grouped(texts)] == [["a", "b"], ["c"]]


def test_a_change_of_the_unit_in_use_is_told_while_armed() -> None:
    line = TimeLine(np.array([0.0, 3.0, 20.0, 21.0, 58.0]), [0, 1, 1, 2, 0], "flown")
    found = estimator._switches(log(imu_that_flew=line), SPANS, [])
    assert [(e.kind, e.t, e.text) for e in found] == [("sensor_switch", 21.0, "IMU 2 replaced IMU 1 at 21.0 s.")]


def test_resets_of_the_attitude_count_while_armed() -> None:
    spans = Segments([*SPANS.segments, Segment("reset", 3.9, 4.0, "x"), Segment("reset", 29.9, 30.0, "by 9 deg")])
    (found,) = estimator._resets(spans)
    assert found.text == "The onboard attitude was reset at 30.0 s: by 9 deg."


def test_what_is_no_measurement_clips_nothing() -> None:
    clipping = Clipping("accelerometer", 0, "vehicle_imu_status:0", T, np.ones(len(T), np.int64), True)
    assert [e.kind for e in sensors.events(log(clippings=[clipping]), SPANS)[0]] == ["clipping"]
    refused = [Problem("imu_mostly_refused", "error", "Mostly refused.")]
    assert sensors.events(log(clippings=[clipping], problems=refused), SPANS) == ([], [])
