"""Magnetometer, GNSS, barometer, battery, rotor speeds: each against what its own physics says."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import allantools
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import earth
from attlog.simulate.flight import Flight, Truth
from attlog.simulate.fly import fly
from attlog.simulate.scenario import PlantedFault
from attlog.simulate.sensors import (
    BaroSensor,
    GnssSensor,
    MagSensor,
    battery_current,
    damage,
    kept_samples,
    sampling_instants,
)
from tests.conftest import few
from tests.simulate.still import Idle, flown, scenario

QUIET_MAG: dict[str, Any] = {"noise_ut_rthz": 0, "hard_iron_spread_ut": 0, "step_ut": 0}
SLOW_LOOP: dict[str, Any] = {"rate_hz": 50, "substeps": 10}
QUIET_GNSS: dict[str, Any] = {"noise_h_m": 0, "noise_v_m": 0, "noise_speed_m_s": 0, "wander_m": 0, "jitter_s": 0}
LIFT = {"move": [{"seconds": 2.0}, {"seconds": 5.0, "up_m": 40.0, "heading_deg": 50.0}]}


def alone(sensor: Any) -> Any:
    """What one sensor tells of a rest that lasts as long as its scenario."""
    one = sensor.scenario
    n = round(one.seconds * one.loop.rate_hz) + 1
    still = {f.name: np.zeros((n, 3)) for f in dataclasses.fields(Truth)}
    still |= {"t": np.arange(n) / one.loop.rate_hz, "q": np.tile([1.0, 0, 0, 0], (n, 1)), "rotor": np.zeros((n, 4))}
    sensor.advance(Truth(**still), one.seconds)
    return sensor.stream()


def with_mag(mag: dict[str, Any], seconds: float = 4.0, seed: int = 0, **values: Any) -> Flight:
    return flown(scenario(seconds, sensors={"mag": [mag]}, **values), seed)


def test_the_field_at_rest_is_the_world_magnetic_model_at_place_and_date() -> None:
    place = {"lat_deg": -37.81, "lon_deg": 144.96, "alt_m": 30.0, "heading_deg": 70.0, "date": "2023-03-01T00:00:00Z"}
    flight = with_mag(QUIET_MAG, motion={"roll_deg": 10, "pitch_deg": -20}, place=place)
    model = earth.field(-37.81, 144.96, 30.0, flight.scenario.place.unix_time)
    assert model is not None
    want = Rotation.from_euler("ZYX", [70, -20, 10], degrees=True).inv().apply(model.ned_t)
    assert np.abs(flight.mags[0].field - want).max() < 1e-12
    assert flight.declination_deg == pytest.approx(11.8, abs=0.3)  # Melbourne, as maps print it
    assert flight.gravity == pytest.approx(9.7998, abs=2e-4)  # Melbourne, measured absolute value 9.79965


def test_iron_on_board_current_and_mounting_act_in_this_order() -> None:
    soft = [[1.1, 0.02, 0], [0.01, 0.95, 0], [0, 0, 1.03]]
    mag = QUIET_MAG | {
        "hard_iron_ut": [3, -2, 1],
        "soft_iron": soft,
        "rotation_deg": [0, 0, 90],
        "current_ut_a": [1, 0, 2],
    }
    flight = with_mag(mag)
    ampere = flight.scenario.sensors.battery.idle_a
    body = np.array(flight.truth.field[0]) * 1e6 + [3, -2, 1] + ampere * np.array([1.0, 0, 2.0])
    turned = Rotation.from_euler("Z", 90, degrees=True).inv().apply(body)
    assert flight.mags[0].field[-1] * 1e6 == pytest.approx(np.array(soft) @ turned, abs=1e-9)


def test_magnetometer_noise_has_its_density_and_counts_their_step() -> None:
    noisy = QUIET_MAG | {"noise_ut_rthz": 0.05, "rate_hz": 100}
    one = scenario(600.0, sensors={"mag": [noisy]}, loop={"rate_hz": 100, "substeps": 5})
    x = alone(MagSensor(one, 0, 1)).field * 1e6
    for axis in range(3):
        found = allantools.oadev(x[:, axis], rate=100.0, data_type="freq", taus=[1.0])[1][0]
        assert found == pytest.approx(0.05, rel=0.12)
    counted = with_mag(QUIET_MAG | {"noise_ut_rthz": 0.05, "step_ut": 0.15, "range_ut": 30}).mags[0].field * 1e6
    assert np.abs(counted / 0.15 - np.round(counted / 0.15)).max() < 1e-6
    assert np.abs(counted).max() == pytest.approx(30.0)


def test_a_magnetometer_measures_the_place_where_it_is() -> None:
    iron = [{"ned_m": [0, 0, -20], "field_ned_ut": [10, -5, 3], "radius_m": 6}]
    flight = with_mag(QUIET_MAG | {"hidden_delay_s": 0.03}, 9.0, motion=LIFT, anomaly=iron)
    mag, truth = flight.mags[0], flight.truth
    true_t = mag.t_sample - 0.03
    height = np.interp(true_t, truth.t, truth.p[:, 2])
    heading = np.interp(true_t, truth.t, np.unwrap(np.radians(50) * smooth((truth.t - 2) / 5)))
    extra = np.exp(-0.5 * (height + 20) ** 2 / 36)[:, None] * [10, -5, 3]
    field = truth.field[0] * 1e6 - np.exp(-0.5 * (truth.p[0, 2] + 20) ** 2 / 36) * np.array([10, -5, 3]) + extra
    want = Rotation.from_rotvec(np.outer(heading, [0, 0, 1])).inv().apply(field)
    assert np.abs(mag.field * 1e6 - want).max() < 0.002
    assert np.abs(mag.t - mag.t_sample - 0.001).max() < 1e-12


def smooth(u: Any) -> Any:
    u = np.clip(u, 0, 1)
    return u**3 * (10 - 15 * u + 6 * u**2)


def test_gnss_is_late_by_its_delay_and_right_at_its_epoch() -> None:
    one = scenario(9.0, motion=LIFT, sensors={"gnss": [QUIET_GNSS | {"rate_hz": 10, "delay_s": 0.2}]})
    flight = flown(one)
    gnss, truth = flight.gnss[0], flight.truth
    assert np.abs(gnss.t - gnss.t_sample - 0.2).max() < 1e-12
    up = np.interp(gnss.t_sample, truth.t, -truth.p[:, 2])
    assert np.abs(gnss.alt - one.place.alt_m - up).max() < 1e-3
    assert np.abs(gnss.vel[:, 2] - np.interp(gnss.t_sample, truth.t, truth.v[:, 2])).max() < 1e-3
    assert np.abs(gnss.utc - one.place.unix_time - gnss.t_sample).max() < 1e-6


def test_the_autopilot_gets_a_fix_only_when_it_has_arrived() -> None:
    got: list[Idle] = []

    def make(*_: object) -> Idle:
        got.append(Idle())
        return got[0]

    fly(scenario(4.0, sensors={"gnss": [QUIET_GNSS | {"delay_s": 0.2}]}), 0, make)
    fixes = [(t, m.fix.t_sample) for t, m in got[0].got if m.fix is not None]
    assert len(fixes) >= 18
    for t, epoch in fixes:
        assert 0.2 - 1e-9 <= t - epoch <= 0.2 + 1 / 400 + 1e-9
    assert all(m.imu.shape == (1, 8) for _, m in got[0].got)
    assert sum(m.mag is not None for _, m in got[0].got) == pytest.approx(200, abs=2)


def test_no_fix_during_an_outage_and_before_the_first_one() -> None:
    gnss = QUIET_GNSS | {"outages": [[4.0, 6.0]], "first_fix_s": 2.0, "rate_hz": 10}
    stream = flown(scenario(9.0, sensors={"gnss": [gnss]})).gnss[0]
    lost = (stream.t_sample < 2.0) | ((stream.t_sample >= 4.0) & (stream.t_sample < 6.0))
    assert np.array_equal(stream.fix == 0, lost)
    assert np.array_equal(np.isnan(stream.lat), lost)
    assert np.array_equal(np.isnan(stream.vel).all(axis=1), lost)
    assert np.isfinite(stream.h_acc).all()


def test_positions_lie_on_the_ellipsoid() -> None:
    """One degree of latitude and of longitude at 47.397 deg by the radii of curvature (WGS 84)."""
    from attlog.simulate.environment import geodetic

    one = scenario()
    a, e2, phi = 6378137.0, 0.00669437999014, math.radians(47.397)
    n = a / math.sqrt(1 - e2 * math.sin(phi) ** 2)
    m = n * (1 - e2) / (1 - e2 * math.sin(phi) ** 2)
    ned = np.array([[100.0, 0, 0], [0, 100.0, 0], [0, 0, -100.0], [0, 0, 0]])
    lat, lon, alt = geodetic(one, ned)
    assert lat[0] - 47.397 == pytest.approx(math.degrees(100.0 / (m + 488)), rel=2e-5)
    assert lon[1] - 8.545 == pytest.approx(math.degrees(100.0 / ((n + 488) * math.cos(phi))), rel=2e-5)
    assert alt[2] == pytest.approx(588.0, abs=1e-6)
    assert [lat[3], lon[3], alt[3]] == pytest.approx([47.397, 8.545, 488.0], abs=1e-9)


def test_gnss_wanders_slowly_with_its_declared_size() -> None:
    gnss = QUIET_GNSS | {"wander_m": 1.5, "wander_s": 20, "noise_speed_m_s": 0.1}
    one = scenario(400.0, sensors={"gnss": [gnss]}, loop={"rate_hz": 50, "substeps": 10})
    ends = [alone(GnssSensor(one, 0, seed)) for seed in range(12)]
    ned = np.concatenate([g.ned[:, :2] for g in ends])
    assert ned.std() == pytest.approx(1.5, rel=0.15)
    lagged = np.mean([np.corrcoef(g.ned[:-50, k], g.ned[50:, k])[0, 1] for g in ends for k in range(2)])
    assert lagged == pytest.approx(math.exp(-10 / 20), abs=0.12)
    assert np.concatenate([g.vel for g in ends]).std() == pytest.approx(0.1, rel=0.03)


def test_gnss_noise_has_its_declared_size_over_ground_and_in_height() -> None:
    one = scenario(400.0, sensors={"gnss": [QUIET_GNSS | {"noise_h_m": 0.5, "noise_v_m": 2.0}]}, loop=SLOW_LOOP)
    ned = np.concatenate([alone(GnssSensor(one, 0, seed)).ned for seed in range(2)])
    assert ned.std(axis=0) == pytest.approx([0.5, 0.5, 2.0], rel=0.06)


def test_the_antenna_swings_with_the_vehicle() -> None:
    motion = {"move": [{"seconds": 2.0, "roll_deg": 40.0}]}
    gnss = QUIET_GNSS | {"antenna_m": [0, 0, -0.5], "rate_hz": 20}
    flight = flown(scenario(3.0, motion=motion, sensors={"gnss": [gnss]}))
    assert flight.gnss[0].ned[-1, 1] == pytest.approx(0.5 * math.sin(math.radians(40)), abs=1e-4)
    assert flight.gnss[0].vel[:, 1].max() == pytest.approx(0.5 * math.radians(40) / 2 * 1.875, rel=0.15)


@pytest.mark.parametrize(("alt", "pascal"), [(0.0, 101325.0), (500.0, 95460.8), (1000.0, 89874.6), (3000.0, 70108.5)])
def test_pressure_is_that_of_the_standard_atmosphere(alt: float, pascal: float) -> None:
    """ISO 2533, geopotential heights; the barometer is 0.12 m above the ground."""
    one = scenario(2.0, place={"alt_m": alt}, sensors={"baro": [{"noise_m_rthz": 0, "walk_m_rts": 0, "step_pa": 0}]})
    baro = flown(one).baro[0]
    assert baro.pressure[0] == pytest.approx(
        pascal * (1 - 0.12 * 9.80665 / (287.05287 * (288.15 - 0.0065 * alt))), abs=0.1
    )
    assert baro.height[0] == pytest.approx(alt + 0.12, abs=1e-6)


def test_barometer_noise_has_its_density_and_its_walk_its_slope() -> None:
    """White noise N / sqrt(tau) at short times, random walk K sqrt(tau / 3) at long ones."""
    white, walking = {"noise_m_rthz": 0.05, "walk_m_rts": 0}, {"noise_m_rthz": 0, "walk_m_rts": 0.05}
    for baro, tau, want in ((white, 1.0, 0.05), (walking, 3.0, 0.05)):
        one = scenario(2000.0, sensors={"baro": [baro | {"step_pa": 0}]}, loop={"rate_hz": 50, "substeps": 10})
        x = alone(BaroSensor(one, 0, 3)).height
        found = allantools.oadev(x, rate=25.0, data_type="freq", taus=[tau])[1][0]
        assert found == pytest.approx(want, rel=0.12)


def test_current_is_shaft_power_over_efficiency_and_voltage() -> None:
    one = scenario()
    v, b = one.vehicle, one.sensors.battery
    speed = 0.8 * v.speed_max_rad_s
    watt = 4 * v.torque_m * 0.64 * v.thrust_max_n * speed
    want = b.idle_a + watt / b.efficiency / (0.5 * (b.full_v + b.empty_v))
    assert battery_current(one, np.full((1, 4), speed), np.zeros(1))[0] == pytest.approx(want, rel=1e-9)


def test_a_standing_vehicle_draws_its_idle_current_and_empties_the_battery_so() -> None:
    flight = flown(scenario(8.0, sensors={"battery": {"noise_a": 0, "noise_v": 0, "idle_a": 2.0}}))
    assert flight.battery is not None
    assert flight.rpm is not None
    assert flight.battery.current == pytest.approx(2.0)
    assert flight.battery.used[-1] == pytest.approx(2.0 * 8 / 3600, rel=0.02)
    assert flight.battery.voltage[0] == pytest.approx(16.8 - 2.0 * 0.03, abs=0.01)
    assert not flight.rpm.rpm.any()


@pytest.mark.parametrize("part", few(["mag", "gnss", "baro"], 1))
def test_a_silent_sensor_sends_nothing_and_a_stuck_one_the_same(part: str) -> None:
    def stream(kind: str) -> Any:
        flight = flown(scenario(8.0, motion=LIFT, fault=[{"t": 3.0, "part": part, "kind": kind, "seconds": 3.0}]))
        streams: dict[str, Any] = {"mag": flight.mags, "gnss": flight.gnss, "baro": flight.baro}
        return streams[part][0]

    quiet = stream("silent")
    assert not ((quiet.t_sample >= 3.0) & (quiet.t_sample < 6.0)).any()
    assert (quiet.t_sample > 6.0).any()
    stuck = stream("stuck")
    now = (stuck.t_sample >= 3.0) & (stuck.t_sample < 6.0)
    value = {"mag": "field", "gnss": "alt", "baro": "pressure"}[part]
    assert np.ptp(getattr(stuck, value)[now], axis=0).max() < 1e-9
    assert np.ptp(getattr(stuck, value)[~now], axis=0).max() > 0


# When a sensor measures: rasters, phases, jitter and gaps.


def test_a_raster_begins_its_phase_after_zero_and_ends_with_the_flight() -> None:
    random = np.random.default_rng(0)
    assert sampling_instants(4.0, 1.0, 0.0, random) == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert sampling_instants(4.0, 1.0, 0.0, random, phase=0.5) == pytest.approx([0.125, 0.375, 0.625, 0.875])
    assert sampling_instants(4.0, 1.1, 0.0, random, phase=0.0) == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_jitter_stays_within_0_45_of_a_period_to_both_sides() -> None:
    """At 4 Hz with a jitter of a second nearly all are at the limits."""
    t = sampling_instants(4.0, 400.0, 1.0, np.random.default_rng(1))
    off = np.concatenate([t - 0.25 * np.rint(t / 0.25)])
    assert np.abs(off).max() == pytest.approx(0.45 * 0.25)
    assert (off.min(), off.max()) == pytest.approx((-0.1125, 0.1125))
    assert (np.diff(t) > 0.0).all()
    assert 0.0 < t[0]
    assert t[-1] <= 400.0


def test_a_gap_takes_its_beginning_and_leaves_its_end() -> None:
    t = np.arange(10.0)
    random = np.random.default_rng(2)
    assert t[kept_samples(t, 0.0, ((2.0, 5.0), (8.0, 8.5)), random)].tolist() == [0.0, 1.0, 5.0, 6.0, 7.0, 9.0]
    assert kept_samples(np.zeros(20_000), 30.0, (), random).mean() == pytest.approx(0.7, abs=0.02)
    assert not kept_samples(t, 100.0, (), random).any()


# Planted faults on samples of which each is another.

T = np.arange(5.0)
X = np.arange(10.0, 15.0)[:, None] * [1.0, 2.0, 3.0]


@pytest.mark.parametrize(("since", "at"), [(2.0, [11.0, 22.0, 33.0]), (0.0, [7.0, 8.0, 9.0])])
def test_a_sensor_is_stuck_at_what_it_told_last(since: float, at: list[float]) -> None:
    """Within the block of samples, or before it."""
    fault = PlantedFault(since, "mag", "stuck", seconds=2.0)
    stuck = damage([fault], T, X, np.array([7.0, 8.0, 9.0]))
    now = (since <= T) & (since + 2.0 > T)
    assert stuck[now].tolist() == [at, at]
    assert np.array_equal(stuck[~now], X[~now])


def test_an_offset_a_scale_and_exchanged_signs_act_while_they_last() -> None:
    faults = [
        PlantedFault(1.0, "mag", "offset", seconds=1.0, value=(1.0, -2.0, 0.5)),
        PlantedFault(2.0, "mag", "scale", seconds=1.0, factor=0.5),
        PlantedFault(3.0, "mag", "flipped", seconds=1.0),
    ]
    found = damage(faults, T, X, X[0])
    assert found.tolist() == [[10, 20, 30], [12, 20, 33.5], [6, 12, 18], [-13, -26, 39], [14, 28, 42]]


def test_a_ramp_grows_within_its_time_and_stays() -> None:
    fault = PlantedFault(1.0, "acc", "ramp", seconds=2.0, value=(4.0, 0.0, -2.0))
    grown = damage([fault], T, X, X[0]) - X
    assert grown.tolist() == [[0, 0, 0], [0, 0, 0], [2, 0, -1], [4, 0, -2], [4, 0, -2]]
