"""The backward pass of the inertial-magnetic filter: against dense algebra, and on motions with known truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.estimators import estimate
from attlog.estimators.filters.inertial import backward, compass, start
from attlog.estimators.filters.inertial.model import RAD, RUNNING, STATE, E, K, N, S
from attlog.testing.motions import CONSUMER_NOISE, Motion, flight, heading_deg, motion, still, swing, tilt_deg

Array = np.ndarray


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def raw(seconds: float = 60.0) -> Motion:
    """A flight seen by a gyro with bias and scale errors."""
    m = flight(seconds, noise=replace(CONSUMER_NOISE, bias=(0.012, -0.01, 0.006)))
    return replace(m, gyr=m.gyr @ (np.eye(3) + 0.003 * np.arange(-4.0, 5.0).reshape(3, 3) / 4.0))


def recorded(m: Motion, **given: float) -> tuple[backward.ForwardRecord, Array]:
    values = backward.mekf_values(given, 60.0)
    data = [np.diff(m.t, prepend=m.t[:1]), m.gyr, m.acc, m.mag, np.full(len(m.t), np.nan)]
    return backward.forward(data, values, None), values


def test_it_equals_a_dense_smoother_written_from_the_definition() -> None:
    """x_k given x_{k+1} is read from their joint covariance; without scaling, for states that are not known exactly."""
    run, values = recorded(raw(12.0))
    back, blocks = backward.backward(run, values), run.blocks
    f = backward.transitions(blocks.sums, values)
    before, after = blocks.before.reshape(-1, N, N), blocks.after.reshape(-1, N, N)
    kept = [i for i in range(N) if after[0][i, i] > 0.0]
    first = len(blocks.end) // 2
    mean, spread = np.zeros(N), after[-1]
    for k in range(len(blocks.end) - 1, first, -1):
        joint = np.block([[after[k - 1], after[k - 1] @ f[k].T], [f[k] @ after[k - 1], before[k]]])
        cross = joint[np.ix_(kept, [N + i for i in kept])]
        gain = np.zeros((N, N))
        gain[np.ix_(kept, kept)] = cross @ np.linalg.inv(joint[N:, N:][np.ix_(kept, kept)])
        turned = Rotation.from_rotvec(mean[:3]) * Rotation.from_rotvec(blocks.error[k, :3])
        mean = gain @ np.r_[turned.as_rotvec(), mean[3:] + blocks.error[k, 3:]]
        spread = after[k - 1] + gain @ (spread - before[k]) @ gain.T
    assert back.states[first] == pytest.approx(blocks.nominal[first] + mean[3:], rel=1e-4, abs=1e-6)
    assert back.at_begin[first + 1] == pytest.approx(mean[:3], rel=1e-4, abs=1e-8)
    assert back.variance[first] == pytest.approx([spread[0, 0] + spread[1, 1], spread[2, 2]], rel=2e-4)


def test_what_an_accelerometer_bias_does_to_the_smoothed_error_is_known() -> None:
    """Smoothed attitudes of two runs whose accelerometers differ by a little, against D carried backward."""
    m, delta = swing(30.0, noise=CONSUMER_NOISE), 1e-3
    squares = np.zeros(1)
    for axis in range(3):
        q = []
        for change in (0.0, delta):
            shifted = m.acc.copy()
            shifted[:, axis] += change
            run, values = recorded(replace(m, acc=shifted), velocity_factor=0.0)
            back = backward.backward(run, values)
            q.append(backward.between(run, back, np.diff(m.t, prepend=m.t[:1]), m.gyr, 0)[0][run.blocks.end])
        turn = rotation.to_rotvec(rotation.multiply(q[1], rotation.conjugate(q[0]))) / delta
        squares = squares + np.sum(turn[:, :2] ** 2, axis=1)
    inner = slice(5, -5)
    assert np.sqrt(squares)[inner] == pytest.approx(np.sqrt(back.considered[inner, 0]), rel=0.05)


def test_what_is_constant_is_one_number_over_the_whole_run() -> None:
    """The gyro matrix has no noise: smoothed it may not move, and its sigma is that of the end everywhere."""
    run, values = recorded(raw())
    back = backward.backward(run, values)
    moved = np.abs(np.diff(run.blocks.nominal[:, 3:12], axis=0)).sum(axis=0)
    assert (np.abs(back.states[:, 3:12] - back.states[-1, 3:12]).max(axis=0) < 1e-2 * moved).all()


def test_looking_ahead_gains_on_the_filter() -> None:
    m = raw()
    smoothed, causal = (estimate(name, *m.sensors).q for name in ("smoother", "mekf"))
    early = m.t < 30.0
    for error in (tilt_deg, heading_deg):
        assert rms(error(smoothed[early], m.q[early])) < 0.5 * rms(error(causal[early], m.q[early]))


def test_the_first_samples_are_found_with_the_bias_of_the_whole() -> None:
    """A gyro bias of 4.4 deg/s would turn the alignment by 9 deg."""
    bias = np.deg2rad([4.4, -1.0, 0.5])
    m = swing(60.0, noise=replace(CONSUMER_NOISE, bias=tuple(bias)))
    e = estimate("smoother", *m.sensors)
    assert np.rad2deg(np.abs(e.bias[0] - bias).max()) < 0.05
    assert tilt_deg(e.q[:10], m.q[:10]).max() < 0.5


def test_attitudes_do_not_jump_where_blocks_meet() -> None:
    m = swing(30.0)
    e = backward.smooth(*m.sensors)
    steps = np.rad2deg(rotation.total_angle(rotation.multiply(rotation.conjugate(e.q[:-1]), e.q[1:])))
    true = np.rad2deg(rotation.total_angle(rotation.multiply(rotation.conjugate(m.q[:-1]), m.q[1:])))
    assert np.abs(steps - true).max() < 0.01


def test_a_field_that_comes_late_tells_the_heading_from_the_first_sample() -> None:
    m = swing(60.0, yaw=2.0, noise=CONSUMER_NOISE)
    mag = np.where(m.t[:, None] < 8.0, np.nan, m.mag)
    e = estimate("smoother", m.t, m.gyr, m.acc, mag)
    assert np.abs(heading_deg(e.q, m.q)).max() < 3.0
    assert tilt_deg(e.q, m.q).max() < 1.0


def test_without_magnetometer_heading_begins_at_0_and_its_sigma_is_that_of_the_drift_since() -> None:
    m = motion(lambda t: (0.3 * np.sin(t), 0.2 * np.sin(1.7 * t), 0.2 * t), 60.0, noise=CONSUMER_NOISE)
    e = backward.smooth(m.t, m.gyr, m.acc)
    assert e.quality["aided_by"] == "rest"
    assert heading_deg(e.q[:1], m.q[:1]) == pytest.approx(0.0, abs=1.5)
    sigma = np.rad2deg(e.aux["sigma_heading"].ravel())
    assert sigma[0] < 0.1 < sigma[-1]
    assert rms(heading_deg(e.q, m.q)) < 3.0 * sigma.max()


def test_without_gnss_a_heading_rests_on_the_compass_alone_or_is_none() -> None:
    m = flight(60.0, noise=CONSUMER_NOISE)
    assert estimate("smoother", *m.sensors).quality["heading_from"] == "compass"
    e = estimate("smoother", m.t, m.gyr, m.acc)
    assert e.quality["heading_from"] == "none"
    assert (e.aux["sigma_heading"] == np.pi).all()


def test_the_delay_of_the_magnetometer_is_told() -> None:
    m = motion(lambda t: (0.4 * np.sin(1.3 * t), 0.4 * np.sin(0.9 * t), t + np.sin(t)), 60.0, noise=CONSUMER_NOISE)
    late = np.vstack([m.mag[:3], m.mag[:-3]])
    assert estimate("smoother", m.t, m.gyr, m.acc, late).quality["mag_delay_ms"] == pytest.approx(30.0, abs=6.0)


def test_a_recording_shorter_than_the_alignment_gets_its_running_solution() -> None:
    m = still(1.0, roll=0.3, noise=CONSUMER_NOISE)
    e = estimate("smoother", *m.sensors)
    assert tilt_deg(e.q[10:], m.q[10:]).max() < 1.0
    assert np.isfinite(e.aux["sigma_tilt"]).all()


def test_long_recordings_get_longer_blocks_and_nearly_the_same_attitude(monkeypatch: pytest.MonkeyPatch) -> None:
    m = raw()
    fine = backward.smooth(*m.sensors)
    monkeypatch.setattr(backward, "MAX_BLOCKS", 600)
    coarse = backward.smooth(*m.sensors)
    assert rms(tilt_deg(coarse.q, fine.q)) < 0.1


def test_sigma_of_tilt_covers_the_error() -> None:
    ratios = []
    for seed in range(4):
        m = flight(60.0, noise=replace(CONSUMER_NOISE, acc=0.02), seed=seed)
        acc = m.acc + 0.03 * np.random.default_rng(seed).standard_normal(3)
        e = estimate("smoother", m.t, m.gyr, acc, m.mag)
        ratios.append(tilt_deg(e.q, m.q) / np.rad2deg(e.aux["sigma_tilt"].ravel()))
    assert 0.3 < rms(np.concatenate(ratios)) < 1.2


def test_a_raw_accelerometer_gets_more_room_for_its_bias_than_a_calibrated_one() -> None:
    """0.15 m/s^2 is 7.5 sigma of what is expected: known at once it would be 0.9 deg of tilt."""
    m = swing(90.0, noise=CONSUMER_NOISE)
    wrong = replace(m, acc=m.acc + np.array([0.15, -0.1, 0.05]))
    late = m.t > 20.0
    q = backward.smooth(*wrong.sensors).q
    assert rms(tilt_deg(q[late], m.q[late])) < 0.17
    values = backward.mekf_values({}, 60.0)
    data = [np.diff(m.t, prepend=m.t[:1]), m.gyr, m.acc, m.mag, np.full(len(m.t), np.nan)]
    expected = values[K.acc_bias_sigma]
    calibrated = backward.acc_bias_spread(backward.forward(data, values, None), expected)
    raw = backward.acc_bias_spread(backward.forward([data[0], m.gyr, wrong.acc, *data[3:]], values, None), expected)
    assert calibrated < expected < 1.5 * expected < raw


# What the covariance of ``mekf`` leaves out, on corrections whose statistics are known.


# What the alignment of ``mekf`` makes of an accelerometer's bias.


# What `mekf` makes of a field, function by function: numpy's algebra, and limits from both sides.

RANDOM = np.random.default_rng(6)


def state_of(covariance: np.ndarray | None = None) -> np.ndarray:
    state = np.zeros(sum(STATE.values()))
    if covariance is not None:
        state[S.P : S.P + N * N] = covariance.ravel()
    return state


def covariance() -> np.ndarray:
    root = 0.05 * RANDOM.normal(size=(N, N))
    return root @ root.T + 1e-3 * np.eye(N)


def parameters(**given: float) -> np.ndarray:
    out = np.zeros(len(K))
    for name, value in given.items():
        out[getattr(K, name)] = value
    return out


@pytest.mark.parametrize(
    ("value", "quiet", "seconds", "factor"),
    [(0.02, 0.0, 0.5, 1.0), (0.02, 0.0, 3.0, 0.5), (1.5, 0.0, 0.5, None), (0.02, 0.2, 0.5, "rest")],
)
def test_a_heading_is_a_kalman_update_of_heading_gyro_and_declination_alone(
    value: float, quiet: float, seconds: float, factor: float | str | None
) -> None:
    """Noise of 8 deg at 1 Hz; beyond twice the expected spread it grows with the square, at rest 5 deg are kept."""
    before, x = covariance(), 0.01 * RANDOM.normal(size=N)
    reach = RANDOM.normal(size=(3, N))
    state = state_of(before)
    state[S.x : S.x + N] = x
    state[S.reach : S.reach + 3 * N] = reach.ravel()
    state[S.quiet], state[S.field_since], state[S.field_doubt] = quiet, seconds, 0.3
    fx, fy, fz = 0.3, -0.2, 0.5
    compass.heading(state, parameters(mag_gate=2.0, mag_noise=8.0), value, fx, fy, fz, 0.25)
    h = np.zeros(N)
    h[[0, 1, 2, E.d]] = -fz * fx / 0.13, -fz * fy / 0.13, 1.0, -1.0
    spread = (8.0 * RAD) ** 2 / (0.25 * min(seconds, 1.0))
    known = before[2, 2] + before[E.d, E.d] - 2.0 * before[2, E.d]
    if factor is None:
        spread *= (value / (2.0 * math.sqrt(known + (3.0 * RAD) ** 2))) ** 2
    if factor == "rest":
        spread *= before[2, 2] / (before[2, 2] - (5.0 * RAD) ** 2)
    s = 1.0 / (h @ before @ h + spread)
    c = before @ h
    own = np.zeros(N, bool)
    own[2 : E.ba] = own[E.d :] = True
    gain = np.where(own, s * c, 0.0)
    assert state[S.x : S.x + N] == pytest.approx(x + gain * (value - h @ x))
    either = own[:, None] | own[None, :]
    assert state[S.P : S.P + N * N].reshape(N, N) == pytest.approx(before - np.where(either, s * np.outer(c, c), 0.0))
    assert state[S.reach : S.reach + 3 * N].reshape(3, N) == pytest.approx(reach - np.outer(reach @ h, gain))
    assert state[S.heading_doubt] == pytest.approx(0.3 * (1.0 - (1.0 - s * c[2]) ** 2))


def test_the_field_of_the_first_rest_is_measured_again_against_home() -> None:
    """A joint Kalman update of heading and home; a field 1.2 deg off in direction for 4 s, norm and dip as at first."""
    before = covariance()
    state = state_of(before)
    state[S.field_now : S.field_now + 3] = field = [0.3, -0.2, 0.5]
    state[S.home], state[S.home_time], state[S.home_left] = math.atan2(-0.2, 0.3) + 0.05, 8.0, 1.0
    state[S.home_norm], state[S.home_dip] = np.linalg.norm(field), math.atan2(0.5, math.hypot(0.3, 0.2))
    state[S.quiet], state[S.field_since] = 3.0, 0.1
    compass.home_field(state, parameters(home_noise=1.2))
    h = np.zeros(N)
    h[[0, 1, 2, E.home]] = -0.5 * 0.3 / 0.13, 0.5 * 0.2 / 0.13, 1.0, -1.0
    c = before @ h
    gain = c / (h @ c + (1.2 * RAD) ** 2 * 0.38 / 0.13 * 4.0 / 0.1)
    own = np.isin(np.arange(N), [*range(2, E.ba), E.d, E.home])
    assert state[S.x : S.x + N] == pytest.approx(np.where(own, 0.05 * gain, 0.0))
    assert np.diag(state[S.P : S.P + N * N].reshape(N, N)) == pytest.approx(np.diag(before) - own * gain * c)


def home_and_back(first_s: float, last_s: float, back_norm: float = 1.0, back_deg: float = 0.0) -> Motion:
    """Rest, 100 s beside iron with a gyro that is off by 0.03 deg/s there alone, rest in a field of one's own."""

    def angles(t: Array) -> tuple[Array, Array, Array]:
        along = np.clip((t - first_s) / 100.0, 0.0, 1.0)
        swings = np.clip(50.0 * along, 0.0, 1.0) * np.clip(50.0 * (1.0 - along), 0.0, 1.0)
        yaw = 0.8 * swings * np.sin(0.25 * t) + 0.7 * (1.0 - np.cos(np.pi * along))
        return 0.5 * swings * np.sin(0.9 * t), 0.4 * swings * np.sin(0.6 * t + 0.5), yaw

    m = motion(angles, first_s + 100.0 + last_s, noise=CONSUMER_NOISE)
    moving = (m.t > first_s) & (m.t < first_s + 100.0)
    back = m.t >= first_s + 100.0
    size = np.where(moving, 1.25, np.where(back, back_norm, 1.0))
    earth = rotation.from_rotvec(np.deg2rad(back_deg) * back[:, None] * [0.0, 0.0, 1.0])
    field = rotation.rotate(earth, rotation.rotate(m.q, m.mag))
    drift = np.deg2rad(0.03) * moving[:, None] * [0.0, 0.0, 1.0]
    return replace(m, gyr=m.gyr + drift, mag=size[:, None] * rotation.rotate_inverse(m.q, field))


