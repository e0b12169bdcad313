"""gyro, accel_mag, complementary, mahony against closed forms, published numbers and the ahrs package."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.estimators import estimate
from attlog.estimators.registry import BUILT_IN, get
from attlog.testing import Motion, Noise, flight, motion, swing
from attlog.testing import still as still_motion
from attlog.testing.motions import heading_deg, total_deg

G = 9.80665
FIELD = np.array([20.0, 0.0, 40.0])
LYU, XU = "complementary:kp=0.5,ki=0.001,mag_gain=1", "mahony:kp=0.6,ki=0.0012,mag_gain=1"
CORRECTING = (LYU, "complementary@fan", XU, "mahony@xu-0.6", f"{XU},mag_form=vector")
BROAD_FRD = np.array([1.0, -1.0, -1.0])


def still(q: np.ndarray, n: int, rate: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Exact sensors of a body that rests at attitude q."""
    t = np.arange(n) / rate
    acc, mag = (np.tile(rotation.rotate_inverse(q, v), (n, 1)) for v in ([0, 0, -G], FIELD))
    return t, np.zeros((n, 3)), acc, mag


@pytest.mark.parametrize("name", CORRECTING)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_error_about_any_axis_shrinks_at_the_rate_of_the_gain(name: str, axis: int, sign: float) -> None:
    t, gyr, acc, mag = still(np.array([1.0, 0, 0, 0]), 200)
    q0 = rotation.from_rotvec(sign * np.radians(5.0) * np.eye(3)[axis])
    e = attlog.estimate(name + (",ki=0" if ":" in name else ":ki=0"), t, gyr, acc, mag, q0=q0)
    if "vector" in name or "fan" in name:
        assert rotation.total_angle(e.q[-1]) < 0.9 * np.radians(5.0)
        return
    # A tilt shows the field askew, so a tilt error moves heading for a while: each angle is judged on its own axis.
    left = rotation.heading_angle(e.q) if axis == 2 else rotation.tilt_angle(e.q)
    kp = 0.5 if name == LYU else 0.6
    assert np.rad2deg(abs(left[-1])) == pytest.approx(5 * np.exp(-kp * t[-1]), rel=0.02)


@pytest.mark.parametrize("name", ["gyro", *CORRECTING])
def test_a_turned_start_turns_the_whole_answer_where_nothing_shows_heading(name: str) -> None:
    rng = np.random.default_rng(2)
    t = np.arange(1000) / 100.0
    gyr = rng.normal(0, 1.0, (1000, 3))
    acc = rng.normal([0, 0, -G], 2.0, (1000, 3))
    plain = attlog.estimate(name, t, gyr, acc, q0=[1, 0, 0, 0])
    turned = attlog.estimate(name, t, gyr, acc, q0=rotation.from_euler(0, 0, 1.0))
    assert np.allclose(
        rotation.total_angle(rotation.earth_error(turned.q, rotation.turn_about_down(plain.q, 1.0))), 0, atol=1e-9
    )


@pytest.mark.parametrize("name", ["accel_mag", *CORRECTING])
def test_the_unit_of_the_field_does_not_matter(name: str) -> None:
    t, gyr, acc, mag = still(rotation.from_euler(0.2, 0.1, 2.0), 50)
    a, b = (attlog.estimate(name, t, gyr, acc, k * mag, q0=[1, 0, 0, 0]) for k in (1.0, 1e-6))
    assert np.allclose(a.q, b.q, atol=1e-12)


def test_accel_mag_shows_the_true_attitude_anywhere() -> None:
    rng = np.random.default_rng(4)
    q = rotation.normalize(rng.normal(size=(500, 4)))
    acc, mag = rotation.rotate_inverse(q, [0, 0, -G]), rotation.rotate_inverse(q, FIELD)
    e = attlog.estimate("accel_mag", np.arange(500) / 50, np.zeros((500, 3)), acc, mag, init="first")
    assert np.rad2deg(rotation.total_angle(rotation.earth_error(e.q, q))).max() < 1e-6


