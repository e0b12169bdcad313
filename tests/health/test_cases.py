"""What is wrong with sixteen real logs: analysed by hand (logs/cases/CASES.md of the corpus), and said."""

from __future__ import annotations

from functools import cache

import pytest

import attlog
from attlog.core.errors import LogUnusable
from attlog.health.findings import SEVERITY_ORDER, Finding
from attlog.result import Result
from tests.conftest import corpus_root

FOLDER = None if corpus_root() is None else corpus_root() / "logs" / "cases"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(FOLDER is None or not FOLDER.is_dir(), reason="needs the corpus")]


@cache
def result(name: str) -> Result:
    assert FOLDER is not None
    return attlog.evaluate(attlog.prepare(FOLDER / name))


def said(name: str) -> dict[str, Finding]:
    found = {f.kind: f for f in result(name).findings}
    assert len(found) == len(result(name).findings), "one cause, one entry"
    return found


def words(finding: Finding) -> str:
    """The sentence and its evidence."""
    return " ".join([finding.text, *finding.evidence])


def test_a_gyro_that_turns_at_rest_is_said_first_and_nothing_is_judged() -> None:
    """rover_2.46_61: -24 / -23 deg/s."""
    first = result("rover_2.46_61.BIN").findings[0]
    assert (first.kind, first.severity) == ("gyro_bias", "serious")
    assert first.value == pytest.approx(-24.3, abs=0.1)
    assert "attitude" not in said("rover_2.46_61.BIN"), "a wrong attitude follows from it"
    rows = [r for r in result("rover_2.46_61.BIN").estimators if r.kind == "replay"]
    assert {r.status for r in rows} == {"not_judged"}
    assert result("rover_2.46_61.BIN").best == {}


@pytest.mark.slow
def test_vibration_is_said_with_its_onset_and_what_it_does_to_the_force() -> None:
    """copter_3.3dev_181: from 54 s acc z std 0.5 -> 3.5 to 5.1, vertical force 9.62 -> 7."""
    found = said("copter_3.3dev_181.BIN")
    assert "From 55 s on the accelerometer's z vibrates" in words(found["vibration"])
    assert found["vibration"].severity == "serious"
    assert found["vibration"].value == pytest.approx(9.62 - 7.0, abs=0.6)
    assert found["attitude"].value == pytest.approx(92, abs=8)
    assert found["attitude"].t == pytest.approx(58, abs=4)
    assert found["estimator"].t == pytest.approx(56.6, abs=0.5), "EKF4.SV above 1, to 19 times its limit"
    assert any("ERR 16/2" in text for text in found["vibration"].evidence), "its cause"


@pytest.mark.slow
def test_a_crash_is_said_with_its_time() -> None:
    """copter_3.3dev_118: crash at 165.7 s of the boot clock's first record, tilt 174 deg, ERR 12/1."""
    thrust, first = result("copter_3.3dev_118.BIN").findings[:2]
    assert (thrust.kind, first.kind, first.severity) == ("thrust", "crash", "serious")
    assert first.t == pytest.approx(167, abs=3)
    assert "more of the kind" not in first.text
    assert "ERR 12/1" in words(first)
    assert "motor outputs in the 5 s before it" in first.action


def off_in_tilt(judged: Result, name: str) -> float:
    row = next(r for r in judged.estimators if r.name == name)
    value = row.metrics["all"]["tilt_rmse_deg"].value
    assert value is not None
    return value


@pytest.mark.slow
def test_an_onboard_attitude_that_the_accelerometer_refutes_is_said_and_is_no_reference() -> None:
    """copter_3.3dev_31: on the ground at 320 s ATT roll is -18.5 deg, the accelerometer says -0.3."""
    found = said("copter_3.3dev_31.BIN")
    assert found["attitude"].severity == "serious"
    assert "wrong by 17 deg on the ground with motors on" in found["attitude"].text
    assert "the accelerometer shows" in words(found["attitude"])
    assert "mounting" not in found
    judged = result("copter_3.3dev_31.BIN")
    assert judged.reference.choice == "smoother"
    onboard, *filters = (off_in_tilt(judged, name) for name in ("onboard", "vqf", "mahony", "madgwick"))
    assert onboard > 1.5 * max(filters)
    assert found["gyro_bias"].severity == "warning"
    assert "z +1.04 deg/s" in found["gyro_bias"].text


