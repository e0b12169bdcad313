"""Heights of GNSS and barometer, and gravity at rest before and after a flight, on made flights with known faults."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import FlightLog, Stream
from attlog.health import consistency
from attlog.health.check import Check, HealthCase
from attlog.segments.model import Segment, Segments
from tests.health.made_flight import case, flight

G = 9.80665


# --- height ------------------------------------------------------------------------------------------------------


def heights(*, gnss_m: float = 0.0, baro_m: float = 0.0, velocity: bool = True, accuracy_m: float = 0.5) -> Check:
    """A climb of 20 m and back, with an error of GNSS or barometer from 40 to 60 s."""
    log = flight()
    receiver = log.gnss[0]

    def height(t: np.ndarray) -> np.ndarray:
        return 20.0 * np.sin(np.pi * t / 100.0)

    def error(t: np.ndarray) -> np.ndarray:
        return np.interp(t, [40.0, 45.0, 55.0, 60.0], [0.0, 1.0, 1.0, 0.0])

    t = np.arange(0.0, 100.0, 0.1)
    receiver.alt = 500.0 + height(receiver.t) + gnss_m * error(receiver.t)
    receiver.v_acc = np.full(len(receiver.t), accuracy_m)
    down = -20.0 * np.pi / 100.0 * np.cos(np.pi * receiver.t / 100.0)
    receiver.vel_ned[:, 2] = down if velocity else np.nan
    log.baro = [Stream(t, (height(t) + baro_m * error(t))[:, None], "m", "", "BARO")]
    (check,) = consistency.height_checks(case(log))
    return check


@pytest.mark.parametrize(
    ("planted", "about"),
    [
        ({"gnss_m": 50.0}, "GNSS height"),
        ({"gnss_m": -50.0}, "GNSS height"),
        ({"baro_m": 50.0}, "barometer"),
        ({"baro_m": 50.0, "velocity": False}, ""),
    ],
)
def test_a_height_that_parts_from_the_other_is_told_by_the_vertical_speed(
    planted: dict[str, float], about: str
) -> None:
    found = heights(**planted)  # type: ignore[arg-type]
    assert (found.verdict, found.about) == ("warning", about)
    assert found.value == pytest.approx(50.0, abs=1.0)
    assert found.t == pytest.approx(42.0, abs=1.0)


def test_a_height_that_steps_errs_also_without_a_vertical_speed() -> None:
    log = flight()
    t = np.arange(0.0, 100.0, 0.1)
    log.gnss[0].vel_ned[:, 2] = np.nan
    log.baro = [Stream(t, 60.0 * ((t > 50.0) & (t < 54.0))[:, None], "m", "", "BARO")]
    (found,) = consistency.height_checks(case(log))
    assert (found.verdict, found.about, found.kind) == ("warning", "barometer", "barometer")


@pytest.mark.parametrize(
    ("planted", "verdict"),
    [({"gnss_m": 12.0}, "ok"), ({"gnss_m": 20.0}, "warning"), ({"gnss_m": 20.0, "accuracy_m": 5.0}, "ok")],
)
def test_what_barometers_and_receivers_drift_is_allowed(planted: dict[str, float], verdict: str) -> None:
    assert heights(**planted).verdict == verdict  # type: ignore[arg-type]


def test_a_barometer_that_pauses_says_nothing_of_the_height_then() -> None:
    log = flight()
    receiver, t = log.gnss[0], np.arange(0.0, 100.0, 0.1)
    receiver.alt = 500.0 + 60.0 * np.sin(np.pi * receiver.t / 100.0)
    log.baro = [Stream(t, 60.0 * np.sin(np.pi * t / 100.0)[:, None], "m", "", "BARO")]
    heard = (t < 20.0) | (t > 80.0)
    log.baro[0].t, log.baro[0].x = t[heard], log.baro[0].x[heard]
    (found,) = consistency.height_checks(case(log))
    assert found.verdict == "ok"


@pytest.mark.parametrize(("share", "verdict"), [(0.08, "ok"), (0.2, "warning")])
def test_warm_air_shortens_the_climb_that_a_barometer_shows(share: float, verdict: str) -> None:
    log = flight()
    receiver, t = log.gnss[0], np.arange(0.0, 100.0, 0.1)
    receiver.alt = 500.0 + 400.0 * np.sin(np.pi * receiver.t / 100.0)
    log.baro = [Stream(t, (1.0 - share) * 400.0 * np.sin(np.pi * t / 100.0)[:, None], "m", "", "BARO")]
    (found,) = consistency.height_checks(case(log))
    assert found.verdict == verdict


# --- gravity -----------------------------------------------------------------------------------------------------


def rested(
    *,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    bias_dps: float = 0.0,
    ends_deg: float = 0.0,
    shaking_dps: float = 0.0,
    every: int = 1,
    seed: int = 1,
) -> list[Check]:
    """Rest to 10 s, a flight that ends tilted, rest from 40 s; offset and bias begin at 25 s.

    In flight the rate shakes at random; of the samples ``every`` one is logged.
    """
    t = np.arange(0.0, 50.0, 0.01)
    roll = np.radians(
        np.interp(t, [12.0, 38.0], [0.0, ends_deg]) + 15.0 * np.sin(t - 12.0) * ((t > 12.0) & (t < 12.0 + 8.0 * np.pi))
    )
    rate = np.column_stack([np.gradient(roll, t), np.zeros((len(t), 2))])
    force = rotation.rotate_inverse(rotation.from_euler(roll, 0.0 * t, 0.0 * t), np.array([0.0, 0.0, -G]))
    late = (t > 25.0)[:, None]
    log: FlightLog = flight()
    imu = log.imus[0]
    moving = ((t > 25.0) & (t < 40.0))[:, None]
    shaking = np.radians(shaking_dps) * np.random.default_rng(seed).standard_normal((len(t), 3))
    rate = rate + np.radians([0.3, -0.2, 0.1]) + moving * np.radians([0.0, bias_dps, 0.0])
    rate = rate + shaking * ((t > 11.0) & (t < 39.0))[:, None]
    acc = np.asarray(force) + late * np.array(offset)
    imu.gyro = Stream(t[::every], rate[::every], "rad/s", "FRD", "I")
    imu.acc = Stream(t[::every], acc[::every], "m/s^2", "FRD", "I")
    spans = [Segment("rest.long", 0.0, 10.0), Segment("airborne", 11.0, 39.0), Segment("rest.long", 40.0, 50.0)]
    return consistency.gravity_kept_checks(HealthCase(log, Segments(spans), None, lambda: None))


def test_gravity_turned_by_the_gyro_is_that_of_the_rest_after_a_sound_flight() -> None:
    (found,) = rested(ends_deg=20.0)
    assert found.verdict == "ok"
    assert found.value == pytest.approx(0.0, abs=0.3)


def test_an_offset_that_began_in_flight_is_the_accelerometers() -> None:
    (found,) = rested(offset=(2.0, 0.0, 0.0))
    assert (found.verdict, found.about, found.kind) == ("warning", "accelerometer", "")
    assert found.value == pytest.approx(np.degrees(np.arctan(2.0 / G)), abs=0.5)
    assert "+2.00 m/s^2 along x" in found.evidence[0]


def test_a_gyro_whose_bias_in_flight_is_another_than_at_rest_is_named() -> None:
    (found,) = rested(bias_dps=1.5)
    assert (found.verdict, found.about, found.kind) == ("warning", "gyro", "gyro_bias")
    assert found.value == pytest.approx(22.5, abs=1.5)


def test_a_gyro_logged_too_slowly_for_its_motion_contradicts_no_gravity() -> None:
    """25 Hz of a rate that vibrates by 12 deg/s: 0.04 s sqrt(700 samples) 12 deg/s = 13 deg an axis."""
    found = [rested(shaking_dps=12.0, every=4, seed=seed)[0] for seed in range(12)]
    assert {check.verdict for check in found} <= {"ok", "unknown"}
    assert all("samples are too few" in check.text for check in found if check.verdict == "unknown")
    assert rested(shaking_dps=12.0, every=4, bias_dps=9.0)[0].verdict == "warning"


def test_on_ground_of_another_slope_neither_is_accused() -> None:
    (found,) = rested(bias_dps=1.5, ends_deg=20.0)
    assert (found.verdict, found.about) == ("warning", "")


def test_without_two_rests_it_is_unknown() -> None:
    spans = Segments([Segment("airborne", 11.0, 39.0), Segment("rest.long", 40.0, 50.0)])
    (found,) = consistency.gravity_kept_checks(HealthCase(flight(), spans, None, lambda: None))
    assert found.verdict == "unknown"


# --- events ------------------------------------------------------------------------------------------------------


def test_sensors_that_failed_in_flight_are_events_and_those_on_the_ground_are_none() -> None:
    step = Check("gyro_bias_step", "fault", "Steps.", 3.0, "deg/s", t=30.0)
    early, other = (
        Check("gyro_bias_step", "fault", "Steps.", 3.0, "deg/s", t=5.0),
        Check("trim", "fault", "Off.", t=30.0),
    )
    spans = Segments([Segment("airborne", 11.0, 39.0)])
    (event,) = consistency.with_sensor_events([], [step, early, other], spans)
    assert (event.kind, event.t, event.text) == ("sensor_fault", 30.0, "Gyro bias stepped by 3.0°/s at 30 s.")
