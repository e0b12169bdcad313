"""Which samples of a compass count: in the air, on the ground, with which power."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.flight.model import Mag, Stream, TimeLine
from attlog.health.assessments.compass import samples as gathering
from attlog.health.assessments.model import HealthCase, MotionAttitude
from attlog.segments.model import Segment, Segments
from tests.health.assessments.compass.made import EARTH, empty_log


class Model:
    """The earth's field."""

    ned_t = tuple(1e-6 * EARTH)


def flown(*more: Segment) -> Segments:
    return Segments([Segment("airborne", 30.0, 60.0), Segment("airborne", 80.0, 100.0), *more])


def test_flight_ends_a_second_early_and_at_the_first_crash() -> None:
    assert gathering.air_spans(flown()) == [(31.0, 59.0), (81.0, 99.0)]
    assert gathering.air_spans(flown(Segment("impact", 90.0, 101.0))) == [(31.0, 59.0), (81.0, 89.0)]
    assert gathering.air_spans(flown(Segment("loss_of_control", 50.0, 55.0))) == [(31.0, 49.0)]


def test_the_ground_is_20_s_before_and_after_and_never_a_wreck() -> None:
    assert gathering.ground_spans(flown()) == ([(10.0, 30.0)], [(100.0, 120.0)])
    assert gathering.ground_spans(flown(Segment("impact", 99.0, 101.0)))[1] == []
    assert gathering.ground_spans(Segments()) == ([], [])


def test_power_far_from_any_record_is_unknown() -> None:
    drive = Stream(np.array([0.0, 1.0, 20.0]), np.array([[2.0], [4.0], [6.0]]), "A", "", "BAT")
    at = gathering.power_at(drive, np.array([0.5, 2.0, 10.0, 20.0, 30.0]))
    assert at[[0, 1, 3]] == pytest.approx([3.0, 4.0 + 2.0 / 19.0, 6.0])
    assert np.isnan(at[[2, 4]]).all()
    assert np.isnan(gathering.power_at(None, np.zeros(2))).all()


def test_a_current_of_zero_gives_way_to_the_throttle() -> None:
    t = np.arange(100.0)
    throttle = Stream(t, np.full((100, 1), 0.5), "1", "", "CTUN")
    log = replace(empty_log(), throttle=throttle, battery=Stream(t, np.zeros((100, 2)), "V", "", "BAT"))
    assert gathering.drive_of(log) == ("throttle", throttle)
    log.battery = Stream(t, np.full((100, 2), 12.0), "V", "", "BAT")
    assert gathering.drive_of(log)[0] == "current"


def gathered(
    sigma_deg: float = 1.0, throttle_on_ground: float = 0.0, tilt: float = 0.0
) -> gathering.FieldSamples | None:
    t = np.arange(0.0, 140.0, 0.1)
    air = (t > 30.0) & (t < 100.0)
    power = np.where(air, 0.5, throttle_on_ground)
    log = replace(empty_log(), throttle=Stream(t, power[:, None], "1", "", "CTUN"))
    log.armed = TimeLine(np.array([0.0, 25.0]), [False, True], "ARM")
    q = np.tile([np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0], (len(t), 1))
    sigma = np.radians(np.full(len(t), sigma_deg))
    motion = MotionAttitude(t, q, np.zeros(len(t), np.int64), sigma, sigma, {})
    case = HealthCase(log, flown(), None, [], lambda: motion)
    mag = Mag(0, Stream(t, np.tile(1e-6 * EARTH, (len(t), 1)), "T", "FRD", "MAG.0"))
    mag.field.x[500] = np.nan
    return gathering.gathered(case, mag, motion, Model())  # type: ignore[arg-type]


def test_samples_lie_in_the_air_or_on_the_ground_with_motors_off() -> None:
    found = gathered()
    assert found is not None
    assert found.seconds == pytest.approx(46.0, rel=0.01)
    assert found.error == pytest.approx(np.zeros((len(found.t), 3)), abs=1e-9)
    assert np.all(found.t[found.before] <= 30.0)
    assert np.all(found.t[found.after] >= 100.0)
    assert (found.before.any(), found.after.any()) == (True, True)
    assert found.hover == pytest.approx(0.5)


def test_idling_above_a_quarter_of_the_power_is_no_ground() -> None:
    found = gathered(throttle_on_ground=0.2)
    assert found is not None
    assert not found.before.any()
    assert not found.after.any()


def test_an_unsure_heading_and_a_vehicle_on_its_back_give_no_samples() -> None:
    assert gathered(sigma_deg=6.0) is None
    assert gathered(tilt=np.pi) is None
