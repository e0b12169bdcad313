"""What `mekf` makes of a field, function by function: numpy's algebra, and limits from both sides."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.filters.inertial import compass, doubt, start
from attlog.estimators.filters.inertial import layout as at

N, P, RAD = at.N, at.P, math.pi / 180.0
RANDOM = np.random.default_rng(6)


def state_of(covariance: np.ndarray | None = None) -> np.ndarray:
    state = np.zeros(1000)
    if covariance is not None:
        state[P : P + N * N] = covariance.ravel()
    return state


def covariance() -> np.ndarray:
    root = 0.05 * RANDOM.normal(size=(N, N))
    return root @ root.T + 1e-3 * np.eye(N)


def parameters(**given: float) -> np.ndarray:
    out = np.zeros(24)
    for name, value in given.items():
        out[getattr(at, name)] = value
    return out


def test_an_angle_is_wrapped_to_half_a_turn() -> None:
    for angle, want in ((3.2, 3.2 - 2 * math.pi), (-3.2, 2 * math.pi - 3.2), (0.4, 0.4), (7.0, 7.0 - 2 * math.pi)):
        assert compass.wrapped(angle) == pytest.approx(want)
    assert compass.wrapped(math.pi) == pytest.approx(-math.pi)


@pytest.mark.parametrize(
    ("value", "quiet", "seconds", "factor"),
    [(0.02, 0.0, 0.5, 1.0), (0.02, 0.0, 3.0, 0.5), (1.5, 0.0, 0.5, None), (0.02, 0.2, 0.5, "rest")],
)
def test_a_heading_is_a_kalman_update_of_heading_biases_and_declination_alone(
    value: float, quiet: float, seconds: float, factor: float | str | None
) -> None:
    """Noise of 8 deg at 1 Hz; beyond twice the expected spread it grows with the square, at rest 5 deg are kept."""
    before, x = covariance(), 0.01 * RANDOM.normal(size=N)
    reach = RANDOM.normal(size=(3, N))
    state = state_of(before)
    state[at.X : at.X + N] = x
    state[at.REACH : at.REACH + 3 * N] = reach.ravel()
    state[at.QUIET], state[at.H_SINCE], state[at.FIELD_DOUBT] = quiet, seconds, 0.3
    fx, fy, fz = 0.3, -0.2, 0.5
    compass.heading(state, parameters(MAG_GATE=2.0, MAG_NOISE=8.0), value, fx, fy, fz, 0.25)
    h = np.zeros(N)
    h[[0, 1, 2, at.DD]] = -fz * fx / 0.13, -fz * fy / 0.13, 1.0, -1.0
    spread = (8.0 * RAD) ** 2 / (0.25 * min(seconds, 1.0))
    known = before[2, 2] + before[at.DD, at.DD] - 2.0 * before[2, at.DD]
    if factor is None:
        spread *= (value / (2.0 * math.sqrt(known + (3.0 * RAD) ** 2))) ** 2
    if factor == "rest":
        spread *= before[2, 2] / (before[2, 2] - (5.0 * RAD) ** 2)
    s = 1.0 / (h @ before @ h + spread)
    c = before @ h
    own = np.zeros(N, bool)
    own[2 : at.DM] = own[at.DD] = True
    gain = np.where(own, s * c, 0.0)
    assert state[at.X : at.X + N] == pytest.approx(x + gain * (value - h @ x))
    either = own[:, None] | own[None, :]
    assert state[P : P + N * N].reshape(N, N) == pytest.approx(before - np.where(either, s * np.outer(c, c), 0.0))
    assert state[at.REACH : at.REACH + 3 * N].reshape(3, N) == pytest.approx(reach - np.outer(reach @ h, gain))
    assert state[at.HEADING_DOUBT] == pytest.approx(0.3 * (1.0 - (1.0 - s * c[2]) ** 2))


def test_at_rest_a_heading_known_to_five_degrees_is_left_alone() -> None:
    before = covariance()
    before[2, 2] = (4.9 * RAD) ** 2
    state = state_of(before)
    state[at.QUIET], state[at.H_SINCE] = 0.2, 0.5
    compass.heading(state, parameters(MAG_GATE=2.0, MAG_NOISE=8.0), 0.1, 0.3, -0.2, 0.5, 1.0)
    assert (state[P : P + N * N] == before.ravel()).all()


def test_a_first_heading_leans_with_the_tilt_by_the_fields_dip() -> None:
    before, reach, x = covariance(), RANDOM.normal(size=(3, N)), RANDOM.normal(size=N)
    for down, lean in ((0.6, 2.0), (-9.0, -6.0), (9.0, 6.0)):
        state = state_of(before)
        state[at.REACH : at.REACH + 3 * N] = reach.ravel()
        state[at.X : at.X + N] = x
        compass.first_heading(state, parameters(FIELD_SIGMA=4.0, HEADING_SIGMA=10.0), 0.3, 0.0, down)
        want = before.copy()
        want[2, :] = want[:, 2] = lean * before[0, :]
        want[at.DD, :] = want[:, at.DD] = 0.0
        offset = (4.0 * RAD) ** 2
        want[2, 2] = lean**2 * before[0, 0] + (10.0 * RAD) ** 2 + offset
        want[2, at.DD] = want[at.DD, 2] = want[at.DD, at.DD] = offset
        assert state[P : P + N * N].reshape(N, N) == pytest.approx(want)
        assert state[at.REACH : at.REACH + 3 * N].reshape(3, N)[:, 2] == pytest.approx(lean * reach[:, 0])
        assert (state[at.X + 2], state[at.X + at.DD]) == (pytest.approx(lean * x[0]), 0.0)


def test_a_field_that_comes_late_turns_all_that_is_told_in_earth_axes() -> None:
    before, reach, x = covariance(), RANDOM.normal(size=(3, N)), RANDOM.normal(size=N)
    state = state_of(before)
    state[at.REACH : at.REACH + 3 * N], state[at.X : at.X + N] = reach.ravel(), x
    state[at.Q : at.Q + 4] = q = rotation.from_euler(0.3, -0.2, 1.0)
    state[at.V : at.V + 2] = [3.0, 4.0]
    psi = math.atan2(0.4, -0.3)
    compass.first_field(state, parameters(FIELD_SIGMA=4.0, HEADING_SIGMA=10.0), -0.3, 0.4, 1.0)
    c, s = math.cos(psi), math.sin(psi)
    turn = np.array([[c, s], [-s, c]])
    all_of = np.eye(N)
    for k in (0, at.DV):
        all_of[k : k + 2, k : k + 2] = turn
    P_turned = all_of @ before @ all_of.T
    found = state[P : P + N * N].reshape(N, N)
    rows = np.delete(np.arange(N), [2, at.DD])
    assert found[np.ix_(rows, rows)] == pytest.approx(P_turned[np.ix_(rows, rows)])
    assert found[2, rows] == pytest.approx(2.0 * P_turned[0, rows])
    assert state[at.V : at.V + 2] == pytest.approx(turn @ [3.0, 4.0])
    assert state[at.X + rows] == pytest.approx((all_of @ x)[rows])
    assert state[at.REACH : at.REACH + 3 * N].reshape(3, N)[:, rows] == pytest.approx((reach @ all_of.T)[:, rows])
    want = rotation.turn_about_down(q, -psi)
    assert abs(state[at.Q : at.Q + 4] @ want) == pytest.approx(1.0)
    assert state[at.STAGE] == at.RUNNING


def test_norm_and_dip_of_the_earths_field_are_trusted_within_nine_percent_and_3_2_degrees() -> None:
    """After 15 s of reference; a field beyond is refused at once, taken again after half a second."""

    def trusted(scale: float, dip_deg: float) -> float:
        state, params = state_of(), parameters()
        state[at.T], state[at.H_SINCE] = 0.1, 0.1
        for _ in range(200):
            assert compass.trust(state, params, 0.3, 0.0, 0.4) == 1.0
        assert state[at.NORM] == pytest.approx(0.5)
        assert state[at.DIP] == pytest.approx(math.atan2(0.4, 0.3))
        dip = math.atan2(0.4, 0.3) + dip_deg * RAD
        weight = 0.0
        for _ in range(3):
            weight = compass.trust(state, params, 0.5 * scale * math.cos(dip), 0.0, 0.5 * scale * math.sin(dip))
        return weight

    for scale, dip, want in (
        (1.085, 0.0, 1.0), (1.1, 0.0, 0.0), (0.915, 0.0, 1.0), (0.9, 0.0, 0.0), (1.0, 3.0, 1.0), (1.0, 3.6, 0.0),
        (1.0, -3.0, 1.0), (1.0, -3.6, 0.0),
    ):  # fmt: skip
        assert trusted(scale, dip) == want


def test_after_a_minute_of_refusal_a_field_counts_a_sixteenth() -> None:
    state, params = state_of(), parameters()
    state[at.T], state[at.H_SINCE] = 0.5, 0.5
    for _ in range(60):
        compass.trust(state, params, 0.3, 0.0, 0.4)
    weights = [compass.trust(state, params, 0.6, 0.0, 0.8) for _ in range(130)]
    assert weights[:110] == [0.0] * 110
    assert weights[-1] == 1.0 / 16.0
    refused = weights.index(1.0 / 16.0) * 0.5
    assert 59.0 <= refused <= 60.5


def test_the_doubt_of_a_field_is_its_spread_over_its_level_beyond_twelve_degrees() -> None:
    """Alternating by +-0.2 about 0.4 level and 0.3 down, in motion; and by how much it would turn the heading."""
    state = state_of()
    state[at.T], state[at.H_SINCE], state[at.TURNED] = 0.1, 0.1, 10.0
    for k in range(3000):
        off = 0.2 if k % 2 else -0.2
        state[at.HL : at.HL + 3] = [0.0, 0.4 + off, 0.3 - off]
        doubt.watch_field(state, 0.1)
    want = 2.0 * 0.2**2 / 0.4**2 - (12.0 * RAD) ** 2
    assert state[at.FIELD_DOUBT] == pytest.approx(want, rel=0.02)
    early = state_of()
    early[at.T], early[at.H_SINCE], early[at.TURNED] = 0.1, 0.1, 10.0
    for seconds in range(1, 25):
        for _ in range(10):
            early[at.HL : at.HL + 3] = [0.4, 0.0, 0.3]
            doubt.watch_field(early, 0.05 * seconds)
        if seconds == 19:
            first = early[at.HEADING_DOUBT]
            assert first == early[at.FIELD_DOUBT] > 0.0
    assert early[at.FIELD_DOUBT] > early[at.HEADING_DOUBT] > first
    assert early[at.FIELD_OFF] - (12.0 * RAD) ** 2 == pytest.approx(early[at.FIELD_DOUBT])
    for _ in range(3000):
        doubt.watch_field(early, 9.0)
    assert early[at.FIELD_DOUBT] == pytest.approx(math.radians(104.0) ** 2)


def test_a_field_is_compared_with_itself_as_far_as_the_body_moves() -> None:
    """In full from 0.35 rad/s on, at half that half as long."""
    for rate, share in ((0.7, 1.0), (0.35, 1.0), (0.175, 0.5), (0.0, 0.0)):
        state = state_of()
        state[at.T], state[at.H_SINCE], state[at.TURNED] = 0.1, 0.2, 0.1 * rate**2
        state[at.HL : at.HL + 3] = [0.4, 0.0, 0.3]
        doubt.watch_field(state, 0.1)
        assert state[at.FIELD_CLOCK] == pytest.approx(0.2 * share)
        assert state[at.FIELD_OFF] == pytest.approx(0.1**2 * 0.2 * share)


def test_sigmas_hold_the_excess_the_considered_bias_and_the_doubt() -> None:
    before, reach = covariance(), RANDOM.normal(size=(3, N))
    state = state_of(before)
    state[at.REACH : at.REACH + 3 * N] = reach.ravel()
    state[at.HEADING_DOUBT] = 0.07
    for excess, counted in ((3.0, 3.0), (0.5, 1.0)):
        state[at.EXCESS] = excess
        doubt.own_sigmas(state, parameters(ACC_BIAS_CONSIDERED=0.12))
        tilt = (before[0, 0] + before[1, 1]) * counted + 0.12**2 * np.sum(reach[:, :2] ** 2)
        heading = before[2, 2] + 0.12**2 * np.sum(reach[:, 2] ** 2) + 0.07
        assert state[at.SIGMA : at.SIGMA + 2] == pytest.approx(np.sqrt([tilt, heading]))


def test_a_measured_entry_takes_its_part_out_of_the_reach() -> None:
    reach, column = RANDOM.normal(size=(3, N)), RANDOM.normal(size=N)
    state = state_of()
    state[at.REACH : at.REACH + 3 * N], state[at.C : at.C + N] = reach.ravel(), column
    doubt.correct_reach(state, 5, 0.3, at.C)
    want = reach - 0.3 * np.outer(reach[:, 5], column)
    assert state[at.REACH : at.REACH + 3 * N].reshape(3, N) == pytest.approx(want)


def test_covariance_at_the_end_of_the_alignment_is_that_of_the_parameters() -> None:
    state = state_of()
    state[at.Q] = state[at.QUIET] = 1.0
    given = {"TILT_SIGMA": 2.0, "HEADING_SIGMA": 25.0, "BIAS_SIGMA": 0.65, "ACC_BIAS_SIGMA": 0.016}
    start.begin(state, parameters(**given, SCALE_SIGMA=0.004, MISALIGNMENT_SIGMA=0.0025, VELOCITY_SIGMA=0.13))
    sd = np.zeros(N)
    sd[:3] = np.radians([2.0, 2.0, 25.0])
    sd[3:6] = np.radians(0.65)
    sd[6:15] = [0.004, 0.0025, 0.0025, 0.0025, 0.004, 0.0025, 0.0025, 0.0025, 0.004]
    sd[15:18], sd[18:20] = 0.016, 1.0
    assert state[P : P + N * N].reshape(N, N) == pytest.approx(np.diag(sd**2))
    assert (state[at.EXCESS], state[at.EXPECTED]) == (1.0, pytest.approx(0.016**2))
    assert state[at.V_MEAN] == pytest.approx(0.13**2)


def test_a_start_in_motion_is_less_certain_of_tilt_and_velocity() -> None:
    """A velocity of 3 m/s north that comes and goes within 2 s, beside gravity: <v^2> less its even part."""
    state, params = (
        state_of(),
        parameters(TILT_SIGMA=2.0, HEADING_SIGMA=25.0, VELOCITY_SIGMA=0.13, ALIGN_TIME=1.999, MOVING_SIGMA=5.0),
    )
    state[at.Q] = 1.0
    t = np.arange(1, 401) * 0.005
    for push in 3.0 * np.pi * np.cos(np.pi * t):
        start.align(state, params, 0.005, np.zeros(3), np.array([push, 0.0, -9.80665]), np.zeros(3))
    v = np.cumsum(0.005 * 3.0 * np.pi * np.cos(np.pi * t))
    assert state[at.V_MEAN] == pytest.approx(0.5 * np.mean((v - t * v[-1] / t[-1]) ** 2), rel=1e-6)
    assert np.degrees(np.sqrt([state[P], state[P + N + 1], state[P + 2 * N + 2]])) == pytest.approx([5.0, 5.0, 25.0])
    start.begin(state, parameters(TILT_SIGMA=8.0, MOVING_SIGMA=5.0, VELOCITY_SIGMA=2.0))
    assert np.degrees(np.sqrt(state[P])) == pytest.approx(8.0)
    assert state[at.V_MEAN] == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("gyro_dps", "acc", "rests"),
    [(0.0, 0.0, True), (0.69, 0.0, True), (0.75, 0.0, False), (0.0, 0.19, True), (0.0, 0.22, False)],
)
def test_rest_is_quiet_within_0_7_deg_s_and_0_2_m_s2_of_its_own_mean(gyro_dps: float, acc: float, rests: bool) -> None:
    """A step, of which the fast low-pass (0.04 s) shows all and the slow one (0.5 s) nothing yet, at its largest."""
    state, params = state_of(), parameters(BIAS_SIGMA=0.65)
    dt = 0.001
    gain = max(abs(math.exp(-t / 0.5) - math.exp(-t / 0.04)) for t in np.arange(0.0, 1.0, dt))
    quiet = []
    for k in range(400):
        step = 1.0 if k >= 100 else 0.0
        gyr = np.array([0.0, gyro_dps * RAD / gain * step, 0.0])
        start.look_for_rest(state, params, dt, gyr, np.array([acc / gain * step, 0.0, -9.8]))
        quiet.append(state[at.QUIET])
    assert quiet[99] == pytest.approx(0.1)
    assert (min(quiet[100:]) > 0.0) == rests


def test_a_steady_turn_beyond_the_bias_and_a_degree_per_second_is_no_rest() -> None:
    for dps, rests in ((0.99 + 3.0 * 0.65, True), (1.01 + 3.0 * 0.65, False)):
        state, params = state_of(), parameters(BIAS_SIGMA=0.65)
        start.look_for_rest(state, params, 0.01, np.array([0.0, 0.0, -dps * RAD]), np.array([0.0, 0.0, -9.8]))
        assert (state[at.QUIET] > 0.0) == rests
        known = state_of(np.diag(np.full(N, (0.2 * RAD) ** 2)))
        known[at.STAGE], known[at.BIAS + 2] = at.RUNNING, 0.5 * RAD
        rate = (0.5 + 3.0 * 0.2 + (0.99 if rests else 1.01)) * RAD
        start.look_for_rest(known, params, 0.01, np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, -9.8]))
        assert (known[at.QUIET] > 0.0) == rests
