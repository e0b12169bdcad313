"""The backward pass of the inertial-magnetic filter: against dense algebra, and on motions with known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.estimators import estimate
from attlog.estimators.filters.inertial import backward, layout
from attlog.estimators.filters.inertial.layout import N
from attlog.testing.motion import CONSUMER, Motion, flight, motion, still, swing
from attlog.testing.subject import heading_deg, inclination_deg

Array = np.ndarray


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def raw(seconds: float = 60.0) -> Motion:
    """A flight seen by a gyro with bias and scale errors."""
    m = flight(seconds, noise=replace(CONSUMER, bias=(0.012, -0.01, 0.006)))
    return replace(m, gyr=m.gyr @ (np.eye(3) + 0.003 * np.arange(-4.0, 5.0).reshape(3, 3) / 4.0))


def recorded(m: Motion, **given: float) -> tuple[backward.ForwardRecord, Array]:
    values = backward.mekf_values(given, 60.0)
    data = [np.diff(m.t, prepend=m.t[:1]), m.gyr, m.acc, m.mag, np.full(len(m.t), np.nan)]
    return backward.forward(data, values, None), values


def test_it_equals_a_dense_smoother_written_from_the_definition() -> None:
    """x_k given x_{k+1} is read from their joint covariance; without scaling, for states that are not known exactly."""
    run, values = recorded(raw(12.0))
    back = backward.backward(run, values)
    f = backward.transitions(run.sums, values)
    kept = [i for i in range(N) if run.after[0][i, i] > 0.0]
    first = len(run.end) // 2
    mean, spread = np.zeros(N), run.after[-1]
    for k in range(len(run.end) - 1, first, -1):
        joint = np.block([[run.after[k - 1], run.after[k - 1] @ f[k].T], [f[k] @ run.after[k - 1], run.before[k]]])
        cross = joint[np.ix_(kept, [N + i for i in kept])]
        gain = np.zeros((N, N))
        gain[np.ix_(kept, kept)] = cross @ np.linalg.inv(joint[N:, N:][np.ix_(kept, kept)])
        turned = Rotation.from_rotvec(mean[:3]) * Rotation.from_rotvec(run.error[k, :3])
        mean = gain @ np.r_[turned.as_rotvec(), mean[3:] + run.error[k, 3:]]
        spread = run.after[k - 1] + gain @ (spread - run.before[k]) @ gain.T
    assert back.states[first] == pytest.approx(run.nominal[first] + mean[3:], rel=1e-4, abs=1e-6)
    assert back.at_begin[first + 1] == pytest.approx(mean[:3], rel=1e-4, abs=1e-8)
    assert back.tilt[first] == pytest.approx(np.sqrt(spread[0, 0] + spread[1, 1]), rel=1e-4)
    assert back.heading[first] == pytest.approx(np.sqrt(spread[2, 2]), rel=1e-4)


def test_what_an_accelerometer_bias_does_to_the_smoothed_error_is_known() -> None:
    """Smoothed attitudes of two runs whose accelerometers differ by a little, against D carried backward."""
    m, delta = swing(30.0, noise=CONSUMER), 1e-3
    squares = np.zeros(1)
    for axis in range(3):
        q = []
        for change in (0.0, delta):
            shifted = m.acc.copy()
            shifted[:, axis] += change
            run, values = recorded(replace(m, acc=shifted), velocity_factor=0.0)
            back = backward.backward(run, values)
            q.append(backward.between(run, back, np.diff(m.t, prepend=m.t[:1]), m.gyr, 0)[0][run.end])
        turn = rotation.to_rotvec(rotation.multiply(q[1], rotation.conjugate(q[0]))) / delta
        squares = squares + np.sum(turn[:, :2] ** 2, axis=1)
    inner = slice(5, -5)
    assert np.sqrt(squares)[inner] == pytest.approx(np.sqrt(back.considered[inner, 0]), rel=0.05)


def test_what_is_constant_is_one_number_over_the_whole_run() -> None:
    """The gyro matrix has no noise: smoothed it may not move, and its sigma is that of the end everywhere."""
    run, values = recorded(raw())
    back = backward.backward(run, values)
    moved = np.abs(np.diff(run.nominal[:, 3:12], axis=0)).sum(axis=0)
    assert (np.abs(back.states[:, 3:12] - back.states[-1, 3:12]).max(axis=0) < 1e-2 * moved).all()


def test_looking_ahead_gains_on_the_filter() -> None:
    m = raw()
    smoothed, causal = (estimate(name, *m.sensors).q for name in ("smoother", "mekf"))
    early = m.t < 30.0
    for error in (inclination_deg, heading_deg):
        assert rms(error(smoothed[early], m.q[early])) < 0.5 * rms(error(causal[early], m.q[early]))


def test_the_first_samples_are_found_with_the_bias_of_the_whole() -> None:
    """A gyro bias of 4.4 deg/s would turn the alignment by 9 deg."""
    bias = np.deg2rad([4.4, -1.0, 0.5])
    m = swing(60.0, noise=replace(CONSUMER, bias=tuple(bias)))
    e = estimate("smoother", *m.sensors)
    assert np.rad2deg(np.abs(e.bias[0] - bias).max()) < 0.05
    assert inclination_deg(e.q[:10], m.q[:10]).max() < 0.5


def test_attitudes_do_not_jump_where_blocks_meet() -> None:
    m = swing(30.0)
    e = backward.smooth(*m.sensors)
    steps = np.rad2deg(rotation.total_angle(rotation.multiply(rotation.conjugate(e.q[:-1]), e.q[1:])))
    true = np.rad2deg(rotation.total_angle(rotation.multiply(rotation.conjugate(m.q[:-1]), m.q[1:])))
    assert np.abs(steps - true).max() < 0.01


def test_a_field_that_comes_late_tells_the_heading_from_the_first_sample() -> None:
    m = swing(60.0, yaw=2.0, noise=CONSUMER)
    mag = np.where(m.t[:, None] < 8.0, np.nan, m.mag)
    e = estimate("smoother", m.t, m.gyr, m.acc, mag)
    assert np.abs(heading_deg(e.q, m.q)).max() < 3.0
    assert inclination_deg(e.q, m.q).max() < 1.0


def test_without_magnetometer_heading_begins_at_0_and_its_sigma_is_that_of_the_drift_since() -> None:
    m = motion(lambda t: (0.3 * np.sin(t), 0.2 * np.sin(1.7 * t), 0.2 * t), 60.0, noise=CONSUMER)
    e = backward.smooth(m.t, m.gyr, m.acc)
    assert e.quality["aided_by"] == "rest"
    assert heading_deg(e.q[:1], m.q[:1]) == pytest.approx(0.0, abs=1.5)
    sigma = np.rad2deg(e.aux["sigma_heading"].ravel())
    assert sigma[0] < 0.1 < sigma[-1]
    assert rms(heading_deg(e.q, m.q)) < 3.0 * sigma.max()


def test_without_gnss_a_heading_rests_on_the_compass_alone_or_is_none() -> None:
    m = flight(60.0, noise=CONSUMER)
    assert estimate("smoother", *m.sensors).quality["heading_from"] == "compass"
    e = estimate("smoother", m.t, m.gyr, m.acc)
    assert e.quality["heading_from"] == "nobody"
    assert (e.aux["sigma_heading"] == np.pi).all()


def test_the_delay_of_the_magnetometer_is_told() -> None:
    m = motion(lambda t: (0.4 * np.sin(1.3 * t), 0.4 * np.sin(0.9 * t), t + np.sin(t)), 60.0, noise=CONSUMER)
    late = np.vstack([m.mag[:3], m.mag[:-3]])
    assert estimate("smoother", m.t, m.gyr, m.acc, late).quality["mag_delay_ms"] == pytest.approx(30.0, abs=6.0)


def test_a_recording_shorter_than_the_alignment_gets_its_running_solution() -> None:
    m = still(1.0, roll=0.3, noise=CONSUMER)
    e = estimate("smoother", *m.sensors)
    assert inclination_deg(e.q[10:], m.q[10:]).max() < 1.0
    assert np.isfinite(e.aux["sigma_tilt"]).all()


def test_long_recordings_get_longer_blocks_and_nearly_the_same_attitude(monkeypatch: pytest.MonkeyPatch) -> None:
    m = raw()
    fine = backward.smooth(*m.sensors)
    monkeypatch.setattr(backward, "MOST_BLOCKS", 600)
    coarse = backward.smooth(*m.sensors)
    assert rms(inclination_deg(coarse.q, fine.q)) < 0.1


def test_sigma_of_tilt_covers_the_error() -> None:
    ratios = []
    for seed in range(4):
        m = flight(60.0, noise=replace(CONSUMER, acc=0.02), seed=seed)
        acc = m.acc + 0.03 * np.random.default_rng(seed).standard_normal(3)
        e = estimate("smoother", m.t, m.gyr, acc, m.mag)
        ratios.append(inclination_deg(e.q, m.q) / np.rad2deg(e.aux["sigma_tilt"].ravel()))
    assert 0.3 < rms(np.concatenate(ratios)) < 1.2


def test_a_raw_accelerometer_gets_more_room_for_its_bias_than_a_calibrated_one() -> None:
    """0.15 m/s^2 is 7.5 sigma of what is expected: known at once it would be 0.9 deg of tilt."""
    m = swing(90.0, noise=CONSUMER)
    wrong = replace(m, acc=m.acc + np.array([0.15, -0.1, 0.05]))
    late = m.t > 20.0
    q = backward.smooth(*wrong.sensors).q
    assert rms(inclination_deg(q[late], m.q[late])) < 0.17
    values = backward.mekf_values({}, 60.0)
    data = [np.diff(m.t, prepend=m.t[:1]), m.gyr, m.acc, m.mag, np.full(len(m.t), np.nan)]
    expected = values[layout.ACC_BIAS_SIGMA]
    calibrated = backward.acc_bias_spread(backward.forward(data, values, None), expected)
    raw = backward.acc_bias_spread(backward.forward([data[0], m.gyr, wrong.acc, *data[3:]], values, None), expected)
    assert calibrated < expected < 1.5 * expected < raw
