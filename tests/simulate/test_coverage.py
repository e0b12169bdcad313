"""Intervals of the metrics on simulated logs, whose truth is known: they hold it at least at their stated rate.

Every log here went through the writer, the reader and the whole analysis. What is counted is how often an interval
of 95 % holds the true value; a rate is refused where it is lower than 95 % by chance once in a thousand tries.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import attlog
from attlog.core import rotation
from attlog.simulate.flight import Flight
from tests.simulate.still import (
    ACC_UG_RTHZ,
    GYRO_DPS_RTHZ,
    MAG_UT_RTHZ,
    RATE,
    analysed,
    answer,
    flown,
    rotated_noise,
    statistical_flight,
    still,
    strokes,
)

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
        flight = statistical_flight(still(), seed)
        result = analysed(flight, folder, estimators=["gyro"])
        for axis in ("roll", "pitch", "heading"):
            one = answer(result, "gyro", f"noise_{axis}_deg", "rest")
            noise.append(holds(one.ci95, wanted))
            ratio.append(one.value / wanted)
        one = answer(result, "gyro", "drift_rest_deg_per_min", "rest")
        drift.append(holds(one.ci95, drift_deg_per_min(flight, 20.0)))
    return noise, drift, ratio


@pytest.mark.slow
def test_noise_and_drift_intervals_hold_the_truth_at_their_stated_rate(tmp_path: Path) -> None:
    noise, drift, ratio = noise_and_drift(range(100, 124), tmp_path)
    assert at_least_as_stated(noise), f"{sum(noise)} of {len(noise)}"
    assert at_least_as_stated(drift), f"{sum(drift)} of {len(drift)}"
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_the_drift_of_a_walking_bias_is_held_at_the_stated_rate(tmp_path: Path) -> None:
    """The bias walks by as much in a minute as it is known: the mean drift of the record is the truth."""
    held = []
    for seed in range(200, 224):
        flight = statistical_flight(still(walk=0.0005), seed)
        result = analysed(flight, tmp_path, estimators=["gyro"])
        one = answer(result, "gyro", "drift_rest_deg_per_min", "rest")
        held.append(holds(one.ci95, drift_deg_per_min(flight, 20.0)))
    assert at_least_as_stated(held), f"{sum(held)} of {len(held)}"


def lags(seeds: range, folder: Path) -> tuple[list[bool], list[float]]:
    """Which intervals of lag hold the sensor's hidden delay, for two filters about each axis; the lags in ms."""
    held, found = [], []
    for seed in seeds:
        result = analysed(statistical_flight(strokes(LATE_MS / 1000), seed), folder, estimators=["gyro", "mahony"])
        for row in ("gyro", "mahony"):
            for axis in ("roll", "pitch", "yaw"):
                one = answer(result, row, f"lag_{axis}_ms", "all")
                held.append(holds(one.ci95, LATE_MS))
                found.append(one.value)
    return held, found


@pytest.mark.slow
def test_lag_intervals_hold_the_truth_at_their_stated_rate(tmp_path: Path) -> None:
    held, found = lags(range(100, 110), tmp_path)
    assert at_least_as_stated(held), f"{sum(held)} of {len(held)}"
    assert np.mean(found) == pytest.approx(LATE_MS, abs=0.05)


# Filters at rest have errors in closed form; simulated flights of known noise must show them.
#
# These are the sizes that the thresholds of the conformance checks stand on: what a filter cannot
# be better than, given noise as in ``attlog.testing.motions.CONSUMER_NOISE``.

Array = NDArray[np.float64]


@functools.lru_cache(maxsize=32)
def flight(seed: int, seconds: float = 40.0, bias: float = 0.0) -> Flight:
    return flown(still(seconds, bias=bias), seed)


def errors_deg(flight: Flight, name: str, field: bool = True, **params: Any) -> Array:
    """Roll, pitch, heading error (n, 3) of a filter that starts with the true attitude, deg."""
    imu, mag = flight.imus[0], np.full((len(flight.imus[0].t), 3), np.nan)
    if field:
        at = np.minimum(np.searchsorted(imu.t_sample, flight.mags[0].t_sample), len(imu.t) - 1)
        mag[at] = flight.mags[0].field
    # With the field of an attitude that is known the magnetometer's declination is that of the place.
    found = attlog.estimate(
        name,
        imu.t_sample,
        imu.gyro,
        imu.acc,
        mag if field else None,
        q0=flight.truth.q[0],
        declination=flight.declination_deg,
        **params,
    )
    e = rotation.earth_error(found.q, flight.truth.q[:1])
    return np.degrees(rotation.to_rotvec(e))


@pytest.mark.slow
def test_a_gyro_alone_is_off_by_its_bias_and_a_random_walk() -> None:
    """Error after T s: bias T on top of a normal variable of variance N^2 T (IEEE Std 952-1997)."""
    ends = []
    for seed in range(16):
        one = flight(seed, 20.0, bias=0.05)
        drifted = np.degrees(one.imus[0].gyro_bias * one.imus[0].dt[:, None]).sum(axis=0)
        # The filter's first attitude is that of the first sample.
        ends.append(errors_deg(one, "gyro", field=False)[-1] - rotation.rotate(one.truth.q[0], drifted))
    spread = np.array(ends) / (GYRO_DPS_RTHZ * math.sqrt(20.0))
    assert stats.kstest(spread.ravel(), "norm").pvalue > 1e-3
    assert spread.std() == pytest.approx(1.0, abs=0.3)


def test_single_samples_of_gravity_and_field_are_off_by_their_noise() -> None:
    """Tilt: n_a sqrt(rate) / g. Heading: n_m sqrt(rate of the field) / B_horizontal, and tilt times tan(dip)."""
    one = flight(1)
    e = errors_deg(one, "accel_mag")[200:]
    acc = np.degrees(ACC_UG_RTHZ * 1e-6 * math.sqrt(RATE))
    assert e[:, :2].std(axis=0) == pytest.approx(acc, rel=0.06)
    north, east, down = one.truth.field[0] * 1e6
    level = math.hypot(north, east)
    field = np.degrees(MAG_UT_RTHZ * math.sqrt(50.0) / level)
    assert e[:, 2].std() == pytest.approx(math.hypot(field, acc * down / level), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("kp", [0.3, 3.0])
def test_a_proportional_filter_is_off_by_bias_over_gain_and_by_filtered_noise(kp: float) -> None:
    """x' = -kp x + bias + gyro noise + kp accelerometer noise: mean bias / kp, variance (N^2 + kp^2 n^2) / (2 kp)."""
    n = np.degrees(ACC_UG_RTHZ * 1e-6)
    wanted = math.sqrt((GYRO_DPS_RTHZ**2 + kp**2 * n**2) / (2.0 * kp))
    offsets, spread = [], []
    for seed in range(8):
        one = flight(seed, 40.0, bias=0.05)
        e = errors_deg(one, "mahony", field=False, kp=kp, ki=0.0)[round(8 * RATE / min(kp, 1.0)) :, :2]
        bias = rotation.rotate(one.truth.q[0], np.degrees(one.imus[0].gyro_bias[0]))[:2]
        offsets.append((e - bias / kp).mean(axis=0))
        spread.append(((e - bias / kp) ** 2).mean())
    assert math.sqrt(np.mean(spread)) == pytest.approx(wanted, rel=0.2)
    assert np.abs(offsets).max() < 4.0 * wanted
