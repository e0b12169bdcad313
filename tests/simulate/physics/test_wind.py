"""Gusts by their formula: each adds to the mean wind and to the others."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.simulate.physics.wind import wind_at
from attlog.simulate.scenario.place import Gust, Wind


def test_gusts_that_overlap_add_up() -> None:
    t = np.arange(0.0, 10.0, 0.5)
    gusts = (Gust(t=1.0, seconds=4.0, ned_m_s=(0.0, 6.0, 0.0)), Gust(t=3.0, seconds=4.0, ned_m_s=(2.0, 0.0, -1.0)))
    air = wind_at(Wind(mean_ned_m_s=(1.0, 0.0, 0.0), turbulence_m_s=0.0, gust=gusts), t, 0)
    assert air[t == 3.0][0] == pytest.approx([1.0, 6.0, 0.0])
    assert air[t == 4.0][0] == pytest.approx([2.0, 3.0, -0.5])
    assert air[t == 5.0][0] == pytest.approx([3.0, 0.0, -1.0])
    assert air[t >= 7.0] == pytest.approx(np.tile([1.0, 0.0, 0.0], (6, 1)))