def test_filters_are_not_called_diverged_where_the_onboard_attitude_is_the_wrong_one() -> None:
    """px4_1.6.5_hand_rotation: five filters within 6 deg of vqf; mean force -9.67 down by it, not by the onboard."""
    name = "px4_1.6.5_hand_rotation.ulg"
    judged = result(name)
    assert (judged.reference.choice, judged.reference.heading_by) == ("smoother", "none")
    papers = ("complementary", "mahony", "madgwick", "ekf12", "vqf")
    assert {r.status for r in judged.estimators if r.estimator in papers} == {"ok"}
    assert max(off_in_tilt(judged, filter_) for filter_ in papers) < 6.0
    assert off_in_tilt(judged, "onboard") == pytest.approx(28, abs=4)
    first = judged.findings[0]
    assert (first.kind, first.severity) == ("attitude", "serious")
    assert "The onboard attitude was wrong: tilt 2" in first.text
    check = next(c for c in judged.checks if c.question == "onboard_against_smoother")
    assert check.value == pytest.approx(28, abs=4)
    assert not {"compass", "accelerometer"} & set(said(name))


def test_motors_that_bend_the_field_are_said_with_the_realignments() -> None:
    """copter_3.6.8_compass: 293 -> 414 mGauss with throttle (r = 0.79), realigned by 49.7 and 26.6 deg."""
    found = said("copter_3.6.8_compass.bin")
    assert found["compass"].value == pytest.approx(100 * (414 / 293 - 1), abs=6)
    assert "r = 0.79" in found["compass"].text
    assert "COMPASS_MOTCT" in found["compass"].action
    assert "The onboard heading jumped 2 times: 49.7 deg at 17.7 s, 26.6 deg at 100.7 s." in found["compass"].evidence
    assert not {"reset", "realigned", "attitude"} & set(found), "one cause, one entry"


def test_an_estimated_bias_that_explains_the_tilt_is_said() -> None:
    """copter_4.7dev_33: XKF2.AX -0.35 m/s^2 explains 2.09 deg."""
    found = said("copter_4.7dev_33.bin")["accelerometer"]
    assert found.value == pytest.approx(-0.35, abs=0.005)
    assert "2.0 of 2.1 deg" in words(found)


def test_an_ekf_failsafe_is_said_of_a_log_that_cannot_be_replayed_too() -> None:
    assert FOLDER is not None
    log = attlog.read(FOLDER / "copter_4.8dev_barodrift.BIN")
    assert {"ekf_check", "ekf_failsafe"} <= {p.code for p in log.problems}
    with pytest.raises(LogUnusable):
        attlog.prepare(log)


QUIET = ("copter_4.4dev_sitl_swarm.BIN", "copter_4.7dev_sitl_climb.BIN")


@pytest.mark.parametrize("name", QUIET)
def test_simulated_flights_without_a_fault_have_no_serious_one(name: str) -> None:
    assert [p.kind for p in result(name).findings if p.is_trouble] == []


