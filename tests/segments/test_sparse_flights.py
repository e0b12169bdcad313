"""Flights of logs that lack the drive, the barometer or a fast IMU: against simulators and made motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import attlog
from attlog import segments
from attlog.core import rotation, spans
from attlog.flight.model import Attitude, Gnss, Stream, TimeLine
from attlog.segments import heights
from attlog.segments import sparse_flights as sparse
from attlog.segments.heights import HeightLevel
from tests.segments.flights import imu_log
from tests.segments.test_airborne import carried, found_in, sitl, true_flight
from tests.segments.test_flight_signs import made_grid

T = made_grid().t


def without_drive(log: attlog.FlightLog) -> attlog.FlightLog:
    """The log as if no throttle, motor output and rotor speed were in it."""
    log.power.throttle = log.power.motors = log.power.rpm = None
    return log


@pytest.mark.parametrize(
    "name",
    [
        "px4_steps.ulg",
        "px4_aggressive.ulg",
        "px4_magfault.ulg",
        "px4_plane.ulg",
        "copter_aggressive.bin",
        "copter_loop400.bin",
        "copter_steps_stabilize.bin",
        "plane_fbwa_cruise.bin",
    ],
)
def test_a_simulated_flight_is_found_without_its_drive(corpus, name):
    """A take-off without any tilt is seen up to 1.5 s late, a roll on wheels begins with the motion."""
    path = sitl(corpus, name)
    log = without_drive(attlog.read(path))
    (found,) = found_in(log).spans
    a, b = true_flight(path, log)
    assert found == (pytest.approx(a, abs=2.5), pytest.approx(b, abs=1.5))


@pytest.mark.parametrize(
    "name",
    [
        "copter_never_lifted.BIN",
        "copter_4.6_standing_accused.BIN",
        "copter_3.2.1_bench.log",
        "copter_flip_at_takeoff.bin",
        "px4_1.14_spoofing_text.ulg",
        "px4_1.6.5_hand_rotation.ulg",
        "copter_4.8dev_barodrift.BIN",
    ],
)
def test_arming_alone_makes_no_flight_of_a_stand(corpus, name):
    found = found_in(without_drive(attlog.read(corpus / "logs" / "cases" / name)))
    assert found.spans == []
    assert found.known


@pytest.mark.parametrize(
    ("name", "kind"), [("vtol_px4_1.12_crash_lost.ulg", "impact"), ("vtol_px4_1.12_no_throttle_topic.ulg", "impact")]
)
def test_crash_rules_apply_where_no_throttle_is_logged(corpus, name, kind):
    found = segments.build(attlog.read(corpus / "logs" / "cases" / name))
    assert kind in [e.kind for e in found.crash_events]
    assert spans.seconds(found.spans("airborne")) > 10.0


def test_a_force_that_follows_the_tilt_is_the_ground_where_nothing_tells_the_drive() -> None:
    """In a hand or on a swaying deck the sideways force is gravity's; rotors feel none of it."""
    assert found_in(without_drive(carried(1.0))).spans == []
    (flight,) = found_in(without_drive(carried(0.05))).spans
    assert flight == (pytest.approx(5.0, abs=3.0), pytest.approx(35.0, abs=3.0))


def test_a_drive_of_zero_high_above_the_ground_is_not_the_drive() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    height = np.interp(t, [6.0, 12.0, 28.0, 34.0], [0.0, 20.0, 20.0, 0.0])
    log = carried(0.05, throttle=0.0)
    assert found_in(log).spans == []
    log.baro = [Stream(t, height[:, None], "m", "", "BARO")]
    (flight,) = found_in(log).spans
    assert flight == (pytest.approx(6.0, abs=2.0), pytest.approx(34.0, abs=2.0))


def test_lift_off_without_a_drive_is_where_down_leaves_its_direction() -> None:
    down = np.column_stack([np.sin(np.radians(np.interp(T, [20.0, 30.0], [0.0, 10.0]))), 0 * T, np.ones(len(T))])
    grid = made_grid(down=down)
    assert sparse.liftoff_by_tilt(grid, 225) == pytest.approx(21.6, abs=0.15)
    assert sparse.liftoff_by_tilt(made_grid(down=np.tile([0.0, 0.0, 1.0], (len(T), 1))), 225) == pytest.approx(T[225])


def test_fast_and_high_for_five_seconds_is_flight_and_lasts_while_either_holds() -> None:
    """On the ground to 10 s and from 34 s on; a run at 9 m/s on a road is none."""
    speed = np.interp(T, [8.0, 12.0, 30.0, 34.0], [0.0, 12.0, 12.0, 0.0])
    high = np.interp(T, [10.0, 14.0, 28.0, 33.0], [0.0, 40.0, 40.0, 0.0])
    grid, may = made_grid(speed=speed), np.ones(len(T), bool)
    ((a, b),) = sparse.flights_by_motion(grid, 500.0 + high, may, True)
    assert (T[a], T[b]) == (pytest.approx(9.7, abs=0.2), pytest.approx(32.7, abs=0.3))
    assert sparse.flights_by_motion(grid, 0.1 * high, may, True) == []
    assert sparse.flights_by_motion(grid, 500.0 + high, ~may, True) == []


