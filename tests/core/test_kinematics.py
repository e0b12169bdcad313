"""Body rates of an attitude, and the mean force that it turns to earth."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import kinematics, rotation

T = np.arange(0.0, 10.0, 0.01)
ONE = np.zeros(len(T), np.int64)


def spin(rate: list[float]) -> np.ndarray:
    return rotation.from_rotvec(T[:, None] * np.radians(rate))


def test_a_constant_rate_is_found_in_body_axes_over_any_interval() -> None:
    for step, stride in ((1, 1), (7, 3)):
        rates = kinematics.body_rates(T, spin([10.0, -20.0, 30.0]), ONE, step, stride)
        np.testing.assert_allclose(np.degrees(rates.rate), [[10.0, -20.0, 30.0]] * len(rates.rate), atol=1e-9)
        np.testing.assert_allclose(rates.end - rates.start, 0.01 * step)


def test_no_interval_crosses_a_segment_lasts_too_long_or_holds_no_attitude() -> None:
    t, q = np.where(T > 5.0, T + 3.0, T), spin([0.0, 0.0, 10.0])
    q[100] = np.nan
    segment = (T > 8.0).astype(np.int64)
    rates = kinematics.body_rates(t, q, segment, 5, max_s=1.0)
    crosses = (rates.start <= 11.0) & (rates.end > 11.0)
    assert not crosses.any()
    assert (rates.end - rates.start < 1.0).all()
    assert np.isfinite(rates.rate).all()
    assert len(kinematics.body_rates(t[:3], q[:3], segment[:3], 5).start) == 0


def test_the_force_of_a_vehicle_at_rest_points_up_whatever_its_attitude() -> None:
    q = spin([3.0, 5.0, 7.0])
    force = rotation.rotate_inverse(q, np.array([0.0, 0.0, -9.8]))
    mean = kinematics.earth_force(T, force, T, q, None, 50)
    assert mean == pytest.approx([0.0, 0.0, -9.8], abs=1e-6)
    leaning = kinematics.earth_force(T, force, T, rotation.multiply(rotation.from_euler(0.2, 0.0, 0.0), q), ONE)
    assert leaning is not None
    assert kinematics.tilt_deg(leaning) == pytest.approx(np.degrees(0.2), abs=1e-3)
    assert kinematics.earth_force(T + 100.0, force, T, q, None) is None