@pytest.mark.parametrize("name", ["mahony:kp=1,ki=0.3", "complementary:kp=1,ki=0.3"])
def test_the_gyro_bias_is_found_on_every_axis(name: str) -> None:
    t, gyr, acc, mag = still(np.array([1.0, 0, 0, 0]), 6000)
    bias = np.radians([2.0, -3.0, 1.0])
    e = attlog.estimate(name, t, gyr + bias, acc, mag)
    assert e.bias is not None
    assert np.allclose(e.bias[-1], bias, atol=1e-4)


def test_ki_per_sample_is_ki_per_second_times_the_rate() -> None:
    t, gyr, acc, mag = still(rotation.from_euler(0.3, 0, 0), 300)
    a = attlog.estimate("complementary:ki=0.001,ki_per=sample", t, gyr, acc, mag, q0=[1, 0, 0, 0])
    b = attlog.estimate("complementary:ki=0.1", t, gyr, acc, mag, q0=[1, 0, 0, 0])
    assert np.allclose(a.q[:-1], b.q[:-1], atol=1e-9)


def test_complementary_and_mahony_are_the_same_equations() -> None:
    rng = np.random.default_rng(6)
    t = np.arange(500) / 100
    x = [rng.normal(0, s, (500, 3)) + o for s, o in ((0.1, 0.0), (1.0, [0, 0, -G]), (1.0, FIELD))]
    a, b = (attlog.estimate(f"{n}:kp=0.8,ki=0.1,mag_gain=0.7", t, *x) for n in ("complementary", "mahony"))
    assert np.allclose(a.q, b.q, atol=1e-12)


def test_first_order_integration_costs_less_than_a_hundredth_of_a_degree_per_second() -> None:
    """At 250 Hz and 100 deg/s: the closed form is rate - atan(rate dt / 2) * 2 / dt = 0.0004 deg/s."""
    t = np.arange(2501) / 250
    gyr = np.tile([0, 0, np.radians(100.0)], (len(t), 1))
    acc = np.tile([0, 0, -G], (len(t), 1))
    exact, first = (attlog.estimate("gyro", t, gyr, acc, integrator=i) for i in ("exact", "first_order"))
    slip = np.rad2deg(rotation.heading_angle(rotation.earth_error(exact.q[-1], first.q[-1]))) / t[-1]
    assert slip == pytest.approx(100 - np.rad2deg(np.arctan(np.radians(100) / 500)) * 500, rel=1e-3)
    assert slip < 0.01


def test_accelerations_that_cancel_do_so_only_as_vectors() -> None:
    """A shake that is stronger one way than the other way is long: its mean is zero, the mean of its direction not."""
    t = np.arange(12000) / 200
    phase = np.arange(12000) % 40
    shake = np.where(phase < 10, 9.0, -3.0)
    acc = np.stack([shake, 0 * t, np.full_like(t, -G)], axis=1)
    tilt = {}
    for form in ("direction", "vector"):
        e = attlog.estimate("mahony", t, np.zeros((len(t), 3)), acc, q0=[1, 0, 0, 0], acc_form=form, ki=0)
        tilt[form] = abs(np.rad2deg(rotation.to_euler(e.q[6000:])[:, 1].mean()))
    assert tilt["vector"] < 0.5 < 2.0 < tilt["direction"]


def test_mahony_equals_the_ahrs_package_on_gravity_alone() -> None:
    """ahrs measures +g up in ENU-like axes; its update is first order with normalised input.

    It compares a sample's vectors with the attitude before, so it is given those of the sample before, as our step is.
    """
    from ahrs.filters import Mahony

    rng = np.random.default_rng(8)
    n = 400
    gyr = rng.normal(0, 0.5, (n, 3))
    acc = rng.normal([0, 0, G], 0.5, (n, 3))
    theirs = Mahony(
        gyr=gyr, acc=np.vstack([acc[:1], acc[:-1]]), frequency=100.0, k_P=0.8, k_I=1e-12, q0=[1.0, 0, 0, 0]
    ).Q
    e = attlog.estimate("mahony@xu-0.6:kp=0.8", np.arange(n) / 100, gyr * BROAD_FRD, acc * BROAD_FRD, q0=[1, 0, 0, 0])
    back = e.q * np.array([1, 1, -1, -1])
    assert np.rad2deg(rotation.total_angle(rotation.earth_error(back, theirs))).max() < 1e-6


