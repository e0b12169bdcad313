"""The figure of the field against the motors: the planted slope, and nothing where no drive varies."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Stream
from attlog.health.figures.interference import POINTS, interference, of_arrays
from attlog.reference import declination
from tests.health.figures.made import AIR, T, case, log


def test_the_line_has_the_planted_slope_and_starts_at_nothing():
    made = log(per_ampere=0.2)
    trace = interference(case(made))[0]
    down = declination.model(made).ned_t[2] / declination.model(made).strength_t
    assert trace.key == "current"
    assert trace.values["slope"] == pytest.approx(0.2 * down, rel=0.02)
    assert trace.values["start"] == pytest.approx(0.0, abs=0.1)
    assert trace.values["r"] > 0.99
    assert len(trace.t) <= POINTS


def test_a_drive_that_does_not_vary_or_is_not_logged_gives_no_figure():
    made = log(per_ampere=0.2)
    made.battery.x[:, 1] = 20.0
    assert interference(case(made)) == []
    made.battery = None
    assert interference(case(made)) == []


def test_the_throttle_stands_in_for_the_current_in_percent():
    made = log()
    made.battery = None
    share = np.where((T > AIR[0]) & (T < AIR[1]), 0.5 + 0.2 * np.sin(T), 0.0)
    made.throttle = Stream(T, share[:, None], "1", "", "CTUN")
    trace = interference(case(made))[0]
    assert trace.key == "throttle"
    assert trace.t.max() == pytest.approx(70.0, abs=0.1)


def test_nothing_after_the_crash_is_drawn():
    made = log()
    made.mags[0].field.x[T > 50] *= 3.0
    assert np.abs(interference(case(made, crash=50.0))[0].columns["residual"]).max() < 1.0


def test_the_line_is_that_of_numpy_over_all_points_also_of_those_not_drawn():
    random = np.random.default_rng(4)
    x = random.uniform(0, 40, 5000)
    y = 3.0 - 0.4 * x + random.normal(0, 1, 5000)
    trace = of_arrays("current", x, y, 100.0)
    np.testing.assert_allclose([trace.values["slope"], trace.values["start"]], np.polyfit(x, y, 1))
    assert trace.values["r"] == pytest.approx(np.corrcoef(x, y)[0, 1])
    assert len(trace.t) <= POINTS
