"""Intervals of the metrics on simulated logs, whose truth is known: they hold it at least at their stated rate.

Every log here went through the writer, the reader and the whole analysis. What is counted is how often an interval
of 95 % holds the true value; a rate is refused where it is lower than 95 % by chance once in a thousand tries.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from attlog.simulate.flight import Flight
from tests.simulate.statistical import GYRO_DPS_RTHZ, analysed, answer, flown, rotated_noise, still, strokes

LATE_MS = 8.0


def holds(interval: tuple[float, float], truth: float) -> bool:
    return interval[0] <= truth <= interval[1]


def at_least_as_stated(held: list[bool], rate: float = 0.95) -> bool:
    """Whether so many intervals held the truth that their rate may well be ``rate``."""
    return bool(stats.binomtest(sum(held), len(held), rate, "less").pvalue > 1e-3)


def drift_deg_per_min(flight: Flight, begin: float) -> float:
    """The mean bias about down after ``begin`` s: what a gyro alone drifts by, deg/min."""
    imu = flight.imus[0]
    return float(np.degrees(imu.gyro_bias[imu.t_sample > begin, 2].mean()) * 60.0)


def noise_and_drift(seeds: range, folder: Path) -> tuple[list[bool], list[bool], list[float]]:
    """Which intervals of noise and of drift hold their truth over seeds, and the noise over its true value."""
    wanted = rotated_noise() * GYRO_DPS_RTHZ
    noise, drift, ratio = [], [], []
    for seed in seeds:
        flight = flown(still(), seed)
        result = analysed(flight, folder, estimators=["gyro"])
        for axis in ("roll", "pitch", "heading"):
            one = answer(result, "gyro", f"noise_{axis}_deg", "rest")
            noise.append(holds(one.ci95, wanted))
            ratio.append(one.value / wanted)
        one = answer(result, "gyro", "drift_rest_deg_per_min", "rest")
        drift.append(holds(one.ci95, drift_deg_per_min(flight, 20.0)))
    return noise, drift, ratio


@pytest.mark.slow
def test_noise_and_drift_intervals_hold_the_truth_on_a_few_seeds(tmp_path: Path) -> None:
    noise, drift, ratio = noise_and_drift(range(2), tmp_path)
    assert sum(noise) >= 5
    assert sum(drift) >= 1
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.2)


@pytest.mark.slow
def test_noise_and_drift_intervals_hold_the_truth_at_their_stated_rate(tmp_path: Path) -> None:
    noise, drift, ratio = noise_and_drift(range(100, 140), tmp_path)
    assert at_least_as_stated(noise), f"{sum(noise)} of {len(noise)}"
    assert at_least_as_stated(drift), f"{sum(drift)} of {len(drift)}"
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.04)


@pytest.mark.slow
def test_the_drift_of_a_walking_bias_is_held_at_the_stated_rate(tmp_path: Path) -> None:
    """The bias walks by as much in a minute as it is known: the mean drift of the record is the truth."""
    held = []
    for seed in range(200, 230):
        flight = flown(still(walk=0.0005), seed)
        result = analysed(flight, tmp_path, estimators=["gyro"])
        one = answer(result, "gyro", "drift_rest_deg_per_min", "rest")
        held.append(holds(one.ci95, drift_deg_per_min(flight, 20.0)))
    assert at_least_as_stated(held), f"{sum(held)} of {len(held)}"


def lags(seeds: range, folder: Path) -> tuple[list[bool], list[float]]:
    """Which intervals of lag hold the sensor's hidden delay, for two filters about each axis; the lags in ms."""
    held, found = [], []
    for seed in seeds:
        result = analysed(flown(strokes(LATE_MS / 1000), seed), folder, estimators=["gyro", "mahony"])
        for row in ("gyro", "mahony"):
            for axis in ("roll", "pitch", "yaw"):
                one = answer(result, row, f"lag_{axis}_ms", "all")
                held.append(holds(one.ci95, LATE_MS))
                found.append(one.value)
    return held, found


@pytest.mark.slow
def test_the_lag_of_a_late_gyro_is_found_and_held(tmp_path: Path) -> None:
    held, found = lags(range(1), tmp_path)
    assert all(held)
    assert np.mean(found) == pytest.approx(LATE_MS, abs=0.1)


@pytest.mark.slow
def test_lag_intervals_hold_the_truth_at_their_stated_rate(tmp_path: Path) -> None:
    held, found = lags(range(100, 120), tmp_path)
    assert at_least_as_stated(held), f"{sum(held)} of {len(held)}"
    assert np.mean(found) == pytest.approx(LATE_MS, abs=0.05)
