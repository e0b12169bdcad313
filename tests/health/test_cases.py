"""What is wrong with sixteen real logs: analysed by hand (logs/cases/CASES.md of the corpus), and said."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import attlog
from attlog import formats
from attlog.base.errors import LogUnusable
from attlog.flight.model import Problem
from attlog.health.findings import ORDER
from attlog.result import Result
from tests.conftest import corpus_root

FOLDER = None if corpus_root() is None else corpus_root() / "logs" / "cases"
pytestmark = pytest.mark.skipif(FOLDER is None or not FOLDER.is_dir(), reason="needs the corpus")


@cache
def result(name: str) -> Result:
    assert FOLDER is not None
    return attlog.evaluate(attlog.prepare(FOLDER / name))


def said(name: str) -> dict[str, Problem]:
    found = {p.code: p for p in result(name).problems}
    assert len(found) == len({(p.code, p.text) for p in result(name).problems})
    return found


def test_a_gyro_that_turns_at_rest_is_said_first_and_nothing_is_judged() -> None:
    """rover_2.46_61: -24 / -23 deg/s."""
    first = result("rover_2.46_61.BIN").problems[0]
    assert (first.code, first.severity) == ("gyro_bias", "error")
    assert first.value == pytest.approx(-24.3, abs=0.1)
    assert "Nothing below is judged" in first.means
    rows = [r for r in result("rover_2.46_61.BIN").estimators if r.kind == "replay"]
    assert {r.status for r in rows} == {"not_judged"}
    assert result("rover_2.46_61.BIN").best == {}


def test_vibration_is_said_with_its_onset_and_what_it_does_to_the_force() -> None:
    """copter_3.3dev_181: from 54 s acc z std 0.5 -> 3.5 to 5.1, vertical force 9.62 -> 7."""
    found = said("copter_3.3dev_181.BIN")
    assert found["vibration"].t == pytest.approx(54, abs=1.5)
    assert "accelerometer's z" in found["vibration"].text
    assert found["vertical_force"].severity == "error"
    assert found["vertical_force"].value == pytest.approx(9.62 - 7.0, abs=0.6)
    assert found["second_source"].value == pytest.approx(92, abs=8)
    assert found["second_source"].t == pytest.approx(58, abs=4)
    assert found["ekf_check"].t == pytest.approx(119, abs=0.5)
    assert found["ekf_check"].count == 2


def test_error_records_are_counted_as_they_stand_in_the_file() -> None:
    """copter_3.3dev_181: 39 ERR records; those of code 0 end a fault."""
    assert FOLDER is not None
    records = formats.open(FOLDER / "copter_3.3dev_181.BIN").first("ERR")
    assert records is not None
    assert len(records) == 39
    found = said("copter_3.3dev_181.BIN")
    counted = {"gnss_glitch": (11, 2), "err_7_1": (7, 1), "ekf_check": (16, 2)}
    for code, (subsystem, number) in counted.items():
        assert found[code].count == int(np.sum((records["Subsys"] == subsystem) & (records["ECode"] == number)))


def test_a_crash_is_said_with_its_time() -> None:
    """copter_3.3dev_118: crash at 165.7 s of the boot clock's first record, tilt 174 deg, ERR 12/1."""
    first = result("copter_3.3dev_118.BIN").problems[0]
    assert (first.code, first.severity) == ("crash", "error")
    assert first.t == pytest.approx(167, abs=3)
    assert "ERR 12/1" in first.text


def off_in_tilt(judged: Result, name: str) -> float:
    row = next(r for r in judged.estimators if r.name == name)
    value = row.metrics["all"]["inclination_rmse_deg"].value
    assert value is not None
    return value


def test_an_onboard_attitude_that_the_accelerometer_refutes_is_said_and_is_no_reference() -> None:
    """copter_3.3dev_31: on the ground at 320 s ATT roll is -18.5 deg, the accelerometer says -0.3."""
    found = said("copter_3.3dev_31.BIN")
    assert found["reference_contradicted"].severity == "error"
    assert found["reference_contradicted"].remedy
    assert "The onboard attitude is the wrong one here: tilt 1" in found["reference_contradicted"].text
    judged = result("copter_3.3dev_31.BIN")
    assert judged.reference.choice == "smoother"
    onboard, *filters = (off_in_tilt(judged, name) for name in ("onboard", "vqf", "mahony", "madgwick"))
    assert onboard > 1.5 * max(filters)
    assert found["gyro_bias"].severity == "warning"
    assert "1.05 deg/s" in found["gyro_bias"].text


