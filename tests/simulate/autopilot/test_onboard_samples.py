"""Samples one by one: what time each of them is integrated over."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.simulate.autopilot.onboard_samples import Cleaner

GYR, ACC = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize(("step", "own", "dt"), [(0.0102, 0.01, 0.01), (0.03, 0.01, 0.03), (0.012, 0.0, 0.012)])
def test_a_sample_is_integrated_over_its_own_time_unless_others_were_lost_before_it(
    step: float, own: float, dt: float
) -> None:
    cleaner = Cleaner(100.0, None, hold_mag=False, instant=False, aids=None)
    first, second = (cleaner.cleaned(t, GYR, ACC, None, own) for t in (5.0, 5.0 + step))
    assert first is not None
    assert second is not None
    assert (first.dt, second.dt) == (0.0, pytest.approx(dt))
