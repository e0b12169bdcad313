"""The inertial-magnetic error-state filter against dense algebra, numerical Jacobians and motions with known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, Out1, Out2
from attlog.estimators import estimate, get
from attlog.estimators.aids import SIZE
from attlog.estimators.filters import mekf
from attlog.estimators.filters.inertial import backward, compass, start
from attlog.estimators.filters.inertial.model import MOVING_RATE, RUNNING, E, N, S
from attlog.estimators.filters.mekf import step as mekf_step
from attlog.testing.motions import CONSUMER_NOISE, Motion, Noise, flight, heading_deg, motion, still, swing, tilt_deg

Array = np.ndarray


def parameters(**given: float) -> Array:
    e = get("mekf")
    return e.pack({p.name: p.default for p in e.parameters} | given)


def running(seed: int = 0) -> Array:
    """A state in the middle of a run: any attitude, biases, gyro matrix and covariance."""
    random = np.random.default_rng(seed)
    state = mekf.start(parameters(), np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    state[S.attitude : S.M] = rotation.normalize(random.standard_normal(4))
    state[S.bias : S.bias + 3] = 0.05 * random.standard_normal(3)
    state[S.M : S.ba] = 0.01 * random.standard_normal(9)
    state[S.ba : S.v] = 0.1 * random.standard_normal(3)
    root = random.standard_normal((N, N)) * np.repeat([0.03, 0.01, 0.004, 0.03, 0.3, 0.05], [3, 3, 9, 3, 2, 2])[:, None]
    state[S.P : S.P + N * N] = (root @ root.T).ravel()
    state[S.stage] = RUNNING
    return state


def moved(state: Array, x: Array) -> Array:
    """The state with the error x in it."""
    new = state.copy()
    new[S.x : S.x + N] = x
    mekf.inject_error(new)
    return new


def apart(a: Array, b: Array) -> Array:
    """The error (N,) that leads from state b to state a."""
    theta = rotation.to_rotvec(rotation.multiply(a[S.attitude : S.M], rotation.conjugate(b[S.attitude : S.M])))
    return np.concatenate([theta, a[S.bias : S.bias + 3] - b[S.bias : S.bias + 3], a[S.M : S.P] - b[S.M : S.P]])


def transition(state: Array) -> Array:
    """F of (4, 5) from the block's sums, written out."""
    f = np.eye(N)
    a = state[S.A : S.A + 9].reshape(3, 3)
    f[0:3, 3:6] -= a
    f[0:3, 6:15] += state[S.B : S.B + 27].reshape(3, 9)
    f[E.v, 1] += state[S.impulse + 2]
    f[E.v + 1, 0] -= state[S.impulse + 2]
    f[E.v : E.v + 2, 15:18] -= a[:2]
    return f


def sampled(state: Array) -> Array:
    """The state after one block of five samples of quick motion."""
    new = state.copy()
    for k in range(5):
        gyr = np.array([1.0 + 0.1 * k, -2.0, 0.7])
        acc = np.array([3.0, -1.0 + k, -9.0])
        mekf.sample(new, 0.005, gyr, acc, np.zeros(3))
    return new


def test_the_transition_is_the_numerical_one_but_for_velocity_from_heading() -> None:
    state = running()
    after = sampled(state)
    numerical = np.empty((N, N))
    for j in range(N):
        x = np.zeros(N)
        x[j] = 1e-5
        numerical[:, j] = apart(sampled(moved(state, x)), sampled(moved(state, -x))) / 2e-5
    f = transition(after)
    assert numerical[E.v, 2] == pytest.approx(-after[S.impulse + 1], abs=0.02)
    assert numerical[E.v + 1, 2] == pytest.approx(after[S.impulse], abs=0.02)
    numerical[E.v : E.v + 2, 2] = 0.0
    # Terms of second order within the block of 25 ms are left out.
    assert f[:3] == pytest.approx(numerical[:3], abs=1e-3)
    assert f[E.v : E.v + 2] == pytest.approx(numerical[E.v : E.v + 2], abs=0.02)
    assert f[3 : E.v] == pytest.approx(numerical[3 : E.v], abs=1e-9)


