"""EKF2's pieces against closed forms, finite differences and the Joseph form; no log is needed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators import error_state as core
from attlog.estimators.ekf2 import observations as obs
from attlog.estimators.ekf2 import state as s
from attlog.estimators.ekf2.loop import Samples, run_filter
from attlog.estimators.ekf2.parameters import settings_of
from attlog.estimators.ekf2.run import down_sample
from attlog.estimators.rerun import local_ned

RNG = np.random.default_rng(7)


def rotation_of(q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


KNOWN = s.Known(
    era=s.ERA_D,
    reset_in_climb=1,
    latitude=0.8,
    declination=0.1,
    inclination=1.1,
    strength=0.5,
    step_s=0.01,
    length=20,
    plane=0,
    n_gnss=1,
    n_baro=1,
    flown_alignment=0,
    flown_emergency=0,
    brief_checks=0,
    imu_period=0.01,
)


def parameters(**changes: float) -> s.Parameters:
    """Default parameters of 1.16 with some changed."""
    setting = settings_of({}, (1, 16)) | changes
    return s.Parameters(*(setting[name.upper()] for name in s.Parameters._fields))


def new() -> core.Filter:
    """A filter with a random attitude, field and covariance."""
    f = core.new_filter(int(KNOWN.length), 1000, s.N_CONTROL)
    q = RNG.normal(size=4)
    f.x[:4] = q / np.linalg.norm(q)
    f.x[4:] = RNG.normal(size=20) * 0.1
    f.x[16:19] = 0.2, 0.03, 0.4
    a = RNG.normal(size=(23, 23)) * 0.05
    f.P[:] = a @ a.T + 1e-4 * np.eye(23)
    core.rotation(f.x, f.r)
    return f


def moved(x: np.ndarray, error: np.ndarray) -> np.ndarray:
    """The state with an error applied: q = exp(theta) * q, the rest added."""
    out = x.copy()
    q = Rotation.from_rotvec(error[:3]) * Rotation.from_quat(x[:4], scalar_first=True)
    out[:4] = q.as_quat(scalar_first=True)
    out[4:] += error[3:]
    return out


def jacobian(f: core.Filter, n: int) -> np.ndarray:
    """The sparse H that the filter prepared, as a dense row."""
    row = np.zeros(23)
    row[f.h_index[:n]] = f.h_value[:n]
    return row


def difference(h, x: np.ndarray) -> np.ndarray:
    """Central differences of a scalar observation over the error state."""
    step = 1e-6
    return np.array([(h(moved(x, step * e)) - h(moved(x, -step * e))) / (2 * step) for e in np.eye(23)])


@pytest.mark.parametrize("axis", range(3))
def test_the_jacobian_of_a_field_axis_is_that_of_finite_differences(axis: int) -> None:
    f = new()
    obs.fuse_axis(f, np.zeros(3), axis, 0.01)

    def h(x: np.ndarray) -> float:
        return float((rotation_of(x[:4]).T @ x[16:19] + x[19:22])[axis])

    assert jacobian(f, 7) == pytest.approx(difference(h, f.x), abs=1e-7)


def test_the_jacobian_of_heading_is_that_of_finite_differences() -> None:
    f = new()
    f.x[:4] = Rotation.from_euler("ZYX", [40, 20, -15], degrees=True).as_quat(scalar_first=True)
    core.rotation(f.x, f.r)
    before = f.x.copy()
    obs.fuse_heading(f, core.heading_of(f.x), 0.09, 1e3, False, f.mask, 0.0, 1.0, False)

    def h(x: np.ndarray) -> float:
        r = rotation_of(x[:4])
        return math.atan2(r[1, 0], r[0, 0])

    assert jacobian(f, 3) == pytest.approx(difference(h, before), abs=1e-6)


def test_the_jacobian_of_sideslip_is_that_of_finite_differences() -> None:
    f = new()
    f.x[4:7] = rotation_of(f.x[:4]) @ [15.0, 1.0, 0.5]
    f.c[s.WIND_ON] = 1.0
    before = f.x.copy()
    obs.fuse_wind(f, parameters(), 0.0, 0.0)

    def h(x: np.ndarray) -> float:
        air = rotation_of(x[:4]).T @ (x[4:7] - np.array([x[22], x[23], 0.0]))
        return float(air[1] / air[0])

    assert jacobian(f, 8) == pytest.approx(difference(h, before), abs=1e-6)


def test_the_covariance_of_a_step_is_that_of_the_transition_by_finite_differences() -> None:
    f = new()
    f.rate[:], f.force[:] = (0.3, -0.2, 0.5), (1.0, -2.0, -9.0)
    f.noise[:] = 0.0
    dt = 0.01

    def step(x: np.ndarray) -> np.ndarray:
        """The strapdown step of a state, its biases taken from fixed rates."""
        g = f._replace(
            x=x.copy(),
            r=np.zeros((3, 3)),
            rate=f.rate - (x[10:13] - f.x[10:13]),
            force=f.force - (x[13:16] - f.x[13:16]),
        )
        core.rotation(g.x, g.r)
        core.strapdown(g, KNOWN.latitude, dt, True)
        return g.x

    centre = step(f.x)

    def apart(x: np.ndarray) -> np.ndarray:
        turn = Rotation.from_quat(x[:4], scalar_first=True) * Rotation.from_quat(centre[:4], scalar_first=True).inv()
        return np.concatenate([turn.as_rotvec(), x[4:] - centre[4:]])

    step_size = 1e-5
    F = np.column_stack(
        [
            (apart(step(moved(f.x, step_size * e))) - apart(step(moved(f.x, -step_size * e)))) / (2 * step_size)
            for e in np.eye(23)
        ]
    )
    expected = F @ f.P @ F.T
    core.predict_covariance(f, dt)
    rest = np.r_[0:6, 9:23]  # the position's half squares of a step are left out
    assert f.P[np.ix_(rest, rest)] == pytest.approx(expected[np.ix_(rest, rest)], abs=1e-4)
    assert f.P == pytest.approx(expected, abs=1e-4)


def test_a_masked_update_is_the_joseph_form() -> None:
    f = new()
    obs.fuse_axis(f, np.zeros(3), 0, 0.01)
    h, before = jacobian(f, 7), f.P.copy()
    variance = core.innovation_variance(f, 7, 0.01)
    mask = np.ones(23)
    mask[[0, 1, 9, 10]] = 0.0
    gain = mask * (before @ h) / variance
    joseph = (np.eye(23) - np.outer(gain, h)) @ before @ (np.eye(23) - np.outer(gain, h)).T + 0.01 * np.outer(
        gain, gain
    )
    core.update(f, variance, 0.02, mask)
    assert f.P == pytest.approx(joseph, abs=1e-12)


def test_a_declination_pulls_the_earth_field_to_it() -> None:
    f = new()
    before = abs(core.wrap(math.atan2(f.x[17], f.x[16]) - 0.3))
    obs.fuse_declination(f, 0.3, 0.02, f.mask)
    assert abs(core.wrap(math.atan2(f.x[17], f.x[16]) - 0.3)) < before


def samples(seconds: float, rate_hz: float, gyro, acc, still: bool = True) -> Samples:
    """Samples of a vehicle on the ground with a body rate and force, without magnetometer and GNSS."""
    n = int(seconds * rate_hz)
    dt = 1.0 / rate_hz
    imu = np.column_stack([np.full(n, dt), np.tile(gyro, (n, 1))]).astype(np.float64)
    per_step = max(round(0.01 / dt), 1)
    k = n // per_step
    steps = np.full((k, 14), -1.0)
    steps[:, 0] = (np.arange(k) + 1) * per_step * dt
    steps[:, 1:4], steps[:, 4:7], steps[:, 7] = gyro, acc, per_step * dt
    steps[:, 9], steps[:, 10] = 1.0, float(still)
    steps[:, 12] = (np.arange(k) + 1) * per_step - 1
    empty = np.zeros
    return Samples(
        imu, steps, empty((0, 6)), empty((0, 13)), empty((0, 3)), empty((0, 3)), empty((0, 3)), empty((0, 2))
    )


def test_a_vehicle_at_rest_reaches_tilt_alignment_and_its_tilt() -> None:
    f = new()
    f.P[:], f.x[:] = 0.0, 0.0
    f.x[0] = 1.0
    tilt = Rotation.from_euler("ZYX", [0, 10, -20], degrees=True)
    data = samples(4.0, 100.0, np.array([0.002, -0.001, 0.003]), tilt.inv().apply([0, 0, -core.G]))
    out_q, out_steps = np.full((len(data.imu), 4), np.nan), np.full((len(data.steps), 25), np.nan)
    run_filter(f, parameters(), KNOWN, data, 0, len(data.steps), out_q, out_steps)
    assert f.c[s.TILT] == 1.0
    assert np.degrees((Rotation.from_quat(out_q[-1], scalar_first=True) * tilt.inv()).magnitude()) < 0.3
    assert f.x[10:13] == pytest.approx([0.002, -0.001, 0.003], abs=5e-4)
    assert np.array_equal(f.P, f.P.T)
    assert np.linalg.eigvalsh(f.P).min() > -1e-12


def test_the_output_follows_a_jump_of_the_filter_by_half_within_the_horizon() -> None:
    """The output is pulled by 0.5 dt / horizon a sample and seen a horizon late: 1/2 after one, 7/8 after two."""
    length, jump = 20, 10.0
    f, par = new(), parameters(HEAD_NOISE=0.001, MAG_CHECK=0, DECL_TYPE=0)
    known = KNOWN._replace(era=s.ERA_A, declination=0.0, flown_alignment=1)
    f.x[:], f.P[:] = 0.0, np.eye(23) * 1e-12
    f.x[0], f.x[16], f.x[18] = 1.0, 0.2, 0.4
    f.P[2, 2] = 0.1
    f.c[s.TILT] = f.c[s.YAW] = 1.0
    for i in (s.T_HEADING, s.T_FALSE, s.T_ZERO):
        f.c[i] = 1e9
    data = samples(3.0, 100.0, np.zeros(3), np.array([0.0, 0.0, -core.G]), still=False)
    field = Rotation.from_euler("z", -jump, degrees=True).apply([0.2, 0.0, 0.4])
    data = data._replace(mag=np.array([[1.0, 1.0, *field, 1.0]]))
    out_q, out_steps = np.full((len(data.imu), 4), np.nan), np.full((len(data.steps), 25), np.nan)
    run_filter(f, par, known, data, 0, len(data.steps), out_q, out_steps)
    heading = np.degrees(2 * np.arctan2(out_q[:, 3], out_q[:, 0])) / jump
    at = int(np.flatnonzero(data.steps[:, 0] >= 1.0 - 1e-9)[0]) + length - 1
    assert np.degrees(core.heading_of(f.x)) == pytest.approx(jump, abs=0.1)
    assert heading[at] == pytest.approx(0.0, abs=0.03)
    assert heading[at + length] == pytest.approx(1 / 2, abs=0.05)
    assert heading[at + 2 * length] == pytest.approx(7 / 8, abs=0.05)


def test_steps_keep_rotation_and_velocity_change_of_their_samples() -> None:
    n, dt = 4, 0.0025
    gyro = np.ascontiguousarray(RNG.normal(size=(n, 3)))
    acc = np.ascontiguousarray(RNG.normal(size=(n, 3)) * 5)
    steps = np.zeros((1, 14))
    down_sample.function(
        gyro, acc, np.full(n, dt), np.zeros(n), n, np.zeros(4), np.zeros(4), np.zeros((3, 3)), np.zeros(3), steps
    )
    turn = Rotation.identity()
    velocity = np.zeros(3)
    for w, a in zip(gyro, acc, strict=True):
        middle = turn * Rotation.from_rotvec(0.5 * w * dt)
        velocity += middle.apply(a) * dt
        turn = turn * Rotation.from_rotvec(w * dt)
    assert (Rotation.from_rotvec(steps[0, 1:4] * steps[0, 7]).inv() * turn).magnitude() < 1e-12
    assert turn.apply(steps[0, 4:7] * steps[0, 7]) == pytest.approx(velocity, abs=1e-5)


def test_local_north_and_east_are_metres() -> None:
    north, east = local_ned(np.array([47.001]), np.array([8.001]), 47.0, 8.0)
    assert north[0] == pytest.approx(6371000 * np.radians(0.001), rel=1e-4)
    assert east[0] == pytest.approx(6371000 * np.radians(0.001) * math.cos(math.radians(47)), rel=1e-4)


def test_settings_come_from_the_log_and_defaults_from_the_version() -> None:
    assert settings_of({}, (1, 10))["BARO_NOISE"] == 2.0
    assert settings_of({}, (1, 15))["BARO_NOISE"] == 3.5
    assert settings_of({"EKF2_MAG_NOISE": 0.08}, (1, 15))["MAG_NOISE"] == 0.08
    assert settings_of({"EKF2_AID_MASK": 0}, (1, 12))["GPS_CTRL"] == 0.0
    assert settings_of({"SENS_GPS0_DELAY": 90}, (1, 18))["GPS_DELAY"] == 90


def flight(seconds: float, heading_deg: float, **known: float) -> tuple[core.Filter, Samples, s.Known]:
    """A level flight with GNSS at 5 Hz that turns velocity about; the filter's heading is off by ``heading_deg``."""
    f = core.new_filter(int(KNOWN.length), 5000, s.N_CONTROL)
    f.P[:] = np.eye(23) * 1e-4
    f.x[:4] = Rotation.from_euler("z", heading_deg, degrees=True).as_quat(scalar_first=True)
    for i in (s.TILT, s.YAW, s.GNSS_ON, s.GNSS_CHECKED):
        f.c[i] = 1.0
    f.c[s.GOOD_SINCE] = f.c[s.T_LANDED] = core.NEVER
    data = samples(seconds, 100.0, np.zeros(3), np.zeros(3), still=False)
    t = data.steps[:, 0]
    data.steps[:, 4:7] = np.column_stack([12.0 * np.sin(t), np.zeros(len(t)), np.full(len(t), -core.G)])
    data.steps[:, 9] = 0.0
    at = np.arange(0.2, seconds, 0.2)
    north, velocity = 12.0 * (at - np.sin(at)), 12.0 * (1.0 - np.cos(at))
    zero, one = np.zeros(len(at)), np.ones(len(at))
    gnss = np.column_stack([at, at, north, zero, zero, velocity, zero, zero, one, one, 0.3 * one, 3 * one, 12 * one])
    bank = np.column_stack([at, zero, np.full(len(at), math.radians(5.0) ** 2)])
    return f, data._replace(gnss=gnss, gsf=bank), KNOWN._replace(**known)