def headings(m: Motion) -> tuple[float, float]:
    """Heading RMSE in deg with the state for the field of the first rest and without it."""
    with_home, without = (backward.smooth(*m.sensors, {"home_noise": noise}) for noise in (1.2, 0.0))
    return rms(heading_deg(with_home.q, m.q)), rms(heading_deg(without.q, m.q))


@pytest.mark.parametrize(("first_s", "last_s"), [(10.0, 6.0), (40.0, 40.0), (10.0, 3.5)])
def test_a_home_field_seen_twice_takes_the_drift_between_away(first_s: float, last_s: float) -> None:
    found, before = headings(home_and_back(first_s, last_s))
    assert found < before - 0.05


@pytest.mark.parametrize(
    ("norm", "deg"), [(1.03, 0.0), (0.97, 0.0), (1.0, 25.0), (1.0, -25.0), (1.0, 8.0), (1.0, -8.0)]
)
def test_another_field_at_the_last_rest_is_not_taken_for_home(norm: float, deg: float) -> None:
    found, before = headings(home_and_back(10.0, 6.0, norm, deg))
    assert found == pytest.approx(before, abs=0.02)


@pytest.mark.parametrize("deg", [2.0, -2.0, 4.0, -4.0, -6.0])
def test_a_field_at_the_last_rest_that_is_like_the_first_does_little_harm(deg: float) -> None:
    found, before = headings(home_and_back(10.0, 6.0, 1.0, deg))
    assert found < before + 0.3