def test_the_covariance_moves_as_the_dense_one() -> None:
    state = sampled(running())
    f, p = transition(state), state[S.P : S.P + N * N].reshape(N, N).copy()
    values = parameters(field_sigma=3.0)
    time, turned = state[S.seconds], state[S.turned]
    moving = min(1.0, np.sqrt(turned / time) / MOVING_RATE)
    keep = np.exp(-time * moving / 60.0)
    f[E.d, E.d] = keep
    noise = np.deg2rad(values[1]) ** 2 * time + values[2] ** 2 * turned
    walk = np.deg2rad(values[3]) ** 2 * time
    local = np.deg2rad(3.0) ** 2 * (1.0 - keep**2)
    velocity = values[8] ** 2 * time
    q = np.repeat([noise, walk, 0.0, velocity, local, 0.0], [3, 3, 12, 2, 1, 1])
    mekf.predict(state, values)
    assert state[S.P : S.P + N * N].reshape(N, N) == pytest.approx(f @ p @ f.T + np.diag(q), abs=1e-14)


def joseph(p: Array, h: Array, k: Array, r: float) -> Array:
    """The covariance after an update with any gain k."""
    a = np.eye(N) - np.outer(k, h)
    return a @ p @ a.T + r * np.outer(k, k)


def test_a_measured_state_updates_as_a_dense_filter_does() -> None:
    state = running(1)
    p, h, r = state[S.P : S.P + N * N].reshape(N, N).copy(), np.eye(N)[E.v], 0.2
    k = p @ h / (h @ p @ h + r)
    mekf.update(state, E.v, 0.4, r)
    assert state[S.x : S.x + N] == pytest.approx(0.4 * k, abs=1e-14)
    assert state[S.P : S.P + N * N].reshape(N, N) == pytest.approx(joseph(p, h, k, r), abs=1e-14)


def test_the_field_corrects_heading_gyro_and_its_own_direction_and_nothing_else() -> None:
    """Update (8) against a dense Schmidt filter in Joseph's form, its H against the numerical derivative of psi."""
    state, field = running(2), np.array([20.0, 3.0, 43.0])
    state[S.field_since] = 0.02
    p = state[S.P : S.P + N * N].reshape(N, N).copy()
    psi = np.arctan2(field[1], field[0])
    h = np.zeros(N)
    for j in range(3):
        turn = np.zeros(3)
        turn[j] = 1e-6
        x = rotation.rotate(rotation.from_rotvec(turn), field)
        h[j] = (np.arctan2(x[1], x[0]) - psi) / 1e-6
    h[E.d] = -1.0
    r = np.deg2rad(14.0) ** 2 / 0.02
    k = np.where(np.isin(np.arange(N), [*range(2, E.ba), E.d, E.home]), p @ h, 0.0) / (h @ p @ h + r)
    compass.heading(state, parameters(), -0.05, *field, 1.0)
    assert state[S.x : S.x + N] == pytest.approx(-0.05 * k, rel=1e-4, abs=1e-12)
    assert state[S.P : S.P + N * N].reshape(N, N) == pytest.approx(joseph(p, h, k, r), abs=1e-7)


def test_another_prior_is_one_more_measurement() -> None:
    """P and ba after a change of the prior are those of a filter that had the new one from the start."""
    values = parameters(acc_bias_sigma=0.02)

    def begun(sigma: float) -> Array:
        state = running(5)
        p = np.diag(np.repeat([1e-6, 1e-9, 1e-9, sigma**2, 1.0, 0.0], [3, 3, 9, 3, 2, 2]))
        state[S.P : S.P + N * N], state[S.ba : S.v], state[S.x : S.x + N] = p.ravel(), 0.0, 0.0
        state[S.impulse + 2] = -9.8
        state[S.A : S.A + 9] = np.eye(3).ravel()
        state[S.seconds] = 1.0
        for k in range(6):
            state[S.x : S.x + N] = transition(state) @ state[S.x : S.x + N]
            mekf.predict(state, values)
            mekf.update(state, E.v + k % 2, 1.0 - 0.3 * k, 0.01)
        mekf.inject_error(state)
        state[S.x : S.x + N] = 0.0
        return state

    state = begun(0.02)
    state[S.expected], state[S.expect_time] = 0.02**2, 5.0
    mekf.expect(state, values)
    mekf.inject_error(state)
    new = np.sqrt(state[S.expected])
    assert new > 0.025
    wanted = begun(new)
    assert state[S.P : S.P + N * N] == pytest.approx(wanted[S.P : S.P + N * N], rel=1e-9, abs=1e-15)
    assert state[S.ba : S.v] == pytest.approx(wanted[S.ba : S.v], rel=1e-6, abs=1e-9)


