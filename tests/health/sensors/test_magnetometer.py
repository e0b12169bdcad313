"""A field held against the attitude: its spread, the attitude's own alignment, and rates that are of no one moment."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, FlightLog, Mag, Stream
from attlog.health.model import Check
from attlog.health.sensors import magnetometer
from attlog.segments.model import Segments
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
    return magnetometer.against_attitude(log, Segments([], {}))[0]


def test_a_sound_compass_stands_still_in_earth_axes():
    check = against(turning(20.0))
    assert (check.verdict, check.value) == ("ok", pytest.approx(0.0, abs=0.1))


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


def test_a_spread_is_that_of_a_normal_distribution():
    angle = np.radians(np.random.default_rng(3).normal(170.0, 6.0, 20_000))
    middle, spread = magnetometer.circular(angle)
    assert middle == pytest.approx(170.0, abs=0.2)
    assert spread == pytest.approx(6.0, rel=0.03)


def test_a_dead_compass_of_a_record_with_an_imu_is_told_apart_from_the_imu():
    """RAW_IMU of MAVLink holds both: its gyro and accelerometer measure."""
    log = turning(20.0)
    log.mag = None
    log.mags[0].field.x[:] = 0.0
    for source, said in (("MAG:0", "MAG:0"), (log.imus[0].gyro.source, f"The compass of {log.imus[0].gyro.source}")):
        log.mags[0].field.source = source
        (dead, _) = magnetometer.checks(log, Segments([], {}))
        assert dead.text == f"{said}: all its values are zero."
