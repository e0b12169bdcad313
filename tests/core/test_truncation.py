"""A gyro's cut digits are found in made readings, whose rounding is known, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core.truncation import truncation_of

DPS = np.pi / 180.0
RATES_HZ = (10.0, 50.0, 285.0, 1000.0)
QUANTA_DPS = (0.0076, 0.061, 0.57)


def readings(rounding, *, rate=285.0, quantum_dps=0.061, noise=1.5, bias=0.4, motion=0.0, seconds=60.0, seed=1):
    """Rates and readings (n, 3) rad/s; noise, bias and motion in quanta, motion between 15 and 45 s only."""
    rng = np.random.default_rng(seed)
    t, q = np.arange(0.0, seconds, 1.0 / rate), quantum_dps * DPS
    turning = np.sin(2.0 * np.pi * np.outer(t, (0.5, 0.71, 1.23)) + (0.1, 2.0, 4.0)) * ((t > 15.0) & (t < 45.0))[:, None]
    x = q * (motion * turning + bias * np.array([1.0, -1.1, 0.9]) + noise * rng.normal(size=(len(t), 3)))
    kinds = {
        "cut": lambda: np.trunc(x / q) * q,
        "rounded": lambda: np.rint(x / q) * q,
        "floor": lambda: np.floor(x / q) * q,
        "dead zone": lambda: np.where(np.abs(x) < 1.5 * q, 0.0, np.rint(x / q) * q),
        "wide dead zone": lambda: np.where(np.abs(x) < 3.0 * q, 0.0, np.rint(x / q) * q),
        "float": lambda: x.astype(np.float32).astype(np.float64),
        "offset grid": lambda: np.trunc(x / q) * q + 0.3 * q,
    }
    return x, kinds[rounding]()


@pytest.mark.parametrize("rate", RATES_HZ)
@pytest.mark.parametrize("quantum_dps", QUANTA_DPS)
def test_a_cut_is_found_at_any_rate_and_step_and_its_bias_goes(rate, quantum_dps):
    x, cut = readings("cut", rate=rate, quantum_dps=quantum_dps, motion=1000.0)
    found = truncation_of(cut)
    assert found is not None
    np.testing.assert_allclose(found.step, quantum_dps * DPS, rtol=1e-3)
    fast = np.abs(x) > 50.0 * found.step  # there a cut reading is half a step too small
    assert np.mean((cut - x)[fast] * np.sign(x[fast])) == pytest.approx(-0.5 * found.step[0], rel=0.1)
    assert abs(np.mean((found.restore(cut) - x)[fast] * np.sign(x[fast]))) < 0.05 * found.step[0]


@pytest.mark.parametrize("rounding", ["rounded", "floor", "dead zone", "wide dead zone", "float", "offset grid"])
@pytest.mark.parametrize("noise", [0.3, 0.9, 1.2, 4.0, 30.0])
@pytest.mark.parametrize("motion", [0.0, 5.0, 1000.0])
def test_nothing_is_found_in_other_readings(rounding, noise, motion):
    for rate in (50.0, 1000.0):
        for bias in (0.0, 0.4, 20.0):
            _, given = readings(rounding, rate=rate, noise=noise, motion=motion, bias=bias, seed=2)
            assert truncation_of(given) is None, (rate, bias)


def test_restored_readings_are_not_found_again():
    _, cut = readings("cut", motion=1000.0)
    assert truncation_of(truncation_of(cut).restore(cut)) is None


def test_a_large_bias_hides_the_cut_until_the_gyro_turns_back_through_zero():
    assert truncation_of(readings("cut", bias=20.0)[1]) is None
    found = truncation_of(readings("cut", bias=20.0, motion=60.0, noise=3.0)[1])
    assert found is not None
    assert found.readings > 15.0 * 285.0


def test_it_looks_no_further_ahead_than_the_reading_that_shows_it():
    _, cut = readings("cut")
    found = truncation_of(cut)
    assert truncation_of(cut[: found.readings - 1]) is None
    assert truncation_of(cut[: found.readings]).readings == found.readings


def test_missing_and_stuck_readings_show_nothing_and_hide_nothing():
    _, cut = readings("cut")
    cut[5::40] = np.nan
    assert truncation_of(cut) is not None
    _, rounded = readings("rounded", noise=4.0)
    for begin in range(0, len(rounded), 300):
        rounded[begin : begin + 150] = 0.0 if begin % 600 else rounded[begin]
    assert truncation_of(rounded) is None
    assert truncation_of(np.full((100, 3), np.nan)) is None
    assert truncation_of(np.zeros((0, 3))) is None


def test_an_axis_off_the_grid_stays_as_it_is():
    x, cut = readings("cut")
    cut[:, 1] = x[:, 1]
    found = truncation_of(cut)
    assert found.step[1] == 0.0
    np.testing.assert_array_equal(found.restore(cut)[:, 1], x[:, 1])