def test_a_raw_accelerometer_gets_room_for_its_bias() -> None:
    """0.15 m/s^2 is 9 sigma of what is expected, and 0.9 deg of tilt where it is not found."""
    m = swing(120.0, noise=CONSUMER_NOISE)
    wrong = replace(m, acc=m.acc + np.array([0.15, -0.1, 0.05]))
    assert errors(wrong, 40.0)[0] < 0.3


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def errors(m: Motion, after: float, **given: float) -> tuple[float, float]:
    """Tilt and heading RMSE in deg after some seconds."""
    e = estimate("mekf", *m.sensors, **given)
    late = m.t > after
    return rms(tilt_deg(e.q[late], m.q[late])), rms(heading_deg(e.q[late], m.q[late]))


def test_accelerations_that_cancel_do_not_tilt_it() -> None:
    """Pushes of 6 m/s^2 back and forth: a filter that follows gravity's direction leans by degrees."""
    m = motion(
        lambda t: (0.0, 0.0, 0.3 * np.sin(0.3 * t)),
        40.0,
        acceleration=lambda t: np.stack([6.0 * np.cos(4.0 * t), 5.0 * np.cos(3.0 * t), 0.0 * t], axis=-1),
    )
    direction = rms(tilt_deg(estimate("madgwick", *m.sensors).q[2000:], m.q[2000:]))
    assert errors(m, 20.0)[0] < 0.35 < 0.25 * direction


def test_a_gyro_bias_of_a_raw_sensor_is_found() -> None:
    true = np.deg2rad([4.4, -1.0, 0.5])
    m = flight(60.0, noise=replace(CONSUMER_NOISE, bias=tuple(true)))
    e = estimate("mekf", *m.sensors)
    assert np.rad2deg(np.abs(e.bias[-1] - true).max()) < 0.1
    assert errors(m, 30.0)[0] < 1.2


def test_gyro_scale_errors_are_found() -> None:
    """2 % of scale: without the gyro matrix among the states the attitude is several times as wrong."""
    m = swing(120.0, noise=CONSUMER_NOISE)
    wrong = replace(m, gyr=m.gyr * np.array([1.01, 0.99, 1.01]))
    known = errors(wrong, 60.0)[0]
    blind = errors(wrong, 60.0, scale_sigma=0.0, misalignment_sigma=0.0)[0]
    assert known < 0.1
    assert blind > 3.0 * known


def test_the_compass_corrects_the_scale_of_a_gyro_that_turns_about_the_vertical() -> None:
    """Two turns to and fro each minute: 1 % of scale is 7 deg of heading, which gravity cannot show."""

    def angles(t: Array) -> tuple[Array, Array, Array]:
        moving = np.maximum(t - 8.0, 0.0)
        sway = 0.1 * (t > 8.0)
        yaw = 2.0 * np.pi * (1.0 - np.cos(2.0 * np.pi * moving / 60.0))
        return sway * np.sin(1.3 * t), sway * np.sin(0.9 * t), yaw

    m = motion(angles, 188.0, noise=CONSUMER_NOISE)
    for scale in (1.01, 0.99):
        wrong = replace(m, gyr=m.gyr * np.array([1.0, 1.0, scale]))
        assert errors(wrong, 60.0)[1] < 1.5
        assert rms(heading_deg(backward.smooth(*wrong.sensors).q, m.q)) < 1.4
        found = 1.0 + final(wrong, wrong.acc)[S.M + 8]
        assert abs(found * scale - 1.0) < 0.005


