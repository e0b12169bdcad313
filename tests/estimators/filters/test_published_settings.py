"""Presets and defaults are the numbers of their sources; ranges are those of what the unit measures."""

from __future__ import annotations

import math

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


RANGES: dict[str, tuple[float, float]] = {
    # Angles end at a quarter turn, headings at a half, gyro biases at 100 deg/s, delays at a second.
    "deg": (0.01, 90.0),
    "deg/s": (0.001, 100.0),
    "1/s": (0.0, 100.0),
    "1/s^2": (0.0, 10.0),
    "deg*sqrt(s)": (0.01, 1000.0),
    "deg/s/sqrt(s)": (0.0, 10.0),
    "deg/sqrt(s)": (1e-5, 10.0),
    "m/s": (1e-4, 100.0),
    "m/s/sqrt(s)": (1e-6, 10.0),
    "m/s^2": (0.0, 10.0),
    "m/s^2*sqrt(s)": (1e-4, 100.0),
    "m/s^2/sqrt(Hz)": (1e-5, 1e3),
    "m/s^2/sqrt(s)": (1e-9, 1e2),
    "rad/s": (0.0, 2.0),
    "rad/s/sqrt(Hz)": (1e-7, 1.0),
    "rad/s^2/sqrt(s)": (1e-6, 1e6),
    "1/sqrt(Hz)": (1e-5, 1e2),
    "1/sqrt(s)": (1e-9, 1e2),
    "sqrt(s)": (0.0, 1.0),
    "s/rad": (0.0, 100.0),
    "Hz": (20.0, 20_000.0),
}
OTHERWISE: dict[str, tuple[float, float]] = {
    "heading_sigma": (0.01, 180.0),
    "declination_sigma": (0.01, 20.0),
    "gyro_bias_sigma": (0.001, 20.0),
    "field_sigma": (0.0, 90.0),
    "acc_rejection": (0.0, 90.0),
    "mag_rejection": (0.0, 90.0),
    "dip_limit": (0.1, 90.0),
    "zeta": (0.0, 10.0),
    "gain": (0.0, 10.0),
    "AHRS_RP_P": (0.05, 10.0),
    "AHRS_YAW_P": (0.05, 10.0),
    "AHRS_GPS_USE": (0.0, 2.0),
    "AHRS_GPS_GAIN": (0.0, 10.0),
    "ATT_ACC_COMP": (0.0, 2.0),
    "COMPASS_USE": (0.0, 1.0),
    "bias_clip": (0.01, 100.0),
    "eskf.acc_bias_sigma": (0.001, 2.0),
    "smoother.acc_bias_sigma": (0.001, 2.0),
    "ukf.bias_sigma": (0.0001, 100.0),
    "mag_gain": (0.0, 10.0),
    "thr1": (0.0, 10.0),
    "thr2": (0.0, 10.0),
    "err1": (0.0, 2.0),
    "err2": (0.0, 2.0),
    "field_scale": (0.1, 2.0),
    "l1": (1e-6, 1e6),
    "l2": (1e-6, 1e6),
    "scale_sigma": (0.0, 1.0),
    "misalignment_sigma": (0.0, 1.0),
    "offset_sigma": (0.0, 10.0),
    "velocity_factor": (0.0, 100.0),
    "norm_limit": (0.001, 10.0),
    "mag_gate": (0.1, 100.0),
    "gate": (0.1, 100.0),
    "soft_gate": (1.0, 100.0),
    "passes": (1.0, 12.0),
    "lead": (-100.0, 100.0),
    "delay_sigma": (0.0, 1000.0),
    "tau": (0.0, 100.0),
    "acc_factor": (0.0, 100.0),
    "settle": (0.0, 1000.0),
    "timeout": (0.0, 1000.0),
    "fast_gains_s": (0.0, 3600.0),
    "block": (0.001, 0.5),
    "tau_acc": (0.01, 1000.0),
    "tau_mag": (0.01, 1000.0),
    "velocity_time": (0.1, 1000.0),
    "field_time": (0.1, 10_000.0),
    "align_time": (0.1, 30.0),
}


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_range_is_that_of_its_unit_and_holds_the_default(name: str) -> None:
    for p in get(name).own:
        if p.choices:
            continue
        want = OTHERWISE.get(f"{name}.{p.name}") or OTHERWISE.get(p.name) or RANGES[p.unit]
        assert (p.low, p.high) == want, p.name
        assert p.low <= float(p.default) <= p.high


# Time constants in s, and how gains relate: kp is the inverse of the first, kp / ki the time in which a bias is found.
TIMES: dict[str, tuple[float, float]] = {
    "complementary": (2.857, 100.0),
    "variable_integral": (3.333, 60.0),
    "mahony_passive": (5.0, 66.67),
    "mahony_dcm": (3.333, 60.0),
    "mahony": (2.222, 112.5),
    "mahony_adaptive": (3.333, 50.0),
}


@pytest.mark.parametrize("name", list(TIMES))
def test_the_gains_are_time_constants_of_seconds_and_biases_of_a_minute_or_two(name: str) -> None:
    own = {p.name: float(p.default) for p in get(name).own if not p.choices}
    kp, ki = own["kp"], own["ki"]
    assert (1.0 / kp, kp / ki) == pytest.approx(TIMES[name], rel=1e-3)


def test_one_sigma_of_the_kalman_filters_is_a_small_sensors() -> None:
    """By angle: noise of gyro (deg in a minute), compass (deg at 10 Hz, root of the rate), bias (deg/s in an hour)."""
    for name, gyro, mag, bias, tilt in (("mekf", 0.1239, 44.27, 0.12, 2.0), ("ukf", 0.2324, 25.3, 0.12, 2.0)):
        own = {p.name: float(p.default) for p in get(name).own if not p.choices}
        assert own["gyro_noise"] * math.sqrt(60.0) == pytest.approx(gyro, rel=1e-3)
        assert own["mag_noise"] * math.sqrt(10.0) == pytest.approx(mag, rel=1e-3)
        assert own["bias_noise"] * math.sqrt(3600.0) == pytest.approx(bias, rel=1e-3)
        assert own["tilt_sigma"] == tilt
        assert own["bias_sigma"] == 0.65
