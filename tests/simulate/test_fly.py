"""Flights as a whole: same seed same bytes, noise of their own for all sensors, sensors that agree with the truth."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.simulate.environment import environment, generator, share_at, wind_at
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.scenario import Gust, Scenario, Wind, build_scenario, load_scenario
from tests.conftest import few
from tests.simulate.still import PERFECT, flown, scenario


def hop(**values: Any) -> Scenario:
    """A short flight: rest, up to 3 m, a lean, down."""
    commands = [
        {"t": 3, "do": "arm"},
        {"t": 4, "do": "takeoff", "up_m": 3},
        {"t": 9, "do": "attitude", "roll_deg": 15},
        {"t": 10, "do": "attitude", "pitch_deg": -10},
        {"t": 11, "do": "hold", "heading_deg": 60},
    ]
    return build_scenario({"seconds": 14.0, "command": commands, "estimator": {"name": "truth"}} | values)


def everything(flight: Flight) -> dict[str, bytes]:
    """All numbers of a flight by name."""
    found: dict[str, bytes] = {}

    def walk(name: str, thing: Any) -> None:
        if isinstance(thing, np.ndarray):
            found[name] = thing.tobytes()
        elif isinstance(thing, list):
            for k, one in enumerate(thing):
                walk(f"{name}.{k}", one)
        elif dataclasses.is_dataclass(thing) and not isinstance(thing, Scenario):
            for field in dataclasses.fields(thing):
                walk(f"{name}.{field.name}", getattr(thing, field.name))

    walk("flight", flight)
    return found


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not() -> None:
    one, again, other = fly(hop(), 7), fly(hop(), 7), fly(hop(), 8)
    assert everything(one) == everything(again)
    assert len(everything(one)) > 40
    for name in ("flight.imus.0.gyro", "flight.mags.0.field", "flight.gnss.0.lat", "flight.baro.0.pressure"):
        assert everything(one)[name] != everything(other)[name]


def test_another_sensor_changes_nothing_in_the_noise_of_the_others() -> None:
    alone = everything(flown(scenario(3.0), 4))
    more = {"imu": [{}, {"rate_hz": 200, "sampling": "instant"}], "mag": [{}, {}], "gnss": [{}, {}], "baro": [{}, {}]}
    many = everything(flown(scenario(3.0, sensors=more), 4))
    assert {name: value for name, value in many.items() if name in alone} == alone
    assert many["flight.mags.1.field"] != many["flight.mags.0.field"]
    assert many["flight.gnss.1.lat"] != many["flight.gnss.0.lat"]


def test_streams_of_different_things_are_uncorrelated() -> None:
    keys = [
        ("imu", 0, "noise"),
        ("imu", 1, "noise"),
        ("imu", 0, "walk"),
        ("mag", 0, "noise"),
        ("wind", 0, "turbulence"),
    ]
    drawn = np.array([generator(3, *key).standard_normal(20_000) for key in keys])
    drawn = np.vstack([drawn, generator(4, *keys[0]).standard_normal(20_000)])
    off = np.corrcoef(drawn) - np.eye(len(drawn))
    assert np.abs(off).max() < 0.035


def test_in_a_flight_gyro_and_accelerometer_agree_with_the_truth() -> None:
    flight = fly(hop(sensors={"imu": [PERFECT | {"vibration": {"harmonics": [], "acc_m_s2": [], "gyro_dps": []}}]}), 2)
    imu, truth = flight.imus[0], flight.truth
    q = Rotation.from_quat(np.roll(truth.q, -1, axis=1))
    turned = Rotation.identity()
    for k in range(len(imu.t)):
        turned = turned * Rotation.from_rotvec(imu.gyro[k] * imu.dt[k])
    assert np.degrees((turned.inv() * q[0].inv() * q[-1]).magnitude()) < 1e-3
    felt = q.inv().apply(truth.a - [0, 0, flight.gravity])
    assert np.abs(imu.acc - 0.5 * (felt[1:] + felt[:-1])).max(axis=1)[truth.t[1:] < 4].max() < 3e-3
    # Velocity from the accelerometer, turned by the true attitude, is the true velocity.
    middle = q[:-1] * Rotation.from_rotvec(0.5 * imu.gyro * imu.dt[:, None])
    down = np.array([0, 0, flight.gravity])
    v = np.cumsum((middle.apply(imu.acc) + down) * imu.dt[:, None], axis=0)
    assert np.abs(v - (truth.v[1:] - truth.v[0])).max() < 2e-3
    p = truth.p[0] + np.cumsum(0.5 * (truth.v[1:] + truth.v[:-1]) / 400, axis=0)
    assert np.abs(p - truth.p[1:]).max() < 1e-3


def test_events_tell_lift_off_faults_overturn_and_impact() -> None:
    fault = [{"t": 8.0, "part": "rotor", "kind": "off", "instance": 2}]
    flight = fly(hop(fault=fault), 2)
    told = [what for _, what in flight.events]
    assert told[0] == "lift-off"
    assert told[1] == "fault: rotor 2 off"
    tilt = np.degrees(rotation.tilt_angle(flight.truth.q))
    assert flight.events[2] == (pytest.approx(flight.truth.t[np.argmax(tilt > 90.0)]), "overturn")
    assert told[3].startswith("impact at ")
    speed = float(told[3].split()[2])
    at = np.argmin(np.abs(flight.truth.t - flight.events[3][0]))
    assert np.linalg.norm(flight.truth.v[at - 1]) == pytest.approx(speed, abs=0.06)


def test_a_rotor_without_propeller_turns_on_and_one_whose_motor_stops_does_not() -> None:
    """Both are commanded to the ceiling while the opposite one is at its floor; only the speed tells them apart."""
    speed = {}
    for kind in ("off", "stopped"):
        flight = fly(hop(fault=[{"t": 8.0, "part": "rotor", "kind": kind, "instance": 1}]), 2)
        after = int(np.searchsorted(flight.truth.t, 8.25))
        command = flight.onboard.motors[np.searchsorted(flight.onboard.t, 8.25)]
        assert command[1] > 0.95
        assert command[0] < 0.05
        speed[kind] = flight.truth.rotor[after, 1] / flight.truth.rotor[: after - 200, 1].max()
    assert speed["stopped"] < 0.05
    assert speed["off"] > 0.9


def test_an_output_that_is_off_stops_its_motor_and_is_logged_so() -> None:
    flight = fly(hop(fault=[{"t": 8.0, "part": "output", "kind": "zero", "instance": 3}]), 2)
    board, after = flight.onboard, flight.onboard.t >= 8.0
    assert np.ptp(board.motors[after, 3]) == 0.0
    assert board.motors[after, 3][0] == 0.0
    assert flight.truth.rotor[flight.truth.t > 8.2, 3].max() < 5.0


def test_a_heading_fault_turns_estimate_and_set_point_and_nothing_that_moves() -> None:
    plain, turned = (
        fly(hop(fault=fault), 2)
        for fault in ([], [{"t": 8.0, "part": "heading", "kind": "offset", "value": [160.0, 0.0, 0.0]}])
    )
    assert np.array_equal(plain.truth.q, turned.truth.q)
    assert np.array_equal(plain.mags[0].field, turned.mags[0].field)
    off = rotation.multiply(turned.onboard.q, rotation.conjugate(plain.onboard.q))
    known = np.isfinite(off[:, 0])
    heading = np.degrees(rotation.to_euler(off[known])[:, 2])
    want = np.where(turned.onboard.t[known] >= 8.0, 160.0, 0.0)
    assert heading == pytest.approx(want, abs=1e-6)
    set_off = rotation.multiply(turned.onboard.q_setpoint, rotation.conjugate(plain.onboard.q_setpoint))
    assert np.degrees(rotation.to_euler(set_off[known])[:, 2]) == pytest.approx(want, abs=1e-6)


def test_a_ramp_of_the_receiver_moves_its_position_alone() -> None:
    ramp = {"t": 6.0, "part": "gnss", "kind": "ramp", "seconds": 2.0, "value": [0.0, 0.0, -20.0]}
    plain, moved = (fly(hop(fault=fault), 2).gnss[0] for fault in ([], [ramp]))
    assert np.array_equal(plain.vel, moved.vel)
    want = 20.0 * np.clip((moved.t_sample - 0.12 - 6.0) / 2.0, 0.0, 1.0)
    assert moved.alt - plain.alt == pytest.approx(want, abs=2.0)
    assert (moved.alt - plain.alt)[-1] == pytest.approx(20.0, abs=1e-6)


def test_wind_has_its_mean_its_turbulence_and_drydens_spectrum() -> None:
    t = np.arange(400_000) / 50.0
    wind = Wind(mean_ned_m_s=(3.0, 0.0, 0.0), turbulence_m_s=1.2, length_m=15.0)
    air = wind_at(wind, t, 1)
    assert air.mean(axis=0) == pytest.approx([3.0, 0.0, 0.0], abs=0.15)
    assert air.std(axis=0) == pytest.approx(1.2, rel=0.05)
    f, density = signal.welch(air - air.mean(axis=0), fs=50.0, nperseg=8192, axis=0)
    x = (2 * np.pi * f * 15.0 / 4.0) ** 2  # it passes at 4 m/s at least
    along = 1.2**2 * 2 * 15.0 / 4.0 * 2 / (1 + x)
    across = 1.2**2 * 15.0 / 4.0 * 2 * (1 + 3 * x) / (1 + x) ** 2
    band = (f > 0.02) & (f < 2.0)
    for column, want in ((0, along), (1, across), (2, across)):
        assert np.median(density[band, column] / want[band]) == pytest.approx(1.0, abs=0.07)
        assert np.polyfit(np.log(want[band]), np.log(density[band, column]), 1)[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("course_deg", [-160.0])
def test_turbulence_turns_with_the_wind(course_deg: float) -> None:
    """Along and across belong to the mean wind: the same noise in a wind of another course is turned as that is."""
    t, course = np.arange(2000) / 50.0, np.radians(course_deg)
    turn = np.array([[np.cos(course), -np.sin(course), 0.0], [np.sin(course), np.cos(course), 0.0], [0.0, 0.0, 1.0]])
    north, turned = (
        wind_at(Wind(mean_ned_m_s=(6.0 * c, 6.0 * s, 0.0), turbulence_m_s=1.2), t, 1)
        for c, s in ((1.0, 0.0), (np.cos(course), np.sin(course)))
    )
    np.testing.assert_allclose(turned, north @ turn.T, atol=1e-9)


def test_wind_falls_off_towards_the_ground() -> None:
    assert share_at(50.0) == share_at(6.0) == 1.0
    assert share_at(1.0) == pytest.approx(np.log(1 / 0.05) / np.log(6 / 0.05))
    assert share_at(0.0) == 0.0


@pytest.mark.parametrize(
    ("values", "told"),
    few(
        [
            ({"vehicle": {"inertia_kg_m2": [1e-9, 1e-9, 1e-9]}}, "motion cannot be computed from .* s on"),
            ({"vehicle": {"motor_lag_s": 1e-9}}, "motion cannot be computed from .* s on"),
            ({"motion": {"move": [{"seconds": 2, "up_m": 1e6}]}, "command": []}, "leaves 50 km"),
            (
                {"sensors": {"imu": [{"gyro": {"noise_dps_rthz": 1e30, "range_dps": 1e300}}]}},
                r"sensors.imu\[0\].gyro gives no finite numbers",
            ),
            (
                {"sensors": {"imu": [{}, {"acc": {"bias_m_s2": [1e200, 0, 0], "range_g": 1e300}}]}},
                r"sensors.imu\[1\].acc gives no finite numbers",
            ),
            ({"sensors": {"imu": [{}, {"loss_pct": 100}]}}, r"sensors.imu\[1\] gives no sample"),
        ],
        1,
    ),
)
def test_numbers_that_run_away_are_refused_and_not_written(values: dict[str, Any], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        fly(hop(**values))


def test_what_flew_is_carried_on_from_where_and_how_it_lies() -> None:
    """Place, attitude and force have no step where a hand takes it up, and the move ends where it says."""
    moves = [{"seconds": 2, "up_m": 1, "north_m": 2, "east_m": -1, "roll_deg": 30}]
    commands = [{"t": 1, "do": "arm"}, {"t": 1.2, "do": "disarm"}]
    values = {"seconds": 5.0, "command": commands, "place": {"heading_deg": 40}, "estimator": {"name": "truth"}}
    flight = fly(build_scenario(values | {"motion": {"after_s": 2.0, "move": moves}}))
    p, v = flight.truth.p, flight.truth.v
    k = int(np.searchsorted(flight.truth.t, 2.0))
    assert np.abs(np.diff(p, axis=0)).max() < 0.006
    assert p[-1] - p[k] == pytest.approx([2.0, -1.0, -1.0], abs=1e-9)
    roll, _, heading = np.degrees(rotation.to_euler(flight.truth.q[-1]))
    assert (roll, heading) == (pytest.approx(30.0, abs=0.1), pytest.approx(40.0, abs=0.1))
    assert np.gradient(p[k + 1 :, 0], flight.truth.t[k + 1 :]) == pytest.approx(v[k + 1 :, 0], abs=0.01)
    assert (2.0, "carried by hand") in flight.events


def test_a_rotor_out_of_balance_shakes_as_many_times_as_much_for_as_long_as_it_is() -> None:
    fault = {"t": 10.5, "seconds": 1.5, "part": "rotor", "kind": "unbalanced", "factor": 10.0, "instance": 2}
    calm, shaken = (fly(hop(fault=faults, seconds=13.0)).imus[0] for faults in ([], [fault]))
    t, more = calm.t_sample, np.abs(shaken.acc - calm.acc).max(axis=1)
    during = (t > 10.52) & (t < 11.98)
    assert more[t < 10.499].max() == 0.0
    assert np.quantile(more[during], 0.5) > 2.0
    assert more[t > 12.01].max() < 0.01


# The scenarios that come with attlog do what their titles say, and begin and end as real logs do.

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
    "compass-turned",
    "roll-in",
    "flip",
    "hard-landing",
    "no-liftoff",
    "clipping",
    "motor-stops",
    "half-thrust",
    "weak-motor",
    "output-off",
    "no-thrust-left",
    "gnss-height",
    "gnss-jumps",
    "accelerometer-step",
    "parameters-in-flight",
    "gyro-scale",
    "heading-step",
    "oscillation",
}
FLOWN = sorted(WANTED - {"static", "lift-drop", "rotation", "flip", "no-liftoff"})


@functools.lru_cache(maxsize=16)
def library_flight(name: str) -> Flight:
    return fly(load_scenario(name), seed=1)


def tilt_deg(flight: Flight) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.degrees(rotation.tilt_angle(flight.truth.q))


@pytest.mark.slow
@pytest.mark.parametrize("name", FLOWN)
def test_a_flight_rests_flies_and_rests_again(name: str) -> None:
    flight = library_flight(name)
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
    assert np.ptp(tilt_deg(library_flight("hover"))) < 5
    assert tilt_deg(library_flight("aggressive")).max() > 35
    assert np.hypot(*library_flight("waypoints").truth.p[:, :2].max(axis=0)) > 40
    heading = np.unwrap(rotation.to_euler(library_flight("yaw").truth.q)[:, 2])
    assert np.degrees(np.abs(np.diff(heading)).sum()) > 900
    assert np.degrees(np.ptp(heading)) > 358
    crash = library_flight("crash")
    assert [what for _, what in crash.events if "impact" in what]
    assert crash.imus[0].clipped.sum() > 10
    assert tilt_deg(crash).max() > 150
    lost = library_flight("gnss-loss").gnss[0]
    assert set(lost.fix[(lost.t_sample > 50) & (lost.t_sample < 80)]) == {0}
    assert set(lost.fix[(lost.t_sample < 50) | (lost.t_sample > 80)]) == {3}
    shaken, calm = (library_flight(n).imus[0] for n in ("vibration", "waypoints"))
    spread = [np.std(i.acc[(i.t > 30) & (i.t < 60), 0]) for i in (shaken, calm)]
    assert spread[0] > 3 * spread[1]
    iron = library_flight("mag-anomaly")
    norm = np.linalg.norm(iron.mags[0].field, axis=1)
    assert np.ptp(norm) > 8e-6
    drifting = library_flight("drift").imus[0].gyro_bias
    assert np.degrees(np.abs(drifting[-1] - drifting[0])).max() > 0.1


@pytest.mark.slow
def test_static_and_prescribed_motion_hold_their_angles() -> None:
    still = fly(load_scenario("static").changed(seconds=20.0), 3).truth
    assert np.degrees(rotation.to_euler(still.q[[0, -1]])) == pytest.approx(np.array([[2, 1, 0]] * 2), abs=1e-9)
    turned = np.degrees(rotation.to_euler(library_flight("rotation").truth.q))
    assert turned.max(axis=0) == pytest.approx([45, 45, 75], abs=1e-6)
    assert turned.min(axis=0) == pytest.approx([-45, -45, -15], abs=1e-6)
    dropped = np.degrees(rotation.to_euler(library_flight("lift-drop").truth.q))[:, 0]
    t = library_flight("lift-drop").truth.t
    for begin, angle in ((21.0, 20), (35.3, 40), (49.6, 60)):
        assert np.interp(begin, t, dropped) == pytest.approx(angle, abs=1e-6)
        assert np.interp(begin + 0.3, t, dropped) == pytest.approx(0, abs=1e-6)


# Gusts by their formula: each adds to the mean wind and to the others.


def test_gusts_that_overlap_add_up() -> None:
    t = np.arange(0.0, 10.0, 0.5)
    once = wind_at(Wind(turbulence_m_s=0.0, gust=(Gust(t=2.0, seconds=4.0, ned_m_s=(0.0, 6.0, -1.0)),)), t, 0)
    assert once[t == 4.0][0] == pytest.approx([0.0, 6.0, -1.0])
    assert once[t == 3.0][0] == pytest.approx([0.0, 3.0, -0.5])
    assert not once[t <= 2.0].any()
    assert np.abs(once[t >= 6.0]).max() < 1e-12
    gusts = (Gust(t=1.0, seconds=4.0, ned_m_s=(0.0, 6.0, 0.0)), Gust(t=3.0, seconds=4.0, ned_m_s=(2.0, 0.0, -1.0)))
    air = wind_at(Wind(mean_ned_m_s=(1.0, 0.0, 0.0), turbulence_m_s=0.0, gust=gusts), t, 0)
    assert air[t == 3.0][0] == pytest.approx([1.0, 6.0, 0.0])
    assert air[t == 4.0][0] == pytest.approx([2.0, 3.0, -0.5])
    assert air[t == 5.0][0] == pytest.approx([3.0, 0.0, -1.0])
    assert air[t >= 7.0] == pytest.approx(np.tile([1.0, 0.0, 0.0], (6, 1)))


# The air at a scenario's place, by the tables of the standard atmosphere (ISO 2533),
# whose heights are geopotential.


@pytest.mark.parametrize(("alt_m", "density"), [(0.0, 1.22500), (3000.0, 0.909122)])
def test_the_density_is_that_of_the_standard_atmosphere(alt_m: float, density: float) -> None:
    assert environment(build_scenario({"place": {"alt_m": alt_m}})).density == pytest.approx(density, rel=5e-5)
