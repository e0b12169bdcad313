"""ArduPilot's drift correction as a function of its state: no north is special, and the bias has its limit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators.aids import SIZE, VEL_D, VEL_E, VEL_N
from attlog.estimators.filters import ap_dcm as dcm

TILT = Rotation.from_euler("ZYX", [0.0, -0.2, 0.35])
FORCE = np.array([0.4, -1.1, -9.5])
"""Mean specific force, m/s^2, in the axes of a vehicle that looks north."""
BEFORE_M_S = np.array([9.0, 1.5, -0.4])
GPS_M_S = np.array([10.0, 2.5, -0.7])


def corrected(heading: float, fix: bool, forward: bool, gain: float = 1.0) -> np.ndarray:
    """State after one correction of a vehicle at a heading, its force and velocities turned with it."""
    turn = Rotation.from_euler("Z", heading)
    state = np.zeros(40)
    state[:4] = np.roll((turn * TILT).as_quat(), 1)
    state[dcm.SUM : dcm.SUM + 3] = 0.3 * turn.apply(FORCE)
    state[dcm.SUM_TIME], state[dcm.AIR], state[dcm.EVERY] = 0.3, 11.0, 0.2
    state[dcm.FIX_AGE] = 0.0 if fix else dcm.NEVER
    state[dcm.VELOCITY : dcm.VELOCITY + 3] = turn.apply(BEFORE_M_S)
    state[dcm.LOCK] = 1.0 if fix else -1.0
    params = np.array([0.2, 0.2, gain, 1.0, 1.0, 400.0, float(forward), 0.0])
    aid = np.full(SIZE, np.nan)
    if fix:
        aid[[VEL_N, VEL_E, VEL_D]] = turn.apply(GPS_M_S)
    dcm.correct_tilt(state, params, 0.01, np.zeros(3), aid, fix, False, 1.0, 0.0)
    return state


def wanted(fix: bool, forward: bool, gain: float = 1.0) -> np.ndarray:
    """f x t in body axes: t is gravity less the change of velocity, in g."""
    velocity = GPS_M_S if fix else 11.0 * TILT.as_matrix()[:, 0]
    target = np.array([0.0, 0.0, -1.0])
    if fix or forward:
        target = target + gain * (velocity - BEFORE_M_S) / (0.3 * 9.80665)
    error = np.cross(FORCE, target) / np.linalg.norm(FORCE) / np.linalg.norm(target)
    return 0.2 * TILT.inv().apply(error)


@pytest.mark.parametrize("heading", [0.0, 0.9, -2.4])
@pytest.mark.parametrize(("fix", "forward"), [(True, False), (True, True), (False, True), (False, False)])
def test_the_correction_is_the_same_in_body_axes_whatever_the_heading(heading: float, fix: bool, forward: bool) -> None:
    state = corrected(heading, fix, forward)
    np.testing.assert_allclose(state[dcm.P : dcm.P + 3], wanted(fix, forward), atol=1e-9)
    velocity = GPS_M_S if fix else 11.0 * TILT.as_matrix()[:, 0]
    turned = Rotation.from_euler("Z", heading).apply(velocity)
    np.testing.assert_allclose(state[dcm.VELOCITY : dcm.VELOCITY + 3], turned, atol=1e-9)
    assert not state[dcm.SUM : dcm.SUM + 3].any()
    if fix:
        assert state[dcm.AIR] == pytest.approx(TILT.as_matrix()[:, 0] @ GPS_M_S)


def test_the_gain_of_gnss_scales_the_acceleration_that_is_taken_out() -> None:
    for gain in (0.0, 0.5):
        np.testing.assert_allclose(
            corrected(0.9, True, False, gain)[dcm.P : dcm.P + 3], wanted(True, False, gain), atol=1e-9
        )


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("error", [1e-4, 0.9, -0.9])
def test_the_bias_is_learnt_in_slow_turns_after_five_seconds_up_to_its_limit(axis: int, error: float) -> None:
    vector = np.zeros(3)
    vector[axis] = error
    for spin, learns in ((np.radians(19.0), True), (np.radians(21.0), False)):
        state = np.zeros(40)
        state[dcm.SUM_TIME] = 1.0
        for _ in range(4):
            dcm.learn_bias(state, *vector, spin)
        assert not state[4:7].any()
        dcm.learn_bias(state, *vector, spin)
        limit = np.radians(0.5 / 60.0) * 5.0
        learnt = -np.clip(5.0 * 0.0087 * vector, -limit, limit) if learns else np.zeros(3)
        np.testing.assert_allclose(state[4:7], learnt, atol=1e-12)
        assert not state[dcm.I_SUM : dcm.I_SUM + 3].any() or not learns
        assert state[dcm.I_TIME] == 0.0


@pytest.mark.parametrize(
    ("age", "every", "known"),
    [(0.59, 0.1, True), (0.61, 0.1, False), (2.9, 1.0, True), (3.1, 1.0, False), (3.9, 5.0, True), (4.1, 5.0, False)],
)
def test_fixes_are_lost_after_three_intervals_or_four_seconds(age: float, every: float, known: bool) -> None:
    state = np.zeros(40)
    state[dcm.FIX_AGE], state[dcm.EVERY] = age, every
    assert dcm.has_gnss(state) is known
