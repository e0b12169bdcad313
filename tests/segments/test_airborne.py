"""Heights over the ground, of an altitude that is given."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import attlog
import attlog.segments.build
from attlog import formats
from attlog.core import rotation
from attlog.core.spans import Span
from attlog.flight.model import Attitude, FlightLog, Gnss, Stream, TimeLine
from attlog.segments import airborne, flight_signs, heights, model, rest
from attlog.segments.flight_signs import Grid
from tests.segments.flights import imu_log


def test_a_rangefinder_that_looks_aslant_tells_the_height_and_not_the_slant_range() -> None:
    """It stands 0.2 m up, then hangs at 3 m and rolls by 60 deg, so that the beam is twice as long."""
    t = np.arange(0.0, 20.0, 0.1)
    roll = np.where(t < 15.0, 0.0, np.radians(60.0))
    down = rotation.rotate_inverse(rotation.from_euler(roll, 0.0 * t, 0.0 * t), np.array([0.0, 0.0, 1.0]))
    height = np.where(t < 10.0, 0.2, 3.0)
    none, nothing, all_known = np.full(len(t), np.nan), np.zeros(len(t), bool), np.ones(len(t), bool)
    grid = Grid(t, all_known, np.zeros((len(t), 3)), none, none, none, nothing, none, down, False)
    beam = Stream(t, (height / np.cos(roll))[:, None], "m", "", "distance_sensor:0")
    log = SimpleNamespace(rangefinder=beam, baro=[], gnss=[], estimator=SimpleNamespace(height=None))
    (level,) = heights.height_levels(log, grid, t < 10.0)  # type: ignore[arg-type]
    assert level.sensor == "range"
    assert level.above[t > 16.0] == pytest.approx(2.8)
    assert level.above[t < 9.0] == pytest.approx(0.0)


def level(sensor: str, above: np.ndarray) -> heights.HeightLevel:
    return heights.HeightLevel(sensor, sensor, above)


def test_a_flight_is_as_high_as_a_rangefinder_that_saw_the_ground_nearly_all_the_time_tells() -> None:
    flying = np.arange(200) < 100
    ranged, pressed = np.full(200, 8.0), np.full(200, 9.5)
    ranged[150], pressed[150] = 50.0, 60.0  # after landing
    both = [level("range", ranged), level("barometer", pressed)]
    assert heights.highest_level(both, flying) == (both[0], 8.0)
    ranged[:4] = np.nan
    assert heights.highest_level(both, flying) == (both[0], 8.0)
    ranged[:6] = np.nan
    assert heights.highest_level(both, flying) == (both[1], 9.5)
    pressed[:100] = 0.2
    assert heights.highest_level(both, flying) == (both[0], 8.0)
    assert heights.highest_level([level("GNSS", np.full(200, np.nan))], flying) is None


def test_a_rangefinder_beyond_its_range_tells_no_height() -> None:
    """A sonar that reads 6 m all the time while the barometer climbs to 50."""
    flying = np.ones(200, bool)
    sonar, pressed = np.full(200, 6.0), np.linspace(0.0, 14.0, 200)
    both = [level("range", sonar), level("barometer", pressed)]
    assert heights.highest_level(both, flying) == (both[0], 6.0)
    both[1] = level("barometer", 3.5 * pressed)
    assert heights.highest_level(both, flying) == (both[1], pytest.approx(49.0))


def test_spikes_of_a_barometer_are_no_height_and_a_fast_climb_is_one() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    climb = np.clip(30.0 * (t - 20.0), 0.0, 300.0)
    spiky = climb.copy()
    spiky[450:453], spiky[454:457] = spiky[450:453] + 180.0, spiky[454:457] - 90.0
    found = heights.averaged_height(t, Stream(t, spiky[:, None], "m", "", "BARO"))
    assert np.abs(found - climb).max() < 15.0
    assert np.abs(found - climb)[440:470].max() < 1e-9
    assert np.nanmax(found) == pytest.approx(300.0)


# In the air or not, by physics: against the true height of simulated flights, and on logs whose flags lie.

HEIGHTS = (("vehicle_local_position_groundtruth", "timestamp", "z", -1.0), ("SIM2", "TimeUS", "PD", -1.0))
QUADS = [
    "px4_hover.ulg",
    "px4_steps.ulg",
    "px4_yaw.ulg",
    "px4_aggressive.ulg",
    "px4_static.ulg",
    "px4_magfault.ulg",
    "px4_gnssloss.ulg",
    "copter_hover_rest.bin",
    "copter_steps_stabilize.bin",
    "copter_yaw_turns.bin",
    "copter_aggressive.bin",
    "copter_static_hop.bin",
    "copter_vibration.bin",
    "copter_stock_logging.bin",
]
IN_WIND = ["px4_wind.ulg", "copter_wind_guided.bin"]
PLANES = ["px4_plane.ulg", "plane_fbwa_cruise.bin", "plane_dcm.bin"]


def found_in(log: FlightLog) -> airborne.InAir:
    """What the sensors of a log say of flight."""
    builder = sys.modules["attlog.segments.build"]
    clock = builder._clock(log)
    t0, t1 = float(clock.min()), float(clock.max())
    armed = rest.armed_spans(log, t0, t1)
    whole = builder._between_pauses(model.find_continuous(clock), t0, t1)
    signs = flight_signs.build_grid(log, t0, t1)
    assert signs is not None
    return airborne.find_flights(log, signs, armed.spans if armed.known else None, whole)


def true_flight(path: Path, log: FlightLog) -> Span:
    """From when to when the simulator's own height was above 5 cm."""
    messages = formats.open(path)
    name, stamp, column, sign = next(x for x in HEIGHTS if messages.instances(x[0]))
    table = messages[name, messages.instances(name)[0]]
    t = (table[stamp].astype(np.int64) - log.t0_us) * 1e-6
    height = sign * table.value(column)
    up = t[height - np.median(height[:5]) > 0.05]
    return float(up[0]), float(up[-1])


