"""The firmwares' second-order filters against scipy's design, its response and its filtering."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal  # type: ignore[import-untyped]

from attlog.core import signal as biquad

LOWPASSES = [(20.0, 250.0), (80.0, 1000.0), (5.0, 25.0), (99.0, 200.0)]
NOTCHES = [(80.0, 20.0, 1000.0), (40.0, 5.0, 250.0), (90.0, 30.0, 200.0)]


def coefficients(f: biquad.Biquad) -> tuple[list[float], list[float]]:
    return [f.b0, f.b1, f.b2], [1.0, f.a1, f.a2]


@pytest.mark.parametrize(("cutoff", "rate"), LOWPASSES)
def test_the_low_pass_is_scipys_butterworth(cutoff: float, rate: float) -> None:
    b, a = coefficients(biquad.lowpass(cutoff, rate))
    wanted_b, wanted_a = signal.butter(2, cutoff, fs=rate)
    np.testing.assert_allclose(b, wanted_b, rtol=1e-12)
    np.testing.assert_allclose(a, wanted_a, rtol=1e-9, atol=1e-12)
    _, h = signal.freqz(b, a, [cutoff], fs=rate)
    assert abs(h[0]) == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize(("centre", "width", "rate"), NOTCHES)
def test_the_notch_is_scipys_and_lets_nothing_through_at_its_centre(centre: float, width: float, rate: float) -> None:
    b, a = coefficients(biquad.notch(centre, width, rate))
    wanted_b, wanted_a = signal.iirnotch(centre, centre / width, fs=rate)
    np.testing.assert_allclose(b, wanted_b, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(a, wanted_a, rtol=1e-9, atol=1e-12)
    _, h = signal.freqz(b, a, [1e-6, centre], fs=rate)
    assert abs(h[0]) == pytest.approx(1.0)
    assert abs(h[1]) < 1e-6


def test_samples_come_out_as_of_scipys_filter_that_started_at_rest_with_the_first_sample() -> None:
    x = np.cumsum(np.random.default_rng(3).normal(size=(500, 3)), axis=0)
    f = biquad.lowpass(20.0, 250.0)
    b, a = coefficients(f)
    wanted = np.column_stack([signal.lfilter(b, a, y, zi=signal.lfilter_zi(b, a) * y[0])[0] for y in x.T])
    np.testing.assert_allclose(biquad.run_biquads([(0, f)], x), wanted, atol=1e-9)


def test_a_filter_that_changes_to_itself_changes_nothing_and_a_steady_value_passes_any_change() -> None:
    x = np.random.default_rng(3).normal(size=(400, 2))
    f, g = biquad.notch(60.0, 20.0, 400.0), biquad.notch(90.0, 20.0, 400.0)
    np.testing.assert_array_equal(biquad.run_biquads([(0, f), (150, f)], x), biquad.run_biquads([(0, f)], x))
    steady = np.full((400, 1), -9.81)
    changing = [(0, biquad.PASS_THROUGH), (100, f), (180, g), (300, biquad.PASS_THROUGH), (350, f)]
    np.testing.assert_allclose(biquad.run_biquads(changing, steady), steady, atol=1e-12)


def test_samples_that_are_not_finite_are_passed_by() -> None:
    x = np.ones((50, 1))
    x[20] = np.nan
    out = biquad.run_biquads([(0, biquad.lowpass(10.0, 100.0))], x)
    assert np.isnan(out[20, 0])
    np.testing.assert_allclose(np.delete(out, 20), 1.0)
