"""The sensors' own figures: spectra against scipy, clipping, sizes that keep their peaks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from attlog.flight.model import Imu, Stream
from attlog.metrics.figures.sensors import BUCKETS, G, at_the_end, buckets, periodogram, size_of, vibration

RATE = 200.0


def imu(acc: np.ndarray) -> Imu:
    """A unit with the given accelerometer at 200 Hz."""
    t = np.arange(len(acc)) / RATE
    return Imu(0, Stream(t, np.zeros_like(acc), "rad/s", "FRD", "IMU"), Stream(t, acc, "m/s^2", "FRD", "IMU"))


@pytest.mark.parametrize("n", [512, 511])
def test_a_spectrum_is_that_of_scipy(n):
    x = np.random.default_rng(2).normal(0.0, 1.0, (n, 2)) + np.arange(n)[:, None] * [0.01, -0.02]
    expected = signal.welch(x, RATE, "hann", n, 0, detrend="linear", axis=0)[1]
    np.testing.assert_allclose(periodogram(x, 1 / RATE)[1:], expected[1:], rtol=1e-9)


def test_white_noise_has_the_density_that_its_size_and_rate_give():
    x = np.random.default_rng(3).normal(0.0, 0.5, (200 * 512, 1))
    mean = np.mean([periodogram(part, 1 / RATE) for part in np.split(x, 200)], axis=0)
    np.testing.assert_allclose(np.median(np.sqrt(mean[1:-1])), 0.5 * np.sqrt(2 / RATE), rtol=0.02)


def test_vibration_is_the_deviation_within_a_second_and_counts_clipped_samples_there():
    t = np.arange(0, 10, 1 / RATE)
    acc = np.column_stack([0.0 * t, 0.0 * t, -G + np.where(t > 5, 3.0, 0.0) * np.sin(2 * np.pi * 20 * t)])
    acc[1700, 0] = 16 * G
    trace = vibration(imu(acc))[0]
    calm, shaken = trace.columns["z"][trace.t < 4.9], trace.columns["z"][trace.t > 6]
    assert calm.max() < 1e-9
    np.testing.assert_allclose(shaken, 3 / np.sqrt(2), rtol=0.01)
    assert trace.columns["clipped"].sum() == trace.values["samples"] == 1
    assert trace.t[np.argmax(trace.columns["clipped"])] == pytest.approx(8.5, abs=0.5)


def test_a_strong_movement_that_reaches_no_full_scale_is_not_clipped():
    assert not at_the_end(np.array([[0.0, 0.0, -G], [120.0, 0.0, 0.0]])).any()
    assert at_the_end(np.array([[0.0, 0.0, -G], [-8 * G, 0.0, 0.0]])).tolist() == [False, True]


def test_the_size_keeps_its_mean_and_its_peaks():
    t = np.arange(0, 3600.0, 0.02)
    size = np.full(len(t), 9.8)
    size[77_777], size[99_999] = 60.0, np.nan
    trace = size_of("gravity", t, size, {})
    assert len(trace.t) <= BUCKETS + 1
    assert trace.columns["high"].max() == 60.0
    assert np.median(trace.columns["mean"]) == pytest.approx(9.8)
    assert np.isfinite(trace.columns["mean"]).all()


def test_windows_follow_one_another_without_a_sample_left_out_even_across_a_gap():
    t = np.concatenate([np.arange(0, 10, 0.01), np.arange(100, 110, 0.01)])
    middle, edges = buckets(t, 0.5)
    assert edges[0] == 0
    assert edges[-1] == len(t)
    assert (np.diff(edges) > 0).all()
    assert len(middle) == len(edges) - 1