def sitl(corpus: Path, name: str) -> Path:
    """A simulated flight of the corpus."""
    return corpus / "sitl" / ("px4" if name.endswith(".ulg") else "ardupilot") / name


@pytest.mark.parametrize(
    ("name", "late_s"), [(n, 1.0) for n in QUADS] + [(n, 1.5) for n in IN_WIND] + [(n, 0.5) for n in PLANES]
)
def test_lift_off_and_landing_lie_where_the_simulator_left_and_met_the_ground(corpus, name, late_s):
    """True heights come 1 to 4 times a second."""
    path = sitl(corpus, name)
    log = attlog.read(path)
    flown = found_in(log).spans
    a, b = true_flight(path, log)
    assert len(flown) == 1
    assert flown[0][0] == pytest.approx(a, abs=late_s)
    assert flown[0][1] == pytest.approx(b, abs=1.5)


@pytest.mark.parametrize(
    "name",
    [
        "copter_never_lifted.BIN",
        "copter_4.6_standing_accused.BIN",
        "copter_flip_at_takeoff.bin",
        "copter_3.2.1_bench.log",
        "px4_1.6.5_hand_rotation.ulg",
        "copter_4.7dev_33.bin",
        "copter_4.8dev_barodrift.BIN",
    ],
)
def test_vehicles_that_never_left_the_ground_have_no_flight(corpus, name):
    """Throttle up, motors at full throttle on a bench, rolled about by hand, flipped over at take-off."""
    assert found_in(attlog.read(corpus / "logs" / "cases" / name)).spans == []


@pytest.mark.parametrize(
    ("name", "flights", "within_s"),
    [
        ("px4_1.14_clipping_crash.ulg", [(33.0, 46.1)], 1.5),
        ("px4_1.14_clipping_field.ulg", [(12.0, 39.0)], 2.0),
        ("px4_1.14_hard_landing.ulg", [(4.0, 75.0)], 1.0),
        ("plane_px4_1.13_crash.ulg", [(6.0, 29.1)], 1.0),
        ("copter_heading_28deg_off.BIN", [(11.0, 103.0)], 1.0),
        ("copter_falsely_accused.bin", [(3.0, 180.0), (221.0, 335.0)], 1.0),
        ("copter_two_compasses.bin", [(4.0, 237.0)], 1.0),
        ("copter_4.2_radio_4hz.tlog", [(42.0, 309.5)], 1.0),
    ],
)
def test_real_flights_that_were_read_by_hand(corpus, name, flights, within_s):
    found = found_in(attlog.read(corpus / "logs" / "cases" / name)).spans
    assert len(found) == len(flights)
    for (a, b), (begin, end) in zip(found, flights, strict=True):
        assert (a, b) == (pytest.approx(begin, abs=within_s), pytest.approx(end, abs=within_s))