# What the papers' filters must have in common, and what sets them apart, on closed-form motion.

SAME = {"kp": 0.8, "ki": 0.02}


def off(m: Motion, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """The true start attitude turned by body angles [rad]."""
    return rotation.multiply(m.q[0], rotation.from_rotvec((roll, pitch, yaw)))


# variable_integral (Lyu)


@pytest.mark.parametrize("forms", [{}, {"mag_form": "vector", "acc_form": "vector"}, {"ki_per": "sample"}])
def test_variable_integral_is_complementary_to_the_bit_below_err1(forms: dict[str, str]) -> None:
    m = swing(30.0, noise=Noise(gyro=1e-3, bias=(0.01, -0.02, 0.01)))
    gains = {"kp": 0.5, "mag_gain": 1.0, "ki": 1e-4 if "ki_per" in forms else 0.05, **forms}
    mine = estimate("variable_integral", *m.sensors, **gains)
    assert mine.aux["ratio"].min() == 1.0
    plain = estimate("complementary", *m.sensors, **gains)
    assert np.array_equal(mine.q, plain.q)
    assert np.array_equal(mine.bias, plain.bias)


def test_variable_integral_fades_between_err1_and_err2() -> None:
    """At rest with a tilt error of 30, 40 and 60 deg the ratio is (17) of the sine; the field is left out."""
    m = still_motion(0.1)
    for angle in (10.0, 30.0, 40.0, 60.0):
        e = estimate("variable_integral@lyu", *m.sensors, q0=off(m, roll=np.deg2rad(angle)), kp=0.0, ki=0.0)
        wanted = np.clip((0.8 - np.sin(np.deg2rad(angle))) / 0.5, 0.0, 1.0)
        assert e.aux["ratio"][1:] == pytest.approx(wanted, abs=1e-12)


def test_frozen_output_keeps_summing_and_frozen_input_does_not() -> None:
    m = still_motion(2.0)
    far = off(m, roll=np.deg2rad(60.0))
    output = estimate("variable_integral@lyu", *m.sensors, q0=far, kp=0.0, ki=0.1)
    entry = estimate("variable_integral@lyu", *m.sensors, q0=far, kp=0.0, ki=0.1, freeze="input")
    assert abs(output.bias[-1, 0]) > 0.1
    assert not entry.bias.any()
    assert total_deg(output.q[-1:], output.q[:1])[0] < 1e-6, "an output of ratio 0 moves nothing"


# mahony_dcm, mahony_passive (Huang)


def test_the_matrix_form_is_the_quaternion_form_to_integration_error() -> None:
    m = flight(60.0, 400.0)
    options = {**SAME, "acc_form": "direction", "q0": off(m, 0.5, -0.4, 0.8)}
    assert total_deg(estimate("mahony_dcm", *m.sensors, **options).q, _mahony(m, **options)).max() < 1e-5
    options["integrator"] = "first_order"
    assert total_deg(estimate("mahony_dcm", *m.sensors, **options).q, _mahony(m, **options)).max() < 0.1


def _mahony(m: Motion, **options: object) -> np.ndarray:
    return estimate("mahony", *m.sensors, **{**options, "acc_form": "direction"}).q


def test_passive_and_explicit_differ_by_tilt_times_tan_dip_on_a_steep_field() -> None:
    """TRIAD turns a wrong gravity into heading; the explicit filter's heading error uses the estimate's tilt."""
    m = still_motion(4.0)
    options = {**SAME, "ki": 0.0, "q0": off(m, roll=0.02)}
    passive = estimate("mahony_passive", *m.sensors, l1=1e6, l2=1e-6, **options).q
    explicit = _mahony(m, mag_form="heading", **options)
    assert np.abs(heading_deg(passive, m.q)).max() < 0.01
    assert np.abs(heading_deg(explicit, m.q)).max() > 0.3


def test_the_rebuilt_attitude_solves_wahba_s_problem() -> None:
    """w of (10) equals vex(Pa(R^T R_y)) with R_y from scipy, for vectors that fit badly."""
    from scipy.spatial.transform import Rotation

    from attlog.estimators.filters.mahony import rebuilt_error

    random = np.random.default_rng(2)
    for l1, l2 in ((1.0, 0.01), (1.0, 1.0), (0.2, 0.8)):
        for _ in range(20):
            q = rotation.normalize(random.standard_normal(4))
            state = np.zeros(16)
            state[:4], state[7:] = q, rotation.to_matrix(q).ravel()
            acc, mag = random.standard_normal((2, 3))
            v, field = -acc / np.linalg.norm(acc), mag / np.linalg.norm(mag)
            h = rotation.rotate(q, field)
            expected = np.array([[0.0, 0.0, 1.0], [np.hypot(h[0], h[1]), 0.0, h[2]]])
            best, _ = Rotation.align_vectors(expected, np.array([v, field]), weights=[l1, l2])
            error = rotation.to_matrix(q).T @ best.as_matrix()
            w = 0.5 * np.array([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]])
            assert rebuilt_error(state, l1, l2, acc, mag) == pytest.approx(w, abs=1e-9)