@pytest.mark.parametrize("east_ut", [1.0, -1.0, 2.0, -2.0, 3.0, -3.0])
@pytest.mark.parametrize("last", [True, False])
def test_iron_across_north_at_one_rest_does_little_harm(east_ut: float, last: bool) -> None:
    """It changes the norm by less than 0.3 %, and the dip by less than 0.2 deg."""
    m = home_and_back(10.0, 6.0)
    here = m.t >= 110.0 if last else m.t < 10.0
    field = rotation.rotate(m.q, m.mag) + here[:, None] * [0.0, 1e-6 * east_ut, 0.0]
    found, before = headings(replace(m, mag=rotation.rotate_inverse(m.q, field)))
    assert found < before + 0.3


@pytest.mark.parametrize(("first_s", "last_s"), [(2.6, 6.0), (1.5, 6.0), (10.0, 1.2), (3.5, 4.0)])
@pytest.mark.parametrize("deg", [0.0, -3.0])
def test_a_short_rest_does_no_harm(first_s: float, last_s: float, deg: float) -> None:
    found, before = headings(home_and_back(first_s, last_s, 1.0, deg))
    assert found < before + 0.3


def test_a_field_that_comes_late_turns_all_that_is_told_in_earth_axes() -> None:
    before, reach, x = covariance(), RANDOM.normal(size=(3, N)), RANDOM.normal(size=N)
    state = state_of(before)
    state[S.reach : S.reach + 3 * N], state[S.x : S.x + N] = reach.ravel(), x
    state[S.attitude : S.attitude + 4] = q = rotation.from_euler(0.3, -0.2, 1.0)
    state[S.v : S.v + 2] = [3.0, 4.0]
    psi = math.atan2(0.4, -0.3)
    compass.first_field(state, parameters(field_sigma=4.0, heading_sigma=10.0), -0.3, 0.4, 1.0)
    c, s = math.cos(psi), math.sin(psi)
    turn = np.array([[c, s], [-s, c]])
    all_of = np.eye(N)
    for k in (0, E.v):
        all_of[k : k + 2, k : k + 2] = turn
    P_turned = all_of @ before @ all_of.T
    found = state[S.P : S.P + N * N].reshape(N, N)
    rows = np.delete(np.arange(N), [2, E.d])
    assert found[np.ix_(rows, rows)] == pytest.approx(P_turned[np.ix_(rows, rows)])
    assert found[2, rows] == pytest.approx(2.0 * P_turned[0, rows])
    assert state[S.v : S.v + 2] == pytest.approx(turn @ [3.0, 4.0])
    assert state[S.x + rows] == pytest.approx((all_of @ x)[rows])
    assert state[S.reach : S.reach + 3 * N].reshape(3, N)[:, rows] == pytest.approx((reach @ all_of.T)[:, rows])
    want = rotation.turn_about_down(q, -psi)
    assert abs(state[S.attitude : S.attitude + 4] @ want) == pytest.approx(1.0)
    assert state[S.stage] == RUNNING


