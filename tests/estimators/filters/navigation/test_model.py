"""Rows of measurements and the transition against differences of what they linearise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.core import rotation
from attlog.estimators.filters.navigation import backward, forward, solve, turns
from attlog.estimators.filters.navigation.backward import Work, undo_updates
from attlog.estimators.filters.navigation.forward import apply_gain, new_row, new_work, propagate
from attlog.estimators.filters.navigation.inputs import WANDER_S, NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.model import (
    BARO,
    MAG,
    NO_RATE,
    POSITION,
    ROW,
    STILL,
    SUMS,
    VELOCITY,
    E,
    Filtered,
    Kept,
    Motion,
    N,
    Nodes,
    adjoint_predict,
    field_rows,
    padded,
    predict,
    rows,
    square,
    to_matrix3,
)
from attlog.estimators.filters.navigation.schedule import scheduled
from attlog.estimators.filters.navigation.solve import Runner
from attlog.estimators.filters.navigation.start import start
from tests.estimators.filters.navigation.made import flight, transition_matrix

RANDOM = np.random.default_rng(4)
Q = rotation.normalize(np.array([0.8, 0.2, -0.3, 0.45]))
X = RANDOM.standard_normal(N) * 0.1
X[E.earth : E.earth + 3] = 0.2, 0.05, 0.43
X[E.soft : E.soft + 6] *= 0.1
X[E.gnss_delay], X[E.mag_delay] = 0.02, 0.025
FORCE, RATE = np.array([0.5, -1.0, -9.0]), np.array([0.4, -0.7, 0.9])
LATE = 0.03
COUNT = {VELOCITY: 3, POSITION: 3, BARO: 1, MAG: 3, STILL: 3, NO_RATE: 3}


def event(kind, q, x):
    """Residual of zero values, and the dense rows."""
    par = NoiseLevels().settings(9.8, 2.5)
    R, row, work = np.zeros((3, 3)), new_row(), np.zeros((4, 3))
    to_matrix3(q, R)
    if kind == MAG:
        wide = field_rows(x, x, R, R, LATE, RATE, np.zeros(3), False, work, row)
    else:
        wide = rows(kind, x, R, LATE, FORCE, RATE, np.zeros(3), par, work, row)
    H = np.zeros((COUNT[kind], N))
    for i in range(COUNT[kind]):
        for k in range(wide):
            H[i, row.hi[i, k]] += row.hv[i, k]
    return row.r[: COUNT[kind]].copy(), H


def moved(q, x, dx):
    """The state with an error dx put in."""
    out = x.copy()
    out[3:] += dx[3:]
    return rotation.multiply(rotation.from_rotvec(dx[:3]), q), out


@pytest.mark.parametrize("kind", COUNT)
def test_rows_are_the_derivatives_of_what_is_predicted(kind):
    """Left out of the rows on purpose: attitude and biases inside accelerations that only multiply a delay."""
    h = 1e-6
    H = event(kind, Q, X)[1]
    for i in range(N):
        dx = np.zeros(N)
        dx[i] = h
        slope = -(event(kind, *moved(Q, X, dx))[0] - event(kind, *moved(Q, X, -dx))[0]) / (2.0 * h)
        loose = 1.1 if kind in (VELOCITY, POSITION) and (i < 3 or 12 <= i < 15) else 0.06 if kind == MAG else 1e-6
        assert slope == pytest.approx(H[:, i], abs=loose), i


def carried(q, x, gyr, acc, dt):
    """State and sums after some samples."""
    q, x, sums, R = q.copy(), x.copy(), np.zeros(SUMS), np.zeros((3, 3))
    n = len(gyr)
    motion = Motion(np.full(n, dt), gyr, acc, np.zeros(n, np.int8))
    propagate(motion, 0, n - 1, 9.8, q, x, R, np.empty((n, 4)), sums)
    return q, x, sums


def test_the_transition_is_the_derivative_of_the_motion():
    """Over a node of five samples; what is left is of second order in its length."""
    gyr = 0.8 * RANDOM.standard_normal((5, 3))
    acc = np.array([0.0, 0.0, -9.8]) + 2.0 * RANDOM.standard_normal((5, 3))
    q1, x1, sums = carried(Q, X, gyr, acc, 0.004)
    phi = transition_matrix(sums, 0, 1e12)
    h = 1e-6
    for i in range(N):
        dx = np.zeros(N)
        dx[i] = h
        q2, x2, _ = carried(*moved(Q, X, dx), gyr, acc, 0.004)
        turned = rotation.to_rotvec(rotation.multiply(q2, rotation.conjugate(q1)))
        slope = np.concatenate([turned, (x2 - x1)[3:]]) / h
        # Gyro scale and bias multiply each other in the motion, which the rows leave out; biases here are large.
        assert slope == pytest.approx(phi[:, i], abs=4e-3), i


def random_covariance():
    root = RANDOM.standard_normal((N, N))
    P = root @ root.T
    return 0.5 * (P + P.T)


@pytest.mark.parametrize("rest", [0, 1])
def test_a_covariance_moves_by_the_transition_and_stays_symmetric_to_the_bit(rest):
    sums, M = RANDOM.standard_normal(SUMS), np.zeros((5, 3, 3))
    sums[0] = 0.02
    phi, P = transition_matrix(sums, rest, 0.1), random_covariance()
    moved_on = padded(P)
    predict(moved_on, sums, rest, 0.1, M)
    assert square(moved_on) == pytest.approx(phi @ P @ phi.T, abs=1e-10)
    assert np.array_equal(square(moved_on), square(moved_on).T)
    lam, back = RANDOM.standard_normal(ROW), padded(P)
    expected = phi.T @ lam[:N]
    adjoint_predict(lam, back, sums, rest, 0.1, M)
    assert square(back) == pytest.approx(phi.T @ P @ phi, abs=1e-10)
    assert np.array_equal(square(back), square(back).T)
    assert lam[:N] == pytest.approx(expected, abs=1e-12)


def test_three_updates_at_once_are_three_one_after_the_other():
    P, hi = random_covariance(), np.array([[0, 5, 20], [1, 5, 38], [2, 20, 30]])
    hv, u = RANDOM.standard_normal((3, 3)), np.zeros(3 * ROW)
    expected = P.copy()
    for i in range(3):
        h = np.zeros(N)
        h[hi[i]] = hv[i]
        ph = expected @ h
        s = h @ ph + 0.5
        u[i * ROW : i * ROW + N] = ph / np.sqrt(s)
        expected -= np.outer(ph, ph) / s
    flat = padded(P)
    apply_gain(flat, 3, u)
    assert square(flat) == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(square(flat), square(flat).T)


def test_updates_are_undone_one_by_one_whatever_the_group():
    """Five updates, two and three at once, against the equations of the file's head."""
    count, hi = 5, np.array([[0, 5, 20], [1, 5, 38], [2, 20, 30], [3, 4, 5], [0, 1, 2]], np.int8)
    H, K, lam = RANDOM.standard_normal((count, 3)), RANDOM.standard_normal((count, N)), RANDOM.standard_normal(N)
    s, nu, L = RANDOM.uniform(1, 2, count), RANDOM.standard_normal(count), random_covariance()
    rows = np.zeros((count, ROW))
    rows[:, :N] = K
    flat_lam, flat, score = np.append(lam, 0.0), padded(L), np.zeros(count)
    none = np.zeros(0)
    kept = Kept(none, none, none, rows.ravel(), H, hi, np.full(count, 3, np.int8), s, nu, none, none, none)
    work = Work(none, np.zeros(3 * ROW), np.zeros(3 * ROW), np.zeros(3 * ROW))
    undo_updates(0, count, kept, flat_lam, flat, score, work)
    for k in range(count - 1, -1, -1):
        h = np.zeros(N)
        h[hi[k]] = H[k]
        u, D, Lk = nu[k] / s[k] + K[k] @ lam, 1 / s[k] + K[k] @ L @ K[k], L @ K[k]
        assert score[k] == pytest.approx(u * u / D)
        lam, L = lam - h * u, L - np.outer(h, Lk) - np.outer(Lk, h) + D * np.outer(h, h)
    assert flat_lam[:N] == pytest.approx(lam)
    assert square(flat) == pytest.approx(L, rel=1e-9, abs=1e-9)
    assert np.array_equal(square(flat), square(flat).T)


