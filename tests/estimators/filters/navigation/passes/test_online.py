"""`eskf` with a gyro whose bias jumps: found as it happens, errors within sigma soon after, nothing changed before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import estimate
from tests.estimators.filters.navigation.made import flight, off

WHEN, SETTLED_S = 52.0, 6.0


def stepped(made, dps):
    m = made.motion
    return replace(made, motion=replace(m, gyr=m.gyr + np.radians(dps) * (m.t >= WHEN)[:, None]))


@pytest.fixture(scope="module")
def made():
    return flight()


@pytest.mark.parametrize("dps", [[0.0, 0.0, 2.0], [1.5, 0.0, 0.0]])
def test_after_a_jump_errors_are_soon_as_large_as_they_are_said_to_be(made, dps):
    e = estimate("eskf", *stepped(made, dps).motion.sensors, aids=made.aids)
    assert e.quality["gyro_jumps"] == 1.0
    assert e.quality["gyro_jump_s"] == pytest.approx(WHEN, abs=1.0)
    tilt, heading = off(e.q, made.motion.q)
    late = e.t > WHEN + SETTLED_S
    assert np.sqrt(np.mean((heading[late] / e.aux["sigma_heading"][late]) ** 2)) < 2.0
    assert np.sqrt(np.mean((tilt[late] / e.aux["sigma_tilt"][late]) ** 2)) < 2.0
    assert e.bias is not None
    assert e.bias[-1] == pytest.approx(np.add(np.radians(dps), [0.004, -0.003, 0.002]), abs=np.radians(0.1))


def test_a_jump_changes_nothing_that_was_said_before_it(made):
    sound, jumped = (
        estimate("eskf@fixed", *one.motion.sensors, aids=made.aids) for one in (made, stepped(made, [0.0, 0.0, 2.0]))
    )
    before = sound.t < WHEN
    assert np.array_equal(sound.q[before], jumped.q[before])
    assert sound.quality["gyro_jumps"] == 0.0
    assert jumped.quality["gyro_jumps"] >= 1.0


def test_a_field_that_changes_is_no_jump(made):
    m = made.motion
    field = m.mag + 6e-6 * np.outer(m.t >= WHEN, [1.0, -0.6, 0.4])
    e = estimate("eskf", m.t, m.gyr, m.acc, field, aids=made.aids)
    assert e.quality["gyro_jumps"] == 0.0


@pytest.mark.parametrize(("name", "deg"), [("eskf@fixed", 15.0), ("eskf", 40.0)])
def test_a_turned_compass_that_gnss_contradicts_is_no_jump(made, name, deg):
    m = made.motion
    field = rotation.rotate(rotation.from_euler(0.0, 0.0, np.radians(deg)), m.mag)
    e = estimate(name, m.t, m.gyr, m.acc, field, aids=made.aids)
    assert e.quality["gyro_jumps"] == 0.0