def test_norm_and_dip_of_the_earths_field_are_trusted_within_nine_percent_and_3_2_degrees() -> None:
    """After 15 s of reference; a field beyond is refused at once, taken again after half a second."""

    def trusted(scale: float, dip_deg: float) -> float:
        state = state_of()
        state[S.seconds], state[S.field_since] = 0.1, 0.1
        for _ in range(200):
            assert compass.trust(state, 0.3, 0.0, 0.4) == 1.0
        assert state[S.norm] == pytest.approx(0.5)
        assert state[S.dip] == pytest.approx(math.atan2(0.4, 0.3))
        dip = math.atan2(0.4, 0.3) + dip_deg * RAD
        weight = 0.0
        for _ in range(3):
            weight = compass.trust(state, 0.5 * scale * math.cos(dip), 0.0, 0.5 * scale * math.sin(dip))
        return weight

    for scale, dip, want in (
        (1.085, 0.0, 1.0), (1.1, 0.0, 0.0), (0.915, 0.0, 1.0), (0.9, 0.0, 0.0), (1.0, 3.0, 1.0), (1.0, 3.6, 0.0),
        (1.0, -3.0, 1.0), (1.0, -3.6, 0.0),
    ):  # fmt: skip
        assert trusted(scale, dip) == want


def test_after_a_minute_of_refusal_a_field_counts_a_sixteenth() -> None:
    state = state_of()
    state[S.seconds], state[S.field_since] = 0.5, 0.5
    for _ in range(60):
        compass.trust(state, 0.3, 0.0, 0.4)
    weights = [compass.trust(state, 0.6, 0.0, 0.8) for _ in range(130)]
    assert weights[:110] == [0.0] * 110
    assert weights[-1] == 1.0 / 16.0
    refused = weights.index(1.0 / 16.0) * 0.5
    assert 59.0 <= refused <= 60.5


