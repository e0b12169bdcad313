"""Jumps of the gyro bias: planted in simulated motion with known truth, and the predictions against runs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.core import rotation
from attlog.estimators import estimate
from attlog.estimators.filters.navigation import jumps
from attlog.estimators.filters.navigation.inputs import JUMP_RAD_S, NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.passes import solved, solved_twice
from attlog.estimators.filters.navigation.schedule import Timetable
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
    par, begin, timetable = tuned.settings(inputs.gravity, 100.0), start(inputs, tuned), Timetable(inputs)
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
        (jump,) = jumps.modelled_jumps(found, when, (t,), (0.0,))
        before, after = (found.bias[i] + found.d[i, 3:] for i in (k - 1, k))
        assert jump.size == pytest.approx(after - before, abs=1e-2 * JUMP_RAD_S)


def test_a_blow_is_not_believed_to_be_a_jump():
    size, sure = np.radians([1.0, 0.0, 0.0]), np.radians([0.1, 0.1, 0.1])
    assert jumps.Jump(1.0, 0.1, size, sure).believable
    assert not jumps.Jump(1.0, 0.1, 20.0 * size, sure).believable
    assert not jumps.Jump(1.0, 0.1, size, 10.0 * sure).believable


# Where jumps of the gyro bias are looked for, how large and how sure they are told: closed forms of one axis.


def shocks(lam: Any, Lam: Any) -> np.ndarray:
    """Scores (m, 12) of diagonal information."""
    lam, Lam = np.atleast_2d(lam), np.atleast_2d(Lam)
    out = np.zeros((len(lam), 12))
    out[:, :3] = lam
    out[:, [3, 7, 11]] = Lam
    return out


def test_each_of_two_times_moves_to_its_own_top_and_the_wider_side_is_its_sigma() -> None:
    """A likelihood that falls by 2 within 0.3 s before and 2.4 s after the first time; one with a far, flat side."""
    asked: list[float] = []

    def likelihood(times: tuple[float, ...]) -> float:
        a, b = times[0] - 10.4, times[1] - 19.0
        asked.append(b)
        return -2.0 * (a / (0.3 if a < 0.0 else 2.4)) ** 2 - (3.0 * b * b if b < 0.0 else 1e-3 * b)

    times, sigmas = jumps.refine_times((9.0, 20.0), likelihood)
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


def test_a_jump_is_found_whenever_it_comes_though_the_field_never_fits():
    """A field that wanders by 15 % lets innovations grow for good, so that searches are rare."""
    made = flight(seconds=100.0)
    m = made.motion
    wander = 0.15 * np.nanmax(np.abs(m.mag)) * np.sin(2.0 * np.pi * m.t / 3.1) * (m.t > 22.0)
    field = m.mag + np.outer(wander, [1.0, -1.0, 0.5])
    for when in np.arange(60.0, 76.0, 2.0):
        gyr = m.gyr + np.radians([0.0, 0.0, 2.0]) * (m.t >= when)[:, None]
        e = estimate("eskf@fixed", m.t, gyr, m.acc, field, aids=made.aids)
        assert e.quality["gyro_jumps"] >= 1.0
        assert e.quality["gyro_jump_s"] > when - 1.5


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
