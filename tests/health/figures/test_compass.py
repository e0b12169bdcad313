"""Figures of the compasses: expected by a turned model, corrected only where it is offered, the planted slope."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Mag, Stream
from attlog.health.assessments import compass
from attlog.health.assessments.compass import FieldHistory
from attlog.health.assessments.model import Assessment, Setting
from attlog.health.figures.compass import field, interference, of_points
from attlog.health.figures.samples import MOST
from attlog.reference import declination
from tests.health.figures.made import AIR, T, case, log

OFFSET = (12.0, -3.0, 5.0)
OFFERED = Assessment("MAG:0", "compass_offset", "fault", "Off.", settings=[Setting("COMPASS_OFS_X", 0.0, -120.0)])


def off(trace, part: str = "") -> np.ndarray:
    """Mean of a part less what is expected, uT."""
    return np.array([np.nanmean(trace.columns[part + a] - trace.columns["expected_" + a]) for a in "xyz"])


def test_measured_less_expected_is_the_planted_offset():
    (trace,) = field(case(log(OFFSET)), [])
    np.testing.assert_allclose(off(trace), OFFSET, atol=1e-6)
    assert np.ptp(trace.columns["expected_x"]) > 30
    assert (trace.key, trace.values) == ("MAG:0", {"by_motion": 1.0})
    assert len(trace.t) <= MOST


def test_a_correction_is_drawn_only_where_its_values_are_offered(monkeypatch):
    x = np.zeros((20, 3))
    history = FieldHistory("MAG:0", np.arange(20.0), x + OFFSET, x, x, "motion")
    monkeypatch.setattr(compass, "field_against_expected", lambda asked: [history])
    (trace,) = field(case(log()), [OFFERED])
    np.testing.assert_allclose(off(trace, "corrected_"), 0.0)
    assert "corrected_x" not in field(case(log()), [])[0].columns


@pytest.mark.parametrize("sigma", [None, 30.0])
def test_without_a_sure_heading_by_motion_the_reference_turns_the_field(sigma):
    (trace,) = field(case(log(), sigma), [])
    assert trace.values == {"by_motion": 0.0}
    assert np.nanmax(np.abs(trace.columns["x"] - trace.columns["expected_x"])) > 20


def test_a_vehicle_that_stands_in_the_air_has_no_heading_by_motion():
    made = log()
    made.gnss[0].vel_ned[:, 0] *= 0.01
    assert field(case(made), [])[0].values == {"by_motion": 0.0}


def test_a_heading_that_nobody_knows_turns_no_field():
    unsure, lost, nowhere = case(log(), None), case(log(), None), log()
    unsure.reference.heading_by, lost.reference.kind, nowhere.gnss = "nobody", "none", []
    assert field(unsure, []) == field(lost, []) == field(case(nowhere), []) == []


def test_a_log_that_is_not_replayed_is_drawn_by_its_onboard_attitude():
    asked = case(log(OFFSET), None)
    asked.reference = None
    np.testing.assert_allclose(off(field(asked, [])[0]), OFFSET, atol=1e-6)


def test_the_compass_in_use_comes_first_and_all_end_at_the_crash():
    made = log()
    made.mags.append(Mag(1, Stream(T, made.mags[0].field.x + 1e-5, "T", "FRD", "MAG:1")))
    made.mag = 1
    found = field(case(made, crash=60.0), [])
    assert [trace.key for trace in found] == ["MAG:1", "MAG:0"]
    assert max(trace.t[-1] for trace in found) < 60.0


def test_the_line_has_the_planted_slope_and_starts_at_nothing():
    made = log(per_ampere=0.2)
    (trace,) = interference(case(made))
    down = declination.model(made).ned_t[2] / declination.model(made).strength_t
    assert trace.key == "current"
    assert trace.values["slope"] == pytest.approx(0.2 * down, rel=0.02)
    assert trace.values["start"] == pytest.approx(0.0, abs=0.1)
    assert trace.values["r"] > 0.99
    assert trace.values["seconds"] == pytest.approx(AIR[1] - AIR[0])


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
    (trace,) = interference(case(made))
    assert trace.key == "throttle"
    assert trace.t.max() == pytest.approx(70.0, abs=0.1)


def test_the_line_is_that_of_numpy():
    random = np.random.default_rng(4)
    x = random.uniform(0, 40, 500)
    y = 3.0 - 0.4 * x + random.normal(0, 1, 500)
    trace = of_points("current", x, y, 100.0)
    np.testing.assert_allclose([trace.values["slope"], trace.values["start"]], np.polyfit(x, y, 1))
    assert trace.values["r"] == pytest.approx(np.corrcoef(x, y)[0, 1])
