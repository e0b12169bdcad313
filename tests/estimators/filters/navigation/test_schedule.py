"""Events in order of time, made from kinds that may be let go of while they are gathered."""

from __future__ import annotations

import numpy as np

from attlog.estimators.filters.navigation.layout import MAG, VELOCITY
from attlog.estimators.filters.navigation.measured import made_ready
from attlog.estimators.filters.navigation.schedule import Timetable
from attlog.estimators.filters.navigation.settings import NoiseLevels
from tests.estimators.filters.navigation.made import flight

COLUMNS = ("node_at", "node_event", "kind", "offset", "z", "f_mean", "w_mean", "sigma", "rest_of", "scalars")


def test_what_is_made_once_is_what_is_made_again_and_again():
    made = flight(seconds=24.0, still=8.0)
    m = made.motion
    inputs = made_ready(m.t, m.gyr, m.acc, m.mag, made.aids, 0.0, ahead=True)
    tuned, table = NoiseLevels(), Timetable(inputs)
    first, second = table.scheduled(tuned, settling=True), table.scheduled(tuned, settling=True)
    once = Timetable(inputs).scheduled(tuned, settling=True, once=True)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        np.testing.assert_array_equal(getattr(first, name), getattr(once, name))
        assert getattr(first, name).dtype == getattr(once, name).dtype
    assert {VELOCITY, MAG} <= set(first.kind.tolist())
    # Each event lies at the sample next to when it was true, and all are in order.
    fixes = np.flatnonzero(first.kind == VELOCITY)
    assert inputs.velocity is not None
    assert len(fixes) == len(inputs.velocity.t)
    np.testing.assert_array_equal(first.z[fixes], inputs.velocity.x)
    assert np.abs(first.offset).max() <= np.diff(inputs.t).max()
