"""The figure of the field: expected by a turned model, corrected only where an offset can be set."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.assessments.model import Assessment, Setting
from attlog.health.figures.field import field
from attlog.health.figures.samples import MOST
from tests.health.figures.made import T, case, log

OFFSET = (12.0, -3.0, 5.0)


def offered(unit: str = "uT", settings: list[Setting] | None = None) -> Assessment:
    """An offset of the compass, with something to set."""
    scale = 10.0 if unit == "mG" else 1.0
    vector = [scale * x for x in OFFSET]
    setting = [Setting("COMPASS_OFS_X", 0.0, -120.0)] if settings is None else settings
    return Assessment("MAG:0", "compass_offset", "fault", "Off.", 13.0, unit, vector=vector, settings=setting)


def off(trace, part: str) -> np.ndarray:
    """Mean of a part less what is expected, uT."""
    return np.array([np.nanmean(trace.columns[part + a] - trace.columns["expected_" + a]) for a in "xyz"])


def test_measured_less_expected_is_the_planted_offset_at_every_sample():
    trace = field(case(log(OFFSET)), [])[0]
    np.testing.assert_allclose(off(trace, ""), OFFSET, atol=1e-6)
    assert np.ptp(trace.columns["expected_x"]) > 30
    assert trace.key == "MAG:0"
    assert trace.values == {"by_motion": 1.0}
    assert "corrected_x" not in trace.columns


@pytest.mark.parametrize("unit", ["uT", "mG"])
def test_corrected_lies_on_expected_where_the_offset_is_offered(unit):
    trace = field(case(log(OFFSET)), [offered(unit)])[0]
    np.testing.assert_allclose(off(trace, "corrected_"), 0.0, atol=1e-6)


def test_an_offset_without_anything_to_set_corrects_nothing():
    assert "corrected_x" not in field(case(log(OFFSET)), [offered(settings=[])])[0].columns


@pytest.mark.parametrize("sigma", [None, 30.0])
def test_without_a_sure_heading_by_motion_the_reference_turns_the_field(sigma):
    trace = field(case(log(), sigma), [])[0]
    assert trace.values == {"by_motion": 0.0}
    assert np.nanmax(np.abs(trace.columns["x"] - trace.columns["expected_x"])) > 20


def test_it_ends_at_the_crash_keeps_few_samples_and_breaks_at_pauses():
    assert field(case(log(), crash=40.0), [])[0].t[-1] < 40.0
    made = log()
    made.mags[0].field.t = np.where(T > 50, T + 30.0, T)
    made.attitudes["ATT"].t = made.mags[0].field.t
    asked = case(made)
    asked.reference = None
    asked.smooth = lambda: None
    trace = field(asked, [])[0]
    assert len(trace.t) <= MOST
    assert np.isnan(trace.columns["x"]).sum() == 1


def test_without_place_compass_or_attitude_there_is_no_figure():
    nowhere, blind, lost = log(), log(), case(log(), None)
    nowhere.gnss, blind.mag = [], None
    lost.reference.kind = "none"
    assert field(case(nowhere), []) == field(case(blind), []) == field(lost, []) == []
    unsure = case(log(), None)
    unsure.reference.heading_by = "nobody"
    assert field(unsure, []) == []


def test_damaged_fields_are_left_out():
    made = log(OFFSET)
    made.mags[0].field.x[::7] = np.nan
    trace = field(case(made), [])[0]
    np.testing.assert_allclose(off(trace, ""), OFFSET, atol=1e-6)
    made.mags[0].field.x[:] = np.nan
    assert field(case(made), []) == []


def test_a_vehicle_that_stands_in_the_air_has_no_heading_by_motion():
    made = log()
    made.gnss[0].vel_ned[:, 0] *= 0.1
    assert field(case(made), [])[0].values == {"by_motion": 0.0}
    made.gnss[0].vel_ned[:] = np.nan
    assert field(case(made), [])[0].values == {"by_motion": 0.0}
