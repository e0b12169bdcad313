"""A field held against the attitude: its spread, the attitude's own alignment, and rates that are of no one moment."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import flight, segments
from attlog.core import rotation
from attlog.flight.model import Attitude, Firmware, FlightLog, Mag, Stream
from attlog.health import compass as magnetometer
from attlog.health import compass_power
from attlog.health.check import Check, HealthCase
from attlog.segments.model import Segment, Segments
from tests.conftest import SAMPLES
from tests.flight.made_log import with_fields
from tests.segments.flights import imu_log

SECONDS = 60.0


def turning(rate_hz: float, off_deg: np.ndarray | float = 0.0, dps: float = 40.0) -> FlightLog:
    """A level vehicle that swings in yaw; its attitude's heading is off by some degrees at each sample."""
    t = np.arange(0.0, SECONDS, 1.0 / rate_hz)
    yaw = np.radians(dps) / 0.5 * np.sin(0.5 * t)
    q = rotation.from_euler(0.0 * t, 0.0 * t, yaw)
    said = rotation.from_euler(0.0 * t, 0.0 * t, yaw + np.radians(off_deg))
    field = 1e-6 * rotation.rotate_inverse(q, np.array([20.0, 0.0, 40.0]))
    ti = np.arange(0.0, SECONDS, 0.01)
    log = imu_log(ti, np.zeros((len(ti), 3)), np.tile([0.0, 0.0, -9.81], (len(ti), 1)))
    log.attitudes, log.onboard = {"ATT": Attitude(t, said, "ATT")}, "ATT"
    log.mags, log.mag = [Mag(0, Stream(t, field, "T", "body FRD", "MAG:0"))], 0
    return log


def against(log: FlightLog) -> Check:
    return magnetometer.field_direction(log, Segments([], {}))[0]


def test_an_attitude_that_is_still_finding_its_heading_accuses_no_compass():
    t = np.arange(0.0, SECONDS, 0.05)
    assert against(turning(20.0, np.where(t < 4.9, 92.0, 0.0))).verdict == "ok"


def test_a_fault_of_a_fifth_of_the_flight_is_seen_and_a_blow_of_a_second_is_not():
    t = np.arange(0.0, SECONDS, 0.05)
    assert against(turning(20.0, np.where((t > 30.0) & (t < 42.0), 40.0, 0.0))).verdict == "warning"
    assert against(turning(20.0, np.where((t > 30.0) & (t < 31.0), 40.0, 0.0))).verdict == "ok"


def test_slow_samples_count_only_while_it_turns_slowly_and_for_less():
    def off(rate_hz: float) -> np.ndarray:
        return 9.0 * np.sin(0.3 * np.arange(0.0, SECONDS, 1.0 / rate_hz))

    assert against(turning(20.0, off(20.0), dps=4.0)).verdict == "warning"
    assert against(turning(2.0, off(2.0), dps=4.0)).verdict == "ok"
    assert against(turning(2.0, off(2.0), dps=400.0)).verdict == "unknown"


def test_a_dead_compass_of_a_record_with_an_imu_is_told_apart_from_the_imu():
    """RAW_IMU of MAVLink holds both: its gyro and accelerometer measure."""
    log = turning(20.0)
    log.mag = None
    log.mags[0].field.x[:] = 0.0
    for source, said in (("MAG:0", "MAG:0"), (log.imus[0].gyro.source, f"The compass of {log.imus[0].gyro.source}")):
        log.mags[0].field.source = source
        (dead, _) = magnetometer.field_checks(HealthCase(log, Segments([], {})))
        assert dead.text == f"{said}: all its values are zero."


# The direction of the field by the attitude: from its alignment on, without late samples, less the declination.


def direction(log: FlightLog) -> Check:
    found = magnetometer.field_checks(HealthCase(log, segments.build(log)))
    return next(c for c in found if c.question == "field_against_attitude")


def px4() -> FlightLog:
    log = deepcopy(flight.read(SAMPLES / "px4_steps.ulg"))
    log.truth = None
    return log


