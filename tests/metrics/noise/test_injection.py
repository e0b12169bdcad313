import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.metrics.noise import injection

STEP = 0.01
T = np.arange(0.0, 5.0, STEP)


def turned(rates_dps, start=(1.0, 0.0, 0.0, 0.0)):
    """Attitudes (n, 4) of body rates (n, 3) in deg/s, integrated by scipy."""
    q = Rotation.from_quat(np.roll(start, -1))
    found = []
    for rate in np.radians(rates_dps):
        found.append(np.roll(q.as_quat(), 1))
        q = q * Rotation.from_rotvec(rate * STEP)
    return np.array(found)


def alone(q, t=T):
    return injection.GyroAttitude(t, q, np.zeros(len(t), np.int64))


def swaying(amplitude_deg=8.0):
    """Rates of a vehicle that sways about all axes within some degrees of its mean attitude."""
    w = 2 * np.pi * np.array([0.7, 0.9, 0.4])
    return amplitude_deg * w * np.cos(w * T[:, None])


@pytest.mark.parametrize("heading", [0.0, 90.0, -135.0])
def test_what_is_pushed_in_is_told_about_roll_pitch_and_the_vertical(heading):
    start = rotation.from_euler(0.0, 0.0, np.radians(heading))
    q_g = turned(swaying(), start)
    pushed = np.radians(np.column_stack([0.3 * np.sin(9 * T), 0.2 * np.sin(7 * T), 0.1 * np.sin(11 * T)]))
    forward = rotation.rotate(start, pushed)  # about the vehicle's level axes, as the earth sees them
    q = rotation.multiply(rotation.from_rotvec(forward), q_g)
    found = injection.residual(T, q, alone(q_g), 20.0)
    expected = np.degrees(pushed) - np.degrees(pushed).mean(axis=0)
    np.testing.assert_allclose(found.std(axis=0), expected.std(axis=0), rtol=0.03)
    for axis in range(3):
        assert np.corrcoef(found[:, axis], expected[:, axis])[0, 1] > 0.98


def test_the_vehicles_own_motion_and_a_constant_turn_in_between_are_no_noise():
    q_g = turned(swaying())
    apart = rotation.from_euler(0.1, -0.05, 2.5)  # the gyro alone has lost its heading long ago
    assert np.abs(injection.residual(T, rotation.multiply(apart, q_g), alone(q_g), 20.0)).max() < 1e-9


def test_a_constant_offset_of_the_gyro_in_body_axes_is_no_noise_while_the_vehicle_turns():
    """Swaying makes a curve of it, in which a straight line would leave noise."""
    rates = swaying()
    q_g, q = turned(rates), turned(rates - [2.4, -1.5, 1.8])
    found = injection.residual(T, q, alone(q_g), 20.0)
    line = np.degrees(rotation.to_rotvec(rotation.error(q, q_g)))
    u = T - T.mean()
    line = line - line.mean(axis=0) - np.outer(u, u @ line / (u @ u))
    assert found.std(axis=0).max() < 0.01
    assert line.std(axis=0).max() > 0.05


def test_a_window_in_which_the_vehicle_turns_too_far_is_not_used():
    rates = np.zeros((len(T), 3))
    rates[:, 2] = 12.0
    q_g = turned(rates)  # 60 deg in the window, 30 about its mean
    assert injection.residual(T, q_g, alone(q_g), 20.0) is None
    assert injection.residual(T, q_g, alone(q_g), 31.0) is not None


def test_rows_at_other_times_are_met_by_interpolation_and_restarts_are_not_crossed():
    q_g = turned(swaying())
    own = T[:-1:4] + 0.003
    q = rotation.slerp(T, q_g, own)
    assert np.abs(injection.residual(own, q, alone(q_g), 20.0)).max() < 1e-9
    restarted = injection.GyroAttitude(T, q_g, (T > 2.5).astype(np.int64))
    assert injection.residual(own, q, restarted, 20.0) is None
    assert injection.residual(own + 1.0, q, alone(q_g), 20.0) is None
