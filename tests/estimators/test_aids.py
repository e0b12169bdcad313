"""Aids: what is refused, what a segment gets of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

import attlog
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators import Aids, Measurements, estimate
from attlog.estimators import aids as airspeed
from attlog.estimators.aids import (
    AIRSPEED_AGE,
    AIRSPEED_LOWPASSED,
    AIRSPEED_RATE,
    NEVER,
    TRUE_AIRSPEED,
    update_airspeed,
    without_acceleration,
)
from attlog.testing.motions import CONSUMER_NOISE, GRAVITY, Motion, heading_deg, motion, tilt_deg

T = np.array([0.0, 1.0, 2.0])
NED = np.ones((3, 3))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Measurements(T, np.ones(2)), "t (n,) and x"),
        (lambda: Measurements(T[:, None], NED), "t (n,) and x"),
        (lambda: Measurements([0.0, 2.0, 1.0], NED), "must be finite and rise"),
        (lambda: Measurements([0.0, 1.0, 1.0], NED), "must be finite and rise"),
        (lambda: Measurements([0.0, 1.0, np.nan], NED), "must be finite and rise"),
        (lambda: Measurements(T, [1.0, np.inf, 1.0]), "values of aids must be finite"),
        (lambda: Measurements(T, [[1.0, np.nan], [np.nan, np.nan], [1.0, 2.0]]), "leave out samples without a value"),
        (lambda: Measurements(T, NED, [1.0, -1.0, 1.0]), "sigma of aids"),
        (lambda: Measurements(T, NED, [1.0, 1.0]), "sigma of aids"),
        (lambda: Measurements(T, ["a", "b", "c"]), "array of numbers"),
        (lambda: Aids(velocity=Measurements(T, NED[:, :2])), "velocity needs x (n, 3)"),
        (lambda: Aids(baro=Measurements(T, NED)), "baro needs x (n,)"),
        (lambda: Aids(position=Measurements(T, NED, [1.0, 1.0, 1.0])), "position needs"),
        (lambda: Aids(mag=Measurements(T, NED[:, :2])), "mag needs x (n, 3)"),
        (lambda: Aids(velocity=(T, NED)), "velocity must be attlog.estimators.Measurements"),
        (lambda: Aids(at_rest=[1.0, 2.0]), "at_rest must be (k, 2)"),
        (lambda: Aids(at_rest=[[3.0, 2.0]]), "must follow each other"),
        (lambda: Aids(at_rest=[[0.0, 2.0], [1.0, 3.0]]), "must follow each other"),
    ],
)
def test_what_is_no_aid_is_refused_in_words(make: Any, words: str) -> None:
    with pytest.raises(UsageError) as refused:
        make()
    assert words in str(refused.value)


def test_estimate_refuses_aids_that_are_none() -> None:
    with pytest.raises(UsageError, match=r"attlog\.estimators\.Aids, not dict"):
        attlog.estimate("gyro", T, NED, aids={})  # type: ignore[arg-type]


def test_the_arrays_are_copies_that_stay_as_they_are() -> None:
    given = T.copy()
    held = Measurements(given, T)
    given[0] = -5.0
    assert held.t[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        held.x[0] = 3.0


def test_a_cut_keeps_what_lies_inside_with_both_ends() -> None:
    aids = Aids(
        velocity=Measurements(T, NED, T),
        baro=Measurements(T + 10, T),
        at_rest=[[0.0, 0.5], [0.8, 1.5], [1.8, 1.9], [3, 4]],
    )
    cut = aids.between(1.0, 2.0)
    assert cut.velocity is not None
    assert cut.velocity.sigma is not None
    assert cut.velocity.t.tolist() == [1.0, 2.0]
    assert cut.velocity.sigma.tolist() == [1.0, 2.0]
    assert cut.baro is None
    assert cut.position is None
    assert cut.at_rest is not None
    assert cut.at_rest.tolist() == [[1.0, 1.5], [1.8, 1.9]]


def test_rest_is_yes_no_or_unknown() -> None:
    t = np.array([-1.0, 0.0, 0.5, 0.6, 2.0])
    assert Aids(at_rest=[[0.0, 0.5], [1.9, 2.5]]).resting(t).tolist() == [0, 1, 1, 0, 1]
    assert Aids(at_rest=np.empty((0, 2))).resting(t).tolist() == [0] * 5
    assert Aids().resting(t).tolist() == [-1] * 5


WHOLE = '''"""Takes whole segments and shows which aids it got."""
import numpy as np
from attlog.estimators import Estimate
SOURCE = "test"
NEEDS = {"gyro"}
USES = {"gnss", "at_rest"}

def run(t, gyr, acc, mag, aids, params):
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    fixes = 0 if aids.velocity is None else len(aids.velocity.t)
    first = -1.0 if aids.velocity is None else aids.velocity.t[0]
    return Estimate(t=t, q=q, aux={"seen": np.tile([fixes, first, aids.baro is not None], (len(t), 1))})
'''


def test_a_run_gets_of_its_aids_what_lies_in_its_segment(tmp_path: Path) -> None:
    """5 Hz fixes from 0 to 10 s; samples from 0 to 2 and from 5 to 8 s: two segments."""
    file = tmp_path / "whole.py"
    file.write_text(WHOLE)
    t = np.r_[np.arange(0.0, 2.005, 0.01), np.arange(5.0, 8.005, 0.01)]
    fixes = np.arange(0.1, 10.0, 0.2)
    aids = Aids(velocity=Measurements(fixes, np.zeros((len(fixes), 3))), baro=Measurements([0.5], [1.0]))
    seen = attlog.estimate(str(file), t, np.zeros((len(t), 3)), aids=aids).aux["seen"]
    assert seen[0].tolist() == [10.0, 0.1, 1.0]
    assert seen[-1] == pytest.approx([15.0, 5.1, 0.0])
    assert attlog.estimate(str(file), t, np.zeros((len(t), 3))).aux["seen"][0].tolist() == [0.0, -1.0, 0.0]


# Airspeed in filters: a plane in coordinated turns, known in closed form, and what pitot tubes tell.

Array = np.ndarray
DT = 0.01


def speed(t: Array) -> Array:
    return 20.0 + 4.0 * np.sin(0.2 * t)


def bank(t: Array) -> Array:
    return 0.5 * np.sin(0.25 * t) + 0.3


def plane(seconds: float = 120.0) -> Motion:
    """Level turns without sideslip: yaw' = g tan(bank) / V, the velocity V along the nose; it begins in a turn."""
    fine = np.arange(0.0, seconds + 0.01, 0.001)
    turned = cumulative_simpson(GRAVITY * np.tan(bank(fine)) / speed(fine), x=fine, initial=0.0)

    def yaw(t: Array) -> Array:
        return np.interp(t, fine, turned)

    def acceleration(t: Array) -> Array:
        along, across = 0.8 * np.cos(0.2 * t), GRAVITY * np.tan(bank(t))
        c, s = np.cos(yaw(t)), np.sin(yaw(t))
        return np.stack([along * c - across * s, along * s + across * c, 0.0 * t], axis=-1)

    return motion(lambda t: (bank(t), 0.0 * t, yaw(t)), seconds, acceleration=acceleration, noise=CONSUMER_NOISE)