def carried(slope: float, throttle: float = 0.5, z: float = -9.81) -> FlightLog:
    """40 s in which a quadrotor sways by 5 deg; ``slope`` of its sideways force on gravity's: 1 on the ground."""
    t = np.arange(0.0, 40.0, 0.01)
    roll, pitch = 0.09 * np.sin(2 * np.pi * 0.4 * t), 0.09 * np.sin(2 * np.pi * 0.31 * t)
    q = rotation.from_euler(roll, pitch, np.zeros_like(t))
    gravity = rotation.rotate_inverse(q, np.array([0.0, 0.0, -9.81]))
    acc = np.column_stack([slope * gravity[:, 0], slope * gravity[:, 1], z + 0.8 * np.sin(2 * np.pi * 0.5 * t)])
    gyro = np.column_stack([np.gradient(roll, t), np.gradient(pitch, t), np.zeros_like(t)])
    return imu_log(
        t,
        gyro,
        acc,
        attitudes={"ATT": Attitude(t[::5], q[::5], "ATT")},
        onboard="ATT",
        armed=TimeLine(np.array([0.0, 5.0, 35.0]), [False, True, False], "ARM"),
        throttle=Stream(t, np.where((t > 5) & (t < 35), throttle, 0.0)[:, None], "1", "", "CTUN.ThO"),
    )


def test_sideways_force_that_feels_no_tilt_is_flight_while_driven():
    (flight,) = found_in(carried(0.05)).spans
    assert flight == (pytest.approx(5.0, abs=2.5), pytest.approx(35.0, abs=2.5))


def climbing(height_m: float) -> FlightLog:
    """A flight without a stand whose motors stop from 18 to 23 s; the barometer moves by ``height_m`` meanwhile."""
    log = carried(0.05)
    log.state.armed = None
    t = np.arange(0.0, 40.0, 0.1)
    pause = (t > 18.0) & (t < 23.0)
    log.power.throttle = Stream(t, np.where(pause, 0.0, 0.5)[:, None], "1", "", "CTUN.ThO")
    height = 30.0 + height_m * np.clip((t - 18.0) / 5.0, 0.0, 1.0)
    log.baro = [Stream(t, height[:, None], "m", "", "BARO")]
    return log


@pytest.mark.parametrize(("height_m", "flights"), [(25.0, 1), (-12.0, 1), (3.0, 2), (0.0, 2)])
def test_what_falls_or_climbs_with_stopped_motors_is_still_in_the_air(height_m, flights):
    assert len(found_in(climbing(height_m)).spans) == flights


@pytest.mark.parametrize("slope", [0.9, 1.0, 1.2])
def test_sideways_force_that_follows_the_tilt_is_the_ground_or_a_hand(slope):
    assert found_in(carried(slope)).spans == []


def test_what_is_not_driven_does_not_fly_whatever_it_feels():
    assert found_in(carried(0.05, throttle=0.01)).spans == []


def test_a_multirotor_on_its_back_is_not_carried_by_its_rotors():
    assert found_in(carried(0.05, z=9.81)).spans == []


def test_a_log_cut_out_of_a_flight_is_all_flight():
    log = carried(0.05)
    log.state.armed = None
    log.power.throttle = Stream(np.arange(0.0, 40.0, 0.1), np.full((400, 1), 0.4), "1", "", "CTUN.ThO")
    (flight,) = found_in(log).spans
    assert flight == (pytest.approx(0.0, abs=0.2), pytest.approx(40.0, abs=0.2))