def test_filters_are_not_called_diverged_where_the_onboard_attitude_is_the_wrong_one() -> None:
    """px4_1.6.5_hand_rotation: five filters within 6 deg of vqf; mean force -9.67 down by it, not by the onboard."""
    name = "px4_1.6.5_hand_rotation.ulg"
    judged = result(name)
    assert (judged.reference.choice, judged.reference.heading_by) == ("smoother", "nobody")
    papers = ("complementary", "mahony", "madgwick", "ekf12", "vqf")
    assert {r.status for r in judged.estimators if r.estimator in papers} == {"ok"}
    assert max(off_in_tilt(judged, filter_) for filter_ in papers) < 6.0
    assert off_in_tilt(judged, "onboard") == pytest.approx(28, abs=4)
    first = judged.problems[0]
    assert (first.code, first.severity) == ("reference_contradicted", "error")
    assert "The onboard attitude is the wrong one here: tilt 2" in first.text
    check = next(c for c in judged.audit if c.name == "onboard against smoother")
    assert check.value == pytest.approx(28, abs=4)
    assert not {"field_against_attitude", "gravity_in_flight"} & set(said(name))


def test_motors_that_bend_the_field_are_said_with_the_realignments() -> None:
    """copter_3.6.8_compass: 293 -> 414 mGauss with throttle (r = 0.79), realigned by 49.7 and 26.6 deg."""
    found = said("copter_3.6.8_compass.bin")
    assert found["field_against_motors"].value == pytest.approx(100 * (414 / 293 - 1), abs=6)
    assert "r = 0.79" in found["field_against_motors"].text
    assert "COMPASS_MOTCT" in found["field_against_motors"].remedy
    assert found["attitude_jumps"].value == pytest.approx(49.7, abs=0.1)
    assert found["attitude_jumps"].count == 2
    assert "26.6 deg" in found["attitude_jumps"].text


def test_an_estimated_bias_that_explains_the_tilt_is_said() -> None:
    """copter_4.7dev_33: XKF2.AX -0.35 m/s^2 explains 2.09 deg."""
    found = said("copter_4.7dev_33.bin")["accelerometer_bias"]
    assert found.value == pytest.approx(-0.35, abs=0.005)
    assert "2.0 of the 2.1 deg" in found.text


def test_an_ekf_failsafe_is_said_of_a_log_that_cannot_be_replayed_too() -> None:
    assert FOLDER is not None
    log = attlog.read(FOLDER / "copter_4.8dev_barodrift.BIN")
    assert {"ekf_check", "ekf_failsafe"} <= {p.code for p in log.problems}
    with pytest.raises(LogUnusable):
        attlog.prepare(log)


QUIET = ("copter_4.4dev_sitl_swarm.BIN", "copter_4.7dev_sitl_climb.BIN")


@pytest.mark.parametrize("name", QUIET)
def test_simulated_flights_without_a_fault_have_no_serious_one(name: str) -> None:
    assert [p.code for p in result(name).problems if p.severity == "error"] == []


@pytest.mark.parametrize(
    "name", ["copter_3.2.1_bench.log", "copter_3.3dev_37.BIN", "copter_3.6.8_compass.bin", "rover_2.46_61.BIN", *QUIET]
)
def test_the_list_is_sorted_complete_and_free_of_doubles(name: str) -> None:
    problems = result(name).problems
    assert [ORDER.index(p.severity) for p in problems] == sorted(ORDER.index(p.severity) for p in problems)
    assert len({p.text for p in problems}) == len(problems)
    assert all(p.text.endswith((".", "?")) and p.severity in ORDER for p in problems)
    wrong = [c for c in result(name).audit if c.verdict in ("warning", "fault")]
    texts = " ".join(p.text for p in problems)
    refused = "reference_contradicted" in {p.code for p in problems}
    for check in wrong:
        covered = refused or check.name in ("rate", "field") or check.name.startswith("magnetometer")
        assert covered or check.text in texts, check.name
