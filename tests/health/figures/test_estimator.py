"""The figure of the test ratios: no peak is lost, what was never tested is not drawn, nothing of a wreck."""

from __future__ import annotations

import numpy as np

from attlog.health.figures import traces
from attlog.health.figures.estimator import of_arrays, ratios
from attlog.health.figures.samples import MOST
from tests.health.figures.made import T, case, innovations, log


def test_of_a_long_log_the_largest_ratios_stay():
    ratio = np.random.default_rng(5).uniform(0, 0.5, 100_000)
    ratio[77_777] = 8.0
    ratio[::3] = np.nan
    ratio[77_777] = 8.0
    trace = of_arrays("compass", 0.1 * np.arange(len(ratio)), ratio)
    assert len(trace.t) <= MOST
    assert trace.columns["ratio"].max() == 8.0
    assert abs(trace.t[np.argmax(trace.columns["ratio"])] - 7777.7) < 10.0
    assert np.isfinite(trace.columns["ratio"]).all()


def test_an_aid_that_was_never_tested_is_not_drawn_and_a_wreck_is_none_of_flight():
    made = log()
    made.innovation_tests = [
        innovations(np.where(T > 50, 9.0, 0.2)),
        innovations(0 * T, "airspeed"),
        innovations(np.nan * T, "height"),
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
