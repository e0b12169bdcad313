"""Noise levels from the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.estimators import Aids
from attlog.estimators.filters.navigation.calibration import WHITE_FACTOR, first_guess
from attlog.estimators.filters.navigation.measured import made_ready
from attlog.estimators.filters.navigation.settings import NoiseLevels


def test_white_noise_is_found_whatever_the_motion_and_its_level_is_sigma_over_the_root_of_the_rate() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 60.0, 0.01)
    slow = np.sin(np.outer(t, [0.5, 0.4, 0.3]))
    gyr = slow + 0.02 * rng.standard_normal((len(t), 3))
    acc = slow + [0.0, 0.0, -9.81] + 0.3 * rng.standard_normal((len(t), 3))
    found = first_guess(made_ready(t, gyr, acc, np.full_like(acc, np.nan), Aids(), 0.0, ahead=True), NoiseLevels())
    assert found.gyro == pytest.approx(WHITE_FACTOR * 0.02 * 0.1, rel=0.05)
    assert found.acc == pytest.approx(WHITE_FACTOR * 0.3 * 0.1, rel=0.05)
