"""What flies and what stands is told by height, throttle and gyro, not by flags or a drifting barometer."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.flight.model import FlightLog, Gnss, Stream, TimeLine
from attlog.segments import flying, spans

from .flights import DISARMED, END, LANDED, TAKE_OFF, flight
from .test_flags import SECONDS, height, throttle

FLOWN = (TAKE_OFF, LANDED)


def build(**more) -> segments.Segments:
    """Segments of the made flight with height and throttle."""
    return segments.build(flight(50.0, **{"baro": [height()], "throttle": throttle()} | more))


def landed_at(*times: float) -> TimeLine:
    """A land detector that toggles at the times, landed at first."""
    return TimeLine(np.array([0.0, *times]), [i % 2 == 0 for i in range(len(times) + 1)], "EV")


def test_a_flag_that_lands_a_climbing_vehicle_is_not_believed():
    found = build(landed=landed_at(TAKE_OFF, TAKE_OFF + 2.0))
    assert spans.seconds(spans.intersect(found.spans("airborne"), [FLOWN])) > 38
    assert "s more by throttle" in found.notes["airborne"]


def test_a_barometer_that_drifts_by_three_metres_lifts_nobody():
    drift = 3.0 * SECONDS / END
    bench = Stream(SECONDS, 100.0 + drift[:, None], "m", "", "BARO:0")
    found = segments.build(
        flight(50.0, calm=True, baro=[bench], throttle=throttle(), landed=landed_at(TAKE_OFF, LANDED))
    )
    assert found.of("airborne") == []
    assert "it stood on the ground by height, throttle and gyro" in found.notes["airborne"]


def test_the_same_drift_does_not_ground_a_flight():
    high = height()
    high.x[:, 0] += 3.0 * SECONDS / END
    found = build(baro=[high], landed=None)
    assert found.spans("airborne") == [(pytest.approx(TAKE_OFF, abs=1.0), pytest.approx(LANDED, abs=1.0))]


def test_not_landed_without_drive_is_no_flight():
    late = landed_at(TAKE_OFF, DISARMED - 0.1)
    found = build(landed=late)
    assert found.spans("airborne")[-1][1] <= LANDED + 1.0


def test_low_and_rough_flight_below_half_a_metre_is_left_to_the_flag():
    """Ground effect: 0.3 m of height with drive and turning is no standing."""
    found = build(baro=[height(top=0.3)], landed=landed_at(TAKE_OFF, LANDED))
    assert spans.seconds(found.spans("airborne")) > 36


def test_height_without_drive_is_a_lift_by_hand():
    idle = Stream(SECONDS, np.where(SECONDS > 1e9, 1.0, 0.02)[:, None], "1", "", "CTUN.ThO")
    idle.x[SECONDS > 100] = 0.5
    assert build(landed=None, throttle=idle).spans("airborne") == []


def test_without_throttle_motor_outputs_tell_drive():
    outputs = Stream(SECONDS, np.repeat(throttle().x, 4, axis=1), "1", "", "RCOU")
    found = build(landed=None, throttle=None, motors=outputs)
    assert found.spans("airborne") == [(pytest.approx(TAKE_OFF, abs=1.0), pytest.approx(LANDED, abs=1.0))]


def test_motors_that_stand_still_are_rest_in_spite_of_a_flag_and_turning_ones_are_none_without():
    outputs = throttle()
    armed_on = TimeLine(np.array([0.0]), [True], "EV")
    assert build(armed=armed_on, motors=outputs).spans("rest") == [
        (pytest.approx(DISARMED, abs=0.6), pytest.approx(END, abs=0.1))
    ]
    turning = Stream(SECONDS, np.full((len(SECONDS), 4), 0.1), "1", "", "RCOU")
    assert build(armed=None, landed=None, motors=turning, throttle=None, baro=[]).of("rest") == []


def test_a_pause_of_the_logger_ends_every_span():
    log = with_pause(flight(50.0, baro=[height()], throttle=throttle()), 45.0, 60.0)
    found = segments.build(log)
    for kind in ("armed", "airborne"):
        assert spans.intersect(found.spans(kind), [(45.1, 59.9)]) == [], kind
        assert len(found.of(kind)) == 2


def with_pause(log: FlightLog, t0: float, t1: float) -> FlightLog:
    """The log without its samples between two times."""
    streams = [log.imus[0].gyro, log.imus[0].acc, *log.baro, *([log.throttle] if log.throttle else [])]
    for stream in streams:
        keep = (stream.t < t0) | (stream.t > t1)
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    return log


def test_a_steady_climb_counts_though_its_height_has_no_ground_to_count_from():
    """A log that begins in the air with throttle on throughout."""
    t = np.arange(0.0, 60.0, 0.1)
    log = flight(50.0, throttle=Stream(t, np.full((len(t), 1), 0.5), "1", "", "ThO"))
    log.baro = [Stream(t, 100.0 + 2.5 * t[:, None], "m", "", "BARO:0")]
    seen = flying.evidence(log, None, 0.0, 60.0)
    assert seen is not None
    assert not np.isfinite(seen.height).any()
    assert seen.off[20:-20].all()
    assert not seen.standing.any()


@pytest.mark.parametrize(("fix", "known"), [(2, False), (3, True), (5, True)])
def test_the_height_of_a_log_without_barometer_is_that_of_a_receiver_with_a_3d_fix(fix, known):
    t = np.arange(0.0, 20.0, 0.2)
    nothing = np.full(len(t), np.nan)
    told = Gnss(0, t, "GPS:0", nothing, nothing, 488.0 + t, np.full((len(t), 3), np.nan), nothing, nothing, nothing,
                np.full(len(t), fix))  # fmt: skip
    found = flying.height(flight(50.0, baro=[], gnss=[told]))
    assert (found is not None) is known
    if found is not None:
        np.testing.assert_array_equal(found.x[:, 0], 488.0 + t)


def lifted(drive_from: int, climb_from: int, height_from: int) -> list[tuple[float, float]]:
    """The flights of 10 s in which drive, climb and height begin at these samples; off the ground from sample 50 on."""
    k = np.arange(100)
    nothing = np.zeros(100, np.bool_)
    height_m = np.where(k >= height_from, 0.3, 0.0) + np.where(k >= 50, 5.0, 0.0)
    climb = np.where(k >= climb_from, 0.5, 0.1)
    return flying.flights(flying.FlightEvidence(0.1 * k, k >= drive_from, height_m, climb, k >= 50, nothing, "made"))


def test_a_flight_begins_where_it_climbs_with_drive_above_the_ground():
    for begins, of in ((40, (40, 0, 0)), (42, (0, 42, 0)), (44, (0, 0, 44)), (50, (0, 55, 0)), (0, (0, 0, 0))):
        assert lifted(*of) == [(pytest.approx(0.1 * begins), pytest.approx(9.9))], of
