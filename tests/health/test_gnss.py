"""GNSS outages in flight, the declination that the autopilot was told, gyros at the end of a range."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from attlog import flight, segments
from attlog.flight.model import FlightLog, Gnss, Reception, TimeLine
from attlog.health import compass as declination_told
from attlog.health import gnss
from attlog.health import gnss as gnss_quality
from attlog.health.check import Check, HealthCase
from attlog.segments.model import Segments
from tests.conftest import SAMPLES
from tests.health.made_flight import case
from tests.health.made_flight import flight as made_flight_flight


@pytest.fixture(scope="module")
def flown() -> tuple[FlightLog, Segments]:
    log = flight.read(SAMPLES / "copter_steps_stabilize.bin")
    return log, segments.build(log)


def middle(found: Segments) -> float:
    (begin, end), *_ = found.spans("airborne")
    return round(0.5 * (begin + end))


def test_a_fix_all_through_the_flight_is_good(flown: tuple[FlightLog, Segments]) -> None:
    check, *_ = gnss.gnss_checks(HealthCase(*flown))
    assert (check.question, check.verdict) == ("gnss_quality", "ok")


def keep_records(receiver: Gnss, keep: np.ndarray) -> None:
    """Keep some of a receiver's records."""
    for one in (receiver, receiver.reception):
        for field in fields(one) if one is not None else ():
            values = getattr(one, field.name)
            if isinstance(values, np.ndarray) and len(values) == len(keep):
                setattr(one, field.name, values[keep]) if one is receiver else object.__setattr__(
                    one, field.name, values[keep]
                )


@pytest.mark.parametrize("how", ["no fix", "no message"])
def test_an_outage_is_told_with_its_time_and_length(flown: tuple[FlightLog, Segments], how: str) -> None:
    log, found = deepcopy(flown[0]), flown[1]
    at = middle(found)
    for one in log.gnss:
        lost = (one.t >= at) & (one.t < at + 6)
        if how == "no fix":
            one.fix = np.where(lost, 1, one.fix)
        else:
            keep_records(one, ~lost)
    check, *_ = gnss.gnss_checks(HealthCase(log, found))
    assert check.verdict == "warning"
    assert check.value == pytest.approx(6.0, abs=0.41)
    assert check.t == pytest.approx(at, abs=0.21)


def test_late_messages_outages_on_the_ground_and_pauses_of_the_logger_are_none(
    flown: tuple[FlightLog, Segments],
) -> None:
    log, found = deepcopy(flown[0]), flown[1]
    (begin, _), *_ = found.spans("airborne")
    at = middle(found)
    for one in log.gnss:
        one.fix = np.where((one.t < begin - 1) | ((one.t > at) & (one.t < at + 2.5)), 1, one.fix)
    assert "no fix" not in gnss.gnss_checks(HealthCase(log, found))[0].text
    for one in log.gnss:
        keep_records(one, (one.t < at) | (one.t > at + 20))
    gyro = log.imus[log.imu or 0].gyro
    gyro.t = gyro.t[(gyro.t < at) | (gyro.t > at + 20)]
    assert "no fix" not in gnss.gnss_checks(HealthCase(log, found))[0].text


@pytest.mark.parametrize(("name", "seconds"), [("ardupilot/copter_gps_loss.bin", 30), ("px4/px4_gnssloss.ulg", 50)])
def test_the_planted_outages_of_the_firmware_simulators_are_found(corpus: Path, name: str, seconds: float) -> None:
    log = flight.read(corpus / "sitl" / name)
    check, *_ = gnss.gnss_checks(HealthCase(log, segments.build(log)))
    assert check.verdict == "warning"
    assert check.value == pytest.approx(seconds, abs=2.0)


def fix_check(log: FlightLog, degrees: float, **params: float) -> FlightLog:
    log = deepcopy(log)
    log.parameters.declination, log.parameters.declination_source = degrees, "COMPASS_DEC"
    log.parameters.lines = {k: TimeLine(np.zeros(1), [v], "PARM") for k, v in params.items()}
    return log


def test_a_wrong_declination_is_found_unless_the_autopilot_looks_it_up(flown: tuple[FlightLog, Segments]) -> None:
    from attlog.reference import alignment

    log = flown[0]
    model = alignment.earth_field(log)
    assert model is not None
    right = model.declination_deg
    assert [
        c.verdict for c in declination_told.declination_checks(HealthCase(fix_check(log, right + 3.0), Segments()))
    ] == ["ok"]
    assert [
        c.verdict for c in declination_told.declination_checks(HealthCase(fix_check(log, right - 10.0), Segments()))
    ] == ["warning"]
    assert [
        c.verdict
        for c in declination_told.declination_checks(HealthCase(fix_check(log, right + 20.0 - 360.0), Segments()))
    ] == ["fault"]
    for name in ("COMPASS_AUTODEC", "EKF2_DECL_TYPE", "ATT_MAG_DECL_A"):
        assert (
            declination_told.declination_checks(HealthCase(fix_check(log, right + 20.0, **{name: 3.0}), Segments()))
            == []
        )
        assert (
            declination_told.declination_checks(HealthCase(fix_check(log, right + 20.0, **{name: 2.0}), Segments()))
            != []
        )
    without = fix_check(log, right + 20.0)
    without.gnss = []
    assert declination_told.declination_checks(HealthCase(without, Segments())) == []


