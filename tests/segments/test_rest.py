"""Flags are believed only as far as the sensors agree, and arming alone is no flight."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation, spans
from attlog.flight.model import Gnss, Stream, TimeLine
from tests.segments import flights
from tests.segments.flights import ARMED, DISARMED, END, LANDED, TAKE_OFF, flight, imu_log

SECONDS = np.arange(0.0, END, 0.1)


def height(top: float = 20.0, start: float = 400.0) -> Stream:
    """A climb at 3 m/s to ``top`` above the start, and down again at landing."""
    rise = np.interp(SECONDS, [TAKE_OFF, TAKE_OFF + top / 3, LANDED - top / 3, LANDED], [0, top, top, 0])
    return Stream(SECONDS, start + rise[:, None], "m", "", "BARO:0")


def throttle() -> Stream:
    """Idling, half throttle in the air, idling, off."""
    x = np.where((SECONDS > TAKE_OFF - 1) & (SECONDS < LANDED), 0.5, np.where(SECONDS > ARMED, 0.08, 0.0))
    return Stream(SECONDS, np.where(SECONDS > DISARMED, 0.0, x)[:, None], "1", "", "CTUN.ThO")


def airborne(**more) -> tuple[list[tuple[float, float]], str]:
    """Flight of a log and the reason for it."""
    found = segments.build(flight(50.0, **more))
    return found.spans("airborne"), found.notes["airborne"]


def test_the_land_detector_tells_flight():
    found, why = airborne()
    assert found == [(TAKE_OFF, LANDED)]
    assert "vehicle_land_detected" in why


def test_a_vehicle_is_not_airborne_by_arming_alone():
    found, why = airborne(landed=None)
    assert found == []
    assert "no land detector" in why
    assert segments.build(flight(50.0, landed=None)).spans("hover") == []


def test_not_landed_while_disarmed_is_a_flag_that_nobody_updated():
    """Some firmwares say "not landed" from boot until the first landing."""
    never = TimeLine(np.array([0.0, LANDED]), [False, True], "vehicle_land_detected")
    found, why = airborne(landed=never)
    assert found == [(ARMED, LANDED)]
    assert "vehicle_land_detected" in why


def test_not_landed_of_a_vehicle_that_lies_still_is_refused_where_arming_is_unknown():
    never = TimeLine(np.array([0.0]), [False], "vehicle_land_detected")
    found, _ = airborne(landed=never, armed=None)
    assert spans.seconds(spans.intersect(found, [(0, ARMED - 1), (DISARMED + 1, END)])) == 0.0
    assert spans.seconds(spans.intersect(found, [(TAKE_OFF, LANDED)])) > 39


def test_without_land_detector_throttle_with_climb_tells_flight():
    found, why = airborne(landed=None, throttle=throttle(), baro=[height()])
    assert len(found) == 1
    assert found[0][0] == pytest.approx(TAKE_OFF, abs=1.0)
    assert found[0][1] == pytest.approx(LANDED, abs=1.0)
    assert "CTUN.ThO" in why
    assert "BARO:0" in why


def test_without_land_detector_and_throttle_a_fast_climb_while_armed_tells_flight():
    found, why = airborne(landed=None, baro=[height()])
    assert len(found) == 1
    assert found[0] == pytest.approx((TAKE_OFF, LANDED), abs=1.0)
    assert "driven (arming)" in why
    assert airborne(landed=None, baro=[height()], armed=None)[0] == []


def test_landed_throughout_a_flight_that_climbs_is_refuted():
    stuck = TimeLine(np.array([0.0]), [True], "vehicle_land_detected")
    found, _ = airborne(landed=stuck, throttle=throttle(), baro=[height()])
    assert spans.seconds(spans.intersect(found, [(TAKE_OFF, LANDED)])) > 38


@pytest.mark.parametrize("vehicle", ["rover", "boat", "submarine"])
def test_vehicles_that_cannot_fly_do_not(vehicle):
    found, why = airborne(vehicle=vehicle)
    assert found == []
    assert vehicle in why


def test_without_any_flag_nothing_is_claimed_about_flight():
    found = segments.build(flight(50.0, armed=None, landed=None))
    assert found.of("airborne") == []
    assert found.of("armed") == []
    assert found.of("idle") == []
    assert "unknown" in found.notes["rest"]


def test_a_log_without_imu_has_the_runs_of_its_attitude_and_no_rest():
    log = flight(50.0, imu=None, imus=[])
    found = segments.build(log)
    assert len(found.of("continuous")) == 1
    assert found.of("rest") == []
    assert "no IMU" in found.notes["continuous"]


@pytest.mark.parametrize("vehicle", ["fixed wing", "quadrotor"])
def test_only_what_can_hover_hovers(vehicle):
    found = segments.build(flight(50.0, vehicle=vehicle))
    assert bool(found.of("hover")) == (vehicle == "quadrotor")
    assert all(s.seconds >= 3 for s in found.of("hover"))


# Rest is found where the vehicle lay still, and nowhere else; hover is never rest.


def resting(log, kind: str = "rest") -> list[tuple[float, float]]:
    """The rests of a log."""
    return segments.build(log).spans(kind)


def still_log(t, seed: int = 1, noise_dps: float = 0.05, **more):
    """A log that lies still throughout."""
    rng = np.random.default_rng(seed)
    gyro = np.radians(rng.normal(size=(len(t), 3)) * noise_dps + flights.OFFSET_DPS)
    acc = rng.normal(size=(len(t), 3)) * 0.02 + [0, 0, -flights.G]
    return imu_log(t, gyro, acc, **more)


@pytest.mark.parametrize("rate", [25.0, 50.0, 200.0, 400.0])
@pytest.mark.parametrize("known", [True, False])
def test_rest_before_and_after_the_flight_is_found_to_half_a_second(rate, known):
    log = flight(rate) if known else flight(rate, armed=None, landed=None)
    found = resting(log, "rest.long")
    assert len(found) == 2
    assert found[0][0] == pytest.approx(0.0, abs=0.01)
    assert found[0][1] == pytest.approx(ARMED, abs=0.6)
    assert found[1][0] == pytest.approx(DISARMED, abs=0.6)
    assert found[1][1] == pytest.approx(END, abs=0.1)


@pytest.mark.parametrize("known", [True, False])
def test_a_calm_hover_is_never_rest(known):
    """Without a cap on the limit a log whose floor is high would call this hover rest."""
    log = flight(calm=True) if known else flight(calm=True, armed=None, landed=None)
    found = segments.build(log)
    assert spans.seconds(spans.intersect(found.spans("rest"), [(TAKE_OFF, LANDED)])) == 0.0
    hover = found.spans("hover")
    if known:
        assert spans.seconds(spans.intersect(hover, [(TAKE_OFF, LANDED)])) > 35


def test_a_log_that_is_all_flight_has_no_rest_however_quiet_its_quietest_window():
    rng = np.random.default_rng(2)
    t = np.arange(0, 60, 1 / 200)
    noise = 1.0 + 0.3 * np.sin(0.2 * t)
    log = imu_log(
        t,
        np.radians(rng.normal(size=(len(t), 3)) * noise[:, None]),
        rng.normal(size=(len(t), 3)) * 0.05 + [0, 0, -flights.G],
    )
    assert resting(log) == []
    assert "no window as still as a surface" in segments.build(log).notes["rest"]


@pytest.mark.parametrize(
    ("seconds", "kind"), [(1.4, None), (5.0, "rest.short"), (9.0, "rest.short"), (12.0, "rest.long")]
)
def test_the_length_of_a_rest_decides_its_class(seconds, kind):
    t = np.arange(0, seconds, 1 / 100)
    found = [s.kind for s in segments.build(still_log(t)).of("rest")]
    assert found == ([] if kind is None else [kind])


def test_a_flag_that_says_armed_or_airborne_takes_rest_away_but_no_flag_makes_rest():
    t = np.arange(0, 30, 1 / 100)
    armed = TimeLine(np.array([0.0, 12.0]), [False, True], "vehicle_status")
    found = resting(still_log(t, armed=armed))
    assert len(found) == 1
    assert found[0][1] <= 12.0
    moving = still_log(t, noise_dps=3.0, armed=TimeLine(np.array([0.0]), [False], "vehicle_status"))
    assert resting(moving) == []


def test_a_slow_steady_turn_between_rests_is_not_rest():
    """A turntable is as quiet as a table; only its mean rate tells it apart."""
    t = np.arange(0, 60, 1 / 100)
    log = still_log(t)
    log.imus[0].gyro.x[(t > 25) & (t < 35), 2] += np.radians(2.0)
    found = resting(log)
    assert spans.seconds(spans.intersect(found, [(25.5, 34.5)])) == 0.0
    assert spans.seconds(found) > 45


def test_an_offset_that_creeps_with_temperature_stays_rest():
    t = np.arange(0, 600, 1 / 50)
    log = still_log(t)
    log.imus[0].gyro.x += np.radians(1.0) * t[:, None] / 600
    assert spans.seconds(resting(log)) > 590


@pytest.mark.parametrize(("shaking", "rests"), [(0.1, 1), (0.3, 0)])
def test_a_quiet_gyro_on_a_shaking_accelerometer_is_no_rest(shaking, rests):
    """A hand that holds still, or idling motors: 0.15 m/s^2 of standard deviation is the limit."""
    t = np.arange(0.0, 30.0, 0.01)
    log = still_log(t)
    log.imus[0].acc.x[:, 2] += np.random.default_rng(4).normal(0.0, shaking, len(t))
    assert len(resting(log)) == rests


def test_a_dead_accelerometer_shows_no_rest():
    t = np.arange(0, 30, 1 / 100)
    log = imu_log(t, np.zeros((len(t), 3)), np.zeros((len(t), 3)))
    assert resting(log) == []


def test_a_vehicle_that_travels_does_not_rest():
    t = np.arange(0, 30, 1 / 100)
    seconds = np.arange(0.0, 30.0, 0.2)
    n = len(seconds)
    velocity = np.where((seconds > 10) & (seconds < 20), 12.0, 0.0)[:, None] * [1.0, 0.0, 0.0]
    gnss = Gnss(
        0,
        seconds,
        "GPS:0",
        np.full(n, 47.0),
        np.full(n, 8.0),
        np.full(n, 400.0),
        velocity,
        np.ones(n),
        np.ones(n),
        np.ones(n),
        np.full(n, 3),
    )
    found = resting(still_log(t, gnss=[gnss]))
    assert spans.seconds(spans.intersect(found, [(10.5, 19.5)])) == 0.0
    assert spans.seconds(found) > 18


def test_rest_never_reaches_across_a_gap():
    t = np.concatenate([np.arange(0, 12, 0.01), np.arange(14, 26, 0.01)])
    found = resting(still_log(t))
    assert len(found) == 2
    assert found[0][1] <= 12.1
    assert found[1][0] >= 13.9


def test_samples_that_are_not_numbers_do_not_end_a_rest_nor_break_the_search():
    t = np.arange(0, 30, 0.01)
    log = still_log(t)
    log.imus[0].gyro.x[1000:1003] = np.nan
    log.imus[0].acc.x[1500] = np.nan
    assert spans.seconds(resting(log)) > 29


def test_idling_is_on_the_ground_with_motors_and_is_not_rest():
    found = segments.build(flight())
    idle = found.spans("idle")
    assert spans.seconds(spans.intersect(idle, [(ARMED, TAKE_OFF)])) > 4
    assert spans.seconds(spans.intersect(idle, [(TAKE_OFF, LANDED)])) == 0.0
    assert spans.intersect(idle, found.spans("rest")) == []


def test_motors_that_turn_by_rpm_idle_where_arming_is_unknown():
    t = np.arange(0.0, 105.0, 0.1)
    rpm = Stream(t, np.where((t > ARMED) & (t < DISARMED), 3000.0, 0.0)[:, None], "rpm", "", "ESC")
    landed = flights.flags()["landed"]
    found = segments.build(flight(armed=None, landed=landed, rpm=rpm))
    assert spans.seconds(spans.intersect(found.spans("idle"), [(ARMED, TAKE_OFF)])) > 4
    assert "RPM" in found.notes["idle"]


def test_flight_is_hover_or_cruise_and_never_both():
    found = segments.build(flight())
    air, hover, cruise = (found.spans(w) for w in ("airborne", "hover", "cruise"))
    assert hover
    assert cruise
    assert spans.intersect(hover, cruise) == []
    assert spans.seconds(hover) + spans.seconds(cruise) == pytest.approx(spans.seconds(air))


def test_motors_idle_at_a_gyro_that_no_rest_could_tell_the_offset_of():
    """Without any rest 2 deg/s may be the gyro's own offset; beside a rest that shows zero the vehicle turns."""
    from attlog.segments import rest
    from attlog.segments import rest as windows
    from attlog.segments.rest import FlagSpans

    t = np.arange(0.0, 10.0, 0.01)
    gyro = np.radians(np.where(t[:, None] < 5.0, 0.0, [0.0, 0.0, 2.0]))
    built = windows.build_windows(t, gyro, np.tile([0.0, 0.0, -9.8], (len(t), 1)))
    ground, motors = FlagSpans(True, [], "not airborne"), FlagSpans(True, [(5.0, 10.0)], "armed")
    nothing, first = np.zeros(len(built.t0), bool), built.t1 <= 5.0
    (idle,) = rest.find_idles(built, nothing, ground, motors, [])
    assert (idle.t0, idle.t1) == (5.0, pytest.approx(10.0))
    assert rest.find_idles(built, first, ground, motors, [(0.0, 5.0)]) == []


