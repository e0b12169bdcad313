"""The scenarios that come with attlog do what their titles say, and begin and end as real logs do."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from attlog.base import rotation
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.scenario.scenario import load, names

WANTED = {
    "static",
    "lift-drop",
    "rotation",
    "hover",
    "steps",
    "initial-angle",
    "tracking",
    "waypoints",
    "yaw",
    "aggressive",
    "drift",
    "vibration",
    "mag-anomaly",
    "gnss-loss",
    "crash",
    "carried-home",
    "roll-in",
    "flip",
    "hard-landing",
    "no-liftoff",
    "clipping",
}
FLOWN = sorted(WANTED - {"static", "lift-drop", "rotation", "flip", "no-liftoff"})


@functools.lru_cache(maxsize=16)
def flown(name: str) -> Flight:
    return fly(load(name), seed=1)


def tilt_deg(flight: Flight) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.degrees(rotation.inclination_angle(flight.truth.q))


def test_the_library_is_complete() -> None:
    assert set(names()) == WANTED


@pytest.mark.slow
@pytest.mark.parametrize("name", FLOWN)
def test_a_flight_rests_flies_and_rests_again(name: str) -> None:
    flight = flown(name)
    t, armed = flight.truth.t, dict((value, at) for at, value in flight.onboard.armed)
    before = t < armed[True]
    assert armed[True] >= 10.0
    assert np.abs(flight.truth.w[before]).max() < np.radians(0.2)
    assert np.abs(flight.truth.a[before]).max() < 0.1
    assert -flight.truth.p[:, 2].min() > 2.5
    assert flight.onboard.armed[-1][1] is False
    end = t > t[-1] - 5.0
    assert np.abs(flight.truth.v[end]).max() < 0.01


@pytest.mark.slow
def test_each_scenario_shows_what_its_title_promises() -> None:
    assert np.ptp(tilt_deg(flown("hover"))) < 5
    assert tilt_deg(flown("aggressive")).max() > 35
    assert np.hypot(*flown("waypoints").truth.p[:, :2].max(axis=0)) > 40
    heading = np.unwrap(rotation.to_euler(flown("yaw").truth.q)[:, 2])
    assert np.degrees(np.abs(np.diff(heading)).sum()) > 900
    assert np.degrees(np.ptp(heading)) > 358
    crash = flown("crash")
    assert [what for _, what in crash.events if "impact" in what]
    assert crash.imus[0].clipped.sum() > 10
    assert tilt_deg(crash).max() > 150
    lost = flown("gnss-loss").gnss[0]
    assert set(lost.fix[(lost.t_sample > 50) & (lost.t_sample < 80)]) == {0}
    assert set(lost.fix[(lost.t_sample < 50) | (lost.t_sample > 80)]) == {3}
    shaken, calm = (flown(n).imus[0] for n in ("vibration", "waypoints"))
    spread = [np.std(i.acc[(i.t > 30) & (i.t < 60), 0]) for i in (shaken, calm)]
    assert spread[0] > 3 * spread[1]
    iron = flown("mag-anomaly")
    norm = np.linalg.norm(iron.mags[0].field, axis=1)
    assert np.ptp(norm) > 8e-6
    drifting = flown("drift").imus[0].gyro_bias
    assert np.degrees(np.abs(drifting[-1] - drifting[0])).max() > 0.1


@pytest.mark.slow
def test_static_and_prescribed_motion_hold_their_angles() -> None:
    still = fly(load("static").changed(seconds=20.0), 3).truth
    assert np.degrees(rotation.to_euler(still.q[[0, -1]])) == pytest.approx(np.array([[2, 1, 0]] * 2), abs=1e-9)
    turned = np.degrees(rotation.to_euler(flown("rotation").truth.q))
    assert turned.max(axis=0) == pytest.approx([45, 45, 75], abs=1e-6)
    assert turned.min(axis=0) == pytest.approx([-45, -45, -15], abs=1e-6)
    dropped = np.degrees(rotation.to_euler(flown("lift-drop").truth.q))[:, 0]
    t = flown("lift-drop").truth.t
    for begin, angle in ((21.0, 20), (35.3, 40), (49.6, 60)):
        assert np.interp(begin, t, dropped) == pytest.approx(angle, abs=1e-6)
        assert np.interp(begin + 0.3, t, dropped) == pytest.approx(0, abs=1e-6)
