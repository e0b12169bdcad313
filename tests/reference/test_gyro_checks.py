"""A gyro in other units, axes or another clock is found by what turned with the vehicle, and judges nobody."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import segments
from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, Imu, Mag, Stream
from attlog.health.attitude import attitude_checks
from attlog.health.check import HealthCase
from attlog.health.findings import contradiction
from attlog.health.gyro import unusable_gyro
from attlog.reference import choose, gyro_checks
from attlog.reference.model import GyroJump
from attlog.segments import Segment, Segments
from tests.reference.flights import Array, attitude_at, flight

FIELD_T = np.array([2e-5, 0.0, 4e-5])
DEGREES, RADIANS = 180.0 / np.pi, np.pi / 180.0

Change = Callable[[Array], Array]
WRONG: dict[str, Change] = {
    "deg/s for rad/s": lambda x: x * DEGREES,
    "rad/s twice": lambda x: x * RADIANS,
    "a half": lambda x: 0.5 * x,
    "clipped": lambda x: np.clip(x, -0.1, 0.1),
    "one sign": lambda x: x * [-1.0, 1.0, 1.0],
    "left-handed": lambda x: -x,
    "swapped axes": lambda x: x[:, [1, 0, 2]],
    "dead": lambda x: np.zeros_like(x),
    "dead from half on": lambda x: np.where((np.arange(len(x)) < len(x) // 2)[:, None], x, x[len(x) // 2]),
    "3 s late": lambda x: np.roll(x, 300, axis=0),
    "backwards": lambda x: x[::-1],
}


def with_compass(log: FlightLog) -> FlightLog:
    t = np.arange(0.0, 60.0, 0.05)
    field = rotation.rotate_inverse(attitude_at(t), FIELD_T)
    field = field + 2e-7 * np.random.default_rng(3).normal(size=field.shape) + [4e-6, 0.0, 0.0]  # noise, hard iron
    log.mags, log.mag = [Mag(0, Stream(t, field, "T", "FRD", "MAG"))], 0
    return log


def turned(change: Change) -> FlightLog:
    log = with_compass(flight(truth_hz=50.0))
    log.imus[0].gyro.x = change(log.imus[0].gyro.x)
    return log


@pytest.mark.parametrize("what", WRONG)
def test_the_field_finds_the_gyro_that_is_wrong(what: str) -> None:
    log = turned(WRONG[what])
    log.truth = None
    found = choose(log, segments.build(log))
    assert "turn differently" in found.faults.gyro
    assert found.kind == "onboard"
    assert "smoother" in found.faults.refused
    (against,) = [
        c for c in attitude_checks(HealthCase(log, segments.build(log), found)) if c.question == "gyro_against_attitude"
    ]
    assert against.verdict == "fault"
    assert "turn differently" in unusable_gyro(log, segments.build(log), found)


@pytest.mark.parametrize("what", ["one sign", "swapped axes", "3 s late"])
def test_the_field_finds_the_attitude_that_is_wrong_and_acquits_the_gyro(what: str) -> None:
    """The same contradiction from the other side: attitudes of a flight that the gyro did not see."""
    log = turned(lambda x: x)
    assert log.truth is not None
    t = log.truth.t
    log.truth.q = {
        "one sign": attitude_at(t) * [1.0, -1.0, 1.0, 1.0],
        "swapped axes": attitude_at(t)[:, [0, 2, 1, 3]],
        "3 s late": attitude_at(t - 3.0),
    }[what]
    found = choose(log, segments.build(log))
    assert found.faults.gyro == ""
    assert found.kind == "onboard"
    assert "turns as the gyro does" in found.faults.refused["truth"]
    (problem,) = contradiction(found)
    assert (problem.code, problem.severity) == ("reference_contradicted", "error")


def test_a_sound_flight_is_contradicted_by_nothing() -> None:
    log = turned(lambda x: 1.04 * x + 0.02)
    found = choose(log, segments.build(log))
    assert (found.faults.gyro, found.kind, found.faults.refused) == ("", "truth", {})


def test_without_a_compass_what_moves_alike_in_another_scale_is_not_judged_and_what_does_not_stays_open() -> None:
    log = flight()
    log.imus[0].gyro.x *= 0.5
    assert "which is right cannot be determined" in choose(log, segments.build(log)).faults.gyro
    log = flight()
    log.imus[0].gyro.x = log.imus[0].gyro.x[::-1].copy()
    assert choose(log, segments.build(log)).faults.gyro == ""


def test_a_slow_attitude_alone_accuses_no_gyro() -> None:
    log = flight(onboard_hz=5.0)
    log.imus[0].gyro.x *= 0.5
    assert choose(log, segments.build(log)).faults.gyro == ""
    assert "turns as the attitude does" in choose(with_compass(log), segments.build(log)).faults.gyro


def test_a_compass_that_moves_with_neither_decides_nothing() -> None:
    log = turned(lambda x: -x)
    log.mags[0].field.x = np.random.default_rng(5).permutation(log.mags[0].field.x)
    attitude = log.attitudes["ATT"]
    assert gyro_checks.field_follows(log.imus[0], attitude, np.zeros(0, np.int64), log.mags[0]) == ""


def test_vibration_of_the_gyro_is_no_scale() -> None:
    log = flight(onboard_hz=100.0)
    imu = log.imus[0]
    imu.gyro.x = imu.gyro.x + np.radians(10.0) * np.sin(2 * np.pi * 37.0 * imu.gyro.t)[:, None]
    (against,) = [
        c for c in attitude_checks(HealthCase(log, segments.build(log))) if c.question == "gyro_against_attitude"
    ]
    assert against.verdict == "ok"
    assert against.value == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("hz", [20.0, 100.0])
def test_an_interval_with_a_reset_is_not_compared(hz: float) -> None:
    log = flight(onboard_hz=hz)
    attitude = log.attitudes["ATT"]
    at = len(attitude.t) // 2 + 1
    attitude.q[at:] = rotation.multiply(rotation.from_euler(0.0, 0.0, 0.8), attitude.q[at:])
    gyro, turned_by = gyro_checks.mean_rates(log.imus[0], attitude, np.array([at]))
    assert np.abs(gyro - turned_by).max() < np.radians(2.0)
    jumped = np.subtract(*gyro_checks.mean_rates(log.imus[0], attitude, np.zeros(0, np.int64)))
    assert np.abs(jumped).max() > 5.0


@pytest.mark.parametrize(("scale", "is_wrong"), [(1.0, False), (0.25, True)])
def test_a_late_attitude_of_an_oscillating_vehicle_is_no_scale(scale: float, is_wrong: bool) -> None:
    """15 ms of 10 Hz are 54 deg of phase: without the delay the slope is cos 54 deg."""
    hz, size, late = 10.0, np.radians(2.0), 0.015
    t, logged = np.arange(0.0, 40.0, 0.0025), np.arange(0.0, 40.0, 0.01)
    rate = np.zeros((len(t), 3))
    rate[:, 0] = scale * size * 2.0 * np.pi * hz * np.cos(2.0 * np.pi * hz * t)
    imu = Imu(0, Stream(t, rate, "rad/s", "FRD", "gyro"), Stream(t, 0.0 * rate, "m/s^2", "FRD", "acc"))
    roll = size * np.sin(2.0 * np.pi * hz * (logged - late))
    attitude = Attitude(logged, rotation.from_euler(roll, 0.0 * roll, 0.0 * roll), "ATT")
    found = gyro_checks.gyro_consistency(imu, attitude, np.zeros(0, np.int64), None)
    assert bool(found.why) is is_wrong


def test_a_noisy_attitude_of_a_flight_that_turns_one_way_is_no_scale() -> None:
    """The median of its rates lies elsewhere than that of the gyro's; the slope is that of a line with an offset."""
    rng = np.random.default_rng(7)
    rate = np.zeros((2000, 3))
    rate[1100:, 2] = np.radians(8.0)  # still for longer than turning
    noise = np.radians(2.0) * rng.normal(size=rate.shape)
    assert gyro_checks.rate_mismatch(rate, rate + noise, (0.97, 1.03)) == ""
    assert "z 1.20" in gyro_checks.rate_mismatch(rate, 1.2 * rate + 0.1 * noise, (0.97, 1.03))


