"""What the covariance of ``mekf`` leaves out, on corrections whose statistics are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.estimators.filters.inertial import doubt
from attlog.estimators.filters.inertial.layout import DV, EXCESS, N, P, T, X

BLOCK_S = 1.0
FADE = math.exp(-BLOCK_S / doubt.SLOW_TIME)


def excess(innovations: np.ndarray) -> float:
    """The mean excess after 100 s of what a velocity, whose innovations (n,) have sigma 1, corrects in tilt."""
    state = [0.0] * 1000
    state[T] = BLOCK_S
    gains = 0.01, 0.02
    state[P + N * DV : P + N * DV + 2] = gains  # covariance of the velocity with either tilt
    state[P + (N + 1) * DV] = 0.4
    found = []
    for innovation in innovations.tolist():
        doubt.fade_slow(state)
        doubt.add_slow_variance(state, DV, 0.6)
        state[X : X + 2] = [gain * innovation for gain in gains]
        doubt.weigh_slow(state)
        found.append(state[EXCESS])
    return float(np.mean(found[100:]))


def test_corrections_that_are_white_noise_have_no_excess() -> None:
    assert excess(np.random.default_rng(1).standard_normal(20_000)) == pytest.approx(1.0, abs=0.15)


def test_corrections_that_last_exceed_by_what_two_geometric_series_say() -> None:
    """(sum of f^k)^2 over the sum of f^2k is (1 + f) / (1 - f), here 10."""
    assert excess(np.ones(400)) == pytest.approx((1.0 + FADE) / (1.0 - FADE), rel=0.02)
