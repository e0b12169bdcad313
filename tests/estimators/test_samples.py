"""Cleaned samples are what a plain walk over the input, sample by sample, says they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog.estimators import estimate
from attlog.estimators.samples import HELD, MISSING, NEW, prepare, uniform


def walked(t, gyr, mag, sampling, hold):
    """Rate, substeps, magnetometer use and segment of each sample, one by one."""
    steps = np.diff(t)
    limit = max(5 * float(np.median(steps)), 0.05) if len(steps) else math.inf
    new = [k for k in range(len(t)) if np.isfinite(mag[k]).all() and mag[k].any()]
    period = float(np.median(np.diff(t[new]))) if len(new) > 1 else 0.0
    found, segment, last = [], 0, None
    for k in range(len(t)):
        step = 0.0 if k == 0 else t[k] - t[k - 1]
        gap = step > limit
        begins = k == 0 or (gap and step > 0.5)
        segment += k > 0 and begins
        mean = not begins and (gap or sampling == "instant")
        rate = 0.5 * (gyr[k - 1] + gyr[k]) if mean else gyr[k]
        parts = 0 if begins else max(math.ceil(math.sqrt(rate @ rate) * step), 1)
        use = NEW if k in new else MISSING
        if use == NEW:
            last = (k, segment)
        elif hold and 1 < len(new) < len(t) and last and last[1] == segment and t[k] - t[last[0]] <= 1.5 * period:
            use = HELD
        found.append((*rate, parts, use, segment))
    return np.array(found)


@pytest.mark.parametrize("sampling", ["interval", "instant"])
@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.sampled_from([0.01, 0.011, 0.04, 0.3, 0.7]), min_size=1, max_size=40),
    speed=st.sampled_from([0.1, 3.0, 34.0]),
    every=st.integers(1, 9),
    hold=st.booleans(),
    seed=st.integers(0, 99),
)
def test_rates_parts_field_and_segments_are_those_of_a_plain_walk(sampling, steps, speed, every, hold, seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum([0.0, *steps])
    gyr = speed * rng.uniform(-1.0, 1.0, (len(t), 3))
    mag = rng.uniform(0.1, 1.0, (len(t), 3))
    mag[rng.integers(0, every, len(t)) > 0] = np.nan
    mag[rng.integers(0, 20, len(t)) == 0] = 0.0
    mag[rng.integers(0, 20, len(t)) == 0, 1] = np.inf
    got = prepare(t, gyr, np.tile([0.0, 0.0, -9.8], (len(t), 1)), mag, sampling=sampling, hold_mag=hold)
    found = np.column_stack([got.gyr, got.substeps, got.use, got.segment])
    np.testing.assert_allclose(found, walked(t, gyr, mag, sampling, hold), rtol=1e-15)
    assert got.skipped.get("nan", 0) == np.isinf(mag).any(axis=1).sum()
    assert got.skipped.get("zero_vector", 0) == (mag == 0.0).all(axis=1).sum()


def test_a_samples_own_time_is_trusted_up_to_one_and_a_half_times_and_not_over_a_lost_sample():
    """Records 10 ms apart, one 14 ms late, then one lost: what that one would have turned is not in the next."""
    t = np.cumsum([0.0, 0.01, 0.014, 0.02, 0.01])
    got = prepare(t, np.zeros((5, 3)), None, dt=np.array([0.01, 0.0099, 0.0101, 0.0098, np.nan]))
    np.testing.assert_allclose(got.dt, [0.0, 0.0099, 0.0101, 0.02, 0.01], atol=1e-12)


# Samples on an even grid.


def test_a_field_sample_stands_at_the_grid_time_that_it_has_else_at_the_next() -> None:
    """Measured at 0 and 10 ms, which are on the grid, and at 35 ms, which is between two of its times."""
    t = np.array([0.0, 0.01, 0.02, 0.035, 0.045])
    mag = np.full((5, 3), np.nan)
    mag[[0, 1, 3]] = [[1.0, 0.0, 2.0], [3.0, 0.0, 4.0], [5.0, 0.0, 6.0]]
    found = uniform(t, np.zeros((5, 3)), np.tile([0.0, 0.0, -9.81], (5, 1)), mag)
    assert np.flatnonzero(found.mag.any(axis=1)).tolist() == [0, 1, 4]
    assert found.mag[[0, 1, 4]].tolist() == mag[[0, 1, 3]].tolist()


def test_half_a_step_is_put_back_from_the_sample_after_the_one_that_shows_the_cut():
    rng, step = np.random.default_rng(0), np.deg2rad(0.061)
    t = 0.004 * np.arange(2000)
    gyr = step * np.trunc(rng.normal(2.0, 1.5, (2000, 3)))
    gyr[70] = np.nan
    acc = np.tile([0.0, 0.0, -9.8], (2000, 1))
    got = prepare(t, gyr, acc, ours=True)
    shown, good = got.truncation.readings, gyr[np.isfinite(gyr).all(axis=1)]
    assert 1000 < shown < 1100
    np.testing.assert_array_equal(got.gyr[:shown], good[:shown])
    np.testing.assert_allclose(got.gyr[shown:], good[shown:] + 0.5 * step * np.sign(good[shown:]), atol=1e-12)
    assert prepare(t, rng.normal(2.0, 1.5, (2000, 3)), acc).truncation is None


def test_an_estimate_says_from_where_half_a_step_was_added():
    rng, step = np.random.default_rng(0), np.deg2rad(0.061)
    t, acc = 0.004 * np.arange(2000), np.tile([0.0, 0.0, -9.8], (2000, 1))
    gyr = step * np.trunc(rng.normal(2.0, 1.5, (2000, 3)))
    for name in ("mekf", "vqf", "smoother"):
        quality = estimate(name, t, gyr, acc).quality
        assert quality["gyro_step_dps"] == pytest.approx(0.061, rel=1e-3)
        assert 4.0 < quality["gyro_step_added_from_s"] < 4.5
        assert "gyro_step_dps" not in estimate(name, t, rng.normal(0.0, 0.01, (2000, 3)), acc).quality
