"""An estimated accelerometer bias: how much it must explain of what gravity shows before it is told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Stream
from attlog.health.sensors import acc_bias
from attlog.segments import Segments


@pytest.mark.parametrize(
    ("bias", "left_deg", "verdict"), [(0.4, 1.9, "warning"), (0.4, 2.1, "ok"), (0.6, 3.9, "fault"), (0.1, 0.0, "ok")]
)
def test_a_bias_is_a_warning_where_it_leaves_less_than_half_of_the_tilt(
    bias: float, left_deg: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """4 deg between the attitude's up and the force at rest; 0.1, 0.4 and 0.6 m/s^2 are 0.6, 2.3 and 3.5 deg."""
    monkeypatch.setattr(acc_bias, "differences", lambda *_: (4.0, left_deg))
    stream = Stream(np.arange(2.0), np.tile([0.0, bias, 0.0], (2, 1)), "m/s^2", "FRD", "bias")
    log: Any = SimpleNamespace(acc_bias=stream, onboard="ATT")
    (found,) = acc_bias.checks(log, Segments())
    assert found.verdict == verdict
    assert bool(found.evidence) is (verdict == "warning")
