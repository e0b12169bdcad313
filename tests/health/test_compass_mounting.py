"""A vehicle flown on a wrongly set compass: the parameter is named with its value and the offsets that belong to it."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest

from attlog import flight, segments
from attlog.flight.calibration import mounting_matrix
from attlog.flight.model import FlightLog, TimeLine
from attlog.health import compass_mounting
from attlog.health.check import Check, HealthCase
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.logs.ardupilot import CALIBRATED_MG
from attlog.simulate.scenario import load_scenario

HARD_IRON_UT = (4.0, -3.0, 2.0)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory):
    scenario = load_scenario("compass-turned")
    (mag,) = scenario.sensors.mag
    scenario = scenario.changed(
        sensors=dataclasses.replace(scenario.sensors, mag=[dataclasses.replace(mag, hard_iron_ut=HARD_IRON_UT)])
    )
    folder, made = tmp_path_factory.mktemp("turned"), fly(scenario, 1)

    @functools.cache
    def path(suffix: str) -> Path:
        write(folder / f"turned{suffix}", made)
        return folder / f"turned{suffix}"

    return lambda suffix: flight.read(path(suffix))


def checked(log: FlightLog) -> Check:
    (check,) = compass_mounting.orientation_checks(HealthCase(log, segments.build(log)))
    return check


def test_ardupilot_gets_orientation_and_offsets_of_the_true_axes(flown) -> None:
    check = checked(flown(".bin"))
    assert check.verdict == "fault"
    new = {setting.name: setting.new for setting in check.settings}
    assert new.pop("COMPASS_ORIENT") == 6
    expected = mounting_matrix(6) @ CALIBRATED_MG - 10.0 * np.array(HARD_IRON_UT)
    assert [new[f"COMPASS_OFS_{axis}"] for axis in "XYZ"] == pytest.approx(expected, abs=12.0)
    assert check.ci95 is not None
    assert check.ci95[0] < 90.0 < check.ci95[1]


def test_px4_is_calibrated_where_a_learned_bias_is_not_logged(flown) -> None:
    check = checked(flown(".ulg"))
    assert check.settings == []
    assert "CAL_MAG0_ROT 6" in check.action
    assert "calibrate" in check.action


def changed(log: FlightLog, name: str, value: float) -> FlightLog:
    log.parameters.lines[name] = TimeLine(np.zeros(1), [value], "made")
    return log


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("COMPASS_DIA_X", 1.2, "Set COMPASS_ORIENT 6, and calibrate"), ("COMPASS_EXTERNAL", 0.0, "orientation 6")],
)
def test_a_mounting_is_never_set_without_its_offsets(flown, name: str, value: float, said: str) -> None:
    check = checked(changed(flown(".bin"), name, value))
    assert check.verdict == "fault"
    assert check.settings == []
    assert said in check.action
    assert check.why_no_setting


def test_a_named_mounting_silences_what_follows_from_it(flown) -> None:
    log = flown(".bin")
    case = HealthCase(log, segments.build(log))
    beside = [
        Check(question, "warning", "") for question in ("compass_offset", "field", "compass_choice", "compass_dead")
    ]
    assert compass_mounting.without_explained(case, beside) == beside
    case.found = [checked(log)]
    assert [check.question for check in compass_mounting.without_explained(case, beside)] == ["compass_dead"]
