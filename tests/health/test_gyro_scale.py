"""Scale of a gyro against what it is not made of, and clocks that feign one: made turns of known scale."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Array, Attitude, Firmware, FlightLog, Gnss, Imu, Mag, Stream
from attlog.health.check import Check, HealthCase
from attlog.health.findings import findings
from attlog.health.gyro_scale import ScaleEvidence, Turn, scale_check, scale_checks
from attlog.health.timing import ClockRate, clock_check, utc_rate
from attlog.segments import Segment, Segments

SECONDS, HZ = 90.0, 50.0
EARTH_T = 1e-6 * np.array([20.0, 2.0, 44.0])
IRON_T = 1e-6 * np.array([3.0, -2.0, 1.0])


def turns(t: Array) -> tuple[Array, Array]:
    """Attitude and body rates of a vehicle that turns by 400 deg and back while it sways by 8 deg."""
    yaw, roll = np.radians(200.0) * (1.0 - np.cos(2.0 * np.pi * t / 30.0)), np.radians(8.0) * np.sin(1.3 * t)
    q = rotation.from_euler(roll, np.radians(6.0) * np.sin(0.9 * t), yaw)
    ahead = rotation.from_euler(
        np.radians(8.0) * np.sin(1.3 * (t + 1e-4)),
        np.radians(6.0) * np.sin(0.9 * (t + 1e-4)),
        np.radians(200.0) * (1.0 - np.cos(2.0 * np.pi * (t + 1e-4) / 30.0)),
    )
    return q, rotation.relative_rotvecs(q, ahead) / 1e-4


def made_log(scale: float = 1.0, late_s: float = 0.0, units: int = 1, compasses: int = 1) -> FlightLog:
    """A flight whose onboard attitude integrates its gyro, which reads ``scale`` times the turn about z."""
    t = np.arange(0.0, SECONDS, 1.0 / HZ)
    rng = np.random.default_rng(5)
    q, rate = turns(t)
    wrong = rate * [1.0, 1.0, scale]
    own = rotation.to_euler(q)
    onboard = rotation.from_euler(own[:, 0], own[:, 1], scale * np.unwrap(own[:, 2]))
    force = rng.normal(size=(len(t), 3))
    imus = [
        Imu(
            k,
            Stream(
                t + late_s, (wrong if k == 0 else rate) + 2e-3 * rng.normal(size=rate.shape), "rad/s", "FRD", f"IMU:{k}"
            ),
            Stream(t, force, "m/s^2", "FRD", f"IMU:{k}"),
        )
        for k in range(units)
    ]
    at = t[::5]
    field = rotation.rotate_inverse(q[::5], EARTH_T) + IRON_T
    mags = [
        Mag(k, Stream(at, field + 2e-7 * rng.normal(size=field.shape), "T", "FRD", f"MAG:{k}"))
        for k in range(compasses)
    ]
    log = FlightLog(Path("made.bin"), "made", 0, 0, Firmware("made"), "quadrotor", imus=imus, imu=0, mags=mags)
    log.mag = 0 if mags else None
    log.attitudes, log.onboard, log.seconds = {"ATT": Attitude(t, onboard, "ATT")}, "ATT", SECONDS
    return log


def checked(log: FlightLog) -> dict[str, Check]:
    segments = Segments([Segment("continuous", 0.0, SECONDS), Segment("airborne", 2.0, SECONDS - 2.0)])
    return {check.question: check for check in scale_checks(HealthCase(log, segments))}


@pytest.mark.parametrize("scale", [0.95, 0.97, 1.0, 1.03, 1.05])
def test_a_compass_shows_the_scale_that_the_onboard_attitude_hides(scale: float) -> None:
    check = checked(made_log(scale))["gyro_scale"]
    assert check.verdict == ("ok" if scale == 1.0 else "fault")
    assert check.ci95 is not None
    assert check.ci95[0] < 100.0 * (scale - 1.0) < check.ci95[1]
    assert ("too much about z" in check.text, "too little about z" in check.text) == (scale > 1.0, scale < 1.0)


@pytest.mark.parametrize("late_s", [-0.015, 0.015])
def test_a_delay_is_no_scale(late_s: float) -> None:
    assert checked(made_log(late_s=late_s))["gyro_scale"].verdict == "ok"


def test_without_a_compass_the_attitude_made_of_the_gyro_judges_nothing() -> None:
    check = checked(made_log(1.05, compasses=0))["gyro_scale"]
    assert (check.verdict, check.action) == ("unknown", "Turn by 360 deg and back at 30 deg/s.")


def test_a_vehicle_that_does_not_turn_round_shows_no_scale() -> None:
    log = made_log(1.05)
    for stream in (log.imus[0].gyro, log.mags[0].field):
        use = stream.t < 6.0
        stream.t, stream.x = stream.t[use], stream.x[use]
    assert checked(log)["gyro_scale"].verdict == "unknown"


def test_one_sign_replaces_no_unit_and_two_do() -> None:
    assert "replace" not in checked(made_log(1.05))["gyro_scale"].action
    assert "replace" in checked(made_log(1.05, units=2))["gyro_scale"].action
    assert "Replace this" in checked(made_log(1.05, compasses=2))["gyro_scale"].action


def test_a_field_that_leaves_an_attitude_of_a_wrong_gyro_calibrates_no_compass() -> None:
    log = made_log(1.05)
    leaves = Check("field_against_attitude", "warning", "The field's north varies by 6 deg.", sensor="MAG:0")
    found = findings(log, [checked(log)["gyro_scale"], leaves])
    assert [f.kind for f in found if f.is_trouble] == ["gyro_scale"]
    assert [f.kind for f in findings(made_log(), [leaves])] == ["compass"]


# Rules, on made evidence.

GYRO = Imu(
    0, Stream(np.zeros(0), np.zeros((0, 3)), "rad/s", "FRD", "IMU"), Stream(np.zeros(0), np.zeros((0, 3)), "", "", "")
)


def turn(share: float, by: str = "MAG", sigma: float = 0.008) -> Turn:
    return Turn(2, share, sigma, by, 60.0)


def judged(**known: object) -> Check:
    made = ScaleEvidence([], [], [], [])
    return scale_check(GYRO, made._replace(**known))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("known", "verdict"),
    [
        ({"field": [turn(-0.05)]}, "fault"),
        ({"field": [turn(-0.05), turn(-0.04, "MAG2")]}, "fault"),
        ({"field": [turn(-0.05), turn(-0.02, "MAG2")]}, "unknown"),
        ({"field": [turn(0.005), turn(-0.03, "MAG2")]}, "unknown"),
        ({"field": [turn(-0.05)], "units": [turn(0.005, "IMU2")]}, "unknown"),
        ({"field": [turn(-0.05)], "units": [turn(-0.04, "IMU2")]}, "fault"),
        ({"field": [turn(-0.05)], "loop": ClockRate(0.945, 60.0, "", 40.0)}, "unknown"),
        ({"field": [turn(-0.05)], "utc": ClockRate(1.0833, 100.0, "GPS")}, "unknown"),
        ({"truth": [turn(-0.05)], "field": [turn(0.0)]}, "fault"),
        ({"truth": [turn(0.0)], "field": [turn(-0.05)]}, "ok"),
        ({"truth": [turn(0.0, sigma=0.05)]}, "unknown"),
        ({"truth": [turn(0.0)._replace(axis=0)], "field": [turn(-0.05)], "units": [turn(0.0, "IMU2")]}, "unknown"),
        ({"onboard": [turn(-0.07, "ATT")]}, "unknown"),
        ({"field": [turn(-0.023, sigma=0.01)]}, "ok"),
    ],
)
def test_only_truth_and_compasses_accuse_a_gyro_where_no_clock_and_no_unit_contradicts(
    known: dict[str, object], verdict: str
) -> None:
    assert judged(**known).verdict == verdict


def test_an_onboard_attitude_that_turns_otherwise_is_explained_by_the_loop_else_by_compass_or_unit() -> None:
    loop = judged(onboard=[turn(-0.065, "ATT")], loop=ClockRate(0.945, 60.0, "", 40.0))
    assert "main loop differ by 5.5 %" in loop.evidence[0]
    (by_compass,) = judged(onboard=[turn(-0.07, "ATT")], field=[turn(0.01)]).evidence
    (by_unit,) = judged(onboard=[turn(-0.07, "ATT")], units=[turn(0.01, "IMU2")]).evidence
    assert "MAG 1.010 times: the attitude is in error" in by_compass
    assert "IMU2 1.010 times: the attitude is in error" in by_unit
    assert judged(onboard=[turn(0.015, "ATT")], field=[turn(0.0)]).evidence == []


# Clocks.


def receiver(rate: float, seconds: float = 120.0, late_s: float = 0.0) -> FlightLog:
    """A log with dates of GNSS, of which ``rate`` s pass in a logged second; the last comes ``late_s`` late."""
    t = np.arange(0.0, seconds, 0.2)
    late = late_s * np.linspace(0.0, 1.0, len(t))
    utc = (1.7e15 + 1e6 * np.round(rate * (t - late), 3)).astype(np.int64)
    none = np.full(len(t), np.nan)
    log = made_log()
    log.gnss = [
        Gnss(0, t, "GPS", none, none, none, np.tile(none[:, None], 3), none, none, none, np.full(len(t), 3), utc_us=utc)
    ]
    return log


@pytest.mark.parametrize(("rate", "verdict"), [(1.0, "ok"), (1.0833, "fault"), (0.95, "fault"), (1.0005, "ok")])
def test_universal_time_shows_a_slow_clock(rate: float, verdict: str) -> None:
    log = receiver(rate)
    found = utc_rate(log)
    assert found is not None
    assert found.rate == pytest.approx(rate, abs=1e-5)
    check = checked(log)["log_clock"]
    assert (check.verdict, "slow" in check.text, "fast" in check.text) == (verdict, rate > 1.01, rate < 0.99)


def test_late_messages_of_a_short_record_and_simulated_time_are_no_slow_clock() -> None:
    assert clock_check(utc_rate(receiver(1.0, 34.0, late_s=0.09)), None).verdict == "ok"
    simulated = receiver(1.0833)
    simulated.simulated = True
    assert utc_rate(simulated) is None


def test_a_wrong_clock_is_of_the_log_and_not_of_the_flight() -> None:
    log = receiver(1.0833)
    (found,) = (f for f in findings(log, checked(log).values()) if f.kind == "log_clock")
    assert (found.severity, found.value) == ("warning", pytest.approx(-8.33, abs=0.01))


@pytest.mark.parametrize(
    ("interval_s", "main_loop", "log_clock"),
    [
        (0.04, "ok", "unknown"),
        (0.0423, "warning", "unknown"),
        (0.0369, "ok", "warning"),
        (0.0333, "unknown", "unknown"),
    ],
)
def test_the_interval_of_records_shows_a_slow_loop_and_a_slow_clock(
    interval_s: float, main_loop: str, log_clock: str
) -> None:
    log = made_log(compasses=0)
    log.firmware = Firmware("ArduPilot", "4.0.0")
    t = np.arange(0.0, SECONDS, interval_s)
    log.imus[0].gyro.t, log.imus[0].gyro.x = t, turns(t)[1]
    found = checked(log)
    assert (found["main_loop"].verdict, found["log_clock"].verdict) == (main_loop, log_clock)
    assert ("as they should" in found["main_loop"].text) is (interval_s == 0.04)


def test_a_loop_of_a_log_with_a_wrong_clock_is_judged_by_universal_time() -> None:
    log = receiver(0.95)
    log.firmware = Firmware("ArduPilot", "4.0.0")
    t = np.arange(0.0, SECONDS, 0.04 / 0.95)
    log.imus[0].gyro.t, log.imus[0].gyro.x = t, turns(t)[1]
    found = checked(log)
    assert (found["main_loop"].verdict, found["log_clock"].verdict) == ("ok", "fault")
    assert "40.0 ms, as they should" in found["main_loop"].text


def test_a_loop_that_keeps_the_time_of_a_slow_clock_has_no_load_to_reduce() -> None:
    log = receiver(1.0833)
    log.firmware = Firmware("ArduPilot", "4.0.0")
    t = np.arange(0.0, SECONDS, 0.02)
    log.imus[0].gyro.t, log.imus[0].gyro.x = t, turns(t)[1]
    found = checked(log)
    assert (found["main_loop"].verdict, found["log_clock"].verdict) == ("ok", "fault")


def test_intervals_of_two_kinds_show_no_main_loop() -> None:
    log = made_log(compasses=0)
    log.firmware = Firmware("ArduPilot", "4.0.0")
    t = np.cumsum(np.append(np.tile([0.01, 0.07], 500), 0.01))
    log.imus[0].gyro.t, log.imus[0].gyro.x = t, turns(t)[1]
    assert "main_loop" not in checked(log)