def test_wings_that_dip_without_stopping_fly_on_and_others_land() -> None:
    dip = (T > 18.0) & (T < 24.0)
    high, speed = np.where(dip, 1.0, 40.0), np.where(dip, 4.0, 15.0)
    high[T < 3.0] = speed[T < 3.0] = 0.0
    grid, may = made_grid(speed=speed), np.ones(len(T), bool)
    assert len(sparse.flights_by_motion(grid, high, may, True)) == 1
    assert len(sparse.flights_by_motion(grid, high, may, False)) == 2
    speed[200] = 1.0
    assert len(sparse.flights_by_motion(made_grid(speed=speed), high, may, True)) == 2


def test_a_drive_that_is_not_heard_is_not_off() -> None:
    t = np.arange(0.0, 10.0, 0.5)
    power, heard = sparse.heard_drive(T, Stream(t, np.full((20, 1), 0.4), "1", "", "VFR_HUD"))
    assert heard[:110].all()
    assert not heard[115:].any()
    np.testing.assert_allclose(power[1:], 0.4)


def test_an_armed_span_begins_with_the_drive_where_heartbeats_were_lost() -> None:
    pushed = (T >= 12.0) & (T < 30.0)
    assert sparse.armed_by_drive(T, [(15.0, 31.0)], pushed) == [(pytest.approx(12.0, abs=0.05), 31.0)]
    assert sparse.armed_by_drive(T, [(11.0, 31.0)], pushed) == [(11.0, 31.0)]


def test_heights_count_from_arming_unless_first_heard_in_the_air() -> None:
    for start, top in ((1.2, 10.0), (6.0, 16.0)):
        level = HeightLevel("estimator", "GLOBAL_POSITION_INT", start + np.interp(T, [10.0, 15.0], [0.0, 10.0]))
        counted = sparse.count_from_arming(T, level, [(8.0, 35.0)])
        assert counted.above[200] == pytest.approx(top)


def test_a_flight_grows_to_a_stand_and_over_what_was_not_heard() -> None:
    above = np.interp(T, [10.0, 15.0, 30.0, 35.0], [0.0, 10.0, 10.0, 0.0])
    above[(T > 20.0) & (T < 22.0)] = np.nan
    none = np.zeros(len(T), bool)
    ((a, b),) = sparse.grow_flights([(160, 190), (250, 280)], none, none, above)
    assert (T[a], T[b]) == (pytest.approx(10.3, abs=0.15), pytest.approx(34.8, abs=0.15))
    stood = (T > 20.0) & (T < 22.5)
    assert len(sparse.grow_flights([(160, 190), (250, 280)], stood, none, above)) == 2
    off = T > 33.5
    assert T[sparse.grow_flights([(160, 190)], none, off, above)[0][1]] == pytest.approx(34.0, abs=0.15)


def telemetry(lost: tuple[float, float]) -> attlog.FlightLog:
    """Telemetry of 1 Hz of a hover at 8 m from 20 to 60 s, with a pause of the link."""
    t = np.arange(0.0, 80.0, 1.0)
    t = t[(t < lost[0]) | (t > lost[1])]
    still = np.tile([0.0, 0.0, -9.81], (len(t), 1))
    height = np.interp(t, [18.0, 22.0, 56.0, 60.0], [0.0, 8.0, 8.0, 0.0])
    log = imu_log(
        t,
        0.0 * still,
        still,
        attitudes={"ATTITUDE": Attitude(t, rotation.from_euler(0.0 * t, 0.0 * t, 0.0 * t), "ATTITUDE")},
        onboard="ATTITUDE",
        armed=TimeLine(np.array([0.0, 15.0, 64.0]), [False, True, False], "HEARTBEAT"),
        throttle=Stream(t, np.where((t > 17) & (t < 61), 0.4, 0.0)[:, None], "1", "", "VFR_HUD"),
        baro=[Stream(t, 300.0 + height[:, None], "m", "", "SCALED_PRESSURE")],
    )
    log.estimator.height = Stream(t, height[:, None], "m", "", "GLOBAL_POSITION_INT")
    return log


@pytest.mark.parametrize("lost", [(90.0, 91.0), (30.0, 38.0), (53.0, 58.5)])
def test_a_pause_of_the_radio_link_neither_lands_nor_cuts_a_flight(lost):
    (flight,) = segments.build(telemetry(lost)).spans("airborne")
    assert flight == (pytest.approx(18.3, abs=0.7), pytest.approx(59.7, abs=0.7))


