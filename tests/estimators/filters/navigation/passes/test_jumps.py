"""Jumps of the gyro bias: planted in simulated motion with known truth, and the predictions against runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.base import rotation
from attlog.estimators import estimate
from attlog.estimators.filters.navigation.measured import made_ready
from attlog.estimators.filters.navigation.passes import jumps, solved, solved_twice
from attlog.estimators.filters.navigation.schedule import Timetable
from attlog.estimators.filters.navigation.settings import JUMP_RAD_S, NoiseLevels
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
    return made_ready(m.t, m.gyr, m.acc, mag, made.aids, 0.0, ahead=True)


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