# mahony_adaptive (Xu)


def test_adaptive_is_mahony_while_only_gravity_acts() -> None:
    m = swing(20.0)
    gains = {"kp": 0.6, "ki": 0.0012, "acc_form": "direction", "q0": off(m, 0.2, 0.1, 0.3)}
    assert np.array_equal(estimate("mahony_adaptive", *m.sensors, **gains).q, estimate("mahony", *m.sensors, **gains).q)


def test_adaptive_trust_follows_the_printed_factor() -> None:
    for up, wanted in ((0.05, 1.0), (0.15, 0.5), (0.19, 0.1), (0.3, 0.0)):
        m = still_motion(0.1)
        e = estimate("mahony_adaptive:tau=0", m.t, m.gyr, (1.0 + up) * m.acc, m.mag)
        assert e.aux["trust"][1:] == pytest.approx(wanted, abs=1e-9)


def test_adaptive_does_not_tilt_in_a_long_acceleration_that_it_can_see() -> None:
    def push(t: np.ndarray) -> np.ndarray:
        return np.outer((t > 2.0) & (t < 6.0), (8.0, 0.0, 0.0))

    m = motion(lambda t: (0.0, 0.0, 0.0), 6.0, acceleration=push)
    at_once = total_deg(estimate("mahony_adaptive@xu:tau=0", *m.sensors).q, m.q).max()
    adaptive = total_deg(estimate("mahony_adaptive@xu", *m.sensors).q, m.q).max()
    fixed = total_deg(estimate("mahony@xu-0.6", *m.sensors).q, m.q).max()
    assert at_once < 1.0 < adaptive < 4.0 < 20.0 < fixed, "0.1 s pass until the mean force shows the push"


@pytest.mark.parametrize("hz", [31.0, 73.0])
def test_adaptive_corrects_its_tilt_under_vibration(hz: float) -> None:
    """15 m/s^2 across gravity: every |f| is too large, the mean force is not."""

    def shaken(t: np.ndarray) -> np.ndarray:
        return 15.0 * np.column_stack([np.sin(2 * np.pi * hz * t), np.cos(2 * np.pi * hz * t), 0.0 * t])

    m = motion(lambda t: (0.0, 0.0, 0.0), 30.0, 250.0, acceleration=shaken)
    q0 = off(m, roll=0.7)
    adaptive = total_deg(estimate("mahony_adaptive:kp=0.6", *m.sensors, q0=q0).q, m.q)
    sample_by_sample = total_deg(estimate("mahony_adaptive:kp=0.6,tau=0", *m.sensors, q0=q0).q, m.q)
    assert adaptive[-1] < 2.0
    assert sample_by_sample[-1] > 30.0


# mag_gain and Huang's factor


