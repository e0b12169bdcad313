"""Band-limited movement against closed forms and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from attlog.reproduce.band import spectrum

T = np.arange(0.0, 120.0, 0.01)
NOISE = np.random.default_rng(3).normal(0.0, 1.0, len(T))


def test_a_sine_has_its_rms_in_its_band_and_nothing_elsewhere() -> None:
    y = 3.0 * np.sin(2 * np.pi * 1.3 * T) + 0.2 * T
    assert spectrum(T, y).rms((1.0, 2.0)) == pytest.approx(3.0 / np.sqrt(2.0), rel=1e-3)
    assert spectrum(T, y).rms((3.0, 20.0)) < 0.02
    assert spectrum(T, y + 0.3 * NOISE).dominant_hz((0.2, 5.0)) == pytest.approx(1.3, abs=0.05)


def test_white_noise_has_the_power_of_the_bands_share() -> None:
    assert spectrum(T, NOISE).rms((5.0, 25.0)) == pytest.approx(np.sqrt(20.0 / 50.0), rel=0.02)
    assert spectrum(T, NOISE).rms((0.0, 51.0)) == pytest.approx(1.0, rel=0.02)


def test_zero_crossings_are_those_of_a_sine_and_of_white_noise_in_the_band() -> None:
    """Of white noise Rice's formula gives the root of the mean of f^2 over the band."""
    assert spectrum(T, np.sin(2 * np.pi * 1.3 * T)).crossing_hz((0.2, 5.0)) == pytest.approx(1.3, rel=0.02)
    low, high = 2.0, 20.0
    mean_square = (high**3 - low**3) / (3.0 * (high - low))
    assert spectrum(T, NOISE).crossing_hz((low, high)) == pytest.approx(np.sqrt(mean_square), rel=0.02)


def test_the_spectrum_is_scipys() -> None:
    found = spectrum(T, NOISE)
    f, density = signal.welch(NOISE, 100.0, "hann", 1000, 500, detrend="linear")
    np.testing.assert_allclose(found.f, f)
    np.testing.assert_allclose(found.density, density, rtol=1e-9, atol=1e-15)


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="too few"):
        spectrum(T[:5], NOISE[:5])