def pitot(t: Array, noise: float = 0.5) -> Measurements:
    """Five readings a second, as autopilots log them."""
    at = np.arange(t[0], t[-1], 0.2)
    return Measurements(at, speed(at) + noise * np.random.default_rng(1).standard_normal(len(at)))


def listening(told: float = np.nan) -> Array:
    """A state that heard that much at once, or nothing yet."""
    state = np.zeros(5)
    state[AIRSPEED_AGE] = NEVER
    update_airspeed(state, 0, DT, told, False)
    return state


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def test_less_the_flights_own_acceleration_force_is_gravity_in_any_turn() -> None:
    m = plane(20.0)
    rate = (GRAVITY * np.tan(bank(m.t)) / speed(m.t))[:, None] * rotation.rotate_inverse(m.q, np.array([0.0, 0.0, 1.0]))
    gravity = rotation.rotate_inverse(m.q, np.array([0.0, 0.0, -GRAVITY]))
    rolling = np.array([0.125 * np.cos(0.25 * m.t), 0.0 * m.t, 0.0 * m.t]).T
    state = np.zeros(5)
    found = np.empty_like(m.acc)
    for k in range(len(m.t)):
        state[TRUE_AIRSPEED], state[AIRSPEED_RATE] = speed(m.t[k]), 0.8 * np.cos(0.2 * m.t[k])
        w = rate[k] + rolling[k]
        found[k] = without_acceleration(state, 0, m.acc[k], w[1], w[2])
    noise = CONSUMER_NOISE.acc * 10.0
    assert rms(found - gravity) < 1.1 * noise
    assert rms(m.acc - gravity) > 3.0


def test_a_missing_force_stays_missing() -> None:
    state = np.array([20.0, 3.0, 20.0, 20.0, 0.0])
    assert without_acceleration(state, 0, np.zeros(3), 1.0, 1.0) == (0.0, 0.0, 0.0)


