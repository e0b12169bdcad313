"""Jumps of the gyro bias: planted in simulated motion with known truth, and the predictions against runs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from attlog.core import rotation
from attlog.estimators import estimate
from attlog.estimators.filters.navigation import jumps
from attlog.estimators.filters.navigation import jumps as online
from attlog.estimators.filters.navigation.inputs import JUMP_RAD_S, NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.jumps import gains
from attlog.estimators.filters.navigation.model import State
from attlog.estimators.filters.navigation.passes import solved, solved_twice
from attlog.estimators.filters.navigation.schedule import Schedule, Timetable
from attlog.estimators.filters.navigation.solve import Runner
from attlog.estimators.filters.navigation.start import start
from tests.estimators.filters.navigation.made import flight, off

WHEN = 52.0


def stepped(made, dps, when=WHEN):
    """The flight with a gyro whose bias steps by ``dps`` (3,) deg/s."""
    m = made.motion
    return replace(made, motion=replace(m, gyr=m.gyr + np.radians(dps) * (m.t >= when)[:, None]))


def ready(made, compass=True):
    m = made.motion
    mag = m.mag if compass else np.full_like(m.mag, np.nan)
    return prepare_inputs(m.t, m.gyr, m.acc, mag, made.aids, 0.0, ahead=True)


@pytest.fixture(scope="module")
def made():
    return flight()


@pytest.mark.slow
@pytest.mark.parametrize("step", [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [0.0, -0.5, 0.5]])
def test_a_step_is_found_with_its_time_and_size_and_the_attitude_stays_within_its_sigma(made, step):
    e = estimate("smoother", *stepped(made, step).motion.sensors, aids=made.aids)
    assert e.quality["gyro_jumps"] == 1.0
    assert e.quality["gyro_jump_s"] == pytest.approx(WHEN, abs=1.0)
    assert [e.quality[f"gyro_jump_{axis}_dps"] for axis in "xyz"] == pytest.approx(step, abs=0.1)
    assert e.quality["heading_from"] == "both"
    tilt, heading = off(e.q, made.motion.q)
    assert np.sqrt(np.mean((heading / e.aux["sigma_heading"]) ** 2)) < 2.0
    assert np.sqrt(np.mean((tilt / e.aux["sigma_tilt"]) ** 2)) < 2.0


def test_two_steps_are_two_jumps(made):
    twice = stepped(stepped(made, [0.0, 0.0, 1.0], 40.0), [0.0, 1.5, 0.0], 65.0)
    found = solved(ready(twice, compass=False), NoiseLevels(), 2.5).jumps
    assert [jump.t for jump in found] == pytest.approx([40.0, 65.0], abs=1.0)
    assert np.degrees(found[0].size) == pytest.approx([0.0, 0.0, 1.0], abs=0.1)
    assert np.degrees(found[1].size) == pytest.approx([0.0, 1.5, 0.0], abs=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_a_sound_gyro_does_not_jump(seed):
    for solution in solved_twice(ready(flight(seed=seed)), NoiseLevels(), 2.5, 5):
        assert solution.jumps == ()
        assert solution.unmodelled == 0.0


def test_neither_a_scale_error_nor_a_turned_compass_is_a_jump(made):
    m = made.motion
    scaled = replace(made, motion=replace(m, gyr=1.03 * m.gyr))
    turn = rotation.from_euler(0.0, 0.0, np.radians(15.0))
    turned = replace(made, motion=replace(m, mag=rotation.rotate(np.tile(turn, (len(m.mag), 1)), m.mag)))
    for faulty in (scaled, turned):
        for solution in solved_twice(ready(faulty), NoiseLevels(), 2.5, 5):
            assert not any(jump.counts for jump in solution.jumps)


def test_the_predicted_gain_is_what_the_way_forth_gains(made):
    inputs = ready(stepped(made, [0.0, 0.0, 0.02]), compass=False)
    tuned = replace(NoiseLevels(), gyro=4e-4, acc=0.02)
    par, begin, timetable = tuned.packed(inputs.gravity, 100.0), start(inputs, tuned), Timetable(inputs)
    begin.q = made.motion.q[0].copy()
    schedule, runner = timetable.scheduled(tuned), Runner(inputs)
    without = runner.both(schedule, begin, par)
    when = inputs.sensed_at[schedule.node_at]
    gain, _ = jumps.gains(without.shocks)
    for t in (30.0, WHEN, 70.0):
        opened = replace(schedule, jump=timetable.jumps_at(schedule.node_at, (t,)))
        k = int(np.flatnonzero(opened.jump)[0])
        assert when[k] == pytest.approx(t, abs=0.05)
        found = runner.both(opened, begin, par)
        assert found.likelihood - without.likelihood == pytest.approx(gain[k], abs=1.0)
        (jump,) = jumps.modelled(found, when, (t,), (0.0,))
        before, after = (found.bias[i] + found.d[i, 3:] for i in (k - 1, k))
        assert jump.size == pytest.approx(after - before, abs=1e-2 * JUMP_RAD_S)


def test_times_move_to_the_top_of_the_likelihood_and_their_sigma_is_its_width():
    """Of a parabola with standard deviation 0.3 s about 12.3 s."""
    times, sigmas = jumps.placed((11.0,), lambda times: -0.5 * ((times[0] - 12.3) / 0.3) ** 2)
    assert times[0] == pytest.approx(12.3, abs=0.05)
    assert 0.3 <= sigmas[0] < 0.6


def test_a_blow_is_not_believed_to_be_a_jump():
    size, sure = np.radians([1.0, 0.0, 0.0]), np.radians([0.1, 0.1, 0.1])
    assert jumps.Jump(1.0, 0.1, size, sure).believable
    assert not jumps.Jump(1.0, 0.1, 20.0 * size, sure).believable
    assert not jumps.Jump(1.0, 0.1, size, 10.0 * sure).believable


def test_runs_agree_on_a_jump_as_far_as_they_can_tell():
    size = np.radians([0.0, 0.0, 2.0])
    sharp = (jumps.Jump(5.0, 0.1, size, np.radians([0.02, 0.02, 0.02])),)
    blurred = (jumps.Jump(5.0, 0.1, 0.5 * size, np.radians([0.1, 0.1, 0.9])),)
    none = (jumps.Jump(5.0, 0.1, 0.0 * size, np.radians([0.02, 0.02, 0.02])),)
    assert jumps.agree(sharp, blurred)
    assert not jumps.agree(sharp, none)


# Where jumps of the gyro bias are looked for, how large and how sure they are told: closed forms of one axis.

OPENED = np.radians(3.0)


def shocks(lam: Any, Lam: Any) -> np.ndarray:
    """Scores (m, 12) of diagonal information."""
    lam, Lam = np.atleast_2d(lam), np.atleast_2d(Lam)
    out = np.zeros((len(lam), 12))
    out[:, :3] = lam
    out[:, [3, 7, 11]] = Lam
    return out


def test_gain_and_size_of_independent_axes_are_sums_of_their_own() -> None:
    lam, Lam = np.array([90.0, -200.0, 40.0]), np.array([9e3, 2e4, 1e3])
    gain, size = jumps.gains(shocks(lam, Lam))
    assert size[0] == pytest.approx(-lam / (Lam + OPENED**-2))
    want = 0.5 * lam**2 / (Lam + OPENED**-2) - 0.5 * np.log(1.0 + OPENED**2 * Lam)
    assert gain[0] == pytest.approx(want.sum())


def test_a_candidate_is_two_seconds_from_the_ends_and_other_jumps_and_above_0_2_deg_s() -> None:
    when = np.arange(0.0, 20.0, 0.25)

    def found(at: dict[float, float], known: tuple[float, ...] = ()) -> tuple[float, float]:
        lam = np.zeros((len(when), 3))
        for t, dps in at.items():
            lam[round(t / 0.25), 1] = -np.radians(dps) * (1e6 + OPENED**-2)
        told: Any = SimpleNamespace(shocks=shocks(lam, np.full_like(lam, 1e6)))
        return jumps.candidate(told, when, known)

    end = when[-1]
    assert found({1.75: 3.0, 2.25: 1.0, end - 2.25: 0.9, end - 1.75: 3.0})[0] == 2.25
    assert found({1.75: 3.0, end - 2.25: 0.9, end - 1.75: 3.0})[0] == end - 2.25
    assert found({10.0: 3.0, 12.25: 1.0}, (10.5,))[0] != 10.0
    assert found({8.25: 1.0, 8.75: 3.0, 12.25: 2.0, 12.75: 1.5}, (10.5,))[0] == 12.75
    gain = jumps.gains(shocks([0.0, -np.radians(0.21) * (1e6 + OPENED**-2), 0.0], [1e6] * 3))[0][0]
    assert found({9.0: 0.21}) == (9.0, pytest.approx(gain))
    assert found({9.0: 0.19}) == (0.0, 0.0)


def test_a_modelled_jump_is_told_by_the_scores_of_its_own_node() -> None:
    when = np.arange(0.0, 10.0, 0.5)
    jump = np.zeros(20)
    jump[[4, 12]] = OPENED
    lam, Lam = np.zeros((20, 3)), np.zeros((20, 3))
    lam[12], Lam[12] = [1.0, -2.0, 3.0], [0.1 / OPENED**2, 0.9 / OPENED**2, 1.1 / OPENED**2]
    found: Any = SimpleNamespace(schedule=SimpleNamespace(jump=jump), shocks=shocks(lam, Lam))
    first, second = jumps.modelled(found, when, (2.1, 5.9), (0.1, 0.2))
    assert (first.t, first.t_sigma, second.t, second.t_sigma) == (2.1, 0.1, 5.9, 0.2)
    assert first.sigma == pytest.approx(np.full(3, OPENED))
    assert second.size == pytest.approx(OPENED**2 * np.array([-1.0, 2.0, -3.0]))
    assert second.sigma == pytest.approx(OPENED * np.sqrt([0.9, 0.1, 0.0]))


@pytest.mark.parametrize(
    ("dps", "sigma", "counts", "believable"),
    [(0.19, 0.1, False, True), (0.21, 0.29, True, True), (9.9, 0.1, True, True), (10.1, 0.1, True, False)],
)
def test_jumps_count_from_0_2_and_are_believed_to_10_deg_s(
    dps: float, sigma: float, counts: bool, believable: bool
) -> None:
    size = np.radians(dps) * np.array([0.6, 0.0, -0.8])
    jump = jumps.Jump(1.0, 0.1, size, np.radians([0.01, sigma, 0.02]))
    assert (jump.counts, jump.believable) == (counts, believable)
    assert np.degrees(jump.rate) == pytest.approx(dps)
    unsure = jumps.Jump(1.0, 0.1, size, np.radians([0.01, 0.31, 0.02]))
    assert not unsure.believable


def test_each_of_two_times_moves_to_its_own_top_and_the_wider_side_is_its_sigma() -> None:
    """A likelihood that falls by 2 within 0.3 s before and 2.4 s after the first time; one with a far, flat side."""
    asked: list[float] = []

    def likelihood(times: tuple[float, ...]) -> float:
        a, b = times[0] - 10.4, times[1] - 19.0
        asked.append(b)
        return -2.0 * (a / (0.3 if a < 0.0 else 2.4)) ** 2 - (3.0 * b * b if b < 0.0 else 1e-3 * b)

    times, sigmas = jumps.placed((9.0, 20.0), likelihood)
    assert times == pytest.approx((10.4, 19.0), abs=0.051)
    assert sigmas[0] == pytest.approx(0.5 * 3.2)
    assert sigmas[1] == pytest.approx(0.5 * 0.05 * 2**10)
    assert 13.0 < max(asked) < 26.1


def test_runs_agree_within_three_joint_sigmas_and_a_tenth_of_a_deg_s() -> None:
    def one(t: float, dps: float, sigma: float) -> tuple[jumps.Jump, ...]:
        return (jumps.Jump(t, 0.1, np.radians([0.0, dps, 0.0]), np.radians([0.0, sigma, 0.0])),)

    base = one(5.0, 1.0, 0.03)
    limit = 3.0 * np.hypot(0.03, 0.04) + 0.1
    assert jumps.agree(base, one(5.0, 1.0 + 0.99 * limit, 0.04))
    assert not jumps.agree(base, one(5.0, 1.0 + 1.01 * limit, 0.04))
    assert not jumps.agree(base, one(5.0, 1.0 - 1.01 * limit, 0.04))
    assert jumps.agree(base, one(6.0, 9.0, 0.04))


def test_each_rest_of_two_seconds_shows_the_bias() -> None:
    """The first and last rest count, as means; one of 1.9 s is too short to tell."""
    t = 0.01 * np.arange(2000)
    still, gyr = np.zeros(2000, bool), np.ones((2000, 3))
    for begin, long, rate in ((0, 201, 0.0), (500, 300, 0.7), (900, 202, 0.03), (1500, 195, 0.5)):
        still[begin : begin + long] = True
        gyr[begin : begin + long] = rate * np.array([0.6, 0.0, -0.8])
    inputs: Any = SimpleNamespace(t=t, still=still, gyr=gyr)
    assert jumps.bias_change_dps(inputs) == pytest.approx(np.degrees(0.03))
    assert jumps.changed_at_rest(inputs)
    gyr[900:1102] = np.radians(0.49) * np.array([0.6, 0.0, -0.8])
    assert not jumps.changed_at_rest(inputs)
    still[1600:] = True
    gyr[1600:] = 0.0
    assert jumps.bias_change_dps(inputs) > 1.0


# `eskf` with a gyro whose bias jumps: found as it happens, errors within sigma soon after, nothing changed before.

ONLINE_JUMP_S, SETTLED_S = 52.0, 6.0


def stepped_online(made, dps):
    m = made.motion
    return replace(made, motion=replace(m, gyr=m.gyr + np.radians(dps) * (m.t >= ONLINE_JUMP_S)[:, None]))


@pytest.fixture(scope="module")
def online_run():
    return flight()


@pytest.mark.parametrize("dps", [[0.0, 0.0, 2.0], [1.5, 0.0, 0.0]])
def test_after_a_jump_errors_are_soon_as_large_as_they_are_said_to_be(online_run, dps):
    e = estimate("eskf", *stepped_online(online_run, dps).motion.sensors, aids=online_run.aids)
    assert e.quality["gyro_jumps"] == 1.0
    assert e.quality["gyro_jump_s"] == pytest.approx(ONLINE_JUMP_S, abs=1.0)
    tilt, heading = off(e.q, online_run.motion.q)
    late = e.t > ONLINE_JUMP_S + SETTLED_S
    assert np.sqrt(np.mean((heading[late] / e.aux["sigma_heading"][late]) ** 2)) < 2.0
    assert np.sqrt(np.mean((tilt[late] / e.aux["sigma_tilt"][late]) ** 2)) < 2.0
    assert e.bias is not None
    assert e.bias[-1] == pytest.approx(np.add(np.radians(dps), [0.004, -0.003, 0.002]), abs=np.radians(0.1))


def test_a_jump_changes_nothing_that_was_said_before_it(online_run):
    sound, jumped = (
        estimate("eskf@fixed", *one.motion.sensors, aids=online_run.aids)
        for one in (online_run, stepped_online(online_run, [0.0, 0.0, 2.0]))
    )
    before = sound.t < ONLINE_JUMP_S
    assert np.array_equal(sound.q[before], jumped.q[before])
    assert sound.quality["gyro_jumps"] == 0.0
    assert jumped.quality["gyro_jumps"] >= 1.0


def test_a_field_that_changes_is_no_jump(online_run):
    m = online_run.motion
    field = m.mag + 6e-6 * np.outer(m.t >= ONLINE_JUMP_S, [1.0, -0.6, 0.4])
    e = estimate("eskf", m.t, m.gyr, m.acc, field, aids=online_run.aids)
    assert e.quality["gyro_jumps"] == 0.0


@pytest.mark.parametrize(("name", "deg"), [("eskf@fixed", 15.0), ("eskf", 40.0)])
def test_a_turned_compass_that_gnss_contradicts_is_no_jump(online_run, name, deg):
    m = online_run.motion
    field = rotation.rotate(rotation.from_euler(0.0, 0.0, np.radians(deg)), m.mag)
    e = estimate(name, m.t, m.gyr, m.acc, field, aids=online_run.aids)
    assert e.quality["gyro_jumps"] == 0.0


# When a filter looks for a jump of the gyro bias and when it takes one: each limit from both sides.
#
# A runner whose innovations, gains and likelihoods are declared stands for the filter.

STEP_S, SECONDS = 0.1, 30
NODES = round(SECONDS / STEP_S)
OPENED_BIAS = np.radians(3.0)


def shock(gain: float, dps: float) -> np.ndarray:
    """The scores (12,) of a jump about z that gains so much and is so large: both are functions of two numbers."""
    size = np.radians(dps)

    def found(log: float) -> np.ndarray:
        row = np.zeros(12)
        row[[3, 7, 11]] = np.exp(log)
        row[2] = -size * (np.exp(log) + OPENED_BIAS**-2)
        return row

    least = np.log(3.0 / size**2)
    return found(brentq(lambda log: gains(found(log)[None])[0][0] - gain, least, least + 10.0))


class Declared:
    """A runner: innovations do not fit after ``bad`` s, a jump at ``at`` s has these gains."""

    def __init__(self, at: float = 12.0, bad: float = 12.2, **given: Any) -> None:
        own = {"gain": 60.0, "dps": 2.0, "real": 60.0, "gnss": 0.0, "end": 1e9}
        self.own = SimpleNamespace(**(own | given))
        self.at, self.bad = at, bad
        self.inputs = SimpleNamespace(sensed_at=100.0 + STEP_S * np.arange(NODES))
        self.looks: list[tuple[int, int]] = []

    def begun(self, schedule: Schedule, begin: Any) -> tuple[Any, State]:
        ratio = np.full((NODES, 4), np.nan)
        when = STEP_S * np.arange(NODES)
        ratio[::2, 0] = np.where((when >= self.bad) & (when < self.own.end), 0.6, 0.3)[::2]
        return SimpleNamespace(ratio=ratio, memory=None), State(
            np.zeros(4), np.zeros(39), np.zeros(39 * 40), np.zeros(18)
        )

    def run(self, a: int, b: int, found: Any, state: State, *_: Any) -> None:
        state.x[0] = b

    def shocks(self, schedule: Schedule, begin: Any, par: Any, state: State, a: int, b: int) -> Any:
        assert state.x[0] == a
        scores = np.zeros((b - a, 12))
        scores[:, [3, 7, 11]] = 1.0
        k = round(self.at / STEP_S)
        opened = schedule.jump[k] > 0.0
        if a <= k < b:
            scores[k - a] = shock(self.own.gain, self.own.dps)
        if not opened:
            self.looks.append((a, b))
        after = state.copy()
        after.x[0] = b
        after.memory[17] += self.own.real if opened else 0.0
        by_group = np.zeros(8)
        if opened:
            by_group[:5] = 0.25 * self.own.gnss
            by_group[4] = -1e3
        return scores, after, by_group


def filtered(runner: Declared) -> tuple[Any, Any, Schedule]:
    none: Any = np.zeros(0)
    schedule = Schedule(np.arange(NODES), *([none] * 9), jump=np.zeros(NODES))  # type: ignore[call-arg]
    told: Any = runner
    found, jumps = online.filtered(told, schedule, None, none)  # type: ignore[arg-type]
    assert (schedule.jump == 0.0).all()
    return found, jumps, schedule


@pytest.mark.parametrize(
    ("limit", "taken"),
    [
        ({}, True),
        ({"gain": 40.5}, True),
        ({"gain": 39.5}, False),
        ({"dps": 3.95}, True),
        ({"dps": 4.05}, False),
        ({"dps": 0.21}, True),
        ({"dps": 0.19}, False),
        ({"real": 40.1}, True),
        ({"real": 39.9}, False),
        ({"gnss": -4.9}, True),
        ({"gnss": -5.1}, False),
    ],
)
def test_a_jump_is_taken_that_gains_40_is_below_4_deg_s_and_costs_gnss_less_than_5(limit: Any, taken: bool) -> None:
    found, jumps, _ = filtered(Declared(**limit))
    assert len(jumps) == taken
    if taken:
        assert jumps[0].t == pytest.approx(112.0)
        assert np.degrees(jumps[0].size) == pytest.approx([0.0, 0.0, limit.get("dps", 2.0)])
    assert found.memory is not None


def test_what_a_jump_turned_while_its_time_was_unsure_by_half_a_second_widens_the_attitude() -> None:
    runner = Declared(end=13.0)
    kept: list[Any] = []
    begun = runner.begun
    runner.begun = lambda *x: kept.append(begun(*x)) or kept[0]  # type: ignore[method-assign]
    filtered(runner)
    P = kept[0][1].P.reshape(39, 40)
    want = np.zeros((39, 40))
    want[2, 2] = (0.5 * np.radians(2.0)) ** 2
    assert pytest.approx(want) == P


def test_a_jump_in_the_last_0_3_s_waits_for_the_next_look() -> None:
    """Innovations are asked for each second: what jumped at 12.5 s is told by 13 s, at 12.7 s by 14 s."""
    for at, looks in ((12.5, 1), (12.7, 2)):
        runner = Declared(at=at)
        runner.own.end = 14.0
        assert len(filtered(runner)[1]) == 1
        assert len(runner.looks) == looks


def test_it_looks_only_while_innovations_do_not_fit_over_ten_seconds_and_seldom_in_vain() -> None:
    """From 12.2 s on: after five looks, one a second, in vain at every fifth second of the run only."""
    runner = Declared(gain=10.0)
    assert filtered(runner)[1] == ()
    ends = [b for _, b in runner.looks]
    assert ends == [130, 140, 150, 160, 170, 210, 260]
    for a, b in runner.looks:
        assert (b - 1 - a) * STEP_S <= 10.0 + 1e-9
        assert (b - 1 - (a - 10)) * STEP_S > 10.0


def test_looks_start_anew_after_innovations_fitted() -> None:
    runner = Declared(gain=10.0, end=16.0)
    ratio = runner.begun(None, None)[0].ratio  # type: ignore[arg-type]
    ratio[200:, 3] = 0.6
    begun = runner.begun
    runner.begun = lambda *x: (SimpleNamespace(ratio=ratio, memory=None), begun(*x)[1])  # type: ignore[method-assign]
    filtered(runner)
    assert [b for _, b in runner.looks] == [130, 140, 150, 160, 210, 220, 230, 240, 250, 260]


def test_velocities_or_fields_that_miss_by_half_their_gate_have_grown_and_no_single_one_counts_above_nine() -> None:
    nan = np.nan
    for column, counts in ((0, True), (1, False), (2, False), (3, True)):
        ratio = np.full((4, 4), nan)
        ratio[:2, column] = [0.41, 0.61]
        assert online.grown(ratio) is counts
        ratio[:2, column] = [0.39, 0.59]
        assert not online.grown(ratio)
    many = np.full((19, 4), 0.0)
    many[0] = 1e6
    assert not online.grown(many)
    assert online.grown(many[:17])
    assert not online.grown(np.full((4, 4), nan))


def test_four_jumps_are_the_most() -> None:
    runner = Declared(bad=2.0)
    shocks = runner.shocks

    def again(*given: Any) -> Any:
        runner.at = STEP_S * (given[5] - 8)
        return shocks(*given)

    runner.shocks = again  # type: ignore[method-assign]
    assert len(filtered(runner)[1]) == 4
