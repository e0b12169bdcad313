"""Presets and defaults are the numbers of their sources, within the ranges that are allowed."""

from __future__ import annotations

import pytest

from attlog.estimators.registry import BUILT_IN, get

PRINTED: dict[str, dict[str, float]] = {
    # Madgwick2010, section 6: optimal beta of the IMU and of the MARG form; Madgwick2011: betaDef / 2, halved field.
    "madgwick@imu": {"beta": 0.033, "zeta": 0.0, "field_scale": 1.0},
    "madgwick@marg": {"beta": 0.041, "zeta": 0.0, "field_scale": 1.0},
    "madgwick@code2011": {"beta": 0.12, "zeta": 0.0, "field_scale": 0.5},
    # Xu, section 3.
    "mahony@xu-0.6": {"kp": 0.6, "ki": 0.0, "mag_gain": 1.0},
    "mahony@xu-1.1": {"kp": 1.1, "ki": 0.0, "mag_gain": 1.0},
    "mahony@xu-2": {"kp": 2.0, "ki": 0.0, "mag_gain": 1.0},
    "mahony_adaptive@xu": {"kp": 0.6, "ki": 0.0, "mag_gain": 1.0, "thr1": 0.1, "thr2": 0.2, "rate_gain": 0.0},
    # Huang, figure 3.
    "mahony_dcm@huang": {"kp": 0.3, "ki": 0.01, "mag_gain": 1.0},
    "mahony_passive@huang": {"kp": 0.3, "ki": 0.01, "mag_gain": 1.0},
    # Lyu, section 3.1; Fan, section 4.
    "variable_integral@lyu": {"kp": 0.5, "ki": 0.001, "err1": 0.3, "err2": 0.8, "mag_gain": 0.0},
    "complementary@lyu-fixed": {"kp": 0.5, "ki": 0.001, "mag_gain": 0.0},
    "complementary@fan": {"kp": 3.0, "ki": 0.01, "mag_gain": 1.0},
    # PX4 1.15, attitude_estimator_q parameters; ArduPilot 4.x, AP_AHRS and compass parameters.
    "px4_q": {"ATT_W_ACC": 0.2, "ATT_W_MAG": 0.1, "ATT_W_GYRO_BIAS": 0.1, "ATT_ACC_COMP": 0.0, "ATT_BIAS_MAX": 0.05},
    "ap_dcm": {"AHRS_RP_P": 0.2, "AHRS_YAW_P": 0.2, "AHRS_GPS_GAIN": 1.0, "AHRS_GPS_USE": 1.0, "COMPASS_USE": 1.0},
    # imufusion's simple and advanced examples.
    "fusion": {"gain": 0.5, "acc_rejection": 0.0, "mag_rejection": 0.0, "timeout": 5.0},
    "fusion@example": {"gain": 0.5, "acc_rejection": 10.0, "mag_rejection": 10.0, "timeout": 5.0},
}


@pytest.mark.parametrize("spec", list(PRINTED))
def test_what_a_source_prints_is_what_runs(spec: str) -> None:
    name, _, preset = spec.partition("@")
    e = get(name)
    values = {p.name: p.default for p in e.own} | dict(e.presets[preset] if preset else {})
    assert {key: values[key] for key in PRINTED[spec]} == PRINTED[spec]


def test_the_presets_of_vqf_are_the_packages_own_defaults() -> None:
    vqf = pytest.importorskip("vqf")
    params = vqf.PyVQF(0.01).params
    told = get("vqf").presets["package"]
    names = {"tau_acc": "tauAcc", "tau_mag": "tauMag", "bias_sigma": "biasSigmaInit", "bias_clip": "biasClip"}
    assert {key: told[key] for key in names} == {key: getattr(params, name) for key, name in names.items()}
    assert told["settle"] == 0.0


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_range_holds_the_default_and_every_preset(name: str) -> None:
    e = get(name)
    for p in e.own:
        if not p.choices:
            told = [preset[p.name] for preset in e.presets.values() if p.name in preset]
            assert all(p.low <= float(value) <= p.high for value in (p.default, *told)), p.name


@pytest.mark.parametrize(
    "name", ["complementary", "variable_integral", "mahony_passive", "mahony_dcm", "mahony", "mahony_adaptive"]
)
def test_default_gains_correct_within_seconds_and_find_a_bias_within_two_minutes(name: str) -> None:
    """A vehicle accelerates for a second or two, and its gyro warms up within minutes."""
    own = {p.name: float(p.default) for p in get(name).own if not p.choices}
    assert 2.0 < 1.0 / own["kp"] < 10.0
    assert 30.0 < own["kp"] / own["ki"] < 120.0
