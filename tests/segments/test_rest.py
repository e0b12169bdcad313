"""Rest is found where the vehicle lay still, and nowhere else; hover is never rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog import segments
from attlog.flight.model import Gnss, Stream, TimeLine
from attlog.segments import spans

from . import flights
from .flights import ARMED, DISARMED, END, LANDED, TAKE_OFF, flight, imu_log


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


@settings(max_examples=15, deadline=None)
@given(shift=st.floats(-1e4, 1e4), yaw=st.floats(-3, 3))
def test_segments_move_with_the_clock(shift, yaw):
    """Time shift invariance: another zero of the clock moves segments and changes nothing else."""
    t = np.arange(0, 40, 1 / 50)
    armed = TimeLine(np.array([0.0, 15.0, 25.0]), [False, True, False], "vehicle_status")
    moved = TimeLine(armed.t + shift, armed.value, armed.source)
    a = segments.build(still_log(t, armed=armed))
    b = segments.build(still_log(t + shift, armed=moved))
    assert [s.kind for s in a.segments] == [s.kind for s in b.segments]
    np.testing.assert_allclose([s.t0 + shift for s in a.segments], [s.t0 for s in b.segments], atol=0.51)


def test_flight_is_hover_or_cruise_and_never_both():
    found = segments.build(flight())
    air, hover, cruise = (found.spans(w) for w in ("airborne", "hover", "cruise"))
    assert hover
    assert cruise
    assert spans.intersect(hover, cruise) == []
    assert spans.seconds(hover) + spans.seconds(cruise) == pytest.approx(spans.seconds(air))


def test_motors_idle_at_a_gyro_that_no_rest_could_tell_the_offset_of():
    """Without any rest 2 deg/s may be the gyro's own offset; beside a rest that shows zero the vehicle turns."""
    from attlog.segments import rest, windows
    from attlog.segments.flags import FlagSpans

    t = np.arange(0.0, 10.0, 0.01)
    gyro = np.radians(np.where(t[:, None] < 5.0, 0.0, [0.0, 0.0, 2.0]))
    built = windows.build(t, gyro, np.tile([0.0, 0.0, -9.8], (len(t), 1)))
    ground, motors = FlagSpans(True, [], "not airborne"), FlagSpans(True, [(5.0, 10.0)], "armed")
    nothing, first = np.zeros(len(built.t0), bool), built.t1 <= 5.0
    (idle,) = rest.idles(built, nothing, ground, motors, [])
    assert (idle.t0, idle.t1) == (5.0, pytest.approx(10.0))
    assert rest.idles(built, first, ground, motors, [(0.0, 5.0)]) == []
