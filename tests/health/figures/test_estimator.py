"""The figure of the test ratios: what was never used is not drawn, nothing of a wreck, no error without anything."""

from __future__ import annotations

import numpy as np

from attlog.health.figures import traces
from attlog.health.figures.estimator import ratios
from tests.health.figures.made import T, case, innovations, log


def test_an_aid_that_was_never_used_is_not_drawn_and_a_wreck_is_none_of_flight():
    made = log()
    made.innovation_tests = [
        innovations(np.where(T > 50, 9.0, 0.2)),
        innovations(0 * T, "airspeed"),
        innovations(np.nan * T, "height"),
        innovations(np.where(T > 50, 9.0, 0.0), "velocity"),
    ]
    found = ratios(case(made, crash=50.0))
    assert [trace.key for trace in found] == ["compass"]
    assert found[0].columns["ratio"].max() == 0.2


def test_a_log_with_nothing_but_an_attitude_gives_no_figure_and_no_error():
    made = log()
    made.mags, made.mag, made.battery, made.gnss = [], None, None, []
    asked = case(made, None)
    asked.segments = asked.reference = None
    assert traces(asked, []) == []
