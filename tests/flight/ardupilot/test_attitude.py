"""Which of ArduPilot's attitudes flew."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.ardupilot.attitude import onboard


@pytest.mark.parametrize(
    ("ang_hz", "ang_until_s", "flew"),
    [(400.0, 60.0, "ANG"), (25.0, 60.0, "ANG"), (10.0, 60.0, "ATT"), (400.0, 50.0, "ATT")],
)
def test_ang_flew_where_it_is_no_slower_than_att_and_covers_its_time(
    ang_hz: float, ang_until_s: float, flew: str
) -> None:
    found: dict[str, Any] = {
        "ATT": SimpleNamespace(t=np.arange(0.0, 60.0, 0.04)),
        "ANG": SimpleNamespace(t=np.arange(0.0, ang_until_s, 1.0 / ang_hz)),
    }
    assert onboard(found, "XK", 0) == flew
    assert onboard({"AHR2": found["ATT"], "XKQ.1": found["ATT"]}, "XK", 1) == "XKQ.1"