def test_the_first_reading_counts_at_once_and_is_no_acceleration() -> None:
    state = listening(22.0)
    assert (state[TRUE_AIRSPEED], state[AIRSPEED_RATE]) == (0.0, 0.0)
    update_airspeed(state, 0, DT, np.nan, False)
    assert (state[TRUE_AIRSPEED], state[AIRSPEED_RATE]) == (22.0, 0.0)


def test_what_a_tube_tells_at_rest_moves_nothing() -> None:
    """Tubes of real autopilots read 63 m/s until they are set to zero."""
    state = listening(63.5)
    for told in (63.5, 63.5, 1.0, 0.5):
        update_airspeed(state, 0, DT, told, True)
        assert (state[TRUE_AIRSPEED], state[AIRSPEED_RATE]) == (0.0, 0.0)
    update_airspeed(state, 0, DT, np.nan, False)
    assert state[TRUE_AIRSPEED] == 0.0


def test_changes_add_up_to_the_speed_and_spikes_are_cut() -> None:
    state = listening(0.0)
    total, steepest = 0.0, 0.0
    for k in range(600):
        update_airspeed(state, 0, DT, 18.0 if k % 20 == 0 else np.nan, False)
        total += DT * state[AIRSPEED_RATE]
        steepest = max(steepest, state[AIRSPEED_LOWPASSED] / (DT * (k + 1)))
    assert total == pytest.approx(state[TRUE_AIRSPEED], abs=1e-9)
    assert state[TRUE_AIRSPEED] == pytest.approx(18.0, abs=0.01)
    assert steepest == pytest.approx(airspeed.MAX_AIRSPEED_RATE, rel=1e-9)


def test_a_breeze_is_no_flight() -> None:
    assert airspeed.weighted_airspeed(0.9) == 0.0
    assert 0.0 < airspeed.weighted_airspeed(2.0) < 2.0
    assert airspeed.weighted_airspeed(airspeed.FULL_AIRSPEED) == airspeed.FULL_AIRSPEED
    assert airspeed.weighted_airspeed(-5.0) == 0.0


def test_a_tube_that_falls_silent_tells_nothing_after_two_seconds() -> None:
    state = listening(20.0)
    silent = []
    for _ in range(250):
        update_airspeed(state, 0, DT, np.nan, False)
        silent.append(state[TRUE_AIRSPEED])
    assert silent[190] == 20.0
    assert silent[-1] == 0.0
    assert state[AIRSPEED_RATE] == 0.0


@pytest.mark.parametrize(("name", "tilt", "heading"), [("mekf", 1.0, 3.0), ("smoother", 0.7, 2.0)])
def test_a_plane_that_never_flies_level_keeps_its_attitude_by_airspeed(name: str, tilt: float, heading: float) -> None:
    m = plane()
    late = m.t > 20.0
    found = {}
    for aids in (Aids(), Aids(airspeed=pitot(m.t))):
        e = estimate(name, *m.sensors, aids=aids)
        found[aids.airspeed is not None] = e
    off = {k: rms(tilt_deg(e.q, m.q)[late]) for k, e in found.items()}
    assert off[True] < tilt
    assert off[False] > 3.0 * off[True]
    assert rms(heading_deg(found[True].q, m.q)[late]) < heading
    z = np.deg2rad(tilt_deg(found[True].q, m.q)) / found[True].aux["sigma_tilt"].ravel()
    assert rms(z[late]) < 1.5


def test_without_gnss_the_navigation_filter_and_the_smoother_hear_airspeed_too() -> None:
    m = plane(60.0)
    aids = Aids(airspeed=pitot(m.t))
    by_mekf, by_eskf = (estimate(name, *m.sensors, aids=aids) for name in ("mekf", "eskf"))
    assert np.array_equal(by_mekf.q, by_eskf.q)
    assert by_eskf.quality["aided_by"] == "mag airspeed"
    assert estimate("smoother", *m.sensors, aids=aids).quality["aided_by"] == "mag airspeed rest"


def test_a_tube_on_a_copter_that_hovers_changes_nothing() -> None:
    m = motion(lambda t: (0.1 * np.sin(t), 0.1 * np.cos(1.3 * t), 0.3 * t), 30.0, noise=CONSUMER_NOISE)
    calm = Aids(airspeed=replace(pitot(m.t), x=np.full(len(pitot(m.t).t), 0.4)))
    assert np.array_equal(estimate("mekf", *m.sensors).q, estimate("mekf", *m.sensors, aids=calm).q)
