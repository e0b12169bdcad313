"""A gyro's cut digits are found in made readings, whose rounding is known, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core.truncation import truncation_of

DPS = np.pi / 180.0
RATES_HZ = (10.0, 50.0, 285.0, 1000.0)
QUANTA_DPS = (0.0076, 0.061, 0.57)


def readings(rounding, *, rate=285.0, quantum_dps=0.061, noise=1.5, bias=2.0, motion=0.0, seconds=120.0, seed=1):
    """Rates and readings (n, 3) rad/s; noise, bias and motion in quanta, motion between 105 and 115 s only."""
    rng = np.random.default_rng(seed)
    t, q = np.arange(0.0, seconds, 1.0 / rate), quantum_dps * DPS
    turning = (
        np.sin(2.0 * np.pi * np.outer(t, (0.5, 0.71, 1.23)) + (0.1, 2.0, 4.0)) * ((t > 105.0) & (t < 115.0))[:, None]
    )
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
        for bias in (0.0, 0.4, 2.0, 20.0):
            _, given = readings(rounding, rate=rate, noise=noise, motion=motion, bias=bias, seed=2)
            assert truncation_of(given) is None, (rate, bias)


def test_restored_readings_are_not_found_again():
    _, cut = readings("cut", motion=1000.0)
    assert truncation_of(truncation_of(cut).restore(cut)) is None


@pytest.mark.parametrize("bias", [0.0, 20.0])
def test_a_bias_near_zero_or_far_off_leaves_the_cut_undecided(bias):
    assert truncation_of(readings("cut", bias=bias)[1]) is None


N, TRIALS = 6000, 50


def vibration(rng, amplitude, bias, noise):
    phase = rng.uniform(30.0, 120.0) * np.arange(N)[:, None] / 250.0 + rng.uniform(0.0, 1.0, 3)
    return amplitude * np.sin(2.0 * np.pi * phase) + bias * np.array([1.0, -1.0, 1.0]) + noise * rng.normal(size=(N, 3))


def switching(rng, low, high, longest):
    """Spreads by turns, each for 2 to ``longest`` readings."""
    ends = np.cumsum(rng.integers(2, longest + 1, N))
    odd = np.searchsorted(ends, np.arange(N), side="right") % 2
    return np.where(odd, high, low)[:, None] * rng.normal(size=(N, 3))


def correlated(rng, keep, size):
    x = rng.normal(size=(N, size))
    for i in range(1, N):
        x[i] = keep * x[i - 1] + np.sqrt(1.0 - keep * keep) * x[i]
    return x


def gusts(rng, rate, spread):
    envelope = np.exp(spread * correlated(rng, np.exp(-1.0 / rate), 1))
    return 4.0 * envelope * correlated(rng, np.exp(-1.0 / rate / 0.15), 3)


def held(rng, times):
    return np.repeat(3.0 * rng.normal(size=(N // times + 1, 3)), times, 0)[:N] + rng.normal(0.0, 1.5, 3)


def odd_reading(rng, part):
    x = np.rint(rng.uniform(1.2, 4.0) * rng.normal(size=(N, 3)) + rng.normal(0.0, 2.0, 3))
    x[rng.integers(5, 200, 3), range(3)] += part
    return x


NOISES = {
    "white": lambda rng: rng.uniform(1.0, 6.0) * rng.normal(size=(N, 3)) + rng.normal(0.0, 3.0, 3),
    "vibration of its bias": lambda rng: vibration(rng, 3.0, 3.0, 0.5),
    "larger vibration of its bias": lambda rng: vibration(rng, 4.0, 4.0, 0.5),
    "vibration": lambda rng: vibration(rng, rng.uniform(1.0, 6.0, 3), rng.uniform(-6.0, 6.0, 3), rng.uniform(0.2, 1.2)),
    "short halts": lambda rng: switching(rng, 0.5, 4.0, 5),
    "halts off zero": lambda rng: switching(rng, 0.5, 3.0, 8) + rng.uniform(-3.0, 3.0, 3),
    "long halts": lambda rng: switching(rng, 0.7, 2.0, 400) + rng.uniform(-3.0, 3.0, 3),
    "gusts at 4 Hz": lambda rng: gusts(rng, 4.0, 1.5),
    "gusts at 10 Hz": lambda rng: gusts(rng, 10.0, 1.5),
    "held 3 times": lambda rng: held(rng, 3),
    "held 5 times": lambda rng: held(rng, 5),
    "heavy tails": lambda rng: rng.uniform(1.0, 4.0) * rng.standard_t(3, (N, 3)) + rng.uniform(-3.0, 3.0, 3),
    "uniform": lambda rng: rng.uniform(3.0, 20.0) * (rng.random((N, 3)) - 0.5) + rng.normal(0.0, 2.0, 3),
    "two spreads": lambda rng: rng.choice([0.5, 2.0], (N, 1)) * rng.normal(size=(N, 3)) + rng.uniform(-3.0, 3.0, 3),
}


@pytest.mark.parametrize("kind", NOISES)
def test_rounded_readings_stay_as_they_are_whatever_the_motion(kind):
    rng = np.random.default_rng(list(NOISES).index(kind))
    found = [truncation_of(1e-3 * np.rint(NOISES[kind](rng))) for _ in range(TRIALS)]
    assert found == [None] * TRIALS


@pytest.mark.parametrize("part", [0.5, 1.0 / 3.0])
def test_one_odd_reading_sets_no_step(part):
    rng = np.random.default_rng(3)
    for _ in range(TRIALS):
        assert truncation_of(1e-3 * odd_reading(rng, part)) is None
        cut = 1e-3 * np.trunc(1.5 * rng.normal(size=(N, 3)) + np.array([2.0, -2.5, 1.8]))
        cut[rng.integers(5, 200, 3), range(3)] += 1e-3 * part
        np.testing.assert_allclose(truncation_of(cut).step, 1e-3, rtol=1e-9)


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


def test_a_missing_reading_after_each_hides_nothing():
    _, cut = readings("cut")
    sparse = np.full((2 * len(cut), 3), np.nan)
    sparse[::2] = cut
    np.testing.assert_array_equal(truncation_of(sparse).step, truncation_of(cut).step)


def test_a_cut_is_found_behind_readings_that_are_on_no_grid():
    _, early = readings("float")
    _, late = readings("cut", seconds=20.0)
    assert truncation_of(early) is None
    assert truncation_of(np.concatenate([early, late])).readings > len(early)


def test_an_axis_off_the_grid_stays_as_it_is():
    x, cut = readings("cut")
    cut[:, 1] = x[:, 1]
    found = truncation_of(cut)
    assert found.step[1] == 0.0
    np.testing.assert_array_equal(found.restore(cut)[:, 1], x[:, 1])
