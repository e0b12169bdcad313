"""EKF2 run again on sample logs: it follows what flew, and a change of a parameter acts as it must."""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn

import numpy as np
import pytest

import attlog
from attlog.compare.gates import Gate, GateLimit, Gates, judge_gates
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators import DEFAULT, parse
from attlog.flight.model import TimeLine
from attlog.metrics.metric import Case
from attlog.pipeline.onboard_rerun import flown_filter, onboard_difference, reproduction, rerun_row, run_again
from attlog.pipeline.replay import run_rows
from attlog.reference.model import Track
from attlog.result import EstimatorRow, Result
from attlog.words.flight import rerun_sentences
from tests.conftest import SAMPLES

RUN = "px4_ekf2"


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(SAMPLES / "px4_steps.ulg", {"estimators": [RUN]})


def rerun(case: Case, spec: str, *, study: bool = False) -> Track:
    """The row of a re-run."""
    return rerun_row(case, next(iter(case.imus.values())), parse(spec), spec, study=study)[0]


def heading_apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.median(np.abs(rotation.heading_angle(rotation.earth_error(a, b))))))


def test_the_filter_that_flew_is_followed_within_a_fifth_of_a_degree(case: Case) -> None:
    found = rerun(case, RUN).reproduction
    assert found is not None
    assert (found.follows, found.airborne) == (True, True)
    assert max(found.tilt_median_deg, found.heading_median_deg) <= 0.2


def test_a_change_of_declination_turns_the_heading_by_it(case: Case) -> None:
    """With the model switched off the heading is that of the declination that is set."""
    straight = rerun(case, f"{RUN}:EKF2_DECL_TYPE=0,EKF2_MAG_DECL=0,EKF2_GPS_CTRL=0")
    turned = rerun(case, f"{RUN}:EKF2_DECL_TYPE=0,EKF2_MAG_DECL=20,EKF2_GPS_CTRL=0")
    assert heading_apart(straight.q, turned.q) == pytest.approx(20.0, abs=2.0)
    assert turned.reproduction is None  # a changed filter need not follow


def test_a_parameter_that_is_set_to_what_flew_changes_nothing(case: Case) -> None:
    same = rerun(case, f"{RUN}:EKF2_MAG_NOISE=0.05")
    assert same.q == pytest.approx(rerun(case, RUN, study=True).q, abs=1e-6)  # the log holds it in single precision


def test_a_log_that_ekf2_did_not_fly_is_refused() -> None:
    with pytest.raises(UsageError, match="PX4 log"):
        run_rows(attlog.prepare(SAMPLES / "copter_steps_stabilize.bin"), [RUN])


def test_arrays_are_refused() -> None:
    t = np.arange(0, 1, 0.01)
    with pytest.raises(UsageError, match="runs on a PX4 log"):
        attlog.estimate(RUN, t, np.zeros((len(t), 3)), np.zeros((len(t), 3)))


def test_values_outside_the_documented_range_are_refused() -> None:
    with pytest.raises(UsageError, match="EKF2_MAG_NOISE=7"):
        parse(f"{RUN}:EKF2_MAG_NOISE=7")
    with pytest.raises(UsageError, match="EKF2_MAG_NOISE"):
        parse(f"{RUN}:EKF2_MAGNOISE=0.1")


@pytest.fixture(scope="module")
def result() -> Result:
    """What ``analyze`` finds by default."""
    return attlog.analyze(SAMPLES / "px4_steps.ulg")


def row_of(result: Result, name: str) -> EstimatorRow:
    return next(row for row in result.estimators if row.name == name)


def test_it_runs_by_default_and_is_never_ranked(result: Result) -> None:
    row = row_of(result, RUN)
    assert (row.kind, row.status) == ("rerun", "ok")
    assert not any(RUN in names for window in result.ranked.values() for names in window.values())
    assert rerun_sentences(result) == [
        "EKF2 run again: within 0.04° tilt and 0.09° heading of the onboard attitude (median in the air)."
    ]