@pytest.mark.parametrize(
    "name", ["copter_3.2.1_bench.log", "copter_3.3dev_37.BIN", "copter_3.6.8_compass.bin", "rover_2.46_61.BIN", *QUIET]
)
def test_the_list_is_sorted_complete_and_free_of_doubles(name: str) -> None:
    problems = result(name).findings
    assert [SEVERITY_ORDER.index(p.severity) for p in problems] == sorted(
        SEVERITY_ORDER.index(p.severity) for p in problems
    )
    assert len({p.text for p in problems}) == len(problems)
    assert all(p.text.endswith((".", "?")) and p.severity in SEVERITY_ORDER for p in problems)
    texts = " ".join(words(p) for p in problems)
    left_out = {"rate", "crash"}  # told by what the autopilot or the events say of the same
    for check in result(name).checks:
        named = check.in_use and not check.question.startswith(("magnetometer", "gaps"))
        if check.verdict in ("warning", "fault") and named:
            assert check.question in left_out or check.text in texts, check.question


@pytest.mark.slow
def test_a_vehicle_that_stands_still_is_not_accused_by_a_smoother_that_gravity_refutes() -> None:
    """copter_4.6_standing_accused, copter_falsely_accused: 8.4 and 3.2 deg "off" where the accelerometer agrees."""
    for name in ("copter_4.6_standing_accused.BIN", "copter_falsely_accused.bin"):
        assert "attitude" not in said(name)


@pytest.mark.slow
def test_vibration_of_motors_before_take_off_is_no_tilt() -> None:
    """px4_1.14_hard_landing: 0.09 deg before flight, 0.3 after; the median of single samples was 4.4."""
    check = next(c for c in result("px4_1.14_hard_landing.ulg").checks if c.question == "gravity_direction")
    assert check.verdict == "ok"
    assert check.value < 1.0


@pytest.mark.slow
def test_another_compass_that_reads_the_earths_field_is_to_be_calibrated_and_used() -> None:
    """copter_two_compasses: compass 1 reads 71 uT, compass 2 42.4 where the earth has 41.8, with offsets of zero.

    COMPASS_USE2 1 and COMPASS_USE 0 alone would leave 4.0.1 without any, because COMPASS_PRIMARY is 0.
    """
    found = said("copter_two_compasses.bin")["compass"]
    assert found.action == "Calibrate MAG2 and use it instead of MAG."
    assert "ground mag anomaly" in words(found)


def test_a_turned_compass_is_one_finding_with_the_heading_it_spoils() -> None:
    """copter_heading_28deg_off: compass 0 needs COMPASS_ORIENT 6, as its owners set it later; motors bend another."""
    flown = result("copter_heading_28deg_off.BIN")
    check = next(c for c in flown.checks if c.question == "compass_motors")
    assert check.verdict == "warning"
    assert "more in x, y, z than on the ground" in check.text
    (found,) = [f for f in flown.findings if f.kind in ("compass", "estimator")]
    assert (found.severity, found.about) == ("serious", "compass_orientation")
    assert found.action == "Set COMPASS_ORIENT 6, and calibrate this compass before flying."
    assert any("by the motion that GNSS shows" in text for text in found.evidence)


def test_clipping_is_said_with_what_it_did_to_the_estimator() -> None:
    """px4_1.14_clipping_crash: IMU 1 counts 1,611 samples from 35.7 s on, "Accel 1 clipping, not safe to fly!"."""
    found = said("px4_1.14_clipping_crash.ulg")
    assert found["vibration"].text.startswith("The accelerometer clipped from 35.7 s")
    assert "not safe to fly" in words(found["vibration"])
    assert "notch" not in found["vibration"].action
    assert "estimator" not in found
    assert found["crash"].t == pytest.approx(46.1, abs=0.1)


def test_of_a_simulator_that_sends_no_sense_nothing_is_told_but_that() -> None:
    """Forces of up to 1,900 m/s^2 are left of 74 % that are more: no frame, calibration or clipping explains them."""
    assert FOLDER is not None
    told = attlog.analyze(FOLDER / "px4_1.17dev_hil_absurd.ulg", {"estimators": ["mahony"]})
    assert [f.kind for f in told.findings if f.severity == "serious"] == ["imu_mostly_refused"]
    assert not {"simulator", "mounting", "accelerometer", "vibration"} & {f.kind for f in told.findings}
    assert "clipped" not in told.headline