def test_the_doubt_of_a_field_is_its_spread_over_its_level_beyond_twelve_degrees() -> None:
    """Alternating by +-0.2 about 0.4 level and 0.3 down, in motion; and by how much it would turn the heading."""
    state = state_of()
    state[S.seconds], state[S.field_since], state[S.turned] = 0.1, 0.1, 10.0
    for k in range(3000):
        off = 0.2 if k % 2 else -0.2
        state[S.field_now : S.field_now + 3] = [0.0, 0.4 + off, 0.3 - off]
        compass.watch_field(state, 0.1)
    want = 2.0 * 0.2**2 / 0.4**2 - (12.0 * RAD) ** 2
    assert state[S.field_doubt] == pytest.approx(want, rel=0.02)
    early = state_of()
    early[S.seconds], early[S.field_since], early[S.turned] = 0.1, 0.1, 10.0
    for seconds in range(1, 25):
        for _ in range(10):
            early[S.field_now : S.field_now + 3] = [0.4, 0.0, 0.3]
            compass.watch_field(early, 0.05 * seconds)
        if seconds == 19:
            first = early[S.heading_doubt]
            assert first == early[S.field_doubt] > 0.0
    assert early[S.field_doubt] > early[S.heading_doubt] > first
    assert early[S.field_off] - (12.0 * RAD) ** 2 == pytest.approx(early[S.field_doubt])
    for _ in range(3000):
        compass.watch_field(early, 9.0)
    assert early[S.field_doubt] == pytest.approx(math.radians(104.0) ** 2)


