"""Filters at rest have errors in closed form; simulated flights of known noise must show them.

These are the sizes that the thresholds of the conformance checks stand on: what a filter cannot
be better than, given noise as in ``attlog.testing.motion.CONSUMER``.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import attlog
from attlog.base import rotation
from attlog.simulate.flight import Flight
from attlog.simulate.physics.streams import generator
from attlog.testing.motion import CONSUMER, FIELD_T, GRAVITY
from tests.conftest import few
from tests.simulate.statistical import ACC_UG_RTHZ, GYRO_DPS_RTHZ, MAG_UT_RTHZ, RATE, still
from tests.simulate.still import flown

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
    e = rotation.error(found.q, flight.truth.q[:1])
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
@pytest.mark.parametrize("kp", few([0.3, 1.0, 3.0], 1))
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


def test_the_conformance_checks_leave_room_above_what_noise_alone_does() -> None:
    """Their 1 deg of tilt and 3 deg of heading at rest are 5.5 and 2.5 sigma of single samples of CONSUMER's noise."""
    tilt = math.degrees(CONSUMER.acc * math.sqrt(100.0) / GRAVITY)
    heading = math.degrees(CONSUMER.mag / FIELD_T[0])
    assert 1.0 / tilt > 5.5
    assert 3.0 / heading > 2.5
    # A gyro alone after the 30 s of that check, its bias known.
    assert math.degrees(CONSUMER.gyro * math.sqrt(30.0)) < 0.1
    assert generator(0, "a").random() != generator(0, "b").random()
