"""One experiment for many seeds: the same numbers in their order however many processes, and a death is told."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from scipy import signal

from attlog.core.errors import AttlogError
from attlog.reproduce import bench, lyu
from attlog.reproduce.bench import flight_samples, run_seeds, spectrum
from attlog.reproduce.paper import PaperOptions
from attlog.simulate.fly import fly


def second(seed: int, angle: float) -> float:
    """The sum of all rates of a second of a lift."""
    board = lyu.board(1.0, lyu.lifted(angle))
    return float(flight_samples(fly(board, seed), mag=False).gyr.sum())


def gone(seed: int) -> int:
    """Ends its process when its turn comes."""
    if seed == 1:
        os._exit(3)
    return seed


@pytest.mark.slow
def test_the_same_seeds_give_the_same_numbers_in_several_processes() -> None:
    alone, both = (run_seeds("seconds", second, PaperOptions(seeds=3, processes=n), 20.0) for n in (1, 2))
    assert alone == both
    assert len(set(alone)) == 3
    assert alone[2] == second(2, 20.0)


@pytest.mark.slow
def test_a_process_that_dies_is_told_with_its_number() -> None:
    with pytest.raises(AttlogError, match="seeds, number 1"):
        run_seeds("seeds", gone, PaperOptions(seeds=3, processes=2))


# Settling, overshoot, rise and spikes of signals whose answer is known.

T_RESPONSE = np.arange(0.0, 10.0, 0.001)


def test_an_error_that_decays_settles_where_the_exponential_says() -> None:
    error = np.where(T_RESPONSE < 2.0, 0.0, 20.0 * np.exp(-(T_RESPONSE - 2.0) / 0.7))
    assert bench.settling_s(T_RESPONSE, error, 2.0, 1.0) == pytest.approx(0.7 * math.log(20.0), abs=0.002)
    assert bench.settling_s(T_RESPONSE, error, 2.0, 30.0) == 0.0
    assert math.isnan(bench.settling_s(T_RESPONSE, error + 2.0, 2.0, 1.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_second_order_step_overshoots_and_rises_as_the_closed_form(sign: float) -> None:
    damping, natural = 0.5, 4.0
    fast = natural * math.sqrt(1 - damping**2)
    s = np.clip(T_RESPONSE - 1.0, 0.0, None)
    y = (
        30.0
        * sign
        * (1 - np.exp(-damping * natural * s) * (np.cos(fast * s) + damping * natural / fast * np.sin(fast * s)))
    )
    peak = 30.0 * math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    assert bench.overshoot_of(T_RESPONSE, y, 1.0, 0.0, 30.0 * sign) == pytest.approx(peak, rel=1e-3)
    assert bench.overshoot_of(T_RESPONSE, 0.5 * y, 1.0, 0.0, 30.0 * sign) == 0.0
    first = bench.rise_s(T_RESPONSE, 30.0 * sign * (1 - np.exp(-s / 0.5)), 1.0, 0.0, 30.0 * sign)
    assert first == pytest.approx(0.5 * math.log(9.0), abs=0.002)
    assert math.isnan(bench.rise_s(T_RESPONSE, 0.8 * y / (1 + peak / 30), 1.0, 0.0, 30.0 * sign))


def test_spikes_are_counted_once_each_whatever_their_sign() -> None:
    error = np.zeros_like(T_RESPONSE)
    for begin, size in ((1.0, 6.0), (1.2, 6.0), (4.0, -9.0), (8.0, 4.0)):
        error[(begin < T_RESPONSE) & (begin + 0.1 > T_RESPONSE)] = size
    assert bench.count_spikes(T_RESPONSE, error, 5.0) == (2, 9.0)
    assert bench.count_spikes(T_RESPONSE, error, 10.0) == (0, 9.0)


def test_spread_knows_nothing_of_a_slope() -> None:
    noise = np.random.default_rng(4).normal(0.0, 2.0, len(T_RESPONSE))
    assert bench.detrended_std(T_RESPONSE, 100.0 * T_RESPONSE + noise) == pytest.approx(2.0, rel=0.03)


def test_an_excursion_is_what_is_quicker_than_the_median_follows() -> None:
    slow = 5.0 * np.sin(2 * np.pi * T_RESPONSE / 40.0)
    quick = np.where((T_RESPONSE > 4.0) & (T_RESPONSE < 4.3), 3.0, 0.0)
    t, found = bench.quick_errors(T_RESPONSE, np.column_stack([slow, slow + quick]))
    assert np.max(np.abs(found[:, 0])) < 0.15
    assert np.max(found[:, 1]) == pytest.approx(3.0, abs=0.3)
    assert 4.0 < t[np.argmax(found[:, 1])] < 4.3
    assert (t[0], t[-1]) == pytest.approx((1.0, 8.98), abs=0.03)


def test_an_error_has_settled_at_the_first_sample_that_is_within_and_not_at_the_last_beyond() -> None:
    t, error = np.arange(6.0), np.array([9.0, 9.0, 9.0, 2.0, 1.0, 0.0])
    assert bench.settling_s(t, error, 1.0, 2.0) == 2.0
    assert bench.settling_s(t, error, 1.0, 1.0) == 3.0


# Band-limited movement against closed forms and scipy.

T_BAND = np.arange(0.0, 120.0, 0.01)
NOISE = np.random.default_rng(3).normal(0.0, 1.0, len(T_BAND))


def test_a_sine_has_its_rms_in_its_band_and_nothing_elsewhere() -> None:
    y = 3.0 * np.sin(2 * np.pi * 1.3 * T_BAND) + 0.2 * T_BAND
    assert spectrum(T_BAND, y).rms((1.0, 2.0)) == pytest.approx(3.0 / np.sqrt(2.0), rel=1e-3)
    assert spectrum(T_BAND, y).rms((3.0, 20.0)) < 0.02
    assert spectrum(T_BAND, y + 0.3 * NOISE).dominant_hz((0.2, 5.0)) == pytest.approx(1.3, abs=0.05)


def test_white_noise_has_the_power_of_the_bands_share() -> None:
    assert spectrum(T_BAND, NOISE).rms((5.0, 25.0)) == pytest.approx(np.sqrt(20.0 / 50.0), rel=0.02)
    assert spectrum(T_BAND, NOISE).rms((0.0, 51.0)) == pytest.approx(1.0, rel=0.02)


def test_zero_crossings_are_those_of_a_sine_and_of_white_noise_in_the_band() -> None:
    """Of white noise Rice's formula gives the root of the mean of f^2 over the band."""
    assert spectrum(T_BAND, np.sin(2 * np.pi * 1.3 * T_BAND)).crossing_hz((0.2, 5.0)) == pytest.approx(1.3, rel=0.02)
    low, high = 2.0, 20.0
    mean_square = (high**3 - low**3) / (3.0 * (high - low))
    assert spectrum(T_BAND, NOISE).crossing_hz((low, high)) == pytest.approx(np.sqrt(mean_square), rel=0.02)


def test_the_spectrum_is_scipys() -> None:
    found = spectrum(T_BAND, NOISE)
    f, density = signal.welch(NOISE, 100.0, "hann", 1000, 500, detrend="linear")
    np.testing.assert_allclose(found.f, f)
    np.testing.assert_allclose(found.density, density, rtol=1e-9, atol=1e-15)


# What an update costs: in turn over the same samples, told apart where it differs by much.


def test_a_filter_with_twelve_states_costs_more_than_integration_alone() -> None:
    spent = bench.time_updates(("gyro", "ekf12"), rounds=3, repeats=3)
    assert [len(x) for x in spent.values()] == [3, 3]
    assert min(spent["ekf12"]) > 3.0 * max(spent["gyro"]) > 0.0