def test_a_late_magnetometer_is_seen_and_taken_into_account() -> None:
    """40 ms of delay in a turn of 60 deg/s on average: 2.3 deg of heading, far less once the delay is known."""
    m = motion(lambda t: (0.4 * np.sin(1.3 * t), 0.4 * np.sin(0.9 * t), t + np.sin(t)), 120.0, noise=CONSUMER_NOISE)
    late = replace(m, mag=np.vstack([m.mag[:4], m.mag[:-4]]))
    known = errors(late, 60.0)[1]
    blind = errors(late, 60.0, delay_sigma=0.0, offset_sigma=0.0)[1]
    assert known < 0.4 * blind


def test_a_field_fixed_to_the_body_is_taken_off_once_it_is_certain() -> None:
    m = swing(120.0, noise=CONSUMER_NOISE)
    magnet = replace(m, mag=m.mag + np.array([6e-6, -4e-6, 3e-6]))
    known = errors(magnet, 60.0)[1]
    blind = errors(magnet, 60.0, offset_sigma=0.0)[1]
    assert known < 1.0
    assert blind > 3.0 * known


def test_a_field_that_comes_between_alignment_and_flight_sets_the_heading() -> None:
    """The covariance turns with it: tilt stays as good as without."""
    m = swing(30.0, yaw=2.5, noise=CONSUMER_NOISE)
    mag = np.where(m.t[:, None] < 2.5, np.nan, m.mag)
    e = estimate("mekf", m.t, m.gyr, m.acc, mag, heading_sigma=5.0)
    late = m.t > 4.0
    assert np.abs(heading_deg(e.q[late], m.q[late])).max() < 3.0
    assert tilt_deg(e.q[late], m.q[late]).max() < 0.5


def test_a_start_in_the_middle_of_a_throw_is_no_worse_after_some_seconds() -> None:
    """The first sample points 57 deg away from gravity."""

    def thrown(t: Array) -> Array:
        return np.stack([15.0 * np.cos(6.0 * t), 8.0 * np.sin(5.0 * t), 0.0 * t], axis=-1)

    m = motion(lambda t: (0.5 * np.sin(2.0 * t), 0.4 * np.sin(1.5 * t), 0.3 * t), 30.0, acceleration=thrown)
    assert errors(m, 2.0)[0] < 4.0
    assert errors(m, 15.0)[0] < 2.0


def test_its_sigmas_are_those_of_its_errors() -> None:
    """Pooled over sensors drawn from its own assumptions: error over sigma near one, never far above."""
    tilt, heading = [], []
    for seed in range(8):
        random = np.random.default_rng(seed)
        bias = tuple(np.deg2rad(0.5) * random.standard_normal(3))
        m = flight(60.0, noise=Noise(gyro=np.deg2rad(0.016), acc=0.02, mag=2e-6, bias=bias), seed=seed)
        gyr = m.gyr @ (np.eye(3) + 0.003 * random.standard_normal((3, 3))).T
        e = estimate("mekf", m.t, gyr, m.acc + 0.025 * random.standard_normal(3), m.mag)
        late = m.t > 20.0
        tilt.append(tilt_deg(e.q, m.q)[late] / np.rad2deg(e.aux["sigma_tilt"].ravel()[late]))
        heading.append(heading_deg(e.q, m.q)[late] / np.rad2deg(e.aux["sigma_heading"].ravel()[late]))
    assert 0.5 < rms(np.concatenate(tilt)) < 1.3
    assert rms(np.concatenate(heading)) < 1.3


def test_what_an_accelerometer_bias_does_to_the_error_is_known() -> None:
    """D of doubt.py is what two accelerometers that differ by a little make of a turning body."""
    m = swing(30.0, noise=CONSUMER_NOISE)
    delta = 1e-3
    for axis in range(3):
        shifted = m.acc.copy()
        shifted[:, axis] += delta
        ends = [final(m, acc, velocity_factor=0.0) for acc in (m.acc, shifted)]
        reach = ends[0][S.reach + N * axis : S.reach + N * (axis + 1)]
        error = -apart(ends[1], ends[0])
        error[E.ba + axis] += delta
        assert error[:2] == pytest.approx(delta * reach[:2], rel=0.03, abs=0.002 * delta)
        assert error[15:18] == pytest.approx(delta * reach[15:18], rel=0.01, abs=0.002 * delta)


