"""With which field and turns a navigation filter starts: closed forms in every axis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.estimators.filters.navigation import start


@pytest.mark.parametrize("count", [1, 10, 40])
def test_without_a_model_the_field_is_that_of_the_first_samples_and_points_to_magnetic_north(count: int) -> None:
    """Of forty samples the first twenty-five count."""
    q = rotation.from_euler(0.3, -0.2, 1.9)
    earth = np.array([0.15, -0.13, 0.41])
    seen = np.tile(rotation.rotate_inverse(q, earth), (count, 1))
    seen[25:] *= 9.0
    mag = SimpleNamespace(t=np.arange(float(count)), x=seen)
    inputs: Any = SimpleNamespace(field=None, mag=mag)
    np.testing.assert_allclose(start._field(inputs, q), [np.hypot(0.15, 0.13), 0.0, 0.41], atol=1e-12)
    inputs.field = (0.2, 0.01, 0.4)
    np.testing.assert_array_equal(start._field(inputs, q), [0.2, 0.01, 0.4])
    np.testing.assert_array_equal(start._field(SimpleNamespace(field=None, mag=None), q), np.zeros(3))  # type: ignore[arg-type]


def test_turns_by_the_gyro_follow_each_other_from_the_first_sample_on() -> None:
    rng = np.random.default_rng(3)
    gyr, dt = rng.normal(size=(30, 3)) * [3.0, 1.0, 2.0], rng.uniform(0.01, 0.05, 30)
    found = start.turned_by_gyro(gyr, dt)
    q = Rotation.identity()
    np.testing.assert_allclose(np.abs(found[0]), [1.0, 0.0, 0.0, 0.0], atol=1e-12)
    for k in range(1, 30):
        q = q * Rotation.from_rotvec(gyr[k] * dt[k])
        assert abs(found[k] @ np.roll(q.as_quat(), 1)) == pytest.approx(1.0, abs=1e-12)
