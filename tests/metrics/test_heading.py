"""Each row's heading error by GNSS acceleration: a number with its evidence, or what is missing."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Gnss, Imu, Stream
from attlog.metrics import heading
from attlog.metrics.metric import Answer
from attlog.segments.model import Segment
from tests.estimators.test_evidence import flown
from tests.metrics import flights


def asked(
    off_deg: float | np.ndarray = 0.0, *, window: str = "all", gnss: bool = True, flies: bool = True, **fields: object
) -> Answer:
    """The answer for the true attitude of a made-up flight, turned by this."""
    flight = flown()
    row = flights.row(flight.t, rotation.turn_about_down(flight.q, np.radians(off_deg)), **fields)
    segments = [Segment("continuous", 0, 120)] + ([Segment("airborne", 5, 115)] if flies else [])
    case = flights.case([row], segments)
    log = case.log
    gyro = Stream(flight.t, np.zeros((len(flight.t), 3)), "rad/s", "FRD", "imu")
    log.imus, log.imu = [Imu(0, gyro, Stream(flight.t, flight.acc, "m/s^2", "FRD", "imu"))], 0
    if gnss:
        n = len(flight.fixes)
        nan = np.full(n, np.nan)
        fix = np.full(n, 3)
        log.gnss = [Gnss(0, flight.fixes, "gnss", nan, nan, nan, flight.velocity, nan, nan, nan, fix)]
    return heading.GNSS_HEADING.ask(case, row, window)["gnss_heading_deg"]


def test_the_value_is_signed_with_interval_evidence_and_time() -> None:
    answer = asked(-25.0)
    assert answer.value == pytest.approx(-25.0, abs=1.0)
    assert answer.ci95 is not None
    assert answer.ci95[0] < -25.0 < answer.ci95[1]
    assert answer.n > 5
    assert answer.seconds == pytest.approx(105.0, abs=6.0)
    assert answer.unit == "deg"
    assert not answer.ranked


def test_every_30_s_in_which_the_heading_is_wrong_stands_in_the_records() -> None:
    answer = asked(np.where(flown().t > 70.0, 60.0, 0.0))
    assert answer.records
    assert all(record.t0 > 40.0 for record in answer.records)
    assert any(record.value == pytest.approx(60.0, abs=3.0) for record in answer.records)
    assert asked(0.0).records == []


def test_a_window_of_time_is_asked_for_itself() -> None:
    answer = asked(np.where(flown().t > 70.0, 60.0, 0.0), window="75:110")
    assert answer.value == pytest.approx(60.0, abs=3.0)


def test_a_vehicle_that_never_flew_is_asked_where_it_moved() -> None:
    assert asked(15.0, flies=False).value == pytest.approx(15.0, abs=1.0)


def test_a_heading_that_was_aligned_is_told_as_the_filter_gave_it() -> None:
    assert asked(0.0, heading_offset_deg=170.0).value == pytest.approx(170.0, abs=1.0)


def test_without_gnss_there_is_a_reason() -> None:
    assert asked(gnss=False).code == "no_gnss"


def test_the_north_that_was_taken_out_is_known_of_one_segment_with_a_compass() -> None:
    flight = flown()
    row = flights.row(flight.t, flight.q, heading_offset_deg=40.0)
    row.uses_mag = True
    row.segment = np.full(len(row.t), 3)
    assert heading.own_north(row) == 40.0
    row.segment[-1] = 4
    assert heading.own_north(row) is None
    row.heading_offset_deg = None
    assert heading.own_north(row) == 0.0