def fly(f: core.Filter, data: Samples, known: s.Known) -> np.ndarray:
    """Run all steps; return what the loop writes of each."""
    out_q, out_steps = np.full((len(data.imu), 4), np.nan), np.full((len(data.steps), 25), np.nan)
    run_filter(f, parameters(), known, data, 0, len(data.steps), out_q, out_steps)
    return out_steps


def test_a_heading_far_off_is_reset_to_the_bank_after_a_second_of_refused_velocity() -> None:
    f, data, known = flight(6.0, 90.0)
    fly(f, data, known)
    assert f.c[s.MAG_FAULT] == 1.0
    assert abs(np.degrees(core.heading_of(f.x))) < 3.0
    f, data, known = flight(6.0, 90.0, flown_emergency=1)  # the log has no such reset
    fly(f, data, known)
    assert f.c[s.MAG_FAULT] == 0.0
    assert np.degrees(core.heading_of(f.x)) > 30.0


@pytest.mark.parametrize("brief_checks", [0, 1])
def test_a_receiver_without_fix_is_left_after_7_s_and_taken_again_after_1_s(brief_checks: int) -> None:
    f, data, known = flight(20.0, 0.0, brief_checks=brief_checks)
    lost = (data.gnss[:, 0] > 5.0) & (data.gnss[:, 0] < 15.0)
    data.gnss[lost, 11] = 0.0
    data.gnss[lost, 5] += 50.0
    on = fly(f, data, known)[:, 13]
    switched = data.steps[1:, 0][np.diff(np.nan_to_num(on, nan=1.0)) != 0]
    assert switched[:2] == pytest.approx([5.0 + 7.0, 15.0 + 1.0], abs=0.25)
    assert abs(f.x[4] - 12.0 * (1.0 - math.cos(19.8))) < 1.0, "samples without fix were not fused"