def turn(log: FlightLog, use: np.ndarray, deg: float) -> None:
    attitude = log.onboard_attitude
    assert attitude is not None
    q = np.tile(rotation.from_euler(0.0, 0.0, np.radians(deg)), (int(use.sum()), 1))
    attitude.q[use] = rotation.multiply(q, attitude.q[use])


def test_an_attitude_that_turns_away_in_flight_is_told_with_its_spread() -> None:
    """Half of the flight by 40 deg off the other half: 20 deg either way of the mean, by 3.29 sigmas 12 at least."""
    log = px4()
    a, b = segments.build(log).spans("airborne")[0]
    attitude = log.onboard_attitude
    assert attitude is not None
    turn(log, attitude.t > 0.5 * (a + b), 40.0)
    assert direction(log).verdict == "warning"
    assert direction(log).value > 12.0


def test_the_spread_of_a_normal_distribution_is_its_standard_deviation() -> None:
    angle = np.radians(np.random.default_rng(1).normal(-170.0, 6.0, 20_000))
    mean, spread = magnetometer.circular_mean(angle)
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
    found = magnetometer.field_checks(HealthCase(log, segments.build(log)))
    assert next(c for c in found if c.question == "declination").verdict == verdict


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


# Strength of the field and what follows the motors: limits from both sides, closed forms and numpy's regression.

T = np.arange(0.0, 60.0, 0.1)
DIRECTION = np.array([0.36, -0.48, 0.8])
FLOWN = Segments([Segment("continuous", 0, 60), Segment("armed", 0, 60), Segment("airborne", 5, 55)])


def compass(size_ut: Any) -> Mag:
    return Mag(0, Stream(T, 1e-6 * (size_ut + 0.0 * T)[:, None] * DIRECTION, "T", "FRD", "MAG:0"))


def log(mag: Mag, **more: Any) -> FlightLog:
    made = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    made.mags, made.mag = [mag], 0
    return with_fields(made, **more)


@pytest.mark.parametrize(
    ("size", "model", "varies", "verdict"),
    [
        (14.9, None, 0.0, "fault"),
        (15.1, None, 0.0, "ok"),
        (89.9, None, 0.0, "ok"),
        (90.1, None, 0.0, "fault"),
        (59.9, 50.0, 0.0, "ok"),
        (60.1, 50.0, 0.0, "warning"),
        (40.1, 50.0, 0.0, "ok"),
        (39.9, 50.0, 0.0, "warning"),
        (50.0, 50.0, 0.099, "ok"),
        (50.0, 50.0, 0.101, "warning"),
        (95.0, 90.0, 0.0, "fault"),
    ],
)
def test_a_field_has_its_strength_within_a_fifth_of_the_model_and_varies_by_a_tenth(
    monkeypatch: pytest.MonkeyPatch, size: float, model: float | None, varies: float, verdict: str
) -> None:
    known = None if model is None else SimpleNamespace(strength_t=1e-6 * model)
    monkeypatch.setattr(magnetometer.alignment, "earth_field", lambda log: known)
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * T / 5.0 + 0.01)  # ten of these are flown
    one = compass(size * (1.0 + varies * wave))
    check = magnetometer.field_strength(log(one), FLOWN)
    assert check.verdict == verdict
    assert f"varying by {100 * varies:.0f} %" in check.text
    one.calibrated = False
    assert magnetometer.field_strength(log(one), FLOWN).verdict == ("warning" if verdict == "ok" else verdict)


def test_a_turn_is_the_fastest_of_the_intervals_around_and_unknown_beyond_the_attitude() -> None:
    t = np.arange(0.0, 6.0)
    angle = np.radians([0.0, 10.0, 10.0, 10.0, 40.0, 40.0])
    q = np.column_stack([np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)])
    found = magnetometer.turning_dps(t, q, np.array([-0.1, 0.5, 1.5, 2.5, 4.5, 5.1]))
    np.testing.assert_allclose(found, [np.inf, 10.0, 10.0, 30.0, 30.0, np.inf])


THROTTLE = 0.5 + 0.3 * np.sin(0.5 * T)


def drive(x: Any, t: np.ndarray = T) -> Stream:
    return Stream(t, np.asarray(x)[:, None], "1", "", "CTUN")