@pytest.mark.parametrize("name", ["mahony", "mahony_dcm", "mahony_passive", "mahony_adaptive"])
def test_mag_gain_sets_how_fast_heading_is_found(name: str) -> None:
    """A heading error that is small falls by exp(-kp mag_gain t); 0 leaves it to the gyro; tilt is untouched."""
    m = still_motion(4.0)
    at_begin = np.deg2rad(2.0)
    for gain in (0.0, 0.5, 1.0, 2.0):
        values = {"kp": 0.5, "ki": 0.0, "mag_gain": gain}
        heading = total_deg(estimate(name, *m.sensors, q0=off(m, yaw=at_begin), **values).q, m.q)
        assert heading[-1] == pytest.approx(2.0 * np.exp(-0.5 * gain * 4.0), rel=0.02)
        leaning = estimate(name, *m.sensors, q0=off(m, roll=at_begin), **values).q
        tilt = np.rad2deg(rotation.tilt_angle(rotation.earth_error(leaning, m.q)))
        assert tilt[-1] == pytest.approx(2.0 * np.exp(-0.5 * 4.0), rel=0.02)


def test_huang_s_heading_error_as_printed_has_the_factor_cos_dip() -> None:
    m = still_motion(4.0)
    h = rotation.rotate(m.q[0], m.mag[0])
    cos_dip = np.hypot(h[0], h[1]) / np.linalg.norm(h)
    assert 0.2 < cos_dip < 0.9, "else the test says nothing"
    q0 = off(m, yaw=np.deg2rad(2.0))
    for form, factor in (("sine", 1.0), ("printed", cos_dip)):
        e = estimate("mahony_dcm", *m.sensors, q0=q0, kp=0.5, ki=0.0, mag_gain=1.0, heading_error=form)
        assert total_deg(e.q, m.q)[-1] == pytest.approx(2.0 * np.exp(-0.5 * factor * 4.0), rel=0.01)


# madgwick


def test_madgwick_steps_at_most_two_beta() -> None:
    m = still_motion(5.0)
    e = estimate("madgwick:beta=0.1", m.t, m.gyr, m.acc, q0=off(m, roll=1.0))
    most = np.rad2deg(2.0 * 0.1 * 4.99)
    assert 0.7 * most < total_deg(e.q[:1], e.q[-1:])[0] < most, "part of the slope points along q and turns nothing"


def test_madgwick_estimates_a_bias_with_zeta() -> None:
    true = np.array([0.02, -0.01, 0.015])
    m = still_motion(300.0, 50.0, noise=Noise(gyro=1e-3, bias=tuple(true)))
    e = estimate("madgwick:beta=0.1,zeta=0.002", *m.sensors)
    assert e.bias[-3000:].mean(axis=0) == pytest.approx(true, abs=0.004)


# integrators


# the ahrs package on the same input


def test_mahony_and_madgwick_agree_with_the_ahrs_package() -> None:
    """Gravity only, where its conventions are ours after a flip of axes (z up, specific force up).

    It compares a sample's vectors with the attitude before; given those of the sample before it does what we do.
    """
    from ahrs.filters import Madgwick, Mahony

    m = flight(20.0)
    flip = np.array([1.0, -1.0, -1.0])
    body = np.array([1.0, 1.0, -1.0, -1.0])
    q0 = off(m, 0.2, -0.1)
    common = {
        "gyr": m.gyr * flip,
        "acc": np.vstack([m.acc[:1], m.acc[:-1]]) * flip,
        "frequency": 100.0,
        "q0": q0 * body,
    }
    theirs = Mahony(**common, k_P=0.6, k_I=1e-12).Q * body
    ours = estimate("mahony@xu-0.6:integrator=first_order,acc_form=direction", m.t, m.gyr, m.acc, q0=q0).q
    assert total_deg(ours, theirs).max() < 0.01
    theirs = Madgwick(**common, gain=0.05).Q * body
    ours = estimate("madgwick@imu:beta=0.05", m.t, m.gyr, m.acc, q0=q0).q
    assert total_deg(ours, theirs).max() < 0.01


# Presets and defaults are the numbers of their sources, within the ranges that are allowed.

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