# The transition of the error state against a matrix product of numpy, written from the equations of the model.


# The way back against the textbook smoother, and a long run in parts against one in whole.


@pytest.fixture(scope="module")
def run():
    made = flight(seconds=24.0, still=8.0)
    m = made.motion
    inputs = prepare_inputs(m.t, m.gyr, m.acc, m.mag, made.aids, 0.0, ahead=True)
    tuned = NoiseLevels()
    return inputs, scheduled(inputs, tuned), start(inputs, tuned), tuned.settings(inputs.gravity, 100.0)


def step(inputs, schedule, begin, par, state, node, events):
    """The kernel over one node, with its events or without; state is carried on in place."""
    count = schedule.node_event.copy()
    if not events:
        count = np.zeros_like(count)
    m, store = len(schedule.node_at), Runner(inputs).storage(schedule, node, node + 1)
    forward.forward(
        node,
        node + 1,
        node,
        0,
        False,
        par,
        begin.x,
        inputs.motion,
        Nodes(schedule.node_at, count, schedule.jump, np.zeros((1, 4))),
        schedule.events,
        state,
        Filtered(np.empty((len(inputs.t), 4)), np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 4))),
        store,
        new_row(),
        new_work(),
    )
    return store.sums[0].copy()


def test_the_way_back_is_rauch_tung_striebel(run):
    inputs, schedule, begin, par = run
    m = len(schedule.node_at)
    state = Runner(inputs).begun(schedule, begin)[1]
    after, before, correction, moves = [], [], [], []
    for node in range(m):
        predicted = state.copy()
        moves.append(step(inputs, schedule, begin, par, predicted, node, events=False))
        step(inputs, schedule, begin, par, state, node, events=True)
        turned = rotation.to_rotvec(rotation.multiply(state[0], rotation.conjugate(predicted[0])))
        correction.append(np.concatenate([turned, (state[1] - predicted[1])[3:]]))
        before.append(square(predicted[2]))
        after.append(square(state[2]))
    d, P = np.zeros(N), after[-1]
    expected_d, expected_P = [d], [P]
    for node in range(m - 2, -1, -1):
        phi = transition_matrix(moves[node + 1], int(schedule.rest_of[node + 1]), WANDER_S)
        gain = np.linalg.lstsq(before[node + 1], phi @ after[node], rcond=1e-15)[0].T
        d = gain @ (d + correction[node + 1])
        P = after[node] + gain @ (P - before[node + 1]) @ gain.T
        expected_d.append(d)
        expected_P.append(P)
    found = Runner(inputs).both(schedule, begin, par)
    wanted = np.array(expected_d[::-1])
    size = np.abs(wanted[:, :3]).max()
    assert np.abs(found.d[:, :3] - wanted[:, :3]).max() < 2e-3 * size
    variance = np.array([np.diag(P)[:3] for P in expected_P[::-1]])
    assert np.sqrt(found.spread) == pytest.approx(np.sqrt(variance), rel=1e-4)