def test_a_drive_that_hardly_varies_a_short_time_and_few_samples_tell_nothing() -> None:
    field, use = compass(40.0 + 20.0 * THROTTLE).field, np.ones(len(T), bool)
    reach = np.ptp(np.quantile(THROTTLE, [0.05, 0.95]))
    assert compass_power.follow_drive(field, drive(THROTTLE), use, 0.99 * reach) is not None
    assert compass_power.follow_drive(field, drive(THROTTLE), use, 1.01 * reach) is None
    assert compass_power.follow_drive(field, drive(THROTTLE), T < 9.95, 0.01) is None
    assert compass_power.follow_drive(field, drive(THROTTLE), T < 10.05, 0.01) is not None
    assert compass_power.follow_drive(field, drive(THROTTLE), use & (np.arange(len(T)) % 13 == 0), 0.1) is None
    assert compass_power.follow_drive(field, drive(THROTTLE, T + 100.0), use, 0.1) is None


@pytest.mark.parametrize(
    ("slope", "verdict"), [(4.5, "ok"), (7.0, "warning"), (18.0, "fault"), (-7.0, "warning"), (-18.0, "fault")]
)
def test_a_field_that_goes_with_the_throttle_by_an_eighth_or_a_third_is_bent(slope: float, verdict: str) -> None:
    """Over 0.59 of throttle: 2.6, 4.1 and 10.6 of some 33 uT; offsets cannot explain what never turns."""
    one = log(compass(33.0 + slope * (THROTTLE - 0.5)), throttle=drive(THROTTLE))
    check = compass_power.interference_check(one, FLOWN, one.mags[one.mag])
    low, high = (33.0 + slope * (q - 0.5) for q in np.quantile(THROTTLE, [0.05, 0.95]))
    assert check.verdict == verdict
    assert check.value == pytest.approx(100.0 * abs(high - low) / min(low, high), abs=0.7)


@pytest.mark.parametrize(
    ("air", "swing", "verdict"),
    [(36.0, 0.5, "unknown"), (27.0, 0.5, "warning"), (20.0, 0.5, "fault"), (27.0, 9.0, "unknown")],
)
def test_without_a_drive_the_field_in_flight_is_compared_with_the_ground(
    air: float, swing: float, verdict: str
) -> None:
    """33 uT on the ground; a size that swings with the heading past that value is an offset."""
    one = log(compass(np.where(T < 10.0, 33.0, air + swing * np.sin(T))))
    flown = Segments([Segment("armed", 8, 60), Segment("airborne", 10, 58)])
    check = compass_power.interference_check(one, flown, one.mags[one.mag])
    assert check.verdict == verdict
    if verdict != "unknown":
        assert check.value == pytest.approx(100.0 * (33.0 - air) / air, abs=1.0)


def test_offsets_explain_a_size_that_changes_with_the_direction_alone() -> None:
    """The vehicle turns with the throttle: an offset of 9 uT makes the size follow, a current of its own does not."""
    angle = 2.0 * (THROTTLE - 0.5) / 0.3
    earth = 40.0 * np.column_stack([0.8 * np.cos(angle), -0.8 * np.sin(angle), 0.6 + 0.0 * T])
    noise = 0.3 * np.random.default_rng(2).normal(size=earth.shape)
    use = np.ones(len(T), bool)
    moved = Stream(T, 1e-6 * (earth + noise + np.array([9.0, 2.0, 0.0])), "T", "FRD", "MAG:0")
    assert compass_power.offsets_explain(moved, drive(THROTTLE), use)
    other = np.sin(0.17 * T)
    free = 40.0 * np.column_stack([0.8 * np.cos(other), -0.8 * np.sin(other), 0.6 + 0.0 * T])
    bent = Stream(T, 1e-6 * (free + noise + np.outer(20.0 * THROTTLE, [1.0, 0.0, 0.0])), "T", "FRD", "MAG:0")
    assert not compass_power.offsets_explain(bent, drive(THROTTLE), use)
    still = compass(33.0 + 7.0 * THROTTLE).field
    assert not compass_power.offsets_explain(still, drive(THROTTLE), use)
    assert not compass_power.offsets_explain(moved, drive(THROTTLE), use & (T < 4.9))