# Reception of given size: poor numbers, jamming, spoofing, outages and jumps are named, good ones are not.


def received(**told: float) -> FlightLog:
    log = made_flight_flight()
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


def quality_of(log: FlightLog, question: str) -> Check:
    (one,) = (a for a in gnss.gnss_checks(case(log)) if a.question == question)
    return one


def test_what_a_receiver_tells_without_a_fix_is_no_quality() -> None:
    """PX4's receivers tell no satellites and an accuracy of 100 m/s then."""
    log = received()
    reception, lost = log.gnss[0].reception, (log.gnss[0].t > 40.0) & (log.gnss[0].t < 52.0)
    assert reception is not None
    log.gnss[0].fix[lost], reception.satellites[lost], log.gnss[0].s_acc[lost] = 0, 0.0, 100.0
    one = quality_of(log, "gnss_quality")
    assert one.text.startswith("GNSS had no fix for 12 s")
    assert one.evidence == [
        "With a fix it has satellites 15, HDOP 0.8, speed accuracy 0.3 m/s, position accuracy 0.5 m (95 %)."
    ]


@pytest.mark.parametrize(
    ("name", "state", "verdict"), [("jamming_state", 3.0, "fault"), ("spoofing_state", 2.0, "fault")]
)
def test_what_the_receiver_reports_for_more_than_a_second_is_told(name: str, state: float, verdict: str) -> None:
    log = received()
    reception = log.gnss[0].reception
    assert reception is not None
    t = log.gnss[0].t
    getattr(reception, name)[(t > 50.0) & (t < 60.0)] = state
    one = quality_of(log, "gnss_interference")
    assert one.verdict == verdict
    assert one.value == pytest.approx(10.0, abs=0.5)
    assert one.t == pytest.approx(50.0, abs=0.3)


@pytest.mark.parametrize(("accuracy", "verdict"), [(0.3, "ok"), (0.6, "warning")])
def test_a_warning_of_jamming_counts_where_the_fix_is_worse(accuracy: float, verdict: str) -> None:
    log = received()
    reception, t = log.gnss[0].reception, log.gnss[0].t
    assert reception is not None
    jammed = (t > 50.0) & (t < 60.0)
    reception.jamming_state[jammed], log.gnss[0].s_acc[jammed] = 2.0, accuracy
    assert quality_of(log, "gnss_interference").verdict == verdict


def test_missing_records_are_no_lost_fix() -> None:
    log = received()
    gnss_ = log.gnss[0]
    kept = (gnss_.t < 40.0) | (gnss_.t > 52.0)
    for name in ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix"):
        setattr(gnss_, name, getattr(gnss_, name)[kept])
    gnss_.reception = None
    one = quality_of(log, "gnss_quality")
    assert one.text.startswith("No GNSS message arrived for 12 s")


@pytest.mark.parametrize("noise_m", [0.0, 4.0])
def test_two_jumps_are_two_whatever_the_noise_between(noise_m: float) -> None:
    log = received()
    t = log.gnss[0].t
    moved = 44.0 * ((t > 40.0) & (t < 60.0)) + noise_m * (np.arange(len(t)) % 50 == 0)
    log.gnss[0].lat = log.gnss[0].lat + np.degrees(moved / 6.371e6)
    assert "jumps twice" in quality_of(log, "gnss_jumps").text


def test_a_receiver_that_tells_nothing_raises_nothing() -> None:
    log = made_flight_flight()
    for name in ("lat", "lon", "vel_ned", "s_acc", "h_acc"):
        getattr(log.gnss[0], name)[:] = np.nan
    assert [a.verdict for a in gnss.gnss_checks(case(log))] == ["unknown"]


@pytest.mark.parametrize(("metres", "verdict"), [(2.8, "ok"), (3.3, "warning"), (-3.3, "warning")])
@pytest.mark.parametrize("axis", ["lat", "lon"])
def test_a_step_of_three_metres_beside_the_velocity_is_a_jump(axis: str, metres: float, verdict: str) -> None:
    log = received()
    gnss = log.gnss[0]
    moved = np.degrees(metres / 6.371e6) * (gnss.t > 50.1)
    setattr(gnss, axis, getattr(gnss, axis) + moved)
    found = quality_of(log, "gnss_jumps")
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
        assert quality_of(log, "gnss_jumps").verdict == verdict


def test_differences_of_longitude_stay_within_half_a_turn() -> None:
    found = gnss_quality._wrapped(np.array([359.9, -359.9, 10.0, 180.0]))
    np.testing.assert_allclose(found, [-0.1, 0.1, 10.0, -180.0])
