"""The way back against the textbook smoother, and a long run in parts against one in whole."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators.filters.navigation import backward, forward, solve
from attlog.estimators.filters.navigation.layout import ROW, SETTINGS, SUM_T, SUMS, WANDER_TAU, N
from attlog.estimators.filters.navigation.measured import made_ready
from attlog.estimators.filters.navigation.motion import square
from attlog.estimators.filters.navigation.schedule import scheduled
from attlog.estimators.filters.navigation.settings import WANDER_S, NoiseLevels
from attlog.estimators.filters.navigation.solve import Runner
from attlog.estimators.filters.navigation.start import start
from attlog.kernels.loops import function_of
from tests.estimators.filters.navigation.dense import transition_matrix
from tests.estimators.filters.navigation.made import flight


@pytest.fixture(scope="module")
def run():
    made = flight(seconds=24.0, still=8.0)
    m = made.motion
    inputs = made_ready(m.t, m.gyr, m.acc, m.mag, made.aids, 0.0, ahead=True)
    tuned = NoiseLevels()
    return inputs, scheduled(inputs, tuned), start(inputs, tuned), tuned.packed(inputs.gravity, 100.0)


def step(inputs, schedule, begin, par, state, node, events):
    """The kernel over one node, with its events or without; state is carried on in place."""
    count = schedule.node_event.copy()
    if not events:
        count = np.zeros_like(count)
    m, store = len(schedule.node_at), Runner(inputs)._storage(schedule, node, node + 1)
    function_of(forward.KERNEL, forward.forward)(
        node,
        node + 1,
        inputs.dt,
        inputs.gyr,
        inputs.acc,
        inputs.rest,
        schedule.node_at,
        count,
        schedule.kind,
        schedule.offset,
        schedule.z,
        schedule.f_mean,
        schedule.w_mean,
        schedule.sigma,
        schedule.jump,
        par,
        np.zeros((1, 4)),
        False,
        begin.x,
        *state,
        np.empty((len(inputs.t), 4)),
        np.empty((m, 3)),
        np.empty((m, 3)),
        np.empty((m, 4)),
        True,
        store["P_rows"],
        store["sums"],
        store["update_of"],
        store["K"],
        store["H"],
        store["H_at"],
        store["wide_of"],
        store["s_of"],
        store["nu_of"],
        store["r_of"],
        store["group"],
        store["soft"],
    )
    return store["sums"][0].copy()


def test_the_way_back_is_rauch_tung_striebel(run):
    inputs, schedule, begin, par = run
    m = len(schedule.node_at)
    state = Runner(inputs).begun(schedule, begin)[1]
    after, before, correction, moves = [], [], [], []
    for node in range(m):
        predicted = [x.copy() for x in state]
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


@pytest.mark.parametrize("rest", [0, 1])
def test_only_disturbances_in_motion_calibrate_and_none_counts_beyond_three_sigma(rest):
    """lam of 2 and of 5 of a variance of 1, over half a second: 0.5 min(lam^2, 9), and 0.5, where nothing rests."""
    par, sums, scores = np.ones(SETTINGS), np.zeros((1, SUMS)), np.zeros((2, N))
    par[WANDER_TAU], sums[0, SUM_T] = WANDER_S, 0.5
    lam, Lam = np.zeros(ROW), np.zeros((N, ROW))
    lam[:N], Lam[:, :N] = np.where(np.arange(N) < 3, 2.0, 5.0), np.eye(N)
    none, scratch = np.zeros(0), [np.zeros(shape) for _, shape in backward.SCRATCH.values()]
    made = (np.array([rest], np.int8), par, np.zeros(6 * ROW), sums, np.zeros(2, np.int64), none, none, none, none)
    room = (np.zeros((1, 6)), np.zeros((1, 3)), none, scores, np.zeros((1, 12)))
    backward.backward(1, *made, none, none, lam, Lam.ravel(), *room, False, False, *scratch)
    wanted = 0.5 * np.array([np.where(np.arange(N) < 3, 4.0, 9.0), np.ones(N)])
    assert scores == pytest.approx(wanted if rest == 0 else np.zeros((2, N)))