def test_a_start_in_motion_is_less_certain_of_tilt_and_velocity() -> None:
    """A velocity of 3 m/s north that comes and goes within 2 s, beside gravity: <v^2> less its even part."""
    state, params = (
        state_of(),
        parameters(tilt_sigma=2.0, heading_sigma=25.0, velocity_sigma=0.13, align_time=1.999, moving_sigma=5.0),
    )
    state[S.attitude] = 1.0
    t = np.arange(1, 401) * 0.005
    for push in 3.0 * np.pi * np.cos(np.pi * t):
        start.align(state, params, 0.005, np.zeros(3), np.array([push, 0.0, -9.80665]), np.zeros(3))
    v = np.cumsum(0.005 * 3.0 * np.pi * np.cos(np.pi * t))
    assert state[S.v_mean] == pytest.approx(0.5 * np.mean((v - t * v[-1] / t[-1]) ** 2), rel=1e-6)
    assert np.degrees(np.sqrt([state[S.P], state[S.P + N + 1], state[S.P + 2 * N + 2]])) == pytest.approx(
        [5.0, 5.0, 25.0]
    )
    start.begin(state, parameters(tilt_sigma=8.0, moving_sigma=5.0, velocity_sigma=2.0))
    assert np.degrees(np.sqrt(state[S.P])) == pytest.approx(8.0)
    assert state[S.v_mean] == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("gyro_dps", "acc", "rests"),
    [(0.0, 0.0, True), (0.69, 0.0, True), (0.75, 0.0, False), (0.0, 0.19, True), (0.0, 0.22, False)],
)
def test_rest_is_quiet_within_0_7_deg_s_and_0_2_m_s2_of_its_own_mean(gyro_dps: float, acc: float, rests: bool) -> None:
    """A step, of which the fast low-pass (0.04 s) shows all and the slow one (0.5 s) nothing yet, at its largest."""
    state, params = state_of(), parameters(bias_sigma=0.65)
    dt = 0.001
    gain = max(abs(math.exp(-t / 0.5) - math.exp(-t / 0.04)) for t in np.arange(0.0, 1.0, dt))
    quiet = []
    for k in range(400):
        step = 1.0 if k >= 100 else 0.0
        gyr = np.array([0.0, gyro_dps * RAD / gain * step, 0.0])
        start.look_for_rest(state, params, dt, gyr, np.array([acc / gain * step, 0.0, -9.8]))
        quiet.append(state[S.quiet])
    assert quiet[99] == pytest.approx(0.1)
    assert (min(quiet[100:]) > 0.0) == rests


