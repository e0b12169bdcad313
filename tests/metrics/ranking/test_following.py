"""Whether a row follows motion."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.ranking import following

T = np.arange(0.0, 60.0, 0.02)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_resets_of_the_reference_are_no_motion_that_a_row_has_to_follow(gain: float) -> None:
    """It swings by 40 deg about each axis, and the reference jumps by 50 deg every 3 s."""
    swing = np.radians(40.0) * np.sin(np.outer(T, [0.9, 0.0, 0.0]))
    q_est = rotation.from_rotvec(gain * swing)
    segment = (T // 3.0).astype(np.int64)
    jumped = np.radians(50.0) * segment[:, None] * np.array([1.0, 0.0, 0.0])
    turned = rotation.increments(rotation.from_rotvec(swing + jumped))
    found = following._gains_of(T, q_est, turned, segment)
    assert found[[0, 3]] == pytest.approx(gain, rel=1e-3)
    assert np.isnan(found[1:3]).all()
