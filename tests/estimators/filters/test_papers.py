"""What the papers' filters must have in common, and what sets them apart, on closed-form motion."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import estimate
from attlog.testing import Motion, Noise, flight, motion, still, swing
from attlog.testing.subject import heading_deg, total_deg

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
    m = still(0.1)
    for angle in (10.0, 30.0, 40.0, 60.0):
        e = estimate("variable_integral@lyu", *m.sensors, q0=off(m, roll=np.deg2rad(angle)), kp=0.0, ki=0.0)
        wanted = np.clip((0.8 - np.sin(np.deg2rad(angle))) / 0.5, 0.0, 1.0)
        assert e.aux["ratio"][1:] == pytest.approx(wanted, abs=1e-12)


def test_frozen_output_keeps_summing_and_frozen_input_does_not() -> None:
    m = still(2.0)
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


@pytest.mark.parametrize("error", [0.02, -0.02])
def test_passive_is_explicit_to_first_order_for_heading_errors_at_any_dip(error: float) -> None:
    m = still(20.0, roll=0.4, pitch=-0.3, yaw=1.0)
    _close_to_first_order(m, rotation.turn_about_down(m.q[0], error))


@pytest.mark.parametrize("start", [(0.02, 0.0, 0.0), (0.0, -0.02, 0.0), (0.015, 0.01, -0.02)])
def test_passive_is_explicit_to_first_order_for_all_errors_on_a_horizontal_field(
    start: tuple[float, float, float],
) -> None:
    m = still(20.0, roll=0.4, pitch=-0.3, yaw=1.0)
    level = rotation.rotate_inverse(m.q, np.array([20e-6, 0.0, 0.0]))
    _close_to_first_order(Motion(m.t, m.q, m.gyr, m.acc, level), off(m, *start))


def _close_to_first_order(m: Motion, q0: np.ndarray) -> None:
    """The difference is of second order: below 3 % of an error of 0.02 rad, which squared is 2 % of it."""
    options = {**SAME, "q0": q0}
    passive = estimate("mahony_passive", *m.sensors, l1=1e6, l2=1e-6, **options).q
    explicit = _mahony(m, mag_form="heading", **options)
    assert total_deg(passive, explicit).max() < 0.03 * total_deg(q0, m.q[0])


def test_passive_and_explicit_differ_by_tilt_times_tan_dip_on_a_steep_field() -> None:
    """TRIAD turns a wrong gravity into heading; the explicit filter's heading error uses the estimate's tilt."""
    m = still(4.0)
    options = {**SAME, "ki": 0.0, "q0": off(m, roll=0.02)}
    passive = estimate("mahony_passive", *m.sensors, l1=1e6, l2=1e-6, **options).q
    explicit = _mahony(m, mag_form="heading", **options)
    assert np.abs(heading_deg(passive, m.q)).max() < 0.01
    assert np.abs(heading_deg(explicit, m.q)).max() > 0.3


def test_the_rebuilt_attitude_solves_wahba_s_problem() -> None:
    """w of (10) equals vex(Pa(R^T R_y)) with R_y from scipy, for vectors that fit badly."""
    from scipy.spatial.transform import Rotation

    from attlog.estimators.filters.mahony_passive import rebuilt_error

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
        m = still(0.1)
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


def test_adaptive_s_mean_force_knows_a_turn_from_an_acceleration() -> None:
    m = motion(lambda t: (2.0 * t, 0.0, 0.0), 20.0, 100.0)
    assert estimate("mahony_adaptive", *m.sensors).aux["trust"].min() == 1.0


# mag_gain and Huang's factor


@pytest.mark.parametrize("name", ["mahony", "mahony_dcm", "mahony_passive", "mahony_adaptive"])
def test_mag_gain_sets_how_fast_heading_is_found(name: str) -> None:
    """A heading error that is small falls by exp(-kp mag_gain t); 0 leaves it to the gyro; tilt is untouched."""
    m = still(4.0)
    at_begin = np.deg2rad(2.0)
    for gain in (0.0, 0.5, 1.0, 2.0):
        values = {"kp": 0.5, "ki": 0.0, "mag_gain": gain}
        heading = total_deg(estimate(name, *m.sensors, q0=off(m, yaw=at_begin), **values).q, m.q)
        assert heading[-1] == pytest.approx(2.0 * np.exp(-0.5 * gain * 4.0), rel=0.02)
        leaning = estimate(name, *m.sensors, q0=off(m, roll=at_begin), **values).q
        tilt = np.rad2deg(rotation.inclination_angle(rotation.error(leaning, m.q)))
        assert tilt[-1] == pytest.approx(2.0 * np.exp(-0.5 * 4.0), rel=0.02)


def test_huang_s_heading_error_as_printed_has_the_factor_cos_dip() -> None:
    m = still(4.0)
    h = rotation.rotate(m.q[0], m.mag[0])
    cos_dip = np.hypot(h[0], h[1]) / np.linalg.norm(h)
    assert 0.2 < cos_dip < 0.9, "else the test says nothing"
    q0 = off(m, yaw=np.deg2rad(2.0))
    for form, factor in (("sine", 1.0), ("printed", cos_dip)):
        e = estimate("mahony_dcm", *m.sensors, q0=q0, kp=0.5, ki=0.0, mag_gain=1.0, heading_error=form)
        assert total_deg(e.q, m.q)[-1] == pytest.approx(2.0 * np.exp(-0.5 * factor * 4.0), rel=0.01)


# madgwick


def test_madgwick_steps_at_most_two_beta() -> None:
    m = still(5.0)
    e = estimate("madgwick:beta=0.1", m.t, m.gyr, m.acc, q0=off(m, roll=1.0))
    most = np.rad2deg(2.0 * 0.1 * 4.99)
    assert 0.7 * most < total_deg(e.q[:1], e.q[-1:])[0] < most, "part of the slope points along q and turns nothing"


def test_madgwick_estimates_a_bias_with_zeta() -> None:
    true = np.array([0.02, -0.01, 0.015])
    m = still(300.0, 50.0, noise=Noise(gyro=1e-3, bias=tuple(true)))
    e = estimate("madgwick:beta=0.1,zeta=0.002", *m.sensors)
    assert e.bias[-3000:].mean(axis=0) == pytest.approx(true, abs=0.004)


# integrators


def test_first_order_and_exact_integration_differ_by_less_than_a_hundredth_of_a_degree_per_second() -> None:
    """At 250 Hz and 100 deg/s; the error of one step is (w dt)^3 / 12."""
    rate = np.deg2rad(100.0)
    m = motion(lambda t: (0.0, 0.0, rate * t), 10.0, 250.0)
    exact = estimate("gyro", *m.sensors, q0=m.q[0]).q
    first = estimate("gyro", *m.sensors, q0=m.q[0], integrator="first_order").q
    assert total_deg(exact, m.q).max() < 1e-6
    drift = total_deg(first[-1:], m.q[-1:])[0] / 10.0
    assert drift == pytest.approx(np.rad2deg((rate / 250.0) ** 3 / 12.0 * 250.0), rel=0.01)
    assert drift < 0.01


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
