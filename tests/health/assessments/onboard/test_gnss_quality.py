"""Reception of given size: poor numbers, jamming, spoofing, outages and jumps are named, good ones are not."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Reception
from attlog.health.assessments import Assessment
from attlog.health.assessments.onboard import gnss_quality
from tests.health.assessments.onboard.made import case, flight


def received(**told: float) -> FlightLog:
    log = flight()
    n = len(log.gnss[0].t)
    usual = {
        "satellites": 15.0,
        "hdop": 0.8,
        "noise": 90.0,
        "jamming": 20.0,
        "jamming_state": 1.0,
        "spoofing_state": 1.0,
    }
    log.gnss[0].reception = Reception(**{name: np.full(n, value) for name, value in (usual | told).items()})
    log.gnss[0].s_acc = np.full(n, 0.3)
    return log


def told(log: FlightLog, question: str) -> Assessment:
    (one,) = (a for a in gnss_quality.assessments(case(log)) if a.question == question)
    return one


def test_good_reception_is_ok_in_all_three() -> None:
    found = gnss_quality.assessments(case(received()))
    assert [(a.question, a.verdict) for a in found] == [
        ("gnss_quality", "ok"),
        ("gnss_interference", "ok"),
        ("gnss_jumps", "ok"),
    ]


@pytest.mark.parametrize(("name", "value"), [("satellites", 4.0), ("hdop", 3.0)])
def test_a_poor_number_is_named(name: str, value: float) -> None:
    one = told(received(**{name: value}), "gnss_quality")
    assert one.verdict == "warning"
    assert f"{'HDOP' if name == 'hdop' else name} {value:.0f}" in one.text


def test_speed_accuracy_counts_by_what_the_firmware_asks() -> None:
    log = received()
    log.gnss[0].s_acc[:] = 0.8
    assert told(log, "gnss_quality").verdict == "warning"


def test_an_outage_is_told_with_its_time() -> None:
    log = received()
    t = log.gnss[0].t
    log.gnss[0].fix[(t > 40.0) & (t < 52.0)] = 0
    one = told(log, "gnss_quality")
    assert one.verdict == "warning"
    assert one.t == pytest.approx(40.0, abs=0.3)
    assert one.text == "GNSS had no fix for 12 s in flight, first at 40 s."


def test_what_a_receiver_tells_without_a_fix_is_no_quality() -> None:
    """PX4's receivers tell no satellites and an accuracy of 100 m/s then."""
    log = received()
    reception, lost = log.gnss[0].reception, (log.gnss[0].t > 40.0) & (log.gnss[0].t < 52.0)
    assert reception is not None
    log.gnss[0].fix[lost], reception.satellites[lost], log.gnss[0].s_acc[lost] = 0, 0.0, 100.0
    one = told(log, "gnss_quality")
    assert one.text.startswith("GNSS had no fix for 12 s")
    assert one.evidence == [
        "With a fix it has satellites 15, HDOP 0.8, speed accuracy 0.3 m/s, position accuracy 0.5 m (95 %)."
    ]


@pytest.mark.parametrize(
    ("name", "state", "verdict"),
    [("jamming_state", 2.0, "warning"), ("jamming_state", 3.0, "fault"), ("spoofing_state", 2.0, "fault")],
)
def test_what_the_receiver_reports_for_more_than_a_second_is_told(name: str, state: float, verdict: str) -> None:
    log = received()
    reception = log.gnss[0].reception
    assert reception is not None
    t = log.gnss[0].t
    getattr(reception, name)[(t > 50.0) & (t < 60.0)] = state
    one = told(log, "gnss_interference")
    assert one.verdict == verdict
    assert one.value == pytest.approx(10.0, abs=0.5)
    assert one.t == pytest.approx(50.0, abs=0.3)


def test_a_jump_of_the_position_is_told_with_size_and_time() -> None:
    log = received()
    log.gnss[0].lat[log.gnss[0].t > 50.05] += np.degrees(12.0 / 6.371e6)
    one = told(log, "gnss_jumps")
    assert one.verdict == "warning"
    assert one.value == pytest.approx(12.0, abs=0.5)
    assert one.t == pytest.approx(50.2, abs=0.3)


def test_a_receiver_that_tells_nothing_raises_nothing() -> None:
    log = flight()
    for name in ("lat", "lon", "vel_ned", "s_acc", "h_acc"):
        getattr(log.gnss[0], name)[:] = np.nan
    assert [a.verdict for a in gnss_quality.assessments(case(log))] == ["unknown"]


@pytest.mark.parametrize(("count", "answered"), [(19, 0), (20, 3)])
def test_twenty_fixes_in_flight_tell_something(count: int, answered: int) -> None:
    log = received()
    gnss = log.gnss[0]
    near = np.flatnonzero(gnss.t > 30.0)[:count]
    for name in ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix"):
        setattr(gnss, name, getattr(gnss, name)[near])
    assert gnss.reception is not None
    gnss.reception = Reception(
        **{name: getattr(gnss.reception, name)[near] for name in ("satellites", "hdop", "noise", "jamming")},
        jamming_state=gnss.reception.jamming_state[near],
        spoofing_state=gnss.reception.spoofing_state[near],
    )
    assert len(gnss_quality.assessments(case(log))) == answered


@pytest.mark.parametrize(("metres", "verdict"), [(2.8, "ok"), (3.3, "warning"), (-3.3, "warning")])
@pytest.mark.parametrize("axis", ["lat", "lon"])
def test_a_step_of_three_metres_beside_the_velocity_is_a_jump(axis: str, metres: float, verdict: str) -> None:
    log = received()
    gnss = log.gnss[0]
    moved = np.degrees(metres / 6.371e6) * (gnss.t > 50.1)
    setattr(gnss, axis, getattr(gnss, axis) + moved)
    found = told(log, "gnss_jumps")
    assert found.verdict == verdict
    assert found.value == pytest.approx(abs(metres), abs=0.15)
    if verdict == "warning":
        assert found.t == pytest.approx(50.2, abs=0.11)


def test_fixes_more_than_a_second_and_a_half_apart_are_not_compared() -> None:
    for hole, verdict in ((1.3, "warning"), (1.7, "ok")):
        log = received()
        gnss = log.gnss[0]
        kept = (gnss.t < 50.05) | (gnss.t > 50.0 + hole - 0.15)
        gnss.lat = gnss.lat + np.degrees(9.0 / 6.371e6) * (gnss.t > 50.1)
        for name in ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix"):
            setattr(gnss, name, getattr(gnss, name)[kept])
        gnss.reception = None
        assert told(log, "gnss_jumps").verdict == verdict


def test_differences_of_longitude_stay_within_half_a_turn() -> None:
    found = gnss_quality._wrapped(np.array([359.9, -359.9, 10.0, 180.0]))
    np.testing.assert_allclose(found, [-0.1, 0.1, 10.0, -180.0])