def test_a_gap_in_the_gyro_accuses_nobody() -> None:
    """The sample behind a gap stands for no second before it."""
    log = with_compass(flight(onboard_hz=50.0))
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        kept = (stream.t % 6.0 < 3.0) | (stream.t < 20.0)
        stream.t, stream.x = stream.t[kept], stream.x[kept]
    log.imus[0].gyro.sampling = log.imus[0].acc.sampling = "interval"
    assert choose(log, segments.build(log)).faults.gyro == ""
    gyro, turned_by = gyro_checks.mean_rates(log.imus[0], log.attitudes["ATT"], np.zeros(0, np.int64))
    assert len(gyro) > 100
    assert np.abs(gyro - turned_by).max() < np.radians(2.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_reversed_axis_is_found_where_the_vehicle_hardly_turns_about_it(samples: Path, axis: int) -> None:
    """Yaw of ``px4_steps`` has a standard deviation of 1.8 deg/s: too little for a scale, plenty for a sign."""
    log = attlog.read(samples / "px4_steps.ulg")
    imu, attitude = log.replay_imu, log.onboard_attitude
    assert imu is not None
    assert attitude is not None
    none = np.zeros(0, int)
    assert gyro_checks.gyro_consistency(imu, attitude, none, None).of == ""
    imu.gyro.x[:, axis] *= -1.0
    fault = gyro_checks.gyro_consistency(imu, attitude, none, None)
    assert fault.of == "gyro"
    assert f"reversed sign about {'xyz'[axis]}" in fault.why
    found = {check.question: check for check in attitude_checks(HealthCase(log, segments.build(log)))}[
        "gyro_against_attitude"
    ]
    assert found.verdict == "fault"


@pytest.mark.parametrize("seed", range(5))
def test_noise_an_askew_mount_and_one_bump_reverse_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    smooth = np.cumsum(rng.normal(size=(2000, 3)), axis=0)
    smooth = np.diff(smooth[:, :] - smooth.mean(axis=0), axis=0, prepend=0) * np.radians([20.0, 15.0, 1.0])
    quiet = np.array([False, False, True])

    def said(by_gyro: Array, by_attitude: Array) -> str:
        return gyro_checks.reversed_slowly(
            gyro_checks.center_rates(by_gyro), gyro_checks.center_rates(by_attitude), ~quiet
        )

    assert said(smooth, smooth * [1.0, 1.0, -1.0]) == "reversed sign about z."
    assert said(smooth, smooth) == ""
    assert said(smooth, rng.permutation(smooth)) == ""
    for degrees in (-12.0, 12.0):  # roll and pitch, twenty times the yaw, show in it with either sign
        askew = rotation.rotate(rotation.from_rotvec(np.radians([degrees, -degrees, 0.0])), smooth)
        assert said(askew, smooth) == ""
    bump = smooth + np.outer(np.arange(2000) == 700, np.radians([0.0, 0.0, 120.0]))
    assert said(bump, smooth - (bump - smooth)) == ""
    assert said(smooth, smooth * [1.0, 1.0, -0.5]) == ""  # half of a turn the other way is no reversed sensor


# Does the gyro jump for single samples?


def gyro(rate):
    t = np.arange(len(rate)) / 200.0
    return Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU"), Stream(t, np.zeros_like(rate), "m/s^2", "FRD", "IMU"))


def flown(n=12000):
    t = np.arange(n) / 200.0
    turns = np.column_stack([np.sin(t), 3.0 * np.sin(2.0 * t) ** 9, 0.5 * np.cos(t)])
    return turns + np.radians(0.3) * np.random.default_rng(1).normal(size=(n, 3))


def test_spikes_are_counted_and_their_turn_is_summed():
    rate = flown()
    rate[1000::1000, 1] += 20.0
    found = gyro_checks.find_spikes(gyro(rate))
    assert found.count == 11
    assert found.deg_per_min == pytest.approx(11 * np.degrees(20.0 / 200.0), rel=0.02)
    assert found.t == pytest.approx(5.0)
    assert found.misleads


def test_a_sample_beside_a_gap_is_no_spike():
    """What turned during the gap is not there, so that the neighbours tell nothing."""
    rate = flown()
    rate[1000::1000, 1] += 20.0
    unit = gyro(rate)
    unit.gyro.t = unit.gyro.t + 0.02 * (np.arange(len(rate)) // 1000)
    assert gyro_checks.find_spikes(unit).count == 0


# Spikes of a gyro: each limit from both sides, and samples that stand for themselves on another clock.

HZ = 100.0
N = 3000


def unit(dps: float = 0.0, count: int = 6, change: float = 0.0, noise: float = 0.0, blow: tuple[float, float] = (0, 0)):
    """So many samples jump about z; their neighbours differ by ``change``; a blow has a force and is so late."""
    t = np.arange(N) / HZ
    rate = np.zeros((N, 3))
    rate[::2, 0] = np.radians(noise)  # each is so far from the mean of its neighbours
    at = 200 + 400 * np.arange(count)
    rate[at, 2] += np.radians(dps)
    rate[at - 1, 1] -= np.radians(0.5 * change)
    rate[at + 1, 1] += np.radians(0.5 * change)
    force = np.tile([0.0, 0.0, -9.81], (N, 1))
    stamps = t.copy()
    if blow[0]:
        force[at, 1] = np.sqrt(blow[0] ** 2 - 9.81**2)
        stamps = t + blow[1]
    return Imu(0, Stream(t, rate, "rad/s", "FRD", "IMU:0"), Stream(stamps, force, "m/s^2", "FRD", "IMU:0"))


@pytest.mark.parametrize(
    ("made", "count"),
    [
        (unit(99.0), 0),
        (unit(101.0), 6),
        (unit(158.0, noise=8.0), 0),
        (unit(163.0, noise=8.0), 6),
        (unit(130.0, change=44.0), 0),
        (unit(130.0, change=43.0), 6),
        (unit(130.0, blow=(29.9, 0.0)), 6),
        (unit(130.0, blow=(30.1, 0.0)), 0),
        (unit(130.0, blow=(40.0, 0.019)), 0),
        (unit(130.0, blow=(40.0, 0.021)), 6),
        (unit(130.0, blow=(40.0, -0.019)), 0),
        (unit(130.0, blow=(40.0, -0.021)), 6),
    ],
)
def test_a_spike_is_far_from_its_neighbours_alone_and_no_blow(made: Imu, count: int) -> None:
    assert gyro_checks.find_spikes(made).count == count


@pytest.mark.parametrize(("dps", "misleads"), [(165.0, False), (168.0, True)])
def test_twenty_degrees_in_a_minute_mislead(dps: float, misleads: bool) -> None:
    """Six of 10 ms in half a minute."""
    assert gyro_checks.find_spikes(unit(dps)).misleads is misleads


@pytest.mark.parametrize(
    ("at_rest_dps", "steps", "contradicted"),
    [(2.0, [2.0], False), (0.0, [2.0], True), (0.0, [2.0, -2.0], False), (-2.0, [2.0], True)],
)
def test_a_step_of_the_gyro_bias_that_is_missing_at_rest_is_none(
    at_rest_dps: float, steps: list[float], contradicted: bool
) -> None:
    t = np.arange(0.0, 60.0, 0.01)
    rate = np.radians(at_rest_dps) * np.outer(t > 30.0, [0.0, 0.0, 1.0])
    unit = Imu(0, Stream(t, rate, "rad/s", "FRD", "I"), Stream(t, rate, "m/s^2", "FRD", "I"))
    phases = Segments([Segment("rest.long", 0.0, 10.0), Segment("rest.long", 50.0, 60.0)])
    jumps = [GyroJump(25.0 + 5.0 * k, (0.0, 0.0, x), (0.1, 0.1, 0.1)) for k, x in enumerate(steps)]
    assert bool(gyro_checks.contradicted_at_rest(unit, phases, jumps)) is contradicted
    assert gyro_checks.contradicted_at_rest(unit, Segments(), jumps) == ""
