"""What is known of now by an attitude and a bias of a while ago, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.filters.navigation import turns


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_attitude_of_before_is_carried_on_by_the_rate_less_the_bias_that_is_known_of_it(axis: int) -> None:
    """Constant rates about one axis, five samples and a lag of 30 ms ahead; at the start another bias was known."""
    n, rate, known, lag = 40, 0.8, 0.3, 0.03
    dt, along = np.full(n, 0.01), np.eye(3)[axis]
    then = np.maximum(np.arange(n) - 5, 0)
    q = rotation.multiply(
        np.tile(rotation.from_euler(0.3, -0.2, 1.0), (n, 1)),
        rotation.from_rotvec((rate - known) * 0.01 * np.arange(n)[:, None] * along),
    )
    out, scratch = np.empty((n, 4)), [np.zeros(shape) for _, shape in turns.SCRATCH.values()]
    gyr, bias = np.tile(rate * along, (n, 1)), np.tile(known * along, (n, 1))
    rest, ring = np.zeros(n, np.int8), np.zeros((8, turns.RING))
    turns.ahead(then, dt, gyr, rest, lag, q, bias, np.array([0.05, -0.1, 0.2]) * along, ring, out, *scratch)
    seconds = 0.01 * (np.arange(n) - then) + lag
    wanted = rotation.multiply(q[then], rotation.from_rotvec((rate - known) * seconds[:, None] * along))
    apart = rotation.total_angle(rotation.error(out, wanted))
    assert apart == pytest.approx(np.zeros(n), abs=1e-9)
