"""Names of rows for people, by rule from what the estimators are called."""

from __future__ import annotations

import pytest

from attlog.estimators import select
from attlog.present.names import name_in_sentence, row_name, row_names
from attlog.result import EstimatorRow, ParameterValue, Result


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
        ("ukf", "UKF"),
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
