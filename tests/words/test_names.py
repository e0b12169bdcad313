"""Names of rows for people, by rule from what the estimators are called."""

from __future__ import annotations

import pytest

from attlog.estimators import select
from attlog.result import EstimatorRow, ParameterValue, Result
from attlog.words.names import name_in_sentence, row_name, row_names
from attlog.words.ranking import quoted_heading_reference
from tests.words.made import drift, result, row


def named(spec: str, suffix: str = "") -> EstimatorRow:
    """The row of a specification of the command line."""
    found = select(spec)[0]
    parameters = {k: ParameterValue(v, origin) for k, (v, origin) in found.resolved().items()}
    return EstimatorRow(
        found.name + suffix,
        "replay",
        found.estimator.name,
        "ok",
        title=found.estimator.title,
        preset=found.preset,
        parameters=parameters,
    )


@pytest.mark.parametrize(
    ("spec", "name"),
    [
        ("mahony@xu-0.6", "Mahony, Xu 0.6"),
        ("mahony:kp=0.8", "Mahony (kp 0.8)"),
        ("mahony_dcm@huang", "Mahony DCM, Huang"),
        ("madgwick@marg", "Madgwick, MARG"),
        ("ekf12@fan", "EKF12, Fan"),
        ("vqf", "VQF"),
        ("px4_q", "PX4 Q"),
        ("ap_dcm:AHRS_RP_P=0.1", "AP DCM (AHRS_RP_P 0.1)"),
        ("gyro", "Gyro"),
        ("accel_mag", "Accel mag"),
        ("complementary@lyu-fixed", "Complementary, Lyu fixed"),
    ],
)
def test_filters_are_named_by_rule(spec, name):
    assert row_name(named(spec)) == name


def test_a_name_in_a_sentence_holds_no_comma():
    assert name_in_sentence(named("mahony@xu-0.6")) == "Mahony Xu 0.6"
    assert "," not in name_in_sentence(named("mahony:kp=0.8,ki=0.1"))


def test_a_row_of_another_imu_says_so():
    assert row_name(named("mahony@xu-0.6", "/imu1")) == "Mahony, Xu 0.6, IMU 1"


@pytest.mark.parametrize(
    ("key", "title", "name"),
    [
        ("onboard", "ATT", "Onboard (ATT)"),
        ("onboard", "", "Onboard"),
        ("onboard:AHR2", "AHR2", "Onboard AHR2"),
        ("onboard:XKQ.1", "XKQ.1", "Onboard XKQ.1"),
    ],
)
def test_onboard_rows_say_where_they_come_from(key, title, name):
    row = EstimatorRow(key, "onboard", "", "ok", title=title)
    assert row_name(row) == name


def test_two_rows_are_never_called_the_same():
    rows = [EstimatorRow(k, "replay", "mine", "ok") for k in ("mine", "mine-2")]
    assert row_names(Result({}, "", {}, {}, estimators=rows)) == {"mine": "Mine [mine]", "mine-2": "Mine [mine-2]"}


# One rule says which heading reference is quoted.


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (("mag", "onboard", "truth"), "truth"),
        (("mag", "onboard"), "onboard"),
        (("course", "mag"), "mag"),
        (("onboard", "gnss_yaw"), "gnss_yaw"),
        (("gnss_yaw", "smoother"), "smoother"),
    ],
)
def test_the_first_that_is_there_is_quoted_whatever_it_ranks(there, said):
    unranked = {"ranked": False, "reason": "rests disagree"}
    found = result([row(f"f{i}", drift(9.0, against=name, **unranked)) for i, name in enumerate(there)])
    assert quoted_heading_reference(found) == said


def test_a_value_of_an_onboard_row_makes_no_heading_reference_quoted():
    rows = [row("onboard:AHR2", drift(1.0, against="truth")), row("a", drift(2.0, against="mag"))]
    assert quoted_heading_reference(result(rows)) == "mag"
