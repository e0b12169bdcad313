"""The direction of the field by the attitude: from its alignment on, without late samples, less the declination."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from attlog import flight, segments
from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.health.model import Check
from attlog.health.sensors import magnetometer
from tests.conftest import SAMPLES


def direction(log: FlightLog) -> Check:
    found = magnetometer.checks(log, segments.build(log))
    return next(c for c in found if c.name == "field against attitude")


def px4() -> FlightLog:
    log = deepcopy(flight.read(SAMPLES / "px4_steps.ulg"))
    log.truth = None
    return log


def turn(log: FlightLog, use: np.ndarray, deg: float) -> None:
    attitude = log.onboard_attitude
    assert attitude is not None
    q = np.tile(rotation.from_euler(0.0, 0.0, np.radians(deg)), (int(use.sum()), 1))
    attitude.q[use] = rotation.multiply(q, attitude.q[use])


def test_a_heading_that_is_wrong_before_its_alignment_accuses_no_compass() -> None:
    log = px4()
    attitude = log.onboard_attitude
    assert attitude is not None
    before = direction(log)
    turn(log, attitude.t < attitude.t[0] + 4.5, -70.0)
    assert direction(log).value == pytest.approx(before.value, abs=0.1)


def test_an_attitude_that_turns_away_in_flight_is_told_with_its_spread() -> None:
    """Half of the flight by 40 deg off the other half: 20 deg either way of the mean, by 3.29 sigmas 12 at least."""
    log = px4()
    a, b = segments.build(log).spans("airborne")[0]
    attitude = log.onboard_attitude
    assert attitude is not None
    turn(log, attitude.t > 0.5 * (a + b), 40.0)
    assert direction(log).verdict == "warning"
    assert direction(log).value > 12.0


def test_a_few_samples_elsewhere_do_not_spread_the_field() -> None:
    angle = np.radians(np.concatenate([np.linspace(9.0, 11.0, 96), [100.0, 120.0, -90.0, -100.0]]))
    mean, spread = magnetometer.circular(angle)
    assert mean == pytest.approx(10.0, abs=3.0)
    assert spread < 2.0


def test_the_spread_of_a_normal_distribution_is_its_standard_deviation() -> None:
    angle = np.radians(np.random.default_rng(1).normal(-170.0, 6.0, 20_000))
    mean, spread = magnetometer.circular(angle)
    assert mean == pytest.approx(-170.0, abs=0.2)
    assert spread == pytest.approx(6.0, rel=0.03)


def test_the_declination_is_taken_off_before_a_field_lies() -> None:
    """Seattle: 15 deg; the flight's compass points to magnetic north."""
    assert "deg from vehicle_attitude's north, less the declination of 15." in direction(px4()).text
    lies = float(direction(px4()).text.split("lies ")[1].split(" deg")[0])
    assert abs(lies) < 4.0


@pytest.mark.parametrize(("every", "verdict"), [(1, "warning"), (10, "ok")])
def test_a_slow_field_bears_twice_the_declination(every: int, verdict: str) -> None:
    """The same heading, 6 deg off its compass, with the field at its own rate and at a tenth of it."""
    log = px4()
    attitude, field = log.onboard_attitude, log.mags[log.mag or 0].field
    assert attitude is not None
    lies = float(direction(log).text.split("lies ")[1].split(" deg")[0])
    turn(log, np.ones(len(attitude.t), bool), 6.0 - lies)
    field.t, field.x = field.t[::every], field.x[::every]
    field.t_sample = None if field.t_sample is None else field.t_sample[::every]
    found = magnetometer.checks(log, segments.build(log))
    assert next(c for c in found if c.name == "declination").verdict == verdict


def test_a_field_that_is_late_in_fast_turns_accuses_no_compass() -> None:
    """Turns about down at 0 and at 200 deg/s by halves of 2 s; the field is of 60 ms before: 12 deg off in the fast."""
    log = px4()
    a, b = segments.build(log).spans("airborne")[0]
    t = np.arange(a, b, 0.01)
    heading = np.cumsum(np.where(t % 4.0 < 2.0, 0.0, np.radians(200.0))) * 0.01
    q = rotation.from_euler(np.zeros(len(t)), np.zeros(len(t)), heading)
    attitude, field = log.onboard_attitude, log.mags[log.mag or 0].field
    assert attitude is not None
    attitude.t, attitude.q, attitude.t_sample, attitude.resets = t, q, None, np.zeros(0, np.int64)
    stamps = np.arange(a, b, 0.1)
    field.t, field.t_sample = stamps, None
    late = rotation.slerp(t, q, np.maximum(stamps - 0.06, a))
    field.x = rotation.rotate_inverse(late, np.array([22e-6, 0.0, 43e-6]))
    found = direction(log)
    assert found.verdict == "ok"
    assert found.value == pytest.approx(0.0, abs=0.5)
