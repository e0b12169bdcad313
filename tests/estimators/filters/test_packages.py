"""The adapters to other people's packages: what they report, and that settings mean what their units say."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.estimators import estimate
from attlog.testing import Noise, still
from attlog.testing.subject import inclination_deg


def biased(deg_s: float, seconds: float = 60.0) -> tuple[np.ndarray, ...]:
    """Rest with a gyro bias in roll; true attitude first."""
    m = still(seconds, 50.0, noise=Noise(gyro=1e-4, acc=0.003, bias=(np.deg2rad(deg_s), 0.0, 0.0)))
    return m.q, m.t, m.gyr, m.acc


def test_vqf_tells_when_the_bias_exceeds_its_clip() -> None:
    _, *sensors = biased(4.0)
    assert estimate("vqf@package", *sensors).skipped["bias_beyond_clip"] > 1000
    assert "bias_beyond_clip" not in estimate("vqf:bias_clip=10", *sensors).skipped


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_fusion_settles_where_gain_and_gyro_bias_balance(gain: float) -> None:
    """sin(error) = bias / gain, with gain in 1/s."""
    q, *sensors = biased(4.0)
    seen = inclination_deg(estimate(f"fusion:gain={gain}", *sensors).q[-100:], q[-100:])
    assert np.median(np.abs(seen)) == pytest.approx(np.rad2deg(np.arcsin(np.deg2rad(4.0) / gain)), rel=0.05)


def test_fusion_s_timeout_is_in_seconds() -> None:
    """With 8 deg/s the accelerometer is soon left out; it comes back after the timeout or never."""
    q, *sensors = biased(8.0)
    soon, never = (inclination_deg(estimate(f"fusion@example:timeout={s}", *sensors).q, q).max() for s in (1, 1000))
    assert soon < 60.0
    assert never > 120.0