def leaning(height_m: float) -> FlightLog:
    """Motors at half throttle, 26 deg of lean by gravity for 6 s; the onboard attitude shows none of it and drifts."""
    t = np.arange(0.0, 30.0, 0.02)
    up = (t > 12.0) & (t < 18.0)
    lean = np.radians(26.0) * up
    acc = 9.81 * np.column_stack([0.0 * t, np.sin(lean), -np.cos(lean)])
    acc += np.random.default_rng(4).normal(size=acc.shape) * np.where((t > 10.0) & (t < 20.0), 0.6, 0.02)[:, None]
    gyro = np.radians(np.random.default_rng(5).normal(size=acc.shape) * 15.0)
    q = rotation.from_euler(np.radians(-8.0 * np.clip(t - 12.0, 0.0, 6.0)), 0.0 * t, 0.0 * t)
    log = imu_log(t, gyro, acc, attitudes={"ATT": Attitude(t[::5], q[::5], "ATT")}, onboard="ATT")
    log.state.armed = TimeLine(np.array([0.0, 8.0, 22.0]), [False, True, False], "EV")
    log.power.throttle = Stream(t[::5], np.where((t > 10.0) & (t < 20.0), 0.5, 0.0)[::5, None], "1", "", "CTUN")
    log.baro = [Stream(t[::5], np.where(up, height_m, 0.0)[::5, None], "m", "", "BARO")]
    return log


def test_what_leans_in_a_hand_at_the_height_of_its_stand_does_not_fly():
    assert found_in(leaning(0.1)).spans == []
    assert found_in(leaning(3.0)).spans != []


@pytest.mark.parametrize(("armed", "flies"), [(True, True), (False, False), (None, False)])
def test_a_plane_on_a_car_does_not_fly(armed, flies):
    """After a motor test, at 15 m/s over a hill: armed it glides; disarmed, or never driven there, it rides."""
    log = over_a_hill()
    log.state.armed = None if armed is None else TimeLine(np.array([0.0]), [armed], "ARM")
    assert bool(found_in(log).spans) is flies


def test_a_glide_does_not_end_where_it_is_disarmed_in_the_air():
    log = over_a_hill()
    ends = []
    for armed in ([True, True], [True, False]):
        log.state.armed = TimeLine(np.array([0.0, 20.0]), armed, "ARM")
        ends.append(found_in(log).spans[-1][1])
    assert ends[1] == pytest.approx(ends[0], abs=0.2)
    assert ends[1] > 30.0


def over_a_hill():
    log = carried(0.05, throttle=0.0)
    t = np.arange(0.0, 40.0, 0.1)
    log.vehicle = "fixed wing"
    log.baro = [Stream(t, 6.0 * np.clip(np.sin((t - 8.0) / 12.0), 0.0, 1.0)[:, None], "m", "", "BARO")]
    moving = np.column_stack([np.where(t > 5.0, 15.0, 0.0), 0.0 * t, 0.0 * t])
    none = np.full(len(t), np.nan)
    log.gnss = [Gnss(0, t, "GPS", none, none, none, moving, none, none, none, np.full(len(t), 3))]
    log.power.throttle = Stream(t, np.where(t < 1.0, 0.4, 0.0)[:, None], "1", "", "CTUN.ThO")
    return log


def test_movement_without_an_attitude_or_a_height_proves_no_flight():
    """Nothing tells then whether the ground or the air carries it: a log cut at its third second."""
    log = carried(0.05)
    log.attitudes, log.onboard = {}, None
    assert found_in(log).spans == []


def test_motors_that_spin_up_have_not_lifted_off_where_no_height_tells():
    """From 5 s on at half of what it flies with, from 9 s on with all of it: copter 3.4 on an Erle-Brain."""
    log = carried(0.05)
    t = log.power.throttle.t
    log.power.throttle.x[(t > 5.0) & (t < 9.0)] = 0.27
    ((begin, _),) = found_in(log).spans
    assert begin == pytest.approx(9.0, abs=0.6)


def test_nothing_is_known_of_flight_where_neither_power_nor_arming_is_told():
    """A bag of a companion computer's sensors: heights alone do not tell a flight from stairs."""
    t = np.arange(0.0, 40.0, 0.01)
    force = np.tile([0.0, 0.0, -9.8], (len(t), 1))
    log = imu_log(t, np.zeros((len(t), 3)), force)
    log.attitudes = {"ATT": Attitude(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), "ATT")}
    log.onboard, log.state.armed, log.power.throttle = "ATT", None, None
    log.baro = [Stream(t, np.clip(t - 10.0, 0.0, 5.0)[:, None], "m", "NED", "BARO")]
    assert not found_in(log).known
    log.power.throttle = Stream(t, np.full((len(t), 1), 0.5), "", "", "RCOU")
    assert found_in(log).known
