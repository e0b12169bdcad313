"""Spectra against scipy's and against what was planted."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Stream
from attlog.flight.vibration.model import Burst
from attlog.health.assessments.vibration import spectra
from tests.health.assessments.vibration.shaken import shaken


def test_a_tone_has_the_power_of_its_amplitude_and_a_gyro_is_in_degrees() -> None:
    t = np.arange(800) / 400.0
    x = np.zeros((2, 800, 3))
    x[:, :, 1] = 3.0 * np.sin(2 * np.pi * 50.0 * t)
    f, density = spectra.welch(x, 400.0, 200)
    assert f.tolist() == pytest.approx((2.0 * np.arange(101)).tolist())
    assert density[:, :, 1].sum(axis=1) * 2.0 == pytest.approx([4.5, 4.5], rel=1e-6)
    assert np.argmax(density[0, :, 1]) == 25
    _, turning = spectra.welch(x, 400.0, 200, "gyro")
    assert turning == pytest.approx(density * np.degrees(1.0) ** 2)


def test_the_power_of_white_noise_is_its_variance_in_deg_per_s() -> None:
    log = shaken(200.0, 60.0, rms_dps=0.0, noise_dps=2.0)
    (found,) = spectra.all_of(log, [(0.0, 80.0)])
    assert found.density.mean(axis=0).sum(axis=0) * found.step == pytest.approx([4.0] * 3, rel=0.05)


def test_windows_lie_in_flight_and_hold_no_gap() -> None:
    t = np.arange(0.0, 40.0, 0.005)
    t = t[(t < 15.0) | (t > 16.0)]
    stream = Stream(t, np.zeros((len(t), 3)), "rad/s", "FRD", "GYR")
    found = spectra.of_stream(stream, [(10.0, 20.0)], "gyro", 0, False)
    assert found is not None
    begin, end = found.t - 0.5 * found.seconds, found.t + 0.5 * found.seconds
    assert len(begin) == 4  # two from 10 to 15 s, two from 16 to 20 s
    assert begin.min() >= 9.99
    assert end.max() <= 20.01
    assert not ((begin < 15.0) & (end > 16.0)).any()


def test_single_lost_samples_do_not_end_a_window_and_move_no_peak() -> None:
    log = shaken(200.0, 40.0, rms_dps=5.0)
    stream = log.imus[0].gyro
    kept = np.random.default_rng(1).random(len(stream.t)) > 0.04
    lossy = Stream(stream.t[kept], stream.x[kept], "rad/s", "FRD", "GYR")
    whole = spectra.of_stream(stream, [(10.0, 70.0)], "gyro", 0, False)
    found = spectra.of_stream(lossy, [(10.0, 70.0)], "gyro", 0, False)
    assert whole is not None
    assert found is not None
    assert len(found.t) > 0.7 * len(whole.t)
    assert found.frequency[np.argmax(np.median(found.total, axis=0))] == pytest.approx(40.0, abs=found.step)


def test_jitter_of_the_stamps_takes_nothing_out_near_half_the_rate() -> None:
    """A tone at 53 of 60 Hz; stamps wander by a fifth of an interval, and their usual step is not the mean one."""
    rng = np.random.default_rng(4)
    number = np.arange(120 * 60)
    x = np.zeros((len(number), 3))
    x[:, 0] = 2.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 53.0 * number / 120.0)
    t = number / 120.0 + rng.uniform(0.0, 0.2 / 120.0, len(number)) + np.where(number % 5 == 0, 0.2 / 120.0, 0.0)
    found = spectra.of_stream(Stream(t, x, "m/s^2", "FRD", "ACC"), [(0.0, 60.0)], "accelerometer", 0, False)
    assert found is not None
    assert found.rate == pytest.approx(120.0, rel=0.002)
    near = np.abs(found.frequency - 53.0) < 5.0
    assert np.sqrt(found.median[near, 0].sum() * found.step) == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(("n", "rate"), [(0, 200.0), (1, 200.0), (5, 200.0), (3000, 25.0)])
def test_what_is_too_short_or_too_slow_has_no_spectrum(n: int, rate: float) -> None:
    t = np.arange(n) / rate
    assert spectra.of_stream(Stream(t, np.zeros((n, 3)), "rad/s", "FRD", ""), [(0.0, 1e3)], "gyro", 0, False) is None


def test_values_that_are_missing_spoil_their_window_only() -> None:
    log = shaken(200.0, 40.0)
    stream = log.imus[0].gyro
    whole = spectra.of_stream(stream, [(10.0, 70.0)], "gyro", 0, False)
    stream.x[4000] = np.nan
    found = spectra.of_stream(stream, [(10.0, 70.0)], "gyro", 0, False)
    assert whole is not None
    assert found is not None
    assert len(whole.t) - 2 <= len(found.t) < len(whole.t)
    assert np.isfinite(found.density).all()


def test_bursts_in_flight_have_spectra_at_the_sensors_rate() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(1024) / 2000.0
    tone = np.radians(3.0 * np.sqrt(2.0)) * np.sin(2 * np.pi * 300.0 * t)
    bursts = [
        Burst("gyro", 0, at, 2000.0, np.float32(1e-3 * rng.standard_normal((1024, 3)) + tone[:, None]), False, "")
        for at in (1.0, 20.0, 30.0)
    ]
    found = spectra.of_bursts(bursts, [(10.0, 40.0)])
    assert found is not None
    assert len(found.t) == 2
    near = np.abs(found.frequency - 300.0) < 15.0
    assert np.sqrt(found.median[near, 0].sum() * found.step) == pytest.approx(3.0, rel=0.03)
    assert spectra.of_bursts(bursts, [(50.0, 60.0)]) is None


def test_hours_cost_no_more_than_minutes() -> None:
    t = np.arange(0.0, 3600.0, 0.01)
    stream = Stream(t, np.zeros((len(t), 3)), "rad/s", "FRD", "GYR")
    found = spectra.of_stream(stream, [(0.0, 3600.0)], "gyro", 0, False)
    assert found is not None
    assert len(found.t) == spectra.MOST_WINDOWS
