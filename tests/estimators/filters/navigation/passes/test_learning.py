"""`eskf` learns the constants of its sensors on the way: when it looks, what it then knows; and without GNSS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.estimators import estimate
from attlog.estimators.filters.navigation.measured import Inputs, made_ready
from attlog.estimators.filters.navigation.passes.learning import learnt, stages
from attlog.estimators.filters.navigation.settings import NoiseLevels
from tests.estimators.filters.navigation.made import flight, off


def inputs_of(seconds: float, still: float = 10.0) -> Inputs:
    made = flight(seconds=seconds, still=still)
    return made_ready(*made.motion.sensors, made.aids, 0.0, ahead=False)


def test_it_looks_after_10_16_and_26_seconds_of_motion():
    inputs = inputs_of(60.0, still=20.0)
    cuts = [a for a, _ in stages(inputs)]
    motion = np.cumsum(np.where(inputs.rest == 0, inputs.dt, 0.0))
    assert motion[cuts[1:]] == pytest.approx([10.0, 16.0, 25.6], abs=0.02)
    assert [b for _, b in stages(inputs)] == [*cuts[1:], len(inputs.t)]
    assert cuts[0] == 0


def test_without_ten_seconds_of_fixes_there_is_no_look():
    inputs = inputs_of(40.0)
    assert inputs.velocity is not None
    late = replace(inputs, velocity=inputs.velocity.between(31.0, 40.0))
    assert stages(late) == [(0, len(inputs.t))]
    assert stages(replace(inputs, velocity=None)) == [(0, len(inputs.t))]


def test_the_delay_of_gnss_is_learnt_within_half_a_minute_of_flight():
    """Planted are 100 ms, begun with 250 ms."""
    inputs = inputs_of(40.0)
    found = learnt(inputs, replace(NoiseLevels(), gnss_delay=0.25), 2.5)
    assert found.levels.gnss_delay == pytest.approx(0.100, abs=0.02)
    assert found.levels.prior.gnss_delay == 0.010
    assert found.state is not None


def test_noise_is_believed_by_the_motion_that_showed_it():
    """30 s of motion count 30 parts against 40 of the noise begun with: geometric means."""
    inputs = inputs_of(40.0)
    begun = NoiseLevels()
    sure = learnt(inputs, replace(begun, acc=1.0), 2.5).levels.acc
    unsure = learnt(inputs, replace(begun, acc=0.01), 2.5).levels.acc
    seen = float(np.sum(inputs.dt[inputs.rest == 0]))
    assert np.log(sure / unsure) == pytest.approx(np.log(100.0) * 40.0 / (40.0 + seen), rel=0.1)


def test_what_was_learnt_makes_the_filter_better_than_one_that_never_learns():
    made = flight(seconds=120.0)
    late = made.motion.t > 40.0
    learning, fixed = (
        np.sqrt(
            [np.mean(x[late] ** 2) for x in off(estimate(spec, *made.motion.sensors, aids=made.aids).q, made.motion.q)]
        )
        for spec in ("eskf", "eskf@fixed")
    )
    assert (learning < 0.9 * fixed).any()
    assert (learning < 1.1 * fixed).all()


def test_the_last_look_and_their_number_are_told():
    made = flight(seconds=60.0)
    told = estimate("eskf", *made.motion.sensors, aids=made.aids).quality
    assert told["constants"] == "past"
    assert told["constants_learnt"] == 3.0
    assert "constants_learnt" not in estimate("eskf@fixed", *made.motion.sensors, aids=made.aids).quality


def test_without_gnss_it_is_the_model_of_mekf():
    made = flight(seconds=30.0)
    alone = estimate("eskf", *made.motion.sensors, declination=3.0)
    barometer = estimate(
        "eskf", *made.motion.sensors, declination=3.0, aids=replace(made.aids, velocity=None, position=None)
    )
    want = estimate("mekf", *made.motion.sensors, declination=3.0)
    assert np.array_equal(alone.q, want.q)
    assert np.array_equal(barometer.q, want.q)
    assert alone.quality["model"] == "mekf"
