"""Other onboard attitudes beside the one that flew: made ones that agree, differ, or never ran."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude
from attlog.health.onboard import sources
from attlog.segments.model import Segments

T = np.arange(0.0, 60.0, 0.1)


def swaying(size_deg: float, heading_deg: float = 0.0) -> Attitude:
    """An attitude that rolls by ``size_deg`` every 7 s."""
    roll = np.radians(size_deg) * np.sin(2.0 * np.pi * T / 7.0)
    heading = np.full(len(T), np.radians(heading_deg))
    return Attitude(T, rotation.from_euler(roll, np.zeros(len(T)), heading), "ATTITUDE")


def test_a_source_that_never_ran_differs_from_nobody() -> None:
    assert sources.difference(swaying(20.0), swaying(0.0, 55.0), Segments()) is None


@pytest.mark.parametrize("size_deg", [20.0, 0.5])
def test_a_source_with_another_heading_differs_by_it(size_deg: float) -> None:
    found = sources.difference(swaying(size_deg), swaying(size_deg, 55.0), Segments())
    assert found is not None
    assert found.heading == pytest.approx(55.0, abs=0.5)