def test_logged_use_of_gnss_goes_before_the_filters_own_checks() -> None:
    f, data, known = flight(6.0, 0.0)
    data.steps[:, 13] = (data.steps[:, 0] < 2.0) | (data.steps[:, 0] > 4.0)
    on = fly(f, data, known)[:, 13]
    assert data.steps[1:, 0][np.diff(np.nan_to_num(on, nan=1.0)) != 0] == pytest.approx([2.0, 4.0], abs=0.21)


def test_a_turning_vehicle_is_that_of_exact_integration() -> None:
    """Turning in place on the turning earth for a minute, with biases known and nothing to learn."""
    f, data, known = flight(60.0, 0.0)
    f.P[:] = np.eye(23) * 1e-12
    data = data._replace(gnss=np.zeros((0, 13)))
    data.steps[:, 13] = -1.0
    f.c[s.T_GNSS] = f.c[s.T_HEADING] = f.c[s.T_FALSE] = 1e9
    spin, dt = np.array([0.3, -0.2, 0.5]), 0.01
    earth = core.EARTH_RATE * np.array([math.cos(known.latitude), 0.0, -math.sin(known.latitude)])
    turn = Rotation.identity()
    for k in range(len(data.steps)):
        data.steps[k, 1:4] = spin + turn.inv().apply(earth)
        data.imu[k, 1:4] = data.steps[k, 1:4]
        turn = turn * Rotation.from_rotvec(spin * dt)
        data.steps[k, 4:7] = turn.inv().apply([0.0, 0.0, -core.G])
    fly(f, data, known)
    exact = Rotation.from_rotvec(spin * dt * (len(data.steps) - int(known.length) + 1))
    error = Rotation.from_quat(f.x[:4], scalar_first=True) * exact.inv()
    assert np.degrees(error.magnitude()) < 0.01
    assert np.linalg.norm(f.x[4:7]) < 0.05


@pytest.mark.parametrize("era", [s.ERA_A, s.ERA_B, s.ERA_C, s.ERA_D])
def test_the_covariance_stays_symmetric_and_positive_over_an_hour(era: int) -> None:
    for seconds in (60.0, 600.0, 3600.0):
        f, data, known = flight(seconds, 2.0, era=era)
        at = np.arange(0.1, seconds, 0.1)
        field = np.tile([0.2, 0.02, 0.4], (len(at), 1)) + 0.01 * RNG.normal(size=(len(at), 3))
        data = data._replace(mag=np.column_stack([at, at, field, np.ones(len(at))]))
        fly(f, data, known)
        assert np.array_equal(f.P, f.P.T)
        assert np.linalg.eigvalsh(f.P / np.sqrt(np.outer(np.diag(f.P) + 1e-12, np.diag(f.P) + 1e-12))).min() > -1e-9
        assert np.abs(np.degrees(core.heading_of(f.x))) < 10.0