def test_the_estimators_height_shows_a_flight_where_neither_imu_nor_attitude_is_logged() -> None:
    t = np.arange(0.0, 80.0, 0.1)
    log = imu_log(t, np.zeros((len(t), 3)), np.zeros((len(t), 3)))
    log.imus, log.imu, log.vehicle, log.seconds = [], None, "fixed wing", 80.0
    log.state.armed = TimeLine(np.array([0.0, 15.0, 64.0]), [False, True, False], "vehicle_status")
    high = np.interp(t, [18.0, 25.0, 50.0, 60.0], [0.0, 60.0, 60.0, 0.0])
    fast = np.interp(t, [16.0, 20.0, 56.0, 61.0], [0.0, 15.0, 15.0, 0.0])
    log.estimator.height = Stream(t, high[:, None], "m", "", "vehicle_local_position")
    log.estimator.speed = Stream(t, fast[:, None], "m/s", "", "vehicle_local_position")
    (flight,) = segments.build(log).spans("airborne")
    assert flight == (pytest.approx(17.5, abs=1.0), pytest.approx(60.0, abs=1.0))
    zero = 0.0 * t  # a receiver that stands still outweighs the estimator
    log.gnss = [Gnss(0, t, "GPS", zero, zero, zero, np.zeros((len(t), 3)), zero, zero, zero, np.full(len(t), 3))]
    assert segments.build(log).spans("airborne") == []


def thinned(log: attlog.FlightLog, hz: float, lost: list[spans.Span]) -> attlog.FlightLog:
    """The log as its telemetry: one IMU, attitude, barometer and throttle at a few hertz, with pauses of the link."""

    def kept(t: np.ndarray) -> np.ndarray:
        k = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], 1.0 / hz)))
        return k[~spans.inside(t[k], lost)]

    def stream(one: Stream) -> Stream:
        k = kept(one.t)
        return replace(one, t=one.t[k], x=one.x[k], t_sample=None)

    unit, attitude = log.imus[0], log.onboard_attitude
    assert attitude is not None
    log.imus, log.imu = [replace(unit, gyro=stream(unit.gyro), acc=stream(unit.acc))], 0
    k = kept(attitude.t)
    log.attitudes = {attitude.source: Attitude(attitude.t[k], attitude.q[k], attitude.source)}
    log.onboard, log.rangefinder, log.gnss = attitude.source, None, []
    log.baro = [stream(one) for one in log.baro[:1]]
    log.power.throttle = None if log.power.throttle is None else stream(log.power.throttle)
    log.power.motors = log.power.rpm = log.estimator.height = log.estimator.speed = None
    return log


@pytest.mark.parametrize("name", ["px4_steps.ulg", "px4_hover.ulg", "copter_aggressive.bin", "copter_loop400.bin"])
@pytest.mark.parametrize("hz", [4.0, 1.5])
def test_slow_telemetry_over_a_bad_link_is_the_one_flight_that_was_simulated(corpus, name, hz):
    """Three in ten seconds are lost, in pauses of 6 s."""
    path = sitl(corpus, name)
    log = attlog.read(path)
    a, b = true_flight(path, log)
    lost = [(t, t + 6.0) for t in np.arange(b % 20.0 + 8.0, log.seconds, 20.0)]
    (found,) = segments.build(thinned(log, hz, lost)).spans("airborne")
    assert found == (pytest.approx(a, abs=6.5), pytest.approx(b, abs=3.0))


def test_a_barometer_that_propellers_raise_is_no_flight_in_slow_telemetry() -> None:
    """1.5 m for half a minute with the throttle up: level within 0.1 deg as on the ground, or swaying."""
    for lean_deg, flights in ((0.1, 0), (2.0, 1)):
        log = telemetry((90.0, 91.0))
        t = log.attitudes["ATTITUDE"].t
        roll = np.radians(lean_deg) * np.sin(2.0 * np.pi * t / 5.0)
        log.attitudes["ATTITUDE"].q = rotation.from_euler(roll, 0.0 * t, 0.0 * t)
        log.baro[0].x = 300.0 + 1.5 * (log.baro[0].x - 300.0) / 8.0
        log.estimator.height = None
        assert len(segments.build(log).spans("airborne")) == flights


def test_the_top_of_an_estimated_height_that_is_reset_in_the_air_is_unknown() -> None:
    """Cores 54 m apart: the height says where it flew, and not how high."""
    high = np.interp(T, [10.0, 15.0, 30.0, 35.0], [0.0, 40.0, 40.0, 0.0])
    for step, jumps in ((54.0, True), (3.0, False)):
        stream = Stream(T, (high + step * ((T > 20.0) & (T < 24.0)))[:, None], "m", "", "vehicle_local_position")
        assert heights.has_jumps(stream) is jumps
        level = HeightLevel("estimator", stream.source, stream.x[:, 0], jumps)
        found = heights.highest_level([level], np.ones(len(T), bool))
        assert (found is None) is jumps
