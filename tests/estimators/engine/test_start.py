"""What a segment starts with is found once for the same samples, and never taken for another segment's or way's."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import estimate
from attlog.estimators.engine import start
from attlog.estimators.engine.samples import PreparedSamples, prepare
from attlog.testing import still

RATE_HZ = 250


def tilting() -> PreparedSamples:
    """Eight seconds of turning, and of a force that turns in the body."""
    t = np.arange(8 * RATE_HZ) / RATE_HZ
    acc = 9.81 * np.column_stack([np.sin(t), np.zeros_like(t), -np.cos(t)])
    return prepare(t, np.column_stack([0.3 * t, 0.1 * t, 0.2 + 0.0 * t]), acc, None)


def test_a_second_run_over_the_same_samples_finds_the_same_start_without_looking_again() -> None:
    samples = tilting()
    seen = start.first(samples, 0, 1000, {})
    with patch.object(start, "first_seconds", side_effect=AssertionError("looked again")):
        assert start.first(samples, 0, 1000, {"init": "average"}) is seen


def test_other_segments_and_another_init_have_their_own_start() -> None:
    samples = tilting()
    asked = [(0, 1000, "average"), (1000, 2000, "average"), (0, 300, "average"), (0, 1000, "first")]
    for a, b, init in [*asked, *asked]:
        alone = start.first(tilting(), a, b, {"init": init})
        np.testing.assert_array_equal(start.first(samples, a, b, {"init": init}).acc, alone.acc)
    found = {start.first(samples, *one[:2], {"init": one[2]}).acc.tobytes() for one in asked}
    assert len(found) == len(asked)


def test_changed_samples_are_looked_at_anew() -> None:
    samples = tilting()
    start.first(samples, 0, 1000, {})
    turned = replace(samples, acc=-samples.acc)
    np.testing.assert_array_equal(start.first(turned, 0, 1000, {}).acc, -start.first(samples, 0, 1000, {}).acc)


def test_the_identity_start_is_level_with_the_nose_to_magnetic_north_unless_an_attitude_is_given() -> None:
    m = still(3.0, roll=0.4, pitch=-0.3, yaw=1.0)
    options = {"kp": 0.0, "ki": 0.0, "init": "identity"}
    level = estimate("mahony", *m.sensors, **options, declination=10.0)
    assert level.q[0] == pytest.approx(rotation.from_euler(0.0, 0.0, np.deg2rad(10.0)))
    assert estimate("mahony", *m.sensors, **options, q0=m.q[0]).q[0] == pytest.approx(m.q[0])
