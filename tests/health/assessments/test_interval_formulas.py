"""Intervals of assessments: 1.96 sigmas of the part along the vector, order statistics, half a line of a spectrum."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from attlog.health.assessments.compass import motors, soft_iron
from attlog.health.assessments.compass.fitting import OffsetFit
from attlog.health.assessments.compass.study import studied
from attlog.health.assessments.vibration import level, peaks
from tests.health.assessments.compass.made import case_of, empty_log, samples


def test_the_interval_of_an_offset_is_that_along_it_and_never_below_zero() -> None:
    found = OffsetFit(np.array([3.0, 0.0, -4.0]), np.array([0.5, 9.0, 0.2]), 1.0, 100, 20)
    half = 1.96 * np.hypot(0.6 * 0.5, 0.8 * 0.2)
    assert found.size_ci95 == pytest.approx((5.0 - half, 5.0 + half))
    small = OffsetFit(np.array([0.1, 0.0, 0.0]), np.array([0.5, 0.5, 0.5]), 1.0, 100, 20)
    assert small.size_ci95 == (0.0, pytest.approx(0.1 + 0.98))


@pytest.mark.parametrize(("offset", "sigma", "counts"), [(1.4, 0.1, False), (1.6, 0.1, True), (2.1, 0.5, True)])
def test_an_offset_counts_beyond_fifteen_milligauss_and_four_sigmas_of_any_axis(
    offset: float, sigma: float, counts: bool
) -> None:
    for axis in range(3):
        for sign in (1.0, -1.0):
            vector, sigmas = np.zeros(3), np.full(3, 9.0)
            vector[axis], sigmas[axis] = sign * offset, sigma
            assert OffsetFit(vector, sigmas, 1.0, 100, 20).counts is counts
    assert not OffsetFit(np.array([1.9, 0.0, 0.0]), np.full(3, 0.5), 1.0, 100, 20).counts


def test_what_motors_add_has_the_interval_of_ground_and_air_along_it() -> None:
    study = studied(samples((1.0, 0.0, 0.0), (0.2, -0.4, 0.1)))
    assert study is not None
    assert study.ground is not None
    found = motors.assessed(case_of(empty_log()), study)
    added = study.air.offset - study.ground.offset
    sigma = np.hypot(study.air.sigma, study.ground.sigma)
    size = np.linalg.norm(added)
    half = 1.96 * np.linalg.norm(sigma * added) / size
    assert found.value == pytest.approx(size, abs=0.05)
    assert found.ci95 == pytest.approx((max(size - half, 0.0), size + half), abs=0.06)
    np.testing.assert_allclose(found.vector, added, atol=0.006)
    np.testing.assert_allclose(found.vector_ci95, 1.96 * sigma, atol=0.006)
    np.testing.assert_allclose(added, 19.5 * np.array([0.2, -0.4, 0.1]), atol=0.5)
    assert found.n == study.air.n + study.ground.n


@pytest.mark.parametrize(("motor", "verdict"), [(0.2, "warning"), (0.4, "fault")])
def test_motors_that_add_a_third_of_the_horizontal_field_are_a_fault(motor: float, verdict: str) -> None:
    """19.5 A more than on the ground; the horizontal field has 20.2 uT."""
    study = studied(samples(motor=(0.6 * motor, 0.8 * motor, 0.0)))
    assert study is not None
    assert motors.assessed(case_of(empty_log()), study).verdict == verdict


@pytest.mark.parametrize(("stretch", "verdict"), [(0.05, "ok"), (0.14, "warning")])
def test_soft_iron_stretches_the_horizontal_field_by_so_many_percent(stretch: float, verdict: str) -> None:
    made = samples((2.0, -1.0, 0.0), noise=0.05)
    x, y = made.expected[:, 0].copy(), made.expected[:, 1].copy()
    made.measured[:, 0] += 0.6 * stretch * x + 0.8 * stretch * y
    made.measured[:, 1] += -0.6 * stretch * y + 0.8 * stretch * x
    study = studied(made)
    assert study is not None
    found = soft_iron.assessed(study)
    assert (found.verdict, found.value) == (verdict, pytest.approx(100.0 * stretch, abs=0.6))
    assert found.ci95 is not None
    low, high = found.ci95
    half = 0.5 * (high - low)
    assert found.value == pytest.approx(0.5 * (low + high), abs=0.11)
    assert half >= 196.0 * 0.015 - 0.1
    assert f"± {half:.0f}" in found.text.replace(f"± {half:.1f}", f"± {half:.0f}")


def test_how_far_the_field_turned_is_between_the_fifth_and_the_ninety_fifth_percentile() -> None:
    angle = np.linspace(2.5, 4.5, 1001)
    assert soft_iron._seen_deg(np.cos(angle), np.sin(angle)) == pytest.approx(np.degrees(0.9 * 2.0), abs=0.1)


@pytest.mark.parametrize(("n", "share"), [(60, 0.8), (400, 0.95), (12, 0.5)])
def test_the_interval_of_a_quantile_has_the_binomial_normal_ranks(n: int, share: float) -> None:
    x = np.random.default_rng(n).permutation(np.arange(n, dtype=float))
    low, high = level.interval_of(x, share)
    ranks = stats.norm.ppf([0.025, 0.975], n * share, np.sqrt(n * share * (1.0 - share)))
    assert (low, high) == (pytest.approx(max(ranks[0], 0.0), abs=0.51), pytest.approx(min(ranks[1], n - 1), abs=0.51))


def test_means_of_seconds_are_those_of_their_finite_samples() -> None:
    t = np.array([0.2, 0.9, 1.1, 3.0, 3.5, 3.9])
    starts, means = level.seconds_of(t, np.array([1.0, 3.0, np.nan, 2.0, np.nan, 6.0]))
    assert (starts.tolist(), means.tolist()) == ([0.0, 3.0], [2.0, 4.0])


def test_the_interval_of_a_peak_is_that_of_the_median_of_its_windows_and_half_a_line_at_least(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spectra: Any = SimpleNamespace(step=2.0)
    peak: Any = SimpleNamespace(frequency=80.0, true=None)
    places = np.array([70.0, 90.0, np.nan, 76.0, 84.0])
    monkeypatch.setattr(peaks, "track", lambda spectra, frequency: places)
    known = places[np.isfinite(places)]
    half = 1.96 * np.sqrt(np.pi / 2.0) * known.std() / 2.0
    assert peaks.interval(spectra, peak) == pytest.approx((80.0 - half, 80.0 + half), abs=0.1)
    peak.true = 120.0
    assert peaks.interval(spectra, peak) == pytest.approx((120.0 - half, 120.0 + half), abs=0.1)
    places[:] = 80.0
    assert peaks.interval(spectra, peak) == (119.0, 121.0)
    places[1:] = np.nan
    assert peaks.interval(spectra, peak) is None