def final(m: Motion, acc: Array, **given: float) -> Array:
    """The state after the motion, its accelerometer read as ``acc``."""
    data = [np.diff(m.t, prepend=m.t[:1]), m.gyr, np.ascontiguousarray(acc), m.mag, np.full(len(m.t), np.nan)]
    return backward.forward(data, parameters(**given), None, keep=False).state


def test_the_prior_of_a_bias_grows_in_motion_only_and_not_beyond_what_sensors_are() -> None:
    """At rest nothing tells a bias from tilt: what a push left would be taken for more and more of it."""
    spread = {}
    for quiet in (0.0, 5.0):
        state, params = running(2), parameters()
        state[S.ba : S.ba + 3] = 1.0
        state[S.seconds], state[S.expect_time], state[S.quiet] = 0.025, 10.0, quiet
        state[S.expected] = 0.016**2
        mekf.expect(state, params)
        spread[quiet] = np.sqrt(state[S.expected])
    assert spread[0.0] == pytest.approx(0.05)
    assert spread[5.0] == pytest.approx(0.016)


def test_sigma_of_tilt_covers_biases_that_a_flight_does_not_show() -> None:
    """Hover in wandering air with an accelerometer off by 0.1 m/s^2 per axis, which no turn tells from tilt."""
    ratios = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        m = still(60.0, noise=CONSUMER_NOISE)
        slow = np.cumsum(random.standard_normal((len(m.t), 3)), axis=0) * 0.01
        slow -= slow.mean(axis=0) + 0.02 * np.gradient(slow, axis=0)
        acc = m.acc + 0.1 * random.standard_normal(3) + 0.3 * random.standard_normal(m.acc.shape)
        e = estimate("mekf", m.t, m.gyr, acc + 0.1 * slow, m.mag)
        late = m.t > 15.0
        ratios.append(tilt_deg(e.q, m.q)[late] / np.rad2deg(e.aux["sigma_tilt"].ravel()[late]))
    assert 0.5 < rms(np.concatenate(ratios)) < 1.3


def test_velocity_that_lasts_widens_the_sigma_and_white_noise_does_not() -> None:
    """Accelerations of 0.5 m/s^2 that keep their sign for 5 s are 3 deg of false tilt."""
    m = still(90.0, noise=CONSUMER_NOISE)
    random = np.random.default_rng(2)
    lasting = np.repeat(random.choice([-0.5, 0.5], (18, 2)), 500, axis=0)[: len(m.t)]
    late = m.t > 30.0
    ratio, excess = {}, {}
    for name, push in (("white", 0.5 * random.standard_normal((len(m.t), 2))), ("lasting", lasting)):
        acc = m.acc + np.column_stack([push, np.zeros(len(push))])
        e = estimate("mekf:acc_bias_considered=0", m.t, m.gyr, acc, m.mag)
        sigma = np.rad2deg(e.aux["sigma_tilt"].ravel()[late])
        ratio[name], excess[name] = rms(tilt_deg(e.q, m.q)[late] / sigma), final(m, acc)[S.excess]
    assert excess["white"] < 1.3
    assert excess["lasting"] > 3.0
    assert ratio["white"] < 1.5
    assert ratio["lasting"] < 2.0


def turning(noise: Noise = CONSUMER_NOISE) -> Motion:
    """Half a minute of rest, then a vehicle that turns to either side, 60 deg/s at most."""
    return motion(
        lambda t: (
            0.2 * np.sin(0.9 * t),
            0.15 * np.sin(0.7 * t),
            np.where(t < 30.0, 0.0, 2.0 * np.sin(0.5 * (t - 30.0))),
        ),
        120.0,
        noise=noise,
    )


