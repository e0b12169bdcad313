"""What a smoothed run says of its own errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.filters.navigation.attitude import HONEST, LEAST_HEADING, LEAST_TILT, sigmas
from attlog.estimators.filters.navigation.passes.jumps import Jump

T = np.arange(0.0, 20.0, 0.1)
OWN = np.radians([0.3, 0.4, 0.7])


def run(q: np.ndarray) -> tuple[Any, Any]:
    """A run at rest with a node at every sample."""
    inputs = SimpleNamespace(t=T, sensed_at=T, gyr=np.zeros((len(T), 3)))
    return inputs, SimpleNamespace(schedule=SimpleNamespace(node_at=np.arange(len(T))), q=np.tile(q, (len(T), 1)))


def test_tilt_holds_two_axes_and_heading_the_third() -> None:
    tilt, heading = sigmas(*run(np.array([1.0, 0, 0, 0])), np.tile(OWN**2, (len(T), 1)))
    assert tilt == pytest.approx(np.hypot(HONEST * np.radians(0.5), LEAST_TILT))
    assert heading == pytest.approx(np.hypot(HONEST * np.radians(0.7), LEAST_HEADING))


@pytest.mark.parametrize(("roll", "tilted", "turned"), [(0.0, 0.0, 1.0), (90.0, 1.0, 0.0)])
def test_near_a_jump_what_it_turns_in_its_sigma_is_added_about_its_axis(roll: float, tilted: float, turned: float):
    """2 deg/s about the body's z, known to 0.5 s: 1 deg, of heading while level, of tilt on the side."""
    spread = np.tile(OWN**2, (len(T), 1))
    at = run(rotation.from_euler(np.radians(roll), 0.0, 0.0))
    jump = Jump(10.0, 0.5, np.radians([0.0, 0.0, 2.0]), np.zeros(3))
    near = np.abs(T - 10.0) <= 1.0 + 1e-9
    for with_jump, without, more in zip(
        sigmas(*at, spread, [jump]), sigmas(*at, spread), (tilted, turned), strict=True
    ):
        added = np.degrees(np.sqrt(with_jump**2 - without**2))
        assert added[near] == pytest.approx(more, abs=1e-6)
        assert added[~near] == pytest.approx(0.0, abs=1e-6)
