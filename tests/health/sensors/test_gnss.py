"""GNSS outages in flight, the declination that the autopilot was told, gyros at the end of a range."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from attlog import flight, segments
from attlog.flight.model import FlightLog, TimeLine
from attlog.health.onboard import declination as declination_told
from attlog.health.sensors import gnss
from attlog.health.sensors.gyro import at_limit
from attlog.segments.model import Segments
from tests.conftest import SAMPLES


@pytest.fixture(scope="module")
def flown() -> tuple[FlightLog, Segments]:
    log = flight.read(SAMPLES / "copter_steps_stabilize.bin")
    return log, segments.build(log)


def middle(found: Segments) -> float:
    (begin, end), *_ = found.spans("airborne")
    return round(0.5 * (begin + end))


def test_a_fix_all_through_the_flight_is_good(flown: tuple[FlightLog, Segments]) -> None:
    (check,) = gnss.checks(*flown)
    assert (check.name, check.verdict, check.value) == ("GNSS", "ok", 0.0)


@pytest.mark.parametrize("how", ["no fix", "no message"])
def test_an_outage_is_told_with_its_time_and_length(flown: tuple[FlightLog, Segments], how: str) -> None:
    log, found = deepcopy(flown[0]), flown[1]
    at = middle(found)
    for one in log.gnss:
        lost = (one.t >= at) & (one.t < at + 6)
        if how == "no fix":
            one.fix = np.where(lost, 1, one.fix)
        else:
            one.t, one.fix = one.t[~lost], one.fix[~lost]
    (check,) = gnss.checks(log, found)
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
    assert gnss.checks(log, found)[0].verdict == "ok"
    for stream in (*(g for g in log.gnss), log.imus[log.imu or 0].gyro):
        keep = (stream.t < at) | (stream.t > at + 20)
        stream.t = stream.t[keep]
        if hasattr(stream, "fix"):
            stream.fix = stream.fix[keep]
    assert gnss.checks(log, found)[0].verdict == "ok"


def test_the_better_of_two_receivers_counts(flown: tuple[FlightLog, Segments]) -> None:
    log, found = deepcopy(flown[0]), flown[1]
    log.gnss = [deepcopy(log.gnss[0]), log.gnss[0]]
    log.gnss[0].fix = np.where(log.gnss[0].t > middle(found), 0, log.gnss[0].fix)
    assert gnss.checks(log, found)[0].verdict == "ok"


def test_indoors_nothing_is_said(flown: tuple[FlightLog, Segments]) -> None:
    log, found = deepcopy(flown[0]), flown[1]
    for one in log.gnss:
        one.fix = np.zeros_like(one.fix)
    assert gnss.checks(log, found) == []
    assert gnss.checks(flown[0], Segments()) == []


@pytest.mark.parametrize(("name", "seconds"), [("ardupilot/copter_gps_loss.bin", 30), ("px4/px4_gnssloss.ulg", 50)])
def test_the_planted_outages_of_the_firmware_simulators_are_found(corpus: Path, name: str, seconds: float) -> None:
    log = flight.read(corpus / "sitl" / name)
    (check,) = gnss.checks(log, segments.build(log))
    assert check.verdict == "warning"
    assert check.value == pytest.approx(seconds, abs=2.0)


def told(log: FlightLog, degrees: float, **params: float) -> FlightLog:
    log = deepcopy(log)
    log.declination_param, log.declination_source = degrees, "COMPASS_DEC"
    log.params = {k: TimeLine(np.zeros(1), [v], "PARM") for k, v in params.items()}
    return log


def test_a_wrong_declination_is_found_unless_the_autopilot_looks_it_up(flown: tuple[FlightLog, Segments]) -> None:
    from attlog.reference import declination

    log = flown[0]
    model = declination.model(log)
    assert model is not None
    right = model.declination_deg
    assert [c.verdict for c in declination_told.checks(told(log, right + 3.0))] == ["ok"]
    assert [c.verdict for c in declination_told.checks(told(log, right - 10.0))] == ["warning"]
    assert [c.verdict for c in declination_told.checks(told(log, right + 20.0 - 360.0))] == ["fault"]
    for name in ("COMPASS_AUTODEC", "EKF2_DECL_TYPE", "ATT_MAG_DECL_A"):
        assert declination_told.checks(told(log, right + 20.0, **{name: 3.0})) == []
        assert declination_told.checks(told(log, right + 20.0, **{name: 2.0})) != []
    without = told(log, right + 20.0)
    without.gnss = []
    assert declination_told.checks(without) == []


def test_a_gyro_at_the_end_of_a_range_lies_flat_there() -> None:
    wave = 400.0 * np.abs(np.sin(np.linspace(0, 20, 4000)))
    for full in (125.0, 250.0):
        assert at_limit(np.minimum(wave, full)) == np.count_nonzero(wave >= full * 0.9995)
    assert at_limit(wave) == 0
    assert at_limit(wave * 250.0 / 400.0 + np.random.default_rng(0).normal(0, 0.2, 4000)) == 0
    assert at_limit(np.array([3.0, 2100.0])) == 1
    assert at_limit(np.zeros(0)) == 0


def test_several_outages_are_told_with_the_first_their_sum_and_their_number(flown: tuple[FlightLog, Segments]) -> None:
    log, found = deepcopy(flown[0]), flown[1]
    first = middle(found) - 8.0
    for one in log.gnss:
        lost = ((one.t >= first) & (one.t < first + 4)) | ((one.t >= first + 8) & (one.t < first + 14))
        one.fix = np.where(lost, 1, one.fix)
    (check,) = gnss.checks(log, found)
    assert (check.verdict, check.count) == ("warning", 2)
    assert check.t == pytest.approx(first, abs=0.21)
    assert check.value == pytest.approx(10.0, abs=0.81)
    assert f"in 2 outages, first at {check.t:.0f} s." in check.text
