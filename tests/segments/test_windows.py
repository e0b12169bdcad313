"""Windows of the IMU: none reaches, and none is joined, across a gap."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.segments import windows


def test_windows_on_both_sides_of_a_gap_are_not_joined_however_short_it_is() -> None:
    """A gap is told from 50 ms on; less than a tenth of a window stands between the two windows."""
    t = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(2.045, 4.0, 0.01)])
    still = windows.build(t, np.zeros((len(t), 3)), np.tile([0.0, 0.0, -9.8], (len(t), 1)))
    (before, after) = windows.join(still, np.ones(len(still.t0), bool))
    assert (before, after) == (pytest.approx((0.0, 2.0)), pytest.approx((2.045, 4.0), abs=0.02))
    assert 0.0 < after[0] - before[1] < 0.1 * still.seconds