def test_gates_and_tables_have_its_distance_from_what_flew(result: Result) -> None:
    row = row_of(result, RUN)
    assert row.reproduction is not None
    found = row.metrics["airborne"]["rerun_tilt_deg"]
    assert found.value == row.reproduction.tilt_median_deg
    assert "rerun_tilt_deg" not in row_of(result, "mekf").metrics["airborne"]
    limits = (GateLimit("max", 0.3),), (GateLimit("max", 0.01),)
    for metric in ("rerun_tilt_deg", "innovation_rms.gnss_velocity"):
        judged = [judge_gates(Gates((Gate(metric, limit),), strict=False), result) for limit in limits]
        assert [[(o.row, o.status) for o in outcomes] for outcomes in judged] == [[(RUN, "passed")], [(RUN, "failed")]]


def test_its_figure_has_logged_and_re_run_lines(result: Result) -> None:
    figure = result.figure("rerun", view="Test ratios")
    assert {trace.name for trace in figure.data} == {"logged", "run again", "gate"}
    bias = {trace.row: trace.columns["z"][-1] for trace in result.traces if trace.key == "bias"}
    assert bias[RUN] == pytest.approx(bias["onboard"], abs=0.02)  # deg/s


def test_no_other_number_changes_with_it(result: Result) -> None:
    alone = attlog.analyze(SAMPLES / "px4_steps.ulg", {"estimators": list(DEFAULT)})
    left = [row for row in result.estimators if row.name != RUN]
    assert [row.name for row in left] == [row.name for row in alone.estimators]
    for with_it, without in zip(left, alone.estimators, strict=True):
        for window, answers in without.metrics.items():
            found = with_it.metrics[window]
            assert {m: a.value for m, a in found.items() if m != "cost_ns"} == {
                m: a.value for m, a in answers.items() if m != "cost_ns"
            }
    assert (result.best, result.ranked) == (alone.best, alone.ranked)
    assert [v.sentence for v in result.verdicts] == [v.sentence for v in alone.verdicts]


def test_a_log_that_is_too_thin_says_why_and_has_no_row() -> None:
    log = attlog.read(SAMPLES / "px4_steps.ulg")

    def refuse() -> NoReturn:
        raise UsageError("EKF2 cannot be run again: its IMU is logged at 50 Hz; 90 are needed.")

    log.estimator.inputs = refuse
    found = attlog.analyze(log, {"estimators": ["default"]})
    assert RUN not in [row.name for row in found.estimators]
    assert rerun_sentences(found) == ["EKF2 cannot be run again: its IMU is logged at 50 Hz; 90 are needed."]
    assert not any("EKF2" in finding.text for finding in found.findings)


def test_a_re_run_that_does_not_follow_says_by_how_much_and_since_when(result: Result) -> None:
    row = row_of(result, RUN)
    assert row.reproduction is not None
    lost = replace(row.reproduction, tilt_median_deg=1.23, follows=False, leaves_s=33.7)
    assert rerun_sentences(replace(result, estimators=[replace(row, reproduction=lost)])) == [
        "EKF2 run again does not follow the onboard attitude: "
        "1.3° tilt and 0.09° heading apart (median in the air, from 34 s)."
    ]


def test_a_lane_switch_ends_the_comparison_and_is_named(result: Result) -> None:
    """Another lane is another filter: after the switch the difference says nothing about the re-run."""
    log = attlog.read(SAMPLES / "px4_steps.ulg")
    log.estimator.lane = TimeLine(np.array([0.0, 40.0]), [0, 1], "estimator_selector_status")
    case = attlog.prepare(log)
    assert case.log.replay_imu is not None
    run = run_again(case, case.log.replay_imu, "px4_ekf2", {}).estimate(case.log.t0_us * 1e-6)
    assert 39.0 < onboard_difference(case, run)[-1, 0] < 40.0
    row = row_of(result, RUN)
    found = reproduction(case, run, "cold")
    assert rerun_sentences(replace(result, estimators=[replace(row, reproduction=found)]))[0].endswith(
        "of the onboard attitude (median in the air to the lane switch at 40.0 s)."
    )


def test_an_ardupilot_log_that_flew_another_filter_has_no_re_run() -> None:
    log = attlog.read(SAMPLES / "copter_yaw_turns.bin")
    assert flown_filter(log) == "ap_ekf3"
    log.parameters.lines["AHRS_EKF_TYPE"] = TimeLine(np.zeros(1), [0], "PARM")
    assert flown_filter(log) == ""