# How `mekf` calibrates a field, and when it takes a new one for the earth's: by numpy and from both sides.


def steady(psi: float = 0.0, rate_dps: float = 30.0, known: float = 0.0) -> np.ndarray:
    """A field of 0.3 level and 0.4 down that stays at heading ``psi`` while the body turns."""
    state = np.zeros(sum(STATE.values()))
    state[S.seconds], state[S.turned] = 0.5, 0.5 * (rate_dps * RAD) ** 2
    field = [0.3 * math.cos(psi), 0.3 * math.sin(psi), 0.4]
    state[S.field_now : S.field_now + 3] = state[S.candidate_field : S.candidate_field + 3] = field
    state[S.P + 2 * (N + 1)] = known
    return state


def looked(state: np.ndarray, seconds: float, good: bool = False) -> bool:
    """What is said after so long, in steps of half a second."""
    told = good
    for _ in range(round(seconds / 0.5)):
        told = compass.candidate(state, 0.5, good)
    return told


def test_a_field_that_stays_for_ten_seconds_of_turning_becomes_the_reference() -> None:
    state = steady()
    assert not looked(state, 9.5)
    assert state[S.norm] == 0.0
    assert looked(state, 0.5)
    assert (state[S.norm], state[S.dip]) == pytest.approx((0.5, math.atan2(0.4, 0.3)))
    assert state[S.undisturbed] == 0.5
    assert state[S.candidate_time] == 0.0
    known = steady()
    assert looked(known, 10.0, good=True)
    assert known[S.norm] == 0.0