def test_parts_of_a_run_give_what_the_whole_gives(run, monkeypatch):
    inputs, schedule, begin, par = run
    whole = Runner(inputs).both(schedule, begin, par)
    monkeypatch.setattr(solve, "PART_NODES", 301)
    parts = Runner(inputs).both(schedule, begin, par)
    for name in ("q", "d", "spread", "score", "first", "bias"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name)), name
    assert parts.likelihood == whole.likelihood


def test_the_covariance_stays_symmetric_and_positive(run):
    inputs, schedule, begin, par = run
    state = Runner(inputs).begun(schedule, begin)[1]
    for node in range(len(schedule.node_at)):
        step(inputs, schedule, begin, par, state, node, events=True)
        if node % 50 == 0:
            P = square(state[2])
            scale = np.sqrt(np.maximum(np.diag(P), 1e-30))
            on = np.diag(P) > 0
            assert np.array_equal(P, P.T)
            assert np.linalg.eigvalsh((P / np.outer(scale, scale))[np.ix_(on, on)]).min() > -1e-9


# What is known of now by an attitude and a bias of a while ago, in closed form.


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_attitude_of_before_is_carried_on_by_the_rate_less_the_bias_that_is_known_of_it(axis: int) -> None:
    """Constant rates about one axis, five samples and a lag of 30 ms ahead; at the start another bias was known."""
    n, rate, known, lag = 40, 0.8, 0.3, 0.03
    dt, along = np.full(n, 0.01), np.eye(3)[axis]
    then = np.maximum(np.arange(n) - 5, 0)
    q = rotation.multiply(
        np.tile(rotation.from_euler(0.3, -0.2, 1.0), (n, 1)),
        rotation.from_rotvec((rate - known) * 0.01 * np.arange(n)[:, None] * along),
    )
    out = np.empty((n, 4))
    gyr, bias = np.tile(rate * along, (n, 1)), np.tile(known * along, (n, 1))
    rest, ring = np.zeros(n, np.int8), np.zeros((8, turns.RING))
    first, motion = np.array([0.05, -0.1, 0.2]) * along, Motion(dt, gyr, gyr, rest)
    turns.ahead(lag, then, motion, q, bias, first, ring, out, np.zeros(9))
    seconds = 0.01 * (np.arange(n) - then) + lag
    wanted = rotation.multiply(q[then], rotation.from_rotvec((rate - known) * seconds[:, None] * along))
    apart = rotation.total_angle(rotation.earth_error(out, wanted))
    assert apart == pytest.approx(np.zeros(n), abs=1e-9)


def test_loops_without_a_compass_refuse_its_events() -> None:
    made = flight(seconds=5.0)
    inputs = prepare_inputs(*made.motion.sensors, made.aids, 0.0, ahead=True)
    schedule, begin = scheduled(inputs, NoiseLevels()), start(inputs, NoiseLevels())
    with pytest.raises(AssertionError):
        Runner(replace(inputs, mag=None)).begun(schedule, begin)
    Runner(inputs).begun(schedule, begin)


def test_without_a_compass_fewer_states_give_the_same_run() -> None:
    made = flight(seconds=30.0)
    inputs = replace(prepare_inputs(*made.motion.sensors, made.aids, 0.0, ahead=True), mag=None)
    few, all_states = Runner(inputs), Runner(inputs)
    all_states.states, all_states.row = N, ROW
    all_states.forward_loop, all_states.backward_loop = forward.forward, backward.backward
    tuned = NoiseLevels()
    schedule, begin, par = scheduled(inputs, tuned), start(inputs, tuned), tuned.settings(inputs.gravity, 2.5)
    assert (few.states, few.row) == (27, 28)
    a, b = (runner.both(schedule, begin, par) for runner in (few, all_states))
    assert a.likelihood == pytest.approx(b.likelihood, rel=1e-12)
    for name in ("q", "bias", "variance", "d", "spread", "score", "shocks", "first", "first_spread"):
        x, y = getattr(a, name), getattr(b, name)
        np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-9 * np.max(np.abs(y)))
