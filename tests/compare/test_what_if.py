"""Parameters of the filter that flew: compared with the log's own, by innovations and reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.compare.comparison import Comparison, modes_text
from attlog.compare.filter_input import FilterInput, change_remarks, flown_changes, require_reproduction
from attlog.compare.grid import parse_free_parameters, search_request
from attlog.compare.run import compare
from attlog.compare.search import flown_questions
from attlog.compare.setting import parse_configuration
from attlog.compare.setting_words import select_words, with_params_file
from attlog.core.errors import LogUnusable, UsageError
from attlog.estimators.rerun import INNOVATION
from attlog.metrics.metric import Case
from attlog.metrics.rerun import compute_innovations
from attlog.pipeline.config import Config
from attlog.pipeline.onboard_rerun import study_mode
from attlog.segments.model import Segment
from tests.conftest import SAMPLES
from tests.metrics import flights

STEPS, COPTER = SAMPLES / "px4_steps.ulg", SAMPLES / "copter_steps_stabilize.bin"
LATE = "EKF2_GPS_DELAY=250"


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(STEPS)


@pytest.fixture(scope="module")
def late() -> Comparison:
    return compare([STEPS], select_words([LATE]).configurations)


# Words of the command line.


def test_a_parameter_of_the_firmware_means_the_filter_that_flew() -> None:
    found = select_words(["a.ulg", LATE, "EKF2_MAG_NOISE=0.1,EKF2_MAG_GATE=5"])
    assert [c.text for c in found.configurations] == [
        "px4_ekf2",
        "px4_ekf2:EKF2_GPS_DELAY=250",
        "px4_ekf2:EKF2_MAG_NOISE=0.1,EKF2_MAG_GATE=5",
    ]
    assert found.logs == [Path("a.ulg")]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("EKF2_GPS_DELAY=900", "EKF2_GPS_DELAY=900 is out of range"),
        ("EKF2_GPS_DELY=90", "did you mean EKF2_GPS_DELAY?"),
        ("EKF2_GPS_DELAY=90s", "is given in ms, not in s"),
        ("EK2_MAG_M_NSE=0.2", "ArduPilot's EKF2 is not run again"),
        ("ap_ekf2:EK2_MAG_M_NSE=0.2", "ArduPilot's EKF2 is not run again"),
        ("BATT_LOW_VOLT=10.5", "no parameter of EKF2 or EKF3"),
        ("EKF2_RNG_NOISE=0.1", "does not offer EKF2_RNG_NOISE: the range finder is not modelled"),
    ],
)
def test_a_value_that_cannot_be_is_refused_in_one_line(word: str, said: str) -> None:
    with pytest.raises(UsageError) as error:
        select_words(["a.ulg", word])
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("word", "same"),
    [
        ("EKF2_WIND_NOISE=0.2", "EKF2_WIND_NSD=0.2"),
        ("SENS_GPS0_DELAY=90", "EKF2_GPS_DELAY=90"),
        ("GPS1_DELAY_MS=220", "ap_ekf3:GPS_DELAY_MS=220"),
    ],
)
def test_the_name_of_another_version_means_the_same_parameter(word: str, same: str) -> None:
    assert parse_configuration(word) == parse_configuration(same)


def test_parameters_of_a_firmware_are_swept_without_naming_a_filter() -> None:
    asked = search_request([str(STEPS), "EKF2_GPS_DELAY=0..200/5"], "")
    assert (asked.filter, asked.logs) == ("px4_ekf2", [STEPS])
    (free,) = parse_free_parameters(["EKF2_GPS_DELAY=0..200"], parse_configuration(asked.filter).row.estimator)
    assert (free.low, free.high) == (0.0, 200.0)


def test_nothing_comes_before_a_filter_that_runs_on_its_own_inputs(case: Case) -> None:
    with pytest.raises(UsageError, match="nothing comes before px4_ekf2"):
        FilterInput.of(case, parse_configuration("px4_ekf2:lowpass=20")).rows([{}])


# What a change does.


def test_a_wrong_delay_of_gnss_is_seen_in_its_innovations(late: Comparison) -> None:
    d = next(q for q in late.questions if q.metric == "innovation_rms.gnss_velocity").contrasts[0].over
    assert d is not None
    assert d.direction == "worse"
    assert 1.8 < (d.value or 0.0) < 4.0
    assert late.labels["px4_ekf2"] == "as flown"


def test_the_first_sentence_gives_values_as_flown_and_changed(late: Comparison) -> None:
    lead = late.verdicts[0].lead
    assert lead.startswith("Tilt error 0.87 to 0.89°, GNSS velocity innovation 0.14 to 0.3")
    assert lead.endswith("; heading error unchanged.")


def test_its_own_attitude_does_not_judge_the_filter_that_flew() -> None:
    found = compare([STEPS], select_words([LATE]).configurations, Config.build({"reference": "onboard"}))
    directions = {q.metric: q.contrasts[0].logs[0] for q in found.questions}
    assert directions["tilt_rmse_deg"].value is None
    assert "filter that flew" in directions["tilt_rmse_deg"].reason
    assert directions["innovation_rms.gnss_velocity"].direction == "worse"


def test_a_rerun_that_does_not_follow_is_not_studied(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("attlog.pipeline.onboard_rerun.MAX_TILT_MEDIAN_DEG", 0.0)
    with pytest.raises(LogUnusable, match=r"does not follow the onboard attitude.*--anyway"):
        require_reproduction(case, "px4_ekf2")
    both = select_words([LATE]).configurations
    refused, anyway = compare([STEPS], both), compare([STEPS], both, anyway=True)
    assert refused.logs[0].code == 65
    assert anyway.used
    assert anyway.questions


def test_a_parameter_of_another_version_is_refused_by_the_log(case: Case) -> None:
    with pytest.raises(UsageError, match=r"EKF2_AID_MASK exists from 1.8 to 1.13; this log is of version 1.18"):
        FilterInput.of(case, parse_configuration("EKF2_AID_MASK=0")).rows([{}])


def test_parameters_of_the_start_are_remarked_in_a_warm_run_and_refused_alone(case: Case) -> None:
    at_start = parse_configuration("EKF2_ANGERR_INIT=0.3,EKF2_MAG_NOISE=0.1")
    assert "cold start alone" in "".join(change_remarks(case, at_start, "warm"))
    assert change_remarks(case, at_start, "cold") == []
    assert change_remarks(case, parse_configuration(LATE), "warm") == []
    with pytest.raises(UsageError, match="cold start alone"):
        change_remarks(case, parse_configuration("EKF2_ANGERR_INIT=0.3"), "warm")


def test_names_of_a_file_that_are_not_taken_get_a_line_each(case: Case, tmp_path: Path) -> None:
    file = tmp_path / "new.params"
    file.write_text("1 1 EKF2_RNG_NOISE 1 9\n1 1 EKF2_AID_MASK 3 6\n1 1 EKF2_FOO 3 6\n1 1 SENS_GPS0_DELAY 250 9\n")
    changes = flown_changes(case, with_params_file([], file)[1])
    assert changes.parameters == {"EKF2_GPS_DELAY": 250.0}
    for said in ("the range finder is not modelled", "exists from 1.8 to 1.13", "has no parameter EKF2_FOO"):
        assert sum(said in remark and "not applied" in remark for remark in changes.remarks) == 1


def test_a_log_of_another_firmware_is_refused() -> None:
    found = compare([COPTER], select_words([LATE]).configurations)
    assert "PX4 log that EKF2 flew" in found.logs[0].reason


def test_of_a_parameter_file_only_what_differs_from_the_log_is_changed(case: Case, tmp_path: Path) -> None:
    flown = case.log.param("EKF2_MAG_NOISE")
    file = tmp_path / "new.params"
    file.write_text(f"1\t1\tEKF2_MAG_NOISE\t{flown}\t9\n1\t1\tEKF2_GPS_DELAY\t250\t9\n1\t1\tMC_ROLL_P\t7\t9\n")
    as_flown, changed = with_params_file([], file)
    assert as_flown.text == "px4_ekf2"
    (by_file,) = FilterInput.of(case, changed).rows([{}])
    (by_name,) = FilterInput.of(case, parse_configuration(LATE)).rows([{}])
    assert by_file.parameters == {"EKF2_GPS_DELAY": 250.0}
    assert np.array_equal(by_file.q, by_name.q)


def test_a_search_is_decided_by_truth_and_else_by_the_aid_of_its_parameter(case: Case) -> None:
    flown = parse_configuration("px4_ekf2")
    judged, innovations = flown_questions([case], flown, ["EKF2_MAG_NOISE"], ["tilt_rmse_deg"])
    assert [q.metric for q in judged] == ["tilt_rmse_deg"]
    assert innovations[0].metric == "innovation_rms.compass_field"
    assert "innovation_rms.compass_heading" not in [q.metric for q in innovations], "this log has none"
    own = attlog.prepare(STEPS, {"reference": "onboard"})
    judged, innovations = flown_questions([own], flown, ["EKF2_GPS_DELAY"], ["tilt_rmse_deg"])
    assert judged == []
    assert innovations[0].metric == "innovation_rms.gnss_velocity"


# Statistics of innovations that are known.


def answers_of(tables: dict[str, np.ndarray]) -> dict[str, attlog.metrics.Answer]:
    t = np.arange(0.0, 100.0, 0.02)
    row = flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
    row.aux = {INNOVATION + name: table for name, table in tables.items()}
    made = flights.case([row], [Segment("continuous", 0.0, 100.0)])
    return compute_innovations(made, row, "all")


def table(e: np.ndarray, variance: float, gate: float) -> np.ndarray:
    t = np.arange(len(e)) * 0.2
    return np.column_stack([t, e, np.full(len(e), variance), e**2 / (gate**2 * variance)])


def test_size_share_bias_and_correlation_of_known_innovations() -> None:
    rng = np.random.default_rng(1)
    north, east = 0.5 + 0.3 * rng.standard_normal(500), 0.4 * rng.standard_normal(500)
    found = answers_of({"velocity_n": table(north, 0.01, 5.0), "velocity_e": table(east, 0.01, 5.0)})
    value = {name: a.value for name, a in found.items()}
    assert value["innovation_rms.gnss_velocity"] == pytest.approx(np.sqrt(np.mean(north**2 + east**2)))
    worst = np.maximum(north**2, east**2) / 0.25
    assert value["test_ratio_rms.gnss_velocity"] == pytest.approx(np.sqrt(np.mean(worst)))
    assert value["rejected_pct.gnss_velocity"] == pytest.approx(100.0 * np.mean(worst > 1.0))
    assert value["innovation_bias.gnss_velocity"] == pytest.approx(0.5, abs=0.05)
    assert abs(value["innovation_correlation.gnss_velocity"]) < 0.1
    slow = np.repeat(rng.standard_normal(50), 10)
    held = answers_of({"velocity_n": table(slow, 0.01, 5.0)})["innovation_correlation.gnss_velocity"].value
    assert held == pytest.approx(0.9, abs=0.05)
    assert value["attitude_resets"] == 0.0
    low, high = found["innovation_rms.gnss_velocity"].ci95
    assert low < value["innovation_rms.gnss_velocity"] < high


def test_a_row_without_innovations_has_none_of_these_metrics() -> None:
    assert answers_of({}) == {}


# Modes: resets and aiding as flown, or by the filter's own rules.


def test_a_study_runs_both_rows_by_the_filters_own_rules_where_it_follows(
    case: Case, late: Comparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert late.logs[0].mode == "own"
    assert late.mode_text == "resets and GNSS use by the filter's own rules"
    fresh = attlog.prepare(STEPS)
    rows = FilterInput.of(fresh, parse_configuration("px4_ekf2")).rows([{}, {"EKF2_GPS_DELAY": 250.0}])
    assert [row.mode for row in rows] == ["own", "own"]
    monkeypatch.setattr("attlog.pipeline.onboard_rerun.MAX_TILT_MEDIAN_DEG", 0.0)
    fresh = attlog.prepare(STEPS)
    assert study_mode(fresh, str(next(iter(fresh.imus.values())).index), "px4_ekf2") == "flown"


def test_modes_of_several_logs_are_one_phrase() -> None:
    assert modes_text(["", ""]) == ""
    assert modes_text(["flown", "flown"]) == "resets and GNSS use as logged"
    assert modes_text(["own", "flown", "own"]) == (
        "resets and GNSS use by the filter's own rules on 2 of 3 logs, else as logged"
    )


def test_a_turned_heading_is_seen_in_gnss_acceleration_without_a_reference(corpus: Path) -> None:
    turned = select_words(["EKF2_DECL_TYPE=0,EKF2_MAG_DECL=20"]).configurations
    found = compare([corpus / "sitl" / "px4" / "px4_wind.ulg"], turned, metrics=["gnss_heading_deg", "attitude_resets"])
    d = found.questions[0].contrasts[0].logs[0]
    assert d.direction == "worse"
    assert 5.0 < (d.value or 0.0) < 20.0
    assert found.questions[1].contrasts[0].logs[0].value == 0.0