@pytest.mark.parametrize(("rate", "counts"), [(20.5, True), (19.5, False)])
def test_it_must_turn_by_20_degrees_per_second(rate: float, counts: bool) -> None:
    state = steady(rate_dps=rate)
    looked(state, 12.0)
    assert (state[S.norm] > 0.0) == counts


@pytest.mark.parametrize(
    ("deg", "known_deg", "opens"),
    [(15.5, 0.0, False), (16.5, 0.0, True), (-16.5, 0.0, True), (19.5, 3.0, False), (20.5, 3.0, True)],
)
def test_a_heading_that_a_steady_field_contradicts_by_four_sigmas_is_opened(
    deg: float, known_deg: float, opens: bool
) -> None:
    """Sigma is that of the heading and four degrees."""
    known = (known_deg * RAD) ** 2
    state = steady(deg * RAD, known=known)
    looked(state, 10.0, good=True)
    assert state[S.P + 2 * (N + 1)] == pytest.approx(known + (deg * RAD) ** 2 * opens)


@pytest.mark.parametrize(
    ("offset", "known", "odd"), [(0.30, 0.002, 1.0), (0.02, 0.002, 1.0), (0.30, 0.0004, 1.0), (0.30, 0.0004, 30.0)]
)
def test_offset_and_delay_are_a_kalman_filters_and_the_offset_counts_beyond_four_sigmas(
    offset: float, known: float, odd: float
) -> None:
    """A component beyond three sigmas counts as if its noise were as large."""
    random = np.random.default_rng(3)
    R = Rotation.from_euler("ZYX", [40.0, -20.0, 10.0], degrees=True).as_matrix()
    rate, T, since = np.array([0.3, -0.5, 0.7]), 0.025, 0.1
    earth, o, tau = np.array([0.5, 0.1, 0.8]), offset * np.array([0.6, 0.0, -0.8]), 0.012
    P = np.diag([1e-3] * 3 + [known] * 3 + [2e-4])
    root = 1e-3 * random.normal(size=(7, 7))
    P = P + root @ root.T
    state, params = np.zeros(sum(STATE.values())), parameters()
    state[S.seconds], state[S.field_since], state[S.unit] = T, since, 2.0
    state[S.turned] = T * 0.14**2
    state[S.A : S.A + 9] = T * R.ravel()
    # R diag(w) dt, whose rows sum to R w.
    state[S.B : S.B + 27] = 0.0
    for k in range(3):
        for j in range(3):
            state[S.B + 9 * k + 4 * j] = T * R[k, j] * rate[j]
    state[S.cal : S.cal + 7] = x = np.r_[earth, o, tau]
    state[S.cal_P : S.cal_P + 49] = P.ravel()
    late = np.cross(R @ rate, earth)
    seen = 2.0 * (earth + R @ o + tau * late) + odd * np.array([0.02, -0.03, 0.01])
    found = compass.calibrated(state, params, *seen)
    P[:3, :3] += 0.01**2 * 0.4 * since * np.eye(3)
    noise = 0.023**2 * 0.6 / since
    for i in range(3):
        h = np.r_[np.eye(3)[i], R[i], late[i]]
        z, c = seen[i] / 2.0 - h @ x, P @ h
        spread, limit = noise, 9.0 * (h @ c + 0.023**2)
        spread *= max(z * z / limit, 1.0)
        s = h @ c + spread
        x, P = x + c * z / s, P - np.outer(c, c) / s
    assert state[S.cal : S.cal + 7] == pytest.approx(x)
    assert state[S.cal_P : S.cal_P + 49].reshape(7, 7) == pytest.approx(P)
    share = max(1.0 - 16.0 * np.trace(P[3:6, 3:6]) / np.sum(x[3:6] ** 2), 0.0)
    assert found == pytest.approx(seen - 2.0 * (share * R @ x[3:6] + x[6] * late))