# Hover is hardly moving over the ground, where that is known.


def seconds_of_hover(speed_m_s: float, fix: int = 3) -> float:
    """How long the made flight hovers with a receiver that tells this speed to the east."""
    t = np.arange(0.0, END, 0.2)
    nothing, velocity = np.full(len(t), np.nan), np.tile([0.0, speed_m_s, 0.0], (len(t), 1))
    told = Gnss(0, t, "GPS:0", nothing, nothing, nothing, velocity, nothing, nothing, nothing, np.full(len(t), fix))
    found = segments.build(flight(50.0, calm=True, gnss=[told]))
    return spans.seconds(spans.intersect(found.spans("hover"), [(TAKE_OFF, LANDED)]))


@pytest.mark.parametrize(("speed", "hovers"), [(0.0, True), (0.9, True), (1.1, False), (8.0, False)])
def test_a_metre_a_second_over_the_ground_is_no_hover(speed: float, hovers: bool) -> None:
    assert seconds_of_hover(speed) == pytest.approx(LANDED - TAKE_OFF if hovers else 0.0, abs=4.0)


@pytest.mark.parametrize(("tilt_deg", "hovers"), [(15.0, True), (25.0, False)])
def test_a_vehicle_that_leans_by_20_degrees_does_not_hover(tilt_deg: float, hovers: bool) -> None:
    """However slowly it turns: it accelerates, or leans into wind as in cruise."""
    log = flight(50.0, calm=True)
    attitude = log.attitudes["ATT"]
    leaning = (attitude.t > TAKE_OFF) & (attitude.t < LANDED)
    attitude.q[leaning] = rotation.multiply(attitude.q[leaning], rotation.from_euler(np.radians(tilt_deg), 0.0, 0.0))
    found = spans.intersect(segments.build(log).spans("hover"), [(TAKE_OFF, LANDED)])
    assert spans.seconds(found) == pytest.approx(LANDED - TAKE_OFF if hovers else 0.0, abs=4.0)


def test_a_speed_without_a_fix_tells_nothing() -> None:
    assert seconds_of_hover(8.0, fix=2) == pytest.approx(LANDED - TAKE_OFF, abs=4.0)