@pytest.mark.parametrize("fault", ["currents", "stuck"])
@pytest.mark.parametrize("name", ["mekf", "smoother"])
def test_sigma_of_heading_says_that_a_compass_is_ruined(fault: str, name: str) -> None:
    """Currents beside it that change every 6 s, or one reading for ever."""
    m = turning()
    size = float(np.linalg.norm(m.mag[0]))
    level = np.repeat(np.random.default_rng(4).standard_normal(20), 600)[: len(m.t), None]
    if fault == "currents":
        ruined = m.mag + 0.5 * size * level * np.array([0.5, 0.8, 0.3])
    else:
        ruined = np.tile([0.3 * size, 0.5 * size, 0.8 * size], (len(m.t), 1))
    e = estimate(name, m.t, m.gyr, m.acc, ruined)
    late = m.t > 60.0
    sigma = np.rad2deg(e.aux["sigma_heading"].ravel()[late])
    error = np.abs(heading_deg(e.q, m.q)[late])
    assert rms(error) > 10.0
    assert rms(error / sigma) < 2.0
    assert sigma.max() > 20.0


def test_a_sound_compass_leaves_no_doubt() -> None:
    m = turning()
    state = final(m, m.acc)
    assert state[S.field_clock] > 20.0
    assert state[S.heading_doubt] == 0.0
    assert np.rad2deg(state[S.sigma_heading]) < 6.0


def test_sigma_of_heading_grows_without_a_field_and_not_at_rest_below_what_one_place_tells() -> None:
    m = still(60.0, noise=CONSUMER_NOISE)
    without = np.rad2deg(estimate("mekf", m.t, m.gyr, m.acc).aux["sigma_heading"].ravel())
    at_rest = np.rad2deg(estimate("mekf", *m.sensors).aux["sigma_heading"].ravel())
    assert without[-1] > 20.0
    assert 4.5 < at_rest[-1] < 6.0


def test_lead_turns_the_output_on_and_changes_nothing_else() -> None:
    m = swing(20.0)
    plain = estimate("mekf", *m.sensors)
    led = estimate("mekf", *m.sensors, lead=10.0)
    assert np.array_equal(plain.aux["sigma_tilt"], led.aux["sigma_tilt"])
    late = slice(500, -1)
    ahead = rms(tilt_deg(led.q[late], m.q[501:]))
    assert ahead < 0.1 < rms(tilt_deg(plain.q[late], m.q[501:]))


def test_rest_is_seen_at_rest_and_not_in_a_slow_turn() -> None:
    params = parameters()
    quiet, turning = running(3), running(3)
    for state in (quiet, turning):
        state[S.bias : S.bias + 3] = 0.0
        state[S.P : S.P + N * N] = 1e-10 * np.eye(N).ravel()
    for _ in range(300):
        start.look_for_rest(quiet, params, 0.01, np.zeros(3), np.array([0.0, 0.0, -9.8]))
        start.look_for_rest(turning, params, 0.01, np.array([0.0, 0.0, 0.05]), np.array([0.0, 0.0, -9.8]))
    assert quiet[S.quiet] > 2.0
    assert turning[S.quiet] == 0.0


@jit.loop("a million steps")
def million(state: Out1, params: F1, gyr: F2, acc: F2, mag: F2, aid: F1, out: Out2) -> None:
    k = 0
    for i in range(len(out)):
        for _ in range(1000):
            k = k + 1 if k + 1 < len(gyr) else 0
            mekf_step(state, params, 0.005, gyr[k], acc[k], mag[k], aid)
        for j in range(N * N):
            out[i, j] = state[S.P + j]


@pytest.mark.slow
def test_the_covariance_stays_symmetric_and_positive_over_a_million_steps() -> None:
    m = flight(50.0, 200.0, noise=CONSUMER_NOISE)
    params = parameters(field_sigma=3.0, home_noise=1.2)
    out = np.empty((1000, N * N))
    million(mekf.start(params, m.acc[0], m.mag[0], m.q[0]), params, m.gyr, m.acc, m.mag, np.full(SIZE, np.nan), out)
    p = out.reshape(-1, N, N)
    scale = np.sqrt(np.einsum("nii->ni", p))
    p = p / scale[:, :, None] / scale[:, None, :]
    assert np.abs(p - np.swapaxes(p, 1, 2)).max() < 1e-9
    assert np.linalg.eigvalsh(p).min() > 1e-12
