"""Vibration second by second: its size, and which seconds count."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.segments.vibration import levels


def test_a_second_that_a_span_cuts_off_counts_for_nothing() -> None:
    """A sine of 2 m/s^2 is 1.41 rms; the last 0.3 s of the span, where it is ten times as large, are no second."""
    t = np.arange(0.0, 8.0, 0.005)
    size = np.where(t < 5.0, 2.0, 20.0)
    acc = np.column_stack([size * np.sin(2.0 * np.pi * 50.0 * t), np.zeros(len(t)), np.full(len(t), -9.8)])
    imu = Imu(0, Stream(t, np.zeros_like(acc), "rad/s", "FRD", "IMU"), Stream(t, acc, "m/s^2", "FRD", "IMU"))
    starts, found = levels(imu, [(0.0, 5.3)])
    assert starts.tolist() == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    assert found[:, 0] == pytest.approx(np.sqrt(2.0), rel=0.05)
    assert found[:, 1] == pytest.approx(0.0, abs=1e-9)
