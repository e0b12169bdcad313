"""Settling, overshoot, rise and spikes of signals whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.reproduce import response

T = np.arange(0.0, 10.0, 0.001)


def test_an_error_that_decays_settles_where_the_exponential_says() -> None:
    error = np.where(T < 2.0, 0.0, 20.0 * np.exp(-(T - 2.0) / 0.7))
    assert response.settling_s(T, error, 2.0, 1.0) == pytest.approx(0.7 * math.log(20.0), abs=0.002)
    assert response.settling_s(T, error, 2.0, 30.0) == 0.0
    assert math.isnan(response.settling_s(T, error + 2.0, 2.0, 1.0))


def test_an_error_that_comes_back_has_not_settled_before() -> None:
    error = np.where((T > 5.0) & (T < 5.5), 3.0, 0.0)
    assert response.settling_s(T, error, 2.0, 1.0) == pytest.approx(3.5, abs=0.002)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_second_order_step_overshoots_and_rises_as_the_closed_form(sign: float) -> None:
    damping, natural = 0.5, 4.0
    fast = natural * math.sqrt(1 - damping**2)
    s = np.clip(T - 1.0, 0.0, None)
    y = (
        30.0
        * sign
        * (1 - np.exp(-damping * natural * s) * (np.cos(fast * s) + damping * natural / fast * np.sin(fast * s)))
    )
    peak = 30.0 * math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    assert response.overshoot(T, y, 1.0, 0.0, 30.0 * sign) == pytest.approx(peak, rel=1e-3)
    assert response.overshoot(T, 0.5 * y, 1.0, 0.0, 30.0 * sign) == 0.0
    first = response.rise_s(T, 30.0 * sign * (1 - np.exp(-s / 0.5)), 1.0, 0.0, 30.0 * sign)
    assert first == pytest.approx(0.5 * math.log(9.0), abs=0.002)
    assert math.isnan(response.rise_s(T, 0.8 * y / (1 + peak / 30), 1.0, 0.0, 30.0 * sign))


def test_spikes_are_counted_once_each_whatever_their_sign() -> None:
    error = np.zeros_like(T)
    for begin, size in ((1.0, 6.0), (1.2, 6.0), (4.0, -9.0), (8.0, 4.0)):
        error[(begin < T) & (begin + 0.1 > T)] = size
    assert response.spikes(T, error, 5.0) == (2, 9.0)
    assert response.spikes(T, error, 10.0) == (0, 9.0)


def test_spread_knows_nothing_of_a_slope() -> None:
    noise = np.random.default_rng(4).normal(0.0, 2.0, len(T))
    assert response.spread(T, 100.0 * T + noise) == pytest.approx(2.0, rel=0.03)


def test_an_excursion_is_what_is_quicker_than_the_median_follows() -> None:
    slow = 5.0 * np.sin(2 * np.pi * T / 40.0)
    quick = np.where((T > 4.0) & (T < 4.3), 3.0, 0.0)
    t, found = response.excursions(T, np.column_stack([slow, slow + quick]))
    assert np.max(np.abs(found[:, 0])) < 0.15
    assert np.max(found[:, 1]) == pytest.approx(3.0, abs=0.3)
    assert 4.0 < t[np.argmax(found[:, 1])] < 4.3
    assert (t[0], t[-1]) == pytest.approx((1.0, 8.98), abs=0.03)


def test_an_error_has_settled_at_the_first_sample_that_is_within_and_not_at_the_last_beyond() -> None:
    t, error = np.arange(6.0), np.array([9.0, 9.0, 9.0, 2.0, 1.0, 0.0])
    assert response.settling_s(t, error, 1.0, 2.0) == 2.0
    assert response.settling_s(t, error, 1.0, 1.0) == 3.0
