"""Strength of the field and what follows the motors: limits from both sides, closed forms and numpy's regression."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Firmware, FlightLog, Mag, Stream
from attlog.health.sensors import interference, magnetometer
from attlog.segments.model import Segment, Segments

T = np.arange(0.0, 60.0, 0.1)
DIRECTION = np.array([0.36, -0.48, 0.8])
FLOWN = Segments([Segment("continuous", 0, 60), Segment("armed", 0, 60), Segment("airborne", 5, 55)])


def compass(size_ut: Any) -> Mag:
    return Mag(0, Stream(T, 1e-6 * (size_ut + 0.0 * T)[:, None] * DIRECTION, "T", "FRD", "MAG:0"))


def log(mag: Mag, **more: Any) -> FlightLog:
    made = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    made.mags, made.mag = [mag], 0
    for name, value in more.items():
        setattr(made, name, value)
    return made


@pytest.mark.parametrize(
    ("size", "model", "varies", "verdict"),
    [
        (14.9, None, 0.0, "fault"),
        (15.1, None, 0.0, "ok"),
        (89.9, None, 0.0, "ok"),
        (90.1, None, 0.0, "fault"),
        (59.9, 50.0, 0.0, "ok"),
        (60.1, 50.0, 0.0, "warning"),
        (40.1, 50.0, 0.0, "ok"),
        (39.9, 50.0, 0.0, "warning"),
        (50.0, 50.0, 0.099, "ok"),
        (50.0, 50.0, 0.101, "warning"),
        (95.0, 90.0, 0.0, "fault"),
    ],
)
def test_a_field_has_its_strength_within_a_fifth_of_the_model_and_varies_by_a_tenth(
    monkeypatch: pytest.MonkeyPatch, size: float, model: float | None, varies: float, verdict: str
) -> None:
    known = None if model is None else SimpleNamespace(strength_t=1e-6 * model)
    monkeypatch.setattr(magnetometer.declination, "model", lambda log: known)
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * T / 5.0 + 0.01)  # ten of these are flown
    one = compass(size * (1.0 + varies * wave))
    check = magnetometer.strength(log(one), FLOWN)
    assert check.verdict == verdict
    assert f"varying by {100 * varies:.0f} %" in check.text
    one.calibrated = False
    assert magnetometer.strength(log(one), FLOWN).verdict == ("warning" if verdict == "ok" else verdict)


def test_directions_have_their_circular_mean_across_south() -> None:
    angle = np.pi + np.radians(np.linspace(-20.0, 40.0, 1001))
    mean, spread = magnetometer.circular(angle)
    assert mean % 360.0 == pytest.approx(190.0, abs=0.05)
    assert spread == pytest.approx(0.9 * 60.0 / magnetometer.MIDDLE_SIGMAS, rel=1e-3)


def test_a_turn_is_the_fastest_of_the_intervals_around_and_unknown_beyond_the_attitude() -> None:
    t = np.arange(0.0, 6.0)
    angle = np.radians([0.0, 10.0, 10.0, 10.0, 40.0, 40.0])
    q = np.column_stack([np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)])
    found = magnetometer.turning_dps(t, q, np.array([-0.1, 0.5, 1.5, 2.5, 4.5, 5.1]))
    np.testing.assert_allclose(found, [np.inf, 10.0, 10.0, 30.0, 30.0, np.inf])


THROTTLE = 0.5 + 0.3 * np.sin(0.5 * T)


def drive(x: Any, t: np.ndarray = T) -> Stream:
    return Stream(t, np.asarray(x)[:, None], "1", "", "CTUN")


def test_the_field_is_put_on_the_line_through_the_drive_at_its_fifth_and_ninety_fifth_percentile() -> None:
    size = 40.0 + 20.0 * THROTTLE + np.random.default_rng(1).normal(size=len(T))
    found = interference.follow(compass(size).field, drive(THROTTLE), np.ones(len(T), bool), 0.1)
    assert found is not None
    r, low, high = found
    assert r == pytest.approx(np.corrcoef(THROTTLE, size)[0, 1])
    slope, start = np.polyfit(THROTTLE, size, 1)
    assert (low, high) == pytest.approx(tuple(start + slope * np.quantile(THROTTLE, [0.05, 0.95])))


def test_a_drive_that_hardly_varies_a_short_time_and_few_samples_tell_nothing() -> None:
    field, use = compass(40.0 + 20.0 * THROTTLE).field, np.ones(len(T), bool)
    reach = np.ptp(np.quantile(THROTTLE, [0.05, 0.95]))
    assert interference.follow(field, drive(THROTTLE), use, 0.99 * reach) is not None
    assert interference.follow(field, drive(THROTTLE), use, 1.01 * reach) is None
    assert interference.follow(field, drive(THROTTLE), T < 9.95, 0.01) is None
    assert interference.follow(field, drive(THROTTLE), T < 10.05, 0.01) is not None
    assert interference.follow(field, drive(THROTTLE), use & (np.arange(len(T)) % 13 == 0), 0.1) is None
    assert interference.follow(field, drive(THROTTLE, T + 100.0), use, 0.1) is None


@pytest.mark.parametrize(
    ("slope", "verdict"), [(4.5, "ok"), (7.0, "warning"), (18.0, "fault"), (-7.0, "warning"), (-18.0, "fault")]
)
def test_a_field_that_goes_with_the_throttle_by_an_eighth_or_a_third_is_bent(slope: float, verdict: str) -> None:
    """Over 0.59 of throttle: 2.6, 4.1 and 10.6 of some 33 uT; offsets cannot explain what never turns."""
    one = log(compass(33.0 + slope * (THROTTLE - 0.5)), throttle=drive(THROTTLE))
    (check,) = interference.checks(one, FLOWN)
    low, high = (33.0 + slope * (q - 0.5) for q in np.quantile(THROTTLE, [0.05, 0.95]))
    assert check.verdict == verdict
    assert check.value == pytest.approx(100.0 * abs(high - low) / min(low, high), abs=0.7)


def test_offsets_explain_a_size_that_changes_with_the_direction_alone() -> None:
    """The vehicle turns with the throttle: an offset of 9 uT makes the size follow, a current of its own does not."""
    angle = 2.0 * (THROTTLE - 0.5) / 0.3
    earth = 40.0 * np.column_stack([0.8 * np.cos(angle), -0.8 * np.sin(angle), 0.6 + 0.0 * T])
    noise = 0.3 * np.random.default_rng(2).normal(size=earth.shape)
    use = np.ones(len(T), bool)
    moved = Stream(T, 1e-6 * (earth + noise + np.array([9.0, 2.0, 0.0])), "T", "FRD", "MAG:0")
    assert interference.offsets_explain(moved, drive(THROTTLE), use)
    other = np.sin(0.17 * T)
    free = 40.0 * np.column_stack([0.8 * np.cos(other), -0.8 * np.sin(other), 0.6 + 0.0 * T])
    bent = Stream(T, 1e-6 * (free + noise + np.outer(20.0 * THROTTLE, [1.0, 0.0, 0.0])), "T", "FRD", "MAG:0")
    assert not interference.offsets_explain(bent, drive(THROTTLE), use)
    still = compass(33.0 + 7.0 * THROTTLE).field
    assert not interference.offsets_explain(still, drive(THROTTLE), use)
    assert not interference.offsets_explain(moved, drive(THROTTLE), use & (T < 4.9))
